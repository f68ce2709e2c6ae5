//! The `sharpen` command.

mod batch;
mod cli;
mod generate;
mod run;

use std::process::ExitCode;

use clap::Parser;

/// Gives back large blocks to itself instead of to the system: the passes allocate and free them in turn, and a
/// tenth of a run would go into clearing fresh pages. It asks the system for huge pages: they save a sixth of the
/// time and cost a fifth of the memory.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    match batch::call_for_one_file().unwrap_or_else(|| run::run(&cli::Arguments::parse())) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("sharpen: {error:#}");
            ExitCode::FAILURE
        }
    }
}
