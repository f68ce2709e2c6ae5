//! Which fit explains each doubtful vertex (steps 4 to 6, second pass and late adoption).

use rayon::prelude::*;

use super::VertexFits;
use super::patch::{Cluster, Member, Patch};
use super::surface::Surface;
use crate::fit::{Fit, FitSource, Fitter, Sample};
use crate::mesh::Vert;

/// Samples that are not deep inside their region are trusted this much: their normals lean towards the
/// chamfer, but small regions have no others.
pub(super) const SHALLOW_TRUST: f64 = 0.1;
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
pub(super) const EXPLAINED: f64 = 0.35;

/// Fits of one region have normals within this angle (cosine; 20 degrees) of its vertices': those of two that make
/// a crease do not.
const SAME_REGION_COSINE: f64 = 0.94;
/// An interior vertex takes the fit of a vertex beside it that is at most this far off, in h. From .1 on coarse
/// countersinks have 5 % more error, at .02 noisy meshes make three quarters of the fits themselves, here half of
/// them; others hardly any.
const SHARED_DISPLACEMENT: f64 = 0.07;

/// Leftover vertices this many rings round one may join its fit ...
const LEFTOVER_RINGS: usize = 3;
/// ... which takes this many of them ...
const LEFTOVER_MEMBERS: usize = 4;
/// ... and has to be this good: residual and displacement in h. At a residual of 0.03 coarse meshes lose
/// a tenth of their gain, at 0.1 finely sampled ones a quarter.
pub(super) const LEFTOVER_RMS: f64 = 0.05;
/// Where samples are off the surface, all residuals beside a crease are larger: a coarse marching-cubes mesh
/// gains a twentieth, and none loses.
pub(super) const LEFTOVER_RMS_OFF_SURFACE: f64 = 0.1;
const LEFTOVER_DISPLACEMENT: f64 = 0.1;

/// A vertex adopts the fit of a neighbour if it lies within this distance of it, in h ...
const ADOPTED_DISPLACEMENT: f64 = 0.1;
/// ... and one of its faces within this angle (cosine; 40 degrees) of the fit's normal.
const ADOPTED_COSINE: f64 = 0.77;

/// Vertices per unit of parallel work, at least: each unit makes its own scratch memory.
const MIN_TASK: usize = 128;

