//! One file: read, sharpen, write, say what came of it.

use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, Result};
use serde::Serialize;
use sharpen::bend::precision;
use sharpen::error::display_name;
use sharpen::place::Outcome;
use sharpen::report::Seconds;
use sharpen::tags::polylines;
use sharpen::weld::weld;
use sharpen::{Mesh, Report, io, paint};

use crate::batch;
use crate::cli::Arguments;

/// Does what the command line asks for.
///
/// # Errors
/// One line that says what failed. No output is written unless all of it can be.
pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    if let Some(generated) = arguments.generate {
        generated.print()?;
        return Ok(ExitCode::SUCCESS);
    }
    if arguments.input.is_dir() && arguments.input != Path::new("-") {
        return batch::sharpen_folder(arguments);
    }
    arguments.folder.refuse_for_a_file();
    start_threads(arguments.threads.map_or(0, usize::from))?;
    let done = sharpen_file(arguments, &arguments.input, &arguments.output)?;
    if let Some(path) = &arguments.report {
        io::write_bytes(path, (serde_json::to_string_pretty(&done)? + "\n").as_bytes())?;
    }
    if !arguments.quiet {
        let name = display_name(&arguments.input);
        done.notices.iter().for_each(|notice| eprintln!("{name}: {notice}"));
        welded(&done.report).into_iter().for_each(|welded| eprintln!("{name}: {welded}"));
        eprintln!("{}", summary(&arguments.input, &done.report));
    }
    if arguments.verbose {
        eprint!("{}", details(&done.report));
    }
    Ok(ExitCode::SUCCESS)
}

/// Starts threads so that there are `n` with this one, or one per core where it is 0. This one takes part in the
/// work: handing each pass of a small file to another thread and back costs a tenth of its time.
///
/// # Errors
/// When the system gives no threads.
pub fn start_threads(n: usize) -> Result<()> {
    Ok(rayon::ThreadPoolBuilder::new().num_threads(n).use_current_thread().build_global()?)
}

/// What became of one file.
#[derive(Serialize)]
pub struct Done {
    /// What was found and done.
    #[serde(flatten)]
    pub report: Report,
    /// What of the file could not be kept, one line each.
    pub notices: Vec<String>,
}

/// Sharpens the mesh in the file `input` into the file `output`. Nothing but these (and what `--classes`
/// names) is read or written, and nothing is said. Where nothing is found, and the format stays, the output
/// is the input byte for byte.
///
/// # Errors
/// One line that says what failed. No output is written unless all of it can be.
pub fn sharpen_file(arguments: &Arguments, input: &Path, output: &Path) -> Result<Done> {
    let mut seconds = Seconds::default();
    let bytes = seconds.time("read", || io::read_bytes(input))?;
    let (source, target) = (arguments.format_of(input)?, arguments.format_of(output)?);
    let model = seconds.time("parse", || io::parse_as(&bytes, &display_name(input), source))?;
    // A file can be read again, if need be; a stream cannot.
    let bytes = (input == Path::new("-")).then_some(bytes);
    let (mut attributes, mut notices) = (model.attributes, model.notices);
    let name = || display_name(input);
    let mut mesh = Mesh::new(model.points, model.faces).with_context(name)?;
    // Twins are made when first asked for.
    let borders = seconds.time("twins", || mesh.border_verts());
    if let Some(firsts) = weld(mesh.points(), borders, arguments.weld) {
        let (points, mut faces) = mesh.into_parts();
        attributes.join(&mut faces, &firsts);
        mesh = Mesh::new(points, faces).with_context(name)?;
    }
    let mut options = arguments.options();
    if arguments.no_sharpen {
        options.sharp_edges = attributes.line_edges();
    }
    if options.bend > 0 {
        options.precision = precision(mesh.points());
    }
    let (mut sharpened, attributes, lost) =
        sharpen::sharpen_with_attributes(&mesh, attributes, &options).with_context(name)?;
    seconds.append(&mut sharpened.report.seconds);
    let painted = sharpened.labels.as_ref().map(|labels| paint::paint(&mesh, labels));
    notices.extend(lost);

    if !sharpened.report.changed && source == target {
        let same = bytes.map_or_else(|| io::read_bytes(input), Ok)?;
        seconds.time("write", || io::write_bytes(output, &same))?;
        notices.clear(); // The copy has all that was left out on reading.
    } else {
        let parted = attributes.part(mesh.points(), &sharpened.mesh);
        drop(mesh);
        let (points, faces) = match &parted {
            Some((points, faces)) => (points.as_slice(), faces.as_slice()),
            None => (sharpened.mesh.points(), sharpened.mesh.faces()),
        };
        let view = io::View { points, faces, attributes: &attributes };
        notices.extend(io::losses(view, target));
        seconds.time("write", || io::write_as(output, view, target))?;
    }
    if let (Some(path), Some(painted)) = (&arguments.classes, painted) {
        io::write_bytes(path, &painted)?;
    }
    if let Some(path) = &arguments.sharp_edges {
        let lines = polylines(&sharpened.tags);
        io::write_bytes(path, &io::format_polylines(sharpened.mesh.points(), &lines))?;
    }
    Ok(Done { report: Report { seconds, ..sharpened.report }, notices })
}

