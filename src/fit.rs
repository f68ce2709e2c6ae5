//! Local fits of smooth regions: height fields over a plane, up to the second degree.
//!
//! ```text
//!        m                      z = c0 + c1 x + c2 y + c3 x²/2 + c4 xy + c5 y²/2
//!        ^     .-o--o-.
//!        |  o´         `o       x, y along t1, t2 and z along m, from the origin, in units of
//!   -----+--------------->t1    h, the mean edge length
//!      origin
//! ```
//!
//! Based on: REGIONS.md step 4 (nothing in the papers, which take the mean of the red normals).
//! Differs: nothing.
//! In/out: `Sample`s round an origin -> `Fit`.
//! Cost: O(samples), no allocation; the sums of the normal equations are moments, 11 for a plane and 27
//! for a quadric, so that a sample costs some 50 operations.

use glam::DVec3;
use nalgebra::{SMatrix, SVector};

/// Samples at the origin weigh `1 / SOFTENING`, those at distance r (in h) `1 / (SOFTENING + r²)`: the
/// weight falls by half at 0.7 h, so that no single near sample rules.
const SOFTENING: f64 = 0.5;
/// A sample whose normal's cosine to the mean normal is not above this (70 degrees) is not part of a
/// height field over it: its slope is too steep to be trusted.
const LEAST_COSINE: f64 = 0.35;
/// Weight of a slope's residual against that of a height (in h), before squaring.
const SLOPE_WEIGHT: f64 = 0.5;
/// Added to the diagonal of the normal equations, times their trace: enough to solve for samples on one
/// line, too little to be seen in any other fit.
const RIDGE: f64 = 1e-9;
/// A quadric needs this many samples (three equations each) ...
const QUADRIC_SAMPLES: usize = 5;
/// ... a plane that leaves more than this residual (in h) ...
const FLAT_RMS: f64 = 1e-3;
/// ... and has to bring the residual below this share of the plane's. Curvature does; noise does not.
const QUADRIC_GAIN: f64 = 0.5;

/// How a vertex came by its fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FitSource {
    /// A smooth region nearby explains the vertex.
    Region,
    /// No region does, but the vertex has red faces: the papers' plane.
    Paper,
    /// Neither: the fit of vertices round it which nothing explained.
    Leftover,
    /// The fit of a neighbour, on which the vertex happens to lie.
    Adopted,
}

/// A height field that stands for a smooth region near one vertex.
#[derive(Clone, Debug)]
pub struct Fit {
    /// The position of the vertex.
    pub origin: DVec3,
    /// Orthonormal and right-handed: two tangents, and the direction of the heights.
    pub frame: [DVec3; 3],
    /// `c0` to `c5` as in the picture, in units of the mean edge length; the last three 0 for a plane.
    pub coefficients: [f64; 6],
    /// Root of the weighted mean square of the residuals of heights and slopes, in mean edge lengths.
    pub rms: f64,
    /// Number of samples that it rests on; 0 for the papers' plane.
    pub n_members: usize,
    /// How far along `normal` the vertex is from the fit, in mean edge lengths.
    pub displacement: f64,
    /// Unit normal of the fit at the vertex.
    pub normal: DVec3,
    /// How the vertex came by it.
    pub source: FitSource,
}

impl Fit {
    /// A plane through `origin` with unit `normal`.
    #[must_use]
    pub fn plane(origin: DVec3, normal: DVec3, source: FitSource) -> Self {
        let (coefficients, rms, displacement) = ([0.0; 6], 0.0, 0.0);
        Self { origin, frame: frame(normal), coefficients, rms, n_members: 0, displacement, normal, source }
    }

    /// The signed distance of `p` from the fit in units of `h`, the mean edge length that the fit was
    /// made with, to first order (height over the length of the gradient); and the unit normal of the
    /// fit below `p`.
    #[inline]
    #[must_use]
    pub fn evaluate(&self, p: DVec3, h: f64) -> (f64, DVec3) {
        let [t1, t2, m] = self.frame;
        let [c0, c1, c2, c3, c4, c5] = self.coefficients;
        let offset = (p - self.origin) / h;
        let (x, y, z) = (offset.dot(t1), offset.dot(t2), offset.dot(m));
        let height = c0 + c1 * x + c2 * y + 0.5 * c3 * x * x + c4 * x * y + 0.5 * c5 * y * y;
        let (slope_x, slope_y) = (c1 + c3 * x + c4 * y, c2 + c4 * x + c5 * y);
        let steepness = (1.0 + slope_x * slope_x + slope_y * slope_y).sqrt();
        ((z - height) / steepness, (m - slope_x * t1 - slope_y * t2) / steepness)
    }
}

