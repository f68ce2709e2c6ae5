//! What all steps read of the mesh, and which of its vertices are interior, deep or doubtful (steps 1
//! and 2).
//!
//! Based on: Sharpen&Bend section 3.1, filters 1 and 2 (smooth edges, red vertices), whose flood gives the red faces.
//! Differs: regions of fewer than [`MIN_REGION`] vertices are none; deep vertices; what is far from any bend is not
//! doubted.
//! In/out: `Mesh` + face normals `[F]` + `Labels` -> `Surface`.
//! Cost: O(V + F) in parallel but for the floods, and what `near.rs` costs.

use glam::DVec3;
use rayon::prelude::*;

use super::near::Near;
use crate::classify::{CALM_ANGLE, Labels, core_faces, flood_over_smooth_edges};
use crate::geometry::angle_as_weight;
use crate::mesh::{Face, Half, Mesh, PerFace, PerVert, Vert};

/// A smooth region with fewer interior vertices than this is none: on marching-cubes meshes they are
/// slanted chamfer vertices. Measured: 3 as good as 4; 1 (no minimum), 6 and 10 worse.
const MIN_REGION: usize = 4;

/// Chamfers are looked for near edges that bend by this much, in radians: 8 degrees. A crease of 35 degrees
/// over edges that bend less is a round of more than four edges, and no chamfer. Finely sampled parts have
/// most of their doubtful vertices on rounds that bend by a degree or two: there this saves two thirds of the
/// work. On 25 of 31 inputs every doubtful vertex is near such an edge.
const BENT_ANGLE: f64 = CALM_ANGLE;
/// Near are this many rings: the ends of chamfer edges have such an edge, and what moves with them is next to these.
const BENT_RINGS: usize = 3;

/// Where a round's two sides make a right angle, its middle is this share of its radius off both, 1 - cos 45 degrees
/// and a fifth more; where they make less, it is less.
const DEPTH_OF_ROUND: f64 = 0.35;

/// What all steps read: the mesh, and what steps 1 and 2 say about its vertices.
pub(super) struct Surface<'a> {
    pub mesh: &'a Mesh,
    pub face_normals: &'a PerFace<DVec3>,
    /// Mean edge length.
    pub h: f64,
    pub interior: PerVert<bool>,
    pub deep: PerVert<bool>,
    pub red_face: PerFace<bool>,
    /// Vertices that are not interior, and the interior ones next to them, ascending: those near an edge that
    /// bends. None where no region is smooth: then there is nothing to doubt by.
    pub doubtful: Vec<Vert>,
    pub near: Near,
    /// Rounds up to this radius, in h, are what smoothing left of creases; 0 if there are none.
    pub max_round: f64,
}

impl<'a> Surface<'a> {
    pub fn new(mesh: &'a Mesh, face_normals: &'a PerFace<DVec3>, labels: &Labels) -> Self {
        let (interior, deep) = interior_and_deep(mesh, &labels.interior_vertex);
        let core = core_faces(mesh, &interior);
        let red_face = flood_over_smooth_edges(mesh, &labels.smooth_edge, core);
        let h = mean_edge_length(mesh);
        let mut doubtful = Vec::new();
        if interior.as_slice().contains(&true) {
            doubtful = doubtful_near_bends(mesh, face_normals, labels, &deep);
        }
        let (near, max_round) = (Near::default(), 0.0);
        let mut surface = Self { mesh, face_normals, h, interior, deep, red_face, doubtful, near, max_round };
        surface.near = Near::around(&surface, &surface.doubtful);
        surface
    }

    /// Whether rounded creases are looked for as well.
    pub fn has_rounds(&self) -> bool {
        self.max_round > 0.0
    }

    /// How far samples may be off the fit of their side, in h: `limit`, or as far as those of the largest of these rounds.
    pub fn deepened(&self, limit: f64) -> f64 {
        limit.max(DEPTH_OF_ROUND * self.max_round)
    }

    /// The vertices that share an edge with `v`, which is doubtful, each once.
    pub fn neighbours(&self, v: Vert) -> impl Iterator<Item = Vert> + '_ {
        self.near.neighbours(self.near.of[v]).iter().map(|&w| self.near.verts[w as usize])
    }

    /// Unit normal at `v` of the faces there that count.
    pub fn normal_of(&self, v: Vert, counts: impl Fn(Face) -> bool) -> DVec3 {
        vertex_normal(self.mesh, self.face_normals, v, counts)
    }
}

