//! What is to be inserted into a mesh, and which edges share what is inserted.
//!
//! In/out: edges and faces to split -> `Inserts`: a number for each new vertex, by half-edge.
//! Cost: O(split edges); where edges are non-manifold a sort of the borders more.

use std::collections::BTreeSet;
use std::ops::Index;

use glam::DVec3;
use rayon::prelude::*;

use crate::mesh::{Face, Half, Mesh, PerHalf, Vert, has_repeated_vertex};

/// New vertices for a mesh, as data: who makes them (sharpening, bending) does not matter here.
///
/// New vertex `i` gets the index `n_verts + i`.
#[derive(Clone, Debug)]
pub struct Inserts {
    /// The new vertex on the edge of each half-edge, the same for twins; [`Vert::NONE`] for no split.
    pub on_edge: OnEdge,
    /// The faces that get a vertex inside, ascending. All three of their edges are split.
    pub in_face: Vec<(Face, Vert)>,
    /// Where each new vertex goes. `[N]`
    pub points: Vec<DVec3>,
    /// Old vertices that go elsewhere, ascending.
    pub moved: Vec<(Vert, DVec3)>,
}

/// The new vertices on edges, by half-edge.
#[derive(Clone, Debug)]
pub enum OnEdge {
    /// One entry for each half-edge of the mesh. `[3F]`
    Any(PerHalf<Vert>),
    /// One entry for each half-edge with a new vertex, ascending.
    Few(Vec<(Half, Vert)>),
}

impl Index<Half> for OnEdge {
    type Output = Vert;
    fn index(&self, h: Half) -> &Vert {
        match self {
            Self::Any(on_edge) => &on_edge[h],
            Self::Few(list) => {
                list.binary_search_by_key(&h, |entry| entry.0).map_or(&Vert::NONE, |i| &list[i].1)
            }
        }
    }
}

impl OnEdge {
    /// The new vertices on the three edges of `f`.
    pub(super) fn of_face(&self, f: Face) -> [Vert; 3] {
        let list = match self {
            Self::Any(on_edge) => return f.halves().map(|h| on_edge[h]),
            Self::Few(list) => &list[list.partition_point(|&(h, _)| h < f.half(0))..],
        };
        let mut of_face = [Vert::NONE; 3];
        list.iter().take_while(|(h, _)| h.face() == f).for_each(|&(h, v)| of_face[h.corner()] = v);
        of_face
    }

    /// The faces with a split edge, ascending.
    pub(crate) fn faces(&self) -> Vec<Face> {
        match self {
            Self::Any(on_edge) => {
                let is_split = |f: &Face| f.halves().into_iter().any(|h| on_edge[h].is_some());
                (0..on_edge.len() / 3).into_par_iter().map(Face::new).filter(is_split).collect()
            }
            Self::Few(list) => {
                let mut faces: Vec<Face> = list.iter().map(|(h, _)| h.face()).collect();
                faces.dedup();
                faces
            }
        }
    }
}

impl Inserts {
    /// No insert at all.
    #[must_use]
    pub fn none() -> Self {
        Self { on_edge: OnEdge::Few(Vec::new()), in_face: Vec::new(), points: Vec::new(), moved: Vec::new() }
    }

    /// Splits the edges for which `is_split` holds, in the order of [`Mesh::edges`], and puts a vertex
    /// into each of `faces` (ascending). The new vertices stay in the middle until they are placed.
    ///
    /// The half-edges of a non-manifold or misoriented edge get one vertex in common, at the first of
    /// them that is split, so that the faces hang together after the split as they did before.
    pub fn in_the_middle(mesh: &Mesh, is_split: impl Fn(Half) -> bool + Send + Sync, faces: &[Face]) -> Self {
        let halves = (0..mesh.n_halves()).into_par_iter().map(Half::new);
        let mut split: Vec<Half> = halves.filter(|&h| is_split(h) && mesh.edge(h) == h).collect();
        let mut on_edge = PerHalf::filled(mesh.n_halves(), Vert::NONE);
        number_edges(mesh, &mut split, |h, vertex| on_edge[h] = vertex);
        Self::of(mesh, OnEdge::Any(on_edge), &split, faces)
    }

