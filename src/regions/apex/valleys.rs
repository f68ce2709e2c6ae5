//! Flips the edges across from an apex that lie in a valley of its cone.
//!
//! ```text
//!       x                 x         x  apex       From the apex on all of a cone goes straight down: where two of its
//!      / \               /|\        a-b           neighbours are joined across a third one that is below, the edge
//!     a---b     ->      a | b       flipped       between them is a chord that cuts into the cone.
//!      \ /               \|/
//!       d                 d
//! ```
//!
//! Based on: nothing in the papers.
//! In/out: edits the faces at the apex in place.
//! Cost: O(valence) a flip, at most [`MAX_FLIPS`].

use super::Apex;
use crate::edit::Edit;
use crate::geometry::{angle_between, unit_normal};
use crate::mesh::{Face, Vert};

/// No edge is flipped that bends inward by less than this, in radians: 10 degrees.
const VALLEY: f64 = 10.0 * std::f64::consts::PI / 180.0;
/// Vertices farther from the apex than this, in h, are not joined with it.
const FARTHEST: f64 = 3.0;
/// A new face is closer to the normal of the cone than 60 degrees.
const MIN_COSINE: f64 = 0.5;
/// Flips at an apex at most.
const MAX_FLIPS: usize = 16;

impl Apex {
    /// Flips the valleys round `tip`, which is the apex in `edit`, the deepest first; says how many. `h` is the mean edge
    /// length. Where no vertex moves, all is well as it is.
    pub(crate) fn flip_valleys(&self, tip: Vert, h: f64, edit: &mut Edit<'_>) -> usize {
        if self.moved.is_empty() {
            return 0;
        }
        for n_flips in 0..MAX_FLIPS {
            let faces = edit.faces_at(tip).to_vec();
            let valleys = faces.iter().filter_map(|&f| self.valley(tip, f, h, edit));
            let deepest = valleys.max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
            let Some((_, beside, triangles)) = deepest else { return n_flips };
            edit.flip(beside, triangles);
        }
        MAX_FLIPS
    }

    /// How deep the valley is that `f`, a face at `tip`, has across from it, and the flip that fills it.
    fn valley(
        &self,
        tip: Vert,
        f: Face,
        h: f64,
        edit: &Edit<'_>,
    ) -> Option<(f64, [Face; 2], [[Vert; 3]; 2])> {
        let t = edit.corners(f);
        let i = t.iter().position(|&v| v == tip)?;
        let (a, b) = (t[(i + 1) % 3], t[(i + 2) % 3]);
        let beside = edit.faces_beside(a, b)?;
        let d = edit.third(beside[1], a, b);
        let triangles = edit.flippable(beside, a, b)?;
        let [n, m] = beside.map(|face| unit_normal(edit.triangle(face)));
        let (n, m) = (n?, m?);
        let outward = if self.is_convex { 1.0 } else { -1.0 };
        let rise = outward * n.dot(edit.point(d) - edit.point(a));
        let bend = angle_between(n, m);
        let is_sound = triangles.into_iter().all(|t| {
            let triangle = t.map(|v| edit.point(v));
            let middle = triangle.into_iter().sum::<glam::DVec3>() / 3.0;
            unit_normal(triangle).is_some_and(|n| outward * n.dot(self.cone.normal(middle)) > MIN_COSINE)
        });
        let is_near = edit.point(d).distance(edit.point(tip)) <= FARTHEST * h;
        (rise > 0.0 && bend >= VALLEY && is_near && is_sound).then_some((bend, beside, triangles))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::PerVert;
    use crate::mesh::tests::mesh;
    use crate::refine::{Inserts, refine};
    use crate::regions::apex::cone::Cone;
    use glam::{DVec3, dvec3};

    /// Flips round vertex 0, whose neighbours 1 to 5 lie 60 degrees apart, but 5 and 1, across which is 6, so far from the
    /// axis and so far down, or up in a pit. How many flips there are comes back, and the faces at 6.
    fn flipped(is_convex: bool, far: f64, deep: f64) -> (usize, Vec<[usize; 3]>) {
        let sign = if is_convex { 1.0 } else { -1.0 };
        let on_circle = |i: usize| {
            let azimuth = 60.0_f64.to_radians() * i as f64;
            [azimuth.cos(), azimuth.sin(), -sign]
        };
        let mut points = vec![[0.0; 3]];
        points.extend((1..6).map(on_circle));
        points.push([far, 0.0, -sign * deep]);
        let faces = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5], [0, 5, 1], [5, 6, 1]];
        let refined = refine(&mesh(&points, &faces), &Inserts::none()).unwrap();
        let is_whole = PerVert::filled(7, true);
        let mut edit = Edit::new(&refined, 7, &is_whole);
        let down = dvec3(0.0, 0.0, -sign);
        let apex = Apex {
            vertex: Vert::new(0),
            point: DVec3::ZERO,
            n_samples: 0,
            rms: 0.0,
            cone: Cone { apex: DVec3::ZERO, down, angle: std::f64::consts::FRAC_PI_4 },
            is_convex,
            moved: vec![(Vert::new(0), DVec3::ZERO)],
            edges: Vec::new(),
        };
        let n_flips = apex.flip_valleys(Vert::new(0), 1.0, &mut edit);
        let mut at_last: Vec<[usize; 3]> = edit
            .faces_at(Vert::new(6))
            .iter()
            .map(|&f| edit.corners(f).map(|v| v.index()))
            .map(|mut t| {
                let least = (0..3).min_by_key(|&i| t[i]).unwrap_or(0);
                t.rotate_left(least);
                t
            })
            .collect();
        at_last.sort_unstable();
        (n_flips, at_last)
    }

    #[test]
    fn what_lies_across_a_chord_is_joined_with_the_apex() {
        assert_eq!(flipped(true, 1.3, 1.3), (1, vec![[0, 5, 6], [0, 6, 1]]));
        assert_eq!(flipped(false, 1.3, 1.3), (1, vec![[0, 5, 6], [0, 6, 1]]), "a pit");
    }

    #[test]
    fn a_ridge_a_gentle_valley_and_what_is_far_stay() {
        // The plane of 0, 1 and 5 falls by 2 at a distance of 1 from the axis.
        let same = (0, vec![[1, 5, 6]]);
        assert_eq!(flipped(true, 1.3, 2.8), same, "a ridge");
        assert_eq!(flipped(true, 1.3, 2.5), same, "a valley of less than ten degrees");
        assert_eq!(flipped(true, 2.4, 2.4), same, "3.4 h away");
    }
}
