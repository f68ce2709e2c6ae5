//! Flips edges along which the surface still folds back onto itself.

use glam::DVec3;
use rayon::prelude::*;

use super::{UntangleCounts, Zone};
use crate::geometry::{angle_between, unit_normal};
use crate::mesh::{Face, Vert};

/// An edge with a larger dihedral angle is a fold, in radians: 150 degrees.
pub(super) const FOLD_ANGLE: f64 = 150.0 * std::f64::consts::PI / 180.0;
/// A flip must lower the largest of the five dihedral angles by this, in radians: 1 degree.
const MIN_FALL: f64 = std::f64::consts::PI / 180.0;
/// Twice the area of a new triangle over the square of its longest side: less is a sliver.
const MIN_SHAPE: f64 = 0.005;
/// Each round uncovers what the flips before it did; few edges are left after the first.
const ROUNDS: usize = 4;

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
            // Only edges of flipped faces have other angles now, and each is seen from one of its two faces.
            let beside = flipped.iter().flat_map(|&f| self.neighbours(f));
            let mut faces: Vec<Face> = folds.iter().map(|&(_, f, ..)| f).chain(beside).collect();
            faces.append(&mut flipped);
            faces.sort_unstable();
            faces.dedup();
            folds = self.folds_among(&faces);
        }
    }

    /// The folds inside the zone that are seen from `faces`, as (cosine, face, from, to), the sharpest first.
    fn folds_among(&self, faces: &[Face]) -> Vec<(f64, Face, Vert, Vert)> {
        let area = |f: Face| {
            let [a, b, c] = self.edit.triangle(f);
            (b - a).cross(c - a)
        };
        let folds_of = |&f: &Face| {
            let (t, own) = (self.edit.corners(f), area(f));
            let edges = [0, 1, 2].map(|i| (t[i], t[(i + 1) % 3])).into_iter().filter(|(a, b)| a < b);
            edges.filter_map(move |(a, b)| {
                let beside = self.edit.faces_beside(a, b).filter(|beside| beside[0] == f)?;
                let g = Some(beside[1]).filter(|&g| self.in_zone(g) && own.dot(area(g)) <= 0.0)?;
                let cosine = self.normal(f)?.dot(self.normal(g)?);
                (cosine < FOLD_ANGLE.cos()).then_some((cosine, f, a, b))
            })
        };
        let standing = faces.par_iter().filter(|&&f| self.in_zone(f) && self.edit.stands(f));
        let mut folds: Vec<_> = standing.flat_map_iter(folds_of).collect();
        folds.sort_by(|x, y| x.0.total_cmp(&y.0).then((x.2, x.3).cmp(&(y.2, y.3))));
        folds
    }

    /// The standing faces across the edges of `f`.
    fn neighbours(&self, f: Face) -> impl Iterator<Item = Face> + '_ {
        let t = self.edit.corners(f);
        (0..3).flat_map(move |i| self.beside(t[i], t[(i + 1) % 3])).filter(move |&g| g != f)
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