    /// Does the same for few edges, which are given as their lower half-edges, ascending.
    pub(crate) fn in_the_middle_of(mesh: &Mesh, edges: &[Half], faces: &[Face]) -> Self {
        let (mut split, mut on_edge) = (edges.to_vec(), Vec::with_capacity(2 * edges.len()));
        number_edges(mesh, &mut split, |h, vertex| on_edge.push((h, vertex)));
        on_edge.sort_unstable();
        Self::of(mesh, OnEdge::Few(on_edge), &split, faces)
    }

    fn of(mesh: &Mesh, on_edge: OnEdge, split: &[Half], faces: &[Face]) -> Self {
        let middle = |&h: &Half| mesh.point(mesh.from(h)).midpoint(mesh.point(mesh.to(h)));
        let mut inserts = Self { on_edge, points: split.par_iter().map(middle).collect(), ..Self::none() };
        for &f in faces {
            let vertex = Vert::new(mesh.n_verts() + inserts.points.len());
            inserts.in_face.push((f, vertex));
            inserts.points.push(mesh.triangle(f).into_iter().sum::<DVec3>() / 3.0);
        }
        inserts
    }

    /// Whether nothing is inserted and nothing moves.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.points.is_empty() && self.moved.is_empty()
    }

    /// Where old vertex `v` of `mesh` goes.
    pub(crate) fn old_point(&self, mesh: &Mesh, v: Vert) -> DVec3 {
        let moved = self.moved.binary_search_by_key(&v, |&(vertex, _)| vertex);
        moved.map_or_else(|_| mesh.point(v), |i| self.moved[i].1)
    }

    /// The vertex inside `f`, if it gets one.
    #[must_use]
    pub fn centre(&self, f: Face) -> Option<Vert> {
        self.in_face.binary_search_by_key(&f, |&(face, _)| face).ok().map(|i| self.in_face[i].1)
    }
}

/// Gives each edge in `split` a new vertex, on all its half-edges, and takes out those that have one by then.
fn number_edges(mesh: &Mesh, split: &mut Vec<Half>, mut put: impl FnMut(Half, Vert)) {
    let knots = Knots::of(mesh);
    let mut in_knots = BTreeSet::new();
    let mut next = mesh.n_verts();
    split.retain(|&h| {
        if in_knots.contains(&h) {
            return false;
        }
        let vertex = Vert::new(next);
        next += 1;
        let others = knots.around(mesh, h).iter().map(|&(_, g)| g).filter(|&g| g != h);
        [Some(h), mesh.twin(h)].into_iter().flatten().chain(others.clone()).for_each(|g| put(g, vertex));
        in_knots.extend(others);
        true
    });
}

/// The edges whose half-edges are no twins although they join the same two vertices: three faces or more
/// meet there, or two that run the same way. To every other pass they are borders.
#[derive(Clone, Debug, Default)]
pub(crate) struct Knots {
    /// Their half-edges with both vertices, the lower one first; ascending.
    halves: Vec<([Vert; 2], Half)>,
}

impl Knots {
    /// Finds them: O(1) in a mesh without any, else a sort of the borders.
    pub(crate) fn of(mesh: &Mesh) -> Self {
        let defects = mesh.defects();
        if defects.non_manifold_edges + defects.misoriented_edges == 0 {
            return Self::default();
        }
        // A face that names a vertex twice bounds nothing: it must not knot its sound neighbours.
        let is_collapsed = |f: Face| has_repeated_vertex(&mesh.corners(f));
        let borders = mesh.halves().filter(|&h| mesh.is_border(h) && !is_collapsed(h.face()));
        let mut borders: Vec<_> = borders.map(|h| (ends(mesh, h), h)).collect();
        borders.sort_unstable();
        let knots = borders.chunk_by(|a, b| a.0 == b.0).filter(|edge| edge.len() > 1);
        Self { halves: knots.flatten().copied().collect() }
    }

    /// All half-edges of the edge of `h`, `h` among them; none when it is no knot.
    pub(crate) fn around(&self, mesh: &Mesh, h: Half) -> &[([Vert; 2], Half)] {
        if self.halves.is_empty() || !mesh.is_border(h) {
            return &[];
        }
        let pair = ends(mesh, h);
        let start = self.halves.partition_point(|&(other, _)| other < pair);
        let length = self.halves[start..].partition_point(|&(other, _)| other == pair);
        &self.halves[start..start + length]
    }
}

/// The two vertices of the edge of `h`, the lower one first.
fn ends(mesh: &Mesh, h: Half) -> [Vert; 2] {
    let (a, b) = (mesh.from(h), mesh.to(h));
    [a.min(b), a.max(b)]
}
