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
//! In/out: `Mesh` + `Inserts` -> `Refined`; children stand where their parent stood.
//! Cost: O(F), one pass to count and one to write, both parallel.

use std::collections::BTreeSet;
use std::ops::{Index, Range};

use glam::DVec3;
use rayon::prelude::*;

use crate::mesh::{Face, Half, Mesh, MeshError, PerFace, PerHalf, Vert, check_size, has_repeated_vertex};

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
    fn of_face(&self, f: Face) -> [Vert; 3] {
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
fn creases_of(children: &Children) -> impl Iterator<Item = [Vert; 2]> + '_ {
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
    /// As in [`Refined`].
    pub creases: Vec<[Vert; 2]>,
    /// As in [`Refined`].
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
    let split_those = |faces: &[Face]| {
        let (mut lengths, mut children, mut creases) =
            (Vec::with_capacity(faces.len()), Vec::new(), Vec::new());
        for &f in faces {
            let own = split_face(mesh, inserts, f, middle);
            creases.extend(creases_of(&own));
            children.extend_from_slice(&own);
            lengths.push(own.len() as u32);
        }
        (lengths, children, creases)
    };
    let pieces: Vec<_> = faces.par_chunks(SPLIT_CHUNK).map(split_those).collect();
    let (mut starts, mut children, mut creases) = (vec![0], Vec::new(), Vec::new());
    for (lengths, own_children, own_creases) in pieces {
        for n in lengths {
            starts.push(starts[starts.len() - 1] + n);
        }
        children.extend(own_children);
        creases.extend(own_creases);
    }
    let n_faces = mesh.n_faces() - faces.len() + children.len();
    check_size(mesh.n_verts() + inserts.points.len(), n_faces)?;
    Ok(Split { faces, starts, children, creases, middles })
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
/// So many faces are split at a time.
const SPLIT_CHUNK: usize = 1 << 10;

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

/// Where the new vertices would be if they stayed in the middle of the old ones, which are `at` their
/// places after the move. `split` are the faces that have one.
fn middles(mesh: &Mesh, inserts: &Inserts, at: impl Fn(Vert) -> DVec3, split: &[Face]) -> Vec<DVec3> {
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
