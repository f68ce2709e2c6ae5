use super::*;
use glam::dvec3;

/// A mesh from plain numbers, checked.
pub(crate) fn mesh(points: &[[f64; 3]], faces: &[[usize; 3]]) -> Mesh {
    let points = points.iter().map(|&p| DVec3::from(p)).collect();
    let faces = faces.iter().map(|f| f.map(Vert::new)).collect();
    let mesh = Mesh::new(points, faces).expect("a test's mesh is sound");
    mesh.check().expect("a new mesh holds its invariant");
    mesh
}

/// `n` points that no two faces' tests care about the place of.
fn anywhere(n: usize) -> Vec<[f64; 3]> {
    (0..n).map(|i| [i as f64, (i * i) as f64, (i * i * i) as f64]).collect()
}

fn twins(mesh: &Mesh) -> Vec<Option<usize>> {
    mesh.halves().map(|h| mesh.twin(h).map(Half::index)).collect()
}

// 3---2
// | / |
// 0---1
#[test]
fn two_triangles_share_one_edge() {
    let m = mesh(&anywhere(4), &[[0, 1, 2], [0, 2, 3]]);
    assert_eq!(twins(&m), [None, None, Some(3), Some(2), None, None]);
    assert_eq!(m.edges().map(Half::index).collect::<Vec<_>>(), [0, 1, 2, 4, 5]);
    assert_eq!(m.leaving(Vert::new(0)), [Half::new(0), Half::new(3)]);
    assert_eq!(m.leaving(Vert::new(2)), [Half::new(2), Half::new(4)]);
    assert_eq!(m.rotate_ccw(Half::new(0)), Some(Half::new(3)));
    assert_eq!(m.rotate_cw(Half::new(3)), Some(Half::new(0)));
    assert_eq!(m.rotate_cw(Half::new(0)), None);
    assert_eq!(m.half_between(Vert::new(2), Vert::new(0)), Some(Half::new(2)));
    assert_eq!(m.half_between(Vert::new(1), Vert::new(3)), None);
    assert_eq!(m.defects(), EdgeDefects::default());
}

#[test]
fn a_tetrahedron_is_closed() {
    let m = mesh(&anywhere(4), &[[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]);
    assert!(m.halves().all(|h| !m.is_border(h)));
    assert_eq!(m.edges().count(), 6);
}

#[test]
fn three_faces_on_one_edge_are_borders_there_and_counted() {
    let m = mesh(&anywhere(5), &[[0, 1, 2], [1, 0, 3], [0, 1, 4]]);
    assert!(m.halves().all(|h| m.is_border(h)));
    assert_eq!(m.defects().non_manifold_edges, 1);
}

#[test]
fn two_faces_that_disagree_are_borders_and_counted() {
    let m = mesh(&anywhere(4), &[[0, 1, 2], [0, 1, 3]]);
    assert!(m.halves().all(|h| m.is_border(h)));
    assert_eq!(m.defects().misoriented_edges, 1);
}

#[test]
fn a_doubled_face_shares_no_edge_with_its_copy() {
    let m = mesh(&anywhere(3), &[[0, 1, 2], [0, 1, 2]]);
    assert!(m.halves().all(|h| m.is_border(h)));
    assert_eq!(m.defects().misoriented_edges, 3);
}

#[test]
fn a_face_that_names_a_vertex_twice_leaves_its_neighbours_joined() {
    let m = mesh(&anywhere(4), &[[0, 1, 1], [0, 1, 2], [1, 0, 3]]);
    assert_eq!(m.twin(Half::new(3)), Some(Half::new(6)));
    assert!((0..3).all(|h| m.is_border(Half::new(h))));
    assert_eq!(m.defects().collapsed_faces, 1);
    assert_eq!(m.leaving(Vert::new(1)), [1, 2, 4, 6].map(Half::new));
}

#[test]
fn a_bow_tie_lists_both_fans_of_its_vertex() {
    let m = mesh(&anywhere(5), &[[0, 1, 2], [0, 3, 4]]);
    assert_eq!(m.leaving(Vert::new(0)), [Half::new(0), Half::new(3)]);
    assert_eq!(m.rotate_ccw(Half::new(0)), None);
}

#[test]
fn a_moebius_strip_has_one_seam_of_borders() {
    // Five triangles round a strip with one half twist; the closing edge 0-1 disagrees.
    let m = mesh(&anywhere(5), &[[0, 1, 2], [2, 1, 3], [2, 3, 4], [4, 3, 0], [4, 0, 1]]);
    assert_eq!(m.defects().misoriented_edges, 1);
}

#[test]
fn empty_and_unused_are_meshes_too() {
    assert_eq!(mesh(&[], &[]).diagonal(), 0.0);
    let m = mesh(&[[9., 9., 9.], [0., 0., 0.], [3., 0., 0.], [0., 4., 0.]], &[[1, 2, 3]]);
    assert_eq!(m.diagonal(), 5.0, "an unused vertex does not count");
    assert!(m.leaving(Vert::new(0)).is_empty());
}

#[test]
fn who_makes_twins_may_come_upon_someone_who_asks_for_them() {
    // While a thread waits for its share of the work it takes up others, which may ask for what it makes.
    let (done, is_done) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        let cell = OnceLock::new();
        let made = made_once(&cell, || 1 + *made_once(&cell, || 1));
        done.send((*made, cell.get().copied())).unwrap();
    });
    let made = is_done.recv_timeout(std::time::Duration::from_secs(60)).expect("it waits for itself");
    assert_eq!(made, (1, Some(1)), "what is there first stays");
}

