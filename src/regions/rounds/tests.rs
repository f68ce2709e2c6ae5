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

/// What becomes of a strip `n` squares long that has this fate before: on a round between two sides that differ by this
/// angle and touch it where it ends, with samples at a quarter and three quarters of its arc.
fn judged_on_round(n: usize, degrees: f64, radius: f64, before: Fate) -> Fate {
    judged_among_rounds(n, degrees, radius, before, 0.0)
}

/// The same where rounds up to a radius of `max_round` are creases.
fn judged_among_rounds(n: usize, degrees: f64, radius: f64, before: Fate, max_round: f64) -> Fate {
    let angle = degrees.to_radians();
    let at = |turn: f64| radius * H * dvec3(0.0, turn.sin(), turn.cos() - 1.0);
    let rows = [0.25, 0.75].map(|share| at(share * angle));
    let m = ribbon(n, |_| rows.map(|p| [p.y, p.z]));
    let (normals, labels) = labels(&m);
    let mut surface = Surface::new(&m, &normals, &labels);
    surface.max_round = max_round;
    (surface.h, surface.interior) = (H, crate::mesh::PerVert::filled(m.n_verts(), false));
    let sides = [(DVec3::Z, DVec3::ZERO), (dvec3(0.0, angle.sin(), angle.cos()), at(angle))];
    let fit = |v: usize| {
        let (normal, on_side) = sides[v % 2];
        (v, normal, (on_side - m.point(Vert::new(v))).dot(normal) / H, Region)
    };
    let fits = planes(&m, &(0..m.n_verts()).map(fit).collect::<Vec<_>>());
    let is_across = |&h: &Half| m.from(h).index() % 2 != m.to(h).index() % 2;
    let candidates: Vec<Half> = m.edges().filter(is_across).collect();
    let (strip_of, mut strips) = judge_strips(&surface, &fits, &candidates, 0.0);
    strips[0].fate = before;
    judge_by_radius(&surface, &fits, &candidates, &strip_of, &mut strips, 0.0);
    strips[0].fate
}

#[test]
fn where_sides_are_less_than_a_right_angle_apart_rounds_may_be_larger() {
    let kept =
        |degrees: f64, radius: f64| judged_on_round(20, degrees, radius, Fate::FarFromFits) == Fate::Kept;
    assert_eq!([0.75, 0.85].map(|radius| kept(90.0, radius)), [true, false]);
    // tan(22.5 degrees) is .414.
    assert_eq!([1.75, 2.05].map(|radius| kept(45.0, radius)), [true, false]);
    // Acute edges are judged by the radius itself.
    assert_eq!([0.75, 0.85].map(|radius| kept(120.0, radius)), [true, false]);
}

#[test]
fn a_strip_without_samples_near_its_crease_is_a_round() {
    // They are tan(22.5 degrees) of the radius from it, as far as the round begins: .54 and .60 h.
    let fates = |n: usize| [1.3, 1.45].map(|radius| judged_on_round(n, 45.0, radius, Fate::Kept));
    assert_eq!(fates(20), [Fate::Kept, Fate::Round]);
    assert_eq!(fates(2), [Fate::Kept, Fate::Round]);
    assert_eq!(fates(1), [Fate::Kept; 2], "three edges");
    // .87 and .95 h, where the sides make 60 degrees.
    let fates = [1.51, 1.65].map(|radius| judged_on_round(2, 60.0, radius, Fate::Kept));
    assert_eq!(fates, [Fate::Kept, Fate::Round]);
}

#[test]
fn rounds_up_to_the_radius_asked_for_are_creases() {
    let fate =
        |degrees: f64, radius: f64, before: Fate| judged_among_rounds(20, degrees, radius, before, 1.5);
    for before in [Fate::FarFromFits, Fate::Round, Fate::Kept] {
        let left = if before == Fate::FarFromFits { Fate::FarFromFits } else { Fate::Round };
        assert_eq!([1.45, 1.55].map(|radius| fate(90.0, radius, before)), [Fate::Kept, left]);
        // tan(22.5 degrees) is .414.
        assert_eq!([3.5, 3.75].map(|radius| fate(45.0, radius, before)), [Fate::Kept, left]);
    }
    assert_eq!(fate(90.0, 1.0, Fate::PoorFits), Fate::PoorFits, "what is no surface is no crease");
    assert_eq!(judged_among_rounds(1, 90.0, 1.0, Fate::Round, 1.5), Fate::Kept, "short ones as well");
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
    let uneven = |from: f64, by: f64| move |t: f64| on_round(0.7 + by * t, from)(t);
    let fate = |by: f64| judged_along(uneven(0.0, by), uneven(45.0, by), kept).fate;
    assert_eq!([0.004, 0.008].map(fate), [Fate::Round, Fate::Kept]);
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
    assert!(!says(&|strip| strip.n_edges = SHORT_NET_STRIP - 1, 0.005));
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
    let h =
        m.half_between(Vert::new(0), Vert::new(1)).or(m.half_between(Vert::new(1), Vert::new(0))).unwrap();
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
    // Nor is it a round where they are all but equally deep, between 30 and 36 degrees from its ends.
    let level = |from: f64, to: f64| {
        move |t: f64| {
            let (sine, cosine) = (from + (to - from) * t).to_radians().sin_cos();
            [0.7 * H * (sine - 1.0), 0.7 * H * (cosine - 1.0)]
        }
    };
    assert_eq!(judged_along(level(30.0, 36.0), level(60.0, 54.0), kept).fate, Fate::Kept);
    assert_eq!(judged_along(level(0.0, 45.0), level(90.0, 45.0), kept).fate, Fate::Round);
}

#[test]
fn strips_with_some_samples_next_to_the_crease_are_those_of_surface_nets() {
    let fate = |nearest: f64, farthest: f64, change: &dyn Fn(&mut Strip)| {
        let away = move |t: f64| (nearest + (farthest - nearest) * t) * H;
        let change = |strip: &mut Strip| {
            strip.fate = Fate::FarFromFits;
            change(strip);
        };
        judged_along(|t| [-away(t), -0.05 * H], |t| [-0.05 * H, -away(t)], change).fate
    };
    // Radii of .25 to 1.7, half of them less than 1.05.
    assert_eq!(fate(0.1, 1.3, &|_| ()), Fate::Kept);
    assert_eq!(fate(0.1, 1.3, &|strip| strip.n_edges = 5), Fate::Kept);
    assert_eq!(fate(0.1, 1.3, &|strip| strip.n_edges = 4), Fate::FarFromFits);
    assert_eq!(fate(0.1, 1.3, &|strip| strip.rms = 0.011), Fate::FarFromFits, "no exact sides");
    assert_eq!(fate(0.45, 1.3, &|_| ()), Fate::FarFromFits, "no sample next to the crease");
    assert_eq!(fate(0.1, 1.8, &|_| ()), Fate::FarFromFits, "half of them far from it");
}
