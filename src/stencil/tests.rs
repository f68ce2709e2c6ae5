//! Weights are read off by moving one vertex at a time: what the new vertex does with it is its weight.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

use approx::assert_relative_eq;
use glam::{DVec2, DVec3, dvec2};

use super::*;
use crate::mesh::Face;
use crate::mesh::tests::mesh;

/// The number of points a side of [`lattice`].
const N: usize = 9;

/// The lattice point in column `i`, row `j`.
fn at(i: usize, j: usize) -> usize {
    i * N + j
}

//   (0,2)--(1,2)--(2,2)
//     |   /  |   /  |       every interior vertex has six triangles, every border vertex three, but for
//   (0,1)--(1,1)--(2,1)     two corners with two and two with one
//     |   /  |   /  |
//   (0,0)--(1,0)--(2,0)
fn lattice(is_mirrored: bool, height: impl Fn(f64, f64) -> f64) -> Mesh {
    let (mut points, mut faces) = (Vec::new(), Vec::new());
    for (i, j) in (0..N).flat_map(|i| (0..N).map(move |j| (i, j))) {
        let (x, y) = (i as f64, j as f64);
        points.push([if is_mirrored { -x } else { x }, y, height(x, y)]);
        if i + 1 < N && j + 1 < N {
            faces.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            faces.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    if is_mirrored {
        faces.iter_mut().for_each(|f| f.swap(1, 2));
    }
    mesh(&points, &faces)
}

/// `n` sectors between rays from a centre, each a triangular lattice of two rows. All vertices but the
/// centre (vertex 0) and those at the rim are regular. Closed, or open with its rays over half a turn; the
/// first ray's near vertex is 1, those of the others follow.
fn rays(n: usize, is_closed: bool) -> Mesh {
    let n_rays = if is_closed { n } else { n + 1 };
    let angle = if is_closed { TAU } else { PI } / n as f64;
    let ray = |s: usize| DVec2::from_angle(angle * s as f64);
    let mut index = BTreeMap::new();
    let mut points = vec![DVec2::ZERO];
    // (sector, row, place in the row); the end of a row is the start of the next sector's.
    for row in 1..=3 {
        for (s, t) in (0..n_rays).flat_map(|s| (0..row).map(move |t| (s, t))) {
            if t == 0 || s < n {
                index.insert((s, row, t), points.len());
                points.push(((row - t) as f64) * ray(s) + t as f64 * ray(s + 1));
            }
        }
    }
    let vertex = |s: usize, row: usize, t: usize| match (row, t) {
        (0, _) => 0,
        (row, t) if row == t => index[&((s + 1) % n_rays, row, 0)],
        (row, t) => index[&(s, row, t)],
    };
    let mut faces = Vec::new();
    for (s, row) in (0..n).flat_map(|s| (0..3).map(move |row| (s, row))) {
        for t in 0..=row {
            faces.push([vertex(s, row, t), vertex(s, row + 1, t), vertex(s, row + 1, t + 1)]);
            if t < row {
                faces.push([vertex(s, row, t), vertex(s, row + 1, t + 1), vertex(s, row, t + 1)]);
            }
        }
    }
    let points: Vec<[f64; 3]> = points.into_iter().map(|p| [p.x, p.y, 0.0]).collect();
    mesh(&points, &faces)
}

fn tags(edges: &[[usize; 2]]) -> Tags {
    Tags::new(edges.iter().map(|edge| edge.map(Vert::new)), [])
}

/// Tags the polyline through the vertices.
fn chain(vertices: &[usize]) -> Vec<[usize; 2]> {
    vertices.windows(2).map(|pair| [pair[0], pair[1]]).collect()
}

fn half(mesh: &Mesh, p: usize, q: usize) -> Half {
    let (p, q) = (Vert::new(p), Vert::new(q));
    mesh.half_between(p, q).or(mesh.half_between(q, p)).expect("the edge is in the mesh")
}

fn place(mesh: &Mesh, sharp: &[[usize; 2]], [p, q]: [usize; 2]) -> Proposal {
    Stencils::new(mesh, &tags(sharp)).place(half(mesh, p, q))
}

/// The rule of an edge and its weights: how far the new vertex rises when a vertex rises by one.
fn weights(mesh: &Mesh, sharp: &[[usize; 2]], edge: [usize; 2]) -> (Rule, BTreeMap<usize, f64>) {
    let mut weights = BTreeMap::new();
    let flat = place(mesh, sharp, edge);
    for v in 0..mesh.n_verts() {
        let mut points = mesh.points().to_vec();
        points[v].z += 1.0;
        let raised = Mesh::new(points, mesh.faces().to_vec()).unwrap();
        let weight = place(&raised, sharp, edge).point.z - flat.point.z;
        if weight.abs() > 1e-14 {
            weights.insert(v, weight);
        }
    }
    (flat.rule, weights)
}

#[track_caller]
fn assert_weights(
    (rule, found): (Rule, BTreeMap<usize, f64>),
    expected_rule: Rule,
    expected: impl IntoIterator<Item = (usize, f64)>,
) {
    assert_eq!(rule, expected_rule);
    let mut expected: BTreeMap<usize, f64> = expected.into_iter().collect();
    expected.retain(|_, weight| weight.abs() > 1e-14);
    let vertices = |weights: &BTreeMap<usize, f64>| weights.keys().copied().collect::<Vec<_>>();
    assert_eq!(vertices(&found), vertices(&expected), "{found:?} {expected:?}");
    for (v, weight) in &found {
        assert_relative_eq!(*weight, expected[v], epsilon = 1e-12);
    }
    assert_relative_eq!(found.values().sum::<f64>(), 1.0, epsilon = 1e-12);
}

fn cubic(x: f64, y: f64) -> f64 {
    0.3 - 2.0 * x + y + 0.7 * x * x - 1.1 * x * y + 0.2 * y * y + 0.05 * x.powi(3) - 0.07 * x * x * y
        + 0.11 * x * y * y
        - 0.02 * y.powi(3)
}

fn quadratic(x: f64, y: f64) -> f64 {
    0.3 - 2.0 * x + y + 0.7 * x * x - 1.1 * x * y + 0.2 * y * y
}

fn linear(x: f64, y: f64) -> f64 {
    0.3 - 2.0 * x + y
}

/// Asserts that all `edges` follow `rule` and are exact for `height`, on the lattice and its mirror image.
#[track_caller]
fn assert_exact(sharp: &[[usize; 2]], edges: &[[usize; 2]], rule: Rule, height: fn(f64, f64) -> f64) {
    for is_mirrored in [false, true] {
        let m = lattice(is_mirrored, height);
        for &edge in edges {
            let Proposal { point, rule: found, .. } = place(&m, sharp, edge);
            let middle = m.point(Vert::new(edge[0])).midpoint(m.point(Vert::new(edge[1])));
            assert_eq!(found, rule, "{edge:?}");
            let expected = middle.truncate().extend(height(middle.x.abs(), middle.y));
            assert_relative_eq!(point.distance(expected), 0.0, epsilon = 1e-12);
        }
    }
}

#[test]
fn r1_is_exact_for_cubics() {
    let edges = [[at(4, 4), at(5, 4)], [at(4, 4), at(4, 5)], [at(4, 4), at(5, 5)]];
    assert_exact(&[], &edges, Rule::R1, cubic);
}

#[test]
fn r1_has_the_weights_of_the_table() {
    // Edge (4,4)-(5,4): its triangles have (5,5) above and (4,3) below.
    let found = weights(&lattice(false, linear), &[], [at(4, 4), at(5, 4)]);
    let ends = [(4, 4), (5, 4)].map(|v| (v, 0.5));
    let sides = [(5, 5), (4, 3)].map(|v| (v, 0.125));
    let wings = [(4, 5), (6, 5), (3, 3), (5, 3)].map(|v| (v, -0.0625));
    let expected = ends.into_iter().chain(sides).chain(wings);
    assert_weights(found, Rule::R1, expected.map(|((i, j), weight)| (at(i, j), weight)));
}

#[test]
fn r2_is_exact_for_cubics_along_sharp_lines_and_borders() {
    let along_row = chain(&[2, 3, 4, 5, 6].map(|i| at(i, 4)));
    assert_exact(&along_row, &[[at(3, 4), at(4, 4)], [at(5, 4), at(4, 4)]], Rule::R2, cubic);
    assert_exact(
        &[],
        &[[at(4, 0), at(5, 0)], [at(0, 3), at(0, 4)], [at(N - 1, 3), at(N - 1, 4)]],
        Rule::R2,
        cubic,
    );
    let expected = [(2, -1.0), (3, 9.0), (4, 9.0), (5, -1.0)].map(|(i, w)| (at(i, 4), w / 16.0));
    assert_weights(weights(&lattice(false, linear), &along_row, [at(3, 4), at(4, 4)]), Rule::R2, expected);
}

#[test]
fn r3_is_exact_for_quadratics_beside_sharp_lines_and_borders() {
    let along_row = chain(&[0, 1, 2, 3, 4, 5, 6, 7, 8].map(|i| at(i, 4)));
    let above = [[at(4, 4), at(4, 5)], [at(4, 4), at(5, 5)]];
    let below = [[at(4, 4), at(4, 3)], [at(3, 3), at(4, 4)]];
    assert_exact(&along_row, &[above, below].concat(), Rule::R3, quadratic);
    let borders = [[at(4, 0), at(4, 1)], [at(4, 0), at(5, 1)], [at(4, N - 1), at(4, N - 2)]];
    assert_exact(&[], &borders, Rule::R3, quadratic);
    let along_diagonal = chain(&[0, 1, 2, 3, 4, 5, 6, 7, 8].map(|i| at(i, i)));
    let edges = [[at(4, 4), at(5, 4)], [at(4, 4), at(4, 3)], [at(4, 4), at(3, 4)], [at(4, 4), at(4, 5)]];
    assert_exact(&along_diagonal, &edges, Rule::R3, quadratic);
}

#[test]
fn r3_has_the_weights_of_the_table() {
    // q = (4,0) on the border, p = (4,1). They share (3,0), which is q's near neighbour on the border, and
    // (5,1); far is (5,0).
    let found = weights(&lattice(false, linear), &[], [at(4, 0), at(4, 1)]);
    let expected = [
        ((4, 1), 10.),
        ((4, 0), 6.),
        ((5, 1), 3.),
        ((5, 2), -2.),
        ((3, 1), -1.),
        ((3, 0), 1.),
        ((5, 0), -1.),
    ];
    assert_weights(found, Rule::R3, expected.map(|((i, j), w)| (at(i, j), w / 16.0)));
}

#[test]
fn r4_is_exact_for_quadratics_between_curves_that_meet() {
    // The row and the diagonal meet in the corner (4,4).
    let corner = [chain(&[4, 5, 6, 7].map(|i| at(i, 4))), chain(&[4, 5, 6, 7].map(|i| at(i, i)))].concat();
    let edge = [at(5, 4), at(5, 5)];
    assert_exact(&corner, &[edge], Rule::R4, quadratic);
    let expected = [((5, 4), 0.5), ((5, 5), 0.5), ((6, 5), 0.25), ((6, 4), -0.125), ((6, 6), -0.125)];
    let found = weights(&lattice(false, linear), &corner, edge);
    assert_weights(found, Rule::R4, expected.map(|((i, j), w)| (at(i, j), w)));
}

#[test]
fn r5_is_exact_for_linear_functions_in_a_strip_one_edge_wide() {
    let row = |j: usize| chain(&[1, 2, 3, 4, 5, 6, 7].map(|i| at(i, j)));
    let strip = [row(4), row(5)].concat();
    assert_exact(&strip, &[[at(4, 4), at(4, 5)], [at(4, 4), at(5, 5)]], Rule::R5, linear);
    // Across the strip, and along its diagonals.
    let near = |vertices: [(usize, usize); 2]| vertices.map(|v| (v, 1.0 / 16.0));
    let far = |vertices: [(usize, usize); 2]| vertices.map(|v| (v, -1.0 / 16.0));
    let ends = |vertices: [(usize, usize); 2]| vertices.map(|v| (v, 0.5));
    for (ends, near, far) in [
        (ends([(4, 4), (4, 5)]), near([(3, 4), (5, 5)]), far([(5, 4), (3, 5)])),
        (ends([(4, 4), (5, 5)]), near([(5, 4), (4, 5)]), far([(3, 4), (6, 5)])),
    ] {
        let edge = [ends[0].0, ends[1].0].map(|(i, j)| at(i, j));
        let expected = [ends, near, far].concat().into_iter().map(|((i, j), w)| (at(i, j), w));
        assert_weights(weights(&lattice(false, linear), &strip, edge), Rule::R5, expected);
    }
}

#[test]
fn r6_mirrors_the_known_neighbour_where_a_curve_ends() {
    // A dead end inside, at (4,4).
    let line = chain(&[4, 5, 6, 7].map(|i| at(i, 4)));
    assert_exact(&line, &[[at(4, 4), at(5, 4)]], Rule::R6, linear);
    // The neighbour (2, 1) of the edge (0, 0) - (1, 0) is mirrored to (-1, 1).
    let points = [[0., 0., 0.], [1., 0., 0.], [2., 1., 0.], [0.5, 2., 5.], [0.5, -2., 7.], [3., -1., 8.]];
    let m = mesh(
        &points,
        &[[0, 1, 3], [1, 0, 4], [1, 2, 3], [2, 1, 5], [4, 5, 1], [3, 2, 4], [2, 5, 4], [0, 3, 4]],
    );
    let proposal = place(&m, &[[0, 1], [1, 2]], [0, 1]);
    assert_eq!(proposal.rule, Rule::R6);
    assert_relative_eq!(proposal.point.distance(DVec3::new(0.5, -0.125, 0.)), 0.0, epsilon = 1e-15);
}

#[test]
fn a_sharp_edge_alone_or_between_corners_is_halved() {
    let m = lattice(false, cubic);
    let middle = |p: usize, q: usize| m.point(Vert::new(p)).midpoint(m.point(Vert::new(q)));
    let (p, q) = (at(4, 4), at(5, 4));
    let alone = place(&m, &[[p, q]], [p, q]);
    assert_eq!((alone.point, alone.rule), (middle(p, q), Rule::Midpoint));
    let corners = [[p, q], [p, at(4, 5)], [p, at(4, 3)], [q, at(5, 5)], [q, at(5, 3)]];
    let between = place(&m, &corners, [p, q]);
    assert_eq!((between.point, between.rule), (middle(p, q), Rule::Midpoint));
}

#[test]
fn curves_end_in_corners_of_three_and_more() {
    // Row, column and diagonal start in (4,4); then its other diagonal as well.
    let row = chain(&[4, 5, 6, 7].map(|i| at(i, 4)));
    let column = chain(&[4, 5, 6, 7].map(|j| at(4, j)));
    let back = chain(&[4, 3, 2, 1].map(|i| at(i, i)));
    let three = [row, column, back].concat();
    let four = [three.clone(), chain(&[4, 3, 2, 1].map(|i| at(i, 4)))].concat();
    for corner in [&three, &four] {
        let first = [[at(4, 4), at(5, 4)], [at(4, 4), at(4, 5)], [at(3, 3), at(4, 4)]];
        assert_exact(corner, &first, Rule::R6, linear);
        assert_exact(corner, &[[at(5, 4), at(6, 4)]], Rule::R2, cubic);
        // A sector of two triangles between two of them: its spoke is halved.
        let halved = [(at(4, 4), 0.5), (at(5, 5), 0.5)];
        assert_weights(weights(&lattice(false, linear), corner, [at(4, 4), at(5, 5)]), Rule::E1, halved);
    }
    // A sector of one triangle, between (3,3) and (3,4), has no spoke: only the edge across from the corner.
    assert_exact(&four, &[[at(3, 3), at(3, 4)]], Rule::R4, quadratic);
}

#[test]
fn a_sharp_line_may_end_on_a_border_and_run_beside_one() {
    // The row ends on the border in (0,4), which is a corner for all three of its cut edges.
    let row = chain(&[0, 1, 2, 3, 4].map(|i| at(i, 4)));
    let cut = [[at(0, 4), at(1, 4)], [at(0, 4), at(0, 5)], [at(0, 3), at(0, 4)]];
    assert_exact(&row, &cut, Rule::R6, linear);
    let halved = [(at(0, 4), 0.5), (at(1, 5), 0.5)];
    assert_weights(weights(&lattice(false, linear), &row, [at(0, 4), at(1, 5)]), Rule::E1, halved);
    // Beside the border, a strip one edge wide.
    let beside = chain(&[1, 2, 3, 4, 5, 6, 7].map(|i| at(i, 1)));
    assert_exact(&beside, &[[at(4, 0), at(4, 1)], [at(4, 0), at(5, 1)]], Rule::R5, linear);
    assert_exact(&beside, &[[at(4, 1), at(4, 2)]], Rule::R3, quadratic);
    // From the border into the surface, along a diagonal: next to the corner a sharp and a border edge meet.
    let diagonal = chain(&[4, 5, 6, 7].map(|i| at(i, i - 4)));
    assert_exact(&diagonal, &[[at(5, 0), at(5, 1)]], Rule::R4, quadratic);
}

#[test]
fn a_dead_end_is_interior() {
    let line = chain(&[4, 5, 6, 7].map(|i| at(i, 4)));
    for edge in [[at(4, 4), at(4, 5)], [at(3, 4), at(4, 4)], [at(3, 3), at(4, 4)]] {
        assert_exact(&line, &[edge], Rule::R1, cubic);
    }
}

#[test]
fn e2_has_the_rows_of_zorin_round_an_interior_vertex() {
    for k in [3, 4, 5, 7, 12] {
        let row = |j: usize| match (k, j) {
            (3, 0) => 5. / 12.,
            (3, _) => -1. / 12.,
            (4, 0) => 3. / 8.,
            (4, 2) => -1. / 8.,
            (4, _) => 0.,
            _ => {
                let angle = TAU * j as f64 / k as f64;
                (0.25 + angle.cos() + 0.5 * (2. * angle).cos()) / k as f64
            }
        };
        let m = rays(k, true);
        for spoke in 0..k {
            let neighbours = (0..k).map(|j| (1 + (spoke + j) % k, row(j)));
            let found = weights(&m, &[], [0, 1 + spoke]);
            assert_weights(found, Rule::E2, neighbours.chain([(0, 0.75)]));
            // Exact for linear functions: the fan's own coordinates are two.
            let middle = m.point(Vert::new(1 + spoke)) / 2.0;
            assert_relative_eq!(place(&m, &[], [0, 1 + spoke]).point.distance(middle), 0.0, epsilon = 1e-12);
        }
    }
    assert_eq!(place(&rays(6, true), &[], [0, 1]).rule, Rule::R1);
}

#[test]
fn e1_has_the_rows_of_zorin_at_a_crease() {
    for k in [2, 4, 5, 6, 9] {
        let m = rays(k, false);
        let n = k as f64;
        let t = PI / n;
        for i in 1..k {
            let spoke = i as f64;
            let end = (spoke * t).cos() / 4.
                - (2. * t).sin() * (2. * t * spoke).sin() / (4. * n * (t.cos() - (2. * t).cos()));
            let row = |j: usize| {
                let j = j as f64;
                ((spoke * t).sin() * (j * t).sin() + 0.5 * (2. * spoke * t).sin() * (2. * j * t).sin()) / n
            };
            let centre = 1. - t.sin() * (spoke * t).sin() / (n * (1. - t.cos()));
            let expected = (1..k).map(|j| (1 + j, row(j))).chain([(0, centre), (1, end), (1 + k, -end)]);
            assert_weights(weights(&m, &[], [0, 1 + i]), Rule::E1, expected);
            let middle = m.point(Vert::new(1 + i)) / 2.0;
            assert_relative_eq!(place(&m, &[], [0, 1 + i]).point.distance(middle), 0.0, epsilon = 1e-12);
        }
    }
    assert_eq!(place(&rays(3, false), &[], [0, 2]).rule, Rule::R3);
}

#[test]
fn a_sharp_curve_through_a_vertex_cuts_it_into_two_crease_ends() {
    // Spokes 0 and 3 of seven are sharp: a sector of three triangles and one of four.
    let m = rays(7, true);
    let sharp = [[1, 8], [0, 1], [0, 4], [4, 11]].map(|[p, q]| [p, q]);
    let far = |v: usize| m.leaving(Vert::new(v)).iter().map(|&h| m.to(h).index()).find(|&w| w > 7).unwrap();
    let sharp = [[1, far(1)], sharp[1], sharp[2], [4, far(4)]];
    assert_eq!(place(&m, &sharp, [0, 2]).rule, Rule::R3);
    let (rule, found) = weights(&m, &sharp, [0, 6]);
    assert_eq!(rule, Rule::E1);
    assert!(found.keys().all(|v| ![2, 3].contains(v)), "nothing comes from beyond the curve: {found:?}");
}

#[test]
fn two_extraordinary_ends_give_the_mean_of_both() {
    // An octahedron: 0 up, 5 down, 1 to 4 round the equator. All valences are 4.
    let points = [[0., 0., 1.], [1., 0., 0.], [0., 1., 0.], [-1., 0., 0.], [0., -1., 0.], [0., 0., -1.]];
    let faces = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1], [5, 2, 1], [5, 3, 2], [5, 4, 3], [5, 1, 4]];
    // From 0: 3/4 of itself, 3/8 of 1, -1/8 of 3. From 1: 3/4 of itself, 3/8 of 0, -1/8 of 5.
    let expected = [(0, 9. / 16.), (1, 9. / 16.), (3, -1. / 16.), (5, -1. / 16.)];
    assert_weights(weights(&mesh(&points, &faces), &[], [0, 1]), Rule::Mean, expected);
}

