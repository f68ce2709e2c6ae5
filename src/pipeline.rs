//! What each reading of the algorithm does at each step.
//!
//! The readings differ in how chamfers are found and placed, how the result is cleaned and what counts as
//! sharp; what they hand on is the same: labels, inserts, tags.

use crate::classify::{Labels, SmoothThreshold, classify, classify_interior, red_edges};
use crate::collapse::collapse_degenerate_faces;
use crate::edit::{Edit, Edited};
use crate::mesh::{Face, Half, Mesh, MeshError, PerHalf, PerVert, Vert};
use crate::options::{Method, Options};
use crate::place::{Outcome, Placement, place};
use crate::refine::{Inserts, Lineage, Refined, refine};
use crate::regions::{RegionLabels, label_by_fits, place_by_fits, verdict};
use crate::report::{Found, Report, Seconds};
use crate::tags::{Tags, tags_by_dihedral};
use crate::untangle::{Context, untangle};
use crate::{Origin, Rebuild, Sharpened};

/// Finds the chamfers of `mesh` and puts its sharp edges back.
pub(crate) fn sharpen(
    mesh: &Mesh,
    options: &Options,
    report: &mut Report,
    on_rebuild: &mut dyn FnMut(Rebuild<'_>),
) -> Result<Sharpened, MeshError> {
    let mut seconds = std::mem::take(&mut report.seconds);
    let chamfers = find(mesh, options, &mut seconds);
    let inserts = &chamfers.placement.inserts;
    report.found = Found::of(&chamfers.labels);
    report.unfit.clone_from(&chamfers.unfit);
    report.changed = !inserts.is_empty();
    report.moved_vertices = inserts.moved.len();
    for &outcome in &chamfers.placement.outcomes {
        *report.inserted.entry(outcome).or_default() += 1;
    }

    if let Some(regions) = &chamfers.regions {
        let verdict = || verdict(mesh, regions, &chamfers.placement);
        report.verdict = options.keep_verdict.then(|| seconds.time("verdict", verdict));
    }

    let refined = seconds.time("refine", || refine(mesh, inserts))?;
    let cleaned = seconds.time("clean", || clean(mesh, &refined, &chamfers, report))?;
    let tags = seconds.time("tags", || find_tags(mesh, &chamfers, &cleaned, options.method));
    drop(refined);
    if report.changed {
        let origin = Origin::Listed(&cleaned.lineage);
        on_rebuild(Rebuild { old: mesh, new: &cleaned.mesh, tags: &tags, origin });
    }
    report.seconds = seconds;
    let labels = options.keep_labels.then_some(chamfers.labels);
    Ok(Sharpened { mesh: cleaned.mesh, tags, labels, ..Sharpened::default() })
}

/// What is sharp in a mesh that is not to be sharpened: what the caller knows of.
pub(crate) fn given_tags(mesh: &Mesh, options: &Options) -> Tags {
    let bent = options.sharp_angle.map(|angle| tags_by_dihedral(mesh, angle)).unwrap_or_default();
    let given = options.sharp_edges.iter().filter(|edge| edge.iter().all(|v| v.index() < mesh.n_verts()));
    Tags::new(bent.sharp_edges().iter().chain(given).copied(), [])
}

/// The chamfers of a mesh, and where their new vertices go.
struct Chamfers {
    /// The colours. By region fits, chamfer edges and corner triangles are those of the fits.
    pub labels: Labels,
    /// The fits, where they were made.
    pub regions: Option<RegionLabels>,
    pub placement: Placement,
    /// Why nothing was looked for, if nothing was.
    pub unfit: Option<String>,
}

/// Above this threshold for smooth edges, in radians, a mesh is too noisy or terraced: 40 degrees. Clean
/// samplings have 4 to 18, with noise of 5 % of the edges up to 34, of which they still gain; from 57 on
/// nothing but spikes came of it.
const MAX_THRESHOLD: f64 = 40.0 * std::f64::consts::PI / 180.0;
/// With a smaller share of interior vertices there is no smooth region to speak of. Sampled parts have
/// 0.4 and more, a body of cubes 0.04.
const MIN_INTERIOR_SHARE: f64 = 0.05;

/// Why a mesh is not the kind of input that can be sharpened, if it is not. A threshold that the caller
/// chose is never questioned, and neither is the strict algorithm.
fn unfit(mesh: &Mesh, labels: &Labels, options: &Options) -> Option<String> {
    if options.method == Method::Paper || matches!(options.smooth, SmoothThreshold::Angle(_)) {
        return None;
    }
    let n_interior = labels.interior_vertex.as_slice().iter().filter(|&&interior| interior).count();
    let n_used = mesh.n_faces() / 2; // Euler: a closed mesh has about half as many vertices as faces.
    if labels.threshold > MAX_THRESHOLD {
        return Some(format!(
            "noisy or terraced: the mean dihedral angle sets the limit of smooth edges at {:.0} degrees (more \
             than {:.0}), where features cannot be told from noise",
            labels.threshold.to_degrees(),
            MAX_THRESHOLD.to_degrees()
        ));
    }
    let is_rough = (n_interior as f64) < MIN_INTERIOR_SHARE * n_used as f64;
    let has_angles = labels.threshold > 0.0;
    (is_rough && has_angles).then(|| {
        format!("no smooth regions: only {n_interior} of about {n_used} vertices have smooth edges all round")
    })
}

/// Finds the chamfers of `mesh` and places their new vertices.
fn find(mesh: &Mesh, options: &Options, seconds: &mut Seconds) -> Chamfers {
    let normals = seconds.time("normals", || mesh.face_normals());
    let colour = if options.method == Method::Regions { classify_interior } else { classify };
    let mut labels = seconds.time("classify", || colour(mesh, &normals, &options.classify_options()));
    let unfit = unfit(mesh, &labels, options);
    if unfit.is_some() {
        labels = classify(mesh, &normals, &options.classify_options());
        labels.chamfer_edge = PerHalf::filled(mesh.n_halves(), false);
        labels.corner_faces.clear();
        let placement = Placement { inserts: Inserts::none(mesh), outcomes: Vec::new() };
        return Chamfers { labels, regions: None, placement, unfit };
    }
    if options.method != Method::Regions {
        let placement = seconds.time("place", || place(mesh, &normals, &labels, &options.place_rules()));
        return Chamfers { labels, regions: None, placement, unfit };
    }
    let mut regions = seconds.time("regions", || label_by_fits(mesh, &normals, &labels));
    let placement = seconds.time("place", || place_by_fits(mesh, &regions, options.max_shift()));
    labels.chamfer_edge.clone_from(&regions.chamfer_edge);
    labels.corner_faces.clone_from(&regions.corner_faces);
    labels.red_face = std::mem::take(&mut regions.red_face);
    if options.keep_labels {
        labels.red_edge = red_edges(mesh, &labels.red_face);
        labels.abstained = regions.abstained();
        labels.beyond_reach = regions.beyond_reach(mesh);
    }
    Chamfers { labels, regions: Some(regions), placement, unfit }
}

/// A sharpened mesh without its degenerate or folded faces.
struct Cleaned {
    pub mesh: Mesh,
    pub lineage: Lineage,
    /// Edges that subdivision created and that may be sharp, before cleaning.
    created: Vec<[Vert; 2]>,
    /// For each vertex before cleaning what it is now.
    now: PerVert<Vert>,
}

/// Cleans the faces at inserted vertices of `refined`.
fn clean(
    mesh: &Mesh,
    refined: &Refined,
    chamfers: &Chamfers,
    report: &mut Report,
) -> Result<Cleaned, MeshError> {
    let n_old = mesh.n_verts();
    let placement = &chamfers.placement;
    let is_moved = |v: Vert| placement.outcomes[v.index() - n_old] == Outcome::Moved;
    let mut edit = Edit::new(refined, n_old);
    let created = match &chamfers.regions {
        None => {
            report.degenerate_faces = Some(collapse_degenerate_faces(&mut edit, &refined.children, is_moved));
            edges_at_inserted(&refined.mesh, &refined.children, n_old)
        }
        Some(regions) => {
            let is_chamfer_end = chamfer_ends(mesh, &chamfers.labels);
            let context = Context {
                before: mesh,
                refined,
                fit: &|v| regions.fits.get(v),
                is_chamfer_end: &|v| is_chamfer_end[v],
                is_moved: &is_moved,
                mean_edge: regions.mean_edge,
            };
            report.untangled = Some(untangle(&context, &mut edit));
            refined.creases.clone()
        }
    };
    let Edited { mesh, lineage, now, replaced } = edit.finish(mesh, &placement.inserts)?;
    report.replaced_vertices = replaced.iter().map(|v| v.index()).collect();
    Ok(Cleaned { mesh, lineage, created, now })
}

fn edges_at_inserted(refined: &Mesh, faces: &[Face], n_old: usize) -> Vec<[Vert; 2]> {
    let edges = |f: &Face| f.halves().map(|h| [refined.from(h), refined.to(h)]);
    let at_inserted = |edge: &[Vert; 2]| edge.iter().any(|v| v.index() >= n_old);
    faces.iter().flat_map(edges).filter(at_inserted).collect()
}

fn chamfer_ends(mesh: &Mesh, labels: &Labels) -> PerVert<bool> {
    let mut is_end = PerVert::filled(mesh.n_verts(), false);
    for h in mesh.halves().filter(|&h| labels.chamfer_edge[h]) {
        is_end[mesh.from(h)] = true;
    }
    is_end
}

/// Finds the sharp edges of the cleaned mesh. `mesh` is the input.
fn find_tags(mesh: &Mesh, chamfers: &Chamfers, cleaned: &Cleaned, method: Method) -> Tags {
    let labels = &chamfers.labels;
    let n_old = mesh.n_verts();
    let is_tagged = |v: &Vert| v.index() >= n_old || labels.tagged_vertex[*v];
    let now = |edge: [Vert; 2]| edge.map(|v| cleaned.now[v]);
    if method == Method::Paper {
        let mut tagged = PerVert::filled(cleaned.mesh.n_verts(), false);
        for v in (0..cleaned.now.len()).map(Vert::new).filter(is_tagged) {
            tagged[cleaned.now[v]] = true;
        }
        return Tags::between_tagged(&cleaned.mesh, &tagged);
    }
    let old: Vec<Half> = match &chamfers.regions {
        None => mesh.edges().filter(|&h| labels.sharp_edge[h]).collect(),
        Some(regions) => regions.sharp_already(mesh, &labels.smooth_edge),
    };
    let old = old.into_iter().map(|h| [mesh.from(h), mesh.to(h)]);
    let created = cleaned.created.iter().copied().filter(|edge| edge.iter().all(is_tagged));
    Tags::where_bent(&cleaned.mesh, old.chain(created).map(now))
}
