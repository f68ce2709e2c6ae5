//! Holds new vertices back where faces would turn over.
//!
//! Based on: nothing; the papers are silent. Plain Butterfly turns thousands of faces over on a mesh full
//! of slivers, because what is a small displacement along an edge is a large one across a sliver.
//!
//! All in the middle is always safe: then each child lies in its parent. So each new vertex starts where it
//! wants to be, and in each round every face looks at its children; the new vertices of a child that has
//! turned too far halve their way, at the fourth objection they stay in the middle. A round reads only
//! what the round before left, so that no order matters; it ends because ways only grow shorter.
//!
//! Rejected: a limit by the heights of the triangles at the edge needs no rounds, but takes from curved
//! surfaces what it should not: at a quarter of the height 2 to 7 percentage points of the L2 error come
//! back (cylinder mi_8k .670 instead of .604 of the error without bending), at a tenth 7 to 11.
//! In/out: old points and shifts `[V + N]` -> points `[V + N]`.
//! Cost: O(F) for the first round, then only faces beside vertices that moved; about six rounds.

#[cfg(test)]
mod tests;

use glam::DVec3;
use rayon::prelude::*;

use super::quarter::Middles;
use crate::mesh::{Face, Half, Mesh, PerFace, has_repeated_vertex};
use crate::stencil::Stencils;

/// A child may turn this far against its parent: 60 degrees. This is what makes the pass safe whatever the
/// normals round about are worth; where they are worth something the next rule fires first, and without
/// this one no figure on 31 inputs changes.
const MAX_TURN_COS: f64 = 0.5;
/// A child may turn this far against the surface round its parent, or as far as the parent has: 45 degrees.
/// Slivers have normals of their own, and without this rule they turn over little by little (fandisk
/// mi_20k_n05: 460 flipped faces, with it 388, in the middle 401). 20 degrees gains nothing more.
const MAX_OFF_SURFACE_COS: f64 = std::f64::consts::FRAC_1_SQRT_2;
/// No two children may fold by more than this on their common edge, 150 degrees, or than their parents do.
/// A measured fold is 170 degrees: what comes near may become one at the next level. It costs up to 0.2
/// percentage points of L2 (cylinder mi_8k .570, without .568).
pub(super) const MAX_FOLD_COS: f64 = -0.866_025_403_784_438_6;

/// What is left of a new vertex's way after so many objections.
const WAY_LEFT: [f64; 4] = [1.0, 0.5, 0.25, 0.0];

/// Where no child can turn by more than this, 24.8 degrees, most faces need not look at their children: the
/// limits above are out of reach of a parent that is at most [`NEAR_SURFACE_COS`] off the surface and
/// folded by at most [`NO_FOLD_COS`].
const CALM_SINE: f64 = 0.42;
/// The cosine of the same angle.
const CALM_COS: f64 = 0.907_524_104_363_073_9;
/// 20 degrees: with 24.8 more, the 45 of [`MAX_OFF_SURFACE_COS`] are not reached.
const NEAR_SURFACE_COS: f64 = 0.939_692_620_785_908_4;
/// 100 degrees: with twice 24.8 more, the 150 of [`MAX_FOLD_COS`] are not reached.
const NO_FOLD_COS: f64 = -0.173_648_177_666_930_35;

/// How far the new vertices of a face go.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Motion {
    /// Nowhere.
    Still,
    /// Not far enough to turn a child by more than [`CALM_SINE`].
    Calm,
    /// Farther.
    Far,
}

/// New vertices on their way from the middles of their edges to where they want to be.
pub(super) struct Draft<'a> {
    pub mesh: &'a Mesh,
    pub stencils: &'a Stencils<'a>,
    pub middles: &'a Middles,
    pub settled: Settled,
    /// The cross product of two edges of each face. `[F]`
    pub areas: PerFace<DVec3>,
}

/// Where new vertices are.
pub(super) struct Settled {
    n_old: usize,
    /// The old vertices, then where each new one wants to be, from the middle. `[V + N]`
    points: Vec<DVec3>,
    /// How often a face has objected. `[N]`
    objections: Vec<u8>,
}

impl Settled {
    /// The points of all vertices. `edges` are those that the new ones are on.
    pub fn into_points(mut self, mesh: &Mesh, edges: &[Half]) -> Vec<DVec3> {
        let settle = |((shift, &n), &h): ((&mut DVec3, &u8), &Half)| {
            let middle = mesh.point(mesh.from(h)).midpoint(mesh.point(mesh.to(h)));
            *shift = middle + WAY_LEFT[usize::from(n)] * *shift;
        };
        let shifts = self.points[self.n_old..].par_iter_mut();
        shifts.zip(&self.objections).zip(edges).for_each(settle);
        self.points
    }

