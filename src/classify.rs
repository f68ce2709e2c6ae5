//! Finds the chamfers: the smooth-edge threshold, the six filters and filter 3bis.
//!
//! ```text
//!   red region          chamfer strip          red region
//!   (smooth)         r---b---r---b---r         (smooth)
//!                    |  /|  /|  /|  /|         r  red vertex (filter 4)
//!                    b / b / b / b / b         b  blue edge, joins two red vertices (filter 5)
//!                    r---b---r---b---r
//! ```
//!
//! Based on: EdgeSharpener section 3; Sharpen&Bend sections 3.1 and 4.1 (filter 3bis).
//! Differs: by default a border edge counts as smooth for filter 1, so that open scans have regions at
//! their borders (Paper silent; strictly, filter 1 never fires there). For region fits, what bends evenly and little
//! is smooth, however low the threshold.
//! In/out: `Mesh` + face normals `[F]` -> `Labels`.
//! Cost: O(F); the angles are computed once, in parallel, those at vertices that are not interior once more for region
//! fits with a low threshold.

mod calm;

use std::cmp::Ordering;
use std::f64::consts::PI;
use std::sync::atomic::AtomicU8;
use std::sync::atomic::Ordering::Relaxed;

use glam::DVec3;
use rayon::prelude::*;

use crate::geometry::{angle_between, angle_between_units, angle_of_chord};
use crate::mesh::{Face, Half, Mesh, PerFace, PerHalf, PerVert, Vert};

pub(crate) use calm::CALM_ANGLE;

/// Which edges count as smooth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SmoothThreshold {
    /// Those with less than this many times the mean dihedral angle of the mesh. The papers take 2;
    /// measured, 1.5 and 2 are equal within 5 % and everything else is worse.
    MeanTimes(f64),
    /// Those with less than this dihedral angle, in radians.
    Angle(f64),
}

/// What the filters need to know besides the mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClassifyOptions {
    /// Which edges count as smooth.
    pub threshold: SmoothThreshold,
    /// Whether filter 1 passes over border edges.
    pub border_is_smooth: bool,
}

/// The colours of the papers, one flag per element. Edge flags are the same on both half-edges.
#[derive(Clone, Debug, Default)]
pub struct Labels {
    /// Edges with a smaller dihedral angle are smooth, in radians.
    pub threshold: f64,
    /// Brown: smooth edges. `[3F]`
    pub smooth_edge: PerHalf<bool>,
    /// Red after filter 1: vertices in the interior of a smooth region. `[V]`
    pub interior_vertex: PerVert<bool>,
    /// Red after filter 2: faces in the core of a smooth region. `[F]`
    pub core_face: PerFace<bool>,
    /// Red after filter 3: faces of a smooth region. `[F]`
    pub red_face: PerFace<bool>,
    /// Tagged by filter 3bis: vertices on a sharp edge that the sampling did not cut off. `[V]`
    pub tagged_vertex: PerVert<bool>,
    /// Found by filter 3bis: old edges that are sharp already. `[3F]`
    pub sharp_edge: PerHalf<bool>,
    /// Red after filter 4: edges of red faces. `[3F]`
    pub red_edge: PerHalf<bool>,
    /// Red after filter 4: vertices of red faces. `[V]`
    pub red_vertex: PerVert<bool>,
    /// Blue: chamfer edges. `[3F]`
    pub chamfer_edge: PerHalf<bool>,
    /// Green: corner triangles, ascending.
    pub corner_faces: Vec<Face>,
    /// Edges that look like chamfers and were left alone, ascending: by region fits only.
    pub abstained: Vec<Half>,
    /// Edges that nothing can be said of, ascending: by region fits only.
    pub beyond_reach: Vec<Half>,
}

/// Colours `mesh`, whose face normals (unit, zero where there is none) are `normals` `[F]`.
#[must_use]
pub fn classify(mesh: &Mesh, normals: &PerFace<DVec3>, options: &ClassifyOptions) -> Labels {
    let mut labels = smooth_edges_and_filter_1(mesh, normals, options);
    filter_2_core_of_smooth_region(mesh, &mut labels);
    filter_3_flood_over_smooth_edges(mesh, &mut labels);
    filter_3bis_edges_that_are_sharp_already(mesh, &mut labels);
    let gray = gray_faces(mesh, &labels.red_face);
    filter_4_border_of_smooth_region(mesh, &gray, &mut labels);
    filter_5_chamfer_edges(mesh, &gray, &mut labels);
    filter_6_corner_triangles(&gray, &mut labels);
    labels
}

