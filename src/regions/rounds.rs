//! Tells creases from rounds by the radius that a round would have.
//!
//! ```text
//!   -----T___            N, M  the fits of both sides
//!        |   `-P         P     a sample u inside N and v inside M
//!        |      \        r     radius of the round through P that touches both, in T
//!        C---r---T
//!                |       (1 - c) r = u + v + sqrt(2 u v (1 + c)),  c = N·M
//! ```
//!
//! Where the normals are less than a right angle apart the round begins nearer to the crease than its radius, at
//! r tan(angle / 2), and takes less away: this counts instead of the radius then (without, a box with bevels of 45
//! degrees on a grid along the axes came back as it was).
//!
//! Every sample beside a round of radius R has an r of R or more: of R on the round, of more beyond it. So what most
//! samples of a strip have is the largest radius that a round there could have. Marching cubes of the distance to a
//! sharp edge puts samples inside of it, which then look like those of a round, but of a small one: on a grid of
//! step s along two planes at a right angle the samples nearest to the edge are p from it on one side and q > p on the
//! other; those at p come q - p / (p + s - q) inside, which no round with a radius of more than 0.86 s does.
//!
//! Based on: nothing in the papers. Grids along the axes put all samples of an edge equally far inside, up to 0.35 h,
//! and the means that [`gates`](super::gates) judge by take that for a round: an L-bracket and a cone on such a grid
//! came back as they were.
//! In/out: strips that were left alone for what a round has -> which of them are kept after all; and
//! strips that were kept, but lie on a round.
//! Cost: O(edges of these).

use glam::DVec3;

use super::gates::{CLEAN_NOISE, Fate, LONG_STRIP, ROUND_DISPLACEMENT, ROUND_GUESSED, STRIP_RMS, Strip};
use super::{Surface, VertexFits};
use crate::fit::{Fit, FitSource};
use crate::mesh::{Half, Vert};

/// A strip is no round if half of its samples allow no larger radius than this, in h, at right angles. Creases on
/// marching cubes have .3 to .8 there, rounds a little more than their radius. To sharpen these pays up to a radius of
/// .65 h and harms from .68 h. At .85 with the radius that a quarter allows, two more rims of coarse cylinders are
/// recovered and two boxes with rounds of .75 h get half as much error again.
const LARGEST_RADIUS: f64 = 0.8;
/// Nor is it one if a tenth allow no more than this, as no sample of a round has less than its radius: rims of holes on
/// grids along the axes have samples of all depths. Boxes with rounds of .68 h and more have .68 and more there ...
const SURE_RADIUS: f64 = 0.65;
/// ... and half of them no more than this: pipes 3 h thick have false edges all round, with 2.3 h, and thin faces beside
/// a nut's chamfers, which become spikes, 1.1.
const LARGEST_SPREAD_RADIUS: f64 = 0.9;

/// Up to that radius it is none either if half of its samples are no deeper than this, in h: of the two samples of an
/// edge across a crease the farther one is on its side. Rims on grids along the axes have .01 to .04 there, boxes with
/// rounds of .8 h on marching cubes .06 and more ...
const ON_SIDE: f64 = 0.045;
/// ... and if the tenth and the half of their radii differ by this, in h: on rounds that are sampled exactly they do
/// not, on those rims by .028 to .11 ...
const OTHER_RADIUS: f64 = 0.015;
/// ... and if its sides are curved, which leaves this residual at least, in h: planes leave less than .0003 even
/// on marching cubes, and a box with rounds of .73 h whose planes a grid happens to meet got a quarter more error.
const RIM_RMS: f64 = 1e-3;

/// Residuals up to this, in h, are those of small holes, where the noise of the mesh is less than [`CLEAN_NOISE`].
const CURVED_RMS: f64 = 0.025;

/// Samples that lie on a round exactly have its radius all alike: the fiftieth and the half of all differ by .001 h at
/// most on rounds by marching intersections, remeshing and scanning, by .008 and more beside creases (the least of these
/// is the rim of a slot, most of whose samples are equally deep along its straight parts) ...
const SAME_RADIUS: f64 = 0.003;
/// ... but for grids along straight creases, where they are all equally deep. On a round of radius .7 h the deepest
/// tenth, quarter and half are .05 h apart.
const OTHER_DEPTH: f64 = 0.02;

