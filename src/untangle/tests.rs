//! Hand-made meshes for the tests of untangling, and the tests of what a face's energy is.

use std::f64::consts::FRAC_1_SQRT_2;
use std::ops::Range;

use glam::{DVec3, dvec3};

use super::*;
use crate::fit::FitSource;
use crate::mesh::tests::mesh;
use crate::refine::{Inserts, refine};

/// A mesh as subdivision could have left it: all of it is the zone.
pub(super) struct Scene {
    /// The same mesh with every inserted vertex in the middle of its edge.
    before: Mesh,
    refined: Refined,
    n_old: usize,
    fits: Vec<Option<Fit>>,
    are_on_feature: bool,
}

impl Scene {
    /// The vertices from `n_old` on are inserted ones and in their middles, with `creases` between them.
    pub(super) fn new(
        points: &[[f64; 3]],
        faces: &[[usize; 3]],
        n_old: usize,
        creases: &[[usize; 2]],
    ) -> Self {
        let before = mesh(points, faces);
        let mut refined = refine(&before, &Inserts::none()).unwrap();
        refined.creases = creases.iter().map(|ends| ends.map(Vert::new)).collect();
        refined.middles = before.points()[n_old..].to_vec();
        refined.children = before.face_ids().collect();
        Self { n_old, fits: vec![None; points.len()], are_on_feature: true, before, refined }
    }

    /// Gives `verts` the plane through the origin as their fit.
    pub(super) fn with_plane(self, verts: Range<usize>, normal: DVec3) -> Self {
        self.with_fit(verts, &Fit::plane(DVec3::ZERO, normal, FitSource::Region))
    }

    pub(super) fn with_fit(mut self, verts: Range<usize>, fit: &Fit) -> Self {
        self.fits[verts].fill(Some(fit.clone()));
        self
    }

    pub(super) fn without_fit(mut self, verts: Range<usize>) -> Self {
        self.fits[verts].fill(None);
        self
    }

    /// Only these faces were split.
    pub(super) fn split_at(mut self, faces: Range<usize>) -> Self {
        self.refined.children = faces.map(Face::new).collect();
        self
    }

    /// No inserted vertex went onto its feature.
    pub(super) fn off_feature(self) -> Self {
        Self { are_on_feature: false, ..self }
    }

    /// Puts vertices elsewhere; the middles stay.
    pub(super) fn moved(mut self, places: &[(usize, [f64; 3])]) -> Self {
        let (mut points, faces) = self.refined.mesh.into_parts();
        places.iter().for_each(|&(v, place)| points[v] = DVec3::from(place));
        self.refined.mesh = Mesh::new(points, faces).unwrap();
        self
    }

    pub(super) fn run<T>(&self, act: impl FnOnce(&mut Zone<'_, '_, '_>) -> T) -> T {
        let mut context = Context::plain(&self.before, &self.refined, None);
        context.n_old = self.n_old;
        context.fits = self.fits.iter().map(Option::as_ref).collect::<Vec<_>>().into();
        let is_moved = |_| self.are_on_feature;
        context.is_moved = &is_moved;
        let is_whole = PerVert::filled(self.before.n_verts(), true);
        let mut edit = Edit::new(&self.refined, self.n_old, &is_whole);
        act(&mut Zone::new(&context, &mut edit))
    }
}

/// A sheet of 10 by 5 vertices, folded down along the crease in its middle. The crease vertices are the last ten.
///
/// ```text
///   y =  2   20--21--22--23-- ... --29
///            | / | / | / | /
///   y =  1   30--31--32--33-- ... --39      inserted ones as well where `n_old` is 30
///            | / | / | / | /
///   y =  0   40==41==42==43== ... ==49      the crease, at z = 0
///            | / | / | / | /
///   y = -1   10--11--12--13-- ... --19
///            | / | / | / | /
///   y = -2    0---1---2---3-- ... ---9
///      x =    0   1   2   3
/// ```
pub(super) fn roof_with(slope: f64, n_old: usize, creases: &[[usize; 2]]) -> Scene {
    let rows = [-2.0, -1.0, 2.0, 1.0, 0.0];
    let point = |i: usize| [(i % 10) as f64, rows[i / 10], -slope * rows[i / 10].abs()];
    let upwards = [[0, 10], [10, 40], [40, 30], [30, 20]];
    let square = |[p, q]: [usize; 2]| [[p, p + 1, q + 1], [p, q + 1, q]];
    let faces = upwards.into_iter().flat_map(|[p, q]| (0..9).flat_map(move |i| square([p + i, q + i])));
    let points: Vec<_> = (0..50).map(point).collect();
    let side = |y: f64| dvec3(0.0, slope * y, 1.0).normalize();
    let scene = Scene::new(&points, &faces.collect::<Vec<_>>(), n_old, creases);
    scene.with_plane(0..20, side(-1.0)).with_plane(20..n_old.max(20), side(1.0))
}

/// That with its crease from end to end and a right angle between its sides.
pub(super) fn roof() -> Scene {
    roof_with(1.0, 40, &(40..49).map(|v| [v, v + 1]).collect::<Vec<_>>())
}

/// The face with these corners, whichever comes first.
pub(super) fn face(zone: &Zone<'_, '_, '_>, corners: [usize; 3]) -> Face {
    let [a, b, c] = corners.map(Vert::new);
    let is_it =
        |&f: &Face| zone.edit.has_corner(f, a) && zone.edit.has_corner(f, b) && zone.edit.has_corner(f, c);
    zone.faces.iter().copied().find(is_it).unwrap()
}

pub(super) fn assert_near(value: f64, expected: f64) {
    assert!((value - expected).abs() < 1e-9, "{value} instead of {expected}");
}

// 2     With the fit of its first vertex, or without any. The second face has no area.
// | `.
// 0---1---3
fn pair(fit: bool) -> Scene {
    let points = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [2., 0., 0.]];
    let scene = Scene::new(&points, &[[0, 1, 2], [0, 1, 3]], 4, &[]);
    if fit { scene.with_plane(0..1, DVec3::Z) } else { scene }
}

