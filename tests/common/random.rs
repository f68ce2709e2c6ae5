//! Random meshes: samplings with creases, soups of triangles, and what becomes of them when faces go, turn,
//! double and vertices fall together.
#![allow(dead_code)] // Each test file uses some of it.

use std::fmt;

use glam::{DQuat, DVec3, dvec3};
use proptest::collection::vec;
use proptest::prelude::*;
use sharpen::classify::SmoothThreshold;
use sharpen::mesh::Vert;
use sharpen::{Mesh, Method, Options};

use crate::common::{chamfered_cube, sphere, wedge_nets, zoo};

/// A mesh that prints itself as the statements that make it.
#[derive(Clone)]
pub struct Shown(pub Mesh);

impl fmt::Debug for Shown {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let points: Vec<_> = self.0.points().iter().map(DVec3::to_array).collect();
        let faces: Vec<_> = self.0.faces().iter().map(|f| f.map(Vert::index)).collect();
        write!(f, "vec!{points:?}, &{faces:?}")
    }
}

/// A finite number of moderate size in steps of 2^-20, which sums keep exactly.
pub fn coordinate() -> impl Strategy<Value = f64> {
    (-4_000_000..4_000_000i32).prop_map(|i| f64::from(i) / 1_048_576.0)
}

fn point() -> impl Strategy<Value = DVec3> {
    [coordinate(), coordinate(), coordinate()].prop_map(DVec3::from)
}

pub fn rotation() -> impl Strategy<Value = DQuat> {
    (point(), 0.0..6.3).prop_map(|(axis, angle)| DQuat::from_axis_angle(axis.normalize_or(DVec3::X), angle))
}

/// A roof `z = -|x cos a + y sin a + d|·s` over an `n` × `n` grid: samples do not know of the crease.
fn roof() -> impl Strategy<Value = Mesh> {
    (4..12usize, 0.0..3.2, -0.5..0.5f64, 0.5..2.0f64).prop_map(|(n, angle, shift, slope)| {
        let height = |x: f64, y: f64| -slope * (x * f64::cos(angle) + y * f64::sin(angle) + shift).abs();
        let at = |i: usize| 2.0 * i as f64 / (n - 1) as f64 - 1.0;
        let grid = (0..n).flat_map(|i| (0..n).map(move |j| (i, j)));
        let points = grid.map(|(i, j)| dvec3(at(i), at(j), height(at(i), at(j)))).collect();
        let mut faces = Vec::new();
        for (i, j) in (0..n - 1).flat_map(|i| (0..n - 1).map(move |j| (i, j))) {
            let [a, b, c, d] = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| i * n + j);
            faces.extend([[a, b, c], [a, c, d]].map(|f| f.map(Vert::new)));
        }
        Mesh::new(points, faces).unwrap()
    })
}

/// Closed or open samplings of shapes, moved a little at random so that nothing is a tie.
pub fn sampling() -> impl Strategy<Value = Mesh> {
    let shape = prop_oneof![
        4 => (4..9usize, 0.7..0.95).prop_map(|(n, reach)| chamfered_cube(n, reach)),
        2 => roof(),
        1 => (2..4usize).prop_map(sphere),
    ];
    (shape, 1e-4..0.02f64, rotation(), any::<u64>()).prop_map(|(mesh, noise, rotation, seed)| {
        let (points, faces) = mesh.into_parts();
        let mut random = Numbers(seed);
        let jitter = |p: DVec3| rotation * (p + noise * random.direction());
        let exact = |p: DVec3| (p * 1_073_741_824.0).round() / 1_073_741_824.0;
        Mesh::new(points.into_iter().map(jitter).map(exact).collect(), faces).unwrap()
    })
}

/// A sampling with edges of four faces.
fn nets() -> impl Strategy<Value = Mesh> {
    (14..20usize, 0.6..1.1, rotation()).prop_map(|(n, angle, turn)| wedge_nets(n, angle, turn))
}

/// Triangles between random points, with all that can be wrong about them.
fn soup() -> impl Strategy<Value = Mesh> {
    (1..14usize).prop_flat_map(|n| {
        let faces = vec([0..n, 0..n, 0..n].prop_map(|f| f.map(Vert::new)), 0..40);
        (vec(point(), n), faces).prop_map(|(points, faces)| Mesh::new(points, faces).unwrap())
    })
}

