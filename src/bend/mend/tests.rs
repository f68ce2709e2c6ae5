use std::collections::BTreeMap;

use glam::dvec3;

use super::*;
use crate::bend::quarter::Middles;
use crate::bend::{BendOptions, Bent, bend};
use crate::mesh::tests::mesh;
use crate::mesh::{Mesh, Vert};
use crate::stencil::Stencils;
use crate::tags::Tags;

/// A sheet in the plane whose first face has slipped over its longest edge, by `depth`.
///
/// ```text
///      5-------4
///      | `\ /´ |
///      0 --2-- 1      2 is a little below 0-1
///        \   /
///          3
/// ```
fn cap(depth: f64) -> Mesh {
    let points = [[0., 0.], [1., 0.], [0.5, -depth], [0.5, -1.], [1., 1.], [0., 1.]];
    let faces = [[0, 1, 2], [1, 0, 3], [2, 1, 4], [0, 2, 5], [2, 4, 5]];
    mesh(&points.map(|[x, y]| [x, y, 0.0]), &faces)
}

fn bent(mesh: &Mesh, tags: &Tags) -> Bent {
    bend(mesh, tags, &BendOptions::default()).unwrap()
}

/// The faces that look down.
fn turned(mesh: &Mesh) -> Vec<Face> {
    mesh.face_ids().filter(|&f| mesh.face_normals()[f].z < 0.0).collect()
}

/// Twice the area over the square of the longest side, of the worst face.
fn worst_shape(mesh: &Mesh) -> f64 {
    let shape = |f: Face| {
        let [a, b, c] = mesh.triangle(f);
        let longest = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
        (b - a).cross(c - a).length() / longest
    };
    mesh.face_ids().map(shape).fold(f64::INFINITY, f64::min)
}

#[test]
fn the_children_of_a_cap_that_has_slipped_over_its_edge_are_all_right() {
    let m = cap(0.02);
    assert_eq!(turned(&m), [Face::new(0)]);
    let Bent { mesh: fine, counts, .. } = bent(&m, &Tags::default());
    fine.check().unwrap();
    assert_eq!(turned(&fine), []);
    assert!((1..=3).contains(&counts.mended), "{} of the cap's new vertices", counts.mended);
    assert!(worst_shape(&fine) > 0.1);
    assert_eq!(fine.points()[..6], *m.points());
    assert!(fine.points().iter().all(|p| p.z == 0.0), "they move within the surface");
    let middle = m.edges().position(|h| m.ends(h) == [4, 5].map(Vert::new)).unwrap();
    assert_eq!(fine.points()[6 + middle], dvec3(0.5, 1.0, 0.0));
}

#[test]
fn a_vertex_on_a_sharp_edge_stays_and_the_others_mend_what_they_can() {
    let m = cap(0.02);
    let Bent { mesh: fine, counts, .. } = bent(&m, &Tags::new([[0, 1].map(Vert::new)], []));
    assert_eq!(fine.point(Vert::new(6)), dvec3(0.5, 0.0, 0.0));
    assert_eq!(turned(&fine), [Face::new(2)], "only the child at the vertex that has slipped over");
    assert_eq!(counts.mended, 2);
}

#[test]
fn a_sheet_without_turned_faces_is_left_alone() {
    let Bent { counts, mesh: fine, .. } = bent(&cap(-0.02), &Tags::default());
    assert_eq!((counts.mended, turned(&fine)), (0, vec![]));
}

/// A sheet in the plane whose vertices are out of place by more than its faces are high.
fn shaken() -> Mesh {
    let noise = |i: usize, j: usize| ((12.9898 * i as f64 + 78.233 * j as f64).sin() * 43758.5453).fract();
    let n = 24;
    let point = |k: usize| {
        let (i, j) = (k / n, k % n);
        [i as f64 + 0.55 * noise(i, j), j as f64 + 0.55 * noise(j + 31, i + 7), 0.0]
    };
    let faces = (0..n * (n - 1)).filter(|k| k % n != n - 1);
    let faces = faces.flat_map(|k| [[k, k + n, k + n + 1], [k, k + n + 1, k + 1]]).collect::<Vec<_>>();
    mesh(&(0..n * n).map(point).collect::<Vec<_>>(), &faces)
}

#[test]
fn a_mesh_that_is_no_surface_is_not_mended() {
    let caps = |n: usize| {
        let one = cap(0.02);
        let points = (0..n).flat_map(|i| {
            one.points().iter().map(move |p| (*p + dvec3(9.0 * i as f64, 0.0, 0.0)).to_array())
        });
        let faces = (0..n).flat_map(|i| one.faces().iter().map(move |f| f.map(|v| 6 * i + v.index())));
        mesh(&points.collect::<Vec<_>>(), &faces.collect::<Vec<_>>())
    };
    let n_mended = |n: usize| bent(&caps(n), &Tags::default()).counts.mended;
    assert!(n_mended(200) >= 200);
    assert_eq!(n_mended(1100), 0);
}

#[test]
fn most_children_of_turned_faces_are_mended_on_any_number_of_threads() {
    let m = shaken();
    let n_before = turned(&m).len();
    let run = |n: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        pool.install(|| bent(&m, &Tags::default()))
    };
    let one = run(1);
    let n_after = turned(&one.mesh).len();
    assert!(worst_shape(&one.mesh) > 1e-3, "of places that leave equally few bad it takes the best shape");
    assert!(n_before > 10 && n_after < 2 * n_before, "{n_before} {n_after}");
    for other in [2, 4].map(run) {
        assert_eq!((one.mesh.points(), &one.counts), (other.mesh.points(), &other.counts));
    }
}

