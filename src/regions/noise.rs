//! Noisy meshes: fits from all samples of a region, and samples moved onto them.
//!
//! ```text
//!   o   o     o        o  samples of one side of a crease, some above and some below it
//!     o   o o   o\
//!                 \    Interior vertices are few, and no better than others: once labels say which vertices
//!                      belong together, all of these together know the surface best.
//! ```
//!
//! Based on: nothing in the papers, which smooth the mesh beforehand.
//! In/out: `Surface` + fits + chamfers -> better fits near the chamfers, and where the samples belong.
//! Cost: on noisy meshes a patch and a fit per vertex near a chamfer, in parallel; else a comparison.

use glam::DVec3;

use super::VertexFits;
use super::gates::ends_of;
use super::label::explain_those;
use super::near::Near;
use super::patch::{Member, Patch, Regions};
use super::surface::Surface;
use crate::fit::{Fit, FitSource, Fitter, Sample};
use crate::mesh::{Half, Vert};

/// A mesh is noisy when the median residual (in h) is larger than this; where samples are exact it is .007 at
/// most ...
pub(super) const NOISY_RMS: f64 = 0.02;
/// ... and the correlation of neighbouring vertices' distances from their fits smaller than this: what a
/// scanned animal's fits leave is shape, and correlates by .39; noise does by .04 to .13.
const NOISY_CORRELATION: f64 = 0.2;
/// It is taken over neighbours whose fits' normals have this cosine at least: one surface.
const SAME_SURFACE: f64 = 0.9;
/// Distances count in residuals of their fits (of this at least, in h), up to this many.
const LEAST_RMS: f64 = 1e-4;
const MOST_RMS: f64 = 3.0;

/// Vertices this many rings round a chamfer take part.
const RINGS: usize = 2;
/// Neighbours are part of one region when their labels' normals are within this angle, in radians.
const JOINED_ANGLE: f64 = 30.0 * std::f64::consts::PI / 180.0;
/// Samples are taken up to this distance, in h.
const REACH: f64 = 3.0;
/// A fit rests on at least this many samples ...
const MIN_MEMBERS: usize = 6;
/// ... and replaces one whose normal has at least this cosine to its own ...
const MIN_COSINE: f64 = 0.85;
/// ... and whose displacement differs by at most this, in h.
const MAX_CHANGE: f64 = 0.25;
/// A sample that is farther from its fit than this many residuals, or this far in h, has the wrong one.
const MAX_MOVE_IN_RMS: f64 = 4.0;
const MAX_MOVE: f64 = 0.5;

/// Whether what the fits leave is noise and not shape. `noise` is their median residual.
pub(super) fn is_noisy(surface: &Surface, fits: &VertexFits, noise: f64) -> bool {
    noise > NOISY_RMS && correlation(surface, fits) < NOISY_CORRELATION
}

/// The correlation between neighbours on one surface of how far they are from their fits.
fn correlation(surface: &Surface, fits: &VertexFits) -> f64 {
    let distance = |fit: &Fit| (fit.displacement / fit.rms.max(LEAST_RMS)).clamp(-MOST_RMS, MOST_RMS);
    let region = |v: Vert| fits.get(v).filter(|fit| fit.source == FitSource::Region);
    let (mut together, mut alone) = (0.0, f64::MIN_POSITIVE);
    for &v in &fits.verts {
        let Some(p) = region(v) else { continue };
        let later = surface.neighbours(v).filter(|&w| w > v);
        for q in later.filter_map(region).filter(|q| q.normal.dot(p.normal) > SAME_SURFACE) {
            let (x, y) = (distance(p), distance(q));
            together += x * y;
            alone += 0.5 * (x * x + y * y);
        }
    }
    together / alone
}

/// The vertices near `chamfers`, ascending.
pub(super) fn zone_of(surface: &Surface, chamfers: &[Half]) -> Vec<Vert> {
    let mut zone = ends_of(surface.mesh, chamfers);
    for _ in 0..RINGS {
        let round: Vec<Vert> = zone.iter().flat_map(|&v| surface.neighbours(v)).collect();
        zone.extend(round);
        zone.sort_unstable();
        zone.dedup();
    }
    zone
}

