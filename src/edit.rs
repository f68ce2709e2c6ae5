//! A mesh under local edits: collapses and flips near the inserted vertices.
//!
//! The faces round each vertex are gathered beforehand; a list of its own is made for a vertex only when an
//! edit changes it. Faces keep their index while edits go on; [`Edit::finish`] compacts.
//!
//! In/out: borrows a [`Refined`] mesh, gives back a compacted one with its lineage.
//! Cost: O(V + F) to set up and to finish, O(valence) per query and edit: the mesh is an
//! [`Excerpt`](crate::excerpt::Excerpt).

mod fan;
mod finish;
#[cfg(test)]
mod tests;

use std::sync::atomic::{AtomicBool, Ordering};

use glam::DVec3;

use crate::mesh::{Face, Mesh, PerFace, PerVert, Vert};
use crate::refine::{Lineage, Place, Refined};

pub(crate) use fan::Fan;
pub(crate) use finish::Edited;

/// A face that an edit removed.
const DEAD: [Vert; 3] = [Vert::NONE; 3];
/// No edit has changed the faces of the vertex.
const UNTOUCHED: u32 = u32::MAX;
/// The mesh under edit.
pub(crate) struct Edit<'m> {
    refined: &'m Refined,
    /// Vertices below this index are old ones, the others were inserted.
    n_old: usize,
    /// Whether the mesh has all faces of a vertex. `[V]`
    is_whole: &'m PerVert<bool>,
    /// Whether somebody has asked for the faces of a vertex of which it does not have them all.
    is_at_fringe: AtomicBool,
    /// Positions: old vertices stay where they are.
    points: PerVert<DVec3>,
    faces: PerFace<[Vert; 3]>,
    /// The faces round each vertex before the edits.
    rings: Rings,
    /// For each vertex the slot of its faces in `around`, or `UNTOUCHED`.
    slot: PerVert<u32>,
    around: Vec<Vec<Face>>,
    /// For each vertex the one that it was collapsed into. `NONE` while it stands.
    into: PerVert<Vert>,
}

impl<'m> Edit<'m> {
    pub(crate) fn new(refined: &'m Refined, n_old: usize, is_whole: &'m PerVert<bool>) -> Self {
        let mesh = &refined.mesh;
        let copies = || (mesh.points().to_vec(), mesh.faces().to_vec());
        let (rings, (points, faces)) = rayon::join(|| Rings::gather(mesh), copies);
        Self {
            refined,
            n_old,
            is_whole,
            is_at_fringe: AtomicBool::new(false),
            points: points.into(),
            faces: faces.into(),
            rings,
            slot: PerVert::filled(mesh.n_verts(), UNTOUCHED),
            around: Vec::new(),
            into: PerVert::filled(mesh.n_verts(), Vert::NONE),
        }
    }

    /// Whether the mesh was too small for what was asked of it: the edits are void.
    pub(crate) fn is_at_fringe(&self) -> bool {
        self.is_at_fringe.load(Ordering::Relaxed)
    }

    pub(crate) fn is_inserted(&self, v: Vert) -> bool {
        v.index() >= self.n_old
    }

    #[inline]
    pub(crate) fn point(&self, v: Vert) -> DVec3 {
        self.points[v]
    }

    /// Moves an inserted vertex.
    pub(crate) fn move_to(&mut self, v: Vert, point: DVec3) {
        debug_assert!(self.is_inserted(v));
        self.points[v] = point;
    }

    /// The corners of a face that stands.
    pub(crate) fn corners(&self, f: Face) -> [Vert; 3] {
        self.faces[f]
    }

    pub(crate) fn triangle(&self, f: Face) -> [DVec3; 3] {
        self.faces[f].map(|v| self.point(v))
    }

    pub(crate) fn stands(&self, f: Face) -> bool {
        self.faces[f] != DEAD
    }

    pub(crate) fn vert_stands(&self, v: Vert) -> bool {
        !self.into[v].is_some()
    }

    /// The faces round `v`, in no particular but a reproducible order.
    pub(crate) fn faces_at(&self, v: Vert) -> &[Face] {
        if !self.is_whole[v] {
            self.is_at_fringe.store(true, Ordering::Relaxed);
        }
        match self.slot[v] {
            UNTOUCHED => self.rings.of(v),
            slot => &self.around[slot as usize],
        }
    }

    pub(crate) fn has_corner(&self, f: Face, v: Vert) -> bool {
        self.faces[f].contains(&v)
    }

