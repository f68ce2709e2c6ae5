//! Reading and writing meshes.
//!
//! A filter gives back what it got: positions keep their bits, vertices their order, unused ones too,
//! and what a file says beyond the mesh travels in [`Attributes`]. The readers are our own because the
//! ready ones were measured to re-order or drop vertices, to cut the mesh at material seams or to refuse
//! harmless files; `tobj` is the oracle of the tests.
//!
//! No sequence of bytes makes a reader panic, and none makes it allocate more than a small multiple of
//! the file's size.

mod faces;
mod format;
mod obj;
mod off;
mod ply;
mod stl;
pub mod temporary;
mod text;
mod triangulate;
mod vertex_data;

pub use format::Format;

use std::fs;
use std::io::{Read, Write};
use std::path::Path;

use glam::DVec3;

use crate::attributes::Attributes;
use crate::error::{Error, display_name};
use crate::mesh::Vert;

/// What a file holds: a mesh of triangles and all that is said about it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Model {
    /// All vertices in the file's order, used or not, bit for bit.
    pub points: Vec<DVec3>,
    /// All faces in the file's order; polygons are cut into triangles, which follow each other.
    pub faces: Vec<[Vert; 3]>,
    /// The rest.
    pub attributes: Attributes,
    /// What of the file is not kept, one line each.
    pub notices: Vec<String>,
}

/// What to write: borrowed, so that a mesh can be written without a copy.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    /// The vertices.
    pub points: &'a [DVec3],
    /// The faces.
    pub faces: &'a [[Vert; 3]],
    /// The rest.
    pub attributes: &'a Attributes,
}

impl<'a> From<&'a Model> for View<'a> {
    fn from(model: &'a Model) -> Self {
        Self { points: &model.points, faces: &model.faces, attributes: &model.attributes }
    }
}

/// Reads the mesh in the file `path`; `-` is standard input.
///
/// # Errors
/// When the file cannot be read, its name does not tell the format, or its content is no mesh.
pub fn read(path: &Path) -> Result<Model, Error> {
    let bytes = read_bytes(path)?;
    parse_as(&bytes, &display_name(path), Format::of(path)?)
}

/// Reads the mesh in the file `path`, whatever its name; `-` is standard input.
///
/// # Errors
/// When the file cannot be read or its content is no mesh.
pub fn read_as(path: &Path, format: Format) -> Result<Model, Error> {
    parse_as(&read_bytes(path)?, &display_name(path), format)
}

/// Reads all bytes of the file `path`; `-` is standard input.
///
/// # Errors
/// When the file system refuses.
pub fn read_bytes(path: &Path) -> Result<Vec<u8>, Error> {
    let bytes = if is_stream(path) {
        let mut bytes = Vec::new();
        std::io::stdin().lock().read_to_end(&mut bytes).map(|_| bytes)
    } else {
        read_file(path)
    };
    bytes.map_err(|source| Error::file(path, "read", source))
}

/// Bytes that a thread reads at a time.
#[cfg(unix)]
const READ: usize = 1 << 22;

/// Reads a file, a large one in pieces on all threads: copying from the system's cache takes as long as parsing.
#[cfg(unix)]
fn read_file(path: &Path) -> std::io::Result<Vec<u8>> {
    use rayon::prelude::*;
    use std::os::unix::fs::FileExt;
    let file = fs::File::open(path)?;
    let size = file.metadata().map_or(0, |about| if about.is_file() { about.len() } else { 0 });
    let Some(length) = usize::try_from(size).ok().filter(|&length| length > READ) else {
        return fs::read(path);
    };
    let mut bytes = vec![0; length];
    let pieces = bytes.par_chunks_mut(READ).enumerate();
    let read = pieces.try_for_each(|(i, piece)| file.read_exact_at(piece, (i * READ) as u64));
    match read {
        Ok(()) => Ok(bytes),
        // It has become shorter meanwhile.
        Err(_) => fs::read(path),
    }
}

#[cfg(not(unix))]
fn read_file(path: &Path) -> std::io::Result<Vec<u8>> {
    fs::read(path)
}

