//! Decides where each new vertex goes: onto the planes of the smooth regions that its chamfer joins.
//!
//! ```text
//!        N   V   M          A, B  ends of a chamfer edge, on the borders of two red regions
//!         \ / \ /           N, M  normals of the regions there
//!          A-C-B            C     middle of A and B
//!         /     \           V     nearest to C on both planes
//! ```
//!
//! Based on: EdgeSharpener section 3; Sharpen&Bend section 3.3.
//! Differs: the papers' closed form for V is not on both planes (see [`nearest_on_both`]); by default the
//! displacement is limited instead of the length of the created edges, and a corner may have mixed edges.
//! In/out: `Mesh` + normals `[F]` + `Labels` -> `Placement`: positions only, no connectivity.
//! Cost: O(chamfer edges), parallel per edge.

use std::collections::BinaryHeap;

use glam::DVec3;
use rayon::prelude::*;

use crate::classify::Labels;
use crate::geometry::{Plane, angle_between, nearest_on_all, nearest_on_both};
use crate::mesh::{Face, Half, Mesh, PerFace, Vert};
use crate::refine::{Inserts, split_face};

/// What became of an inserted vertex: moved onto the feature, or why it stayed in the middle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// It moved onto the feature.
    Moved,
    /// An end of its edge has no red face with a normal.
    NoNormal,
    /// The strip is convex on one side and concave on the other.
    Mixed,
    /// The planes are parallel or antiparallel, or nearly so.
    Parallel,
    /// The planes meet too far away.
    TooFar,
    /// None of its own was found or sure; it took the place of the corner beside it.
    AtCorner,
}

impl std::fmt::Display for Outcome {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(match self {
            Self::Moved => "moved",
            Self::NoNormal => "no smooth region at an end",
            Self::Mixed => "convex on one side and concave on the other",
            Self::Parallel => "parallel planes",
            Self::TooFar => "planes meet too far away",
            Self::AtCorner => "put onto the corner beside it",
        })
    }
}

/// How far a new vertex may go.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ShiftLimit {
    /// No created edge may be longer than the longest edge of the input (the papers' rule).
    LongestInputEdge,
    /// The displacement from the middle is at most this many times the split edge (for a corner: the
    /// longest edge of its triangle).
    TimesSplitEdge(f64),
}

/// The rules of placement in which the strict and the default reading differ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaceRules {
    /// How far a new vertex may go.
    pub limit: ShiftLimit,
    /// Planes whose normals have a smaller sine between them count as parallel.
    pub min_sine: f64,
    /// Whether one mixed edge keeps a corner's vertex in the middle.
    pub corner_needs_unmixed_edges: bool,
}

impl PlaceRules {
    /// The papers' rules to the letter.
    pub const STRICT: Self =
        Self { limit: ShiftLimit::LongestInputEdge, min_sine: 1e-3, corner_needs_unmixed_edges: true };

    /// What was measured to be better. At 1.5 times the split edge correct acute edges pass that the
    /// strict rule refuses, and no spike does; between 1.5 and 3 nothing was found, without a limit
    /// the largest error grows 25-fold. Planes less than 10 degrees apart need no vertex between them;
    /// any cut up to 20 degrees costs nothing measurable.
    pub const MEASURED: Self =
        Self { limit: ShiftLimit::TimesSplitEdge(1.5), min_sine: 0.17, corner_needs_unmixed_edges: false };
}

/// Three planes whose unit normals have a smaller singular value than this do not fix a corner.
const MIN_CORNER_SINGULAR_VALUE: f64 = 0.1;

/// New vertices with their positions, and what became of each.
#[derive(Clone, Debug)]
pub struct Placement {
    /// The new vertices: those on edges in the order of [`Mesh::edges`], then those in corner faces.
    pub inserts: Inserts,
    /// What became of each of them. `[N]`
    pub outcomes: Vec<Outcome>,
}

