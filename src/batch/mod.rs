//! A folder of files.
//!
//! ```text
//! walk -> Plan -> (State: what is made already) -> tasks -> Budget -> workers -> Journal
//! ```
//!
//! One thread hands out the files in the order of their names, each as soon as it fits into the
//! [`Budget`]; they run in rayon's pool, where what is idle helps with the large ones. With `--timeout`
//! each runs in a process of its own instead, see [`child`].

mod budget;
mod child;
mod journal;
mod plan;
mod progress;
mod record;

use std::any::Any;
use std::collections::BTreeSet;
use std::fs::{self, File, TryLockError};
use std::panic::{self, AssertUnwindSafe};
use std::path::Path;
use std::process::ExitCode;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow, bail};
use clap::Parser;
use sharpen::error::display_name;
use sharpen::io::temporary;

use crate::cli::{self, Arguments};
use crate::run::{Done, sharpen_file, start_threads, unfit};
use budget::Budget;
use child::End;
use journal::{Journal, Stamp, State};
use plan::{Plan, Task};
use progress::Progress;
use record::{Glance, Line, Name, Status};

/// Sharpens every file of the input folder into the output folder.
///
/// # Errors
/// When it cannot begin, or the journal cannot be written. Files that fail are no error.
pub fn sharpen_folder(arguments: &Arguments) -> Result<ExitCode> {
    let _lock = open_output(arguments)?;
    let mut plan = Plan::new(arguments)?;
    let recipe = journal::short(&arguments.recipe());
    let state = State::read(&arguments.output);
    let is_made = |task: &Task| arguments.folder.resume && state.is_made(task, &recipe);
    let (skipped, tasks) = plan.tasks.into_iter().partition(is_made);
    plan.tasks = tasks;
    remove_left_over(arguments, &plan.tasks);
    let journal = Journal::start(
        &arguments.output,
        state,
        arguments.report.as_deref(),
        [&plan.tasks, &skipped],
        recipe,
    )?;

    let run = Run::new(arguments, &plan, journal);
    run.books().progress.counts.skipped = skipped.len();
    run.note_others(&plan.others)?;
    run.go(&plan.tasks)?;
    let books = run.books();
    books.progress.finish(arguments);
    Ok(if books.progress.counts.failed == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// So long a run waits for the lock of a run before it that was killed.
const LOCK_PATIENCE: Duration = Duration::from_secs(1);

/// Makes the output folder and keeps other runs out of it as long as what comes back lives.
fn open_output(arguments: &Arguments) -> Result<Option<File>> {
    let output = &arguments.output;
    for (file, flag) in [(&arguments.classes, "--classes"), (&arguments.sharp_edges, "--sharp-edges")] {
        if file.is_some() {
            cli::wrong_usage(format!("{flag} names one file, and the input is a folder"));
        }
    }
    fs::create_dir_all(output).with_context(|| format!("{}: cannot make a folder", display_name(output)))?;
    if fs::canonicalize(output)? == fs::canonicalize(&arguments.input)? {
        cli::wrong_usage("the output folder may not be the input folder: the next run would sharpen twice");
    }
    // Where a folder cannot be opened or locked, nothing is kept out.
    let Ok(folder) = File::open(output) else { return Ok(None) };
    // What a killed run has just forked holds the lock until it starts its program or dies.
    let patience = Instant::now() + LOCK_PATIENCE;
    while let Err(TryLockError::WouldBlock) = folder.try_lock() {
        if Instant::now() > patience {
            bail!("{}: another run is writing into this folder", display_name(output));
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    Ok(Some(folder))
}

/// Removes the temporary files that killed runs have left where this one will write.
fn remove_left_over(arguments: &Arguments, tasks: &[Task]) {
    let mut folders: BTreeSet<&Path> = tasks.iter().filter_map(|task| task.output.parent()).collect();
    folders.insert(&arguments.output);
    folders.extend(arguments.report.as_deref().map(folder_of));
    for folder in folders {
        temporary::remove_left_over(folder);
    }
}

/// The folder that a file is in.
fn folder_of(file: &Path) -> &Path {
    file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// What all workers share.
struct Run<'a> {
    arguments: &'a Arguments,
    jobs: usize,
    books: Mutex<Books>,
}

/// What is written while the workers work.
struct Books {
    journal: Journal,
    progress: Progress,
    /// Why the run cannot go on.
    error: Option<anyhow::Error>,
}

impl<'a> Run<'a> {
    fn new(arguments: &'a Arguments, plan: &Plan, journal: Journal) -> Self {
        let progress = Progress::new(arguments, plan);
        let print = progress.printer();
        panic::set_hook(Box::new(move |panic| print(&format!("sharpen: {panic}"))));
        Self { arguments, jobs: jobs(arguments), books: Mutex::new(Books { journal, progress, error: None }) }
    }

    fn books(&self) -> MutexGuard<'_, Books> {
        self.books.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Reports what is not tried.
    fn note_others(&self, others: &[Line]) -> Result<()> {
        let mut books = self.books();
        for other in others {
            let line = other.to_json()?;
            let glance = serde_json::from_str(&line)?;
            books.progress.count(&glance);
            books.progress.say(&other.name.name, &glance);
            books.journal.report(&line)?;
        }
        Ok(())
    }

    /// Works on all tasks.
    fn go(&self, tasks: &[Task]) -> Result<()> {
        // A thread that waits for a child needs no core.
        let threads =
            if self.timeout().is_some() { self.jobs } else { self.jobs.max(threads(self.arguments)) };
        rayon::ThreadPoolBuilder::new().num_threads(threads).build_global()?;
        let bytes = self.arguments.folder.memory.map_or_else(budget::half_of_memory, |mb| mb * 1_000_000);
        let budget = Budget::new(self.jobs, bytes);
        rayon::in_place_scope(|scope| {
            for task in tasks {
                let share = budget.take(memory_for(task.size, self.arguments.bend));
                if self.books().error.is_some() {
                    break;
                }
                scope.spawn(move |_| {
                    self.work_on(task);
                    drop(share);
                });
            }
        });
        self.books().error.take().map_or(Ok(()), Err)
    }

    fn timeout(&self) -> Option<Duration> {
        self.arguments.folder.timeout
    }

    /// Sharpens a file and notes what became of it.
    fn work_on(&self, task: &Task) {
        let before = Stamp::of(&task.input).ok();
        let start = Instant::now();
        let answer = match self.timeout() {
            None => line_for(self.arguments, &task.input, &task.output),
            Some(timeout) => self.line_from_child(task, timeout),
        };
        let noted = answer.or_else(|reason| {
            let reason = format!("{}: {reason:#}", display_name(&task.input));
            let line = Line::without_mesh(task.name.clone(), Status::Failed, reason);
            Ok(Line { seconds: start.elapsed().as_secs_f64(), ..line }.to_json()?)
        });
        let mut books = self.books();
        if let Err(error) = noted.and_then(|line| books.note(task, before, &line)) {
            books.error.get_or_insert(error);
        }
    }

    /// The line of the report about a file, made by another process; or what happened to that.
    fn line_from_child(&self, task: &Task, timeout: Duration) -> Result<String> {
        let command = child::call(task)?;
        match child::run(command, timeout).context("cannot start a process")? {
            End::Itself(status, text) => {
                let (said, last) = text.trim_end().rsplit_once('\n').unwrap_or(("", text.trim_end()));
                if status.success() && serde_json::from_str::<Glance>(last).is_ok() {
                    if !said.is_empty() {
                        self.books().progress.printer()(said);
                    }
                    return Ok(last.to_owned());
                }
                Err(anyhow!("the program crashed ({status}) {last}"))
            }
            End::Killed => {
                temporary::remove_left_over(folder_of(&task.output));
                Err(anyhow!("took longer than {} seconds", timeout.as_secs_f64()))
            }
        }
    }
}

impl Books {
    fn note(&mut self, task: &Task, before: Option<Stamp>, line: &str) -> Result<()> {
        let glance: Glance = serde_json::from_str(line)?;
        self.journal.report(line)?;
        if let (Status::Ok, Some(before)) = (glance.status, before) {
            self.journal.note(task, before, line)?;
        }
        self.progress.count(&glance);
        self.progress.say(&display_name(&task.input), &glance);
        self.progress.advance(task);
        Ok(())
    }
}

/// Answers a call for one file of a folder, if this process was called so: it prints the line of the report.
///
/// # Errors
/// When it cannot.
pub fn call_for_one_file() -> Option<Result<ExitCode>> {
    let (input, output, words) = child::called()?;
    let answer = || -> Result<ExitCode> {
        child::end_with_parent()?;
        let arguments = Arguments::parse_from(words);
        start_threads((threads(&arguments) / jobs(&arguments)).max(1))?;
        child::answer(&line_for(&arguments, &input, &output)?)?;
        Ok(ExitCode::SUCCESS)
    };
    Some(answer())
}

/// Sharpens a file; the line of the report comes back, also when it failed.
fn line_for(arguments: &Arguments, input: &Path, output: &Path) -> Result<String> {
    let name = Name::of(input.strip_prefix(&arguments.input).unwrap_or(input));
    let start = Instant::now();
    let result = caught(input, || {
        refuse_same_file(input, output)?;
        let folder = folder_of(output);
        fs::create_dir_all(folder)
            .with_context(|| format!("{}: cannot make a folder", display_name(folder)))?;
        sharpen_file(arguments, input, output)
    });
    let seconds = start.elapsed().as_secs_f64();
    let line = match result {
        Ok(Done { report, notices }) => {
            let reason = unfit(&report).map(|unfit| format!("{}: {unfit}", display_name(input)));
            Line { name, status: Status::Ok, reason, seconds, notices, report: Some(report) }
        }
        Err(error) => Line { seconds, ..Line::without_mesh(name, Status::Failed, format!("{error:#}")) },
    };
    Ok(line.to_json()?)
}

/// The last resort: a panic on one file is an error of this file.
fn caught(input: &Path, work: impl FnOnce() -> Result<Done>) -> Result<Done> {
    panic::catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| {
        let reason = text_of(&*panic);
        Err(anyhow!("{}: the program is at fault, please report this file: {reason}", display_name(input)))
    })
}

/// What a panic says.
fn text_of(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<&str>().copied();
    text.or_else(|| panic.downcast_ref::<String>().map(String::as_str)).unwrap_or("unknown")
}

/// In the output folder may be links back to the inputs.
fn refuse_same_file(input: &Path, output: &Path) -> Result<()> {
    match (fs::canonicalize(input), fs::canonicalize(output)) {
        (Ok(from), Ok(to)) if from == to => {
            Err(anyhow!("{}: is a link to its input {}", display_name(output), display_name(input)))
        }
        _ => Ok(()),
    }
}

/// The number of threads that may compute.
fn threads(arguments: &Arguments) -> usize {
    let all = || thread::available_parallelism().map_or(1, usize::from);
    arguments.threads.map_or_else(all, usize::from)
}

/// The number of files at the same time.
fn jobs(arguments: &Arguments) -> usize {
    arguments.folder.jobs.map_or_else(|| threads(arguments), usize::from)
}

/// How much memory a file of `size` bytes may need. Measured on a million faces: 4 (STL) to 9 times
/// (PLY) its size; short numbers, attributes and many chamfers make it more. Each level of bending makes
/// four faces of one.
fn memory_for(size: u64, levels: u32) -> u64 {
    const PER_FILE: u64 = 1_000_000;
    const TIMES: u64 = 20;
    TIMES.saturating_mul(4_u64.saturating_pow(levels)).saturating_mul(size).saturating_add(PER_FILE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_an_error_of_the_file() {
        let reason = |work: fn() -> Result<Done>| caught(Path::new("a.obj"), work).err().unwrap().to_string();
        let fault = "a.obj: the program is at fault, please report this file: ";
        assert_eq!(reason(|| panic!("one")), format!("{fault}one"));
        assert_eq!(reason(|| panic!("{} and {}", 1, 2)), format!("{fault}1 and 2"));
        assert_eq!(reason(|| panic::panic_any(7)), format!("{fault}unknown"));
        assert_eq!(reason(|| bail!("a.obj: no")), "a.obj: no");
    }
}