    fn shift(&self, slot: usize) -> DVec3 {
        self.points[self.n_old + slot]
    }

    /// How far new vertex `slot` is from the middle.
    pub fn way(&self, slot: usize) -> DVec3 {
        WAY_LEFT[usize::from(self.objections[slot])] * self.shift(slot)
    }

    /// Sends it another way.
    pub fn redirect(&mut self, slot: usize, way: DVec3) {
        self.points[self.n_old + slot] = way;
        self.objections[slot] = 0;
    }
}

impl<'a> Draft<'a> {
    /// `points` are the old vertices, then the ways from the middles of their edges that new ones want to go.
    pub fn new(mesh: &'a Mesh, stencils: &'a Stencils<'a>, middles: &'a Middles, points: Vec<DVec3>) -> Self {
        let area = |f: Face| {
            let [a, b, c] = mesh.triangle(f);
            (b - a).cross(c - a)
        };
        let areas = (0..mesh.n_faces()).into_par_iter().map(|f| area(Face::new(f)));
        let areas = areas.collect::<Vec<_>>().into();
        let n_old = mesh.n_verts();
        let settled = Settled { n_old, objections: vec![0; points.len() - n_old], points };
        Self { mesh, stencils, middles, settled, areas }
    }

    /// Takes vertices back until no face objects; gives how many were.
    pub fn retreat(&mut self) -> usize {
        let mesh = self.mesh;
        let all = || (0..mesh.n_faces()).into_par_iter().map(Face::new);
        let motions = all().map(|f| self.motion(f)).collect::<Vec<_>>().into();
        let mut faces: Vec<Face> = all().filter(|&f| self.may_object(f, &motions)).collect();
        drop(motions);
        while !faces.is_empty() {
            let objections = faces.par_iter().flat_map_iter(|&f| self.objections(f));
            let slots = objections.filter_map(|h| self.middles.slot(h));
            let mut slots: Vec<usize> = slots.collect();
            slots.par_sort_unstable();
            slots.dedup();
            slots.retain(|&slot| usize::from(self.settled.objections[slot]) + 1 < WAY_LEFT.len());
            faces.clear();
            for slot in slots {
                self.settled.objections[slot] += 1;
                let h = self.middles.edges[slot];
                faces.extend([Some(h), mesh.twin(h)].into_iter().flatten().map(Half::face));
            }
            // An edge is looked at from one of its faces: the neighbours must look again as well.
            for i in 0..faces.len() {
                let beside = faces[i];
                faces.extend(self.twins(beside).map(Half::face));
            }
            faces.par_sort_unstable();
            faces.dedup();
        }
        self.settled.objections.iter().filter(|&&n| n > 0).count()
    }

    /// Where the new vertices are now.
    pub fn into_settled(self) -> Settled {
        self.settled
    }

