//! Completions and the man page, made from the arguments.

use std::io::{self, Write};

use clap::CommandFactory;
use clap_complete::Shell;

use crate::cli::Arguments;

/// What `--generate` prints.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub enum Generated {
    /// Completions for bash.
    Bash,
    /// Completions for zsh.
    Zsh,
    /// Completions for fish.
    Fish,
    /// A man page.
    Man,
}

impl Generated {
    /// Prints it to standard output.
    ///
    /// # Errors
    /// When that does not take it.
    pub fn print(self) -> io::Result<()> {
        let mut command = Arguments::command();
        let mut text = Vec::new();
        match self {
            Self::Bash => clap_complete::generate(Shell::Bash, &mut command, "sharpen", &mut text),
            Self::Zsh => clap_complete::generate(Shell::Zsh, &mut command, "sharpen", &mut text),
            Self::Fish => clap_complete::generate(Shell::Fish, &mut command, "sharpen", &mut text),
            Self::Man => clap_mangen::Man::new(command).render(&mut text)?,
        }
        io::stdout().write_all(&text)
    }
}
