use super::*;
use crate::classify::{ClassifyOptions, SmoothThreshold, classify};
use crate::mesh::tests::mesh;
use crate::place::{Outcome, Placement};
use glam::dvec3;

pub(super) fn labels(mesh: &Mesh) -> (PerFace<DVec3>, Labels) {
    let options = ClassifyOptions {
        threshold: SmoothThreshold::MeanTimes(2.0),
        border_is_smooth: true,
        folds_count: true,
    };
    let normals = mesh.face_normals();
    let labels = classify(mesh, &normals, &options);
    (normals, labels)
}

/// Fits that are planes through their vertices: vertex, normal, how far the vertex is off, source.
pub(super) fn planes(mesh: &Mesh, list: &[(usize, DVec3, f64, FitSource)]) -> VertexFits {
    let fit = |&(v, normal, displacement, source): &(usize, DVec3, f64, FitSource)| {
        let v = Vert::new(v);
        let plane = Fit::plane(mesh.point(v), normal, source);
        let coefficients = [displacement, 0.0, 0.0, 0.0, 0.0, 0.0];
        (v, Fit { displacement, coefficients, n_members: 10, ..plane })
    };
    VertexFits::of(mesh.n_verts(), list.iter().map(fit))
}

fn run(mesh: &Mesh) -> (RegionLabels, Placement) {
    let (normals, labels) = labels(mesh);
    let labels = label_by_fits(mesh, &normals, &labels, 0.0);
    let placement = place_by_fits(mesh, &labels, None);
    (labels, placement)
}

/// The cube [0, n]³ as a feature-insensitive sampling has it: one sample in the middle of each unit
/// square of its sides, a triangle at each corner, and a chamfer strip along each edge.
///
/// ```text
///    .---.---.          o  samples
///    | o-|-o-|.         Faces of the mesh stand for the lattice points: a quadrilateral, cut in
///    .-|-.-|-. `o       two, where four squares meet, a triangle at the corners of the cube.
///    | o-|-o-|--|.
///    .---.---.  o
/// ```
pub(super) fn cut_cube(n: usize) -> Mesh {
    let n = n as i64;
    let mut points: Vec<[f64; 3]> = Vec::new();
    let mut round: std::collections::BTreeMap<[i64; 3], Vec<usize>> = Default::default();
    for side in 0..6 {
        let (axis, u, v) = (side % 3, (side + 1) % 3, (side + 2) % 3);
        let level = if side < 3 { 0 } else { n };
        for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
            let mut sample = [level as f64; 3];
            (sample[u], sample[v]) = (i as f64 + 0.5, j as f64 + 0.5);
            for (di, dj) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let mut corner = [level; 3];
                (corner[u], corner[v]) = (i + di, j + dj);
                round.entry(corner).or_default().push(points.len());
            }
            assert!(axis != u && axis != v);
            points.push(sample);
        }
    }
    let centre = DVec3::splat(n as f64 / 2.0);
    let mut faces = Vec::new();
    for (corner, mut samples) in round {
        let corner = DVec3::from(corner.map(|c| c as f64));
        let outward = (corner - centre).normalize();
        let across = outward.any_orthonormal_vector();
        let turn = |&s: &usize| {
            let offset = DVec3::from(points[s]) - corner;
            offset.dot(outward.cross(across)).atan2(offset.dot(across))
        };
        samples.sort_by(|a, b| turn(a).total_cmp(&turn(b)));
        faces.extend((2..samples.len()).map(|i| [samples[0], samples[i - 1], samples[i]]));
    }
    mesh(&points, &faces)
}

/// How many coordinates of `p` are those of the cube's sides: 1 on a side, 2 on an edge, 3 in a corner.
fn n_sides(p: DVec3, n: usize) -> usize {
    let is_side = |c: &f64| c.abs() < 1e-9 || (c - n as f64).abs() < 1e-9;
    p.to_array().iter().filter(|c| is_side(c)).count()
}

#[test]
fn the_edges_and_corners_of_a_sampled_cube_come_back() {
    let n = 8;
    let m = cut_cube(n);
    let (labels, placement) = run(&m);
    // Each chamfer has n rungs and n - 1 diagonals; each corner triangle adds none of its own.
    assert_eq!(placement.inserts.points.len(), 12 * (2 * n - 1) + 8);
    assert_eq!(labels.corner_faces.len(), 8);
    assert!(placement.outcomes.iter().all(|&outcome| outcome == Outcome::Moved));
    let (on_edges, in_corners) = placement.inserts.points.split_at(12 * (2 * n - 1));
    assert!(on_edges.iter().all(|&p| n_sides(p, n) == 2));
    assert!(in_corners.iter().all(|&p| n_sides(p, n) == 3));
    assert_eq!(placement.inserts.moved, []);
    // Twelve strips that meet in the corner triangles: one component.
    assert_eq!(labels.strips.len(), 1);
    assert_eq!((labels.strips[0].n_edges, labels.strips[0].fate), (12 * (2 * n - 1), Fate::Kept));
}

