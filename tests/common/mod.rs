//! Meshes that tests share, all from closed forms.
#![allow(dead_code)] // Each test file uses some of them.

use std::collections::BTreeMap;

use glam::{DQuat, DVec2, DVec3, dvec2, dvec3};
use sharpen::Mesh;
use sharpen::mesh::Vert;

/// A mesh from plain numbers.
pub fn mesh(points: Vec<DVec3>, faces: &[[usize; 3]]) -> Mesh {
    let mesh = Mesh::new(points, faces.iter().map(|f| f.map(Vert::new)).collect()).unwrap();
    mesh.check().unwrap();
    mesh
}

/// The cube `[-1, 1]³` with its edges and corners cut off, as a sampling would: `n` × `n` samples on each
/// side, the outermost `1 - reach` away from the edges; a strip of triangles along each edge, one
/// triangle at each corner.
pub fn chamfered_cube(n: usize, reach: f64) -> Mesh {
    let (mut points, mut faces) = (Vec::new(), Vec::new());
    let coordinate = |i: usize| reach * (2.0 * i as f64 / (n - 1) as f64 - 1.0);
    // Side 2a + s: axis a at -1 (s = 0) or 1 (s = 1); i runs along axis a + 1, j along axis a + 2.
    let index = |side: usize, i: usize, j: usize| (side * n + i) * n + j;
    for side in 0..6 {
        let axis = side / 2;
        for i in 0..n {
            for j in 0..n {
                let mut p = [0.0; 3];
                p[axis] = if side % 2 == 0 { -1.0 } else { 1.0 };
                p[(axis + 1) % 3] = coordinate(i);
                p[(axis + 2) % 3] = coordinate(j);
                points.push(DVec3::from(p));
            }
        }
        for (i, j) in (0..n - 1).flat_map(|i| (0..n - 1).map(move |j| (i, j))) {
            let [a, b, c, d] =
                [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| index(side, i, j));
            faces.extend([[a, b, c], [a, c, d]]);
        }
    }
    let last = |s: usize| if s == 0 { 0 } else { n - 1 };
    for axis in 0..3 {
        for (s, t) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            // The edge where axis a is at s and axis a + 1 at t, along axis a + 2.
            let (next, along) = ((axis + 1) % 3, 0..n);
            let first = |k: usize| index(2 * axis + s, last(t), k);
            let second = |k: usize| index(2 * next + t, k, last(s));
            for k in along.take(n - 1) {
                faces.extend([[first(k), first(k + 1), second(k)], [first(k + 1), second(k + 1), second(k)]]);
            }
        }
    }
    for corner in 0..8 {
        let s = [0, 1, 2].map(|axis| (corner >> axis) & 1);
        faces.push([0, 1, 2].map(|a| index(2 * a + s[a], last(s[(a + 1) % 3]), last(s[(a + 2) % 3]))));
    }
    orient_outwards(&points, &mut faces);
    mesh(points, &faces)
}

/// Turns each face of a body that is star-shaped about the origin so that its normal points outwards.
fn orient_outwards(points: &[DVec3], faces: &mut [[usize; 3]]) {
    for f in faces {
        let [a, b, c] = f.map(|v| points[v]);
        if (b - a).cross(c - a).dot(a + b + c) < 0.0 {
            f.swap(1, 2);
        }
    }
}

/// A unit sphere: an octahedron whose faces are split `levels` times into four.
pub fn sphere(levels: usize) -> Mesh {
    let mut points = vec![DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z];
    let mut faces = Vec::new();
    for (x, y, z) in (0..8).map(|i| (i & 1, 2 + (i >> 1 & 1), 4 + (i >> 2))) {
        faces.push([x, y, z]);
    }
    orient_outwards(&points, &mut faces);
    for _ in 0..levels {
        let mut middles = BTreeMap::new();
        let mut middle = |a: usize, b: usize| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                points.push((points[a] + points[b]).normalize());
                points.len() - 1
            })
        };
        let split = |[a, b, c]: [usize; 3]| {
            let (x, y, z) = (middle(a, b), middle(b, c), middle(c, a));
            [[a, x, z], [b, y, x], [c, z, y], [x, y, z]]
        };
        faces = faces.into_iter().flat_map(split).collect();
    }
    mesh(points, &faces)
}

