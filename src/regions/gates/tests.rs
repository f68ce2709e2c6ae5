use super::*;
use crate::mesh::tests::mesh;
use crate::regions::tests::{labels, planes};
use FitSource::{Leftover, Region};
use approx::assert_relative_eq;
use glam::{DVec3, dvec3};

// 1---3---5---7
// | / | / | / |      edges 0-3, 2-5 and 4-7 are the diagonals
// 0---2---4---6
fn strip() -> Mesh {
    let points: Vec<_> = (0..8).map(|i| [f64::from(i / 2), f64::from(i % 2), 0.0]).collect();
    mesh(&points, &[[0, 2, 3], [0, 3, 1], [2, 4, 5], [2, 5, 3], [4, 6, 7], [4, 7, 5]])
}

fn edge(mesh: &Mesh, a: usize, b: usize) -> Half {
    mesh.edge(mesh.half_between(Vert::new(a), Vert::new(b)).unwrap())
}

#[test]
fn edges_that_share_a_triangle_make_one_strip() {
    let m = strip();
    let mut edges = [(0, 3), (2, 3), (4, 7)].map(|(a, b)| edge(&m, a, b));
    edges.sort_unstable();
    assert_eq!(group_by_triangles(&m, &edges), (vec![0, 0, 1], 2));
    let mut edges = [(0, 3), (2, 3), (2, 5), (4, 5), (4, 7)].map(|(a, b)| edge(&m, a, b));
    edges.sort_unstable();
    assert_eq!(group_by_triangles(&m, &edges), (vec![0; 5], 1));
}

#[test]
fn a_strip_knows_its_numbers() {
    // A ridge along x between a side that faces up and one that faces +y: vertex 0, on the first, is
    // 0.1 below it (the round's inner side), vertex 3 0.2 above the other; vertex 2 is a guess.
    let m = strip();
    let (normals, labels) = labels(&m);
    let mut surface = Surface::new(&m, &normals, &labels);
    surface.interior = crate::mesh::PerVert::filled(8, false);
    let (up, along) = (DVec3::Z, dvec3(0.0, 1.0, 0.0));
    let fits = planes(&m, &[(0, up, 0.1, Region), (2, up, 0.0, Leftover), (3, along, -0.2, Region)]);
    let mut edges = [(0, 3), (2, 3)].map(|(a, b)| edge(&m, a, b));
    edges.sort_unstable();
    let (strip_of, strips) = judge_strips(&surface, &fits, &edges, 0.0);
    assert_eq!((strip_of, strips.len()), (vec![0, 0], 1));
    let strip = &strips[0];
    assert_eq!((strip.n_edges, strip.n_inward, strip.rms, strip.guessed), (2, 3, 0.0, 0.25));
    assert_relative_eq!(strip.displacement, (0.1 + 0.2 + 0.2) / 4.0);
    assert_relative_eq!(strip.inward, (0.1 - 0.2 - 0.2) / 3.0);
    assert_eq!(strip.fate, Fate::FarFromFits);
    // An interior end counts neither as displaced nor as inward.
    surface.interior[Vert::new(3)] = true;
    let strip = &judge_strips(&surface, &fits, &edges, 0.0).1[0];
    assert_eq!((strip.displacement, strip.inward, strip.n_inward), (0.1 / 4.0, 0.1, 1));
    // A valley: the same displacement is outward.
    let fits = planes(&m, &[(0, up, 0.1, Region), (3, -along, 0.0, Region)]);
    assert_relative_eq!(judge_strips(&surface, &fits, &[edge(&m, 0, 3)], 0.0).1[0].inward, -0.1);
}