/// Two tangents and `m`, orthonormal and right-handed.
fn frame(m: DVec3) -> [DVec3; 3] {
    let aside = if m.x.abs() < 0.6 { DVec3::X } else { DVec3::Y };
    let t1 = m.cross(aside).normalize();
    [t1, m.cross(t1), m]
}

/// A vertex of a smooth region, as a fit sees it.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// From the fit's origin to the vertex, in mean edge lengths.
    pub offset: DVec3,
    /// Unit normal at the vertex.
    pub normal: DVec3,
    /// How far the sample is trusted: 1 deep inside a region, less near its border.
    pub trust: f64,
}

/// Fits a height field over the mean normal of `samples` round `origin`; a plane unless a quadric is
/// clearly better. None when no sample has a usable normal or the solution is not finite.
///
/// `samples` is working space and holds local coordinates afterwards.
#[must_use]
pub fn fit_samples(origin: DVec3, samples: &mut Vec<Sample>, source: FitSource) -> Option<Fit> {
    let mut mean = DVec3::ZERO;
    for sample in samples.iter_mut() {
        sample.trust /= SOFTENING + sample.offset.length_squared();
        mean += sample.trust * sample.normal;
    }
    let m = mean.try_normalize()?;
    let frame = frame(m);
    samples.retain_mut(|sample| into_frame(sample, &frame));
    let (mut coefficients, mut rms) = solve_plane(samples)?;
    if samples.len() >= QUADRIC_SAMPLES && rms > FLAT_RMS {
        let quadric = solve_quadric(samples);
        if let Some(better) = quadric.filter(|&(_, quadric_rms)| quadric_rms < QUADRIC_GAIN * rms) {
            (coefficients, rms) = better;
        }
    }
    let [c0, c1, c2, ..] = coefficients;
    let steepness = (1.0 + c1 * c1 + c2 * c2).sqrt();
    let displacement = c0 / steepness;
    let normal = (m - c1 * frame[0] - c2 * frame[1]) / steepness;
    let is_sound = rms.is_finite() && displacement.is_finite() && normal.is_finite();
    let n_members = samples.len();
    is_sound.then_some(Fit { origin, frame, coefficients, rms, n_members, displacement, normal, source })
}

/// Turns a sample's offset into local coordinates and its normal into the slopes along x and y. False
/// when it is too steep for that.
#[inline]
fn into_frame(sample: &mut Sample, [t1, t2, m]: &[DVec3; 3]) -> bool {
    let cosine = sample.normal.dot(*m);
    let slope = -cosine.recip();
    sample.normal = DVec3::new(sample.normal.dot(*t1) * slope, sample.normal.dot(*t2) * slope, 0.0);
    sample.offset = DVec3::new(sample.offset.dot(*t1), sample.offset.dot(*t2), sample.offset.dot(*m));
    cosine > LEAST_COSINE
}

/// Square of [`SLOPE_WEIGHT`].
const K: f64 = SLOPE_WEIGHT * SLOPE_WEIGHT;

/// Least squares for the first three coefficients, and the residual.
fn solve_plane(samples: &[Sample]) -> Option<([f64; 6], f64)> {
    let mut sums = [0.0; 12];
    for &Sample { offset, normal: slope, trust: w } in samples {
        let (wx, wy, wz) = (w * offset.x, w * offset.y, w * offset.z);
        let (wp, wq) = (w * slope.x, w * slope.y);
        let square = wz * offset.z + K * (wp * slope.x + wq * slope.y);
        let terms = [w, wx, wy, wx * offset.x, wx * offset.y, wy * offset.y];
        let right = [wz, wz * offset.x, wz * offset.y, wp, wq, square];
        for (sum, term) in sums.iter_mut().zip(terms.into_iter().chain(right)) {
            *sum += term;
        }
    }
    let [s, x, y, xx, xy, yy, z, zx, zy, p, q, square] = sums;
    #[rustfmt::skip]
    let matrix = SMatrix::<f64, 3, 3>::new(
        s, x,          y,
        x, xx + K * s, xy,
        y, xy,         yy + K * s,
    );
    let right = SVector::from([z, zx + K * p, zy + K * q]);
    let (c, rms) = solve(matrix, right, square, s)?;
    Some(([c[0], c[1], c[2], 0.0, 0.0, 0.0], rms))
}

