//! What all steps read of the mesh, and which of its vertices are interior, deep or doubtful (steps 1
//! and 2).

use glam::DVec3;
use rayon::prelude::*;

use crate::classify::{Labels, core_faces, flood_over_smooth_edges};
use crate::mesh::{Face, Half, Mesh, PerFace, PerHalf, PerVert, Vert};

/// A smooth region with fewer interior vertices than this is none: on marching-cubes meshes they are
/// slanted chamfer vertices. Measured: 3 as good as 4; 1 (no minimum), 6 and 10 worse.
const MIN_REGION: usize = 4;

/// What all steps read: the mesh, and what steps 1 and 2 say about its vertices.
pub(super) struct Surface<'a> {
    pub mesh: &'a Mesh,
    pub face_normals: &'a PerFace<DVec3>,
    /// Mean edge length.
    pub h: f64,
    pub neighbours: Neighbours,
    pub interior: PerVert<bool>,
    pub deep: PerVert<bool>,
    pub red_face: PerFace<bool>,
    /// The angle of each half-edge's face at the corner that it leaves. `[3F]`
    pub angles: PerHalf<f64>,
    /// Unit normals at the vertices, of all faces there.
    pub normals: PerVert<DVec3>,
}

impl<'a> Surface<'a> {
    pub fn new(mesh: &'a Mesh, face_normals: &'a PerFace<DVec3>, labels: &Labels) -> Self {
        let neighbours = Neighbours::of(mesh);
        let interior = interior_of_large_regions(mesh, &neighbours, &labels.interior_vertex);
        let is_deep = |v: Vert| interior[v] && neighbours.of_vertex(v).iter().all(|&w| interior[w]);
        let deep = per_vertex(mesh, is_deep);
        let core = core_faces(mesh, &interior);
        let red_face = flood_over_smooth_edges(mesh, &labels.smooth_edge, core);
        let (h, angles) = (mean_edge_length(mesh), corner_angles(mesh));
        let normals = per_vertex(mesh, |v| vertex_normal(mesh, face_normals, &angles, v, |_| true));
        Self { mesh, face_normals, h, neighbours, interior, deep, red_face, angles, normals }
    }

    /// Vertices that are not interior, and the interior ones next to them, ascending. None where no region
    /// is smooth: then there is nothing to doubt by.
    pub fn doubtful(&self) -> Vec<Vert> {
        if !self.interior.as_slice().contains(&true) {
            return Vec::new();
        }
        let is_doubtful = |v: &Vert| !self.deep[*v] && !self.mesh.leaving(*v).is_empty();
        self.mesh.verts().filter(is_doubtful).collect()
    }

    /// Unit normal at `v` of the faces there that count.
    pub fn normal_of(&self, v: Vert, counts: impl Fn(Face) -> bool) -> DVec3 {
        vertex_normal(self.mesh, self.face_normals, &self.angles, v, counts)
    }
}

/// Unit normal at `v`: the normals of the faces there that count, each times its angle. Zero where no face
/// does.
fn vertex_normal(
    mesh: &Mesh,
    face_normals: &PerFace<DVec3>,
    angles: &PerHalf<f64>,
    v: Vert,
    counts: impl Fn(Face) -> bool,
) -> DVec3 {
    let faces = mesh.leaving(v).iter().filter(|h| counts(h.face()));
    let sum: DVec3 = faces.map(|&h| angles[h] * face_normals[h.face()]).sum();
    let length = sum.length();
    // Unit normals times angles: a sum of rounding errors only has no direction.
    if length > 1e-12 { sum / length } else { DVec3::ZERO }
}

/// Step 1: interior vertices, but for those in components of fewer than [`MIN_REGION`].
fn interior_of_large_regions(
    mesh: &Mesh,
    neighbours: &Neighbours,
    interior: &PerVert<bool>,
) -> PerVert<bool> {
    let is_in_large_region = |v: Vert| {
        let mut found = [v; MIN_REGION];
        let mut n_found = 1;
        let mut next = 0;
        while next < n_found && n_found < MIN_REGION {
            for &w in neighbours.of_vertex(found[next]).iter().filter(|&&w| interior[w]) {
                if n_found < MIN_REGION && !found[..n_found].contains(&w) {
                    found[n_found] = w;
                    n_found += 1;
                }
            }
            next += 1;
        }
        n_found == MIN_REGION
    };
    per_vertex(mesh, |v| interior[v] && is_in_large_region(v))
}

pub(super) fn per_vertex<T: Send>(mesh: &Mesh, value: impl Fn(Vert) -> T + Send + Sync) -> PerVert<T> {
    let verts = (0..mesh.n_verts()).into_par_iter().map(Vert::new);
    verts.map(value).collect::<Vec<_>>().into()
}

