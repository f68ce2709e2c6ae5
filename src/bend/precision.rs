//! How finely the coordinates of a mesh are known.
//!
//! ```text
//!   o--o--o--o--o--o     a plane whose coordinates were rounded is not flat: what its normals promise is
//!    `--´`---´  `-´      rounding, and nothing that a new vertex should follow
//! ```
//!
//! Based on: nothing in the papers.
//! In/out: points `[V]` -> the step of their coordinates, in their own unit.
//! Cost: O(V), parallel.

use glam::DVec3;
use rayon::prelude::*;

/// More decimals than this, and the step is below what single precision has for a part of size 1.
const MOST_DECIMALS: usize = 9;
/// Powers of ten that a double holds exactly.
const POWERS: [f64; MOST_DECIMALS + 1] = [1.0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9];
/// A multiple of a step is one to within this share of it: a double nearest to one is far nearer, up to
/// [`LARGEST`], and any other passes with this chance only.
const OFF_STEP: f64 = 1e-4;
/// Beyond this many steps a double tells them no longer apart well enough.
const LARGEST: f64 = 1e11;
/// So many points are looked at at a time.
const CHUNK: usize = 1 << 13;

/// The step that all coordinates are multiples of: of a number of decimals, as text files have, or of single
/// precision at the largest coordinate, as binary ones do. The smaller where both hold, 0 where neither does.
#[must_use]
pub fn precision(points: &[DVec3]) -> f64 {
    let steps = points.par_chunks(CHUNK).map(Steps::of);
    let Steps { decimals, is_single, largest } = steps.reduce(Steps::default, Steps::and);
    let decimal = POWERS.get(decimals).map(|power| power.recip());
    let single = is_single.then(|| f64::from(f32::EPSILON) * largest);
    decimal.into_iter().chain(single).reduce(f64::min).unwrap_or(0.0)
}

/// What coordinates have in common.
struct Steps {
    /// The least number of decimals that holds them, more than [`MOST_DECIMALS`] if none does.
    decimals: usize,
    /// Whether single precision holds them.
    is_single: bool,
    /// The largest magnitude.
    largest: f64,
}

impl Default for Steps {
    fn default() -> Self {
        Self { decimals: 0, is_single: true, largest: 0.0 }
    }
}

impl Steps {
    fn of(points: &[DVec3]) -> Self {
        let mut steps = Self::default();
        for x in points.iter().flat_map(DVec3::to_array) {
            while POWERS.get(steps.decimals).is_some_and(|power| !is_whole(x * power)) {
                steps.decimals += 1;
            }
            steps.is_single &= f64::from(x as f32) == x;
            steps.largest = steps.largest.max(x.abs());
        }
        steps
    }

    fn and(self, other: Self) -> Self {
        Self {
            decimals: self.decimals.max(other.decimals),
            is_single: self.is_single && other.is_single,
            largest: self.largest.max(other.largest),
        }
    }
}

fn is_whole(x: f64) -> bool {
    x.abs() < LARGEST && (x - x.round()).abs() < OFF_STEP
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;

    /// More points than one chunk, none of whose coordinates is special.
    fn points() -> Vec<DVec3> {
        let coordinate = |i: usize| (i as f64 * 0.618_033_988_749_895).fract() * 8.0 - 3.0;
        (0..3 * CHUNK)
            .map(|i| dvec3(coordinate(3 * i), coordinate(3 * i + 1), coordinate(3 * i + 2)))
            .collect()
    }

    fn rounded(round: impl Fn(f64) -> f64) -> f64 {
        precision(&points().into_iter().map(|p| DVec3::from(p.to_array().map(&round))).collect::<Vec<_>>())
    }

    #[test]
    fn decimals_are_counted_as_a_file_has_them() {
        let parsed = |decimals| rounded(|x| format!("{x:.decimals$}").parse().unwrap());
        assert_eq!([1, 6, 9].map(parsed), [0.1, 1e-6, 1e-9]);
        assert_eq!(parsed(12), 0.0, "as good as exact");
        // One that has more decimals than the others counts.
        let mut few: Vec<DVec3> = points().iter().map(|p| (p * 16.0).round() / 16.0).collect();
        few[2 * CHUNK].z = 0.123_45;
        assert_eq!(precision(&few), 1e-5);
    }

    #[test]
    fn single_precision_has_the_step_of_its_largest_coordinate() {
        let largest = points().iter().map(|p| p.abs().max_element()).fold(0.0, f64::max);
        let step = rounded(|x| f64::from(x as f32));
        assert!((step / (largest * f64::from(f32::EPSILON)) - 1.0).abs() < 1e-6, "{step}");
        // Whole numbers were not rounded to whole ones: the finer step is meant.
        assert!(rounded(f64::round) < 1e-6);
        // The largest may be negative, and one that is not single is enough wherever it is.
        assert_eq!(rounded(|x| f64::from(-x as f32)), step);
        let mut mixed: Vec<DVec3> = points().iter().map(|p| p.as_vec3().as_dvec3()).collect();
        mixed[0].x = 0.1;
        assert_eq!(precision(&mixed), 0.0);
    }

    #[test]
    fn exact_coordinates_have_no_step_and_bad_ones_neither() {
        assert_eq!(rounded(|x| x), 0.0);
        assert_eq!(precision(&[]), 0.0);
        assert_eq!(precision(&[dvec3(0.1, f64::NAN, 0.0)]), 0.0);
        assert_eq!(precision(&[dvec3(0.1, f64::INFINITY, 0.0)]), 0.0);
    }
}
