//! What a caller can choose.

use crate::classify::{ClassifyOptions, SmoothThreshold};
use crate::mesh::Vert;
use crate::place::{PlaceRules, ShiftLimit};

/// Which reading of the algorithm runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// Region fits: every doubtful vertex is labelled with the smooth region that explains it.
    #[default]
    Regions,
    /// The papers' six filters with the departures that were measured to be better.
    Filters,
    /// The papers' algorithm to the letter (but for its two slips in the placement formula).
    Paper,
}

/// The default of [`Options::max_faces`]: some 10 GB of output.
pub const DEFAULT_MAX_FACES: usize = 200_000_000;

/// What [`sharpen`](crate::sharpen) does. [`Options::default`] is what the command line does without
/// any flag, with coordinates that are exact.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Which reading of the algorithm runs.
    pub method: Method,
    /// Which edges count as smooth.
    pub smooth: SmoothThreshold,
    /// The farthest that an inserted vertex may go from the middle, in lengths of the split edge: 1.5 unless this is
    /// set, and 3 between flat sides. [`Method::Paper`] has a rule of its own then.
    pub max_shift: Option<f64>,
    /// Rounded edges up to this radius, in mean edge lengths, are creases that smoothing wore off; at 0 only those are
    /// whose radius sampling explains, .65 or so. For [`Method::Regions`].
    pub max_round: f64,
    /// Whether chamfers are looked for at all. If not, what is sharp is taken from `sharp_angle` and
    /// `sharp_edges`, for bending.
    pub sharpen: bool,
    /// Without sharpening: edges with at least this dihedral angle, in radians, are sharp.
    pub sharp_angle: Option<f64>,
    /// Without sharpening: these edges are sharp.
    pub sharp_edges: Vec<[Vert; 2]>,
    /// Rounds of Laplacian smoothing of all that is not sharp, before bending.
    pub denoise: usize,
    /// Levels of bending: each splits every face in four.
    pub bend: u32,
    /// The step of the coordinates, in their own unit: what bulges less is not bent. Known of a file (see
    /// [`precision`](crate::bend::precision)), which the command line takes care of; by default they are exact.
    pub precision: f64,
    /// A mesh that bending would give more faces than this is refused.
    pub max_faces: usize,
    /// Whether the colours of the mesh come back in [`Sharpened::labels`](crate::Sharpened::labels).
    pub keep_labels: bool,
    /// Whether the report says how well each recovered crease and corner is supported, and counts all that is
    /// irregular about the input.
    pub keep_verdict: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            method: Method::default(),
            smooth: SmoothThreshold::MeanTimes(2.0),
            max_shift: None,
            max_round: 0.0,
            sharpen: true,
            sharp_angle: None,
            sharp_edges: Vec::new(),
            denoise: 0,
            bend: 0,
            precision: 0.0,
            max_faces: DEFAULT_MAX_FACES,
            keep_labels: false,
            keep_verdict: false,
        }
    }
}

impl Options {
    pub(crate) fn classify_options(&self) -> ClassifyOptions {
        let border_is_smooth = self.method != Method::Paper;
        ClassifyOptions { threshold: self.smooth, border_is_smooth, folds_count: true }
    }

    pub(crate) fn place_rules(&self) -> PlaceRules {
        let rules = match self.method {
            Method::Regions | Method::Filters => PlaceRules::MEASURED,
            Method::Paper => PlaceRules::STRICT,
        };
        let limit = self.max_shift.map_or(rules.limit, ShiftLimit::TimesSplitEdge);
        PlaceRules { limit, ..rules }
    }
}
