//! Which samples beside chamfers are off the surface, and where on it they belong (step 9).
//!
//! ```text
//!   o---o---o   o---o      o  samples of one side, on their fit
//!            `.´           x  one that is off it: on the inner side of the crease, and alone
//!             x
//! ```
//!
//! Based on: nothing in the papers, which let samples stay.
//! Differs: on the inner side of a crease a sample moves when it is off by less; none moves to what is beside its facet.
//! In/out: `Surface` + fits + chamfers -> vertices, ascending, and where to.
//! Cost: O(chamfer edges).

use glam::DVec3;

use super::VertexFits;
use super::surface::{Surface, edges_at};
use crate::fit::{Fit, FitSource};
use crate::mesh::{Half, Vert};

/// A sample is moved onto its fit only if it is farther off than this, in h ...
const MIN_MOVE: f64 = 0.003;
/// ... and this many times the fit's residual, ...
const MIN_MOVE_IN_RMS: f64 = 6.0;
/// ... of a plane three, as it is what a few bad samples leave: at 6 samples stay off beside a crease, ...
const MIN_MOVE_OF_PLANE_IN_RMS: f64 = 3.0;
/// ... and of any fit two where the sample lies on the inner side of its crease, which is where marching cubes puts
/// samples (what they miss the surface by, as a mean square, falls by up to two fifths in 31 of 78 meshes and rises in
/// none; 1.5 is as good; with quadrics alone a star on a grid along the axes keeps 2.7 times the L2), ...
const MIN_MOVE_TO_INNER_IN_RMS: f64 = 2.0;
/// ... if the fit is good to this (in h): more is what curvature leaves, and a bias. On a countersink samples move
/// the wrong way from .015 on, ...
const MAX_RMS_OF_UNBIASED: f64 = 0.0125;
/// ... or else if the sample stands out, as a bias is common to all samples beside a crease: their median displacement
/// has to be below this share of its own.
const STANDS_OUT: f64 = 0.5;
/// Nor is it moved if it is so far off, in h, that the fit must be the wrong one, ...
const MAX_MOVE: f64 = 0.5;
/// ... and only ends of chamfers are this far off. Others have the label of what is beside their facet, which has no
/// interior, ...
const MAX_MOVE_OF_OTHERS: f64 = 0.12;
/// ... and so have the ends next to them that are off to the same side by more than this. Of the samples of a fandisk
/// that were moved these made half of what all missed the surface by.
const MAX_MOVE_BESIDE_OTHERS: f64 = 0.1;
/// But a plane with no larger residual than this, in h, is that of an exact side, from which grids along the axes put whole
/// rows off (a wedge keeps eight times the L2 without; of the wrong labels of a fandisk none is as good).
const EXACT_RMS: f64 = 1e-5;
/// Those with normals of this cosine to its own, at least, are beside the same crease on the same side.
const SAME_SIDE: f64 = 0.8;

/// Step 9: the vertices of `chamfers` and their neighbours that lie off their fit, and where on it they
/// belong.
pub(super) fn moves(surface: &Surface, fits: &VertexFits, chamfers: &[Half]) -> Vec<(Vert, DVec3)> {
    let near = &surface.near;
    let mut is_end = vec![false; near.verts.len()];
    let mut is_in_zone = is_end.clone();
    for i in chamfers.iter().flat_map(|&h| surface.mesh.ends(h)).map(|v| near.of[v]) {
        (is_end[i as usize], is_in_zone[i as usize]) = (true, true);
        near.neighbours(i).iter().for_each(|&j| is_in_zone[j as usize] = true);
    }
    let max_move = surface.deepened(MAX_MOVE);
    let onto_fit = |i: u32| {
        let v = near.verts[i as usize];
        let fit = fits.get(v).filter(|fit| fit.source == FitSource::Region && !surface.deep[v])?;
        let distance = fit.displacement.abs();
        let is_off = |times: f64| distance > MIN_MOVE.max(times * fit.rms) && distance < max_move;
        let is_moved = is_off(MIN_MOVE_IN_RMS)
            || fit.is_plane() && is_off(MIN_MOVE_OF_PLANE_IN_RMS)
            || is_off(MIN_MOVE_TO_INNER_IN_RMS)
                && is_on_inner_side(surface, fits, chamfers, v)
                && (fit.rms < MAX_RMS_OF_UNBIASED || stands_out(surface, fits, &is_end, v));
        let is_moved =
            is_moved && (surface.has_rounds() || !is_on_another_facet(surface, fits, &is_end, i, fit));
        is_moved.then(|| (v, surface.mesh.point(v) + surface.h * fit.displacement * fit.normal))
    };
    let zone = (0..near.verts.len() as u32).filter(|&i| is_in_zone[i as usize]);
    let mut moves: Vec<(Vert, DVec3)> = zone.filter_map(onto_fit).collect();
    moves.sort_unstable_by_key(|&(v, _)| v);
    moves
}

