//! Rows of samples that look like a region of their own and are part of the one beside them (step 1).
//!
//! ```text
//!   N---N---N---N      N  a smooth side, down to its last row of samples that are on the surface
//!   | / | / | / |
//!   r---r---r---r      r  the next row, off the surface: the faces above it bend too much to be smooth, those below
//!   | / | / | / |         it do not, and so it is interior, a region one sample wide with exact fits, of the slant
//!   o---o---o---o         that its faces happen to have
//! ```
//!
//! Marching cubes of a part along the grid put whole rows off the surface alike. A true face that has but one row of
//! interior samples faces another way than the regions beside it: those do not explain it.
//!
//! Based on: nothing in the papers.
//! In/out: the interior vertices of a `Surface` -> without such rows: they are doubtful then as any other vertex.
//! Cost: O(near vertices) to find rows, in parallel; a patch and a fit for each vertex of one.

use glam::DVec3;
use rayon::prelude::*;

use super::explain::Explainer;
use super::patch::Regions;
use super::surface::Surface;

/// Each vertex of a row has at most this many interior neighbours.
const ALONG_ROW: usize = 2;
/// A region explains a vertex of a row that is no farther off its fit than this, in h ...
const MAX_DISPLACEMENT: f64 = 0.12;
/// ... and has a normal within this angle (cosine; 12 degrees) of the fit's. Rows beside the base of a pyramid are .05 h
/// and 7 degrees off; at 5 degrees none of them goes, from 10 to 15 the same ones do.
const MIN_COSINE: f64 = 0.978;
/// A row goes as a whole, if regions explain this share of its vertices: what was left of it would be shorter, but as
/// wrong.
const MIN_EXPLAINED: f64 = 0.7;

/// Makes the vertices of rows doubtful that the regions beside them explain.
pub(super) fn dissolve_rows(surface: &mut Surface) {
    let rows = rows(surface);
    let mut is_row = vec![false; surface.near.verts.len()];
    rows.iter().flatten().for_each(|&i| is_row[i as usize] = true);
    let others = Others { surface, is_row: &is_row };
    let is_explained = |explainer: &mut Explainer, row: &Vec<u32>| {
        let n_explained = row.iter().filter(|&&i| others.explain(explainer, i)).count();
        n_explained as f64 >= MIN_EXPLAINED * row.len() as f64
    };
    let explained: Vec<bool> = rows.par_iter().map_init(Explainer::default, is_explained).collect();
    for (row, _) in rows.iter().zip(explained).filter(|(_, is_explained)| *is_explained) {
        for &i in row {
            surface.interior[surface.near.verts[i as usize]] = false;
            surface.near.interior[i as usize] = false;
            surface.near.normals[i as usize] = DVec3::ZERO;
        }
    }
}

/// The regions that are rows: all their vertices have at most [`ALONG_ROW`] interior neighbours. By their numbers
/// among the near vertices.
fn rows(surface: &Surface) -> Vec<Vec<u32>> {
    let near = &surface.near;
    let interior_beside = |i: u32| near.neighbours(i).iter().copied().filter(|&j| near.interior[j as usize]);
    // What is next to deep vertices only has more.
    let is_shallow = |&i: &u32| near.interior[i as usize] && !near.deep[i as usize];
    let is_thin = |i: &u32| is_shallow(i) && interior_beside(*i).count() <= ALONG_ROW;
    let thin: Vec<u32> = (0..near.verts.len() as u32).into_par_iter().filter(is_thin).collect();
    let mut is_open = vec![false; near.verts.len()];
    thin.iter().for_each(|&i| is_open[i as usize] = true);
    let mut rows = Vec::new();
    for &first in &thin {
        if !std::mem::replace(&mut is_open[first as usize], false) {
            continue;
        }
        let (mut row, mut next) = (vec![first], 0);
        while let Some(&i) = row.get(next) {
            next += 1;
            row.extend(interior_beside(i).filter(|&j| std::mem::replace(&mut is_open[j as usize], false)));
        }
        let is_whole = |&i: &u32| interior_beside(i).all(|j| thin.binary_search(&j).is_ok());
        if row.iter().all(is_whole) {
            rows.push(row);
        }
    }
    rows
}