#[test]
fn a_tetrahedron_has_interior_ends_of_three() {
    let points = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]];
    let m = mesh(&points, &[[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]);
    let expected = [(0, 7. / 12.), (1, 7. / 12.), (2, -1. / 12.), (3, -1. / 12.)];
    assert_weights(weights(&m, &[], [0, 1]), Rule::Mean, expected);
}

#[test]
fn two_triangles_back_to_back_are_halved() {
    let m = mesh(&[[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]], &[[0, 1, 2], [0, 2, 1]]);
    let Proposal { point, rule, .. } = place(&m, &[], [0, 1]);
    assert_eq!((point, rule), (DVec3::new(0.5, 0., 0.), Rule::Mean));
}

#[test]
fn a_loop_of_three_edges_sees_its_third_vertex_from_both_sides() {
    let m = mesh(&[[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]], &[[0, 1, 2]]);
    let expected = [(0, 9. / 16.), (1, 9. / 16.), (2, -1. / 8.)];
    assert_weights(weights(&m, &[], [0, 1]), Rule::R2, expected);
    // The same as a sharp loop on a closed surface, round a sector of one triangle.
    let points = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]];
    let m = mesh(&points, &[[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]);
    let expected = [(0, 9. / 16.), (1, 9. / 16.), (2, -1. / 8.)];
    assert_weights(weights(&m, &[[0, 1], [1, 2], [2, 0]], [0, 1]), Rule::R2, expected);
}