    /// The standing faces with both `a` and `b` as corners.
    pub(crate) fn faces_with(&self, a: Vert, b: Vert) -> impl Iterator<Item = Face> + '_ {
        self.faces_at(a).iter().copied().filter(move |&f| self.has_corner(f, b))
    }

    /// The faces with both `a` and `b` as corners, if there are exactly two and they agree on the
    /// orientation: first the one that runs from `a` to `b`.
    pub(crate) fn faces_beside(&self, a: Vert, b: Vert) -> Option<[Face; 2]> {
        let mut both = self.faces_with(a, b);
        let (f, g) = (both.next()?, both.next()?);
        if both.next().is_some() {
            return None;
        }
        match (self.runs(f, a, b), self.runs(g, a, b)) {
            (true, false) => Some([f, g]),
            (false, true) => Some([g, f]),
            _ => None,
        }
    }

    /// Whether face `f` has `b` right after `a`.
    fn runs(&self, f: Face, a: Vert, b: Vert) -> bool {
        let t = self.faces[f];
        (0..3).any(|i| t[i] == a && t[(i + 1) % 3] == b)
    }

    /// The corner of `f` after `v`.
    fn after(&self, f: Face, v: Vert) -> Vert {
        let t = self.faces[f];
        let i = t.iter().position(|&w| w == v).unwrap_or(0);
        t[(i + 1) % 3]
    }

    /// Whether some face has both `a` and `b` as corners.
    pub(crate) fn are_neighbours(&self, a: Vert, b: Vert) -> bool {
        self.faces_with(a, b).next().is_some()
    }

    /// The corner of `f` that is neither `a` nor `b`.
    pub(crate) fn third(&self, f: Face, a: Vert, b: Vert) -> Vert {
        self.faces[f].into_iter().find(|&v| v != a && v != b).unwrap_or(a)
    }

    /// The neighbours of `v`, ascending.
    pub(crate) fn link(&self, v: Vert) -> Vec<Vert> {
        let faces = self.faces_at(v);
        let mut link = Vec::with_capacity(3 * faces.len());
        link.extend(faces.iter().flat_map(|&f| self.faces[f]).filter(|&w| w != v));
        link.sort_unstable();
        link.dedup();
        link
    }

    /// Whether `v` has at least four neighbours.
    pub(crate) fn has_four_neighbours(&self, v: Vert) -> bool {
        let (mut found, mut n) = ([v; 4], 0);
        for w in self.faces_at(v).iter().flat_map(|&f| self.faces[f]) {
            if w != v && !found[..n].contains(&w) {
                found[n] = w;
                n += 1;
                if n == found.len() {
                    return true;
                }
            }
        }
        false
    }

    /// Whether every edge at `v` has exactly two faces that agree on its direction.
    pub(crate) fn is_surrounded(&self, v: Vert) -> bool {
        let faces = self.faces_at(v);
        let mut neighbours: Vec<(Vert, bool)> = Vec::with_capacity(2 * faces.len());
        for &f in faces {
            let t = self.faces[f];
            let i = t.iter().position(|&w| w == v).unwrap_or(0);
            neighbours.extend([(t[(i + 1) % 3], false), (t[(i + 2) % 3], true)]);
        }
        neighbours.sort_unstable();
        neighbours.chunk_by(|a, b| a.0 == b.0).all(|edge| edge.len() == 2 && edge[0].1 != edge[1].1)
    }

    /// Whether `t` is a face of the mesh that was refined, turned over. Edits may not make one: it would lie
    /// on what that face became.
    pub(crate) fn is_turned(&self, t: [Vert; 3]) -> bool {
        if t.iter().any(|&v| self.is_inserted(v)) {
            return false;
        }
        let Lineage { parents, corners, .. } = &self.refined.lineage;
        // The faces that `v` was a corner of, and which one.
        let corners_at = |v: Vert| {
            let number = move |&f: &Face| {
                let i = self.refined.mesh.corners(f).iter().position(|&w| w == v)?;
                Some((parents[f], corners[f.half(i)]))
            };
            self.rings.of(v).iter().filter_map(number)
        };
        let is_corner = |v: Vert, f: Face, i: u8| corners_at(v).any(|at| at == (f, Place::Corner(i % 3)));
        corners_at(t[0]).any(|(f, place)| {
            matches!(place, Place::Corner(i) if is_corner(t[1], f, i + 2) && is_corner(t[2], f, i + 1))
        })
    }

    /// The triangles on the other diagonal of the quadrilateral of faces `f` and `g` beside `a`-`b`, that of
    /// `a` first, if nothing joins its ends yet.
    pub(crate) fn on_other_diagonal(&self, [f, g]: [Face; 2], a: Vert, b: Vert) -> Option<[[Vert; 3]; 2]> {
        let (c, d) = (self.third(f, a, b), self.third(g, a, b));
        (c != d && !self.are_neighbours(c, d)).then_some([[a, d, c], [d, b, c]])
    }

    /// The triangles [on the other diagonal](Self::on_other_diagonal), if neither is a face turned over.
    pub(crate) fn flippable(&self, beside: [Face; 2], a: Vert, b: Vert) -> Option<[[Vert; 3]; 2]> {
        let triangles = self.on_other_diagonal(beside, a, b)?;
        (!triangles.into_iter().any(|t| self.is_turned(t))).then_some(triangles)
    }

    /// The two faces that collapsing `gone` into `kept` would remove, if the surface stays a surface
    /// with the same borders: `gone` has no border or non-manifold edge, the two have exactly the two
    /// opposite vertices as common neighbours (the link condition), and these keep three neighbours. No face
    /// may be turned over.
    pub(crate) fn collapsible(&self, gone: Vert, kept: Vert) -> Option<[Face; 2]> {
        let beside = self.faces_beside(gone, kept)?;
        let opposite = beside.map(|f| self.third(f, gone, kept));
        if opposite[0] == opposite[1] || !opposite.iter().all(|&v| self.has_four_neighbours(v)) {
            return None;
        }
        if !self.is_surrounded(gone) {
            return None;
        }
        // Each neighbour comes right after `gone` in one of the two faces with both.
        let neighbours = self.faces_at(gone).iter().map(|&f| self.after(f, gone));
        let others = neighbours.filter(|&v| v != gone && v != kept);
        let n_common = others.filter(|&v| self.are_neighbours(kept, v)).count();
        let moved = |&f: &Face| self.faces[f].map(|v| if v == gone { kept } else { v });
        let turns = || {
            let others = self.faces_at(gone).iter().filter(|f| !beside.contains(f));
            others.map(moved).any(|t| self.is_turned(t))
        };
        (n_common == 2 && !turns()).then_some(beside)
    }

    /// Removes `gone` and the two faces beside `gone`-`kept`, which [`collapsible`](Self::collapsible)
    /// allowed; its other faces go to `kept`. Their indices come back.
    pub(crate) fn collapse(&mut self, gone: Vert, kept: Vert) -> Vec<Face> {
        let (beside, others): (Vec<_>, Vec<_>) =
            self.faces_at(gone).iter().partition(|&&f| self.has_corner(f, kept));
        beside.into_iter().for_each(|f| self.remove(f));
        for &f in &others {
            self.faces[f] = self.faces[f].map(|v| if v == gone { kept } else { v });
        }
        self.list(kept).extend(&others);
        self.list(gone).clear();
        self.into[gone] = kept;
        others
    }

    fn remove(&mut self, f: Face) {
        for v in self.faces[f] {
            self.list(v).retain(|&g| g != f);
        }
        self.faces[f] = DEAD;
    }

    /// Gives `f` and `g` the corners `t` and `u`: the two triangles that the other diagonal of their
    /// quadrilateral makes.
    pub(crate) fn flip(&mut self, [f, g]: [Face; 2], [t, u]: [[Vert; 3]; 2]) {
        for (face, corners) in [(f, t), (g, u)] {
            for v in self.faces[face] {
                self.list(v).retain(|&h| h != face);
            }
            for v in corners {
                self.list(v).push(face);
            }
            self.faces[face] = corners;
        }
    }

    /// The faces round `v`, as a list of its own.
    fn list(&mut self, v: Vert) -> &mut Vec<Face> {
        if self.slot[v] == UNTOUCHED {
            let faces = self.faces_at(v).to_vec();
            self.slot[v] = self.around.len() as u32;
            self.around.push(faces);
        }
        &mut self.around[self.slot[v] as usize]
    }
}