/// Whether `v` is the end of chamfer edges, and below its fit where they make a ridge, above it where a valley.
fn is_on_inner_side(surface: &Surface, fits: &VertexFits, chamfers: &[Half], v: Vert) -> bool {
    let Surface { mesh, .. } = surface;
    let Some(fit) = fits.get(v) else { return false };
    let across = edges_at(mesh, v).filter(|&(h, _)| chamfers.binary_search(&mesh.edge(h)).is_ok());
    let bend = |w: Vert| {
        let along = mesh.point(w) - mesh.point(v);
        fits.get(w).map_or(0.0, |other| (along.dot(other.normal) - along.dot(fit.normal)).signum())
    };
    across.map(|(_, w)| bend(w)).sum::<f64>() * fit.displacement > 0.0
}

/// Whether `v` is farther from its fit than the ends of chamfers near it on the same side are from theirs.
fn stands_out(surface: &Surface, fits: &VertexFits, is_end: &[bool], v: Vert) -> bool {
    let near = &surface.near;
    let Some(fit) = fits.get(v) else { return false };
    let mut round: Vec<u32> = near.neighbours(near.of[v]).to_vec();
    round.extend(near.neighbours(near.of[v]).iter().flat_map(|&i| near.neighbours(i)));
    round.sort_unstable();
    round.dedup();
    let is_beside = |&i: &u32| is_end[i as usize] && !near.interior[i as usize] && i != near.of[v];
    let beside = round.into_iter().filter(is_beside).filter_map(|i| fits.get(near.verts[i as usize]));
    let is_same =
        |other: &&Fit| other.source == FitSource::Region && other.normal.dot(fit.normal) > SAME_SIDE;
    let mut displacements: Vec<f64> = beside.filter(is_same).map(|other| other.displacement).collect();
    displacements.sort_unstable_by(f64::total_cmp);
    let n = displacements.len();
    n > 0 && {
        let median = displacements[(n - 1) / 2].midpoint(displacements[n / 2]);
        median.abs() < STANDS_OUT * fit.displacement.abs()
    }
}

