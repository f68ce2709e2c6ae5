//! Finds the chamfers by region fits: labels every doubtful vertex with the fit of the smooth region
//! that explains it, and reads the chamfers off the labels.
//!
//! ```text
//!   i---i---i---o         i  interior vertex of a smooth region: the samples of the fits
//!   |  /|  /|  / \        o  doubtful vertex: takes the fit N or M that explains it
//!   i---i---i---o-b-o     b  chamfer edge: the fits of its ends disagree by 45 degrees
//!         N       \ |\
//!                   i---i    Wherever three regions meet there is a triangle with three chamfer
//!                 M |  /|    edges (Sperner's lemma): no search for corners.
//! ```
//!
//! Based on: REGIONS.md steps 1 to 9; it replaces the papers' filters 1 to 6, but for the smooth edges.
//! Differs: vertices count as deep by their neighbours alone, not by a distance as well (step 2; it made
//! no measurable difference). A patch has at most [`patch::MAX_MEMBERS`] vertices. Interior vertices keep
//! to their own region.
//! In/out: `Mesh` + face normals `[F]` + `Labels` (smooth edges, interior vertices) -> `RegionLabels`.
//! Cost: O(V) plus some 10 microseconds per doubtful vertex, in parallel.

mod gates;
mod label;
mod patch;
mod place;

use glam::DVec3;
use rayon::prelude::*;

use crate::classify::{Labels, core_faces, flood_over_smooth_edges};
use crate::fit::{Fit, FitSource};
use crate::mesh::{Face, Half, Mesh, PerFace, PerHalf, PerVert, Vert};

pub use gates::{Fate, OffSurface, Strip};
pub use place::{MAX_SHIFT, place_by_fits};

/// A smooth region with fewer interior vertices than this is none: on marching-cubes meshes they are
/// slanted chamfer vertices. Measured: 3 as good as 4; 1 (no minimum), 6 and 10 worse.
const MIN_REGION: usize = 4;
/// Fits whose normals differ by this angle, in radians, make a chamfer edge. At 30 degrees rounds get
/// false edges, at 60 true ones are lost.
const CHAMFER_ANGLE: f64 = 45.0 * std::f64::consts::PI / 180.0;

/// A vertex this close to two fits lies on their crease, in mean edge lengths.
const ON_CREASE: f64 = 0.05;

/// What the region fits say about a mesh.
#[derive(Clone, Debug, Default)]
pub struct RegionLabels {
    /// The mean edge length, h: the unit of every distance in fits and strips.
    pub mean_edge: f64,
    /// Vertices in the interior of a smooth region, without the regions that are too small. `[V]`
    pub interior_vertex: PerVert<bool>,
    /// Interior vertices with interior neighbours only: trusted most, never moved. `[V]`
    pub deep_vertex: PerVert<bool>,
    /// The fits of the doubtful vertices and of their interior neighbours.
    pub fits: VertexFits,
    /// The median residual of the region fits, in h: an estimate of the noise.
    pub noise: f64,
    /// Every edge whose ends' fits disagree, as the lower half-edge, ascending ...
    pub candidates: Vec<Half>,
    /// ... the strip that it belongs to, as an index into `strips` ...
    pub strip_of: Vec<u32>,
    /// ... and the strips with what became of them.
    pub strips: Vec<Strip>,
    /// Chamfer edges: the candidates of the strips that were kept. `[3F]`
    pub chamfer_edge: PerHalf<bool>,
    /// Corner triangles: those with three chamfer edges, ascending.
    pub corner_faces: Vec<Face>,
    /// Whether the samples beside the chamfers are off the surface.
    pub off_surface: OffSurface,
    /// The vertices that are therefore moved onto their fit, ascending, and where to.
    pub moved: Vec<(Vert, DVec3)>,
}

/// The fits of the vertices that have one.
#[derive(Clone, Debug, Default)]
pub struct VertexFits {
    /// For each vertex its place in the next two, `u32::MAX` if it has none. `[V]`
    slot: PerVert<u32>,
    verts: Vec<Vert>,
    fits: Vec<Option<Fit>>,
}

