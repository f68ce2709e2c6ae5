//! Gathers the half-edges that leave each vertex.
//!
//! In/out: faces `[F]` -> `Fans`.
//! Cost: O(F); each thread reads all faces and sorts in what leaves its share of the vertices.

use rayon::prelude::*;

use super::{CHUNK, Half, Mesh, Vert};

/// The half-edges that leave each vertex.
#[derive(Clone, Debug, Default)]
pub struct Fans {
    starts: Vec<u32>,
    halves: Vec<Half>,
}

impl Fans {
    /// Each thread counts and places what leaves its part of the vertices.
    pub(super) fn new(n_verts: usize, faces: &[[Vert; 3]]) -> Self {
        let part = n_verts.div_ceil(rayon::current_num_threads()).max(CHUNK);
        let mut starts = vec![0u32; n_verts + 1];
        starts[1..].par_chunks_mut(part).enumerate().for_each(|(i, counts)| {
            for v in faces.as_flattened() {
                if let Some(count) = counts.get_mut(v.index().wrapping_sub(i * part)) {
                    *count += 1;
                }
            }
        });
        for v in 0..n_verts {
            starts[v + 1] += starts[v];
        }
        let mut halves = vec![Half::NONE; 3 * faces.len()];
        let mut rest = halves.as_mut_slice();
        let mut parts = Vec::new();
        for first in (0..n_verts).step_by(part) {
            let bounds = &starts[first..=n_verts.min(first + part)];
            let own;
            (own, rest) = rest.split_at_mut((bounds[bounds.len() - 1] - bounds[0]) as usize);
            parts.push((first, bounds, own));
        }
        parts.into_par_iter().for_each(|(first, bounds, own)| {
            let mut next: Vec<u32> =
                bounds[..bounds.len() - 1].iter().map(|start| start - bounds[0]).collect();
            for (h, v) in (0..).zip(faces.as_flattened()) {
                if let Some(slot) = next.get_mut(v.index().wrapping_sub(first)) {
                    own[*slot as usize] = Half(h);
                    *slot += 1;
                }
            }
        });
        Self { starts, halves }
    }

    /// How many vertices there are.
    pub(super) fn n_verts(&self) -> usize {
        self.starts.len() - 1
    }

    /// The half-edges that leave `v`, ascending.
    #[inline]
    #[must_use]
    pub fn leaving(&self, v: Vert) -> &[Half] {
        &self.halves[self.starts[v.index()] as usize..self.starts[v.index() + 1] as usize]
    }

    pub(super) fn check(&self, mesh: &Mesh) -> Result<(), String> {
        if self.n_verts() != mesh.n_verts() || self.halves.len() != mesh.n_halves() {
            return Err("the fans are those of another mesh".to_owned());
        }
        for v in mesh.verts() {
            let leaving = self.leaving(v);
            if !leaving.is_sorted_by(|a, b| a < b) {
                return Err(format!("the fan of {v:?} is not ascending"));
            }
            if let Some(h) = leaving.iter().find(|&&h| mesh.from(h) != v) {
                return Err(format!("{h:?} does not leave {v:?}"));
            }
        }
        Ok(())
    }
}
