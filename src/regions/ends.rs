//! Takes back short branches that end in the middle of a face: creases do not.
//!
//! ```text
//!   ------------x-----------       x  corner triangle: three chamfer edges
//!                \                 o  dead end: the triangle beyond has no other chamfer edge
//!                 \-------o
//! ```
//!
//! Based on: nothing in the papers, whose chamfers are judged edge by edge.
//! In/out: candidates and their strips -> the same candidates, short branches in strips of their own.
//! Cost: O(chamfer edges).

use rayon::prelude::*;

use super::VertexFits;
use super::gates::{Fate, Strip, Sums, set_apart};
use super::surface::Surface;
use crate::mesh::{Half, Mesh};

/// A branch with more edges than this is no accident. On fandisks on marching cubes those that follow no crease
/// have 15 edges at most, and those that do 29 or more.
const LONGEST_BRANCH: usize = 15;
/// One edge alone may be all that is left of a crease at a corner: without it a wedge loses one.
const SHORTEST_BRANCH: usize = 2;

/// A branch is too far from its fits for a strip, and by this (in h) where none of them is a guess: pieces of true
/// creases between planes reach 0.08 on marching cubes ...
const FAR: f64 = 0.09;
/// ... without a guess among their ends; of false ones this share and more are.
const FEW_GUESSED: f64 = 0.1;

/// Judges each short branch with a dead end by itself, as the strip that it is part of may be sound, and cancels
/// those that the gates for strips do not let pass. `noise` is the median residual, in h.
pub(super) fn cancel_short_branches(
    surface: &Surface,
    fits: &VertexFits,
    candidates: &[Half],
    strip_of: &mut [u32],
    strips: &mut Vec<Strip>,
    noise: f64,
) {
    let kept = super::kept(candidates, strip_of, strips);
    let branches = kept.par_iter().flat_map_iter(|&h| {
        let sides = [Some(h), surface.mesh.twin(h)].into_iter().flatten();
        sides.filter_map(|h| branch(surface.mesh, &kept, h))
    });
    let branches: Vec<Vec<Half>> = branches.collect();
    for branch in branches {
        let mut sums = Sums::default();
        branch.iter().for_each(|&h| sums.add(surface, fits, h));
        let strip = sums.strip(noise);
        // Poor fits do not tell: on noisy meshes all are, and true branches would go.
        let is_wrong = match strip.fate {
            Fate::FarFromFits => strip.displacement > FAR || strip.guessed > FEW_GUESSED,
            fate => fate == Fate::Guessed,
        };
        if !is_wrong {
            continue;
        }
        set_apart(&branch, candidates, strip_of, strips, |_| strip);
    }
}