#[test]
fn the_order_of_the_faces_and_of_their_corners_does_not_matter() {
    let m = shaken();
    let turned_round = |(i, &[a, b, c]): (usize, &[Vert; 3])| [[a, b, c], [b, c, a], [c, a, b]][i % 3];
    let faces: Vec<_> = m.faces().iter().enumerate().map(turned_round).rev().collect();
    let other = Mesh::new(m.points().to_vec(), faces).unwrap();
    let middles = |m: &Mesh| {
        let Bent { mesh: fine, counts, .. } = bent(m, &Tags::default());
        let ends = m.edges().map(|h| [m.from(h).min(m.to(h)), m.from(h).max(m.to(h))]);
        (ends.zip(fine.points()[m.n_verts()..].to_vec()).collect::<BTreeMap<_, _>>(), counts.mended)
    };
    let ((here, n), (there, n_other)) = (middles(&m), middles(&other));
    assert!(n > 10 && n == n_other, "{n} {n_other}");
    assert!(here.iter().all(|(ends, p)| p.distance(there[ends]) < 1e-12));
}

/// The faces that should be mended, and the directions of the surface that they should lie in.
fn suspects(m: &Mesh, sharp: &[[usize; 2]]) -> Vec<(usize, DVec3)> {
    let stencils = Stencils::new(m, &Tags::new(sharp.iter().map(|edge| edge.map(Vert::new)), []));
    let middles = Middles::of(m).unwrap();
    let mut points = m.points().to_vec();
    points.resize(m.n_verts() + middles.edges.len(), DVec3::ZERO);
    let found = Draft::new(m, &stencils, &middles, points).suspects();
    found.into_iter().map(|(f, normal)| (f.index(), normal)).collect()
}

// A face that looks up, and one each over its first two sides with tips there.
fn with_two(tip: [f64; 3], other_tip: [f64; 3]) -> Mesh {
    let points = [[0.; 3], [1., 0., 0.], [0., 1., 0.], tip, other_tip];
    mesh(&points, &[[0, 1, 2], [1, 0, 3], [2, 1, 4]])
}

#[test]
fn faces_are_turned_if_those_round_them_agree_that_they_are() {
    // Twice the areas: (0, .6, -.8) and (-.42, -.42, -.8).
    let agree = with_two([0.5, 0.8, 0.6], [0.1, 0.1, 0.42]);
    let found = suspects(&agree, &[]);
    assert_eq!(found[0].0, 0);
    assert!(found[0].1.distance(DVec3::new(-0.42, 0.18, -1.6).normalize()) < 1e-9, "{}", found[0].1);
    // Twice the areas: (0, .9, -.43) and (-.64, -.64, -.43).
    let differ = with_two([0.5, 0.43, 0.9], [0.285, 0.285, 0.64]);
    assert!(suspects(&differ, &[]).iter().all(|&(f, _)| f != 0));
    // What is beyond a cut says nothing.
    assert_eq!(suspects(&agree, &[[0, 1], [1, 2]]), []);
}

#[test]
fn faces_that_others_fold_over_are_mended_as_they_lie() {
    // The second face lies on the first one; the third goes on from it.
    let folded = with_two([0.5, 0.1, 0.005], [1., 1., 0.]);
    assert_eq!(suspects(&folded, &[]).iter().map(|&(f, _)| f).collect::<Vec<_>>(), [0, 1]);
    assert!(suspects(&folded, &[]).iter().all(|(_, normal)| normal.z > 0.9));
}

/// The new vertices that are off the middles of their edges, and how far they are off the planes of the faces beside
/// these, in edges.
fn off_middle(m: &Mesh, fine: &Mesh) -> Vec<f64> {
    let off = |(h, &new): (Half, &DVec3)| {
        let way = new - m.point(m.from(h)).midpoint(m.point(m.to(h)));
        let beside = [Some(h), m.twin(h)].into_iter().flatten().map(Half::face);
        let off_plane = beside.map(|f| m.face_normals()[f].dot(way).abs() / m.length(h));
        (way != DVec3::ZERO && !m.is_border(h)).then(|| off_plane.fold(0.0, f64::max))
    };
    m.edges().zip(&fine.points()[m.n_verts()..]).filter_map(off).collect()
}

#[test]
fn a_vertex_for_which_no_place_is_better_is_where_it_was() {
    let tags = Tags::new([[0, 1].map(Vert::new)], []);
    for m in [cap(0.02), shaken()] {
        let Bent { counts, mesh: fine, .. } = bent(&m, &tags);
        assert_eq!(off_middle(&m, &fine).len(), counts.mended);
    }
}

#[test]
fn mended_vertices_stay_near_the_planes_of_both_faces() {
    // The face across 0-1 goes down steeply.
    let (mut points, faces) = cap(0.02).into_parts();
    points[3].z = -0.7;
    let m = Mesh::new(points, faces).unwrap();
    let Bent { counts, mesh: fine, .. } = bent(&m, &Tags::default());
    let off = off_middle(&m, &fine);
    assert!(counts.mended > 1 && turned(&fine).is_empty());
    assert!(off.len() > 1 && off.iter().all(|&off| off <= MAX_OFF_PLANE), "{off:?}");
}
