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
//! In/out: bytes; points `[V]`, faces `[F]` in the file's order, and what is said about them.
//! Cost: some 100 ns per triangle to read.

mod piece;
mod run;
mod write;

pub(super) use write::{losses, write};

use std::ops::Add;

use glam::DVec3;
use rayon::prelude::*;

use super::text::{Cursor, is_blank};
use super::{Model, looks_like};
use crate::error::{Fault, Quoted};
use crate::mesh::{MAX_FACES, MAX_VERTS};
use piece::Piece;
use run::Run;

/// How many statements of each kind there are, and lines.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Counts {
    vertices: usize,
    faces: usize,
    textures: usize,
    normals: usize,
    lines: usize,
}

impl Counts {
    #[inline]
    fn note(&mut self, statement: Kind) {
        match statement {
            Kind::Vertex => self.vertices += 1,
            Kind::Face => self.faces += 1,
            Kind::Texture => self.textures += 1,
            Kind::Normal => self.normals += 1,
            Kind::Other => {}
        }
    }
}

impl Add for Counts {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self {
            vertices: self.vertices + other.vertices,
            faces: self.faces + other.faces,
            textures: self.textures + other.textures,
            normals: self.normals + other.normals,
            lines: self.lines + other.lines,
        }
    }
}

/// Bytes that a thread reads at a time: enough that joining what they give costs nothing. It is the same
/// for any number of threads, so that they give the same.
const RUN: usize = 1 << 20;

/// Reads a mesh.
pub(super) fn parse(bytes: &[u8]) -> Result<Model, Fault> {
    parse_in_runs(bytes, RUN)
}

fn parse_in_runs(bytes: &[u8], run: usize) -> Result<Model, Fault> {
    if bytes.starts_with(b"\xff\xfe") || bytes.starts_with(b"\xfe\xff") {
        return Err(Fault { line: 1, reason: "this is UTF-16 text; save it as UTF-8".to_owned() });
    }
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let runs = split(bytes, run);
    let counts: Vec<Counts> = runs.par_iter().map(|run| count(run)).collect();
    let total = counts.iter().fold(Counts::default(), |sum, &count| sum + count);
    let most = total.vertices.max(total.textures).max(total.normals);
    if most > MAX_VERTS {
        return Err(Fault { line: 1, reason: format!("{most} vertices are too many") });
    }
    let mut points = vec![DVec3::ZERO; total.vertices];
    let mut pieces = Vec::new();
    parse_runs(&runs, &counts, &mut points, total).collect_into_vec(&mut pieces);
    let mut whole = Piece::with_capacity(&pieces);
    for piece in pieces {
        whole.append(piece?);
    }
    let n_triangles = whole.faces.triangles.len();
    if n_triangles == 0 {
        return Err(no_faces(bytes, total));
    }
    if n_triangles > MAX_FACES {
        return Err(Fault { line: 1, reason: format!("{n_triangles} triangles are too many") });
    }
    Ok(whole.into_model(points))
}

/// Cuts the bytes into runs of about `length`, each of whole statements.
fn split(bytes: &[u8], length: usize) -> Vec<&[u8]> {
    let mut runs = Vec::new();
    let mut rest = bytes;
    while rest.len() > length {
        let mut text = Cursor::new(rest, 1);
        text.at = length;
        text.skip_line();
        // Behind a line that ends in a backslash a statement may go on: the next one is taken along.
        while !text.is_at_end() {
            let start = text.at;
            text.skip_line();
            if !rest[start..text.at].trim_ascii_end().ends_with(b"\\") {
                break;
            }
        }
        let (run, after) = rest.split_at(text.at);
        runs.push(run);
        rest = after;
    }
    runs.push(rest);
    runs
}

/// Reads each run, with its part of the points.
fn parse_runs<'a>(
    runs: &'a [&[u8]],
    counts: &'a [Counts],
    mut points: &'a mut [DVec3],
    total: Counts,
) -> impl IndexedParallelIterator<Item = Result<Piece, Fault>> + 'a {
    let mut before = Counts::default();
    let mut tasks = Vec::with_capacity(runs.len());
    for (&bytes, &count) in runs.iter().zip(counts) {
        let (own, rest) = points.split_at_mut(count.vertices);
        points = rest;
        tasks.push((Cursor::new(bytes, before.lines + 1), own, before, count));
        before = before + count;
    }
    tasks.into_par_iter().map(move |(text, points, before, count)| {
        let is_head = before == Counts::default();
        Run::new(text, points, [before, count, total]).parse(is_head)
    })
}

