//! What a file says about a mesh beyond points and faces: colours, texture coordinates, normals, groups,
//! materials, polygons. Carried through the passes here and nowhere else.
//!
//! Three kinds of places hold such data. A *column* has one number per vertex or face. A *channel* has
//! one entry of a table per corner, so that a vertex can lie on a seam. A *mark* stands between faces
//! and holds from there on, like a material. A plain mesh has none and pays nothing.
//!
//! Based on: Wavefront OBJ and PLY, whose statements these are.
//! Differs: nothing is interpreted that need not be, so that it comes out as it went in.
//! In/out: `Attributes` of the old mesh + [`Lineage`](crate::refine::Lineage) -> those of the new mesh.
//! Cost: O(F) for what is there.

mod carry;
mod normals;

use crate::mesh::{Half, PerHalf, PerVert, Vert};

/// Bytes of a file that are passed on as they are: mostly text, in no certain encoding.
pub type Text = Box<[u8]>;

/// Everything of a file that is not a position or a triangle. Empty for a plain mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Attributes {
    /// The comments at the head of the file, one line each, without the sign that makes them one.
    pub head: Vec<Text>,
    /// Further lines of the head that only PLY has (`obj_info`), without their keyword.
    pub info: Vec<Text>,
    /// The material libraries (`mtllib`, `maplib`), whole statements.
    pub libraries: Vec<Text>,
    /// Numbers per vertex (file vertex, if [`split`](Self::split) is there): colours, a quality, ...
    pub vertex_columns: Vec<Column>,
    /// Numbers per face.
    pub face_columns: Vec<Column>,
    /// Texture coordinates of the corners.
    pub texture: Channel,
    /// Normals of the corners.
    pub normals: Channel,
    /// What stands between the faces, in the file's order; ascending in `face`.
    pub marks: Vec<Mark>,
    /// Which triangles are parts of polygons.
    pub polygons: Polygons,
    /// Which vertices of the file each vertex stands for, if several stand in one place.
    pub split: Option<Split>,
    /// How the numbers of the file were stored.
    pub storage: Option<Storage>,
}

/// One number per vertex or face, with a name.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// What the file calls it; colours are `red`, `green`, `blue`, `alpha`.
    pub name: String,
    /// How it is stored in a binary file.
    pub kind: Kind,
    /// One number each; NaN where the file has none.
    pub values: Vec<f64>,
}

/// How a number is stored. Each fits into an `f64` without loss.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "they are Rust's own names")]
pub enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Kind {
    /// Whether it holds whole numbers only.
    #[must_use]
    pub fn is_whole(self) -> bool {
        !matches!(self, Self::F32 | Self::F64)
    }
}

/// How a file stored its numbers; a file of the same format is written in the same way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Storage {
    /// Text or bytes.
    pub encoding: Encoding,
    /// The coordinates: `F32` or `F64`.
    pub coordinates: Kind,
}

/// Text or bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// Text.
    Ascii,
    /// Bytes, the lowest of a number first.
    LittleEndian,
    /// Bytes, the highest of a number first.
    BigEndian,
}

/// An entry of a table per corner.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Channel {
    /// The table. Entries of the file come first and stay, used or not.
    pub values: Vec<[f64; 3]>,
    /// How many of the three numbers each entry has.
    pub widths: Vec<u8>,
    /// For each half-edge the entry at the corner it leaves, or [`Channel::NONE`]. Empty when no corner
    /// has one.
    pub at: PerHalf<u32>,
    /// How many entries come from the file.
    pub from_file: usize,
}

impl Channel {
    /// No entry.
    pub const NONE: u32 = u32::MAX;

    pub(crate) fn reserve_exact(&mut self, n: usize) {
        self.values.reserve_exact(n);
        self.widths.reserve_exact(n);
    }

    /// Appends the entries of another table; those of its corners are not looked at.
    pub(crate) fn append(&mut self, other: Self) {
        self.values.extend(other.values);
        self.widths.extend(other.widths);
    }

