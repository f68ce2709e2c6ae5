use super::*;
use crate::mesh::tests::mesh;
use approx::assert_relative_eq;
use std::f64::consts::FRAC_PI_4;

fn labels(mesh: &Mesh, threshold: SmoothThreshold, border_is_smooth: bool) -> Labels {
    classify(mesh, &mesh.face_normals(), &ClassifyOptions { threshold, border_is_smooth, folds_count: true })
}

fn flagged<I>(flags: &crate::mesh::PerElement<I, bool>) -> Vec<usize> {
    (0..flags.len()).filter(|&i| flags.as_slice()[i]).collect()
}

/// Two flat sheets, at z = 0 and x = 4, joined by a chamfer strip from x = 3 to z = -1.
///
/// ```text
///   x = 0   1   2   3  \ 4
///   y
///   3   3---7--11--15--19--23--27--31     column c, row r: vertex 4c + r
///   2   2---6--10--14--18--22--26--30
///   1   1---5---9--13--17--21--25--29
///   0   0---4---8--12--16--20--24--28
/// ```
fn chamfered_sheet() -> Mesh {
    let profile = [(0., 0.), (1., 0.), (2., 0.), (3., 0.), (4., -1.), (4., -2.), (4., -3.), (4., -4.)];
    let mut points = Vec::new();
    for (x, z) in profile {
        points.extend((0..4).map(|row| [x, f64::from(row), z]));
    }
    let mut faces = Vec::new();
    for column in 0..7 {
        for row in 0..3 {
            let a = 4 * column + row;
            faces.extend([[a, a + 4, a + 5], [a, a + 5, a + 1]]);
        }
    }
    mesh(&points, &faces)
}

#[test]
fn the_threshold_is_a_multiple_of_the_mean_angle() {
    let m = chamfered_sheet();
    let l = labels(&m, SmoothThreshold::MeanTimes(2.0), true);
    let inner = m.edges().filter(|&h| !m.is_border(h)).count();
    // Two lines of three edges bend by 45 degrees each, all others by nothing.
    assert_relative_eq!(l.threshold, 2.0 * 6.0 * FRAC_PI_4 / inner as f64, max_relative = 1e-12);
    assert_eq!(m.edges().filter(|&h| l.smooth_edge[h]).count(), inner - 6);
    assert_eq!(labels(&m, SmoothThreshold::Angle(0.5), true).threshold, 0.5);
}

#[test]
fn a_chamfer_strip_turns_blue_between_two_red_sheets() {
    let m = chamfered_sheet();
    let l = labels(&m, SmoothThreshold::MeanTimes(2.0), true);
    // Filter 1: all vertices but those of the two bent lines, columns 3 and 4.
    assert_eq!(
        flagged(&l.interior_vertex),
        [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 20, 21, 22, 23, 24, 25, 26, 27, 28, 29, 30, 31]
    );
    // Filters 2 and 3: all faces but the six of the strip, faces 18 to 23.
    assert_eq!(flagged(&l.red_face), (0..18).chain(24..42).collect::<Vec<_>>());
    assert_eq!(l.core_face, l.red_face);
    // Filter 4 adds the lines. Filter 5: what joins them, but for the two border edges.
    assert!(l.red_vertex.as_slice().iter().all(|&red| red));
    let mut blue: Vec<_> = m
        .edges()
        .filter(|&h| l.chamfer_edge[h])
        .map(|h| [m.from(h).index().min(m.to(h).index()), m.from(h).index().max(m.to(h).index())])
        .collect();
    blue.sort_unstable();
    assert_eq!(blue, [[12, 17], [13, 17], [13, 18], [14, 18], [14, 19]]);
    assert!(l.corner_faces.is_empty());
    assert!(l.tagged_vertex.as_slice().iter().all(|&tag| !tag));
}

#[test]
fn steps_rise_with_the_chord_and_tell_an_eighth_from_the_next() {
    let chords: Vec<f64> =
        (0..4000).map(|i| 1e-9 * 1.006f64.powi(i)).take_while(|&chord| chord <= 4.0).collect();
    assert!(chords.is_sorted_by_key(|&chord| step_of(chord)));
    assert!((1..8).all(|i| step_of(0.01 * 1.125f64.powi(i)) > step_of(0.01 * 1.125f64.powi(i - 1))));
    assert!(step_of(4.0) < NO_ANGLE - 1 && step_of(f64::INFINITY) < NO_ANGLE);
    assert_eq!((step_of(0.0), step_of(1e-9)), (0, 0));
}

