//! Fits of faces too narrow for a region, by the places of their samples alone (step 6).
//!
//! ```text
//!   N---N---N---N      N, M  samples of the regions on both sides of a narrow face
//!   | / | / | / |
//!   x---x---x---x      x     its only samples: every face beside them leans towards N or M, and so do their normals,
//!   | / | / | / |            but their places are those of the face
//!   M---M---M---M
//! ```
//!
//! A sample next to a region may be one of that: then it lies on the inner side of the face, below it where they make a
//! ridge and above it where a valley. What lies on the other side counts in full, however near the region is.
//!
//! Based on: nothing in the papers. Ends of fillets that bend more than their samples can tell have such samples too.
//! Differs: only where samples are on the surface and without noise; on marching cubes those beside a crease are not.
//! In/out: `Surface` + fits -> fits of vertices that have none but the papers' plane.
//! Cost: the samples within reach and four solutions of 6 by 6 for each of these, in parallel.

use glam::DVec3;
use nalgebra::{SMatrix, SVector};

use super::VertexFits;
use super::label::explain_those;
use super::surface::Surface;
use crate::fit::{Fit, FitSource, weight_at};
use crate::mesh::Vert;

/// Samples are taken from within this distance, in h: at 2.5 a quarter of what a coarse remeshed fandisk gains is lost,
/// at 4 half of what one by marching intersections does.
const REACH: f64 = 3.0;
/// That far are this many rings, ...
const RINGS: usize = 4;
/// ... up to so many vertices, which slivers seldom reach: finding them takes time in the square of their number.
const MAX_NEAR: usize = 128;
/// A face has this many samples ...
const MIN_SAMPLES: usize = 4;
/// ... and is not narrow if it has more than this: rounds, whose places fit a quadric badly, have 18 and more.
const MAX_SAMPLES: usize = 12;
/// A fit of a region that leaves less than this (in h) is one: its own vertices are no samples of a narrow face. At .01
/// two coarse meshes get a tenth more error, at .05 nothing changes.
const REGION_RMS: f64 = 0.03;
/// A sample counts by the square of how far it is from the regions next to it, in h; from here on in full. At .3 and
/// less a coarse fandisk loses half of its gain: beside a crease samples may be those of either side.
const SURE_DISTANCE: f64 = 0.6;
/// What counts in full settles in so many rounds.
const ROUNDS: usize = 4;
/// The squares of a slope against the vertex's own normal, and of a curvature (1 / h), count this much against the mean
/// square of what is missed (in h). Samples in a row tell neither across the row. Five times as much of the first and a
/// quarter of the second lose a sixth of what a coarse fandisk gains.
const SLOPE_PRIOR: f64 = 0.01;
const CURVATURE_PRIOR: f64 = 0.02;
/// The fit leaves no more than this (in h), as other guesses do. Then it is near its vertex, too, which weighs most.
const MAX_RMS: f64 = 0.05;

/// A sample as the fit sees it.
struct Place {
    /// What the coefficients of the height field are multiplied by.
    row: SVector<f64, 6>,
    height: f64,
    weight: f64,
    /// How much it counts on the inner side, which is below the face if `inner` is -1 and above it if 1 (0 if no region is
    /// next to it).
    trust: f64,
    inner: f64,
}

impl Place {
    /// How far it is above the height field.
    fn missed_by(&self, coefficients: &SVector<f64, 6>) -> f64 {
        self.height - self.row.dot(coefficients)
    }

    fn weight(&self, coefficients: &SVector<f64, 6>) -> f64 {
        let is_inside = self.missed_by(coefficients) * self.inner > 0.0;
        self.weight * if is_inside { self.trust } else { 1.0 }
    }
}

/// Gives the vertices without a fit, or with the papers' plane, that of the places round them which no region explains.
pub(super) fn explain_by_places(surface: &Surface, fits: &mut VertexFits) {
    let is_open = |v: Vert, fit: Option<&Fit>| {
        !surface.interior[v] && fit.is_none_or(|fit| fit.source == FitSource::Paper)
    };
    explain_those(fits, is_open, |(round, places): &mut (Vec<u32>, Vec<Place>), fits, v| {
        // Height fields are over the mean normal of all faces.
        let normal = surface.normal_of(v, |_| true);
        let plane = Fit::plane(surface.mesh.point(v), normal, FitSource::Leftover);
        let is_told = normal != DVec3::ZERO && take_places(surface, fits, v, &plane, round, places);
        fit_of(surface.h, &plane, is_told.then_some(places)?)
    });
}

