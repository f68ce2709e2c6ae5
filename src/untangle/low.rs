//! Collapses vertices that lie so low over a crease edge that the crease may in truth run beyond them.
//!
//! ```text
//!      w-------x                w-------x       A crease is as far out of place as its fits are uncertain.
//!      |`.   .´|                |`-.    |       Where it is out by a third of the height of face a-b-v,
//!      |  `v´  |                |   `-. |       the middle of that face lies beyond the true crease, on a
//!      | .´ `. |                |      `|       face that it is turned away from. The higher face a-b-w
//!   ---a-------b--- crease   ---a-------b---    bears more.
//! ```
//!
//! Where fits are exact, a face may still fold over its crease edge: a sample right at an acute crease that lies on
//! one side may have the label of the other. Its face is turned over, but as seen from the normal of that label by no
//! more than the crease's own angle, too little to count as bad. Such a vertex goes as well.
//!
//! Based on: nothing in the papers.
//! In/out: collapses vertices of the zone that are on no crease, old or inserted.
//! Cost: O(faces of the zone) to find low faces, parallel; O(valence²) for each.

use glam::DVec3;
use rayon::prelude::*;

use super::fold::{FOLD_ANGLE, shape};
use super::{UntangleCounts, Zone};
use crate::geometry::{distance_to_triangle, unit_normal};
use crate::mesh::{Face, Vert};

/// A face is low below this many times the residual of the fits beside its crease edge: the crease is out of
/// place by about as much, at blunt angles by more. Where fits are exact, no sample is lost. At 3 a seventh
/// fewer turned faces vanish; at 30 half as many vertices again go, for no more ...
const HEIGHT_IN_RMS: f64 = 10.0;
/// ... and below this height, in mean edge lengths: at 0.2 an eighth fewer turned faces vanish, at 0.4 four times
/// as many vertices go for no more ...
const MAX_HEIGHT: f64 = 0.3;
/// ... or, where noise puts the crease out by more, below this many times the residual. Bending halves faces, and
/// the halves at the crease turn where it is out by a sixth of the height: at 5 a tenth of these vanish, half of
/// them where vertices are off by a tenth of an edge; at 10 one more in twenty, but three times as many vertices go
/// and a fandisk loses 1 % of L2.
const NOISY_HEIGHT_IN_RMS: f64 = 5.0;
/// The lowest face over a crease edge must become higher by this factor: otherwise nothing is gained.
const MIN_RISE: f64 = 1.5;
/// The surface may depart from the fits, and from the vertex that goes, by this (in mean edge lengths): without a
/// limit a cylinder's largest error grows by half and a blockhole loses 2 % of L2 ...
const MAX_OFF: f64 = 0.01;
/// ... or by as much as it did, up to this: at 0.1 a twentieth more turned faces stay, at 0.2 a fandisk loses 1 % of
/// L2 ...
const MAX_OFF_BEFORE: f64 = 0.15;
/// ... and by so many times of it, as without the vertex flat faces span a curved fit: at 1 the distance of the vertex
/// from them exceeds that from its fit by rounding alone, and 5 of 17 folds of a scanned pyramid stay; at 1.0001 those
/// of a saddle do.
const OFF_SLACK: f64 = 1.05;
/// The [`shape`] of a new face: half a degree, no angle to compute with, unless
/// a face was worse before. Thin faces away from the crease are better than low ones: at 0.05 a twentieth more
/// turned faces stay, at 0 not one less.
const MIN_SHAPE: f64 = 0.01;
/// Of the vertices to collapse into the one with the best shape wins; so much of it is worth one mean edge length of
/// departure.
const OFF_WEIGHT: f64 = 10.0;
/// A vertex with more faces than this stays: trying all its neighbours takes time in the square of their number.
const MAX_FAN: usize = 32;
/// The second round finds what the first one left low.
const ROUNDS: usize = 2;

/// A low face, or one that folds over its crease edge, of whose vertices the one on no crease belongs to a split face.
struct Low {
    height: f64,
    face: Face,
    /// The vertex that is on no crease.
    vert: Vert,
}

