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
//! Based on: nothing in the papers, which take the mean of the red normals. Step 4 of [`regions`](crate::regions).
//! Differs: nothing.
//! In/out: `Sample`s round an origin -> `Fit`.
//! Cost: O(samples), no allocation; the sums of the normal equations are moments, 12 for a plane and 28
//! for a quadric, so that a sample costs some 50 operations, and four times that where outliers are found.

mod robust;
mod solve;

use glam::DVec3;

use robust::Residuals;
use solve::{Local, Solution};

/// Samples at the origin weigh `1 / SOFTENING`, those at distance r (in h) `1 / (SOFTENING + r²)`: the
/// weight falls by half at 0.7 h, so that no single near sample rules. Where fits are anchored, coarse meshes keep three
/// turned faces more at 1.5.
const SOFTENING: f64 = 0.5;
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
    /// From the vertex to the nearest sample of the region, in mean edge lengths; 0 for the vertex's own.
    pub distance: f64,
    /// How the vertex came by it.
    pub source: FitSource,
}

impl Fit {
    /// Whether it is a plane.
    #[must_use]
    pub fn is_plane(&self) -> bool {
        self.coefficients[3..] == [0.0; 3]
    }

    /// A plane through `origin` with unit `normal`.
    #[must_use]
    pub fn plane(origin: DVec3, normal: DVec3, source: FitSource) -> Self {
        let frame = frame(normal);
        let (coefficients, n_members) = ([0.0; 6], 0);
        let (rms, displacement, distance) = (0.0, 0.0, 0.0);
        Self { origin, frame, coefficients, rms, n_members, displacement, normal, distance, source }
    }

    /// The same height field as a fit of a vertex at `p`. `h` as in [`Fit::evaluate`].
    pub(crate) fn seen_from(&self, p: DVec3, h: f64) -> Self {
        let (height, [slope_x, slope_y]) = self.height_and_slopes(p, h);
        let [.., c3, c4, c5] = self.coefficients;
        let coefficients = [-height, slope_x, slope_y, c3, c4, c5];
        let (distance, normal) = self.evaluate(p, h);
        Self { origin: p, coefficients, displacement: -distance, normal, ..self.clone() }
    }

    /// How high `p` is above the height field, and the slopes of that below `p`.
    #[inline]
    fn height_and_slopes(&self, p: DVec3, h: f64) -> (f64, [f64; 2]) {
        let [t1, t2, m] = self.frame;
        let [c0, c1, c2, c3, c4, c5] = self.coefficients;
        let offset = (p - self.origin) / h;
        let (x, y, z) = (offset.dot(t1), offset.dot(t2), offset.dot(m));
        let height = c0 + c1 * x + c2 * y + 0.5 * c3 * x * x + c4 * x * y + 0.5 * c5 * y * y;
        (z - height, [c1 + c3 * x + c4 * y, c2 + c4 * x + c5 * y])
    }

    /// The signed distance of `p` from the fit in units of `h`, the mean edge length that the fit was
    /// made with, to first order (height over the length of the gradient); and the unit normal of the
    /// fit below `p`.
    #[inline]
    #[must_use]
    pub fn evaluate(&self, p: DVec3, h: f64) -> (f64, DVec3) {
        let [t1, t2, m] = self.frame;
        let (height, [slope_x, slope_y]) = self.height_and_slopes(p, h);
        let steepness = (1.0 + slope_x * slope_x + slope_y * slope_y).sqrt();
        (height / steepness, (m - slope_x * t1 - slope_y * t2) / steepness)
    }
}

/// Two tangents and `m`, orthonormal and right-handed.
fn frame(m: DVec3) -> [DVec3; 3] {
    let aside = if m.x.abs() < 0.6 { DVec3::X } else { DVec3::Y };
    let t1 = m.cross(aside).normalize();
    [t1, m.cross(t1), m]
}

/// A vertex of a smooth region, as a fit sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// From the fit's origin to the vertex, in mean edge lengths.
    pub offset: DVec3,
    /// Unit normal at the vertex.
    pub normal: DVec3,
    /// What it counts: the nearer it is the more.
    weight: f64,
}

