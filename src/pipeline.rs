//! What each reading of the algorithm does at each step.
//!
//! The readings differ in how chamfers are found and placed, how the result is cleaned and what counts as
//! sharp; what they hand on is the same: labels, inserts, tags.

use rayon::prelude::*;

use crate::classify::{Labels, SmoothThreshold, classify, classify_interior, red_edges};
use crate::collapse::{CollapseCounts, collapse_degenerate_faces};
use crate::edit::Edit;
use crate::excerpt::{Excerpt, Now, RINGS, Rejoined};
use crate::mesh::{Face, Half, Mesh, MeshError, PerHalf, Vert};
use crate::options::{Method, Options};
use crate::place::{Outcome, Placement, place};
use crate::refine::{Child, Inserts, Lineage, Split, split};
use crate::regions::{RegionLabels, label_by_fits, place_by_fits, verdict};
use crate::report::{Found, Report, Seconds};
use crate::subset::Subset;
use crate::tags::{Tags, tags_by_dihedral};
use crate::untangle::{Context, UntangleCounts, untangle};
use crate::{Origin, Rebuild, Sharpened};

/// Finds the chamfers of `mesh` and puts its sharp edges back.
pub(crate) fn sharpen(
    mesh: &Mesh,
    options: &Options,
    report: &mut Report,
    on_rebuild: &mut Option<&mut dyn FnMut(Rebuild<'_>)>,
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
        report.found.chamfer_edges = regions.chamfers.len();
        report.found.apexes = regions.apexes.len();
        report.found.rounded_edges = regions.n_rounded();
        let verdict = || verdict(mesh, regions, &chamfers.placement);
        report.verdict = options.keep_verdict.then(|| seconds.time("verdict", verdict));
    }

    let split = seconds.time("refine", || split(mesh, inserts))?;
    let keeps_lineage = report.changed && on_rebuild.is_some();
    let cleaned = seconds.time("clean", || clean(mesh, split, &chamfers, report, keeps_lineage))?;
    let tags = seconds.time("tags", || find_tags(mesh, &chamfers, &cleaned, options.method));
    if let (Some(on_rebuild), Some(lineage)) = (on_rebuild, &cleaned.lineage) {
        on_rebuild(Rebuild { old: mesh, new: &cleaned.mesh, tags: &tags, origin: Origin::Listed(lineage) });
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
    /// The colours. By region fits corner triangles are those of the fits, and chamfer edges if labels are kept.
    pub labels: Labels,
    /// The fits, where they were made.
    pub regions: Option<RegionLabels>,
    pub placement: Placement,
    /// Why nothing was looked for, if nothing was.
    pub unfit: Option<String>,
}

/// Above this threshold for smooth edges, in radians, a mesh is too noisy or terraced: 40 degrees. Clean
/// samplings have 4 to 18, with noise of 5 % of the edges up to 34, of which they still gain; from 57 on
/// nothing but spikes came of it. Coarse meshes on whose flat sides decimation by quadrics left folded slivers have 40 to
/// 54, without these edges mostly 30 to 36.
const MAX_THRESHOLD: f64 = 40.0 * std::f64::consts::PI / 180.0;
/// With a smaller share of interior vertices there is no smooth region to speak of. Sampled parts have
/// 0.4 and more, a body of cubes 0.04.
const MIN_INTERIOR_SHARE: f64 = 0.05;

/// Whether the mesh may turn out not to be the kind of input that can be sharpened.
fn is_questioned(options: &Options) -> bool {
    options.method != Method::Paper && !matches!(options.smooth, SmoothThreshold::Angle(_))
}

/// Why a mesh is not the kind of input that can be sharpened, if it is not. A threshold that the caller
/// chose is never questioned, and neither is the strict algorithm.
fn unfit(mesh: &Mesh, labels: &Labels, options: &Options) -> Option<String> {
    if !is_questioned(options) {
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
    let mut rules = options.classify_options();
    let mut labels = seconds.time("classify", || colour(mesh, &normals, &rules));
    if is_questioned(options) && labels.threshold > MAX_THRESHOLD {
        rules.folds_count = false;
        labels = seconds.time("classify", || colour(mesh, &normals, &rules));
    }
    let unfit = unfit(mesh, &labels, options);
    if unfit.is_some() {
        labels = classify(mesh, &normals, &rules);
        labels.chamfer_edge = PerHalf::filled(mesh.n_halves(), false);
        labels.corner_faces.clear();
        let placement = Placement { inserts: Inserts::none(), outcomes: Vec::new() };
        return Chamfers { labels, regions: None, placement, unfit };
    }
    if options.method != Method::Regions {
        let placement = seconds.time("place", || place(mesh, &normals, &labels, &options.place_rules()));
        return Chamfers { labels, regions: None, placement, unfit };
    }
    let mut regions = seconds.time("regions", || label_by_fits(mesh, &normals, &labels, options.max_round));
    let placement = seconds.time("place", || place_by_fits(mesh, &regions, options.max_shift));
    labels.corner_faces.clone_from(&regions.corner_faces);
    labels.red_face = std::mem::take(&mut regions.red_face);
    if options.keep_labels {
        labels.chamfer_edge = regions.chamfer_edge(mesh);
        labels.red_edge = red_edges(mesh, &labels.red_face);
        labels.abstained = regions.abstained();
        labels.beyond_reach = regions.beyond_reach(mesh);
    }
    Chamfers { labels, regions: Some(regions), placement, unfit }
}

/// A sharpened mesh without its degenerate or folded faces.
struct Cleaned {
    pub mesh: Mesh,
    /// Where its faces come from, if that was asked for.
    pub lineage: Option<Lineage>,
    /// Edges that subdivision created and that may be sharp, before cleaning.
    created: Vec<[Vert; 2]>,
    /// What each vertex before cleaning is now.
    now: Now,
}

/// Refines `mesh` round its `split` faces and cleans the faces at inserted vertices.
fn clean(
    mesh: &Mesh,
    split: Split,
    chamfers: &Chamfers,
    report: &mut Report,
    keeps_lineage: bool,
) -> Result<Cleaned, MeshError> {
    let inserts = &chamfers.placement.inserts;
    let mut rings = RINGS;
    let apexes = chamfers.regions.as_ref().map_or(&[][..], |regions| &regions.apexes);
    let tips: Vec<Vert> = apexes.iter().map(|apex| apex.vertex).collect();
    let rejoined = loop {
        let excerpt = Excerpt::new(mesh, inserts, &split, &tips, rings);
        let mut edit = Edit::new(&excerpt.refined, excerpt.n_old(), &excerpt.is_whole);
        match &chamfers.regions {
            None => report.degenerate_faces = Some(mend_degenerate_faces(&excerpt, chamfers, &mut edit)),
            Some(regions) => {
                let mut counts = untangle_excerpt(mesh, &excerpt, chamfers, regions, &mut edit);
                let own = apexes.iter().filter_map(|apex| Some((apex, excerpt.own(apex.vertex)?)));
                own.for_each(|(apex, tip)| {
                    counts.flipped += apex.flip_valleys(tip, regions.mean_edge, &mut edit)
                });
                report.untangled = Some(counts);
            }
        }
        if !edit.is_at_fringe() {
            let edited = edit.finish(mesh, inserts, |v| excerpt.whole(v), keeps_lineage)?;
            break excerpt.rejoin(edited, keeps_lineage);
        }
        rings += 1;
    };
    report.left_alone.take_loosened(report.untangled.map_or(0, |untangled| untangled.loosened));
    let Rejoined { mesh: cleaned, lineage, now, replaced } = rejoined;
    report.replaced_vertices = replaced.iter().map(|v| v.index()).collect();
    let created = match &chamfers.regions {
        None => edges_at_inserted(&split, mesh.n_verts()),
        Some(_) => split.creases,
    };
    Ok(Cleaned { mesh: cleaned, lineage, created, now })
}

fn mend_degenerate_faces(excerpt: &Excerpt<'_>, chamfers: &Chamfers, edit: &mut Edit<'_>) -> CollapseCounts {
    let is_moved = |v: Vert| chamfers.placement.outcomes[v.index() - excerpt.n_old()] == Outcome::Moved;
    collapse_degenerate_faces(edit, &excerpt.refined.children, is_moved)
}

fn untangle_excerpt(
    mesh: &Mesh,
    excerpt: &Excerpt<'_>,
    chamfers: &Chamfers,
    regions: &RegionLabels,
    edit: &mut Edit<'_>,
) -> UntangleCounts {
    let ends = regions.chamfers.iter().flat_map(|&h| mesh.ends(h));
    let chamfer_ends = Subset::of(mesh.n_verts(), ends);
    let context = Context {
        before: mesh,
        excerpt: Some(excerpt),
        refined: &excerpt.refined,
        n_old: excerpt.n_old(),
        fits: excerpt.old_verts().par_iter().map(|&v| regions.fits.get(v)).collect::<Vec<_>>().into(),
        is_chamfer_end: &|v| chamfer_ends.contains(excerpt.whole(v)),
        is_moved: &|v| chamfers.placement.outcomes[v.index() - excerpt.n_old()] == Outcome::Moved,
        mean_edge: regions.mean_edge,
    };
    untangle(&context, edit)
}

fn edges_at_inserted(split: &Split, n_old: usize) -> Vec<[Vert; 2]> {
    let edges = |child: &Child| [0, 1, 2].map(|i| [child[i].0, child[(i + 1) % 3].0]);
    let at_inserted = |edge: &[Vert; 2]| edge.iter().any(|v| v.index() >= n_old);
    split.children.iter().flat_map(edges).filter(at_inserted).collect()
}

/// Finds the sharp edges of the cleaned mesh. `mesh` is the input.
fn find_tags(mesh: &Mesh, chamfers: &Chamfers, cleaned: &Cleaned, method: Method) -> Tags {
    let labels = &chamfers.labels;
    let n_old = mesh.n_verts();
    let is_tagged = |v: &Vert| v.index() >= n_old || labels.tagged_vertex[*v];
    let now = |edge: [Vert; 2]| edge.map(|v| cleaned.now.of(v));
    if method == Method::Paper {
        let n_inserted = chamfers.placement.inserts.points.len();
        let tagged = (0..n_old + n_inserted).map(Vert::new).filter(is_tagged).map(|v| cleaned.now.of(v));
        return Tags::between_tagged(&cleaned.mesh, tagged);
    }
    let old: Vec<Half> = match &chamfers.regions {
        None => mesh.edges().filter(|&h| labels.sharp_edge[h]).collect(),
        Some(regions) => regions.sharp_already(mesh, &labels.smooth_edge),
    };
    let created = cleaned.created.iter().copied().filter(|edge| edge.iter().all(is_tagged));
    let candidates = old.iter().map(|&h| mesh.ends(h)).chain(created).map(now);
    // All edges that subdivision created are in the excerpt.
    let halves = old.iter().flat_map(|&h| [Some(h), mesh.twin(h)]).flatten();
    let mut faces: Vec<Face> = halves.filter_map(|h| cleaned.now.face(h.face())).collect();
    faces.sort_unstable();
    faces.dedup();
    faces.extend(cleaned.now.faces_of_excerpt());
    let bent = Tags::where_bent_beside(&cleaned.mesh, &faces, candidates);
    let apexes = chamfers.regions.iter().flat_map(|regions| &regions.apexes);
    bent.with_tagged(apexes.map(|apex| cleaned.now.of(apex.vertex)))
}
