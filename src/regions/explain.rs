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

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use super::VertexFits;
use super::label::{EXPLAINED, SHALLOW_TRUST, best, explain_those};
use super::patch::{Cluster, Patch, REACH_IN_REGION, Regions};
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
/// A fit with a larger residual (in h) is no smooth surface.
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
/// though they are far off it. One sample without a label leaves a gap in a crease.
pub(super) fn explain_by_exact_sides(surface: &Surface, fits: &mut VertexFits) {
    let is_open = |v: Vert, fit: Option<&Fit>| !surface.interior[v] && fit.is_none();
    let is_exact_side =
        |fit: &Fit| fit.is_plane() && fit.rms < SIDE_RMS && fit.displacement.abs() < SIDE_DISPLACEMENT;
    explain_those(fits, is_open, |explainer: &mut Explainer, _, v| {
        explainer.explain_by(surface, surface, v).filter(is_exact_side)
    });
}

/// The doubtful vertices that are not interior, by their numbers among the near ones, group by group, and where the
/// groups are: each one a vertex and those next to it which are in no group before.
fn groups(surface: &Surface, fits: &VertexFits) -> (Vec<u32>, Vec<Range<usize>>) {
    let near = &surface.near;
    let has_slot = |&v: &Vert| !surface.interior[v] && fits.slot[v] != u32::MAX;
    let mut is_open: Vec<bool> = near.verts.iter().map(has_slot).collect();
    let (mut verts, mut groups) = (Vec::new(), Vec::new());
    for first in 0..near.verts.len() as u32 {
        if !std::mem::replace(&mut is_open[first as usize], false) {
            continue;
        }
        let start = verts.len();
        verts.push(first);
        let limit = (GROUP_REACH * surface.h).powi(2);
        for &i in near.neighbours(first) {
            let squared = near.points[i as usize].distance_squared(near.points[first as usize]);
            if is_open[i as usize] && squared <= limit {
                is_open[i as usize] = false;
                verts.push(i);
            }
        }
        // The order round a vertex is that of the faces in the file.
        verts[start + 1..].sort_unstable();
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
            let fit = best(seen, surface.h.recip(), fit).filter(|fit| fit.displacement.abs() < EXPLAINED);
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
}

impl Samples {
    /// Takes what a vertex at `origin` sees of `cluster`.
    fn take(&mut self, surface: &Surface, patch: &Patch, cluster: &Cluster, origin: DVec3) {
        let near = &surface.near;
        let reach = (REACH_IN_REGION * surface.h).powi(2);
        let per_h = surface.h.recip();
        self.all.clear();
        for (is_deep, trust) in [(true, 1.0), (false, SHALLOW_TRUST)] {
            self.n_deep = self.all.len();
            for member in patch.members(cluster) {
                let i = member.near as usize;
                let offset = near.points[i] - origin;
                if near.deep[i] == is_deep && offset.length_squared() <= reach {
                    self.all.push(Sample { offset: offset * per_h, normal: near.normals[i], trust });
                }
            }
        }
    }

    /// Their fit round `origin`, that of the deep ones alone where these agree clearly better.
    fn fit(&self, origin: DVec3, fitter: &mut Fitter) -> Option<Fit> {
        let deep = &self.all[..self.n_deep];
        let has_eroded = (ERODED_MEMBERS..self.all.len()).contains(&self.n_deep);
        let max_rms = ERODED_GAIN * ERODED_RMS;
        let plane = has_eroded.then(|| fitter.exact_plane(origin, deep, FitSource::Region, max_rms));
        if let Some(plane) = plane.flatten() {
            return Some(plane); // Whatever the others say.
        }
        let fit = fitter.fit(origin, &self.all, FitSource::Region)?;
        if has_eroded && fit.rms > ERODED_RMS {
            let eroded = fitter.fit(origin, deep, FitSource::Region);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Mesh;
    use crate::regions::tests::{cut_cube, labels};

    #[test]
    fn vertices_beside_an_edge_take_the_side_they_lie_on() {
        let m = cut_cube(6);
        let normals = m.face_normals();
        let fits = explain_by_regions(&Surface::new(&m, &normals, &labels(&m).1));
        assert!(fits.iter().count() > 100);
        for (v, fit) in fits.iter() {
            let p = m.point(v);
            let outward = DVec3::from(p.to_array().map(|c| f64::from(c == 6.0) - f64::from(c == 0.0)));
            assert!(fit.normal.distance(outward) < 1e-9, "{v:?} at {p}: {}", fit.normal);
            assert!(fit.displacement.abs() < 1e-9 && fit.source == FitSource::Region);
        }
    }

    #[test]
    fn what_nothing_explains_is_part_of_an_exact_side_if_that_is_not_too_far() {
        // A sample in the middle of a side goes inside, and all of them may be a little uneven.
        let flat = cut_cube(10);
        let h = Surface::new(&flat, &flat.face_normals(), &labels(&flat).1).h;
        let found = |off: f64, uneven: f64| {
            let (mut points, faces) = flat.clone().into_parts();
            let v = Vert::new(points.iter().position(|p| *p == DVec3::new(4.5, 4.5, 0.0)).unwrap());
            points.iter_mut().enumerate().for_each(|(i, p)| p.z += uneven * (7.0 * i as f64).sin());
            points[v.index()].z += off * h;
            let m = Mesh::new(points, faces).unwrap();
            let normals = m.face_normals();
            let surface = Surface::new(&m, &normals, &labels(&m).1);
            assert!(!surface.interior[v]);
            let mut fits = VertexFits::none(m.n_verts(), surface.doubtful.clone());
            explain_by_exact_sides(&surface, &mut fits);
            fits.get(v).map(|fit| (fit.normal, fit.displacement))
        };
        let (normal, displacement) = found(0.45, 0.0).unwrap();
        assert!(normal.distance(-DVec3::Z) < 1e-4 && (displacement - 0.45).abs() < 0.02, "{displacement}");
        assert_eq!(found(0.55, 0.0), None);
        assert_eq!(found(0.45, 1e-3), None);
    }

    #[test]
    fn interior_vertices_take_the_fit_beside_them_where_it_is_that_of_their_region() {
        let m = cut_cube(6);
        let normals = m.face_normals();
        let mut surface = Surface::new(&m, &normals, &labels(&m).1);
        let fits = explain_by_regions(&surface);
        let beside: Vec<Vert> = fits.verts.iter().copied().filter(|&v| surface.interior[v]).collect();
        assert!(beside.len() > 20);
        let taken = |surface: &Surface, fits: &VertexFits| {
            beside.iter().filter_map(|&v| fit_from_beside(surface, fits, v)).collect::<Vec<_>>()
        };
        let found = taken(&surface, &fits);
        assert_eq!(found.len(), beside.len());
        for (&v, fit) in beside.iter().zip(&found) {
            // The vertex that it was made for is another one, on the same plane.
            assert!(fit.origin != m.point(v) && fit.displacement.abs() < 1e-9 && fit.distance == 0.0);
            assert!(fit.normal.dot(fit.origin - m.point(v)).abs() < 1e-9);
        }
        // Planes of the same direction that are 0.1 h off are another surface's, and so are others that lean.
        let changed = |change: &dyn Fn(&mut Fit)| {
            let mut fits = fits.clone();
            fits.fits.iter_mut().flatten().for_each(change);
            taken(&surface, &fits).len()
        };
        let (h, lean) = (surface.h, 25f64.to_radians().tan());
        assert_eq!(changed(&|fit| fit.origin += 0.04 * h * fit.normal), beside.len());
        assert_eq!(changed(&|fit| fit.origin += 0.1 * h * fit.normal), 0);
        assert_eq!(changed(&|fit| fit.coefficients[1] = lean), 0);
        // Off by 0.04 h above: so far the vertex is from it, along its normal.
        let mut above = fits.clone();
        above.fits.iter_mut().flatten().for_each(|fit| fit.origin += 0.04 * h * fit.normal);
        assert!(taken(&surface, &above).iter().all(|fit| (fit.displacement - 0.04).abs() < 1e-9));
        // Without doubtful vertices beside it there is none.
        surface.near.interior.fill(true);
        assert_eq!(taken(&surface, &fits).len(), 0);
    }

    #[test]
    fn every_doubtful_vertex_is_in_one_group_beside_its_first() {
        let m = cut_cube(6);
        let normals = m.face_normals();
        let surface = Surface::new(&m, &normals, &labels(&m).1);
        let fits = VertexFits::none(m.n_verts(), surface.doubtful.clone());
        let (verts, groups) = groups(&surface, &fits);
        let name = |&i: &u32| surface.near.verts[i as usize];
        let mut grouped: Vec<Vert> = verts.iter().map(name).collect();
        grouped.sort_unstable();
        let others = surface.doubtful.iter().copied().filter(|&v| !surface.interior[v]);
        assert_eq!(grouped, others.collect::<Vec<_>>());
        assert!(groups.len() < verts.len() / 2);
        let mut next = 0;
        for group in groups {
            assert!(group.start == next && !group.is_empty());
            next = group.end;
            let first = verts[group.start];
            let is_beside = |i: &u32| surface.near.neighbours(first).contains(i);
            assert!(verts[group.start + 1..group.end].iter().all(is_beside));
        }
        assert_eq!(next, verts.len());
    }

    #[test]
    fn vertices_of_a_group_have_the_fits_that_they_would_have_alone() {
        let m = cut_cube(6);
        let normals = m.face_normals();
        let surface = Surface::new(&m, &normals, &labels(&m).1);
        let fits = VertexFits::none(m.n_verts(), surface.doubtful.clone());
        let (verts, groups) = groups(&surface, &fits);
        let mut explainer = Explainer::default();
        let (mut together, mut alone) = (Vec::new(), Vec::new());
        groups.iter().for_each(|g| explainer.explain_group(&surface, &verts[g.clone()], &mut together));
        verts.iter().for_each(|&i| explainer.explain_group(&surface, &[i], &mut alone));
        assert_eq!(together.len(), alone.len());
        for ((v, fit), (w, own)) in together.iter().zip(&alone) {
            assert!(v == w && fit.origin == own.origin && fit.distance == own.distance);
            assert!(fit.normal.distance(own.normal) < 1e-9, "{v:?}: {} {}", fit.normal, own.normal);
            assert!((fit.displacement - own.displacement).abs() < 1e-9);
        }
    }

    #[test]
    fn fits_do_not_depend_on_what_was_explained_before() {
        // Turned, so that the same plane is not the same to the last bit from everywhere.
        let turn = glam::DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -1.1, 2.0);
        let (points, faces) = cut_cube(6).into_parts();
        let m = Mesh::new(points.into_iter().map(|p| turn * p).collect(), faces).unwrap();
        let normals = m.face_normals();
        let surface = Surface::new(&m, &normals, &labels(&m).1);
        let fits = VertexFits::none(m.n_verts(), surface.doubtful.clone());
        let (verts, groups) = groups(&surface, &fits);
        let mut worker = Explainer::default();
        let (mut found, mut fresh) = (Vec::new(), Vec::new());
        for group in groups {
            worker.explain_group(&surface, &verts[group.clone()], &mut found);
            Explainer::default().explain_group(&surface, &verts[group], &mut fresh);
        }
        let bits = |found: &[(Vert, Fit)]| {
            found.iter().map(|(v, fit)| (*v, fit.coefficients, fit.frame)).collect::<Vec<_>>()
        };
        assert!(found.len() > 100);
        assert_eq!(bits(&found), bits(&fresh));
    }

    #[test]
    fn groups_are_the_same_at_any_scale_and_ascend() {
        let grouped = |scale: f64| {
            let (points, faces) = cut_cube(6).into_parts();
            let m = Mesh::new(points.into_iter().map(|p| scale * p).collect(), faces).unwrap();
            let normals = m.face_normals();
            let surface = Surface::new(&m, &normals, &labels(&m).1);
            groups(&surface, &VertexFits::none(m.n_verts(), surface.doubtful.clone()))
        };
        let (verts, groups) = grouped(1.0);
        assert_eq!((&verts, &groups), (&grouped(128.0).0, &grouped(128.0).1));
        assert!(groups.into_iter().all(|group| verts[group][1..].is_sorted()));
    }

    #[test]
    fn a_vertex_far_from_all_regions_has_no_fit() {
        let m = cut_cube(6);
        let (normals, labels) = labels(&m);
        let surface = Surface::new(&m, &normals, &labels);
        let fits = explain_by_regions(&surface);
        // One on the chamfers, pulled outwards along its normal.
        let v = *fits.verts.iter().find(|&&v| !surface.interior[v] && fits.get(v).is_some()).unwrap();
        let off = |by: f64| {
            let (mut points, faces) = m.clone().into_parts();
            points[v.index()] += by * surface.h * fits.get(v).unwrap().normal;
            let m = Mesh::new(points, faces).unwrap();
            let normals = m.face_normals();
            let mut surface = Surface::new(&m, &normals, &labels);
            surface.h = 1.0;
            explain_by_regions(&surface).get(v).map(|fit| fit.displacement.abs())
        };
        let [near, far] = [0.3, 0.4].map(off);
        assert!(near.is_some_and(|off| off > 0.3) && far.is_none(), "{near:?} {far:?}");
    }

    #[test]
    fn interior_vertices_take_the_fit_of_the_nearest_one() {
        let m = cut_cube(6);
        let normals = m.face_normals();
        let surface = Surface::new(&m, &normals, &labels(&m).1);
        let mut fits = explain_by_regions(&surface);
        // Each fit is known by its vertex.
        let verts = fits.verts.clone();
        fits.fits.iter_mut().zip(&verts).for_each(|(fit, v)| {
            if let Some(fit) = fit {
                fit.n_members = v.index();
            }
        });
        let mut n_choices = 0;
        for &v in verts.iter().filter(|&&v| surface.interior[v]) {
            let giver = Vert::new(fit_from_beside(&surface, &fits, v).unwrap().n_members);
            let near = &surface.near;
            let neighbours = near.neighbours(near.of[v]).iter().map(|&i| near.verts[i as usize]);
            let others = neighbours.filter(|&w| !surface.interior[w]);
            let distances: Vec<f64> = others.map(|w| m.point(w).distance(m.point(v))).collect();
            let least = distances.iter().copied().fold(f64::INFINITY, f64::min);
            assert_eq!(m.point(giver).distance(m.point(v)), least);
            n_choices += usize::from(distances.iter().any(|&d| d > least + 0.1));
        }
        assert!(n_choices > 5, "{n_choices}");
    }

    #[test]
    fn samples_are_those_within_reach_and_deep_ones_are_trusted() {
        let m = cut_cube(12);
        let normals = m.face_normals();
        let surface = Surface::new(&m, &normals, &labels(&m).1);
        let v = *surface.doubtful.iter().find(|&&v| !surface.interior[v]).unwrap();
        let mut patch = Patch::default();
        patch.search(&surface, &surface, v, 1.0);
        let mut samples = Samples::default();
        samples.take(&surface, &patch, &patch.clusters()[0], m.point(v));
        let Samples { all, n_deep } = &samples;
        assert!(*n_deep > 0 && *n_deep < all.len());
        assert!(all.iter().all(|sample| sample.offset.length() <= REACH_IN_REGION));
        assert!(all[..*n_deep].iter().all(|sample| sample.trust == 1.0));
        assert!(all[*n_deep..].iter().all(|sample| sample.trust == SHALLOW_TRUST));
        assert!(all.len() < patch.members(&patch.clusters()[0]).len(), "the patch is wider");
    }

    // Deep samples with heights `deep(x)` in two rows, and as many that are not deep, at height `outer`.
    fn fit_of(n_deep: usize, outer: f64, deep: fn(f64) -> f64) -> Option<Fit> {
        let sample = |i: usize, z: f64, trust| {
            let offset = DVec3::new((i / 2) as f64, (i % 2) as f64, z);
            Sample { offset, normal: DVec3::Z, trust }
        };
        let inner = (0..n_deep).map(|i| sample(i, deep((i / 2) as f64), 1.0));
        let outer = (0..n_deep).map(|i| sample(i, outer, SHALLOW_TRUST));
        let samples = Samples { all: inner.chain(outer).collect(), n_deep };
        samples.fit(DVec3::ZERO, &mut Fitter::default())
    }

    #[test]
    fn deep_samples_on_a_plane_are_believed_if_they_are_enough() {
        let fit = |n_deep, deep| fit_of(n_deep, 0.2, deep).unwrap();
        let exact = fit(ERODED_MEMBERS, |_| 0.0);
        assert!(exact.is_plane() && exact.displacement.abs() < 1e-9 && exact.n_members == ERODED_MEMBERS);
        assert_eq!(fit(ERODED_MEMBERS - 1, |_| 0.0).n_members, 2 * (ERODED_MEMBERS - 1));
        // They leave a third of what all leave at least: no better.
        let rough = fit(ERODED_MEMBERS, |x| if x % 2.0 == 1.0 { 0.15 } else { 0.0 });
        assert_eq!(rough.n_members, 2 * ERODED_MEMBERS);
        // The last two are a little off the plane of the others.
        let nearly = fit(ERODED_MEMBERS, |x| if x == 3.0 { 0.002 } else { 0.0 });
        assert_eq!(nearly.n_members, ERODED_MEMBERS);
    }

    #[test]
    fn deep_samples_on_a_curve_are_believed_if_the_others_disagree() {
        let members = |off: f64| {
            let sample = |i: usize, trust: f64| {
                let (x, y) = ((i / 2) as f64, (i % 2) as f64);
                let z = 0.05 * x * x + if trust < 1.0 { off * (1.0 - x) } else { 0.0 };
                Sample {
                    offset: DVec3::new(x, y, z),
                    normal: DVec3::new(-0.1 * x, 0.0, 1.0).normalize(),
                    trust,
                }
            };
            let trusts = [1.0, SHALLOW_TRUST];
            let all = trusts.into_iter().flat_map(|trust| (0..8).map(move |i| sample(i, trust))).collect();
            let samples = Samples { all, n_deep: 8 };
            samples.fit(DVec3::ZERO, &mut Fitter::default()).unwrap().n_members
        };
        assert_eq!([0.01, 0.2].map(members), [16, 8]);
    }

    #[test]
    fn where_all_samples_agree_all_count() {
        // They leave 0.001 h, which is no better than what the deep ones leave.
        let fit = fit_of(ERODED_MEMBERS, 0.001, |x| if x % 2.0 == 1.0 { 0.002 } else { 0.0 }).unwrap();
        assert!(fit.rms > ERODED_GAIN * ERODED_RMS && fit.rms < ERODED_RMS, "{}", fit.rms);
        assert_eq!(fit.n_members, 2 * ERODED_MEMBERS);
    }
}
