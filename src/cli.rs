//! The command line: degrees become radians here, once.

use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::error::ErrorKind;
use clap::{CommandFactory, Parser};
use globset::{GlobBuilder, GlobMatcher};
use sharpen::classify::SmoothThreshold;
use sharpen::error::Error;
use sharpen::options::DEFAULT_MAX_FACES;
use sharpen::weld::Weld;
use sharpen::{Method, Options, io};

use crate::generate::Generated;

/// Gives a triangle mesh back the sharp edges and corners that sampling took away.
///
/// Marching cubes, scanners, remeshers and generators cut every crease off into a strip of chamfer
/// triangles. sharpen finds these strips and puts new vertices where the smooth surfaces on both sides
/// meet. Away from creases everything stays as it is: the same vertices in the same order, bit for bit.
#[derive(Parser, Clone, Debug)]
#[command(override_usage = "sharpen [OPTIONS] <INPUT> <OUTPUT>\n       sharpen --generate <WHAT>")]
#[command(version, after_help = EXIT_STATUS, after_long_help = format!("{FOLDERS}\n\n{EXIT_STATUS}"))]
pub struct Arguments {
    /// The mesh to sharpen: OBJ, PLY, STL or OFF; `-` for standard input (with --format). Or a folder of
    /// meshes.
    #[arg(required_unless_present = "generate", default_value = "-", hide_default_value = true)]
    pub input: PathBuf,

    /// Where the sharpened mesh goes, in any of these formats; may be the input. For a folder, a folder,
    /// which may not be the input.
    #[arg(required_unless_present = "generate", default_value = "-", hide_default_value = true)]
    pub output: PathBuf,

    /// Run the papers' algorithm to the letter.
    #[arg(long)]
    pub paper: bool,

    /// Edges count as smooth below this many times the mesh's mean dihedral angle [default: 2].
    #[arg(long, value_name = "FACTOR", value_parser = positive_or_zero)]
    pub smooth_factor: Option<f64>,

    /// Edges count as smooth below this dihedral angle, in degrees; at 0 nothing is found.
    #[arg(long, value_name = "DEG", conflicts_with = "smooth_factor", value_parser = degrees)]
    pub smooth_angle: Option<f64>,

    /// The farthest that a new vertex may go from the middle of its edge, in lengths of that edge
    /// [default: 1.5, between flat sides 3; with --paper no created edge may be longer than the longest
    /// one of the input].
    #[arg(long, value_name = "TIMES", value_parser = positive_or_zero)]
    pub max_shift: Option<f64>,

    /// Rounded edges up to this radius, in mean edge lengths, become sharp as well: those of meshes that were
    /// smoothed, or made from blurred or learned fields. The tool cannot tell them from true rounds
    /// [default: .65 or so, what sampling explains].
    #[arg(long, value_name = "RADIUS", conflicts_with = "paper", value_parser = positive_or_zero)]
    pub rounds: Option<f64>,

    /// Bend the result N times: each level splits every face in four, rounds what is smooth, turns sharp
    /// edges into smooth curves and keeps them sharp.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub bend: u32,

    /// Take noise out by N rounds of Laplacian smoothing that leaves sharp edges alone, before bending.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub denoise: usize,

    /// Look for no chamfers: bend or denoise the mesh as it is. Sharp are the edges that the file names as
    /// `l` elements, and those of --sharp-angle.
    #[arg(long)]
    pub no_sharpen: bool,

    /// With --no-sharpen, edges with at least this dihedral angle are sharp, in degrees.
    #[arg(long, value_name = "DEG", requires = "no_sharpen", value_parser = degrees)]
    pub sharp_angle: Option<f64>,

    /// Also write the sharp edges of the output as polylines (`l` elements) from corner to corner.
    #[arg(long, value_name = "FILE.obj")]
    pub sharp_edges: Option<PathBuf>,

    /// Refuse to bend beyond this many faces.
    #[arg(long, value_name = "N", default_value_t = DEFAULT_MAX_FACES)]
    pub max_faces: usize,

    /// Which vertices of the file count as one: none, exact (those with equal coordinates), or those
    /// within a distance. The output keeps the file's own vertices.
    #[arg(long, value_name = "none|exact|DISTANCE", default_value = "exact")]
    pub weld: Weld,

    /// Format of files whose name does not tell it, such as `-`, standard input and output.
    #[arg(long, value_name = "FORMAT", value_parser = io::Format::NAMES)]
    pub format: Option<String>,

    /// Also write the input mesh painted as in the papers' figures: red smooth regions, green corner
    /// triangles, blue chamfer edges, brown smooth edges; orange is what looks like a chamfer and was left
    /// alone, violet what nothing can be said of.
    #[arg(long, value_name = "FILE.ply")]
    pub classes: Option<PathBuf>,

    /// Also write what was found and done, as JSON; for a folder as JSON lines, one for each file.
    #[arg(long, value_name = "FILE.json")]
    pub report: Option<PathBuf>,

    /// Number of threads [default: one per core]. The result does not depend on it.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub threads: Option<u16>,

    /// Say more about what was found and how long it took.
    #[arg(short, long)]
    pub verbose: bool,

    /// Say nothing but errors.
    #[arg(short, long, conflicts_with = "verbose")]
    pub quiet: bool,

    /// Print completions for a shell, or a man page, and do nothing else.
    #[arg(long, value_name = "WHAT", exclusive = true)]
    pub generate: Option<Generated>,

    /// What holds for folders only.
    #[command(flatten)]
    pub folder: FolderArguments,
}

/// What holds for folders only.
#[derive(clap::Args, Clone, Debug, Default)]
#[command(next_help_heading = "Folders")]
pub struct FolderArguments {
    /// Skip the files that an earlier run with the same options has done and that have not changed since.
    #[arg(long)]
    pub resume: bool,

