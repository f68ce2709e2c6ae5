//! Fits that a few outliers do not tilt.
//!
//! ```text
//!   -o--o--o--o--o--o---           o  samples that agree: half of the weight has small residuals
//!                        ` o       Geman-McClure: a residual e weighs 1 / (1 + (e / scale)²)²
//! ```
//!
//! Based on: iteratively reweighted least squares with the weights of Geman and McClure (1987).
//! Differs: only where the residuals have heavy tails, so that noise and curvature change nothing.
//! In/out: least squares -> least squares of the samples that agree.
//! Cost: O(samples) for the test; some four solutions where it says so.

use super::solve::{self, Local, Solution};

/// Outliers are looked for among this many samples ...
const MIN_SAMPLES: usize = 8;
/// ... that leave more than this residual, in h.
const GOOD_RMS: f64 = 0.002;
/// Tails are heavy when the median of the residuals is at most this share of their root mean square; that of
/// noise is near it, two thirds for one component and nine tenths for three.
const HEAVY_TAILED: f64 = 0.5;
/// A residual of this many medians weighs a quarter ...
const SCALE: f64 = 2.0;
/// ... or of this, in h, if that is more: samples that agree better than that are as good as exact.
const MIN_SCALE: f64 = 1e-3;
/// The weights settle in three rounds.
const ROUNDS: usize = 3;

/// What a fit leaves of a sample, squared, and the weight of the sample in the first solution.
#[derive(Clone, Copy, Debug)]
struct Residual {
    square: f64,
    weight: f64,
}

/// Working space.
#[derive(Debug, Default)]
pub(super) struct Residuals {
    /// In the order of the samples.
    all: Vec<Residual>,
    /// In the order in which the median is found.
    sorted: Vec<Residual>,
}

/// Solves again with less weight for the samples that most of the weight contradicts, if there are any.
/// `samples` then have these weights.
pub(super) fn without_outliers(
    mut solution: Solution,
    samples: &mut [Local],
    Residuals { all, sorted }: &mut Residuals,
) -> Solution {
    if samples.len() < MIN_SAMPLES || solution.rms <= GOOD_RMS {
        return solution;
    }
    all.clear();
    all.extend(samples.iter().map(|sample| Residual { square: 0.0, weight: sample.weight }));
    for round in 0..ROUNDS {
        for (residual, sample) in all.iter_mut().zip(samples.iter()) {
            residual.square = sample.squared_residual(&solution.coefficients);
        }
        if round == 0 && !is_heavy_tailed(all, solution.rms) {
            break;
        }
        sorted.clone_from(all);
        let squared_scale = (SCALE * SCALE * weighted_median(sorted)).max(MIN_SCALE * MIN_SCALE);
        for (residual, sample) in all.iter().zip(samples.iter_mut()) {
            sample.weight = residual.weight / (1.0 + residual.square / squared_scale).powi(2);
        }
        let again = if solution.is_quadric { solve::quadric(samples) } else { solve::plane(samples) };
        let Some(again) = again else { break };
        solution = again;
    }
    solution
}

/// Whether half of the weight has residuals that are small against the root mean square `rms` of all.
fn is_heavy_tailed(residuals: &[Residual], rms: f64) -> bool {
    let small = (HEAVY_TAILED * rms).powi(2);
    let (mut below, mut total) = (0.0, 0.0);
    for residual in residuals {
        total += residual.weight;
        below += if residual.square <= small { residual.weight } else { 0.0 };
    }
    below >= 0.5 * total
}