/// Unit normal at `v`: the normals of the faces there that count, each times its angle. Zero where no face
/// does.
fn vertex_normal(
    mesh: &Mesh,
    face_normals: &PerFace<DVec3>,
    v: Vert,
    counts: impl Fn(Face) -> bool,
) -> DVec3 {
    let apex = mesh.point(v);
    let angle = |h: Half| angle_as_weight(mesh.point(mesh.to(h)) - apex, mesh.point(mesh.opposite(h)) - apex);
    let faces = mesh.leaving(v).iter().filter(|h| counts(h.face()));
    let sum: DVec3 = faces.map(|&h| angle(h) * face_normals[h.face()]).sum();
    let length = sum.length();
    // Unit normals times angles: a sum of rounding errors only has no direction.
    if length > 1e-12 { sum / length } else { DVec3::ZERO }
}

/// Step 1: interior vertices, but for those in components of fewer than [`MIN_REGION`]; and step 2: those of
/// them with interior neighbours only.
fn interior_and_deep(mesh: &Mesh, interior: &PerVert<bool>) -> (PerVert<bool>, PerVert<bool>) {
    // The others are few: what is next to them is found faster than what is not.
    let others: Vec<Vert> = filter_verts(mesh, |v| !interior[v]);
    let mut deep = interior.clone();
    let mut beside = Vec::new();
    for &v in &others {
        for w in corners_beside(mesh, v) {
            beside.extend(std::mem::replace(&mut deep[w], false).then_some(w));
        }
    }
    // With all neighbours of at least three being interior, four vertices are.
    beside.extend(filter_verts(mesh, |v| deep[v] && mesh.leaving(v).len() < MIN_REGION - 1));
    let small = beside.into_par_iter().filter(|&v| !is_in_large_region(mesh, interior, v));
    let mut interior = interior.clone();
    for v in small.collect::<Vec<_>>() {
        (interior[v], deep[v]) = (false, false);
    }
    (interior, deep)
}

/// The vertices that are not deep, ascending: those that vertices like them join to an edge that is not smooth
/// and bends by [`BENT_ANGLE`] at least.
fn doubtful_near_bends(
    mesh: &Mesh,
    face_normals: &PerFace<DVec3>,
    labels: &Labels,
    deep: &PerVert<bool>,
) -> Vec<Vert> {
    let bends = |&h: &Half| {
        let Some(twin) = mesh.twin(h).filter(|_| !labels.smooth_edge[h]) else { return false };
        let (n, m) = (face_normals[h.face()], face_normals[twin.face()]);
        n != DVec3::ZERO && m != DVec3::ZERO && n.dot(m) < BENT_ANGLE.cos()
    };
    let has_bend = |v: Vert| !labels.interior_vertex[v] && mesh.leaving(v).iter().any(bends);
    let mut found = filter_verts(mesh, has_bend);
    let mut is_known = deep.clone();
    found.iter().for_each(|&v| is_known[v] = true);
    let mut ring_start = 0;
    for _ in 0..BENT_RINGS {
        let ring = ring_start..found.len();
        ring_start = found.len();
        for i in ring {
            for w in corners_beside(mesh, found[i]) {
                if !std::mem::replace(&mut is_known[w], true) {
                    found.push(w);
                }
            }
        }
    }
    found.par_sort_unstable();
    found
}

fn is_in_large_region(mesh: &Mesh, interior: &PerVert<bool>, v: Vert) -> bool {
    let mut found = [v; MIN_REGION];
    let mut n_found = 1;
    let mut next = 0;
    while next < n_found && n_found < MIN_REGION {
        for w in corners_beside(mesh, found[next]).filter(|&w| interior[w]) {
            if n_found < MIN_REGION && !found[..n_found].contains(&w) {
                found[n_found] = w;
                n_found += 1;
            }
        }
        next += 1;
    }
    n_found == MIN_REGION
}

fn filter_verts(mesh: &Mesh, holds: impl Fn(Vert) -> bool + Send + Sync) -> Vec<Vert> {
    (0..mesh.n_verts()).into_par_iter().map(Vert::new).filter(|&v| holds(v)).collect()
}

