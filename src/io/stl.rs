//! STL: text, or bytes.
//!
//! An STL file is a soup of triangles. Corners with equal coordinates are joined into one vertex on
//! reading; the normals that the file has are not kept, as they follow from the corners.
//!
//! Based on: "The STL format" of 3D Systems, as exporters write it: several solids in a file, numbers of
//! 64 bits in text, two bytes per triangle in bytes.
//! In/out: bytes; points in the order of their first corner, faces in the file's order.
//! Cost: O(F), with a hash table of the points while reading.
//!
//! Why not a ready crate: `stl_io` keeps each coordinate in 32 bits, also of a text that has more, and
//! drops names and the bytes per triangle. It is the oracle of the tests.

use glam::DVec3;

use super::faces::{Corners, Faces};
use super::text::{Cursor, push_number, push_one_line};
use super::{Model, View, looks_like};
use crate::attributes::{Attributes, Column, Encoding, Kind, Mark, Statement, Storage};
use crate::error::{Fault, Quoted};
use crate::geometry::unit_normal;
use crate::mesh::{MAX_FACES, Vert};
use crate::weld::Places;

/// Bytes of the head and of the number of triangles, and of each triangle.
const HEAD: usize = 80;
const COUNT_END: usize = HEAD + 4;
const TRIANGLE: usize = 50;
/// What the two bytes of each triangle are called as a column.
const ATTRIBUTE: &str = "attribute";

/// Reads a mesh. A text begins with `solid`; so may bytes, but then their number fits.
pub(super) fn parse(bytes: &[u8]) -> Result<Model, Fault> {
    let is_text = bytes.trim_ascii_start().get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
    let count = bytes.get(HEAD..COUNT_END).and_then(|count| count.first_chunk());
    let fits = |count: &[u8; 4]| bytes.len() == COUNT_END + TRIANGLE * u32::from_le_bytes(*count) as usize;
    let soup = match count {
        Some(count) if !is_text || fits(count) => parse_binary(bytes, u32::from_le_bytes(*count) as usize)?,
        _ if is_text => parse_text(bytes)?,
        _ => {
            let seems = looks_like(bytes).map_or(String::new(), |kind| format!("; this looks like {kind}"));
            return Err(Fault { line: 1, reason: format!("no STL file: too short{seems}") });
        }
    };
    if soup.faces.triangles.is_empty() {
        return Err(Fault { line: 1, reason: "no faces".to_owned() });
    }
    Ok(soup.into_model())
}

/// Triangles whose corners are joined as they come.
struct Soup {
    points: Vec<DVec3>,
    places: Places,
    faces: Faces,
    attributes: Attributes,
    notices: Vec<String>,
}

impl Soup {
    fn new(encoding: Encoding) -> Self {
        Self {
            points: Vec::new(),
            places: Places::exact(),
            faces: Faces::default(),
            attributes: Attributes {
                storage: Some(Storage { encoding, coordinates: Kind::F64 }),
                ..Attributes::default()
            },
            notices: Vec::new(),
        }
    }

    fn vertex(&mut self, point: DVec3) -> Vert {
        self.points.push(point);
        let vertex = self.places.find_or_add(&self.points, Vert::new(self.points.len() - 1));
        if vertex.index() + 1 < self.points.len() {
            self.points.pop();
        }
        vertex
    }

    fn into_model(mut self) -> Model {
        drop(self.places);
        for column in &mut self.attributes.face_columns {
            self.faces.per_triangle(column);
        }
        let faces = self.faces.cut(&self.points);
        self.attributes.polygons = faces.polygons;
        Model {
            points: self.points,
            faces: faces.triangles,
            attributes: self.attributes,
            notices: self.notices,
        }
    }
}