/// Keeps those of `strips` after all that were left alone because their samples are inside of their fits, but are
/// creases by the radius that a round would have there: long ones, between fits that are exact. Leaves alone those that
/// are kept though all samples lie on one round. `noise` is the median residual, in h.
pub(super) fn judge_by_radius(
    surface: &Surface,
    fits: &VertexFits,
    candidates: &[Half],
    strip_of: &[u32],
    strips: &mut [Strip],
    noise: f64,
) {
    let is_asked = |strip: &Strip| has_a_say(strip, noise).then(Vec::new);
    let mut samples: Vec<Option<Vec<Inside>>> = strips.iter().map(is_asked).collect();
    for (&h, &strip) in candidates.iter().zip(strip_of) {
        if let Some(samples) = &mut samples[strip as usize] {
            samples.extend(samples_at(surface, fits, h));
        }
    }
    for (strip, samples) in strips.iter_mut().zip(samples) {
        let Some(samples) = samples.filter(|samples| !samples.is_empty()) else { continue };
        let values = |of: fn(&Inside) -> f64| samples.iter().map(of).collect::<Vec<f64>>();
        let mut radii = values(|sample| sample.radius);
        let mut reaches = values(|sample| sample.reach);
        let mut depths = values(|sample| sample.depth);
        let (tenth, half) = (quantile(&mut reaches, 0.1), quantile(&mut reaches, 0.5));
        let is_exact = strip.rms <= STRIP_RMS;
        let largest = if is_exact { LARGEST_SPREAD_RADIUS } else { LARGEST_RADIUS };
        let depths = [0.5, 0.75, 0.9].map(|share| quantile(&mut depths, share));
        let is_on_round = quantile(&mut radii, 0.5) - quantile(&mut radii, 0.02) < SAME_RADIUS
            && depths.windows(2).all(|d| d[1] - d[0] > OTHER_DEPTH);
        let is_rim = strip.rms > RIM_RMS
            && half <= LARGEST_SPREAD_RADIUS
            && half - tenth > OTHER_RADIUS
            && depths[0] < ON_SIDE;
        if is_on_round && tenth > SURE_RADIUS {
            strip.fate = Fate::Round;
        } else if half <= largest && (tenth <= SURE_RADIUS || is_exact && half <= LARGEST_RADIUS) || is_rim {
            strip.fate = Fate::Kept;
        }
    }
}

/// Whether the radius has a say about `strip`.
fn has_a_say(strip: &Strip, noise: f64) -> bool {
    let is_far_inside = match strip.fate {
        Fate::Round | Fate::FarFromFits => true,
        Fate::Kept => strip.inward > ROUND_DISPLACEMENT,
        _ => false,
    };
    let max_rms = if noise < CLEAN_NOISE { CURVED_RMS } else { STRIP_RMS };
    is_far_inside && strip.n_edges >= LONG_STRIP && strip.rms <= max_rms && strip.guessed < ROUND_GUESSED
}

/// What this share of `values` does not exceed.
fn quantile(values: &mut [f64], share: f64) -> f64 {
    let place = (share * values.len() as f64) as usize;
    *values.select_nth_unstable_by(place, f64::total_cmp).1
}

/// A sample beside a strip, in h.
struct Inside {
    /// How far it is off the fit of its own side ...
    depth: f64,
    /// ... the radius of the round through it ...
    radius: f64,
    /// ... and how far from the crease that begins, or its radius if this is less.
    reach: f64,
}

/// Those ends of the edge of `h` that a region explains.
fn samples_at(surface: &Surface, fits: &VertexFits, h: Half) -> impl Iterator<Item = Inside> {
    let mesh = surface.mesh;
    let ends = [mesh.from(h), mesh.to(h)];
    let [p, q] = ends.map(|v| fits.get(v));
    let along = mesh.point(ends[1]) - mesh.point(ends[0]);
    let sample = move |(v, along, own, other): (Vert, DVec3, Option<&Fit>, Option<&Fit>)| {
        let own = own.filter(|own| own.source == FitSource::Region && !surface.interior[v])?;
        let other = other?;
        let (above, normal) = other.evaluate(mesh.point(v), surface.h);
        // Inside is below both sides of a ridge, above those of a valley.
        let sign = (along.dot(normal) - along.dot(own.normal)).signum();
        let cosine = own.normal.dot(normal);
        let radius = round_through(sign * own.displacement, -sign * above, cosine);
        let reach = radius * half_tangent(cosine).min(1.0);
        radius.is_finite().then_some(Inside { depth: own.displacement.abs(), radius, reach })
    };
    [(ends[0], along, p, q), (ends[1], -along, q, p)].into_iter().filter_map(sample)
}

