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
//! Based on: nothing in the papers. Narrow zones at corners and between creases have no interior vertex at
//! all; their labels come from their ends.
//! In/out: `Surface` + fits -> more fits.
//! Cost: a patch and a few fits per vertex that is not explained and round, in parallel.

use glam::DVec3;

use super::VertexFits;
use super::label::{DISTANCE_PENALTY, SHALLOW_TRUST, explain_the_rest};
use super::patch::{Cluster, Member, Patch, Regions};
use super::surface::Surface;
use crate::fit::{Fit, FitSource, Fitter, Sample};
use crate::mesh::{Half, PerVert, Vert};

/// Rounds of growing: as far as labels are right, they do not have to go far.
const ROUNDS: usize = 3;
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

/// Gives the vertices without a fit one of the labelled vertices round them, round by round. None is farther
/// than `limit` (in h) from its vertex.
pub(super) fn grow(surface: &Surface, fits: &mut VertexFits, limit: f64) {
    let carried = |v: Vert, fit: &Fit| {
        let place = fit.origin + surface.h * fit.displacement * fit.normal;
        (!surface.interior[v]).then_some(Carried { place, normal: fit.normal })
    };
    let mut labels: Vec<Option<Carried>> =
        fits.verts.iter().zip(&fits.fits).map(|(&v, fit)| carried(v, fit.as_ref()?)).collect();
    for _ in 0..ROUNDS {
        let explain = |scratch: &mut Scratch, fits: &VertexFits, v| {
            Grown { surface, slot: &fits.slot, labels: &labels }.explain(scratch, v, limit)
        };
        let found = explain_the_rest(surface, fits, explain);
        if found.is_empty() {
            break;
        }
        for v in found {
            let slot = fits.slot[v] as usize;
            labels[slot] = fits.fits[slot].as_ref().and_then(|fit| carried(v, fit));
        }
    }
}

/// Working space of one worker.
#[derive(Default)]
struct Scratch {
    patch: Patch,
    samples: Vec<Sample>,
    fitter: Fitter,
}

/// A labelled vertex where its label puts it, with the label's normal.
#[derive(Clone, Copy)]
struct Carried {
    place: DVec3,
    normal: DVec3,
}

/// The smooth regions, grown by the vertices that they explain.
struct Grown<'a> {
    surface: &'a Surface<'a>,
    /// For each vertex its place in `labels`, if it has one. `[V]`
    slot: &'a PerVert<u32>,
    labels: &'a [Option<Carried>],
}

impl Regions for Grown<'_> {
    #[inline]
    fn is_member(&self, v: Vert) -> bool {
        self.surface.interior[v] || self.label(v).is_some()
    }

    /// Whether the two tangent planes agree.
    fn are_joined(&self, v: Vert, w: Vert) -> bool {
        if self.surface.interior[v] && self.surface.interior[w] {
            return true;
        }
        let (a, b) = (self.member(v), self.member(w));
        let across = b.place - a.place;
        let both = a.normal + b.normal;
        let rise = across.dot(both).abs() / both.length();
        a.normal.dot(b.normal) >= JOINED_ANGLE.cos()
            && rise <= JOINED_SLOPE * across.length() + JOINED_HEIGHT * self.surface.h
    }
}

impl Grown<'_> {
    #[inline]
    fn label(&self, v: Vert) -> Option<Carried> {
        *self.labels.get(self.slot[v] as usize)?
    }

    fn member(&self, v: Vert) -> Carried {
        let (place, normal) = (self.surface.mesh.point(v), self.surface.normal(v));
        self.label(v).unwrap_or(Carried { place, normal })
    }

    /// The fit of the region that explains `v` best.
    fn explain(&self, scratch: &mut Scratch, v: Vert, limit: f64) -> Option<Fit> {
        let patch = &mut scratch.patch;
        patch.search(self.surface, self, v);
        let mut best: Option<(f64, Fit)> = None;
        for cluster in scratch.patch.clusters() {
            let penalty = DISTANCE_PENALTY * (cluster.distance() / self.surface.h - 1.0);
            if best.as_ref().is_some_and(|&(score, _)| score <= penalty) {
                break; // No region from here on can be better.
            }
            let fit = self.fit(&scratch.patch, cluster, &mut scratch.samples, &mut scratch.fitter, v);
            let Some(fit) = fit.filter(|fit| self.is_good(v, fit, limit)) else { continue };
            let score = fit.displacement.abs() + penalty;
            if best.as_ref().is_none_or(|&(least, _)| score < least) {
                best = Some((score, fit));
            }
        }
        best.map(|(_, fit)| fit)
    }

    fn fit(
        &self,
        patch: &Patch,
        cluster: &Cluster,
        samples: &mut Vec<Sample>,
        fitter: &mut Fitter,
        v: Vert,
    ) -> Option<Fit> {
        let origin = self.surface.mesh.point(v);
        let members = patch.members(cluster);
        let is_new = |member: &Member| !self.surface.interior[member.vertex];
        if members.len() < MIN_MEMBERS || !members.iter().any(is_new) {
            return None; // The interior vertices by themselves did not explain it.
        }
        let sample = |member: &Member| {
            let Carried { place, normal } = self.member(member.vertex);
            let trust = if self.surface.deep[member.vertex] { 1.0 } else { SHALLOW_TRUST };
            Sample { offset: (place - origin) / self.surface.h, normal, trust }
        };
        samples.clear();
        samples.extend(members.iter().map(sample));
        fitter.fit(origin, samples, FitSource::Region)
    }

    fn is_good(&self, v: Vert, fit: &Fit, limit: f64) -> bool {
        let cosine = |h: &Half| self.surface.face_normals[h.face()].dot(fit.normal);
        let is_followed = || self.surface.mesh.leaving(v).iter().any(|h| cosine(h) >= FOLLOWING_ANGLE.cos());
        fit.rms <= MAX_RMS && fit.displacement.abs() < limit && is_followed()
    }
}