impl VertexFits {
    /// No fit yet, and room for those of `verts` (ascending).
    fn none(n_verts: usize, verts: Vec<Vert>) -> Self {
        let mut slot = PerVert::filled(n_verts, u32::MAX);
        for (i, &v) in verts.iter().enumerate() {
            slot[v] = i as u32;
        }
        let fits = vec![None; verts.len()];
        Self { slot, verts, fits }
    }

    /// The fit of `v`, if it has one.
    #[inline]
    #[must_use]
    pub fn get(&self, v: Vert) -> Option<&Fit> {
        self.fits.get(self.slot[v] as usize)?.as_ref()
    }

    /// All vertices with a fit, ascending.
    pub fn iter(&self) -> impl Iterator<Item = (Vert, &Fit)> {
        self.verts.iter().zip(&self.fits).filter_map(|(&v, fit)| Some((v, fit.as_ref()?)))
    }

    fn set(&mut self, v: Vert, fit: Fit) {
        self.fits[self.slot[v] as usize] = Some(fit);
    }
}

impl RegionLabels {
    /// Whether the old edge of `h` lies on a crease already: the fits of the vertices across its two
    /// faces make a chamfer angle on it, and both its ends lie on both fits.
    #[must_use]
    pub fn is_sharp_already(&self, mesh: &Mesh, h: Half) -> bool {
        let Some(twin) = mesh.twin(h) else { return false };
        let fits = (self.fits.get(mesh.opposite(h)), self.fits.get(mesh.opposite(twin)));
        let (Some(p), Some(q)) = fits else { return false };
        let ends = [mesh.from(h), mesh.to(h)].map(|v| mesh.point(v));
        let middle = ends[0].midpoint(ends[1]);
        let normal = |fit: &Fit| fit.evaluate(middle, self.mean_edge).1;
        let is_on = |fit: &Fit| ends.iter().all(|&end| fit.evaluate(end, self.mean_edge).0.abs() < ON_CREASE);
        normal(p).dot(normal(q)) < CHAMFER_ANGLE.cos() && is_on(p) && is_on(q)
    }
}

/// What all steps read: the mesh, and what steps 1 and 2 say about its vertices.
struct Surface<'a> {
    mesh: &'a Mesh,
    face_normals: &'a PerFace<DVec3>,
    /// Mean edge length.
    h: f64,
    neighbours: Neighbours,
    interior: PerVert<bool>,
    deep: PerVert<bool>,
    red_face: PerFace<bool>,
    /// The angle of each half-edge's face at the corner that it leaves. `[3F]`
    angles: PerHalf<f64>,
}

/// Labels the doubtful vertices of `mesh` with the smooth regions that explain them, and finds the
/// chamfers.
#[must_use]
pub fn label_by_fits(mesh: &Mesh, face_normals: &PerFace<DVec3>, labels: &Labels) -> RegionLabels {
    let surface = Surface::new(mesh, face_normals, labels);
    let mut fits = label::explain_by_regions(&surface);
    label::explain_by_red_faces(&surface, &mut fits);
    label::explain_by_leftovers(&surface, &mut fits);

    let noise = gates::noise(&fits);
    let first = chamfer_edges(&surface, &fits);
    if !gates::off_surface(&surface, &fits, &first).is_likely() {
        // The samples are on the surface: a label far from its vertex is a wrong label.
        label::take_back_far_labels(&surface, &mut fits, noise);
        label::explain_by_red_faces(&surface, &mut fits);
        label::explain_by_leftovers(&surface, &mut fits);
    }
    label::adopt_from_neighbours(&surface, &mut fits);

    let candidates = chamfer_edges(&surface, &fits);
    let (strip_of, strips) = gates::judge_strips(&surface, &fits, &candidates, noise);
    let is_kept = |&(_, &strip): &(&Half, &u32)| strips[strip as usize].fate == Fate::Kept;
    let kept: Vec<Half> = candidates.iter().zip(&strip_of).filter(is_kept).map(|(&h, _)| h).collect();
    let off_surface = gates::off_surface(&surface, &fits, &kept);
    let moved = if off_surface.is_certain() { place::moves(&surface, &fits, &kept) } else { Vec::new() };
    let chamfer_edge = edge_flags(mesh, &kept);
    let corner_faces = corner_faces(mesh, &chamfer_edge, &kept);
    let Surface { h: mean_edge, interior: interior_vertex, deep: deep_vertex, .. } = surface;
    RegionLabels {
        mean_edge,
        interior_vertex,
        deep_vertex,
        fits,
        noise,
        candidates,
        strip_of,
        strips,
        chamfer_edge,
        corner_faces,
        off_surface,
        moved,
    }
}

