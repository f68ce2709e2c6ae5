//! The vertices near doubtful ones, copied out of the mesh into an order of their own.
//!
//! In/out: `Surface` + doubtful vertices -> `Near`.
//! Cost: O(near vertices); their neighbours and normals are found in parallel.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use super::patch::REACH_IN_REGION;
use super::surface::{CHUNK, Surface, neighbours};
use crate::mesh::{Mesh, PerVert, Vert};

/// The vertices that patches can reach, by numbers of their own: neighbours have numbers near each other, so
/// that a patch lies together in memory however the file orders its vertices.
#[derive(Default)]
pub(super) struct Near {
    /// The number of each vertex, `u32::MAX` if it is not near. `[V]`
    pub of: PerVert<u32>,
    /// The vertex of each number.
    pub verts: Vec<Vert>,
    pub points: Vec<DVec3>,
    /// Unit normals of all faces, where they are interior; else zero.
    pub normals: Vec<DVec3>,
    /// Which of them are interior.
    pub interior: Vec<bool>,
    starts: Vec<u32>,
    /// The numbers of the neighbours that are near.
    neighbours: Vec<u32>,
}

impl Near {
    /// Those vertices that come within reach of one of `centres`, and all neighbours of these.
    pub fn around(surface: &Surface, centres: &[Vert]) -> Self {
        let mesh = surface.mesh;
        let mut found = Found::around(mesh, centres, (REACH_IN_REGION * surface.h).powi(2));
        let verts = found.renumber();
        let mut near = Self { of: found.place, verts, starts: vec![0], ..Self::default() };
        for &v in &near.verts {
            let list = &found.lists[found.order[near.of[v] as usize] as usize];
            let numbers = found.neighbours[list.clone()].iter().map(|&w| near.of[w]);
            near.neighbours.extend(numbers.filter(|&w| w != u32::MAX));
            near.starts.push(near.neighbours.len() as u32);
        }
        near.points = near.verts.iter().map(|&v| mesh.point(v)).collect();
        near.interior = near.verts.iter().map(|&v| surface.interior[v]).collect();
        // In the order of the file, in which what they read lies together.
        let is_sample = |v: &Vert| near.of[*v] != u32::MAX && surface.interior[*v];
        let normal = |v: Vert| (near.of[v], surface.normal_of(v, |_| true));
        let samples = (0..mesh.n_verts()).into_par_iter().map(Vert::new).filter(is_sample);
        let found: Vec<(u32, DVec3)> = samples.map(normal).collect();
        near.normals = vec![DVec3::ZERO; near.verts.len()];
        found.into_iter().for_each(|(i, normal)| near.normals[i as usize] = normal);
        near
    }

    /// The numbers of those neighbours of the vertex with the number `i` that are near.
    #[inline]
    pub fn neighbours(&self, i: u32) -> &[u32] {
        &self.neighbours[self.starts[i as usize] as usize..self.starts[i as usize + 1] as usize]
    }
}

/// The neighbours of `verts`, one list after the other, and the lengths of the lists; in pieces.
fn neighbour_lists(mesh: &Mesh, verts: &[Vert]) -> Vec<(Vec<usize>, Vec<Vert>)> {
    let lists = |piece: &[Vert]| {
        let (mut lengths, mut all, mut round) = (Vec::with_capacity(piece.len()), Vec::new(), Vec::new());
        all.reserve(8 * piece.len());
        for &v in piece {
            all.extend_from_slice(neighbours(mesh, v, &mut round));
            lengths.push(round.len());
        }
        (lengths, all)
    };
    verts.par_chunks(CHUNK).map(lists).collect()
}

/// The search for near vertices, layer by layer.
struct Found {
    /// In the order in which they were found.
    verts: Vec<Vert>,
    /// The place of each vertex in `verts`, later its number; `u32::MAX` if it was not found. `[V]`
    place: PerVert<u32>,
    /// Where `neighbours` has those of each vertex.
    lists: Vec<Range<usize>>,
    neighbours: Vec<Vert>,
    /// For each number the place in `verts`.
    order: Vec<u32>,
}

impl Found {
    fn around(mesh: &Mesh, centres: &[Vert], reach: f64) -> Self {
        let mut place = PerVert::filled(mesh.n_verts(), u32::MAX);
        centres.iter().zip(0..).for_each(|(&v, i)| place[v] = i);
        let mut verts = centres.to_vec();
        // The nearest centre as far as the layers before know it.
        let mut centre_of = centres.to_vec();
        let (mut lists, mut all) = (Vec::new(), Vec::new());
        let mut layer_start = 0;
        while layer_start < verts.len() {
            let layer = layer_start..verts.len();
            layer_start = layer.end;
            let first = all.len();
            for (lengths, found) in neighbour_lists(mesh, &verts[layer.clone()]) {
                let start = all.len();
                all.extend(found);
                lists.extend(lengths.iter().scan(start, |start, length| {
                    *start += length;
                    Some(*start - length..*start)
                }));
            }
            let mut next: Vec<(Vert, f64, Vert)> = Vec::new();
            let mut pairs = all[first..].iter();
            for (list, &centre) in lists[layer.clone()].iter().zip(&centre_of[layer.clone()]) {
                for &w in pairs.by_ref().take(list.len()) {
                    let squared = || mesh.point(w).distance_squared(mesh.point(centre));
                    match (place[w] as usize).checked_sub(layer.end) {
                        None => {}
                        Some(pending) if pending < next.len() => {
                            let (_, least, best) = &mut next[pending];
                            if *best != centre && (squared(), centre) < (*least, *best) {
                                (*least, *best) = (squared(), centre);
                            }
                        }
                        Some(_) => {
                            place[w] = (layer.end + next.len()) as u32;
                            next.push((w, squared(), centre));
                        }
                    }
                }
            }
            next.iter().for_each(|&(w, ..)| place[w] = u32::MAX);
            for (w, squared, centre) in next {
                if squared <= reach || layer.start == 0 {
                    place[w] = verts.len() as u32;
                    verts.push(w);
                    centre_of.push(centre);
                }
            }
        }
        Self { verts, place, lists, neighbours: all, order: Vec::new() }
    }

    /// Numbers the vertices breadth first. Returns them in this order.
    fn renumber(&mut self) -> Vec<Vert> {
        let mut is_numbered = vec![false; self.verts.len()];
        self.order.reserve(self.verts.len());
        let mut next = 0;
        for first in 0..self.verts.len() {
            if !std::mem::replace(&mut is_numbered[first], true) {
                self.order.push(first as u32);
            }
            while let Some(&i) = self.order.get(next) {
                next += 1;
                for &w in &self.neighbours[self.lists[i as usize].clone()] {
                    let place = self.place[w];
                    if place != u32::MAX && !std::mem::replace(&mut is_numbered[place as usize], true) {
                        self.order.push(place);
                    }
                }
            }
        }
        let verts: Vec<Vert> = self.order.iter().map(|&i| self.verts[i as usize]).collect();
        verts.iter().zip(0..).for_each(|(&v, number)| self.place[v] = number);
        verts
    }
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