#[test]
fn strictly_no_border_vertex_is_interior() {
    let m = chamfered_sheet();
    let l = labels(&m, SmoothThreshold::MeanTimes(2.0), false);
    assert_eq!(flagged(&l.interior_vertex), [5, 6, 9, 10, 21, 22, 25, 26]);
}

#[test]
fn an_edge_that_is_sharp_already_is_found_by_3bis() {
    // The same sheet without the strip: its two sides meet in column 3 at a right angle.
    let m = chamfered_sheet();
    let (mut points, faces) = m.into_parts();
    for p in &mut points[16..] {
        p.x -= 1.0;
    }
    let m = Mesh::new(points, faces).unwrap();
    let l = labels(&m, SmoothThreshold::Angle(0.5), true);
    assert_eq!(flagged(&l.tagged_vertex), [12, 13, 14, 15]);
    assert_eq!(m.edges().filter(|&h| l.sharp_edge[h]).count(), 3);
    assert!(flagged(&l.chamfer_edge).is_empty());
}

// Face 0 in the middle, one neighbour across each of its edges, one red face at each of its corners.
#[test]
fn a_triangle_with_three_blue_edges_turns_green() {
    let points: Vec<_> = (0..9).map(|i| [f64::from(i), f64::from(i * i), f64::from(i % 4)]).collect();
    let faces = [[0, 1, 2], [1, 0, 3], [2, 1, 4], [0, 2, 5], [0, 6, 3], [1, 7, 4], [2, 8, 5]];
    let m = mesh(&points, &faces);
    let last_filters = |l: &mut Labels| {
        let gray = gray_faces(&m, &l.red_face);
        filter_4_border_of_smooth_region(&m, &gray, l);
        filter_5_chamfer_edges(&m, &gray, l);
        filter_6_corner_triangles(&gray, l);
    };
    let mut l = Labels {
        interior_vertex: PerVert::filled(9, false),
        red_face: [false, false, false, false, true, true, true].to_vec().into(),
        ..Labels::default()
    };
    last_filters(&mut l);
    assert_eq!(m.edges().filter(|&h| l.chamfer_edge[h]).map(Half::index).collect::<Vec<_>>(), [0, 1, 2]);
    assert_eq!(l.corner_faces, [Face::new(0)]);
    l.red_face[Face::new(4)] = false;
    last_filters(&mut l);
    assert_eq!(m.edges().filter(|&h| l.chamfer_edge[h]).map(Half::index).collect::<Vec<_>>(), [1]);
    assert!(l.corner_faces.is_empty());
}

#[test]
fn red_groups_are_counted_over_all_fans_of_a_vertex() {
    // Two closed fans of three faces touch in vertex 0 (bow-tie).
    let points: Vec<_> = (0..7).map(|i| [f64::from(i), f64::from(i * i), f64::from(i % 3)]).collect();
    let m = mesh(&points, &[[0, 1, 2], [0, 2, 3], [0, 3, 1], [0, 4, 5], [0, 5, 6], [0, 6, 4]]);
    let groups = |red: [bool; 6]| has_two_red_groups(&m, &red.to_vec().into(), Vert::new(0));
    assert!(groups([true; 6]), "both fans whole");
    assert!(!groups([true, true, true, false, false, false]), "one fan whole");
    assert!(groups([true, true, true, true, false, false]), "one whole, one in part");
    assert!(groups([true, false, true, false, true, false]), "a part of each");
    assert!(!groups([true, false, true, false, false, false]), "one group across the start");
    assert!(!groups([false; 6]), "none");
}

#[test]
fn a_face_without_area_has_no_smooth_edge() {
    let m = mesh(&[[0.; 3], [1., 0., 0.], [2., 0., 0.], [1., -1., 0.]], &[[0, 1, 2], [1, 0, 3]]);
    let l = labels(&m, SmoothThreshold::Angle(1.0), true);
    assert!(flagged(&l.smooth_edge).is_empty());
    assert_eq!(labels(&m, SmoothThreshold::MeanTimes(2.0), true).threshold, 0.0);
}