impl Sample {
    /// `trust` says how far it is trusted: 1 deep inside a region, less near its border.
    #[inline]
    #[must_use]
    pub fn new(offset: DVec3, normal: DVec3, trust: f64) -> Self {
        Self { offset, normal, weight: trust / (SOFTENING + offset.length_squared()) }
    }
}

/// What a sample weighs that is fully trusted. `offset` is where it is from the fit's origin, in mean edge lengths.
#[inline]
pub(crate) fn weight_at(offset: DVec3) -> f64 {
    Sample::new(offset, DVec3::ZERO, 1.0).weight
}

/// The samples that a fitter has taken.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Taken {
    frame: [DVec3; 3],
    plane: Option<Solution>,
}

/// Makes fits one after the other in the same memory.
#[derive(Debug, Default)]
pub struct Fitter {
    samples: Vec<Local>,
    residuals: Residuals,
}

impl Fitter {
    /// Fits a height field over the mean normal of `samples` round `origin`: a plane unless a quadric is
    /// clearly better, and without the samples that most of the others contradict. None when no sample has
    /// a usable normal or the solution is not finite.
    #[must_use]
    pub fn fit(&mut self, origin: DVec3, samples: &[Sample], source: FitSource) -> Option<Fit> {
        let taken = self.take(samples)?;
        self.fit_to_taken(taken, origin, source)
    }

    /// [`fit`](Self::fit) to the samples that were taken last.
    pub(crate) fn fit_to_taken(&mut self, taken: Taken, origin: DVec3, source: FitSource) -> Option<Fit> {
        let solution = self.solve(taken.plane?)?;
        let n_members = self.samples.len();
        let solution = robust::without_outliers(solution, &mut self.samples, &mut self.residuals);
        fit_of(solution, origin, taken.frame, n_members, source)
    }

    /// Fits a plane to all samples that were taken last that leaves no more than `max_rms` (in h) of them, if there is
    /// one: of their places and normals, or else of their places alone. Beside samples that are off the surface normals
    /// lean, though their own places are exact.
    pub(crate) fn exact_plane(
        &self,
        taken: Taken,
        origin: DVec3,
        source: FitSource,
        max_rms: f64,
    ) -> Option<Fit> {
        let is_exact = |plane: &Solution| plane.rms <= max_rms;
        let plane = taken.plane.filter(is_exact);
        let plane = plane.or_else(|| solve::plane_through(&self.samples).filter(is_exact))?;
        fit_of(plane, origin, taken.frame, self.samples.len(), source)
    }

    /// Takes `samples` over their mean normal, if they have one.
    pub(crate) fn take(&mut self, samples: &[Sample]) -> Option<Taken> {
        let mean: DVec3 = samples.iter().map(|sample| sample.weight * sample.normal).sum();
        let frame = frame(mean.try_normalize()?);
        self.samples.clear();
        self.samples.reserve(samples.len());
        let local = samples.iter().filter_map(|sample| Local::of(sample, &frame));
        local.for_each(|local| self.samples.push(local));
        Some(Taken { frame, plane: solve::plane(&self.samples) })
    }

    /// The plane of the samples, or a quadric that is clearly better.
    fn solve(&self, plane: Solution) -> Option<Solution> {
        if self.samples.len() < QUADRIC_SAMPLES || plane.rms <= FLAT_RMS {
            return Some(plane);
        }
        let quadric = solve::quadric(&self.samples);
        quadric.filter(|quadric| quadric.rms < QUADRIC_GAIN * plane.rms).or(Some(plane))
    }
}

