//! Bends a sharpened mesh: splits every triangle in four, rounds what is smooth and keeps what is sharp.
//!
//! ```text
//!        /\                /\         new vertices leave the middles of their edges: onto a smooth surface
//!       /  \      ->      o--o        between sharp edges, onto a smooth curve along them
//!      /    \            / \/ \
//!     /______\          /__o___\
//! ```
//!
//! Based on: Sharpen&Bend section 4.2; the stencils are in [`stencil`](crate::stencil).
//! Differs: the papers' plain scheme misses circles and folds meshes that are full of slivers. Here a new vertex
//! goes on to the circle where its surroundings are round (see [`stencil`](crate::stencil)), but only as far as
//! its neighbourhood vouches for, retreats towards the middle where faces would turn over (see `limit.rs`), and
//! makes up for faces that are turned over already (see `mend.rs`). Paper silent.
//! In/out: `Mesh` + `Tags` -> `Bent`: old vertices first, in their order and where they were, then one
//! new vertex per edge in the order of [`Mesh::edges`].
//! Cost: O(F), parallel; rounds of the limiter look only at faces whose vertices moved.

mod limit;
mod mend;
mod precision;
mod quarter;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use glam::DVec3;
use rayon::prelude::*;

use crate::mesh::{Half, MAX_FACES, Mesh, MeshError};
use crate::refine::Lineage;
use crate::stencil::{Rule, Stencils};
use crate::tags::Tags;

use limit::Draft;
pub use precision::precision;
use quarter::{Middles, Quarters};

/// How a mesh is bent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BendOptions {
    /// Whether new vertices are held back where the stencils cannot be trusted. Without, the papers' plain
    /// scheme runs, which folds slivers.
    pub is_limited: bool,
    /// The step of the coordinates, in their own unit: what the surface or a curve bulges less than this is
    /// rounding. See [`precision`].
    pub precision: f64,
}

impl Default for BendOptions {
    fn default() -> Self {
        Self { is_limited: true, precision: 0.0 }
    }
}

/// How the new vertices were placed.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct BendCounts {
    /// How many new vertices each rule placed.
    pub rules: BTreeMap<Rule, usize>,
    /// Those that were trusted by less than half, because the two ends of their edge expect different things
    /// or a surface bent too much for its sampling.
    pub doubted: usize,
    /// Those that would have gone farther than [`MAX_SHIFT`].
    pub shortened: usize,
    /// Those that retreated because a face would have turned over.
    pub retreated: usize,
    /// Those that went elsewhere so that fewer children of a turned face are turned.
    pub mended: usize,
}

/// A mesh after one level of bending.
#[derive(Clone, Debug)]
pub struct Bent {
    /// The new mesh: four faces for each that names three vertices.
    pub mesh: Mesh,
    /// Its sharp edges, two for each before, and its tagged vertices.
    pub tags: Tags,
    /// How the new vertices were placed.
    pub counts: BendCounts,
    quarters: Quarters,
}

impl Bent {
    /// Where its faces come from. Made when asked for: most meshes have no attributes to carry.
    #[must_use]
    pub fn lineage(&self) -> Lineage {
        self.quarters.lineage()
    }
}

/// Tells whether a mesh of `n_faces` can be bent `levels` times within `max_faces`; gives the number of
/// faces that come out.
///
/// # Errors
/// When it is more than `max_faces` or than the index type can count: with the figure.
pub fn levels_fit(n_faces: usize, levels: u32, max_faces: usize) -> Result<usize, MeshError> {
    let limit = max_faces.min(MAX_FACES);
    let count = 4usize.checked_pow(levels).and_then(|n| n.checked_mul(n_faces));
    match count {
        Some(count) if count <= limit => Ok(count),
        _ if n_faces == 0 => Ok(0),
        _ => Err(MeshError::TooLarge { what: "faces", count: count.unwrap_or(usize::MAX), limit }),
    }
}

