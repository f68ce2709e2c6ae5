//! The half-edge mesh that every pass reads.
//!
//! Half-edge `3f + i` runs from corner `i` to corner `i + 1` of face `f`, so *next*, *previous* and
//! *face* are arithmetic and only twins are stored. Fans (the half-edges that leave a vertex) are
//! derived on first use.
//!
//! Based on: the half-edge structure as Manifold and geometry-central lay it out.
//! Differs: an edge whose half-edges are not exactly two, opposite in direction, gets no twins. It is
//! a border to every later pass, which therefore needs no special case for it; the mesh counts it.

mod element;
mod fans;
#[cfg(test)]
pub(crate) mod tests;
mod twins;

use std::ops::Range;
use std::sync::OnceLock;

use glam::DVec3;
use rayon::prelude::*;

use crate::geometry::unit_normal;

pub(crate) use element::Element;
pub use element::{Face, Half, PerElement, PerFace, PerHalf, PerVert, Vert};
pub use fans::Fans;
pub use twins::EdgeDefects;
use twins::{Twins, pair_twins};

/// Vertices or faces per unit of parallel work.
const CHUNK: usize = 4096;

/// Why arrays do not make a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MeshError {
    /// A face names a vertex that does not exist.
    #[error("face {face} names vertex {vertex}, but there are {vertices} vertices")]
    NoSuchVertex {
        /// The face, counted from 0.
        face: usize,
        /// The vertex it names, counted from 0.
        vertex: usize,
        /// How many vertices there are.
        vertices: usize,
    },
    /// More elements than the 32-bit index type can count, or more faces than the caller allows.
    #[error("{count} {what} are more than the {limit} that {}", whose(*limit))]
    TooLarge {
        /// What there are too many of.
        what: &'static str,
        /// How many there are.
        count: usize,
        /// How many there may be.
        limit: usize,
    },
}

/// Who sets a limit to the number of faces or vertices.
fn whose(limit: usize) -> &'static str {
    if limit == MAX_FACES || limit == MAX_VERTS {
        "the index type holds"
    } else {
        "are allowed (--max-faces)"
    }
}

/// Most faces that a mesh can have: three half-edges of each must fit below [`Half::NONE`].
pub const MAX_FACES: usize = (u32::MAX / 3) as usize;
/// Most vertices that a mesh can have.
pub const MAX_VERTS: usize = (u32::MAX - 1) as usize;

/// A triangle mesh with half-edges.
///
/// Vertices may be unused, faces degenerate or doubled, edges non-manifold, fans may touch in a
/// vertex (bow-tie): every such mesh is valid here, and [`check`](Self::check) says what is invariant.
///
/// ```
/// use glam::dvec3;
/// use sharpen::mesh::{Half, Mesh, Vert};
///
/// let points = vec![dvec3(0., 0., 0.), dvec3(1., 0., 0.), dvec3(1., 1., 0.), dvec3(0., 1., 0.)];
/// let v = Vert::new;
/// let mesh = Mesh::new(points, vec![[v(0), v(1), v(2)], [v(0), v(2), v(3)]])?;
/// assert_eq!(mesh.twin(Half::new(2)), Some(Half::new(3)));
/// assert_eq!(mesh.twin(Half::new(0)), None);
/// # Ok::<(), sharpen::mesh::MeshError>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    points: PerVert<DVec3>,
    faces: PerFace<[Vert; 3]>,
    twins: OnceLock<Twins>,
    fans: OnceLock<Fans>,
}