/// The smooth edges and filter 1 alone, with the interior of surfaces that bend evenly: all that region fits start
/// from. The other colours stay empty.
#[must_use]
pub fn classify_interior(mesh: &Mesh, normals: &PerFace<DVec3>, options: &ClassifyOptions) -> Labels {
    let mut labels = smooth_edges_and_filter_1(mesh, normals, options);
    // A threshold that the caller chose is what it is.
    if matches!(options.threshold, SmoothThreshold::MeanTimes(_)) {
        calm::add_calm_vertices(mesh, normals, &mut labels);
    }
    labels
}

fn smooth_edges_and_filter_1(mesh: &Mesh, normals: &PerFace<DVec3>, options: &ClassifyOptions) -> Labels {
    let (threshold, smooth_edge) = smooth_edges(mesh, normals, options.threshold);
    let mut labels = Labels { threshold, smooth_edge, ..Labels::default() };
    filter_1_interior_of_smooth_region(mesh, options.border_is_smooth, &mut labels);
    labels
}

/// Faces per unit of parallel work. Sums are formed per chunk and added in order, so that the
/// threshold does not depend on the number of threads.
const CHUNK: usize = 4096;

/// The threshold in radians, and the edges below it.
///
/// The mean runs over edges with two faces that both have a normal; no other edge has an angle, and an
/// edge without an angle is never smooth.
fn smooth_edges(mesh: &Mesh, normals: &PerFace<DVec3>, threshold: SmoothThreshold) -> (f64, PerHalf<bool>) {
    let (mean, steps) = mean_angle_and_steps(mesh, normals);
    let threshold = match threshold {
        SmoothThreshold::Angle(angle) => angle,
        SmoothThreshold::MeanTimes(factor) => factor * mean,
    };
    // Chords compare as their angles do.
    let largest = if threshold <= PI { (2.0 * (0.5 * threshold).sin()).powi(2) } else { f64::INFINITY };
    let last = step_of(largest);
    let is_smooth = |(h, step): (usize, u8)| match step.cmp(&last) {
        _ if step == NO_ANGLE => false,
        Ordering::Less => true,
        Ordering::Greater => false,
        // On the same step: the chord itself tells.
        Ordering::Equal => chord_squared(mesh, normals, Half::new(h)).is_some_and(|chord| chord < largest),
    };
    let smooth: Vec<bool> = steps.into_par_iter().enumerate().map(is_smooth).collect();
    (threshold, smooth.into())
}

/// The mean dihedral angle of the edges that have one, in radians (0 where none has), and on which step the
/// square of each edge's chord is. `[3F]`
///
/// The threshold is known only after the mean. A byte for each edge is fetched faster than two normals are once
/// more.
fn mean_angle_and_steps(mesh: &Mesh, normals: &PerFace<DVec3>) -> (f64, Vec<u8>) {
    let steps: Vec<AtomicU8> =
        (0..mesh.n_halves()).into_par_iter().map(|_| AtomicU8::new(NO_ANGLE)).collect();
    let sum_of = |(i, faces): (usize, &[[Vert; 3]])| {
        let halves = (3 * CHUNK * i..3 * (CHUNK * i + faces.len())).map(Half::new);
        let (mut sum, mut n) = (0.0, 0);
        for (h, twin) in halves.filter_map(|h| Some((h, mesh.twin(h).filter(|&twin| h < twin)?))) {
            let Some(chord) = chord_squared(mesh, normals, h) else { continue };
            [h, twin].iter().for_each(|half| steps[half.index()].store(step_of(chord), Relaxed));
            sum += angle_of_chord(chord, || angle_between(normals[h.face()], normals[twin.face()]));
            n += 1;
        }
        (sum, n)
    };
    let sums: Vec<(f64, usize)> = mesh.faces().par_chunks(CHUNK).enumerate().map(sum_of).collect();
    let (sum, n) = sums.into_iter().fold((0.0, 0), |(s, n), (t, m)| (s + t, n + m));
    let steps = steps.into_iter().map(AtomicU8::into_inner).collect();
    (if n == 0 { 0.0 } else { sum / n as f64 }, steps)
}

/// The step of an edge without an angle.
const NO_ANGLE: u8 = u8::MAX;

