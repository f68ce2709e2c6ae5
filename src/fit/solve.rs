//! The normal equations of a fit: sums over its samples, and their solution.
//!
//! ```text
//!   z = c0 + c1 x + c2 y + c3 x²/2 + c4 x y + c5 y²/2        each sample gives three equations: its height,
//!   p = c1 + c3 x + c4 y,   q = c2 + c4 x + c5 y             and the slopes p and q of its normal
//! ```
//!
//! Based on: nothing in the papers; weighted linear least squares, solved by Cholesky's factors.
//! In/out: local samples, in h -> six coefficients and the root mean square of what they leave.
//! Cost: O(samples), one pass; 28 sums for a quadric, 12 for a plane, 10 for one through places alone.

use glam::DVec3;
use nalgebra::{SMatrix, SVector};

use super::Sample;

/// Weight of a slope's residual against that of a height (in h), before squaring.
const SLOPE_WEIGHT: f64 = 0.5;
/// Square of [`SLOPE_WEIGHT`].
const K: f64 = SLOPE_WEIGHT * SLOPE_WEIGHT;
/// Added to the diagonal of the normal equations, times their trace: enough to solve for samples on one
/// line, too little to be seen in any other fit.
const RIDGE: f64 = 1e-9;
/// What a curvature of 1 / h adds to the mean square of the residuals (in h): the samples of a narrow
/// region lie in a row, and without it the least error of their slopes bends the quadric across the row.
/// Samples that say anything about the curvature outweigh it.
const CURVATURE_PRIOR: f64 = 0.005;
/// How often the square of each coefficient counts in what is added to the diagonal. The mixed one stands twice
/// in the matrix of second derivatives: with less, fits depend on which tangents they are over, and with them
/// on how the mesh is turned (new vertices by up to 1e-4 of the diagonal).
const TIMES: [f64; 6] = [1.0, 1.0, 1.0, 1.0, 2.0, 1.0];
/// Samples whose places are to span a plane have this variance at least in every direction of it, in h²: those in one row
/// have none across it, in two rows .25.
const MIN_SPREAD: f64 = 0.1;
/// A sample whose normal's cosine to the mean normal is not above this (37 degrees) is not part of a
/// height field over it: round the wall of a hole no parabola passes. At 70 degrees the rims of coarse holes have up to
/// 1.3 times the error, a coarse fandisk loses 4 of 18 corners; at 45 a third of what is gained is lost, at 32 a
/// fifth.
const LEAST_COSINE: f64 = 0.8;

/// A sample of a height field, in local coordinates and units of h.
#[derive(Clone, Copy, Debug)]
pub(super) struct Local {
    pub x: f64,
    pub y: f64,
    pub z: f64,
    /// Slope along x, as the sample's normal has it.
    pub p: f64,
    /// Slope along y.
    pub q: f64,
    pub weight: f64,
}

impl Local {
    /// `sample` over the tangents `t1` and `t2`, with heights along `m`. None when it is too steep for that.
    #[inline]
    pub fn of(&Sample { offset, normal, weight }: &Sample, &[t1, t2, m]: &[DVec3; 3]) -> Option<Self> {
        let cosine = normal.dot(m);
        (cosine > LEAST_COSINE).then(|| {
            let slope = -cosine.recip();
            let (x, y, z) = (offset.dot(t1), offset.dot(t2), offset.dot(m));
            let (p, q) = (normal.dot(t1) * slope, normal.dot(t2) * slope);
            Self { x, y, z, p, q, weight }
        })
    }

    /// The square of what a height field leaves of this sample's height and slopes.
    #[inline]
    pub fn squared_residual(&self, [c0, c1, c2, c3, c4, c5]: &[f64; 6]) -> f64 {
        let &Self { x, y, z, p, q, .. } = self;
        let height = c0 + c1 * x + c2 * y + 0.5 * c3 * x * x + c4 * x * y + 0.5 * c5 * y * y - z;
        let (along_x, along_y) = (c1 + c3 * x + c4 * y - p, c2 + c4 * x + c5 * y - q);
        height * height + K * (along_x * along_x + along_y * along_y)
    }
}

/// A height field of least squares.
#[derive(Clone, Copy, Debug)]
pub(super) struct Solution {
    /// As [`super::Fit::coefficients`].
    pub coefficients: [f64; 6],
    /// As [`super::Fit::rms`].
    pub rms: f64,
    pub is_quadric: bool,
}