impl Mesh {
    /// Builds a mesh from `points` `[V]` and `faces` `[F]` (corners counter-clockwise from outside).
    ///
    /// Cost: O(F). Twins and fans are made on first use: a mesh that is only written needs neither.
    ///
    /// # Errors
    /// When a face names a vertex that does not exist, or the index type cannot count the elements.
    pub fn new(points: Vec<DVec3>, faces: Vec<[Vert; 3]>) -> Result<Self, MeshError> {
        check_size(points.len(), faces.len())?;
        let is_wrong = |v: &Vert| v.index() >= points.len();
        let first_wrong = |faces: &[[Vert; 3]]| faces.iter().position(|face| face.iter().any(is_wrong));
        if !faces.par_chunks(CHUNK).all(|faces| first_wrong(faces).is_none()) {
            let face = first_wrong(&faces).unwrap_or(0);
            let vertex = faces[face].iter().find(|v| is_wrong(v)).map_or(0, |v| v.index());
            return Err(MeshError::NoSuchVertex { face, vertex, vertices: points.len() });
        }
        Ok(Self::of_valid_parts(points, faces))
    }

    /// The mesh of `points` and `faces` that are known to go together.
    pub(crate) fn of_valid_parts(points: Vec<DVec3>, faces: Vec<[Vert; 3]>) -> Self {
        debug_assert!(faces.iter().flatten().all(|v| v.index() < points.len()));
        Self { points: points.into(), faces: faces.into(), twins: OnceLock::new(), fans: OnceLock::new() }
    }

    /// The twins, made on first use from the fans: O(F log k), k the largest number of edges at one vertex.
    #[inline]
    fn twins(&self) -> &Twins {
        made_once(&self.twins, || pair_twins(self.faces(), self.fans()))
    }

    /// Number of vertices, used or not.
    #[must_use]
    pub fn n_verts(&self) -> usize {
        self.points.len()
    }

    /// Number of faces.
    #[must_use]
    pub fn n_faces(&self) -> usize {
        self.faces.len()
    }

    /// Number of half-edges, three per face.
    #[must_use]
    pub fn n_halves(&self) -> usize {
        3 * self.faces.len()
    }

    /// All vertices in order.
    pub fn verts(&self) -> impl ExactSizeIterator<Item = Vert> + Clone + use<> {
        (0..self.n_verts() as u32).map(Vert)
    }

    /// All half-edges in order.
    pub fn halves(&self) -> impl ExactSizeIterator<Item = Half> + Clone + use<> {
        (0..self.n_halves() as u32).map(Half)
    }

    /// All faces in order.
    pub fn face_ids(&self) -> impl ExactSizeIterator<Item = Face> + Clone + use<> {
        (0..self.n_faces() as u32).map(Face)
    }

