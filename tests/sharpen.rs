//! The whole filter on meshes whose original is known in closed form.

mod common;

use std::collections::BTreeSet;
use std::path::Path;

use common::{chamfered_cube, sphere, wedge_nets, zoo};
use glam::{DQuat, DVec3, dvec3};
use sharpen::bend::{BendOptions, bend};
use sharpen::classify::SmoothThreshold;
use sharpen::mesh::{Half, Vert};
use sharpen::place::Outcome;
use sharpen::tags::{Tags, tags_by_dihedral};
use sharpen::{Mesh, Method, Options, Sharpened, sharpen};

const METHODS: [Method; 3] = [Method::Regions, Method::Filters, Method::Paper];

fn run(mesh: &Mesh, method: Method) -> Sharpened {
    let sharpened = sharpen(mesh, &Options { method, ..Options::default() }).unwrap();
    sharpened.mesh.check().unwrap();
    sharpened
}

/// Distance of a point from the nearest edge of the cube `[-1, 1]³`, corners included.
fn distance_to_cube_edge(p: DVec3) -> f64 {
    let mut off = (p.abs() - DVec3::ONE).abs().to_array();
    off.sort_by(f64::total_cmp);
    off[0].hypot(off[1])
}

fn bits(points: &[DVec3]) -> Vec<[u64; 3]> {
    points.iter().map(|p| p.to_array().map(f64::to_bits)).collect()
}

#[test]
fn a_cube_gets_its_edges_and_corners_back() {
    let cube = chamfered_cube(8, 0.9);
    for method in METHODS {
        let sharpened = run(&cube, method);
        let report = &sharpened.report;
        // 12 strips of 7 quadrilaterals: 8 edges across and 7 diagonals each; 3 edges at each corner are
        // among the 8 x 12.
        assert_eq!(report.found.chamfer_edges, 12 * 15, "{method:?}");
        assert_eq!(report.found.corner_triangles, 8);
        assert_eq!(report.inserted[&Outcome::Moved], 12 * 15 + 8);
        let diagonal = cube.diagonal();
        let inserted = &sharpened.mesh.points()[cube.n_verts()..];
        for &p in inserted {
            assert!(distance_to_cube_edge(p) < 1e-9 * diagonal, "{method:?}: {p} is off every edge");
        }
        for corner in 0..8 {
            let sign = |i: i32| if corner >> i & 1 == 0 { -1.0 } else { 1.0 };
            let corner = DVec3::new(sign(0), sign(1), sign(2));
            let is_there = |p: &DVec3| p.distance(corner) < 1e-9 * diagonal;
            assert_eq!(inserted.iter().filter(|p| is_there(p)).count(), 1, "{method:?}: {corner}");
        }
        assert_eq!(bits(&sharpened.mesh.points()[..cube.n_verts()]), bits(cube.points()));
        assert!(sharpened.mesh.halves().all(|h| !sharpened.mesh.is_border(h)));
        assert_eq!(euler(&sharpened.mesh), 2);
    }
}

#[test]
fn an_open_box_keeps_no_chamfer_at_its_border() {
    let (points, mut faces) = chamfered_cube(8, 0.9).into_parts();
    faces.retain(|f| f.iter().all(|v| points[v.index()].z < 0.3));
    let open = Mesh::new(points, faces).unwrap();
    let sharpened = run(&open, Method::Regions);
    // Every face lies in one of the five sides.
    for normal in sharpened.mesh.face_normals().as_slice() {
        assert!((normal.abs().max_element() - 1.0).abs() < 1e-9, "{normal}");
    }
    let n_borders = |mesh: &Mesh| mesh.halves().filter(|&h| mesh.is_border(h)).count();
    assert_eq!(n_borders(&sharpened.mesh), n_borders(&open) + 4, "one new vertex for each crease");
    let bent = bend(&sharpened.mesh, &sharpened.tags, &BendOptions::default()).unwrap().mesh;
    for normal in bent.face_normals().as_slice() {
        assert!((normal.abs().max_element() - 1.0).abs() < 1e-9, "bent {normal}");
    }
}

#[test]
fn the_sharp_edges_of_a_cube_are_its_twelve_edges() {
    let sharpened = run(&chamfered_cube(8, 0.9), Method::Filters);
    let length = |&[a, b]: &[Vert; 2]| sharpened.mesh.point(a).distance(sharpened.mesh.point(b));
    let total: f64 = sharpened.tags.sharp_edges().iter().map(length).sum();
    assert!((total - 24.0).abs() < 1e-9, "{total}");
}