/// Reads the OBJ mesh in `bytes`; `name` stands for the file in errors.
///
/// # Errors
/// When the content is no mesh.
pub fn parse(bytes: &[u8], name: &str) -> Result<Model, Error> {
    parse_as(bytes, name, Format::Obj)
}

/// Reads the mesh in `bytes`; `name` stands for the file in errors.
///
/// # Errors
/// When the content is no mesh of this format. Text and bytes are told apart whatever `format` says.
pub fn parse_as(bytes: &[u8], name: &str, format: Format) -> Result<Model, Error> {
    let parsed = match format {
        Format::Obj => obj::parse(bytes),
        Format::Ply(_) => ply::parse(bytes),
        Format::Stl(_) => stl::parse(bytes),
        Format::Off => off::parse(bytes),
    };
    parsed.map_err(|fault| Error::content(name, fault))
}

/// Writes a mesh to the file `path`: to a temporary file beside it, which then takes its name, so that
/// nobody ever sees half a file. An existing file keeps its permissions; a link stays one; what is not a
/// regular file, like `/dev/null`, is written to. `-` is standard output.
///
/// # Errors
/// When the name does not tell the format, or the file system refuses.
pub fn write<'a>(path: &Path, view: impl Into<View<'a>>) -> Result<(), Error> {
    write_as(path, view, Format::of(path)?)
}

/// Writes a mesh to the file `path` as [`write()`] does, whatever its name.
///
/// # Errors
/// When the file system refuses.
pub fn write_as<'a>(path: &Path, view: impl Into<View<'a>>, format: Format) -> Result<(), Error> {
    let view = view.into();
    put(path, |out| write_to(out, view, format))
}

/// A mesh as the bytes of an OBJ file.
#[must_use]
pub fn format<'a>(view: impl Into<View<'a>>) -> Vec<u8> {
    format_as(view, Format::Obj)
}

/// A mesh as the bytes of a file.
#[must_use]
pub fn format_as<'a>(view: impl Into<View<'a>>, format: Format) -> Vec<u8> {
    let mut bytes = Vec::new();
    // Writing into memory does not fail.
    write_to(&mut bytes, view.into(), format).unwrap_or_default();
    bytes
}

fn write_to(out: &mut (dyn Write + Send), view: View, format: Format) -> std::io::Result<()> {
    match format {
        Format::Obj => obj::write(view, out),
        Format::Ply(encoding) => out.write_all(&ply::format(view, encoding)),
        Format::Stl(encoding) => out.write_all(&stl::format(view, encoding)),
        Format::Off => out.write_all(&off::format(view)),
    }
}

/// Polylines as the bytes of an OBJ file: the vertices on them, each once, ascending, then one `l` each.
#[must_use]
pub fn format_polylines(points: &[DVec3], lines: &[Vec<Vert>]) -> Vec<u8> {
    let mut used: Vec<Vert> = lines.iter().flatten().copied().collect();
    used.sort_unstable();
    used.dedup();
    let mut bytes = Vec::new();
    for v in &used {
        bytes.push(b'v');
        for x in points[v.index()].to_array() {
            bytes.push(b' ');
            text::push_number(&mut bytes, x);
        }
        bytes.push(b'\n');
    }
    for line in lines {
        bytes.push(b'l');
        for v in line {
            bytes.push(b' ');
            let number = used.binary_search(v).map_or(0, |i| i + 1);
            text::push_whole(&mut bytes, number);
        }
        bytes.push(b'\n');
    }
    bytes
}

/// What a file of this format cannot hold of a mesh, one line each.
#[must_use]
pub fn losses<'a>(view: impl Into<View<'a>>, format: Format) -> Vec<String> {
    let view = view.into();
    match format {
        Format::Obj => obj::losses(view),
        Format::Ply(_) => ply::losses(view),
        Format::Stl(encoding) => stl::losses(view, encoding),
        Format::Off => off::losses(view),
    }
}

/// Whether `path` stands for a standard stream.
fn is_stream(path: &Path) -> bool {
    path == Path::new("-")
}