/// Places a new vertex on every chamfer edge and in every corner triangle of `labels`.
#[must_use]
pub fn place(mesh: &Mesh, normals: &PerFace<DVec3>, labels: &Labels, rules: &PlaceRules) -> Placement {
    let halves = (0..mesh.n_halves()).into_par_iter().map(Half::new);
    let is_chamfer = |&h: &Half| labels.chamfer_edge[h] && mesh.edge(h) == h;
    let chamfers: Vec<Half> = halves.filter(is_chamfer).collect();
    let mut inserts = Inserts::in_the_middle_of(mesh, &chamfers, &labels.corner_faces);
    let plane = |v: Vert| region_plane(mesh, normals, labels, v);
    let on_edge = |&h: &Half| place_on_edge(mesh, h, plane, rules);
    let in_corner = |&f: &Face| place_in_corner(mesh, f, plane, rules);
    let mut found: Vec<Found> = chamfers.par_iter().map(on_edge).collect();
    found.par_extend(labels.corner_faces.par_iter().map(in_corner));

    let centres = inserts.points.clone();
    let mut outcomes = Vec::with_capacity(found.len());
    for (point, found) in inserts.points.iter_mut().zip(found) {
        outcomes.push(match found {
            Ok(place) => {
                *point = place;
                Outcome::Moved
            }
            Err(why) => why,
        });
    }
    let mut placement = Placement { inserts, outcomes };
    if rules.limit == ShiftLimit::LongestInputEdge {
        limit_created_edges(mesh, &centres, &mut placement);
    }
    placement
}

/// A position, or why there is none.
type Found = Result<DVec3, Outcome>;

/// The plane of the smooth region at `v`: through `v`, its normal the sum of the unit normals of the red
/// faces at `v`, each times its angle there. No other estimate did better.
fn region_plane(mesh: &Mesh, normals: &PerFace<DVec3>, labels: &Labels, v: Vert) -> Option<Plane> {
    let red = mesh.leaving(v).iter().copied().filter(|h| labels.red_face[h.face()]);
    let sum: DVec3 = red.map(|h| corner_angle(mesh, h) * normals[h.face()]).sum();
    let length = sum.length();
    // Unit normals times angles: a sum of rounding errors only has no direction.
    (length > 1e-12).then(|| Plane { point: mesh.point(v), normal: sum / length })
}

/// The angle of the face of `h` at the corner that `h` leaves.
pub(crate) fn corner_angle(mesh: &Mesh, h: Half) -> f64 {
    let p = mesh.point(mesh.from(h));
    angle_between(mesh.point(mesh.to(h)) - p, mesh.point(mesh.opposite(h)) - p)
}

fn place_on_edge(mesh: &Mesh, h: Half, plane: impl Fn(Vert) -> Option<Plane>, rules: &PlaceRules) -> Found {
    let (Some(p), Some(q)) = (plane(mesh.from(h)), plane(mesh.to(h))) else {
        return Err(Outcome::NoNormal);
    };
    if is_mixed(p, q) {
        return Err(Outcome::Mixed);
    }
    let centre = p.point.midpoint(q.point);
    match nearest_on_both(p, q, centre) {
        Some((point, sine)) if sine >= rules.min_sine => {
            within(point, centre, mesh.length(h), rules.limit).ok_or(Outcome::TooFar)
        }
        _ => Err(Outcome::Parallel),
    }
}

fn place_in_corner(mesh: &Mesh, f: Face, plane: impl Fn(Vert) -> Option<Plane>, rules: &PlaceRules) -> Found {
    let [Some(p), Some(q), Some(r)] = mesh.corners(f).map(plane) else {
        return Err(Outcome::NoNormal);
    };
    if rules.corner_needs_unmixed_edges && (is_mixed(p, q) || is_mixed(q, r) || is_mixed(r, p)) {
        return Err(Outcome::Mixed);
    }
    let centre = (p.point + q.point + r.point) / 3.0;
    let (point, smallest) = nearest_on_all(&[p, q, r], centre, 0.0);
    if smallest < MIN_CORNER_SINGULAR_VALUE || !point.is_finite() {
        return Err(Outcome::Parallel);
    }
    let longest = f.halves().map(|h| mesh.length(h)).into_iter().fold(0.0, f64::max);
    within(point, centre, longest, rules.limit).ok_or(Outcome::TooFar)
}

/// Whether the strip between `p` and `q` is convex on one side and concave on the other: each point
/// lies on the same side of the other's plane, seen along the edge.
fn is_mixed(p: Plane, q: Plane) -> bool {
    let edge = q.point - p.point;
    edge.dot(p.normal) * edge.dot(q.normal) > 0.0
}

fn within(point: DVec3, centre: DVec3, edge: f64, limit: ShiftLimit) -> Option<DVec3> {
    match limit {
        ShiftLimit::LongestInputEdge => Some(point),
        ShiftLimit::TimesSplitEdge(times) => (point.distance(centre) <= times * edge).then_some(point),
    }
}

