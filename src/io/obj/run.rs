//! Reads a run of whole OBJ statements.

use glam::DVec3;

use super::super::faces::{Corners, Faces};
use super::super::text::{Cursor, plain_decimal, up_to_eight_digits};
use super::piece::{Piece, STRIDE};
use super::{Counts, Kind, kind};
use crate::attributes::{Channel, Mark, Statement};
use crate::error::{Fault, Quoted};
use crate::mesh::Vert;

/// A run of whole statements while it is read.
pub(super) struct Run<'a> {
    text: Cursor<'a>,
    /// Where the vertices of this run go.
    points: &'a mut [DVec3],
    /// Statements before this run, before the one at the cursor, and in the whole file.
    first: Counts,
    seen: Counts,
    total: Counts,
    piece: Piece,
    /// The corners of the face being read.
    corners: Corners,
}

impl<'a> Run<'a> {
    /// `counts` are those before this run, in it and in the whole file.
    pub fn new(text: Cursor<'a>, points: &'a mut [DVec3], [first, own, total]: [Counts; 3]) -> Self {
        Self {
            text,
            points,
            first,
            seen: first,
            total,
            piece: Piece {
                faces: Faces::with_capacity(own.faces),
                n_verts: own.vertices,
                ..Piece::default()
            },
            corners: Corners::default(),
        }
    }

    pub fn parse(mut self, is_head: bool) -> Result<Piece, Fault> {
        if is_head {
            self.head();
        }
        while !self.text.is_at_end() {
            match kind(&mut self.text) {
                Kind::Vertex => {
                    self.points[self.seen.vertices - self.first.vertices] = self.vertex()?;
                    self.seen.vertices += 1;
                }
                Kind::Face => {
                    self.face()?;
                    self.seen.faces += 1;
                }
                Kind::Texture => {
                    let (values, width) = self.values("texture coordinate (vt) that is not all numbers");
                    self.piece.texture.push(values, width);
                    self.seen.textures += 1;
                }
                Kind::Normal => {
                    let (values, _) = self.values("normal (vn) that is not all numbers");
                    self.piece.normals.push(values, 3);
                    self.seen.normals += 1;
                }
                Kind::Other => self.other(),
            }
        }
        Ok(self.piece)
    }

    /// The comments before the first statement.
    fn head(&mut self) {
        loop {
            let start = self.text.clone();
            match self.text.statement().trim_ascii() {
                [b'#', comment @ ..] => self.piece.head.push(comment.into()),
                [] if !self.text.is_at_end() => {}
                _ => {
                    self.text = start;
                    return;
                }
            }
        }
    }

    /// Reads the rest of a line of three words, each behind one blank: nearly all lines are such. None where this is
    /// not so or a word is not for `read`, which also tells how long it is; then nothing is read.
    #[inline]
    fn three_words<T: Copy + Default>(
        &mut self,
        read: impl Fn(&[u8]) -> Option<(T, usize)>,
    ) -> Option<[T; 3]> {
        let mut rest = &self.text.bytes[self.text.at..];
        let mut words = [T::default(); 3];
        for word in &mut words {
            rest = rest.strip_prefix(b" ")?;
            let length;
            (*word, length) = read(rest)?;
            rest = &rest[length..];
        }
        rest = rest.strip_prefix(b"\n")?;
        self.text.at = self.text.bytes.len() - rest.len();
        self.text.line += 1;
        Some(words)
    }

    /// Three coordinates. What may follow: a weight, or a colour of three or four numbers.
    fn vertex(&mut self) -> Result<DVec3, Fault> {
        if let Some(point) = self.three_words(plain_decimal) {
            return Ok(point.into());
        }
        let mut numbers = [0.0; 7];
        let mut n = 0;
        while !self.text.ends_statement() {
            let number = self.text.number()?;
            if let Some(place) = numbers.get_mut(n) {
                *place = number;
            }
            n += 1;
        }
        let [x, y, z, extras @ ..] = numbers;
        if n != 3 {
            self.extras(n, extras, [x, y])?;
        }
        self.text.skip_line();
        Ok(DVec3::new(x, y, z))
    }

    /// Keeps what stands behind the coordinates of a vertex of `n` numbers.
    #[cold]
    fn extras(&mut self, n: usize, extras: [f64; 4], [x, y]: [f64; 2]) -> Result<(), Fault> {
        const NONE: f64 = f64::NAN;
        let [r, g, b, a] = extras;
        let kept = match n {
            0 => return Err(self.text.fault("a vertex needs three coordinates and has none")),
            1 | 2 => {
                let has = if n == 1 { x.to_string() } else { format!("{x} {y}") };
                let reason = format_args!("a vertex needs three coordinates and has \"{has}\" only");
                return Err(self.text.fault(reason));
            }
            4 => [r, NONE, NONE, NONE, NONE],
            6 => [NONE, r, g, b, NONE],
            7 => [NONE, r, g, b, a],
            _ => {
                self.piece
                    .left_out
                    .add("numbers behind a vertex that are no weight and no colour", self.text.line);
                return Ok(());
            }
        };
        let before = STRIDE * (self.seen.vertices - self.first.vertices);
        self.piece.extras.resize(before, NONE);
        self.piece.extras.extend(kept);
        Ok(())
    }

    fn face(&mut self) -> Result<(), Fault> {
        let total = self.total.vertices as u64;
        let corner = |word: &[u8]| {
            let (index, length) = up_to_eight_digits(word)?;
            (1..=total).contains(&index).then(|| (index as usize - 1, length))
        };
        if let Some(corners) = self.three_words(corner) {
            self.piece.faces.triangles.push(corners.map(Vert::new));
            return Ok(());
        }
        let line = self.text.line;
        self.corners.clear();
        while !self.text.ends_statement() {
            let corner = self.corner()?;
            self.corners.verts.push(corner);
        }
        if self.corners.verts.len() < 3 {
            return Err(self.too_few_corners(line));
        }
        self.piece.faces.push(&mut self.corners);
        self.text.skip_line();
        Ok(())
    }

