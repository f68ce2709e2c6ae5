//! One file: read, sharpen, write, say what came of it.

use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, Result};
use sharpen::place::Outcome;
use sharpen::{Mesh, Report, io, paint};

use crate::batch;
use crate::cli::Arguments;

/// Does what the command line asks for.
///
/// # Errors
/// One line that says what failed. No output is written unless all of it can be.
pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    if let Some([input, output]) = arguments.folder.only_file.as_deref() {
        return batch::answer_for(arguments, input, output);
    }
    if arguments.input.is_dir() {
        return batch::sharpen_folder(arguments);
    }
    arguments.folder.refuse_for_a_file();
    if let Some(threads) = arguments.threads {
        rayon::ThreadPoolBuilder::new().num_threads(threads.into()).build_global()?;
    }
    let done = sharpen_file(arguments, &arguments.input, &arguments.output)?;
    if let Some(path) = &arguments.report {
        io::write_bytes(path, (serde_json::to_string_pretty(&done.report)? + "\n").as_bytes())?;
    }
    if !arguments.quiet {
        done.notices.iter().for_each(|notice| eprintln!("{}: {notice}", arguments.input.display()));
        eprintln!("{}", summary(&arguments.input, &done.report));
    }
    if arguments.verbose {
        eprint!("{}", details(&done.report));
    }
    Ok(ExitCode::SUCCESS)
}

/// What became of one file.
pub struct Done {
    /// What was found and done.
    pub report: Report,
    /// What of the file could not be kept, one line each.
    pub notices: Vec<String>,
}

/// Sharpens the mesh in the file `input` into the file `output`. Nothing but these (and what `--classes`
/// names) is read or written, and nothing is said.
///
/// # Errors
/// One line that says what failed. No output is written unless all of it can be.
pub fn sharpen_file(arguments: &Arguments, input: &Path, output: &Path) -> Result<Done> {
    let model = io::read(input)?;
    let mesh = Mesh::new(model.points, model.faces).with_context(|| input.display().to_string())?;
    let sharpened = sharpen::sharpen(&mesh, &arguments.options())?;
    let painted = sharpened.labels.as_ref().map(|labels| paint::paint(&mesh, labels));
    drop(mesh);

    let view = io::View {
        points: sharpened.mesh.points(),
        faces: sharpened.mesh.faces(),
        attributes: &model.attributes,
    };
    io::write(output, view)?;
    if let (Some(path), Some(painted)) = (&arguments.classes, painted) {
        io::write_bytes(path, &painted)?;
    }
    Ok(Done { report: sharpened.report, notices: model.notices })
}

/// One line that says what came of it.
fn summary(input: &Path, report: &Report) -> String {
    let moved = report.inserted.get(&Outcome::Moved).copied().unwrap_or(0);
    let inserted: usize = report.inserted.values().sum();
    let name = input.display();
    if !report.changed {
        return format!("{name}: nothing to sharpen in {} faces", report.input.faces);
    }
    format!(
        "{name}: {} chamfer edges and {} corners; {moved} of {inserted} new vertices on the feature; {} -> {} faces",
        report.found.chamfer_edges, report.found.corner_triangles, report.input.faces, report.output.faces,
    )
}

/// What `--verbose` adds, line by line.
fn details(report: &Report) -> String {
    let mut lines = vec![format!("smooth below {:.3} degrees", report.found.threshold_deg)];
    let in_the_middle = report.inserted.iter().filter(|&(&outcome, _)| outcome != Outcome::Moved);
    lines.extend(in_the_middle.map(|(outcome, count)| format!("left in the middle, {outcome}: {count}")));
    let mended = report.degenerate_faces;
    lines.push(format!(
        "degenerate faces: {} collapsed, {} flipped, {} left",
        mended.collapsed, mended.flipped, mended.left
    ));
    let defects = report.input.defects;
    for (count, what) in [
        (defects.non_manifold_edges, "non-manifold edges"),
        (defects.misoriented_edges, "edges where faces disagree on the orientation"),
        (defects.collapsed_faces, "faces that name a vertex twice"),
    ] {
        if count > 0 {
            lines.push(format!("left alone: {count} {what}"));
        }
    }
    lines.extend(report.seconds.stages().iter().map(|(stage, s)| format!("{stage}: {:.1} ms", 1e3 * s)));
    lines.iter().map(|line| format!("  {line}\n")).collect()
}
