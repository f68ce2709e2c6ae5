//! Splits every face in four at new vertices on its edges.
//!
//! ```text
//!            c                 f, its half-edges a-b, b-c, c-a with the new vertices x, y, z:
//!           / \                children 4f     a x z
//!          / 2 \                        4f + 1  b y x
//!         z-----y                       4f + 2  c z y
//!        / \ 3 / \                      4f + 3  x y z
//!       / 0 \ / 1 \
//!      a-----x-----b
//! ```
//!
//! Where every face is split alike, a child's number says all about where it comes from. A face that names
//! a vertex twice has no surface to split and stays as it is; all children after it come three places
//! earlier.
//!
//! Based on: Sharpen&Bend section 4.2 and figure 11.
//! Differs: [`refine`](crate::refine) does the same among other things; here nothing is looked up, and
//! lineage is made only for those who ask for it.
//! In/out: `Mesh` -> numbers of new vertices; with their points -> `Mesh`.
//! Cost: O(F), parallel.

use std::iter::once;

use glam::DVec3;
use rayon::prelude::*;

use crate::mesh::{Face, Half, MAX_VERTS, Mesh, MeshError, PerHalf, Vert, has_repeated_vertex};
use crate::refine::{Knots, Lineage, Place};

/// So many half-edges or faces are worked on at a time.
const CHUNK: usize = 1 << 14;

/// The new vertices of a mesh, one for each edge, in the order of [`Mesh::edges`].
///
/// The half-edges of a non-manifold or misoriented edge have one in common, so that the faces hang together
/// after the split as they did before. A face that names a vertex twice has none.
pub(super) struct Middles {
    /// The new vertex of each half-edge, or none. `[3F]`
    on_edge: PerHalf<Vert>,
    /// The lowest half-edge of each new vertex. `[N]`
    pub edges: Vec<Half>,
    n_old: usize,
    /// The faces that are not split, ascending.
    whole: Vec<Face>,
}

impl Middles {
    /// Numbers the new vertices.
    ///
    /// # Errors
    /// When there are more vertices than the index type can count.
    pub fn of(mesh: &Mesh) -> Result<Self, MeshError> {
        let knots = Knots::of(mesh);
        let n_collapsed = mesh.defects().collapsed_faces;
        let is_whole = |f: Face| n_collapsed > 0 && has_repeated_vertex(&mesh.corners(f));
        let lowest =
            |h: Half| knots.around(mesh, h).first().map_or_else(|| mesh.edge(h), |&(_, first)| first);
        let is_first = |h: &Half| lowest(*h) == *h && !is_whole(h.face());
        let halves = |chunk: usize| (CHUNK * chunk..mesh.n_halves().min(CHUNK * (chunk + 1))).map(Half::new);
        let firsts = |chunk: usize| halves(chunk).filter(is_first).collect::<Vec<_>>();
        let edges: Vec<Vec<Half>> =
            (0..mesh.n_halves().div_ceil(CHUNK)).into_par_iter().map(firsts).collect();

        let n_old = mesh.n_verts();
        let count = n_old + edges.iter().map(Vec::len).sum::<usize>();
        if count > MAX_VERTS {
            return Err(MeshError::TooLarge { what: "vertices", count, limit: MAX_VERTS });
        }
        let mut numbers = vec![Vert::NONE; mesh.n_halves()];
        let starts: Vec<usize> = edges
            .iter()
            .scan(n_old, |next, edges| Some(std::mem::replace(next, *next + edges.len())))
            .collect();
        let number = |(chunk, numbers): (usize, &mut [Vert])| {
            for (i, h) in edges[chunk].iter().enumerate() {
                numbers[h.index() - CHUNK * chunk] = Vert::new(starts[chunk] + i);
            }
        };
        numbers.par_chunks_mut(CHUNK).enumerate().for_each(number);
        let on_edge = |h: Half| if is_whole(h.face()) { Vert::NONE } else { numbers[lowest(h).index()] };
        let on_edge = (0..mesh.n_halves()).into_par_iter().map(|h| on_edge(Half::new(h)));
        let on_edge = on_edge.collect::<Vec<_>>().into();
        let whole = mesh.face_ids().take(if n_collapsed > 0 { mesh.n_faces() } else { 0 });
        let whole = whole.filter(|&f| is_whole(f)).collect();
        Ok(Self { on_edge, edges: edges.concat(), n_old, whole })
    }

    /// The new vertex on the edge of `h`; [`Vert::NONE`] at a face that is not split.
    pub fn vertex(&self, h: Half) -> Vert {
        self.on_edge[h]
    }

    /// The number of the new vertex on the edge of `h` among the new ones, if it has one.
    pub fn slot(&self, h: Half) -> Option<usize> {
        // NONE is the largest number there is; what is left of it is larger than any slot.
        self.on_edge[h].is_some().then(|| self.on_edge[h].index() - self.n_old)
    }

    /// The mesh with every face split. `points` are those of the old vertices, then those of the new ones.
    ///
    /// # Errors
    /// When it has more faces than the index type can count.
    pub fn split(&self, mesh: &Mesh, points: Vec<DVec3>) -> Result<Mesh, MeshError> {
        let faces = if self.whole.is_empty() {
            let children = (0..mesh.n_faces()).into_par_iter().map(|f| self.children(mesh, Face::new(f)));
            children.collect::<Vec<_>>().into_flattened()
        } else {
            let children = |f: Face| match self.is_whole(f) {
                true => vec![mesh.corners(f)],
                false => self.children(mesh, f).to_vec(),
            };
            mesh.face_ids().flat_map(children).collect()
        };
        Mesh::new(points, faces)
    }

