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

/// A crease vertex may be projected onto its crease from at most this far (in mean edge lengths), as a fit says nothing
/// about what is far from it. Half changes 4 of 251 inputs, of which a thin plate's largest error grows by a fifth;
/// double none.
const MAX_PROJECTION: f64 = 0.25;
/// The planes of two fits with a smaller sine between them do not fix a crease: 6 degrees. No chamfer has less than
/// some 35, so that only curvature along the crease can bring fits that near: half and double change nothing on 251
/// inputs.
const MIN_CREASE_SINE: f64 = 0.1;
/// Steps of projection onto the planes of the fits below the point that the step before found: each about squares the
/// error, and the first starts within `MAX_PROJECTION`. One, two and six change a third of 251 inputs, none
/// by more than 1 %.
const PROJECTION_STEPS: usize = 3;
/// A run of at most this many crease vertices is spaced anew at once: at 3 the largest errors of three pyramids and
/// wedges grow by half and more; at 12 a star has 13 more turned faces.
const LONGEST_RUN: usize = 6;
/// Where between its neighbours a crease vertex may go, as shares of the way: the middle first, which wins a tie. The
/// middle alone changes 50 of 251 inputs and eighths 38, but only three and two of them by more than 1 %: a star cuts
/// itself in four places more, icosahedra lose 3 % of L2.
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
            // Those inside are along the crease, or the run would have ended there.
            if sorted.len() != run.len() {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::FitSource;
    use crate::untangle::tests::{Scene, assert_near, roof, roof_with};
    use glam::dvec3;

    fn v(i: usize) -> Vert {
        Vert::new(i)
    }

    fn crease() -> Vec<[usize; 2]> {
        (40..49).map(|v| [v, v + 1]).collect()
    }

    #[test]
    fn a_point_is_projected_onto_the_crease_from_nearby_only() {
        let projected = |from: [f64; 3]| roof().run(|zone| zone.project(DVec3::from(from), v(42), v(43)));
        assert!(projected([2.3, 0.1, 0.1]).unwrap().distance(dvec3(2.3, 0., 0.)) < 1e-12);
        assert!(projected([2.3, 0., 0.24]).is_some());
        assert!(projected([2.3, 0., 0.26]).is_none());
        assert!(roof().run(|zone| zone.project(DVec3::ZERO, v(42), v(44))).is_none(), "no edge");
        assert!(roof().without_fit(0..40).run(|zone| zone.project(DVec3::ZERO, v(42), v(43))).is_none());
    }

    #[test]
    fn sides_that_hardly_meet_fix_no_crease() {
        // The sides lean by 2.8 and 2.9 degrees each.
        let is_fixed = |slope: f64| {
            roof_with(slope, 40, &crease()).run(|zone| zone.project(2.0 * DVec3::X, v(42), v(43))).is_some()
        };
        assert!(is_fixed(0.051) && !is_fixed(0.049));
    }

    #[test]
    fn projection_follows_curved_fits() {
        // Both sides bend down along the crease: it runs through (x, 0, -x²/10).
        let side = |slope: f64| Fit {
            frame: [DVec3::X, DVec3::Y, DVec3::Z],
            coefficients: [0.0, 0.0, slope, -0.2, 0.0, 0.0],
            ..Fit::plane(DVec3::ZERO, DVec3::Z, FitSource::Region)
        };
        let scene = roof().with_fit(0..20, &side(1.0)).with_fit(20..40, &side(-1.0));
        let to = scene.run(|zone| zone.project(dvec3(1., 0., 0.), v(41), v(42))).unwrap();
        assert!(to.y.abs() < 1e-12 && (to.z + to.x * to.x / 10.0).abs() < 1e-6, "{to}");
    }

    fn respaced(scene: &Scene, vert: usize) -> Option<(f64, [f64; 3])> {
        scene.run(|zone| zone.try_respace(v(vert))).map(|(gain, to)| (gain, to.to_array()))
    }

    #[test]
    fn a_crease_vertex_goes_to_where_its_faces_look_the_right_way() {
        let tangled = || roof().moved(&[(42, [3.2, 0., 0.])]);
        let (gain, to) = respaced(&tangled(), 42).unwrap();
        assert_near(gain, 5.0);
        assert_eq!(to, [2., 0., 0.]);
        assert_eq!(respaced(&roof(), 42), None, "nothing to gain");
        assert_eq!(respaced(&tangled(), 12), None, "an old vertex");
        assert_eq!(respaced(&tangled().off_feature(), 42), None, "not on its crease");
        let branched = [crease(), vec![[42, 33]]].concat();
        let corner = roof_with(1.0, 30, &branched).moved(&[(42, [3.2, 0., 0.])]);
        assert_eq!(respaced(&corner, 42), None, "a corner");
    }

    #[test]
    fn where_the_middle_does_not_do_a_quarter_of_the_way_may() {
        // Old vertex 12 is beyond the crease: face 11-12-42 is turned over unless 42 is left of 1 + 1 / 1.1.
        let scene = roof().moved(&[(42, [3.2, 0., 0.]), (12, [2., 0.1, 0.1])]);
        let (gain, to) = respaced(&scene, 42).unwrap();
        assert_near(gain, 2.5);
        assert_eq!(to, [1.5, 0., 0.]);
    }

    #[test]
    fn a_respaced_vertex_keeps_its_creases_on_their_fits() {
        // The middle of 42-43 would be off by half the rise over the square root of two.
        let with_rise = |z: f64| roof().moved(&[(42, [3.2, 0., 0.]), (43, [3., 0., z])]);
        assert!(respaced(&with_rise(0.13), 42).is_some());
        assert_eq!(respaced(&with_rise(0.15), 42), None);
    }

    type Run = Option<(f64, Vec<usize>, Vec<[f64; 3]>)>;

    fn run(scene: &Scene) -> Run {
        let (gain, verts, to) = scene.run(|zone| zone.try_run(v(42), v(43)))?;
        let verts = verts.into_iter().map(Vert::index).collect();
        Some((gain, verts, to.into_iter().map(|p| p.to_array()).collect()))
    }

    #[test]
    fn a_run_is_spaced_evenly_between_its_ends() {
        let (gain, verts, to) = run(&roof().moved(&[(42, [3.2, 0., 0.])])).unwrap();
        assert_near(gain, 5.0);
        assert_eq!(verts, [42, 43]);
        assert!(to[0].map(f64::round) == [2., 0., 0.] && (to[0][0] - 2.0).abs() < 1e-12, "{to:?}");
        assert!((to[1][0] - 3.0).abs() < 1e-12, "{to:?}");
        assert_eq!(run(&roof()), None);
    }

    fn places(xs: &[(usize, f64)]) -> Scene {
        roof().moved(&xs.iter().map(|&(v, x)| (v, [x, 0., 0.])).collect::<Vec<_>>())
    }

    #[test]
    fn a_run_grows_until_it_gains() {
        // The ends 41 and 44 of the shortest run have changed places.
        let (gain, verts, to) = run(&places(&[(41, 4.), (42, 3.), (43, 2.), (44, 1.)])).unwrap();
        assert_near(gain, 15.0);
        assert_eq!(verts, [41, 42, 43, 44]);
        assert_eq!(to, [1., 2., 3., 4.].map(|x| [x, 0., 0.]));
    }

    #[test]
    fn a_run_ends_in_corners_and_has_two_vertices_at_least() {
        // The first vertex of the crease is its end.
        let first = roof().moved(&[(41, [2.2, 0., 0.])]);
        assert_eq!(first.run(|zone| zone.try_run(v(40), v(41))).unwrap().1, [41, 42].map(v));
        // 41 has a third crease; the other end of the shortest run is beyond it.
        let creases = [crease(), vec![[41, 49]]].concat();
        let corner = roof_with(1.0, 40, &creases).moved(&[(44, [0.5, 0., 0.])]);
        assert_eq!(run(&corner).unwrap().1, [42, 43, 44]);
    }

    #[test]
    fn a_run_goes_along_a_crease() {
        // 33 is near where the crease should be.
        let scene = roof().moved(&[(42, [3.2, 0., 0.]), (33, [3., 0.1, -0.1])]);
        assert!(scene.run(|zone| zone.try_run(v(42), v(43))).is_some());
        assert!(scene.run(|zone| zone.try_run(v(42), v(33))).is_none());
    }

    #[test]
    fn a_run_of_more_than_six_vertices_stays() {
        // All runs from 40 on that end in 45 to 47 run backwards, or those that end in 45 and 46 only.
        let backwards = [(41, 5.), (42, 4.), (43, 3.), (44, 2.), (45, -1.), (46, -2.)];
        let with = |x: f64| run(&places(&[&backwards[..], &[(47, x), (48, 8.)]].concat()));
        assert_eq!(with(7.0).unwrap().1, [41, 42, 43, 44, 45, 46]);
        assert_eq!(with(-3.0), None);
    }
}