#[test]
fn samples_off_the_surface_are_moved_back_onto_it() {
    // Marching cubes puts the samples beside an edge inside it: here by 0.08 on every other rung.
    let n = 8;
    let (mut points, faces) = cut_cube(n).into_parts();
    let beside = |c: f64| c == 0.5 || c == n as f64 - 0.5;
    for (i, p) in points.iter_mut().enumerate().filter(|(i, _)| i % 2 == 0) {
        if p.to_array().iter().any(|&c| beside(c)) {
            let inward = DVec3::from(p.to_array().map(|c| f64::from(c == 0.0) - f64::from(c == n as f64)));
            *p += 0.08 * inward;
            assert!(inward.length() == 1.0, "sample {i} lies on one side");
        }
    }
    let m = Mesh::new(points, faces).unwrap();
    let (labels, placement) = run(&m);
    assert!(labels.off_surface.is_likely(), "{:?} {:?}", labels.off_surface, labels.strips);
    assert_eq!(placement.inserts.moved, labels.moved);
    // Half of the samples in the outermost rows of the six sides.
    assert_eq!(labels.moved.len(), 6 * (8 * 8 - 6 * 6) / 2);
    let distance =
        |p: DVec3| p.to_array().into_iter().map(|c| c.abs().min((c - 8.0).abs())).fold(1.0, f64::min);
    for &(v, p) in &labels.moved {
        assert!(!labels.deep_vertex[v] && distance(m.point(v)) > 0.07, "{v:?} was on the surface");
        assert!(distance(p) < 0.02, "{v:?} is still {} off", distance(p));
    }
}

#[test]
fn a_sphere_has_no_chamfer() {
    let (mut points, faces) = cut_cube(10).into_parts();
    for (i, p) in points.iter_mut().enumerate() {
        // Uneven samples, so that some of them are doubtful.
        let aside = 0.3 * dvec3((i as f64).sin(), (2.0 * i as f64).sin(), (3.0 * i as f64).sin());
        *p = (*p + aside - DVec3::splat(5.0)).normalize();
    }
    let m = Mesh::new(points, faces).unwrap();
    let (labels, placement) = run(&m);
    assert!(labels.fits.iter().count() > 0, "nothing was doubtful");
    assert!(labels.candidates.is_empty() && placement.inserts.is_empty());
}

#[test]
fn creases_reach_the_border_of_an_open_sheet() {
    // Half of a cube: four strips end in borders.
    let (points, mut faces) = cut_cube(8).into_parts();
    faces.retain(|f| f.iter().all(|&v| points[v.index()].z < 4.0));
    let m = Mesh::new(points, faces).unwrap();
    let (labels, placement) = run(&m);
    assert_eq!(labels.corner_faces.len(), 4);
    let at_border: Vec<Half> = labels.chamfers.iter().copied().filter(|&h| m.is_border(h)).collect();
    assert_eq!(at_border.len(), 4);
    let inserted = |h: Half| placement.inserts.points[placement.inserts.on_edge[h].index() - m.n_verts()];
    assert!(at_border.iter().all(|&h| n_sides(inserted(h), 8) == 2 && inserted(h).z == 3.5));
    assert!(placement.inserts.points.iter().all(|&p| n_sides(p, 8) >= 2));
}

// Three sheets hang on one edge, the ends of which have fits that disagree.
#[test]
fn an_edge_of_three_faces_or_of_none_is_no_chamfer() {
    let points = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.], [0., -1., 0.]];
    let faces = [[0, 1, 2], [0, 1, 3], [0, 1, 4]];
    let chamfers = |faces: &[[usize; 3]]| {
        let m = mesh(&points, faces);
        let (normals, labels) = labels(&m);
        let plane = |v, n| (Vert::new(v), Fit::plane(m.point(Vert::new(v)), n, FitSource::Region));
        let fits = VertexFits::of(5, [plane(0, DVec3::X), plane(1, DVec3::Y)]);
        chamfer_edges(&Surface::new(&m, &normals, &labels), &fits)
    };
    assert_eq!(chamfers(&faces[..1]), [Half::new(0)]);
    assert_eq!(chamfers(&faces), []);
    assert_eq!(chamfers(&[[0, 1, 1]]), [], "a face that names a vertex twice");
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let (mut points, faces) = cut_cube(9).into_parts();
    for (i, p) in points.iter_mut().enumerate() {
        *p += 0.02 * dvec3((i as f64).sin(), (2.0 * i as f64).sin(), (3.0 * i as f64).sin());
    }
    let m = Mesh::new(points, faces).unwrap();
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let (labels, placement) = pool.install(|| run(&m));
        format!("{labels:?} {placement:?}")
    };
    assert!(on(1) == on(3));
}

