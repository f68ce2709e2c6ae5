//! Finds the chamfers by region fits: labels every doubtful vertex with the fit of the smooth region
//! that explains it, and reads the chamfers off the labels.
//!
//! ```text
//!   i---i---i---o         i  interior vertex of a smooth region: the samples of the fits
//!   |  /|  /|  / \        o  doubtful vertex: takes the fit N or M that explains it
//!   i---i---i---o-b-o     b  chamfer edge: the fits of its ends disagree by 43 degrees
//!         N       \ |\
//!                   i---i    Wherever three regions meet there is a triangle with three chamfer
//!                 M |  /|    edges (Sperner's lemma): no search for corners.
//! ```
//!
//! The steps, as comments in these files number them (`h` is the mean edge length):
//!
//! 1. Interior vertices have smooth edges only; regions of fewer than four of them are none, and rows off a flat side
//!    (`rows.rs`).
//! 2. Deep ones have interior neighbours only: their samples are trusted fully.
//! 3. The patch of a doubtful vertex: the regions that come within 3 h of it (`patch.rs`).
//! 4. The fit of a region round the vertex: a height field through positions and normals (`fit.rs`).
//! 5. The label of the vertex: the fit that passes nearest to it (`explain.rs`).
//! 6. What no region explains, or no crease beside it (`chord.rs`): by red faces (a), by leftovers (b), by labels
//!    carried along, by places alone (`label.rs`, `grow.rs`, `narrow.rs`).
//! 7. Chamfer edges: the fits of their ends disagree in the middle.
//! 8. Strips of them that are rounds, fades or guesses are left alone (`gates.rs`, `rounds.rs`, `fade.rs`, `ends.rs`).
//! 9. Samples that are off the surface move onto their fit (`moves.rs`, `noise.rs`), or fits onto their samples
//!    (`anchor.rs`); tips of cones (`apex.rs`).
//!
//! Based on: nothing in the papers but their smooth edges; it replaces filters 1 to 6.
//! Differs: a patch has at most 1024 vertices; interior vertices keep to their own region.
//! In/out: `Mesh` + face normals `[F]` + `Labels` (smooth edges, interior vertices) -> `RegionLabels`.
//! Cost: O(V) plus some 10 microseconds per doubtful vertex, in parallel.

mod anchor;
mod apex;
mod chord;
mod ends;
mod explain;
mod fade;
mod fits;
mod gates;
mod grow;
mod label;
mod moves;
mod narrow;
mod near;
mod noise;
mod patch;
mod place;
mod rounds;
mod rows;
mod surface;
#[cfg(test)]
mod tests;
mod verdict;

use glam::DVec3;
use rayon::prelude::*;

use crate::classify::Labels;
use crate::fit::{Fit, FitSource};
use crate::geometry::unit_normal;
use crate::mesh::{Face, Half, Mesh, PerFace, PerHalf, PerVert, Vert, has_repeated_vertex};
use crate::refine::Knots;

pub use apex::Apex;
pub use fits::VertexFits;
pub use gates::{Fate, OffSurface, Strip};
pub use place::place_by_fits;
use surface::{Surface, edges_at};
pub use verdict::{Support, Verdict, verdict};

/// Fits whose normals differ by this angle, in radians, make a chamfer edge. At 30 degrees rounds get
/// false edges, at 60 true ones are lost; at 45 half of the creases of exactly that angle are, as between a
/// plate and a countersink (L2 .026, at 43 degrees .012).
const CHAMFER_ANGLE: f64 = 43.0 * std::f64::consts::PI / 180.0;
/// So do planes that differ by this much only, as curvature has no part in their angle: those of smooth
/// regions with a residual of less than [`FLAT_RMS`]. Brings back the icosahedron (42 degrees; L2 .059 ->
/// .008) and prisms of ten sides. At 25 degrees the gate for rounds lets single edges pass.
const FLAT_CHAMFER_ANGLE: f64 = 35.0 * std::f64::consts::PI / 180.0;
/// Residual of a plane that is one, in mean edge lengths. From .007 to .015 none of 40 meshes with rounds
/// gets worse; at .02 one does, by a spike.
const FLAT_RMS: f64 = 0.01;