fn energy(fit: bool, face: usize, triangle: [DVec3; 3]) -> Energy {
    pair(fit).run(|zone| zone.energy_of(triangle, Face::new(face)))
}

/// How far the first face would be from its fit.
fn residual(fit: bool, triangle: [DVec3; 3]) -> f64 {
    pair(fit).run(|zone| zone.residual_of(triangle, Face::new(0)))
}

/// A right-angled triangle of sides `size`, turned about one of them.
fn turned(degrees: f64, size: f64) -> [DVec3; 3] {
    let (sin, cos) = degrees.to_radians().sin_cos();
    [DVec3::ZERO, size * DVec3::X, size * dvec3(0.0, cos, sin)]
}

#[test]
fn a_face_is_bad_when_turned_by_more_than_60_degrees_from_its_fit() {
    for degrees in [0.0, 59.0] {
        assert_eq!(energy(true, 0, turned(degrees, 0.1)).turned, 0.0, "{degrees}");
    }
    for degrees in [61.0_f64, 90.0, 120.0, 180.0] {
        assert_near(energy(true, 0, turned(degrees, 0.1)).turned, 1.5 - degrees.to_radians().cos());
    }
    assert_near(residual(true, turned(90.0, 0.1)), 0.1);
}

#[test]
fn a_face_far_from_its_fit_is_bad_only_when_turned_by_more_than_90_degrees() {
    let lifted = |degrees: f64, z: f64| turned(degrees, 0.1).map(|p| p + z * DVec3::Z);
    let up = 61.0_f64.to_radians().sin() * 0.1;
    assert_eq!(energy(true, 0, lifted(61.0, 0.151 - up)).turned, 0.0);
    assert_near(energy(true, 0, lifted(61.0, 0.149 - up)).turned, 1.5 - 61.0_f64.to_radians().cos());
    assert_eq!(energy(true, 0, lifted(89.0, 1.0)).turned, 0.0);
    assert_near(energy(true, 0, lifted(91.0, 1.0)).turned, 1.5 - 91.0_f64.to_radians().cos());
    assert_near(residual(true, turned(0.0, 0.1).map(|p| p - 0.3 * DVec3::Z)), 0.3);
}

#[test]
fn without_a_fit_a_face_follows_the_input_face_that_it_lies_in() {
    // However far from it; one whose input face has no area is never bad.
    assert_eq!(energy(false, 0, turned(59.0, 10.0)).turned, 0.0);
    let bad = energy(false, 0, turned(61.0, 10.0));
    assert_near(bad.turned, 1.5 - 61.0_f64.to_radians().cos());
    assert_eq!(residual(false, turned(61.0, 10.0)), 0.0);
    assert_eq!(energy(false, 1, turned(180.0, 1.0)).turned, 0.0);
    assert_near(energy(true, 1, turned(180.0, 0.1)).turned, 2.5);
}

#[test]
fn a_face_without_area_is_bad_and_no_sliver() {
    let none = energy(true, 0, [DVec3::ZERO, DVec3::X, 2.0 * DVec3::X]);
    assert_eq!((none.turned, none.sliver), (1.5, 0.0));
    assert_eq!(energy(true, 0, [DVec3::ZERO; 3]).turned, 1.5);
}

#[test]
fn a_sliver_counts_a_fifth_and_more_the_thinner_it_is_once_slivers_count() {
    // The smallest angle is at the first corner, between the two longest sides.
    let thin = |degrees: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        energy(true, 0, [DVec3::ZERO, DVec3::X, 0.9 * dvec3(cos, sin, 0.0)])
    };
    assert_eq!(thin(1.01).sliver, 0.0);
    let half = 0.2 + 0.1 * (1.0 - 0.5_f64.to_radians().sin() / 1.0_f64.to_radians().sin());
    assert_near(thin(0.5).sliver, half);
    assert_eq!(thin(0.5).turned, 0.0);
    roof().run(|zone| {
        assert_eq!(zone.value(thin(0.5)), 0.0);
        zone.slivers_count = true;
        assert_near(zone.value(thin(0.5)), half);
    });
}

#[test]
fn the_faces_beside_the_crease_of_a_roof_follow_their_sides() {
    roof().run(|zone| {
        let fits = [[12, 43, 42], [42, 43, 33]].map(|t| zone.fit(face(zone, t)).unwrap().normal);
        let sides = [-1.0, 1.0].map(|y| FRAC_1_SQRT_2 * dvec3(0.0, y, 1.0));
        assert!(fits[0].distance(sides[0]) < 1e-12 && fits[1].distance(sides[1]) < 1e-12, "{fits:?}");
        assert_eq!(zone.bad_faces(), []);
    });
}
