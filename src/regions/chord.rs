//! Labels that marching cubes cannot have made (second pass).
//!
//! ```text
//!        B
//!         \   s       A, B    two sides of a crease, with normals N and M
//!    ------\---x--    o...x   an edge of the grid, of length s: the distance along it is the larger one of those to
//!     A   v \,p            A and B (of a ridge; the smaller one of a valley)
//!          o' \       p       the sample, where the chord of the distances at o and x is zero: inside A by u, B by v
//! ```
//!
//! With p at the share t of the edge, u / t + v / (1 - t) = s (M - N)·e for its direction e. The left side is at least
//! (√u + √v)², the right side at most s |M - N|: so (√u + √v)² ≤ s √(2 (1 - N·M)) beside any crease, wherever the grid
//! lies. What is farther from both sides is no part of either, but of a third face between them, too small to be a
//! region.
//!
//! Based on: nothing in the papers.
//! In/out: `Surface` + fits, where samples are off the surface -> fits without such labels; whether the samples are
//! those of marching cubes.
//! Cost: O(vertices whose label is far from them), each with two rings, in parallel.

use rayon::prelude::*;

use super::VertexFits;
use super::surface::Surface;
use crate::fit::{Fit, FitSource};
use crate::mesh::Vert;

/// The longest edge of the grid, in h. Right labels need 1.06 at most, on 60 meshes of planes, cones and cylinders, half
/// of them .6. At 1.3 the small faces of nuts have a tenth more error.
const MAX_STEP: f64 = 1.2;
/// Longer ones than this, in h, ...
const LONG_STEP: f64 = 1.0;
/// ... need no more than this share of the labels that are possible: .09 at most on marching cubes of creases, mostly
/// less than .05, but .1 to .3 on surface nets, whose samples are averages of those of a cell and may be deeper ...
const MAX_LONG_SHARE: f64 = 0.1;
/// ... and more than that only where this share of all is impossible: with small faces, .11 at least, where .19 may be
/// long. On surface nets it is .04 at most.
const MAX_IMPOSSIBLE_SHARE: f64 = 0.06;
/// Nearer labels are right in any case, in h: what is between them is too small.
const MIN_DISPLACEMENT: f64 = 0.1;
/// Fits that leave more than this, in h, may be as far off as their samples are: those of curved facets that are two
/// samples wide. At .001 and below a fandisk has 7 % more error.
const MAX_RMS: f64 = 0.003;
/// The other side has a label within so many rings ...
const RINGS: usize = 2;
/// ... of so many vertices, most of which have 18 in these ...
const MAX_VERTS: usize = 64;
/// ... and a normal at more than this angle (cosine; 11 degrees).
const SAME_SIDE_COSINE: f64 = 0.98;

/// Takes back the labels that no crease explains, so that leftovers may get a fit of their own. Lone ones stay: they
/// are beside others that have no label yet. Returns whether the samples are those of marching cubes: on others nothing
/// is taken back.
pub(super) fn take_back_impossible_labels(surface: &Surface, fits: &mut VertexFits) -> bool {
    let is_asked = |v: Vert, fit: &Fit| {
        !surface.interior[v] && fit.source == FitSource::Region && fit.rms <= MAX_RMS && is_far(fit)
    };
    let verts = fits.verts.par_iter().zip(&fits.fits);
    let asked = verts.filter_map(|(&v, fit)| Some((v, fit.as_ref().filter(|fit| is_asked(v, fit))?)));
    let step = |rings: &mut Vec<u32>, (v, fit)| Some((v, needed_step(surface, fits, v, fit, rings)?));
    let steps: Vec<(Vert, f64)> = asked.map_init(Vec::new, step).flatten().collect();
    let n_up_to = |step: f64| steps.iter().filter(|(_, needed)| *needed <= step).count();
    let (n_possible, n_short) = (n_up_to(MAX_STEP), n_up_to(LONG_STEP));
    let has_long = (n_possible - n_short) as f64 > MAX_LONG_SHARE * n_possible as f64;
    let has_small_faces = (steps.len() - n_possible) as f64 > MAX_IMPOSSIBLE_SHARE * steps.len() as f64;
    if has_long && !has_small_faces {
        return false;
    }
    let impossible: Vec<Vert> = steps.iter().filter(|(_, step)| *step > MAX_STEP).map(|(v, _)| *v).collect();
    let is_impossible = |v: Vert| impossible.binary_search(&v).is_ok();
    for &v in impossible.iter().filter(|&&v| surface.neighbours(v).any(is_impossible)) {
        fits.remove(v);
    }
    true
}

