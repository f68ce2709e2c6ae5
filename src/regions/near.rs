//! The vertices near doubtful ones, copied out of the mesh.
//!
//! In/out: `Surface` + doubtful vertices -> `Near`.
//! Cost: O(near vertices); their neighbours and normals are found in parallel.

use glam::DVec3;
use rayon::prelude::*;

use super::patch::REACH_IN_REGION;
use super::surface::{CHUNK, Surface, corners_beside, neighbours};
use crate::mesh::{Mesh, PerVert, Vert};
use crate::rings::collect_rings;

/// Width of a cell in mean edge lengths: some ten vertices of a surface lie in one.
const CELL: f64 = 3.0;
/// From one vertex of the file to the next it is no farther than this, in mean edge lengths, mostly: it is in order.
const LEAP: f64 = 6.0;

/// The vertices that patches can reach, by numbers of their own: those of near vertices are near, however the file
/// orders them, so that a patch lies together in memory.
#[derive(Default)]
pub(super) struct Near {
    /// The number of each vertex, `u32::MAX` if it is not near. `[V]`
    pub of: PerVert<u32>,
    /// The vertex of each number.
    pub verts: Vec<Vert>,
    pub points: Vec<DVec3>,
    /// Unit normals of all faces, where they are interior; else zero.
    pub normals: Vec<DVec3>,
    /// Which of them are interior, and which deep.
    pub interior: Vec<bool>,
    pub deep: Vec<bool>,
    starts: Vec<u32>,
    /// The numbers of the neighbours that are near.
    neighbours: Vec<u32>,
}

impl Near {
    /// Those vertices that come within reach of one of `centres`, and all neighbours of these.
    pub fn around(surface: &Surface, centres: &[Vert]) -> Self {
        let mesh = surface.mesh;
        let mut of = find(mesh, centres, (REACH_IN_REGION * surface.h).powi(2));
        let near = (0..mesh.n_verts()).into_par_iter().map(Vert::new).filter(|&v| of[v] != u32::MAX);
        let verts = along_a_curve(mesh, surface.h, near.collect());
        verts.iter().zip(0..).for_each(|(&v, number)| of[v] = number);
        let (starts, neighbours) = neighbour_numbers(mesh, &verts, &of);
        let normal = |v: Vert| {
            if surface.interior[v] { surface.normal_of(v, |_| true) } else { DVec3::ZERO }
        };
        let (points, normals) = verts.par_iter().map(|&v| (mesh.point(v), normal(v))).unzip();
        let interior = verts.iter().map(|&v| surface.interior[v]).collect();
        let deep = verts.iter().map(|&v| surface.deep[v]).collect();
        Self { of, verts, points, normals, interior, deep, starts, neighbours }
    }

    /// The numbers of those neighbours of the vertex with the number `i` that are near.
    #[inline]
    pub fn neighbours(&self, i: u32) -> &[u32] {
        &self.neighbours[self.starts[i as usize] as usize..self.starts[i as usize + 1] as usize]
    }

    /// Puts into `found` the vertex with the number `centre` and those so many `rings` round it that belong, by their
    /// numbers, as [`collect_rings`] does; those that do not belong lead nowhere.
    pub fn collect_rings(
        &self,
        centre: u32,
        rings: usize,
        max: usize,
        belongs: impl Fn(u32) -> bool,
        found: &mut Vec<u32>,
    ) {
        let around = |i| self.neighbours(i).iter().copied().filter(|&w| belongs(w));
        collect_rings(centre, rings, max, around, found);
    }
}

/// `verts` in the order of a curve that fills space, so that what is near has a near number: it goes from cell to
/// cell, [`CELL`] wide, in the order of Morton (1966).
///
/// Where the file has them in such an order already, its own is as good: on marching cubes fits are made 6 % faster by
/// the curve, and all that reads the mesh is slower; in a shuffled file fits are made in half of the time.
fn along_a_curve(mesh: &Mesh, h: f64, verts: Vec<Vert>) -> Vec<Vert> {
    let is_leap =
        |pair: &&[Vert]| mesh.point(pair[0]).distance_squared(mesh.point(pair[1])) > (LEAP * h).powi(2);
    let n_leaps = verts.par_windows(2).filter(is_leap).count();
    if 2 * n_leaps < verts.len() {
        return verts;
    }
    let low = verts.par_iter().map(|&v| mesh.point(v)).reduce(|| DVec3::INFINITY, DVec3::min);
    let code = |v: Vert| {
        let cell = (mesh.point(v) - low) / (CELL * h);
        spread(cell.x as u64) | spread(cell.y as u64) << 1 | spread(cell.z as u64) << 2
    };
    let mut coded: Vec<(u64, Vert)> = verts.par_iter().map(|&v| (code(v), v)).collect();
    coded.par_sort_unstable();
    coded.into_iter().map(|(_, v)| v).collect()
}

/// The lowest 21 bits of `i`, two places left free between each.
fn spread(i: u64) -> u64 {
    let i = i.min((1 << 21) - 1);
    let i = (i | i << 32) & 0x001f_0000_0000_ffff;
    let i = (i | i << 16) & 0x001f_0000_ff00_00ff;
    let i = (i | i << 8) & 0x100f_00f0_0f00_f00f;
    let i = (i | i << 4) & 0x10c3_0c30_c30c_30c3;
    (i | i << 2) & 0x1249_2492_4924_9249
}