/// Least squares for the first three coefficients.
pub(super) fn plane(samples: &[Local]) -> Option<Solution> {
    let mut sums = [0.0; 12];
    for &Local { x, y, z, p, q, weight: w } in samples {
        let (wx, wy, wz, wp, wq) = (w * x, w * y, w * z, w * p, w * q);
        let square = wz * z + K * (wp * p + wq * q);
        let terms = [w, wx, wy, wx * x, wx * y, wy * y, wz, wz * x, wz * y, wp, wq, square];
        for (sum, term) in sums.iter_mut().zip(terms) {
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
    Some(Solution { coefficients: [c[0], c[1], c[2], 0.0, 0.0, 0.0], rms, is_quadric: false })
}

/// Least squares of the heights alone for the first three coefficients, if the samples span a plane.
pub(super) fn plane_through(samples: &[Local]) -> Option<Solution> {
    let mut sums = [0.0; 10];
    for &Local { x, y, z, weight: w, .. } in samples {
        let (wx, wy, wz) = (w * x, w * y, w * z);
        let terms = [w, wx, wy, wx * x, wx * y, wy * y, wz, wz * x, wz * y, wz * z];
        for (sum, term) in sums.iter_mut().zip(terms) {
            *sum += term;
        }
    }
    let [s, x, y, xx, xy, yy, z, zx, zy, square] = sums;
    // The smaller eigenvalue of the covariance.
    let (vx, vy, vxy) = (xx / s - (x / s).powi(2), yy / s - (y / s).powi(2), xy / s - x * y / (s * s));
    let least = 0.5 * (vx + vy - (vx - vy).hypot(2.0 * vxy));
    if least < MIN_SPREAD {
        return None;
    }
    #[rustfmt::skip]
    let matrix = SMatrix::<f64, 3, 3>::new(
        s, x,  y,
        x, xx, xy,
        y, xy, yy,
    );
    let (c, rms) = solve(matrix, SVector::from([z, zx, zy]), square, s)?;
    Some(Solution { coefficients: [c[0], c[1], c[2], 0.0, 0.0, 0.0], rms, is_quadric: false })
}

/// Least squares for all six coefficients.
pub(super) fn quadric(samples: &[Local]) -> Option<Solution> {
    // Sums of w x^i y^j, named by the letters: the slope equations need the lower ones once more.
    let mut moments = [0.0; 15];
    let mut heights = [0.0; 6];
    let mut slopes = [0.0; 6];
    let mut square = 0.0;
    for &Local { x, y, z, p, q, weight: w } in samples {
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
            slopes[i] += low[i] * p;
            slopes[3 + i] += low[i] * q;
        }
        square += w * (z * z + K * (p * p + q * q));
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
    Some(Solution { coefficients: c.into(), rms, is_quadric: true })
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
    let ridge = RIDGE * (0..N).map(|i| matrix[(i, i)] / TIMES[i]).sum::<f64>();
    for i in 0..N {
        ridged[(i, i)] += TIMES[i] * (ridge + if i < 3 { 0.0 } else { CURVATURE_PRIOR * weights });
    }
    let c = ridged.cholesky()?.solve(&right);
    let left = square - c.dot(&(2.0 * right - matrix * c));
    Some((c, (left.max(0.0) / weights).sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn all_six_terms_of_a_quadric_are_solved_for() {
        let c = [0.1, 0.02, -0.03, 0.4, 0.15, -0.2];
        let [c0, c1, c2, c3, c4, c5] = c;
        // Far enough for the prior to have no weight, and not so far that the ridge has.
        let grid = (-2..=2).flat_map(|i| (-2..=2).map(move |j| (f64::from(i) * 7.0, f64::from(j) * 9.0)));
        let local = |(x, y)| {
            let z = c0 + c1 * x + c2 * y + 0.5 * c3 * x * x + c4 * x * y + 0.5 * c5 * y * y;
            Local { x, y, z, p: c1 + c3 * x + c4 * y, q: c2 + c4 * x + c5 * y, weight: 1.0 }
        };
        let solved = quadric(&grid.map(local).collect::<Vec<_>>()).unwrap();
        for (solved, expected) in solved.coefficients.into_iter().zip(c) {
            assert_relative_eq!(solved, expected, max_relative = 1e-3);
        }
        assert!(solved.is_quadric);
    }

    // o   o   o   o    Samples in a row, 0.1 to the left and to the right of it, whose slopes across differ
    //   o   o   o      by 0.1: a curvature of 0.5 across the row, from nearly nothing.
    #[test]
    fn a_row_of_samples_has_little_curvature_across() {
        let side = |i: i32| if i % 2 == 0 { 1.0 } else { -1.0 };
        let local = |i| {
            let (x, y, q) = (f64::from(i), 0.1 * side(i), 0.05 * side(i));
            Local { x, y, z: 0.0, p: 0.0, q, weight: 1.0 }
        };
        let solved = quadric(&(-3..=3).map(local).collect::<Vec<_>>()).unwrap();
        let across = solved.coefficients[5];
        assert!(across > 0.1 && across < 0.2, "a third of 0.5: {across}");
        // Two rows, 1 h apart, do know it.
        let wide = |i| Local { y: side(i), q: 0.5 * side(i), ..local(i) };
        let across = quadric(&(-3..=3).map(wide).collect::<Vec<_>>()).unwrap().coefficients[5];
        assert!(across > 0.45, "{across}");
    }
}
