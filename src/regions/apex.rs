//! Recovers the tips of cones, where one smooth region meets itself.
//!
//! ```text
//!          x             x  apex: where the cone of the samples round the tip ends
//!         ´ `
//!        o---o           o  samples of the tip: the one that is best placed moves onto the apex
//!       /     \
//!      o       o         o  samples of the cone: they alone say where it is
//! ```
//!
//! Between two regions there is a crease, and where three meet there is a corner; the tip of a cone is a corner of
//! one region, and no edge there is a chamfer. So it is looked for where the faces turn by much within a few
//! edges, by the angles that are missing round vertices, and believed only if *all* samples within reach lie on one
//! cone, those of the tip too: a tip that is round does not lie on the cone of its sides.
//!
//! No vertex is inserted; edges that cut into the cone beside the apex are flipped (`valleys.rs`).
//!
//! Based on: nothing in the papers, which recover edges only.
//! In/out: `Surface` + chamfers -> `Apex`es, ascending.
//! Cost: O(doubtful vertices) for the angles, some 20 microseconds for each of the few that stand out, in parallel.

mod cone;
#[cfg(test)]
mod tests;
mod valleys;

use std::f64::consts::{PI, TAU};

use glam::DVec3;
use rayon::prelude::*;

use super::Surface;
use super::gates::{Fate, Strip, set_apart};
use crate::geometry::{angle_between, unit_normal};
use crate::mesh::{Half, Vert};
use cone::{Cone, Fitted};

/// Angles missing round a vertex and its neighbours together, in radians: less is no tip that is worth it. A cone whose
/// sides are 72 degrees from its axis has this much; what cutting it takes off is a fifth of h high.
const MIN_DEFECT: f64 = 0.3;
/// Samples within this distance of the vertex that stands out have to lie on the cone, in h ...
const REACH: f64 = 4.5;
/// ... those beyond this say where its apex is: samples of a tip are off it on marching cubes (five apexes off by .06 to
/// .12 h with them, by .01 to .06 without) ...
const OUTER: f64 = 2.5;
/// ... and those between these have to say the same: of a round tip they say something else.
const INNER: std::ops::Range<f64> = 1.0..3.0;
/// So far, in h: .14 at most on cones on marching cubes, 1 and more on round tips of three edges and more.
const MAX_APART: f64 = 0.15;
/// So many samples have to be on each side, three for each two unknowns of a cone.
const MIN_SAMPLES: usize = 9;
/// More are no patch of a regular sampling: marching cubes have 110.
const MAX_SAMPLES: usize = 256;
/// Residual of the samples, in h: .02 on marching cubes, where they are terraced .03 (and the apex .18 off).
const MAX_RMS: f64 = 0.025;
/// A sample may be as far off as this many times the residual of those that say where the apex is: at the tips of cones
/// on marching cubes 22, at tips that are round by an edge's length 27 and more ...
const MAX_OFF_IN_RMS: f64 = 24.0;
/// ... or this far, in h: the facets of what was sampled. Samples of round tips are .012 off and more.
const MAX_OFF: f64 = 0.01;
/// Standard error of the apex, in h: .07 at most on marching cubes.
const MAX_ERROR: f64 = 0.1;
/// No gap round the axis between samples is wider, in radians: 36 degrees on cones whose sides are 27 from the axis.
const MAX_GAP: f64 = PI / 2.0;
/// The apex is this close to a sample at least, in h: .1 to 1.5 where the sides are 27 degrees from the axis or more. A
/// needle of 11 degrees has 3.6; but then a tip that is round by half an edge looks the same.
const MAX_LIFT: f64 = 2.0;
/// Samples within this distance of the apex are those of the tip, in h ...
const TIP: f64 = 2.0;
/// ... and move onto the cone if they are farther off than this, in h, as samples beside creases do ...
const MIN_MOVE: f64 = 0.003;
/// ... and this many times the residual.
const MIN_MOVE_IN_RMS: f64 = 3.0;
/// A face at a sample that moves is closer to the cone's normal in the end: 60 degrees, or it is bad as untangling has it.
const MIN_COSINE: f64 = 0.5;

