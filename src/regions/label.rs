//! Which of several fits explains a vertex best, and what explains vertices that no region does (step 6, second pass and
//! late adoption).
//!
//! Based on: nothing in the papers but their plane of the red faces (Sharpen&Bend section 3.3), the first guess.
//! In/out: `Surface` + fits -> more fits, with their source: red faces, leftovers, a neighbour's; far labels go.
//! Cost: O(vertices without a fit), each with up to [`LEFTOVER_MAX`] others round it, in parallel.

use rayon::prelude::*;

use super::VertexFits;
use super::patch::Cluster;
use super::surface::Surface;
use crate::fit::{Fit, FitSource, Fitter, Sample};
use crate::mesh::Vert;

/// Samples that are not deep inside their region are trusted this much: their normals lean towards the
/// chamfer, but small regions have no others.
pub(super) const SHALLOW_TRUST: f64 = 0.1;
/// What a region loses for each h that it is farther away, in h of displacement: of two regions that
/// explain a vertex nearly as well the nearer one is meant.
const DISTANCE_PENALTY: f64 = 0.08;
/// A vertex farther from every fit (in h) is not explained. Marching cubes puts samples up to 0.33 h off;
/// forcing a label on every vertex makes errors above the input's.
pub(super) const EXPLAINED: f64 = 0.35;

/// Leftover vertices this many rings round one may join its fit ...
const LEFTOVER_RINGS: usize = 3;
/// ... which takes this many of them ...
const LEFTOVER_MEMBERS: usize = 4;
/// ... and no more than this many: three rings of evenly spaced vertices have 37 ...
const LEFTOVER_MAX: usize = 128;
/// ... of which this many face as it does: two across a fold are no surface (a needle got 14 faces that cross others);
/// at four a coarse fandisk loses two corners. And so has this share of them: without, and at .7, one of 9 coarse
/// meshes gets clearly worse, at .4 and .6 a third of the gain is lost ...
const LEFTOVER_FACING: usize = 3;
const LEFTOVER_FACING_SHARE: f64 = 0.5;
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
    type Scratch = (Vec<u32>, Vec<Sample>, Fitter);
    let near = &surface.near;
    explain_the_rest(surface, fits, |(members, samples, fitter): &mut Scratch, fits, centre| {
        let is_left = |v: Vert| !surface.interior[v] && fits.get(v).is_none();
        let is_left_near = |i: u32| is_left(near.verts[i as usize]);
        near.collect_rings(near.of[centre], LEFTOVER_RINGS, LEFTOVER_MAX, is_left_near, members);
        let is_left_face = |f| surface.mesh.corners(f).into_iter().all(is_left);
        let sample = |&i: &u32| {
            let v = near.verts[i as usize];
            let normal = surface.normal_of(v, is_left_face);
            let offset = (surface.mesh.point(v) - surface.mesh.point(centre)) / surface.h;
            (normal != glam::DVec3::ZERO).then_some(Sample::new(offset, normal, 1.0))
        };
        samples.clear();
        samples.extend(members.iter().filter_map(sample));
        if samples.len() < LEFTOVER_MEMBERS {
            return None;
        }
        let fit = fitter.fit(surface.mesh.point(centre), samples, FitSource::Leftover)?;
        let is_good = fit.n_members >= LEFTOVER_FACING
            && fit.n_members as f64 >= LEFTOVER_FACING_SHARE * samples.len() as f64
            && fit.rms <= max_rms
            && fit.displacement.abs() <= LEFTOVER_DISPLACEMENT;
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
    use crate::regions::tests::{labels, planes};
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
        // A strip folded by 90 degrees is not smooth: at most one side alone is.
        let (mut points, faces) = strip().into_parts();
        points[4..].iter_mut().for_each(|p| *p = dvec3(1.0, p.y, 1.0 - p.x));
        let folded = Mesh::new(points, faces).unwrap();
        let normals = folded.face_normals();
        let mut fits = VertexFits::none(8, folded.verts().collect());
        explain_by_leftovers(&surface(&folded, &normals), &mut fits, LEFTOVER_RMS);
        assert!(fits.iter().count() <= 2, "a vertex at each end sees enough of its side");
        let is_of_one_side = |fit: &Fit| fit.normal.x.max(fit.normal.z) > 0.999 && fit.rms < 1e-3;
        assert!(fits.iter().all(|(_, fit)| is_of_one_side(fit)));
    }

    #[test]
    fn leftovers_fit_each_other_if_half_of_them_face_one_way() {
        // Columns of a strip that curls up: three rings round the middle are seven columns.
        let is_explained = |turn: f64| {
            let (mut points, faces) = crate::regions::patch::tests::strip(9).into_parts();
            let (mut x, mut z) = (0.0, 0.0);
            for (column, pair) in points.chunks_mut(2).enumerate() {
                pair.iter_mut().for_each(|p| (p.x, p.z) = (x, z));
                let (sine, cosine) = (turn * column as f64).to_radians().sin_cos();
                (x, z) = (x + cosine, z + sine);
            }
            let m = Mesh::new(points, faces).unwrap();
            let mut fits = VertexFits::none(18, m.verts().collect());
            explain_by_leftovers(&surface(&m, &m.face_normals()), &mut fits, LEFTOVER_RMS);
            fits.get(Vert::new(8)).is_some()
        };
        assert!(is_explained(15.0), "five of seven columns");
        assert!(!is_explained(30.0), "three");
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
