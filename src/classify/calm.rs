//! The interior of surfaces that bend evenly, however low the threshold of smooth edges is.
//!
//! ```text
//!   flat         .-o-o-.        Most edges of a part are flat, and twice their mean angle is less than the wall of
//!   -o--o--o--o-´       `o      a small hole bends from facet to facet. Its samples are those of one quadric all the
//!                 wall   o      same, and those beside a crease are not.
//! ```
//!
//! Based on: nothing in the papers, where all edges have one threshold.
//! In/out: `Mesh` + face normals `[F]` + `Labels` (smooth edges, interior vertices) -> more interior vertices.
//! Cost: O(V); a solution of 6 by 6 for each vertex with bends that no crease needs but the mean forbids, in parallel.

use std::f64::consts::PI;

use glam::DVec3;
use nalgebra::{SMatrix, SVector};
use rayon::prelude::*;

use super::{Labels, chord_squared};
use crate::mesh::{Mesh, PerFace, Vert};
use crate::rings::collect_rings;

/// Edges that bend by less than this are no chamfers (those of the least crease bend by half of 35 degrees), and are
/// smooth where all edges round them are: 8 degrees, in radians.
pub(crate) const CALM_ANGLE: f64 = 8.0 * PI / 180.0;

/// Edges that bend by less than this, in radians, are smooth where the samples round them are those of one quadric: 20
/// degrees. The wall of a hole with a radius of three edges bends by 19; at 40 hardly any vertex more is found.
const EVEN_ANGLE: f64 = 20.0 * PI / 180.0;
/// Samples are taken from this many rings ...
const RINGS: usize = 2;
/// ... up to this many, which slivers seldom reach: finding them takes time in the square of their number.
const MAX_SAMPLES: usize = 64;
/// Fewer than twice as many as a quadric has coefficients do not tell whether it fits.
const MIN_SAMPLES: usize = 12;
/// What a quadric leaves of their heights, as root of the mean square and in mean lengths of the edges at the vertex,
/// where a surface is even. Nine tenths of a hole's wall have .009 or less, facets of 22 degrees and slanted vertices of
/// chamfers .008 and more. At .008 a block's hole has 1.2 times the error, at .015 a fandisk 1.07 times.
const EVEN_RMS: f64 = 0.01;
/// Added to the diagonal of the normal equations for each sample: enough to solve for samples in one line.
const RIDGE: f64 = 1e-9;

/// Paints red each vertex that has no edge of [`CALM_ANGLE`] or more, and no neighbour that has; and those of which that
/// holds of [`EVEN_ANGLE`] if a quadric passes through the samples round them.
///
/// Where most of a mesh is flat without any noise, on grids along the axes above all, the mean angle is next to
/// nothing, and the wall of a hole has no vertex with smooth edges only: its rim gets the wrong labels (L2 of a block
/// with a hole .0206 -> .0088, of a coarse one .0665 -> .0221). With a larger threshold for all edges, slanted vertices of
/// chamfers count as smooth too, and a wedge has 8 times the error.
pub(super) fn add_calm_vertices(mesh: &Mesh, normals: &PerFace<DVec3>, labels: &mut Labels) {
    if labels.threshold >= EVEN_ANGLE {
        return;
    }
    let chord = |angle: f64| (2.0 * (0.5 * angle).sin()).powi(2);
    let candidates = candidates(mesh, normals, labels, chord(EVEN_ANGLE));
    for (angle, has_to_be_even) in [(CALM_ANGLE, false), (EVEN_ANGLE, true)] {
        if labels.threshold >= angle {
            continue;
        }
        let interior = &mut labels.interior_vertex;
        let bends_less = |&&(v, steepest): &&(Vert, f64)| steepest < chord(angle) && !interior[v];
        let calm: Vec<Vert> = candidates.iter().filter(bends_less).map(|&(v, _)| v).collect();
        let mut is_calm = interior.clone();
        calm.iter().for_each(|&v| is_calm[v] = true);
        let counts = |ring: &mut Vec<Vert>, &v: &Vert| {
            mesh.leaving(v).iter().all(|&h| is_calm[mesh.to(h)])
                && (!has_to_be_even || is_even(mesh, normals, v, ring))
        };
        let counts: Vec<bool> = calm.par_iter().map_init(Vec::new, counts).collect();
        calm.iter().zip(counts).filter(|(_, counts)| *counts).for_each(|(&v, _)| interior[v] = true);
    }
}

/// The vertices that are not interior and have no edge with a chord of `limit` or more, with the square of the longest
/// chord of those that are not smooth. Ascending.
fn candidates(mesh: &Mesh, normals: &PerFace<DVec3>, labels: &Labels, limit: f64) -> Vec<(Vert, f64)> {
    let Labels { smooth_edge, interior_vertex, .. } = labels;
    let steepest = |v: Vert| {
        let leaving = mesh.leaving(v).iter();
        leaving.copied().try_fold(0.0, |most: f64, h| {
            // An edge that no half-edge leaves by is a border.
            let chord = match smooth_edge[h] {
                true => 0.0,
                false => chord_squared(mesh, normals, h).filter(|&chord| chord < limit)?,
            };
            (!mesh.is_border(h.prev())).then_some(most.max(chord))
        })
    };
    let candidate =
        |v: Vert| (!interior_vertex[v] && !mesh.leaving(v).is_empty()).then(|| steepest(v)).flatten();
    let verts = (0..mesh.n_verts()).into_par_iter().map(Vert::new);
    verts.filter_map(|v| Some((v, candidate(v)?))).collect()
}

