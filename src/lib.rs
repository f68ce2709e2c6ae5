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
//! Mesh -> classify -> Labels -> place -> Inserts -> refine -> collapse -> tags
//! ```
//!
//! # References
//! * Attene, Falcidieno, Rossignac, Spagnuolo: *Edge-Sharpener: Recovering sharp features in
//!   triangulations of non-adaptively re-meshed surfaces*, SGP 2003.
//! * The same: *Sharpen&Bend: Recovering curved sharp edges in triangle meshes produced by
//!   feature-insensitive sampling*, IEEE TVCG 2005.

pub mod attributes;
pub mod classify;
pub mod collapse;
mod edit;
pub mod error;
pub mod fit;
pub mod geometry;
pub mod io;
pub mod mesh;
pub mod options;
pub mod paint;
pub mod place;
pub mod refine;
pub mod regions;
pub mod report;
pub mod tags;
#[expect(dead_code, reason = "the region fits will call it")]
mod untangle;

pub use mesh::{Mesh, MeshError};
pub use options::{Method, Options};
pub use report::Report;

use classify::{Labels, classify};
use collapse::collapse_degenerate_faces;
use edit::Edit;
use mesh::{Face, PerVert, Vert};
use place::{Outcome, Placement, place};
use refine::{Lineage, Refined, refine};
use report::{Found, Seconds, Size};
use tags::Tags;

/// What [`sharpen`] gives back.
#[derive(Clone, Debug, Default)]
pub struct Sharpened {
    /// The new mesh. Old vertices keep their index and their bits; inserted ones follow.
    pub mesh: Mesh,
    /// Its sharp edges and tagged vertices.
    pub tags: Tags,
    /// Where its faces come from, stage by stage; empty when nothing changed.
    pub lineage: Vec<Lineage>,
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
    let mut seconds = Seconds::default();
    let normals = seconds.time("normals", || mesh.face_normals());
    let labels = seconds.time("classify", || classify(mesh, &normals, &options.classify_options()));
    let placement = seconds.time("place", || place(mesh, &normals, &labels, &options.place_rules()));
    drop(normals);

    let mut report = Report {
        method: options.method,
        input: Size::of(mesh),
        found: Found::of(mesh, &labels),
        changed: !placement.inserts.is_empty(),
        ..Report::default()
    };
    for &outcome in &placement.outcomes {
        *report.inserted.entry(outcome).or_default() += 1;
    }

    let refined = seconds.time("refine", || refine(mesh, &placement.inserts))?;
    let cleaned = seconds.time("collapse", || clean(mesh, &refined, &placement, &mut report))?;
    let tags = seconds.time("tags", || find_tags(mesh, &labels, &cleaned, options.method));

    report.output = Size::of(&cleaned.mesh);
    report.sharp_edges = tags.sharp_edges().len();
    report.seconds = seconds;
    let lineage = if report.changed { vec![cleaned.lineage] } else { Vec::new() };
    let labels = options.keep_labels.then_some(labels);
    Ok(Sharpened { mesh: cleaned.mesh, tags, lineage, labels, report })
}

/// A sharpened mesh without its degenerate faces.
struct Cleaned {
    mesh: Mesh,
    lineage: Lineage,
    /// The edges that subdivision created at inserted vertices, before cleaning.
    created: Vec<[Vert; 2]>,
    /// For each vertex before cleaning what it is now.
    now: PerVert<Vert>,
}

/// Removes the degenerate faces of `refined` that own an inserted vertex.
fn clean(
    mesh: &Mesh,
    refined: &Refined,
    placement: &Placement,
    report: &mut Report,
) -> Result<Cleaned, MeshError> {
    let n_old = mesh.n_verts();
    let is_inserted = |v: &Vert| v.index() >= n_old;
    let owns_inserted = |f: &Face| refined.mesh.corners(*f).iter().any(is_inserted);
    let faces: Vec<Face> = refined.mesh.face_ids().filter(owns_inserted).collect();
    let edges = |f: &Face| f.halves().map(|h| [refined.mesh.from(h), refined.mesh.to(h)]);
    let at_inserted = |edge: &[Vert; 2]| edge.iter().any(is_inserted);
    let created = faces.iter().flat_map(edges).filter(at_inserted).collect();

    let mut edit = Edit::new(refined, n_old);
    let is_moved = |v: Vert| placement.outcomes[v.index() - n_old] == Outcome::Moved;
    report.degenerate_faces = collapse_degenerate_faces(&mut edit, &faces, is_moved);
    let edited = edit.finish(mesh, &placement.inserts)?;
    report.replaced_vertices = edited.replaced.iter().map(|v| v.index()).collect();
    Ok(Cleaned { mesh: edited.mesh, lineage: edited.lineage, created, now: edited.now })
}

/// Finds the sharp edges of the cleaned mesh. Inserted vertices are tagged, and those that filter 3bis
/// tagged in the input `mesh`.
fn find_tags(mesh: &Mesh, labels: &Labels, cleaned: &Cleaned, method: Method) -> Tags {
    let n_old = mesh.n_verts();
    let is_tagged = |v: &Vert| v.index() >= n_old || labels.tagged_vertex[*v];
    let now = |edge: [Vert; 2]| edge.map(|v| cleaned.now[v]);
    match method {
        Method::Paper => {
            let mut tagged = PerVert::filled(cleaned.mesh.n_verts(), false);
            for v in (0..cleaned.now.len()).map(Vert::new).filter(is_tagged) {
                tagged[cleaned.now[v]] = true;
            }
            Tags::between_tagged(&cleaned.mesh, &tagged)
        }
        Method::Filters => {
            let old = mesh.edges().filter(|&h| labels.sharp_edge[h]).map(|h| [mesh.from(h), mesh.to(h)]);
            let created = cleaned.created.iter().copied().filter(|edge| edge.iter().all(is_tagged));
            Tags::where_bent(&cleaned.mesh, old.chain(created).map(now))
        }
    }
}
