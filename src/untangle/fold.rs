//! Flips edges along which the surface still folds back onto itself.
//!
//! ```text
//!       c             c         f = a b c is turned over onto g = b a d: its edge a-b has a dihedral angle of more than
//!      / \           /|\        150 degrees. The flip is done if the largest of the five angles round it falls.
//!     a---b    ->   a | b
//!      \ /           \|/
//!       d             d
//! ```
//!
//! Based on: nothing in the papers.
//! In/out: edits faces of the zone.
//! Cost: O(faces of the zone) to find folds, in parallel; up to [`ROUNDS`] rounds over what is left.

use glam::DVec3;
use rayon::prelude::*;

use super::{UntangleCounts, Zone};
use crate::geometry::{angle_between, unit_normal};
use crate::mesh::{Face, Vert};
use crate::subset::Subset;

/// An edge with a larger dihedral angle is a fold, in radians: 150 degrees.
pub(super) const FOLD_ANGLE: f64 = 150.0 * std::f64::consts::PI / 180.0;
/// A flip must lower the largest of the five dihedral angles by this, in radians: 1 degree. Half and double change
/// nothing on 251 inputs; at 0, where a fold may become another one as sharp, 12 change, as many folds come as go, and
/// a star's largest error grows 30 times.
const MIN_FALL: f64 = std::f64::consts::PI / 180.0;
/// A new triangle of a smaller [`shape`] is a sliver. The angles of a sliver are
/// rounding. Half and double change none of 251 inputs by more than 1 %, 0 two of them, with three folds fewer.
const MIN_SHAPE: f64 = 0.005;
/// Each round uncovers what the flips before it did; few edges are left after the first.
const ROUNDS: usize = 4;
/// Vertices per unit of parallel work.
const CHUNK: usize = 1024;
/// Up to so many faces at a vertex are compared each with each.
const FEW: usize = 16;

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
        let mut folds = self.folds_at(&self.verts_with_turned_faces());
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
            folds = self.folds_at(&self.verts_of(&flipped));
        }
    }

    /// The corners of those of `faces` that stand, ascending.
    pub(super) fn verts_of(&self, faces: &[Face]) -> Vec<Vert> {
        let standing = faces.iter().filter(|&&f| self.edit.stands(f));
        let corners = standing.flat_map(|&f| self.edit.corners(f));
        Subset::of(self.is_inner.len(), corners).iter().collect()
    }

    /// The vertices of the zone at which a face is turned from another one by a right angle at least, or which have too
    /// many of them to tell: no other has a fold.
    fn verts_with_turned_faces(&self) -> Vec<Vert> {
        let area = |&f: &Face| {
            let [p, q, r] = if self.edit.stands(f) { self.edit.triangle(f) } else { [DVec3::ZERO; 3] };
            (q - p).cross(r - p)
        };
        let areas: Vec<DVec3> = self.faces.par_iter().map(area).collect();
        let has_turned_faces = |&v: &Vert| {
            let faces = self.edit.faces_at(v);
            if faces.len() > FEW {
                return true;
            }
            let (mut own, mut n) = ([DVec3::ZERO; FEW], 0);
            for &f in faces.iter().filter(|&&f| self.in_zone(f)) {
                own[n] = areas[self.slot[f] as usize];
                n += 1;
            }
            (1..n).any(|i| own[..i].iter().any(|area| area.dot(own[i]) <= 0.0))
        };
        self.verts_of(&self.faces).into_par_iter().filter(has_turned_faces).collect()
    }

    /// The folds inside the zone at `verts`, as (cosine, face, from, to), the sharpest first.
    fn folds_at(&self, verts: &[Vert]) -> Vec<(f64, Face, Vert, Vert)> {
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
        let across = sides.map(|(p, q)| self.edit.faces_with(p, q).find(|&h| h != f && h != g));
        if [Some(f), Some(g)].iter().chain(&across).flatten().any(|h| flipped.contains(h)) {
            return;
        }
        let points = triangles.map(|t| t.map(|v| self.edit.point(v)));
        let [Some(n), Some(m)] = points.map(unit_normal) else { return };
        if points.into_iter().any(|triangle| shape(triangle) < MIN_SHAPE) {
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

/// Twice the area of a triangle over the square of its longest side.
pub(super) fn shape([a, b, c]: [DVec3; 3]) -> f64 {
    let longest = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
    (b - a).cross(c - a).length() / longest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::untangle::tests::Scene;

    // 2---4---0    Edge 4-5 is a fold where 5 is beyond 0: face 4-5-0 is turned over, and flipping it cures that.
    //  `. |`. |`.
    //     1---5---3
    fn strip(five: [f64; 3], three: [f64; 3]) -> Scene {
        let points = [[1., 1., 0.], [0., 0., 0.], [-1., 1., 0.], three, [0., 1., 0.], five];
        Scene::new(&points, &[[4, 5, 0], [5, 4, 1], [1, 4, 2], [0, 5, 3]], 6, &[])
    }

    const BEYOND: [f64; 3] = [2., 1.5, 0.];

    /// How many edges were flipped, and the corners of the first two faces then.
    fn flipped(scene: &Scene) -> (usize, [[usize; 3]; 2]) {
        scene.run(|zone| {
            let mut counts = UntangleCounts::default();
            zone.flip_folds(&mut counts);
            (counts.flipped, [0, 1].map(|f| zone.edit.corners(Face::new(f)).map(Vert::index)))
        })
    }

    const AS_BEFORE: (usize, [[usize; 3]; 2]) = (0, [[4, 5, 0], [5, 4, 1]]);

    #[test]
    fn a_fold_is_flipped_away() {
        assert_eq!(flipped(&strip(BEYOND, [3., 3., 0.])), (1, [[4, 1, 0], [1, 5, 0]]));
        assert_eq!(flipped(&strip([1., 0., 0.], [2., 0., 0.])), AS_BEFORE, "nothing folds");
    }

    /// Two faces with an angle of so many degrees between them: [0, 0, 0] to [0, 1, 0] is their edge.
    fn leaning(degrees: f64) -> [[f64; 3]; 4] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        [[0.5 * cos, 0.5, 0.5 * sin], [-1., 0.5, 0.], [0., 1., 0.], [0.; 3]]
    }

    #[test]
    fn only_angles_over_150_degrees_are_folds() {
        let flips = |degrees| flipped(&Scene::new(&leaning(degrees), &[[2, 3, 0], [3, 2, 1]], 4, &[])).0;
        assert_eq!([149.0, 151.0].map(flips), [0, 1]);
    }

    #[test]
    fn the_sharpest_fold_comes_first() {
        let points = [leaning(155.0), leaning(170.0)].concat();
        let scene = Scene::new(&points, &[[2, 3, 0], [3, 2, 1], [6, 7, 4], [7, 6, 5]], 8, &[]);
        let folds = scene.run(|zone| zone.folds_at(&zone.verts_with_turned_faces()));
        let edges: Vec<_> = folds.iter().map(|&(_, f, a, b)| [f.index(), a.index(), b.index()]).collect();
        assert_eq!(edges, [[2, 6, 7], [0, 2, 3]]);
        assert_eq!(folds, scene.run(|zone| zone.folds_at(&zone.verts_of(&zone.faces))));
        assert!((folds[0].0 - 170.0_f64.to_radians().cos()).abs() < 1e-12);
    }

    #[test]
    fn folds_are_looked_for_at_vertices_with_faces_that_turn_from_each_other() {
        let verts = |degrees: f64| {
            let scene = Scene::new(&leaning(degrees), &[[2, 3, 0], [3, 2, 1]], 4, &[]);
            scene.run(|zone| zone.verts_with_turned_faces())
        };
        assert_eq!(verts(89.0), []);
        assert_eq!(verts(91.0), [Vert::new(2), Vert::new(3)]);
        // A flat fan of so many faces round vertex 0.
        let fan = |n: usize| {
            let rim = (0..n).map(|i| (i as f64 * std::f64::consts::TAU / n as f64).sin_cos());
            let points: Vec<_> = [[0.; 3]].into_iter().chain(rim.map(|(y, x)| [x, y, 0.])).collect();
            let faces: Vec<_> = (0..n).map(|i| [0, 1 + i, 1 + (i + 1) % n]).collect();
            Scene::new(&points, &faces, n + 1, &[]).run(|zone| zone.verts_with_turned_faces())
        };
        assert_eq!((fan(FEW), fan(FEW + 1)), (vec![], vec![Vert::new(0)]), "too many to tell");
    }

    #[test]
    fn a_fold_stays_where_its_flip_would_make_a_sliver() {
        // Twice the area of 1-5-0 is 2 - y, the square of its longest side 4 + y².
        let flips = |y: f64| flipped(&strip([2., y, 0.], [3., 3., 0.])).0;
        assert_eq!((flips(1.96), flips(1.962)), (1, 0));
    }

    #[test]
    fn a_fold_stays_where_its_flip_would_make_another_as_sharp() {
        // Face 0-5-3 is turned over as well.
        assert_eq!(flipped(&strip(BEYOND, [2., 0., 0.])), AS_BEFORE);
    }

    #[test]
    fn a_flip_lowers_the_largest_angle_by_a_degree() {
        // The first face is turned by 170 degrees. After the flip the third one is turned by `degrees` from its
        // neighbour 1-3-0.
        let flips = |degrees: f64| {
            let [c, d, a, b] = leaning(170.0).map(DVec3::from);
            let normal = unit_normal([d, b, c]).unwrap();
            let outward = (c - b).cross(normal).normalize();
            let outward = if outward.dot(d - b) > 0.0 { -outward } else { outward };
            let (sin, cos) = degrees.to_radians().sin_cos();
            let points = [c, d, a, b, c.midpoint(b) + cos * outward - sin * normal].map(|p| p.to_array());
            let scene = Scene::new(&points, &[[2, 3, 0], [3, 2, 1], [0, 3, 4]], 5, &[]);
            flipped(&scene).0
        };
        assert_eq!([169.5, 168.5].map(flips), [0, 1]);
    }

    // What folds along 4-5 and 0-3 keeps each other's faces turned over: the second flip gains only after the first.
    #[test]
    fn a_round_flips_what_the_one_before_it_uncovered() {
        let points = [[1., 1., 0.], [0., 0., 0.], [-1., 1., 0.], [3., 3., 0.], [0., 1., 0.], BEYOND];
        let points = [&points[..], &[[2.2, 1.9, 0.]]].concat();
        let faces = [[4, 5, 0], [5, 4, 1], [1, 4, 2], [0, 5, 3], [0, 3, 6]];
        assert_eq!(flipped(&Scene::new(&points, &faces, 7, &[])), (2, [[4, 1, 0], [1, 5, 0]]));
    }

    #[test]
    fn faces_beside_a_flip_are_left_for_the_next_round() {
        let flips_after = |earlier: &[usize]| {
            strip(BEYOND, [3., 3., 0.]).run(|zone| {
                let mut flipped: Vec<Face> = earlier.iter().map(|&f| Face::new(f)).collect();
                zone.flip_fold(Face::new(0), Vert::new(4), Vert::new(5), &mut flipped);
                flipped.len() == earlier.len() + 2
            })
        };
        assert!(flips_after(&[]));
        for beside in 0..4 {
            assert!(!flips_after(&[beside]), "{beside}");
        }
    }
}
