//! What fuzzing asks of the program: one function for each target, which panics where it is not met. The
//! targets in `fuzz/` call them, and `tests/corpus.rs` on all that was found.
#![allow(dead_code)] // Each of them uses some of it.

use glam::{DQuat, DVec3, dvec3};
use sharpen::attributes::Encoding;
use sharpen::io::{self, Format, Model, View};
use sharpen::mesh::Vert;
use sharpen::weld::{Weld, weld};
use sharpen::{Mesh, Method, Options, sharpen_with_attributes};

use crate::laws::{bits, obey_laws};
use crate::shapes::{chamfered_cube, sphere, wedge_nets};

/// All formats that can be written.
pub const FORMATS: [Format; 9] = [
    Format::Obj,
    Format::Off,
    Format::Ply(None),
    Format::Ply(Some(Encoding::Ascii)),
    Format::Ply(Some(Encoding::LittleEndian)),
    Format::Ply(Some(Encoding::BigEndian)),
    Format::Stl(None),
    Format::Stl(Some(Encoding::Ascii)),
    Format::Stl(Some(Encoding::LittleEndian)),
];

/// What panics where the program does not do as it should on these bytes.
pub type Target = fn(&[u8]);

/// The targets by name.
pub const TARGETS: [(&str, Target); 7] = [
    ("obj", |bytes| reader(bytes, Format::Obj)),
    ("ply", |bytes| reader(bytes, Format::Ply(None))),
    ("stl", |bytes| reader(bytes, Format::Stl(None))),
    ("off", |bytes| reader(bytes, Format::Off)),
    ("tobj", against_tobj),
    ("file", file),
    ("mesh", mesh),
];

/// Reads a file, and writes and reads again what was in it.
pub fn reader(bytes: &[u8], format: Format) {
    let model = match io::parse_as(bytes, "file", format) {
        Ok(model) => model,
        Err(error) => return assert_eq!(error.to_string().lines().count(), 1, "{error}"),
    };
    assert!(model.points.len() <= bytes.len() && model.faces.len() <= bytes.len(), "more than there is");
    assert!(model.points.iter().all(|p| p.is_finite()));
    assert!(model.notices.iter().all(|notice| notice.lines().count() == 1));
    let mesh = Mesh::new(model.points.clone(), model.faces.clone()).expect("what was read is a mesh");
    mesh.check().expect("what was read is a mesh");
    for format in FORMATS {
        survives(View::from(&model), format);
    }
}

/// Writes a model, reads it again, and checks that nothing is lost that the format can hold.
fn survives(view: View<'_>, format: Format) -> Model {
    let written = io::format_as(view, format);
    let read = io::parse_as(&written, "written", format).expect("what was written can be read");
    assert_eq!(read.faces.len(), view.faces.len(), "{format:?}");
    if !matches!(format, Format::Stl(_)) {
        assert_eq!(bits(&read.points), bits(view.points), "{format:?}");
        assert_eq!(read.faces, view.faces, "{format:?}");
    }
    let again = io::format_as(&read, format);
    let third = io::parse_as(&again, "again", format).expect("what was written can be read");
    assert!(io::format_as(&third, format) == again, "{format:?}: a file changes twice");
    // STL's numbers are short, and its normals were those of the long ones. A colour of OFF that is at most
    // 1 of 255 looks like one of 1.
    if !matches!(format, Format::Stl(_))
        && (format != Format::Off || view.attributes.vertex_columns.is_empty())
    {
        assert!(again == written, "{format:?}: a file changes when it is read and written");
    }
    read
}

/// Compares the OBJ reader with `tobj`'s on files that both accept.
pub fn against_tobj(bytes: &[u8]) {
    let (Ok(model), Some(theirs)) = (io::parse(bytes, "file"), oracle(bytes)) else { return };
    let bits = |v: Vert| model.points[v.index()].to_array().map(f64::to_bits);
    let ours: Vec<_> = model.faces.iter().map(|face| face.map(bits)).collect();
    assert_eq!(ours, theirs);
}

