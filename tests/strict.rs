//! The strict algorithm against the reference colours and positions, element by element. The reference
//! lies outside the project: where it is missing the test says so and passes.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use glam::DVec3;
use serde_json::Value;
use sharpen::classify::{ClassifyOptions, SmoothThreshold, classify};
use sharpen::mesh::{Half, Mesh, PerElement, PerHalf, Vert};
use sharpen::place::{Outcome, PlaceRules, place};

fn shared(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data").join(path)
}

fn load(path: &Path) -> Mesh {
    let model = sharpen::io::read(path).unwrap();
    Mesh::new(model.points, model.faces).unwrap()
}

fn flagged<I>(flags: &PerElement<I, bool>) -> BTreeSet<usize> {
    (0..flags.len()).filter(|&i| flags.as_slice()[i]).collect()
}

fn edge(mesh: &Mesh, h: Half) -> (usize, usize) {
    let (a, b) = (mesh.from(h).index(), mesh.to(h).index());
    (a.min(b), a.max(b))
}

fn flagged_edges(mesh: &Mesh, flags: &PerHalf<bool>) -> BTreeSet<(usize, usize)> {
    mesh.edges().filter(|&h| flags[h]).map(|h| edge(mesh, h)).collect()
}

fn numbers(value: &Value) -> BTreeSet<usize> {
    value.as_array().unwrap().iter().map(|n| n.as_u64().unwrap() as usize).collect()
}

fn pairs(value: &Value) -> BTreeSet<(usize, usize)> {
    let pair = |v: &Value| (v[0].as_u64().unwrap() as usize, v[1].as_u64().unwrap() as usize);
    value.as_array().unwrap().iter().map(pair).collect()
}

fn outcome(name: &Value) -> Outcome {
    match name.as_str().unwrap() {
        "moved" => Outcome::Moved,
        "nonormal" => Outcome::NoNormal,
        "mixed" => Outcome::Mixed,
        "parallel" => Outcome::Parallel,
        "long" => Outcome::TooFar,
        other => panic!("unknown outcome {other}"),
    }
}

fn point(row: &Value, at: usize) -> DVec3 {
    DVec3::from([0, 1, 2].map(|i| row[at + i].as_f64().unwrap()))
}

fn compare(name: &str) {
    let (reference, input) = (shared(&format!("classes/{name}.json")), shared(&format!("inputs/{name}.obj")));
    if !reference.exists() {
        eprintln!("{name}: no reference at {}, nothing compared", reference.display());
        return;
    }
    let reference: Value = serde_json::from_slice(&std::fs::read(reference).unwrap()).unwrap();
    let mesh = load(&input);
    let normals = mesh.face_normals();
    let options = ClassifyOptions {
        threshold: SmoothThreshold::MeanTimes(2.0),
        border_is_smooth: false,
        folds_count: true,
    };
    let labels = classify(&mesh, &normals, &options);
    let threshold = reference["threshold"].as_f64().unwrap();
    assert!((labels.threshold - threshold).abs() < 1e-12, "{} {threshold}", labels.threshold);
    assert_eq!(flagged_edges(&mesh, &labels.smooth_edge), pairs(&reference["brown"]), "brown");
    assert_eq!(flagged(&labels.interior_vertex), numbers(&reference["red_v1"]), "filter 1");
    assert_eq!(flagged(&labels.core_face), numbers(&reference["red_f2"]), "filter 2");
    assert_eq!(flagged(&labels.red_face), numbers(&reference["red_f3"]), "filter 3");
    assert_eq!(flagged(&labels.tagged_vertex), numbers(&reference["tag_v"]), "filter 3bis");
    assert_eq!(flagged(&labels.red_vertex), numbers(&reference["red_v"]), "filter 4, vertices");
    assert_eq!(flagged_edges(&mesh, &labels.red_edge), pairs(&reference["red_e"]), "filter 4, edges");
    assert_eq!(flagged_edges(&mesh, &labels.chamfer_edge), pairs(&reference["blue"]), "filter 5");
    let green: BTreeSet<usize> = labels.corner_faces.iter().map(|f| f.index()).collect();
    assert_eq!(green, numbers(&reference["green"]), "filter 6");

    let placement = place(&mesh, &normals, &labels, &PlaceRules::STRICT);
    let tolerance = 1e-9 * mesh.diagonal();
    let check = |v: Vert, row: &Value, at: usize| {
        let i = v.index() - mesh.n_verts();
        assert_eq!(placement.outcomes[i], outcome(&row[at]), "{row}");
        let distance = placement.inserts.points[i].distance(point(row, at + 1));
        assert!(distance <= tolerance, "{row} is {distance} away");
    };
    for row in reference["edge_points"].as_array().unwrap() {
        let [a, b] = [0, 1].map(|i| Vert::new(row[i].as_u64().unwrap() as usize));
        let h = mesh.half_between(a, b).unwrap();
        check(placement.inserts.on_edge[h], row, 2);
    }
    for row in reference["corner_points"].as_array().unwrap() {
        let f = sharpen::mesh::Face::new(row[0].as_u64().unwrap() as usize);
        check(placement.inserts.centre(f).unwrap(), row, 1);
    }
}

#[test]
fn cube_by_marching_intersections_is_coloured_and_placed_as_the_reference() {
    compare("cube__mi_8k");
}

#[test]
fn pyramid_by_marching_intersections_is_coloured_and_placed_as_the_reference() {
    compare("pyramid__mi_8k");
}

#[test]
fn remeshed_cylinder_is_coloured_and_placed_as_the_reference() {
    compare("cylinder__remesh_2k");
}

#[test]
fn remeshed_fandisk_is_coloured_and_placed_as_the_reference() {
    compare("fandisk__remesh_5k");
}