impl Zone<'_, '_, '_> {
    /// Collapses vertices that lie low over crease edges or fold over them, the lowest first.
    pub(super) fn collapse_low_faces(&mut self, counts: &mut UntangleCounts) {
        let mut verts: Vec<Vert> = (self.n_old..self.n_old + self.creases.len()).map(Vert::new).collect();
        for _ in 0..ROUNDS {
            let mut low: Vec<Low> = verts.par_iter().flat_map_iter(|&v| self.low_beside(v)).collect();
            low.sort_unstable_by(|x, y| x.height.total_cmp(&y.height).then(x.face.cmp(&y.face)));
            // The vertices whose faces have changed, and those of faces that stay low.
            let (mut n_collapsed, mut near) = (0, Vec::new());
            for Low { face, .. } in low {
                if !self.edit.stands(face) {
                    continue;
                }
                near.extend(self.edit.corners(face));
                if let Some(Low { height, vert, .. }) = self.low(face)
                    && let Some(kept) = self.best_neighbour(vert, height)
                {
                    near.extend(self.edit.link(vert));
                    self.collapse(vert, kept);
                    n_collapsed += 1;
                }
            }
            if n_collapsed == 0 {
                break;
            }
            counts.collapsed += n_collapsed;
            // No other face can be low now.
            let faces: Vec<Face> = near.iter().flat_map(|&v| self.edit.faces_at(v)).copied().collect();
            verts = self.verts_of(&faces);
        }
    }

    /// The low faces beside the crease edges from `v` to vertices of higher index.
    fn low_beside(&self, v: Vert) -> impl Iterator<Item = Low> + '_ {
        let higher = self.crease(v).iter().filter(move |&&w| v < w);
        higher.flat_map(move |&w| self.edit.faces_with(v, w)).filter_map(|f| self.low(f))
    }

    /// Whether `f` has a crease edge and is low over it, or near it and folded.
    fn low(&self, f: Face) -> Option<Low> {
        let t = self.edit.corners(f);
        let (height, vert) = self.height_over_crease(t)?;
        if !self.is_inner[vert] || self.edit.faces_at(vert).len() > MAX_FAN {
            return None;
        }
        let [a, b] = [0, 1].map(|i| if t[i] == vert { t[2] } else { t[i] });
        // Without a fit there is doubt, but nothing to tell noise by.
        let residual = |g: Face| self.fit(g).map_or(MAX_HEIGHT / NOISY_HEIGHT_IN_RMS, |fit| fit.rms);
        let doubt = self.edit.faces_with(a, b).filter(|&g| self.in_zone(g)).map(residual).fold(0.0, f64::max);
        let limit = MAX_HEIGHT.max(NOISY_HEIGHT_IN_RMS * doubt).min(HEIGHT_IN_RMS * doubt);
        let is_low = height < limit || (height < MAX_HEIGHT && self.folds_over(f, a, b));
        is_low.then_some(Low { height, face: f, vert })
    }

    /// Whether `f` folds back onto the face across its edge `a`-`b`.
    fn folds_over(&self, f: Face, a: Vert, b: Vert) -> bool {
        let normal = |g: Face| unit_normal(self.edit.triangle(g));
        let folds =
            |n: DVec3| self.edit.faces_with(a, b).filter_map(normal).any(|m| n.dot(m) < FOLD_ANGLE.cos());
        normal(f).is_some_and(folds)
    }

    /// The corner of a triangle that is on no crease, where the other two are joined by one, and how high it is over
    /// that edge, in mean edge lengths.
    fn height_over_crease(&self, t: [Vert; 3]) -> Option<(f64, Vert)> {
        let i = (0..3)
            .find(|&i| self.is_crease(t[(i + 1) % 3], t[(i + 2) % 3]) && self.crease(t[i]).is_empty())?;
        let [p, a, b] = [t[i], t[(i + 1) % 3], t[(i + 2) % 3]].map(|v| self.edit.point(v));
        Some(((a - p).cross(b - p).length() / (a.distance(b) * self.context.mean_edge), t[i]))
    }

    /// The neighbour of `v` to collapse it into, if any is fit for that. `height` is that of a low face at `v`.
    fn best_neighbour(&mut self, v: Vert, height: f64) -> Option<Vert> {
        let faces = self.edit.faces_at(v).to_vec();
        let point = self.edit.point(v);
        let limit = |off: f64| MAX_OFF.max((OFF_SLACK * off).min(MAX_OFF_BEFORE));
        let own = faces.iter().map(|&f| self.off_fit(point, f)).fold(0.0, f64::max);
        let middles =
            faces.iter().map(|&f| self.middles_off_fit(self.edit.triangle(f), f)).fold(0.0, f64::max);
        let least_shape = faces.iter().map(|&f| shape(self.edit.triangle(f))).fold(MIN_SHAPE, f64::min);
        let mut best: Option<(f64, Vert)> = None;
        for kept in self.edit.link(v) {
            let stay = || faces.iter().copied().filter(|&f| !self.edit.has_corner(f, kept));
            let corners = |f: Face| self.edit.corners(f).map(|w| if w == v { kept } else { w });
            let triangle = |f: Face| corners(f).map(|w| self.edit.point(w));
            let new_shape = stay().map(|f| shape(triangle(f))).fold(f64::INFINITY, f64::min);
            let stays_low = || {
                stay()
                    .filter_map(|f| self.height_over_crease(corners(f)))
                    .any(|(new, _)| new < MIN_RISE * height)
            };
            if new_shape < least_shape || stays_low() {
                continue;
            }
            let off = stay().map(|f| self.middles_off_fit(triangle(f), f)).fold(0.0, f64::max);
            let gap = stay().map(|f| distance_to_triangle(point, triangle(f))).fold(f64::INFINITY, f64::min);
            let gap = gap / self.context.mean_edge;
            let is_fit = off <= limit(middles) && gap <= limit(own) && !self.would_fold(v, kept, &faces);
            let value = new_shape - OFF_WEIGHT * (gap + off);
            if is_fit
                && best.is_none_or(|(most, _)| value > most)
                && self.try_collapse(v, kept, true).is_some()
            {
                best = Some((value, kept));
            }
        }
        best.map(|(_, kept)| kept)
    }

    /// How far the middles of the sides and of the triangle are from the fit of `f` at most.
    fn middles_off_fit(&self, [a, b, c]: [DVec3; 3], f: Face) -> f64 {
        let middles = [a.midpoint(b), b.midpoint(c), c.midpoint(a), (a + b + c) / 3.0];
        middles.into_iter().map(|p| self.off_fit(p, f)).fold(0.0, f64::max)
    }

    /// Whether a face that goes from `gone`, with `faces`, to `kept` would fold with a neighbour.
    fn would_fold(&self, gone: Vert, kept: Vert, faces: &[Face]) -> bool {
        let corners = |f: Face| self.edit.corners(f).map(|w| if w == gone { kept } else { w });
        let normal = |f: Face| unit_normal(corners(f).map(|w| self.edit.point(w)));
        let is_gone = |f: Face| faces.contains(&f) && self.edit.has_corner(f, kept);
        let stay = || faces.iter().copied().filter(|&f| !is_gone(f));
        stay().any(|f| {
            let Some(n) = normal(f) else { return true };
            let t = corners(f);
            (0..3).map(|i| (t[i], t[(i + 1) % 3])).any(|(a, b)| {
                let across = stay().chain(self.edit.faces_with(a, b).filter(|g| !faces.contains(g)));
                let mut across = across.filter(|&g| g != f && [a, b].iter().all(|w| corners(g).contains(w)));
                across.any(|g| normal(g).is_none_or(|m| n.dot(m) < FOLD_ANGLE.cos()))
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::edit::Edit;
    use crate::fit::{Fit, FitSource};
    use crate::mesh::tests::mesh;
    use crate::mesh::{Half, Mesh, PerVert};
    use crate::refine::{Inserts, refine};
    use crate::untangle::Context;

    // A sheet of 5 by 6 vertices in the plane, row after row from y = -2 to 3. The edges between the third and the
    // fourth are split at y = 1/2: the new vertices make a crease there, at height `z`. The middle sample of the third row,
    // vertex 12, is at `sample`.
    fn collapsed_beside(z: f64, sample: DVec3, rms: f64) -> (usize, bool) {
        let plane = |_| Some(Fit { rms, ..Fit::plane(DVec3::ZERO, DVec3::Z, FitSource::Region) });
        let (n_collapsed, replaced, _) = collapsed_with(z, sample, 1.0, plane);
        (n_collapsed, replaced == [Vert::new(12)])
    }

    // The same at any scale, with a fit for each old vertex: how many collapsed, which are gone, and what came out.
    fn collapsed_with(
        z: f64,
        sample: DVec3,
        scale: f64,
        fit: impl Fn(usize) -> Option<Fit>,
    ) -> (usize, Vec<Vert>, Mesh) {
        let mut points: Vec<[f64; 3]> =
            (0..30).map(|i| [f64::from(i % 5), f64::from(i / 5) - 2.0, 0.0]).collect();
        points[12] = sample.to_array();
        points.iter_mut().flatten().for_each(|x| *x *= scale);
        let square = |c: usize| [[c, c + 1, c + 6], [c, c + 6, c + 5]];
        let corners = (0..25).filter(|c| c % 5 != 4).flat_map(square);
        let before = mesh(&points, &corners.collect::<Vec<_>>());
        let is_between = |h: Half| {
            let rows = before.ends(h).map(|v| v.index() / 5);
            rows.contains(&2) && rows.contains(&3)
        };
        let mut inserts = Inserts::in_the_middle(&before, is_between, &[]);
        inserts.points.iter_mut().for_each(|p| (p.y, p.z) = (0.5 * scale, z * scale));
        let refined = refine(&before, &inserts).unwrap();
        let fits: Vec<Option<Fit>> = (0..30).map(fit).collect();
        let fits = fits.iter().map(Option::as_ref).collect::<Vec<_>>().into();
        let context = Context { fits, mean_edge: scale, ..Context::plain(&before, &refined, None) };
        let is_whole = PerVert::filled(refined.mesh.n_verts(), true);
        let mut edit = Edit::new(&refined, before.n_verts(), &is_whole);
        let mut counts = UntangleCounts::default();
        Zone::new(&context, &mut edit).collapse_low_faces(&mut counts);
        let edited = edit.finish(&before, &inserts, |v| v, true).unwrap();
        edited.mesh.check().unwrap();
        assert!(edited.mesh.face_normals().as_slice().iter().all(|n| n.z > 0.5));
        (counts.collapsed, edited.replaced, edited.mesh)
    }

    fn collapsed(sample: DVec3, rms: f64) -> (usize, bool) {
        collapsed_beside(0.0, sample, rms)
    }

    #[test]
    fn a_sample_goes_if_it_is_lower_than_the_crease_is_certain() {
        let low = DVec3::new(2.0, 0.4, 0.0);
        assert_eq!(collapsed(low, 0.02), (1, true));
        assert_eq!(collapsed(low, 0.005), (0, false), "0.1 is more than ten times the residual");
        let higher = DVec3::new(2.0, 0.1, 0.0);
        assert_eq!(collapsed(higher, 0.05), (0, false), "no face is as low as 0.3");
        assert_eq!(collapsed(higher, 0.1), (1, true), "noise");
    }

    #[test]
    fn a_sample_whose_faces_fold_over_the_crease_goes_however_certain_that_is() {
        assert_eq!(collapsed(DVec3::new(2.0, 0.505, 0.0), 0.0), (1, true));
        assert_eq!(collapsed(DVec3::new(2.0, 0.495, 0.0), 0.0), (0, false), "nothing folds");
    }

    #[test]
    fn a_sample_off_its_fit_goes_even_if_the_crease_is_a_little_off_on_the_other_side() {
        let beside = |z: f64| collapsed_beside(z, DVec3::new(2.0, 0.3, 0.08), 0.05);
        assert_eq!(beside(-0.004), (1, true), "a thirtieth more than from the fit");
        assert_eq!(beside(-0.02), (0, false), "a seventh more");
    }

    #[test]
    fn a_sample_stays_if_the_surface_would_depart_from_it() {
        let lifted = |z: f64| collapsed(DVec3::new(2.0, 0.3, z), 0.05);
        assert_eq!(lifted(0.12), (1, true), "it was off its fit by as much");
        assert_eq!(lifted(0.19), (0, false));
    }

    const LOW: DVec3 = DVec3::new(2.0, 0.4, 0.0);

    fn plane(rms: f64) -> Option<Fit> {
        Some(Fit { rms, ..Fit::plane(DVec3::ZERO, DVec3::Z, FitSource::Region) })
    }

    #[test]
    fn heights_and_distances_are_in_mean_edges() {
        for scale in [0.01, 1.0, 100.0] {
            let n = |sample| collapsed_with(0.0, sample, scale, |_| plane(0.02)).0;
            assert_eq!((n(LOW), n(DVec3::new(2.0, 0.2, 0.0))), (1, 0), "{scale}");
            let lifted = |z| collapsed_with(0.0, DVec3::new(2.0, 0.3, z), scale, |_| plane(0.05)).0;
            assert_eq!((lifted(0.12), lifted(0.19)), (1, 0), "{scale}");
        }
    }

    #[test]
    fn the_crease_is_as_uncertain_as_the_worse_of_its_sides() {
        let n = |below: Option<Fit>, above: Option<Fit>| {
            collapsed_with(0.0, LOW, 1.0, |v| if v < 15 { below.clone() } else { above.clone() }).0
        };
        assert_eq!(n(plane(0.0), plane(0.0)), 0);
        assert_eq!(n(plane(0.02), plane(0.0)), 1);
        assert_eq!(n(plane(0.0), plane(0.02)), 1);
        assert_eq!(n(plane(0.0), None), 1, "without a fit there is doubt");
    }

    #[test]
    fn the_sample_goes_where_the_faces_that_are_left_have_the_best_shape() {
        // The worst of its neighbours would leave faces a third as good.
        for (sample, least) in
            [(LOW, 0.3), (DVec3::new(1.9, 0.4, 0.0), 0.27), (DVec3::new(2.2, 0.35, 0.0), 0.287)]
        {
            let (n, _, mesh) = collapsed_with(0.0, sample, 1.0, |_| plane(0.05));
            let worst = mesh.face_ids().map(|f| shape(mesh.triangle(f))).fold(f64::INFINITY, f64::min);
            assert!(n == 1 && worst > least - 1e-3, "{sample}: {worst}");
        }
    }
}