/// The radius of the round through a point `u` and `v` inside of two planes whose normals have this cosine.
fn round_through(u: f64, v: f64, cosine: f64) -> f64 {
    let (u, v) = (u.max(0.0), v.max(0.0));
    (u + v + (2.0 * u * v * (1.0 + cosine)).max(0.0).sqrt()) / (1.0 - cosine)
}

/// The tangent of half of the angle that has this cosine.
fn half_tangent(cosine: f64) -> f64 {
    ((1.0 - cosine) / (1.0 + cosine)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Mesh;
    use crate::mesh::tests::mesh;
    use crate::regions::gates::judge_strips;
    use crate::regions::tests::{labels, planes};
    use FitSource::{Leftover, Region};
    use approx::assert_relative_eq;
    use glam::dvec3;

    #[test]
    fn the_radius_is_that_of_the_round_a_point_lies_on() {
        // Two planes with their normals 60, 90 and 130 degrees apart, and points on the round of radius 2.
        for angle in [60f64, 90.0, 130.0].map(f64::to_radians) {
            let (n, m) = (DVec3::X, dvec3(angle.cos(), angle.sin(), 0.0));
            // The centre is 2 inside of both.
            let centre = -2.0 * (n + m) / (1.0 + angle.cos());
            for turn in [0.0, 0.3, 0.5, 0.9, 1.0].map(|share| share * angle) {
                let p = centre + 2.0 * dvec3(turn.cos(), turn.sin(), 0.0);
                let radius = round_through(-p.dot(n), -p.dot(m), n.dot(m));
                assert_relative_eq!(radius, 2.0, epsilon = 1e-6);
            }
        }
        // On one plane, where the round would end; and a little outside of it.
        assert_eq!(round_through(0.0, 0.7, 0.0), 0.7);
        assert_eq!(round_through(-0.01, 0.7, 0.0), 0.7);
    }

    /// The step of the grid; a flat face of marching cubes along it has two edges of one step and a diagonal.
    const STEP: f64 = 1.0;
    const H: f64 = (2.0 + std::f64::consts::SQRT_2) / 3.0 * STEP;

    /// A row of `n` squares along x, with two vertices at each step that are at (y, z) = `row`.
    fn ribbon(n: usize, row: impl Fn(usize) -> [[f64; 2]; 2]) -> Mesh {
        let points: Vec<[f64; 3]> = (0..=n).flat_map(|i| row(i).map(|[y, z]| [i as f64, y, z])).collect();
        let square = |i: usize| [[2 * i, 2 * i + 2, 2 * i + 3], [2 * i, 2 * i + 3, 2 * i + 1]];
        mesh(&points, &(0..n).flat_map(square).collect::<Vec<_>>())
    }

    /// A ridge along x, `n` squares long, between one side that faces up and one that faces +y, or the valley between
    /// the two seen from below. One row of squares cuts it off: the samples of the first side are at (y, z) = `first`,
    /// those of the second at `second`.
    fn judged(n: usize, first: [f64; 2], second: [f64; 2], up: f64, change: impl Fn(&mut Fit)) -> Strip {
        let m = ribbon(n, |_| [first, second]);
        let (normals, labels) = labels(&m);
        let mut surface = Surface::new(&m, &normals, &labels);
        (surface.h, surface.interior) = (H, crate::mesh::PerVert::filled(m.n_verts(), false));
        let (above, beside) = (-up * first[1] / H, -up * second[0] / H);
        let fits = |i| [(2 * i, up * DVec3::Z, above, Region), (2 * i + 1, up * DVec3::Y, beside, Region)];
        let mut fits = planes(&m, &(0..=n).flat_map(fits).collect::<Vec<_>>());
        fits.fits.iter_mut().flatten().for_each(change);
        let is_across = |&h: &Half| m.from(h).index() % 2 != m.to(h).index() % 2;
        let candidates: Vec<Half> = m.edges().filter(is_across).collect();
        let (_, mut strips) = judge_strips(&surface, &fits, &candidates, 0.0);
        assert_eq!((strips.len(), strips[0].n_edges), (1, 2 * n + 1));
        strips.remove(0)
    }

    #[test]
    fn what_marching_cubes_makes_of_an_edge_along_the_grid_is_a_crease() {
        // The samples at p = 0.2 are 0.8 - 0.2 / 0.4 inside, those at q = 0.8 on their plane.
        let (first, second) = ([-0.2, -0.3], [0.0, -0.8]);
        for up in [1.0, -1.0] {
            let strip = judged(15, first, second, up, |_| ());
            assert!(strip.inward > 0.1 && strip.displacement > 0.1, "looks like a round by these");
            assert_eq!(strip.fate, Fate::Kept);
        }
        let fate = |n, change: &dyn Fn(&mut Fit)| judged(n, first, second, 1.0, change).fate;
        assert_eq!(fate(14, &|_| ()), Fate::FarFromFits, "29 edges are not enough");
        assert_eq!(fate(15, &|fit| fit.rms = 0.011), Fate::FarFromFits, "nor are fits that are not exact");
        let guess = |fit: &mut Fit| fit.source = if fit.normal == DVec3::Y { Leftover } else { Region };
        assert_eq!(fate(15, &guess), Fate::FarFromFits, "nor guesses");
    }

    #[test]
    fn a_round_stays_one() {
        let on_round = |radius: f64, turn: f64| {
            let (sine, cosine) = turn.to_radians().sin_cos();
            [radius * (sine - 1.0), radius * (cosine - 1.0)]
        };
        let fate = |radius: f64| judged(20, on_round(radius, 25.0), on_round(radius, 65.0), 1.0, |_| ()).fate;
        assert_eq!(fate(0.85 * H), Fate::FarFromFits);
        assert_eq!(fate(1.2 * H), Fate::FarFromFits);
        // A smaller one is as good as sharp.
        assert_eq!(fate(0.75 * H), Fate::Kept);
    }

    #[test]
    fn where_sides_are_less_than_a_right_angle_apart_rounds_may_be_larger() {
        let kept = |degrees: f64, radius: f64| {
            let angle = degrees.to_radians();
            let at = |turn: f64| radius * H * dvec3(0.0, turn.sin(), turn.cos() - 1.0);
            let rows = [0.25, 0.75].map(|share| at(share * angle));
            let m = ribbon(20, |_| rows.map(|p| [p.y, p.z]));
            let (normals, labels) = labels(&m);
            let mut surface = Surface::new(&m, &normals, &labels);
            (surface.h, surface.interior) = (H, crate::mesh::PerVert::filled(m.n_verts(), false));
            // Both sides touch the round where it ends.
            let sides = [(DVec3::Z, DVec3::ZERO), (dvec3(0.0, angle.sin(), angle.cos()), at(angle))];
            let fit = |v: usize| {
                let (normal, on_side) = sides[v % 2];
                (v, normal, (on_side - m.point(Vert::new(v))).dot(normal) / H, Region)
            };
            let fits = planes(&m, &(0..m.n_verts()).map(fit).collect::<Vec<_>>());
            let is_across = |&h: &Half| m.from(h).index() % 2 != m.to(h).index() % 2;
            let candidates: Vec<Half> = m.edges().filter(is_across).collect();
            let (strip_of, mut strips) = judge_strips(&surface, &fits, &candidates, 0.0);
            strips[0].fate = Fate::FarFromFits;
            judge_by_radius(&surface, &fits, &candidates, &strip_of, &mut strips, 0.0);
            strips[0].fate == Fate::Kept
        };
        assert_eq!([0.75, 0.85].map(|radius| kept(90.0, radius)), [true, false]);
        // tan(22.5 degrees) is .414.
        assert_eq!([1.75, 2.05].map(|radius| kept(45.0, radius)), [true, false]);
        // Acute edges are judged by the radius itself.
        assert_eq!([0.75, 0.85].map(|radius| kept(120.0, radius)), [true, false]);
    }

    /// One sample a row and side instead, at what `first` and `second` make of its place from 0 to 1.
    fn judged_along(
        first: impl Fn(f64) -> [f64; 2],
        second: impl Fn(f64) -> [f64; 2],
        change: impl Fn(&mut Strip),
    ) -> Strip {
        let n = 30;
        let share = |i: usize| (7 * i % 30) as f64 / 30.0;
        let m = ribbon(n, |i| [first(share(i)), second(share(i))]);
        let (normals, labels) = labels(&m);
        let mut surface = Surface::new(&m, &normals, &labels);
        (surface.h, surface.interior) = (H, crate::mesh::PerVert::filled(m.n_verts(), false));
        let fit = |v: usize| {
            let axis = if v.is_multiple_of(2) { DVec3::Z } else { DVec3::Y };
            (v, axis, -m.point(Vert::new(v)).dot(axis) / H, Region)
        };
        let fits = planes(&m, &(0..m.n_verts()).map(fit).collect::<Vec<_>>());
        let is_across = |&h: &Half| m.from(h).index() % 2 != m.to(h).index() % 2;
        let candidates: Vec<Half> = m.edges().filter(is_across).collect();
        let (strip_of, mut strips) = judge_strips(&surface, &fits, &candidates, 0.0);
        change(&mut strips[0]);
        judge_by_radius(&surface, &fits, &candidates, &strip_of, &mut strips, 0.0);
        strips.remove(0)
    }

    #[test]
    fn samples_of_all_depths_are_those_of_a_crease() {
        // Half of the samples allow a radius of 0.84 h, some next to none.
        let first = |t: f64| [-0.8 * t * H, -0.15 * H];
        let second = |t: f64| [-0.1 * H, -0.8 * (1.0 - t) * H];
        let fate = |change: &dyn Fn(&mut Strip)| judged_along(first, second, change).fate;
        assert_eq!(fate(&|strip| strip.fate = Fate::Round), Fate::Kept);
        let curved = |rms: f64| fate(&|strip| (strip.rms, strip.fate) = (rms, Fate::Round));
        assert_eq!(curved(0.02), Fate::Round, "half of them would have to be closer");
        // Where most allow any radius there is more than a crease.
        let wide = |t: f64| [-2.0 * t * H, -0.15 * H];
        let strip = judged_along(wide, |t| [-0.1 * H, -2.0 * t * H], |strip| strip.fate = Fate::Round);
        assert_eq!(strip.fate, Fate::Round);
    }

    #[test]
    fn samples_that_lie_on_one_round_are_left_alone_though_the_gates_let_them_pass() {
        let on_round = |radius: f64, from: f64| {
            move |t: f64| {
                let (sine, cosine) = (from + 45.0 * t).to_radians().sin_cos();
                [radius * H * (sine - 1.0), radius * H * (cosine - 1.0)]
            }
        };
        let kept = |strip: &mut Strip| (strip.inward, strip.fate) = (0.05, Fate::Kept);
        let fate = |radius: f64| judged_along(on_round(radius, 0.0), on_round(radius, 45.0), kept).fate;
        assert_eq!(fate(0.7), Fate::Round);
        assert_eq!(fate(0.6), Fate::Kept, "as good as sharp");
        // The same radius at one depth only is that of a grid.
        let level = |radius: f64| {
            let at = |turn: f64| move |_: f64| on_round(radius, turn)(0.0);
            judged_along(at(25.0), at(65.0), kept).fate
        };
        assert_eq!(level(0.7), Fate::Kept);
        // Nor has a round samples that are inside of it, few as they are.
        let dented = |from: f64| move |t: f64| on_round(if t == 0.5 { 0.6 } else { 0.7 }, from)(t);
        assert_eq!(judged_along(dented(0.0), dented(45.0), kept).fate, Fate::Kept);
    }

    #[test]
    fn curved_strips_with_half_of_their_samples_on_their_sides_are_rims() {
        let fate = |nearest: f64, spread: f64, depth: f64, rms: f64| {
            let away = move |t: f64| (nearest + spread * t) * H;
            let change = |strip: &mut Strip| (strip.rms, strip.fate) = (rms, Fate::FarFromFits);
            judged_along(|t| [-away(t), -depth * H], |t| [-depth * H, -away(t)], change).fate
        };
        assert_eq!(fate(0.74, 0.2, 0.0, 0.002), Fate::Kept);
        assert_eq!(fate(0.74, 0.2, 0.0, 0.012), Fate::Kept, "a small hole");
        assert_eq!(fate(0.74, 0.2, 0.0, 0.0005), Fate::FarFromFits, "between planes");
        assert_eq!(fate(0.82, 0.02, 0.0, 0.002), Fate::FarFromFits, "one radius is that of a round");
        assert_eq!(fate(0.86, 0.2, 0.0, 0.002), Fate::FarFromFits, "too large a radius");
        // Radii of .72 to .94, but all samples are deep.
        assert_eq!(fate(0.45, 0.2, 0.05, 0.002), Fate::FarFromFits);
    }

    #[test]
    fn long_strips_that_are_off_their_fits_are_asked() {
        let says = |change: &dyn Fn(&mut Strip), noise: f64| {
            let mut strip = judged(20, [-0.2, -0.3], [0.0, -0.8], 1.0, |_| ());
            strip.fate = Fate::Round;
            change(&mut strip);
            has_a_say(&strip, noise)
        };
        assert!(says(&|_| (), 0.005));
        assert!(!says(&|strip| strip.n_edges = LONG_STRIP - 1, 0.005));
        assert!(!says(&|strip| strip.guessed = ROUND_GUESSED, 0.005));
        assert!(!says(&|strip| strip.fate = Fate::PoorFits, 0.005));
        let kept = |inward: f64| says(&|strip| (strip.fate, strip.inward) = (Fate::Kept, inward), 0.005);
        assert_eq!([0.9, 1.1].map(|times| kept(times * ROUND_DISPLACEMENT)), [false, true]);
        // Small holes have larger residuals, and so has noise.
        let residual = |rms: f64, noise: f64| says(&|strip| strip.rms = rms, noise);
        assert_eq!([0.009, 0.011, 0.024, 0.026].map(|rms| residual(rms, 0.005)), [true, true, true, false]);
        assert_eq!([0.009, 0.011].map(|rms| residual(rms, 0.02)), [true, false]);
    }

    #[test]
    fn samples_are_the_doubtful_ends_that_a_region_explains() {
        let m = ribbon(1, |_| [[-0.2, -0.3], [0.0, -0.8]]);
        let (normals, labels) = labels(&m);
        let h = m
            .half_between(Vert::new(0), Vert::new(1))
            .or(m.half_between(Vert::new(1), Vert::new(0)))
            .unwrap();
        let samples = |is_interior: bool, sources: [FitSource; 2]| {
            let mut surface = Surface::new(&m, &normals, &labels);
            surface.h = 1.0;
            surface.interior = crate::mesh::PerVert::filled(m.n_verts(), false);
            surface.interior[Vert::new(0)] = is_interior;
            let list = [(0, DVec3::Z, 0.3, sources[0]), (1, DVec3::Y, 0.0, sources[1])];
            samples_at(&surface, &planes(&m, &list), h).map(|sample| sample.depth).collect::<Vec<_>>()
        };
        assert_eq!(samples(false, [Region, Region]).len(), 2);
        assert_eq!(samples(true, [Region, Region]), [0.0]);
        assert_eq!(samples(false, [Leftover, Region]), [0.0]);
        assert_eq!(samples(false, [Region, Leftover]), [0.3]);
    }

    #[test]
    fn samples_of_a_round_are_at_more_depths_than_two() {
        // On one round of radius 0.7, three of five 20 degrees from where it ends, the others halfway.
        let at = |t: f64, near: f64| {
            let (sine, cosine) = if t < 0.6 { near } else { 45.0 }.to_radians().sin_cos();
            [0.7 * H * (sine - 1.0), 0.7 * H * (cosine - 1.0)]
        };
        let kept = |strip: &mut Strip| (strip.inward, strip.fate) = (0.05, Fate::Kept);
        assert_eq!(judged_along(|t| at(t, 20.0), |t| at(t, 70.0), kept).fate, Fate::Kept);
    }
}
