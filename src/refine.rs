//! Rebuilds a mesh with new vertices on its edges and in its faces.
//!
//! Every split edge splits both its faces, so a face has one of five shapes (new vertices `o`):
//!
//! ```text
//!   no split      a: one edge     b: two edges      c: all, with centre   d: all, without
//!      /\             /|\              /\                   /|\                  /\
//!     /  \           / | \            o--o                 o.|.o                o--o
//!    /    \         /  |  \          / `. \               / `o´ \              / \/ \
//!   /______\       /___o___\        /____`.\             /_.´|`._\            /__o__\
//! ```
//!
//! Based on: Sharpen&Bend section 3.2 and figure 5 (a, b, c), section 4.2 and figure 11 (d).
//! Differs: in case b, where the paper is silent, the quadrilateral takes its shorter diagonal,
//! measured before the new vertices move (a tie goes to the smaller vertex index).
//! Sharpening rebuilds only an excerpt round the split faces and bending splits all faces alike, both for speed; this
//! is what both are held against, and what callers of the library have.
//!
//! In/out: `Mesh` + `Inserts` -> `Refined`; children stand where their parent stood.
//! Cost: O(F), one pass to count and one to write, both parallel.

mod inserts;
mod split;

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use crate::mesh::{Face, Half, Mesh, MeshError, PerFace, PerHalf, Vert, check_size};

pub(crate) use inserts::Knots;
pub use inserts::{Inserts, OnEdge};
pub(crate) use split::{Child, Split, split, split_face};
use split::{creases_of, middles};

/// Where a corner of a new face lies in the face's parent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// At the parent's corner of that number.
    Corner(u8),
    /// In the middle of the parent's half-edge of that number.
    Mid(u8),
    /// At the parent's centroid.
    Centre,
    /// Elsewhere, by a collapse or a flip: [`Lineage::foreign`] has the barycentric coordinates.
    Foreign,
}

/// Where the faces of a rebuilt mesh come from: all that is needed to carry attributes along.
#[derive(Clone, Debug, Default)]
pub struct Lineage {
    /// For each new face the old face that it lies in, ascending. `[F']`
    pub parents: PerFace<Face>,
    /// For each new half-edge where the corner that it leaves lies in the parent. `[3F']`
    pub corners: PerHalf<Place>,
    /// Barycentric coordinates in the parent, for the corners with [`Place::Foreign`], ascending.
    pub foreign: Vec<(Half, [f64; 3])>,
}

impl Lineage {
    /// That of a mesh with the same faces.
    #[must_use]
    pub fn identity(mesh: &Mesh) -> Self {
        let corners = [0, 1, 2].map(Place::Corner);
        Self {
            parents: mesh.face_ids().collect::<Vec<_>>().into(),
            corners: corners.repeat(mesh.n_faces()).into(),
            foreign: Vec::new(),
        }
    }
}

/// A rebuilt mesh.
#[derive(Clone, Debug)]
pub struct Refined {
    /// The new mesh: old vertices first, in their order, then the inserted ones.
    pub mesh: Mesh,
    /// Where its faces come from.
    pub lineage: Lineage,
    /// The new edges that join two inserted vertices within a face (cases b and c, not d): the pieces of
    /// the recovered creases.
    pub creases: Vec<[Vert; 2]>,
    /// Where each inserted vertex would be in the middle of its (moved) edge or face. `[N]`
    pub middles: Vec<DVec3>,
    /// The children of split faces, ascending. All other faces are old ones.
    pub children: Vec<Face>,
}

