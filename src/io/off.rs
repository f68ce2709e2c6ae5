//! OFF, the object file format of Geomview, as text.
//!
//! Based on: Geomview's manual, section OFF; colours as CGAL and MeshLab write them.
//! Differs: numbers behind the coordinates count as a colour also where the first word does not say so.
//! In/out: bytes; points, faces, colours and normals in the file's order.
//! Cost: one pass.

use std::borrow::Cow;

use glam::DVec3;

use super::faces::{Corners, Faces};
use super::text::{Cursor, push_number, push_one_line, push_whole};
use super::vertex_data::{COLOURS, byte_colours, vertex_normals};
use super::{Model, View, looks_like};
use crate::attributes::{Attributes, Column, Kind, Statement, Text};
use crate::error::{Fault, Quoted};
use crate::mesh::{MAX_VERTS, Vert};

const NORMALS: [&str; 3] = ["nx", "ny", "nz"];
const TEXTURES: [&str; 2] = ["s", "t"];

/// Reads a mesh.
pub(super) fn parse(bytes: &[u8]) -> Result<Model, Fault> {
    let mut text = Cursor::new(bytes, 1);
    let mut head = Vec::new();
    let (has_texture, has_normals) = first_word(&mut text, &mut head)?;
    let n_verts = next_count(&mut text, &mut head)?;
    let n_faces = next_count(&mut text, &mut head)?;
    text.skip_line();
    let room = (bytes.len() - text.at + 1) / 6;
    if n_verts.saturating_add(n_faces) > room || n_verts > MAX_VERTS {
        let reason = format!("the file is too short for {n_verts} vertices and {n_faces} faces");
        return Err(text.fault(reason));
    }
    let mut points = Vec::with_capacity(n_verts);
    let (mut normals, mut textures) = (Table::new(&NORMALS), Table::new(&TEXTURES));
    let (mut vertex_colours, mut face_colours) = (Colours::default(), Colours::default());
    let mut line = Line::default();
    for i in 0..n_verts {
        next_line(&mut text, &mut head);
        let number = text.line;
        line.read(&mut text)?;
        let least = 3 + if has_normals { 3 } else { 0 } + if has_texture { 2 } else { 0 };
        if line.numbers.len() < least {
            let reason = format!("vertex {i} needs {least} numbers and has {} only", line.numbers.len());
            return Err(Fault { line: number, reason });
        }
        points.push(DVec3::from_slice(&line.numbers));
        line.numbers.drain(..3);
        if has_normals {
            normals.set(i, &line.numbers[..3]);
            line.numbers.drain(..3);
        }
        if has_texture {
            textures.set(i, &line.numbers.split_off(line.numbers.len() - 2));
        }
        vertex_colours.set(i, &line);
    }
    let mut faces = Faces::with_capacity(n_faces);
    let mut corners = Corners::default();
    for i in 0..n_faces {
        next_line(&mut text, &mut head);
        face(&mut text, &mut corners, n_verts)?;
        faces.push(&mut corners);
        line.read(&mut text)?;
        face_colours.set(i, &line);
    }
    if faces.triangles.is_empty() {
        return Err(text.fault(format_args!("no faces (and {n_verts} vertices)")));
    }
    let mut notices = Vec::new();
    let mut vertex_columns = normals.columns(n_verts, Kind::F64);
    vertex_columns.extend(vertex_colours.into_columns(n_verts, "vertex", &mut notices));
    vertex_columns.extend(textures.columns(n_verts, Kind::F64));
    let mut face_columns = face_colours.into_columns(n_faces, "face", &mut notices);
    face_columns.iter_mut().for_each(|column| faces.per_triangle(column));
    let faces = faces.cut(&points);
    let attributes =
        Attributes { head, vertex_columns, face_columns, polygons: faces.polygons, ..Attributes::default() };
    Ok(Model { points, faces: faces.triangles, attributes, notices })
}