fn zoo_animal() -> impl Strategy<Value = Mesh> {
    prop::sample::select(zoo().into_iter().map(|(_, mesh)| mesh).collect::<Vec<_>>())
}

/// What happens to a mesh between a sampling and a file.
#[derive(Clone, Debug)]
enum Damage {
    Remove(prop::sample::Index),
    Turn(prop::sample::Index),
    Double(prop::sample::Index),
    Add([prop::sample::Index; 3]),
    Merge([prop::sample::Index; 2]),
    Move([prop::sample::Index; 2]),
    Shift(prop::sample::Index, DVec3),
}

fn damage() -> impl Strategy<Value = Damage> {
    let index = any::<prop::sample::Index>;
    prop_oneof![
        3 => index().prop_map(Damage::Remove),
        1 => index().prop_map(Damage::Turn),
        1 => index().prop_map(Damage::Double),
        1 => [index(), index(), index()].prop_map(Damage::Add),
        1 => [index(), index()].prop_map(Damage::Merge),
        1 => [index(), index()].prop_map(Damage::Move),
        2 => (index(), point()).prop_map(|(i, p)| Damage::Shift(i, 0.05 * p)),
    ]
}

fn suffer(mesh: Mesh, damages: &[Damage]) -> Mesh {
    let (mut points, mut faces) = mesh.into_parts();
    for damage in damages {
        if points.is_empty() || faces.is_empty() {
            break;
        }
        let (n, n_faces) = (points.len(), faces.len());
        let vert = |i: &prop::sample::Index| Vert::new(i.index(n));
        match damage {
            Damage::Remove(i) => drop(faces.remove(i.index(n_faces))),
            Damage::Turn(i) => faces[i.index(n_faces)].swap(1, 2),
            Damage::Double(i) => faces.push(faces[i.index(n_faces)]),
            Damage::Add(corners) => faces.push([0, 1, 2].map(|k| vert(&corners[k]))),
            Damage::Merge([i, j]) => {
                let (i, j) = (vert(i), vert(j));
                faces.iter_mut().flatten().filter(|v| **v == i).for_each(|v| *v = j);
            }
            Damage::Move([i, j]) => points[i.index(n)] = points[j.index(n)],
            Damage::Shift(i, by) => points[i.index(n)] += *by,
        }
    }
    Mesh::new(points, faces).unwrap()
}

/// Any mesh at all.
pub fn any_mesh() -> impl Strategy<Value = Shown> {
    let whole = prop_oneof![4 => sampling(), 1 => nets()];
    let damaged = (whole, vec(damage(), 0..12)).prop_map(|(mesh, damages)| suffer(mesh, &damages));
    prop_oneof![4 => damaged, 2 => soup(), 1 => zoo_animal()].prop_map(Shown)
}

/// Any options that make sense for small meshes.
pub fn options() -> impl Strategy<Value = Options> {
    let method =
        prop_oneof![3 => Just(Method::Regions), 1 => Just(Method::Filters), 1 => Just(Method::Paper)];
    let smooth = prop_oneof![
        3 => Just(SmoothThreshold::MeanTimes(2.0)),
        1 => (0.0..4.0).prop_map(SmoothThreshold::MeanTimes),
        1 => (0.0..3.2).prop_map(SmoothThreshold::Angle),
    ];
    let levels = prop_oneof![5 => Just(0), 2 => Just(1), 1 => Just(2)];
    let max_shift = prop::option::weighted(0.2, 0.0..3.0);
    let max_round = prop_oneof![3 => Just(0.0), 1 => 0.0..4.0];
    (method, smooth, max_shift, max_round, levels, 0..3usize).prop_map(
        |(method, smooth, max_shift, max_round, bend, denoise)| {
            let denoise = denoise.saturating_sub(1);
            Options { method, smooth, max_shift, max_round, bend, denoise, ..Options::default() }
        },
    )
}

/// A generator of numbers that is enough for noise (splitmix64).
pub struct Numbers(pub u64);

impl Numbers {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// In [-1, 1).
    pub fn number(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    pub fn direction(&mut self) -> DVec3 {
        dvec3(self.number(), self.number(), self.number())
    }
}

/// A mesh with its points moved.
pub fn map(mesh: &Mesh, f: impl Fn(DVec3) -> DVec3) -> Mesh {
    Mesh::new(mesh.points().iter().copied().map(f).collect(), mesh.faces().to_vec()).unwrap()
}
