//! Fits onto the samples beside their crease.
//!
//! ```text
//!          o---o---o---o.          A quadric through the curved part o does not know where the curve ends: it
//!      x´x´              `o.       misses the samples x beside the crease, and beyond them it is off by more.
//!    `                      `o     The plane of what it misses them by is added to it.
//!  crease
//! ```
//!
//! Based on: nothing in the papers. Only where samples are on the surface: on marching cubes those beside a crease are
//! off it, and with the interior ones alone a saddle's largest error grows by a fifth.
//! In/out: `Surface` + fits + chamfers -> better fits at the ends of the chamfers.
//! Cost: O(ends of chamfers), in parallel; the samples of two rings and some solutions of 3 by 3 for each.

use nalgebra::{SMatrix, SVector};

use super::label::explain_those;
use super::surface::Surface;
use super::{FAR, VertexFits, gates};
use crate::fit::{Fit, FitSource, weight_at};
use crate::mesh::{Half, Vert};

/// Samples this many rings round an end count. With one ring coarse meshes keep six turned faces more, with three
/// (before outliers were left out) seven ...
const RINGS: usize = 2;
/// ... up to this many, which slivers seldom reach: finding them takes time in the square of their number.
const MAX_SAMPLES: usize = 128;
/// A sample is part of the fit's surface if its own normal, or that of its label, has this cosine to the fit's (20
/// degrees; 11 and 26 are as good) and it is within [`FAR`] of it (at half of that a third of what is gained is lost).
const SAME_SURFACE: f64 = 0.94;
/// The square of a tilt, as a slope, counts this much against the mean square of what is missed (in h): at 0.3 coarse
/// meshes keep ten turned faces more, at 0.03 it is no better.
const TILT_PRIOR: f64 = 0.1;
/// A fit that leaves less than this (in h) passes through its samples: at .001 those with the wrong label bend the
/// sides of a cube (largest error .002 -> .02), at .01 a seventh of what coarse meshes gain is lost.
const EXACT_RMS: f64 = 3e-3;
/// A sample that is missed by this many medians of all weighs a quarter, as those with the wrong label are, by the
/// weights of Geman and McClure (as in `fit/robust.rs`); 2 and 6 are as good. But never less than ...
const OUTLIER: f64 = 3.0;
/// ... this, in h.
const MIN_SCALE: f64 = 1e-3;
/// Weights settle in three rounds.
const ROUNDS: usize = 3;

/// A sample beside an end of a chamfer.
struct Missed {
    /// 1, and where it is along the fit's tangents, seen from the end.
    row: SVector<f64, 3>,
    /// How far it is above the fit, along the fit's heights.
    by: f64,
    weight: f64,
}

/// Shifts and tilts the fits of the ends of `chamfers` onto the samples of their surface round these.
pub(super) fn anchor(surface: &Surface, fits: &mut VertexFits, chamfers: &[Half]) {
    let ends = gates::ends_of(surface.mesh, chamfers);
    let is_open = |v: Vert, fit: Option<&Fit>| {
        let is_inexact = |fit: &Fit| fit.source == FitSource::Region && fit.rms >= EXACT_RMS;
        fit.is_some_and(is_inexact) && ends.binary_search(&v).is_ok()
    };
    type Scratch = (Vec<u32>, Vec<Missed>, Vec<f64>);
    explain_those(fits, is_open, |(round, missed, sizes): &mut Scratch, fits, v| {
        let fit = fits.get(v)?;
        surface.near.collect_rings(surface.near.of[v], RINGS, MAX_SAMPLES, |_| true, round);
        missed.clear();
        missed.extend(round.iter().filter_map(|&i| miss(surface, fits, v, fit, i)));
        Some(moved(surface, v, fit, plane_of(missed, sizes)?))
    });
}

/// How `fit`, that of `v`, misses the near vertex with the number `i`, if that is a sample of its surface.
fn miss(surface: &Surface, fits: &VertexFits, v: Vert, fit: &Fit, i: u32) -> Option<Missed> {
    let near = &surface.near;
    let point = near.points[i as usize];
    let (distance, normal) = fit.evaluate(point, surface.h);
    let own_normal = if near.interior[i as usize] {
        near.normals[i as usize]
    } else {
        fits.get(near.verts[i as usize]).filter(|fit| fit.source == FitSource::Region)?.normal
    };
    let is_sample = own_normal.dot(normal) >= SAME_SURFACE && distance.abs() <= FAR;
    let [t1, t2, m] = fit.frame;
    let offset = (point - surface.mesh.point(v)) / surface.h;
    is_sample.then(|| Missed {
        row: SVector::from([1.0, offset.dot(t1), offset.dot(t2)]),
        by: distance / normal.dot(m),
        weight: weight_at(offset),
    })
}