#[test]
fn empty_collapsed_and_tiny_meshes_have_no_chamfer() {
    let collapsed = mesh(&[[1.0; 3]; 4], &[[0, 1, 2], [0, 2, 3]]);
    let one = mesh(&[[0.; 3], [1., 0., 0.], [0., 1., 0.], [5.; 3]], &[[0, 1, 2]]);
    for m in [mesh(&[], &[]), collapsed, one] {
        let (labels, placement) = run(&m);
        assert!(labels.candidates.is_empty() && placement.inserts.is_empty());
    }
}

// 3---2    The fits of 0 and 2 disagree by 90 degrees; 0 and 2 may be interior or not.
// | / |
// 0---1
#[test]
fn an_edge_whose_fits_disagree_is_a_chamfer_unless_both_ends_are_interior() {
    let m = mesh(&[[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]], &[[0, 1, 2], [0, 2, 3]]);
    let (normals, labels) = labels(&m);
    let mut surface = Surface::new(&m, &normals, &labels);
    surface.red_face = PerFace::filled(2, true);
    let v = Vert::new;
    let plane = |v, normal, source| (v, Fit::plane(m.point(v), normal, source));
    let ends =
        |source| VertexFits::of(4, [plane(v(0), DVec3::X, source), plane(v(2), DVec3::Z, FitSource::Region)]);
    let mut chamfers = |interior: [bool; 4], fits: &VertexFits| {
        surface.interior = interior.to_vec().into();
        chamfer_edges(&surface, fits)
    };
    let diagonal = [Half::new(2)];
    assert_eq!(chamfers([true, false, false, false], &ends(FitSource::Region)), diagonal);
    assert_eq!(chamfers([true, false, true, false], &ends(FitSource::Region)), []);
    // The papers' plane comes with the papers' rule; both faces are red.
    assert_eq!(chamfers([true, false, false, false], &ends(FitSource::Paper)), []);
    // How far planes have to tilt depends on how good they are.
    let tilted = |angle: f64, rms: f64| {
        let normal = dvec3(angle.to_radians().sin(), 0.0, angle.to_radians().cos());
        let [(a, p), (b, q)] = [(0, normal), (2, DVec3::Z)].map(|(i, n)| plane(v(i), n, FitSource::Region));
        VertexFits::of(4, [(a, Fit { rms, ..p }), (b, Fit { rms, ..q })])
    };
    let mut is_chamfer = |angle, rms| chamfers([false; 4], &tilted(angle, rms)) == diagonal;
    assert!(is_chamfer(44.0, 0.03) && !is_chamfer(42.0, 0.03));
    assert!(is_chamfer(36.0, 0.005) && !is_chamfer(34.0, 0.005));
    // Two sides of a sheet have no crease to meet in.
    assert!(is_chamfer(174.0, 0.03) && !is_chamfer(175.0, 0.03) && !is_chamfer(180.0, 0.005));
}

// 1---3---5    Nothing has a fit. Flat, nothing is beyond reach; folded along 2-3, the edges that have
// | / | / |    two faces and an end on the fold are.
// 0---2---4
#[test]
fn only_what_bends_like_a_chamfer_is_beyond_reach() {
    let beyond = |z: f64| {
        let points = [[0., 0., z], [0., 1., z], [1., 0., 0.], [1., 1., 0.], [2., 0., z], [2., 1., z]];
        let m = mesh(&points, &[[0, 2, 3], [0, 3, 1], [2, 4, 5], [2, 5, 3]]);
        let interior_vertex = PerVert::filled(6, false);
        let fits = VertexFits::none(6, m.verts().collect());
        let labels = RegionLabels { interior_vertex, fits, ..RegionLabels::default() };
        labels.beyond_reach(&m).iter().map(|h| m.ends(*h).map(Vert::index)).collect::<Vec<_>>()
    };
    assert_eq!(beyond(0.1), [[0; 2]; 0], "eleven degrees");
    assert_eq!(beyond(1.0), [[2, 3], [3, 0], [5, 2]]);
}
