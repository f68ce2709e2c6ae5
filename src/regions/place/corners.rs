//! New vertices that belong on a corner.
//!
//! ```text
//!        a       c   b      a, b  on one crease, which ends at c: b lies beyond it, since chamfers are as wide
//!   -----o-------x---o            as samples are apart, and folds the faces over
//!                |
//!                |
//! ```
//!
//! Where more than three faces meet in a corner, those that are no neighbours touch there all the same: the crease
//! between their samples begins and ends in that corner, and all of it belongs there. Left where their planes meet its
//! vertices stand off the surface (icosahedra by marching intersections: L2 .0076 -> .0001).
//!
//! Based on: nothing in the papers, which leave them where they are.
//! In/out: the new vertices of creases and corners -> some of the creases' put onto corners; untangling merges them.
//! Cost: O(corners).

use glam::DVec3;

use super::{Found, MAX_SHIFT, MAX_SHIFT_OF_GUESS, Placing};
use crate::fit::Fit;
use crate::mesh::{Face, Half};
use crate::place::Outcome;
use crate::refine::Inserts;

/// A crease is followed from its corner over this many chamfer edges, some four h, ...
const FOLLOWED: usize = 8;
/// ... and has to get this far from it, in h, to show on which side of it the crease lies.
const LEAST_AHEAD: f64 = 0.5;

/// Two corners that are no farther apart than this, in h, are one: those of marching cubes are as uncertain. At .25
/// the same are.
const SAME_CORNER: f64 = 0.1;

/// A new vertex on an edge that belongs on a corner.
struct Joined {
    /// The number of the new vertex.
    vertex: usize,
    /// From the middle of its edge to the corner.
    distance: f64,
    corner: DVec3,
}

