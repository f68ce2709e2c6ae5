//! Wavefront OBJ.
//!
//! The reader makes two passes over the bytes. The first only counts statements, so that the second can
//! resolve every index at once, name the first fault in the file's order and write into arrays of the
//! right size. Both work on runs of whole statements that know what stands before them.
//!
//! Based on: Wavefront's "Object Files (.obj)", as exporters write it.
//! Differs: a comment may follow data; a vertex may have a weight or a colour behind its coordinates;
//! faces may come before their vertices; LF, CRLF and CR end a line; texture coordinates and normals of
//! the wrong form are not worth refusing a mesh for.
//! In/out: bytes; points `[V]`, faces `[F]` in the file's order.
//! Cost: some 100 ns per triangle to read.

use glam::DVec3;

use super::text::{Cursor, is_blank};
use super::triangulate::triangulate;
use super::{Model, View};
use crate::error::{Fault, Quoted};
use crate::mesh::{MAX_FACES, MAX_VERTS, Vert};

/// How many statements of each kind there are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Counts {
    vertices: usize,
    faces: usize,
}

/// Reads a mesh.
pub(super) fn parse(bytes: &[u8]) -> Result<Model, Fault> {
    if bytes.starts_with(b"\xff\xfe") || bytes.starts_with(b"\xfe\xff") {
        return Err(Fault { line: 1, reason: "this is UTF-16 text; save it as UTF-8".to_owned() });
    }
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let (total, last_line) = count(bytes);
    if total.vertices > MAX_VERTS {
        return Err(Fault { line: 1, reason: format!("{} vertices are too many", total.vertices) });
    }
    let mut points = vec![DVec3::ZERO; total.vertices];
    let mut run = Run {
        text: Cursor::new(bytes, 1),
        points: &mut points,
        seen: Counts::default(),
        total,
        faces: Vec::with_capacity(total.faces),
        polygons: Vec::new(),
        corners: Vec::new(),
    };
    run.parse()?;
    let Run { mut faces, polygons, .. } = run;
    cut_polygons(&points, &mut faces, &polygons);
    if faces.is_empty() {
        return Err(no_faces(bytes, total, last_line));
    }
    if faces.len() > MAX_FACES {
        return Err(Fault { line: 1, reason: format!("{} triangles are too many", faces.len()) });
    }
    Ok(Model { points, faces, ..Model::default() })
}

/// The kinds of statements that are counted.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Vertex,
    Face,
    Other,
}

/// What the statement at the cursor is; the cursor moves behind its first word if it is counted.
#[inline]
fn kind(text: &mut Cursor) -> Kind {
    text.skip_blanks();
    let after = text.bytes.get(text.at + 1);
    let is_apart = after.is_none_or(|&b| is_blank(b) || matches!(b, b'\n' | b'\r' | b'\\' | b'#'));
    let kind = match text.peek() {
        b'v' if is_apart => Kind::Vertex,
        b'f' if is_apart => Kind::Face,
        _ => return Kind::Other,
    };
    text.at += 1;
    kind
}

/// Counts statements; also gives the number of the last line.
fn count(bytes: &[u8]) -> (Counts, usize) {
    let mut text = Cursor::new(bytes, 1);
    let mut counts = Counts::default();
    let mut last_line = 1;
    while !text.is_at_end() {
        last_line = text.line;
        match kind(&mut text) {
            Kind::Vertex => counts.vertices += 1,
            Kind::Face => counts.faces += 1,
            Kind::Other => {}
        }
        text.statement();
    }
    (counts, last_line)
}

/// A run of whole statements while it is read.
struct Run<'a> {
    text: Cursor<'a>,
    /// Where the vertices of this run go.
    points: &'a mut [DVec3],
    /// Statements before the one at the cursor, in the whole file.
    seen: Counts,
    /// Statements in the whole file.
    total: Counts,
    faces: Vec<[Vert; 3]>,
    /// First triangle and number of corners of each face with more than three. Its corners stand in
    /// `faces` as a fan until all points are known.
    polygons: Vec<(usize, usize)>,
    /// The corners of the face being read.
    corners: Vec<Vert>,
}

