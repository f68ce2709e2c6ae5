//! Frees the chamfer zone of folds: mends faces that look away from the surface their fit predicts.
//!
//! ```text
//!   old vertex o beyond the crease     coincident crease vertices     a vertex off its feature
//!        x---y---z                         x-yy'-z                        x---v---z
//!         \ / `o/                           \||/                           \  |  /
//!          o---o       collapse o->y         oo      collapse y->y'          `o´    flip, move back
//! ```
//!
//! A face is *bad* when its normal is far from the one that the fit of its representative (an old
//! vertex with a label) predicts. Every operation must lower the summed energy of the faces that it
//! touches and keep them on their fits. First short edges are collapsed; then bad faces are mended,
//! worst first, and edges of four faces loosened where a sheet folds along them; what nothing else cures
//! goes back towards the middle; then slivers are cleared, and edges that still fold are flipped; vertices
//! that lie so low over a crease that it may run beyond them are collapsed; last, bad faces that cut others
//! are pulled out of them.
//!
//! Based on: nothing in the papers, whose clean-up only looks at angles below 1 degree.
//! In/out: edits the refined mesh in place, in the *zone* only: the faces at vertices of split faces.
//! Old vertices may be collapsed there, never moved.
//! Cost: O(bad faces) per round, at most 20 rounds.

mod cross;
mod fold;
mod loosen;
mod low;
mod moves;
mod respace;
#[cfg(test)]
mod tests;

use glam::DVec3;
use rayon::prelude::*;

use crate::edit::Edit;
use crate::excerpt::Excerpt;
use crate::fit::Fit;
use crate::mesh::{Face, Mesh, PerFace, PerVert, Vert};
use crate::refine::Refined;
use loosen::Loosening;

/// A face whose normal is more than 60 degrees from the predicted one is bad ...
const BAD_COSINE: f64 = 0.5;
/// ... but one with a corner farther than this from its fit (in mean edge lengths: dead ends, mixed
/// strips) is not expected to follow it, and is bad only when turned by more than 90 degrees. Without
/// the distinction a fandisk loses up to 30 % of its gain.
const RELIABLE_RESIDUAL: f64 = 0.15;
/// A new face may be this far from its fit, or as far as it was, in mean edge lengths.
const FACE_TOLERANCE: f64 = 0.1;
/// The middle of a new crease edge may be this far from the fits on its sides, in mean edge lengths.
const CREASE_TOLERANCE: f64 = 0.05;
/// Edges shorter than this (in mean edge lengths) at inserted vertices are collapsed beforehand:
/// coincident vertices make a third of all bad faces.
const SHORT_EDGE: f64 = 0.05;
/// An operation must lower the energy by more than this; a good face has none, a bad one 1 or more.
const MIN_GAIN: f64 = 1e-3;
/// Sine of the smallest angle that is no sliver: the papers' 1 degree.
const SLIVER_SINE: f64 = 0.017_452_406_437_283_51;
/// Rounds until nothing changes are 7 to 10.
const MAX_ROUNDS: usize = 20;

/// What untangling did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct UntangleCounts {
    /// Bad faces before.
    pub bad_before: usize,
    /// Bad faces and slivers that nothing mended.
    pub left: usize,
    /// Edges collapsed, short ones and those of low faces included.
    pub collapsed: usize,
    /// Edges of four faces that have two now.
    pub loosened: usize,
    /// Edges flipped.
    pub flipped: usize,
    /// Crease vertices that were spaced anew along their crease.
    pub respaced: usize,
    /// Inserted vertices that went back towards the middle of their edge.
    pub moved_back: usize,
}

/// What untangling needs to know about the mesh that was refined.
pub(crate) struct Context<'a> {
    /// The mesh before subdivision.
    pub before: &'a Mesh,
    /// The excerpt of it that was refined, if it is not all there is.
    pub excerpt: Option<&'a Excerpt<'a>>,
    /// The mesh after it, or the excerpt.
    pub refined: &'a Refined,
    /// How many of its vertices are old ones.
    pub n_old: usize,
    /// The fit of each old vertex, if it has one.
    pub fits: PerVert<Option<&'a Fit>>,
    /// Whether an old vertex is an end of a chamfer edge.
    pub is_chamfer_end: &'a (dyn Fn(Vert) -> bool + Sync),
    /// Whether an inserted vertex went onto its feature.
    pub is_moved: &'a (dyn Fn(Vert) -> bool + Sync),
    /// Mean edge length of the mesh before subdivision.
    pub mean_edge: f64,
}

