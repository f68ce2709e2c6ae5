//! Pure functions on points, normals and planes. Angles are in radians.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

use glam::DVec3;
use nalgebra::{Matrix3, SymmetricEigen, Vector3};

/// The unit normal of a triangle given counter-clockwise; none when it has no area that a float can
/// express.
#[inline]
#[must_use]
pub fn unit_normal([a, b, c]: [DVec3; 3]) -> Option<DVec3> {
    let normal = (b - a).cross(c - a);
    let length = normal.length();
    (length > 0.0 && length.is_finite()).then(|| normal / length)
}

/// The angle between two vectors, in `[0, π]`. Exact also near 0 and π, where an arc cosine is not.
#[inline]
#[must_use]
pub fn angle_between(a: DVec3, b: DVec3) -> f64 {
    let (sine, cosine) = (a.cross(b).length(), a.dot(b));
    if !(sine.is_finite() && cosine.is_finite()) {
        return sine.atan2(cosine);
    }
    let (less, more) = if sine < cosine.abs() { (sine, cosine.abs()) } else { (cosine.abs(), sine) };
    if more == 0.0 {
        return 0.0;
    }
    let to_nearer_axis = arc_tangent(less / more);
    let acute = if sine < cosine.abs() { to_nearer_axis } else { FRAC_PI_2 - to_nearer_axis };
    if cosine < 0.0 { PI - acute } else { acute }
}

/// The arc tangent of `t` in [0, 1] within two units of the last place. The standard library's takes three
/// times as long, and its last bit depends on the machine.
///
/// Based on: the rational approximation of S. L. Moshier's Cephes library.
#[inline]
fn arc_tangent(t: f64) -> f64 {
    const P: [f64; 5] = [
        -8.750_608_600_031_904e-1,
        -1.615_753_718_733_365e1,
        -7.500_855_792_314_705e1,
        -1.228_866_684_490_136_2e2,
        -6.485_021_904_942_025e1,
    ];
    const Q: [f64; 6] = [
        1.0,
        2.485_846_490_142_306_3e1,
        1.650_270_098_316_988_5e2,
        4.328_810_604_912_902_7e2,
        4.853_903_996_359_137e2,
        1.945_506_571_482_614e2,
    ];
    let (base, t) = if t > 0.66 { (FRAC_PI_4, (t - 1.0) / (t + 1.0)) } else { (0.0, t) };
    let z = t * t;
    let horner = |coefficients: &[f64]| coefficients.iter().fold(0.0, |sum, c| sum * z + c);
    base + (t + t * z * horner(&P) / horner(&Q))
}

/// The angle between two vectors, in `[0, π]`, faster than [`angle_between`] and for weights only: to within 5e-13, but
/// 1.5e-8 near 0 and π, where the cosine tells no more. A number for whatever vectors, also for those of no length.
///
/// Based on: the form of Abramowitz and Stegun, 4.4.46. Differs: fourteen terms, the first exact, so that acute and
/// obtuse angles meet; the others interpolate at the Chebyshev nodes. Eight terms (1e-8) break twice as many ties between
/// triangles otherwise.
#[inline]
#[must_use]
pub(crate) fn angle_as_weight(a: DVec3, b: DVec3) -> f64 {
    const SERIES: [f64; 14] = [
        FRAC_PI_2,
        -0.214_601_836_600_713_6,
        0.089_048_621_925_203_1,
        -0.050_792_779_206_589_9,
        0.033_680_490_923_937_8,
        -0.024_364_896_446_506_6,
        0.018_604_719_962_719_9,
        -0.014_568_867_093_157_1,
        0.011_188_162_312_822_1,
        -0.007_842_858_442_027_9,
        0.004_567_423_056_171_4,
        -0.001_976_926_258_537_4,
        0.000_547_304_760_469,
        -0.000_071_323_316_574_8,
    ];
    let cosine = a.dot(b) / (a.length_squared() * b.length_squared()).sqrt();
    // Not above 1 by rounding; and 1 where there is no cosine.
    let x = cosine.abs().min(1.0);
    let acute = (1.0 - x).sqrt() * SERIES.iter().rev().fold(0.0, |sum, c| sum * x + c);
    if cosine < 0.0 { PI - acute } else { acute }
}