/// The word that names the format; whether it announces texture coordinates and normals.
fn first_word(text: &mut Cursor, head: &mut Vec<Text>) -> Result<(bool, bool), Fault> {
    next_line(text, head);
    let word = text.peek_word();
    let rest = word.strip_suffix(b"OFF").ok_or_else(|| {
        let seems = looks_like(text.bytes).map_or(String::new(), |kind| format!("; this looks like {kind}"));
        text.fault(format_args!("an OFF file begins with \"OFF\", not with {}{seems}", Quoted(word)))
    })?;
    let (has_texture, rest) = rest.strip_prefix(b"ST").map_or((false, rest), |rest| (true, rest));
    let rest = rest.strip_prefix(b"C").unwrap_or(rest);
    let (has_normals, rest) = rest.strip_prefix(b"N").map_or((false, rest), |rest| (true, rest));
    text.at += word.len();
    text.skip_blanks();
    if !rest.is_empty() || text.peek_word() == b"BINARY" {
        let what = if rest.is_empty() { text.peek_word() } else { word };
        return Err(text.fault(format_args!("this kind of OFF file is not read: {}", Quoted(what))));
    }
    Ok((has_texture, has_normals))
}

/// Steps to the next line with data, or the end; keeps comments.
fn next_line(text: &mut Cursor, head: &mut Vec<Text>) {
    while text.ends_statement() && !text.is_at_end() {
        if text.peek() == b'#' {
            text.at += 1;
            let start = text.at;
            text.skip_line();
            head.push(text.bytes[start..text.at].trim_ascii_end().into());
        } else {
            text.skip_line_end();
        }
    }
}

fn next_count(text: &mut Cursor, head: &mut Vec<Text>) -> Result<usize, Fault> {
    next_line(text, head);
    let word = text.peek_word();
    let count = text.whole().and_then(|count| usize::try_from(count).ok());
    count.ok_or_else(|| text.fault(format_args!("{} is no number of vertices or faces", Quoted(word))))
}

/// Rows of up to four numbers.
struct Table {
    names: &'static [&'static str],
    rows: Vec<[f64; 4]>,
}

impl Table {
    fn new(names: &'static [&'static str]) -> Self {
        Self { names, rows: Vec::new() }
    }

    /// Sets row `i`, which is behind the last one.
    fn set(&mut self, i: usize, numbers: &[f64]) {
        let mut row = [f64::NAN; 4];
        row[..numbers.len()].copy_from_slice(numbers);
        self.rows.resize(i, [f64::NAN; 4]);
        self.rows.push(row);
    }

    fn columns(&self, n: usize, kind: Kind) -> Vec<Column> {
        let column = |(i, name): (usize, &&str)| {
            let mut values: Vec<f64> = self.rows.iter().map(|row| row[i]).collect();
            values.resize(n, f64::NAN);
            let is_there = values.iter().any(|value| !value.is_nan());
            is_there.then(|| Column { name: (*name).to_owned(), kind, values })
        };
        self.names.iter().enumerate().filter_map(column).collect()
    }
}

/// Colours behind vertices or faces.
struct Colours {
    table: Table,
    /// Whether all numbers are whole and at most 255: else colours run from 0 to 1.
    is_bytes: bool,
    /// How many rows are no colour.
    odd: usize,
}

impl Default for Colours {
    fn default() -> Self {
        Self { table: Table::new(&COLOURS), is_bytes: true, odd: 0 }
    }
}

impl Colours {
    fn set(&mut self, i: usize, line: &Line) {
        match line.numbers.len() {
            0 => {}
            3 | 4 => {
                self.is_bytes &= !line.has_point && line.numbers.iter().all(|x| (0.0..=255.0).contains(x));
                self.table.set(i, &line.numbers);
            }
            _ => self.odd += 1,
        }
    }

    fn into_columns(self, n: usize, what: &str, notices: &mut Vec<String>) -> Vec<Column> {
        if self.odd > 0 {
            notices.push(format!("left out: numbers behind {} x {what} that are no colour", self.odd));
        }
        self.table.columns(n, if self.is_bytes { Kind::U8 } else { Kind::F64 })
    }
}