/// The regions without the rows.
struct Others<'a> {
    surface: &'a Surface<'a>,
    /// Of the near vertices.
    is_row: &'a [bool],
}

impl Regions for Others<'_> {
    #[inline]
    fn is_member(&self, v: u32) -> bool {
        self.surface.near.interior[v as usize] && !self.is_row[v as usize]
    }

    #[inline]
    fn are_joined(&self, _: u32, _: u32) -> bool {
        true
    }
}

impl Others<'_> {
    /// Whether one of them explains the near vertex with the number `i`.
    fn explain(&self, explainer: &mut Explainer, i: u32) -> bool {
        let near = &self.surface.near;
        let fit = explainer.explain_by(self.surface, self, near.verts[i as usize]);
        fit.is_some_and(|fit| {
            fit.displacement.abs() <= MAX_DISPLACEMENT
                && fit.normal.dot(near.normals[i as usize]) >= MIN_COSINE
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tests::mesh;
    use crate::mesh::{PerVert, Vert};
    use crate::regions::near::Near;
    use crate::regions::tests::labels;

    const WIDTH: usize = 12;

    /// A sheet of rows along x, one at each y and at `heights[y]`, of which some are interior: which of them are so
    /// afterwards.
    fn interior_rows(heights: &[f64], interior: &[usize]) -> Vec<usize> {
        let n = heights.len();
        let points: Vec<[f64; 3]> =
            (0..n * WIDTH).map(|i| [(i % WIDTH) as f64, (i / WIDTH) as f64, heights[i / WIDTH]]).collect();
        let square = |c: usize| [[c, c + 1, c + WIDTH + 1], [c, c + WIDTH + 1, c + WIDTH]];
        let squares = (0..(n - 1) * WIDTH).filter(|c| c % WIDTH != WIDTH - 1).flat_map(square);
        let m = mesh(&points, &squares.collect::<Vec<_>>());
        let (normals, labels) = labels(&m);
        let mut surface = Surface::new(&m, &normals, &labels);
        surface.h = 1.0;
        let is_interior = |i: usize| interior.contains(&(i / WIDTH));
        surface.interior = (0..m.n_verts()).map(is_interior).collect::<Vec<_>>().into();
        surface.deep = PerVert::filled(m.n_verts(), false);
        surface.near = Near::around(&surface, &m.verts().collect::<Vec<_>>());
        dissolve_rows(&mut surface);
        for (i, v) in surface.near.verts.iter().enumerate() {
            assert_eq!(surface.near.interior[i], surface.interior[*v]);
            assert_eq!(surface.near.normals[i] != DVec3::ZERO, surface.interior[*v]);
        }
        let is_left = |row: usize| {
            let row: Vec<bool> = (0..WIDTH).map(|i| surface.interior[Vert::new(row * WIDTH + i)]).collect();
            assert!(row.iter().all(|&left| left == row[0]), "part of a row");
            row[0]
        };
        (0..n).filter(|&row| is_left(row)).collect()
    }

    #[test]
    fn a_row_goes_if_the_region_beside_it_explains_it() {
        let left = |fall: f64, next: f64| {
            let heights = [0., 0., 0., 0., 0., 0., -fall, -fall - next];
            interior_rows(&heights, &[0, 1, 2, 3, 4, 6])
        };
        assert_eq!(left(0.05, 0.15), [0, 1, 2, 3, 4]);
        assert_eq!(left(0.2, 0.1), [0, 1, 2, 3, 4, 6], "too far off");
        assert_eq!(left(0.05, 0.5), [0, 1, 2, 3, 4, 6], "15 degrees");
    }

    #[test]
    fn what_is_wider_than_a_row_or_part_of_the_region_stays() {
        let heights = [0., 0., 0., 0., 0., 0., -0.05, -0.1, -0.15];
        assert_eq!(interior_rows(&heights, &[0, 1, 2, 3, 4, 6, 7]), [0, 1, 2, 3, 4, 6, 7]);
        assert_eq!(interior_rows(&heights, &[0, 1, 2, 3, 4, 5]), [0, 1, 2, 3, 4, 5]);
        assert_eq!(interior_rows(&heights, &[6]), [6], "nothing else explains it");
    }
}