/// Bends `mesh` by one level. The result does not depend on the number of threads.
///
/// # Errors
/// When the output has more elements than the 32-bit index type can count; before any work.
pub fn bend(mesh: &Mesh, tags: &Tags, options: &BendOptions) -> Result<Bent, MeshError> {
    levels_fit(mesh.n_faces(), 1, MAX_FACES)?;
    let middles = Middles::of(mesh)?;
    let stencils = Stencils::new(mesh, tags);
    let mut counts = BendCounts::default();
    let bent = if options.is_limited {
        // In one memory from wishes to points: that of the new mesh.
        let n_old = mesh.n_verts();
        let mut points = Vec::with_capacity(n_old + middles.edges.len());
        points.extend_from_slice(mesh.points());
        points.resize(n_old + middles.edges.len(), DVec3::ZERO);
        let new = &mut points[n_old..];
        vouched_shifts(mesh, &stencils, &middles.edges, options.precision, new, &mut counts);
        let mut draft = Draft::new(mesh, &stencils, &middles, points);
        counts.retreated = draft.retreat();
        counts.mended = draft.mend();
        let settled = draft.into_settled();
        drop(stencils);
        middles.split(mesh, settled.into_points(mesh, &middles.edges))?
    } else {
        let placed = middles.edges.par_iter().map(|&h| stencils.place(h));
        let (rules, new): (Vec<_>, Vec<_>) = placed.map(|placed| (placed.rule, placed.point)).unzip();
        rules.into_iter().for_each(|rule| *counts.rules.entry(rule).or_default() += 1);
        middles.split(mesh, [mesh.points(), &new].concat())?
    };
    let tags = tags_of_children(mesh, tags, &middles);
    Ok(Bent { mesh: bent, tags, counts, quarters: middles.into_quarters(mesh.n_faces()) })
}

/// Both halves of a sharp edge are sharp.
fn tags_of_children(mesh: &Mesh, tags: &Tags, middles: &Middles) -> Tags {
    let halves = tags.halves_of_sharp_edges(mesh).filter(|&h| middles.vertex(h).is_some());
    let halves = halves.flat_map(|h| {
        let middle = middles.vertex(h);
        [[mesh.from(h), middle], [middle, mesh.to(h)]]
    });
    Tags::new(halves, tags.tagged().iter().copied())
}

/// So many edges are looked at at a time.
const CHUNK: usize = 1 << 12;

/// Writes into `shifts` how far the new vertices on `edges` go before faces have a say; counts how.
fn vouched_shifts(
    mesh: &Mesh,
    stencils: &Stencils<'_>,
    edges: &[Half],
    precision: f64,
    shifts: &mut [DVec3],
    counts: &mut BendCounts,
) {
    let place = |(edges, shifts): (&[Half], &mut [DVec3])| {
        let mut counts = BendCounts::default();
        let mut rules = [0; Rule::ALL.len()];
        for (&h, vector) in edges.iter().zip(shifts) {
            let shift = vouched_shift(stencils, mesh, h, precision);
            *vector = shift.vector;
            rules[shift.rule as usize] += 1;
            counts.doubted += usize::from(shift.is_doubted);
            counts.shortened += usize::from(shift.is_shortened);
        }
        let rules = Rule::ALL.into_iter().zip(rules);
        counts.rules = rules.filter(|&(_, count)| count > 0).collect();
        counts
    };
    let chunks = edges.par_chunks(CHUNK).zip(shifts.par_chunks_mut(CHUNK));
    for chunk in chunks.map(place).collect::<Vec<_>>() {
        counts.doubted += chunk.doubted;
        counts.shortened += chunk.shortened;
        chunk.rules.into_iter().for_each(|(rule, n)| *counts.rules.entry(rule).or_default() += n);
    }
}

/// A new vertex goes no farther from the middle of its edge than this many times its length.
///
/// A circle of six edges asks for 0.108, a surface that turns by 60 degrees from end to end for 0.134:
/// coarser sampling than that shows no curvature. With 0.1 cylinder mc_8k has 1.7 % more error, cylinder
/// mi_8k 2 %, cone mi_8k 1.1 %; with 0.05 cylinders have 7 to 12 % more.
pub const MAX_SHIFT: f64 = 0.15;

/// What the ends of an edge expect counts in full up to this many times its length, which is what a surface
/// has that turns by 100 degrees from end to end: the tip of a cone.
///
/// Without any such limit specks of six vertices that a sampling leaves behind are blown up (pyramid mi_8k
/// 1.09 times the error without bending); 0.2 costs the tip of a cone 1 to 3 %.
const MAX_EXPECTED: f64 = 0.3;

/// How many times what the bolder end expects a vertex may go along the normal. Measured: 1 leaves 6 %
/// more error on sphere remesh_8k, 2 leaves nothing worse; without this rule cylinders and rounded blocks
/// have 3 % more.
const BOLDNESS: f64 = 2.0;

/// What is round goes farther by this power of the trust. Beside the tips of cones the ends differ: with 1 those of pits
/// have 3 % more error than without it, with 2 1 %, with 4 none has; small round cones have a tenth less with each.
const ROUNDNESS_POWER: i32 = 4;