/// On samples that lie on the surface, a label this far (in h) from its vertex is wrong ...
const FAR: f64 = 0.15;
/// ... and one that is carried along is not given where it would be this far, as it rests on others ...
const FAR_TO_GROW: f64 = 0.1;
/// ... and one this far gives way to one that is carried along, if that is better: the ends of walls that
/// taper off have labels of what is beside them, .07 to .14 from their vertices ...
const FAR_TO_STAY: f64 = 0.05;
/// ... but each may be as far as this many times the noise.
const FAR_IN_NOISE: f64 = 5.0;

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
    /// Faces of the smooth regions: the core faces and what smooth edges join to them. `[F]`
    pub red_face: PerFace<bool>,
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
    /// Chamfer edges: the candidates of the strips that were kept, ascending.
    pub chamfers: Vec<Half>,
    /// Corner triangles: those with three chamfer edges, ascending.
    pub corner_faces: Vec<Face>,
    /// Whether the samples beside the chamfers are off the surface.
    pub off_surface: OffSurface,
    /// Whether the samples are noisy.
    pub is_noisy: bool,
    /// The tips of cones, ascending.
    pub apexes: Vec<Apex>,
    /// The vertices that move onto their fit, as samples are off the surface or noisy, or onto the cone of an apex,
    /// ascending, and where to.
    pub moved: Vec<(Vert, DVec3)>,
}

impl RegionLabels {
    /// The chamfer edges as flags on both half-edges. `[3F]`
    pub(crate) fn chamfer_edge(&self, mesh: &Mesh) -> PerHalf<bool> {
        let mut flags = PerHalf::filled(mesh.n_halves(), false);
        for &h in &self.chamfers {
            [Some(h), mesh.twin(h)].into_iter().flatten().for_each(|h| flags[h] = true);
        }
        flags
    }

    /// The edges that look like chamfers and were left alone, ascending.
    #[must_use]
    pub fn abstained(&self) -> Vec<Half> {
        let fate = |strip: &u32| self.strips[*strip as usize].fate;
        let abstained =
            self.candidates.iter().zip(&self.strip_of).filter(|(_, strip)| fate(strip) != Fate::Kept);
        abstained.map(|(&h, _)| h).collect()
    }

    /// How many edges look like chamfers and were left alone as rounded ones.
    #[must_use]
    pub fn n_rounded(&self) -> usize {
        let is_rounded = |strip: &&Strip| matches!(strip.fate, Fate::Round | Fate::FarFromFits);
        self.strips.iter().filter(is_rounded).map(|strip| strip.n_edges).sum()
    }

    /// The edges between doubtful vertices of which one has no fit at all though the faces there bend like
    /// a chamfer, ascending: no smooth face that is three samples wide is near.
    #[must_use]
    pub fn beyond_reach(&self, mesh: &Mesh) -> Vec<Half> {
        let is_doubtful = |v: Vert| !self.interior_vertex[v];
        let is_beyond_reach =
            |&v: &Vert| is_doubtful(v) && self.fits.get(v).is_none() && bends_like_a_chamfer(mesh, v);
        let verts = (0..mesh.n_verts()).into_par_iter().map(Vert::new).filter(is_beyond_reach);
        let beside = |v: Vert| mesh.leaving(v).iter().flat_map(|&h| [h, h.prev()]);
        let is_beyond =
            |&h: &Half| !mesh.is_border(h) && is_doubtful(mesh.from(h)) && is_doubtful(mesh.to(h));
        let mut edges: Vec<Half> =
            verts.flat_map_iter(beside).filter(is_beyond).map(|h| mesh.edge(h)).collect();
        edges.par_sort_unstable();
        edges.dedup();
        edges
    }

    /// The old edges that lie on a crease already.
    #[must_use]
    pub fn sharp_already(&self, mesh: &Mesh, smooth_edge: &PerHalf<bool>) -> Vec<Half> {
        // The vertices across both faces of such an edge have fits.
        let is_edge = |&h: &Half| !smooth_edge[h] && mesh.edge(h) == h;
        let across = |&v: &Vert| mesh.leaving(v).iter().map(|h| h.next()).filter(is_edge);
        let verts = self.fits.verts.par_iter();
        verts.flat_map_iter(across).filter(|&h| self.is_sharp_already(mesh, h)).collect()
    }

    /// Whether the old edge of `h` lies on a crease already: the fits of the vertices across its two
    /// faces make a chamfer angle on it, and both its ends lie on both fits.
    #[must_use]
    pub fn is_sharp_already(&self, mesh: &Mesh, h: Half) -> bool {
        let Some(twin) = mesh.twin(h) else { return false };
        let fits = (self.fits.get(mesh.opposite(h)), self.fits.get(mesh.opposite(twin)));
        let (Some(p), Some(q)) = fits else { return false };
        let ends = mesh.ends(h).map(|v| mesh.point(v));
        let middle = ends[0].midpoint(ends[1]);
        let is_on = |fit: &Fit| ends.iter().all(|&end| fit.evaluate(end, self.mean_edge).0.abs() < ON_CREASE);
        meet_in_crease(p, q, middle, self.mean_edge) && is_on(p) && is_on(q)
    }
}