/// The tip of a cone.
#[derive(Clone, Debug, PartialEq)]
pub struct Apex {
    /// The vertex that is the apex.
    pub vertex: Vert,
    /// Where the apex is.
    pub point: DVec3,
    /// How many samples say so.
    pub n_samples: usize,
    /// Their residual, in mean edge lengths.
    pub rms: f64,
    cone: Cone,
    /// Whether the tip sticks out; else it is the bottom of a pit.
    is_convex: bool,
    /// The vertices that move, and where to.
    moved: Vec<(Vert, DVec3)>,
    /// Chamfer edges on the cone, which are none.
    edges: Vec<Half>,
}

/// Finds the tips of cones away from `chamfers`, ascending.
pub(super) fn find(surface: &Surface, chamfers: &[Half]) -> Vec<Apex> {
    let mut is_end = vec![false; surface.near.verts.len()];
    let ends = chamfers.iter().flat_map(|&h| surface.mesh.ends(h));
    ends.for_each(|v| is_end[surface.near.of[v] as usize] = true);
    let candidates = candidates(surface, &is_end);
    let found = candidates.par_iter().filter_map(|&i| Patch::around(surface, i)?.apex(chamfers, &is_end));
    let mut apexes: Vec<Apex> = found.collect();
    // Two vertices may stand out at one tip.
    apexes.sort_by_key(|apex| apex.vertex);
    let mut apart: Vec<Apex> = Vec::new();
    for apex in apexes {
        if apart.iter().all(|other| other.point.distance(apex.point) > REACH * surface.h) {
            apart.push(apex);
        }
    }
    apart
}

/// Numbers of the doubtful vertices with the most missing angle among their neighbours, and enough of it: of those that
/// are not interior and no ends of chamfers.
fn candidates(surface: &Surface, is_end: &[bool]) -> Vec<u32> {
    let near = &surface.near;
    let is_open = |&i: &u32| !near.interior[i as usize] && !is_end[i as usize];
    let open: Vec<u32> = surface.doubtful.iter().map(|&v| near.of[v]).filter(is_open).collect();
    let found: Vec<f64> = open.par_iter().map(|&i| defect(surface, near.verts[i as usize])).collect();
    let mut defects = vec![0.0; near.verts.len()];
    open.iter().zip(found).for_each(|(&i, defect)| defects[i as usize] = defect);
    let defect = |i: u32| defects[i as usize];
    let stands_out = |&i: &u32| {
        let around = near.neighbours(i);
        defect(i) > 0.0
            && defect(i) + around.iter().map(|&j| defect(j)).sum::<f64>() >= MIN_DEFECT
            && around.iter().all(|&j| (defect(j), j) < (defect(i), i))
    };
    open.into_par_iter().filter(stands_out).collect()
}

/// What the angles round `v` lack to a full turn.
fn defect(surface: &Surface, v: Vert) -> f64 {
    let mesh = surface.mesh;
    let p = mesh.point(v);
    let angle = |&h: &Half| angle_between(mesh.point(mesh.to(h)) - p, mesh.point(mesh.opposite(h)) - p);
    TAU - mesh.leaving(v).iter().map(angle).sum::<f64>()
}

/// The samples within reach of one, in mean edge lengths from it.
struct Patch<'s, 'a> {
    surface: &'s Surface<'a>,
    centre: DVec3,
    verts: Vec<Vert>,
    points: Vec<DVec3>,
}

impl<'s, 'a> Patch<'s, 'a> {
    /// The samples joined to the near vertex with the number `i`; none if they are too many, or at a border.
    fn around(surface: &'s Surface<'a>, i: u32) -> Option<Self> {
        let Surface { mesh, near, h, .. } = surface;
        let centre = near.points[i as usize];
        let mut members = vec![i];
        let mut next = 0;
        while next < members.len() {
            for &j in near.neighbours(members[next]) {
                if near.points[j as usize].distance(centre) <= REACH * h && !members.contains(&j) {
                    members.push(j);
                }
                if members.len() > MAX_SAMPLES {
                    return None;
                }
            }
            next += 1;
        }
        let verts: Vec<Vert> = members.iter().map(|&j| near.verts[j as usize]).collect();
        let is_at_border =
            |v: &Vert| mesh.leaving(*v).iter().any(|&h| mesh.is_border(h) || mesh.is_border(h.prev()));
        if mesh.n_borders() > 0 && verts.iter().any(is_at_border) {
            return None;
        }
        let points = members.iter().map(|&j| (near.points[j as usize] - centre) / *h).collect();
        Some(Self { surface, centre, verts, points })
    }