/// The numbers up to the end of a line.
#[derive(Default)]
struct Line {
    numbers: Vec<f64>,
    /// Whether one of them has a point or an exponent.
    has_point: bool,
}

impl Line {
    fn read(&mut self, text: &mut Cursor) -> Result<(), Fault> {
        self.numbers.clear();
        self.has_point = false;
        while !text.ends_statement() {
            self.has_point |= text.peek_word().iter().any(|byte| b".eE".contains(byte));
            self.numbers.push(text.number()?);
        }
        text.skip_line();
        Ok(())
    }
}

fn face(text: &mut Cursor, corners: &mut Corners, n_verts: usize) -> Result<(), Fault> {
    corners.clear();
    let word = text.peek_word();
    let n =
        text.whole().ok_or_else(|| text.fault(format_args!("{} is no number of corners", Quoted(word))))?;
    if n < 3 {
        return Err(text.fault(format_args!("a face needs three corners and has {n} only")));
    }
    for k in 0..n {
        if text.ends_statement() {
            return Err(text.fault(format_args!("a face of {n} corners has {k} only")));
        }
        let word = text.peek_word();
        let index =
            text.whole().and_then(|index| usize::try_from(index).ok()).filter(|&index| index < n_verts);
        let Some(index) = index else {
            let reason = format_args!("{} names no vertex (there are {n_verts}, from 0)", Quoted(word));
            return Err(text.fault(reason));
        };
        corners.verts.push(Vert::new(index));
    }
    Ok(())
}

/// A mesh as the bytes of a file.
pub(super) fn format(view: View) -> Vec<u8> {
    let polygons = || view.attributes.polygons.iter().map(|(_, sides)| sides.len());
    let n_faces = view.faces.len() + polygons().count() - polygons().map(|n| n - 2).sum::<usize>();
    let data = VertexData::of(view);
    let mut out = Vec::with_capacity(40 * view.points.len() + 24 * view.faces.len());
    out.extend_from_slice(if data.textures.is_empty() { b"" } else { b"ST" });
    out.extend_from_slice(if data.colours.is_empty() { b"" } else { b"C" });
    out.extend_from_slice(if data.normals.is_empty() { b"" } else { b"N" });
    out.extend_from_slice(b"OFF\n");
    for line in view.attributes.head.iter().chain(&view.attributes.info) {
        out.push(b'#');
        push_one_line(&mut out, line.trim_ascii_end()); // As they are read.
    }
    for (count, end) in [(view.points.len(), b" "), (n_faces, b" "), (0, b"\n")] {
        push_whole(&mut out, count);
        out.extend_from_slice(end);
    }
    for (i, point) in view.points.iter().enumerate() {
        let [x, y, z] = point.to_array();
        push_number(&mut out, x);
        [y, z].into_iter().for_each(|number| push_word(&mut out, number));
        data.normals.iter().for_each(|column| push_word(&mut out, column.values[i]));
        push_colour(&mut out, &data.colours, i);
        data.textures.iter().for_each(|column| push_word(&mut out, column.values[i]));
        out.push(b'\n');
    }
    push_faces(&mut out, view);
    out
}

fn push_faces(out: &mut Vec<u8>, view: View) {
    let verts = view.faces.as_flattened();
    let colours: Vec<_> = view.attributes.face_columns.iter().filter(is_colour).map(Cow::Borrowed).collect();
    let mut polygons = view.attributes.polygons.iter().peekable();
    let mut face = 0;
    while face < view.faces.len() {
        let first = face;
        if let Some((_, sides)) = polygons.next_if(|&(first, _)| first == face) {
            push_whole(out, sides.len());
            sides.iter().for_each(|half| push_index(out, verts[half.index()]));
            face += sides.len() - 2;
        } else {
            push_whole(out, 3);
            view.faces[face].iter().for_each(|&v| push_index(out, v));
            face += 1;
        }
        push_colour(out, &colours, first);
        out.push(b'\n');
    }
}