/// The numbers of those neighbours of `verts` that have one, one list after the other, and where the lists begin.
fn neighbour_numbers(mesh: &Mesh, verts: &[Vert], of: &PerVert<u32>) -> (Vec<u32>, Vec<u32>) {
    let lists = |piece: &[Vert]| {
        let mut lengths = Vec::with_capacity(piece.len());
        let mut all = Vec::with_capacity(8 * piece.len());
        let mut round = Vec::new();
        for &v in piece {
            let before = all.len();
            let numbers = neighbours(mesh, v, &mut round).iter().map(|&w| of[w]);
            all.extend(numbers.filter(|&number| number != u32::MAX));
            lengths.push((all.len() - before) as u32);
        }
        (lengths, all)
    };
    let pieces: Vec<(Vec<u32>, Vec<u32>)> = verts.par_chunks(CHUNK).map(lists).collect();
    let mut starts = Vec::with_capacity(verts.len() + 1);
    let mut numbers = Vec::with_capacity(pieces.iter().map(|(_, all)| all.len()).sum());
    starts.push(0);
    for (lengths, all) in pieces {
        let mut start = numbers.len() as u32;
        starts.extend(lengths.into_iter().map(|length| {
            start += length;
            start
        }));
        numbers.extend(all);
    }
    (starts, numbers)
}

/// Finds, layer by layer, the vertices joined to one of `centres` that lie within the root of `reach` of it, and all
/// neighbours of centres: those that do not have `u32::MAX` in the result. `[V]`
fn find(mesh: &Mesh, centres: &[Vert], reach: f64) -> PerVert<u32> {
    /// In any found vertex; those about to be found have their place among these.
    const FOUND: u32 = u32::MAX - 1;
    let mut state = PerVert::filled(mesh.n_verts(), u32::MAX);
    centres.iter().for_each(|&v| state[v] = FOUND);
    // With the nearest centre as far as the layers before know it.
    let mut layer: Vec<(Vert, Vert)> = centres.iter().map(|&v| (v, v)).collect();
    let mut is_first = true;
    while !layer.is_empty() {
        let beside = |piece: &[(Vert, Vert)]| {
            let mut beside = Vec::with_capacity(piece.len());
            for &(v, centre) in piece {
                let new = corners_beside(mesh, v).filter(|&w| state[w] == u32::MAX);
                let measured = new.map(|w| (w, mesh.point(w).distance_squared(mesh.point(centre)), centre));
                beside.extend(measured.filter(|&(_, squared, _)| squared <= reach || is_first));
            }
            beside
        };
        let pieces: Vec<Vec<(Vert, f64, Vert)>> = layer.par_chunks(CHUNK).map(beside).collect();
        let mut next: Vec<(Vert, f64, Vert)> = Vec::new();
        for (w, squared, centre) in pieces.into_iter().flatten() {
            if state[w] == u32::MAX {
                state[w] = next.len() as u32;
                next.push((w, squared, centre));
            } else {
                let (_, least, nearest) = &mut next[state[w] as usize];
                if (squared, centre) < (*least, *nearest) {
                    (*least, *nearest) = (squared, centre);
                }
            }
        }
        next.iter().for_each(|&(w, ..)| state[w] = FOUND);
        layer.clear();
        layer.extend(next.into_iter().map(|(w, _, centre)| (w, centre)));
        is_first = false;
    }
    state
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tests::mesh;
    use crate::regions::tests::labels;

    #[test]
    fn what_is_near_lies_within_reach_of_a_centre_or_next_to_one() {
        // A strip of squares along x, column c at x = c: vertices 2c and 2c + 1.
        let points: Vec<_> = (0..60).map(|i| [f64::from(i / 2), f64::from(i % 2), 0.0]).collect();
        let square = |c: usize| [[2 * c, 2 * c + 2, 2 * c + 3], [2 * c, 2 * c + 3, 2 * c + 1]];
        let m = mesh(&points, &(0..29).flat_map(square).collect::<Vec<_>>());
        let (normals, labels) = labels(&m);
        let mut surface = Surface::new(&m, &normals, &labels);
        assert!(surface.near.verts.is_empty(), "nothing is doubtful");
        let found = |surface: &Surface, centres: &[usize]| {
            let near = Near::around(surface, &centres.iter().map(|&v| Vert::new(v)).collect::<Vec<_>>());
            for (i, &v) in near.verts.iter().enumerate() {
                assert_eq!((near.of[v] as usize, near.points[i]), (i, m.point(v)));
                let normal = if surface.interior[v] { DVec3::Z } else { DVec3::ZERO };
                assert_eq!((near.normals[i], near.interior[i]), (normal, surface.interior[v]));
                assert_eq!(near.deep[i], surface.deep[v]);
                let mut round = Vec::new();
                let near_round = neighbours(&m, v, &mut round).iter().filter(|&&w| near.of[w] != u32::MAX);
                let listed = near.neighbours(i as u32).iter().map(|&w| near.verts[w as usize]);
                assert!(listed.eq(near_round.copied()));
            }
            let mut verts: Vec<usize> = near.verts.iter().map(|v| v.index()).collect();
            verts.sort_unstable();
            verts
        };
        surface.h = 1.0;
        // 4.5 h to both sides: columns 6 to 14; of the centres 20 and 50, columns 10 and 25, both sides.
        assert_eq!(found(&surface, &[20]), (12..30).collect::<Vec<_>>());
        assert_eq!(found(&surface, &[20, 50]), (12..30).chain(42..60).collect::<Vec<_>>());
        surface.h = 0.1;
        assert_eq!(found(&surface, &[20]), [17 + 1, 20, 21, 22, 23], "its neighbours, however far they are");
    }
}