/// Whether two fits, both evaluated at `middle`, differ by the angle of a crease. `h` is the mean edge length.
fn meet_in_crease(p: &Fit, q: &Fit, middle: DVec3, h: f64) -> bool {
    let normal = |fit: &Fit| if fit.is_plane() { fit.normal } else { fit.evaluate(middle, h).1 };
    let cosine = normal(p).dot(normal(q));
    // The two sides of a sheet meet nowhere.
    if cosine < -(1.0 - place::MIN_SINE * place::MIN_SINE).sqrt() {
        return false;
    }
    cosine < CHAMFER_ANGLE.cos() || cosine < FLAT_CHAMFER_ANGLE.cos() && is_flat(p) && is_flat(q)
}

/// Whether `fit` is the plane of a smooth region that has no curvature.
fn is_flat(fit: &Fit) -> bool {
    fit.is_plane() && fit.rms < FLAT_RMS && fit.source == FitSource::Region
}

/// Whether two faces at `v` make at least half of the angle of a crease, as those beside a chamfer do.
fn bends_like_a_chamfer(mesh: &Mesh, v: Vert) -> bool {
    let normal = |h: &Half| unit_normal(mesh.triangle(h.face()));
    let normals: Vec<DVec3> = mesh.leaving(v).iter().filter_map(normal).collect();
    let bends = |i: usize| normals[..i].iter().any(|n| n.dot(normals[i]) < (0.5 * CHAMFER_ANGLE).cos());
    (1..normals.len()).any(bends)
}

/// Labels the doubtful vertices of `mesh` with the smooth regions that explain them, and finds the
/// chamfers. Rounds between sides at a right angle whose radius is `max_round` mean edges at most count as such.
#[must_use]
pub fn label_by_fits(
    mesh: &Mesh,
    face_normals: &PerFace<DVec3>,
    labels: &Labels,
    max_round: f64,
) -> RegionLabels {
    let mut surface = Surface::new(mesh, face_normals, labels);
    surface.max_round = max_round;
    rows::dissolve_rows(&mut surface);
    let surface = surface;
    let (mut fits, noise) = label_vertices(&surface);
    let mut candidates = chamfer_edges(&surface, &fits);
    let (mut strip_of, mut strips) = gates::judge_strips(&surface, &fits, &candidates, noise);
    let off_surface = gates::off_surface(&surface, &fits, &kept(&candidates, &strip_of, &strips));
    ends::cancel_short_branches(&surface, &fits, &candidates, &mut strip_of, &mut strips, noise);
    if fade::can_follow(noise, off_surface.is_likely()) {
        fade::follow(&surface, &fits, &mut candidates, &mut strip_of, &mut strips);
    }
    let apexes = apex::find(&surface, &kept(&candidates, &strip_of, &strips));
    apex::cancel_edges(&apexes, &candidates, &mut strip_of, &mut strips);
    let chamfers = kept(&candidates, &strip_of, &strips);
    let is_noisy = noise::is_noisy(&surface, &fits, noise);
    let mut moved = if is_noisy {
        let zone = noise::zone_of(&surface, &chamfers);
        noise::fit_again(&surface, &mut fits, &zone);
        noise::moves(&surface, &fits, &zone)
    } else if off_surface.is_likely() || surface.has_rounds() {
        moves::moves(&surface, &fits, &chamfers)
    } else {
        anchor::anchor(&surface, &mut fits, &chamfers);
        Vec::new()
    };
    apex::add_moves(&apexes, &mut moved);
    let corner_faces = corner_faces(mesh, &chamfers);
    let Surface { h: mean_edge, interior: interior_vertex, deep: deep_vertex, red_face, .. } = surface;
    RegionLabels {
        mean_edge,
        interior_vertex,
        deep_vertex,
        red_face,
        fits,
        noise,
        candidates,
        strip_of,
        strips,
        chamfers,
        corner_faces,
        off_surface,
        is_noisy,
        apexes,
        moved,
    }
}

/// The edges of the strips that were kept.
fn kept(candidates: &[Half], strip_of: &[u32], strips: &[Strip]) -> Vec<Half> {
    let is_kept = |&(_, &strip): &(&Half, &u32)| strips[strip as usize].fate == Fate::Kept;
    candidates.iter().zip(strip_of).filter(is_kept).map(|(&h, _)| h).collect()
}