//   3---2   6---5     two squares that touch in vertex 0: each border turns there within its own square
//   |  /  .´ \  |
//   1---0-----4-´
#[test]
fn the_border_of_a_bow_tie_stays_in_its_own_fan() {
    let points = [
        [0., 0., 0.],
        [-1., 0., 0.],
        [0., 1., 0.],
        [-1., 1., 0.],
        [1., 0., 0.],
        [1., -1., 0.],
        [0., -1., 0.],
    ];
    let m = mesh(&points, &[[0, 2, 1], [1, 2, 3], [0, 6, 4], [4, 6, 5]]);
    let expected = [(2, -1.), (0, 9.), (1, 9.), (3, -1.)].map(|(v, w)| (v, w / 16.));
    assert_weights(weights(&m, &[], [0, 1]), Rule::R2, expected);
}

/// Three sheets round the line 0-1-2-3, each a strip of triangles; the far rims differ.
fn book() -> Mesh {
    let (mut points, mut faces) = (Vec::new(), Vec::new());
    points.extend((0..4).map(|i| [f64::from(i), 0.1 * f64::from(i * i), 0.]));
    for sheet in 0..3 {
        let out = DVec2::from_angle(TAU * f64::from(sheet) / 3.0);
        let rim = points.len();
        points.extend((0..4).map(|i| [f64::from(i), out.x, out.y]));
        for i in 0..3 {
            faces.push([i, i + 1, rim + i]);
            faces.push([i + 1, rim + i + 1, rim + i]);
        }
    }
    mesh(&points, &faces)
}