/// How bad a face is.
#[derive(Clone, Copy, Default)]
struct Energy {
    /// 0 when good, 1 to 2.5 when bad, the more the farther it is turned.
    turned: f64,
    /// 0.2 to 0.3 for a sliver.
    sliver: f64,
}

/// The mesh under edit with all that the operations look at.
struct Zone<'z, 'c, 'm> {
    context: &'z Context<'c>,
    edit: &'z mut Edit<'m>,
    /// The zone's faces, ascending.
    faces: Vec<Face>,
    /// For each face its place in `faces`, or `OUTSIDE`.
    slot: PerFace<u32>,
    /// For each vertex whether it belongs to a split face.
    is_inner: PerVert<bool>,
    /// For each zone face the fit that it follows, or none: that of its representative.
    fits: Vec<Option<&'c Fit>>,
    /// For each zone face its energy, once computed.
    energy: Vec<Option<Energy>>,
    /// For each inserted vertex its neighbours along creases, ascending.
    creases: Vec<Vec<Vert>>,
    n_old: usize,
    /// Whether slivers count as bad.
    slivers_count: bool,
    /// Where fans at edges of four faces may go.
    loosening: Loosening,
}

const OUTSIDE: u32 = u32::MAX;

/// Untangles the chamfer zone of `edit`.
pub(crate) fn untangle(context: &Context<'_>, edit: &mut Edit<'_>) -> UntangleCounts {
    let mut zone = Zone::new(context, edit);
    let mut counts = UntangleCounts::default();
    let bad = zone.bad_faces();
    counts.bad_before = bad.len();
    zone.collapse_short_edges(&mut counts);
    zone.mend(bad, &mut counts);
    zone.flip_folds(&mut counts);
    zone.collapse_low_faces(&mut counts);
    zone.uncross(&mut counts);
    counts.left = zone.bad_faces().len();
    counts
}

impl<'z, 'c, 'm> Zone<'z, 'c, 'm> {
    fn new(context: &'z Context<'c>, edit: &'z mut Edit<'m>) -> Self {
        let Refined { mesh, children, creases, .. } = context.refined;
        let n_old = context.n_old;
        let mut is_inner = PerVert::filled(mesh.n_verts(), false);
        children.iter().flat_map(|&f| mesh.corners(f)).for_each(|v| is_inner[v] = true);
        let has_inner = |f: &Face| mesh.corners(*f).into_iter().any(|v| is_inner[v]);
        let faces: Vec<Face> = (0..mesh.n_faces()).into_par_iter().map(Face::new).filter(has_inner).collect();
        let mut slot = PerFace::filled(mesh.n_faces(), OUTSIDE);
        for (i, &f) in faces.iter().enumerate() {
            slot[f] = i as u32;
        }
        let fits = faces.par_iter().map(|&f| context.fit_of(mesh.corners(f))).collect();
        let mut neighbours = vec![Vec::new(); mesh.n_verts() - n_old];
        for &[a, b] in creases {
            neighbours[a.index() - n_old].push(b);
            neighbours[b.index() - n_old].push(a);
        }
        neighbours.iter_mut().for_each(|list: &mut Vec<Vert>| list.sort_unstable());
        Self {
            energy: vec![None; faces.len()],
            creases: neighbours,
            slivers_count: false,
            loosening: Loosening::at_first(context.before),
            context,
            edit,
            faces,
            slot,
            is_inner,
            fits,
            n_old,
        }
    }

    fn in_zone(&self, f: Face) -> bool {
        self.slot[f] != OUTSIDE
    }

