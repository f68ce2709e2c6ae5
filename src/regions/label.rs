//! Which fit explains each doubtful vertex (steps 4 to 6, second pass and late adoption).

use rayon::prelude::*;

use super::patch::{Cluster, Member, Patch};
use super::{Surface, VertexFits};
use crate::fit::{Fit, FitSource, Sample, fit_samples};
use crate::mesh::Vert;

/// Samples that are not deep inside their region are trusted this much: their normals lean towards the
/// chamfer, but small regions have no others.
const SHALLOW_TRUST: f64 = 0.1;
/// Where a fit leaves more than this residual (in h) ...
const ERODED_RMS: f64 = 0.002;
/// ... and at least this many of its samples lie deep inside the region, these are tried alone ...
const ERODED_MEMBERS: usize = 8;
/// ... and taken if they leave less than this share of the residual. On marching cubes the samples beside
/// a crease are off the surface and spoil the fit; curvature and noise raise both residuals alike.
const ERODED_GAIN: f64 = 0.3;
/// A fit with a larger residual (in h) is no smooth surface.
const MAX_RMS: f64 = 0.25;
/// What a region loses for each h that it is farther away, in h of displacement: of two regions that
/// explain a vertex nearly as well the nearer one is meant.
const DISTANCE_PENALTY: f64 = 0.08;
/// A vertex farther from every fit (in h) is not explained. Marching cubes puts samples up to 0.33 h off;
/// forcing a label on every vertex makes errors above the input's.
const EXPLAINED: f64 = 0.35;

/// Leftover vertices this many rings round one may join its fit ...
const LEFTOVER_RINGS: usize = 3;
/// ... which takes this many of them ...
const LEFTOVER_MEMBERS: usize = 4;
/// ... and has to be this good: residual and displacement in h. At a residual of 0.03 coarse meshes lose
/// a tenth of their gain, at 0.1 finely sampled ones a quarter.
const LEFTOVER_RMS: f64 = 0.05;
const LEFTOVER_DISPLACEMENT: f64 = 0.1;

/// On samples that lie on the surface, a label this far (in h) from its vertex is wrong ...
const FAR: f64 = 0.15;
/// ... or this many times the noise.
const FAR_IN_NOISE: f64 = 5.0;

/// A vertex adopts the fit of a neighbour if it lies within this distance of it, in h ...
const ADOPTED_DISPLACEMENT: f64 = 0.1;
/// ... and one of its faces within this angle (cosine; 40 degrees) of the fit's normal.
const ADOPTED_COSINE: f64 = 0.77;

/// Steps 3 to 5: gives each doubtful vertex the fit of the smooth region that explains it best.
pub(super) fn explain_by_regions(surface: &Surface) -> VertexFits {
    let mut fits = VertexFits::none(surface.mesh.n_verts(), surface.doubtful());
    let normals = super::per_vertex(surface.mesh, |v| surface.normal(v, |_| true));
    let per_h = surface.h.recip();
    let explain = |(patch, samples): &mut (Patch, Vec<Sample>), &v: &Vert| {
        patch.search(surface, v);
        let fit = |samples: &mut Vec<Sample>, cluster: &Cluster| {
            let sample = |member: &Member| Sample {
                offset: member.offset * per_h,
                normal: normals[member.vertex],
                trust: if surface.deep[member.vertex] { 1.0 } else { SHALLOW_TRUST },
            };
            let members = patch.members(cluster);
            samples.clear();
            samples.extend(members.iter().map(sample));
            let fit = fit_samples(surface.mesh.point(v), samples, FitSource::Region)?;
            let deep = members.iter().filter(|member| surface.deep[member.vertex]);
            let n_deep = deep.clone().count();
            if fit.rms > ERODED_RMS && (ERODED_MEMBERS..members.len()).contains(&n_deep) {
                samples.clear();
                samples.extend(deep.map(sample));
                let eroded = fit_samples(surface.mesh.point(v), samples, FitSource::Region);
                if let Some(eroded) = eroded.filter(|eroded| eroded.rms < ERODED_GAIN * fit.rms) {
                    return Some(eroded);
                }
            }
            Some(fit).filter(|fit| fit.rms <= MAX_RMS)
        };
        if surface.interior[v] {
            return patch.clusters().first().and_then(|own| fit(samples, own));
        }
        let mut best: Option<(f64, Fit)> = None;
        for cluster in patch.clusters() {
            let penalty = DISTANCE_PENALTY * (cluster.distance() * per_h - 1.0);
            if best.as_ref().is_some_and(|&(score, _)| score <= penalty) {
                break; // No region from here on can be better.
            }
            let Some(fit) = fit(samples, cluster) else { continue };
            let score = fit.displacement.abs() + penalty;
            if best.as_ref().is_none_or(|&(least, _)| score < least) {
                best = Some((score, fit));
            }
        }
        best.map(|(_, fit)| fit).filter(|fit| fit.displacement.abs() < EXPLAINED)
    };
    fits.fits = fits.verts.par_iter().map_init(Default::default, explain).collect();
    fits
}

