//! Time of each stage and of the whole filter, on chamfered cubes in file order and shuffled.
//!
//! `cargo bench` runs all; `cargo bench -- classify/100k` one. Compare figures of one run only.

#[path = "../tests/common/mod.rs"]
mod common;

use std::hint::black_box;

use criterion::{BatchSize, BenchmarkId, Criterion, criterion_group, criterion_main};
use sharpen::attributes::Attributes;
use sharpen::classify::{ClassifyOptions, SmoothThreshold, classify};
use sharpen::io;
use sharpen::mesh::Vert;
use sharpen::place::{PlaceRules, place};
use sharpen::refine::refine;
use sharpen::{Mesh, Method, Options, sharpen};

/// Samples along a side of the cube, and about how many faces that makes.
const SIZES: [(usize, &str); 2] = [(92, "100k"), (290, "1M")];

/// The cubes, each in file order and with vertices and faces shuffled.
fn meshes() -> Vec<(String, Mesh)> {
    let mut meshes = Vec::new();
    for (n, name) in SIZES {
        let cube = common::chamfered_cube(n, 1.0 - 1.0 / n as f64);
        let shuffled = shuffled(&cube);
        meshes.extend([(name.to_owned(), cube), (format!("{name}-shuffled"), shuffled)]);
    }
    meshes
}

/// The mesh with vertices and faces in another order, always the same one.
fn shuffled(mesh: &Mesh) -> Mesh {
    let mut state = 1u64;
    let mut order = |n: usize| {
        let mut order: Vec<usize> = (0..n).collect();
        for i in (1..n).rev() {
            // Knuth's 64-bit linear congruential generator.
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            order.swap(i, (state >> 33) as usize % (i + 1));
        }
        order
    };
    let (vertices, faces) = (order(mesh.n_verts()), order(mesh.n_faces()));
    let mut now = vec![0; mesh.n_verts()];
    vertices.iter().enumerate().for_each(|(new, &old)| now[old] = new);
    let points = vertices.iter().map(|&v| mesh.points()[v]).collect();
    let corners = |&f: &usize| mesh.faces()[f].map(|v| Vert::new(now[v.index()]));
    Mesh::new(points, faces.iter().map(corners).collect()).unwrap()
}

fn stages(criterion: &mut Criterion) {
    let attributes = Attributes::default();
    for (name, mesh) in meshes() {
        let parts = || (mesh.points().to_vec(), mesh.faces().to_vec());
        let normals = mesh.face_normals();
        let options = ClassifyOptions {
            threshold: SmoothThreshold::MeanTimes(2.0),
            border_is_smooth: true,
            folds_count: true,
        };
        let labels = classify(&mesh, &normals, &options);
        let placement = place(&mesh, &normals, &labels, &PlaceRules::MEASURED);
        let text =
            io::format(io::View { points: mesh.points(), faces: mesh.faces(), attributes: &attributes });

        let mut group = criterion.benchmark_group("stage");
        group.sample_size(10);
        let mut stage = |stage: &str, run: &mut dyn FnMut()| {
            group.bench_function(BenchmarkId::new(stage, &name), |b| b.iter(&mut *run));
        };
        stage("parse", &mut || drop(black_box(io::parse(&text, "bench"))));
        stage("format", &mut || {
            let view = io::View { points: mesh.points(), faces: mesh.faces(), attributes: &attributes };
            drop(black_box(io::format(view)));
        });
        stage("normals", &mut || drop(black_box(mesh.face_normals())));
        stage("classify", &mut || drop(black_box(classify(&mesh, &normals, &options))));
        stage("place", &mut || drop(black_box(place(&mesh, &normals, &labels, &PlaceRules::MEASURED))));
        stage("refine", &mut || drop(black_box(refine(&mesh, &placement.inserts))));
        group.bench_function(BenchmarkId::new("twins", &name), |b| {
            b.iter_batched(parts, |(points, faces)| Mesh::new(points, faces), BatchSize::LargeInput);
        });
        group.finish();
    }
}

fn whole_filter(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("filter");
    group.sample_size(10);
    for (name, mesh) in meshes() {
        for (method, flag) in [(Options::default().method, "default"), (Method::Paper, "paper")] {
            for threads in [1, 2] {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                let options = Options { method, ..Options::default() };
                let id = BenchmarkId::new(format!("{flag}-{threads}-threads"), &name);
                group.bench_function(id, |b| {
                    b.iter(|| pool.install(|| black_box(sharpen(&mesh, &options)).unwrap().mesh.n_faces()));
                });
            }
        }
    }
    group.finish();
}

criterion_group!(benches, stages, whole_filter);
criterion_main!(benches);