/// Gives the file `path` the content `bytes` in one step, as [`write()`] does.
///
/// # Errors
/// When the file system refuses.
pub fn write_bytes(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    put(path, |out| out.write_all(bytes))
}

/// Gives the file `path` what `write` writes, in one step.
fn put(path: &Path, write: impl FnOnce(&mut (dyn Write + Send)) -> std::io::Result<()>) -> Result<(), Error> {
    let written = if is_stream(path) {
        let mut out = std::io::stdout();
        write(&mut out).and_then(|()| out.flush())
    } else {
        replace(path, write)
    };
    written.map_err(|source| Error::file(path, "write", source))
}

/// What other kind of file this is, by its first bytes.
fn looks_like(bytes: &[u8]) -> Option<&'static str> {
    let kinds: [(&[u8], &str); 8] = [
        (b"solid", "an STL file"),
        (b"ply", "a PLY file"),
        (b"OFF", "an OFF file"),
        (b"glTF", "a glTF file"),
        (b"PK\x03\x04", "a ZIP archive"),
        (b"\x1f\x8b", "a gzip archive"),
        (b"Kaydara", "an FBX file"),
        (b"<", "an XML file"),
    ];
    kinds.iter().find(|(start, _)| bytes.starts_with(start)).map(|&(_, kind)| kind)
}

/// Gives the file `path` what `write` writes, by way of a temporary file.
fn replace(
    path: &Path,
    write: impl FnOnce(&mut (dyn Write + Send)) -> std::io::Result<()>,
) -> std::io::Result<()> {
    // A link is followed, so that the file it names is replaced and not the link.
    let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let existing = fs::metadata(&target).ok();
    if existing.as_ref().is_some_and(|file| !file.is_file()) {
        return write(&mut fs::OpenOptions::new().write(true).open(&target)?);
    }
    let folder = target.parent().filter(|folder| !folder.as_os_str().is_empty());
    let mut temporary = temporary::create(folder.unwrap_or(Path::new(".")))?;
    write(temporary.as_file_mut())?;
    if let Some(existing) = existing {
        temporary.as_file().set_permissions(existing.permissions())?;
    }
    temporary.persist(&target)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

    fn triangle() -> Model {
        parse(TRIANGLE.as_bytes(), "test").expect("a triangle is a mesh")
    }

    #[test]
    fn what_is_missing_or_a_folder_is_one_line() {
        let folder = tempfile::tempdir().unwrap();
        for path in [folder.path().to_owned(), folder.path().join("none.obj")] {
            let message = read_as(&path, Format::Obj).unwrap_err().to_string();
            assert!(message.contains(": cannot read: ") && message.lines().count() == 1, "{message}");
        }
        let message = write_as(folder.path(), &triangle(), Format::Obj).unwrap_err().to_string();
        assert!(message.contains(": cannot write: "), "{message}");
        let message = write(&folder.path().join("no/such.obj"), &triangle()).unwrap_err().to_string();
        assert!(message.contains(": cannot write: ") && message.lines().count() == 1, "{message}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "something was left behind");
    }

    #[test]
    fn input_may_be_output() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a ü.obj");
        fs::write(&path, "# old\n".to_owned() + TRIANGLE).unwrap();
        write(&path, &read(&path).unwrap()).unwrap();
        assert_eq!(read(&path).unwrap().faces, triangle().faces);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "a temporary file was left");
    }

    #[cfg(unix)]
    #[test]
    fn permissions_and_links_stay() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let folder = tempfile::tempdir().unwrap();
        let (path, link) = (folder.path().join("a.obj"), folder.path().join("link.obj"));
        fs::write(&path, "old").unwrap();
        let usual = fs::metadata(&path).unwrap().permissions();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).unwrap();
        symlink("a.obj", &link).unwrap();
        write(&link, &triangle()).unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::read_to_string(&path).unwrap(), TRIANGLE);
        assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o600);
        let new = folder.path().join("new.obj");
        write(&new, &triangle()).unwrap();
        assert_eq!(fs::metadata(&new).unwrap().permissions(), usual, "the umask is not respected");
        write_as(Path::new("/dev/null"), &triangle(), Format::Obj).unwrap();
    }
}
