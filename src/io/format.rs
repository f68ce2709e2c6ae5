//! The formats, by extension and by name.

use std::path::Path;

use crate::attributes::Encoding;
use crate::error::{Error, display_name};

/// A file format. Where there is a choice of text or bytes, none means: as in the file that the mesh
/// comes from, if it had that choice, else bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Wavefront OBJ.
    Obj,
    /// PLY.
    Ply(Option<Encoding>),
    /// STL.
    Stl(Option<Encoding>),
    /// OFF.
    Off,
}

impl Format {
    /// The names that [`by_name`](Self::by_name) knows.
    pub const NAMES: [&str; 9] =
        ["obj", "ply", "stl", "off", "ply-ascii", "ply-binary", "ply-binary-be", "stl-ascii", "stl-binary"];

    /// The format called `name`.
    #[must_use]
    pub fn by_name(name: &str) -> Option<Self> {
        Some(match name {
            "obj" => Self::Obj,
            "ply" => Self::Ply(None),
            "ply-ascii" => Self::Ply(Some(Encoding::Ascii)),
            "ply-binary" => Self::Ply(Some(Encoding::LittleEndian)),
            "ply-binary-be" => Self::Ply(Some(Encoding::BigEndian)),
            "stl" => Self::Stl(None),
            "stl-ascii" => Self::Stl(Some(Encoding::Ascii)),
            "stl-binary" => Self::Stl(Some(Encoding::LittleEndian)),
            "off" => Self::Off,
            _ => return None,
        })
    }

    /// The format that the extension of `path` stands for, in capitals or not.
    ///
    /// # Errors
    /// When it stands for none.
    pub fn of(path: &Path) -> Result<Self, Error> {
        let extension = path.extension().map(|extension| extension.to_string_lossy().to_lowercase());
        let found =
            extension.as_deref().filter(|name| Self::EXTENSIONS.contains(name)).and_then(Self::by_name);
        found.ok_or_else(|| {
            let reason = if super::is_stream(path) {
                format!(
                    "a stream has no name to tell its format by: say --format (known are {})",
                    Self::NAMES.join(", ")
                )
            } else {
                format!("no format goes by this name (known are .{})", Self::EXTENSIONS.join(", ."))
            };
            Error::Format { file: display_name(path), reason }
        })
    }

    /// The extensions that [`of`](Self::of) knows.
    pub const EXTENSIONS: [&str; 4] = ["obj", "ply", "stl", "off"];
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extensions_and_names_are_known() {
        assert_eq!(Format::of(Path::new("a/b.c.OBJ")).unwrap(), Format::Obj);
        assert_eq!(Format::of(Path::new("b.Stl")).unwrap(), Format::Stl(None));
        for path in ["a", "obj", ".ply", "a.ply-ascii", "a.glb", "a-"] {
            let fault = Format::of(Path::new(path)).unwrap_err().to_string();
            assert_eq!(
                fault,
                format!("{path}: no format goes by this name (known are .obj, .ply, .stl, .off)")
            );
        }
        assert!(Format::NAMES.iter().all(|name| Format::by_name(name).is_some()));
    }
}
