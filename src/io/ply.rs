//! PLY, the polygon file format: text, or bytes of either order.
//!
//! Numbers that the format does not define are passed on: whatever stands beside x, y, z is a column of
//! the vertices, whatever stands beside the corners a column of the faces.
//!
//! Based on: Greg Turk's "The PLY Polygon File Format"; the names of properties as MeshLab uses them.
//! Differs: a list of texture coordinates per face (`texcoord`) becomes a channel of the corners.
//! In/out: bytes; points, faces and columns in the file's order.
//! Cost: one pass; memory for no more than the file has bytes for, whatever its head claims.
//!
//! Why not a ready crate: `ply-rs-bw` keeps a hash map per vertex (1M triangles: 551 ms and 641 MB, here
//! 67 ms and 51 MB), `serde-ply` wants the properties to be known when it is compiled. The first is the
//! oracle of the tests.

mod body;
mod header;
mod write;

pub(super) use write::{format, losses};

use glam::DVec3;

use super::Model;
use super::faces::{Corners, Faces};
use crate::attributes::{Attributes, Channel, Column, Encoding, Kind, Storage};
use crate::error::Fault;
use crate::mesh::{MAX_VERTS, Vert};
use body::Body;
use header::{Element, Header, Property};

/// Reads a mesh.
pub(super) fn parse(bytes: &[u8]) -> Result<Model, Fault> {
    let header = Header::parse(bytes)?;
    let n_verts = header.element("vertex").map_or(0, |element| element.count);
    if n_verts > MAX_VERTS {
        return Err(Fault { line: 1, reason: format!("{n_verts} vertices are too many") });
    }
    let mut reader = Reader { n_verts, ..Reader::default() };
    let mut body = Body::new(bytes, &header);
    for (i, element) in header.elements.iter().enumerate() {
        let is_first = header.elements[..i].iter().all(|other| other.name != element.name);
        body.check_room(element)?;
        match element.name.as_str() {
            "vertex" if is_first => reader.vertices(element, &mut body)?,
            "face" if is_first => reader.faces(element, &mut body)?,
            _ => reader.skip(element, &mut body)?,
        }
    }
    if reader.faces.triangles.is_empty() {
        let why = match header.element("tristrips") {
            Some(_) => "no faces (triangle strips are not read)".to_owned(),
            None => format!("no faces (and {} vertices)", reader.points.len()),
        };
        return Err(body.fault(why));
    }
    Ok(reader.into_model(header))
}

/// A mesh while it is read.
#[derive(Default)]
struct Reader {
    n_verts: usize,
    points: Vec<DVec3>,
    coordinates: Option<Kind>,
    vertex_columns: Vec<Column>,
    faces: Faces,
    face_columns: Vec<Column>,
    texture: Channel,
    /// The last entry of each vertex, and the one before each entry: to find equal ones.
    last_entry: Vec<u32>,
    entry_before: Vec<u32>,
    notices: Vec<String>,
}

impl Reader {
    fn vertices(&mut self, element: &Element, body: &mut Body) -> Result<(), Fault> {
        let axes = ["x", "y", "z"].map(|axis| element.properties.iter().position(|p| p.is_scalar(axis)));
        let [Some(x), Some(y), Some(z)] = axes else {
            return Err(Fault { line: element.line, reason: "the vertices have no x, y and z".to_owned() });
        };
        let is_single = [x, y, z].iter().all(|&axis| element.properties[axis].kind == Kind::F32);
        self.coordinates = Some(if is_single { Kind::F32 } else { Kind::F64 });
        self.points.reserve_exact(element.count);
        let is_axis = |i: usize| [x, y, z].contains(&i);
        self.vertex_columns = columns(element, is_axis);
        self.name_lists(element, |_| false);
        let mut row = vec![0.0; element.properties.len()];
        for i in 0..element.count {
            for (value, property) in row.iter_mut().zip(&element.properties) {
                *value = body.value(property)?;
            }
            let point = DVec3::new(row[x], row[y], row[z]);
            if !point.is_finite() {
                return Err(body.fault(format_args!("vertex {i} has a coordinate that is not finite")));
            }
            self.points.push(point);
            push_row(&mut self.vertex_columns, element, &row, is_axis);
        }
        Ok(())
    }

    fn faces(&mut self, element: &Element, body: &mut Body) -> Result<(), Fault> {
        let is_corners =
            |p: &Property| p.list.is_some() && matches!(&*p.name, "vertex_indices" | "vertex_index");
        let Some(corners_at) = element.properties.iter().position(is_corners) else {
            return Err(Fault {
                line: element.line,
                reason: "the faces have no list vertex_indices".to_owned(),
            });
        };
        let is_texture = |p: &Property| p.list.is_some() && p.name == "texcoord";
        self.faces = Faces::with_capacity(element.count);
        self.face_columns = columns(element, |_| false);
        self.name_lists(element, |p| is_corners(p) || is_texture(p));
        let mut row = vec![0.0; element.properties.len()];
        let (mut corners, mut texture) = (Corners::default(), Vec::new());
        for i in 0..element.count {
            corners.clear();
            texture.clear();
            for (k, property) in element.properties.iter().enumerate() {
                if k == corners_at {
                    self.corners(i, property, body, &mut corners.verts)?;
                } else if is_texture(property) {
                    body.list(property, &mut texture)?;
                } else {
                    row[k] = body.value(property)?;
                }
            }
            self.textures(&texture, &mut corners);
            self.faces.push(&mut corners);
            push_row(&mut self.face_columns, element, &row, |_| false);
        }
        Ok(())
    }

