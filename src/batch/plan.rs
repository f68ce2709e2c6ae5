//! What there is to do in a folder.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use sharpen::error::display_name;
use sharpen::io::{Format, temporary};
use walkdir::{DirEntry, WalkDir};

use super::journal::STATE;
use super::record::{Line, Name, Status};
use crate::cli::Arguments;

/// One file to sharpen.
#[derive(Debug)]
pub struct Task {
    pub name: Name,
    pub input: PathBuf,
    pub output: PathBuf,
    /// Bytes of the input.
    pub size: u64,
}

/// What there is to do in a folder.
#[derive(Debug, Default)]
pub struct Plan {
    /// In the order of their names.
    pub tasks: Vec<Task>,
    /// What is not tried, and why.
    pub others: Vec<Line>,
}

/// The two folders, without links in their paths.
struct Folders {
    input: PathBuf,
    output: PathBuf,
}

impl Plan {
    /// Walks the input folder. Nothing is written, and the output folder is not entered.
    ///
    /// # Errors
    /// When one of the folders cannot be found.
    pub fn new(arguments: &Arguments) -> Result<Self> {
        let canonical = |path: &Path| fs::canonicalize(path).with_context(|| display_name(path));
        let folders = Folders { input: canonical(&arguments.input)?, output: canonical(&arguments.output)? };
        let mut plan = Self::default();
        let mut walk = WalkDir::new(&arguments.input).sort_by_file_name().into_iter();
        while let Some(entry) = walk.next() {
            match entry {
                Ok(entry) if entry.depth() == 0 => debug_assert_eq!(entry.path(), arguments.input),
                Ok(entry) if entry.file_type().is_dir() => {
                    if !plan.enters(arguments, &folders, &entry) {
                        walk.skip_current_dir();
                    }
                }
                Ok(entry) => plan.add(arguments, &folders, &entry),
                Err(error) => {
                    let path = error.path().unwrap_or(&arguments.input);
                    let reason = error.io_error().map_or_else(|| error.to_string(), ToString::to_string);
                    plan.leave(arguments, path, Status::Failed, &format!("cannot read: {reason}"));
                }
            }
        }
        Ok(plan)
    }

    /// Whether the folder `entry` is one of inputs.
    fn enters(&mut self, arguments: &Arguments, folders: &Folders, entry: &DirEntry) -> bool {
        // No link was followed to get here.
        if folders.input.join(below(&arguments.input, entry.path())) == folders.output {
            return false;
        }
        let is_output = entry.path().join(STATE).exists();
        if is_output {
            let reason = format!("holds the outputs of another run ({STATE})");
            self.leave(arguments, entry.path(), Status::Skipped, &reason);
        }
        !is_output
    }

    /// Adds what is no folder.
    fn add(&mut self, arguments: &Arguments, folders: &Folders, entry: &DirEntry) {
        let path = entry.path();
        let below = below(&arguments.input, path);
        // What a link leads to; nothing if that is missing, which reading will say.
        let target = fs::metadata(path).ok();
        if target.as_ref().is_some_and(fs::Metadata::is_dir) {
            self.leave(arguments, path, Status::Skipped, "is a link to a folder");
            return;
        }
        if !is_wanted(arguments, below) {
            return;
        }
        if target.as_ref().is_some_and(|target| !target.is_file()) {
            self.leave(arguments, path, Status::Skipped, "is not a regular file");
        } else if is_among_inputs(folders, below) {
            self.leave(arguments, path, Status::Failed, "its output would lie among the inputs");
        } else {
            self.tasks.push(Task {
                name: Name::of(below),
                input: path.to_owned(),
                output: arguments.output.join(below),
                size: target.map_or(0, |target| target.len()),
            });
        }
    }

    /// Notes what is not tried.
    fn leave(&mut self, arguments: &Arguments, path: &Path, status: Status, reason: &str) {
        let name = Name::of(below(&arguments.input, path));
        let reason = format!("{}: {reason}", display_name(path));
        self.others.push(Line::without_mesh(name, status, reason));
    }
}

/// The path of `path` below `folder`.
fn below<'p>(folder: &Path, path: &'p Path) -> &'p Path {
    path.strip_prefix(folder).unwrap_or(path)
}

/// Whether `--include` or the extension asks for a file.
fn is_wanted(arguments: &Arguments, below: &Path) -> bool {
    let Some(name) = below.file_name() else { return false };
    if temporary::is_ours(name) {
        return false;
    }
    let globs = &arguments.folder.include;
    if globs.is_empty() {
        return Format::of(below).is_ok();
    }
    globs
        .iter()
        .any(|glob| if glob.glob().glob().contains('/') { glob.is_match(below) } else { glob.is_match(name) })
}

/// Whether the output of the file `below` is a file of the input folder: where that lies in the output
/// folder.
fn is_among_inputs(folders: &Folders, below: &Path) -> bool {
    !folders.output.starts_with(&folders.input) && folders.output.join(below).starts_with(&folders.input)
}