/// Rebuilds `mesh` with `inserts`.
///
/// # Errors
/// When the new mesh has more elements than the index type can count.
pub fn refine(mesh: &Mesh, inserts: &Inserts) -> Result<Refined, MeshError> {
    let mut points = Vec::with_capacity(mesh.n_verts() + inserts.points.len());
    points.extend_from_slice(mesh.points());
    for &(v, point) in &inserts.moved {
        points[v.index()] = point;
    }
    let split = inserts.on_edge.faces();
    let middles = middles(mesh, inserts, |v| points[v.index()], &split);
    let middle = |v: Vert| match v.index().checked_sub(mesh.n_verts()) {
        Some(i) => middles[i],
        None => points[v.index()],
    };
    let chunks = chunks(mesh, inserts, &split);
    let n_faces = chunks.iter().map(|chunk| chunk.n_new).sum();
    check_size(mesh.n_verts() + inserts.points.len(), n_faces)?;
    let mut faces = vec![[Vert::NONE; 3]; n_faces];
    let mut parents = vec![Face::NONE; n_faces];
    let mut places = vec![[Place::Foreign; 3]; n_faces];
    let mut rest = Out { first: 0, faces: &mut faces, parents: &mut parents, places: &mut places };
    let mut outs = Vec::with_capacity(chunks.len());
    for chunk in &chunks {
        let (out, later) = rest.split(chunk.n_new);
        outs.push(out);
        rest = later;
    }
    let rebuild = |(chunk, out)| rebuild(mesh, inserts, chunk, out, middle);
    let (creases, children): (Vec<_>, Vec<_>) = chunks.into_par_iter().zip(outs).map(rebuild).unzip();
    points.extend_from_slice(&inserts.points);
    let corners = places.into_flattened().into();
    let lineage = Lineage { parents: parents.into(), corners, foreign: Vec::new() };
    let mesh = Mesh::new(points, faces)?;
    debug_assert_eq!(mesh.check(), Ok(()));
    Ok(Refined { mesh, lineage, creases: creases.concat(), middles, children: children.concat() })
}

/// Old faces that one thread rebuilds.
struct Chunk<'a> {
    old: Range<usize>,
    /// Those of them that are split, ascending.
    split: &'a [Face],
    /// How many faces they become.
    n_new: usize,
}

/// So many old faces are rebuilt at a time: far more than it costs to hand them out.
const CHUNK: usize = 1 << 14;

fn chunks<'a>(mesh: &Mesh, inserts: &Inserts, split: &'a [Face]) -> Vec<Chunk<'a>> {
    let n_grown = |&f: &Face| match inserts.on_edge.of_face(f).into_iter().filter(|v| v.is_some()).count() {
        3 if inserts.centre(f).is_some() => 5,
        n_splits => n_splits,
    };
    let chunk = |start: usize| {
        let old = start..(start + CHUNK).min(mesh.n_faces());
        let [first, last] = [old.start, old.end].map(|end| split.partition_point(|f| f.index() < end));
        let split = &split[first..last];
        Chunk { n_new: old.len() + split.iter().map(n_grown).sum::<usize>(), old, split }
    };
    (0..mesh.n_faces()).into_par_iter().step_by(CHUNK).map(chunk).collect()
}

/// Where new faces go.
struct Out<'a> {
    /// The number of the first of them.
    first: usize,
    faces: &'a mut [[Vert; 3]],
    parents: &'a mut [Face],
    places: &'a mut [[Place; 3]],
}

impl Out<'_> {
    /// The first `n` and the rest.
    fn split(self, n: usize) -> (Self, Self) {
        let (faces, parents, places) =
            (self.faces.split_at_mut(n), self.parents.split_at_mut(n), self.places.split_at_mut(n));
        (
            Self { first: self.first, faces: faces.0, parents: parents.0, places: places.0 },
            Self { first: self.first + n, faces: faces.1, parents: parents.1, places: places.1 },
        )
    }
}

