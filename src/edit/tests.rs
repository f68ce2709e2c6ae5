use super::*;
use crate::mesh::Half;
use crate::mesh::tests::mesh;
use crate::refine::{Inserts, refine};

/// A regular hexagon round vertex 0, refined without inserts.
fn hexagon() -> (Mesh, Inserts, Refined) {
    let mut points = vec![[0., 0., 0.]];
    points.extend((0..6).map(|i| {
        let angle = f64::from(i) * std::f64::consts::FRAC_PI_3;
        [angle.cos(), angle.sin(), 0.]
    }));
    let faces: Vec<_> = (0..6).map(|i| [0, 1 + i, 1 + (i + 1) % 6]).collect();
    let m = mesh(&points, &faces);
    let inserts = Inserts::none();
    let refined = refine(&m, &inserts).unwrap();
    (m, inserts, refined)
}

pub(super) fn all_whole(m: &Mesh) -> PerVert<bool> {
    PerVert::filled(m.n_verts(), true)
}

pub(super) fn v(i: usize) -> Vert {
    Vert::new(i)
}

#[test]
fn a_collapse_removes_two_faces_and_frees_a_slot_for_an_inserted_vertex() {
    let (m, inserts, refined) = hexagon();
    // Pretend that vertices 5 and 6 were inserted.
    let is_whole = all_whole(&m);
    let mut edit = Edit::new(&refined, 5, &is_whole);
    assert!(edit.collapsible(v(1), v(0)).is_none(), "a border vertex stays");
    assert!(edit.collapsible(v(0), v(1)).is_none(), "its neighbours would keep too few");
    let others = edit.collapse(v(0), v(1));
    assert_eq!(others, [1, 2, 3, 4].map(Face::new));
    let edited = edit.finish(&m, &inserts, |v| v, true).unwrap();
    let faces: Vec<_> = edited.mesh.faces().iter().map(|f| f.map(Vert::index)).collect();
    // Vertex 6 takes slot 0.
    assert_eq!(faces, [[1, 2, 3], [1, 3, 4], [1, 4, 5], [1, 5, 0]]);
    assert_eq!(edited.mesh.point(v(0)), m.point(v(6)));
    assert_eq!(edited.replaced, [v(0)]);
    assert_eq!(edited.now.as_slice(), [1, 1, 2, 3, 4, 5, 0].map(v));
    assert_eq!(edited.lineage.parents.as_slice(), [1, 2, 3, 4].map(Face::new));
    assert_eq!(edited.lineage.corners[Half::new(0)], Place::Foreign);
    assert_eq!(edited.lineage.foreign.len(), 4);
}

#[test]
fn where_no_inserted_vertex_is_left_to_take_a_slot_the_old_one_stays_without_a_face() {
    let (m, inserts, refined) = hexagon();
    let is_whole = all_whole(&m);
    let mut edit = Edit::new(&refined, 6, &is_whole);
    edit.collapse(v(0), v(1));
    edit.collapse(v(1), v(6));
    let edited = edit.finish(&m, &inserts, |v| v, true).unwrap();
    // The inserted vertex 6 takes the slot of 0, and nobody that of 1.
    assert_eq!(edited.replaced, [v(0), v(1)]);
    assert_eq!((edited.mesh.n_verts(), edited.mesh.point(v(0))), (6, m.point(v(6))));
    assert_eq!(edited.now.as_slice(), [0, 0, 2, 3, 4, 5, 0].map(v));
    assert!(edited.mesh.leaving(v(1)).is_empty() && !edited.mesh.faces().is_empty());
}

#[test]
fn a_flip_takes_the_other_diagonal() {
    let (m, inserts, refined) = hexagon();
    let is_whole = all_whole(&m);
    let mut edit = Edit::new(&refined, 7, &is_whole);
    let [f, g] = edit.faces_beside(v(0), v(2)).unwrap();
    assert_eq!([f, g], [Face::new(1), Face::new(0)]);
    edit.flip([f, g], [[v(1), v(2), v(3)], [v(1), v(3), v(0)]]);
    assert_eq!(edit.link(v(0)), [1, 3, 4, 5, 6].map(v));
    assert_eq!(edit.link(v(1)), [0, 2, 3, 6].map(v));
    let edited = edit.finish(&m, &inserts, |v| v, true).unwrap();
    assert_eq!(edited.mesh.corners(Face::new(1)), [v(1), v(2), v(3)]);
    assert_eq!(edited.now.as_slice(), [0, 1, 2, 3, 4, 5, 6].map(v));
}

//     2        The edge from 0 to 1 is split. Without the edge from 2 to 3 the two halves of face 2 0 1
//   / | \      have 2 1 0 at their back.
//  0--+--1
//   \ | /      3 in front, or 3 and 4
//     3
#[test]
fn no_edit_turns_a_face_over() {
    let points = [[0., 0., 0.], [2., 0., 0.], [1., 2., 0.], [1., 0., 1.], [0., 0., 1.]];
    let tetrahedron: &[[usize; 3]] = &[[2, 0, 1], [2, 1, 3], [2, 3, 0], [0, 3, 1]];
    let pyramid: &[[usize; 3]] = &[[2, 0, 1], [2, 1, 3], [2, 3, 4], [2, 4, 0], [0, 3, 1], [0, 4, 3]];
    for (faces, kept, flipped) in [(tetrahedron, 0, None), (pyramid, 4, Some([[2, 1, 4], [1, 3, 4]]))] {
        let n_old = faces.len() / 2 + 2;
        let m = mesh(&points[..n_old], faces);
        let split = m.edge(m.half_between(v(0), v(1)).unwrap());
        let refined = refine(&m, &Inserts::in_the_middle(&m, |h| m.edge(h) == split, &[])).unwrap();
        let is_whole = all_whole(&refined.mesh);
        let edit = Edit::new(&refined, n_old, &is_whole);
        let beside = edit.faces_beside(v(2), v(3)).unwrap();
        assert_eq!(edit.flippable(beside, v(2), v(3)), flipped.map(|f| f.map(|t| t.map(v))));
        assert_eq!(edit.collapsible(v(3), v(kept)).is_some(), flipped.is_some());
        assert!(edit.is_turned([v(2), v(1), v(0)]) && edit.is_turned([v(0), v(2), v(1)]));
        assert!(!edit.is_turned([v(2), v(0), v(1)]) && !edit.is_turned([v(2), v(1), v(n_old)]));
    }
}

#[test]
fn misoriented_faces_are_not_beside_an_edge() {
    let m = mesh(&[[0.; 3], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]], &[[0, 1, 2], [0, 1, 3]]);
    let refined = refine(&m, &Inserts::none()).unwrap();
    let is_whole = all_whole(&m);
    let edit = Edit::new(&refined, 4, &is_whole);
    assert_eq!(edit.faces_beside(v(0), v(1)), None);
    assert!(!edit.is_surrounded(v(0)));
}