#[test]
fn folded_slivers_do_not_say_what_is_smooth_where_they_are_many() {
    // Pairs of triangles back to back beside the cube: all their edges are folded.
    let cube = chamfered_cube(8, 0.9);
    let with_pairs = |n: usize| {
        let (mut points, mut faces) = (cube.points().to_vec(), cube.faces().to_vec());
        for i in 0..n {
            let first = points.len();
            let corner = DVec3::new(3.0 + i as f64, 0.0, 0.0);
            points.extend([corner, corner + 0.2 * DVec3::X, corner + 0.2 * DVec3::Y]);
            let [a, b, c] = [0, 1, 2].map(|k| Vert::new(first + k));
            faces.extend([[a, b, c], [a, c, b]]);
        }
        Mesh::new(points, faces).unwrap()
    };
    for n in [10, 60] {
        let report = run(&with_pairs(n), Method::Regions).report;
        assert_eq!((report.found.chamfer_edges, report.unfit), (12 * 15, None), "{n}");
    }
    // 60 pairs set the limit above 40 degrees.
    assert!(run(&with_pairs(60), Method::Paper).report.found.threshold_deg > 40.0);
    assert!(run(&with_pairs(60), Method::Regions).report.found.threshold_deg < 20.0);
    let few = [Method::Paper, Method::Regions]
        .map(|method| run(&with_pairs(10), method).report.found.threshold_deg);
    assert_eq!(few[0], few[1]);
}

#[test]
fn a_smoothed_cube_becomes_sharp_where_rounds_count_as_creases() {
    let smoothing = Options { sharpen: false, denoise: 2, ..Options::default() };
    let smooth = sharpen(&chamfered_cube(16, 0.95), &smoothing).unwrap().mesh;
    let run = |max_round: f64| sharpen(&smooth, &Options { max_round, ..Options::default() }).unwrap();
    let corner_distance =
        |mesh: &Mesh, p: DVec3| mesh.points().iter().map(|q| q.distance(p)).fold(f64::INFINITY, f64::min);
    let h = 2.0 / 16.0;
    let corners: Vec<DVec3> =
        (0..8).map(|i| DVec3::from([0, 1, 2].map(|k| f64::from(i >> k & 1) * 2.0 - 1.0))).collect();
    let sharp = run(2.0);
    for &p in &corners {
        assert!(corner_distance(&smooth, p) > 0.5 * h, "worn off");
        assert!(corner_distance(&sharp.mesh, p) < 0.05 * h, "{p}");
    }
    // Most of each edge is back, and nothing else is sharp.
    let length = |&[a, b]: &[Vert; 2]| sharp.mesh.point(a).distance(sharp.mesh.point(b));
    let total: f64 = sharp.tags.sharp_edges().iter().map(length).sum();
    assert!((22.0..=24.5).contains(&total), "{total}");
    // A round that is larger stays, and is counted.
    let left = run(0.3).report;
    assert!(!left.changed && left.found.rounded_edges > 12 * 16, "{:?}", left.found);
    assert_eq!(sharp.report.found.rounded_edges, 0);
}

#[test]
fn edges_of_four_faces_on_surface_nets_have_two_where_faces_would_fold() {
    let nets = wedge_nets(18, 50f64.to_radians(), DQuat::from_scaled_axis(dvec3(0.2, 0.35, 0.1)));
    let n_pinched = nets.defects().non_manifold_edges;
    assert_eq!((n_pinched, nets.n_borders()), (7, 28));
    let Sharpened { mesh, report, .. } = run(&nets, Method::Regions);
    let left = n_pinched - report.untangled.unwrap().loosened;
    assert!(left < 2, "{left}");
    let counts = (mesh.defects().non_manifold_edges, mesh.n_borders());
    assert_eq!(counts, (left, 4 * left));
    assert_eq!((report.left_alone.defects.non_manifold_edges, report.left_alone.border_edges), counts);
    let normals = mesh.face_normals();
    let is_fold = |&h: &Half| {
        let twin = mesh.twin(h).unwrap_or(h);
        normals[h.face()].dot(normals[twin.face()]) < 170f64.to_radians().cos()
    };
    assert_eq!(mesh.halves().filter(is_fold).count(), 0);
}