/// The triangles that tobj reads, in order, as bits; none if it refuses or is known to be wrong.
fn oracle(bytes: &[u8]) -> Option<Vec<[[u64; 3]; 3]>> {
    // It cuts polygons its own way, takes a face that names a vertex twice for a point or a line, divides by
    // a fourth coordinate, takes a line of three points for a face, and knows neither continued lines nor
    // comments behind a statement.
    let text = std::str::from_utf8(bytes).ok()?;
    let is_plain = |line: &str| {
        let mut words = line.split_whitespace(); // As it does: a vertical tab parts words, too.
        match words.next() {
            Some("f") => {
                let corners: Vec<_> = words.map(|word| word.split('/').next()).collect();
                corners.len() == 3 && (0..3).all(|i| corners[i] != corners[(i + 1) % 3])
            }
            Some("v") => matches!(words.count(), 3 | 6),
            Some("l" | "p") => false,
            _ => true,
        }
    };
    if text.contains(['\\', '#', '\r']) || !text.is_ascii() || !text.lines().all(is_plain) {
        return None;
    }
    let options = tobj::LoadOptions { triangulate: true, ..Default::default() };
    let mut reader = bytes;
    let load = |reader| tobj::load_obj_buf(reader, &options, |_| Ok((Vec::new(), Default::default())));
    let (models, _) = load(&mut reader).ok()?;
    let mut triangles = Vec::new();
    for tobj::Model { mesh, .. } in models {
        let bits = |i: u32| [0, 1, 2].map(|k| mesh.positions[3 * i as usize + k].to_bits());
        triangles.extend(mesh.indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]].map(bits)));
    }
    Some(triangles)
}

/// Reads a file, sharpens and bends what is in it as the binary does, writes and reads it. The first four
/// bytes say how.
pub fn file(bytes: &[u8]) {
    let Some((settings, bytes)) = bytes.split_at_checked(4) else { return };
    let options = options(settings[0], settings[1]);
    let pick = |i: u8| FORMATS[usize::from(i) % FORMATS.len()];
    let welding = [Weld::Exact, Weld::None, Weld::Distance(0.1), Weld::Distance(1e300)];
    let welding = welding[usize::from(settings[3]) / FORMATS.len() % 4];
    let Ok(model) = io::parse_as(bytes, "file", pick(settings[2])) else { return };
    let mut attributes = model.attributes;
    let mut mesh = Mesh::new(model.points, model.faces).expect("what was read is a mesh");
    if let Some(firsts) = weld(mesh.points(), mesh.border_verts(), welding) {
        let (points, mut faces) = mesh.into_parts();
        attributes.join(&mut faces, &firsts);
        mesh = Mesh::new(points, faces).expect("welding makes no vertex");
    }
    let sharpened = obey_laws(&mesh, &options);
    let (same, attributes, _) =
        sharpen_with_attributes(&mesh, attributes, &options).expect("attributes do not matter");
    assert_eq!(bits(same.mesh.points()), bits(sharpened.mesh.points()));
    let parted = attributes.part(mesh.points(), &same.mesh);
    let (points, faces) = match &parted {
        Some((points, faces)) => (points.as_slice(), faces.as_slice()),
        None => (same.mesh.points(), same.mesh.faces()),
    };
    survives(View { points, faces, attributes: &attributes }, pick(settings[3]));
}

/// Sharpens and bends a mesh that is made from the bytes, writes and reads it.
pub fn mesh(bytes: &[u8]) {
    let mut bytes = Bytes(bytes);
    let options = options(bytes.next(), bytes.next());
    let format = FORMATS[usize::from(bytes.next()) % FORMATS.len()];
    let mesh = make(&mut bytes);
    let sharpened = obey_laws(&mesh, &options);
    if sharpened.mesh.n_faces() > 0 {
        let attributes = sharpen::attributes::Attributes::default();
        let (points, faces) = (sharpened.mesh.points(), sharpened.mesh.faces());
        survives(View { points, faces, attributes: &attributes }, format);
    }
}

