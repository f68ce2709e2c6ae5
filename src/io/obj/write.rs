//! Writes OBJ: coordinates in the shortest form that reads back to the same bits.

use std::io::{self, Write};
use std::ops::Range;

use rayon::prelude::*;

use super::super::View;
use super::super::text::{push_number, push_one_line, push_whole};
use crate::attributes::{Attributes, Channel, Column, Statement};
use crate::mesh::{Half, Vert};

/// The columns that an OBJ file can hold, by what it makes of them.
const COLOURS: [&str; 3] = ["red", "green", "blue"];
const NORMALS: [&str; 3] = ["nx", "ny", "nz"];
const TEXTURES: [[&str; 2]; 3] = [["s", "t"], ["u", "v"], ["texture_u", "texture_v"]];

/// Vertices or faces that a thread writes at a time.
const BATCH: usize = 1 << 14;

/// Writes a mesh.
pub(in super::super) fn write(view: View, out: &mut (dyn Write + Send)) -> io::Result<()> {
    let textures = CornerSource::textures(view);
    let normals = CornerSource::normals(view);
    let mut head = Vec::new();
    push_head(&mut head, view);
    out.write_all(&head)?;
    let Attributes { texture, normals: normal, .. } = view.attributes;
    let vertices = Vertices::of(view);
    let faces = Faces { view, textures: &textures, normals: &normals };
    let sections: [(usize, Push); 4] = [
        (view.points.len(), &|range, out| vertices.push(out, range)),
        (textures.len(texture), &|range, out| textures.push_entries(out, "vt", texture, range)),
        (normals.len(normal), &|range, out| normals.push_entries(out, "vn", normal, range)),
        (view.faces.len(), &|range, out| faces.push(out, range)),
    ];
    in_batches(&sections, out)
}

/// Formats the elements of a range.
type Push<'a> = &'a (dyn Fn(Range<usize>, &mut Vec<u8>) + Sync);

/// Formats the elements of the sections in batches, on all threads, and writes them in order: some batches are
/// formatted while those before them are written.
fn in_batches(sections: &[(usize, Push)], out: &mut (dyn Write + Send)) -> io::Result<()> {
    let mut batches: Vec<(Range<usize>, Push)> = Vec::new();
    for &(n, push) in sections {
        batches.extend((0..n).step_by(BATCH).map(|start| (start..n.min(start + BATCH), push)));
    }
    let batch = |(range, push): &(Range<usize>, Push<'_>)| {
        let mut out = Vec::with_capacity(40 * BATCH);
        push(range.clone(), &mut out);
        out
    };
    let mut ready: Vec<Vec<u8>> = Vec::new();
    for wave in batches.chunks(2 * rayon::current_num_threads()) {
        let (written, next) = rayon::join(
            || ready.iter().try_for_each(|batch| out.write_all(batch)),
            || wave.par_iter().map(batch).collect(),
        );
        written?;
        ready = next;
    }
    ready.iter().try_for_each(|batch| out.write_all(batch))
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
    // Without blanks at the end, as they are read.
    for line in &view.attributes.head {
        out.push(b'#');
        push_one_line(out, line.trim_ascii_end());
    }
    for line in &view.attributes.info {
        out.extend_from_slice(if line.is_empty() { b"#".as_slice() } else { b"# " });
        push_one_line(out, line);
    }
    for statement in &view.attributes.libraries {
        out.extend_from_slice(closed(statement));
        out.push(b'\n');
    }
}

/// A statement without a backslash at its end, which would join the next line to it. Behind a `#` in the
/// same line it would not.
fn closed(mut statement: &[u8]) -> &[u8] {
    while let Some(shorter) = statement.strip_suffix(b"\\") {
        let line = shorter.rsplit(|byte| matches!(byte, b'\n' | b'\r')).next().unwrap_or_default();
        if line.contains(&b'#') {
            break;
        }
        statement = shorter.trim_ascii_end();
    }
    statement
}

/// The vertices with what stands behind their coordinates.
struct Vertices<'a> {
    view: View<'a>,
    weight: Option<&'a Column>,
    /// Red, green, blue, and alpha if it is there.
    colours: Vec<&'a Column>,
}

impl<'a> Vertices<'a> {
    fn of(view: View<'a>) -> Self {
        let attributes = view.attributes;
        let mut colours = attributes.columns(COLOURS).map_or(Vec::new(), Vec::from);
        if !colours.is_empty() {
            colours.extend(attributes.columns(["alpha"]).into_iter().flatten());
        }
        Self { view, weight: attributes.columns(["w"]).map(|[weight]| weight), colours }
    }

