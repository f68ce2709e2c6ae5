//! Loosens pinched edges: those of four faces, where two sheets hang together (`edit/fan.rs`).
//!
//! ```text
//!     u---b---w         The faces at a           x-a-u, u-a-b, b-a-w and w-a-y of the sheet above,
//!     | `.|.´ |                                  x-b-a and a-b-y, which are turned over, of the one below;
//!     |  .a.  |         those at b below         x-p-b, p-q-b and q-y-b, which cover a.
//!     |.´   `.|
//!   --x--p-q--y--       Once b has handed its fan from x to y over to a, x-b-a and a-b-y are gone, and edge a-b has
//!       crease          two faces.
//! ```
//!
//! Surface nets have one vertex in a cell even where two sheets of the surface pass through it, as beside a crease
//! that cuts the grid at an acute angle. On 44 of them 569 of 575 folds lay there, as every other operation asks for
//! edges of two faces. Where a and b are on different sides of the crease, the fan may go to another vertex of its
//! ring once nothing else helps: with that 20 folds stay, without 31, and 33 if it may from the start on.
//!
//! Based on: nothing in the papers, whose inputs are manifold.
//! In/out: a bad face and an edge of it -> the fan and the vertex that is to get it; no vertex goes or moves.
//! Cost: O(valence) for each such edge of a bad face, later on O(valence²); nothing without edges of four faces.

use super::{MIN_GAIN, Zone};
use crate::edit::Fan;
use crate::mesh::{Face, Mesh, Vert};

/// Where the fan of a pinched edge may go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Loosening {
    /// There is no edge of more than two faces.
    Never,
    ToOtherEnd,
    /// To any vertex of its ring.
    Anywhere,
}

impl Loosening {
    pub(super) fn at_first(mesh: &Mesh) -> Self {
        if mesh.defects().non_manifold_edges == 0 { Self::Never } else { Self::ToOtherEnd }
    }
}

