use super::*;
use crate::mesh::Mesh;
use crate::mesh::tests::mesh;
use crate::regions::tests::labels;
use crate::regions::{RegionLabels, label_by_fits, place_by_fits, verdict};
use approx::assert_relative_eq;
use glam::dvec3;

const N: usize = 20;

/// The graph of `height` over a grid of N x N squares of length 1 whose middle is near the origin.
fn graph(height: impl Fn(f64, f64) -> f64) -> Mesh {
    let points: Vec<[f64; 3]> = (0..(N + 1) * (N + 1))
        .map(|k| [(k / (N + 1)) as f64 - 9.7, (k % (N + 1)) as f64 - 10.4])
        .map(|[x, y]| [x, y, height(x, y)])
        .collect();
    let square = |k: usize| {
        let [i, j] = [k / N, k % N];
        let [a, b, c, d] = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]].map(|[i, j]| i * (N + 1) + j);
        [[a, b, c], [a, c, d]]
    };
    mesh(&points, &(0..N * N).flat_map(square).collect::<Vec<_>>())
}

/// Between -1 and 1, and no pattern that a cone has.
fn noise(x: f64, y: f64) -> f64 {
    (78.233 * x + 12.9898 * y).sin()
}

fn run(m: &Mesh) -> RegionLabels {
    let (normals, labels) = labels(m);
    label_by_fits(m, &normals, &labels, 0.0)
}

#[test]
fn a_cone_gets_its_apex_back_and_nothing_else_moves() {
    for slope in [0.5, 1.0, 1.5, -1.0] {
        let m = graph(|x, y| 3.0 - slope * x.hypot(y));
        let found = run(&m);
        let [apex] = &found.apexes[..] else { panic!("{slope}: {:?}", found.apexes) };
        assert!(apex.point.distance(dvec3(0.0, 0.0, 3.0)) < 1e-9, "{slope}: {}", apex.point);
        assert!(apex.rms < 1e-9 && apex.n_samples > 20);
        // The nearest sample is that at (.3, -.4).
        assert_eq!(m.point(apex.vertex).truncate(), glam::dvec2(10.0 - 9.7, 10.0 - 10.4));
        assert_eq!(found.moved, [(apex.vertex, apex.point)]);
        assert!(found.chamfers.is_empty());
        let placement = place_by_fits(&m, &found, None);
        assert_eq!(placement.inserts.moved, found.moved);
        let corners = verdict(&m, &found, &placement).corners;
        let support: Vec<_> = corners.iter().map(|c| (c.at, c.edges, c.least_samples, c.placed)).collect();
        assert_eq!(support, [(apex.point.to_array(), 0, apex.n_samples, 1.0)]);
    }
}

#[test]
fn a_tip_that_is_there_is_found_and_nothing_changes() {
    for lower in [0.0, 0.0005] {
        let tip = |r: f64| if r == 0.0 { lower } else { 0.0 };
        let m = graph(|x, y| {
            let r = (x - (10.0 - 9.7)).hypot(y - (10.0 - 10.4));
            3.0 - r - tip(r)
        });
        let sharpened = crate::sharpen(&m, &crate::Options::default()).unwrap();
        assert_eq!((sharpened.report.found.apexes, sharpened.report.changed), (1, false));
        assert_eq!((sharpened.mesh.points(), sharpened.mesh.faces()), (m.points(), m.faces()));
        assert_eq!(sharpened.tags.tagged().len(), 1);
    }
}

#[test]
fn what_only_looks_like_a_cone_is_left_alone() {
    let none = |what: &str, height: &dyn Fn(f64, f64) -> f64| {
        let m = graph(height);
        let (normals, labels) = labels(&m);
        let surface = Surface::new(&m, &normals, &labels);
        let is_end = vec![false; surface.near.verts.len()];
        assert!(!candidates(&surface, &is_end).is_empty(), "{what}: nothing was looked at");
        assert!(run(&m).apexes.is_empty(), "{what}");
    };
    none("a hyperboloid", &|x, y| -(x * x + y * y + 0.2).sqrt());
    none("a cone with a ball of one and a half edges as its tip", &|x, y| {
        let r = x.hypot(y);
        let round: f64 = 1.5;
        if r < round / 2f64.sqrt() { (round * round - r * r).sqrt() - 2f64.sqrt() * round } else { -r }
    });
    none("a cone cut off flat", &|x, y| -x.hypot(y).max(1.0));
    none("a pyramid of four sides", &|x, y| -x.abs().max(y.abs()));
    none("a cone of an ellipse", &|x, y| -(x.hypot(1.4 * y)));
    none("a horn", &|x, y| -3.0 * x.hypot(y).powf(0.8));
    none("noise on a cone", &|x, y| 0.1 * noise(x, y) - x.hypot(y));
}