/// Least squares for all six coefficients, and the residual.
fn solve_quadric(samples: &[Sample]) -> Option<([f64; 6], f64)> {
    // Sums of w x^i y^j, named by the letters: the slope equations need the lower ones once more.
    let mut moments = [0.0; 15];
    let mut heights = [0.0; 6];
    let mut slopes = [0.0; 6];
    let mut square = 0.0;
    for &Sample { offset, normal: slope, trust: w } in samples {
        let (x, y, z) = (offset.x, offset.y, offset.z);
        let (xx, xy, yy) = (x * x, x * y, y * y);
        let (wxx, wxy, wyy) = (w * xx, w * xy, w * yy);
        let low = [w, w * x, w * y, wxx, wxy, wyy];
        let high = [wxx * x, wxx * y, wyy * x, wyy * y, wxx * xx, wxx * xy, wxx * yy, wxy * yy, wyy * yy];
        for (sum, term) in moments.iter_mut().zip(low.into_iter().chain(high)) {
            *sum += term;
        }
        for (sum, term) in heights.iter_mut().zip(low) {
            *sum += term * z;
        }
        for i in 0..3 {
            slopes[i] += low[i] * slope.x;
            slopes[3 + i] += low[i] * slope.y;
        }
        square += w * (z * z + K * (slope.x * slope.x + slope.y * slope.y));
    }
    let [s, x, y, xx, xy, yy, xxx, xxy, xyy, yyy, xxxx, xxxy, xxyy, xyyy, yyyy] = moments;
    let [z, zx, zy, zxx, zxy, zyy] = heights;
    let [p, px, py, q, qx, qy] = slopes;
    #[rustfmt::skip]
    let matrix = SMatrix::<f64, 6, 6>::new(
        s,        x,                 y,                 0.5 * xx,             xy,                   0.5 * yy,
        x,        xx + K * s,        xy,                0.5 * xxx + K * x,    xxy + K * y,          0.5 * xyy,
        y,        xy,                yy + K * s,        0.5 * xxy,            xyy + K * x,          0.5 * yyy + K * y,
        0.5 * xx, 0.5 * xxx + K * x, 0.5 * xxy,         0.25 * xxxx + K * xx, 0.5 * xxxy + K * xy,  0.25 * xxyy,
        xy,       xxy + K * y,       xyy + K * x,       0.5 * xxxy + K * xy,  xxyy + K * (xx + yy), 0.5 * xyyy + K * xy,
        0.5 * yy, 0.5 * xyy,         0.5 * yyy + K * y, 0.25 * xxyy,          0.5 * xyyy + K * xy,  0.25 * yyyy + K * yy,
    );
    let right = [z, zx + K * p, zy + K * q, 0.5 * zxx + K * px, zxy + K * (py + qx), 0.5 * zyy + K * qy];
    let (c, rms) = solve(matrix, SVector::from(right), square, s)?;
    Some((c.into(), rms))
}