/// Faces per unit of parallel work. Sums are formed per chunk and added in order, so that they do not
/// depend on the number of threads.
const CHUNK: usize = 4096;

/// Mean length over all edges; 0 without edges.
fn mean_edge_length(mesh: &Mesh) -> f64 {
    let chunks: Vec<(f64, usize)> = mesh
        .faces()
        .par_chunks(CHUNK)
        .enumerate()
        .map(|(i, faces)| {
            let lowest = 3 * CHUNK * i;
            let halves = (lowest..lowest + 3 * faces.len()).map(Half::new);
            let edges = halves.filter(|&h| mesh.edge(h) == h);
            edges.fold((0.0, 0), |(sum, n), h| (sum + mesh.length(h), n + 1))
        })
        .collect();
    let (sum, n) = chunks.into_iter().fold((0.0, 0), |(s, n), (t, m)| (s + t, n + m));
    if n == 0 { 0.0 } else { sum / n as f64 }
}

/// The angle of each face at each of its corners, in radians; what a face without area has does not
/// matter. `[3F]`
fn corner_angles(mesh: &Mesh) -> PerHalf<f64> {
    let angles = |corners: &[Vert; 3]| {
        let [a, b, c] = corners.map(|v| mesh.point(v));
        let (ab, bc, ca) = (b - a, c - b, a - c);
        let twice_area = ab.cross(ca).length();
        let (at_a, at_b) = (twice_area.atan2(-ab.dot(ca)), twice_area.atan2(-ab.dot(bc)));
        [at_a, at_b, std::f64::consts::PI - at_a - at_b]
    };
    let nested: Vec<[f64; 3]> = mesh.faces().par_iter().map(angles).collect();
    nested.into_flattened().into()
}

/// The vertices that share an edge with each vertex, ascending, each once.
pub(super) struct Neighbours {
    starts: Vec<u32>,
    verts: Vec<Vert>,
}

impl Neighbours {
    fn of(mesh: &Mesh) -> Self {
        let mut starts = Vec::with_capacity(mesh.n_verts() + 1);
        let mut verts: Vec<Vert> = Vec::with_capacity(mesh.n_halves() + mesh.n_halves() / 16);
        starts.push(0);
        let mut round = Vec::new();
        for v in mesh.verts() {
            round.clear();
            for &h in mesh.leaving(v) {
                round.push(mesh.to(h));
                if mesh.is_border(h.prev()) {
                    round.push(mesh.from(h.prev()));
                }
            }
            round.sort_unstable();
            round.dedup();
            verts.extend(round.iter().filter(|&&w| w != v));
            starts.push(verts.len() as u32);
        }
        Self { starts, verts }
    }

    #[inline]
    pub fn of_vertex(&self, v: Vert) -> &[Vert] {
        &self.verts[self.starts[v.index()] as usize..self.starts[v.index() + 1] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tests::mesh;
    use crate::regions::tests::cut_cube;

    // 0---1---2   5---6     Two regions of interior vertices: three vertices are none, four are one.
    //  `-_|_-´     `-7|
    //     3         4-´
    #[test]
    fn regions_of_fewer_than_four_vertices_are_none() {
        let m = mesh(&[[0.0; 3]; 8], &[[0, 3, 1], [1, 3, 2], [4, 7, 6], [5, 6, 7]]);
        let mut interior = PerVert::filled(8, true);
        interior[Vert::new(4)] = false;
        let large = interior_of_large_regions(&m, &Neighbours::of(&m), &interior);
        assert_eq!(large.as_slice(), [true, true, true, true, false, false, false, false]);
    }

    // 3---2    Edge 0-2 has two faces, all others one.
    // | / |
    // 0---1
    #[test]
    fn neighbours_are_listed_once_across_borders_too() {
        let m = mesh(&[[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]], &[[0, 1, 2], [0, 2, 3]]);
        let neighbours = Neighbours::of(&m);
        let of = |v| neighbours.of_vertex(Vert::new(v)).iter().map(|w| w.index()).collect::<Vec<_>>();
        assert_eq!([of(0), of(1), of(2), of(3)], [vec![1, 2, 3], vec![0, 2], vec![0, 1, 3], vec![0, 2]]);
        assert_eq!(mean_edge_length(&m), (4.0 + 2f64.sqrt()) / 5.0);
    }

    #[test]
    fn corner_angles_are_those_of_the_corners() {
        let m = cut_cube(3);
        let angles = corner_angles(&m);
        for h in m.halves() {
            assert!((angles[h] - crate::place::corner_angle(&m, h)).abs() < 1e-14, "{h:?}");
        }
    }
}
