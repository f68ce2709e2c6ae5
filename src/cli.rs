//! The command line: degrees become radians here, once.

use std::path::{Path, PathBuf};

use clap::Parser;
use sharpen::classify::SmoothThreshold;
use sharpen::error::Error;
use sharpen::weld::Weld;
use sharpen::{Method, Options, io};

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
    /// The mesh to sharpen: OBJ, PLY, STL or OFF; `-` for standard input (with --format).
    pub input: PathBuf,

    /// Where the sharpened mesh goes, in any of these formats; may be the input.
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
    /// [default: 1.5; with --paper no created edge may be longer than the longest one of the input].
    #[arg(long, value_name = "TIMES", value_parser = positive_or_zero)]
    pub max_shift: Option<f64>,

    /// Which vertices of the file count as one: none, exact (those with equal coordinates), or those
    /// within a distance. The output keeps the file's own vertices.
    #[arg(long, value_name = "none|exact|DISTANCE", default_value = "exact")]
    pub weld: Weld,

    /// Format of files whose name does not tell it, such as `-`, standard input and output.
    #[arg(long, value_name = "FORMAT", value_parser = io::Format::NAMES)]
    pub format: Option<String>,

    /// Also write the input mesh painted as in the papers' figures: red smooth regions, green corner
    /// triangles, blue chamfer edges, brown smooth edges.
    #[arg(long, value_name = "FILE.ply")]
    pub classes: Option<PathBuf>,

    /// Also write what was found and done, as JSON.
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
    /// What the library is asked to do.
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
            keep_labels: self.classes.is_some(),
        }
    }
}
