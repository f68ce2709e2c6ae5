//! Carries labels along: a vertex that no region explains may be explained by vertices that have a label.
//!
//! ```text
//!   i---i---i             i  interior vertex of a smooth region
//!   | / | / |             L  labelled vertex: a sample of its region, at its corrected place
//!   L---L---L-.           ?  no region comes near enough: the labelled vertices on the way to it, which
//!   | / | / |   `-.          agree with each other, make a region of their own
//!   ?---?---?------?
//! ```
//!
//! Based on: nothing in the papers. Narrow zones at corners and between creases have no interior vertex of
//! their own; their labels come from where they widen.
//! In/out: `Surface` + fits -> more fits; those that are far from their vertex are replaced by better ones.
//! Cost: a patch and a few fits per vertex that nothing explains, and again where labels are new, in parallel.

use std::ops::RangeInclusive;

use glam::DVec3;

use super::VertexFits;
use super::label::{SHALLOW_TRUST, best, explain_those, score};
use super::patch::{Member, Patch, REACH_IN_REGION, Regions};
use super::surface::Surface;
use crate::fit::{Fit, FitSource, Fitter, Sample};
use crate::mesh::{Half, Vert};

/// Labels are carried this many times, 3 h each: what is farther from a region is better left alone.
const ROUNDS: usize = 3;
/// What changed farther than this from a vertex, in h, is not in its patch; a little more than that goes.
const NEWS_REACH: f64 = 1.01 * REACH_IN_REGION;
/// Neighbours are on the same surface when their normals are within this angle, in radians ...
const JOINED_ANGLE: f64 = 30.0 * std::f64::consts::PI / 180.0;
/// ... and their difference rises above their mean tangent plane by at most this share of its length ...
const JOINED_SLOPE: f64 = 0.2;
/// ... plus this, in h.
const JOINED_HEIGHT: f64 = 0.03;
/// A region of labels has at least this many members.
const MIN_MEMBERS: usize = 4;
/// A fit of labels with a larger residual (in h) is no smooth surface.
const MAX_RMS: f64 = 0.1;
/// One face of a vertex has to be within this angle of the fit's normal, in radians.
const FOLLOWING_ANGLE: f64 = 45.0 * std::f64::consts::PI / 180.0;

/// A label that is far from its vertex may be that of the next region: one that is carried along replaces it
/// if it explains the vertex better by this, in h. A label that is not so far has to be farther by it as well:
/// what is carried along has samples nearer by than it, and the score counts that too.
const CLEARLY_BETTER: f64 = 0.03;

/// A label is far only if it is so by this many times the residual of its fit: a biased fit is biased for
/// all, and replacing it here and there made a countersink look round.
const FAR_IN_RMS: f64 = 4.0;

/// Gives the vertices without a fit, or with one that is far (from the first of `far` on if its fit is exact,
/// from the last on in any case), one of the labelled vertices round them, round by round. None is farther than `limit` from its vertex; both in h.
pub(super) fn grow(surface: &Surface, fits: &mut VertexFits, far: RangeInclusive<f64>, limit: f64) {
    let near = &surface.near;
    let carried = |fit: &Fit| {
        let place = fit.origin + surface.h * fit.displacement * fit.normal;
        Carried { place, normal: fit.normal }
    };
    let mut is_member = near.interior.clone();
    let own = near.points.iter().zip(&near.normals).map(|(&place, &normal)| Carried { place, normal });
    let mut labels: Vec<Carried> = own.collect();
    for (v, fit) in fits.iter().filter(|&(v, _)| !surface.interior[v]) {
        let i = near.of[v] as usize;
        (labels[i], is_member[i]) = (carried(fit), true);
    }
    let is_open = |v: Vert, fit: Option<&Fit>| {
        let is_far =
            |fit: &Fit| fit.displacement.abs() > (FAR_IN_RMS * fit.rms).clamp(*far.start(), *far.end());
        !surface.interior[v] && fit.is_none_or(is_far)
    };
    let mut news: Option<News> = None;
    for _ in 0..ROUNDS {
        let explain = |scratch: &mut Scratch, fits: &VertexFits, v| {
            let centre = near.of[v];
            let place = near.points[centre as usize];
            if news.as_ref().is_some_and(|news| !news.is_within(NEWS_REACH * surface.h, place)) {
                return None; // Round it is all as it was, when nothing better was found.
            }
            let grown = Grown { surface, labels: &labels, is_member: &is_member, centre };
            let found = grown.explain(scratch, limit)?;
            let is_better = |old: &Fit| {
                let (now, then) = (found.displacement.abs(), old.displacement.abs());
                let is_nearer = then > *far.end() || now < then - CLEARLY_BETTER;
                is_nearer && score(&found) < score(old) - CLEARLY_BETTER
            };
            fits.get(v).is_none_or(is_better).then_some(found)
        };
        let found = explain_those(fits, is_open, explain);
        if found.is_empty() {
            break;
        }
        news = Some(News::of(found.iter().map(|&v| surface.mesh.point(v))));
        for v in found {
            let i = near.of[v] as usize;
            (labels[i], is_member[i]) = (fits.get(v).map_or(labels[i], carried), true);
        }
    }
}