/// The least square up to which there is half of the weight; reorders the residuals, of which there is at
/// least one.
fn weighted_median(mut residuals: &mut [Residual]) -> f64 {
    let weight = |residuals: &[Residual]| residuals.iter().map(|residual| residual.weight).sum::<f64>();
    let mut wanted = 0.5 * weight(residuals);
    loop {
        let middle = residuals.len() / 2;
        let (lower, &mut at, upper) =
            residuals.select_nth_unstable_by(middle, |a, b| a.square.total_cmp(&b.square));
        let below = weight(lower);
        if below >= wanted && !lower.is_empty() {
            residuals = lower;
        } else if below + at.weight >= wanted || upper.is_empty() {
            return at.square;
        } else {
            wanted -= below + at.weight;
            residuals = upper;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    /// A grid of n x n level samples of weight 1, lifted by `height`.
    fn grid(n: i32, height: impl Fn(i32, i32) -> f64) -> Vec<Local> {
        let places = (0..n).flat_map(|i| (0..n).map(move |j| (i, j)));
        let sample = |(i, j)| {
            let (x, y) = (f64::from(i - n / 2), f64::from(j - n / 2));
            Local { x, y, z: height(i, j), p: 0.0, q: 0.0, weight: 1.0 }
        };
        places.map(sample).collect()
    }

    #[test]
    fn an_outlier_does_not_tilt_a_plane() {
        let lifted = |i, j| if (i, j) == (4, 2) { 0.3 } else { 0.0 };
        let mut samples = grid(5, lifted);
        let least_squares = solve::plane(&samples).unwrap();
        assert!(least_squares.coefficients[1] > 0.01, "{least_squares:?}");
        let robust = without_outliers(least_squares, &mut samples, &mut Residuals::default());
        // The outlier keeps a weight of (scale / 0.3)⁴, some 1e-9.
        for c in robust.coefficients {
            assert_relative_eq!(c, 0.0, epsilon = 1e-8);
        }
        assert!(robust.rms < 1e-4 && !robust.is_quadric, "{robust:?}");
    }

    #[test]
    fn a_quadric_stays_one() {
        // A cylinder, and a row of samples beside it that belong to something else.
        let bent = |i: i32, j| if j == 4 { 0.5 } else { 0.1 * f64::from(i - 2).powi(2) };
        let mut samples = grid(5, bent);
        for sample in &mut samples {
            sample.p = 0.2 * sample.x;
        }
        let least_squares = solve::quadric(&samples).unwrap();
        let robust = without_outliers(least_squares, &mut samples, &mut Residuals::default());
        assert!(robust.is_quadric && robust.rms < 0.5 * least_squares.rms, "{least_squares:?} {robust:?}");
    }

    #[test]
    fn noise_is_not_taken_for_outliers() {
        let noisy = grid(5, |i, j| 0.1 * f64::from((i + j) % 2));
        let least_squares = solve::plane(&noisy).unwrap();
        let mut samples = noisy.clone();
        let same = without_outliers(least_squares, &mut samples, &mut Residuals::default());
        assert_eq!(same.coefficients, least_squares.coefficients);
        assert!(samples.iter().all(|sample| sample.weight == 1.0));
        // Seven samples are too few to tell.
        let mut few = grid(5, |i, j| if (i, j) == (1, 1) { 0.3 } else { 0.0 });
        few.truncate(7);
        let least_squares = solve::plane(&few).unwrap();
        let same = without_outliers(least_squares, &mut few, &mut Residuals::default());
        assert_eq!(same.coefficients, least_squares.coefficients);
    }

    #[test]
    fn the_weighted_median_has_half_of_the_weight_at_or_below_it() {
        let median = |list: &[(f64, f64)]| {
            let residual = |&(square, weight): &(f64, f64)| Residual { square, weight };
            weighted_median(&mut list.iter().map(residual).collect::<Vec<_>>())
        };
        assert_eq!(median(&[(7.0, 1.0)]), 7.0);
        assert_eq!(median(&[(3.0, 1.0), (1.0, 1.0), (2.0, 1.0)]), 2.0);
        assert_eq!(median(&[(3.0, 1.0), (1.0, 1.0), (2.0, 1.0), (4.0, 1.0)]), 2.0);
        assert_eq!(median(&[(3.0, 5.0), (1.0, 1.0), (2.0, 1.0)]), 3.0);
        assert_eq!(median(&[(3.0, 1.0), (1.0, 5.0), (2.0, 1.0)]), 1.0);
        let many: Vec<_> = (0..101).map(|i| (f64::from(i * 37 % 101), 1.0)).collect();
        assert_eq!(median(&many), 50.0);
    }
}
