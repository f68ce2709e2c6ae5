//! Writes OBJ: coordinates in the shortest form that reads back to the same bits.

use super::super::View;
use super::super::text::{push_number, push_whole};
use crate::attributes::{Channel, Column, Statement};
use crate::mesh::{Half, Vert};

/// The columns that an OBJ file can hold, by what it makes of them.
const COLOURS: [&str; 3] = ["red", "green", "blue"];
const NORMALS: [&str; 3] = ["nx", "ny", "nz"];
const TEXTURES: [[&str; 2]; 3] = [["s", "t"], ["u", "v"], ["texture_u", "texture_v"]];

/// A mesh as the bytes of a file.
pub(in super::super) fn format(view: View) -> Vec<u8> {
    let mut out = Vec::with_capacity(40 * view.points.len() + 24 * view.faces.len());
    push_head(&mut out, view);
    push_vertices(&mut out, view);
    let textures = CornerSource::textures(view);
    let normals = CornerSource::normals(view);
    textures.push_table(&mut out, "vt", &view.attributes.texture);
    normals.push_table(&mut out, "vn", &view.attributes.normals);
    push_faces(&mut out, view, &textures, &normals);
    out
}

/// What an OBJ file cannot hold of a mesh.
pub(in super::super) fn losses(view: View) -> Vec<String> {
    let attributes = view.attributes;
    let has_colours = attributes.columns(COLOURS).is_some();
    let textures = TEXTURES.iter().find(|names| attributes.columns(**names).is_some());
    let is_kept = |name: &str| {
        name == "w"
            || (has_colours && (COLOURS.contains(&name) || name == "alpha"))
            || (attributes.normals.at.is_empty()
                && attributes.columns(NORMALS).is_some()
                && NORMALS.contains(&name))
            || (attributes.texture.at.is_empty() && textures.is_some_and(|names| names.contains(&name)))
    };
    let vertex =
        attributes.vertex_columns.iter().filter(|column| !is_kept(&column.name)).map(|c| ("vertex", c));
    let face = attributes.face_columns.iter().map(|c| ("face", c));
    vertex.chain(face).map(|(what, c)| format!("left out: {what} property \"{}\"", c.name)).collect()
}

fn push_head(out: &mut Vec<u8>, view: View) {
    for line in &view.attributes.head {
        out.push(b'#');
        push_line(out, line);
    }
    for line in &view.attributes.info {
        out.extend_from_slice(b"# ");
        push_line(out, line);
    }
    for line in &view.attributes.libraries {
        push_line(out, line);
    }
}

fn push_line(out: &mut Vec<u8>, line: &[u8]) {
    out.extend_from_slice(line);
    out.push(b'\n');
}

fn push_vertices(out: &mut Vec<u8>, view: View) {
    let attributes = view.attributes;
    let weight = attributes.columns(["w"]);
    let colours = attributes.columns(COLOURS);
    let alpha = attributes.columns(["alpha"]);
    for (i, point) in view.points.iter().enumerate() {
        out.push(b'v');
        point.to_array().into_iter().for_each(|number| push_word(out, number));
        let extras = colours.iter().flatten().chain(alpha.iter().flatten().filter(|_| colours.is_some()));
        let mut extras =
            extras.map(|column| unit_value(column, i)).filter(|number| !number.is_nan()).peekable();
        if extras.peek().is_none() {
            let weight = weight.map(|[column]| column.values[i]).filter(|number| !number.is_nan());
            weight.into_iter().for_each(|number| push_word(out, number));
        }
        extras.for_each(|number| push_word(out, number));
        out.push(b'\n');
    }
}

/// A colour: 0 to 1 for one that is stored in whole numbers, else as it is.
fn unit_value(column: &Column, i: usize) -> f64 {
    use crate::attributes::Kind::{U8, U16};
    match column.kind {
        U8 => column.values[i] / 255.0,
        U16 => column.values[i] / 65535.0,
        _ => column.values[i],
    }
}

fn push_word(out: &mut Vec<u8>, number: f64) {
    out.push(b' ');
    push_number(out, number);
}