fn parse_binary(bytes: &[u8], count: usize) -> Result<Soup, Fault> {
    let fault = |reason: String| Fault { line: 1, reason };
    let (triangles, tail) = bytes[COUNT_END..].as_chunks::<TRIANGLE>();
    if triangles.len() < count {
        let seems = looks_like(bytes).map_or(String::new(), |kind| format!("; this looks like {kind}"));
        return Err(fault(format!("{count} triangles are announced, {} are there{seems}", triangles.len())));
    }
    let extra = TRIANGLE * (triangles.len() - count) + tail.len();
    let mut soup = Soup::new(Encoding::LittleEndian);
    if extra > 0 {
        soup.notices.push(format!("left out: {extra} bytes behind the last triangle"));
    }
    let head = bytes[..HEAD].split(|&byte| byte == 0).next().unwrap_or_default().trim_ascii();
    soup.attributes.head.extend((!head.is_empty()).then(|| head.into()));
    soup.faces = Faces::with_capacity(count);
    let mut attribute = Vec::new();
    let mut corners = Corners::default();
    for (i, triangle) in triangles[..count].iter().enumerate() {
        corners.clear();
        let (numbers, rest) = triangle.as_chunks::<4>();
        for corner in numbers[3..].chunks_exact(3) {
            let number = |axis: usize| f64::from(f32::from_le_bytes(corner[axis]));
            let point = DVec3::new(number(0), number(1), number(2));
            if !point.is_finite() {
                return Err(fault(format!("triangle {i} has a coordinate that is not finite")));
            }
            corners.verts.push(soup.vertex(point));
        }
        soup.faces.push(&mut corners);
        let word = rest.first_chunk().map_or(0, |word| u16::from_le_bytes(*word));
        if word != 0 || !attribute.is_empty() {
            attribute.resize(i, 0.0);
            attribute.push(f64::from(word));
        }
    }
    if !attribute.is_empty() {
        let column = Column { name: ATTRIBUTE.to_owned(), kind: Kind::U16, values: attribute };
        soup.attributes.face_columns.push(column);
    }
    Ok(soup)
}

/// A text: `solid`, then facets, each a loop of vertices; perhaps several times.
fn parse_text(bytes: &[u8]) -> Result<Soup, Fault> {
    let mut text = Cursor::new(bytes, 1);
    let mut soup = Soup::new(Encoding::Ascii);
    let mut corners = Corners::default();
    loop {
        while text.ends_line() && text.skip_line_end() {}
        if text.is_at_end() {
            return Ok(soup);
        }
        let word = text.take_word();
        match word.to_ascii_lowercase().as_slice() {
            b"solid" => {
                let name = text.rest_of_line();
                if !name.is_empty() {
                    let face = soup.faces.triangles.len() as u32;
                    soup.attributes
                        .marks
                        .push(Mark { face, what: Statement::Text([b"o ", name].concat().into()) });
                }
            }
            b"outer" => {
                corners.clear();
                text.skip_line();
            }
            b"vertex" => {
                let mut point = [0.0; 3];
                for coordinate in &mut point {
                    text.skip_blanks();
                    *coordinate = text.number()?;
                }
                corners.verts.push(soup.vertex(point.into()));
            }
            b"endloop" => {
                if corners.verts.len() < 3 {
                    let n = corners.verts.len();
                    return Err(text.fault(format_args!("a facet needs three vertices and has {n} only")));
                }
                if soup.faces.triangles.len() + corners.verts.len() > MAX_FACES {
                    return Err(text.fault("too many triangles"));
                }
                soup.faces.push(&mut corners);
                corners.clear();
            }
            b"facet" | b"endsolid" => text.skip_line(),
            b"endfacet" => {}
            _ => return Err(text.fault(format_args!("{} does not belong into an STL text", Quoted(word)))),
        }
    }
}

/// A mesh as the bytes of a file, in the given encoding, or that of the file it comes from.
pub(super) fn format(view: View, encoding: Option<Encoding>) -> Vec<u8> {
    let source = view.attributes.storage.map(|storage| storage.encoding);
    match encoding.or(source) {
        Some(Encoding::Ascii) => format_text(view),
        _ => format_binary(view),
    }
}

fn format_binary(view: View) -> Vec<u8> {
    let mut out = Vec::with_capacity(COUNT_END + TRIANGLE * view.faces.len());
    let head = view.attributes.head.first().map_or(b"".as_slice(), |line| line.trim_ascii());
    // "solid" would make it a text.
    let begin: &[u8] =
        if head.get(..5).is_some_and(|w| w.eq_ignore_ascii_case(b"solid")) { b"STL " } else { b"" };
    out.extend([begin, head].concat().into_iter().take(HEAD));
    out.resize(HEAD, 0);
    out.extend((view.faces.len() as u32).to_le_bytes());
    let attribute = view.attributes.face_columns.iter().find(|column| column.name == ATTRIBUTE);
    for (f, face) in view.faces.iter().enumerate() {
        let corners = face.map(|v| view.points[v.index()]);
        for vector in [normal(corners)].into_iter().chain(corners) {
            vector.to_array().into_iter().for_each(|number| out.extend(single(number).to_le_bytes()));
        }
        let word = attribute.map_or(0, |column| column.values[f] as u16);
        out.extend(word.to_le_bytes());
    }
    out
}