/// Puts vertices back to the middle until no created edge is longer than the longest input edge.
///
/// Based on: EdgeSharpener section 3. Paper silent on the order: the longest created edge goes first;
/// of its moved ends the one that moved further goes back (a tie goes to the smaller index).
fn limit_created_edges(mesh: &Mesh, centres: &[DVec3], placement: &mut Placement) {
    // One part in 10^12 of slack: a created edge may be an input edge, rounded another way.
    let longest =
        mesh.faces().par_iter().map(|&corners| longest_side(mesh, corners)).reduce(|| 0.0, f64::max);
    let limit = longest.sqrt() * (1.0 + 1e-12);
    let n_old = mesh.n_verts();
    let new = |v: Vert| v.index().checked_sub(n_old);
    let Placement { inserts, outcomes } = placement;
    let created = created_edges(mesh, inserts, centres);

    let length = |points: &[DVec3], a: Vert, b: Vert| {
        let at = |v: Vert| new(v).map_or_else(|| mesh.point(v), |i| points[i]);
        at(a).distance(at(b))
    };
    // Lengths are not negative, so their bits order as they do.
    let entry = |points: &[DVec3], [a, b]: [Vert; 2]| (length(points, a, b).to_bits(), a.max(b), a.min(b));
    let is_long = |&(bits, ..): &(u64, Vert, Vert)| f64::from_bits(bits) > limit;
    let mut heap: BinaryHeap<_> =
        created.iter().map(|&edge| entry(&inserts.points, edge)).filter(is_long).collect();
    while let Some((bits, a, b)) = heap.pop() {
        if entry(&inserts.points, [a, b]).0 != bits {
            continue; // An end has gone back since.
        }
        let shift = |i: usize| inserts.points[i].distance(centres[i]);
        let moved = [b, a].into_iter().filter_map(new).filter(|&i| outcomes[i] == Outcome::Moved);
        let further = |i: usize, j: usize| if shift(j) > shift(i) { j } else { i };
        let Some(back) = moved.reduce(further) else { continue };
        outcomes[back] = Outcome::TooFar;
        inserts.points[back] = centres[back];
        let back = Vert::new(n_old + back);
        let first = created.partition_point(|edge| edge[0] < back);
        let edges = created[first..].iter().take_while(|edge| edge[0] == back);
        heap.extend(edges.map(|&edge| entry(&inserts.points, edge)).filter(is_long));
    }
}

/// Square of the length of a face's longest side.
fn longest_side(mesh: &Mesh, corners: [Vert; 3]) -> f64 {
    let [a, b, c] = corners.map(|v| mesh.point(v));
    a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a))
}