/// Points among which those near a place are found.
struct News {
    /// Ascending by x.
    points: Vec<DVec3>,
}

impl News {
    fn of(points: impl Iterator<Item = DVec3>) -> Self {
        let mut points: Vec<DVec3> = points.collect();
        points.sort_unstable_by(|p, q| p.x.total_cmp(&q.x));
        Self { points }
    }

    /// Whether one of the points is within `reach` of `place`.
    fn is_within(&self, reach: f64, place: DVec3) -> bool {
        let start = self.points.partition_point(|p| p.x < place.x - reach);
        let mut slab = self.points[start..].iter().take_while(|p| p.x <= place.x + reach);
        slab.any(|p| p.distance_squared(place) <= reach * reach)
    }
}

/// Working space of one worker.
#[derive(Default)]
struct Scratch {
    patch: Patch,
    samples: Vec<Sample>,
    fitter: Fitter,
}

/// A vertex where its label puts it, with the label's normal.
#[derive(Clone, Copy)]
struct Carried {
    place: DVec3,
    normal: DVec3,
}

/// The smooth regions, grown by the vertices that they explain, as `centre` sees them: without itself.
struct Grown<'a> {
    surface: &'a Surface<'a>,
    /// Of the near vertices: those that have a label where it puts them, the others where they are.
    labels: &'a [Carried],
    /// Which of them are interior or have a label.
    is_member: &'a [bool],
    centre: u32,
}

impl Regions for Grown<'_> {
    #[inline]
    fn is_member(&self, v: u32) -> bool {
        v != self.centre && self.is_member[v as usize]
    }

    /// Whether the two tangent planes agree.
    fn are_joined(&self, v: u32, w: u32) -> bool {
        let interior = &self.surface.near.interior;
        if interior[v as usize] && interior[w as usize] {
            return true;
        }
        let (a, b) = (&self.labels[v as usize], &self.labels[w as usize]);
        let across = b.place - a.place;
        let both = a.normal + b.normal;
        let rise = across.dot(both).abs() / both.length();
        a.normal.dot(b.normal) >= JOINED_ANGLE.cos()
            && rise <= JOINED_SLOPE * across.length() + JOINED_HEIGHT * self.surface.h
    }
}

