//! Each operation on small meshes: what allows it, what it gains, and which one is chosen.

use super::*;
use crate::untangle::tests::{Scene, assert_near, face, roof, roof_with};
use glam::dvec3;

fn v(i: usize) -> Vert {
    Vert::new(i)
}

// 2---4---0    Edge 4-5 is to be flipped; face 4-5-0 is turned over where 5 is beyond 0.
//  `. |`. |`.
//     1---5---3
const STRIP: [[usize; 3]; 4] = [[4, 5, 0], [5, 4, 1], [1, 4, 2], [0, 5, 3]];

fn strip(faces: &[[usize; 3]], creases: &[[usize; 2]]) -> Scene {
    let points = [[1., 1., 0.], [0., 0., 0.], [-1., 1., 0.], [2., 0., 0.], [0., 1., 0.], [1., 0., 0.]];
    Scene::new(&points, faces, 4, creases).with_plane(0..4, DVec3::Z).moved(&[(5, [2., 1.5, 0.])])
}

#[test]
fn a_flip_turns_a_face_back() {
    let (gain, faces, triangles) =
        strip(&STRIP, &[]).run(|zone| zone.try_flip(Face::new(0), v(4), v(5))).unwrap();
    assert_near(gain, 2.5);
    assert_eq!((faces, triangles), ([0, 1].map(Face::new), [[4, 1, 0], [1, 5, 0]].map(|t| t.map(v))));
    let nothing_wrong = strip(&STRIP, &[]).moved(&[(5, [1., 0., 0.])]);
    assert!(nothing_wrong.run(|zone| zone.try_flip(Face::new(0), v(4), v(5))).is_none());
}

#[test]
fn no_flip_crosses_a_crease() {
    assert!(strip(&STRIP, &[[4, 5]]).run(|zone| zone.try_flip(Face::new(0), v(4), v(5))).is_none());
}

#[test]
fn no_flip_takes_an_edge_from_a_vertex_with_three_neighbours() {
    for faces in [&STRIP[..3], &[STRIP[0], STRIP[1], STRIP[3]]] {
        assert!(strip(faces, &[]).run(|zone| zone.try_flip(Face::new(0), v(4), v(5))).is_none());
    }
}

// The same strip with the other diagonal along a right-angled edge: 4 is on its upper side, 5 on the other.
#[test]
fn a_flipped_face_may_follow_the_fit_of_the_other() {
    let points = [[0., 1., 0.], [0., 0., 0.], [-1., 0., 0.], [0., 1., -1.], [-1., 0.5, 0.], [0., 0.5, -1.]];
    let points = points.map(|p| p.map(|c| 0.1 * c));
    let faces_with = |fits: [DVec3; 2]| {
        let scene = Scene::new(&points, &STRIP, 6, &[]);
        let scene = scene.with_plane(0..1, fits[0]).with_plane(1..2, fits[1]);
        let (gain, faces, _) = scene.run(|zone| zone.try_flip(Face::new(0), v(4), v(5))).unwrap();
        assert_near(gain, 2.0 * (1.5 - 1.0 / 6.0_f64.sqrt()));
        faces
    };
    assert_eq!(faces_with([DVec3::Z, DVec3::X]), [0, 1].map(Face::new));
    assert_eq!(faces_with([DVec3::X, DVec3::Z]), [1, 0].map(Face::new));
}

/// The roof with crease vertex 42 beyond 43: two faces are turned over.
fn tangled() -> Scene {
    roof().moved(&[(42, [3.2, 0., 0.])])
}

fn collapse_gain(scene: &Scene, gone: usize, kept: usize) -> Option<f64> {
    scene.run(|zone| zone.try_collapse(v(gone), v(kept), false))
}

#[test]
fn a_crease_vertex_beyond_the_next_one_is_collapsed_along_its_crease_only() {
    assert_near(collapse_gain(&tangled(), 42, 43).unwrap(), 5.0);
    assert_eq!(collapse_gain(&tangled(), 42, 33), None, "off the crease");
    assert_eq!(collapse_gain(&roof(), 42, 43), None, "nothing gained");
    assert!(roof().run(|zone| zone.try_collapse(v(42), v(43), true)).is_some());
}

