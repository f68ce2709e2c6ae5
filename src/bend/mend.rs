//! Turns children of turned faces the right way round.
//!
//! ```text
//!      A ---- x ---- B              A ------------ B     C has slipped over the edge A-B: the face lies on
//!       `z_ ____ _y´      ->         \`.  C     .´/      its back, and so do its four children while x, y, z
//!          `- C -´                    \ z-----y  /       are in the middle. Moved about in the surface the
//!                                      \   \ /  /        new vertices make up for what old ones may not.
//!                                            x
//! ```
//!
//! A face is *turned* when it looks away from the surface round it: from the faces at its corners on its
//! side of the cuts. The new vertices on its edges, and on those of faces that are folded, try places round
//! where they are within the surface, and take the one that leaves the fewest children turned or folded;
//! those on cut edges stay on their curve. Vertices of all other faces do not move.
//!
//! It mends folds above all, and few of the faces that are measured as turned. Most of these are not: they look the
//! way their surroundings do, beside a crease a little out of place. Where that is a sixth to a third of a face's
//! height, the face is measured as sound and its two children at the crease as turned, wherever their new vertices
//! go: the split in the middle alone makes more of them than bending does. Only a better place of the crease, or
//! fewer low faces, mends those.
//!
//! Based on: nothing; the papers are silent.
//! Rejected: to ask of a turned face that it be turned by 96 or 100 degrees (5 folds instead of 3).
//! In/out: ways of a [`Draft`]'s new vertices, in place.
//! Cost: O(F) to find turned faces, parallel; then O(turned faces), one by one.

#[cfg(test)]
mod tests;

use glam::DVec3;
use rayon::prelude::*;

use super::limit::{Draft, MAX_FOLD_COS, is_within};
use crate::mesh::{Face, Half, has_repeated_vertex};

/// A child that is turned by more than this from its surface is bad: 60 degrees, the most that the limiter
/// lets one turn from its parent.
const BAD_COS: f64 = 0.5;
/// Faces say how a surface lies when their areas, added as vectors, keep this share of their sum. Across a
/// crease that was not found there are two surfaces, and each would turn the other's faces: without this
/// rule pyramid mi_8k has 18 % more L2 error than without bending. 0.75 leaves 8 more faces turned.
const MIN_AGREEMENT: f64 = 0.6;
/// A move must lower the badness by this: a good child has none, a bad one 1 to 2.5 or [`COLLAPSED`].
const MIN_GAIN: f64 = 0.5;
/// What a child counts that has no area which a float could tell from rounding: as much as two that are turned right over.
/// On an old vertex, or in line with two, no new one is of use, and which of these it went to would be for rounding to say.
const COLLAPSED: f64 = 5.0;
/// What a folded edge counts against badness: as much as a child that is turned by 120 degrees.
const FOLD_WEIGHT: f64 = 2.0;
/// What the shape of the worst child counts for against badness: it only decides between places that leave
/// equally few children bad.
const SHAPE_WEIGHT: f64 = 0.1;
const DIAGONAL: f64 = std::f64::consts::FRAC_1_SQRT_2;
/// The directions in which a new vertex tries places, as shares of its edge and of the perpendicular to it.
const DIRECTIONS: [(f64, f64); 8] = [
    (0.0, 1.0),
    (0.0, -1.0),
    (1.0, 0.0),
    (-1.0, 0.0),
    (DIAGONAL, DIAGONAL),
    (DIAGONAL, -DIAGONAL),
    (-DIAGONAL, DIAGONAL),
    (-DIAGONAL, -DIAGONAL),
];
/// It tries them at these distances, in edge lengths: slivers need short steps, their neighbours leave room for long
/// ones.
const STEPS: [f64; 6] = [0.5, 0.25, 0.125, 0.0625, 0.03125, 0.015_625];
/// It stays as near as this to the planes of both its faces, in edge lengths: what slipped within the surface
/// can be put right within it.
const MAX_OFF_PLANE: f64 = 0.05;
/// A vertex that has moved makes room for the others: so many rounds change anything.
const ROUNDS: usize = 4;
/// Where more faces than this are turned or folded, and more than one in [`ONE_IN`], there is no surface to
/// mend them by, and trying takes long: a quarter of a minute on a shaken sheet of 318,000 faces.
const MOST_SUSPECTS: usize = 1000;
/// See [`MOST_SUSPECTS`].
const ONE_IN: usize = 50;
/// So many faces to either side of a corner are looked at. Wider fans are no neighbourhood.
const MAX_FAN: usize = 32;