/// The vertices that share an edge with `v`; where the mesh has borders most of them twice, as corners of two faces.
#[inline]
pub(super) fn corners_beside(mesh: &Mesh, v: Vert) -> impl Iterator<Item = Vert> + '_ {
    let leaving = mesh.leaving(v);
    let again = if mesh.n_borders() == 0 { &[] } else { leaving };
    leaving.iter().map(|&h| mesh.to(h)).chain(again.iter().map(|&h| mesh.opposite(h)))
}

/// A half-edge of each edge at `v`, with the other end: those that leave it, and those of borders that arrive. An edge of
/// three faces or more comes as often as it has half-edges.
pub(super) fn edges_at(mesh: &Mesh, v: Vert) -> impl Iterator<Item = (Half, Vert)> + '_ {
    let leaving = mesh.leaving(v).iter();
    let arriving = leaving.clone().map(|h| h.prev()).filter(|&h| mesh.is_border(h));
    leaving.map(|&h| (h, mesh.to(h))).chain(arriving.map(|h| (h, mesh.from(h))))
}

/// The vertices that share an edge with `v`, each once, put into `round`.
pub(super) fn neighbours<'r>(mesh: &Mesh, v: Vert, round: &'r mut Vec<Vert>) -> &'r [Vert] {
    round.clear();
    if mesh.n_borders() == 0 {
        round.extend(mesh.leaving(v).iter().map(|&h| mesh.to(h)));
        return round;
    }
    let mut is_closed = true;
    for &h in mesh.leaving(v) {
        round.push(mesh.to(h));
        if mesh.is_border(h) || mesh.is_border(h.prev()) {
            round.push(mesh.opposite(h));
            is_closed = false;
        }
    }
    if !is_closed {
        round.sort_unstable();
        round.dedup();
        round.retain(|&w| w != v);
    }
    round
}

/// Faces per unit of parallel work. Sums are formed per chunk and added in order, so that they do not
/// depend on the number of threads.
pub(super) const CHUNK: usize = 4096;

/// Mean length over all edges; 0 without edges.
fn mean_edge_length(mesh: &Mesh) -> f64 {
    let chunks: Vec<(f64, usize)> = mesh
        .faces()
        .par_chunks(CHUNK)
        .enumerate()
        .map_init(Vec::new, |edges, (i, faces)| {
            mesh.edges_of(CHUNK * i..CHUNK * i + faces.len(), edges);
            (edges.iter().fold(0.0, |sum, &h| sum + mesh.length(h)), edges.len())
        })
        .collect();
    let (sum, n) = chunks.into_iter().fold((0.0, 0), |(s, n), (t, m)| (s + t, n + m));
    if n == 0 { 0.0 } else { sum / n as f64 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tests::mesh;

    // 0---1---2   5---6     Two regions of interior vertices: three vertices are none, four are one.
    //  `-_|_-´     `-7|
    //     3         4-´
    #[test]
    fn regions_of_fewer_than_four_vertices_are_none() {
        let m = mesh(&[[0.0; 3]; 8], &[[0, 3, 1], [1, 3, 2], [4, 7, 6], [5, 6, 7]]);
        let mut interior = PerVert::filled(8, true);
        interior[Vert::new(4)] = false;
        let (large, deep) = interior_and_deep(&m, &interior);
        assert_eq!(large.as_slice(), [true, true, true, true, false, false, false, false]);
        assert_eq!(deep, large, "none of the four is next to another one");
    }

    // 3---2    Edge 0-2 has two faces, all others one.
    // | / |
    // 0---1
    #[test]
    fn neighbours_are_listed_once_across_borders_too() {
        let m = mesh(&[[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]], &[[0, 1, 2], [0, 2, 3]]);
        let of =
            |v| neighbours(&m, Vert::new(v), &mut Vec::new()).iter().map(|w| w.index()).collect::<Vec<_>>();
        assert_eq!([of(0), of(1), of(2), of(3)], [vec![1, 2, 3], vec![0, 2], vec![0, 1, 3], vec![0, 2]]);
        assert_eq!(mean_edge_length(&m), (4.0 + 2f64.sqrt()) / 5.0);
    }
}