/// Options from two bytes, most often the default.
fn options(how: u8, much: u8) -> Options {
    use sharpen::classify::SmoothThreshold::{Angle, MeanTimes};
    let share = f64::from(much) / 255.0;
    Options {
        method: [Method::Regions, Method::Filters, Method::Paper, Method::Regions][usize::from(how & 3)],
        bend: u32::from(how >> 2 & 3) % 3,
        denoise: usize::from(how >> 4 & 1),
        smooth: match how >> 5 & 3 {
            0 | 1 => MeanTimes(2.0),
            2 => MeanTimes(4.0 * share),
            _ => Angle(3.0 * share),
        },
        max_shift: (how >> 7 == 1).then_some(3.0 * share),
        max_round: if how >> 5 & 3 == 1 { 4.0 * share } else { 0.0 },
        ..Options::default()
    }
}

/// Numbers from bytes; zeros at their end.
struct Bytes<'a>(&'a [u8]);

impl Bytes<'_> {
    fn next(&mut self) -> u8 {
        let Some((&first, rest)) = self.0.split_first() else { return 0 };
        self.0 = rest;
        first
    }

    /// A number below `n`.
    fn index(&mut self, n: usize) -> usize {
        (256 * usize::from(self.next()) + usize::from(self.next())) % n.max(1)
    }

    /// In [-1, 1], coarse, so that points coincide and lie in one plane.
    fn point(&mut self) -> DVec3 {
        let mut number = || f64::from(self.next() as i8) / 128.0;
        dvec3(number(), number(), number())
    }
}

/// A rotation from five bits.
fn turn(bits: u8) -> DQuat {
    DQuat::from_scaled_axis(dvec3(0.4, 0.7, 0.2) * (0.5 + f64::from(bits >> 3)))
}

/// A shape and what happens to it.
fn make(bytes: &mut Bytes<'_>) -> Mesh {
    let (shape, size) = (bytes.next(), bytes.next());
    let reach = 0.5 + f64::from(size >> 3) / 64.0;
    let (mut points, mut faces) = match shape % 8 {
        0 => (Vec::new(), Vec::new()),
        1 => sphere(usize::from(size) % 3).into_parts(),
        7 => wedge_nets(14 + usize::from(size) % 8, 0.6 + 0.5 * reach, turn(shape)).into_parts(),
        _ => chamfered_cube(3 + usize::from(size) % 4, reach).into_parts(),
    };
    while !bytes.0.is_empty() {
        let (n, n_faces) = (points.len(), faces.len());
        match bytes.next() % 16 {
            0..4 => points.push(bytes.point()),
            _ if n == 0 => {}
            4..7 => faces.push([(); 3].map(|()| Vert::new(bytes.index(n)))),
            7 | 8 => {
                let v = bytes.index(n);
                points[v] += 0.25 * bytes.point();
            }
            9 => {
                let v = bytes.index(n);
                points[v] = points[bytes.index(n)];
            }
            10 => {
                let (v, w) = (Vert::new(bytes.index(n)), Vert::new(bytes.index(n)));
                faces.iter_mut().flatten().filter(|corner| **corner == v).for_each(|corner| *corner = w);
            }
            11 => {
                let scale = 2f64.powi(4 * i32::from(bytes.next() as i8));
                points
                    .iter_mut()
                    .for_each(|p| *p = (*p * scale).clamp(DVec3::splat(-1e200), DVec3::splat(1e200)));
            }
            _ if n_faces == 0 => {}
            12 | 13 => drop(faces.swap_remove(bytes.index(n_faces))),
            14 => faces[bytes.index(n_faces)].swap(1, 2),
            _ => faces.push(faces[bytes.index(n_faces)]),
        }
    }
    Mesh::new(points, faces).expect("all corners are there")
}