#[test]
fn no_collapse_takes_a_face_off_its_fit() {
    // Off both sides by the rise over the square root of two; the middle of 41-43 stays on both.
    let with_rise = |z: f64| tangled().moved(&[(43, [3., 0., z]), (41, [1., 0., -z])]);
    assert!(collapse_gain(&with_rise(0.13), 42, 43).is_some());
    assert_eq!(collapse_gain(&with_rise(0.15), 42, 43), None);
}

#[test]
fn the_middle_of_a_joined_crease_edge_lies_on_its_fits() {
    let with_rise = |z: f64| tangled().moved(&[(43, [3., 0., 0.13]), (41, [1., 0., z])]);
    assert!(collapse_gain(&with_rise(0.0), 42, 43).is_some());
    assert_eq!(collapse_gain(&with_rise(0.03), 42, 43), None, "0.08 over the square root of two");
}

#[test]
fn no_collapse_makes_two_creases_one() {
    let with = |creases: &[[usize; 2]]| roof_with(1.0, 30, creases).moved(&[(42, [3.2, 0., 0.])]);
    assert!(collapse_gain(&with(&[[42, 43], [42, 33]]), 42, 43).is_some());
    assert_eq!(collapse_gain(&with(&[[42, 43], [42, 33], [43, 33]]), 42, 43), None);
}

#[test]
fn corners_vertices_without_a_label_and_those_outside_are_not_collapsed() {
    let corner = roof_with(1.0, 30, &[[41, 42], [42, 43], [42, 33]]).moved(&[(42, [3.2, 0., 0.])]);
    assert_eq!(collapse_gain(&corner, 42, 43), None);
    let collapses = |scene: Scene| scene.run(|zone| zone.try_collapse(v(13), v(43), true)).is_some();
    assert!(collapses(roof()));
    assert!(!collapses(roof().without_fit(13..14)));
    assert!(!collapses(roof().split_at(0..2)), "no face of 13 was split");
}

#[test]
fn two_crease_vertices_merge_between_them_on_their_crease() {
    // Both are above the crease.
    let scene = roof().moved(&[(42, [3.2, 0., 0.1]), (43, [3., 0., 0.1])]);
    let (gain, to) = scene.run(|zone| zone.try_merge(v(42), v(43))).unwrap();
    assert!(gain > 4.0 && to.distance(dvec3(3.1, 0., 0.)) < 1e-12, "{gain} {to}");
    assert!(scene.run(|zone| zone.try_merge(v(42), v(44))).is_none(), "no crease edge");
    assert!(scene.off_feature().run(|zone| zone.try_merge(v(42), v(43))).is_none(), "they are on no crease");
}

#[test]
fn corners_merge_where_they_nearly_coincide() {
    let creases = [[41, 42], [42, 43], [43, 44], [42, 32], [43, 34]];
    let merged = |p: [f64; 3], q: [f64; 3]| {
        let scene = roof_with(1.0, 30, &creases).moved(&[(42, p), (43, q)]);
        scene.run(|zone| zone.try_merge(v(42), v(43))).map(|(_, to)| to.to_array())
    };
    assert_eq!(merged([3.24, 0., 0.], [3., 0., 0.]), Some([3., 0., 0.]), "the one that stays has its way");
    assert_eq!(merged([3.26, 0., 0.], [3., 0., 0.]), None, "too far apart");
    assert_eq!(merged([2., 0., 0.], [1.9, 0., 0.15]), Some([2., 0., 0.]), "the other one is off its fits");
}

#[test]
fn a_vertex_moves_back_as_far_as_helps() {
    // Without fits; past 43 the two faces beside 42-43 are turned over.
    let flat = || roof_with(0.0, 40, &[]).without_fit(0..40);
    let back = |to: [f64; 3]| {
        flat().moved(&[(42, to)]).run(|zone| zone.try_back(v(42))).map(|(gain, to)| (gain, to.to_array()))
    };
    let (gain, to) = back([3.5, 0., 0.]).unwrap();
    assert_near(gain, 5.0);
    assert_eq!(to, [2.75, 0., 0.], "half of the way; all of it gains no more");
    assert_eq!(back([2., 0., 10.]).unwrap().1, [2., 0., 0.], "the nearer the better");
    assert_eq!(back([2.9, 0., 0.]), None, "nothing is wrong");
    assert_eq!(flat().run(|zone| zone.try_back(v(32))).map(|(gain, _)| gain), None, "an old vertex");
}