/// Where the texture coordinates or normals of the corners come from.
enum CornerSource<'a> {
    /// The channel of the attributes, which may be empty.
    Channel,
    /// Columns, one entry per vertex.
    Columns(Vec<&'a Column>),
}

impl<'a> CornerSource<'a> {
    fn textures(view: View<'a>) -> Self {
        let columns = TEXTURES.iter().find_map(|names| view.attributes.columns(*names));
        Self::of(&view.attributes.texture, columns.map(Vec::from))
    }

    fn normals(view: View<'a>) -> Self {
        Self::of(&view.attributes.normals, view.attributes.columns(NORMALS).map(Vec::from))
    }

    fn of(channel: &Channel, columns: Option<Vec<&'a Column>>) -> Self {
        columns.filter(|_| channel.values.is_empty()).map_or(Self::Channel, Self::Columns)
    }

    fn push_table(&self, out: &mut Vec<u8>, keyword: &str, channel: &Channel) {
        match self {
            Self::Channel => {
                for (value, &width) in channel.values.iter().zip(&channel.widths) {
                    out.extend_from_slice(keyword.as_bytes());
                    value[..width as usize].iter().for_each(|&number| push_word(out, number));
                    out.push(b'\n');
                }
            }
            Self::Columns(columns) => {
                for i in 0..columns[0].values.len() {
                    out.extend_from_slice(keyword.as_bytes());
                    columns.iter().for_each(|column| push_word(out, column.values[i]));
                    out.push(b'\n');
                }
            }
        }
    }

    /// The entry at the corner that `half`, at `vertex`, leaves.
    fn entry(&self, channel: &Channel, half: usize, vertex: Vert) -> Option<usize> {
        match self {
            Self::Columns(_) => Some(vertex.index()),
            Self::Channel => {
                let entry = channel.at.as_slice().get(half).copied();
                entry.filter(|&entry| entry != Channel::NONE).map(|entry| entry as usize)
            }
        }
    }
}

fn push_faces(out: &mut Vec<u8>, view: View, textures: &CornerSource, normals: &CornerSource) {
    let corners = view.faces.as_flattened();
    let push_corner = |out: &mut Vec<u8>, half: usize| {
        let v = corners[half];
        out.push(b' ');
        push_whole(out, v.index() + 1);
        let texture = textures.entry(&view.attributes.texture, half, v);
        let normal = normals.entry(&view.attributes.normals, half, v);
        if texture.is_some() || normal.is_some() {
            out.push(b'/');
        }
        texture.into_iter().for_each(|texture| push_whole(out, texture + 1));
        if let Some(normal) = normal {
            out.push(b'/');
            push_whole(out, normal + 1);
        }
    };
    let mut marks = view.attributes.marks.iter().peekable();
    let mut polygons = view.attributes.polygons.iter().peekable();
    let mut face = 0;
    while face < view.faces.len() {
        while let Some(mark) = marks.next_if(|mark| mark.face as usize <= face) {
            push_statement(out, &mark.what);
        }
        out.push(b'f');
        if let Some((_, sides)) = polygons.next_if(|&(first, _)| first == face) {
            sides.iter().for_each(|&half: &Half| push_corner(out, half.index()));
            face += sides.len() - 2;
        } else {
            (3 * face..3 * face + 3).for_each(|half| push_corner(out, half));
            face += 1;
        }
        out.push(b'\n');
    }
    marks.for_each(|mark| push_statement(out, &mark.what));
}

fn push_statement(out: &mut Vec<u8>, what: &Statement) {
    match what {
        Statement::Text(text) => out.extend_from_slice(text),
        Statement::Line(corners) => {
            out.push(b'l');
            for &(v, texture) in corners {
                out.push(b' ');
                push_whole(out, v.index() + 1);
                if texture != Channel::NONE {
                    out.push(b'/');
                    push_whole(out, texture as usize + 1);
                }
            }
        }
        Statement::Points(points) => {
            out.push(b'p');
            for v in points {
                out.push(b' ');
                push_whole(out, v.index() + 1);
            }
        }
    }
    out.push(b'\n');
}
