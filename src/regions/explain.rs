//! The fit of the smooth region that explains each doubtful vertex best (steps 3 to 5).
//!
//! ```text
//!   i---i---i---i---i    i  interior vertices
//!   | / | / | / | / |    o  doubtful ones: those next to one (1) see the regions that it sees, so that these
//!   o---o---o---o---o       are searched for once; and where the fit of 1 leaves no residual, it is theirs too
//!   | / | / | / | / |
//!   o---o---1---o---o
//! ```
//!
//! Based on: nothing in the papers.
//! Differs: one search for some three vertices; exact fits are shared; interior vertices take a fit beside them
//! where it fits.
//! In/out: `Surface` -> `VertexFits`.
//! Cost: some 5 microseconds per doubtful vertex on curved surfaces, less on flat ones, in parallel.

#[cfg(test)]
mod tests;

use std::cmp::Reverse;
use std::iter;
use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use super::VertexFits;
use super::chord;
use super::label::{EXPLAINED, SHALLOW_TRUST, best, explain_those};
use super::patch::{Cluster, Member, Patch, REACH_IN_REGION, Regions};
use super::surface::Surface;
use crate::fit::{Fit, FitSource, Fitter, Sample};
use crate::mesh::Vert;

/// Where a fit leaves more than this residual (in h) ...
const ERODED_RMS: f64 = 0.002;
/// ... and at least this many of its samples lie deep inside the region, these are tried alone ...
const ERODED_MEMBERS: usize = 8;
/// ... and taken if they leave less than this share of the residual. On marching cubes the samples beside
/// a crease are off the surface and spoil the fit; curvature and noise raise both residuals alike.
const ERODED_GAIN: f64 = 0.3;
/// A fit with a larger residual (in h) is no smooth surface. It decides where samples are noisy, and hardly: without it a
/// fandisk of 141 meshes keeps one turned face more.
const MAX_RMS: f64 = 0.25;

/// A fit that leaves at most this residual (in h) is as good for the vertices next to its own: at .003 two coarse
/// meshes of 31 have 1.5 and 5 % more error, at .001 none has ...
const EXACT_RMS: f64 = 1e-3;
/// ... if it rests on this many samples: fewer leave little in any case.
const EXACT_MEMBERS: usize = 8;

/// Fits of one region have normals within this angle (cosine; 20 degrees) of its vertices': those of two that make
/// a crease do not.
const SAME_REGION_COSINE: f64 = 0.94;
/// An interior vertex takes the fit of a vertex beside it that is at most this far off, in h. From .1 on coarse
/// countersinks have 5 % more error, at .02 noisy meshes make three quarters of the fits themselves, here half of
/// them; others hardly any.
const SHARED_DISPLACEMENT: f64 = 0.07;

/// What nothing else explains is part of a plane that leaves no larger residual than this, in h, and is an exact side:
/// at 1e-3 wrong labels of fandisks and countersinks come back, at 1e-5 one cone and one thin plate have half as much
/// error again ...
const SIDE_RMS: f64 = 1e-4;
/// ... and that is no farther off than this, in h, as far as samples are moved: beside acute edges marching cubes puts
/// them off by .45. Nothing changes up to .7.
const SIDE_DISPLACEMENT: f64 = 0.5;
/// The same for samples of surface nets, which are deeper.
const SIDE_DISPLACEMENT_IN_NETS: f64 = 0.7;

/// The vertices of a group lie within this distance of its first one, in h: the patch is so much wider.
const GROUP_REACH: f64 = 1.5;
/// Groups per unit of parallel work: each unit makes its own list of fits.
const TASK: usize = 64;

/// Gives each doubtful vertex the fit of the smooth region that explains it best. Interior ones, which have others
/// beside them, take one of theirs where it fits: two of five vertices.
pub(super) fn explain_by_regions(surface: &Surface) -> VertexFits {
    let mut fits = VertexFits::none(surface.mesh.n_verts(), surface.doubtful.clone());
    // First those that the interior ones may take theirs from.
    let (verts, groups) = groups(surface, &fits);
    let explain = |explainer: &mut Explainer, task: &[Range<usize>]| {
        let mut found = Vec::with_capacity(task.last().map_or(0, |last| last.end - task[0].start));
        task.iter().for_each(|group| explainer.explain_group(surface, &verts[group.clone()], &mut found));
        found
    };
    let found: Vec<Vec<(Vert, Fit)>> =
        groups.par_chunks(TASK).map_init(Explainer::default, explain).collect();
    found.into_iter().flatten().for_each(|(v, fit)| fits.set(v, fit));
    let is_open = |v: Vert, _: Option<&Fit>| surface.interior[v];
    explain_those(&mut fits, is_open, |explainer: &mut Explainer, fits, v| {
        fit_from_beside(surface, fits, v).or_else(|| explainer.explain_interior(surface, v))
    });
    fits
}

