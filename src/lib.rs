//! Gives triangle meshes back the sharp edges and corners that sampling took away.
//!
//! Marching cubes, scanners and remeshers sample a surface without regard to its creases, so that every
//! crease is cut off into a strip of *chamfer* triangles. [`sharpen`] finds these strips, splits their
//! edges, and puts the new vertices where the smooth surfaces on both sides meet:
//!
//! ```text
//!        original            sampled             sharpened
//!           /\                 __                   /\
//!          /  \               /  \  <- chamfer     /__\
//!         /    \             /    \               /    \
//! ```
//!
//! # Vocabulary
//! The papers': a *smooth edge* (brown) has a small dihedral angle; a *smooth region* (red) is bounded by
//! edges that are not smooth; a *chamfer edge* (blue) joins two smooth regions; a *corner triangle*
//! (green) has three of them; a *sharp edge* joins two *tagged vertices* and stays sharp when bent.
//!
//! # Data flow
//! ```text
//! Mesh -> classify -> regions -> Labels -> place -> Inserts -> refine -> untangle -> Tags -> (bend -> refine) x N
//! ```
//!
//! # References
//! * Attene, Falcidieno, Rossignac, Spagnuolo: *Edge-Sharpener: Recovering sharp features in
//!   triangulations of non-adaptively re-meshed surfaces*, SGP 2003.
//! * The same: *Sharpen&Bend: Recovering curved sharp edges in triangle meshes produced by
//!   feature-insensitive sampling*, IEEE TVCG 2005.

pub mod attributes;
pub mod bend;
pub mod census;
pub mod classify;
pub mod collapse;
pub mod denoise;
mod edit;
pub mod error;
mod excerpt;
pub mod fit;
pub mod geometry;
pub mod io;
pub mod mesh;
pub mod options;
pub mod paint;
mod pipeline;
pub mod place;
pub mod refine;
pub mod regions;
pub mod report;
mod rings;
pub mod stencil;
mod subset;
pub mod tags;
pub mod untangle;
pub mod weld;

pub use mesh::{Mesh, MeshError};
pub use options::{Method, Options};
pub use report::Report;

use std::borrow::Cow;

use attributes::{Attributes, Split};
use bend::{BendOptions, Bent, bend, levels_fit};
use classify::Labels;
use denoise::denoise;
use refine::Lineage;
use report::{LeftAlone, Size};
use tags::Tags;

/// What [`sharpen`] gives back.
#[derive(Clone, Debug, Default)]
pub struct Sharpened {
    /// The new mesh. Old vertices keep their index, and their bits but for those that moved onto their surface
    /// beside a crease or gave their place to an inserted one (the report has both); other inserted ones follow.
    pub mesh: Mesh,
    /// Its sharp edges and tagged vertices.
    pub tags: Tags,
    /// The colours of the *input* mesh, where [`Options::keep_labels`] asked for them.
    pub labels: Option<Labels>,
    /// What was found and done.
    pub report: Report,
}

/// Recovers the sharp edges and corners of `mesh`.
///
/// A mesh on which nothing is found comes back as it is: the same vertices and faces in the same order,
/// bit for bit. The result does not depend on the number of threads.
///
/// ```
/// use sharpen::{Mesh, Options, sharpen};
///
/// let sharpened = sharpen(&Mesh::default(), &Options::default())?;
/// assert!(!sharpened.report.changed);
/// # Ok::<(), sharpen::MeshError>(())
/// ```
///
/// # Errors
/// When the output has more elements than the 32-bit index type can count.
pub fn sharpen(mesh: &Mesh, options: &Options) -> Result<Sharpened, MeshError> {
    rebuild(mesh, options, None)
}

/// [`sharpen`] that also carries along what a file says about the mesh beyond points and faces. What could
/// not be carried is named, one line each.
///
/// # Errors
/// As [`sharpen`].
pub fn sharpen_with_attributes(
    mesh: &Mesh,
    mut attributes: Attributes,
    options: &Options,
) -> Result<(Sharpened, Attributes, Vec<String>), MeshError> {
    if attributes.is_plain() {
        return Ok((sharpen(mesh, options)?, attributes, Vec::new()));
    }
    let mut notices = Vec::new();
    let n_joined = attributes.split.as_ref().map_or(0, Split::n_joined);
    let mut sharpened = sharpen_observed(mesh, options, |rebuild| {
        let (lineage, sharp) = (rebuild.lineage(), rebuild.tags.sharp_edges());
        let (carried, lost) =
            std::mem::take(&mut attributes).carry(&lineage, rebuild.old, rebuild.new, sharp);
        attributes = carried;
        notices.extend(lost);
    })?;
    sharpened.report.left_alone.set_joined(n_joined);
    Ok((sharpened, attributes, notices))
}