    fn fit(&self, f: Face) -> Option<&'c Fit> {
        self.fits[self.slot[f] as usize]
    }

    /// The neighbours of `v` along creases.
    fn crease(&self, v: Vert) -> &[Vert] {
        v.index().checked_sub(self.n_old).map_or(&[], |i| &self.creases[i])
    }

    fn is_crease(&self, a: Vert, b: Vert) -> bool {
        self.crease(a).contains(&b)
    }

    fn energy(&mut self, f: Face) -> Energy {
        let slot = self.slot[f] as usize;
        if let Some(energy) = self.energy[slot] {
            return energy;
        }
        let energy = self.energy_of(self.edit.triangle(f), f);
        self.energy[slot] = Some(energy);
        energy
    }

    /// How bad a face with this energy counts.
    fn value(&self, energy: Energy) -> f64 {
        if self.slivers_count { energy.turned + energy.sliver } else { energy.turned }
    }

    /// How bad face `f` is.
    fn value_of(&mut self, f: Face) -> f64 {
        let energy = self.energy(f);
        self.value(energy)
    }

    fn forget(&mut self, f: Face) {
        self.energy[self.slot[f] as usize] = None;
    }

    /// The energy that face `f` would have as `triangle`.
    fn energy_of(&self, triangle: [DVec3; 3], f: Face) -> Energy {
        let [a, b, c] = triangle;
        let normal = (b - a).cross(c - a);
        let length = normal.length();
        let sides = [a.distance_squared(b), b.distance_squared(c), c.distance_squared(a)];
        let longest = sides[0].max(sides[1]).max(sides[2]);
        let second = sides[0].min(sides[1]).max(sides[0].max(sides[1]).min(sides[2]));
        let predicted = match self.fit(f) {
            Some(fit) => Some(fit.evaluate((a + b + c) / 3.0, self.context.mean_edge).1),
            None => self.context.parent_normal(f),
        };
        let Some(predicted) = predicted else { return Energy::default() };
        // No area that a float could tell from rounding.
        if length <= 1e-9 * longest {
            return Energy { turned: 1.5, sliver: 0.0 };
        }
        let cosine = normal.dot(predicted) / length;
        let is_reliable = || self.residual_of(triangle, f) <= RELIABLE_RESIDUAL;
        let is_turned = cosine < 0.0 || cosine < BAD_COSINE && is_reliable();
        let turned = if is_turned { 1.5 - cosine } else { 0.0 };
        let sine = length / (second * longest).sqrt();
        let sliver = if sine < SLIVER_SINE { 0.2 + 0.1 * (1.0 - sine / SLIVER_SINE) } else { 0.0 };
        Energy { turned, sliver }
    }

    /// How far face `f` would be from its fit as `triangle`, in mean edge lengths.
    fn residual_of(&self, triangle: [DVec3; 3], f: Face) -> f64 {
        let [a, b, c] = triangle.map(|p| self.off_fit(p, f));
        a.max(b).max(c)
    }

    /// How far `point` is from the fit of `f`, in mean edge lengths.
    fn off_fit(&self, point: DVec3, f: Face) -> f64 {
        self.fit(f).map_or(0.0, |fit| fit.evaluate(point, self.context.mean_edge).0.abs())
    }

    fn bad_faces(&mut self) -> Vec<Face> {
        let mut energy = std::mem::take(&mut self.energy);
        let unknown = self.faces.par_iter().zip(&mut energy).filter(|(_, energy)| energy.is_none());
        let standing = unknown.filter(|&(&f, _)| self.edit.stands(f));
        standing.for_each(|(&f, energy)| *energy = Some(self.energy_of(self.edit.triangle(f), f)));
        self.energy = energy;
        let is_bad = |energy: &Option<Energy>| energy.is_some_and(|energy| self.value(energy) > 0.0);
        let bad = self.faces.iter().zip(&self.energy).filter(|(_, energy)| is_bad(energy));
        bad.map(|(&f, _)| f).filter(|&f| self.edit.stands(f)).collect()
    }

    /// Collapses the shortest edges first: along a crease either way, whichever is better; an old vertex
    /// only into the crease.
    fn collapse_short_edges(&mut self, counts: &mut UntangleCounts) {
        let limit = (SHORT_EDGE * self.context.mean_edge).powi(2);
        let short_side = |t: [Vert; 3], i: usize| {
            let (a, b) = (t[i].min(t[(i + 1) % 3]), t[i].max(t[(i + 1) % 3]));
            let length = self.length_squared(a, b);
            let counts = || self.is_crease(a, b) || (!self.edit.is_inserted(a) && self.edit.is_inserted(b));
            // Not negative: the bits order as the lengths do.
            (length < limit && counts()).then(|| (length.to_bits(), a, b))
        };
        let short_sides =
            |&f: &Face| [0, 1, 2].map(|i| short_side(self.edit.corners(f), i)).into_iter().flatten();
        let mut short: Vec<(u64, Vert, Vert)> = self.faces.par_iter().flat_map_iter(short_sides).collect();
        short.sort_unstable();
        short.dedup();
        for (_, a, b) in short {
            if !self.edit.vert_stands(a) || !self.edit.vert_stands(b) {
                continue;
            }
            let into_b = self.try_collapse(a, b, true);
            let into_a = if self.is_crease(a, b) { self.try_collapse(b, a, true) } else { None };
            let pick = match (into_b, into_a) {
                (Some(x), Some(y)) if y > x => Some((b, a)),
                (Some(_), _) => Some((a, b)),
                (None, Some(_)) => Some((b, a)),
                (None, None) => None,
            };
            if let Some((gone, kept)) = pick {
                self.collapse(gone, kept);
                counts.collapsed += 1;
            }
        }
    }

    /// Rounds of operations on bad faces, worst first, until nothing changes: at first fans go to the other end
    /// of their edge only, then anywhere; then vertices move back; then slivers count as bad.
    fn mend(&mut self, bad: Vec<Face>, counts: &mut UntangleCounts) {
        let mut todo = bad;
        let mut may_move_back = false;
        for _ in 0..MAX_ROUNDS {
            let (changed, touched) = self.round(&todo, may_move_back, counts);
            todo.extend(touched);
            todo.retain(|&f| self.edit.stands(f));
            todo.sort_unstable();
            todo.dedup();
            if changed {
                continue;
            }
            if self.loosening == Loosening::ToOtherEnd {
                self.loosening = Loosening::Anywhere;
            } else if !may_move_back {
                may_move_back = true;
            } else if !self.slivers_count {
                self.slivers_count = true;
                may_move_back = false;
                todo = self.bad_faces();
            } else {
                break;
            }
        }
    }

    /// One round over the bad faces among `todo`. Says whether anything changed, and which faces did.
    fn round(
        &mut self,
        todo: &[Face],
        may_move_back: bool,
        counts: &mut UntangleCounts,
    ) -> (bool, Vec<Face>) {
        let mut order: Vec<(u64, Face)> = Vec::new();
        for &f in todo.iter().filter(|&&f| self.edit.stands(f)).collect::<Vec<_>>() {
            let value = self.value_of(f);
            if value > 0.0 {
                order.push((value.to_bits(), f));
            }
        }
        order.sort_unstable_by_key(|&(value, f)| (std::cmp::Reverse(value), f));
        let (mut changed, mut touched) = (false, Vec::new());
        for (_, f) in order {
            if self.edit.stands(f)
                && self.value_of(f) > 0.0
                && let Some(operation) = self.best_operation(f, may_move_back)
            {
                touched.extend(self.apply(operation, counts));
                changed = true;
            }
        }
        (changed, touched)
    }

    fn length_squared(&self, a: Vert, b: Vert) -> f64 {
        self.edit.point(a).distance_squared(self.edit.point(b))
    }
}