impl Grown<'_> {
    /// The fit of the region that explains the centre best.
    fn explain(&self, Scratch { patch, samples, fitter }: &mut Scratch, limit: f64) -> Option<Fit> {
        patch.search(self.surface, self, self.surface.near.verts[self.centre as usize], 0.0);
        let origin = self.surface.near.points[self.centre as usize];
        best(patch.clusters(), self.surface.h.recip(), |cluster| {
            let members = patch.members(cluster);
            let is_new = |member: &Member| !self.surface.near.interior[member.near as usize];
            if members.len() < MIN_MEMBERS || !members.iter().any(is_new) {
                return None; // The interior vertices by themselves did not explain it.
            }
            let sample = |member: &Member| {
                let Carried { place, normal } = self.labels[member.near as usize];
                let trust = if self.surface.near.deep[member.near as usize] { 1.0 } else { SHALLOW_TRUST };
                Sample::new((place - origin) / self.surface.h, normal, trust)
            };
            samples.clear();
            samples.extend(members.iter().map(sample));
            fitter.fit(origin, samples, FitSource::Region).filter(|fit| self.is_good(fit, limit))
        })
    }

    fn is_good(&self, fit: &Fit, limit: f64) -> bool {
        let cosine = |h: &Half| self.surface.face_normals[h.face()].dot(fit.normal);
        let mut faces = self.surface.mesh.leaving(self.surface.near.verts[self.centre as usize]).iter();
        fit.rms <= MAX_RMS
            && fit.displacement.abs() < limit
            && faces.any(|h| cosine(h) >= FOLLOWING_ANGLE.cos())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Mesh;
    use crate::regions::label::tests::surface;
    use crate::regions::near::Near;
    use crate::regions::patch::tests::strip;
    use crate::regions::tests::{cut_cube, labels};
    use approx::assert_relative_eq;
    use glam::dvec3;

    /// The fits of the columns (two vertices each) of a strip: planes with these normals, `off` their vertices.
    fn columns(mesh: &Mesh, normal: impl Fn(usize) -> Option<DVec3>, off: f64) -> VertexFits {
        let mut fits = VertexFits::none(mesh.n_verts(), mesh.verts().collect());
        for v in mesh.verts() {
            if let Some(normal) = normal(v.index() / 2) {
                let plane = Fit::plane(mesh.point(v), normal, FitSource::Region);
                fits.set(v, Fit { displacement: off, ..plane });
            }
        }
        fits
    }

    #[test]
    fn points_are_near_what_is_within_reach_of_one() {
        let news = News::of([dvec3(7.0, 0.0, 3.0), dvec3(0.2, -0.1, -0.0), dvec3(1.0, 9.0, 0.0)].into_iter());
        assert!(news.is_within(2.0, dvec3(2.1, -0.1, 0.0)) && news.is_within(2.0, dvec3(7.0, -1.4, 4.4)));
        assert!(news.is_within(2.0, dvec3(0.2, 1.8, 0.0)) && news.is_within(2.0, dvec3(1.0, 8.0, 1.0)));
        assert!(!news.is_within(2.0, dvec3(2.3, -0.1, 0.0)) && !news.is_within(2.0, dvec3(0.2, 4.1, 0.0)));
        assert!(!news.is_within(2.0, dvec3(-4.0, 0.0, 0.0)) && !news.is_within(2.0, dvec3(9.1, 0.0, 3.0)));
    }

    #[test]
    fn labels_are_carried_along_a_strip_three_h_a_round() {
        // Columns 0 to 4 have the plane 0.1 above them; each round reaches three columns on.
        let m = strip(16);
        let normals = m.face_normals();
        let mut surface = surface(&m, &normals);
        let grown = |surface: &Surface, limit| {
            let mut fits = columns(&m, |column| (column < 5).then_some(DVec3::Z), 0.1);
            grow(surface, &mut fits, 0.15..=0.15, limit);
            fits
        };
        let fits = grown(&surface, 0.2);
        assert_eq!(fits.iter().count(), 2 * 14, "columns 5 to 7, 8 to 10, 11 to 13");
        for (_, fit) in fits.iter() {
            assert_relative_eq!(fit.displacement, 0.1, epsilon = 1e-6);
            assert_relative_eq!(fit.normal.distance(DVec3::Z), 0.0, epsilon = 1e-6);
            assert_eq!(fit.source, FitSource::Region);
        }
        assert_eq!(grown(&surface, 0.05).iter().count(), 2 * 5, "farther than the limit");
        // Interior vertices alone are no news.
        surface.interior = m.verts().map(|v| v.index() < 10).collect::<Vec<_>>().into();
        surface.near = Near::around(&surface, &m.verts().collect::<Vec<_>>());
        let mut none = columns(&m, |_| None, 0.0);
        grow(&surface, &mut none, 0.15..=0.15, 0.2);
        assert_eq!(none.iter().count(), 0);
    }

    #[test]
    fn a_crease_keeps_the_labels_on_its_sides_apart() {
        // Columns 0 to 3 in z = 0, columns 4 to 7 in x = 3, down from the crease; column 3 has no label.
        let (mut points, faces) = strip(8).into_parts();
        for p in points.iter_mut().filter(|p| p.x > 3.0) {
            (p.x, p.z) = (3.0, 3.0 - p.x);
        }
        points[6..8].iter_mut().for_each(|p| p.x = 2.9);
        let m = Mesh::new(points, faces).unwrap();
        let normals = m.face_normals();
        let side = |column| match column {
            0..3 => Some(DVec3::Z),
            3 => None,
            _ => Some(DVec3::X),
        };
        let mut fits = columns(&m, side, 0.0);
        grow(&surface(&m, &normals), &mut fits, 0.15..=0.15, 0.2);
        for v in [6, 7].map(Vert::new) {
            let fit = fits.get(v).unwrap();
            assert_eq!((fit.normal, fit.n_members), (DVec3::Z, 6), "nothing of the other side");
            assert_relative_eq!(fit.displacement, 0.0, epsilon = 1e-9);
        }
        // Two members on each side are too few, four together would do.
        let mut fits = columns(&m, |column| side(column).filter(|_| column == 2 || column == 4), 0.0);
        grow(&surface(&m, &normals), &mut fits, 0.15..=0.15, 0.2);
        assert!(fits.get(Vert::new(6)).is_none());
    }

    #[test]
    fn a_far_label_gives_way_to_a_clearly_better_one() {
        // All of a strip in its plane, but for column 5, whose label is that of a plane `off` it.
        let m = strip(10);
        let normals = m.face_normals();
        let surface = surface(&m, &normals);
        let displacement = |off| {
            let mut fits = columns(&m, |_| Some(DVec3::Z), 0.0);
            for v in [10, 11].map(Vert::new) {
                let far = Fit { displacement: off, distance: 1.0, ..fits.get(v).unwrap().clone() };
                fits.set(v, far);
            }
            grow(&surface, &mut fits, 0.15..=0.15, 0.35);
            fits.get(Vert::new(10)).unwrap().displacement
        };
        assert_relative_eq!(displacement(0.3), 0.0, epsilon = 1e-3);
        assert_eq!(displacement(0.14), 0.14, "not far");
        let is_replaced = |rms: f64| {
            let mut fits = columns(&m, |_| Some(DVec3::Z), 0.0);
            let far =
                Fit { displacement: 0.1, rms, distance: 1.0, ..fits.get(Vert::new(10)).unwrap().clone() };
            fits.set(Vert::new(10), far);
            grow(&surface, &mut fits, 0.05..=0.15, 0.35);
            fits.get(Vert::new(10)).unwrap().displacement < 0.1
        };
        assert!(is_replaced(0.02) && !is_replaced(0.03), "five residuals, three");
    }

    #[test]
    fn nothing_grows_where_no_face_follows() {
        // Labels that stand upright on the strip: planes through every vertex beyond them, y = 0 or 1.
        let m = strip(10);
        let normals = m.face_normals();
        let mut fits = columns(&m, |column| (column < 5).then_some(DVec3::Y), 0.0);
        grow(&surface(&m, &normals), &mut fits, 0.15..=0.15, 0.35);
        assert_eq!(fits.iter().count(), 10);
    }

    #[test]
    fn nothing_grows_on_a_sphere() {
        let (mut points, faces) = cut_cube(10).into_parts();
        for (i, p) in points.iter_mut().enumerate() {
            let aside = 0.3 * dvec3((i as f64).sin(), (2.0 * i as f64).sin(), (3.0 * i as f64).sin());
            *p = (*p + aside - DVec3::splat(5.0)).normalize();
        }
        let m = Mesh::new(points, faces).unwrap();
        let (normals, labels) = labels(&m);
        let surface = Surface::new(&m, &normals, &labels);
        let mut fits = crate::regions::explain::explain_by_regions(&surface);
        let before = format!("{fits:?}");
        assert!(fits.iter().count() > 0);
        grow(&surface, &mut fits, 0.15..=0.15, 0.35);
        assert_eq!(format!("{fits:?}"), before);
    }
}