fn is_unit(attributes: &Attributes) -> bool {
    attributes
        .vertex_columns
        .iter()
        .filter(is_colour)
        .flat_map(|column| &column.values)
        .all(|&x| x <= 1.0 || x.is_nan())
}

fn is_colour(column: &&Column) -> bool {
    COLOURS.contains(&column.name.as_str())
}

fn push_index(out: &mut Vec<u8>, v: Vert) {
    out.push(b' ');
    push_whole(out, v.index());
}

/// Appends a number; 0 for what is none, as a reader would stumble over it.
fn push_word(out: &mut Vec<u8>, number: f64) {
    out.push(b' ');
    push_number(out, if number.is_finite() { number } else { 0.0 });
}

/// Appends a colour, if there is one; a real number is told from a byte by its point.
fn push_colour(out: &mut Vec<u8>, columns: &[Cow<Column>], i: usize) {
    for column in columns.iter().filter(|column| !column.values[i].is_nan()) {
        push_word(out, column.values[i]);
        if !column.kind.is_whole() && column.values[i].fract() == 0.0 && column.values[i].abs() < 1e15 {
            out.extend_from_slice(b".0");
        }
    }
}

/// What stands behind the coordinates.
struct VertexData<'a> {
    normals: Vec<Cow<'a, Column>>,
    colours: Vec<Cow<'a, Column>>,
    textures: Vec<Cow<'a, Column>>,
}

impl<'a> VertexData<'a> {
    fn of(view: View<'a>) -> Self {
        let attributes = view.attributes;
        let borrow = |columns: &[&'a Column]| columns.iter().copied().map(Cow::Borrowed).collect();
        let normals = match (attributes.columns(NORMALS), vertex_normals(view)) {
            (_, Some(columns)) => columns.into_iter().map(Cow::Owned).collect(),
            (Some(columns), None) => borrow(&columns),
            (None, None) => Vec::new(),
        };
        let colours = match (attributes.columns(["red", "green", "blue"]), byte_colours(view)) {
            // Real numbers run from 0 to 1 in this format.
            (Some(_), Some(columns)) if !is_unit(attributes) => columns.into_iter().map(Cow::Owned).collect(),
            (Some(_), _) => attributes.vertex_columns.iter().filter(is_colour).map(Cow::Borrowed).collect(),
            (None, _) => Vec::new(),
        };
        let textures = attributes.columns(TEXTURES).map_or(Vec::new(), |columns| borrow(&columns));
        Self { normals, colours, textures }
    }
}

/// What an OFF file cannot hold of a mesh.
pub(super) fn losses(view: View) -> Vec<String> {
    let attributes = view.attributes;
    let data = VertexData::of(view);
    let kept: Vec<&str> = [&data.normals, &data.colours, &data.textures]
        .into_iter()
        .flatten()
        .map(|c| c.name.as_str())
        .collect();
    let mut losses = Vec::new();
    let mut lose = |is_lost: bool, what: &str| losses.extend(is_lost.then(|| format!("left out: {what}")));
    for column in attributes.vertex_columns.iter().filter(|column| !kept.contains(&column.name.as_str())) {
        lose(true, &format!("vertex property \"{}\"", column.name));
    }
    for column in attributes.face_columns.iter().filter(|column| !is_colour(column)) {
        lose(true, &format!("face property \"{}\"", column.name));
    }
    lose(!attributes.texture.at.is_empty(), "texture coordinates");
    let has_normals = !attributes.normals.at.is_empty();
    lose(has_normals && data.normals.is_empty(), "normals (they differ between the faces of a vertex)");
    lose(!attributes.libraries.is_empty(), "material libraries");
    let is_text = |what: &Statement| matches!(what, Statement::Text(_));
    lose(attributes.marks.iter().any(|mark| is_text(&mark.what)), "groups, materials and the like");
    lose(attributes.marks.iter().any(|mark| !is_text(&mark.what)), "lines and points");
    losses
}
