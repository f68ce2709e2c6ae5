//! Spaces crease vertices anew: one or a run of them slides along its crease to where the faces beside it look the
//! right way.
//!
//! ```text
//!   w---v-------z        w-----v-----z       The crease is where the fits of both sides meet: a vertex is put on a
//!    \ /`.     /   ->     \   / \   /        point of the chord w-z and projected from there onto both, which
//!     x----`.-/            \ /   \ /         curvature and the angle between them take a few steps to reach.
//! ```
//!
//! Based on: nothing in the papers.
//! In/out: says what to move and what that gains; `moves.rs` chooses and carries out.
//! Cost: O(faces at the vertices of the run).

use glam::DVec3;

use super::{MIN_GAIN, Zone};
use crate::fit::Fit;
use crate::geometry::{Plane, nearest_on_both};
use crate::mesh::{Face, Vert};

/// A crease vertex may be projected onto its crease from at most this far (in mean edge lengths).
const MAX_PROJECTION: f64 = 0.25;
/// The planes of two fits with a smaller sine between them do not fix a crease: 6 degrees.
const MIN_CREASE_SINE: f64 = 0.1;
/// Steps of projection onto the fits' planes below the point that the step before found: each squares the error, and
/// the first starts within `MAX_PROJECTION`.
const PROJECTION_STEPS: usize = 3;
/// A run of at most this many crease vertices is spaced anew at once.
const LONGEST_RUN: usize = 6;
/// Where between its neighbours a crease vertex may go, as shares of the way: the middle first, which wins a tie.
const SHARES: [f64; 3] = [0.5, 0.25, 0.75];

impl Zone<'_, '_, '_> {
    /// The point of the crease of the two fits beside crease edge `v`-`w` nearest to `from`.
    pub(super) fn project(&self, from: DVec3, v: Vert, w: Vert) -> Option<DVec3> {
        let beside = self.edit.faces_beside(v, w)?;
        let [Some(p), Some(q)] = beside.map(|f| self.fit(f)) else { return None };
        let h = self.context.mean_edge;
        let mut point = from;
        for _ in 0..PROJECTION_STEPS {
            let plane = |fit: &Fit| {
                let (distance, normal) = fit.evaluate(point, h);
                Plane { point: point - distance * h * normal, normal }
            };
            let (next, sine) = nearest_on_both(plane(p), plane(q), from)?;
            if sine < MIN_CREASE_SINE || next.distance(from) > MAX_PROJECTION * h {
                return None;
            }
            point = next;
        }
        Some(point)
    }

    /// Whether `v` is a vertex along a crease (not its end, not a corner) that lies on its feature.
    pub(super) fn is_along_crease(&self, v: Vert) -> bool {
        self.edit.is_inserted(v) && self.crease(v).len() == 2 && (self.context.is_moved)(v)
    }

    /// Puts a crease vertex elsewhere between its two crease neighbours.
    pub(super) fn try_respace(&mut self, v: Vert) -> Option<(f64, DVec3)> {
        if !self.is_along_crease(v) {
            return None;
        }
        let [w, z] = [0, 1].map(|i| self.crease(v)[i]);
        let mut best: Option<(f64, DVec3)> = None;
        for share in SHARES {
            let from = self.edit.point(w).lerp(self.edit.point(z), share);
            if let Some(to) = self.project(from, v, w)
                && let Some(gain) = self.move_gain(&[v], &[to])
                && best.is_none_or(|(most, _)| gain > most)
            {
                best = Some((gain, to));
            }
        }
        best
    }

    /// Spaces the run of crease vertices round crease edge `a`-`b` evenly between its fixed ends: the
    /// shortest run of two vertices or more that gains.
    pub(super) fn try_run(&mut self, a: Vert, b: Vert) -> Option<(f64, Vec<Vert>, Vec<DVec3>)> {
        if !self.is_crease(a, b) {
            return None;
        }
        let mut run = self.longer_run(&[a, b]);
        while (3..=LONGEST_RUN + 2).contains(&run.len()) {
            let inner = run[1..run.len() - 1].to_vec();
            let mut sorted = run.clone();
            sorted.sort_unstable();
            sorted.dedup();
            if sorted.len() != run.len() || !inner.iter().all(|&v| self.is_along_crease(v)) {
                return None;
            }
            if inner.len() > 1
                && let Some(to) = self.even_spacing(&run)
                && let Some(gain) = self.move_gain(&inner, &to)
            {
                return Some((gain, inner, to));
            }
            let longer = self.longer_run(&run);
            if longer.len() == run.len() {
                return None;
            }
            run = longer;
        }
        None
    }

    /// The run with the next crease vertex at each end that is free to move.
    fn longer_run(&self, run: &[Vert]) -> Vec<Vert> {
        let beyond = |end: Vert, inner: Vert| {
            let next = self.crease(end).iter().copied().find(|&w| w != inner);
            next.filter(|_| self.is_along_crease(end))
        };
        let mut longer: Vec<Vert> = beyond(run[0], run[1]).into_iter().collect();
        longer.extend(run);
        longer.extend(beyond(run[run.len() - 1], run[run.len() - 2]));
        longer
    }

    fn even_spacing(&self, run: &[Vert]) -> Option<Vec<DVec3>> {
        let (first, last) = (self.edit.point(run[0]), self.edit.point(run[run.len() - 1]));
        let share = |i: usize| i as f64 / (run.len() - 1) as f64;
        let place = |i: usize| self.project(first.lerp(last, share(i)), run[i], run[i - 1]);
        (1..run.len() - 1).map(place).collect()
    }

    /// What moving `vertices` gains, if faces and creases stay on their fits.
    fn move_gain(&mut self, vertices: &[Vert], to: &[DVec3]) -> Option<f64> {
        let mut faces: Vec<Face> = vertices.iter().flat_map(|&v| self.edit.faces_at(v)).copied().collect();
        faces.sort_unstable();
        faces.dedup();
        let old: f64 = faces.iter().map(|&f| self.value_of(f)).sum();
        let new = self.energy_with(vertices, to, faces, old - MIN_GAIN)?;
        let at = |v: Vert| self.point_with(vertices, to, v);
        let stays = |&v: &Vert| {
            let middle = |w: Vert| at(v).midpoint(at(w));
            self.crease(v).iter().all(|&w| self.is_on_its_fits(middle(w), v, w))
        };
        vertices.iter().all(stays).then_some(old - new)
    }
}