    /// The points that are so far from the first one.
    fn ring(&self, distances: std::ops::Range<f64>) -> Vec<DVec3> {
        self.points.iter().copied().filter(|p| distances.contains(&p.length())).collect()
    }

    /// The sum of the unit normals of the faces at all samples.
    fn normal(&self) -> DVec3 {
        let Surface { mesh, face_normals, .. } = self.surface;
        let halves = self.verts.iter().flat_map(|&v| mesh.leaving(v));
        halves.map(|h| face_normals[h.face()]).sum::<DVec3>().normalize_or_zero()
    }

    /// The apex of the cone that the samples lie on, if they do and it can be put back.
    fn apex(&self, chamfers: &[Half], is_end: &[bool]) -> Option<Apex> {
        let edges = self.own_edges(chamfers, is_end)?;
        let normal = self.normal();
        let is_convex = self.points.iter().map(|p| p.dot(normal)).sum::<f64>() < 0.0;
        let (cone, rms, n_samples) = self.cone(if is_convex { -normal } else { normal })?;
        let lift = |i: usize| self.points[i].distance(cone.apex);
        let nearest = (0..self.verts.len())
            .min_by(|&i, &j| lift(i).total_cmp(&lift(j)).then(self.verts[i].cmp(&self.verts[j])))?;
        let moved = self.moves(&cone, rms, nearest);
        let is_recovered = lift(nearest) <= MAX_LIFT && self.is_sound(&cone, is_convex, &moved);
        let place = |p: DVec3| self.centre + self.surface.h * p;
        is_recovered.then(|| Apex {
            vertex: self.verts[nearest],
            point: place(cone.apex),
            n_samples,
            rms,
            cone: Cone { apex: place(cone.apex), ..cone },
            is_convex,
            moved: moved.into_iter().map(|(v, p)| (v, place(p))).collect(),
            edges,
        })
    }

    /// The chamfer edges among the samples; none if one leads out of them.
    fn own_edges(&self, chamfers: &[Half], is_end: &[bool]) -> Option<Vec<Half>> {
        let Surface { mesh, near, .. } = self.surface;
        let ends = self.verts.iter().filter(|&&v| is_end[near.of[v] as usize]);
        let edges = ends.flat_map(|&v| mesh.leaving(v).iter().flat_map(|&h| [h, h.prev()]));
        let mut edges: Vec<Half> =
            edges.map(|h| mesh.edge(h)).filter(|h| chamfers.binary_search(h).is_ok()).collect();
        edges.sort_unstable();
        edges.dedup();
        let is_own = |&h: &Half| mesh.ends(h).iter().all(|v| self.verts.contains(v));
        edges.iter().all(is_own).then_some(edges)
    }

    /// The cone, what the samples leave of it and how many they are, if they are all on it and go all round it.
    fn cone(&self, down: DVec3) -> Option<(Cone, f64, usize)> {
        let (mut far, mut deep) = (0.0, 0.0);
        for p in &self.points {
            let s = p.dot(down);
            (far, deep) = (far + (*p - s * down).length(), deep + s);
        }
        let guess = Cone { apex: DVec3::ZERO, down, angle: f64::atan2(far, deep) };
        let (inner, outer, all) =
            (self.ring(INNER), self.ring(OUTER..f64::MAX), self.ring(INNER.start..f64::MAX));
        // All of a cone is below its tip; of most that is none something is not, and no fit has to say so.
        let is_below = outer.iter().all(|p| p.dot(down) > 0.0);
        if inner.len() < MIN_SAMPLES || outer.len() < MIN_SAMPLES || !is_below {
            return None;
        }
        let Fitted { cone, spread } = guess.fit(&outer)?;
        let other = cone.fit(&inner)?.cone;
        let rms = cone.rms(&outer);
        let most = MAX_OFF.max(MAX_OFF_IN_RMS * rms);
        let is_on = |&p: &DVec3| cone.distance(p).abs() <= most && (p - cone.apex).dot(cone.down) > -most;
        let is_cone = cone.rms(&all) <= MAX_RMS
            && rms * spread <= MAX_ERROR
            && other.apex.distance(cone.apex) <= MAX_APART
            && self.points.iter().all(is_on)
            && widest_gap(&cone, &outer) <= MAX_GAP;
        is_cone.then_some((cone, rms, outer.len()))
    }