/// The fit of the region that the near vertex with the number `i` is part of, if it is a good one.
fn region_of<'f>(surface: &Surface, fits: &'f VertexFits, i: u32) -> Option<&'f Fit> {
    let fit = fits.get(surface.near.verts[i as usize])?;
    (fit.source == FitSource::Region && fit.rms < REGION_RMS).then_some(fit)
}

/// Puts into `places` what no region explains round `v`, over `plane`: whether that is as much as a narrow face has.
/// `round` is working space.
fn take_places(
    surface: &Surface,
    fits: &VertexFits,
    v: Vert,
    plane: &Fit,
    round: &mut Vec<u32>,
    places: &mut Vec<Place>,
) -> bool {
    let near = &surface.near;
    let &Fit { origin, frame: [t1, t2, m], .. } = plane;
    let is_in_reach =
        |i: u32| near.points[i as usize].distance_squared(origin) <= (REACH * surface.h).powi(2);
    near.collect_rings(near.of[v], RINGS, MAX_NEAR, is_in_reach, round);
    let is_open = |i: &&u32| !near.interior[**i as usize] && region_of(surface, fits, **i).is_none();
    let place = |&i: &u32| {
        let point = near.points[i as usize];
        let regions = near.neighbours(i).iter().filter_map(|&j| region_of(surface, fits, j));
        let distances = regions.map(|fit| (fit.evaluate(point, surface.h).0.abs(), fit));
        let nearest =
            distances.min_by(|a, b| a.0.total_cmp(&b.0)).filter(|nearest| nearest.0 < SURE_DISTANCE);
        let trust = nearest.map_or(1.0, |(distance, _)| (distance / SURE_DISTANCE).powi(2));
        // A region that the vertex is above makes a valley with its face.
        let inner = nearest.map_or(0.0, |(_, fit)| fit.evaluate(origin, surface.h).0.signum());
        let offset = (point - origin) / surface.h;
        let (x, y, height) = (offset.dot(t1), offset.dot(t2), offset.dot(m));
        let row = SVector::from([1.0, x, y, 0.5 * x * x, x * y, 0.5 * y * y]);
        Place { row, height, weight: weight_at(offset), trust, inner }
    };
    places.clear();
    places.extend(round.iter().filter(is_open).map(place));
    (MIN_SAMPLES..=MAX_SAMPLES).contains(&places.len())
}

/// The height field over `plane` through `places`, if it passes through them. `h` is the mean edge length.
fn fit_of(h: f64, plane: &Fit, places: &[Place]) -> Option<Fit> {
    let mut solution = SVector::zeros();
    for _ in 0..ROUNDS {
        solution = solve(places, &solution)?;
    }
    let weights = places.iter().map(|place| place.weight(&solution));
    let squares = places.iter().map(|place| place.weight(&solution) * place.missed_by(&solution).powi(2));
    let rms = (squares.sum::<f64>() / weights.sum::<f64>()).sqrt();
    let fit = Fit { coefficients: solution.into(), rms, n_members: places.len(), ..plane.clone() };
    let (distance, normal) = fit.evaluate(fit.origin, h);
    (rms < MAX_RMS).then_some(Fit { displacement: -distance, normal, ..fit })
}