/// The kinds of statements that are counted.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Vertex,
    Face,
    Texture,
    Normal,
    Other,
}

/// What the statement at the cursor is; the cursor moves behind its first word if it is counted.
#[inline]
fn kind(text: &mut Cursor) -> Kind {
    text.skip_blanks();
    let after = |i: usize| text.bytes.get(text.at + i).copied().unwrap_or(b'\n');
    let is_apart = |b: u8| is_blank(b) || matches!(b, b'\n' | b'\r' | b'\\' | b'#');
    let (kind, length) = match (text.peek(), after(1)) {
        (b'v', b) if is_apart(b) => (Kind::Vertex, 1),
        (b'f', b) if is_apart(b) => (Kind::Face, 1),
        (b'v', b't') if is_apart(after(2)) => (Kind::Texture, 2),
        (b'v', b'n') if is_apart(after(2)) => (Kind::Normal, 2),
        _ => (Kind::Other, 0),
    };
    text.at += length;
    kind
}

/// Counts statements and lines.
fn count(bytes: &[u8]) -> Counts {
    if memchr::memchr2(b'\r', b'\\', bytes).is_some() {
        return count_carefully(bytes);
    }
    // Each line is a statement, and a statement at most one line.
    let mut counts = Counts::default();
    let mut start = 0;
    for end in memchr::memchr_iter(b'\n', bytes) {
        counts.note(kind(&mut Cursor::new(&bytes[start..end], 0)));
        counts.lines += 1;
        start = end + 1;
    }
    counts.note(kind(&mut Cursor::new(&bytes[start..], 0)));
    counts
}

/// [`count`] where lines end in other ways, or go on in the next one.
fn count_carefully(bytes: &[u8]) -> Counts {
    let mut text = Cursor::new(bytes, 0);
    let mut counts = Counts::default();
    while !text.is_at_end() {
        counts.note(kind(&mut text));
        text.statement();
    }
    counts.lines = text.line;
    counts
}

