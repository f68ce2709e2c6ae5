//! Writes PLY.

use std::borrow::Cow;

use super::super::View;
use super::super::text::{push_number, push_one_line};
use super::super::vertex_data::{COLOURS, byte_colours, vertex_normals};
use crate::attributes::{Channel, Column, Encoding, Kind, Statement};
use crate::mesh::{Half, Vert};

/// A mesh as the bytes of a file, in the given encoding, or that of the file it comes from.
pub(in super::super) fn format(view: View, encoding: Option<Encoding>) -> Vec<u8> {
    let attributes = view.attributes;
    let source = attributes.storage.map(|storage| storage.encoding);
    let encoding = encoding.or(source).unwrap_or(Encoding::LittleEndian);
    // Text may have more digits than the `float` it was declared as can hold in bytes.
    let is_kept = encoding == Encoding::Ascii || source != Some(Encoding::Ascii);
    let coordinates = attributes.storage.filter(|_| is_kept).map_or(Kind::F64, |storage| storage.coordinates);
    let columns = vertex_columns(view);
    let faces = FaceRows::new(view);

    let mut out = head(view, encoding);
    push_line(&mut out, &["element vertex", &view.points.len().to_string()]);
    for axis in ["x", "y", "z"] {
        push_line(&mut out, &["property", coordinates.names()[0], axis]);
    }
    for column in &columns {
        push_line(&mut out, &["property", column.kind.names()[0], &column.name]);
    }
    push_line(&mut out, &["element face", &faces.count.to_string()]);
    push_line(&mut out, &["property list", faces.length.names()[0], "int vertex_indices"]);
    if !attributes.texture.at.is_empty() {
        push_line(&mut out, &["property list", faces.length.names()[0], "float texcoord"]);
    }
    for column in &attributes.face_columns {
        push_line(&mut out, &["property", column.kind.names()[0], &column.name]);
    }
    push_line(&mut out, &["end_header"]);

    let mut rows = Rows { out, encoding };
    for (i, point) in view.points.iter().enumerate() {
        point.to_array().into_iter().for_each(|number| rows.push(coordinates, number));
        columns.iter().for_each(|column| rows.push(column.kind, column.values[i]));
        rows.end();
    }
    faces.push(&mut rows);
    rows.out
}

/// What a PLY file cannot hold of a mesh.
pub(in super::super) fn losses(view: View) -> Vec<String> {
    let attributes = view.attributes;
    let mut losses = Vec::new();
    let mut lose = |is_lost: bool, what: &str| losses.extend(is_lost.then(|| format!("left out: {what}")));
    lose(!attributes.libraries.is_empty(), "material libraries");
    let is_text = |what: &Statement| matches!(what, Statement::Text(_));
    lose(attributes.marks.iter().any(|mark| is_text(&mark.what)), "groups, materials and the like");
    lose(attributes.marks.iter().any(|mark| !is_text(&mark.what)), "lines and points");
    let has_normals = !attributes.normals.at.is_empty();
    lose(
        has_normals && vertex_normals(view).is_none(),
        "normals (they differ between the faces of a vertex)",
    );
    let texture = &attributes.texture;
    if !texture.at.is_empty() {
        let widths = || texture.widths.iter();
        lose(widths().any(|&width| width > 2), "the third texture coordinate");
        let is_rounded =
            |value: &[f64; 3]| value[..2].iter().any(|&x| f64::from(x as f32) != x && !x.is_nan());
        lose(texture.values.iter().any(is_rounded), "digits of texture coordinates behind the seventh");
    }
    if let Some(colours) = byte_colours(view) {
        let is_missing = colours.iter().any(|column| column.values.iter().any(|value| value.is_nan()));
        lose(is_missing, "that some vertices have no colour (they are white now)");
    }
    losses
}

fn head(view: View, encoding: Encoding) -> Vec<u8> {
    let mut out = Vec::with_capacity(32 * view.points.len() + 16 * view.faces.len() + 1024);
    out.extend_from_slice(b"ply\nformat ");
    out.extend_from_slice(encoding.name().as_bytes());
    out.extend_from_slice(b" 1.0\n");
    let lines = view.attributes.head.iter().map(|line| (b"comment".as_slice(), line));
    for (keyword, line) in lines.chain(view.attributes.info.iter().map(|line| (b"obj_info".as_slice(), line)))
    {
        out.extend_from_slice(keyword);
        if !line.first().is_none_or(u8::is_ascii_whitespace) {
            out.push(b' ');
        }
        push_one_line(&mut out, line);
    }
    out
}