/// Steps of an eighth of an octave, from 1e-8 (below a hundredth of a degree) to more than the 4 of a chord that
/// is as long as it can be. Of two values the lower one is never on the higher step.
fn step_of(chord_squared: f64) -> u8 {
    const FRACTION_BITS: u32 = f64::MANTISSA_DIGITS - 1 - 3;
    const LOWEST: u64 = 1e-8f64.to_bits() >> FRACTION_BITS;
    let step = (chord_squared.to_bits() >> FRACTION_BITS).saturating_sub(LOWEST);
    step.min(u64::from(NO_ANGLE) - 1) as u8
}

/// The angle between the normals of the two faces of an edge, in `[0, π]`; none on borders and at faces
/// without area.
#[inline]
#[must_use]
pub fn dihedral_angle(mesh: &Mesh, normals: &PerFace<DVec3>, h: Half) -> Option<f64> {
    normals_beside(mesh, normals, h).map(|[n, m]| angle_between_units(n, m))
}

/// The square of the distance of the normals' tips.
#[inline]
fn chord_squared(mesh: &Mesh, normals: &PerFace<DVec3>, h: Half) -> Option<f64> {
    normals_beside(mesh, normals, h).map(|[n, m]| n.distance_squared(m))
}

/// The normals of the two faces of an edge, if it has two and both have one.
#[inline]
fn normals_beside(mesh: &Mesh, normals: &PerFace<DVec3>, h: Half) -> Option<[DVec3; 2]> {
    let (n, m) = (normals[h.face()], normals[mesh.twin(h)?.face()]);
    (n != DVec3::ZERO && m != DVec3::ZERO).then_some([n, m])
}

fn per_vertex(mesh: &Mesh, value: impl Fn(Vert) -> bool + Send + Sync) -> PerVert<bool> {
    (0..mesh.n_verts()).into_par_iter().map(|v| value(Vert::new(v))).collect::<Vec<_>>().into()
}

/// Paints red each vertex whose edges are all smooth. A vertex without edges stays gray.
fn filter_1_interior_of_smooth_region(mesh: &Mesh, border_is_smooth: bool, labels: &mut Labels) {
    let smooth = &labels.smooth_edge;
    let stops = |&h: &Half| !(smooth[h] || border_is_smooth && mesh.is_border(h));
    let stops: Vec<Half> = (0..mesh.n_halves()).into_par_iter().map(Half::new).filter(stops).collect();
    labels.interior_vertex = per_vertex(mesh, |v| !mesh.leaving(v).is_empty());
    for h in stops {
        labels.interior_vertex[mesh.from(h)] = false;
        labels.interior_vertex[mesh.to(h)] = false;
    }
}

/// Paints red each face with a red vertex.
fn filter_2_core_of_smooth_region(mesh: &Mesh, labels: &mut Labels) {
    labels.core_face = core_faces(mesh, &labels.interior_vertex);
}

/// The faces with a vertex in the interior of a smooth region. `[F]`
pub(crate) fn core_faces(mesh: &Mesh, interior_vertex: &PerVert<bool>) -> PerFace<bool> {
    let is_core = |corners: &[Vert; 3]| corners.iter().any(|&v| interior_vertex[v]);
    mesh.faces().par_iter().map(is_core).collect::<Vec<_>>().into()
}

/// Paints red, again and again, each face next to a red one across a smooth edge.
fn filter_3_flood_over_smooth_edges(mesh: &Mesh, labels: &mut Labels) {
    labels.red_face = flood_over_smooth_edges(mesh, &labels.smooth_edge, labels.core_face.clone());
}

/// The faces that can be reached from those in `red` across smooth edges. By an explicit stack: a region
/// can be as large as the mesh. `[F]`
pub(crate) fn flood_over_smooth_edges(
    mesh: &Mesh,
    smooth_edge: &PerHalf<bool>,
    mut red: PerFace<bool>,
) -> PerFace<bool> {
    let beside = |f: Face| f.halves().into_iter().filter(|&h| smooth_edge[h]).filter_map(|h| mesh.twin(h));
    // Nearly all faces are red from the start: the flood begins at those that are next to become it.
    let is_next = |&f: &Face| !red[f] && beside(f).any(|twin| red[twin.face()]);
    let mut stack: Vec<Face> = (0..mesh.n_faces()).into_par_iter().map(Face::new).filter(is_next).collect();
    stack.iter().for_each(|&f| red[f] = true);
    while let Some(f) = stack.pop() {
        for g in beside(f).map(Half::face) {
            if !red[g] {
                red[g] = true;
                stack.push(g);
            }
        }
    }
    red
}