#[test]
fn an_edge_of_three_faces_goes_on_in_others_of_its_kind() {
    let m = book();
    assert_eq!(m.defects().non_manifold_edges, 3);
    let expected = [(0, -1.), (1, 9.), (2, 9.), (3, -1.)].map(|(v, w)| (v, w / 16.));
    assert_weights(weights(&m, &[], [1, 2]), Rule::R2, expected);
    // All three half-edges agree. At the ends of the line three borders begin: it is a corner.
    let stencils = Stencils::new(&m, &Tags::default());
    let halves = m.halves().filter(|&h| m.ends(h) == [1, 2].map(Vert::new));
    let points: Vec<DVec3> = halves.map(|h| stencils.place(h).point).collect();
    assert_eq!((points.len(), points[0], points[1]), (3, points[1], points[2]));
    assert_eq!(place(&m, &[], [0, 1]).rule, Rule::R6);
    // A border that ends on the line does not turn into it.
    assert_eq!(place(&m, &[], [0, 4]).rule, Rule::R6);
}

/// A cone of `n` triangles round vertex 0.
fn cone(n: usize, is_closed: bool) -> Mesh {
    let rim =
        |i: usize| dvec2((0.1 * i as f64).cos() + 2.0, (0.2 * i as f64).sin()).extend(i as f64 / n as f64);
    let points: Vec<[f64; 3]> = [[0.; 3]].into_iter().chain((0..=n).map(|i| rim(i).to_array())).collect();
    let spoke = |i: usize| if is_closed { 1 + i % n } else { 1 + i };
    let faces: Vec<[usize; 3]> = (0..n).map(|i| [0, spoke(i), spoke(i + 1)]).collect();
    mesh(&points, &faces)
}