fn push_line(out: &mut Vec<u8>, words: &[&str]) {
    out.extend_from_slice(words.join(" ").as_bytes());
    out.push(b'\n');
}

/// The columns to write: those there are, colours in bytes, and normals if there is one per vertex.
fn vertex_columns(view: View) -> Vec<Cow<Column>> {
    let colours = byte_colours(view);
    let is_replaced = |column: &&Column| colours.is_none() || !COLOURS.contains(&column.name.as_str());
    let mut columns: Vec<_> =
        view.attributes.vertex_columns.iter().filter(is_replaced).map(Cow::Borrowed).collect();
    columns.extend(colours.into_iter().flatten().map(Cow::Owned));
    columns.extend(vertex_normals(view).into_iter().flatten().map(Cow::Owned));
    columns
}

/// Numbers in rows.
struct Rows {
    out: Vec<u8>,
    encoding: Encoding,
}

impl Rows {
    fn push(&mut self, kind: Kind, number: f64) {
        // Where there is no number a colour is white.
        let number = if kind.is_whole() && number.is_nan() { 255.0 } else { number };
        macro_rules! put {
            ($number:expr) => {
                match self.encoding {
                    Encoding::Ascii => push_number(&mut self.out, f64::from($number)),
                    Encoding::LittleEndian => self.out.extend_from_slice(&$number.to_le_bytes()),
                    Encoding::BigEndian => self.out.extend_from_slice(&$number.to_be_bytes()),
                }
            };
        }
        match kind {
            Kind::I8 => put!(number as i8),
            Kind::U8 => put!(number as u8),
            Kind::I16 => put!(number as i16),
            Kind::U16 => put!(number as u16),
            Kind::I32 => put!(number as i32),
            Kind::U32 => put!(number as u32),
            // All digits in text, whatever the type.
            Kind::F32 if self.encoding != Encoding::Ascii => put!(number as f32),
            Kind::F32 | Kind::F64 => put!(number),
        }
        if self.encoding == Encoding::Ascii {
            self.out.push(b' ');
        }
    }

    fn end(&mut self) {
        if self.encoding == Encoding::Ascii {
            if self.out.last() == Some(&b' ') {
                self.out.pop();
            }
            self.out.push(b'\n');
        }
    }
}

/// The faces as they are written: polygons where there are some.
struct FaceRows<'a> {
    view: View<'a>,
    count: usize,
    /// How the length of a list is stored: in a byte if that is enough.
    length: Kind,
}

impl<'a> FaceRows<'a> {
    fn new(view: View<'a>) -> Self {
        let polygons = || view.attributes.polygons.iter().map(|(_, sides)| sides.len());
        let most = polygons().max().unwrap_or(3) * if view.attributes.texture.at.is_empty() { 1 } else { 2 };
        let length = if most > usize::from(u8::MAX) { Kind::I32 } else { Kind::U8 };
        Self {
            view,
            count: view.faces.len() + polygons().count() - polygons().map(|n| n - 2).sum::<usize>(),
            length,
        }
    }

    fn push(&self, rows: &mut Rows) {
        let mut polygons = self.view.attributes.polygons.iter().peekable();
        let mut face = 0;
        while face < self.view.faces.len() {
            let first = face;
            if let Some((_, sides)) = polygons.next_if(|&(first, _)| first == face) {
                self.push_face(rows, sides.iter().map(|half: &Half| half.index()));
                face += sides.len() - 2;
            } else {
                self.push_face(rows, 3 * face..3 * face + 3);
                face += 1;
            }
            let columns = &self.view.attributes.face_columns;
            columns.iter().for_each(|column| rows.push(column.kind, column.values[first]));
            rows.end();
        }
    }

    fn push_face(&self, rows: &mut Rows, corners: impl ExactSizeIterator<Item = usize> + Clone) {
        let verts: &[Vert] = self.view.faces.as_flattened();
        rows.push(self.length, corners.len() as f64);
        corners.clone().for_each(|half| rows.push(Kind::I32, verts[half].index() as f64));
        let texture = &self.view.attributes.texture;
        if texture.at.is_empty() {
            return;
        }
        let entry = |half: usize| Some(texture.at.as_slice()[half]).filter(|&entry| entry != Channel::NONE);
        if corners.clone().all(|half| entry(half).is_none()) {
            return rows.push(self.length, 0.0);
        }
        rows.push(self.length, 2.0 * corners.len() as f64);
        for half in corners {
            let value = entry(half).map_or([0.0; 3], |entry| texture.values[entry as usize]);
            value[..2].iter().for_each(|&number| rows.push(Kind::F32, number));
        }
    }
}