#[test]
fn the_tip_of_a_cone_is_a_corner_and_stays_where_it_is() {
    // Over a grid of squares, none of whose vertices is the tip.
    let n = 24;
    let xy = |k: usize| [(k / (n + 1)) as f64 - 11.7, (k % (n + 1)) as f64 - 12.4];
    let points = (0..(n + 1) * (n + 1)).map(xy).map(|[x, y]| DVec3::new(x, y, -1.5 * x.hypot(y))).collect();
    let square = |k: usize| {
        let [i, j] = [k / n, k % n];
        let [a, b, c, d] =
            [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]].map(|[i, j]| Vert::new(i * (n + 1) + j));
        [[a, b, c], [a, c, d]]
    };
    let cone = Mesh::new(points, (0..n * n).flat_map(square).collect()).unwrap();
    let options = Options { bend: 1, denoise: 2, keep_verdict: true, ..Options::default() };
    let sharpened = sharpen(&cone, &options).unwrap();
    let report = &sharpened.report;
    assert_eq!((report.found.apexes, report.found.chamfer_edges, report.moved_vertices), (1, 0, 1));
    assert_eq!(report.verdict.as_ref().unwrap().corners.len(), 1);
    let [tip] = sharpened.tags.tagged() else { panic!("{:?}", sharpened.tags) };
    let tip = sharpened.mesh.point(*tip);
    assert!(tip.length() < 1e-9, "{tip}");
    // Without denoising all other vertices of the file keep their bits, and so does everything by the paper.
    let plain = run(&cone, Method::Regions);
    let (now, was) = (bits(plain.mesh.points()), bits(cone.points()));
    assert_eq!(now.iter().zip(&was).filter(|(now, was)| now != was).count(), 1);
    assert_eq!((plain.mesh.n_faces(), euler(&plain.mesh)), (cone.n_faces(), euler(&cone)));
    let paper = run(&cone, Method::Paper);
    assert_eq!(bits(&paper.mesh.points()[..cone.n_verts()]), bits(cone.points()));
    assert_eq!(paper.report.found.apexes, 0);
}

fn bracket(name: &str) -> Mesh {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata").join(name);
    let model = sharpen::io::read(&path).unwrap();
    Mesh::new(model.points, model.faces).unwrap()
}

fn total_length(mesh: &Mesh, tags: &Tags) -> f64 {
    tags.sharp_edges().iter().map(|&[a, b]| mesh.point(a).distance(mesh.point(b))).sum()
}

#[test]
fn tags_survive_collapses_compaction_and_every_level_of_bending() {
    let (exact, sampled) = (bracket("bracket.obj"), bracket("bracket_mc.obj"));
    let true_length = total_length(&exact, &tags_by_dihedral(&exact, 30f64.to_radians()));
    for method in METHODS {
        let at_level = |bend| sharpen(&sampled, &Options { method, bend, ..Options::default() }).unwrap();
        let mut before = at_level(0);
        let replaced = &before.report.replaced_vertices;
        let stand_in_slots = |v: &&usize| before.tags.tagged().contains(&Vert::new(**v));
        assert!(replaced.iter().any(|v| stand_in_slots(&v)), "{method:?}: no new vertex in an old slot");
        if method == Method::Regions {
            let length = total_length(&before.mesh, &before.tags);
            assert!((length / true_length - 1.0).abs() < 0.01, "{length} of {true_length}");
        }
        for level in 1..=2 {
            let bent = at_level(level);
            let (edges, tagged) = (bent.tags.sharp_edges(), bent.tags.tagged());
            assert_eq!(edges.len(), 2 * before.tags.sharp_edges().len(), "{method:?}, level {level}");
            assert!(before.tags.tagged().iter().all(|v| tagged.binary_search(v).is_ok()));
            assert!(
                edges.iter().all(|&[a, b]| {
                    bent.mesh.half_between(a, b).or(bent.mesh.half_between(b, a)).is_some()
                })
            );
            // Each edge has become two, from its ends to what is new between them.
            let n = before.mesh.n_verts();
            let halves = |v: Vert| edges.iter().filter(move |edge| edge.contains(&v));
            let ends = |v: usize| {
                let mut ends: Vec<_> = halves(Vert::new(v)).map(|edge| edge[0]).collect();
                ends.sort_unstable();
                ends
            };
            let new: BTreeSet<usize> = edges.iter().map(|edge| edge[1].index()).collect();
            assert!(new.iter().all(|&v| v >= n), "{method:?}, level {level}");
            let parents: BTreeSet<Vec<Vert>> = new.into_iter().map(ends).collect();
            let expected = before.tags.sharp_edges().iter().map(|edge| edge.to_vec());
            assert!(parents.into_iter().eq(expected.collect::<BTreeSet<_>>()), "{method:?}, level {level}");
            before = bent;
        }
    }
}