    /// Only take files whose path below the folder matches, or whose name does if GLOB has no slash; may
    /// be given several times [default: every extension that can be read].
    #[arg(long, value_name = "GLOB", value_parser = glob)]
    pub include: Vec<GlobMatcher>,

    /// How many files are worked on at the same time [default: one per thread].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub jobs: Option<u16>,

    /// Give up on a file after so many seconds. Each file then has a process of its own, so that also a
    /// crash costs no other file.
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    pub timeout: Option<Duration>,

    /// Files worked on at the same time may need so much memory together, in megabytes, estimated as 20
    /// times their size, times four for each level of bending; one that needs more runs alone [default:
    /// half of the machine's].
    #[arg(long, value_name = "MB", value_parser = clap::value_parser!(u64).range(1..))]
    pub memory: Option<u64>,
}

const EXIT_STATUS: &str = "\
Exit status: 0 done (also when nothing was found), 1 failed (in a folder: any file), 2 wrong usage.";

const FOLDERS: &str = "\
A folder's files are sharpened into files of the same names below the output folder, which is made. A file \
that fails is reported and passed over. Other files (materials, textures) are not copied. Links to files are \
read, links to folders not followed. The output folder may lie in the input folder; what it holds is no \
input, and neither are the outputs of other runs.

No output is ever half written: a run that is killed leaves only whole files, and temporary files that the \
next run removes. The file .sharpen-state.jsonl in the output folder says which outputs are whole, by which \
options, and when their inputs were changed; --resume goes by it. It tries again what failed.

A line of the --report has a name, a status (ok, failed or skipped), for the last two a reason, the seconds \
it took, notices of what of the file could not be kept, and under \"report\" what the report of a single \
file has. It is written as soon as the file is done. --resume keeps the lines of the files that it skips, \
so that in the end there is one line for each file.

Also works one file at a time:
  find in -name '*.obj' -print0 | xargs -0 -P 4 -I{} sharpen -q {} {}
  parallel sharpen -q {} out/{/} ::: in/*.obj
  out/%.obj: in/%.obj ; sharpen -q $< $@      (in a makefile)";

fn positive_or_zero(word: &str) -> Result<f64, String> {
    let number: f64 = word.parse().map_err(|_| format!("{word:?} is not a number"))?;
    if number.is_finite() && number >= 0.0 { Ok(number) } else { Err(format!("{word} is not 0 or more")) }
}

fn seconds(word: &str) -> Result<Duration, String> {
    let seconds = positive_or_zero(word)?;
    let duration = Duration::try_from_secs_f64(seconds).map_err(|_| format!("{word} is too long"))?;
    if duration.is_zero() { Err(format!("{word} is no time at all")) } else { Ok(duration) }
}

fn glob(word: &str) -> Result<GlobMatcher, String> {
    let glob = GlobBuilder::new(word).literal_separator(true).build();
    glob.map(|glob| glob.compile_matcher()).map_err(|error| error.kind().to_string())
}

fn degrees(word: &str) -> Result<f64, String> {
    let angle = positive_or_zero(word)?;
    if angle <= 180.0 { Ok(angle) } else { Err(format!("{word} is more than 180 degrees")) }
}

impl Arguments {
    /// The format of a file by its name, else by `--format`.
    pub fn format_of(&self, path: &Path) -> Result<io::Format, Error> {
        let named = self.format.as_deref().and_then(io::Format::by_name);
        match (io::Format::of(path), named) {
            (Ok(format), _) | (Err(_), Some(format)) => Ok(format),
            (Err(error), None) => Err(error),
        }
    }

    /// What the library is asked to do.
    pub fn options(&self) -> Options {
        let defaults = Options::default();
        let factor = self.smooth_factor.map(SmoothThreshold::MeanTimes);
        let angle = self.smooth_angle.map(|angle| SmoothThreshold::Angle(angle.to_radians()));
        Options {
            method: if self.paper { Method::Paper } else { defaults.method },
            smooth: factor.or(angle).unwrap_or(defaults.smooth),
            max_shift: self.max_shift,
            max_round: self.rounds.unwrap_or(defaults.max_round),
            sharpen: !self.no_sharpen,
            sharp_angle: self.sharp_angle.map(f64::to_radians),
            denoise: self.denoise,
            bend: self.bend,
            max_faces: self.max_faces,
            keep_labels: self.classes.is_some(),
            keep_verdict: self.report.is_some() || self.verbose,
            ..defaults
        }
    }
    /// All that an output depends on beside its input, as text: every argument but those named here.
    pub fn recipe(&self) -> String {
        let arguments = Self {
            input: PathBuf::new(),
            output: PathBuf::new(),
            report: None,
            threads: None,
            verbose: false,
            quiet: false,
            folder: FolderArguments::default(),
            ..self.clone()
        };
        format!("sharpen {} {arguments:?}", env!("CARGO_PKG_VERSION"))
    }
}

impl FolderArguments {
    /// Ends the process if one of these was given for an input that is no folder.
    pub fn refuse_for_a_file(&self) {
        let given = [
            (self.resume, "--resume"),
            (!self.include.is_empty(), "--include"),
            (self.jobs.is_some(), "--jobs"),
            (self.timeout.is_some(), "--timeout"),
            (self.memory.is_some(), "--memory"),
        ];
        if let Some((_, flag)) = given.iter().find(|(is_given, _)| *is_given) {
            wrong_usage(format!("{flag} is for folders, and the input is none"));
        }
    }
}

/// Ends the process as clap does when the arguments make no sense.
pub fn wrong_usage(message: impl std::fmt::Display) -> ! {
    Arguments::command().error(ErrorKind::ArgumentConflict, message).exit()
}