/// Whether marching cubes can have put `v` beside a crease of the side that has the fit `own`, or whether there is no
/// other side near. `rings` is working space.
pub(super) fn is_possible(
    surface: &Surface,
    fits: &VertexFits,
    v: Vert,
    own: &Fit,
    rings: &mut Vec<u32>,
) -> bool {
    !is_far(own) || needed_step(surface, fits, v, own, rings).is_none_or(|step| step <= MAX_STEP)
}

fn is_far(fit: &Fit) -> bool {
    fit.displacement.abs() >= MIN_DISPLACEMENT
}

/// The least edge of a grid, in h, that has the sample `v` if its side has the fit `own`, beside the other side that
/// needs the least; none where no other side is near.
fn needed_step(
    surface: &Surface,
    fits: &VertexFits,
    v: Vert,
    own: &Fit,
    rings: &mut Vec<u32>,
) -> Option<f64> {
    let Surface { mesh, h, near, .. } = surface;
    near.collect_rings(near.of[v], RINGS, MAX_VERTS, |_| true, rings);
    let step = |&i: &u32| {
        let (above, normal) = fits.get(near.verts[i as usize])?.evaluate(mesh.point(v), *h);
        let cosine = normal.dot(own.normal);
        // Inside is below both sides of a ridge, above those of a valley.
        let other = (-own.displacement.signum() * above).max(0.0);
        (cosine < SAME_SIDE_COSINE).then(|| least_step(own.displacement.abs(), other, cosine))
    };
    rings.iter().filter_map(step).min_by(f64::total_cmp)
}

