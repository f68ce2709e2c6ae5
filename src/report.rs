//! What a run found and did, as data.

use std::collections::BTreeMap;
use std::time::Instant;

use serde::Serialize;

use crate::bend::BendCounts;
use crate::census::Census;
use crate::classify::Labels;
use crate::collapse::CollapseCounts;
use crate::mesh::{EdgeDefects, Mesh, PerHalf};
use crate::options::Method;
use crate::place::Outcome;
use crate::regions::Verdict;
use crate::untangle::UntangleCounts;

/// Numbers of elements of a mesh.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Size {
    /// Vertices, used or not.
    pub vertices: usize,
    /// Triangles.
    pub faces: usize,
}

impl Size {
    /// Counts the elements of `mesh`.
    #[must_use]
    pub fn of(mesh: &Mesh) -> Self {
        Self { vertices: mesh.n_verts(), faces: mesh.n_faces() }
    }
}

/// What of the input is left as it is: it is neither repaired nor sharpened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct LeftAlone {
    /// Half-edges without a twin: borders, and the edges below.
    pub border_edges: usize,
    /// What is irregular about the edges.
    #[serde(flatten)]
    pub defects: EdgeDefects,
    /// What else is irregular, where [`Options::keep_verdict`](crate::Options::keep_verdict) asked for it.
    #[serde(flatten)]
    pub census: Option<Census>,
    /// Vertices of the file that count as one with an earlier vertex. The output has all of them.
    pub joined_vertices: usize,
}

impl LeftAlone {
    /// Counts what `mesh` has of it, all of it if `in_full`.
    #[must_use]
    pub fn of(mesh: &Mesh, in_full: bool) -> Self {
        Self {
            border_edges: mesh.n_borders(),
            defects: mesh.defects(),
            census: in_full.then(|| Census::of(mesh)),
            joined_vertices: 0,
        }
    }

    /// Notes that so many edges of four faces have two now: two half-edges each are gone, and two have a twin.
    pub(crate) fn take_loosened(&mut self, n: usize) {
        self.defects.non_manifold_edges -= n;
        self.border_edges -= 4 * n;
    }

    /// Notes that so many vertices were joined with others before: no face names them any more, but they are
    /// not isolated.
    pub(crate) fn set_joined(&mut self, n: usize) {
        self.joined_vertices = n;
        if let Some(census) = &mut self.census {
            census.isolated_vertices = census.isolated_vertices.saturating_sub(n);
        }
    }
}

/// What the filters coloured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Found {
    /// Edges with a smaller dihedral angle counted as smooth, in degrees.
    pub threshold_deg: f64,
    /// Smooth (brown) edges.
    pub smooth_edges: usize,
    /// Red vertices after filter 1.
    pub interior_vertices: usize,
    /// Red faces after filter 3.
    pub red_faces: usize,
    /// Chamfer (blue) edges.
    pub chamfer_edges: usize,
    /// Corner triangles (green).
    pub corner_triangles: usize,
    /// Tips of cones.
    pub apexes: usize,
    /// Edges that would be chamfer edges if rounds were creases (see [`Options::max_round`](crate::Options::max_round)).
    pub rounded_edges: usize,
}

impl Found {
    pub(crate) fn of(labels: &Labels) -> Self {
        let count = |flags: &[bool]| flags.iter().filter(|&&flag| flag).count();
        // Both half-edges of a smooth or chamfer edge carry the flag: a border edge is neither.
        let edges = |flags: &PerHalf<bool>| count(flags.as_slice()) / 2;
        Self {
            threshold_deg: labels.threshold.to_degrees(),
            smooth_edges: edges(&labels.smooth_edge),
            interior_vertices: count(labels.interior_vertex.as_slice()),
            red_faces: count(labels.red_face.as_slice()),
            chamfer_edges: edges(&labels.chamfer_edge),
            corner_triangles: labels.corner_faces.len(),
            apexes: 0,
            rounded_edges: 0,
        }
    }
}

/// What a run found and did.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Report {
    /// Which reading of the algorithm ran.
    pub method: Method,
    /// The mesh that came in.
    pub input: Size,
    /// What of it is left as it is.
    pub left_alone: LeftAlone,
    /// The mesh that went out.
    pub output: Size,
    /// Why the mesh is not the kind of input that can be sharpened, if it is not. Nothing was sharpened then.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unfit: Option<String>,
    /// What the filters coloured.
    pub found: Found,
    /// How many inserted vertices moved onto their feature, and how many stayed in the middle for which
    /// reason.
    pub inserted: BTreeMap<Outcome, usize>,
    /// How well the recovered creases and corners are supported, where region fits found them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub verdict: Option<Verdict>,
    /// Old vertices that moved onto the surface that their region's fit predicts, or to the tip of a cone.
    pub moved_vertices: usize,
    /// What became of degenerate faces, where the papers' clean-up ran.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub degenerate_faces: Option<CollapseCounts>,
    /// What became of folds and slivers, where untangling ran.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub untangled: Option<UntangleCounts>,
    /// Old vertices that were collapsed. Inserted vertices have taken their indices, the lowest first; where more were
    /// collapsed than inserted ones are left, the others stay without a face.
    pub replaced_vertices: Vec<usize>,
    /// How the new vertices of each level of bending were placed.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub bent: Vec<BendCounts>,
    /// Edges tagged as sharp in the output.
    pub sharp_edges: usize,
    /// Whether the output differs from the input at all.
    pub changed: bool,
    /// Seconds spent in each stage, in their order.
    pub seconds: Seconds,
}

/// Seconds spent in each stage, in the order in which the stages ran.
#[derive(Clone, Debug, Default)]
pub struct Seconds(Vec<(&'static str, f64)>);

impl Seconds {
    /// Runs a stage and notes its time.
    pub fn time<T>(&mut self, stage: &'static str, run: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = run();
        self.0.push((stage, start.elapsed().as_secs_f64()));
        result
    }

    /// Adds the stages of another run, which ran later, and leaves that one empty.
    pub fn append(&mut self, later: &mut Self) {
        self.0.append(&mut later.0);
    }

    /// The stages with their seconds, in their order.
    #[must_use]
    pub fn stages(&self) -> &[(&'static str, f64)] {
        &self.0
    }
}

impl Serialize for Seconds {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.0.iter().copied())
    }
}
