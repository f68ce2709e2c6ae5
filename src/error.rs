//! What can go wrong, and who is at fault: a file's content, the file system or the command line.

use std::fmt;
use std::io;
use std::path::Path;

/// Why a mesh could not be read, handled or written. Displays as one line.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The file's content is at fault.
    #[error("{file}:{line}: {reason}")]
    Content {
        /// The file, or `-` for standard input.
        file: String,
        /// Line of the fault, counted from 1. In a binary file: 1.
        line: usize,
        /// What is wrong there, with the offending word.
        reason: String,
    },
    /// The file system is at fault.
    #[error("{file}: cannot {action}: {cause}")]
    File {
        /// The file, or `-` for a standard stream.
        file: String,
        /// What was tried: `read`, `write`.
        action: &'static str,
        /// What the system said.
        cause: io::Error,
    },
    /// The name or the format asked for is at fault.
    #[error("{file}: {reason}")]
    Format {
        /// The file, or `-` for a standard stream.
        file: String,
        /// What is wrong with it.
        reason: String,
    },
    /// The arrays do not make a mesh.
    #[error(transparent)]
    Mesh(#[from] crate::mesh::MeshError),
}

impl Error {
    /// The file system refused `action` (an infinitive) on `path`.
    pub(crate) fn file(path: &Path, action: &'static str, cause: io::Error) -> Self {
        Self::File { file: display_name(path), action, cause }
    }

    /// The content of the file called `file` is at fault.
    pub(crate) fn content(file: &str, fault: Fault) -> Self {
        Self::Content { file: file.to_owned(), line: fault.line, reason: fault.reason }
    }
}

/// A fault in a file's content, before the file's name is known.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Fault {
    /// Counted from 1.
    pub line: usize,
    pub reason: String,
}

/// The name of a file as messages show it: on one line whatever is in it.
#[must_use]
pub fn display_name(path: &Path) -> String {
    let name = path.to_string_lossy();
    if name.contains(char::is_control) { name.escape_debug().to_string() } else { name.into_owned() }
}

/// A word of a file as messages show it: quoted, cut to a readable length, on one line.
pub(crate) struct Quoted<'a>(pub &'a [u8]);

impl fmt::Display for Quoted<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const LONGEST: usize = 40;
        let cut = &self.0[..self.0.len().min(LONGEST)];
        let text = String::from_utf8_lossy(cut);
        let dots = if cut.len() < self.0.len() { "..." } else { "" };
        write!(f, "\"{}{dots}\"", text.escape_debug())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_is_one_line_with_file_line_and_word() {
        let reason = format!("{} is not a number", Quoted(b"0\n\xff5"));
        let error = Error::content("a.obj", Fault { line: 7, reason });
        assert_eq!(error.to_string(), "a.obj:7: \"0\\n\u{fffd}5\" is not a number");
    }

    #[test]
    fn a_long_word_is_cut() {
        assert_eq!(Quoted(&[b'9'; 50]).to_string(), format!("\"{}...\"", "9".repeat(40)));
    }

    #[test]
    fn a_name_with_a_line_break_stays_on_one_line() {
        assert_eq!(display_name(Path::new("a\nb ü.obj")), "a\\nb ü.obj");
    }
}