/// Steps 3 to 6 in two passes: the fits of the doubtful vertices, and the noise. Only the second pass knows
/// whether the samples are on the surface.
fn label_vertices(surface: &Surface) -> (VertexFits, f64) {
    let mut fits = explain::explain_by_regions(surface);
    label::explain_by_red_faces(surface, &mut fits);
    label::explain_by_leftovers(surface, &mut fits, label::LEFTOVER_RMS);
    let noise = gates::noise(&fits);
    let chamfers = chamfer_edges(surface, &fits);
    let is_off = surface.has_rounds() || gates::off_surface(surface, &fits, &chamfers).is_likely();

    // On the surface a label far from its vertex is a wrong label; off it, one to be looked at again.
    let limit = |least: f64| least.max(FAR_IN_NOISE * noise).min(label::EXPLAINED);
    let explained = surface.deepened(label::EXPLAINED);
    let unless_off = |on_surface: f64| if is_off { explained } else { on_surface };
    let leftover_rms = if is_off { label::LEFTOVER_RMS_OFF_SURFACE } else { label::LEFTOVER_RMS };
    label::take_back_far_labels(surface, &mut fits, unless_off(limit(FAR)));
    let is_marching_cubes =
        is_off && !surface.has_rounds() && chord::take_back_impossible_labels(surface, &mut fits);
    // Leftovers first, which then grow as well: the other way round remesh_5k has L2 .069 instead of .050.
    label::explain_by_leftovers(surface, &mut fits, leftover_rms);
    let far_to_stay = limit(if is_off { FAR } else { FAR_TO_STAY });
    grow::grow(surface, &mut fits, far_to_stay..=limit(FAR), unless_off(limit(FAR_TO_GROW)));
    if is_off {
        explain::explain_by_exact_sides(surface, &mut fits, is_marching_cubes);
    }
    label::explain_by_red_faces(surface, &mut fits);
    label::explain_by_leftovers(surface, &mut fits, leftover_rms);
    if !is_off && noise < gates::CLEAN_NOISE {
        narrow::explain_by_places(surface, &mut fits);
    }
    label::adopt_from_neighbours(surface, &mut fits);
    (fits, noise)
}

/// Step 7: edges whose ends' fits, evaluated at the edge's middle, disagree. Taking both fits to the same point
/// removes the angle that curvature explains. Edges of the border count, so that creases reach it: else a chamfer
/// stays at every end of one (scans with holes lose up to two fifths of L2); edges of three faces or more, and
/// of faces that name a vertex twice, do not. As lower half-edges, ascending.
fn chamfer_edges(surface: &Surface, fits: &VertexFits) -> Vec<Half> {
    let Surface { mesh, h, interior, red_face, .. } = surface;
    let is_chamfer = |&half: &Half| {
        let (a, b) = (mesh.from(half), mesh.to(half));
        let (Some(p), Some(q)) = (fits.get(a), fits.get(b)) else { return false };
        let is_red = red_face[half.face()] || mesh.twin(half).is_some_and(|twin| red_face[twin.face()]);
        if is_red && (p.source == FitSource::Paper || q.source == FitSource::Paper) {
            return false; // The papers' plane comes with the papers' rule: no red edge is a chamfer.
        }
        let middle = mesh.point(a).midpoint(mesh.point(b));
        meet_in_crease(p, q, middle, *h)
    };
    let knots = Knots::of(mesh);
    let bounds_one_or_two = |half: Half| {
        let is_face = || !has_repeated_vertex(&mesh.corners(half.face()));
        !mesh.is_border(half) || knots.around(mesh, half).is_empty() && is_face()
    };
    // Not both ends are interior: from the end that is not, and where neither is from the lower one.
    let edges_from = |&v: &Vert| {
        let mine = edges_at(mesh, v).filter(move |&(_, w)| interior[w] || v < w).map(|(half, _)| half);
        mine.filter(|&half| bounds_one_or_two(half)).filter(is_chamfer)
    };
    let ends = fits.verts.par_iter().filter(|&&v| !interior[v]);
    let mut chamfers: Vec<Half> = ends.flat_map_iter(edges_from).map(|half| mesh.edge(half)).collect();
    chamfers.par_sort_unstable();
    chamfers
}

/// The faces with three chamfer edges, ascending.
fn corner_faces(mesh: &Mesh, chamfers: &[Half]) -> Vec<Face> {
    let beside = |&h: &Half| [Some(h), mesh.twin(h)].into_iter().flatten().map(Half::face);
    let mut faces: Vec<Face> = chamfers.iter().flat_map(beside).collect();
    faces.sort_unstable();
    faces.chunk_by(|f, g| f == g).filter(|edges| edges.len() == 3).map(|edges| edges[0]).collect()
}
