//! The command line: degrees become radians here, once.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::Parser;
use sharpen::classify::SmoothThreshold;
use sharpen::place::Outcome;
use sharpen::{Mesh, Method, Options, Report, io, paint};

/// Gives a triangle mesh back the sharp edges and corners that sampling took away.
///
/// Marching cubes, scanners, remeshers and generators cut every crease off into a strip of chamfer
/// triangles. sharpen finds these strips and puts new vertices where the smooth surfaces on both sides
/// meet. Everything else stays as it is: the same vertices in the same order, bit for bit.
#[derive(Parser, Debug)]
#[command(
    version,
    after_help = "Exit status: 0 done (also when nothing was found), 1 failed, 2 wrong usage."
)]
pub struct Arguments {
    /// The mesh to sharpen (OBJ).
    input: PathBuf,

    /// Where the sharpened mesh goes; may be the input.
    output: PathBuf,

    /// Run the papers' algorithm to the letter.
    #[arg(long)]
    paper: bool,

    /// Edges count as smooth below this many times the mesh's mean dihedral angle [default: 2].
    #[arg(long, value_name = "FACTOR", value_parser = positive_or_zero)]
    smooth_factor: Option<f64>,

    /// Edges count as smooth below this dihedral angle, in degrees; at 0 nothing is found.
    #[arg(long, value_name = "DEG", conflicts_with = "smooth_factor", value_parser = degrees)]
    smooth_angle: Option<f64>,

    /// The farthest that a new vertex may go from the middle of its edge, in lengths of that edge
    /// [default: 1.5; with --paper no created edge may be longer than the longest one of the input].
    #[arg(long, value_name = "TIMES", value_parser = positive_or_zero)]
    max_shift: Option<f64>,

    /// Also write the input mesh painted as in the papers' figures: red smooth regions, green corner
    /// triangles, blue chamfer edges, brown smooth edges.
    #[arg(long, value_name = "FILE.ply")]
    classes: Option<PathBuf>,

    /// Also write what was found and done, as JSON.
    #[arg(long, value_name = "FILE.json")]
    report: Option<PathBuf>,

    /// Number of threads [default: one per core]. The result does not depend on it.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    threads: Option<u16>,

    /// Say more about what was found and how long it took.
    #[arg(short, long)]
    verbose: bool,

    /// Say nothing but errors.
    #[arg(short, long, conflicts_with = "verbose")]
    quiet: bool,
}

fn positive_or_zero(word: &str) -> Result<f64, String> {
    let number: f64 = word.parse().map_err(|_| format!("{word:?} is not a number"))?;
    if number.is_finite() && number >= 0.0 { Ok(number) } else { Err(format!("{word} is not 0 or more")) }
}

fn degrees(word: &str) -> Result<f64, String> {
    let angle = positive_or_zero(word)?;
    if angle <= 180.0 { Ok(angle) } else { Err(format!("{word} is more than 180 degrees")) }
}

impl Arguments {
    fn options(&self) -> Options {
        let defaults = Options::default();
        let factor = self.smooth_factor.map(SmoothThreshold::MeanTimes);
        let angle = self.smooth_angle.map(|angle| SmoothThreshold::Angle(angle.to_radians()));
        Options {
            method: if self.paper { Method::Paper } else { defaults.method },
            smooth: factor.or(angle).unwrap_or(defaults.smooth),
            max_shift: self.max_shift,
            keep_labels: self.classes.is_some(),
        }
    }
}

/// Does what the command line asks for.
///
/// # Errors
/// One line that says what failed. No output is written unless all of it can be.
pub fn run(arguments: &Arguments) -> Result<()> {
    if let Some(threads) = arguments.threads {
        rayon::ThreadPoolBuilder::new().num_threads(threads.into()).build_global()?;
    }
    sharpen_file(arguments)
}

fn sharpen_file(arguments: &Arguments) -> Result<()> {
    let mut model = io::read(&arguments.input)?;
    let mesh = Mesh::new(model.points, model.faces).with_context(|| arguments.input.display().to_string())?;
    let sharpened = sharpen::sharpen(&mesh, &arguments.options())?;
    for lineage in &sharpened.lineage {
        let sharp = sharpened.tags.sharp_edges();
        let (carried, notices) = model.attributes.carry(lineage, &mesh, &sharpened.mesh, sharp);
        model.attributes = carried;
        model.notices.extend(notices);
    }
    let painted = sharpened.labels.as_ref().map(|labels| paint::paint(&mesh, labels));
    let report = serde_json::to_string_pretty(&sharpened.report)? + "\n";
    drop(mesh);

    let view = io::View {
        points: sharpened.mesh.points(),
        faces: sharpened.mesh.faces(),
        attributes: &model.attributes,
    };
    io::write(&arguments.output, view)?;
    if let (Some(path), Some(painted)) = (&arguments.classes, painted) {
        io::write_bytes(path, &painted)?;
    }
    if let Some(path) = &arguments.report {
        io::write_bytes(path, report.as_bytes())?;
    }
    if !arguments.quiet {
        model.notices.iter().for_each(|notice| eprintln!("{}: {notice}", arguments.input.display()));
        eprintln!("{}", summary(&arguments.input, &sharpened.report));
    }
    if arguments.verbose {
        eprint!("{}", details(&sharpened.report));
    }
    Ok(())
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
    if let Some(mended) = report.degenerate_faces {
        let (collapsed, flipped, left) = (mended.collapsed, mended.flipped, mended.left);
        lines.push(format!("degenerate faces: {collapsed} collapsed, {flipped} flipped, {left} left"));
    }
    if let Some(untangled) = report.untangled {
        let (bad, collapsed, flipped) = (untangled.bad_before, untangled.collapsed, untangled.flipped);
        let left = untangled.left;
        lines.push(format!("{bad} bad faces: {collapsed} edges collapsed, {flipped} flipped; {left} left"));
    }
    let defects = report.left_alone.defects;
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
