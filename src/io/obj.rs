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
#[cfg(test)]
mod tests;
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
    // Each line is a statement, and a statement at most one line. Nearly all begin with a letter and a blank.
    let kind_of = |line: &[u8]| match line {
        [b'v', b' ', ..] => Kind::Vertex,
        [b'f', b' ', ..] => Kind::Face,
        _ => kind(&mut Cursor::new(line, 0)),
    };
    let mut counts = Counts::default();
    let mut start = 0;
    for end in memchr::memchr_iter(b'\n', bytes) {
        counts.note(kind_of(&bytes[start..end]));
        counts.lines += 1;
        start = end + 1;
    }
    counts.note(kind_of(&bytes[start..]));
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