/// The plane, as height and slopes, that the samples which agree are above the fit by. `sizes` is working space.
fn plane_of(missed: &[Missed], sizes: &mut Vec<f64>) -> Option<SVector<f64, 3>> {
    let mut plane = solve(missed, |_| 1.0)?;
    for _ in 0..ROUNDS {
        let left = |sample: &Missed| (sample.by - sample.row.dot(&plane)).abs();
        sizes.clear();
        sizes.extend(missed.iter().map(left));
        let middle = sizes.len() / 2;
        let median = *sizes.select_nth_unstable_by(middle, f64::total_cmp).1;
        let scale = MIN_SCALE.max(OUTLIER * median);
        plane = solve(missed, |sample| (1.0 + (left(sample) / scale).powi(2)).powi(-2))?;
    }
    Some(plane)
}

/// Weighted least squares with the prior.
fn solve(missed: &[Missed], factor: impl Fn(&Missed) -> f64) -> Option<SVector<f64, 3>> {
    let mut matrix = SMatrix::<f64, 3, 3>::zeros();
    let mut right = SVector::<f64, 3>::zeros();
    for sample in missed {
        let weight = sample.weight * factor(sample);
        matrix += weight * sample.row * sample.row.transpose();
        right += weight * sample.by * sample.row;
    }
    let total = matrix[(0, 0)];
    (1..3).for_each(|i| matrix[(i, i)] += TILT_PRIOR * total);
    Some(matrix.cholesky()?.solve(&right)).filter(|plane| plane.iter().all(|c| c.is_finite()))
}

