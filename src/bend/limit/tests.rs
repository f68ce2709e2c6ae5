use super::*;
use crate::mesh::Vert;
use crate::mesh::tests::mesh;
use crate::tags::Tags;
use glam::dvec3;

fn noise(i: usize, j: usize) -> f64 {
    ((12.9898 * i as f64 + 78.233 * j as f64).sin() * 43758.5453).fract()
}

/// A sheet of 24 by 24 vertices, rough and uneven enough for everything, and ways for the new vertices of any length
/// up to the one given.
fn rough() -> (Mesh, impl Fn(f64, usize) -> DVec3) {
    let n = 24;
    let point = |k: usize| {
        let (i, j) = (k / n, k % n);
        let roughness = 0.6 * (i as f64 / n as f64);
        [i as f64 + 0.4 * noise(i, j), j as f64 + 0.4 * noise(j, i + 7), roughness * noise(i + 3, j)]
    };
    let faces = (0..n * (n - 1)).filter(|k| k % n != n - 1);
    let faces = faces.flat_map(|k| [[k, k + n, k + n + 1], [k, k + n + 1, k + 1]]).collect::<Vec<_>>();
    let shift = |farthest: f64, k| farthest * noise(k, 1) * dvec3(noise(k, 2), noise(k, 3), noise(k, 4));
    (mesh(&(0..n * n).map(point).collect::<Vec<_>>(), &faces), shift)
}

#[test]
fn faces_that_are_passed_over_have_nothing_to_object_to() {
    let (mesh, shift) = rough();
    let middles = Middles::of(&mesh).unwrap();
    let stencils = Stencils::new(&mesh, &Tags::default());
    let (mut n_passed_over, mut n_objecting) = (0, 0);
    for farthest in [0.003, 0.03, 0.1, 0.3] {
        let shifts = (0..middles.edges.len()).map(|k| shift(farthest, k));
        let points = mesh.points().iter().copied().chain(shifts).collect();
        let draft = Draft::new(&mesh, &stencils, &middles, points);
        let motions: PerFace<Motion> = mesh.face_ids().map(|f| draft.motion(f)).collect::<Vec<_>>().into();
        for f in mesh.face_ids() {
            let (looks, objects) = (draft.may_object(f, &motions), draft.objections(f).next().is_some());
            assert!(looks || !objects, "{f:?} at {farthest}");
            n_passed_over += usize::from(!looks);
            n_objecting += usize::from(objects);
        }
    }
    assert!(n_passed_over > 300 && n_objecting > 300, "{n_passed_over} {n_objecting}");
}

/// Hands on a draft of `mesh` whose new vertices are moved from the middles of the edges of these half-edges.
fn with_draft<T>(mesh: &Mesh, sharp: &[[usize; 2]], moved: &[(usize, DVec3)], ask: impl Fn(Draft) -> T) -> T {
    let middles = Middles::of(mesh).unwrap();
    let stencils = Stencils::new(mesh, &Tags::new(sharp.iter().map(|edge| edge.map(Vert::new)), []));
    let mut points = mesh.points().to_vec();
    points.resize(mesh.n_verts() + middles.edges.len(), DVec3::ZERO);
    for &(i, shift) in moved {
        points[mesh.n_verts() + middles.slot(Half::new(i)).unwrap()] = shift;
    }
    ask(Draft::new(mesh, &stencils, &middles, points))
}

/// What the first face objects to, ascending.
fn objections(mesh: &Mesh, sharp: &[[usize; 2]], moved: &[(usize, DVec3)]) -> Vec<usize> {
    with_draft(mesh, sharp, moved, |draft| {
        let mut halves: Vec<usize> = draft.objections(Face::new(0)).map(Half::index).collect();
        halves.sort_unstable();
        halves.dedup();
        halves
    })
}

// 2
// | `.        x, y, z on 0-1, 1-2, 2-0
// 0---1
fn corner() -> Mesh {
    mesh(&[[0.; 3], [2., 0., 0.], [0., 2., 0.]], &[[0, 1, 2]])
}

#[test]
fn children_turn_by_at_most_45_degrees_against_the_surface() {
    // With x at height t the child at 1 leans by t √2, those at 0 and inside by t.
    let lifted = |t: f64| objections(&corner(), &[], &[(0, t * DVec3::Z)]);
    assert_eq!(lifted(0.70), []);
    assert_eq!(lifted(0.72), [0, 1], "those at the child that leans too much");
    assert_eq!(lifted(1.01), [0, 1, 2], "the inner child has them all");
}

#[test]
fn children_turn_by_at_most_60_degrees_against_their_parent() {
    // A second face over 0-1 whose area with that of the first is (0, 100, 0): the surface leans by 90 degrees.
    let points = [[0.; 3], [2., 0., 0.], [0., 2., 0.], [1., 2., 50.]];
    let m = mesh(&points, &[[0, 1, 2], [1, 0, 3]]);
    let lifted = |t: f64| objections(&m, &[], &[(0, t * DVec3::Z)]);
    assert_eq!(lifted(1.2), [], "59.5 degrees at 1");
    assert_eq!(lifted(1.25), [0, 1], "60.5 degrees");
}

#[test]
fn a_child_without_area_is_turned() {
    assert_eq!(objections(&corner(), &[], &[(0, -DVec3::X)]), [0, 2], "x lies on 0");
}