/// [`angle_between`] of unit vectors: below 15 degrees by a series, several times as fast.
#[inline]
#[must_use]
pub fn angle_between_units(a: DVec3, b: DVec3) -> f64 {
    angle_of_chord(a.distance_squared(b), || angle_between(a, b))
}

/// The angle between unit vectors from the square of the distance of their tips; `otherwise`, if that is too
/// large for the series.
#[inline]
pub(crate) fn angle_of_chord(chord_squared: f64, otherwise: impl FnOnce() -> f64) -> f64 {
    /// Square of the chord of 15 degrees. The first term left out is below the rounding error.
    const SERIES: f64 = 0.068;
    let q = chord_squared;
    if q >= SERIES {
        return otherwise();
    }
    // 2 asin(chord / 2), divided by the chord: the coefficients are C(2n, n) / (16^n (2n + 1)).
    const C: [f64; 8] = [
        1.0,
        1.0 / 24.0,
        3.0 / 640.0,
        5.0 / 7168.0,
        35.0 / 294_912.0,
        63.0 / 2_883_584.0,
        231.0 / 54_525_952.0,
        143.0 / 167_772_160.0,
    ];
    q.sqrt() * C.iter().rev().fold(0.0, |sum, c| sum * q + c)
}

/// The three inner angles of a triangle. A corner on two coincident points counts as a right angle,
/// and the corner between the two as 0, so that a collapsed triangle has one vanishing angle.
#[must_use]
pub fn inner_angles(triangle: [DVec3; 3]) -> [f64; 3] {
    [0, 1, 2].map(|i| {
        let (a, b) = (triangle[(i + 1) % 3] - triangle[i], triangle[(i + 2) % 3] - triangle[i]);
        if a == DVec3::ZERO || b == DVec3::ZERO {
            if a == b { 0.0 } else { std::f64::consts::FRAC_PI_2 }
        } else {
            angle_between(a, b)
        }
    })
}

/// A plane through `point` with unit normal `normal`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// A point of the plane.
    pub point: DVec3,
    /// Its unit normal.
    pub normal: DVec3,
}

impl Plane {
    /// Signed distance of `p`, positive on the side that the normal points to.
    #[inline]
    #[must_use]
    pub fn distance(&self, p: DVec3) -> f64 {
        (p - self.point).dot(self.normal)
    }
}

/// The point of the line `P ∩ Q` nearest to `from`, and the sine of the angle between the planes.
///
/// None when the planes are parallel or antiparallel to the last bit; the caller decides from the sine
/// what is too nearly so.
///
/// Based on: Sharpen&Bend section 3.3. Differs: the papers' closed form is not this point (with
/// `AB = B - A` its sign is wrong); this solves the two plane equations for the least displacement.
#[must_use]
pub fn nearest_on_both(p: Plane, q: Plane, from: DVec3) -> Option<(DVec3, f64)> {
    let (n, m) = (p.normal, q.normal);
    let sine_squared = n.cross(m).length_squared();
    let cosine = n.dot(m);
    let (to_p, to_q) = (-p.distance(from), -q.distance(from));
    let along_n = (to_p - cosine * to_q) / sine_squared;
    let along_m = (to_q - cosine * to_p) / sine_squared;
    let point = from + along_n * n + along_m * m;
    (sine_squared > 0.0 && point.is_finite()).then(|| (point, sine_squared.sqrt()))
}

/// The point that lies on all `planes` in the sense of least squares and, where they leave it free, is
/// nearest to `from`; and the smallest singular value of their unit normals that was used or refused.
///
/// A direction whose singular value is below `cutoff` times the largest one counts as left free.
#[must_use]
pub fn nearest_on_all(planes: &[Plane], from: DVec3, cutoff: f64) -> (DVec3, f64) {
    let mut normal_matrix = Matrix3::zeros();
    let mut right_side = Vector3::zeros();
    for plane in planes {
        let n = Vector3::from(plane.normal.to_array());
        normal_matrix += n * n.transpose();
        right_side -= n * plane.distance(from);
    }
    // The squares of the singular values are the eigenvalues: exact enough, as `cutoff` is far above
    // the square root of the rounding error.
    let eigen = SymmetricEigen::new(normal_matrix);
    let largest = eigen.eigenvalues.max();
    let mut step = Vector3::zeros();
    for (value, direction) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
        if *value > cutoff * cutoff * largest {
            step += direction * (direction.dot(&right_side) / value);
        }
    }
    let smallest = eigen.eigenvalues.min().max(0.0).sqrt();
    (from + DVec3::new(step.x, step.y, step.z), smallest)
}

