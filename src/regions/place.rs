//! Where new vertices go: to where fits meet (steps 10 and 11).
//!
//! ```text
//!   N  `-.        .-'  M      m  the middle of the chamfer edge a-b
//!   ------a--_m_--b------     x  the nearest point to m that lies on both fits: Newton steps on their tangent planes,
//!           `-x-'                as a fit may be curved
//! ```
//!
//! Based on: Sharpen&Bend section 3.3 (planes through the ends of an edge, or the corners of a triangle, intersect).
//! Differs: fits instead of planes at the samples; corners of four regions are solved for all of them; a limit for how
//! far a vertex may go, tighter where a fit is a guess.
//! In/out: the mesh and its `RegionLabels` -> `Placement`: a point and an outcome for each chamfer edge and corner.
//! Cost: O(chamfer edges), in parallel.

mod corners;

use glam::DVec3;
use rayon::prelude::*;

use super::{RegionLabels, is_flat};
use crate::fit::{Fit, FitSource};
use crate::geometry::{Plane, nearest_on_all, nearest_on_both};
use crate::mesh::{Face, Half, Mesh, Vert};
use crate::place::{Outcome, Placement};
use crate::refine::Inserts;

/// Newton steps: the fits are nearly planes, and three leave nothing that a float can see.
const NEWTON_STEPS: usize = 3;
/// Fits whose normals have a smaller sine between them count as parallel.
pub(super) const MIN_SINE: f64 = 0.1;
/// A step goes at most this many times the edge's length from the middle, so that the next one starts
/// where the fits still mean something.
const MAX_STEP: f64 = 4.0;
/// A strip is mixed, convex on one side and concave on the other, when both ends rise above the other's
/// fit by more than this share of their distance, or both fall below it.
const MIXED: f64 = 0.02;
/// A new vertex goes at most this many times the split edge (a corner's: the longest edge) from the
/// middle. At 1.5 most acute edges pass and no spike does ...
const MAX_SHIFT: f64 = 1.5;
/// ... twice as many between flat sides, which say exactly where they meet: edges of 35 degrees and corners of
/// tetrahedra need up to 2 (wedges have a third to a thousandth of the error); at 4.5 nothing else moves ...
const MAX_SHIFT_OF_FLAT: f64 = 3.0;
/// ... but where a fit is a guess or leaves a residual of more than [`POOR_RMS`] (in h), and on mixed
/// strips, half of that.
const MAX_SHIFT_OF_GUESS: f64 = 0.75;
const POOR_RMS: f64 = 0.02;
/// ... where samples are noisy, of more than this many times the noise, as theirs all do: wedges and stars with noise of
/// 5 and 10 % lose half of their L2, which creases left in the middle of their edges had. At 1.2 a third of that stays; 2.5
/// is as good.
const POOR_IN_NOISE: f64 = 2.0;
/// The limit never falls below that of an edge of this length, in h: slivers have none to speak of ...
const MIN_EDGE: f64 = 0.3;
/// ... nor rises above that of an edge of this length: those that decimation leaves across flat sides, up to 20 h long,
/// cross the crease near one end ...
const LONG_EDGE: f64 = 3.0;
/// ... and the fit of the other is extrapolated to there: its residual times the distance may be this, in h. Of 28
/// decimated meshes two had up to four times the error of the input, by spikes of 1.4 and 2.6 h, and have less than it
/// now, six others up to a tenth less; .03 and .1 are worse on one each.
const MAX_EXTRAPOLATED: f64 = 0.05;
/// Directions with a singular value below this share of the largest are left free at corners.
const CORNER_CUTOFF: f64 = 0.1;