    /// Each edge once, as the lower of its half-edges. A border edge is its only half-edge; a
    /// non-manifold edge appears once per face.
    pub fn edges(&self) -> impl Iterator<Item = Half> + Clone + '_ {
        let twins = &self.twins().of;
        self.halves().filter(|&h| h <= twins[h])
    }

    /// Puts those [`edges`](Self::edges) into `edges` whose lower half-edges belong to these faces. Without a branch: half
    /// of the half-edges are the lower ones, and no processor guesses which.
    pub(crate) fn edges_of(&self, faces: Range<usize>, edges: &mut Vec<Half>) {
        let halves = 3 * faces.start..3 * faces.end;
        edges.clear();
        edges.resize(halves.len(), Half::NONE);
        let mut n = 0;
        for (h, &twin) in halves.clone().zip(&self.twins().of.as_slice()[halves]) {
            edges[n] = Half(h as u32);
            n += usize::from(Half(h as u32) <= twin);
        }
        edges.truncate(n);
    }

    /// The half-edge that stands for the edge of `h`: the lower of `h` and its twin.
    #[inline]
    #[must_use]
    pub fn edge(&self, h: Half) -> Half {
        h.min(self.twins().of[h])
    }

    /// Position of vertex `v`.
    #[inline]
    #[must_use]
    pub fn point(&self, v: Vert) -> DVec3 {
        self.points[v]
    }

    /// All positions `[V]`.
    #[must_use]
    pub fn points(&self) -> &[DVec3] {
        self.points.as_slice()
    }

    /// The corners of face `f`, counter-clockwise.
    #[inline]
    #[must_use]
    pub fn corners(&self, f: Face) -> [Vert; 3] {
        self.faces[f]
    }

    /// All faces as corners `[F]`.
    #[must_use]
    pub fn faces(&self) -> &[[Vert; 3]] {
        self.faces.as_slice()
    }

    /// The three positions of face `f`.
    #[inline]
    #[must_use]
    pub fn triangle(&self, f: Face) -> [DVec3; 3] {
        self.faces[f].map(|v| self.points[v])
    }

    /// The vertex that `h` leaves.
    #[inline]
    #[must_use]
    pub fn from(&self, h: Half) -> Vert {
        self.faces().as_flattened()[h.index()]
    }

    /// The vertex that `h` points to.
    #[inline]
    #[must_use]
    pub fn to(&self, h: Half) -> Vert {
        self.from(h.next())
    }

    /// The vertex that `h` leaves, and the one that it points to.
    #[inline]
    #[must_use]
    pub fn ends(&self, h: Half) -> [Vert; 2] {
        [self.from(h), self.to(h)]
    }

    /// The vertex of the face of `h` that is not on `h`.
    #[inline]
    #[must_use]
    pub fn opposite(&self, h: Half) -> Vert {
        self.from(h.prev())
    }

    /// Length of the edge of `h`.
    #[inline]
    #[must_use]
    pub fn length(&self, h: Half) -> f64 {
        self.point(self.from(h)).distance(self.point(self.to(h)))
    }

    /// The other half-edge of the same edge; none on a border or a non-manifold edge.
    #[inline]
    #[must_use]
    pub fn twin(&self, h: Half) -> Option<Half> {
        Some(self.twins().of[h]).filter(|t| t.is_some())
    }

    /// Whether the edge of `h` has no second face (or too many of them).
    #[inline]
    #[must_use]
    pub fn is_border(&self, h: Half) -> bool {
        !self.twins().of[h].is_some()
    }

    /// Number of half-edges without a twin.
    #[must_use]
    pub fn n_borders(&self) -> usize {
        self.twins().n_borders
    }

    /// The ends of all edges without a twin, ascending, each once.
    #[must_use]
    pub fn border_verts(&self) -> Vec<Vert> {
        if self.n_borders() == 0 {
            return Vec::new();
        }
        let borders = self.halves().filter(|&h| self.is_border(h));
        let mut verts: Vec<Vert> = borders.flat_map(|h| self.ends(h)).collect();
        verts.sort_unstable();
        verts.dedup();
        verts
    }

    /// The next half-edge that leaves the same vertex, counter-clockwise; none past a border.
    #[inline]
    #[must_use]
    pub fn rotate_ccw(&self, h: Half) -> Option<Half> {
        self.twin(h.prev())
    }

    /// The next half-edge that leaves the same vertex, clockwise; none past a border.
    #[inline]
    #[must_use]
    pub fn rotate_cw(&self, h: Half) -> Option<Half> {
        self.twin(h).map(Half::next)
    }

    /// What is irregular about the edges.
    #[must_use]
    pub fn defects(&self) -> EdgeDefects {
        self.twins().defects
    }

    /// The fans of all vertices, made on first use. O(F).
    #[must_use]
    pub fn fans(&self) -> &Fans {
        made_once(&self.fans, || Fans::new(self.n_verts(), self.faces()))
    }

    /// The half-edges that leave `v`, one per face at `v`, ascending. This is *all* faces at `v`, also
    /// where several fans touch in it.
    #[inline]
    #[must_use]
    pub fn leaving(&self, v: Vert) -> &[Half] {
        self.fans().leaving(v)
    }

    /// The half-edge from `a` to `b`, if a face has one; the lowest where several have.
    #[must_use]
    pub fn half_between(&self, a: Vert, b: Vert) -> Option<Half> {
        self.leaving(a).iter().copied().find(|&h| self.to(h) == b)
    }

    /// The unit normal of each face; zero for a face without area. `[F]`
    #[must_use]
    pub fn face_normals(&self) -> PerFace<DVec3> {
        let normal = |f: &[Vert; 3]| unit_normal(f.map(|v| self.points[v])).unwrap_or(DVec3::ZERO);
        self.faces().par_iter().map(normal).collect::<Vec<_>>().into()
    }

    /// The box round all vertices that faces use, as (lowest, highest) corner; none without faces.
    #[must_use]
    pub fn bounds(&self) -> Option<(DVec3, DVec3)> {
        let mut used = self.faces().iter().flatten().map(|&v| self.point(v));
        let first = used.next()?;
        Some(used.fold((first, first), |(lo, hi), p| (lo.min(p), hi.max(p))))
    }

    /// Length of the bounding box's diagonal; 0 without faces.
    #[must_use]
    pub fn diagonal(&self) -> f64 {
        self.bounds().map_or(0.0, |(lo, hi)| lo.distance(hi))
    }

    /// Takes the mesh apart into points `[V]` and faces `[F]`.
    #[must_use]
    pub fn into_parts(self) -> (Vec<DVec3>, Vec<[Vert; 3]>) {
        (self.points.into_vec(), self.faces.into_vec())
    }

    /// Checks the whole invariant; `Err` says what is broken. O(F log k).
    ///
    /// * Every corner names a vertex; every half-edge has a twin entry.
    /// * Twins are mutual, belong to different faces, run in opposite directions between the same two
    ///   vertices, and are the only two half-edges between them.
    /// * Two half-edges that are alone on their edge and opposite *are* twins.
    /// * The fans list each half-edge once, at the vertex it leaves.
    ///
    /// # Errors
    /// One sentence that names the first element found broken.
    pub fn check(&self) -> Result<(), String> {
        if let Some(v) = self.faces().iter().flatten().find(|v| v.index() >= self.n_verts()) {
            return Err(format!("{v:?} of {} vertices", self.n_verts()));
        }
        let twins = self.twins();
        if twins.of.len() != self.n_halves() {
            return Err(format!("{} twins for {} half-edges", twins.of.len(), self.n_halves()));
        }
        for h in self.halves() {
            let Some(t) = self.twin(h) else { continue };
            if t.index() >= self.n_halves() || twins.of[t] != h || t.face() == h.face() {
                return Err(format!("{h:?} and {t:?} are no mutual twins of two faces"));
            }
            if self.from(h) != self.to(t) || self.to(h) != self.from(t) {
                return Err(format!("twins {h:?} and {t:?} do not join the same vertices"));
            }
        }
        if *twins != pair_twins(self.faces(), self.fans()) {
            return Err("the twins are those of another mesh".to_owned());
        }
        self.fans().check(self)
    }
}

/// What `cell` holds, made on first use. Threads that ask at the same time make it each and keep the first:
/// [`OnceLock::get_or_init`] would have the others wait, and a thread of a pool that waits while `make` needs the
/// pool may wait for ever.
#[inline]
fn made_once<T>(cell: &OnceLock<T>, make: impl FnOnce() -> T) -> &T {
    #[cold]
    fn fill<T>(cell: &OnceLock<T>, made: T) -> &T {
        cell.get_or_init(|| made)
    }
    match cell.get() {
        Some(held) => held,
        None => fill(cell, make()),
    }
}

pub(crate) fn check_size(n_verts: usize, n_faces: usize) -> Result<(), MeshError> {
    let too_large = |what, count, limit| Err(MeshError::TooLarge { what, count, limit });
    if n_faces > MAX_FACES {
        return too_large("faces", n_faces, MAX_FACES);
    }
    if n_verts > MAX_VERTS {
        return too_large("vertices", n_verts, MAX_VERTS);
    }
    Ok(())
}

/// Whether a face is no triangle at all.
pub(crate) fn has_repeated_vertex(&[a, b, c]: &[Vert; 3]) -> bool {
    a == b || b == c || c == a
}