#[test]
fn children_fold_by_at_most_150_degrees_within_a_face() {
    // y is in front of 0-1: the child at 1 lies on its back, a little out of the plane of the inner one.
    assert_eq!(objections(&corner(), &[], &[(1, dvec3(0.5, -1.1, 0.03))]), [0, 1, 2]);
    // Turned as well, but to one side of its neighbour.
    assert_eq!(objections(&corner(), &[], &[(1, dvec3(0.5, -1.1, 0.25))]), [0, 1]);
}

/// Two faces that fold by `degrees` at their sharp edge 0-1, the second below the first.
fn wedge(degrees: f64) -> Mesh {
    let (sine, cosine) = degrees.to_radians().sin_cos();
    let points = [[0.; 3], [2., 0., 0.], [1., 2., 0.], [1., -2.0 * cosine, -2.0 * sine]];
    mesh(&points, &[[0, 1, 2], [1, 0, 3]])
}

#[test]
fn children_fold_by_at_most_150_degrees_across_an_edge_unless_their_parents_do() {
    let sharp = [[0, 1]];
    let moved =
        |degrees: f64, i: usize, height: f64| objections(&wedge(degrees), &sharp, &[(i, height * DVec3::Z)]);
    // The second face's half-edges are 3 to 5; those at 0 are 3 and 4. With z (on 2-0) down by 0.6 the child at 0
    // folds by 31 degrees more than its parent.
    assert_eq!(moved(120.0, 2, -0.56), []);
    assert_eq!(moved(120.0, 2, -0.60), [0, 2, 4]);
    assert_eq!(moved(120.0, 1, -0.56), []);
    assert_eq!(moved(120.0, 1, -0.60), [0, 1, 5], "at 1 it is y, and 3-1 on the other side");
    // Half of it on either side at 0: (0, .87, .5) is the second face's own way down.
    let both = |height: f64| {
        let own_down = dvec3(0.0, -0.75f64.sqrt(), -0.5);
        objections(&wedge(120.0), &sharp, &[(2, height * DVec3::Z), (4, height * own_down)])
    };
    assert_eq!(both(-0.25), []);
    assert_eq!(both(-0.30), [0, 2, 4]);
    // What is folded already may be folded as much, not more.
    assert_eq!(moved(160.0, 2, 0.05), []);
    assert_eq!(moved(160.0, 2, -0.05), [0, 2, 4]);
}

#[test]
fn a_face_that_is_off_its_surface_may_stay_as_far_off() {
    // Without a cut the surface of a wedge is 60 degrees from both faces.
    assert_eq!(objections(&wedge(120.0), &[], &[]), []);
    // One degree more is too much.
    assert_eq!(objections(&wedge(120.0), &[], &[(2, -0.02 * DVec3::Z)]), [0, 1, 2]);
}

#[test]
fn a_vertex_halves_its_way_three_times_at_most_and_then_stays_in_the_middle() {
    let left = |t: f64| {
        with_draft(&corner(), &[], &[(0, t * DVec3::Z)], |mut draft| {
            let n_retreated = draft.retreat();
            let slot = draft.middles.slot(Half::new(0)).unwrap();
            let way = draft.settled.way(slot);
            let points = draft.into_settled().into_points(&corner(), &[0, 1, 2].map(Half::new));
            assert_eq!(points[3], dvec3(1.0, 0.0, 0.0) + way);
            (n_retreated, way.z)
        })
    };
    // The other vertices of the child at 1 are asked to retreat as well, from nowhere.
    assert_eq!(left(0.7), (0, 0.7));
    assert_eq!(left(1.2).1, 0.6);
    assert_eq!(left(2.0).1, 0.5);
    assert_eq!(left(100.0), (3, 0.0));
}

#[test]
fn faces_whose_children_turn_far_are_not_calm() {
    let motion =
        |moved: &[(usize, DVec3)]| with_draft(&corner(), &[], moved, |draft| draft.motion(Face::new(0)));
    assert!(motion(&[]) == Motion::Still);
    assert!(motion(&[(0, 0.2 * DVec3::Z)]) == Motion::Calm, "16 degrees");
    // x up and y down: the child at 1 leans by 28 degrees.
    assert!(motion(&[(0, 0.24 * DVec3::Z), (1, -0.24 * DVec3::Z)]) == Motion::Far);
}

#[test]
fn in_the_end_no_face_objects_that_could_be_helped() {
    let (mesh, shift) = rough();
    let n = 24;
    let sharp: Vec<[usize; 2]> = (0..n - 1).map(|i| [n * i + 9, n * (i + 1) + 9]).collect();
    let middles = Middles::of(&mesh).unwrap();
    let stencils = Stencils::new(&mesh, &Tags::new(sharp.iter().map(|edge| edge.map(Vert::new)), []));
    for farthest in [0.1, 0.3, 1.0] {
        let shifts = (0..middles.edges.len()).map(|k| shift(farthest, k));
        let points = mesh.points().iter().copied().chain(shifts).collect();
        let mut draft = Draft::new(&mesh, &stencils, &middles, points);
        let n_retreated = draft.retreat();
        assert!(n_retreated > 50, "{n_retreated}");
        for h in mesh.face_ids().flat_map(|f| draft.objections(f)) {
            let n = draft.settled.objections[draft.middles.slot(h).unwrap()];
            assert_eq!(usize::from(n) + 1, WAY_LEFT.len(), "{h:?} at {farthest}");
        }
    }
}