/// In 32 bits; a number beyond their range becomes the largest one, as an infinite one is no number.
fn single(number: f64) -> f32 {
    (number as f32).clamp(f32::MIN, f32::MAX)
}

fn normal(corners: [DVec3; 3]) -> DVec3 {
    unit_normal(corners).unwrap_or(DVec3::ZERO)
}

fn format_text(view: View) -> Vec<u8> {
    let mut out = Vec::with_capacity(250 * view.faces.len());
    let mut solids = view.attributes.marks.iter().filter_map(solid).peekable();
    let mut name: &[u8] = b"";
    let has_start = solids.peek().is_none_or(|&(face, _)| face > 0);
    if has_start {
        // With a blank, without which some readers do not know it.
        out.extend_from_slice(b"solid \n");
    }
    for (f, face) in view.faces.iter().enumerate() {
        while let Some((_, next)) = solids.next_if(|&(face, _)| face <= f) {
            if f > 0 {
                push_end(&mut out, name);
            }
            name = next;
            out.extend_from_slice(b"solid ");
            push_one_line(&mut out, name);
        }
        let corners = face.map(|v| view.points[v.index()]);
        out.extend_from_slice(b" facet normal");
        push_vector(&mut out, normal(corners));
        out.extend_from_slice(b"  outer loop\n");
        for corner in corners {
            out.extend_from_slice(b"   vertex");
            push_vector(&mut out, corner);
        }
        out.extend_from_slice(b"  endloop\n endfacet\n");
    }
    push_end(&mut out, name);
    out
}

/// The name of the solid that begins at a mark, and its first face.
fn solid(mark: &Mark) -> Option<(usize, &[u8])> {
    match &mark.what {
        Statement::Text(text) => Some((mark.face as usize, text.strip_prefix(b"o ")?)),
        _ => None,
    }
}

fn push_end(out: &mut Vec<u8>, name: &[u8]) {
    out.extend_from_slice(if name.is_empty() { b"endsolid" } else { b"endsolid " });
    push_one_line(out, name);
}

fn push_vector(out: &mut Vec<u8>, vector: DVec3) {
    for number in vector.to_array() {
        out.push(b' ');
        push_number(out, number);
    }
    out.push(b'\n');
}

/// What an STL file cannot hold of a mesh.
pub(super) fn losses(view: View, encoding: Option<Encoding>) -> Vec<String> {
    let attributes = view.attributes;
    let is_text = encoding.or(attributes.storage.map(|storage| storage.encoding)) == Some(Encoding::Ascii);
    let mut losses = Vec::new();
    let mut lose = |is_lost: bool, what: &str| losses.extend(is_lost.then(|| format!("left out: {what}")));
    let is_attribute = |column: &Column| !is_text && column.name == ATTRIBUTE;
    for column in
        attributes.vertex_columns.iter().chain(attributes.face_columns.iter().filter(|c| !is_attribute(c)))
    {
        lose(true, &format!("property \"{}\"", column.name));
    }
    lose(!attributes.texture.at.is_empty(), "texture coordinates");
    lose(!attributes.normals.at.is_empty(), "normals (they follow from the corners)");
    lose(!attributes.polygons.list.is_empty(), "polygons (they are cut into triangles)");
    let kept_marks = attributes.marks.iter().filter_map(solid).filter(|_| is_text).count();
    lose(attributes.marks.len() > kept_marks, "groups, materials, lines and the like");
    lose(attributes.head.len() + attributes.info.len() > usize::from(!is_text), "comments");
    let is_rounded = |x: f64| f64::from(single(x)) != x;
    let rounds = !is_text && view.points.iter().any(|p| p.to_array().into_iter().any(is_rounded));
    lose(rounds, "digits of coordinates behind the seventh");
    let mut is_used = vec![false; view.points.len()];
    view.faces.as_flattened().iter().for_each(|v| is_used[v.index()] = true);
    lose(is_used.contains(&false), "vertices without a face");
    losses
}