/// A face that is turned or folded, and the normal of the surface that it should lie in.
type Suspect = (Face, DVec3);

impl Draft<'_> {
    /// Moves new vertices of turned faces until fewer of their children are turned; gives how many.
    pub(super) fn mend(&mut self) -> usize {
        let suspects = self.suspects();
        if suspects.len() > MOST_SUSPECTS.max(self.mesh.n_faces() / ONE_IN) {
            return 0;
        }
        let mut moved: Vec<usize> = Vec::new();
        // In the order of their vertices: that of the faces in the file decides nothing.
        let mut todo = suspects.clone();
        todo.sort_by_cached_key(|&(f, _)| self.edges_by_vertices(f).map(|h| self.mesh.ends(h)));
        for _ in 0..ROUNDS {
            let mut moved_now = Vec::new();
            for &(f, normal) in &todo {
                for h in self.edges_by_vertices(f) {
                    let is_free = !self.stencils.is_cut(h);
                    let Some(slot) = self.middles.slot(h).filter(|_| is_free) else { continue };
                    if let Some(way) = self.better_way(h, slot, normal, &suspects) {
                        self.settled.redirect(slot, way);
                        moved_now.push(slot);
                    }
                }
            }
            // Only a move in a face or beside it makes another try worth while.
            moved_now.sort_unstable();
            let has_moved =
                |h: Half| self.middles.slot(h).is_some_and(|s| moved_now.binary_search(&s).is_ok());
            todo.retain(|&(f, _)| {
                let mut near = self.twins(f).map(Half::face).chain([f]).flat_map(Face::halves);
                near.any(has_moved)
            });
            moved.extend(moved_now);
        }
        moved.sort_unstable();
        moved.dedup();
        moved.len()
    }

    /// The edges of `f`, each as the half-edge that leaves its lower vertex if there is one, the lowest first.
    fn edges_by_vertices(&self, f: Face) -> [Half; 3] {
        let mesh = self.mesh;
        let from_lower = |h: Half| mesh.twin(h).filter(|&twin| mesh.from(twin) < mesh.from(h)).unwrap_or(h);
        let mut edges = f.halves().map(from_lower);
        edges.sort_by_key(|&h| mesh.ends(h));
        edges
    }

    /// The faces that look away from the surface round them or are folded, ascending.
    fn suspects(&self) -> Vec<Suspect> {
        let look = |f: usize| {
            let f = Face::new(f);
            let own = self.areas[f];
            let is_against = |twin: Half| self.areas[twin.face()].dot(own) < 0.0;
            if !self.twins(f).any(is_against) || has_repeated_vertex(&self.mesh.corners(f)) {
                return None;
            }
            let (surface, area) = self.surface_round(f);
            if surface.dot(own) < 0.0 && surface.length() >= MIN_AGREEMENT * area {
                return Some((f, surface.normalize_or_zero()));
            }
            let is_fold = |twin: Half| !is_within(MAX_FOLD_COS, self.areas[twin.face()], own);
            self.twins(f).any(is_fold).then(|| (f, own.normalize_or_zero()))
        };
        (0..self.mesh.n_faces()).into_par_iter().filter_map(look).collect()
    }

    /// The normal of the faces at the corners of `f` without itself, by their areas, on its side of the
    /// cuts; and the sum of these areas.
    fn surface_round(&self, f: Face) -> (DVec3, f64) {
        let (mut surface, mut area) = (DVec3::ZERO, 0.0);
        let mut add = |g: Face| {
            surface += self.areas[g];
            area += self.areas[g].length();
        };
        f.halves().into_iter().for_each(|h| self.faces_at(h, &mut add));
        (surface, area)
    }

    /// Hands on the faces at the start of `h`.
    fn faces_at(&self, h: Half, add: &mut impl FnMut(Face)) {
        let mut last = h;
        for _ in 0..MAX_FAN {
            let next = if self.stencils.is_cut(last.prev()) { None } else { self.mesh.rotate_ccw(last) };
            let Some(next) = next else { break };
            if next == h {
                return;
            }
            add(next.face());
            last = next;
        }
        let (end, mut last) = (last, h);
        for _ in 0..MAX_FAN {
            let next = if self.stencils.is_cut(last) { None } else { self.mesh.rotate_cw(last) };
            let Some(next) = next.filter(|&next| next != end) else { break };
            add(next.face());
            last = next;
        }
    }

    /// The way on which new vertex `slot` on the edge of `h` leaves fewer children turned, if there is one.
    fn better_way(&mut self, h: Half, slot: usize, normal: DVec3, suspects: &[Suspect]) -> Option<DVec3> {
        let (badness, n_folds) = (self.badness(h, suspects), self.n_folds(h));
        if badness < 1.0 && n_folds == 0 {
            return None;
        }
        let way = self.settled.way(slot);
        let edge = self.mesh.point(self.mesh.to(h)) - self.mesh.point(self.mesh.from(h));
        let along = edge - edge.dot(normal) * normal;
        let across = normal.cross(along);
        let beside = [Some(h), self.mesh.twin(h)].map(|h| h.map_or(DVec3::ZERO, |h| self.areas[h.face()]));
        let planes = beside.map(DVec3::normalize_or_zero);
        let farthest_off = MAX_OFF_PLANE * edge.length();
        let mut best = None;
        let mut least = badness + FOLD_WEIGHT * n_folds as f64 - MIN_GAIN;
        for (step, (u, v)) in STEPS.into_iter().flat_map(|step| DIRECTIONS.map(|d| (step, d))) {
            let shift = step * (u * along + v * across);
            if planes.iter().any(|n| n.dot(shift).abs() > farthest_off) {
                continue;
            }
            let to = way + shift;
            self.settled.redirect(slot, to);
            let badness = self.badness(h, suspects);
            if badness >= least {
                continue;
            }
            let folds = self.n_folds(h);
            let value = badness + FOLD_WEIGHT * folds as f64;
            if folds <= n_folds && value < least {
                (least, best) = (value, Some(to));
            }
        }
        self.settled.redirect(slot, way);
        best
    }

    /// How bad the children on both sides of `h` are.
    fn badness(&self, h: Half, suspects: &[Suspect]) -> f64 {
        let (mut sum, mut worst) = (0.0, f64::INFINITY);
        for f in [Some(h), self.mesh.twin(h)].into_iter().flatten().map(Half::face) {
            let place = suspects.binary_search_by_key(&f, |&(f, _)| f);
            let surface = place.map_or_else(|_| self.areas[f].normalize_or_zero(), |i| suspects[i].1);
            for [a, b, c] in self.triangles(f) {
                let area = (b - a).cross(c - a);
                let longest = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
                let size = area.length();
                let cosine = area.dot(surface) / size;
                sum += match size > 1e-9 * longest {
                    false => COLLAPSED,
                    true if cosine < BAD_COS => 1.5 - cosine,
                    true => 0.0,
                };
                worst = worst.min(if longest > 0.0 { size / longest } else { 0.0 });
            }
        }
        sum - SHAPE_WEIGHT * worst
    }

    /// How many edges of children on both sides of `h` are folded.
    fn n_folds(&self, h: Half) -> usize {
        let is_fold = |a: DVec3, b: DVec3| usize::from(!is_within(MAX_FOLD_COS, a, b));
        let mut n = 0;
        for first in [Some(h), self.mesh.twin(h)].into_iter().flatten() {
            let own = self.children(first.face());
            n += (0..3).map(|i| is_fold(own[i], own[3])).sum::<usize>();
            for (i, side) in first.face().halves().into_iter().enumerate() {
                let Some(twin) = self.mesh.twin(side).filter(|_| side != first || first == h) else {
                    continue;
                };
                let other = self.children(twin.face());
                n += is_fold(own[i], other[twin.next().corner()]);
                n += is_fold(own[(i + 1) % 3], other[twin.corner()]);
            }
        }
        n
    }
}