impl<'a> Surface<'a> {
    fn new(mesh: &'a Mesh, face_normals: &'a PerFace<DVec3>, labels: &Labels) -> Self {
        let neighbours = Neighbours::of(mesh);
        let interior = interior_of_large_regions(mesh, &neighbours, &labels.interior_vertex);
        let is_deep = |v: Vert| interior[v] && neighbours.of_vertex(v).iter().all(|&w| interior[w]);
        let deep = per_vertex(mesh, is_deep);
        let core = core_faces(mesh, &interior);
        let red_face = flood_over_smooth_edges(mesh, &labels.smooth_edge, core);
        let (h, angles) = (mean_edge_length(mesh), corner_angles(mesh));
        Self { mesh, face_normals, h, neighbours, interior, deep, red_face, angles }
    }

    /// Vertices that are not interior, and the interior ones next to them, ascending.
    fn doubtful(&self) -> Vec<Vert> {
        let is_doubtful = |v: &Vert| !self.deep[*v] && !self.mesh.leaving(*v).is_empty();
        self.mesh.verts().filter(is_doubtful).collect()
    }

    /// Unit normal at `v`: the normals of the faces there that count, each times its angle. Zero where no
    /// face does.
    fn normal(&self, v: Vert, counts: impl Fn(Face) -> bool) -> DVec3 {
        let faces = self.mesh.leaving(v).iter().filter(|h| counts(h.face()));
        let weighted = |&h: &Half| self.angles[h] * self.face_normals[h.face()];
        let sum: DVec3 = faces.map(weighted).sum();
        let length = sum.length();
        // Unit normals times angles: a sum of rounding errors only has no direction.
        if length > 1e-12 { sum / length } else { DVec3::ZERO }
    }
}

/// Step 1: interior vertices, but for those in components of fewer than [`MIN_REGION`].
fn interior_of_large_regions(
    mesh: &Mesh,
    neighbours: &Neighbours,
    interior: &PerVert<bool>,
) -> PerVert<bool> {
    let is_in_large_region = |v: Vert| {
        let mut found = [v; MIN_REGION];
        let mut n_found = 1;
        let mut next = 0;
        while next < n_found && n_found < MIN_REGION {
            for &w in neighbours.of_vertex(found[next]).iter().filter(|&&w| interior[w]) {
                if n_found < MIN_REGION && !found[..n_found].contains(&w) {
                    found[n_found] = w;
                    n_found += 1;
                }
            }
            next += 1;
        }
        n_found == MIN_REGION
    };
    per_vertex(mesh, |v| interior[v] && is_in_large_region(v))
}

/// Step 7: edges with two faces whose ends' fits, evaluated at the edge's middle, disagree. Taking both
/// fits to the same point removes the angle that curvature explains. As lower half-edges, ascending.
fn chamfer_edges(surface: &Surface, fits: &VertexFits) -> Vec<Half> {
    let Surface { mesh, h, interior, red_face, .. } = surface;
    let is_chamfer = |&half: &Half| {
        let Some(twin) = mesh.twin(half).filter(|&twin| half < twin) else { return false };
        let (a, b) = (mesh.from(half), mesh.to(half));
        let (Some(p), Some(q)) = (fits.get(a), fits.get(b)) else { return false };
        if interior[a] && interior[b] {
            return false;
        }
        let is_red = red_face[half.face()] || red_face[twin.face()];
        if is_red && (p.source == FitSource::Paper || q.source == FitSource::Paper) {
            return false; // The papers' plane comes with the papers' rule: no red edge is a chamfer.
        }
        let middle = mesh.point(a).midpoint(mesh.point(b));
        let (n, m) = (p.evaluate(middle, *h).1, q.evaluate(middle, *h).1);
        n.dot(m) < CHAMFER_ANGLE.cos()
    };
    let halves = (0..mesh.n_halves()).into_par_iter().map(Half::new);
    halves.filter(is_chamfer).collect()
}

