//! What is known of earlier runs, and what this one notes.
//!
//! The state file in the output folder has a line for each output that is whole: the recipe by which it
//! was made, size and time of change of both files, and its line of the report. Four rules make it right
//! after a kill at any moment:
//!
//! 1. Before the first output is written, the lines of all outputs that will be are gone: the file is
//!    replaced in one step by one that holds the others.
//! 2. A line is added after its output is whole. A kill between leaves an output without a line, which
//!    is made again.
//! 3. The input's size and time are those from before it was read. A change meanwhile makes a line that
//!    does not hold.
//! 4. A line that was cut off by the kill is no line.
//!
//! A second run into the same folder is kept out by a lock. The report is replaced at the start, by the
//! lines that the state holds for what is skipped: however often a run was killed, and whether it wrote
//! a report, the last one has one line for each file.
//!
//! After a power failure, unlike a kill, the system may have kept the line and lost the output; its size
//! then differs from that in the line.

use std::collections::HashMap;
use std::fs::{self, Metadata, OpenOptions};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::{self, Write};
use std::path::Path;
use std::time::UNIX_EPOCH;

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;
use sharpen::error::display_name;
use sharpen::io::write_bytes;

use super::plan::Task;
use super::record::Name;

/// The name of the state file.
pub const STATE: &str = ".sharpen-state.jsonl";

/// What tells whether a file has changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stamp {
    bytes: u64,
    /// Nanoseconds since 1970.
    modified: i64,
}

impl Stamp {
    pub fn of(path: &Path) -> io::Result<Self> {
        let metadata = fs::metadata(path)?;
        Ok(Self { bytes: metadata.len(), modified: modified(&metadata)? })
    }
}

/// When a file was changed, in nanoseconds since 1970.
fn modified(metadata: &Metadata) -> io::Result<i64> {
    let time = metadata.modified()?;
    let nanoseconds = match time.duration_since(UNIX_EPOCH) {
        Ok(after) => i64::try_from(after.as_nanos()),
        Err(before) => i64::try_from(before.duration().as_nanos()).map(|n| -n),
    };
    Ok(nanoseconds.unwrap_or(i64::MAX))
}

/// What an output was made from, and how: a line of the state file.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Made {
    recipe: String,
    input: Stamp,
    output: Stamp,
    /// The line of the report, which has the name.
    line: Box<RawValue>,
}

/// The state file of an output folder.
#[derive(Debug, Default)]
pub struct State {
    made: HashMap<Name, Made>,
}

impl State {
    /// Reads the state of the output folder: nothing where there is none, or for lines that are none.
    pub fn read(folder: &Path) -> Self {
        let text = fs::read(folder.join(STATE)).unwrap_or_default();
        let read = |line| {
            let made: Made = serde_json::from_slice(line).ok()?;
            Some((serde_json::from_str(made.line.get()).ok()?, made))
        };
        Self { made: text.split(|&byte| byte == b'\n').filter_map(read).collect() }
    }

    /// Whether the output of `task` is whole, made by `recipe` from the input as it is now.
    ///
    /// The output may be younger than noted: a copy of the folder is as good.
    pub fn is_made(&self, task: &Task, recipe: &str) -> bool {
        let Some(made) = self.made.get(&task.name) else { return false };
        let output = Stamp::of(&task.output);
        made.recipe == recipe
            && Stamp::of(&task.input).is_ok_and(|input| input == made.input)
            && output.is_ok_and(|now| now.bytes == made.output.bytes && now.modified >= made.output.modified)
    }

    /// Forgets the outputs of `tasks`.
    fn forget(&mut self, tasks: &[Task]) {
        tasks.iter().for_each(|task| drop(self.made.remove(&task.name)));
    }

    /// The state file, in the order of the names.
    fn text(&self) -> Result<String> {
        let mut made: Vec<_> = self.made.iter().collect();
        made.sort_unstable_by_key(|&(name, _)| name);
        let lines: Result<Vec<_>, _> = made.iter().map(|(_, made)| serde_json::to_string(made)).collect();
        Ok(lines?.iter().map(|line| format!("{line}\n")).collect())
    }

    /// The lines of the report about `tasks`.
    fn lines(&self, tasks: &[Task]) -> String {
        let made = tasks.iter().filter_map(|task| self.made.get(&task.name));
        made.map(|made| format!("{}\n", made.line)).collect()
    }
}

/// A short word for a recipe. If a new compiler makes another one, the outputs are made again.
pub fn short(recipe: &str) -> String {
    let mut hasher = DefaultHasher::new();
    recipe.hash(&mut hasher);
    format!("{:016x}", hasher.finish())
}

/// Where this run notes what it has done.
pub struct Journal {
    report: Option<Box<dyn Write + Send>>,
    state: Box<dyn Write + Send>,
    recipe: String,
}

impl Journal {
    /// Starts the files: the state without `tasks`, the report with what is known of `skipped`.
    ///
    /// # Errors
    /// When one of them cannot be written.
    pub fn start(
        folder: &Path,
        mut state: State,
        report: Option<&Path>,
        [tasks, skipped]: [&[Task]; 2],
        recipe: String,
    ) -> Result<Self> {
        let report = report.map(|path| start(path, &state.lines(skipped))).transpose()?;
        state.forget(tasks);
        let state = start(&folder.join(STATE), &state.text()?)?;
        Ok(Self { report, state, recipe })
    }

    /// Adds a line to the report.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn report(&mut self, line: &str) -> Result<()> {
        let Some(report) = &mut self.report else { return Ok(()) };
        add_line(report, line).context("cannot write the report")
    }

    /// Notes that the output of `task` is whole, made from an input that was `input`, and what the
    /// report says of it.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn note(&mut self, task: &Task, input: Stamp, line: &str) -> Result<()> {
        // An output that is gone already is not worth a line.
        let Ok(output) = Stamp::of(&task.output) else { return Ok(()) };
        let line = RawValue::from_string(line.to_owned())?;
        let made = Made { recipe: self.recipe.clone(), input, output, line };
        let text = serde_json::to_string(&made)?;
        add_line(&mut self.state, &text).with_context(|| format!("cannot write {STATE}"))
    }
}

/// Gives the file the content `text`, in one step if it is a regular one, and opens it to add more.
fn start(path: &Path, text: &str) -> Result<Box<dyn Write + Send>> {
    let is_stream = path == Path::new("-");
    let is_pipe = !is_stream && fs::metadata(path).is_ok_and(|metadata| !metadata.is_file());
    if !is_pipe {
        write_bytes(path, text.as_bytes())?;
    }
    if is_stream {
        return Ok(Box::new(io::stdout()));
    }
    let context = || format!("{}: cannot write", display_name(path));
    let mut file = OpenOptions::new().append(true).open(path).with_context(context)?;
    if is_pipe {
        file.write_all(text.as_bytes()).with_context(context)?;
    }
    Ok(Box::new(file))
}

/// Adds a line in one step, as far as the system can.
fn add_line(to: &mut impl Write, line: &str) -> io::Result<()> {
    to.write_all(format!("{line}\n").as_bytes())
}
