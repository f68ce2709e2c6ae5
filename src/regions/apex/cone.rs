//! A right circular cone of least squares.
//!
//! ```text
//!      apex
//!       /|\        a point p is off by   r cos(angle) - s sin(angle)
//!      / | \
//!     / s|  p      s: how far down the axis it is, r: how far from the axis
//!    /   |-r-\
//! ```
//!
//! Based on: Gauss and Newton's steps on the signed distances of the points (nothing in the papers).
//! In/out: a first guess + points -> `Cone`, and how well the points tell where its apex is.
//! Cost: O(points) a step.

use glam::DVec3;
use nalgebra::{SMatrix, SVector};

/// Steps at most: from a guess whose axis is 20 degrees off, six leave nothing that a float can see.
const MAX_STEPS: usize = 8;
/// An apex that goes farther than this from the origin, in units of the points, does not come back: most that is no cone
/// ends here.
const FARTHEST: f64 = 8.0;
/// A step that moves the apex by less than this (in units of the points) and turns nothing by more is the last.
const LAST_STEP: f64 = 1e-9;
/// Half the angles at the apex that a cone may have on the way, in radians: beyond it is a line or a plane.
const ANGLES: std::ops::Range<f64> = 0.02..1.55;

/// One half of a right circular cone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cone {
    pub apex: DVec3,
    /// Unit vector from the apex along the axis.
    pub down: DVec3,
    /// Between the axis and the sides, in radians.
    pub angle: f64,
}

/// A cone that was fitted.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fitted {
    pub cone: Cone,
    /// The standard error of the apex for points whose distances from the cone have a standard deviation of one.
    pub spread: f64,
}

impl Cone {
    /// How far down the axis `p` is and how far from it, and the unit vector from the axis to it.
    fn cylindrical(&self, p: DVec3) -> (f64, f64, DVec3) {
        let offset = p - self.apex;
        let s = offset.dot(self.down);
        let away = offset - s * self.down;
        let r = away.length();
        (s, r, away / r.max(f64::MIN_POSITIVE))
    }

    /// The signed distance of `p` from the sides, positive outside.
    pub fn distance(&self, p: DVec3) -> f64 {
        let (s, r, _) = self.cylindrical(p);
        r * self.angle.cos() - s * self.angle.sin()
    }

    /// The unit vector from the axis to `p`.
    pub fn away(&self, p: DVec3) -> DVec3 {
        self.cylindrical(p).2
    }

    /// The unit normal of the sides next to `p`, away from the axis.
    pub fn normal(&self, p: DVec3) -> DVec3 {
        self.angle.cos() * self.away(p) - self.angle.sin() * self.down
    }

    /// Root of the mean square of the distances of `points`.
    pub fn rms(&self, points: &[DVec3]) -> f64 {
        let sum: f64 = points.iter().map(|&p| self.distance(p).powi(2)).sum();
        (sum / points.len().max(1) as f64).sqrt()
    }

    /// The cone nearest to `points`, from this one on; none if it comes to nothing.
    pub fn fit(mut self, points: &[DVec3]) -> Option<Fitted> {
        for _ in 0..MAX_STEPS {
            let (e, f) = self.down.any_orthonormal_pair();
            let (mut matrix, mut right) = (SMatrix::<f64, 6, 6>::zeros(), SVector::<f64, 6>::zeros());
            for &p in points {
                let (s, r, away) = self.cylindrical(p);
                let slant = s * self.angle.cos() + r * self.angle.sin();
                let normal = self.normal(p);
                // The distance's derivatives: the apex, the axis turned towards e and f, the angle.
                let turns = [-slant * away.dot(e), -slant * away.dot(f), -slant];
                let row = SVector::from([-normal.x, -normal.y, -normal.z, turns[0], turns[1], turns[2]]);
                matrix += row * row.transpose();
                right -= row * self.distance(p);
            }
            let inverse = matrix.cholesky()?.inverse();
            let step = inverse * right;
            self.apex += DVec3::new(step[0], step[1], step[2]);
            self.down = (self.down + step[3] * e + step[4] * f).try_normalize()?;
            self.angle += step[5];
            let is_near = self.apex.length_squared() <= FARTHEST * FARTHEST; // Not if it is not a number.
            if !is_near || !ANGLES.contains(&self.angle) {
                return None;
            }
            if step.amax() < LAST_STEP {
                let spread = (inverse[(0, 0)] + inverse[(1, 1)] + inverse[(2, 2)]).sqrt();
                return Some(Fitted { cone: self, spread });
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use glam::dvec3;

    fn cone() -> Cone {
        Cone { apex: dvec3(0.3, -0.2, 0.9), down: dvec3(0.1, 0.2, -1.0).normalize(), angle: 0.45 }
    }

    /// Points of the cone, so far out of it.
    fn points(off: impl Fn(usize) -> f64) -> Vec<DVec3> {
        let Cone { apex, down, angle } = cone();
        let (e, f) = down.any_orthonormal_pair();
        let point = |i: usize| {
            let (azimuth, slant) = (2.4 * i as f64, 2.0 + 0.1 * i as f64);
            let away = azimuth.cos() * e + azimuth.sin() * f;
            let normal = angle.cos() * away - angle.sin() * down;
            apex + slant * (angle.sin() * away + angle.cos() * down) + off(i) * normal
        };
        (0..24).map(point).collect()
    }

    #[test]
    fn distances_and_normals_are_those_of_the_sides() {
        for (i, p) in points(|i| 0.01 * i as f64 - 0.1).into_iter().enumerate() {
            assert_relative_eq!(cone().distance(p), 0.01 * i as f64 - 0.1, epsilon = 1e-12);
            let foot = p - cone().distance(p) * cone().normal(p);
            assert_relative_eq!(cone().distance(foot), 0.0, epsilon = 1e-12);
        }
    }

    #[test]
    fn a_cone_is_found_from_a_guess_that_is_far_off() {
        let guess = Cone { apex: dvec3(0.5, 0.3, 0.2), down: dvec3(-0.2, 0.3, -1.0).normalize(), angle: 0.8 };
        let found = guess.fit(&points(|_| 0.0)).unwrap();
        assert!(found.cone.apex.distance(cone().apex) < 1e-9, "{}", found.cone.apex);
        assert!(found.cone.down.distance(cone().down) < 1e-9);
        assert_relative_eq!(found.cone.angle, cone().angle, epsilon = 1e-9);
    }

    #[test]
    fn the_spread_is_how_far_the_apex_goes_for_a_given_error() {
        // The mean over signs that change in turn with all periods: close to independent errors.
        let error = |period: usize| {
            let found =
                cone().fit(&points(|i| if (i / period).is_multiple_of(2) { 1e-4 } else { -1e-4 })).unwrap();
            (found.cone.apex.distance(cone().apex) / 1e-4, found.spread)
        };
        let errors: Vec<(f64, f64)> = (1..12).map(error).collect();
        let mean = errors.iter().map(|(error, _)| error).sum::<f64>() / errors.len() as f64;
        let spread = errors[0].1;
        assert!(mean > 0.3 * spread && mean < 3.0 * spread, "{mean} {spread}");
    }

    #[test]
    fn points_that_are_on_many_cones_or_none_give_none() {
        let line: Vec<DVec3> = (0..9).map(|i| f64::from(i) * DVec3::X).collect();
        assert!(cone().fit(&line).is_none());
        assert!(cone().fit(&[]).is_none());
        let plane: Vec<DVec3> = (0..25).map(|i| dvec3(f64::from(i / 5), f64::from(i % 5), 0.0)).collect();
        assert!(cone().fit(&plane).is_none());
    }
}
