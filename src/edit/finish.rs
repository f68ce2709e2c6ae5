//! Compacts an edited mesh.
//!
//! In/out: the edited mesh, the mesh before and its inserts -> `Edited`.
//! Cost: O(V + F), parallel but for the copies.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use super::{DEAD, Edit};
use crate::mesh::{Face, Half, Mesh, MeshError, PerVert, Vert};
use crate::refine::{Inserts, Lineage, Place, Refined};

/// Faces per unit of parallel work.
const CHUNK: usize = 8192;

/// What remains of some of its faces: as in [`Lineage`], and which corners each has.
#[derive(Default)]
struct Piece {
    faces: Vec<[Vert; 3]>,
    parents: Vec<Face>,
    places: Vec<Place>,
    /// By the index in `places`.
    foreign: Vec<(usize, [f64; 3])>,
}

/// What remains of a mesh after its edits.
pub(crate) struct Edited {
    pub mesh: Mesh,
    /// With nothing but the parents if the corners were not asked for.
    pub lineage: Lineage,
    /// For each vertex before the edits, the vertex that it is now, or was collapsed into. `[V]`
    pub now: PerVert<Vert>,
    /// Old vertices that were collapsed, ascending. Inserted vertices stand in their slots, as far as there are any.
    pub replaced: Vec<Vert>,
}

impl Edit<'_> {
    /// Compacts the mesh: faces keep their order, an old vertex keeps its index, and the last inserted
    /// vertices take the slots of old vertices that are gone. `before` is the mesh that was refined
    /// with `inserts`, and `whole` says which vertex of it refined a vertex is. Says where corners lie if it
    /// `keeps_lineage`.
    ///
    /// # Errors
    /// Never, in fact: the mesh has fewer elements than before.
    pub(crate) fn finish(
        self,
        before: &Mesh,
        inserts: &Inserts,
        whole: impl Fn(Vert) -> Vert + Sync,
        keeps_lineage: bool,
    ) -> Result<Edited, MeshError> {
        let (now, replaced, points) = self.compact_verts();
        let n_faces = self.faces.len();
        let mut faces = Vec::with_capacity(n_faces);
        let (mut parents, mut places) = (Vec::with_capacity(n_faces), Vec::new());
        let mut foreign = Vec::new();
        let piece = |first: usize| {
            let range = first..n_faces.min(first + CHUNK);
            let mut piece = self.finish_piece(range.clone(), &now);
            if keeps_lineage {
                self.place_corners(range, &mut piece, before, inserts, &whole);
            }
            piece
        };
        let pieces: Vec<Piece> = (0..n_faces).into_par_iter().step_by(CHUNK).map(piece).collect();
        for piece in pieces {
            foreign.extend(piece.foreign.iter().map(|&(i, weights)| (Half::new(places.len() + i), weights)));
            faces.extend(piece.faces);
            parents.extend(piece.parents);
            places.extend(piece.places);
        }
        let lineage = Lineage { parents: parents.into(), corners: places.into(), foreign };
        let mesh = Mesh::new(points, faces)?;
        debug_assert_eq!(mesh.check(), Ok(()));
        Ok(Edited { mesh, lineage, now, replaced })
    }

    /// What is left of some of the faces, with the vertices that are `now` their corners but not their places.
    fn finish_piece(&self, range: Range<usize>, now: &PerVert<Vert>) -> Piece {
        let (n, mut piece) = (range.len(), Piece::default());
        (piece.faces, piece.parents) = (Vec::with_capacity(n), Vec::with_capacity(n));
        let (faces, parents) =
            (&self.faces.as_slice()[range.clone()], &self.refined.lineage.parents.as_slice()[range]);
        for (&corners, &parent) in faces.iter().zip(parents).filter(|(corners, _)| **corners != DEAD) {
            piece.faces.push(corners.map(|v| now[v]));
            piece.parents.push(parent);
        }
        piece
    }

    /// Says where the corners of `piece` lie in their parents.
    fn place_corners(
        &self,
        range: Range<usize>,
        piece: &mut Piece,
        before: &Mesh,
        inserts: &Inserts,
        whole: impl Fn(Vert) -> Vert,
    ) {
        let Refined { mesh, lineage: old, .. } = self.refined;
        for f in range.map(Face::new).filter(|&f| self.stands(f)) {
            let (parent, corners) = (old.parents[f], self.corners(f));
            for (i, v) in corners.into_iter().enumerate() {
                let stays = v == mesh.corners(f)[i];
                let place =
                    if stays { old.corners[f.half(i)] } else { place_in(before, inserts, parent, whole(v)) };
                if place == Place::Foreign {
                    let weights = barycentric(before.triangle(parent), self.point(v));
                    piece.foreign.push((piece.places.len(), weights));
                }
                piece.places.push(place);
            }
        }
    }

    /// New indices `[V]`, the old vertices that are gone, and the points in their new order. Inserted vertices take the
    /// slots of those that are gone, the lowest ones first; where more are gone than inserted ones stand, the others
    /// stay as they were, without a face: no index shifts.
    fn compact_verts(&self) -> (PerVert<Vert>, Vec<Vert>, Vec<DVec3>) {
        let n_verts = self.refined.mesh.n_verts();
        let stands = |v: &Vert| self.vert_stands(*v);
        let gone_old: Vec<Vert> = (0..self.n_old).map(Vert::new).filter(|v| !stands(v)).collect();
        let mut inserted: Vec<Vert> = (self.n_old..n_verts).map(Vert::new).filter(stands).collect();
        let movers = inserted.split_off(inserted.len().saturating_sub(gone_old.len()));

        let mut now = PerVert::filled(n_verts, Vert::NONE);
        let mut points = self.points.as_slice()[..self.n_old].to_vec();
        for v in (0..self.n_old).map(Vert::new).filter(stands) {
            now[v] = v;
        }
        for (&slot, &v) in gone_old.iter().zip(&movers) {
            now[v] = slot;
            points[slot.index()] = self.point(v);
        }
        for v in inserted {
            now[v] = Vert::new(points.len());
            points.push(self.point(v));
        }
        for v in (0..n_verts).map(Vert::new).filter(|v| !stands(v)) {
            // The others on the way there have the same answer; chains are long where one edge after the other goes.
            let mut kept = v;
            while !now[kept].is_some() {
                kept = self.into[kept];
            }
            let last = now[kept];
            let mut next = v;
            while !now[next].is_some() {
                now[next] = last;
                next = self.into[next];
            }
        }
        (now, gone_old, points)
    }
}