#[test]
fn wide_ends_follow_the_same_rules_as_narrow_ones() {
    // What is summed beforehand is the same as what a walk gives, at once below and above the limit.
    for (n, is_closed, sharp) in [
        (sector::WIDE, true, vec![]),
        (sector::WIDE + 1, true, vec![]),
        (sector::WIDE + 1, false, vec![]),
        (2 * sector::WIDE, true, vec![[0, 5]]),
        (2 * sector::WIDE, true, vec![[0, 5], [0, 90]]),
        (4 * sector::WIDE, false, vec![[0, 100]]),
    ] {
        let m = cone(n, is_closed);
        let stencils = Stencils::new(&m, &tags(&sharp));
        let blank = Stencils::bare(&m, stencils.is_cut.clone());
        assert_eq!(stencils.wide.is_empty(), n == sector::WIDE);
        for h in m.edges() {
            let (known, walked) = (stencils.place(h), blank.place(h));
            assert_eq!(known.rule, walked.rule, "{h:?} of {n}");
            assert_relative_eq!(known.point.distance(walked.point), 0.0, epsilon = 1e-12);
            for (a, b) in known.expected.into_iter().zip(walked.expected) {
                assert_relative_eq!(a.distance(b), 0.0, epsilon = 1e-12);
            }
        }
    }
}

