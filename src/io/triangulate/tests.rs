use super::*;
use glam::dvec3;
use proptest::prelude::*;

fn cut(corners: &[DVec3]) -> Vec<[u32; 3]> {
    let mut triangles = Vec::new();
    triangulate(corners, &mut triangles);
    triangles
}

fn flat(corners: &[[f64; 2]]) -> Vec<DVec3> {
    corners.iter().map(|&[x, y]| dvec3(x, y, 0.0)).collect()
}

fn area(corners: &[DVec3], [a, b, c]: [u32; 3]) -> DVec3 {
    let [a, b, c] = [a, b, c].map(|i| corners[i as usize]);
    0.5 * (b - a).cross(c - a)
}

/// All triangles turn the same way and their areas add up: the cut is inside, without overlap.
fn assert_sound(corners: &[DVec3], triangles: &[[u32; 3]]) {
    assert_eq!(triangles.len(), corners.len() - 2);
    let whole: DVec3 = (1..corners.len() as u32 - 1).map(|i| area(corners, [0, i, i + 1])).sum();
    let parts: Vec<DVec3> = triangles.iter().map(|&t| area(corners, t)).collect();
    let sum: f64 = parts.iter().map(|part| part.dot(whole.normalize())).sum();
    assert!((sum - whole.length()).abs() < 1e-9 * whole.length(), "{sum} of {whole}");
    for (part, triangle) in parts.iter().zip(triangles) {
        assert!(part.dot(whole) >= -1e-12 * whole.length_squared(), "{triangle:?} is turned over");
    }
    assert_edges(corners.len() as u32, triangles);
}

/// Every side of the polygon is a side of exactly one triangle, every other side of exactly two.
fn assert_edges(n: u32, triangles: &[[u32; 3]]) {
    let mut sides: Vec<(u32, u32)> =
        triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]).collect();
    sides.sort_unstable();
    let is_side = |a: u32, b: u32| sides.binary_search(&(a, b)).is_ok();
    assert!(sides.windows(2).all(|pair| pair[0] != pair[1]), "a side comes twice");
    assert!((0..n).all(|i| is_side(i, (i + 1) % n)), "a side of the polygon is lost");
    for &(a, b) in &sides {
        assert!(is_side(b, a) != ((a + 1) % n == b), "the side {a}-{b} does not fit");
    }
}