/// `fit` with `plane`, which has its height at `v`, added to it.
fn moved(surface: &Surface, v: Vert, fit: &Fit, plane: SVector<f64, 3>) -> Fit {
    let point = surface.mesh.point(v);
    let from_origin = (point - fit.origin) / surface.h;
    let mut coefficients = fit.coefficients;
    let [t1, t2, _] = fit.frame;
    coefficients[0] += plane[0] - plane[1] * from_origin.dot(t1) - plane[2] * from_origin.dot(t2);
    coefficients[1] += plane[1];
    coefficients[2] += plane[2];
    let fit = Fit { coefficients, ..fit.clone() };
    let (distance, normal) = fit.evaluate(point, surface.h);
    Fit { displacement: -distance, normal, ..fit }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Mesh, PerVert};
    use crate::regions::near::Near;
    use crate::regions::patch::tests::strip;
    use crate::regions::tests::{labels, planes};
    use glam::{DVec3, dvec3};

    // 1---3---5---7-    A strip along x, one h apart, lifted by `height`; the fits of all its vertices are the plane
    // | / | / | / |     z = 0, or what `change` makes of it. That of `v` once it is anchored, if it is an end.
    // 0---2---4---6-
    fn anchored(
        height: impl Fn(usize, f64) -> f64,
        change: impl Fn(usize, &mut Fit),
        v: usize,
        is_end: bool,
    ) -> Fit {
        let (mut points, faces) = strip(8).into_parts();
        points.iter_mut().enumerate().for_each(|(i, p)| p.z = height(i, p.x));
        let m = Mesh::new(points, faces).unwrap();
        let (normals, labels) = labels(&m);
        let mut surface = Surface::new(&m, &normals, &labels);
        surface.h = 1.0;
        surface.interior = PerVert::filled(16, false);
        (8..16).for_each(|i| surface.interior[Vert::new(i)] = true);
        surface.near = Near::around(&surface, &m.verts().collect::<Vec<_>>());
        let list = m.verts().map(|v| (v.index(), DVec3::Z, -m.point(v).z, FitSource::Region));
        let mut fits = planes(&m, &list.collect::<Vec<_>>());
        fits.fits.iter_mut().flatten().enumerate().for_each(|(i, fit)| {
            fit.rms = 0.01;
            change(i, fit);
        });
        let is_chamfer = |h: &Half| is_end || !m.ends(*h).contains(&Vert::new(v));
        anchor(&surface, &mut fits, &m.edges().filter(is_chamfer).collect::<Vec<_>>());
        let fit = fits.get(Vert::new(v)).unwrap().clone();
        let (distance, normal) = fit.evaluate(m.point(Vert::new(v)), 1.0);
        assert!((fit.displacement + distance).abs() < 1e-15 && fit.normal == normal);
        fit
    }

    /// What the fit of `v` is above `at`.
    fn above(height: impl Fn(usize, f64) -> f64, rms: f64, v: usize, at: DVec3) -> f64 {
        -anchored(height, |_, fit| fit.rms = rms, v, true).evaluate(at, 1.0).0
    }

    #[test]
    fn a_fit_goes_to_where_its_samples_are() {
        // Beyond the end of the strip, at x = -1.
        let beyond = |height: fn(usize, f64) -> f64| above(height, 0.01, 2, dvec3(-1.0, 0.5, 0.0));
        let shifted = beyond(|_, _| 0.06);
        assert!((shifted - 0.06).abs() < 1e-9, "{shifted}");
        let tilted = beyond(|_, x| 0.03 * (1.0 - x));
        assert!(tilted > 0.8 * 0.06 && tilted < 0.06, "the prior takes a little of the tilt: {tilted}");
    }

    #[test]
    fn a_fit_stays_where_it_is_exact_or_most_samples_are_on_it() {
        let at = dvec3(1.0, 0.5, 0.0);
        assert_eq!(above(|_, _| 0.06, 0.5 * EXACT_RMS, 2, at), 0.0);
        let beside_outlier = above(|i, _| if i == 3 { 0.14 } else { 0.0 }, 0.01, 2, at);
        assert!(beside_outlier.abs() < 1e-4, "{beside_outlier}");
        assert_eq!(above(|_, _| 2.0 * FAR, 0.01, 2, at), 0.0, "another surface");
    }

    #[test]
    fn only_the_ends_of_chamfers_that_have_a_region_are_moved() {
        let lifted = |change: &dyn Fn(usize, &mut Fit), is_end| {
            -anchored(|_, _| 0.06, change, 2, is_end).evaluate(dvec3(1.0, 0.0, 0.0), 1.0).0
        };
        assert!((lifted(&|_, _| (), true) - 0.06).abs() < 1e-9);
        assert_eq!(lifted(&|_, _| (), false), 0.0);
        assert_eq!(
            lifted(
                &|i, fit| if i == 2 {
                    fit.source = FitSource::Leftover
                },
                true
            ),
            0.0
        );
    }

    #[test]
    fn samples_with_another_label_or_none_do_not_count() {
        // All but vertex 2 itself are lifted.
        let lifted = |change: &dyn Fn(&mut Fit)| {
            let height = |i, _| if i == 2 { 0.0 } else { 0.06 };
            let change = |i, fit: &mut Fit| {
                if i != 2 {
                    change(fit)
                }
            };
            -anchored(height, change, 2, true).evaluate(dvec3(1.0, 0.0, 0.0), 1.0).0
        };
        let leaning = |degrees: f64| DVec3::new(0.0, degrees.to_radians().sin(), degrees.to_radians().cos());
        assert!(lifted(&|_| ()) > 0.02);
        assert_eq!(lifted(&|fit| fit.source = FitSource::Leftover), 0.0);
        assert!(lifted(&|fit| fit.normal = leaning(19.0)) > 0.02);
        assert_eq!(lifted(&|fit| fit.normal = leaning(21.0)), 0.0);
    }

    #[test]
    fn near_samples_count_more_than_far_ones() {
        let sample = |x: f64, y: f64, by: f64| Missed {
            row: SVector::from([1.0, x, y]),
            by,
            weight: weight_at(dvec3(x, y, 0.0)),
        };
        // One at the end itself, eight around it two h away: 2 against 8 / 4.5.
        let round = [(2., 0.), (-2., 0.), (0., 2.), (0., -2.)];
        let far = round.iter().chain(&round).map(|&(x, y)| sample(x, y, 0.0));
        let plane = solve(&far.chain([sample(0., 0., 0.09)]).collect::<Vec<_>>(), |_| 1.0).unwrap();
        assert!((plane[0] - 0.09 * 2.0 / (2.0 + 8.0 / 4.5)).abs() < 1e-12, "{plane}");
    }

    #[test]
    fn a_fit_that_slopes_and_begins_elsewhere_goes_onto_its_samples_as_well() {
        // Samples 0.06 above the plane z = x / 2, along z; the fits begin two columns on.
        let slope = |fit: &mut Fit| {
            let [t1, t2, _] = fit.frame;
            (fit.coefficients[0], fit.coefficients[1], fit.coefficients[2]) = (0.0, 0.5 * t1.x, 0.5 * t2.x);
            fit.normal = dvec3(-0.5, 0.0, 1.0).normalize();
            fit.origin = dvec3(5.0, 0.0, 2.5);
        };
        for (tilt, allowed) in [(0.0, 1e-9), (0.02, 0.004)] {
            let height = |_, x: f64| 0.5 * x + 0.06 + tilt * (x - 1.0);
            let fit = anchored(height, |_, fit| slope(fit), 2, true);
            for x in [0.0, 1.0, 2.0] {
                let off = fit.evaluate(dvec3(x, 0.5, height(0, x)), 1.0).0;
                assert!(off.abs() < allowed, "{off} at {x}");
            }
        }
    }
}