/// Rebuilds the faces of a chunk; gives the pieces of creases and the children of split faces.
fn rebuild(
    mesh: &Mesh,
    inserts: &Inserts,
    Chunk { old, split, .. }: Chunk<'_>,
    Out { first, faces, parents, places }: Out<'_>,
    middle: impl Fn(Vert) -> DVec3 + Copy,
) -> (Vec<[Vert; 2]>, Vec<Face>) {
    let mut creases = Vec::new();
    let mut children_ids =
        Vec::with_capacity(if split.is_empty() { 0 } else { faces.len() + split.len() - old.len() });
    let (mut done, mut next) = (old.start, 0);
    for f in split.iter().copied().map(Some).chain([None]) {
        // The faces up to the next split one stay as they are.
        let whole = done..f.map_or(old.end, Face::index);
        let slots = next..next + whole.len();
        next = slots.end;
        faces[slots.clone()].copy_from_slice(&mesh.faces()[whole.clone()]);
        places[slots.clone()].fill([0, 1, 2].map(Place::Corner));
        parents[slots].iter_mut().zip(whole).for_each(|(parent, f)| *parent = Face::new(f));
        let Some(f) = f else { break };
        done = f.index() + 1;
        let children = split_face(mesh, inserts, f, middle);
        for child in children.iter() {
            children_ids.push(Face::new(first + next));
            faces[next] = child.map(|(vertex, _)| vertex);
            parents[next] = f;
            places[next] = child.map(|(_, place)| place);
            next += 1;
        }
        creases.extend(creases_of(&children));
    }
    (creases, children_ids)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tests::mesh;
    use glam::dvec3;

    // 2
    // | `.
    // 0---1
    fn triangle() -> Mesh {
        mesh(&[[0., 0., 0.], [4., 0., 0.], [0., 2., 0.]], &[[0, 1, 2]])
    }

    fn refined(mesh: &Mesh, split: &[usize], faces: &[usize]) -> Refined {
        let faces: Vec<_> = faces.iter().map(|&f| Face::new(f)).collect();
        let inserts = Inserts::in_the_middle(mesh, |h| split.contains(&h.index()), &faces);
        refine(mesh, &inserts).unwrap()
    }

    fn faces(refined: &Refined) -> Vec<[usize; 3]> {
        refined.mesh.faces().iter().map(|f| f.map(Vert::index)).collect()
    }

    #[test]
    fn without_inserts_the_mesh_is_the_same() {
        let m = triangle();
        let r = refine(&m, &Inserts::none()).unwrap();
        assert_eq!((r.mesh.points(), r.mesh.faces()), (m.points(), m.faces()));
        assert!(r.creases.is_empty());
    }

    #[test]
    fn case_a_splits_in_two() {
        let r = refined(&triangle(), &[1], &[]);
        assert_eq!(faces(&r), [[1, 3, 0], [3, 2, 0]]);
        assert_eq!(r.mesh.point(Vert::new(3)), dvec3(2., 1., 0.));
        assert_eq!(
            r.lineage.corners.as_slice(),
            [
                Place::Corner(1),
                Place::Mid(1),
                Place::Corner(0),
                Place::Mid(1),
                Place::Corner(2),
                Place::Corner(0)
            ]
        );
    }

    #[test]
    fn case_b_takes_the_shorter_diagonal() {
        // Whole edge 0-1; x = 3 on 1-2, y = 4 on 2-0. |0-3| = sqrt 5 < |1-4| = sqrt 17.
        let r = refined(&triangle(), &[1, 2], &[]);
        assert_eq!(faces(&r), [[2, 4, 3], [4, 0, 3], [0, 1, 3]]);
        assert_eq!(r.creases, [[Vert::new(4), Vert::new(3)]]);
        // Whole edge 2-0; x = 3 on 0-1, y = 4 on 1-2. |2-3| = sqrt 8 > |0-4| = sqrt 5.
        let r = refined(&triangle(), &[0, 1], &[]);
        assert_eq!(faces(&r), [[1, 4, 3], [4, 2, 0], [4, 0, 3]]);
    }

    #[test]
    fn case_b_ties_go_to_the_smaller_index() {
        let m = mesh(&[[0., 2., 0.], [-1., 0., 0.], [1., 0., 0.]], &[[1, 2, 0]]);
        // Whole edge 1-2: both diagonals have the length of (1.5, 1).
        let r = refined(&m, &[1, 2], &[]);
        assert_eq!(faces(&r)[1][1..], [1, 3]);
    }

    #[test]
    fn case_c_is_a_fan_of_six() {
        let r = refined(&triangle(), &[0, 1, 2], &[0]);
        assert_eq!(faces(&r), [[0, 3, 6], [3, 1, 6], [1, 4, 6], [4, 2, 6], [2, 5, 6], [5, 0, 6]]);
        assert_eq!(r.creases, [[3, 6], [4, 6], [5, 6]].map(|e: [usize; 2]| e.map(Vert::new)));
    }

    #[test]
    fn case_d_is_four_triangles() {
        let r = refined(&triangle(), &[0, 1, 2], &[]);
        assert_eq!(faces(&r), [[0, 3, 5], [1, 4, 3], [2, 5, 4], [3, 4, 5]]);
        assert!(r.creases.is_empty());
    }

    // 3---2    The split of 0-2 splits both faces with one new vertex.
    // | / |
    // 0---1
    #[test]
    fn a_shared_edge_splits_both_its_faces_with_one_vertex() {
        let m = mesh(&[[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]], &[[0, 1, 2], [0, 2, 3]]);
        let r = refined(&m, &[2], &[]);
        assert_eq!(faces(&r), [[2, 4, 1], [4, 0, 1], [0, 4, 3], [4, 2, 3]]);
        assert_eq!(r.lineage.parents.as_slice(), [0, 0, 1, 1].map(Face::new));
        assert_eq!(r.mesh.edges().filter(|&h| r.mesh.is_border(h)).count(), 4);
    }

    #[test]
    fn faces_that_share_all_their_vertices_are_split_too() {
        let p = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]];
        let pillow = mesh(&p[..3], &[[0, 1, 2], [2, 1, 0]]);
        let r = refined(&pillow, &[0, 1], &[]);
        // Both faces of the pillow have the edge between the new vertices, and the same diagonal.
        assert_eq!((r.mesh.n_faces(), r.mesh.defects().non_manifold_edges), (6, 2));
        let doubled = mesh(&p[..3], &[[0, 1, 2], [0, 1, 2]]);
        assert_eq!(refined(&doubled, &[0, 1, 2], &[]).mesh.n_faces(), 8);
        let tetrahedron = mesh(&p, &[[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]);
        let r = refined(&tetrahedron, &(0..12).collect::<Vec<_>>(), &[0, 1, 2, 3]);
        assert!(r.mesh.n_faces() == 24 && r.mesh.halves().all(|h| !r.mesh.is_border(h)));
    }

    #[test]
    fn moved_vertices_decide_the_diagonal_and_land_where_they_should() {
        let m = triangle();
        let mut inserts = Inserts::in_the_middle(&m, |h| h.index() != 0, &[]);
        inserts.moved = vec![(Vert::new(1), dvec3(-9., 0., 0.))];
        inserts.points = vec![dvec3(7., 7., 7.), dvec3(8., 8., 8.)];
        let r = refine(&m, &inserts).unwrap();
        // |0-3| is from 0 to the middle of (-9, 0) and (0, 2); |1-4| from (-9, 0) to (0, 1): longer.
        assert_eq!(faces(&r), [[2, 4, 3], [4, 0, 3], [0, 1, 3]]);
        assert_eq!(r.mesh.point(Vert::new(1)), dvec3(-9., 0., 0.));
        assert_eq!(r.mesh.point(Vert::new(4)), dvec3(8., 8., 8.));
    }

    #[test]
    fn the_faces_of_a_non_manifold_edge_share_its_new_vertex() {
        // Three faces on 0-1, each a half-edge of its own there.
        let points = [[0., 0., 0.], [2., 0., 0.], [1., 1., 0.], [1., -1., 0.], [1., 0., 1.]];
        let m = mesh(&points, &[[0, 1, 2], [1, 0, 3], [0, 1, 4]]);
        let r = refined(&m, &[0, 3, 6], &[]);
        assert_eq!(faces(&r), [[0, 5, 2], [5, 1, 2], [1, 5, 3], [5, 0, 3], [0, 5, 4], [5, 1, 4]]);
        assert_eq!(r.mesh.defects().non_manifold_edges, 2);
        // One of them is enough: the others must follow.
        assert_eq!(faces(&refined(&m, &[6], &[])), faces(&r));
    }

    #[test]
    fn a_face_that_names_a_vertex_twice_does_not_share() {
        let points = [[0., 0., 0.], [2., 0., 0.], [1., 1., 0.], [1., -1., 0.], [1., 0., 1.]];
        let m = mesh(&points, &[[0, 1, 1], [0, 1, 2], [1, 0, 3], [2, 3, 4], [2, 3, 4]]);
        let inserts = Inserts::in_the_middle(&m, |h| h.face() == Face::new(0) || h == Half::new(3), &[]);
        let on_edge = |h: usize| inserts.on_edge[Half::new(h)].index();
        assert_eq!([0, 1, 2, 3, 6].map(on_edge), [5, 6, 7, 8, 8]);
    }
}