#[test]
fn very_many_triangles_at_one_vertex_cost_no_square() {
    // Walked for each edge, this would be a thousand million steps each time.
    let n = 30_000;
    for (is_closed, every) in [(true, usize::MAX), (true, 1000), (false, 2)] {
        let m = cone(n, is_closed);
        let sharp: Vec<_> =
            (1..=n).filter(|spoke| spoke.is_multiple_of(every)).map(|spoke| [0, spoke]).collect();
        let stencils = Stencils::new(&m, &tags(&sharp));
        assert!(m.edges().all(|h| stencils.place(h).point.is_finite()));
    }
}

#[test]
fn normals_expect_a_parabola_on_a_sphere_from_both_ends() {
    // A chord of a circle of radius 5, seen from the normals at its ends.
    let (n, m) = (DVec3::new(-0.28, 0., 0.96), DVec3::new(0.28, 0., 0.96));
    let [a, b] = expected_by_normals(5.0 * (m - n), n, m);
    assert_relative_eq!(a.distance(b), 0.0, epsilon = 1e-15);
    // The tangents meet at height 1.4 · 0.28 / 0.96 above the chord; the parabola reaches half of it.
    assert_relative_eq!(a.z, 0.5 * 1.4 * 0.28 / 0.96, epsilon = 1e-12);
    // Waves: the ends expect opposite things. No normal expects nothing.
    let [a, b] = expected_by_normals(DVec3::X, n, n);
    assert_relative_eq!((a + b).length(), 0.0, epsilon = 1e-15);
    assert!(a.length() > 0.05);
    assert_eq!(expected_by_normals(DVec3::X, DVec3::ZERO, DVec3::ZERO), [DVec3::ZERO; 2]);
}