/// Where samples are off the surface: gives the vertices that are without a fit that of an exact side beside them,
/// though they are far off it: those of marching cubes if a crease can explain them. One sample without a label leaves
/// a gap in a crease.
pub(super) fn explain_by_exact_sides(surface: &Surface, fits: &mut VertexFits, is_marching_cubes: bool) {
    let is_open = |v: Vert, fit: Option<&Fit>| !surface.interior[v] && fit.is_none();
    let in_nets = surface.deepened(SIDE_DISPLACEMENT_IN_NETS);
    let max_displacement = if is_marching_cubes { SIDE_DISPLACEMENT } else { in_nets };
    let is_exact_side =
        |fit: &Fit| fit.is_plane() && fit.rms < SIDE_RMS && fit.displacement.abs() < max_displacement;
    explain_those(fits, is_open, |(explainer, rings): &mut (Explainer, Vec<u32>), fits, v| {
        let fit = explainer.explain_by(surface, surface, v).filter(is_exact_side)?;
        (!is_marching_cubes || chord::is_possible(surface, fits, v, &fit, rings)).then_some(fit)
    });
}

/// The doubtful vertices that are not interior, by their numbers among the near ones, group by group, and where the
/// groups are: each one a vertex and those next to it which are in no group before. Of a vertex and those next to it the
/// one with the most of them is taken, so that groups are few.
fn groups(surface: &Surface, fits: &VertexFits) -> (Vec<u32>, Vec<Range<usize>>) {
    let near = &surface.near;
    let has_slot = |&v: &Vert| !surface.interior[v] && fits.slot[v] != u32::MAX;
    let mut is_open: Vec<bool> = near.verts.iter().map(has_slot).collect();
    let limit = (GROUP_REACH * surface.h).powi(2);
    let (mut verts, mut groups) = (Vec::new(), Vec::new());
    for seed in 0..near.verts.len() as u32 {
        if !is_open[seed as usize] {
            continue;
        }
        let start = verts.len();
        let open_beside = |i: u32| {
            let is_close =
                move |j: u32| near.points[i as usize].distance_squared(near.points[j as usize]) <= limit;
            let beside = near.neighbours(i).iter().copied();
            beside.filter(|&j| is_open[j as usize]).filter(move |&j| is_close(j))
        };
        let size = |&i: &u32| (open_beside(i).count(), Reverse(i));
        let first = iter::once(seed).chain(open_beside(seed)).max_by_key(size).unwrap_or(seed);
        verts.push(first);
        verts.extend(open_beside(first));
        // The order round a vertex is that of the faces in the file.
        verts[start + 1..].sort_unstable();
        verts[start..].iter().for_each(|&i| is_open[i as usize] = false);
        groups.push(start..verts.len());
    }
    (verts, groups)
}

/// Working space of one worker.
#[derive(Default)]
pub(super) struct Explainer {
    patch: Patch,
    /// The clusters of the patch as one vertex of the group sees them.
    seen: Vec<Cluster>,
    /// The exact fits of its clusters, by the clusters' first members.
    exact: Vec<(u32, Fit)>,
    samples: Samples,
    fitter: Fitter,
}

impl Explainer {
    /// The fits of the vertices of `group` which a region explains.
    fn explain_group(&mut self, surface: &Surface, group: &[u32], found: &mut Vec<(Vert, Fit)>) {
        let near = &surface.near;
        let first = near.points[group[0] as usize];
        let distance = |&i: &u32| near.points[i as usize].distance(first);
        let farthest = group.iter().map(distance).fold(0.0, f64::max);
        self.patch.search(surface, surface, near.verts[group[0] as usize], farthest);
        self.exact.clear();
        let explained = surface.deepened(EXPLAINED);
        for &i in group {
            let origin = near.points[i as usize];
            self.patch.clusters_from(surface, origin, &mut self.seen);
            let Self { patch, seen, exact, samples, fitter } = &mut *self;
            let fit = |cluster: &Cluster| {
                let name = patch.members(cluster)[0].near;
                if let Some((_, fit)) = exact.iter().find(|(other, _)| *other == name) {
                    return Some(fit.seen_from(origin, surface.h));
                }
                samples.take(surface, patch, cluster, origin);
                let fit = samples.fit(origin, fitter)?;
                if fit.rms <= EXACT_RMS && fit.n_members >= EXACT_MEMBERS {
                    exact.push((name, fit.clone()));
                }
                Some(fit)
            };
            let fit = best(seen, surface.h.recip(), fit).filter(|fit| fit.displacement.abs() < explained);
            found.extend(fit.map(|fit| (near.verts[i as usize], fit)));
        }
    }

