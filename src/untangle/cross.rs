//! Pulls bad faces out of the faces that they cut.
//!
//! In/out: moves inserted vertices of the zone, as far back towards the middle of their edges as helps.
//! Cost: O(bad faces that are left), each against the faces within [`RINGS`] rings.

use glam::DVec3;

use super::{UntangleCounts, Zone};
use crate::mesh::{Face, Vert};

/// A face may cut others this many rings away: in thin wedges the opposite sheet.
const RINGS: usize = 3;
/// No more faces than this are looked at of one vertex: there are some six.
const MAX_FAN: usize = 64;
/// Shares of the way back to the middle that are tried.
const SHARES: [f64; 4] = [0.25, 0.5, 0.75, 1.0];

impl Zone<'_, '_, '_> {
    /// Moves inserted vertices of bad faces that cut others, and of those cut, until fewer faces cut each
    /// other.
    pub(super) fn uncross(&mut self, counts: &mut UntangleCounts) {
        for f in self.bad_faces() {
            let mut cut = self.faces_cut_by(f);
            if cut.is_empty() {
                continue;
            }
            cut.push(f);
            let mut verts: Vec<Vert> = cut.iter().flat_map(|&f| self.edit.corners(f)).collect();
            verts.retain(|&v| self.edit.is_inserted(v));
            verts.sort_unstable();
            verts.dedup();
            if let Some((v, to)) = self.best_way_out(&verts) {
                self.edit.move_to(v, to);
                let faces: Vec<Face> = self.edit.faces_at(v).to_vec();
                faces.into_iter().for_each(|f| self.forget(f));
                counts.moved_back += 1;
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
    fn faces_cut_by(&self, f: Face) -> Vec<Face> {
        let mut near = vec![f];
        let mut verts: Vec<Vert> = Vec::new();
        for _ in 0..RINGS {
            let known = verts.clone();
            verts.extend(near.iter().flat_map(|&f| self.edit.corners(f)));
            verts.sort_unstable();
            verts.dedup();
            let new = verts.iter().filter(|v| known.binary_search(v).is_err());
            near.extend(new.flat_map(|&v| self.edit.faces_at(v).iter().take(MAX_FAN)));
            near.sort_unstable();
            near.dedup();
        }
        near.retain(|&g| self.cut_each_other(f, g));
        near
    }

    /// Whether `f` and `g` cut each other: at a common vertex or edge they only touch.
    fn cut_each_other(&self, f: Face, g: Face) -> bool {
        let (t, u) = (self.edit.corners(f), self.edit.corners(g));
        let n_common = t.iter().filter(|v| u.contains(v)).count();
        let (p, q) = (self.edit.triangle(f), self.edit.triangle(g));
        let low = |t: [DVec3; 3]| t[0].min(t[1]).min(t[2]);
        let high = |t: [DVec3; 3]| t[0].max(t[1]).max(t[2]);
        if n_common > 1 || high(p).cmplt(low(q)).any() || high(q).cmplt(low(p)).any() {
            return false;
        }
        let pierces = |of: [Vert; 3], by: [Vert; 3], points: [DVec3; 3], target: [DVec3; 3]| {
            let is_free = |i: &usize| !by.contains(&of[*i]) && !by.contains(&of[(i + 1) % 3]);
            (0..3).filter(is_free).any(|i| passes_through([points[i], points[(i + 1) % 3]], target))
        };
        pierces(t, u, p, q) || pierces(u, t, q, p)
    }
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
    use crate::mesh::tests::mesh;
    use crate::mesh::{Half, PerVert};
    use crate::refine::{Inserts, refine};
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

    // A strip along x from 3 to 0 at z = 0, and back at z = 0.2. The new vertex in the middle of the last
    // square below goes to z = `to`.
    fn height_after_uncrossing(to: f64) -> (f64, usize) {
        let columns = [(3., 0.), (2., 0.), (1., 0.), (0., 0.), (0., 0.2), (1., 0.2), (2., 0.2), (3., 0.2)];
        let points: Vec<[f64; 3]> = columns.iter().flat_map(|&(x, z)| [[x, 0., z], [x, 1., z]]).collect();
        let square = |c: usize| [[2 * c, 2 * c + 2, 2 * c + 3], [2 * c, 2 * c + 3, 2 * c + 1]];
        let before = mesh(&points, &(0..7).flat_map(square).collect::<Vec<_>>());
        let diagonal = before.half_between(Vert::new(4), Vert::new(7)).unwrap();
        let is_diagonal = |h: Half| before.edge(h) == before.edge(diagonal);
        let mut inserts = Inserts::in_the_middle(&before, is_diagonal, &[]);
        inserts.points[0].z = to;
        let refined = refine(&before, &inserts).unwrap();
        let context = Context::plain(&before, &refined, None);
        let is_whole = PerVert::filled(refined.mesh.n_verts(), true);
        let mut edit = Edit::new(&refined, before.n_verts(), &is_whole);
        let mut counts = UntangleCounts::default();
        Zone::new(&context, &mut edit).uncross(&mut counts);
        (edit.point(Vert::new(16)).z, counts.moved_back)
    }

    #[test]
    fn a_spike_is_pulled_out_of_the_sheet_that_it_cuts() {
        assert_eq!(height_after_uncrossing(2.0), (0.0, 1), "three quarters of the way are not enough");
        assert_eq!(height_after_uncrossing(-2.0), (-2.0, 0), "it cuts nothing");
    }
}