#[test]
fn a_sharpened_mesh_is_bent_by_its_sharp_edges_as_it_is_at_once() {
    let sampled = bracket("bracket_mc.obj");
    let sharpened = sharpen(&sampled, &Options::default()).unwrap();
    let at_once = sharpen(&sampled, &Options { bend: 2, ..Options::default() }).unwrap();
    let sharp_edges = sharpened.tags.sharp_edges().to_vec();
    let alone = Options { sharpen: false, sharp_edges, bend: 2, ..Options::default() };
    let bent = sharpen(&sharpened.mesh, &alone).unwrap();
    assert_eq!(bits(bent.mesh.points()), bits(at_once.mesh.points()));
    assert_eq!(bent.mesh.faces(), at_once.mesh.faces());
    assert_eq!(bent.tags, at_once.tags);
}

fn euler(mesh: &Mesh) -> i64 {
    let used = mesh.verts().filter(|&v| !mesh.leaving(v).is_empty()).count();
    used as i64 - mesh.edges().count() as i64 + mesh.n_faces() as i64
}

#[test]
fn a_sphere_comes_back_bit_for_bit() {
    let sphere = sphere(4);
    for method in METHODS {
        let sharpened = run(&sphere, method);
        assert!(!sharpened.report.changed, "{method:?}");
        assert_eq!(bits(sharpened.mesh.points()), bits(sphere.points()));
        assert_eq!(sharpened.mesh.faces(), sphere.faces());
        assert!(sharpened.tags.sharp_edges().is_empty());
    }
}

#[test]
fn at_a_smooth_angle_of_zero_nothing_is_found() {
    let cube = chamfered_cube(6, 0.8);
    let options = Options { smooth: SmoothThreshold::Angle(0.0), ..Options::default() };
    let sharpened = sharpen(&cube, &options).unwrap();
    assert_eq!((sharpened.mesh.points(), sharpened.mesh.faces()), (cube.points(), cube.faces()));
    assert!(!sharpened.report.changed);
}

#[test]
fn a_noisy_mesh_is_left_as_it_is_and_the_report_says_why() {
    let (mut points, faces) = sphere(4).into_parts();
    for (i, p) in points.iter_mut().enumerate() {
        *p *= 1.0 + 0.05 * (i as f64 * 12.9898).sin();
    }
    let noisy = Mesh::new(points, faces).unwrap();
    let sharpened = run(&noisy, Method::Regions);
    assert!(sharpened.report.unfit.as_ref().is_some_and(|why| why.starts_with("noisy or terraced")));
    assert_eq!((sharpened.mesh.points(), sharpened.mesh.faces()), (noisy.points(), noisy.faces()));
    assert!(run(&noisy, Method::Paper).report.unfit.is_none(), "the strict algorithm does as it is told");
}

#[test]
fn every_animal_of_the_zoo_survives_every_method() {
    for (name, animal) in zoo() {
        for method in METHODS {
            let sharpened = run(&animal, method);
            let finite = |p: &DVec3| p.is_finite();
            assert!(sharpened.mesh.points().iter().all(finite), "{name}, {method:?}");
            let old = &sharpened.mesh.points()[..animal.n_verts()];
            let replaced = &sharpened.report.replaced_vertices;
            for (i, (p, q)) in old.iter().zip(animal.points()).enumerate() {
                assert!(p == q || replaced.contains(&i), "{name}, {method:?}: vertex {i} moved");
            }
            let ends = |mesh: &Mesh| -> Vec<Vert> {
                mesh.halves().filter(|&h| mesh.is_border(h)).map(|h| mesh.from(h)).collect()
            };
            let (before, after) = (ends(&animal), ends(&sharpened.mesh));
            let is_new = |v: &&Vert| v.index() >= animal.n_verts() || replaced.contains(&v.index());
            let n_split = after.iter().filter(is_new).count();
            assert_eq!(before.len() + n_split, after.len(), "{name}, {method:?}: borders");
            assert!(n_split == 0 || method == Method::Regions, "{name}, {method:?}: borders");
            assert_eq!(euler(&animal), euler(&sharpened.mesh), "{name}, {method:?}: Euler characteristic");
        }
    }
}

#[test]
fn the_result_does_not_depend_on_the_number_of_threads() {
    let cube = chamfered_cube(40, 0.97);
    for method in METHODS {
        let results = [1, 2, 5].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| run(&cube, method))
        });
        for other in &results[1..] {
            assert_eq!(bits(results[0].mesh.points()), bits(other.mesh.points()));
            assert_eq!(results[0].mesh.faces(), other.mesh.faces());
            assert_eq!(results[0].tags, other.tags);
        }
    }
}