    #[cold]
    fn too_few_corners(&self, line: usize) -> Fault {
        let has: Vec<String> = self.corners.verts.iter().map(|v| (v.index() + 1).to_string()).collect();
        let has = if has.is_empty() { "none".to_owned() } else { format!("\"{}\" only", has.join(" ")) };
        Fault { line, reason: format!("a face needs three corners and has {has}") }
    }

    /// One corner: `v`, `v/vt`, `v//vn` or `v/vt/vn`.
    #[inline]
    fn corner(&mut self) -> Result<Vert, Fault> {
        let start = self.text.at;
        let Some(index) = self.text.whole() else { return Err(self.bad_corner(start, "is no vertex index")) };
        if self.text.peek() == b'/' {
            self.corner_entries(start)?;
        }
        match resolve(index, self.seen.vertices, self.total.vertices) {
            Some(vertex) => Ok(Vert::new(vertex)),
            None => Err(self.bad_index(start, index)),
        }
    }

    /// What follows the vertex of a corner: a texture coordinate, a normal, or both.
    fn corner_entries(&mut self, start: usize) -> Result<(), Fault> {
        for is_normal in [false, true] {
            if self.text.peek() != b'/' {
                break;
            }
            self.text.at += 1;
            let Some(index) = self.text.whole() else { continue };
            let (entries, seen, total) = if is_normal {
                (&mut self.corners.normals, self.seen.normals, self.total.normals)
            } else {
                (&mut self.corners.textures, self.seen.textures, self.total.textures)
            };
            if let Some(entry) = resolve(index, seen, total) {
                entries.resize(self.corners.verts.len(), Channel::NONE);
                entries.push(entry as u32);
            } else {
                let what = if is_normal { "normal of a corner" } else { "texture coordinate of a corner" };
                self.piece.left_out.add(format!("{what} that does not exist"), self.text.line);
            }
        }
        if self.text.ends_word() {
            return Ok(());
        }
        Err(self.bad_corner(start, "is no corner (v, v/vt, v//vn, v/vt/vn)"))
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

    /// Up to three numbers, and how many there are; NaN for what is no number.
    fn values(&mut self, fault: &str) -> ([f64; 3], u8) {
        let start = self.text.clone();
        let mut values = [0.0; 3];
        let mut n = 0;
        while !self.text.ends_statement() {
            match self.text.number() {
                Ok(number) if n < 3 => values[n] = number,
                _ => {
                    self.text = start;
                    return self.odd_values(fault);
                }
            }
            n += 1;
        }
        if n == 0 {
            self.text = start;
            return self.odd_values(fault);
        }
        self.text.skip_line();
        (values, n as u8)
    }

    #[cold]
    fn odd_values(&mut self, fault: &str) -> ([f64; 3], u8) {
        self.piece.left_out.add(fault, self.text.line);
        let mut text = Cursor::new(self.text.statement(), self.text.line);
        let mut values = [f64::NAN; 3];
        let mut n = 0;
        while !text.ends_statement() && n < 3 {
            match text.number() {
                Ok(number) => values[n] = number,
                Err(_) => text.at += text.peek_word().len(),
            }
            n += 1;
        }
        (values, n.max(1) as u8)
    }

    /// A statement that is neither a vertex nor a face.
    fn other(&mut self) {
        let line = self.text.line;
        let bytes = self.text.statement().trim_ascii();
        let end = bytes.iter().position(u8::is_ascii_whitespace).unwrap_or(bytes.len());
        let (word, rest) = bytes.split_at(end);
        let face = self.piece.faces.triangles.len() as u32;
        match word {
            b"" => {}
            [b'#', ..] => self.piece.left_out.add("comment behind the head", line),
            b"mtllib" | b"maplib" => self.piece.libraries.push(bytes.into()),
            b"g" | b"o" | b"s" | b"usemtl" | b"mg" | b"usemap" | b"lod" | b"bevel" | b"c_interp"
            | b"d_interp" | b"shadow_obj" | b"trace_obj" => {
                self.piece.marks.push(Mark { face, what: Statement::Text(bytes.into()) });
            }
            b"l" | b"p" => match self.element(word == b"l", Cursor::new(rest, line)) {
                Some(what) => self.piece.marks.push(Mark { face, what }),
                None => self.piece.left_out.add("line or point with a vertex that does not exist", line),
            },
            _ => self.piece.left_out.add(Quoted(word).to_string(), line),
        }
    }

    /// A polyline or points.
    fn element(&self, is_line: bool, mut text: Cursor) -> Option<Statement> {
        let mut corners = Vec::new();
        while !text.ends_statement() {
            let index = text.whole()?;
            let vertex = resolve(index, self.seen.vertices, self.total.vertices)?;
            let mut texture = Channel::NONE;
            if is_line && text.peek() == b'/' {
                text.at += 1;
                let entry = text.whole().and_then(|i| resolve(i, self.seen.textures, self.total.textures));
                texture = entry.map_or(Channel::NONE, |entry| entry as u32);
            }
            if !text.ends_word() {
                return None;
            }
            corners.push((Vert::new(vertex), texture));
        }
        match (is_line, corners.len()) {
            (true, 2..) => Some(Statement::Line(corners)),
            (false, 1..) => Some(Statement::Points(corners.into_iter().map(|(v, _)| v).collect())),
            _ => None,
        }
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