/// Least squares for the six coefficients, with the weights that `places` have by those before.
fn solve(places: &[Place], before: &SVector<f64, 6>) -> Option<SVector<f64, 6>> {
    let mut matrix = SMatrix::<f64, 6, 6>::zeros();
    let mut right = SVector::<f64, 6>::zeros();
    for place in places {
        let weight = place.weight(before);
        matrix.ger(weight, &place.row, &place.row, 1.0);
        right.axpy(weight * place.height, &place.row, 1.0);
    }
    let total = matrix[(0, 0)];
    // The mixed coefficient stands twice in the matrix of second derivatives.
    let priors = [SLOPE_PRIOR, SLOPE_PRIOR, CURVATURE_PRIOR, 2.0 * CURVATURE_PRIOR, CURVATURE_PRIOR];
    for (i, prior) in (1..).zip(priors) {
        matrix[(i, i)] += prior * total;
    }
    Some(matrix.cholesky()?.solve(&right))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Mesh;
    use crate::mesh::tests::mesh;
    use crate::regions::label::tests::surface;
    use FitSource::{Leftover, Paper, Region};

    /// `n` columns, 1 apart along x, of rows with these y and z.
    fn ribbon(n: usize, rows: &[[f64; 2]]) -> Mesh {
        let column = |i: usize| rows.iter().map(move |&[y, z]| [i as f64, y, z]);
        let points: Vec<_> = (0..n).flat_map(column).collect();
        let r = rows.len();
        let squares = (0..n - 1).flat_map(|c| (0..r - 1).map(move |i| r * c + i));
        let faces: Vec<_> = squares.flat_map(|v| [[v, v + r + 1, v + 1], [v, v + r, v + r + 1]]).collect();
        mesh(&points, &faces)
    }

    // A step down along y: two rows of the wall y = 0 between those of two levels.
    //
    //   ---0
    //       \
    //        1         0, 3  have the fits of their levels
    //        2         1, 2  have none, and no face of the wall has a level's neighbour
    //         \
    //          3---
    const STEP: [[f64; 2]; 4] = [[-0.5, 0.0], [0.0, -0.6], [0.0, -1.2], [0.5, -1.8]];

    /// The fits of the first and the last row of `ribbon`, which leave this residual.
    fn levels(m: &Mesh, n_rows: usize, rms: f64) -> VertexFits {
        let is_level = |v: &Vert| [0, n_rows - 1].contains(&(v.index() % n_rows));
        let mut fits = VertexFits::none(m.n_verts(), m.verts().collect());
        for v in m.verts().filter(is_level) {
            fits.set(v, Fit { rms, ..Fit::plane(m.point(v), DVec3::Z, Region) });
        }
        fits
    }

    /// The fits that the vertices of `ribbon` have afterwards, those of its first and last row being the levels'.
    fn explained(m: &Mesh, n_rows: usize, with: &[(usize, FitSource)]) -> VertexFits {
        let normals = m.face_normals();
        let surface = surface(m, &normals);
        let mut fits = levels(m, n_rows, 0.0);
        for &(v, source) in with {
            fits.set(Vert::new(v), Fit::plane(m.point(Vert::new(v)), DVec3::X, source));
        }
        explain_by_places(&surface, &mut fits);
        fits
    }

    #[test]
    fn a_wall_of_two_rows_has_the_normal_of_its_places() {
        let m = ribbon(5, &STEP);
        let fits = explained(&m, 4, &[]);
        for v in [4 * 2 + 1, 4 * 2 + 2].map(Vert::new) {
            let fit = fits.get(v).unwrap();
            assert!(fit.source == Leftover && fit.n_members == 10, "{fit:?}");
            assert!(fit.normal.dot(DVec3::Y) > 0.99, "{}", fit.normal);
            assert!(fit.displacement.abs() < 0.02 && fit.rms < 0.02, "{fit:?}");
            let by_faces: DVec3 = m.leaving(v).iter().map(|h| m.face_normals()[h.face()]).sum();
            assert!(by_faces.normalize().dot(DVec3::Y) < 0.98, "its faces lean");
        }
        // The levels' own stay as they were.
        assert_eq!(fits.get(Vert::new(0)).unwrap().normal, DVec3::Z);
    }

    #[test]
    fn only_what_has_no_fit_or_the_papers_plane_gets_one() {
        let m = ribbon(5, &STEP);
        let fits = explained(&m, 4, &[(9, Leftover), (10, Paper)]);
        assert_eq!(fits.get(Vert::new(9)).unwrap().normal, DVec3::X);
        assert!(fits.get(Vert::new(10)).unwrap().normal.dot(DVec3::Y) > 0.99);
    }

    #[test]
    fn a_sample_on_the_inner_side_beside_a_region_hardly_counts() {
        let normal = |y: f64| {
            let [level, .., floor] = STEP;
            let m =
                ribbon(4, &[[level[0] - 0.4, 0.0], [y, -0.1], [0.0, -0.7], [0.0, -1.3], [floor[0], -1.9]]);
            explained(&m, 5, &[]).get(Vert::new(5 + 2)).map(|fit| fit.normal.dot(DVec3::Y))
        };
        let [inside, outside] = [-0.3, 0.3].map(normal);
        assert!(inside.is_some_and(|cosine| cosine > 0.99), "{inside:?} {outside:?}");
        assert!(outside.is_none_or(|cosine| cosine < 0.98), "{inside:?} {outside:?}");
    }

    #[test]
    fn a_face_of_many_samples_is_not_narrow() {
        let [level, upper, lower, floor] = STEP;
        let rows = [level, upper, [0.0, -0.9], lower, floor];
        let is_explained = |n: usize| explained(&ribbon(n, &rows), 5, &[]).get(Vert::new(5 + 2)).is_some();
        // Three rows of four columns, and of five within reach: twelve, and fifteen.
        assert_eq!([4, 5].map(is_explained), [true, false]);
        // Four samples of two columns, and three of one and a half.
        let m = ribbon(2, &STEP);
        assert!(explained(&m, 4, &[]).get(Vert::new(2)).is_some());
        assert!(explained(&m, 4, &[(1, Region)]).get(Vert::new(2)).is_none());
    }

    /// What is taken round vertex `v` of `m`, which has four rows, of edges of mean length 1.
    fn taken(m: &Mesh, v: usize, level_rms: f64) -> Vec<Place> {
        let normals = m.face_normals();
        let mut surface = surface(m, &normals);
        surface.h = 1.0;
        let plane = Fit::plane(m.point(Vert::new(v)), DVec3::Y, Leftover);
        let (mut round, mut places) = (Vec::new(), Vec::new());
        let fits = levels(m, 4, level_rms);
        take_places(&surface, &fits, Vert::new(v), &plane, &mut round, &mut places);
        places
    }

    #[test]
    fn places_are_those_within_reach_that_no_good_region_has() {
        // Seven of the row itself are within three edges, and five of the other one.
        let m = ribbon(9, &STEP);
        assert_eq!(taken(&m, 4 * 4 + 1, 0.0).len(), 12);
        assert_eq!(taken(&m, 4 * 4 + 1, 0.025).len(), 12);
        assert!(taken(&m, 4 * 4 + 1, 0.035).len() > 12);
    }

    #[test]
    fn places_near_a_region_are_trusted_by_the_square_of_their_distance() {
        let m = ribbon(2, &[[-0.5, 0.0], [0.0, -0.3], [0.0, -1.0], [0.5, -1.7]]);
        let places = taken(&m, 1, 0.0);
        assert_eq!(places.len(), 4);
        for place in &places {
            // Below the upper level: a ridge, and the inner side is below the wall. What is .7 off counts in full.
            let is_upper = place.row[1].abs() < 0.1; // The first tangent points down.
            let (trust, inner) = if is_upper { (0.25, -1.0) } else { (1.0, 0.0) };
            assert!((place.trust - trust).abs() < 1e-12 && place.inner == inner, "{}", place.trust);
        }
        // Where the wall passes above it counts in full, where it passes below by its trust.
        let upper = places.iter().find(|place| place.inner == -1.0).unwrap();
        let weight = |z: f64| upper.weight(&SVector::from([z, 0.0, 0.0, 0.0, 0.0, 0.0])) / upper.weight;
        assert_eq!([-0.5, 0.5].map(weight).map(|w| (100.0 * w).round()), [100.0, 25.0]);
    }

    fn place(x: f64, y: f64, height: f64) -> Place {
        let row = SVector::from([1.0, x, y, 0.5 * x * x, x * y, 0.5 * y * y]);
        Place { row, height, weight: 1.0, trust: 1.0, inner: 0.0 }
    }

    #[test]
    fn what_samples_do_not_tell_is_level_and_straight() {
        let solved = |at: &[[f64; 3]]| {
            let places: Vec<Place> = at.iter().map(|&[x, y, z]| place(x, y, z)).collect();
            solve(&places, &SVector::zeros()).unwrap()
        };
        // Two samples in a row: nothing about the slope across it.
        let c = solved(&[[-1.0, 0.0, -1.0], [1.0, 0.0, 1.0]]);
        assert!((c[1] - 1.0 / 1.01).abs() < 1e-12 && c[2].abs() < 1e-12, "{c}");
        // 3 c0 + c3 = 2 and c0 + (0.5 + 3 / 50) c3 = 1.
        let c = solved(&[[-1.0, 0.0, 1.0], [0.0, 0.0, 0.0], [1.0, 0.0, 1.0]]);
        assert!((c[3] - 1.0 / 0.68).abs() < 1e-12 && c[5].abs() < 1e-12, "{c}");
        let c = solved(&[[-1.0, -1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [1.0, 1.0, 1.0]]);
        assert!((c[4] - 1.0 / 1.04).abs() < 1e-12, "{c}");
    }

    #[test]
    fn places_that_no_height_field_passes_through_have_none() {
        let fit = |a: f64| {
            let at = |i: usize| {
                (
                    (i % 4) as f64 - 1.5,
                    (i / 4) as f64 - 1.0,
                    if (i + i / 4).is_multiple_of(2) { a } else { -a },
                )
            };
            let places: Vec<Place> = (0..12).map(at).map(|(x, y, z)| place(x, y, z)).collect();
            fit_of(1.0, &Fit::plane(DVec3::ZERO, DVec3::Z, Leftover), &places)
        };
        let good = fit(0.04).unwrap();
        assert!(good.rms > 0.035 && good.n_members == 12, "{}", good.rms);
        assert!(fit(0.06).is_none());
    }
}
