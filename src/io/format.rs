//! The formats, by extension and by name.

use std::path::Path;

use super::Error;
use crate::error::display_name;

/// A file format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Format {
    /// Wavefront OBJ.
    Obj,
}

impl Format {
    /// The names that [`by_name`](Self::by_name) knows.
    pub const NAMES: [&str; 1] = ["obj"];

    /// The format called `name`.
    #[must_use]
    pub fn by_name(name: &str) -> Option<Self> {
        match name {
            "obj" => Some(Self::Obj),
            _ => None,
        }
    }

    /// The format that the extension of `path` stands for, in capitals or not.
    ///
    /// # Errors
    /// When it stands for none.
    pub fn of(path: &Path) -> Result<Self, Error> {
        let extension = path.extension().map(|extension| extension.to_string_lossy().to_lowercase());
        let found = extension.as_deref().filter(|name| !name.contains('-')).and_then(Self::by_name);
        found.ok_or_else(|| Error::Format {
            file: display_name(path),
            reason: format!("its name does not tell the format ({})", Self::NAMES.join(", ")),
        })
    }
}
