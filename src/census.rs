//! Counts what is irregular about a mesh as a whole, for the report. Nothing of it is repaired.
//!
//! In/out: a mesh -> its [`Census`].
//! Cost: O(F log k), k the largest number of faces at one vertex.

use rayon::prelude::*;
use serde::Serialize;

use crate::geometry::unit_normal;
use crate::mesh::{Half, Mesh, Vert};

/// What is irregular about a mesh beyond its edges.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Census {
    /// Parts that share no vertex with another.
    pub components: usize,
    /// Vertices that no face names.
    pub isolated_vertices: usize,
    /// Faces between three vertices that have no area.
    pub zero_area_faces: usize,
    /// Faces with the same three corners as a face before, turned over or not.
    pub doubled_faces: usize,
}

impl Census {
    /// Counts what `mesh` has of it.
    #[must_use]
    pub fn of(mesh: &Mesh) -> Self {
        let has_no_area = |&&[a, b, c]: &&[Vert; 3]| {
            a != b && b != c && c != a && unit_normal([a, b, c].map(|v| mesh.point(v))).is_none()
        };
        Self {
            components: components(mesh),
            isolated_vertices: mesh.verts().filter(|&v| mesh.leaving(v).is_empty()).count(),
            zero_area_faces: mesh.faces().par_iter().filter(has_no_area).count(),
            doubled_faces: (0..mesh.n_verts()).into_par_iter().map(|v| doubled_at(mesh, Vert::new(v))).sum(),
        }
    }
}

/// The number of sets of faces that hang together, by union-find.
fn components(mesh: &Mesh) -> usize {
    fn root(parents: &mut [u32], mut i: u32) -> u32 {
        while parents[i as usize] != i {
            parents[i as usize] = parents[parents[i as usize] as usize];
            i = parents[i as usize];
        }
        i
    }
    let mut parents: Vec<u32> = (0..mesh.n_verts() as u32).collect();
    for face in mesh.faces() {
        let [a, b, c] = face.map(|v| root(&mut parents, v.index() as u32));
        let first = a.min(b).min(c);
        [a, b, c].into_iter().for_each(|v| parents[v as usize] = first);
    }
    let is_root = |v: &Vert| parents[v.index()] as usize == v.index() && !mesh.leaving(*v).is_empty();
    mesh.verts().filter(is_root).count()
}

/// Of the faces whose lowest corner is `v`, how many are like one before.
fn doubled_at(mesh: &Mesh, v: Vert) -> usize {
    let others = |&h: &Half| {
        let (to, from) = (mesh.to(h), mesh.to(h.next()));
        (v < to && v < from).then_some([to.min(from), to.max(from)])
    };
    let mut faces: Vec<[Vert; 2]> = mesh.leaving(v).iter().filter_map(others).collect();
    let n = faces.len();
    faces.sort_unstable();
    faces.dedup();
    n - faces.len()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DVec3, dvec3};

    fn census(n: usize, faces: &[[usize; 3]]) -> Census {
        let mut points: Vec<DVec3> = (0..n).map(|i| dvec3(i as f64, (i * i) as f64, 0.0)).collect();
        // The last one is in the middle of the first two.
        points[n - 1] = points[0].midpoint(points[1]);
        Census::of(&Mesh::new(points, faces.iter().map(|f| f.map(Vert::new)).collect()).unwrap())
    }

    #[test]
    fn each_irregularity_is_counted_once() {
        let none = Census { components: 1, ..Census::default() };
        assert_eq!(census(4, &[[0, 1, 2], [2, 1, 3]]), none);
        assert_eq!(census(5, &[[0, 1, 2], [2, 1, 3]]), Census { isolated_vertices: 1, ..none });
        assert_eq!(census(4, &[[0, 3, 1], [2, 1, 3]]), Census { zero_area_faces: 1, ..none });
        assert_eq!(census(3, &[[0, 1, 2], [2, 1, 0], [1, 2, 0]]).doubled_faces, 2);
        assert_eq!(census(6, &[[0, 1, 2], [2, 1, 0], [3, 4, 5]]).components, 2);
        // A bow-tie hangs together; so does what a later face joins.
        assert_eq!(census(6, &[[1, 2, 0], [0, 3, 4]]), Census { isolated_vertices: 1, ..none });
        assert_eq!(census(8, &[[0, 1, 2], [4, 5, 6], [6, 3, 2]]), Census { isolated_vertices: 1, ..none });
        // A face that names a vertex twice is counted as such elsewhere.
        assert_eq!(census(3, &[[0, 1, 1], [0, 0, 0], [0, 1, 2]]).zero_area_faces, 1);
        assert_eq!(census(3, &[[0, 1, 1], [0, 0, 0]]).zero_area_faces, 0);
        assert_eq!(census(2, &[]), Census { isolated_vertices: 2, ..Census::default() });
    }
}