/// Surface nets of the solid where `field` is negative, within a grid of `n` cells each way over `[-1, 1]³`: each cell
/// that the surface crosses has one vertex, in the mean of the crossings, even where two sheets cross it.
pub fn surface_nets(n: usize, field: impl Fn(DVec3) -> f64) -> Mesh {
    let place = |at: [usize; 3]| DVec3::from(at.map(|i| 2.0 * i as f64 / n as f64 - 1.0));
    let grid = || (0..n).flat_map(|x| (0..n).flat_map(move |y| (0..n).map(move |z| [x, y, z])));
    let mut crossings: BTreeMap<[usize; 3], Vec<DVec3>> = BTreeMap::new();
    let mut quads = Vec::new();
    for (low, axis) in grid().flat_map(|low| [0, 1, 2].map(|axis| (low, axis))) {
        let moved = |by: [usize; 3], to: usize| [0, 1, 2].map(|k| low[k] + to * by[k]);
        let unit = |k: usize| [0, 1, 2].map(|l| usize::from(k % 3 == l));
        let (p, q) = (place(low), place(moved(unit(axis), 1)));
        let (f, g) = (field(p), field(q));
        if (f < 0.0) == (g < 0.0) {
            continue;
        }
        // The four cells round the edge, counter-clockwise as seen from its high end.
        let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut cells = [[1, 1], [0, 1], [0, 0], [1, 0]].map(|[i, j]| {
            let mut cell = low;
            (cell[b], cell[c]) = (cell[b] - i, cell[c] - j);
            cell
        });
        cells.iter().for_each(|&cell| crossings.entry(cell).or_default().push(p.lerp(q, f / (f - g))));
        if f >= 0.0 {
            cells.reverse();
        }
        quads.push(cells);
    }
    let cells: Vec<_> = crossings.keys().copied().collect();
    let points = crossings.values().map(|of| of.iter().sum::<DVec3>() / of.len() as f64).collect();
    let number = |cell: &[usize; 3]| cells.binary_search(cell).unwrap();
    let corners = quads.iter().map(|quad| [0, 1, 2, 3].map(|i| number(&quad[i])));
    let faces: Vec<_> = corners.flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    mesh(points, &faces)
}

/// Surface nets of a turned wedge of so many radians: some of the edges on its edge have four faces.
pub fn wedge_nets(n: usize, angle: f64, turn: DQuat) -> Mesh {
    let side = DVec2::from_angle(angle / 2.0);
    surface_nets(n, |p| {
        let p = turn * (1.3 * p);
        let sides = side.dot(dvec2(p.x.abs(), p.y)) - 0.7 * side.y;
        sides.max(p.z.abs() - 0.7).max(-p.y - 0.5)
    })
}

/// Meshes that break careless passes, each with its name.
pub fn zoo() -> Vec<(&'static str, Mesh)> {
    let p = |n: usize| -> Vec<DVec3> {
        (0..n).map(|i| dvec3((i as f64).cos(), (2.0 * i as f64).sin(), i as f64 / 3.0)).collect()
    };
    let strip = |n: usize| -> Vec<[usize; 3]> {
        (0..n).map(|i| if i % 2 == 0 { [i, i + 1, i + 2] } else { [i + 1, i, i + 2] }).collect()
    };
    vec![
        ("empty", mesh(vec![], &[])),
        ("vertices only", mesh(p(4), &[])),
        ("one triangle", mesh(p(3), &[[0, 1, 2]])),
        ("unused vertices", mesh(p(9), &[[2, 5, 7], [7, 5, 8]])),
        ("three faces on one edge", mesh(p(5), &[[0, 1, 2], [1, 0, 3], [0, 1, 4]])),
        ("bow-tie", mesh(p(5), &[[0, 1, 2], [0, 3, 4]])),
        ("two closed fans in a point", {
            mesh(p(7), &[[0, 1, 2], [0, 2, 3], [0, 3, 1], [0, 4, 5], [0, 5, 6], [0, 6, 4]])
        }),
        ("Moebius strip", mesh(p(5), &[[0, 1, 2], [2, 1, 3], [2, 3, 4], [4, 3, 0], [4, 0, 1]])),
        ("doubled face", mesh(p(4), &[[0, 1, 2], [0, 1, 2], [2, 1, 3]])),
        ("face and its reverse", mesh(p(3), &[[0, 1, 2], [2, 1, 0]])),
        ("a vertex twice in a face", mesh(p(4), &[[0, 1, 1], [0, 1, 2], [1, 0, 3]])),
        ("all corners in one vertex", mesh(p(1), &[[0, 0, 0]])),
        ("zero area", mesh(vec![DVec3::ZERO, DVec3::X, 2.0 * DVec3::X, DVec3::Y], &[[0, 1, 2], [1, 0, 3]])),
        ("all points equal", mesh(vec![DVec3::ONE; 6], &strip(4))),
        ("open strip", mesh(p(12), &strip(10))),
        ("tiny", mesh(p(12).into_iter().map(|p| 1e-200 * p).collect(), &strip(10))),
        ("huge", mesh(p(12).into_iter().map(|p| 1e200 * p).collect(), &strip(10))),
        ("tetrahedron", mesh(p(4), &[[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])),
        ("chamfered cube with a hole", {
            let (points, mut faces) = chamfered_cube(6, 0.8).into_parts();
            faces.remove(faces.len() - 1);
            faces.remove(100);
            Mesh::new(points, faces).unwrap()
        }),
        ("chamfered cube with a face turned over", {
            let (points, mut faces) = chamfered_cube(6, 0.8).into_parts();
            for i in [7, 300, 310] {
                faces[i].swap(0, 1);
            }
            Mesh::new(points, faces).unwrap()
        }),
    ]
}