    fn push(&self, out: &mut Vec<u8>, range: Range<usize>) {
        for i in range {
            out.push(b'v');
            self.view.points[i].to_array().into_iter().for_each(|number| push_word(out, number));
            let weight = self.weight.map(|column| column.values[i]).filter(|number| !number.is_nan());
            let mut colour =
                self.colours.iter().map(|column| unit_value(column, i)).filter(|x| !x.is_nan()).peekable();
            weight.filter(|_| colour.peek().is_none()).into_iter().for_each(|number| push_word(out, number));
            colour.for_each(|number| push_word(out, number));
            out.push(b'\n');
        }
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

    /// How many entries there are.
    fn len(&self, channel: &Channel) -> usize {
        match self {
            Self::Channel => channel.values.len(),
            Self::Columns(columns) => columns[0].values.len(),
        }
    }

    fn push_entries(&self, out: &mut Vec<u8>, keyword: &str, channel: &Channel, range: Range<usize>) {
        for i in range {
            out.extend_from_slice(keyword.as_bytes());
            match self {
                Self::Channel => {
                    let numbers = &channel.values[i][..channel.widths[i] as usize];
                    numbers.iter().for_each(|&number| push_word(out, number));
                }
                Self::Columns(columns) => columns.iter().for_each(|column| push_word(out, column.values[i])),
            }
            out.push(b'\n');
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

/// The faces, and what stands between them.
struct Faces<'a> {
    view: View<'a>,
    textures: &'a CornerSource<'a>,
    normals: &'a CornerSource<'a>,
}

impl Faces<'_> {
    /// The faces of `range`, each polygon with the range that it begins in, and the marks before them.
    fn push(&self, out: &mut Vec<u8>, range: Range<usize>) {
        let Attributes { marks, polygons, texture, normals, .. } = self.view.attributes;
        let is_bare = self.textures.len(texture) == 0 && self.normals.len(normals) == 0;
        if is_bare && marks.is_empty() && polygons.list.is_empty() {
            self.view.faces[range].iter().for_each(|face| push_triangle(out, face));
            return;
        }
        let from = |face: usize| marks.partition_point(|mark| (mark.face as usize) < face);
        let is_last = range.end == self.view.faces.len();
        let own_marks = from(range.start)..if is_last { marks.len() } else { from(range.end) };
        let mut own_marks = marks[own_marks].iter().peekable();

        let mut polygon = polygons.list.partition_point(|&(first, _)| (first as usize) < range.start);
        let mut face = range.start;
        // A polygon that began in the range before may reach into this one.
        if let Some((first, sides)) = polygon.checked_sub(1).and_then(|before| polygons.get(before)) {
            face = face.max(first + sides.len() - 2);
        }
        while face < range.end {
            while let Some(mark) = own_marks.next_if(|mark| mark.face as usize <= face) {
                push_statement(out, &mark.what);
            }
            out.push(b'f');
            match polygons.get(polygon) {
                Some((first, sides)) if first == face => {
                    sides.iter().for_each(|&half: &Half| self.push_corner(out, half.index()));
                    face += sides.len() - 2;
                    polygon += 1;
                }
                _ => {
                    (3 * face..3 * face + 3).for_each(|half| self.push_corner(out, half));
                    face += 1;
                }
            }
            out.push(b'\n');
        }
        own_marks.for_each(|mark| push_statement(out, &mark.what));
    }

    #[inline]
    fn push_corner(&self, out: &mut Vec<u8>, half: usize) {
        let v = self.view.faces.as_flattened()[half];
        out.push(b' ');
        push_whole(out, v.index() + 1);
        let texture = self.textures.entry(&self.view.attributes.texture, half, v);
        let normal = self.normals.entry(&self.view.attributes.normals, half, v);
        if texture.is_some() || normal.is_some() {
            out.push(b'/');
        }
        texture.into_iter().for_each(|texture| push_whole(out, texture + 1));
        if let Some(normal) = normal {
            out.push(b'/');
            push_whole(out, normal + 1);
        }
    }
}

/// Appends the line of a face that has three vertices and nothing else.
#[inline]
fn push_triangle(out: &mut Vec<u8>, face: &[Vert; 3]) {
    /// Room for three numbers of ten digits, and what stands round them.
    const LONGEST: usize = 3 * 11 + 2;
    /// 00 to 99.
    const PAIRS: [[u8; 2]; 100] = {
        let mut pairs = [[b'0'; 2]; 100];
        let mut i = 0;
        while i < 100 {
            pairs[i] = [b'0' + i as u8 / 10, b'0' + i as u8 % 10];
            i += 1;
        }
        pairs
    };
    let mut line = [b' '; LONGEST];
    line[LONGEST - 1] = b'\n';
    let mut at = LONGEST - 1;
    for v in face.iter().rev() {
        let mut number = v.index() + 1;
        while number >= 10 {
            at -= 2;
            line[at..at + 2].copy_from_slice(&PAIRS[number % 100]);
            number /= 100;
        }
        if number > 0 {
            at -= 1;
            line[at] = b'0' + number as u8;
        }
        at -= 1; // Over the blank before it.
    }
    line[at - 1] = b'f';
    out.extend_from_slice(&line[at - 1..]);
}

fn push_statement(out: &mut Vec<u8>, what: &Statement) {
    match what {
        Statement::Text(text) => out.extend_from_slice(closed(text)),
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