/// Solves normal equations. `square` is the weighted sum of the squares that are to be explained; from
/// it follows the root of the weighted mean square of what is left, exact to some 1e-8 of the patch, far
/// below anything that it is compared with.
fn solve<const N: usize>(
    matrix: SMatrix<f64, N, N>,
    right: SVector<f64, N>,
    square: f64,
    weights: f64,
) -> Option<(SVector<f64, N>, f64)> {
    let mut ridged = matrix;
    let ridge = RIDGE * matrix.trace();
    for i in 0..N {
        ridged[(i, i)] += ridge;
    }
    let c = ridged.cholesky()?.solve(&right);
    let left = square - c.dot(&(2.0 * right - matrix * c));
    Some((c, (left.max(0.0) / weights).sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use glam::dvec3;

    /// Samples of the graph of `height` with gradient `slope` over a 5 x 5 grid, turned by `turn`.
    fn samples(turn: glam::DQuat, height: impl Fn(f64, f64) -> (f64, f64, f64)) -> Vec<Sample> {
        let grid = (-2..=2).flat_map(|i| (-2..=2).map(move |j| (f64::from(i) * 0.7, f64::from(j) * 0.9)));
        grid.map(|(x, y)| {
            let (z, slope_x, slope_y) = height(x, y);
            let normal = dvec3(-slope_x, -slope_y, 1.0).normalize();
            Sample { offset: turn * dvec3(x, y, z), normal: turn * normal, trust: 1.0 }
        })
        .collect()
    }

    fn turn() -> glam::DQuat {
        glam::DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -1.1, 2.0)
    }

    #[test]
    fn a_plane_is_reproduced_exactly() {
        let (a, b, c) = (0.3, 0.2, -0.5);
        let mut plane = samples(turn(), |x, y| (a + b * x + c * y, b, c));
        let fit = fit_samples(dvec3(7., 8., 9.), &mut plane, FitSource::Region).unwrap();
        let normal = turn() * dvec3(-b, -c, 1.0).normalize();
        assert_eq!((fit.n_members, fit.coefficients[3..].to_vec()), (25, vec![0.0; 3]));
        assert_relative_eq!(fit.normal.distance(normal), 0.0, epsilon = 1e-8);
        assert_relative_eq!(fit.displacement, a / (1.0 + b * b + c * c).sqrt(), max_relative = 1e-7);
        assert!(fit.rms < 1e-7, "{}", fit.rms);
        // Three mean edges of length 2 beyond the plane, wherever along it.
        let on_plane = dvec3(7., 8., 9.) + 2.0 * (turn() * dvec3(5., 1., a + 5. * b + c));
        let (distance, at) = fit.evaluate(on_plane + 6.0 * normal, 2.0);
        assert_relative_eq!(distance, 3.0, epsilon = 1e-6);
        assert_relative_eq!(at.distance(normal), 0.0, epsilon = 1e-8);
    }

    #[test]
    fn a_quadric_over_its_mean_normal_is_reproduced_exactly() {
        // Symmetric in x and in y, so that the mean normal is z.
        let (a, b, c) = (-0.2, 0.3, -0.1);
        let quadric = |x: f64, y: f64| (a + b * x * x + c * y * y, 2. * b * x, 2. * c * y);
        let fit = fit_samples(DVec3::ZERO, &mut samples(turn(), quadric), FitSource::Region).unwrap();
        assert!(fit.rms < 1e-7, "{}", fit.rms);
        assert_relative_eq!(fit.displacement, a, epsilon = 1e-7);
        let (x, y) = (0.8, -0.6);
        let (z, slope_x, slope_y) = quadric(x, y);
        let (distance, normal) = fit.evaluate(turn() * dvec3(x, y, z), 1.0);
        assert_relative_eq!(distance, 0.0, epsilon = 1e-7);
        let expected = turn() * dvec3(-slope_x, -slope_y, 1.0).normalize();
        assert_relative_eq!(normal.distance(expected), 0.0, epsilon = 1e-7);
    }

    #[test]
    fn all_six_terms_of_a_quadric_are_solved_for() {
        let c = [0.1, 0.02, -0.03, 0.4, 0.15, -0.2];
        let [c0, c1, c2, c3, c4, c5] = c;
        let mut locals = samples(glam::DQuat::IDENTITY, |x, y| {
            let z = c0 + c1 * x + c2 * y + 0.5 * c3 * x * x + c4 * x * y + 0.5 * c5 * y * y;
            (z, c1 + c3 * x + c4 * y, c2 + c4 * x + c5 * y)
        });
        locals.retain_mut(|sample| into_frame(sample, &[DVec3::X, DVec3::Y, DVec3::Z]));
        let (solved, rms) = solve_quadric(&locals).unwrap();
        for (solved, expected) in solved.into_iter().zip(c) {
            assert_relative_eq!(solved, expected, epsilon = 1e-7);
        }
        assert!(rms < 1e-7, "{rms}");
    }

    #[test]
    fn noise_does_not_bend_a_plane() {
        let mut sign = 1.0;
        let mut noisy = samples(turn(), |_, _| (0.0, 0.0, 0.0));
        for sample in &mut noisy {
            sign = -sign;
            sample.offset += 0.1 * sign * (turn() * DVec3::Z);
        }
        let fit = fit_samples(DVec3::ZERO, &mut noisy, FitSource::Region).unwrap();
        assert_eq!(fit.coefficients[3..], [0.0; 3]);
        assert_relative_eq!(fit.rms, 0.1, epsilon = 0.01);
    }

    #[test]
    fn steep_samples_are_left_out_and_opposite_ones_make_no_fit() {
        let mut plane = samples(turn(), |_, _| (0.0, 0.0, 0.0));
        plane.push(Sample { offset: turn() * DVec3::X, normal: turn() * DVec3::X, trust: 1.0 });
        let fit = fit_samples(DVec3::ZERO, &mut plane, FitSource::Region).unwrap();
        assert_eq!(fit.n_members, 25);
        let facing = |normal| Sample { offset: DVec3::ZERO, normal, trust: 1.0 };
        let mut opposite = vec![facing(DVec3::Z), facing(-DVec3::Z)];
        assert!(fit_samples(DVec3::ZERO, &mut opposite, FitSource::Region).is_none());
    }

    #[test]
    fn one_sample_makes_the_plane_of_its_normal() {
        let normal = dvec3(1., 2., 3.).normalize();
        let mut one = vec![Sample { offset: 0.5 * normal, normal, trust: 0.1 }];
        let fit = fit_samples(DVec3::ZERO, &mut one, FitSource::Leftover).unwrap();
        assert_relative_eq!(fit.displacement, 0.5, epsilon = 1e-8);
        assert_relative_eq!(fit.normal.distance(normal), 0.0, epsilon = 1e-12);
    }
}
