//! What a person sees of a run.

use std::time::{Duration, Instant};

use indicatif::{HumanCount, ProgressBar, ProgressStyle};
use sharpen::error::display_name;

use super::plan::{Plan, Task};
use super::record::{Glance, Status};
use crate::cli::Arguments;

/// Counts what is done, and shows it on a terminal.
pub struct Progress {
    bar: ProgressBar,
    start: Instant,
    is_quiet: bool,
    is_verbose: bool,
    n_tasks: usize,
    pub counts: Counts,
}

/// Numbers of files by what became of them, and of faces.
#[derive(Clone, Copy, Debug, Default)]
pub struct Counts {
    pub ok: usize,
    pub failed: usize,
    pub skipped: usize,
    faces: [u64; 2],
}

/// A file takes as long as this many bytes more would.
const BYTES_PER_FILE: u64 = 4096;

impl Progress {
    pub fn new(arguments: &Arguments, plan: &Plan) -> Self {
        let bytes = plan.tasks.iter().map(|task| task.size + BYTES_PER_FILE).sum();
        let bar = if arguments.quiet { ProgressBar::hidden() } else { ProgressBar::new(bytes) };
        if let Ok(style) = ProgressStyle::with_template("{wide_bar} {msg}, {eta} left") {
            bar.set_style(style);
        }
        if !bar.is_hidden() {
            bar.enable_steady_tick(Duration::from_millis(250));
        }
        Self {
            bar,
            start: Instant::now(),
            is_quiet: arguments.quiet,
            is_verbose: arguments.verbose,
            n_tasks: plan.tasks.len(),
            counts: Counts::default(),
        }
    }

    /// Something to print while the bar is out of the way.
    pub fn printer(&self) -> impl Fn(&str) + Send + Sync + 'static {
        let bar = self.bar.clone();
        move |text| bar.suspend(|| eprintln!("{text}"))
    }

    /// Counts a file.
    pub fn count(&mut self, glance: &Glance) {
        match glance.status {
            Status::Ok => self.counts.ok += 1,
            Status::Failed => self.counts.failed += 1,
            Status::Skipped => self.counts.skipped += 1,
        }
        if let Some(sizes) = &glance.report {
            self.counts.faces[0] += sizes.input.faces;
            self.counts.faces[1] += sizes.output.faces;
        }
    }

    /// Says what became of a file, if that is worth a line.
    pub fn say(&self, name: &str, glance: &Glance) {
        let print = self.printer();
        match (&glance.reason, glance.status) {
            (Some(reason), Status::Failed) => print(&format!("sharpen: {reason}")),
            (Some(reason), _) if !self.is_quiet => print(reason),
            _ => {}
        }
        if !self.is_quiet {
            glance.notices.iter().for_each(|notice| print(&format!("{name}: {notice}")));
        }
        if let (true, Some(sizes)) = (self.is_verbose, &glance.report) {
            print(&format!("{name}: {} -> {} faces", sizes.input.faces, sizes.output.faces));
        }
    }

    /// Moves the bar by one file.
    pub fn advance(&self, task: &Task) {
        let Counts { ok, failed, faces, .. } = self.counts;
        let done = ok + failed;
        let faces = HumanCount(faces[0]);
        self.bar.set_message(format!("{done}/{} files, {faces} faces, {failed} failed", self.n_tasks));
        self.bar.inc(task.size + BYTES_PER_FILE);
    }

    /// Ends with a summary.
    pub fn finish(&self, arguments: &Arguments) {
        self.bar.finish_and_clear();
        let Counts { ok, failed, skipped, faces } = self.counts;
        let name = display_name(&arguments.input);
        let seconds = self.start.elapsed().as_secs_f64();
        if self.is_quiet {
            return;
        }
        if ok + failed + skipped == 0 {
            return eprintln!("{name}: no files to sharpen");
        }
        let [before, after] = faces;
        eprintln!(
            "{name}: {ok} sharpened, {failed} failed, {skipped} skipped; {before} -> {after} faces in {seconds:.1} s"
        );
    }
}