// 3---2      A square keeps the diagonal from its first corner; a longer one goes.
// | / |
// 0---1
#[test]
fn a_quadrilateral_is_cut_by_its_shorter_diagonal() {
    assert_eq!(cut(&flat(&[[0., 0.], [1., 0.], [1., 1.], [0., 1.]])), [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(cut(&flat(&[[0., 0.], [1., 0.], [3., 2.], [0., 1.]])), [[0, 1, 3], [1, 2, 3]]);
}

//     2          The shorter diagonal 1-3 is outside.
//   / 3 \
//  0     1   as an arrow head: 0 3 1 2 in this order
#[test]
fn an_arrow_head_is_cut_inside() {
    let arrow = flat(&[[-4., 0.], [0., 3.], [4., 0.], [0., 4.]]);
    assert_eq!(cut(&arrow), [[0, 1, 3], [1, 2, 3]]);
    let turned = flat(&[[0., 3.], [4., 0.], [0., 4.], [-4., 0.]]);
    assert_eq!(cut(&turned), [[0, 1, 2], [0, 2, 3]]);
}

#[test]
fn a_flat_corner_of_a_quadrilateral_gets_no_flat_triangle() {
    // The diagonal 0-2 is the shorter one but passes through corner 1.
    let corners = flat(&[[0., 0.], [1., 0.], [2., 0.], [1., 9.]]);
    assert_eq!(cut(&corners), [[0, 1, 3], [1, 2, 3]]);
}

// A comb of three teeth, standing, lying, seen from behind.
#[test]
fn a_comb_is_cut_inside_in_any_plane() {
    let comb =
        [[0., 0.], [7., 0.], [7., 5.], [6., 5.], [5., 1.], [4., 1.], [3., 5.], [2., 1.], [1., 1.], [0., 5.]];
    let maps: [fn([f64; 2]) -> DVec3; 6] = [
        |[x, y]| dvec3(x, y, 0.),
        |[x, y]| dvec3(y, x, 3.),
        |[x, y]| dvec3(0., x, y),
        |[x, y]| dvec3(9., y, x),
        |[x, y]| dvec3(y, 0., x),
        |[x, y]| dvec3(x, x + y, 2. * y),
    ];
    for map in maps {
        let corners = comb.map(map);
        assert_sound(&corners, &cut(&corners));
    }
}

#[test]
fn flat_corners_are_kept() {
    // A square with two more corners on each side.
    let corners: Vec<DVec3> = (0..12)
        .map(|i| {
            let t = f64::from(i % 3) / 3.0;
            [dvec3(t, 0., 0.), dvec3(1., t, 0.), dvec3(1. - t, 1., 0.), dvec3(0., 1. - t, 0.)][i as usize / 3]
        })
        .collect();
    let triangles = cut(&corners);
    assert_sound(&corners, &triangles);
    assert!(triangles.iter().all(|&t| area(&corners, t).length() > 1e-3), "a flat triangle");
}

// 3-----------2
// |   6---5   |    The hole is joined to the rim by a cut from 0 to 4 and back (7 = 4, 8 = 0).
// |   |   |   |
// |   .---.   |
// 0-----------1
#[test]
fn a_hole_on_a_cut_stays_open() {
    let corners = flat(&[
        [0., 0.],
        [9., 0.],
        [9., 9.],
        [0., 9.],
        [0., 0.],
        [3., 3.],
        [3., 6.],
        [6., 6.],
        [6., 3.],
        [3., 3.],
    ]);
    assert_sound(&corners, &cut(&corners));
}

#[test]
fn degenerate_polygons_lose_no_triangle() {
    let cases = [
        vec![DVec3::ZERO; 7],
        (0..9).map(|i| dvec3(f64::from(i), 0., 0.)).collect(),
        flat(&[[0., 0.], [2., 2.], [2., 0.], [0., 2.], [1., 5.]]),
        flat(&[[0., 0.], [1., 0.], [0., 0.], [1., 0.], [0., 1.]]),
        vec![
            dvec3(1e300, 0., 0.),
            dvec3(0., 1e300, 0.),
            dvec3(-1e300, 0., 0.),
            dvec3(0., -1e300, 0.),
            dvec3(1e-300, 2e299, 1e300),
        ],
        vec![
            dvec3(5e-324, 0., 0.),
            dvec3(0., 5e-324, 0.),
            dvec3(-5e-324, 0., 0.),
            dvec3(0., -5e-324, 0.),
            DVec3::ZERO,
        ],
    ];
    for corners in cases {
        let triangles = cut(&corners);
        assert_eq!(triangles.len(), corners.len() - 2);
        assert_edges(corners.len() as u32, &triangles);
    }
}

#[test]
fn polygons_of_many_corners_take_little_time() {
    let n = 20_000;
    let angle = |i: u32| f64::from(i) / f64::from(n) * std::f64::consts::TAU;
    let circle: Vec<DVec3> = (0..n).map(|i| dvec3(angle(i).cos(), angle(i).sin(), 0.)).collect();
    let star = |i: u32| if i.is_multiple_of(2) { 1.0 } else { 0.01 };
    let star: Vec<DVec3> = (0..n).map(|i| star(i) * dvec3(angle(i).cos(), angle(i).sin(), 0.)).collect();
    let spiral: Vec<DVec3> = (0..n)
        .map(|i| {
            let (k, width) = if i < n / 2 { (i, 0.0) } else { (n - 1 - i, 0.4) };
            let t = f64::from(k) / f64::from(n) * 120.0;
            (1.0 + t + width) * dvec3(t.cos(), t.sin(), 0.)
        })
        .collect();
    let start = std::time::Instant::now();
    for corners in [circle, star, spiral] {
        assert_sound(&corners, &cut(&corners));
    }
    // Milliseconds in release; the bound only tells n log n from n^2.
    assert!(start.elapsed().as_secs() < 20, "{:?}", start.elapsed());
}

proptest! {
    #[test]
    fn star_shaped_polygons_are_cut_inside(radii in proptest::collection::vec(0.01..1.0f64, 5..80)) {
        let n = radii.len() as f64;
        let corners: Vec<DVec3> = radii.iter().enumerate().map(|(i, r)| {
            let angle = i as f64 / n * std::f64::consts::TAU;
            *r * dvec3(angle.cos(), angle.sin(), angle.cos() - 0.5 * angle.sin())
        }).collect();
        assert_sound(&corners, &cut(&corners));
    }

    #[test]
    fn any_polygon_gives_two_triangles_less_than_corners(
        corners in proptest::collection::vec((0..5i8, 0..5i8, 0..2i8), 3..40)
    ) {
        let corners: Vec<DVec3> =
            corners.iter().map(|&(x, y, z)| dvec3(x.into(), y.into(), z.into())).collect();
        let triangles = cut(&corners);
        assert_eq!(triangles.len(), corners.len() - 2);
        assert_edges(corners.len() as u32, &triangles);
    }
}