/// Places a new vertex on every chamfer edge and in every corner triangle of `labels`: where the fits of
/// their ends meet, nearest to the middle. The farthest that a new vertex may go is `max_shift` times the
/// split edge, or 3 mean edges if that is less; if it is not given, 1.5 times, and 3 times between flat sides.
#[must_use]
pub fn place_by_fits(mesh: &Mesh, labels: &RegionLabels, max_shift: Option<f64>) -> Placement {
    let mut inserts = Inserts::in_the_middle_of(mesh, &labels.chamfers, &labels.corner_faces);
    inserts.moved.clone_from(&labels.moved);
    let placing = Placing { mesh, labels, max_shift };
    let mut on_edges: Vec<Found> = labels.chamfers.par_iter().map(|&h| placing.on_edge(h)).collect();
    let in_corners: Vec<Found> = labels.corner_faces.par_iter().map(|&f| placing.in_corner(f)).collect();
    placing.join_corners(&inserts, &mut on_edges, &in_corners);
    let found = || on_edges.iter().chain(&in_corners);
    inserts.points = found().map(|found| found.point).collect();
    let outcomes = found().map(|found| found.outcome).collect();
    Placement { inserts, outcomes }
}

/// Where a new vertex goes.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Found {
    point: DVec3,
    outcome: Outcome,
    /// Whether its strip is convex on one side and concave on the other.
    is_mixed: bool,
}

impl Found {
    fn new(point: DVec3, outcome: Outcome) -> Self {
        Self { point, outcome, is_mixed: false }
    }
}

struct Placing<'a> {
    mesh: &'a Mesh,
    labels: &'a RegionLabels,
    max_shift: Option<f64>,
}

