//! Pulls bad faces out of the faces that they cut.
//!
//! In/out: moves inserted vertices of the zone, as far back towards the middle of their edges as helps.
//! Cost: O(bad faces that are left), each against the faces within [`RINGS`] rings.

use glam::DVec3;
use rayon::prelude::*;

use super::{UntangleCounts, Zone};
use crate::mesh::{Face, Vert};

/// A face may cut others this many rings away: in thin wedges the opposite sheet.
const RINGS: usize = 3;
/// No more faces than this are looked at of one vertex: there are some six.
const MAX_FAN: usize = 64;
/// Shares of the way back to the middle that are tried.
const SHARES: [f64; 4] = [0.25, 0.5, 0.75, 1.0];

/// A vertex or face near the zone. The excerpt ends before what a face may cut: a vertex of which it does not have all
/// faces, what lies beyond, and the faces there are those of the mesh before, as no edit gets so far.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Near<I> {
    Edited(I),
    Before(I),
}

impl Zone<'_, '_, '_> {
    /// Moves inserted vertices of bad faces that cut others, and of those cut, until fewer faces cut each
    /// other.
    pub(super) fn uncross(&mut self, counts: &mut UntangleCounts) {
        let bad = self.bad_faces();
        // So it stays until a vertex moves.
        let cut: Vec<_> = bad.par_iter().map(|&f| self.faces_cut_by(f)).collect();
        let mut has_moved = false;
        for (f, cut) in bad.into_iter().zip(cut) {
            let mut cut = if has_moved { self.faces_cut_by(f) } else { cut };
            if cut.is_empty() {
                continue;
            }
            cut.push(Near::Edited(f));
            // No face from before has an inserted vertex.
            let edited = cut.iter().filter_map(|&g| if let Near::Edited(g) = g { Some(g) } else { None });
            let mut verts: Vec<Vert> = edited.flat_map(|f| self.edit.corners(f)).collect();
            verts.retain(|&v| self.edit.is_inserted(v));
            verts.sort_unstable();
            verts.dedup();
            if let Some((v, to)) = self.best_way_out(&verts) {
                self.edit.move_to(v, to);
                let faces: Vec<Face> = self.edit.faces_at(v).to_vec();
                faces.into_iter().for_each(|f| self.forget(f));
                counts.moved_back += 1;
                has_moved = true;
            }
        }
    }

    /// Which of `verts` to move and where to, so that the most cuts and bad faces vanish.
    fn best_way_out(&mut self, verts: &[Vert]) -> Option<(Vert, DVec3)> {
        let mut best: Option<(f64, Vert, DVec3)> = None;
        for &v in verts {
            let (from, middle) = (self.edit.point(v), self.context.refined.middles[v.index() - self.n_old]);
            let (cuts, bad) = self.trouble_at(v);
            for share in SHARES {
                let to = from.lerp(middle, share);
                self.edit.move_to(v, to);
                let (cuts_then, bad_then) = self.trouble_at(v);
                let gain = f64::from(cuts) - f64::from(cuts_then) + bad - bad_then;
                if cuts_then < cuts && gain > best.map_or(0.0, |(most, ..)| most) {
                    best = Some((gain, v, to));
                }
            }
            self.edit.move_to(v, from);
        }
        best.map(|(_, v, to)| (v, to))
    }

    /// How often the faces at `v` cut others, and their summed energy.
    fn trouble_at(&self, v: Vert) -> (u32, f64) {
        let faces = self.edit.faces_at(v);
        let badness = |f: Face| self.value(self.energy_of(self.edit.triangle(f), f));
        let add = |(cuts, bad), &f: &Face| (cuts + self.faces_cut_by(f).len() as u32, bad + badness(f));
        faces.iter().fold((0, 0.0), add)
    }

    /// The faces within reach that `f` cuts, ascending.
    fn faces_cut_by(&self, f: Face) -> Vec<Near<Face>> {
        let (mut cut, mut faces, mut verts) = (Vec::new(), vec![Near::Edited(f)], Vec::new());
        for _ in 0..RINGS {
            // What is not in the ring before is new.
            verts = without(&verts, faces.iter().flat_map(|&f| self.corners_near(f)));
            let mut around = Vec::new();
            verts.iter().for_each(|&v| self.add_faces_near(v, &mut around));
            faces = without(&faces, around);
            cut.extend(faces.iter().copied().filter(|&g| self.cut_each_other(f, g)));
        }
        cut.sort_unstable();
        cut.dedup();
        cut
    }

    fn add_faces_near(&self, v: Near<Vert>, faces: &mut Vec<Near<Face>>) {
        match v {
            Near::Edited(v) => {
                let parent = |f: Face| self.context.refined.lineage.parents[f];
                let is_inside = |f: Face| self.edit.corners(f).into_iter().all(|w| self.is_inside(w));
                let near = |&f| if is_inside(f) { Near::Edited(f) } else { Near::Before(parent(f)) };
                faces.extend(self.edit.faces_at(v).iter().take(MAX_FAN).map(near));
            }
            Near::Before(v) => {
                let at_v = self.context.before.leaving(v).chunk_by(|g, h| g.face() == h.face());
                faces.extend(at_v.take(MAX_FAN).map(|halves| Near::Before(halves[0].face())));
            }
        }
    }

    /// Whether the excerpt has all faces of its vertex `v`.
    fn is_inside(&self, v: Vert) -> bool {
        self.context.excerpt.is_none_or(|excerpt| excerpt.is_whole[v])
    }

    fn corners_near(&self, f: Near<Face>) -> [Near<Vert>; 3] {
        let own = |v: Vert| self.context.excerpt?.own(v).filter(|&v| self.is_inside(v));
        match f {
            Near::Edited(f) => self.edit.corners(f).map(Near::Edited),
            Near::Before(f) => {
                self.context.before.corners(f).map(|v| own(v).map_or(Near::Before(v), Near::Edited))
            }
        }
    }

    fn triangle_near(&self, f: Near<Face>) -> [DVec3; 3] {
        match f {
            Near::Edited(f) => self.edit.triangle(f),
            Near::Before(f) => self.context.before.corners(f).map(|v| self.context.old_point(v)),
        }
    }

    /// Whether `f` and `g` cut each other: at a common vertex or edge they only touch.
    fn cut_each_other(&self, f: Face, g: Near<Face>) -> bool {
        let [p, q] = [Near::Edited(f), g].map(|f| self.triangle_near(f));
        let low = |t: [DVec3; 3]| t[0].min(t[1]).min(t[2]);
        let high = |t: [DVec3; 3]| t[0].max(t[1]).max(t[2]);
        if high(p).cmplt(low(q)).any() || high(q).cmplt(low(p)).any() {
            return false;
        }
        let [t, u] = [Near::Edited(f), g].map(|f| self.corners_near(f));
        if t.iter().filter(|v| u.contains(v)).count() > 1 {
            return false;
        }
        let pierces = |of: [Near<Vert>; 3], by: [Near<Vert>; 3], points: [DVec3; 3], target: [DVec3; 3]| {
            let is_free = |i: &usize| !by.contains(&of[*i]) && !by.contains(&of[(i + 1) % 3]);
            (0..3).filter(is_free).any(|i| passes_through([points[i], points[(i + 1) % 3]], target))
        };
        pierces(t, u, p, q) || pierces(u, t, q, p)
    }
}