/// Step 6a: a vertex that no region explains, but that has red faces, keeps the papers' plane.
pub(super) fn explain_by_red_faces(surface: &Surface, fits: &mut VertexFits) {
    explain_the_rest(surface, fits, |_, v| {
        let normal = surface.normal(v, |f| surface.red_face[f]);
        (normal != glam::DVec3::ZERO).then(|| Fit::plane(surface.mesh.point(v), normal, FitSource::Paper))
    });
}

/// Step 6b: fits among the vertices that are still without one.
pub(super) fn explain_by_leftovers(surface: &Surface, fits: &mut VertexFits) {
    explain_the_rest(surface, fits, |fits, centre| {
        let is_left = |v: Vert| !surface.interior[v] && fits.get(v).is_none();
        let mut members = vec![centre];
        let mut ring_start = 0;
        for _ in 0..LEFTOVER_RINGS {
            let ring = ring_start..members.len();
            ring_start = members.len();
            for i in ring {
                for &w in surface.neighbours.of_vertex(members[i]) {
                    if is_left(w) && !members.contains(&w) {
                        members.push(w);
                    }
                }
            }
        }
        let is_left_face = |f| surface.mesh.corners(f).into_iter().all(is_left);
        let sample = |&v: &Vert| {
            let normal = surface.normal(v, is_left_face);
            let offset = (surface.mesh.point(v) - surface.mesh.point(centre)) / surface.h;
            (normal != glam::DVec3::ZERO).then_some(Sample { offset, normal, trust: 1.0 })
        };
        let mut samples: Vec<Sample> = members.iter().filter_map(sample).collect();
        if samples.len() < LEFTOVER_MEMBERS {
            return None;
        }
        let fit = fit_samples(surface.mesh.point(centre), &mut samples, FitSource::Leftover)?;
        let is_good = fit.rms <= LEFTOVER_RMS && fit.displacement.abs() <= LEFTOVER_DISPLACEMENT;
        is_good.then_some(fit)
    });
}

/// Second pass: takes back the labels that are far from their vertex, and all guesses.
pub(super) fn take_back_far_labels(surface: &Surface, fits: &mut VertexFits, noise: f64) {
    let limit = EXPLAINED.min(FAR.max(FAR_IN_NOISE * noise));
    for (&v, fit) in fits.verts.iter().zip(&mut fits.fits) {
        let is_wrong = |fit: &Fit| fit.source != FitSource::Region || fit.displacement.abs() > limit;
        if !surface.interior[v] && fit.as_ref().is_some_and(is_wrong) {
            *fit = None;
        }
    }
}

/// Late adoption: a vertex that is still without a fit takes that of the neighbour on whose fit it lies
/// best, if it does. The papers' planes are not handed on.
pub(super) fn adopt_from_neighbours(surface: &Surface, fits: &mut VertexFits) {
    explain_the_rest(surface, fits, |fits, v| {
        let point = surface.mesh.point(v);
        let mut nearest: Option<(f64, Fit)> = None;
        let handed_on = |w: &Vert| fits.get(*w).filter(|fit| fit.source != FitSource::Paper);
        for fit in surface.neighbours.of_vertex(v).iter().filter_map(handed_on) {
            let (distance, normal) = fit.evaluate(point, surface.h);
            let distance = distance.abs();
            let follows = |h: &crate::mesh::Half| surface.face_normals[h.face()].dot(normal) > ADOPTED_COSINE;
            if distance <= ADOPTED_DISPLACEMENT
                && nearest.as_ref().is_none_or(|&(least, _)| distance < least)
                && surface.mesh.leaving(v).iter().any(follows)
            {
                let source = FitSource::Adopted;
                nearest = Some((distance, Fit { displacement: 0.0, normal, source, ..fit.clone() }));
            }
        }
        nearest.map(|(_, fit)| fit)
    });
}

/// Gives a fit to each vertex without one, all from the same state.
fn explain_the_rest(
    surface: &Surface,
    fits: &mut VertexFits,
    explain: impl Fn(&VertexFits, Vert) -> Option<Fit> + Sync,
) {
    let is_left = |v: &&Vert| !surface.interior[**v] && fits.get(**v).is_none();
    let left: Vec<Vert> = fits.verts.iter().filter(is_left).copied().collect();
    let found: Vec<_> = left.par_iter().map(|&v| explain(fits, v)).collect();
    for (v, fit) in left.into_iter().zip(found) {
        if let Some(fit) = fit {
            fits.set(v, fit);
        }
    }
}