impl Placing<'_> {
    /// Where `v` is after samples have moved onto their fits.
    fn point(&self, v: Vert) -> DVec3 {
        let moved = &self.labels.moved;
        moved.binary_search_by_key(&v, |&(v, _)| v).map_or_else(|_| self.mesh.point(v), |i| moved[i].1)
    }

    /// The tangent plane of `fit` below `p`.
    fn plane(&self, fit: &Fit, p: DVec3) -> Plane {
        let (distance, normal) = fit.evaluate(p, self.labels.mean_edge);
        Plane { point: p - distance * self.labels.mean_edge * normal, normal }
    }

    /// The lengths of an edge that limits are multiples of.
    fn reach(&self, length: f64) -> f64 {
        length.clamp(MIN_EDGE * self.labels.mean_edge, self.long_edge())
    }

    /// Whether `fit` can be trusted at `point`, on an edge of this length.
    fn holds_at(&self, fit: &Fit, point: DVec3, length: f64) -> bool {
        let error = fit.rms * point.distance(fit.origin);
        length <= self.long_edge() || error <= MAX_EXTRAPOLATED * self.labels.mean_edge
    }

    /// The length of the longest edge that is not too long.
    fn long_edge(&self) -> f64 {
        LONG_EDGE * self.labels.mean_edge
    }

    /// The farthest that a new vertex between `fits` may go, in lengths of its edge.
    fn max_shift(&self, fits: &[&Fit]) -> f64 {
        let are_flat = || fits.iter().all(|fit| is_flat(fit));
        self.max_shift.unwrap_or_else(|| if are_flat() { MAX_SHIFT_OF_FLAT } else { MAX_SHIFT })
    }

    /// Fits with a larger residual are poor.
    fn poor_rms(&self) -> f64 {
        let RegionLabels { is_noisy, noise, .. } = self.labels;
        if *is_noisy { POOR_RMS.max(POOR_IN_NOISE * noise) } else { POOR_RMS }
    }

    fn on_edge(&self, h: Half) -> Found {
        let ends = self.mesh.ends(h);
        let [a, b] = ends.map(|v| self.point(v));
        let centre = a.midpoint(b);
        let [Some(p), Some(q)] = ends.map(|v| self.labels.fits.get(v)) else {
            return Found::new(centre, Outcome::NoNormal);
        };
        let length = a.distance(b);
        let mut point = centre;
        for _ in 0..NEWTON_STEPS {
            let planes = (self.plane(p, point), self.plane(q, point));
            match nearest_on_both(planes.0, planes.1, centre) {
                Some((nearest, sine)) if sine >= MIN_SINE => {
                    point = centre + (nearest - centre).clamp_length_max(MAX_STEP * length);
                }
                _ => return Found::new(centre, Outcome::Parallel),
            }
        }
        let is_mixed = self.is_mixed([p, q], [a, b]);
        let is_poor = |fit: &Fit| fit.rms > self.poor_rms() || fit.source != FitSource::Region;
        let is_doubtful = is_poor(p) || is_poor(q);
        let times = if is_doubtful || is_mixed { MAX_SHIFT_OF_GUESS } else { self.max_shift(&[p, q]) };
        let is_near = point.distance(centre) <= times * self.reach(length)
            && [p, q].into_iter().all(|fit| self.holds_at(fit, point, length));
        let outcome = match (is_mixed, is_near) {
            (true, true) if !is_doubtful => Outcome::Moved,
            (true, _) => Outcome::Mixed,
            (false, true) => Outcome::Moved,
            (false, false) => Outcome::TooFar,
        };
        Found { point: if outcome == Outcome::Moved { point } else { centre }, outcome, is_mixed }
    }

    fn is_mixed(&self, [p, q]: [&Fit; 2], [a, b]: [DVec3; 2]) -> bool {
        let h = self.labels.mean_edge;
        let along = (b - a) / a.distance(b);
        let (rise_p, rise_q) = (along.dot(p.evaluate(a, h).1), along.dot(q.evaluate(b, h).1));
        rise_p * rise_q > 0.0 && rise_p.abs().min(rise_q.abs()) > MIXED
    }

    /// Solves for the fits of the triangle's corners and, where a fourth region meets here, of the corner
    /// triangles across its edges.
    fn in_corner(&self, f: Face) -> Found {
        let corners = self.mesh.corners(f);
        let points = corners.map(|v| self.point(v));
        let centre = points.into_iter().sum::<DVec3>() / 3.0;
        let longest = (0..3).map(|i| points[i].distance(points[(i + 1) % 3])).fold(0.0, f64::max);

        let mut verts = corners.to_vec();
        let across = f.halves().into_iter().filter_map(|h| self.mesh.twin(h)).map(Half::face);
        for g in across.filter(|g| self.labels.corner_faces.binary_search(g).is_ok()) {
            for v in self.mesh.corners(g) {
                if !verts.contains(&v) {
                    verts.push(v);
                }
            }
        }
        let fits: Vec<&Fit> = verts.iter().filter_map(|&v| self.labels.fits.get(v)).collect();
        let limit = self.max_shift(&fits) * longest.min(self.long_edge());
        let mut point = centre;
        for _ in 0..NEWTON_STEPS {
            let planes: Vec<Plane> = fits.iter().map(|fit| self.plane(fit, point)).collect();
            point = nearest_on_all(&planes, centre, CORNER_CUTOFF).0;
            if !point.is_finite() || point.distance(centre) > 2.0 * limit {
                return Found::new(centre, Outcome::TooFar);
            }
        }
        let holds = fits.iter().all(|fit| self.holds_at(fit, point, longest));
        if holds && point.distance(centre) <= limit {
            Found::new(point, Outcome::Moved)
        } else {
            Found::new(centre, Outcome::TooFar)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tests::mesh;
    use crate::regions::tests::planes;
    use FitSource::{Adopted, Region};
    use glam::dvec3;

    // 3---2    The chamfer edge 0-2, from (0, 0, 0) to (1, 1, 0).
    // | / |
    // 0---1
    fn square() -> Mesh {
        mesh(&[[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]], &[[0, 1, 2], [0, 2, 3]])
    }

    fn place_diagonal(
        m: &Mesh,
        [n, q]: [DVec3; 2],
        source: FitSource,
        edit: impl Fn(&mut RegionLabels),
    ) -> (DVec3, Outcome) {
        place_diagonal_up_to(None, m, [n, q], source, edit)
    }

    fn place_diagonal_up_to(
        max_shift: Option<f64>,
        m: &Mesh,
        [n, q]: [DVec3; 2],
        source: FitSource,
        edit: impl Fn(&mut RegionLabels),
    ) -> (DVec3, Outcome) {
        let fits = planes(m, &[(0, n.normalize(), 0.0, Region), (2, q.normalize(), 0.0, source)]);
        let chamfers = vec![Half::new(2)];
        let mut labels = RegionLabels { mean_edge: 1.0, fits, chamfers, ..RegionLabels::default() };
        edit(&mut labels);
        let placement = place_by_fits(m, &labels, max_shift);
        (placement.inserts.points[0], placement.outcomes[0])
    }

    #[test]
    fn a_vertex_goes_where_the_planes_of_its_ends_meet() {
        let m = square();
        let middle = dvec3(0.5, 0.5, 0.0);
        let place = |normals, source| place_diagonal(&m, normals, source, |_| {});
        // Planes that rise at 45 degrees from both ends meet as high as half the edge is long.
        let steep = |slope: f64| [dvec3(-slope, -slope, 1.0), dvec3(slope, slope, 1.0)];
        let (point, outcome) = place(steep(1.0), Region);
        assert_eq!(outcome, Outcome::Moved);
        assert!(point.distance(dvec3(0.5, 0.5, 1.0)) < 1e-12, "{point}");
        // At 2.5 times the slope it is 2.5 high and 1.77 edges from the middle: planes may go as far, curved sides not.
        assert_eq!(place(steep(2.5), Region).1, Outcome::Moved);
        assert_eq!(place(steep(4.5), Region), (middle, Outcome::TooFar));
        let curved =
            |labels: &mut RegionLabels| labels.fits.fits.iter_mut().flatten().for_each(|fit| fit.rms = 0.011);
        assert_eq!(place_diagonal(&m, steep(2.5), Region, curved), (middle, Outcome::TooFar));
        assert_eq!(place(steep(1.5), Region).1, Outcome::Moved);
        // A guess may go half as far.
        assert_eq!(place(steep(1.5), Adopted), (middle, Outcome::TooFar));
        // Rising at one end and falling at the other towards it: only with two good fits, and near.
        let mixed = |slope: f64| [dvec3(-slope, -slope, 1.), dvec3(-slope, -slope, -1.)];
        assert_eq!(place(mixed(1.0), Region).1, Outcome::Moved);
        assert_eq!(place(mixed(1.0), Adopted), (middle, Outcome::Mixed));
        assert_eq!(place(mixed(1.5), Region), (middle, Outcome::Mixed));
        // So may a fit with a larger residual, unless that is noise.
        let with_rms = |rms: f64, noise: f64| {
            place_diagonal(&m, steep(1.5), Region, |labels| {
                labels.fits.fits.iter_mut().flatten().for_each(|fit| fit.rms = rms);
                (labels.noise, labels.is_noisy) = (noise, noise > 0.03);
            })
            .1
        };
        let outcomes = [(0.019, 0.0), (0.021, 0.0), (0.05, 0.029), (0.07, 0.036), (0.07, 0.034)];
        let [good, poor, not_noisy, noisy, worse] = outcomes.map(|(rms, noise)| with_rms(rms, noise));
        assert_eq!([good, poor, not_noisy], [Outcome::Moved, Outcome::TooFar, Outcome::TooFar]);
        assert_eq!([noisy, worse], [Outcome::Moved, Outcome::TooFar]);
        // Nine degrees apart are parallel, and so is antiparallel.
        assert_eq!(place([DVec3::Z, dvec3(0.07, 0.07, 1.0)], Region), (middle, Outcome::Parallel));
        assert_eq!(place([DVec3::Z, -DVec3::Z], Region), (middle, Outcome::Parallel));
    }

    #[test]
    fn on_a_long_edge_a_vertex_goes_as_far_as_its_fits_hold() {
        let place = |scale: f64, rms: f64| {
            let (mut points, faces) = square().into_parts();
            points.iter_mut().for_each(|p| *p *= scale);
            let m = Mesh::new(points, faces).unwrap();
            let steep = [dvec3(-1.0, -1.0, 1.0), dvec3(1.0, 1.0, 1.0)];
            let rough = |labels: &mut RegionLabels| {
                labels.fits.fits.iter_mut().flatten().for_each(|fit| fit.rms = rms)
            };
            place_diagonal(&m, steep, Region, rough).1
        };
        // Edges of 1.4 h and 5.7 h; from the ends of the second it is 4.9 h to where the planes meet.
        assert_eq!([0.015, 0.02].map(|rms| place(1.0, rms)), [Outcome::Moved; 2]);
        assert_eq!([0.009, 0.0105].map(|rms| place(4.0, rms)), [Outcome::Moved, Outcome::TooFar]);
        // Planes that meet 8.5 and 9.5 h from the middle of edges of 12 and 13.4 h: three times 3 h is the limit.
        assert_eq!([8.5, 9.5].map(|scale| place(scale, 0.0)), [Outcome::Moved, Outcome::TooFar]);
    }

    #[test]
    fn a_limit_that_is_given_holds_for_planes_too() {
        let m = square();
        let normals = [dvec3(-2.5, -2.5, 1.0), dvec3(2.5, 2.5, 1.0)];
        let outcome = |max_shift: f64| place_diagonal_up_to(Some(max_shift), &m, normals, Region, |_| {}).1;
        assert_eq!([1.5, 1.8].map(outcome), [Outcome::TooFar, Outcome::Moved]);
    }

    #[test]
    fn moved_samples_count_where_they_are_now() {
        // Vertex 2 moves up; its plane was made 1 h above where it was.
        let m = square();
        let up = dvec3(1.0, 1.0, 1.0);
        let (point, outcome) = place_diagonal(&m, [-DVec3::Z, DVec3::X], Region, |labels| {
            labels.moved = vec![(Vert::new(2), up)];
        });
        // The middle is now (.5, .5, .5); planes z = 0 and x = 1.
        assert_eq!(outcome, Outcome::Moved);
        assert!(point.distance(dvec3(1.0, 0.5, 0.0)) < 1e-12, "{point}");
    }

    #[test]
    fn an_end_without_a_fit_leaves_the_vertex_in_the_middle() {
        let m = square();
        let found = place_diagonal(&m, [DVec3::Z, DVec3::X], Region, |labels| {
            labels.fits = planes(&m, &[(0, DVec3::Z, 0.0, Region)]);
        });
        assert_eq!(found, (dvec3(0.5, 0.5, 0.0), Outcome::NoNormal));
    }

    // 2            Corner triangles 0-1-2 and 1-3-2 with four regions: the planes of all four vertices
    // | `.         meet in (1, 1, 1), those of 0, 1 and 2 as well.
    // 0---1
    #[test]
    fn a_corner_goes_where_three_or_four_fits_meet() {
        let m = mesh(&[[0., 1., 1.], [1., 0., 1.], [1., 1., 0.], [1.5, 0.5, 0.5]], &[[0, 1, 2], [1, 3, 2]]);
        let normals = [DVec3::X, DVec3::Y, DVec3::Z, dvec3(1., 1., 1.)];
        // Each plane passes through (1, 1, 1): as far off its vertex as that is.
        let plane = |v: usize| {
            let normal = normals[v].normalize();
            (v, normal, normal.dot(DVec3::ONE - m.point(Vert::new(v))), Region)
        };
        let place = |moved, corner_faces: &[usize], planes_of: &[usize]| {
            let list: Vec<_> = planes_of.iter().map(|&v| plane(v)).collect();
            let labels = RegionLabels {
                mean_edge: 1.0,
                fits: planes(&m, &list),
                chamfers: m.edges().collect(),
                corner_faces: corner_faces.iter().map(|&f| Face::new(f)).collect(),
                moved,
                ..RegionLabels::default()
            };
            let placement = place_by_fits(&m, &labels, None);
            (placement.inserts.points[5], placement.outcomes[5])
        };
        for faces in [&[0][..], &[0, 1]] {
            let (point, outcome) = place(vec![], faces, &[0, 1, 2, 3]);
            assert_eq!(outcome, Outcome::Moved);
            assert!(point.distance(DVec3::ONE) < 1e-12, "{point}");
        }
        let outcome = |at: f64| place(vec![(Vert::new(0), DVec3::splat(at))], &[0], &[0, 1, 2]).1;
        assert_eq!(outcome(-8.0), Outcome::Moved, "5.2 h, which is more than three of the edges that were");
        assert_eq!(outcome(-20.0), Outcome::TooFar, "long edges count as 3 h");
    }
}
