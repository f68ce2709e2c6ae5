//! What a run of an OBJ file gave, and the model that comes of it.

use std::collections::BTreeMap;

use glam::DVec3;

use super::super::Model;
use super::super::faces::Faces;
use crate::attributes::{Attributes, Channel, Column, Kind, Mark, Text};
use crate::error::Fault;

/// What a run of statements gave.
#[derive(Default)]
pub(super) struct Piece {
    pub faces: Faces,
    pub n_verts: usize,
    /// The tables only: the entries of the corners are in `faces`.
    pub texture: Channel,
    pub normals: Channel,
    /// Numbers behind the coordinates: `STRIDE` for each vertex up to the last that has any.
    pub extras: Vec<f64>,
    pub marks: Vec<Mark>,
    pub head: Vec<Text>,
    pub libraries: Vec<Text>,
    pub left_out: LeftOut,
}

/// Numbers kept for each vertex that has some behind its coordinates: a weight, and a colour.
pub(super) const STRIDE: usize = 5;
/// What they are called as columns.
const EXTRAS: [&str; STRIDE] = ["w", "red", "green", "blue", "alpha"];

/// What is not kept: how often, and the line where it came first.
#[derive(Default)]
pub(super) struct LeftOut(BTreeMap<String, (usize, usize)>);

impl LeftOut {
    /// Kinds of things that are told apart.
    const KINDS: usize = 12;

    pub fn add(&mut self, what: impl Into<String>, line: usize) {
        self.add_many(what.into(), 1, line);
    }

    fn add_many(&mut self, mut what: String, count: usize, line: usize) {
        if self.0.len() >= Self::KINDS && !self.0.contains_key(&what) {
            "other statements".clone_into(&mut what);
        }
        self.0.entry(what).or_insert((0, line)).0 += count;
    }

    fn append(&mut self, other: Self) {
        for (what, (count, line)) in other.0 {
            self.add_many(what, count, line);
        }
    }

    fn into_notices(self) -> Vec<String> {
        let mut kinds: Vec<_> = self.0.into_iter().collect();
        kinds.sort_by_key(|&(_, (_, line))| line);
        let notice = |(what, (count, line))| format!("left out: {count} x {what} (first in line {line})");
        kinds.into_iter().map(notice).collect()
    }
}

impl Piece {
    /// Room for what all of `pieces` have.
    pub fn with_capacity(pieces: &[Result<Self, Fault>]) -> Self {
        let sound = || pieces.iter().flatten();
        let mut whole = Self::default();
        whole.faces.triangles.reserve_exact(sound().map(|piece| piece.faces.triangles.len()).sum());
        whole.texture.reserve_exact(sound().map(|piece| piece.texture.values.len()).sum());
        whole.normals.reserve_exact(sound().map(|piece| piece.normals.values.len()).sum());
        whole
    }

    /// Appends what the next run gave.
    pub fn append(&mut self, next: Self) {
        let first = self.faces.triangles.len() as u32;
        if !next.extras.is_empty() {
            self.extras.resize(STRIDE * self.n_verts, f64::NAN);
            self.extras.extend(next.extras);
        }
        self.n_verts += next.n_verts;
        self.faces.append(next.faces);
        self.texture.append(next.texture);
        self.normals.append(next.normals);
        self.marks.extend(next.marks.into_iter().map(|mark| Mark { face: first + mark.face, ..mark }));
        self.head.extend(next.head);
        self.libraries.extend(next.libraries);
        self.left_out.append(next.left_out);
    }

    /// The model, now that all points are known: polygons are cut, tables become channels and columns.
    pub fn into_model(mut self, points: Vec<DVec3>) -> Model {
        let vertex_columns = self.columns(points.len());
        let faces = self.faces.cut(&points);
        let channel = |mut channel: Channel, at: Vec<u32>| {
            channel.at = at.into();
            channel.from_file = channel.values.len();
            channel
        };
        let attributes = Attributes {
            head: self.head,
            libraries: self.libraries,
            vertex_columns,
            texture: channel(self.texture, faces.textures),
            normals: channel(self.normals, faces.normals),
            marks: self.marks,
            polygons: faces.polygons,
            ..Attributes::default()
        };
        Model { points, faces: faces.triangles, attributes, notices: self.left_out.into_notices() }
    }

    /// The numbers behind the coordinates, by column; columns without a number are left away.
    fn columns(&mut self, n_verts: usize) -> Vec<Column> {
        let extras = std::mem::take(&mut self.extras);
        let column = |(i, name): (usize, &str)| {
            let numbers = || extras.iter().skip(i).step_by(STRIDE).copied();
            numbers().any(|number| !number.is_nan()).then(|| {
                let mut values = Vec::with_capacity(n_verts);
                values.extend(numbers());
                values.resize(n_verts, f64::NAN);
                Column { name: name.to_owned(), kind: Kind::F64, values }
            })
        };
        EXTRAS.into_iter().enumerate().filter_map(column).collect()
    }
}