/// The edges from that of `h`, whose face is a dead end, to a corner triangle, if it is one and there is one near.
fn branch(mesh: &Mesh, kept: &[Half], h: Half) -> Option<Vec<Half>> {
    let beside = |h: Half| {
        let others = [h.next(), h.prev()].into_iter();
        others.filter(|&other| kept.binary_search(&mesh.edge(other)).is_ok())
    };
    // At a border a crease does end.
    let is_dead_end = beside(h).next().is_none() && !mesh.is_border(h.next()) && !mesh.is_border(h.prev());
    let mut branch = Vec::new();
    let mut next = Some(h).filter(|_| is_dead_end);
    while let Some(h) = next.filter(|_| branch.len() < LONGEST_BRANCH) {
        branch.push(mesh.edge(h));
        let mut others = beside(mesh.twin(h)?);
        next = others.next();
        if others.next().is_some() {
            return Some(branch).filter(|branch| branch.len() >= SHORTEST_BRANCH);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::FitSource::Region;
    use crate::mesh::tests::mesh;
    use crate::mesh::{PerVert, Vert};
    use crate::regions::gates::judge_strips;
    use crate::regions::tests::{labels, planes};
    use glam::DVec3;

    const ROWS: usize = 4;

    // A grid of 4 rows of squares, each with the diagonal from its lower left corner. Chamfer edges cross the
    // middle row of squares from column `first` on, in a zigzag, and at column `corner` they part: x.
    //
    //   .---.---.---.---.
    //   | / | / | / | / |
    //   .---b---b-x-b---.      b-a  chamfer edges, those upright in columns `first` to `corner` + 1
    //   | / | / | / | / |
    //   .---a---a---a---.      and the level one below x
    //   | / | / | / | / |
    //   .---.---.---.---.
    fn grid(first: usize, corner: usize) -> (Mesh, Vec<Half>) {
        let columns = corner + 4;
        let at = |c: usize, r: usize| ROWS * c + r;
        let points: Vec<_> =
            (0..ROWS * columns).map(|i| [(i / ROWS) as f64, (i % ROWS) as f64, 0.0]).collect();
        let squares = (0..columns - 1).flat_map(|c| (0..ROWS - 1).map(move |r| (c, r)));
        let halves = squares.flat_map(|(c, r)| {
            [[at(c, r), at(c + 1, r), at(c + 1, r + 1)], [at(c, r), at(c + 1, r + 1), at(c, r + 1)]]
        });
        let m = mesh(&points, &halves.collect::<Vec<_>>());
        let edge = |a: usize, b: usize| {
            let half = |a, b| m.half_between(Vert::new(a), Vert::new(b));
            m.edge(half(a, b).or_else(|| half(b, a)).unwrap())
        };
        let upright = (first..=corner + 1).map(|c| edge(at(c, 1), at(c, 2)));
        let diagonal = (first.max(1) - 1..=corner).map(|c| edge(at(c, 1), at(c + 1, 2)));
        let diagonal = diagonal.skip(usize::from(first > 0));
        let mut edges: Vec<Half> =
            upright.chain(diagonal).chain([edge(at(corner, 1), at(corner + 1, 1))]).collect();
        edges.sort_unstable();
        (m, edges)
    }

    #[test]
    fn a_branch_leads_from_a_dead_end_to_a_corner_near_by() {
        let lengths = |first, corner| {
            let (m, edges) = grid(first, corner);
            let halves = edges.iter().flat_map(|&h| [Some(h), m.twin(h)]).flatten();
            let branches = halves.filter_map(|h| branch(&m, &edges, h));
            let mut lengths: Vec<usize> = branches.map(|branch| branch.len()).collect();
            lengths.sort_unstable();
            lengths
        };
        assert_eq!(lengths(2, 4), [6], "the zigzag, without the single edges beside the corner");
        assert_eq!(lengths(2, 8), [14]);
        assert_eq!(lengths(2, 9), [0; 0], "16 edges are no accident");
        assert_eq!(lengths(0, 2), [0; 0], "it comes from the border");
    }

    #[test]
    fn a_branch_far_from_its_fits_is_cancelled_and_its_strip_is_not() {
        let corner = 5;
        let (m, edges) = grid(2, corner);
        let (normals, labels) = labels(&m);
        let mut surface = Surface::new(&m, &normals, &labels);
        surface.interior = PerVert::filled(m.n_verts(), false);
        let fates = |displacement: f64| {
            let fit = |v: usize| {
                let off = if v / ROWS <= corner { displacement } else { 0.0 };
                (v, [DVec3::Y, DVec3::Z][v % ROWS / 2], off, Region)
            };
            let fits = planes(&m, &(0..m.n_verts()).map(fit).collect::<Vec<_>>());
            let (mut strip_of, mut strips) = judge_strips(&surface, &fits, &edges, 0.0);
            (strips[0].fate, strips[0].n_edges) = (Fate::Kept, edges.len());
            cancel_short_branches(&surface, &fits, &edges, &mut strip_of, &mut strips, 0.0);
            strips.iter().map(|strip| (strip.n_edges, strip.fate)).collect::<Vec<_>>()
        };
        assert_eq!(fates(0.05), [(10, Fate::Kept)]);
        assert_eq!(fates(0.1), [(2, Fate::Kept), (8, Fate::FarFromFits)]);
    }
}