impl Run<'_> {
    fn parse(&mut self) -> Result<(), Fault> {
        let first = self.seen.vertices;
        while !self.text.is_at_end() {
            match kind(&mut self.text) {
                Kind::Vertex => {
                    self.points[self.seen.vertices - first] = self.vertex()?;
                    self.seen.vertices += 1;
                }
                Kind::Face => {
                    self.face()?;
                    self.seen.faces += 1;
                }
                Kind::Other => {
                    self.text.statement();
                }
            }
        }
        Ok(())
    }

    /// Three coordinates. What may follow: a weight, or a colour of three or four numbers.
    fn vertex(&mut self) -> Result<DVec3, Fault> {
        let mut numbers = [0.0; 3];
        let mut n = 0;
        while !self.text.ends_statement() {
            let number = self.text.number()?;
            if let Some(place) = numbers.get_mut(n) {
                *place = number;
            }
            n += 1;
        }
        if n < 3 {
            let [x, y, _] = numbers;
            let has = match n {
                0 => "none".to_owned(),
                1 => format!("\"{x}\" only"),
                _ => format!("\"{x} {y}\" only"),
            };
            return Err(self.text.fault(format_args!("a vertex needs three coordinates and has {has}")));
        }
        self.text.skip_line();
        Ok(numbers.into())
    }

    fn face(&mut self) -> Result<(), Fault> {
        let line = self.text.line;
        self.corners.clear();
        while !self.text.ends_statement() {
            let corner = self.corner()?;
            self.corners.push(corner);
        }
        match *self.corners {
            [a, b, c] => self.faces.push([a, b, c]),
            [first, .., _] if self.corners.len() > 3 => {
                self.polygons.push((self.faces.len(), self.corners.len()));
                self.faces.extend(self.corners[1..].windows(2).map(|pair| [first, pair[0], pair[1]]));
            }
            _ => return Err(self.too_few_corners(line)),
        }
        self.text.skip_line();
        Ok(())
    }

    #[cold]
    fn too_few_corners(&self, line: usize) -> Fault {
        let has: Vec<String> = self.corners.iter().map(|v| (v.index() + 1).to_string()).collect();
        let has = if has.is_empty() { "none".to_owned() } else { format!("\"{}\" only", has.join(" ")) };
        Fault { line, reason: format!("a face needs three corners and has {has}") }
    }

    /// One corner: `v`, `v/vt`, `v//vn` or `v/vt/vn`.
    #[inline]
    fn corner(&mut self) -> Result<Vert, Fault> {
        let start = self.text.at;
        let Some(index) = self.text.whole() else { return Err(self.bad_corner(start, "is no vertex index")) };
        for _ in 0..2 {
            if self.text.peek() != b'/' {
                break;
            }
            self.text.at += 1;
            if self.text.whole().is_none() && self.text.peek() != b'/' && !self.text.ends_word() {
                return Err(self.bad_corner(start, "is no corner (v, v/vt, v//vn, v/vt/vn)"));
            }
        }
        if self.text.peek() == b'/' {
            return Err(self.bad_corner(start, "is no corner (v, v/vt, v//vn, v/vt/vn)"));
        }
        match resolve(index, self.seen.vertices, self.total.vertices) {
            Some(vertex) => Ok(Vert::new(vertex)),
            None => Err(self.bad_index(start, index)),
        }
    }

    #[cold]
    fn bad_corner(&mut self, start: usize, reason: &str) -> Fault {
        self.text.at = start;
        self.text.fault(format_args!("{} {reason}", Quoted(self.text.peek_word())))
    }

    #[cold]
    fn bad_index(&mut self, start: usize, index: i64) -> Fault {
        let (seen, total) = (self.seen.vertices, self.total.vertices);
        let reason = match index {
            0 => "names vertex 0, but vertices count from 1".to_owned(),
            1.. => format!("names a vertex that does not exist (there are {total})"),
            _ => format!("counts back beyond the first vertex ({seen} stand before this line)"),
        };
        self.bad_corner(start, &reason)
    }
}

/// The element that `index` names, from 0: the file counts from 1, or back from the last one `seen`.
#[inline]
fn resolve(index: i64, seen: usize, total: usize) -> Option<usize> {
    let element = if index > 0 {
        index - 1
    } else if index < 0 {
        seen as i64 + index
    } else {
        -1
    };
    usize::try_from(element).ok().filter(|&element| element < total)
}