/// Steps 3 to 5: gives each doubtful vertex the fit of the smooth region that explains it best. Interior ones,
/// which have others beside them, take one of theirs where it fits: two of five vertices.
pub(super) fn explain_by_regions(surface: &Surface) -> VertexFits {
    let mut fits = VertexFits::none(surface.mesh.n_verts(), surface.doubtful.clone());
    let per_h = surface.h.recip();
    let explain = |(patch, samples, fitter): &mut (Patch, Vec<Sample>, Fitter), &v: &Vert| {
        patch.search(surface, surface, v);
        let fit = |cluster: &Cluster| {
            let sample = |member: &Member| Sample {
                offset: member.offset * per_h,
                normal: surface.near.normals[member.near as usize],
                trust: if surface.near.deep[member.near as usize] { 1.0 } else { SHALLOW_TRUST },
            };
            samples.clear();
            samples.extend(patch.members(cluster).iter().map(sample));
            let fit = fitter.fit(surface.mesh.point(v), samples, FitSource::Region)?;
            let n_members = samples.len();
            let n_deep = samples.iter().filter(|sample| sample.trust == 1.0).count();
            if fit.rms > ERODED_RMS && (ERODED_MEMBERS..n_members).contains(&n_deep) {
                samples.retain(|sample| sample.trust == 1.0);
                let eroded = fitter.fit(surface.mesh.point(v), samples, FitSource::Region);
                if let Some(eroded) = eroded.filter(|eroded| eroded.rms < ERODED_GAIN * fit.rms) {
                    return Some(eroded);
                }
            }
            Some(fit).filter(|fit| fit.rms <= MAX_RMS)
        };
        if surface.interior[v] {
            return patch.clusters().first().and_then(fit);
        }
        best(patch.clusters(), per_h, fit).filter(|fit| fit.displacement.abs() < EXPLAINED)
    };
    // In the order in which they lie in memory; first those that the interior ones may take theirs from.
    let has_slot = |&v: &Vert| !surface.interior[v] && fits.slot[v] != u32::MAX;
    let others: Vec<Vert> = surface.near.verts.iter().copied().filter(has_slot).collect();
    let scratch = <(Patch, Vec<Sample>, Fitter)>::default;
    let found: Vec<_> = others.par_iter().with_min_len(MIN_TASK).map_init(scratch, explain).collect();
    for (v, fit) in others.into_iter().zip(found) {
        fits.fits[fits.slot[v] as usize] = fit;
    }
    let is_open = |v: Vert, _: Option<&Fit>| surface.interior[v];
    explain_those(&mut fits, is_open, |scratch, fits, v| {
        fit_from_beside(surface, fits, v).or_else(|| explain(scratch, &v))
    });
    fits
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

/// The fit of the cluster that explains a vertex best. `clusters` are in the order of their distance.
pub(super) fn best(
    clusters: &[Cluster],
    per_h: f64,
    mut fit: impl FnMut(&Cluster) -> Option<Fit>,
) -> Option<Fit> {
    let mut best: Option<Fit> = None;
    for cluster in clusters {
        let distance = cluster.distance() * per_h;
        if best.as_ref().is_some_and(|best| score(best) <= DISTANCE_PENALTY * (distance - 1.0)) {
            break; // No region from here on can be better.
        }
        let Some(fit) = fit(cluster).map(|fit| Fit { distance, ..fit }) else { continue };
        if best.as_ref().is_none_or(|best| score(&fit) < score(best)) {
            best = Some(fit);
        }
    }
    best
}

/// How badly `fit` explains its vertex.
pub(super) fn score(fit: &Fit) -> f64 {
    fit.displacement.abs() + DISTANCE_PENALTY * (fit.distance - 1.0)
}

/// Step 6a: a vertex that no region explains, but that has red faces, keeps the papers' plane.
pub(super) fn explain_by_red_faces(surface: &Surface, fits: &mut VertexFits) {
    explain_the_rest(surface, fits, |(), _, v| {
        let normal = surface.normal_of(v, |f| surface.red_face[f]);
        (normal != glam::DVec3::ZERO).then(|| Fit::plane(surface.mesh.point(v), normal, FitSource::Paper))
    });
}

/// Step 6b: fits among the vertices that are still without one.
pub(super) fn explain_by_leftovers(surface: &Surface, fits: &mut VertexFits, max_rms: f64) {
    type Scratch = (Vec<Vert>, Vec<Sample>, Fitter);
    explain_the_rest(surface, fits, |(members, samples, fitter): &mut Scratch, fits, centre| {
        let is_left = |v: Vert| !surface.interior[v] && fits.get(v).is_none();
        members.clear();
        members.push(centre);
        let mut ring_start = 0;
        for _ in 0..LEFTOVER_RINGS {
            let ring = ring_start..members.len();
            ring_start = members.len();
            for i in ring {
                for w in surface.neighbours(members[i]) {
                    if is_left(w) && !members.contains(&w) {
                        members.push(w);
                    }
                }
            }
        }
        let is_left_face = |f| surface.mesh.corners(f).into_iter().all(is_left);
        let sample = |&v: &Vert| {
            let normal = surface.normal_of(v, is_left_face);
            let offset = (surface.mesh.point(v) - surface.mesh.point(centre)) / surface.h;
            (normal != glam::DVec3::ZERO).then_some(Sample { offset, normal, trust: 1.0 })
        };
        samples.clear();
        samples.extend(members.iter().filter_map(sample));
        if samples.len() < LEFTOVER_MEMBERS {
            return None;
        }
        let fit = fitter.fit(surface.mesh.point(centre), samples, FitSource::Leftover)?;
        let is_good = fit.rms <= max_rms && fit.displacement.abs() <= LEFTOVER_DISPLACEMENT;
        is_good.then_some(fit)
    });
}

/// Second pass: takes back the labels farther than `limit` (in h) from their vertex, and all guesses.
pub(super) fn take_back_far_labels(surface: &Surface, fits: &mut VertexFits, limit: f64) {
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
    explain_the_rest(surface, fits, |(), fits, v| {
        let point = surface.mesh.point(v);
        let mut nearest: Option<(f64, Fit)> = None;
        let handed_on = |w: Vert| fits.get(w).filter(|fit| fit.source != FitSource::Paper);
        for fit in surface.neighbours(v).filter_map(handed_on) {
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
fn explain_the_rest<Scratch: Default>(
    surface: &Surface,
    fits: &mut VertexFits,
    explain: impl Fn(&mut Scratch, &VertexFits, Vert) -> Option<Fit> + Sync,
) {
    explain_those(fits, |v, fit| !surface.interior[v] && fit.is_none(), explain);
}

/// Gives a fit to each vertex of which `is_open` holds, all from the same state; one that has a fit keeps it
/// unless there is a new one. Returns the vertices that got one.
pub(super) fn explain_those<Scratch: Default>(
    fits: &mut VertexFits,
    is_open: impl Fn(Vert, Option<&Fit>) -> bool,
    explain: impl Fn(&mut Scratch, &VertexFits, Vert) -> Option<Fit> + Sync,
) -> Vec<Vert> {
    let is_open = |&(&v, fit): &(&Vert, &Option<Fit>)| is_open(v, fit.as_ref());
    let mut open: Vec<Vert> = fits.verts.iter().zip(&fits.fits).filter(is_open).map(|(&v, _)| v).collect();
    let explain = |scratch: &mut Scratch, &v: &Vert| explain(scratch, fits, v);
    let found: Vec<_> = open.par_iter().with_min_len(MIN_TASK).map_init(Scratch::default, explain).collect();
    let mut found = found.into_iter();
    open.retain(|&v| found.next().flatten().map(|fit| fits.set(v, fit)).is_some());
    open
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::mesh::tests::mesh;
    use crate::mesh::{Mesh, PerFace, PerVert};
    use crate::regions::near::Near;
    use crate::regions::tests::{cut_cube, labels, planes};
    use FitSource::{Adopted, Leftover, Paper, Region};
    use approx::assert_relative_eq;
    use glam::{DVec3, dvec3};

    /// A surface that says nothing about its vertices: none is interior, no face red.
    pub(in crate::regions) fn surface<'a>(mesh: &'a Mesh, normals: &'a PerFace<DVec3>) -> Surface<'a> {
        let mut surface = Surface::new(mesh, normals, &labels(mesh).1);
        surface.h = 1.0;
        surface.interior = PerVert::filled(mesh.n_verts(), false);
        surface.deep = surface.interior.clone();
        surface.red_face = PerFace::filled(mesh.n_faces(), false);
        surface.near = Near::around(&surface, &mesh.verts().collect::<Vec<_>>());
        surface
    }

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
            assert!(fit.displacement.abs() < 1e-9 && fit.source == Region);
        }
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

    // 1---3---5---7
    // | / | / | / |      all in the plane z = 0
    // 0---2---4---6
    fn strip() -> Mesh {
        let points: Vec<_> = (0..8).map(|i| [f64::from(i / 2), f64::from(i % 2), 0.0]).collect();
        mesh(&points, &[[0, 2, 3], [0, 3, 1], [2, 4, 5], [2, 5, 3], [4, 6, 7], [4, 7, 5]])
    }

    #[test]
    fn what_no_region_explains_keeps_the_plane_of_its_red_faces() {
        let m = strip();
        let normals = m.face_normals();
        let mut surface = surface(&m, &normals);
        surface.red_face[crate::mesh::Face::new(0)] = true;
        surface.interior[Vert::new(0)] = true;
        let mut fits = planes(&m, &[(3, DVec3::X, 0.0, Region)]);
        // Room for all, as `doubtful` gives it.
        let mut all = VertexFits::none(8, m.verts().collect());
        all.set(Vert::new(3), fits.fits[0].take().unwrap());
        explain_by_red_faces(&surface, &mut all);
        let found: Vec<_> = all.iter().map(|(v, fit)| (v.index(), fit.normal, fit.source)).collect();
        assert_eq!(found, [(2, DVec3::Z, Paper), (3, DVec3::X, Region)], "0 is interior, 3 has a fit");
    }

    #[test]
    fn leftovers_fit_each_other_if_they_are_enough_and_smooth() {
        let m = strip();
        let normals = m.face_normals();
        let mut fits = VertexFits::none(8, m.verts().collect());
        explain_by_leftovers(&surface(&m, &normals), &mut fits, LEFTOVER_RMS);
        assert!(fits.iter().count() == 8 && fits.iter().all(|(_, fit)| fit.source == Leftover));
        assert!(fits.iter().all(|(_, fit)| fit.normal.distance(DVec3::Z) < 1e-9 && fit.rms < 1e-7));
        // Three of them are not enough, also where others with a region's fit are next to them.
        let mut fits = VertexFits::none(8, m.verts().collect());
        for v in 3..8 {
            fits.set(Vert::new(v), Fit::plane(DVec3::ZERO, DVec3::Z, Region));
        }
        explain_by_leftovers(&surface(&m, &normals), &mut fits, LEFTOVER_RMS);
        assert_eq!(fits.iter().filter(|(_, fit)| fit.source == Leftover).count(), 0);
        // A strip folded by 90 degrees is not smooth.
        let (mut points, faces) = strip().into_parts();
        points[4..].iter_mut().for_each(|p| *p = dvec3(1.0, p.y, 1.0 - p.x));
        let folded = Mesh::new(points, faces).unwrap();
        let normals = folded.face_normals();
        let mut fits = VertexFits::none(8, folded.verts().collect());
        explain_by_leftovers(&surface(&folded, &normals), &mut fits, LEFTOVER_RMS);
        assert_eq!(fits.iter().count(), 0);
    }

    #[test]
    fn far_labels_and_guesses_are_taken_back() {
        let m = strip();
        let normals = m.face_normals();
        let mut surface = surface(&m, &normals);
        surface.interior[Vert::new(4)] = true;
        let list =
            [(0, 0.14, Region), (1, 0.16, Region), (2, 0.0, Leftover), (3, 0.0, Paper), (4, 0.3, Region)];
        let list = list.map(|(v, d, source)| (v, DVec3::Z, d, source));
        let left = |limit| {
            let mut fits = planes(&m, &list);
            take_back_far_labels(&surface, &mut fits, limit);
            fits.iter().map(|(v, _)| v.index()).collect::<Vec<_>>()
        };
        assert_eq!(left(0.15), [0, 4], "an interior vertex keeps its own region");
        assert_eq!(left(0.2), [0, 1, 4], "all guesses");
    }

    #[test]
    fn a_vertex_adopts_the_fit_of_the_neighbour_on_which_it_lies_best() {
        // Vertex 5 is next to 2, 3, 4 and 7; the planes of 2, 3 and 4 pass 0.04, 0.02 and 0 from it.
        let m = strip();
        let normals = m.face_normals();
        let surface = surface(&m, &normals);
        let adopted = |list: &[(usize, DVec3, f64, FitSource)]| {
            let mut fits = VertexFits::none(8, m.verts().collect());
            for (v, fit) in planes(&m, list).iter() {
                fits.set(v, fit.clone());
            }
            adopt_from_neighbours(&surface, &mut fits);
            fits.get(Vert::new(5)).cloned()
        };
        let steep = dvec3(1.0, 0.0, 0.0);
        let list = [(2, DVec3::Z, 0.04, Region), (3, DVec3::Z, -0.02, Region), (4, DVec3::Z, 0.0, Paper)];
        let fit = adopted(&list).unwrap();
        assert_eq!((fit.source, fit.displacement, fit.normal), (Adopted, 0.0, DVec3::Z));
        assert_relative_eq!(fit.evaluate(m.point(Vert::new(5)), 1.0).0, 0.02, epsilon = 1e-12);
        // Too far off; or no face that follows the fit.
        assert!(adopted(&[(3, DVec3::Z, 0.11, Region)]).is_none());
        assert!(adopted(&[(7, steep, -1.0, Region)]).is_none());
    }
}