/// Where `v` lies in `parent`: at a corner, on an edge, in the centre, or elsewhere.
fn place_in(before: &Mesh, inserts: &Inserts, parent: Face, v: Vert) -> Place {
    let number = |i: Option<usize>| i.map(|i| i as u8);
    if let Some(i) = number(before.corners(parent).iter().position(|&w| w == v)) {
        Place::Corner(i)
    } else if let Some(i) = number(parent.halves().iter().position(|&h| inserts.on_edge[h] == v)) {
        Place::Mid(i)
    } else if inserts.centre(parent) == Some(v) {
        Place::Centre
    } else {
        Place::Foreign
    }
}

/// Barycentric coordinates of the point of the triangle's plane nearest to `p`, pulled into the
/// triangle: attributes are mixed, never extrapolated.
fn barycentric([a, b, c]: [DVec3; 3], p: DVec3) -> [f64; 3] {
    let normal = (b - a).cross(c - a);
    let area = normal.length_squared();
    let weights = [(b, c), (c, a), (a, b)].map(|(q, r)| ((q - p).cross(r - p).dot(normal) / area).max(0.0));
    let sum: f64 = weights.iter().sum();
    if sum.is_finite() && sum > 0.0 { weights.map(|w| w / sum) } else { [1.0 / 3.0; 3] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;

    #[test]
    fn barycentric_coordinates_stay_inside_the_triangle() {
        let t = [dvec3(0., 0., 0.), dvec3(4., 0., 0.), dvec3(0., 4., 0.)];
        assert_eq!(barycentric(t, dvec3(1., 1., 9.)), [0.5, 0.25, 0.25]);
        assert_eq!(barycentric(t, dvec3(-4., 8., 0.)), [0.0, 0.0, 1.0]);
        assert_eq!(barycentric([t[0]; 3], t[1]), [1.0 / 3.0; 3]);
    }
}