#[test]
fn what_gains_less_than_half_a_bad_face_moves_nothing_back() {
    let scene = roof_with(0.0, 40, &[]).without_fit(0..40).moved(&[(42, [2.985, 0., 0.])]);
    scene.run(|zone| {
        zone.slivers_count = true;
        assert!(zone.value_of(face(zone, [42, 43, 33])) > 0.2);
        assert!(zone.try_back(v(42)).is_none());
    });
}

#[test]
fn of_several_operations_the_one_that_gains_most_wins() {
    // With old vertex 12 beyond the crease too, 42 does not just have to go but to keep left of it.
    let scene = tangled().moved(&[(42, [3.2, 0., 0.]), (12, [2., 0.1, -0.1])]);
    scene.run(|zone| {
        let respaced = zone.try_respace(v(42)).unwrap().0;
        let others = [
            zone.try_collapse(v(42), v(43), false),
            zone.try_collapse(v(43), v(42), false),
            zone.try_merge(v(42), v(43)).map(|(gain, _)| gain),
            zone.try_run(v(42), v(43)).map(|(gain, ..)| gain),
            zone.try_respace(v(43)).map(|(gain, _)| gain),
        ];
        assert!(others.iter().all(|gain| gain.is_some_and(|gain| gain < respaced - 0.5)), "{others:?}");
        let best = zone.best_operation(face(zone, [42, 43, 33]), true).unwrap();
        let Operation::Respace { vertices, to } = best else { panic!("{best:?}") };
        assert_eq!((vertices, to), (vec![v(42)], vec![dvec3(1.5, 0., 0.)]));
    });
}

#[test]
fn of_equal_gains_the_gentler_operation_wins() {
    tangled().run(|zone| {
        assert_near(zone.try_respace(v(42)).unwrap().0, 5.0);
        assert_near(zone.try_merge(v(42), v(43)).unwrap().0, 5.0);
        let best = zone.best_operation(face(zone, [42, 43, 33]), true).unwrap();
        let Operation::Collapse { gone, kept } = best else { panic!("{best:?}") };
        assert_eq!((gone, kept), (v(42), v(43)), "either way gains the same");
    });
}

#[test]
fn a_vertex_moves_back_only_where_nothing_else_helps() {
    // A spike with creases all round: nothing may collapse, merge, slide or flip.
    let creases = [41, 43, 11, 12, 32, 33].map(|w| [w, 42]);
    let spike = roof_with(0.0, 10, &creases).without_fit(0..40).moved(&[(42, [2., 0., 10.])]);
    spike.run(|zone| {
        let f = face(zone, [42, 43, 33]);
        assert!(zone.best_operation(f, false).is_none());
        let best = zone.best_operation(f, true).unwrap();
        let Operation::MoveBack { vertex, to } = best else { panic!("{best:?}") };
        assert_eq!((vertex, to), (v(42), dvec3(2., 0., 0.)));
    });
    // Any other operation comes first, also one that gains less.
    let few = roof_with(0.0, 10, &creases[1..]).without_fit(0..40).moved(&[(42, [2., 0., 10.])]);
    few.run(|zone| {
        let f = face(zone, [41, 42, 32]);
        let best = zone.best_operation(f, true).unwrap();
        assert!(matches!(best, Operation::Flip { .. }), "{best:?}");
    });
}

#[test]
fn what_is_carried_out_is_counted_and_leaves_nothing_bad() {
    let done = |operation: Operation| {
        tangled().run(|zone| {
            let mut counts = UntangleCounts::default();
            assert_eq!(zone.bad_faces().len(), 2);
            let touched = zone.apply(operation.clone(), &mut counts);
            assert!(touched.iter().all(|&f| zone.value_of(f) == 0.0), "{operation:?}");
            assert_eq!(zone.bad_faces(), []);
            let creases = [41, 43].map(|w| zone.crease(v(w)).iter().map(|w| w.index()).collect::<Vec<_>>());
            (counts, creases, zone.edit.point(v(43)).x)
        })
    };
    let (gone, kept) = (v(42), v(43));
    let (none, whole) = (UntangleCounts::default(), [vec![40, 42], vec![42, 44]]);
    let joined = [vec![40, 43], vec![41, 44]];
    let collapsed = UntangleCounts { collapsed: 1, ..none };
    assert_eq!(done(Operation::Collapse { gone, kept }), (collapsed, joined.clone(), 3.0));
    let to = dvec3(2.5, 0., 0.);
    assert_eq!(done(Operation::Merge { gone, kept, to }), (collapsed, joined, 2.5));
    let run = Operation::Respace { vertices: vec![gone, kept], to: vec![2.0 * DVec3::X, to] };
    assert_eq!(done(run), (UntangleCounts { respaced: 2, ..none }, whole.clone(), 2.5));
    let back = Operation::MoveBack { vertex: gone, to };
    assert_eq!(done(back), (UntangleCounts { moved_back: 1, ..none }, whole, 3.0));
    strip(&STRIP, &[]).run(|zone| {
        let mut counts = UntangleCounts::default();
        let (_, faces, triangles) = zone.try_flip(Face::new(0), v(4), v(5)).unwrap();
        zone.apply(Operation::Flip { faces, triangles }, &mut counts);
        assert_eq!(counts, UntangleCounts { flipped: 1, ..none });
        assert_eq!(faces.map(|f| zone.edit.corners(f)), triangles);
    });
}