/// Hands out the corners of a face, each vertex once.
#[inline]
fn for_each_distinct(corners: &[Vert; 3], mut visit: impl FnMut(Vert)) {
    let &[a, b, c] = corners;
    visit(a);
    if b != a {
        visit(b);
    }
    if c != a && c != b {
        visit(c);
    }
}

/// The faces round each vertex, ascending.
struct Rings {
    starts: Vec<u32>,
    faces: Vec<Face>,
}

impl Rings {
    fn gather(mesh: &Mesh) -> Self {
        // A face counts once at a vertex, also where it names it twice.
        let mut starts = vec![0; mesh.n_verts() + 1];
        for corners in mesh.faces() {
            for_each_distinct(corners, |v| starts[v.index() + 1] += 1);
        }
        for v in 0..mesh.n_verts() {
            starts[v + 1] += starts[v];
        }
        let mut next = starts.clone();
        let mut faces = vec![Face::NONE; starts[mesh.n_verts()] as usize];
        for (f, corners) in mesh.face_ids().zip(mesh.faces()) {
            for_each_distinct(corners, |v| {
                faces[next[v.index()] as usize] = f;
                next[v.index()] += 1;
            });
        }
        Self { starts, faces }
    }

    fn of(&self, v: Vert) -> &[Face] {
        &self.faces[self.starts[v.index()] as usize..self.starts[v.index() + 1] as usize]
    }
}