/// Tags the ends of each non-smooth edge between two red faces, and each vertex whose red faces form
/// two or more groups joined by edges.
fn filter_3bis_edges_that_are_sharp_already(mesh: &Mesh, labels: &mut Labels) {
    let Labels { smooth_edge, red_face, interior_vertex, .. } = &*labels;
    let mut tagged = per_vertex(mesh, |v| !interior_vertex[v] && has_two_red_groups(mesh, red_face, v));
    let is_red = |h: Half| red_face[h.face()];
    let is_sharp = |h: &Half| !smooth_edge[*h] && is_red(*h) && mesh.twin(*h).is_some_and(is_red);
    let mut sharp = PerHalf::filled(mesh.n_halves(), false);
    for h in (0..mesh.n_halves()).into_par_iter().map(Half::new).filter(is_sharp).collect::<Vec<_>>() {
        sharp[h] = true;
        tagged[mesh.from(h)] = true; // Its twin, sharp as well, leaves the other end.
    }
    labels.sharp_edge = sharp;
    labels.tagged_vertex = tagged;
}

/// Whether the red faces at `v` form more than one group, faces joined across their edges at `v`.
fn has_two_red_groups(mesh: &Mesh, red: &PerFace<bool>, v: Vert) -> bool {
    let red_halves = || mesh.leaving(v).iter().copied().filter(|&h| red[h.face()]);
    let n_red = red_halves().count();
    // A group that is not a whole closed fan has one face without a red face clockwise of it.
    let is_first = |&h: &Half| !mesh.rotate_cw(h).is_some_and(|c| red[c.face()]);
    let mut firsts = red_halves().filter(is_first);
    let Some(start) = firsts.next().or_else(|| red_halves().next()) else { return false };
    if firsts.next().is_some() {
        return true;
    }
    // The one group found is all there is only if it holds every red face.
    let next_red = |&h: &Half| mesh.rotate_ccw(h).filter(|&c| c != start && red[c.face()]);
    std::iter::successors(Some(start), next_red).count() < n_red
}

/// The faces that are not red, ascending: few, and all that the last filters need to look at.
fn gray_faces(mesh: &Mesh, red_face: &PerFace<bool>) -> Vec<Face> {
    (0..mesh.n_faces()).into_par_iter().map(Face::new).filter(|&f| !red_face[f]).collect()
}

/// Paints red the edges and vertices of the red faces.
fn filter_4_border_of_smooth_region(mesh: &Mesh, gray: &[Face], labels: &mut Labels) {
    labels.red_edge = red_edges(mesh, &labels.red_face);
    labels.red_vertex = per_vertex(mesh, |v| !mesh.leaving(v).is_empty());
    for v in gray.iter().flat_map(|&f| mesh.corners(f)) {
        labels.red_vertex[v] = mesh.leaving(v).iter().any(|h| labels.red_face[h.face()]);
    }
}

/// The edges of the red faces. `[3F]`
pub(crate) fn red_edges(mesh: &Mesh, red_face: &PerFace<bool>) -> PerHalf<bool> {
    let mut red = PerHalf::filled(mesh.n_halves(), true);
    for h in gray_faces(mesh, red_face).into_iter().flat_map(Face::halves) {
        red[h] = mesh.twin(h).is_some_and(|twin| red_face[twin.face()]);
    }
    red
}

/// Paints blue each non-red edge that joins two red vertices. A border edge is never a chamfer.
fn filter_5_chamfer_edges(mesh: &Mesh, gray: &[Face], labels: &mut Labels) {
    let Labels { red_edge, red_vertex, chamfer_edge, .. } = labels;
    *chamfer_edge = PerHalf::filled(mesh.n_halves(), false);
    for h in gray.iter().flat_map(|f| f.halves()) {
        chamfer_edge[h] =
            !red_edge[h] && !mesh.is_border(h) && red_vertex[mesh.from(h)] && red_vertex[mesh.to(h)];
    }
}

/// Paints green each face with three blue edges.
fn filter_6_corner_triangles(gray: &[Face], labels: &mut Labels) {
    let is_corner = |f: &&Face| f.halves().into_iter().all(|h| labels.chamfer_edge[h]);
    labels.corner_faces = gray.iter().filter(is_corner).copied().collect();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tests::mesh;
    use approx::assert_relative_eq;
    use std::f64::consts::FRAC_PI_4;

    fn labels(mesh: &Mesh, threshold: SmoothThreshold, border_is_smooth: bool) -> Labels {
        classify(mesh, &mesh.face_normals(), &ClassifyOptions { threshold, border_is_smooth })
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
}
