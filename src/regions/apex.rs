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
    let ends = chamfers.iter().flat_map(|&h| [surface.mesh.from(h), surface.mesh.to(h)]);
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
        let is_own = |&h: &Half| [mesh.from(h), mesh.to(h)].iter().all(|v| self.verts.contains(v));
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Mesh;
    use crate::mesh::tests::mesh;
    use crate::regions::tests::labels;
    use crate::regions::{MAX_SHIFT, RegionLabels, label_by_fits, place_by_fits, verdict};
    use approx::assert_relative_eq;
    use glam::dvec3;

    const N: usize = 20;

    /// The graph of `height` over a grid of N x N squares of length 1 whose middle is near the origin.
    fn graph(height: impl Fn(f64, f64) -> f64) -> Mesh {
        let points: Vec<[f64; 3]> = (0..(N + 1) * (N + 1))
            .map(|k| [(k / (N + 1)) as f64 - 9.7, (k % (N + 1)) as f64 - 10.4])
            .map(|[x, y]| [x, y, height(x, y)])
            .collect();
        let square = |k: usize| {
            let [i, j] = [k / N, k % N];
            let [a, b, c, d] = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]].map(|[i, j]| i * (N + 1) + j);
            [[a, b, c], [a, c, d]]
        };
        mesh(&points, &(0..N * N).flat_map(square).collect::<Vec<_>>())
    }

    /// Between -1 and 1, and no pattern that a cone has.
    fn noise(x: f64, y: f64) -> f64 {
        (78.233 * x + 12.9898 * y).sin()
    }

    fn run(m: &Mesh) -> RegionLabels {
        let (normals, labels) = labels(m);
        label_by_fits(m, &normals, &labels)
    }

    #[test]
    fn a_cone_gets_its_apex_back_and_nothing_else_moves() {
        for slope in [0.5, 1.0, 1.5, -1.0] {
            let m = graph(|x, y| 3.0 - slope * x.hypot(y));
            let found = run(&m);
            let [apex] = &found.apexes[..] else { panic!("{slope}: {:?}", found.apexes) };
            assert!(apex.point.distance(dvec3(0.0, 0.0, 3.0)) < 1e-9, "{slope}: {}", apex.point);
            assert!(apex.rms < 1e-9 && apex.n_samples > 20);
            // The nearest sample is that at (.3, -.4).
            assert_eq!(m.point(apex.vertex).truncate(), glam::dvec2(10.0 - 9.7, 10.0 - 10.4));
            assert_eq!(found.moved, [(apex.vertex, apex.point)]);
            assert!(found.chamfers.is_empty());
            let placement = place_by_fits(&m, &found, MAX_SHIFT);
            assert_eq!(placement.inserts.moved, found.moved);
            let corners = verdict(&m, &found, &placement).corners;
            let support: Vec<_> =
                corners.iter().map(|c| (c.at, c.edges, c.least_samples, c.placed)).collect();
            assert_eq!(support, [(apex.point.to_array(), 0, apex.n_samples, 1.0)]);
        }
    }

    #[test]
    fn a_tip_that_is_there_is_found_and_nothing_changes() {
        for lower in [0.0, 0.0005] {
            let tip = |r: f64| if r == 0.0 { lower } else { 0.0 };
            let m = graph(|x, y| {
                let r = (x - (10.0 - 9.7)).hypot(y - (10.0 - 10.4));
                3.0 - r - tip(r)
            });
            let sharpened = crate::sharpen(&m, &crate::Options::default()).unwrap();
            assert_eq!((sharpened.report.found.apexes, sharpened.report.changed), (1, false));
            assert_eq!((sharpened.mesh.points(), sharpened.mesh.faces()), (m.points(), m.faces()));
            assert_eq!(sharpened.tags.tagged().len(), 1);
        }
    }

    #[test]
    fn what_only_looks_like_a_cone_is_left_alone() {
        let none = |what: &str, height: &dyn Fn(f64, f64) -> f64| {
            let m = graph(height);
            let (normals, labels) = labels(&m);
            let surface = Surface::new(&m, &normals, &labels);
            let is_end = vec![false; surface.near.verts.len()];
            assert!(!candidates(&surface, &is_end).is_empty(), "{what}: nothing was looked at");
            assert!(run(&m).apexes.is_empty(), "{what}");
        };
        none("a hyperboloid", &|x, y| -(x * x + y * y + 0.2).sqrt());
        none("a cone with a ball of one and a half edges as its tip", &|x, y| {
            let r = x.hypot(y);
            let round: f64 = 1.5;
            if r < round / 2f64.sqrt() { (round * round - r * r).sqrt() - 2f64.sqrt() * round } else { -r }
        });
        none("a cone cut off flat", &|x, y| -x.hypot(y).max(1.0));
        none("a pyramid of four sides", &|x, y| -x.abs().max(y.abs()));
        none("a cone of an ellipse", &|x, y| -(x.hypot(1.4 * y)));
        none("a horn", &|x, y| -3.0 * x.hypot(y).powf(0.8));
        none("noise on a cone", &|x, y| 0.1 * noise(x, y) - x.hypot(y));
    }

    #[test]
    fn a_little_noise_hides_no_apex() {
        let m = graph(|x, y| 0.01 * noise(x, y) - x.hypot(y));
        let [apex] = &run(&m).apexes[..] else { panic!("none") };
        assert!(apex.point.length() < 0.05, "{}", apex.point);
        assert_relative_eq!(
            apex.rms,
            0.01 / 2f64.sqrt() / 2f64.sqrt() / run(&m).mean_edge,
            max_relative = 0.5
        );
    }

    #[test]
    fn samples_of_the_tip_that_are_off_the_cone_move_onto_it() {
        // Marching cubes put the sample at (.3, .6) lower than the cone.
        let low = |x: f64, y: f64| if (x - 0.3).hypot(y - 0.6) < 1e-6 { 0.12 } else { 0.0 };
        let m = graph(|x, y| 0.015 * noise(x, y) - low(x, y) - x.hypot(y));
        let found = run(&m);
        let [apex] = &found.apexes[..] else { panic!("none") };
        let [other] = &found.moved.iter().filter(|moved| moved.0 != apex.vertex).collect::<Vec<_>>()[..]
        else {
            panic!("{:?}", found.moved)
        };
        let was = m.point(other.0);
        assert_eq!(low(was.x, was.y), 0.12);
        let off = |p: DVec3| ((p - apex.point).truncate().length() + (p - apex.point).z).abs();
        assert!(off(was) > 0.1 && off(other.1) < 0.02, "{} {}", off(was), off(other.1));
    }

    #[test]
    fn chamfers_on_the_cone_go_and_one_that_leads_away_is_believed() {
        let m = graph(|x, y| -x.hypot(y));
        let (normals, labels) = labels(&m);
        let surface = Surface::new(&m, &normals, &labels);
        let middle =
            (0..m.n_verts()).map(Vert::new).find(|&v| m.point(v).truncate().length() < 0.51).unwrap();
        // The edges across from the vertex next to the apex.
        let mut chamfers: Vec<Half> = m.leaving(middle).iter().map(|h| m.edge(h.next())).collect();
        chamfers.sort_unstable();
        let apexes = find(&surface, &chamfers);
        assert_eq!(apexes[0].edges, chamfers);
        // A strip of all candidates, of which two are not on the cone.
        let far = [m.edge(Half::new(0)), m.edge(Half::new(1))];
        let mut candidates = [&chamfers[..], &far].concat();
        candidates.sort_unstable();
        let strip = Strip {
            n_edges: candidates.len(),
            displacement: 0.0,
            rms: 0.0,
            inward: 0.0,
            n_inward: 0,
            guessed: 0.0,
            fate: Fate::Kept,
        };
        let (mut strip_of, mut strips) = (vec![0; candidates.len()], vec![strip]);
        cancel_edges(&apexes, &candidates, &mut strip_of, &mut strips);
        assert_eq!(crate::regions::kept(&candidates, &strip_of, &strips), far);
        let fates: Vec<_> = strips.iter().map(|strip| (strip.n_edges, strip.fate)).collect();
        assert_eq!(fates, [(2, Fate::Kept), (chamfers.len(), Fate::Cone)]);
        // Seven edges from a neighbour on lead out of the patch.
        let along = |h: &&Half| m.point(m.to(**h)).y == m.point(middle).y;
        let mut line = vec![m.to(*m.leaving(middle).iter().find(along).unwrap())];
        while line.len() < 8 {
            let next = |h: &&Half| along(h) && m.to(**h) != middle && !line.contains(&m.to(**h));
            line.push(m.to(*m.leaving(line[line.len() - 1]).iter().find(next).unwrap()));
        }
        let edge = |pair: &[Vert]| m.edge(m.half_between(pair[0], pair[1]).unwrap());
        let mut crease: Vec<Half> = line.windows(2).map(edge).collect();
        crease.sort_unstable();
        assert_eq!(find(&surface, &crease), []);
    }

    #[test]
    fn moves_of_an_apex_come_before_others() {
        let at = |v: usize, x: f64| (Vert::new(v), DVec3::splat(x));
        let apex = |moved| Apex {
            vertex: Vert::new(5),
            point: DVec3::ZERO,
            n_samples: 0,
            rms: 0.0,
            cone: Cone { apex: DVec3::ZERO, down: DVec3::Z, angle: 0.5 },
            is_convex: true,
            moved,
            edges: Vec::new(),
        };
        let mut moved = vec![at(1, 1.0), at(5, 2.0), at(9, 3.0)];
        add_moves(&[apex(vec![at(5, 0.0), at(7, 0.5)])], &mut moved);
        assert_eq!(moved, [at(1, 1.0), at(5, 0.0), at(7, 0.5), at(9, 3.0)]);
    }
}
