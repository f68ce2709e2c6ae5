//! Takes noise out of what is smooth, and leaves what is sharp alone.
//!
//! Based on: Sharpen&Bend section 5 and figure 17: Laplacian smoothing in which tagged vertices are held.
//! Differs: border vertices (and those of edges with other than two faces) are held as well, or a border
//! would shrink (Paper silent). A vertex goes half the way to the mean of its neighbours, not all of it:
//! the whole way lets neighbours change places for ever on a regular grid (Paper silent).
//! In/out: `Mesh` + `Tags` -> `Mesh`, the same vertices and faces; held vertices keep their bits.
//! Cost: O(F) a round, parallel per vertex; each round reads only what the round before left.

use glam::DVec3;
use rayon::prelude::*;

use crate::mesh::{Mesh, MeshError, PerVert, Vert};
use crate::tags::Tags;

/// How much of the way to the mean of its neighbours a vertex goes in a round.
const STEP: f64 = 0.5;

/// Smooths `mesh` by `rounds` rounds of Laplacian smoothing; tagged vertices and borders stay.
///
/// # Errors
/// None that a sound mesh could cause: those of [`Mesh::new`].
pub fn denoise(mesh: &Mesh, tags: &Tags, rounds: usize) -> Result<Mesh, MeshError> {
    let mut is_held = PerVert::filled(mesh.n_verts(), false);
    for h in mesh.halves().filter(|&h| mesh.is_border(h)) {
        is_held[mesh.from(h)] = true;
        is_held[mesh.to(h)] = true;
    }
    for &v in tags.tagged().iter().filter(|v| v.index() < mesh.n_verts()) {
        is_held[v] = true;
    }
    // Every neighbour of a free vertex is at the end of exactly one half-edge that leaves it.
    let free: Vec<Vert> = mesh.verts().filter(|&v| !is_held[v] && !mesh.leaving(v).is_empty()).collect();
    let mut points = mesh.points().to_vec();
    for _ in 0..rounds {
        let at = |v: Vert| points[v.index()];
        let smoothed = |&v: &Vert| {
            let leaving = mesh.leaving(v);
            let mean = leaving.iter().map(|&h| at(mesh.to(h))).sum::<DVec3>() / leaving.len() as f64;
            at(v).lerp(mean, STEP)
        };
        let smoothed: Vec<DVec3> = free.par_iter().map(smoothed).collect();
        for (v, point) in free.iter().zip(smoothed) {
            points[v.index()] = point;
        }
    }
    Mesh::new(points, mesh.faces().to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tests::mesh;
    use approx::assert_relative_eq;

    //   3---2      an apex 4 over a square, and a second square below it with an apex 5: an octahedron
    //   | 4 |      whose equator can be tagged
    //   0---1
    fn octahedron() -> Mesh {
        let points = [[0., 0., 0.], [2., 0., 0.], [2., 2., 0.], [0., 2., 0.], [1., 1., 3.], [5., 1., -3.]];
        let up = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]];
        let down = up.map(|[a, b, _]| [b, a, 5]);
        mesh(&points, &[up, down].concat())
    }

    #[test]
    fn tagged_vertices_are_held_and_the_others_go_half_the_way() {
        let m = octahedron();
        let tags = Tags::new([], (0..4).map(Vert::new));
        let smooth = denoise(&m, &tags, 1).unwrap();
        assert_eq!(smooth.points()[..4], m.points()[..4]);
        assert_eq!(smooth.faces(), m.faces());
        assert_eq!(smooth.points()[4..].to_vec(), [DVec3::new(1., 1., 1.5), DVec3::new(3., 1., -1.5)]);
        let twice = denoise(&m, &tags, 2).unwrap();
        assert_eq!(twice.points()[4].z, 0.75);
    }

    #[test]
    fn a_round_reads_only_the_round_before() {
        // Nothing is held: vertex 0 sees 1, 3, 4 and 5 where they were, not where they go.
        let m = octahedron();
        let smooth = denoise(&m, &Tags::default(), 1).unwrap();
        let p = m.points();
        let mean = (p[1] + p[3] + p[4] + p[5]) / 4.0;
        assert_relative_eq!(smooth.points()[0].distance(p[0].midpoint(mean)), 0.0, epsilon = 1e-15);
        assert_eq!(denoise(&m, &Tags::default(), 0).unwrap().points(), m.points());
    }

    #[test]
    fn borders_unused_vertices_and_knotted_edges_stay() {
        // A fan of three on 0-1, a square with its middle vertex 9 inside, and vertex 10 unused.
        let points: Vec<[f64; 3]> = (0..11).map(|i| [f64::from(i), f64::from(i * i % 7), 0.]).collect();
        let faces = [[0, 1, 2], [1, 0, 3], [0, 1, 4], [5, 6, 9], [6, 7, 9], [7, 8, 9], [8, 5, 9]];
        let m = mesh(&points, &faces);
        let smooth = denoise(&m, &Tags::default(), 3).unwrap();
        let moved: Vec<usize> = (0..11).filter(|&v| smooth.points()[v] != m.points()[v]).collect();
        assert_eq!(moved, [9]);
    }

    #[test]
    fn noise_on_a_plane_goes_and_the_plane_stays() {
        // A grid with a sawtooth: the highest frequency there is goes at once.
        let n = 8;
        let height = |i: usize, j: usize| if (i + j).is_multiple_of(2) { 0.1 } else { -0.1 };
        let points: Vec<[f64; 3]> =
            (0..n * n).map(|k| [(k / n) as f64, (k % n) as f64, height(k / n, k % n)]).collect();
        let squares = (0..(n - 1) * (n - 1)).map(|k| (k / (n - 1), k % (n - 1)));
        let faces: Vec<[usize; 3]> = squares
            .flat_map(|(i, j)| {
                let [a, b, c, d] = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| i * n + j);
                [[a, b, c], [a, c, d]]
            })
            .collect();
        let m = mesh(&points, &faces);
        let smooth = denoise(&m, &Tags::default(), 10).unwrap();
        let middle = smooth.points()[3 * n + 3];
        assert!(middle.z.abs() < 0.01, "{middle}");
        assert!((middle.x - 3.0).abs() < 1e-12 && (middle.y - 3.0).abs() < 1e-12, "{middle}");
    }
}