    /// The half-edges across the edges of `f`.
    pub fn twins(&self, f: Face) -> impl Iterator<Item = Half> + '_ {
        f.halves().into_iter().filter_map(|h| self.mesh.twin(h))
    }

    /// How far the new vertices of `f` go.
    ///
    /// Let d be the most that two of them can come apart and L the longest edge. The edges of a child are at
    /// most L/2, so that its cross product changes by at most d (L + d), and it is a quarter of its parent's.
    fn motion(&self, f: Face) -> Motion {
        let halves = f.halves();
        let shift =
            |h: Half| self.middles.slot(h).map_or(0.0, |slot| self.settled.shift(slot).length_squared());
        let farthest = halves.map(shift).into_iter().fold(0.0, f64::max);
        if farthest == 0.0 {
            return Motion::Still;
        }
        let [a, b, c] = self.mesh.triangle(f);
        let longest = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a)).sqrt();
        let apart = 2.0 * farthest.sqrt();
        let area = self.areas[f];
        // Slivers are out of reach of the bound; their children tell.
        let is_calm = apart * (longest + apart) <= CALM_SINE * area.length() / 4.0
            || self
                .children(f)
                .iter()
                .all(|&child| child.dot(area) > 0.0 && is_within(CALM_COS, child, area));
        if is_calm { Motion::Calm } else { Motion::Far }
    }

    /// Whether `f` may have something to object to, as far as a glance tells.
    fn may_object(&self, f: Face, motions: &PerFace<Motion>) -> bool {
        let own = motions[f];
        let is_folded = |g: Face| !is_within(NO_FOLD_COS, self.areas[f], self.areas[g]);
        let is_disturbed = |g: Face| match own.max(motions[g]) {
            Motion::Still => false,
            Motion::Calm => is_folded(g),
            Motion::Far => true,
        };
        own == Motion::Far
            || self.twins(f).any(|twin| is_disturbed(twin.face()))
            || own == Motion::Calm && !is_within(NEAR_SURFACE_COS, self.areas[f], self.surface(f))
    }

    /// The normal of `f` with its neighbours across edges that are no cut, by their areas.
    fn surface(&self, f: Face) -> DVec3 {
        let beside = f.halves().into_iter().filter(|&h| !self.stencils.is_cut(h));
        let beside = beside.filter_map(|h| self.mesh.twin(h)).map(|twin| self.areas[twin.face()]);
        self.areas[f] + beside.sum::<DVec3>()
    }

    /// The half-edges whose new vertices should retreat, as far as face `f` is to say.
    fn objections(&self, f: Face) -> impl Iterator<Item = Half> + use<> {
        let halves = f.halves();
        let mut objections = [Half::NONE; 9];
        if !has_repeated_vertex(&self.mesh.corners(f)) {
            let children = self.children(f);
            let (parent, surface) = (self.areas[f], self.surface(f));
            let off_surface = MAX_OFF_SURFACE_COS.min(cosine(parent, surface) - 1e-9);
            let has_turned = children.map(|child| {
                !is_within(MAX_TURN_COS, child, parent)
                    // A parent without area, or a child, has no angle.
                    || child.dot(parent) <= 0.0
                    || !is_within(off_surface, child, surface)
            });
            let is_folded = |i: usize| !is_within(MAX_FOLD_COS, children[i], children[3]);
            for i in 0..3 {
                // The child at corner i has its new vertices on half-edges i and i - 1.
                if has_turned[i] || has_turned[(i + 1) % 3] || has_turned[3] || (0..3).any(is_folded) {
                    objections[i] = halves[i];
                }
            }
            for i in 0..3 {
                let Some(twin) = self.mesh.twin(halves[i]).filter(|&twin| twin > halves[i]) else { continue };
                for (end, other) in self.folds_across(f, i, twin, &children).into_iter().enumerate() {
                    if let Some(other) = other {
                        objections[i] = halves[i];
                        let own = (i + if end == 0 { 2 } else { 1 }) % 3;
                        objections[own] = halves[own];
                        objections[3 + 2 * i + end] = other;
                    }
                }
            }
        }
        objections.into_iter().filter(|h| h.is_some())
    }

    /// Whether the children of both faces fold too far over the edge `i` of `f`, at its start and at its
    /// end: the other half-edge whose new vertex the neighbour's child has there.
    ///
    /// ```text
    ///            \   / own child
    ///     start --o-m-o-- end          m the new vertex, at both
    ///          ^ / \ ^ neighbour's child
    ///        other   other
    /// ```
    fn folds_across(&self, f: Face, i: usize, twin: Half, children: &[DVec3; 4]) -> [Option<Half>; 2] {
        let g = twin.face();
        let neighbours = self.children(g);
        let (at_start, at_end) = (neighbours[twin.next().corner()], neighbours[twin.corner()]);
        let (own_start, own_end) = (children[i], children[(i + 1) % 3]);
        if own_start.dot(at_start) >= 0.0 && own_end.dot(at_end) >= 0.0 {
            return [None; 2];
        }
        let parents = [f, g].map(|f| self.areas[f]);
        if parents.contains(&DVec3::ZERO) {
            return [None; 2];
        }
        let limit = MAX_FOLD_COS.min(cosine(parents[0], parents[1]) - 1e-9);
        let (at_start, at_end) = (!is_within(limit, own_start, at_start), !is_within(limit, own_end, at_end));
        [at_start.then_some(twin.next()), at_end.then_some(twin.prev())]
    }

    /// The cross products of two edges of each child of `f`: of those at its three corners, then of the
    /// inner one.
    pub fn children(&self, f: Face) -> [DVec3; 4] {
        self.triangles(f).map(|[p, q, r]| (q - p).cross(r - p))
    }

    /// The corners of each child, in the same order.
    pub fn triangles(&self, f: Face) -> [[DVec3; 3]; 4] {
        let [a, b, c] = self.mesh.triangle(f);
        let way = |h: Half| self.middles.slot(h).map_or(DVec3::ZERO, |slot| self.settled.way(slot));
        let [x, y, z] = f.halves().map(way);
        let (x, y, z) = (a.midpoint(b) + x, b.midpoint(c) + y, c.midpoint(a) + z);
        [[a, x, z], [b, y, x], [c, z, y], [x, y, z]]
    }
}

/// Whether the angle between `a` and `b` is at most that of the cosine; zero has none and is within any.
pub(super) fn is_within(cosine: f64, a: DVec3, b: DVec3) -> bool {
    a.dot(b) >= cosine * (a.length() * b.length())
}

/// The cosine of the angle between two vectors; 0 where one has no direction.
fn cosine(a: DVec3, b: DVec3) -> f64 {
    a.normalize_or_zero().dot(b.normalize_or_zero())
}