impl Placing<'_> {
    /// Puts new vertices onto the corner that their crease ends at: the one on the edge of the corner triangle if it
    /// has no place of its own, or one on a mixed strip, and those that lie beyond the corner.
    pub(super) fn join_corners(&self, inserts: &Inserts, on_edges: &mut [Found], in_corners: &[Found]) {
        let mut joined: Vec<Joined> = Vec::new();
        for (&f, corner) in self.labels.corner_faces.iter().zip(in_corners) {
            if corner.outcome == Outcome::Moved {
                self.join_corner(inserts, on_edges, in_corners, f, corner.point, &mut joined);
            }
        }
        // Of two corners the nearer one: it comes last, and stays.
        joined.sort_by(|x, y| x.vertex.cmp(&y.vertex).then(y.distance.total_cmp(&x.distance)));
        for Joined { vertex, corner, .. } in joined {
            on_edges[vertex] = Found { point: corner, outcome: Outcome::AtCorner, ..on_edges[vertex] };
        }
    }

    /// Adds the new vertices that belong on the corner of `f` to `joined`.
    fn join_corner(
        &self,
        inserts: &Inserts,
        on_edges: &[Found],
        in_corners: &[Found],
        f: Face,
        corner: DVec3,
        joined: &mut Vec<Joined>,
    ) {
        for h in f.halves() {
            let crease = self.crease_from(inserts, h);
            let found = &on_edges[self.number(inserts, h)];
            let has_no_place = matches!(found.outcome, Outcome::Mixed | Outcome::TooFar) || found.is_mixed;
            let (n_joined, times) = if self.has_no_length(in_corners, &crease, corner) {
                (crease.len(), self.max_shift.unwrap_or(MAX_SHIFT))
            } else {
                let n_beyond = self.n_beyond(inserts, on_edges, &crease, corner);
                (n_beyond.max(usize::from(has_no_place)), MAX_SHIFT_OF_GUESS)
            };
            for &h in &crease[..n_joined] {
                let (distance, length) = (corner.distance(self.middle(h)), self.length(h));
                if distance <= times * self.reach(length) {
                    joined.push(Joined { vertex: self.number(inserts, h), distance, corner });
                }
            }
        }
    }

    /// Whether `crease`, which comes from this `corner`, ends in the same one.
    fn has_no_length(&self, in_corners: &[Found], crease: &[Half], corner: DVec3) -> bool {
        let end = crease.last().and_then(|&h| self.mesh.twin(h)).map(Half::face);
        let number = end.and_then(|f| self.labels.corner_faces.binary_search(&f).ok());
        number.is_some_and(|i| {
            let other = &in_corners[i];
            let distance = other.point.distance(corner);
            other.outcome == Outcome::Moved && distance <= SAME_CORNER * self.labels.mean_edge
        })
    }

    /// How many vertices of `crease`, from the first on, lie beyond the `corner` that it comes from, or before one
    /// that does.
    fn n_beyond(&self, inserts: &Inserts, on_edges: &[Found], crease: &[Half], corner: DVec3) -> usize {
        let fit = |v| self.labels.fits.get(v);
        let (Some(&first), Some(&last)) = (crease.first(), crease.last()) else { return 0 };
        let (Some(p), Some(q)) = (fit(self.mesh.from(first)), fit(self.mesh.to(first))) else { return 0 };
        let normal = |fit: &Fit| fit.evaluate(corner, self.labels.mean_edge).1;
        let along = normal(p).cross(normal(q)).normalize_or_zero();
        let ahead = (self.middle(last) - corner).dot(along);
        if ahead.abs() < LEAST_AHEAD * self.labels.mean_edge {
            return 0;
        }
        let is_beyond = |&h: &Half| {
            let found = &on_edges[self.number(inserts, h)];
            found.outcome == Outcome::Moved && (found.point - corner).dot(along) * ahead.signum() < 0.0
        };
        crease.iter().rposition(is_beyond).map_or(0, |i| i + 1)
    }

    /// The first chamfer edges of the crease from a corner triangle, of which `h` is a half-edge: that of `h` first.
    fn crease_from(&self, inserts: &Inserts, h: Half) -> Vec<Half> {
        let mut crease = vec![h];
        let mut at = h;
        while let Some(twin) = self.mesh.twin(at).filter(|_| crease.len() < FOLLOWED) {
            let mut others = [twin.next(), twin.prev()].into_iter();
            let mut next = others.by_ref().filter(|&h| inserts.on_edge[h].is_some());
            let (Some(one), None) = (next.next(), next.next()) else { break };
            crease.push(one);
            at = one;
        }
        crease
    }

    /// The number of the new vertex on the edge of `h`.
    fn number(&self, inserts: &Inserts, h: Half) -> usize {
        inserts.on_edge[h].index() - self.mesh.n_verts()
    }

    fn middle(&self, h: Half) -> DVec3 {
        self.point(self.mesh.from(h)).midpoint(self.point(self.mesh.to(h)))
    }

    fn length(&self, h: Half) -> f64 {
        self.point(self.mesh.from(h)).distance(self.point(self.mesh.to(h)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::FitSource::Region;
    use crate::mesh::tests::mesh;
    use crate::regions::tests::planes;
    use crate::regions::{RegionLabels, place_by_fits};
    use glam::dvec3;

    // 2 . 0-----3-----5     Sides z = 0 (0, 3, 5), y = 0 (1, 4) and x = 0 (2) meet in the corner (0, 0, 0); the
    //  `. |\   / \   /      triangle 0-1-2 has all three. The crease of the first two goes on along x: the middles
    //    `| \ /   \ /       of its edges 0-1 and 1-3 are at x = -0.25 and -0.05, of 3-4 and 4-5 at 0.4 and 1.
    //     1-------4
    fn place(x_of_5: f64) -> Vec<(DVec3, Outcome)> {
        let points = [
            [-0.3, 0.5, 0.0],
            [-0.2, 0.0, -0.5],
            [0.0, 0.4, -0.4],
            [0.1, 0.5, 0.0],
            [0.7, 0.0, -0.5],
            [x_of_5, 0.5, 0.0],
        ];
        let m = mesh(&points, &[[0, 1, 2], [0, 3, 1], [1, 3, 4], [3, 5, 4]]);
        let normals = [DVec3::Z, -DVec3::Y, -DVec3::X, DVec3::Z, -DVec3::Y, DVec3::Z];
        let fits = planes(&m, &(0..6).map(|v| (v, normals[v], 0.0, Region)).collect::<Vec<_>>());
        let crease = [(0, 1), (1, 3), (3, 4), (4, 5)];
        let edge = |&(a, b): &(usize, usize)| {
            let half = |a, b| m.half_between(crate::mesh::Vert::new(a), crate::mesh::Vert::new(b));
            m.edge(half(a, b).or_else(|| half(b, a)).unwrap())
        };
        let mut chamfers: Vec<Half> = crease.iter().chain(&[(1, 2), (2, 0)]).map(edge).collect();
        chamfers.sort_unstable();
        let corner_faces = vec![Face::new(0)];
        let labels = RegionLabels { mean_edge: 1.0, fits, chamfers, corner_faces, ..RegionLabels::default() };
        let placement = place_by_fits(&m, &labels, None);
        let new = |h| placement.inserts.on_edge[h].index() - m.n_verts();
        let at = |h| (placement.inserts.points[new(h)], placement.outcomes[new(h)]);
        crease.iter().map(edge).map(at).collect()
    }

    #[test]
    fn crease_vertices_beyond_their_corner_go_onto_it() {
        let placed = place(1.3);
        for (point, outcome) in &placed[..2] {
            assert_eq!(*outcome, Outcome::AtCorner);
            assert!(point.length() < 1e-12, "{point}");
        }
        for ((point, outcome), x) in placed[2..].iter().zip([0.4, 1.0]) {
            assert_eq!(*outcome, Outcome::Moved);
            assert!(point.distance(dvec3(x, 0.0, 0.0)) < 1e-12, "{point}");
        }
    }

    #[test]
    fn a_crease_that_stays_near_its_corner_does_not_show_its_side() {
        // The middle of 4-5 is at 0.45.
        assert!(place(0.2).iter().all(|&(_, outcome)| outcome == Outcome::Moved));
    }

    //      1          Four sides slope down from y = `ridge` to y = -`ridge` at z = 0, to +x (0), +y (1), -x (2 and 3) and -y
    //   2 / \         (4). Corner triangles 0-1-2 and 0-3-4, and between them the crease 0-2, 0-3.
    //   | `-- 0
    //   3 ´\ /
    //      4
    fn placed_between(ridge: f64) -> Vec<(DVec3, Outcome)> {
        let points =
            [[0.5, -0.05, -0.5], [0.0, 0.5, -0.5], [-0.5, 0.1, -0.5], [-0.5, -0.15, -0.5], [0.0, -0.5, -0.5]];
        let m = mesh(&points, &[[0, 1, 2], [0, 2, 3], [0, 3, 4]]);
        let sides = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (-1.0, 0.0), (0.0, -1.0)];
        let plane = |v: usize| {
            let normal = dvec3(sides[v].0, sides[v].1, 1.0).normalize();
            let top = dvec3(0.0, ridge * sides[v].1, 0.0);
            (v, normal, normal.dot(top - DVec3::from(points[v])), Region)
        };
        let labels = RegionLabels {
            mean_edge: 1.0,
            fits: planes(&m, &(0..5).map(plane).collect::<Vec<_>>()),
            chamfers: m.edges().filter(|&h| m.ends(h).map(crate::mesh::Vert::index) != [2, 3]).collect(),
            corner_faces: [0, 2].map(Face::new).to_vec(),
            ..RegionLabels::default()
        };
        let placement = place_by_fits(&m, &labels, None);
        let crease = [1, 2].map(|f| Face::new(f).half(0));
        let new = crease.map(|h| placement.inserts.on_edge[h].index() - m.n_verts());
        new.map(|i| (placement.inserts.points[i], placement.outcomes[i])).to_vec()
    }

    #[test]
    fn a_crease_that_ends_in_the_corner_it_comes_from_goes_onto_it() {
        for (point, outcome) in placed_between(0.0) {
            assert_eq!(outcome, Outcome::AtCorner);
            assert!(point.length() < 1e-12, "{point}");
        }
        // A ridge has two corners, at y = 0.3 and -0.3: its vertices stay where they are.
        for ((point, outcome), y) in placed_between(0.3).into_iter().zip([0.025, -0.1]) {
            assert_eq!(outcome, Outcome::Moved);
            assert!(point.distance(dvec3(0.0, y, 0.0)) < 1e-12, "{point}");
        }
    }
}