/// Flags both half-edges of each of `edges`. `[3F]`
fn edge_flags(mesh: &Mesh, edges: &[Half]) -> PerHalf<bool> {
    let mut flags = PerHalf::filled(mesh.n_halves(), false);
    for &h in edges {
        flags[h] = true;
        if let Some(twin) = mesh.twin(h) {
            flags[twin] = true;
        }
    }
    flags
}

/// The faces with three chamfer edges, ascending.
fn corner_faces(mesh: &Mesh, chamfer_edge: &PerHalf<bool>, chamfers: &[Half]) -> Vec<Face> {
    let is_corner = |f: &Face| f.halves().into_iter().all(|h| chamfer_edge[h]);
    let beside = |&h: &Half| [Some(h), mesh.twin(h)].into_iter().flatten().map(Half::face);
    let mut corners: Vec<Face> = chamfers.iter().flat_map(beside).filter(is_corner).collect();
    corners.sort_unstable();
    corners.dedup();
    corners
}

fn per_vertex<T: Send>(mesh: &Mesh, value: impl Fn(Vert) -> T + Send + Sync) -> PerVert<T> {
    let verts = (0..mesh.n_verts()).into_par_iter().map(Vert::new);
    verts.map(value).collect::<Vec<_>>().into()
}

/// Faces per unit of parallel work. Sums are formed per chunk and added in order, so that they do not
/// depend on the number of threads.
const CHUNK: usize = 4096;

/// Mean length over all edges; 0 without edges.
fn mean_edge_length(mesh: &Mesh) -> f64 {
    let chunks: Vec<(f64, usize)> = mesh
        .faces()
        .par_chunks(CHUNK)
        .enumerate()
        .map(|(i, faces)| {
            let lowest = 3 * CHUNK * i;
            let halves = (lowest..lowest + 3 * faces.len()).map(Half::new);
            let edges = halves.filter(|&h| mesh.edge(h) == h);
            edges.fold((0.0, 0), |(sum, n), h| (sum + mesh.length(h), n + 1))
        })
        .collect();
    let (sum, n) = chunks.into_iter().fold((0.0, 0), |(s, n), (t, m)| (s + t, n + m));
    if n == 0 { 0.0 } else { sum / n as f64 }
}

/// The angle of each face at each of its corners, in radians; what a face without area has does not
/// matter. `[3F]`
fn corner_angles(mesh: &Mesh) -> PerHalf<f64> {
    let angles = |corners: &[Vert; 3]| {
        let [a, b, c] = corners.map(|v| mesh.point(v));
        let (ab, bc, ca) = (b - a, c - b, a - c);
        let twice_area = ab.cross(ca).length();
        let (at_a, at_b) = (twice_area.atan2(-ab.dot(ca)), twice_area.atan2(-ab.dot(bc)));
        [at_a, at_b, std::f64::consts::PI - at_a - at_b]
    };
    let nested: Vec<[f64; 3]> = mesh.faces().par_iter().map(angles).collect();
    nested.into_flattened().into()
}

/// The vertices that share an edge with each vertex, ascending, each once.
struct Neighbours {
    starts: Vec<u32>,
    verts: Vec<Vert>,
}

impl Neighbours {
    fn of(mesh: &Mesh) -> Self {
        let mut starts = Vec::with_capacity(mesh.n_verts() + 1);
        let mut verts: Vec<Vert> = Vec::with_capacity(mesh.n_halves() + mesh.n_halves() / 16);
        starts.push(0);
        let mut round = Vec::new();
        for v in mesh.verts() {
            round.clear();
            for &h in mesh.leaving(v) {
                round.push(mesh.to(h));
                if mesh.is_border(h.prev()) {
                    round.push(mesh.from(h.prev()));
                }
            }
            round.sort_unstable();
            round.dedup();
            verts.extend(round.iter().filter(|&&w| w != v));
            starts.push(verts.len() as u32);
        }
        Self { starts, verts }
    }

    #[inline]
    fn of_vertex(&self, v: Vert) -> &[Vert] {
        &self.verts[self.starts[v.index()] as usize..self.starts[v.index() + 1] as usize]
    }
}