#[test]
fn a_normal_that_lies_flat_expects_no_more_than_one_of_78_degrees() {
    let (sine, cosine) = 80f64.to_radians().sin_cos();
    let [a, b] = expected_by_normals(DVec3::X, DVec3::new(-sine, 0., cosine), DVec3::new(sine, 0., cosine));
    assert_relative_eq!(a.distance(0.25 * sine / 0.2 * DVec3::Z), 0.0, epsilon = 1e-12);
    assert_relative_eq!(a.distance(b), 0.0, epsilon = 1e-12);
}

#[test]
fn a_curve_has_a_corner_where_it_turns_by_more_than_60_degrees() {
    let turned = |degrees: f64| 0.3 * DVec2::from_angle(degrees.to_radians()).extend(0.0);
    assert_eq!(
        [-61.0, -59.0, 59.0, 61.0].map(|d| is_smooth_turn(2.0 * DVec3::X, turned(d))),
        [false, true, true, false]
    );
}

#[test]
fn the_ends_of_an_edge_on_a_curve_expect_what_its_sides_turn_aside() {
    // From a diagonal of the lattice into a row, and straight on or up a column.
    let m = lattice(false, |_, _| 0.0);
    let edge = [at(3, 4), at(4, 4)];
    let along = |last| chain(&[at(2, 3), at(3, 4), at(4, 4), last]);
    let smooth = place(&m, &along(at(5, 4)), edge);
    assert!([DVec3::Y / 8.0, DVec3::ZERO].iter().all(|way| smooth.expected.contains(way)));
    assert_eq!(place(&m, &along(at(4, 5)), edge).expected, [DVec3::ZERO; 2], "a corner at one end");
    // On a circle both expect where the new vertex goes.
    let circle = |i: u32| DVec2::from_angle(TAU * f64::from(i) / 8.0).extend(0.0).to_array();
    let points: Vec<[f64; 3]> = (0..8).map(circle).chain([[0.; 3]]).collect();
    let m = mesh(&points, &(0..8).map(|i| [i, (i + 1) % 8, 8]).collect::<Vec<_>>());
    let Proposal { point, expected, .. } = place(&m, &[], [2, 3]);
    let shift = point - (m.point(Vert::new(2)) + m.point(Vert::new(3))) / 2.0;
    assert!(expected.iter().all(|way| way.distance(shift) < 1e-12) && shift.length() > 0.01);
}