#[test]
fn a_little_noise_hides_no_apex() {
    let m = graph(|x, y| 0.01 * noise(x, y) - x.hypot(y));
    let [apex] = &run(&m).apexes[..] else { panic!("none") };
    assert!(apex.point.length() < 0.05, "{}", apex.point);
    assert_relative_eq!(apex.rms, 0.01 / 2f64.sqrt() / 2f64.sqrt() / run(&m).mean_edge, max_relative = 0.5);
}

#[test]
fn samples_of_the_tip_that_are_off_the_cone_move_onto_it() {
    // Marching cubes put the sample at (.3, .6) lower than the cone.
    let low = |x: f64, y: f64| if (x - 0.3).hypot(y - 0.6) < 1e-6 { 0.12 } else { 0.0 };
    let m = graph(|x, y| 0.015 * noise(x, y) - low(x, y) - x.hypot(y));
    let found = run(&m);
    let [apex] = &found.apexes[..] else { panic!("none") };
    let [other] = &found.moved.iter().filter(|moved| moved.0 != apex.vertex).collect::<Vec<_>>()[..] else {
        panic!("{:?}", found.moved)
    };
    let was = m.point(other.0);
    assert_eq!(low(was.x, was.y), 0.12);
    let off = |p: DVec3| ((p - apex.point).truncate().length() + (p - apex.point).z).abs();
    assert!(off(was) > 0.1 && off(other.1) < 0.02, "{} {}", off(was), off(other.1));
}

#[test]
fn chamfers_on_the_cone_go_and_one_that_leads_away_is_believed() {
    let m = graph(|x, y| -x.hypot(y));
    let (normals, labels) = labels(&m);
    let surface = Surface::new(&m, &normals, &labels);
    let middle = (0..m.n_verts()).map(Vert::new).find(|&v| m.point(v).truncate().length() < 0.51).unwrap();
    // The edges across from the vertex next to the apex.
    let mut chamfers: Vec<Half> = m.leaving(middle).iter().map(|h| m.edge(h.next())).collect();
    chamfers.sort_unstable();
    let apexes = find(&surface, &chamfers);
    assert_eq!(apexes[0].edges, chamfers);
    // A strip of all candidates, of which two are not on the cone.
    let far = [m.edge(Half::new(0)), m.edge(Half::new(1))];
    let mut candidates = [&chamfers[..], &far].concat();
    candidates.sort_unstable();
    let strip = Strip {
        n_edges: candidates.len(),
        displacement: 0.0,
        rms: 0.0,
        inward: 0.0,
        n_inward: 0,
        guessed: 0.0,
        fate: Fate::Kept,
    };
    let (mut strip_of, mut strips) = (vec![0; candidates.len()], vec![strip]);
    cancel_edges(&apexes, &candidates, &mut strip_of, &mut strips);
    assert_eq!(crate::regions::kept(&candidates, &strip_of, &strips), far);
    let fates: Vec<_> = strips.iter().map(|strip| (strip.n_edges, strip.fate)).collect();
    assert_eq!(fates, [(2, Fate::Kept), (chamfers.len(), Fate::Cone)]);
    // Seven edges from a neighbour on lead out of the patch.
    let along = |h: &&Half| m.point(m.to(**h)).y == m.point(middle).y;
    let mut line = vec![m.to(*m.leaving(middle).iter().find(along).unwrap())];
    while line.len() < 8 {
        let next = |h: &&Half| along(h) && m.to(**h) != middle && !line.contains(&m.to(**h));
        line.push(m.to(*m.leaving(line[line.len() - 1]).iter().find(next).unwrap()));
    }
    let edge = |pair: &[Vert]| m.edge(m.half_between(pair[0], pair[1]).unwrap());
    let mut crease: Vec<Half> = line.windows(2).map(edge).collect();
    crease.sort_unstable();
    assert_eq!(find(&surface, &crease), []);
}

#[test]
fn moves_of_an_apex_come_before_others() {
    let at = |v: usize, x: f64| (Vert::new(v), DVec3::splat(x));
    let apex = |moved| Apex {
        vertex: Vert::new(5),
        point: DVec3::ZERO,
        n_samples: 0,
        rms: 0.0,
        cone: Cone { apex: DVec3::ZERO, down: DVec3::Z, angle: 0.5 },
        is_convex: true,
        moved,
        edges: Vec::new(),
    };
    let mut moved = vec![at(1, 1.0), at(5, 2.0), at(9, 3.0)];
    add_moves(&[apex(vec![at(5, 0.0), at(7, 0.5)])], &mut moved);
    assert_eq!(moved, [at(1, 1.0), at(5, 0.0), at(7, 0.5), at(9, 3.0)]);
}