    fn corners(
        &self,
        face: usize,
        property: &Property,
        body: &mut Body,
        corners: &mut Vec<Vert>,
    ) -> Result<(), Fault> {
        for _ in 0..body.length(property)? {
            let index = body.number(property.kind)?;
            if !(index >= 0.0 && index < self.n_verts as f64 && index.fract() == 0.0) {
                let reason =
                    format_args!("face {face} names vertex {index}, but there are {} (from 0)", self.n_verts);
                return Err(body.fault(reason));
            }
            corners.push(Vert::new(index as usize));
        }
        if corners.len() < 3 {
            let n = corners.len();
            return Err(body.fault(format_args!("face {face} needs three corners and has {n} only")));
        }
        Ok(())
    }

    /// Gives the corners of a face their texture coordinates, two numbers each. Corners at one vertex
    /// with equal numbers get one entry, so that only seams are seams.
    fn textures(&mut self, numbers: &[f64], corners: &mut Corners) {
        /// Entries of one vertex that are compared: a vertex in a million seams must not take for ever.
        const MOST: usize = 32;
        if numbers.len() != 2 * corners.verts.len() {
            return;
        }
        self.last_entry.resize(self.n_verts, Channel::NONE);
        for (v, uv) in corners.verts.iter().zip(numbers.chunks_exact(2)) {
            let value = [uv[0], uv[1], 0.0];
            let last = &mut self.last_entry[v.index()];
            let before =
                |&entry: &u32| Some(self.entry_before[entry as usize]).filter(|&e| e != Channel::NONE);
            let entries = std::iter::successors(Some(*last).filter(|&e| e != Channel::NONE), before);
            let is_equal = |entry: &u32| {
                self.texture.values[*entry as usize].map(f64::to_bits) == value.map(f64::to_bits)
            };
            let entry = entries.take(MOST).find(is_equal).unwrap_or_else(|| {
                let entry = self.texture.push(value, 2);
                self.entry_before.push(std::mem::replace(last, entry));
                entry
            });
            corners.textures.push(entry);
        }
    }

    /// Passes over an element that is not kept.
    fn skip(&mut self, element: &Element, body: &mut Body) -> Result<(), Fault> {
        self.notices.push(format!("left out: {} x element \"{}\"", element.count, element.name));
        // An element without properties takes no room, however many there are.
        for _ in 0..if element.properties.is_empty() { 0 } else { element.count } {
            for property in &element.properties {
                body.value(property)?;
            }
        }
        Ok(())
    }

    fn name_lists(&mut self, element: &Element, is_known: impl Fn(&Property) -> bool) {
        for property in element.properties.iter().filter(|p| p.list.is_some() && !is_known(p)) {
            self.notices.push(format!("left out: list \"{}\" of each {}", property.name, element.name));
        }
    }

    fn into_model(mut self, header: Header) -> Model {
        for column in &mut self.face_columns {
            self.faces.per_triangle(column);
        }
        let faces = self.faces.cut(&self.points);
        self.texture.at = faces.textures.into();
        self.texture.from_file = self.texture.values.len();
        let coordinates = self.coordinates.unwrap_or(Kind::F64);
        let attributes = Attributes {
            head: header.comments,
            info: header.info,
            vertex_columns: self.vertex_columns,
            face_columns: self.face_columns,
            texture: self.texture,
            polygons: faces.polygons,
            storage: Some(Storage { encoding: header.encoding, coordinates }),
            ..Attributes::default()
        };
        Model { points: self.points, faces: faces.triangles, attributes, notices: self.notices }
    }
}

/// The columns of an element: its scalar properties, but for those that `is_taken`.
fn columns(element: &Element, is_taken: impl Fn(usize) -> bool) -> Vec<Column> {
    let properties = element.properties.iter().enumerate();
    let kept = properties.filter(|&(i, property)| property.list.is_none() && !is_taken(i));
    let column = |(_, p): (usize, &Property)| Column {
        name: p.name.clone(),
        kind: p.kind,
        values: Vec::with_capacity(element.count),
    };
    kept.map(column).collect()
}

fn push_row(columns: &mut [Column], element: &Element, row: &[f64], is_taken: impl Fn(usize) -> bool) {
    let properties = element.properties.iter().enumerate();
    let kept = properties.filter(|&(i, property)| property.list.is_none() && !is_taken(i));
    for (column, (i, _)) in columns.iter_mut().zip(kept) {
        column.values.push(row[i]);
    }
}

impl Encoding {
    /// What a header calls it.
    fn name(self) -> &'static str {
        match self {
            Self::Ascii => "ascii",
            Self::LittleEndian => "binary_little_endian",
            Self::BigEndian => "binary_big_endian",
        }
    }
}

impl Kind {
    /// What a header calls it, first the name that is written, then the other one.
    fn names(self) -> [&'static str; 2] {
        match self {
            Self::I8 => ["char", "int8"],
            Self::U8 => ["uchar", "uint8"],
            Self::I16 => ["short", "int16"],
            Self::U16 => ["ushort", "uint16"],
            Self::I32 => ["int", "int32"],
            Self::U32 => ["uint", "uint32"],
            Self::F32 => ["float", "float32"],
            Self::F64 => ["double", "float64"],
        }
    }

    /// Bytes of a number.
    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}
