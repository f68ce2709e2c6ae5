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

#[cfg(test)]
mod tests;

use glam::DVec3;
use rayon::prelude::*;

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

/// If a fiftieth allow no more than this it is none either: on surface nets, whose samples are averages of those of a
/// cell, .2 to .6 do, on marching cubes of rounds that half of them say are larger than .9 h .64 and more ...
const SURE_NET_RADIUS: f64 = 0.6;
/// ... and half of them no more than this: 1.18 at most on surface nets.
const LARGEST_NET_RADIUS: f64 = 1.2;
/// Strips of fewer edges are not asked.
const SHORT_NET_STRIP: usize = 5;

/// Residuals up to this, in h, are those of small holes, where the noise of the mesh is less than [`CLEAN_NOISE`].
const CURVED_RMS: f64 = 0.025;

/// Samples that lie on a round exactly have its radius all alike: the fiftieth and the half of all differ by .001 h at
/// most on rounds by marching intersections, remeshing and scanning, by .008 and more beside creases (the least of these
/// is the rim of a slot, most of whose samples are equally deep along its straight parts) ...
const SAME_RADIUS: f64 = 0.003;
/// ... but for grids along straight creases, where they are all equally deep. On a round of radius .7 h the deepest
/// tenth, quarter and half are .05 h apart.
const OTHER_DEPTH: f64 = 0.02;

/// Beside a crease some samples are near it. A strip of which nine tenths are farther than this, in h, is part of a round:
/// of the creases that 1,100 meshes keep none has more than .83, on a grid with steps of 1 and 2 one has .88.
const AWAY: f64 = 0.9;
/// Where normals differ by less than this (cosine; 55 degrees) less is enough, as rounds of a right angle with a row along
/// their middle that passes for a side get two false creases of 45 degrees ...
const OBTUSE_COSINE: f64 = 0.573_576_436_351_046;
/// ... whose samples have .6 to 1.2 there, those of 310 true ones .54 at most (of 59 degrees: .68). Boxes with rounds of
/// 1.5 to 3 h had up to 1.4 times the input's L2 and five times its largest error by them.
const AWAY_FROM_OBTUSE: f64 = 0.57;
/// Strips of fewer edges have too few samples for that: one of a fandisk's corners would be lost.
const SHORT_AWAY_STRIP: usize = 4;

/// Keeps those of `strips` after all that were left alone because their samples are inside of their fits, but are
/// creases by the radius that a round would have there: long ones, between fits that are exact. Leaves alone those that
/// are kept though all samples lie on one round, or are away from it. `noise` is the median residual, in h.
pub(super) fn judge_by_radius(
    surface: &Surface,
    fits: &VertexFits,
    candidates: &[Half],
    strip_of: &[u32],
    strips: &mut [Strip],
    noise: f64,
) {
    let is_asked =
        |strip: &Strip| surface.has_rounds() || strip.fate == Fate::Kept || has_a_say(strip, noise);
    let asked = candidates.par_iter().zip(strip_of).filter(|(_, strip)| is_asked(&strips[**strip as usize]));
    let found =
        asked.flat_map_iter(|(&h, &strip)| samples_at(surface, fits, h).map(move |found| (strip, found)));
    let mut samples: Vec<Vec<Inside>> = strips.iter().map(|_| Vec::new()).collect();
    for (strip, found) in found.collect::<Vec<_>>() {
        samples[strip as usize].push(found);
    }
    for (strip, samples) in strips.iter_mut().zip(samples) {
        if samples.is_empty() {
            continue;
        }
        if surface.has_rounds() {
            strip.fate = fate_among_rounds(strip, &samples, surface.max_round);
        } else if strip.fate == Fate::Kept && is_away(strip, &samples) {
            strip.fate = Fate::Round;
        } else if has_a_say(strip, noise)
            && let Some(fate) = fate_by(strip, &samples)
        {
            strip.fate = fate;
        }
    }
}

