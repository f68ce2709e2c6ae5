//! Rows of samples that look like smooth regions, or like the ends of one, and are off the flat side beside them
//! (step 1).
//!
//! ```text
//!   N---N---N---N      N  a flat side, down to its last row of samples that are on the surface
//!   | / | / | / |
//!   r---r---r---r      r  the next row, off the surface: the faces above it bend too much to be smooth, those below
//!   | / | / | / |         it do not, and so it is interior, a region one sample wide with exact fits, of the slant
//!   o---o---o---o         that its faces happen to have
//! ```
//!
//! Marching cubes put whole rows off the surface where a part lies along the grid, and a few samples in a row along a
//! chamfer elsewhere. A true face that has but one row of interior samples is an edge wide on both sides of it, and
//! the planes beside it are farther off.
//!
//! Based on: nothing in the papers.
//! In/out: the interior vertices of a `Surface` -> without such rows: they are doubtful then as any other vertex.
//! Cost: O(near vertices) to find rows; a patch and a fit for each vertex of one, in parallel.

use glam::DVec3;
use rayon::prelude::*;

use super::explain::Explainer;
use super::near::Near;
use super::patch::Regions;
use super::surface::Surface;

/// A vertex of a row has at most this many interior neighbours, and so have these.
const ALONG_ROW: usize = 2;
/// The fit of the side beside the row is a plane that leaves no more than this residual, in h: on curved walls that
/// taper off rows are true, and without the limit coarse fandisks have 2 to 5 % more error; at .01 a needle has 1 %.
const FLAT_RMS: f64 = 0.003;
/// The row is off that plane by more than this, in h: what lies on it is no artefact (a thin plate sampled exactly got
/// its first error) ...
const MIN_DISPLACEMENT: f64 = 0.004;
/// ... but by no more than this. Rows beside the base of a pyramid are .05 off, those along a chamfer and in the tip of
/// a star .2; nothing changes between .2 and .3. However they face: in an acute tip they face both sides.
const MAX_DISPLACEMENT: f64 = 0.25;

/// Makes the vertices of rows doubtful that are a little off the flat side beside them.
pub(super) fn dissolve_rows(surface: &mut Surface) {
    let near = &surface.near;
    let mut is_row = vec![false; near.verts.len()];
    let row: Vec<u32> =
        (0..near.verts.len() as u32).into_par_iter().filter(|&i| is_in_row(near, i)).collect();
    row.iter().for_each(|&i| is_row[i as usize] = true);
    let others = Others { near, is_row };
    let is_off_side = |explainer: &mut Explainer, &i: &u32| {
        let fit = explainer.explain_by(surface, &others, near.verts[i as usize])?;
        let is_off = (MIN_DISPLACEMENT..MAX_DISPLACEMENT).contains(&fit.displacement.abs());
        let is_side = fit.is_plane() && fit.rms < FLAT_RMS;
        (is_off && is_side).then_some(i)
    };
    let off: Vec<Option<u32>> = row.par_iter().map_init(Explainer::default, is_off_side).collect();
    for i in off.into_iter().flatten() {
        surface.interior[surface.near.verts[i as usize]] = false;
        surface.near.interior[i as usize] = false;
        surface.near.normals[i as usize] = DVec3::ZERO;
    }
}

/// Whether the near vertex with the number `i` is part of a row.
fn is_in_row(near: &Near, i: u32) -> bool {
    let interior_beside = |i: u32| near.neighbours(i).iter().copied().filter(|&j| near.interior[j as usize]);
    let is_thin = |i: u32| interior_beside(i).nth(ALONG_ROW).is_none();
    // None of these is deep: all of its neighbours would be interior, three at least.
    near.interior[i as usize] && is_thin(i) && interior_beside(i).all(is_thin)
}

/// The regions without the rows.
struct Others<'a> {
    near: &'a Near,
    /// Of the near vertices.
    is_row: Vec<bool>,
}

impl Regions for Others<'_> {
    #[inline]
    fn is_member(&self, v: u32) -> bool {
        self.near.interior[v as usize] && !self.is_row[v as usize]
    }

    #[inline]
    fn are_joined(&self, _: u32, _: u32) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tests::mesh;
    use crate::mesh::{PerVert, Vert};
    use crate::regions::tests::labels;

    const WIDTH: usize = 12;

    /// A sheet of rows along x, one at each y and at `heights[y]`, of which some are interior: which of them are so
    /// afterwards.
    fn interior_rows(heights: &[f64], interior: &[usize]) -> Vec<usize> {
        uneven_rows(heights, 0.0, interior)
    }

    /// Every other column is higher and the others lower by `uneven`.
    fn uneven_rows(heights: &[f64], uneven: f64, interior: &[usize]) -> Vec<usize> {
        let n = heights.len();
        let height = |i: usize| heights[i / WIDTH] + if i.is_multiple_of(2) { uneven } else { -uneven };
        let points: Vec<[f64; 3]> =
            (0..n * WIDTH).map(|i| [(i % WIDTH) as f64, (i / WIDTH) as f64, height(i)]).collect();
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
    fn a_row_goes_if_it_is_a_little_off_the_flat_side_beside_it() {
        let stays = |fall: f64, next: f64| {
            let heights = [0., 0., 0., 0., 0., 0., -fall, -fall - next];
            let left = interior_rows(&heights, &[0, 1, 2, 3, 4, 6]);
            assert_eq!(left[..5], [0, 1, 2, 3, 4]);
            left.len() == 6
        };
        assert!(!stays(0.05, 0.15));
        assert!(!stays(0.24, 0.6));
        assert!(stays(0.3, 0.1), "too far off");
        assert!(!stays(0.05, 5.0), "however it faces");
        assert!(stays(0.0035, 0.15), "it is on the side");
        assert!(!stays(0.0045, 0.15));
    }

    #[test]
    fn a_row_beside_what_is_uneven_stays() {
        let stays = |uneven: f64| {
            let heights = [0., 0., 0., 0., 0., 0., -0.05, -0.15];
            uneven_rows(&heights, uneven, &[0, 1, 2, 3, 4, 6]).len() == 6
        };
        assert_eq!([0.002, 0.005].map(stays), [false, true]);
    }

    #[test]
    fn a_row_beside_what_is_not_flat_stays() {
        let curved = |k: f64| [0., 1., 2., 3., 4., 5.].map(|y: f64| -k * y * y);
        let left = |k: f64| {
            let heights = [&curved(k)[..], &[-k * 36.0 - 0.05, -k * 49.0 - 0.1]].concat();
            interior_rows(&heights, &[0, 1, 2, 3, 4, 6])
        };
        assert_eq!(left(0.0), [0, 1, 2, 3, 4]);
        assert_eq!(left(0.03), [0, 1, 2, 3, 4, 6]);
    }

    #[test]
    fn what_is_wider_than_a_row_or_part_of_the_region_stays() {
        let heights = [0., 0., 0., 0., 0., 0., -0.05, -0.1, -0.15];
        assert_eq!(interior_rows(&heights, &[0, 1, 2, 3, 4, 6, 7]), [0, 1, 2, 3, 4, 6, 7]);
        assert_eq!(interior_rows(&heights, &[0, 1, 2, 3, 4, 5]), [0, 1, 2, 3, 4, 5]);
        assert_eq!(interior_rows(&heights, &[6]), [6], "nothing else explains it");
    }
}