/// Whether a quadric passes through `v` and the samples round it. `ring` is working space.
fn is_even(mesh: &Mesh, normals: &PerFace<DVec3>, v: Vert, ring: &mut Vec<Vert>) -> bool {
    collect_rings(v, RINGS, MAX_SAMPLES, |v| mesh.leaving(v).iter().map(|&h| mesh.to(h)), ring);
    let leaving = mesh.leaving(v);
    let up: DVec3 = leaving.iter().map(|h| normals[h.face()]).sum();
    let unit = leaving.iter().map(|&h| mesh.length(h)).sum::<f64>() / leaving.len() as f64;
    let Some(up) = up.try_normalize().filter(|_| ring.len() >= MIN_SAMPLES && unit > 0.0) else {
        return false;
    };
    let (t1, t2) = up.any_orthonormal_pair();
    let sample = |w: &Vert| {
        let offset = (mesh.point(*w) - mesh.point(v)) / unit;
        let (x, y) = (offset.dot(t1), offset.dot(t2));
        (SVector::from([1.0, x, y, x * x, x * y, y * y]), offset.dot(up))
    };
    let mut matrix = SMatrix::<f64, 6, 6>::identity() * (RIDGE * ring.len() as f64);
    let (mut right, mut squares) = (SVector::<f64, 6>::zeros(), 0.0);
    for (row, height) in ring.iter().map(sample) {
        matrix.ger(1.0, &row, &row, 1.0);
        right.axpy(height, &row, 1.0);
        squares += height * height;
    }
    let Some(factors) = matrix.cholesky() else { return false };
    // What the best quadric leaves is what it is at right angles to.
    let left = squares - factors.solve(&right).dot(&right);
    left <= EVEN_RMS * EVEN_RMS * ring.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::classify::{ClassifyOptions, SmoothThreshold, classify, classify_interior};
    use crate::mesh::tests::mesh;

    /// Columns of 5 vertices, 1 apart, that bend by `turn` degrees at each; and which of them are interior in the
    /// middle, by the papers and by what is here, with the papers' threshold and with what that is.
    fn interior(n: usize, turn: impl Fn(usize) -> f64) -> (f64, [Vec<usize>; 3]) {
        let (mut points, mut direction) = (Vec::new(), 0f64);
        let (mut x, mut z) = (0.0, 0.0);
        for c in 0..n {
            points.extend((0..5).map(|r| [x, f64::from(r), z]));
            direction += turn(c);
            let (sine, cosine) = direction.to_radians().sin_cos();
            (x, z) = (x + cosine, z - sine);
        }
        let squares = (0..n - 1).flat_map(|c| (0..4).map(move |r| 5 * c + r));
        let faces: Vec<_> = squares.flat_map(|v| [[v, v + 5, v + 6], [v, v + 6, v + 1]]).collect();
        let m = mesh(&points, &faces);
        let options = |threshold| ClassifyOptions { threshold, border_is_smooth: true, folds_count: true };
        let in_row_2 = |labels: &Labels| {
            (0..n).filter(|c| labels.interior_vertex[Vert::new(5 * c + 2)]).collect::<Vec<_>>()
        };
        let normals = m.face_normals();
        let by_papers = classify(&m, &normals, &options(SmoothThreshold::MeanTimes(2.0)));
        let found = classify_interior(&m, &normals, &options(SmoothThreshold::MeanTimes(2.0)));
        let asked = classify_interior(&m, &normals, &options(SmoothThreshold::Angle(by_papers.threshold)));
        (by_papers.threshold, [&by_papers, &found, &asked].map(in_row_2))
    }

    #[test]
    fn a_wall_that_bends_evenly_is_smooth_beside_a_large_flat_part() {
        // Flat up to column 30, then 6 degrees more at each, and 45 at column 40.
        let turn = |c: usize| match c {
            30..40 => 6.0,
            40 => 45.0,
            _ => 0.0,
        };
        let (threshold, [by_papers, found, asked]) = interior(45, turn);
        assert!(threshold < 2f64.to_radians());
        let flat: Vec<usize> = (0..30).chain(41..45).collect();
        assert_eq!(by_papers, flat);
        let all_but_beside_the_crease: Vec<usize> = (0..39).chain(41..45).collect();
        assert_eq!(found, all_but_beside_the_crease);
        assert_eq!(asked, flat, "a threshold that was asked for stays");
    }

    #[test]
    fn a_wall_that_bends_more_is_smooth_where_a_quadric_passes_through_it() {
        // A wall of 12 degrees between flat parts. At its ends one of the five columns round a vertex is off the quadric.
        let wall = |c: usize| if (60..75).contains(&c) { 12.0 } else { 0.0 };
        let (threshold, [by_papers, found, asked]) = interior(135, wall);
        assert!(threshold < 12f64.to_radians());
        let flat: Vec<usize> = (0..60).chain(75..135).collect();
        assert_eq!(by_papers, flat);
        let all: Vec<usize> = (0..135).collect();
        let ends = [60, 74];
        let without_ends: Vec<usize> = all.iter().copied().filter(|c| !ends.contains(c)).collect();
        assert_eq!(found, without_ends);
        assert_eq!(asked, flat);
        // As many degrees, but every other edge flat: facets two columns wide.
        let facets = |c: usize| if (60..75).contains(&c) && c.is_multiple_of(2) { 16.0 } else { 0.0 };
        let (threshold, [by_papers, found, _]) = interior(135, facets);
        assert!(threshold < 12f64.to_radians());
        assert_eq!(found, by_papers);
        // At 21 degrees a crease may be all that there is.
        let steep = |c: usize| if (60..75).contains(&c) { 21.0 } else { 0.0 };
        let (_, [by_papers, found, _]) = interior(260, steep);
        assert_eq!(found, by_papers);
    }
}
