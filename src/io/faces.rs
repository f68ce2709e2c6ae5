//! Faces while a file is read: triangles, and polygons that wait for their points to be cut.

use glam::DVec3;

use super::triangulate::triangulate;
use crate::attributes::{Channel, Column, Polygons};
use crate::mesh::{Half, Vert};

/// The faces of a file, or of a part of it, in order.
#[derive(Default)]
pub(super) struct Faces {
    /// The triangles. A polygon stands as a fan until it is cut.
    pub triangles: Vec<[Vert; 3]>,
    /// First triangle and number of corners of each face with more than three.
    polygons: Vec<(usize, usize)>,
    /// The channels' entries at the corners; they may end early.
    textures: Vec<u32>,
    normals: Vec<u32>,
}

/// The corners of one face; the channels' entries may end early.
#[derive(Default)]
pub(super) struct Corners {
    pub verts: Vec<Vert>,
    pub textures: Vec<u32>,
    pub normals: Vec<u32>,
}

impl Corners {
    pub fn clear(&mut self) {
        self.verts.clear();
        self.textures.clear();
        self.normals.clear();
    }
}

/// Faces whose polygons are cut, with the entries of each half-edge.
pub(super) struct CutFaces {
    pub triangles: Vec<[Vert; 3]>,
    pub polygons: Polygons,
    pub textures: Vec<u32>,
    pub normals: Vec<u32>,
}

impl Faces {
    pub fn with_capacity(n: usize) -> Self {
        Self { triangles: Vec::with_capacity(n), ..Self::default() }
    }

    /// Adds a face of three or more corners.
    #[inline]
    pub fn push(&mut self, corners: &mut Corners) {
        let first = self.triangles.len();
        let n = corners.verts.len();
        if !corners.textures.is_empty() {
            push_fan(&mut self.textures, 3 * first, &mut corners.textures, n);
        }
        if !corners.normals.is_empty() {
            push_fan(&mut self.normals, 3 * first, &mut corners.normals, n);
        }
        if let [a, b, c] = *corners.verts {
            self.triangles.push([a, b, c]);
        } else {
            self.polygons.push((first, n));
            let verts = &corners.verts;
            self.triangles.extend(verts[1..].windows(2).map(|pair| [verts[0], pair[0], pair[1]]));
        }
    }

    /// Appends faces that follow these in the file.
    pub fn append(&mut self, next: Self) {
        let first = self.triangles.len();
        self.triangles.extend(next.triangles);
        self.polygons.extend(next.polygons.into_iter().map(|(face, n)| (first + face, n)));
        for (at, next) in [(&mut self.textures, next.textures), (&mut self.normals, next.normals)] {
            if !next.is_empty() {
                at.resize(3 * first, Channel::NONE);
                at.extend(next);
            }
        }
    }

    /// Replaces the fan that stands for each polygon by a sound cut.
    pub fn cut(mut self, points: &[DVec3]) -> CutFaces {
        let n_halves = 3 * self.triangles.len();
        for at in [&mut self.textures, &mut self.normals] {
            if !at.is_empty() {
                at.resize(n_halves, Channel::NONE);
            }
        }
        let mut polygons = Polygons::default();
        let (mut places, mut cut, mut sides) = (Vec::new(), Vec::new(), Vec::new());
        for (first, n) in self.polygons {
            let fan = self.triangles[first..first + n - 2].as_flattened_mut();
            places.clear();
            places.extend(fan_corners(fan).map(|v| points[v.index()]));
            cut.clear();
            triangulate(&places, &mut cut);
            recut(fan, &cut);
            for at in [&mut self.textures, &mut self.normals] {
                if !at.is_empty() {
                    recut(&mut at[3 * first..3 * (first + n - 2)], &cut);
                }
            }
            sides.clear();
            sides.resize(n, Half::NONE);
            for (i, &corner) in cut.as_flattened().iter().enumerate() {
                let next = cut[i / 3][(i + 1) % 3];
                if next as usize == (corner as usize + 1) % n {
                    sides[corner as usize] = Half::new(3 * first + i);
                }
            }
            polygons.push(first, sides.iter().copied());
        }
        CutFaces { triangles: self.triangles, polygons, textures: self.textures, normals: self.normals }
    }

    /// Gives a column that has a value per face of the file a value per triangle.
    pub fn per_triangle(&self, column: &mut Column) {
        if self.polygons.is_empty() {
            return;
        }
        let mut values = Vec::with_capacity(self.triangles.len());
        let mut polygons = self.polygons.iter().peekable();
        for &value in &column.values {
            let n = polygons.next_if(|&&(first, _)| first == values.len()).map_or(3, |&(_, n)| n);
            values.extend(std::iter::repeat_n(value, n - 2));
        }
        column.values = values;
    }
}

/// Appends the entries of a face of `n` corners as the fan that its corners stand as.
fn push_fan(at: &mut Vec<u32>, before: usize, entries: &mut Vec<u32>, n: usize) {
    entries.resize(n, Channel::NONE);
    at.resize(before, Channel::NONE);
    at.extend(entries[1..].windows(2).flat_map(|pair| [entries[0], pair[0], pair[1]]));
}

/// The corners of a polygon that stands as a fan.
fn fan_corners<T: Copy>(fan: &[T]) -> impl Iterator<Item = T> {
    fan[..2].iter().copied().chain(fan.iter().skip(2).step_by(3).copied())
}

/// Puts the triangles, given as numbers of corners, in the place of the fan.
fn recut<T: Copy>(fan: &mut [T], triangles: &[[u32; 3]]) {
    let corners: Vec<T> = fan_corners(fan).collect();
    for (value, &corner) in fan.iter_mut().zip(triangles.as_flattened()) {
        *value = corners[corner as usize];
    }
}