#[cold]
fn no_faces(bytes: &[u8], total: Counts) -> Fault {
    // A last line without an end is not counted.
    let last_line = total.lines + usize::from(!bytes.ends_with(b"\n") && !bytes.ends_with(b"\r"));
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

#[cfg(test)]
mod tests {
    use super::super::View;
    use super::*;
    use crate::mesh::Vert;
    use glam::dvec3;

    fn read(text: &str) -> Result<Model, String> {
        parse(text.as_bytes()).map_err(|fault| format!("{}: {}", fault.line, fault.reason))
    }

    fn faces(text: &str) -> Vec<[usize; 3]> {
        let model = read(text).unwrap_or_else(|fault| panic!("{text:?}: {fault}"));
        model.faces.iter().map(|face| face.map(Vert::index)).collect()
    }

    fn written(model: &Model) -> String {
        let mut out = Vec::new();
        write(View::from(model), &mut out).unwrap();
        String::from_utf8(out).unwrap()
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
        let text = written(&model);
        assert_eq!(
            text,
            "v 1 -0 0.1\nv 1e+21 5e-324 1.7976931348623157e+308\nv 0.3333333333333333 100 -1e-7\nf 1 2 3\n"
        );
        assert_eq!(read(&text).unwrap(), model);
    }

    /// Reads and writes.
    fn again(text: &str) -> String {
        let model = read(text).unwrap_or_else(|fault| panic!("{text:?}: {fault}"));
        assert_eq!(model.notices, [""; 0], "{text:?}");
        written(&model)
    }

    #[test]
    fn what_a_file_says_beyond_the_mesh_comes_back() {
        let text = "\
            # made by hand\n#\n#no blank\nmtllib a b.mtl\n\
            v 0 0 0\nv 1 0 0 0.5 0.25 1\nv 1 1 0 128 64 255 0.5\nv 0 1 0 0.5\n\
            vt 0.5\nvt 0 1\nvt 0 1 0.5\nvn 0 0 1\nvn 0 1 0\n\
            o left #1\ng a b\nusemtl Material #25\ns off\n\
            f 1/1/1 2/2/1 3/3/2\n\
            p 1 2\nl 1/2 3 4/1\n\
            usemtl\n\
            f 1 3//2 4/3\n\
            g\n\
            f 1/2/1 2/3/1 3/2/2 4/1/2\n\
            s 1\n";
        assert_eq!(again(text), text);
    }

    #[test]
    fn a_name_that_ends_in_a_backslash_joins_no_line_to_it() {
        // Found by random changes to files: the face behind the name was lost on writing.
        for name in
            ["usemtl a \\\n\n", "usemtl a \\ \n", "usemtl a \\\\\n \\\n\n", "mtllib a\\\n\n", "g \\\n\\\n\n"]
        {
            let text = format!("{POINTS}{name}f 1 2 3\n");
            let kept = name.replace(['\\', '\n'], "").trim().to_owned();
            let expected =
                if kept.starts_with('m') { format!("{kept}\n{POINTS}") } else { format!("{POINTS}{kept}\n") };
            assert_eq!(again(&text), expected + "f 1 2 3\n", "{name:?}");
        }
        let hash = format!("{POINTS}usemtl a#\\\nf 1 2 3\n");
        assert_eq!(again(&hash), hash);
        assert_eq!(again(&format!("{POINTS}f 1 2 3\ng \\")), format!("{POINTS}f 1 2 3\ng\n"));
    }

    #[test]
    fn polygons_come_back_as_polygons() {
        // A quadrilateral cut along 2-4, a concave pentagon, and triangles between.
        let text = "v 0 0 0\nv 1 0 0\nv 3 2 0\nv 0 1 0\nv 1 0.5 0\nvt 0 0\nvt 1 1\n\
            f 1 2 3\nf 1/1 2/2 3/2 4/1\nf 3 4 1\nf 1 2 5 3 4\nf 2 3 4\n";
        assert_eq!(again(text), text);
        assert_eq!(faces(text)[1..3], [[0, 1, 3], [1, 2, 3]]);
    }

    #[test]
    fn what_is_left_out_is_named_with_count_and_line() {
        let text = "v 0 0 0 1 2\nv 1 0 0\nv 0 1 0\n# late\n# again\ncstype bezier\nvn 0 x 1\nvt\n\
            p 9\nl 1\nf 1/2 2/0 3//5\n";
        let notices = [
            "left out: 1 x numbers behind a vertex that are no weight and no colour (first in line 1)",
            "left out: 2 x comment behind the head (first in line 4)",
            "left out: 1 x \"cstype\" (first in line 6)",
            "left out: 1 x normal (vn) that is not all numbers (first in line 7)",
            "left out: 1 x texture coordinate (vt) that is not all numbers (first in line 8)",
            "left out: 2 x line or point with a vertex that does not exist (first in line 9)",
            "left out: 1 x normal of a corner that does not exist (first in line 11)",
            "left out: 2 x texture coordinate of a corner that does not exist (first in line 11)",
        ];
        let model = read(text).unwrap();
        assert_eq!(model.notices, notices);
        let written = written(&model);
        assert_eq!(written, "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt NaN\nvn 0 NaN 1\nf 1 2 3\n");
    }

    #[test]
    fn any_cut_into_runs_gives_the_same() {
        let texts = [
            "v 0 0 0\nv 1 0 0 0.5 0.25 1\nv 1 1 \\\n 0 1 1 1 0.5\r\nv 0 1 0\nvt 0.5\nvt 0 1\ng a \\\n b\nvn 0 0 1\n\
             f 1/1 2/2 3\nusemtl x\n# c \\\nl 1/2 3 4/1\nf 1 -2 \\\n\\\n 4\nf 1 2 3//1 4\ng\nf -4/-1 2 3\rs 1\n",
            "v 0 0 0\nv 1 0 0\nv 0 1 0\n# c\nf 1 2 3\n# \\\nx\nf 1 2 \\\n 3\nx\nf 1 2 4\nf 1 x\n",
            "v 0 0 0\n\n\n\\\n\n\\\n\\\n v 0 0 0\n\n",
        ];
        for text in texts {
            // As text, in which NaN equals NaN.
            let in_runs = |run: usize| format!("{:?}", parse_in_runs(text.as_bytes(), run));
            let whole = in_runs(usize::MAX);
            (1..text.len()).for_each(|run| assert_eq!(in_runs(run), whole, "{run}"));
        }
    }

    #[test]
    fn polygons_and_groups_may_lie_across_batches() {
        let mut text = String::new();
        (0..50_000).for_each(|i| text += &format!("v {i} {} 0\n", i % 7));
        text += "vt 0 0\nvt 1 1\n";
        for i in 1..=15_000 {
            text += &match i % 5 {
                0 => format!("g {i}\nf {i} {} {}/1 {}\n", i + 1, i + 2, i + 3),
                1 => format!("f {i}/2 {} {} {} {}/1 {}\np {i}\n", i + 1, i + 2, i + 3, i + 4, i + 6),
                _ => format!("f {i} {} {}/2\n", i + 1, i + 2),
            };
        }
        assert_eq!(again(&text), text);
    }
}