impl<'a> Context<'a> {
    /// The fit that a face follows: that of an end of a chamfer edge first, then that of its lowest old vertex.
    fn fit_of(&self, corners: [Vert; 3]) -> Option<&'a Fit> {
        let is_labelled = |v: &Vert| v.index() < self.n_old && self.fits[*v].is_some();
        let best = corners.into_iter().filter(is_labelled).min_by_key(|&v| (!(self.is_chamfer_end)(v), v));
        best.and_then(|v| self.fits[v])
    }

    /// Where an old vertex of the whole mesh is.
    fn old_point(&self, v: Vert) -> DVec3 {
        self.excerpt.map_or_else(|| self.before.point(v), |excerpt| excerpt.old_point(v))
    }

    /// The normal of the input face that `f` lies in.
    fn parent_normal(&self, f: Face) -> Option<DVec3> {
        crate::geometry::unit_normal(self.before.triangle(self.refined.lineage.parents[f]))
    }
}

#[cfg(test)]
impl<'a> Context<'a> {
    /// That of tests: all old vertices have the same fit or none, all inserted ones are on their feature, and the mean
    /// edge is one long.
    fn plain(before: &'a Mesh, refined: &'a Refined, fit: Option<&'a Fit>) -> Self {
        Self {
            before,
            excerpt: None,
            refined,
            n_old: before.n_verts(),
            fits: PerVert::filled(before.n_verts(), fit),
            is_chamfer_end: &|_| false,
            is_moved: &|_| true,
            mean_edge: 1.0,
        }
    }
}