/// Replaces the fan that stands for each polygon by a sound cut.
fn cut_polygons(points: &[DVec3], faces: &mut [[Vert; 3]], polygons: &[(usize, usize)]) {
    let (mut corners, mut places, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
    for &(first, n) in polygons {
        let fan = &mut faces[first..first + n - 2];
        corners.clear();
        corners.extend_from_slice(&[fan[0][0], fan[0][1]]);
        corners.extend(fan.iter().map(|triangle| triangle[2]));
        places.clear();
        places.extend(corners.iter().map(|v| points[v.index()]));
        triangles.clear();
        triangulate(&places, &mut triangles);
        for (face, triangle) in fan.iter_mut().zip(&triangles) {
            *face = triangle.map(|i| corners[i as usize]);
        }
    }
}

#[cold]
fn no_faces(bytes: &[u8], total: Counts, last_line: usize) -> Fault {
    match looks_like(bytes) {
        Some(kind) => {
            Fault { line: 1, reason: format!("no faces; {} is how {kind} begins", Quoted(first_word(bytes))) }
        }
        None => Fault { line: last_line, reason: format!("no faces (and {} vertices)", total.vertices) },
    }
}

fn first_word(bytes: &[u8]) -> &[u8] {
    let end = bytes.iter().take(16).position(|b| !b.is_ascii_graphic());
    &bytes[..end.unwrap_or(bytes.len().min(16))]
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

/// Writes a mesh: coordinates in the shortest form that reads back to the same bits.
pub(super) fn format(view: View) -> Vec<u8> {
    let mut out = Vec::with_capacity(40 * view.points.len() + 24 * view.faces.len());
    for point in view.points {
        out.push(b'v');
        for number in point.to_array() {
            out.push(b' ');
            push_number(&mut out, number);
        }
        out.push(b'\n');
    }
    let mut buffer = itoa::Buffer::new();
    for face in view.faces {
        out.push(b'f');
        for v in face {
            out.push(b' ');
            out.extend_from_slice(buffer.format(v.index() + 1).as_bytes());
        }
        out.push(b'\n');
    }
    out
}

/// Appends the shortest decimal that reads back as `number`; a whole one without ".0".
fn push_number(out: &mut Vec<u8>, number: f64) {
    let mut buffer = zmij::Buffer::new();
    let text = buffer.format(number);
    out.extend_from_slice(text.strip_suffix(".0").unwrap_or(text).as_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;

    fn read(text: &str) -> Result<Model, String> {
        parse(text.as_bytes()).map_err(|fault| format!("{}: {}", fault.line, fault.reason))
    }

    fn faces(text: &str) -> Vec<[usize; 3]> {
        let model = read(text).unwrap_or_else(|fault| panic!("{text:?}: {fault}"));
        model.faces.iter().map(|face| face.map(Vert::index)).collect()
    }

    const POINTS: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

    #[test]
    fn points_and_faces_keep_order_and_bits() {
        let model = read("v 0.1 -0 1e-320\nv 9 9 9\nv 1 0 0\nv 500000.12345678901 1 0\nf 1 3 4\n").unwrap();
        let expected = [[0.1, -0.0, 1e-320], [9.0; 3], [1.0, 0.0, 0.0], [500_000.123_456_789, 1.0, 0.0]];
        let bits = |p: [f64; 3]| p.map(f64::to_bits);
        assert_eq!(model.points.iter().map(|p| bits(p.to_array())).collect::<Vec<_>>(), expected.map(bits));
        assert_eq!(model.faces, [[0, 2, 3].map(Vert::new)]);
    }

    #[test]
    fn a_polygon_before_its_vertices_is_cut_by_their_places() {
        // The arrow head of triangulate.rs: the fan from its first corner would be outside.
        let text = "f 1 2 3 4\nv -4 0 0\nv 0 3 0\nv 4 0 0\nv 0 4 0\nf 1 2 3\n";
        assert_eq!(faces(text), [[0, 1, 3], [1, 2, 3], [0, 1, 2]]);
    }

    #[test]
    fn negative_indices_count_back_from_where_they_stand() {
        let text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nf -3 -2 -1\nv 0 1 0\nf -4 -2 -1\nf 1 -2 4\n";
        assert_eq!(faces(text), [[0, 1, 2], [0, 2, 3], [0, 2, 3]]);
    }

    #[test]
    fn every_way_to_end_a_line_counts_lines() {
        let ends =
            [("\n", 6), ("\r\n", 6), ("\r", 6), ("  \n", 6), ("#x\n", 6), (" # c \\\n", 6), ("\t\\\n\n", 11)];
        for (end, line) in ends {
            let text = format!("{POINTS}f 1 2 3\nf 1 x 3\n").replace('\n', end);
            assert_eq!(read(&text).unwrap_err(), format!("{line}: \"x\" is no vertex index"), "{end:?}");
        }
    }

    #[test]
    fn a_continued_line_goes_on_and_a_comment_does_not() {
        assert_eq!(faces(&format!("{POINTS}f 1 \\\n2\\\r\n 3\n")), [[0, 1, 2]]);
        assert_eq!(faces(&format!("# C:\\\n{POINTS}f 1 2 3 # \\\nf 1 3 4 \\")), [[0, 1, 2], [0, 2, 3]]);
    }

    #[test]
    fn faults_name_line_and_word() {
        let cases = [
            ("v 0 0 0\nv nan 0 0\nf 1 1 1", "2: \"nan\" is not a finite number"),
            ("v 0 0 1e999\n", "1: \"1e999\" is not a finite number"),
            ("v 0,5 0 0\n", "1: \"0,5\" is not a number (a comma is no decimal sign)"),
            ("v 1.#IND 0 0\n", "1: \"1.#IND\" is not a number"),
            ("v 0 0\n", "1: a vertex needs three coordinates and has \"0 0\" only"),
            ("v\n", "1: a vertex needs three coordinates and has none"),
            ("f 0 1 2\nv 0 0 0", "1: \"0\" names vertex 0, but vertices count from 1"),
            ("v 0 0 0\nf 1 1 99\n", "2: \"99\" names a vertex that does not exist (there are 1)"),
            (
                "v 0 0 0\nf 1 1 -2/7\n",
                "2: \"-2/7\" counts back beyond the first vertex (1 stand before this line)",
            ),
            ("v 0 0 0\nf 1 1 1.0\n", "2: \"1.0\" is no vertex index"),
            ("v 0 0 0\nf 1/2/3/4 1 1\n", "2: \"1/2/3/4\" is no corner (v, v/vt, v//vn, v/vt/vn)"),
            ("v 0 0 0\nf 1/a 1 1\n", "2: \"1/a\" is no corner (v, v/vt, v//vn, v/vt/vn)"),
            ("v 0 0 0\nf 1 1\n", "2: a face needs three corners and has \"1 1\" only"),
            ("v 0 0 0\nf", "2: a face needs three corners and has none"),
            ("", "1: no faces (and 0 vertices)"),
            ("v 0 0 0\n\nv 0 0 0\n", "3: no faces (and 2 vertices)"),
            ("solid x\nfacet", "1: no faces; \"solid\" is how an STL file begins"),
        ];
        for (text, fault) in cases {
            assert_eq!(read(text).unwrap_err(), fault, "{text:?}");
        }
        let huge = "99999999999999999999";
        let fault = read(&format!("v 0 0 0\nf 1 1 {huge}\n")).unwrap_err();
        assert_eq!(fault, format!("2: \"{huge}\" names a vertex that does not exist (there are 1)"));
    }

    #[test]
    fn numbers_are_written_short_and_read_back() {
        let points =
            vec![dvec3(1.0, -0.0, 0.1), dvec3(1e21, 5e-324, f64::MAX), dvec3(1.0 / 3.0, 100.0, -1e-7)];
        let model = Model { points, faces: vec![[0, 1, 2].map(Vert::new)], ..Model::default() };
        let text = String::from_utf8(format(View::from(&model))).unwrap();
        assert_eq!(
            text,
            "v 1 -0 0.1\nv 1e+21 5e-324 1.7976931348623157e+308\nv 0.3333333333333333 100 -1e-7\nf 1 2 3\n"
        );
        assert_eq!(read(&text).unwrap(), model);
    }
}