#[test]
fn a_candidate_is_before_another_by_gain_then_rank_then_length_then_vertices() {
    let candidate = |(gain, rank, length_squared, first): (i64, u8, f64, usize)| {
        let operation = Operation::MoveBack { vertex: v(0), to: DVec3::ZERO };
        Candidate { gain, rank, length_squared, vertices: [v(first), v(9)], operation }
    };
    let ordered = [(3, 9, 9., 9), (2, 1, 9., 9), (2, 2, 1., 9), (2, 2, 2., 1), (2, 2, 2., 2)].map(candidate);
    for (i, j) in (0..5).flat_map(|i| (0..5).map(move |j| (i, j))) {
        assert_eq!(ordered[i].is_before(&ordered[j]), i < j, "{i} {j}");
    }
}

#[test]
fn a_face_that_was_off_its_fit_may_stay_so() {
    // The middle of 41-43 is on both sides.
    let with_rise = |old: f64, new: f64| {
        let scene = tangled().moved(&[(42, [3.2, 0., old]), (41, [1., 0., -new]), (43, [3., 0., new])]);
        collapse_gain(&scene, 42, 43).is_some()
    };
    assert!(!with_rise(0.0, 0.2));
    assert!(with_rise(0.201, 0.2));
}

#[test]
fn a_merged_vertex_keeps_its_creases_on_their_fits() {
    // The middle of the edge to 41 would be off by half the rise over the square root of two.
    let merges =
        |z: f64| tangled().moved(&[(41, [1., 0., z])]).run(|zone| zone.try_merge(v(42), v(43))).is_some();
    assert!(merges(0.13) && !merges(0.15));
}

#[test]
fn corners_merge_along_a_crease_inside_the_mesh_only() {
    // 33 is on the wrong side of crease 41-42-43, near 42.
    let corners = [[41, 42], [42, 43], [42, 11], [33, 34], [33, 23], [33, 32]];
    let merges = |creases: &[[usize; 2]]| {
        let scene = roof_with(0.0, 10, &[&corners, creases].concat()).without_fit(0..40);
        scene.moved(&[(33, [2.1, -0.1, 0.])]).run(|zone| zone.try_merge(v(33), v(42))).is_some()
    };
    assert!(merges(&[[42, 33]]));
    assert!(!merges(&[]), "no crease joins them");
    assert!(!merges(&[[42, 33], [42, 32]]), "creases 42-32 and 33-32 would become one");
    // 41 is beyond 40, a vertex of the border.
    let corners = [[40, 41], [40, 10], [40, 30], [41, 42], [41, 11]];
    let border = roof_with(0.0, 10, &corners).without_fit(0..40).moved(&[(41, [-0.1, 0., 0.])]);
    assert!(border.run(|zone| zone.try_merge(v(41), v(40))).is_none());
    assert!(border.run(|zone| zone.try_merge(v(40), v(41))).is_none());
}

#[test]
fn a_collapse_lets_its_faces_be_looked_at_anew() {
    // Old vertex 12 is beyond the crease: face 12-43-42 is turned over.
    roof().moved(&[(12, [2., 0.1, -0.1])]).run(|zone| {
        let f = face(zone, [12, 43, 42]);
        assert!(zone.bad_faces().contains(&f) && zone.value_of(f) > 0.0);
        zone.collapse(v(12), v(11));
        assert_eq!(zone.edit.corners(f), [11, 43, 42].map(v));
        assert_eq!(zone.value_of(f), 0.0);
    });
}