    fn children(&self, mesh: &Mesh, f: Face) -> [[Vert; 3]; 4] {
        let [a, b, c] = mesh.corners(f);
        let [x, y, z] = f.halves().map(|h| self.on_edge[h]);
        [[a, x, z], [b, y, x], [c, z, y], [x, y, z]]
    }

    fn is_whole(&self, f: Face) -> bool {
        self.whole.binary_search(&f).is_ok()
    }

    /// Where the faces of the split mesh come from.
    pub fn into_quarters(self, n_faces: usize) -> Quarters {
        Quarters { n_faces, whole: self.whole }
    }
}

/// How the faces of a mesh were split.
#[derive(Clone, Debug, Default)]
pub(super) struct Quarters {
    n_faces: usize,
    /// Those that were not, ascending.
    whole: Vec<Face>,
}

impl Quarters {
    /// Where the new faces and their corners come from.
    pub fn lineage(&self) -> Lineage {
        use Place::{Corner, Mid};
        let split = [
            [Corner(0), Mid(0), Mid(2)],
            [Corner(1), Mid(1), Mid(0)],
            [Corner(2), Mid(2), Mid(1)],
            [Mid(0), Mid(1), Mid(2)],
        ];
        let (mut parents, mut corners) = (Vec::new(), Vec::new());
        let mut done = 0;
        for end in self.whole.iter().map(|f| f.index()).chain(once(self.n_faces)) {
            parents.extend((done..end).flat_map(|f| [Face::new(f); 4]));
            corners.extend(split.as_flattened().repeat(end - done));
            if end < self.n_faces {
                parents.push(Face::new(end));
                corners.extend([0, 1, 2].map(Corner));
            }
            done = end + 1;
        }
        Lineage { parents: parents.into(), corners: corners.into(), foreign: Vec::new() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tests::mesh;
    use crate::refine::{Inserts, refine};

    /// A strip, a fan of three on one edge, and two faces that name a vertex twice, one of them last.
    fn knotted() -> Mesh {
        let points: Vec<[f64; 3]> =
            (0..8).map(|i| [f64::from(i), f64::from(i * i % 5), f64::from(i % 3)]).collect();
        mesh(&points, &[[0, 1, 2], [2, 1, 3], [4, 4, 1], [4, 5, 6], [5, 4, 7], [4, 5, 3], [7, 7, 7]])
    }

    #[test]
    fn the_split_is_that_of_the_general_rebuild() {
        let m = knotted();
        let middles = Middles::of(&m).unwrap();
        let is_sound = |h: Half| !has_repeated_vertex(&m.corners(h.face()));
        let general = refine(&m, &Inserts::in_the_middle(&m, is_sound, &[])).unwrap();
        let middle = |&h: &Half| m.point(m.from(h)).midpoint(m.point(m.to(h)));
        let new: Vec<DVec3> = middles.edges.iter().map(middle).collect();
        let split = middles.split(&m, [m.points(), &new].concat()).unwrap();
        assert_eq!((split.points(), split.faces()), (general.mesh.points(), general.mesh.faces()));
        let lineage = middles.into_quarters(m.n_faces()).lineage();
        assert_eq!(lineage.parents, general.lineage.parents);
        assert_eq!(lineage.corners, general.lineage.corners);
    }

    #[test]
    fn new_vertices_are_numbered_along_the_edges() {
        let m = mesh(&[[0.; 3], [1., 0., 0.], [0., 1., 0.], [1., 1., 0.]], &[[0, 1, 2], [2, 1, 3]]);
        let middles = Middles::of(&m).unwrap();
        assert_eq!(middles.edges, [0, 1, 2, 4, 5].map(Half::new));
        let new: Vec<DVec3> = (0..middles.edges.len()).map(|slot| DVec3::splat(slot as f64)).collect();
        let split = middles.split(&m, [m.points(), &new].concat()).unwrap();
        let faces: Vec<_> = split.faces().iter().map(|f| f.map(Vert::index)).collect();
        assert_eq!(faces[..4], [[0, 4, 6], [1, 5, 4], [2, 6, 5], [4, 5, 6]]);
        assert_eq!(faces[4..], [[2, 5, 8], [1, 7, 5], [3, 8, 7], [5, 7, 8]]);
        assert_eq!(split.point(Vert::new(7)), DVec3::splat(3.0));
    }

    #[test]
    fn a_mesh_of_several_chunks_is_split_as_well() {
        let n = 60;
        let points: Vec<[f64; 3]> = (0..n * n).map(|k| [(k / n) as f64, (k % n) as f64, 0.0]).collect();
        let squares = (0..n * (n - 1)).filter(|k| k % n != n - 1);
        let faces: Vec<_> = squares.flat_map(|k| [[k, k + n, k + n + 1], [k, k + n + 1, k + 1]]).collect();
        let m = mesh(&points, &faces);
        assert!(m.n_halves() > CHUNK);
        let middles = Middles::of(&m).unwrap();
        assert!(middles.edges.iter().copied().eq(m.edges()));
        let slots = middles.edges.iter().map(|&h| middles.slot(h).unwrap());
        assert!(slots.eq(0..middles.edges.len()));
        assert!(m.halves().all(|h| middles.vertex(h) == middles.vertex(m.edge(h))));
    }
}