#[test]
fn each_gate_has_its_threshold() {
    let sound = Strip {
        n_edges: 40,
        displacement: 0.03,
        rms: 0.005,
        inward: 0.02,
        n_inward: 40,
        guessed: 0.1,
        fate: Fate::Kept,
    };
    let fate = |strip: Strip, noise| strip.judge(noise);
    assert_eq!(fate(sound.clone(), 0.0), Fate::Kept);
    assert_eq!(fate(Strip { displacement: 0.07, ..sound.clone() }, 0.0), Fate::FarFromFits);
    assert_eq!(fate(Strip { displacement: 0.07, ..sound.clone() }, 0.01), Fate::Kept);
    let poor = Strip { rms: 0.019, n_edges: 29, ..sound.clone() };
    assert_eq!(fate(poor.clone(), 0.0), Fate::PoorFits, "with a guess among ten ends");
    assert_eq!(fate(Strip { n_edges: 30, ..poor.clone() }, 0.0), Fate::Kept);
    let curved = Strip { guessed: 0.09, ..poor };
    assert_eq!(fate(curved.clone(), 0.0), Fate::Kept);
    assert_eq!(fate(curved.clone(), 0.011), Fate::PoorFits, "noise");
    assert_eq!(fate(Strip { rms: 0.021, ..curved }, 0.0), Fate::PoorFits);
    let round = Strip { inward: 0.064, ..sound.clone() };
    assert_eq!(fate(round.clone(), 0.0), Fate::Round, "0.068 less the residual");
    assert_eq!(fate(Strip { rms: 0.001, ..round.clone() }, 0.0), Fate::Kept);
    assert_eq!(fate(Strip { n_inward: 5, ..round.clone() }, 0.0), Fate::Kept);
    assert_eq!(fate(Strip { guessed: 0.4, ..round }, 0.0), Fate::Kept);
    let guess = Strip { n_edges: 9, guessed: 0.51, ..sound };
    assert_eq!(fate(guess.clone(), 0.0), Fate::Guessed);
    assert_eq!(fate(Strip { n_edges: 10, ..guess }, 0.0), Fate::Kept);
}

#[test]
fn the_noise_is_the_median_residual_of_region_fits_with_enough_samples() {
    let m = strip();
    let fit = |v: usize, rms: f64, n_members: usize, source| {
        (Vert::new(v), Fit { rms, n_members, ..Fit::plane(DVec3::ZERO, DVec3::Z, source) })
    };
    let mut list = vec![
        fit(0, 0.4, 6, Region),
        fit(1, 0.1, 6, Region),
        fit(2, 9.0, 5, Region),
        fit(3, 9.0, 9, Leftover),
    ];
    assert_eq!(noise(&VertexFits::of(8, list.clone())), 0.25);
    list.push(fit(4, 0.2, 7, Region));
    assert_eq!(noise(&VertexFits::of(m.n_verts(), list)), 0.2);
    assert_eq!(noise(&VertexFits::default()), 0.0);
}

#[test]
fn fragments_of_what_was_left_alone_are_left_alone_too() {
    let strip = |n_edges, fate| Strip {
        n_edges,
        displacement: 0.0,
        rms: 0.0,
        inward: 0.0,
        n_inward: 0,
        guessed: 0.0,
        fate,
    };
    let fates = |mut strips: Vec<Strip>| {
        cancel_fragments(&mut strips);
        strips.into_iter().map(|strip| strip.fate).collect::<Vec<_>>()
    };
    let round = strip(100, Fate::Round);
    let (short, long) = (strip(29, Fate::Kept), strip(30, Fate::Kept));
    let cancelled = fates(vec![round.clone(), short.clone(), long.clone()]);
    assert_eq!(cancelled, [Fate::Round, Fate::Fragment, Fate::Kept]);
    let kept = fates(vec![round, short, strip(71, Fate::Kept)]);
    assert_eq!(kept, [Fate::Round, Fate::Kept, Fate::Kept], "half of the edges");
}

#[test]
fn samples_are_off_the_surface_by_the_word_of_good_fits() {
    let m = strip();
    let (normals, labels) = labels(&m);
    let mut surface = Surface::new(&m, &normals, &labels);
    surface.interior = crate::mesh::PerVert::filled(8, false);
    surface.interior[Vert::new(5)] = true;
    let list = [(0, 0.2, Region), (2, 0.02, Region), (3, 0.2, Leftover), (5, 0.2, Region)];
    let fits = planes(&m, &list.map(|(v, d, source)| (v, DVec3::Z, d, source)));
    let chamfers = [(0, 3), (2, 5), (4, 7)].map(|(a, b)| edge(&m, a, b));
    let off = off_surface(&surface, &fits, &chamfers);
    // Vertex 5 is interior, 4 and 7 have no fit, 3 has a guess; of 0 and 2 the first is off.
    assert_eq!(off, OffSurface { witnesses: 2.0 / 3.0, share: 0.5, exact: 2.0 / 3.0 });
    assert!(off.is_likely());
    let is_likely = |witnesses, share, exact| OffSurface { witnesses, share, exact }.is_likely();
    assert!(!is_likely(0.9, 0.11, 0.5), "too small a share");
    assert!(!is_likely(0.29, 0.9, 0.0), "too few witnesses");
    assert!(!is_likely(0.5, 0.15, 0.5), "too few of all labels");
    assert!(is_likely(0.9, 0.03, 0.89), "enough of a polyhedron");
    assert!(!is_likely(0.9, 0.02, 0.89), "too few even of that");
}