    /// Adds an entry.
    pub(crate) fn push(&mut self, value: [f64; 3], width: u8) -> u32 {
        self.values.push(value);
        self.widths.push(width);
        (self.values.len() - 1) as u32
    }
}

/// Something that stands before a face and holds from there on.
#[derive(Clone, Debug, PartialEq)]
pub struct Mark {
    /// The face that it stands before; the number of faces if it stands behind all.
    pub face: u32,
    /// What it is.
    pub what: Statement,
}

/// What can stand between faces.
#[derive(Clone, Debug, PartialEq)]
pub enum Statement {
    /// A whole statement, such as `g wheel` or `usemtl steel`.
    Text(Text),
    /// A polyline: (file) vertices, each with a texture coordinate or [`Channel::NONE`].
    Line(Vec<(Vert, u32)>),
    /// Points: (file) vertices.
    Points(Vec<Vert>),
}

/// The polygons among the faces.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Polygons {
    /// First triangle of each polygon, ascending, and where its sides begin in `sides`. A polygon of n
    /// corners has n - 2 triangles, which follow each other.
    pub list: Vec<(u32, u32)>,
    /// The sides of all polygons: for each side the half-edge of the triangle that it is a side of.
    pub sides: Vec<Half>,
}

impl Polygons {
    /// First triangle and sides of each polygon.
    pub fn iter(&self) -> impl Iterator<Item = (usize, &[Half])> {
        (0..self.list.len()).filter_map(|i| self.get(i))
    }

    /// First triangle and sides of polygon `i`.
    pub(crate) fn get(&self, i: usize) -> Option<(usize, &[Half])> {
        let &(face, start) = self.list.get(i)?;
        let end = self.list.get(i + 1).map_or(self.sides.len(), |&(_, end)| end as usize);
        Some((face as usize, &self.sides[start as usize..end]))
    }

    /// Adds a polygon, whose triangles begin with `face`.
    pub(crate) fn push(&mut self, face: usize, sides: impl IntoIterator<Item = Half>) {
        self.list.push((face as u32, self.sides.len() as u32));
        self.sides.extend(sides);
    }
}

/// The vertices of the file, where the mesh has one vertex for several of them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Split {
    /// For each half-edge the file vertex that it leaves. `[3F]`
    pub at: PerHalf<Vert>,
    /// For each file vertex the vertex of the mesh that it is joined in.
    pub joined_in: PerVert<Vert>,
}

impl Split {
    /// How many file vertices are joined in another one.
    #[must_use]
    pub fn n_joined(&self) -> usize {
        self.joined_in.as_slice().iter().enumerate().filter(|(i, v)| v.index() != *i).count()
    }
}

impl Attributes {
    /// The edges along the file's polylines (`l`), in terms of the mesh's vertices.
    #[must_use]
    pub fn line_edges(&self) -> Vec<[Vert; 2]> {
        let joined = |v: Vert| self.split.as_ref().map_or(v, |split| split.joined_in[v]);
        let lines = self.marks.iter().filter_map(|mark| match &mark.what {
            Statement::Line(line) => Some(line),
            _ => None,
        });
        lines.flat_map(|line| line.windows(2).map(|ends| [joined(ends[0].0), joined(ends[1].0)])).collect()
    }

    /// Whether there is nothing that belongs to a vertex, a corner or a face.
    #[must_use]
    pub fn is_plain(&self) -> bool {
        self.vertex_columns.is_empty()
            && self.face_columns.is_empty()
            && self.texture.at.is_empty()
            && self.normals.at.is_empty()
            && self.marks.is_empty()
            && self.polygons.list.is_empty()
            && self.split.is_none()
    }

    /// The columns called `names`, if all of them are there.
    pub(crate) fn columns<const N: usize>(&self, names: [&str; N]) -> Option<[&Column; N]> {
        let find = |name: &str| self.vertex_columns.iter().find(|column| column.name == name);
        let found: Vec<&Column> = names.iter().filter_map(|name| find(name)).collect();
        found.try_into().ok()
    }
}