/// The distance of a point from a triangle; from the nearest of its sides where it has no area.
#[must_use]
pub fn distance_to_triangle(p: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let to_side = |(a, b): (DVec3, DVec3)| {
        let along = b - a;
        let share = (p - a).dot(along) / along.length_squared();
        p.distance(if share > 0.0 { a + share.min(1.0) * along } else { a })
    };
    let normal = (b - a).cross(c - a);
    let sides = [(a, b), (b, c), (c, a)];
    let is_over = sides.iter().all(|&(q, r)| (r - q).cross(p - q).dot(normal) >= 0.0);
    if is_over && normal != DVec3::ZERO {
        return (p - a).dot(normal).abs() / normal.length();
    }
    sides.map(to_side).into_iter().fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use glam::dvec3;

    #[test]
    fn angles_are_those_of_the_standard_library() {
        for i in 0..=3600 {
            let (sine, cosine) = (f64::from(i) / 3600.0 * PI).sin_cos();
            let between = angle_between(DVec3::X * 3.0, DVec3::new(cosine, sine, 0.0));
            assert_relative_eq!(between, sine.atan2(cosine), max_relative = 1e-15);
        }
        assert_eq!(angle_between(DVec3::ZERO, DVec3::X), 0.0);
        assert_eq!(angle_between(DVec3::X, DVec3::Y), FRAC_PI_2);
        assert!(angle_between(DVec3::X, DVec3::NAN).is_nan());
    }

    #[test]
    fn weights_are_angles_and_numbers_for_all_vectors() {
        for i in 0..=36_000 {
            let angle = f64::from(i) / 36_000.0 * PI;
            let (sine, cosine) = angle.sin_cos();
            let weight = angle_as_weight(DVec3::X * 3.0, dvec3(0.2 * cosine, 0.0, -0.2 * sine));
            let epsilon = if sine < 5e-4 { 1.5e-8 } else { 5e-13 };
            assert_relative_eq!(weight, angle, epsilon = epsilon, max_relative = 0.0);
        }
        // Acute and obtuse angles meet.
        let beside = [1e-17, -1e-17].map(|x| angle_as_weight(DVec3::X, dvec3(x, 1.0, 0.0)));
        assert_eq!(beside, [FRAC_PI_2; 2]);
        for v in [DVec3::ZERO, DVec3::X, 1e300 * DVec3::ONE, DVec3::INFINITY, DVec3::NAN] {
            let weight = angle_as_weight(v, dvec3(1e-300, 2.0, 0.0));
            assert!((0.0..=PI).contains(&weight), "{v:?}: {weight}");
        }
        let v = dvec3(1.0 / 3.0, 1.0 / 7.0, 1.0 / 11.0);
        assert!(angle_as_weight(v, 3.0 * v) <= 1.5e-8 && angle_as_weight(v, -3.0 * v) >= PI - 1.5e-8);
    }

    #[test]
    fn the_series_of_small_angles_is_exact() {
        for i in 0..2000 {
            let angle = (f64::from(i) * 0.16).to_radians().min(PI);
            let axis = DVec3::new(1.0, f64::from(i % 7), f64::from(i % 5)).normalize();
            let a = axis.any_orthonormal_vector();
            let b = glam::DQuat::from_axis_angle(axis, angle) * a;
            assert_relative_eq!(angle_between_units(a, b), angle_between(a, b), epsilon = 4e-16);
        }
        assert_eq!(angle_between_units(DVec3::X, DVec3::X), 0.0);
    }

    #[test]
    fn a_triangle_without_area_has_no_normal() {
        assert_eq!(unit_normal([DVec3::ZERO, DVec3::X, DVec3::Y]), Some(DVec3::Z));
        assert_eq!(unit_normal([DVec3::ZERO, DVec3::X, 2.0 * DVec3::X]), None);
        assert_eq!(unit_normal([DVec3::ZERO, 1e300 * DVec3::X, 1e300 * DVec3::Y]), None);
    }

    #[test]
    fn angles_are_exact_near_their_ends() {
        assert_relative_eq!(angle_between(DVec3::X, dvec3(1., 1e-9, 0.)), 1e-9, max_relative = 1e-12);
        assert_relative_eq!(angle_between(DVec3::X, -DVec3::X), PI);
        let right = inner_angles([DVec3::ZERO, DVec3::X, DVec3::Y]);
        for (angle, expected) in right.into_iter().zip([FRAC_PI_2, FRAC_PI_4, FRAC_PI_4]) {
            assert_relative_eq!(angle, expected);
        }
    }

    #[test]
    fn a_collapsed_triangle_has_one_vanishing_angle() {
        assert_eq!(inner_angles([DVec3::ZERO, DVec3::X, DVec3::X]), [0.0, FRAC_PI_2, FRAC_PI_2]);
        assert_eq!(inner_angles([DVec3::X; 3]), [0.0; 3]);
    }

    #[test]
    fn two_planes_meet_nearest_to_the_point() {
        let p = Plane { point: dvec3(0., 0., 1.), normal: DVec3::Z };
        let slanted = Plane { point: dvec3(2., 0., 0.), normal: dvec3(1., 0., 1.).normalize() };
        let (point, sine) = nearest_on_both(p, slanted, dvec3(5., 7., 3.)).unwrap();
        assert_relative_eq!(point.distance(dvec3(1., 7., 1.)), 0.0, epsilon = 1e-12);
        assert_relative_eq!(sine, FRAC_PI_4.sin(), epsilon = 1e-12);
        let antiparallel = Plane { point: DVec3::ZERO, normal: -DVec3::Z };
        assert_eq!(nearest_on_both(p, antiparallel, DVec3::X), None);
    }

    #[test]
    fn three_planes_meet_in_their_corner() {
        let corner = dvec3(0.3, -2., 5.);
        let normals = [dvec3(1., 0.2, 0.), dvec3(0., 1., 0.4), dvec3(-0.3, 0., 1.)];
        let planes = normals.map(|n| Plane { point: corner, normal: n.normalize() });
        let (point, smallest) = nearest_on_all(&planes, dvec3(9., 9., 9.), 0.1);
        assert_relative_eq!(point.distance(corner), 0.0, epsilon = 1e-12);
        assert!(smallest > 0.5 && smallest <= 1.0, "{smallest}");
    }

    #[test]
    fn three_planes_on_one_line_leave_it_free() {
        let normals = [DVec3::X, DVec3::Y, dvec3(1., 1., 0.).normalize()];
        let planes = normals.map(|normal| Plane { point: dvec3(1., 2., 100.), normal });
        let (point, smallest) = nearest_on_all(&planes, dvec3(0., 0., 7.), 0.1);
        assert_relative_eq!(point.distance(dvec3(1., 2., 7.)), 0.0, epsilon = 1e-12);
        assert!(smallest < 1e-7, "{smallest}");
    }

    #[test]
    fn a_triangle_is_as_far_away_as_its_nearest_point() {
        let t = [DVec3::ZERO, DVec3::new(4.0, 0.0, 0.0), DVec3::new(0.0, 4.0, 0.0)];
        let from = |x, y, z| distance_to_triangle(DVec3::new(x, y, z), t);
        assert_eq!(from(1.0, 1.0, -3.0), 3.0, "inside");
        assert_eq!(from(2.0, -3.0, 4.0), 5.0, "a side");
        assert_eq!(from(7.0, -4.0, 0.0), 5.0, "a corner");
        assert_eq!(distance_to_triangle(DVec3::Z, [DVec3::ZERO; 3]), 1.0);
        assert_eq!(distance_to_triangle(DVec3::Z, [DVec3::ZERO, DVec3::X, 2.0 * DVec3::X]), 1.0);
    }
}
