//! The `sharpen` command.

mod batch;
mod cli;
mod generate;
mod run;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    match batch::call_for_one_file().unwrap_or_else(|| run::run(&cli::Arguments::parse())) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("sharpen: {error:#}");
            ExitCode::FAILURE
        }
    }
}