/// Every edge that subdivision will create at an inserted vertex, from each inserted end, ascending.
fn created_edges(mesh: &Mesh, inserts: &Inserts, centres: &[DVec3]) -> Vec<[Vert; 2]> {
    let n_old = mesh.n_verts();
    let middle = |v: Vert| v.index().checked_sub(n_old).map_or_else(|| mesh.point(v), |i| centres[i]);
    let mut created = Vec::new();
    for f in inserts.on_edge.faces() {
        for child in split_face(mesh, inserts, f, middle).iter() {
            for i in 0..3 {
                let (a, b) = (child[i].0, child[(i + 1) % 3].0);
                created.extend([[a, b], [b, a]].into_iter().filter(|[v, _]| v.index() >= n_old));
            }
        }
    }
    created.sort_unstable();
    created.dedup();
    created
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tests::mesh;
    use approx::assert_relative_eq;
    use glam::dvec3;

    // A ridge along y that was cut off: red slopes left and right (faces 0 and 3), chamfer edge 1-2 of
    // length 2 between them.
    //
    //   4---1---3      x = -3, -1, .. 1, 3; heights 0, 2, .. 2, 0: the slopes meet at x = 0, z = 3
    //   |0 /1\ 3|
    //   |/  2 \ |      (face 1 = 1 0 2, face 2 = 1 2 3)
    //   0---2---5
    fn ridge(height_right: f64) -> (Mesh, Labels) {
        let m = mesh(
            &[
                [-3., 0., 0.],
                [-1., 1., 2.],
                [1., 0., height_right],
                [3., 1., 0.],
                [-3., 1., 0.],
                [3., 0., 0.],
            ],
            &[[4, 0, 1], [1, 0, 2], [1, 2, 3], [2, 5, 3]],
        );
        let mut labels = Labels { red_face: vec![true, false, false, true].into(), ..Labels::default() };
        labels.chamfer_edge = m.halves().map(|h| h.index() == 5 || h.index() == 6).collect::<Vec<_>>().into();
        (m, labels)
    }

    fn placed(height_right: f64, rules: &PlaceRules) -> (Vec<DVec3>, Vec<Outcome>) {
        let (m, labels) = ridge(height_right);
        let placement = place(&m, &m.face_normals(), &labels, rules);
        (placement.inserts.points, placement.outcomes)
    }

    #[test]
    fn the_new_vertex_lies_on_both_slopes() {
        for rules in [PlaceRules::STRICT, PlaceRules::MEASURED] {
            let (points, outcomes) = placed(2.0, &rules);
            assert_eq!(outcomes, [Outcome::Moved]);
            assert_relative_eq!(points[0].distance(dvec3(0., 0.5, 3.)), 0.0, epsilon = 1e-12);
        }
    }

    #[test]
    fn a_strip_that_is_convex_and_concave_stays_in_the_middle() {
        let (points, outcomes) = placed(-2.0, &PlaceRules::MEASURED);
        assert_eq!((points, outcomes), (vec![dvec3(0., 0.5, 0.)], vec![Outcome::Mixed]));
    }

    #[test]
    fn a_place_too_far_away_is_refused() {
        let near = PlaceRules { limit: ShiftLimit::TimesSplitEdge(0.4), ..PlaceRules::MEASURED };
        let (points, outcomes) = placed(2.0, &near);
        assert_eq!((points, outcomes), (vec![dvec3(0., 0.5, 2.)], vec![Outcome::TooFar]));
    }

    #[test]
    fn nearly_parallel_planes_are_refused() {
        let steep = PlaceRules { min_sine: 1.0 + 1e-12, ..PlaceRules::MEASURED };
        assert_eq!(placed(2.0, &steep).1, [Outcome::Parallel]);
    }

    #[test]
    fn an_end_without_red_faces_has_no_plane() {
        let (m, mut labels) = ridge(2.0);
        labels.red_face[Face::new(3)] = false;
        let placement = place(&m, &m.face_normals(), &labels, &PlaceRules::STRICT);
        assert_eq!(placement.outcomes, [Outcome::NoNormal]);
    }

    #[test]
    fn a_created_edge_longer_than_all_input_edges_goes_back() {
        // Slopes of 20 to 1 meet 20 above the middle; no edge of the mesh is longer than 41.
        let (m, labels) = ridge(2.0);
        let (mut points, faces) = m.into_parts();
        for p in &mut points {
            p.z *= 20.0;
        }
        let m = Mesh::new(points, faces).unwrap();
        let placement = place(&m, &m.face_normals(), &labels, &PlaceRules::STRICT);
        assert_eq!(placement.outcomes, [Outcome::TooFar], "the edges to 0 and 3 would be 60 long");
        assert_eq!(placement.inserts.points, [dvec3(0., 0.5, 40.)]);
    }

    // The corner of a cube at the origin, cut off: triangle 0 1 2, a red face behind each of its points.
    #[test]
    fn a_corner_lies_on_its_three_planes() {
        let m = mesh(
            &[
                [0., -1., -1.],
                [-1., 0., -1.],
                [-1., -1., 0.],
                [0., -2., -3.],
                [0., -3., -2.],
                [-3., 0., -2.],
                [-2., 0., -3.],
                [-2., -3., 0.],
                [-3., -2., 0.],
                [-1., -1., -5.],
                [-5., -1., -1.],
                [-1., -5., -1.],
            ],
            &[[0, 1, 2], [0, 3, 4], [1, 5, 6], [2, 7, 8], [1, 0, 9], [2, 1, 10], [0, 2, 11]],
        );
        let labels = Labels {
            red_face: vec![false, true, true, true, false, false, false].into(),
            chamfer_edge: m.halves().map(|h| !m.is_border(h)).collect::<Vec<_>>().into(),
            corner_faces: vec![Face::new(0)],
            ..Labels::default()
        };
        let rules = PlaceRules { limit: ShiftLimit::TimesSplitEdge(1.5), ..PlaceRules::STRICT };
        let placement = place(&m, &m.face_normals(), &labels, &rules);
        assert_eq!(placement.outcomes[3], Outcome::Moved);
        assert_relative_eq!(placement.inserts.points[3].length(), 0.0, epsilon = 1e-12);
    }
}
