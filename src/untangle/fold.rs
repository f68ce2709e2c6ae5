//! Flips edges along which the surface still folds back onto itself.

use glam::DVec3;
use rayon::prelude::*;

use super::{UntangleCounts, Zone};
use crate::geometry::{angle_between, unit_normal};
use crate::mesh::{Face, Vert};
use crate::subset::Subset;

/// An edge with a larger dihedral angle is a fold, in radians: 150 degrees.
pub(super) const FOLD_ANGLE: f64 = 150.0 * std::f64::consts::PI / 180.0;
/// A flip must lower the largest of the five dihedral angles by this, in radians: 1 degree.
const MIN_FALL: f64 = std::f64::consts::PI / 180.0;
/// Twice the area of a new triangle over the square of its longest side: less is a sliver.
const MIN_SHAPE: f64 = 0.005;
/// Each round uncovers what the flips before it did; few edges are left after the first.
const ROUNDS: usize = 4;
/// Vertices per unit of parallel work.
const CHUNK: usize = 1024;

/// A face at a vertex: it runs from there to `to`, and comes back from `from`.
struct Spoke {
    face: Face,
    to: Vert,
    from: Vert,
    /// The normal, twice the area long.
    area: DVec3,
}

impl Zone<'_, '_, '_> {
    /// Flips folds, sharpest first; a face and its neighbours take part in one flip a round.
    pub(super) fn flip_folds(&mut self, counts: &mut UntangleCounts) {
        let mut folds = self.folds_among(&self.faces);
        for _ in 0..ROUNDS {
            let mut flipped = Vec::new();
            for &(_, f, a, b) in &folds {
                self.flip_fold(f, a, b, &mut flipped);
            }
            if flipped.is_empty() {
                return;
            }
            counts.flipped += flipped.len() / 2;
            // Only edges of flipped faces have other angles now.
            flipped.extend(folds.iter().map(|&(_, f, ..)| f));
            folds = self.folds_among(&flipped);
        }
    }

    /// The folds inside the zone at corners of `faces`, as (cosine, face, from, to), the sharpest first.
    fn folds_among(&self, faces: &[Face]) -> Vec<(f64, Face, Vert, Vert)> {
        let standing = faces.iter().filter(|&&f| self.edit.stands(f));
        let corners = standing.flat_map(|&f| self.edit.corners(f));
        let verts: Vec<Vert> = Subset::of(self.is_inner.len(), corners).iter().collect();
        let folds_of = |verts: &[Vert]| {
            let (mut spokes, mut folds) = (Vec::new(), Vec::new());
            verts.iter().for_each(|&v| self.add_folds_at(v, &mut spokes, &mut folds));
            folds
        };
        let mut folds = verts.par_chunks(CHUNK).flat_map_iter(folds_of).collect::<Vec<_>>();
        folds.sort_by(|x, y| x.0.total_cmp(&y.0).then((x.2, x.3).cmp(&(y.2, y.3))));
        folds
    }

    /// Adds the folds on edges from `a` to vertices of higher index. All edges at a vertex are looked at together:
    /// its faces are read once, and hardly any edge folds.
    fn add_folds_at(&self, a: Vert, spokes: &mut Vec<Spoke>, folds: &mut Vec<(f64, Face, Vert, Vert)>) {
        spokes.clear();
        for &f in self.edit.faces_at(a) {
            let t = self.edit.corners(f);
            let i = t.iter().position(|&v| v == a).unwrap_or(0);
            let [p, q, r] = self.edit.triangle(f);
            let (to, from, area) = (t[(i + 1) % 3], t[(i + 2) % 3], (q - p).cross(r - p));
            spokes.push(Spoke { face: f, to, from, area });
        }
        spokes.sort_unstable_by_key(|spoke| (spoke.from, spoke.face));
        for f in spokes.iter().filter(|f| a < f.to && self.in_zone(f.face)) {
            let across = spokes.get(spokes.partition_point(|g| g.from < f.to)).filter(|g| g.from == f.to);
            let Some(g) = across.filter(|g| f.area.dot(g.area) <= 0.0 && self.in_zone(g.face)) else {
                continue;
            };
            if self.edit.faces_beside(a, f.to) == Some([f.face, g.face])
                && let (Some(n), Some(m)) = (self.normal(f.face), self.normal(g.face))
                && n.dot(m) < FOLD_ANGLE.cos()
            {
                folds.push((n.dot(m), f.face, a, f.to));
            }
        }
    }

    fn normal(&self, f: Face) -> Option<DVec3> {
        unit_normal(self.edit.triangle(f))
    }

    /// Flips edge `a`-`b` of `f` if the largest of the five dihedral angles round it falls and no face there is
    /// among those `flipped`.
    fn flip_fold(&mut self, f: Face, a: Vert, b: Vert, flipped: &mut Vec<Face>) {
        let Some([_, g]) = self.edit.faces_beside(a, b).filter(|beside| beside[0] == f) else { return };
        let Some(triangles) = self.edit.flippable([f, g], a, b) else { return };
        let [_, d, c] = triangles[0];
        let sides = [(a, d), (d, b), (b, c), (c, a)];
        let across = sides.map(|(p, q)| self.beside(p, q).find(|&h| h != f && h != g));
        if [Some(f), Some(g)].iter().chain(&across).flatten().any(|h| flipped.contains(h)) {
            return;
        }
        let points = triangles.map(|t| t.map(|v| self.edit.point(v)));
        let [Some(n), Some(m)] = points.map(unit_normal) else { return };
        if points.into_iter().any(is_sliver) {
            return;
        }
        let (Some(n_old), Some(m_old)) = (self.normal(f), self.normal(g)) else { return };
        // Sides a-d and c-a belong to the first new triangle, d-b and b-c to the second; before, b-c and
        // c-a belonged to f, a-d and d-b to g.
        let largest = |inner: f64, own: [DVec3; 4]| {
            let angles =
                own.into_iter().zip(across).filter_map(|(n, h)| Some(angle_between(n, self.normal(h?)?)));
            angles.fold(inner, f64::max)
        };
        let before = largest(angle_between(n_old, m_old), [m_old, m_old, n_old, n_old]);
        let after = largest(angle_between(n, m), [n, m, m, n]);
        if after >= before - MIN_FALL {
            return;
        }
        self.edit.flip([f, g], triangles);
        [f, g].into_iter().for_each(|face| self.forget(face));
        flipped.extend([f, g]);
    }
}

fn is_sliver([a, b, c]: [DVec3; 3]) -> bool {
    let longest = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
    (b - a).cross(c - a).length() < MIN_SHAPE * longest
}
