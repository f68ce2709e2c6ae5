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
#[cfg(test)]
mod tests;

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
    /// Whether folded edges count in the mean dihedral angle.
    pub folds_count: bool,
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
    let (threshold, smooth_edge) = smooth_edges(mesh, normals, options);
    let mut labels = Labels { threshold, smooth_edge, ..Labels::default() };
    filter_1_interior_of_smooth_region(mesh, options.border_is_smooth, &mut labels);
    labels
}

/// Faces per unit of parallel work. Sums are formed per chunk and added in order, so that the
/// threshold does not depend on the number of threads.
const CHUNK: usize = 4096;

/// An edge with a larger dihedral angle, in radians, is folded: 150 degrees.
const FOLDED_ANGLE: f64 = 150.0 * std::f64::consts::PI / 180.0;

/// The threshold in radians, and the edges below it.
///
/// The mean runs over edges with two faces that both have a normal; no other edge has an angle, and an
/// edge without an angle is never smooth.
fn smooth_edges(mesh: &Mesh, normals: &PerFace<DVec3>, options: &ClassifyOptions) -> (f64, PerHalf<bool>) {
    let (mean, steps) = mean_angle_and_steps(mesh, normals, options.folds_count);
    let threshold = match options.threshold {
        SmoothThreshold::Angle(angle) => angle,
        SmoothThreshold::MeanTimes(factor) => factor * mean,
    };
    // Chords compare as their angles do.
    let largest = if threshold <= PI { (2.0 * (0.5 * threshold).sin()).powi(2) } else { f64::INFINITY };
    let last = step_of(largest);
    // On the same step the chord itself tells. An edge without an angle is on a step above all others.
    let tells = |h: usize| chord_squared(mesh, normals, Half::new(h)).is_some_and(|chord| chord < largest);
    let is_smooth = |(h, step): (usize, u8)| step < last || step == last && tells(h);
    let smooth: Vec<bool> = steps.into_par_iter().enumerate().map(is_smooth).collect();
    (threshold, smooth.into())
}

/// The mean dihedral angle of the edges that have one, in radians (0 where none has), and on which step the
/// square of each edge's chord is. `[3F]`
///
/// The threshold is known only after the mean. A byte for each edge is fetched faster than two normals are once
/// more.
fn mean_angle_and_steps(mesh: &Mesh, normals: &PerFace<DVec3>, folds_count: bool) -> (f64, Vec<u8>) {
    let steps: Vec<AtomicU8> =
        (0..mesh.n_halves()).into_par_iter().map(|_| AtomicU8::new(NO_ANGLE)).collect();
    let sum_of = |edges: &mut Vec<Half>, (i, faces): (usize, &[[Vert; 3]])| {
        mesh.edges_of(CHUNK * i..CHUNK * i + faces.len(), edges);
        let mut angles = Angles::default();
        for &h in edges.iter() {
            let Some(twin) = mesh.twin(h) else { continue };
            let Some([n, m]) = normals_of(normals, [h, twin]) else { continue };
            let chord = n.distance_squared(m);
            [h, twin].iter().for_each(|half| steps[half.index()].store(step_of(chord), Relaxed));
            angles.add(angle_of_chord(chord, || angle_between(n, m)));
        }
        angles
    };
    let chunks = mesh.faces().par_chunks(CHUNK).enumerate();
    let sums: Vec<Angles> = chunks.map_init(Vec::new, sum_of).collect();
    let all = sums.into_iter().fold(Angles::default(), Angles::and);
    let steps = steps.into_iter().map(AtomicU8::into_inner).collect();
    (all.mean(folds_count), steps)
}

/// Sums of dihedral angles, in radians.
#[derive(Clone, Copy, Debug, Default)]
struct Angles {
    sum: f64,
    n: usize,
    /// Those of folded edges among them.
    sum_of_folded: f64,
    n_folded: usize,
}

impl Angles {
    #[inline]
    fn add(&mut self, angle: f64) {
        self.sum += angle;
        self.n += 1;
        if angle > FOLDED_ANGLE {
            self.sum_of_folded += angle;
            self.n_folded += 1;
        }
    }

    fn and(self, other: Self) -> Self {
        Self {
            sum: self.sum + other.sum,
            n: self.n + other.n,
            sum_of_folded: self.sum_of_folded + other.sum_of_folded,
            n_folded: self.n_folded + other.n_folded,
        }
    }

    /// Their mean, without the folded ones if these do not count; 0 if there are none.
    fn mean(self, folds_count: bool) -> f64 {
        let Self { sum, n, sum_of_folded, n_folded } = self;
        let (sum, n) = if folds_count { (sum, n) } else { (sum - sum_of_folded, n - n_folded) };
        if n == 0 { 0.0 } else { sum / n as f64 }
    }
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
    normals_of(normals, [h, mesh.twin(h)?])
}

/// The normals of the faces of two half-edges, if both have one.
#[inline]
fn normals_of(normals: &PerFace<DVec3>, halves: [Half; 2]) -> Option<[DVec3; 2]> {
    let [n, m] = halves.map(|h| normals[h.face()]);
    (n != DVec3::ZERO && m != DVec3::ZERO).then_some([n, m])
}

fn per_vertex(mesh: &Mesh, value: impl Fn(Vert) -> bool + Send + Sync) -> PerVert<bool> {
    (0..mesh.n_verts()).into_par_iter().map(|v| value(Vert::new(v))).collect::<Vec<_>>().into()
}

/// Paints red each vertex whose edges are all smooth. A vertex without edges stays gray.
fn filter_1_interior_of_smooth_region(mesh: &Mesh, border_is_smooth: bool, labels: &mut Labels) {
    let smooth = &labels.smooth_edge;
    let edges = smooth.as_slice().par_iter().enumerate().map(|(h, &is_smooth)| (Half::new(h), is_smooth));
    let stops = edges.filter(|&(h, is_smooth)| !(is_smooth || border_is_smooth && mesh.is_border(h)));
    let stops: Vec<Half> = stops.map(|(h, _)| h).collect();
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