/// Whether the near vertex with the number `i` and the fit `fit`, or one beside it, is off that fit where no chamfer
/// edge ends, so that no crease is the reason.
fn is_on_another_facet(surface: &Surface, fits: &VertexFits, is_end: &[bool], i: u32, fit: &Fit) -> bool {
    let near = &surface.near;
    let distance = fit.displacement.abs();
    if fit.is_plane() && fit.rms < EXACT_RMS {
        return false;
    }
    if !is_end[i as usize] {
        return distance > MAX_MOVE_OF_OTHERS;
    }
    let is_off_as_well = |&j: &u32| {
        let other = fits.get(near.verts[j as usize]).filter(|other| other.source == FitSource::Region);
        other.is_some_and(|other| {
            other.displacement * fit.displacement.signum() > MAX_MOVE_OF_OTHERS
                && other.normal.dot(fit.normal) > SAME_SIDE
        })
    };
    let mut others = near.neighbours(i).iter().filter(|&&j| !is_end[j as usize]);
    distance > MAX_MOVE_BESIDE_OTHERS && others.any(is_off_as_well)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tests::mesh;
    use crate::mesh::{Mesh, PerVert};
    use crate::regions::near::Near;
    use crate::regions::tests::planes;
    use FitSource::{Adopted, Region};
    use glam::dvec3;

    // 3---2    The chamfer edge 0-2, from (0, 0, 0) to (1, 1, 0).
    // | / |
    // 0---1
    fn square() -> Mesh {
        mesh(&[[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]], &[[0, 1, 2], [0, 2, 3]])
    }

    #[test]
    fn samples_near_a_chamfer_move_if_they_are_off_and_not_deep() {
        let m = square();
        let (normals, labels) = crate::regions::tests::labels(&m);
        let mut surface = Surface::new(&m, &normals, &labels);
        surface.h = 2.0;
        surface.deep = PerVert::filled(4, false);
        surface.near = Near::around(&surface, &m.verts().collect::<Vec<_>>());
        surface.deep[Vert::new(3)] = true;
        let list = [(0, DVec3::Z, 0.1, Region), (1, DVec3::Z, 0.1, Adopted), (2, DVec3::Z, 0.002, Region)];
        let mut list = list.to_vec();
        list.push((3, DVec3::Z, 0.1, Region));
        let fits = planes(&m, &list);
        let moved = moves(&surface, &fits, &[Half::new(2)]);
        // Vertex 1 carries a guess, 2 is hardly off, 3 is deep.
        assert_eq!(moved, [(Vert::new(0), dvec3(0.0, 0.0, 0.2))]);
    }

    #[test]
    fn how_far_off_a_sample_has_to_be_depends_on_what_its_fit_leaves() {
        let m = square();
        let (normals, labels) = crate::regions::tests::labels(&m);
        let mut surface = Surface::new(&m, &normals, &labels);
        surface.deep = PerVert::filled(4, false);
        surface.near = Near::around(&surface, &m.verts().collect::<Vec<_>>());
        let moves = |displacement: f64, rms: f64, curvature: f64| {
            let mut fits = planes(&m, &[(0, DVec3::Z, displacement, Region)]);
            let fit = fits.fits[0].as_mut().unwrap();
            (fit.rms, fit.coefficients[3]) = (rms, curvature);
            !super::moves(&surface, &fits, &[Half::new(2)]).is_empty()
        };
        assert!(moves(0.07, 0.02, 0.0) && !moves(0.05, 0.02, 0.0), "a plane");
        assert!(moves(0.13, 0.02, 0.1) && !moves(0.11, 0.02, 0.1), "a curved side");
    }

    // 1---3---5---7-     Chamfers between the odd vertices, on a side that faces up, and the even ones, on one that
    // | / | / | / |      faces down the page: a ridge. With `turn` -1 the sides face each other, in a valley.
    // 0---2---4---6-
    #[test]
    fn a_sample_a_little_off_a_curved_side_has_to_be_on_the_inner_side_and_stand_out() {
        let m = crate::regions::patch::tests::strip(8);
        let (normals, labels) = crate::regions::tests::labels(&m);
        let mut surface = Surface::new(&m, &normals, &labels);
        surface.deep = PerVert::filled(16, false);
        surface.interior = PerVert::filled(16, false);
        surface.near = Near::around(&surface, &m.verts().collect::<Vec<_>>());
        let is_chamfer = |&h: &Half| {
            let (a, b) = (m.from(h), m.to(h));
            !m.is_border(h) && m.edge(h) == h && a.index() % 2 != b.index() % 2
        };
        let chamfers: Vec<Half> = (0..m.n_halves()).map(Half::new).filter(is_chamfer).collect();
        let is_moved_at = |rms: f64, own: f64, others: f64, turn: f64| {
            let fit = |v: usize| {
                let normal = [turn * -DVec3::Y, DVec3::Z][v % 2];
                (v, normal, if v == 6 { own } else { others }, Region)
            };
            let mut fits = planes(&m, &(0..16).map(fit).collect::<Vec<_>>());
            for fit in fits.fits.iter_mut().flatten() {
                (fit.rms, fit.coefficients[3]) = (rms, 0.1);
            }
            moves(&surface, &fits, &chamfers).iter().any(|&(v, _)| v == Vert::new(6))
        };
        let is_moved = |own, others, turn| is_moved_at(0.02, own, others, turn);
        assert!(is_moved(0.07, 0.0, 1.0) && is_moved(0.05, 0.02, 1.0), "more than two residuals");
        assert!(!is_moved(0.035, 0.0, 1.0), "less than two");
        assert!(!is_moved(0.07, 0.04, 1.0), "no more than the others");
        assert!(!is_moved(-0.07, 0.0, 1.0) && is_moved(-0.07, 0.0, -1.0), "above a ridge, above a valley");
        assert!(is_moved(-0.13, 0.04, 1.0), "six residuals are enough");
        assert!(is_moved_at(0.01, 0.025, 0.025, 1.0), "a good fit is not biased");
        assert!(!is_moved_at(0.01, -0.025, 0.0, 1.0), "but the inner side it has to be");
    }

    #[test]
    fn a_sample_is_not_moved_to_what_is_beside_its_facet() {
        let m = square();
        let (normals, labels) = crate::regions::tests::labels(&m);
        let mut surface = Surface::new(&m, &normals, &labels);
        surface.deep = PerVert::filled(4, false);
        surface.near = Near::around(&surface, &m.verts().collect::<Vec<_>>());
        // Of the end 0 of the chamfer and of vertex 1, which is none.
        let moved_at = |rms: f64, end: f64, other: f64, lean: f64| {
            let normal = dvec3(0.0, lean.sin(), lean.cos());
            let mut fits = planes(&m, &[(0, DVec3::Z, end, Region), (1, normal, other, Region)]);
            fits.fits.iter_mut().flatten().for_each(|fit| fit.rms = rms);
            moves(&surface, &fits, &[Half::new(2)]).iter().map(|&(v, _)| v.index()).collect::<Vec<_>>()
        };
        let moved = |end, other, lean| moved_at(1e-4, end, other, lean);
        assert_eq!(moved(0.3, 0.11, 0.0), [0, 1]);
        assert_eq!(moved(0.3, 0.13, 0.0), [0; 0], "off where no chamfer ends");
        assert_eq!(moved_at(8e-6, 0.3, 0.13, 0.0), [0, 1], "an exact side");
        assert_eq!(moved_at(1.2e-5, 0.3, 0.13, 0.0), [0; 0], "hardly exact");
        assert_eq!(moved_at(1e-6, 0.49, 0.51, 0.0), [0], "too far in any case");
        assert_eq!(moved_at(0.0, 0.0028, 0.0032, 0.0), [1], "too near");
        assert_eq!(moved(0.09, 0.13, 0.0), [0], "a little");
        assert_eq!(moved(-0.3, 0.13, 0.0), [0], "to the other side");
        assert_eq!(moved(0.3, 0.13, 0.8), [0], "another surface");
        assert_eq!(moved(0.3, 0.13, 0.5), [0; 0], "the same one, bent");
    }
}
