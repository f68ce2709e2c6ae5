//! Splits single faces: the five shapes that [`refine`](super) draws.
//!
//! In/out: a face of a `Mesh` + `Inserts` -> its children; all split faces -> `Split`.
//! Cost: O(split faces).

use glam::DVec3;

use super::{Inserts, Place};
use crate::mesh::{Face, Mesh, MeshError, Vert, check_size};

/// One child triangle: its corners, and where they lie in the parent.
pub(crate) type Child = [(Vert, Place); 3];

/// The children of one face: at most six.
pub(crate) struct Children {
    list: [Child; 6],
    len: usize,
}

impl Children {
    fn new(children: &[Child]) -> Self {
        let mut list = [[(Vert::NONE, Place::Foreign); 3]; 6];
        list[..children.len()].copy_from_slice(children);
        Self { list, len: children.len() }
    }
}

impl std::ops::Deref for Children {
    type Target = [Child];
    fn deref(&self) -> &[Child] {
        &self.list[..self.len]
    }
}

/// Splits face `f`. `middle` gives the position of a vertex, old or new, before new vertices move.
pub(crate) fn split_face(
    mesh: &Mesh,
    inserts: &Inserts,
    f: Face,
    middle: impl Fn(Vert) -> DVec3,
) -> Children {
    let corners = mesh.corners(f);
    let on_edge = inserts.on_edge.of_face(f);
    let corner = |i: usize| (corners[i % 3], Place::Corner((i % 3) as u8));
    let mid = |i: usize| (on_edge[i % 3], Place::Mid((i % 3) as u8));
    let is_split = on_edge.map(Vert::is_some);
    match is_split.iter().filter(|&&split| split).count() {
        0 => Children::new(&[[corner(0), corner(1), corner(2)]]),
        1 => {
            let i = is_split.iter().position(|&split| split).unwrap_or(0);
            Children::new(&[[corner(i), mid(i), corner(i + 2)], [mid(i), corner(i + 1), corner(i + 2)]])
        }
        2 => {
            // Edge p-q is whole; x lies on q-r, y on r-p.
            let i = is_split.iter().position(|&split| !split).unwrap_or(0);
            let (p, q, r, x, y) = (corner(i), corner(i + 1), corner(i + 2), mid(i + 1), mid(i + 2));
            let diagonal = |a: (Vert, Place), b: (Vert, Place)| middle(a.0).distance(middle(b.0));
            let (px, qy) = (diagonal(p, x), diagonal(q, y));
            if px < qy || (px == qy && p.0 < q.0) {
                Children::new(&[[r, y, x], [y, p, x], [p, q, x]])
            } else {
                Children::new(&[[r, y, x], [y, p, q], [y, q, x]])
            }
        }
        _ => match inserts.centre(f) {
            Some(centre) => {
                let w = (centre, Place::Centre);
                Children::new(&[
                    [corner(0), mid(0), w],
                    [mid(0), corner(1), w],
                    [corner(1), mid(1), w],
                    [mid(1), corner(2), w],
                    [corner(2), mid(2), w],
                    [mid(2), corner(0), w],
                ])
            }
            None => Children::new(&[
                [corner(0), mid(0), mid(2)],
                [corner(1), mid(1), mid(0)],
                [corner(2), mid(2), mid(1)],
                [mid(0), mid(1), mid(2)],
            ]),
        },
    }
}

/// The pieces of creases in a split face: the edges between two inserted vertices (cases b and c).
pub(super) fn creases_of(children: &Children) -> impl Iterator<Item = [Vert; 2]> + '_ {
    let (n, centre) = (children.len(), children[0][2].0);
    let across = (n == 3).then(|| [children[0][1].0, centre]);
    let spokes = (0..6).step_by(2).filter(move |_| n == 6).map(move |i| [children[i][1].0, centre]);
    across.into_iter().chain(spokes)
}

/// The split faces of a mesh and what becomes of them, without the rest of it.
pub(crate) struct Split {
    /// The split faces, ascending ...
    pub faces: Vec<Face>,
    /// ... where the children of each begin, and where those of the last one end ...
    pub starts: Vec<u32>,
    /// ... and the children.
    pub children: Vec<Child>,
    /// As in [`Refined`](super::Refined).
    pub creases: Vec<[Vert; 2]>,
    /// As in [`Refined`](super::Refined).
    pub middles: Vec<DVec3>,
}

impl Split {
    /// The children of `faces[i]`.
    pub(crate) fn children(&self, i: usize) -> &[Child] {
        &self.children[self.starts[i] as usize..self.starts[i + 1] as usize]
    }
}

/// Splits the faces of `mesh` that `inserts` split.
///
/// # Errors
/// When the new mesh would have more elements than the index type can count.
pub(crate) fn split(mesh: &Mesh, inserts: &Inserts) -> Result<Split, MeshError> {
    let faces = inserts.on_edge.faces();
    let old_point = |v: Vert| inserts.old_point(mesh, v);
    let middles = middles(mesh, inserts, old_point, &faces);
    let middle = |v: Vert| v.index().checked_sub(mesh.n_verts()).map_or_else(|| old_point(v), |i| middles[i]);
    let (mut starts, mut children, mut creases) = (vec![0], Vec::new(), Vec::new());
    for &f in &faces {
        let own = split_face(mesh, inserts, f, middle);
        creases.extend(creases_of(&own));
        children.extend_from_slice(&own);
        starts.push(children.len() as u32); // Wraps only if there are too many.
    }
    let n_faces = mesh.n_faces() - faces.len() + children.len();
    check_size(mesh.n_verts() + inserts.points.len(), n_faces)?;
    Ok(Split { faces, starts, children, creases, middles })
}

/// Where the new vertices would be if they stayed in the middle of the old ones, which are `at` their
/// places after the move. `split` are the faces that have one.
pub(super) fn middles(
    mesh: &Mesh,
    inserts: &Inserts,
    at: impl Fn(Vert) -> DVec3,
    split: &[Face],
) -> Vec<DVec3> {
    let mut middles = vec![DVec3::ZERO; inserts.points.len()];
    for &f in split {
        for (h, vertex) in f.halves().into_iter().zip(inserts.on_edge.of_face(f)).filter(|(_, v)| v.is_some())
        {
            middles[vertex.index() - mesh.n_verts()] = at(mesh.from(h)).midpoint(at(mesh.to(h)));
        }
    }
    for &(f, vertex) in &inserts.in_face {
        middles[vertex.index() - mesh.n_verts()] = mesh.corners(f).map(&at).into_iter().sum::<DVec3>() / 3.0;
    }
    middles
}