/// What is not among the `known`, which are ascending: ascending, once each.
fn without<T: Ord>(known: &[T], all: impl IntoIterator<Item = T>) -> Vec<T> {
    let mut new: Vec<T> = all.into_iter().filter(|x| known.binary_search(x).is_err()).collect();
    new.sort_unstable();
    new.dedup();
    new
}

/// Whether the segment passes through the triangle.
fn passes_through([p, q]: [DVec3; 2], [a, b, c]: [DVec3; 3]) -> bool {
    let volume = |p: DVec3, a: DVec3, b: DVec3, c: DVec3| (a - p).cross(b - p).dot(c - p);
    let sides = [volume(p, a, b, c), volume(q, a, b, c)];
    let turns = [volume(p, q, a, b), volume(p, q, b, c), volume(p, q, c, a)];
    sides[0] * sides[1] < 0.0 && (turns.iter().all(|&t| t > 0.0) || turns.iter().all(|&t| t < 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::edit::Edit;
    use crate::excerpt::Excerpt;
    use crate::mesh::tests::mesh;
    use crate::mesh::{Half, PerVert};
    use crate::refine::{Inserts, split};
    use crate::untangle::Context;
    use glam::dvec3;

    #[test]
    fn a_segment_passes_through_a_triangle_or_not() {
        let triangle = [dvec3(0., 0., 0.), dvec3(1., 0., 0.), dvec3(0., 1., 0.)];
        let upright = |x, y, from, to| passes_through([dvec3(x, y, from), dvec3(x, y, to)], triangle);
        assert!(upright(0.2, 0.2, -1., 1.) && upright(0.2, 0.2, 1., -1.));
        assert!(!upright(0.8, 0.8, -1., 1.), "beside it");
        assert!(!upright(0.2, 0.2, 1., 2.), "above it");
        assert!(!upright(0.2, 0.2, 0., 1.), "it only touches");
    }

    // A strip along x from 4 to 0 at z = 0, its first square rising from there, and back at z = 0.2. The new vertex in
    // the middle of the last square below goes to `tip`; the excerpt has so many rings.
    fn height_after_uncrossing(tip: [f64; 3], rings: usize) -> (f64, usize) {
        let below = [(4., 0.3), (3., 0.), (2., 0.), (1., 0.), (0., 0.)];
        let above = [(0., 0.2), (1., 0.2), (2., 0.2), (3., 0.2)];
        let columns = [&below[..], &above].concat();
        let mut points: Vec<[f64; 3]> = columns.iter().flat_map(|&(x, z)| [[x, 0., z], [x, 1., z]]).collect();
        // A corner of the first square was elsewhere.
        let moved = (Vert::new(3), DVec3::from(std::mem::replace(&mut points[3], [9., 1., 0.])));
        let square = |c: usize| [[2 * c, 2 * c + 2, 2 * c + 3], [2 * c, 2 * c + 3, 2 * c + 1]];
        let before = mesh(&points, &(0..8).flat_map(square).collect::<Vec<_>>());
        let diagonal = before.half_between(Vert::new(6), Vert::new(9)).unwrap();
        let is_diagonal = |h: Half| before.edge(h) == before.edge(diagonal);
        let mut inserts = Inserts::in_the_middle(&before, is_diagonal, &[]);
        inserts.points[0] = DVec3::from(tip);
        inserts.moved = vec![moved];
        let excerpt = Excerpt::new(&before, &inserts, &split(&before, &inserts).unwrap(), &[], rings);
        let n_old = excerpt.n_old();
        let plain = Context::plain(&before, &excerpt.refined, None);
        let context = Context { excerpt: Some(&excerpt), n_old, fits: PerVert::filled(n_old, None), ..plain };
        let mut edit = Edit::new(&excerpt.refined, n_old, &excerpt.is_whole);
        let mut counts = UntangleCounts::default();
        Zone::new(&context, &mut edit).uncross(&mut counts);
        assert!(!edit.is_at_fringe());
        (edit.point(Vert::new(n_old)).z, counts.moved_back)
    }

    #[test]
    fn a_spike_is_pulled_out_of_the_sheet_that_it_cuts() {
        let after = |to: f64| height_after_uncrossing([0.5, 0.5, to], 9);
        assert_eq!(after(2.0), (0.0, 1), "three quarters of the way are not enough");
        assert_eq!(after(-2.0), (-2.0, 0), "it cuts nothing");
    }

    #[test]
    fn what_a_face_cuts_may_lie_beyond_the_excerpt() {
        // A face at x = 1 cuts the first square, none of whose vertices has all faces in an excerpt of two rings.
        for rings in [2, 9] {
            assert_eq!(height_after_uncrossing([4.8, 0.5, 0.15], rings), (0.0, 1));
            assert_eq!(height_after_uncrossing([2.8, 0.5, 0.15], rings), (0.15, 0), "it cuts nothing");
        }
    }
}