/// Below this many times the edge's length a displacement is rounding, and nothing to have doubts about.
const ROUNDING: f64 = 1e-6;
/// Up to this many times the edge's length it is rounding if it is below the step of the coordinates: a
/// surface that turns by half a degree from end to end. Coordinates of six decimals are that coarse where a
/// part of size 1 has a million faces.
const MOST_ROUNDED: f64 = 1e-3;

/// How far a new vertex goes from the middle of its edge before faces have a say.
struct Shift {
    rule: Rule,
    vector: DVec3,
    is_doubted: bool,
    is_shortened: bool,
}

/// Holds what the stencil proposes against what the ends of the edge expect.
///
/// * Where both ends expect nothing, or less than the step of the coordinates, the surface is flat and the
///   curve straight, and the vertex stays in the middle: in a plane, what the stencils move about within it
///   leaves faces that cut each other by the last bit of their coordinates (189 on cube remesh_8k, 128 on
///   fandisk scan_20k).
/// * Along the normal a vertex goes to neither side of what both ends expect, nothing counted as well, and
///   no farther than [`BOLDNESS`] times what the bolder one expects. Stencils count neighbours and know
///   nothing of how far away they are; the normals do.
/// * All of the way is scaled by trust. Let a and b be the displacements that the two ends expect. On a
///   smooth surface or curve they agree, on noise and beside defects they do not. The trust
///   |a + b|² / (2 (|a|² + |b|²)) is 1 where they are equal, 1/2 where one is zero and 0 where they are
///   opposite: Wiener's factor, the square of the mean against itself plus the variance. Where they expect
///   more than [`MAX_EXPECTED`], the surface turns too much from vertex to vertex to be smooth, and the
///   trust falls off with the square.
/// * Beside a curve trust counts twice: the normals there are those of half a neighbourhood. This is where
///   faces are small and steps show (fandisk mi_20k_n05: 228 flipped faces, with this rule 220, in the
///   middle 210; mc_5k 278, 259, 256; mc_20k 152, 144, 144), and it costs no error.
/// * Where the surroundings are round the way is as much longer as on a circle (`Site::roundness`), as far as the two ends
///   agree that they are ([`ROUNDNESS_POWER`]).
/// * At most [`MAX_SHIFT`] is left.
///
/// Rejected: the disagreement between the stencils of the two ends (they are exact for linear functions
/// only: slivers on a sphere look like noise); a limit of the length alone (cannot tell curvature from
/// noise: both are 0.01 to 0.02 edges here).
fn vouched_shift(stencils: &Stencils<'_>, mesh: &Mesh, h: Half, precision: f64) -> Shift {
    let site = stencils.look(h);
    let rule = site.rule;
    let (from, to) = (mesh.point(mesh.from(h)), mesh.point(mesh.to(h)));
    let length = from.distance(to);
    let [a, b] = site.expected;
    let steepest = a.length_squared().max(b.length_squared()).sqrt();
    if steepest <= precision.min(MOST_ROUNDED * length).max(ROUNDING * length) {
        return Shift { rule, vector: DVec3::ZERO, is_doubted: false, is_shortened: false };
    }
    let mut wanted = stencils.point(&site) - from.midpoint(to);
    if !rule.is_on_curve() {
        let bolder = if a.length_squared() < b.length_squared() { b } else { a };
        let up = bolder.normalize_or_zero();
        let (a, b, rounding) = (BOLDNESS * a.dot(up), BOLDNESS * b.dot(up), ROUNDING * length);
        let (lowest, highest) = (a.min(b).min(0.0) - rounding, a.max(b).max(0.0) + rounding);
        let height = wanted.dot(up);
        if height < lowest || height > highest {
            // All of the way is scaled: taking only the height off would lift vertices off a plane whose
            // slivers have normals a little out of true.
            wanted *= height.min(highest).max(lowest) / height;
        }
    }

    let rounding = (ROUNDING * length).powi(2);
    let squares = 2.0 * (a.length_squared() + b.length_squared());
    let mut trust = ((a + b).length_squared() + rounding) / (squares + rounding);
    if steepest > MAX_EXPECTED * length {
        trust *= (MAX_EXPECTED * length / steepest).powi(2);
    }
    wanted *= 1.0 + trust.powi(ROUNDNESS_POWER) * (site.roundness() - 1.0);
    wanted *= if site.is_beside_curve() { trust * trust } else { trust };
    let is_shortened = wanted.length() > MAX_SHIFT * length;
    let vector = if is_shortened { wanted.clamp_length_max(MAX_SHIFT * length) } else { wanted };
    let vector = if vector.is_finite() { vector } else { DVec3::ZERO };
    Shift { rule, vector, is_doubted: trust < 0.5, is_shortened }
}