#[test]
fn both_half_edges_of_an_edge_say_the_same() {
    let m = lattice(false, |x, y| 0.2 * (1.3 * x).sin() - 0.1 * (x * y).cos());
    let stencils = Stencils::new(&m, &tags(&chain(&[at(2, 3), at(3, 4), at(4, 4)])));
    let twins = m.halves().filter_map(|h| Some((h, m.twin(h)?)));
    let n = twins.inspect(|&(h, twin)| assert_eq!(stencils.place(h), stencils.place(twin))).count();
    assert!(n > 300);
}

#[test]
fn surfaces_that_touch_in_a_vertex_do_not_count_as_one() {
    // Two tetrahedra with a common corner: three triangles there each, not a regular end of six.
    let points =
        [[0.; 3], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.], [-1., 0., 0.], [0., -1., 0.], [0., 0., -1.]];
    let one = |[a, b, c]: [usize; 3]| [[0, b, a], [0, c, b], [0, a, c], [a, b, c]];
    let m = mesh(&points, &[one([1, 2, 3]), one([4, 6, 5])].concat());
    let expected = [(0, 1.0 / 3.0), (1, 1.0 / 3.0), (2, 1.0 / 6.0), (3, 1.0 / 6.0)];
    let alone = mesh(&points, &one([1, 2, 3]));
    let both = weights(&m, &[], [0, 1]);
    assert_eq!(both.0, Rule::Mean);
    assert_eq!(both, weights(&alone, &[], [0, 1]), "{expected:?}");
    let of = |m: &Mesh| place(m, &[], [0, 1]).expected;
    assert_eq!(of(&m), of(&alone));
}

#[test]
fn faces_without_area_have_no_say_in_a_normal() {
    // A flat fan of four in which one triangle has two corners in the same place.
    let points = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 1., 0.], [-1., -1., 0.]];
    let m = mesh(&points, &[[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]]);
    let stencils = Stencils::new(&m, &Tags::default());
    let sector = stencils.sector(Face::new(0).half(0));
    assert_eq!(stencils.normal(sector), DVec3::Z);
    // Nor have those that have a corner where the end is.
    let mut points = points;
    points[3] = points[0];
    let m = mesh(&points, &[[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]]);
    let stencils = Stencils::new(&m, &Tags::default());
    assert_eq!(stencils.normal(stencils.sector(Face::new(0).half(0))), DVec3::Z);
}
