//! The `sharpen` command.

mod batch;
mod cli;
mod run;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    match run::run(&cli::Arguments::parse()) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("sharpen: {error:#}");
            ExitCode::FAILURE
        }
    }
}