    /// The fit of the one of `regions` that explains `v` best.
    pub fn explain_by(&mut self, surface: &Surface, regions: &impl Regions, v: Vert) -> Option<Fit> {
        self.patch.search(surface, regions, v, 0.0);
        let origin = surface.mesh.point(v);
        let Self { patch, samples, fitter, .. } = self;
        best(patch.clusters(), surface.h.recip(), |cluster| {
            samples.take(surface, patch, cluster, origin);
            samples.fit(origin, fitter)
        })
    }

    /// The fit of the region that interior vertex `v` is part of.
    fn explain_interior(&mut self, surface: &Surface, v: Vert) -> Option<Fit> {
        self.patch.search(surface, surface, v, 0.0);
        let origin = surface.mesh.point(v);
        self.samples.take(surface, &self.patch, self.patch.clusters().first()?, origin);
        self.samples.fit(origin, &mut self.fitter)
    }
}

/// What a vertex sees of a region.
#[derive(Default)]
struct Samples {
    /// The deep ones first.
    all: Vec<Sample>,
    n_deep: usize,
    /// The numbers of the deep ones and of the others, while they are taken.
    sorted: [Vec<u32>; 2],
    /// Fits the deep ones alone.
    deep_fitter: Fitter,
}

impl Samples {
    /// Takes what a vertex at `origin` sees of `cluster`.
    fn take(&mut self, surface: &Surface, patch: &Patch, cluster: &Cluster, origin: DVec3) {
        let near = &surface.near;
        let reach = (REACH_IN_REGION * surface.h).powi(2);
        let per_h = surface.h.recip();
        let members = patch.members(cluster);
        for list in &mut self.sorted {
            list.resize(list.len().max(members.len()), 0);
        }
        let [deep, shallow] = &mut self.sorted;
        let (mut n_deep, mut n_shallow) = (0, 0);
        // Without a branch: no processor guesses which ones these are.
        for &Member { near: i, .. } in members {
            let is_within = near.points[i as usize].distance_squared(origin) <= reach;
            let is_deep = near.deep[i as usize];
            (deep[n_deep], shallow[n_shallow]) = (i, i);
            n_deep += usize::from(is_within & is_deep);
            n_shallow += usize::from(is_within & !is_deep);
        }
        let sample = |i: u32, trust: f64| {
            let i = i as usize;
            Sample::new((near.points[i] - origin) * per_h, near.normals[i], trust)
        };
        self.all.clear();
        self.all.extend(deep[..n_deep].iter().map(|&i| sample(i, 1.0)));
        self.all.extend(shallow[..n_shallow].iter().map(|&i| sample(i, SHALLOW_TRUST)));
        self.n_deep = n_deep;
    }

    /// Their fit round `origin`, that of the deep ones alone where these agree clearly better.
    fn fit(&mut self, origin: DVec3, fitter: &mut Fitter) -> Option<Fit> {
        let Self { all, n_deep, deep_fitter, .. } = self;
        let has_eroded = (ERODED_MEMBERS..all.len()).contains(n_deep);
        let deep = has_eroded.then(|| deep_fitter.take(&all[..*n_deep])).flatten();
        let max_rms = ERODED_GAIN * ERODED_RMS;
        let plane = deep.and_then(|deep| deep_fitter.exact_plane(deep, origin, FitSource::Region, max_rms));
        if plane.is_some() {
            return plane; // Whatever the others say.
        }
        let fit = fitter.fit(origin, all, FitSource::Region)?;
        if let Some(deep) = deep.filter(|_| fit.rms > ERODED_RMS) {
            let eroded = deep_fitter.fit_to_taken(deep, origin, FitSource::Region);
            if let Some(eroded) = eroded.filter(|eroded| eroded.rms < ERODED_GAIN * fit.rms) {
                return Some(eroded);
            }
        }
        Some(fit).filter(|fit| fit.rms <= MAX_RMS)
    }
}

/// The fit of the nearest doubtful vertex beside interior vertex `v` that has one of the same region: as good as
/// its own, and there already.
fn fit_from_beside(surface: &Surface, fits: &VertexFits, v: Vert) -> Option<Fit> {
    let near = &surface.near;
    let number = near.of[v];
    let (point, own_normal) = (near.points[number as usize], near.normals[number as usize]);
    let fit = |&i: &u32| {
        let fit = fits.get(near.verts[i as usize])?;
        let (distance, normal) = fit.evaluate(point, surface.h);
        let is_same_region = normal.dot(own_normal) > SAME_REGION_COSINE;
        let is_shared = is_same_region && distance.abs() < SHARED_DISPLACEMENT;
        is_shared.then(|| (point.distance_squared(near.points[i as usize]), distance, normal, fit))
    };
    let doubtful = near.neighbours(number).iter().filter(|&&i| !near.interior[i as usize]);
    let nearest = doubtful.filter_map(fit).min_by(|a, b| a.0.total_cmp(&b.0));
    nearest.map(|(_, distance, normal, fit)| Fit {
        displacement: -distance,
        normal,
        distance: 0.0,
        ..fit.clone()
    })
}