/// The fit that `solution` is, over `frame` round `origin`, if it is finite.
fn fit_of(
    solution: Solution,
    origin: DVec3,
    frame: [DVec3; 3],
    n_members: usize,
    source: FitSource,
) -> Option<Fit> {
    let Solution { coefficients, rms, .. } = solution;
    let [c0, c1, c2, ..] = coefficients;
    let steepness = (1.0 + c1 * c1 + c2 * c2).sqrt();
    let displacement = c0 / steepness;
    let normal = (frame[2] - c1 * frame[0] - c2 * frame[1]) / steepness;
    let is_sound = rms.is_finite() && displacement.is_finite() && normal.is_finite();
    let plane = Fit::plane(origin, normal, source);
    is_sound.then_some(Fit { frame, coefficients, rms, n_members, displacement, ..plane })
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
            Sample::new(turn * dvec3(x, y, z), turn * normal, 1.0)
        })
        .collect()
    }

    fn turn() -> glam::DQuat {
        glam::DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -1.1, 2.0)
    }

    #[test]
    fn a_plane_is_reproduced_exactly() {
        let (a, b, c) = (0.3, 0.2, -0.5);
        let plane = samples(turn(), |x, y| (a + b * x + c * y, b, c));
        let fit = Fitter::default().fit(dvec3(7., 8., 9.), &plane, FitSource::Region).unwrap();
        let normal = turn() * dvec3(-b, -c, 1.0).normalize();
        assert_eq!((fit.n_members, fit.coefficients[3..].to_vec()), (25, vec![0.0; 3]));
        assert_relative_eq!(fit.normal.distance(normal), 0.0, epsilon = 1e-8);
        assert_relative_eq!(fit.displacement, a / (1.0 + b * b + c * c).sqrt(), max_relative = 1e-7);
        assert!(fit.rms < 1e-5, "{}", fit.rms);
        // Three mean edges of length 2 beyond the plane, wherever along it.
        let on_plane = dvec3(7., 8., 9.) + 2.0 * (turn() * dvec3(5., 1., a + 5. * b + c));
        let (distance, at) = fit.evaluate(on_plane + 6.0 * normal, 2.0);
        assert_relative_eq!(distance, 3.0, epsilon = 1e-6);
        assert_relative_eq!(at.distance(normal), 0.0, epsilon = 1e-8);
    }

    #[test]
    fn a_plane_is_that_of_the_places_where_normals_lean() {
        // Three of five normals lean by 10 degrees.
        let (a, b, c) = (0.3, 0.2, -0.5);
        let leaning = samples(turn(), |x, y| (a + b * x + c * y, if x > -0.1 { b + 0.18 } else { b }, c));
        let origin = dvec3(7., 8., 9.);
        let plain = Fitter::default().fit(origin, &leaning, FitSource::Region).unwrap();
        assert!(plain.rms > 0.01, "{}", plain.rms);
        let exact = |samples: &[Sample]| {
            let mut fitter = Fitter::default();
            let taken = fitter.take(samples).unwrap();
            fitter.exact_plane(taken, origin, FitSource::Region, 1e-3)
        };
        let fit = exact(&leaning).unwrap();
        assert!(fit.is_plane() && fit.rms < 1e-5 && fit.n_members == 25);
        assert_relative_eq!(
            fit.normal.distance(turn() * dvec3(-b, -c, 1.0).normalize()),
            0.0,
            epsilon = 1e-5
        );
        assert_relative_eq!(fit.displacement, a / (1.0 + b * b + c * c).sqrt(), max_relative = 1e-4);
        // Places off by .003 are not exact, and a row spans no plane, whatever its normals say.
        let rough =
            samples(turn(), |x, y| (a + 0.003 * (9.0 * x * y).sin(), if x > 1.0 { 0.18 } else { 0.0 }, 0.0));
        assert!(exact(&rough).is_none());
        let row = |leaning: &[Sample]| leaning.iter().step_by(5).copied().collect::<Vec<_>>();
        assert!(exact(&row(&leaning)).is_none());
        let upright = samples(turn(), |x, y| (a + b * x + c * y, b, c));
        assert!(exact(&row(&upright)).is_some(), "all of it agrees");
    }

    #[test]
    fn a_quadric_over_its_mean_normal_is_reproduced() {
        // Symmetric in x and in y, so that the mean normal is z. The prior takes 2 % of the curvature.
        let (a, b, c) = (-0.2, 0.2, -0.1);
        let quadric = |x: f64, y: f64| (a + b * x * x + c * y * y, 2. * b * x, 2. * c * y);
        let fit = Fitter::default().fit(DVec3::ZERO, &samples(turn(), quadric), FitSource::Region).unwrap();
        assert!(fit.rms < 0.01, "{}", fit.rms);
        assert_relative_eq!(fit.displacement, a, epsilon = 0.005);
        let (x, y) = (0.8, -0.6);
        let (z, slope_x, slope_y) = quadric(x, y);
        let (distance, normal) = fit.evaluate(turn() * dvec3(x, y, z), 1.0);
        assert_relative_eq!(distance, 0.0, epsilon = 0.005);
        let expected = turn() * dvec3(-slope_x, -slope_y, 1.0).normalize();
        assert_relative_eq!(normal.distance(expected), 0.0, epsilon = 0.02);
    }

    #[test]
    fn a_fit_does_not_depend_on_how_the_mesh_is_turned() {
        let twisted =
            |x: f64, y: f64| (0.2 * x * x + 0.3 * x * y, 0.4 * x + 0.3 * y + 0.01 * (9.0 * y).sin(), 0.3 * x);
        let fit =
            |turn| Fitter::default().fit(DVec3::ZERO, &samples(turn, twisted), FitSource::Region).unwrap();
        let at = |turn: glam::DQuat| {
            let (distance, normal) = fit(turn).evaluate(turn * dvec3(0.9, 0.7, 0.2), 1.0);
            (distance, turn.inverse() * normal)
        };
        let plain = at(glam::DQuat::IDENTITY);
        assert!(fit(turn()).coefficients[4].abs() > 0.1, "it has a twist");
        for turn in [turn(), glam::DQuat::from_rotation_z(0.5), glam::DQuat::from_rotation_z(-2.0)] {
            let turned = at(turn);
            assert_relative_eq!(turned.0, plain.0, epsilon = 1e-12);
            assert_relative_eq!(turned.1.distance(plain.1), 0.0, epsilon = 1e-12);
        }
    }

    #[test]
    fn a_fit_is_the_same_seen_from_elsewhere() {
        let quadric = |x: f64, y: f64| (0.1 * x * x + 0.2 * x * y, 0.2 * x + 0.2 * y, 0.2 * x);
        let fit =
            Fitter::default().fit(dvec3(1., 2., 3.), &samples(turn(), quadric), FitSource::Region).unwrap();
        let (h, from) = (2.0, dvec3(1.5, 2.5, 2.0));
        let moved = fit.seen_from(from, h);
        assert_eq!((moved.origin, moved.rms, moved.n_members), (from, fit.rms, fit.n_members));
        for p in [from, dvec3(0., 2., 4.), dvec3(2., 1., 3.)] {
            let ((distance, normal), (same, as_before)) = (moved.evaluate(p, h), fit.evaluate(p, h));
            assert_relative_eq!(distance, same, epsilon = 1e-12);
            assert_relative_eq!(normal.distance(as_before), 0.0, epsilon = 1e-12);
        }
        assert_eq!((-moved.displacement, moved.normal), fit.evaluate(from, h));
    }

    #[test]
    fn noise_does_not_bend_a_plane() {
        let mut sign = 1.0;
        let mut noisy = samples(turn(), |_, _| (0.0, 0.0, 0.0));
        for sample in &mut noisy {
            sign = -sign;
            sample.offset += 0.1 * sign * (turn() * DVec3::Z);
        }
        let fit = Fitter::default().fit(DVec3::ZERO, &noisy, FitSource::Region).unwrap();
        assert_eq!(fit.coefficients[3..], [0.0; 3]);
        assert_relative_eq!(fit.rms, 0.1, epsilon = 0.01);
    }

    #[test]
    fn steep_samples_are_left_out_and_opposite_ones_make_no_fit() {
        let mut plane = samples(turn(), |_, _| (0.0, 0.0, 0.0));
        plane.push(Sample::new(turn() * DVec3::X, turn() * DVec3::X, 1.0));
        let fit = Fitter::default().fit(DVec3::ZERO, &plane, FitSource::Region).unwrap();
        assert_eq!(fit.n_members, 25);
        let facing = |normal| Sample::new(DVec3::ZERO, normal, 1.0);
        let opposite = vec![facing(DVec3::Z), facing(-DVec3::Z)];
        assert!(Fitter::default().fit(DVec3::ZERO, &opposite, FitSource::Region).is_none());
    }

    #[test]
    fn one_sample_makes_the_plane_of_its_normal() {
        let normal = dvec3(1., 2., 3.).normalize();
        let one = vec![Sample::new(0.5 * normal, normal, 0.1)];
        let fit = Fitter::default().fit(DVec3::ZERO, &one, FitSource::Leftover).unwrap();
        assert_relative_eq!(fit.displacement, 0.5, epsilon = 1e-8);
        assert_relative_eq!(fit.normal.distance(normal), 0.0, epsilon = 1e-12);
    }
}