    /// Which vertices move if the sample `apex` becomes the apex, ascending, and where to in the patch.
    fn moves(&self, cone: &Cone, rms: f64, apex: usize) -> Vec<(Vert, DVec3)> {
        let least = MIN_MOVE.max(MIN_MOVE_IN_RMS * rms);
        let moved = |(i, (&v, &p)): (usize, (&Vert, &DVec3))| {
            let distance = cone.distance(p);
            if i == apex {
                (p.distance(cone.apex) > MIN_MOVE).then_some((v, cone.apex))
            } else {
                let is_off = distance.abs() > least && p.distance(cone.apex) <= TIP;
                is_off.then(|| (v, p - distance * cone.normal(p)))
            }
        };
        let mut moves: Vec<(Vert, DVec3)> =
            self.verts.iter().zip(&self.points).enumerate().filter_map(moved).collect();
        moves.sort_unstable_by_key(|&(v, _)| v);
        moves
    }

    /// Whether the faces at vertices that move look away from the cone's axis in the end, or towards it in a pit.
    fn is_sound(&self, cone: &Cone, is_convex: bool, moved: &[(Vert, DVec3)]) -> bool {
        let Surface { mesh, h, .. } = self.surface;
        let point = |v: Vert| {
            let i = moved.binary_search_by_key(&v, |&(v, _)| v);
            i.map_or_else(|_| (mesh.point(v) - self.centre) / *h, |i| moved[i].1)
        };
        let outward = if is_convex { 1.0 } else { -1.0 };
        let faces = moved.iter().flat_map(|&(v, _)| mesh.leaving(v)).map(|h| h.face());
        faces.into_iter().all(|f| {
            let triangle = mesh.corners(f).map(point);
            let middle = triangle.into_iter().sum::<DVec3>() / 3.0;
            unit_normal(triangle).is_some_and(|n| outward * n.dot(cone.normal(middle)) > MIN_COSINE)
        })
    }
}

/// The widest angle round the axis without a point, in radians.
fn widest_gap(cone: &Cone, points: &[DVec3]) -> f64 {
    let (e, f) = cone.down.any_orthonormal_pair();
    let azimuth = |&p: &DVec3| f64::atan2(cone.away(p).dot(f), cone.away(p).dot(e));
    let mut azimuths: Vec<f64> = points.iter().map(azimuth).collect();
    azimuths.sort_unstable_by(f64::total_cmp);
    let across = azimuths.first().zip(azimuths.last()).map_or(TAU, |(first, last)| first + TAU - last);
    azimuths.windows(2).map(|pair| pair[1] - pair[0]).fold(across, f64::max)
}

/// Leaves the candidate edges on the cones of `apexes` alone, as a strip of their own each.
pub(super) fn cancel_edges(
    apexes: &[Apex],
    candidates: &[Half],
    strip_of: &mut [u32],
    strips: &mut Vec<Strip>,
) {
    for apex in apexes {
        let on_cone = |strip: &Strip| Strip { fate: Fate::Cone, ..strip.clone() };
        set_apart(&apex.edges, candidates, strip_of, strips, on_cone);
    }
}

/// Adds the vertices that `apexes` move to those that are `moved`, ascending.
pub(super) fn add_moves(apexes: &[Apex], moved: &mut Vec<(Vert, DVec3)>) {
    // First, so that of two places that of the apex counts.
    let of_apexes: Vec<_> = apexes.iter().flat_map(|apex| apex.moved.iter().copied()).collect();
    if !of_apexes.is_empty() {
        moved.splice(0..0, of_apexes);
        moved.sort_by_key(|&(v, _)| v);
        moved.dedup_by_key(|&mut (v, _)| v);
    }
}