#[test]
fn a_face_out_of_range_is_refused() {
    let error = Mesh::new(vec![dvec3(0., 0., 0.)], vec![[Vert::new(0), Vert::new(0), Vert::new(7)]]);
    assert_eq!(error.map(|_| ()), Err(MeshError::NoSuchVertex { face: 0, vertex: 7, vertices: 1 }));
}

#[test]
fn twins_are_those_that_a_search_of_all_pairs_finds() {
    // A fan round vertex 0 with more faces than a vertex usually has, and faces at random over it: collapsed,
    // doubled and misoriented ones among them.
    let mut seed = 1u32;
    let mut random = |n: usize| {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (seed >> 16) as usize % n
    };
    for n_random in 0..60 {
        let mut faces: Vec<[usize; 3]> = (1..=20).map(|i| [0, i, i % 20 + 1]).collect();
        faces.extend((0..n_random).map(|_| [0, 1, 2].map(|_| random(12))));
        let m = mesh(&anywhere(21), &faces);
        let (mut non_manifold, mut misoriented) = (0, 0);
        for a in 0..21 {
            for b in a + 1..21 {
                let is_sound = |h: &Half| !has_repeated_vertex(&m.corners(h.face()));
                let runs = |h: &Half, a: usize, b: usize| (m.from(*h).index(), m.to(*h).index()) == (a, b);
                let on_edge: Vec<Half> =
                    m.halves().filter(|h| is_sound(h) && (runs(h, a, b) || runs(h, b, a))).collect();
                match on_edge[..] {
                    [g, h] if m.from(g) == m.to(h) => {
                        assert_eq!((m.twin(g), m.twin(h)), (Some(h), Some(g)));
                        continue;
                    }
                    [_, _] => misoriented += 1,
                    [_, _, ..] => non_manifold += 1,
                    _ => {}
                }
                assert!(on_edge.iter().all(|&h| m.is_border(h)), "{a} {b}");
            }
        }
        let collapsed_faces = m.faces().iter().filter(|face| has_repeated_vertex(face)).count();
        let counts =
            EdgeDefects { non_manifold_edges: non_manifold, misoriented_edges: misoriented, collapsed_faces };
        assert_eq!(m.defects(), counts);
    }
}

#[test]
fn the_edges_of_some_faces_are_those_whose_lower_half_edge_they_have() {
    // A tetrahedron, and three faces on one edge.
    let faces = [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0], [4, 5, 6], [5, 4, 7], [4, 5, 8]];
    let m = mesh(&anywhere(9), &faces);
    let mut edges = vec![Half::NONE; 9];
    for (first, end) in [(0, 7), (0, 2), (2, 5), (3, 3)] {
        m.edges_of(first..end, &mut edges);
        let expected: Vec<Half> = m.edges().filter(|h| (first..end).contains(&h.face().index())).collect();
        assert_eq!(edges, expected, "{first} to {end}");
    }
}

#[test]
fn a_broken_twin_does_not_pass_the_check() {
    let mut m = mesh(&anywhere(4), &[[0, 1, 2], [0, 2, 3]]);
    m.twins();
    m.twins.get_mut().unwrap().of[Half::new(2)] = Half::NONE;
    assert!(m.check().is_err());
    let mut m = mesh(&anywhere(4), &[[0, 1, 2], [0, 2, 3]]);
    m.twins();
    m.faces[Face::new(1)] = [1, 2, 3].map(Vert::new);
    assert!(m.check().is_err());
}