/// Fits the regions of the vertices of `zone` again, from all their vertices alike.
pub(super) fn fit_again(surface: &Surface, fits: &mut VertexFits, zone: &[Vert]) {
    let Near { verts, points, normals, interior, .. } = &surface.near;
    let label = |v: Vert| fits.get(v).filter(|fit| fit.source == FitSource::Region).map(|fit| fit.normal);
    let own = |i: usize| if interior[i] { normals[i] } else { DVec3::ZERO };
    let normals = verts.iter().enumerate().map(|(i, &v)| label(v).unwrap_or(own(i))).collect();
    let regions = Labelled { normals };
    let is_open = |v: Vert, fit: Option<&Fit>| {
        fit.is_some_and(|fit| fit.source == FitSource::Region) && zone.binary_search(&v).is_ok()
    };
    type Scratch = (Patch, Vec<Sample>, Fitter);
    explain_those(fits, is_open, |(patch, samples, fitter): &mut Scratch, fits, v| {
        patch.search(surface, &regions, v, 0.0);
        let origin = surface.mesh.point(v);
        let sample = |member: &Member| {
            let i = member.near as usize;
            let (offset, normal) = ((points[i] - origin) / surface.h, regions.normals[i]);
            (offset.length_squared() <= REACH * REACH).then_some(Sample::new(offset, normal, 1.0))
        };
        samples.clear();
        samples.extend(patch.members(patch.clusters().first()?).iter().filter_map(sample));
        if samples.len() < MIN_MEMBERS {
            return None;
        }
        let (old, new) = (fits.get(v)?, fitter.fit(origin, samples, FitSource::Region)?);
        let is_like = new.normal.dot(old.normal) >= MIN_COSINE
            && (new.displacement - old.displacement).abs() <= MAX_CHANGE;
        let n_members = new.n_members.max(old.n_members);
        is_like.then_some(Fit { n_members, distance: old.distance, ..new })
    });
}

/// The vertices that have a label, or are interior, joined where their normals agree.
struct Labelled {
    /// Of the near vertices; zero for all others.
    normals: Vec<DVec3>,
}

impl Regions for Labelled {
    fn is_member(&self, v: u32) -> bool {
        self.normals[v as usize] != DVec3::ZERO
    }

    fn are_joined(&self, v: u32, w: u32) -> bool {
        self.normals[v as usize].dot(self.normals[w as usize]) >= JOINED_ANGLE.cos()
    }
}

/// The vertices of `zone` that move onto their fits, ascending, and where to.
pub(super) fn moves(surface: &Surface, fits: &VertexFits, zone: &[Vert]) -> Vec<(Vert, DVec3)> {
    let onto_fit = |&v: &Vert| {
        let fit =
            fits.get(v).filter(|fit| fit.source == FitSource::Region && fit.n_members >= MIN_MEMBERS)?;
        let is_near = fit.displacement.abs() < MAX_MOVE.min(MAX_MOVE_IN_RMS * fit.rms);
        is_near.then(|| (v, surface.mesh.point(v) + surface.h * fit.displacement * fit.normal))
    };
    zone.iter().filter_map(onto_fit).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Mesh;
    use crate::place::Outcome;
    use crate::regions::tests::{cut_cube, labels};
    use crate::regions::{label_by_fits, place_by_fits};

    /// The cube [0, n]³ with samples that are off its sides by up to `most`, in any way.
    fn noisy_cube(n: usize, most: f64) -> Mesh {
        let (mut points, faces) = cut_cube(n).into_parts();
        let mut seed = 7u32;
        let mut random = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(seed >> 8) / f64::from(1 << 23) - 1.0
        };
        for p in &mut points {
            *p += most * DVec3::new(random(), random(), random());
        }
        Mesh::new(points, faces).unwrap()
    }

    #[test]
    fn noise_is_known_from_exact_samples() {
        let is_noisy = |most| {
            let m = noisy_cube(14, most);
            let (normals, labels) = labels(&m);
            let surface = Surface::new(&m, &normals, &labels);
            let fits = crate::regions::explain::explain_by_regions(&surface);
            let noise = crate::regions::gates::noise(&fits);
            (noise, is_noisy(&surface, &fits, noise))
        };
        assert!(is_noisy(0.12).1, "{:?}", is_noisy(0.12));
        assert!(!is_noisy(0.001).1, "{:?}", is_noisy(0.001));
    }

    #[test]
    fn noisy_samples_beside_a_crease_move_towards_their_side() {
        let n = 14;
        let m = noisy_cube(n, 0.12);
        let (normals, labels) = labels(&m);
        let found = label_by_fits(&m, &normals, &labels, 0.0);
        assert!(found.moved.len() > 300, "{}", found.moved.len());
        let distance = |p: DVec3| {
            p.to_array().into_iter().map(|c| c.abs().min((c - n as f64).abs())).fold(1.0, f64::min)
        };
        let mean_square =
            |points: &mut dyn Iterator<Item = DVec3>| points.map(|p| distance(p).powi(2)).sum::<f64>();
        let before = mean_square(&mut found.moved.iter().map(|&(v, _)| m.point(v)));
        let after = mean_square(&mut found.moved.iter().map(|&(_, p)| p));
        assert!(after < 0.25 * before, "{before} {after}");
        let placement = place_by_fits(&m, &found, None);
        let on_feature = placement.outcomes.iter().filter(|&&outcome| outcome == Outcome::Moved).count();
        assert!(on_feature > 12 * (2 * n - 1) * 4 / 5, "{on_feature}");
    }
}