impl Zone<'_, '_, '_> {
    /// What it gains to give the fan of `gone` that starts with `f` at a pinched edge `gone`-`other` to `other`, or
    /// later on to the vertex of its ring that gains most; the fan, and the place of that vertex.
    pub(super) fn try_loosen(&mut self, f: Face, gone: Vert, other: Vert) -> Option<(f64, Fan, usize)> {
        // Those of the input, no part of which is split or on a crease. Doubled faces may make others when they are split.
        let are_old = || !self.edit.is_inserted(gone) && !self.edit.is_inserted(other);
        if self.loosening == Loosening::Never || !self.is_inner[gone] || !are_old() {
            return None;
        }
        let fan = self.edit.fan_from(f, gone, other)?;
        let old: f64 = fan.faces.iter().map(|&f| self.value_of(f)).sum();
        let n_tried = if self.loosening == Loosening::Anywhere { fan.ring.len() } else { 1 };
        let mut best: Option<(f64, usize)> = None;
        for (i, &kept) in fan.ring.iter().enumerate().take(n_tried) {
            let limit = best.map_or(old, |(least, _)| least) - MIN_GAIN;
            let new = self.energy_with(&[gone], &[self.edit.point(kept)], fan.without(i), limit);
            if let Some(new) = new.filter(|_| self.edit.may_take(&fan, i)) {
                best = Some((new, i));
            }
        }
        best.map(|(new, i)| (old - new, fan, i))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tests::mesh;
    use crate::untangle::UntangleCounts;
    use crate::untangle::tests::{Scene, assert_near, face};
    use glam::DVec3;

    const FACES: [[usize; 3]; 14] = [
        [0, 1, 3],
        [0, 6, 2],
        [0, 8, 1],
        [0, 2, 8],
        [0, 3, 8],
        [0, 8, 6],
        [8, 3, 4],
        [8, 4, 5],
        [8, 5, 6],
        [8, 2, 7],
        [8, 7, 1],
        [3, 9, 4],
        [4, 9, 5],
        [5, 9, 6],
    ];

    // The drawing above, with a, u, w, x, p, q, y from 0 to 6, vertex 7 above b, b as vertex 8, and 9 beyond the
    // crease.
    fn pinched_with(more: &[[usize; 3]], n_old: usize) -> Scene {
        let points =
            [[0.0, 0.5], [-1., 1.5], [1., 1.5], [-1., 0.], [-0.3, -0.1], [0.3, -0.1], [1., 0.], [0., 2.]];
        let points = [&points[..], &[[0., 1.], [0., -1.]]].concat();
        let points: Vec<_> = points.into_iter().map(|[x, y]| [x, y, 0.]).collect();
        Scene::new(&points, &[&FACES[..], more].concat(), n_old, &[]).with_plane(0..n_old, DVec3::Z)
    }

    fn pinched_of(n_old: usize) -> Scene {
        pinched_with(&[], n_old)
    }

    fn pinched() -> Scene {
        pinched_of(10)
    }

    /// What handing the fan of `gone` that starts with the face with `corners` over to `kept` gains.
    fn gain(scene: &Scene, corners: [usize; 3], gone: usize, kept: usize) -> Option<f64> {
        scene.run(|zone| {
            let f = face(zone, corners);
            zone.try_loosen(f, Vert::new(gone), Vert::new(kept)).map(|(gain, ..)| gain)
        })
    }

    #[test]
    fn a_fan_over_a_sample_goes_to_that_sample() {
        assert_near(gain(&pinched(), [0, 3, 8], 8, 0).unwrap(), 5.0);
        assert_near(gain(&pinched(), [0, 8, 6], 8, 0).unwrap(), 5.0);
        assert!(gain(&pinched(), [0, 8, 1], 8, 0).is_none(), "the sheet above is sound");
        let (counts, faces) = pinched().run(|zone| {
            let mut counts = UntangleCounts::default();
            let bad = zone.bad_faces();
            zone.mend(bad, &mut counts);
            assert!(zone.bad_faces().is_empty());
            let stands = |f: &Face| zone.edit.stands(*f);
            let faces = zone.faces.iter().copied().filter(stands).map(|f| zone.edit.corners(f));
            (counts, faces.map(|t| t.map(Vert::index)).collect::<Vec<_>>())
        });
        assert_eq!(counts, UntangleCounts { loosened: 1, ..counts });
        assert_eq!((counts.collapsed, counts.flipped, counts.moved_back), (0, 0, 0));
        let below = [[0, 3, 4], [0, 4, 5], [0, 5, 6]];
        assert_eq!(faces, [&FACES[..4], &below, &FACES[9..]].concat());
    }

    #[test]
    fn no_fan_leaves_its_fit() {
        let lifted = |z: f64| gain(&pinched().moved(&[(0, [0., 0.5, z])]), [0, 3, 8], 8, 0).is_some();
        assert_eq!([0.09, 0.11].map(lifted), [true, false]);
    }

    #[test]
    fn no_fan_goes_where_the_surface_would_be_another() {
        assert!(gain(&pinched_with(&[[0, 4, 9]], 10), [0, 3, 8], 8, 0).is_none());
    }

    #[test]
    fn a_fan_that_may_not_go_to_the_other_end_goes_elsewhere_later_on() {
        let scene = pinched().moved(&[(0, [0., 0.5, 0.2])]);
        let (first, then) = scene.run(|zone| {
            let f = face(zone, [0, 3, 8]);
            let first = zone.try_loosen(f, Vert::new(8), Vert::new(0)).is_some();
            zone.loosening = Loosening::Anywhere;
            let then = zone.try_loosen(f, Vert::new(8), Vert::new(0));
            (first, then.map(|(gain, fan, i)| (gain, fan.ring[i].index())))
        });
        assert!(!first);
        let (gain, kept) = then.unwrap();
        assert!(gain > 4.7);
        assert_eq!(kept, 3, "the first of those that gain most");
    }

    #[test]
    fn only_edges_of_the_input_in_the_zone_are_loosened() {
        let (below, aside) = (([0, 3, 8], 8, 0), ([0, 3, 8], 0, 8));
        let is_loosened = |scene: &Scene, (f, gone, kept)| gain(scene, f, gone, kept).is_some();
        assert!([below, aside].iter().all(|&fan| is_loosened(&pinched_of(9), fan)), "vertex 9 is inserted");
        assert!([below, aside].iter().all(|&fan| !is_loosened(&pinched_of(8), fan)), "so is vertex 8");
        assert!(!is_loosened(&pinched().split_at(0..2), below), "vertex 8 is outside");
    }

    #[test]
    fn edges_of_two_faces_are_not_loosened() {
        assert!(gain(&pinched(), [0, 3, 8], 3, 0).is_none());
    }

    #[test]
    fn without_edges_of_more_than_two_faces_nothing_is_tried() {
        let never = |faces: &[[usize; 3]]| {
            let at_first = Loosening::at_first(&mesh(&[[0.; 3]; 10], faces));
            assert_ne!(at_first, Loosening::Anywhere);
            at_first == Loosening::Never
        };
        assert!(!never(&FACES) && never(&FACES[..3]));
    }
}