/// One line that says what came of it.
fn summary(input: &Path, report: &Report) -> String {
    let moved = report.inserted.get(&Outcome::Moved).copied().unwrap_or(0);
    let inserted: usize = report.inserted.values().sum();
    let name = display_name(input);
    if let Some(unfit) = unfit(report) {
        return format!("{name}: {unfit}");
    }
    if report.found.smooth_edges == 0 && report.changed {
        return format!("{name}: not sharpened; {} -> {} faces", report.input.faces, report.output.faces);
    }
    let found = &report.found;
    let rounded = if found.rounded_edges > found.chamfer_edges {
        format!("; {} edges are left as rounded ones (--rounds)", found.rounded_edges)
    } else {
        String::new()
    };
    if !report.changed {
        return format!("{name}: nothing to sharpen in {} faces{rounded}", report.input.faces);
    }
    let corners = found.corner_triangles + found.apexes;
    format!(
        "{name}: {} chamfer edges and {} corners; {moved} of {inserted} new vertices on the feature; {} -> {} faces{rounded}",
        found.chamfer_edges, corners, report.input.faces, report.output.faces,
    )
}

/// Why nothing was sharpened, if the mesh is not the kind of input for it.
pub fn unfit(report: &Report) -> Option<String> {
    let why = report.unfit.as_ref()?;
    let (before, after) = (report.input.faces, report.output.faces);
    let what = if report.changed { "bent and not sharpened" } else { "left as it is" };
    let faces = if report.changed { format!("; {before} -> {after} faces") } else { String::new() };
    Some(format!("{what}: {why}{faces}"))
}

/// Which vertices count as one, if any do.
fn welded(report: &Report) -> Option<String> {
    let (n, all) = (report.left_alone.joined_vertices, report.input.vertices);
    (n > 0).then(|| format!("{n} of {all} vertices count as one with an earlier one in their place (--weld)"))
}

/// What `--verbose` adds, line by line.
fn details(report: &Report) -> String {
    let mut lines = vec![format!("smooth below {:.3} degrees", report.found.threshold_deg)];
    let in_the_middle = report.inserted.iter().filter(|&(&outcome, _)| outcome != Outcome::Moved);
    lines.extend(in_the_middle.map(|(outcome, count)| format!("left in the middle, {outcome}: {count}")));
    if let Some(mended) = report.degenerate_faces {
        let (collapsed, flipped, left) = (mended.collapsed, mended.flipped, mended.left);
        lines.push(format!("degenerate faces: {collapsed} collapsed, {flipped} flipped, {left} left"));
    }
    if let Some(untangled) = report.untangled {
        let (bad, collapsed, flipped) = (untangled.bad_before, untangled.collapsed, untangled.flipped);
        let left = untangled.left;
        lines.push(format!(
            "{bad} bad faces, slivers not counted: {collapsed} edges collapsed, {flipped} flipped; {left} left, slivers counted"
        ));
        if untangled.loosened > 0 {
            lines.push(format!("{} edges of four faces have two now", untangled.loosened));
        }
    }
    if let Some(verdict) = &report.verdict {
        let percent = |share: f64| format!("{:.1} %", 100.0 * share);
        let (creases, corners) = (verdict.creases.len(), verdict.corners.len());
        let recovered = percent(verdict.recovered);
        lines.push(format!("{creases} creases and {corners} corners: {recovered} of the chamfers"));
        let abstained = verdict.abstained.iter();
        lines.extend(abstained.map(|(why, share)| format!("left alone, {why}: {}", percent(*share))));
        if verdict.impossible > 0.0 {
            let impossible = percent(verdict.impossible);
            lines.push(format!("beyond reach (smooth faces under three samples wide): {impossible}"));
        }
    }
    let defects = report.left_alone.defects;
    let census = report.left_alone.census.unwrap_or_default();
    for (count, what) in [
        (report.left_alone.border_edges, "sides of faces without a neighbour"),
        (defects.non_manifold_edges, "non-manifold edges"),
        (defects.misoriented_edges, "edges where faces disagree on the orientation"),
        (defects.collapsed_faces, "faces that name a vertex twice"),
        (census.zero_area_faces, "faces without area"),
        (census.doubled_faces, "faces with the corners of another"),
        (census.isolated_vertices, "vertices without a face"),
    ] {
        if count > 0 {
            lines.push(format!("left alone: {count} {what}"));
        }
    }
    lines.extend(report.seconds.stages().iter().map(|(stage, s)| format!("{stage}: {:.1} ms", 1e3 * s)));
    lines.iter().map(|line| format!("  {line}\n")).collect()
}