/// One rebuild of the mesh, for those who carry something along.
#[derive(Clone, Copy, Debug)]
pub struct Rebuild<'a> {
    /// The mesh before: at the first rebuild the input.
    pub old: &'a Mesh,
    /// The mesh after.
    pub new: &'a Mesh,
    /// What is sharp in the new mesh.
    pub tags: &'a Tags,
    origin: Origin<'a>,
}

/// What tells where new faces come from.
#[derive(Clone, Copy, Debug)]
enum Origin<'a> {
    Listed(&'a Lineage),
    Bent(&'a Bent),
    /// The same faces as before.
    Same,
}

impl<'a> Rebuild<'a> {
    /// Where the new faces and corners come from.
    #[must_use]
    pub fn lineage(&self) -> Cow<'a, Lineage> {
        match self.origin {
            Origin::Listed(lineage) => Cow::Borrowed(lineage),
            Origin::Bent(bent) => Cow::Owned(bent.lineage()),
            Origin::Same => Cow::Owned(Lineage::identity(self.new)),
        }
    }
}

/// [`sharpen`] that calls `on_rebuild` after each rebuild of the mesh; never, when nothing changes.
///
/// # Errors
/// As [`sharpen`].
pub fn sharpen_observed(
    mesh: &Mesh,
    options: &Options,
    mut on_rebuild: impl FnMut(Rebuild<'_>),
) -> Result<Sharpened, MeshError> {
    rebuild(mesh, options, Some(&mut on_rebuild))
}

/// [`sharpen_observed`], or without an observer: then nobody wants to know where faces come from.
fn rebuild(
    mesh: &Mesh,
    options: &Options,
    mut on_rebuild: Option<&mut dyn FnMut(Rebuild<'_>)>,
) -> Result<Sharpened, MeshError> {
    levels_fit(mesh.n_faces(), options.bend, options.max_faces)?;
    let mut report = Report {
        method: options.method,
        input: Size::of(mesh),
        left_alone: LeftAlone::of(mesh, options.keep_verdict),
        ..Report::default()
    };
    let mut sharpened = if options.sharpen {
        pipeline::sharpen(mesh, options, &mut report, &mut on_rebuild)?
    } else {
        let tags = report.seconds.time("tags", || pipeline::given_tags(mesh, options));
        Sharpened { mesh: mesh.clone(), tags, ..Sharpened::default() }
    };
    if options.denoise > 0 {
        let smoothed =
            report.seconds.time("denoise", || denoise(&sharpened.mesh, &sharpened.tags, options.denoise))?;
        if let Some(on_rebuild) = &mut on_rebuild {
            on_rebuild(Rebuild {
                old: &sharpened.mesh,
                new: &smoothed,
                tags: &sharpened.tags,
                origin: Origin::Same,
            });
        }
        sharpened.mesh = smoothed;
        report.changed = true;
    }
    levels_fit(sharpened.mesh.n_faces(), options.bend, options.max_faces)?;
    let bend_options = BendOptions { precision: options.precision, ..BendOptions::default() };
    for _ in 0..options.bend {
        let bent = report.seconds.time("bend", || bend(&sharpened.mesh, &sharpened.tags, &bend_options))?;
        if let Some(on_rebuild) = &mut on_rebuild {
            on_rebuild(Rebuild {
                old: &sharpened.mesh,
                new: &bent.mesh,
                tags: &bent.tags,
                origin: Origin::Bent(&bent),
            });
        }
        (sharpened.mesh, sharpened.tags) = (bent.mesh, bent.tags);
        report.bent.push(bent.counts);
        report.changed = true;
    }
    report.output = Size::of(&sharpened.mesh);
    report.sharp_edges = sharpened.tags.sharp_edges().len();
    Ok(Sharpened { report, ..sharpened })
}