/// What becomes of `strip` if rounds up to the radius `max_round` are creases.
fn fate_among_rounds(strip: &Strip, samples: &[Inside], max_round: f64) -> Fate {
    let [half] = quantiles(samples, |sample| sample.reach, [0.5]);
    match strip.fate {
        Fate::Round | Fate::FarFromFits | Fate::Kept if half <= max_round => Fate::Kept,
        Fate::Kept => Fate::Round,
        fate => fate,
    }
}

/// Whether all samples of `strip` are away from its crease.
fn is_away(strip: &Strip, samples: &[Inside]) -> bool {
    let cosine = samples.iter().map(|sample| sample.cosine).sum::<f64>() / samples.len() as f64;
    let away = if cosine > OBTUSE_COSINE { AWAY_FROM_OBTUSE } else { AWAY };
    let [tenth] = quantiles(samples, |sample| sample.reach, [0.1]);
    strip.n_edges >= SHORT_AWAY_STRIP && tenth > away
}

/// What the radii at the samples of `strip` make of it, if they say anything.
fn fate_by(strip: &Strip, samples: &[Inside]) -> Option<Fate> {
    let [fiftieth, tenth, half] = quantiles(samples, |sample| sample.reach, [0.02, 0.1, 0.5]);
    let is_exact = strip.rms <= STRIP_RMS;
    if is_exact && fiftieth <= SURE_NET_RADIUS && half <= LARGEST_NET_RADIUS {
        return Some(Fate::Kept);
    }
    if strip.n_edges < LONG_STRIP {
        return None;
    }
    let [least_radius, radius] = quantiles(samples, |sample| sample.radius, [0.02, 0.5]);
    let depths = quantiles(samples, |sample| sample.depth, [0.5, 0.75, 0.9]);
    let is_on_round =
        radius - least_radius < SAME_RADIUS && depths.windows(2).all(|d| d[1] - d[0] > OTHER_DEPTH);
    if is_on_round && tenth > SURE_RADIUS {
        return Some(Fate::Round);
    }
    let largest = if is_exact { LARGEST_SPREAD_RADIUS } else { LARGEST_RADIUS };
    let is_crease = half <= largest && (tenth <= SURE_RADIUS || is_exact && half <= LARGEST_RADIUS);
    let is_rim = strip.rms > RIM_RMS
        && half <= LARGEST_SPREAD_RADIUS
        && half - tenth > OTHER_RADIUS
        && depths[0] < ON_SIDE;
    (is_crease || is_rim).then_some(Fate::Kept)
}

/// Whether the radius has a say about `strip`.
fn has_a_say(strip: &Strip, noise: f64) -> bool {
    let is_far_inside = match strip.fate {
        Fate::Round | Fate::FarFromFits => true,
        Fate::Kept => strip.inward > ROUND_DISPLACEMENT,
        _ => false,
    };
    let max_rms = if noise < CLEAN_NOISE { CURVED_RMS } else { STRIP_RMS };
    is_far_inside && strip.n_edges >= SHORT_NET_STRIP && strip.rms <= max_rms && strip.guessed < ROUND_GUESSED
}

/// What these shares of the values of `samples` do not exceed.
fn quantiles<const N: usize>(samples: &[Inside], value: fn(&Inside) -> f64, shares: [f64; N]) -> [f64; N] {
    let mut values: Vec<f64> = samples.iter().map(value).collect();
    shares.map(|share| {
        let place = (share * values.len() as f64) as usize;
        *values.select_nth_unstable_by(place, f64::total_cmp).1
    })
}

/// A sample beside a strip, in h.
struct Inside {
    /// How far it is off the fit of its own side ...
    depth: f64,
    /// ... the radius of the round through it ...
    radius: f64,
    /// ... and how far from the crease that begins, or its radius if this is less.
    reach: f64,
    /// The cosine of the angle between both sides' normals.
    cosine: f64,
}

/// Those ends of the edge of `h` that a region explains.
fn samples_at(surface: &Surface, fits: &VertexFits, h: Half) -> impl Iterator<Item = Inside> {
    let mesh = surface.mesh;
    let ends = mesh.ends(h);
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
        radius.is_finite().then_some(Inside { depth: own.displacement.abs(), radius, reach, cosine })
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