/// The least edge of a grid that has a sample inside two sides by `u` and `v`, whose normals have this `cosine`.
fn least_step(u: f64, v: f64, cosine: f64) -> f64 {
    (u.sqrt() + v.sqrt()).powi(2) / (2.0 * (1.0 - cosine)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Mesh;
    use crate::mesh::tests::mesh;
    use crate::regions::label::tests::surface;
    use crate::regions::tests::{labels, planes};
    use FitSource::{Leftover, Region};
    use glam::{DVec3, dvec3};

    #[test]
    fn no_edge_of_a_grid_is_shorter_than_the_least_one() {
        // Edges in all directions through all points beside a crease, with their samples where their chords are zero.
        for (degrees, reached) in [(40f64, 0.95), (90.0, 0.95), (150.0, 0.75)] {
            let (n, m) = (DVec3::X, dvec3(degrees.to_radians().cos(), degrees.to_radians().sin(), 0.0));
            let mut largest = 0f64;
            for i in 0..60_000 {
                let random = |k: f64| (f64::from(i) * k).fract() - 0.5;
                let start = 2.0 * dvec3(random(0.618_034), random(0.754_878), 0.0);
                let turn = std::f64::consts::TAU * random(0.569_840);
                let along = dvec3(turn.cos(), turn.sin(), 0.0);
                let distance = |p: DVec3| p.dot(n).max(p.dot(m));
                let [from, to] = [start, start + along].map(distance);
                if from * to < 0.0 {
                    let sample = start + from / (from - to) * along;
                    let [u, v] = [n, m].map(|side| -sample.dot(side));
                    assert!(u.min(v) > -1e-12);
                    // One that lies on a side has nothing to do with the other.
                    if u.min(v) > 1e-9 {
                        largest = largest.max(least_step(u, v, n.dot(m)));
                    }
                }
            }
            assert!(largest < 1.0 + 1e-6, "{degrees}: {largest}");
            assert!(largest > reached, "{degrees}: {largest}");
        }
    }

    fn strip() -> Mesh {
        let points: Vec<_> = (0..8).map(|i| [f64::from(i / 2), f64::from(i % 2), 0.0]).collect();
        mesh(&points, &[[0, 2, 3], [0, 3, 1], [2, 4, 5], [2, 5, 3], [4, 6, 7], [4, 7, 5]])
    }

    // 1---3---5---7   The samples 2 and 3 are 0.3 below the one side, so far inside of the other one, whose label 6
    // | / | / | / |   and 7 have.
    // 0---2---4---6
    fn labels_left(inside: f64, labelled: &[usize], change: impl Fn(&mut Surface, &mut Fit)) -> usize {
        let m = strip();
        let normals = labels(&m).0;
        let mut surface = surface(&m, &normals);
        let ridge = |&v: &usize| (v, DVec3::Z, 0.3, Region);
        let mut list: Vec<_> = labelled.iter().map(ridge).collect();
        list.extend([6, 7].map(|v| (v, DVec3::X, inside - 2.0, Region)));
        let mut fits = planes(&m, &list);
        for fit in fits.fits.iter_mut().flatten() {
            match fit.normal {
                DVec3::Z => change(&mut surface, fit),
                _ => fit.rms = 2.0 * MAX_RMS, // Not asked.
            }
        }
        take_back_impossible_labels(&surface, &mut fits);
        assert!([6, 7].map(Vert::new).into_iter().all(|v| fits.get(v).is_some()));
        fits.iter().count() - 2
    }

    #[test]
    fn what_is_too_far_from_both_sides_is_part_of_neither() {
        let left = |inside: f64, labelled: &[usize]| labels_left(inside, labelled, |_, _| ());
        // Steps of 1.18 and 1.3 h.
        assert_eq!(left(0.55, &[2, 3]), 2);
        assert_eq!(left(0.65, &[2, 3]), 0);
        assert_eq!(left(-0.8, &[2, 3]), 2, "outside of the other: no ridge");
        assert_eq!(left(0.8, &[2]), 1, "a lone one stays");
        assert_eq!(left(0.8, &[0, 1]), 2, "nothing is within two rings");
    }

    #[test]
    fn only_exact_labels_of_regions_are_taken_back_if_they_are_far() {
        let left = |change: &dyn Fn(&mut Surface, &mut Fit)| labels_left(1.0, &[2, 3], change);
        assert_eq!(left(&|_, fit| fit.source = Leftover), 2);
        assert_eq!([0.0025, 0.0035].map(|rms| left(&|_, fit| fit.rms = rms)), [0, 2]);
        assert_eq!([0.11, 0.09].map(|far| left(&|_, fit| fit.displacement = far)), [0, 2]);
        let interior = |surface: &mut Surface, _: &mut Fit| {
            [2, 3].map(Vert::new).into_iter().for_each(|v| surface.interior[v] = true);
        };
        assert_eq!(left(&interior), 2);
        assert_eq!(left(&|_, _| ()), 0);
    }

    #[test]
    fn samples_that_need_long_steps_are_those_of_surface_nets() {
        let is_marching_cubes = |inside: [f64; 2]| {
            let m = strip();
            let normals = labels(&m).0;
            let surface = surface(&m, &normals);
            let [a, b] = inside.map(|inside| inside - 2.0);
            let list = [(2, DVec3::Z, 0.3, Region), (3, DVec3::Z, 0.3, Region), (6, DVec3::X, a, Leftover)];
            let list = [&list[..], &[(7, DVec3::X, b, Leftover)]].concat();
            take_back_impossible_labels(&surface, &mut planes(&m, &list))
        };
        assert!(is_marching_cubes([0.2, 0.2]));
        assert!(!is_marching_cubes([0.5, 0.5]), "steps of 1.11");
        assert!(is_marching_cubes([0.7, 0.7]), "small faces");
    }

    #[test]
    fn valleys_are_ridges_seen_from_below() {
        let valley = |inside: f64| {
            let turn = |_: &mut Surface, fit: &mut Fit| {
                (fit.displacement, fit.coefficients[0]) = (-fit.displacement, -fit.coefficients[0]);
            };
            labels_left(inside, &[2, 3], turn)
        };
        assert_eq!([-0.55, -0.65].map(valley), [2, 0]);
        assert_eq!(valley(0.65), 2);
    }
}
