//! Which chamfers to believe (steps 8, 8b and 9): do no harm.
//!
//! ```text
//!     b---b---b              b---b        Edges that share a triangle make a strip. It stands or falls as one:
//!    / \ / \ / \     ...    / \ / \       single edges are too noisy to judge, and half a strip would end in a
//!   b---b---b---b          b---b---b      spike.
//! ```
//!
//! Based on: nothing in the papers, which believe every blue edge.
//! In/out: the fits and the candidate edges -> strips with a fate each, the strip of each candidate, the noise of the
//! samples, and whether they are off the surface.
//! Cost: O(candidates), serial, and a selection among the fits for their median.

#[cfg(test)]
mod tests;

use rayon::prelude::*;
use serde::Serialize;

use super::{Surface, VertexFits, rounds};
use crate::fit::{Fit, FitSource};
use crate::mesh::{Half, Mesh, Vert};

/// A region fit counts towards the noise, or as a witness of the surface, with this many samples.
const WITNESS_MEMBERS: usize = 6;

/// The ends of a strip are at most this far from their fits on average, in h ...
const STRIP_DISPLACEMENT: f64 = 0.06;
/// ... plus this many times the noise. Rounded edges have 0.07 to 0.23, true ones on marching cubes 0.03.
const STRIP_DISPLACEMENT_PER_NOISE: f64 = 2.0;
/// A strip whose fits leave a larger residual (in h) than this on average has to be long to be believed:
/// scans are full of short false ones ...
pub(super) const STRIP_RMS: f64 = 0.01;
/// ... or, where the noise of the mesh is less than [`CLEAN_NOISE`], than this, if next to none of its ends carries a
/// guess: the rims of small holes and cones bend more than quadrics do. At .025 a small round gets a spike, and with
/// guesses a coarse fandisk has 4 % more error ...
const CURVED_STRIP_RMS: f64 = 0.02;
/// ... as a share of ends ...
const FEW_GUESSED: f64 = 0.1;
/// ... with at least this many edges. At 100 small meshes lose their creases.
pub(super) const LONG_STRIP: usize = 30;

/// Noise below this, in h, is none. Sampled parts have .006 and less, a bunny .06.
pub(super) const CLEAN_NOISE: f64 = 0.01;

/// The ends of a round lie this far on the inner side of their fits on average, in h; samples beside a
/// crease lie on theirs, and noise averages out. True creases on marching cubes reach 0.062 ...
pub(super) const ROUND_DISPLACEMENT: f64 = 0.045;
/// ... where the residual is small: the limit is this less the residual, if that is more.
const ROUND_DISPLACEMENT_AND_RMS: f64 = 0.068;
/// That is judged on this many ends with a region's fit ...
const ROUND_ENDS: usize = 6;
/// ... where less than this share of the ends carries a guess.
pub(super) const ROUND_GUESSED: f64 = 0.4;
/// A strip with fewer edges than this, more than [`MAX_GUESSED`] of whose ends carry a guess, is not
/// believed.
const SHORT_STRIP: usize = 10;
const MAX_GUESSED: f64 = 0.5;

/// Where less than this share of the candidates is kept, a strip has to be long to be believed. On filleted
/// boxes fragments of 2 to 13 edges came through, each of which spikes the fillet.
const MOSTLY_KEPT: f64 = 0.5;

/// A sample is off the surface when it is this far from a fit, in h ...
const OFF_DISPLACEMENT: f64 = 0.03;
/// ... and this many times the fit's residual ...
const OFF_IN_RMS: f64 = 5.0;
/// ... which has to be below this, in h, for the fit to be a witness.
const WITNESS_RMS: f64 = 0.01;
/// Share of samples off the surface from which on it is the sampling and not chance. Measured: marching
/// cubes .20 to .51; marching intersections, remeshed and scanned .05 or less.
const OFF_SHARE: f64 = 0.12;
/// Share of witnesses that is needed to be sure. Organic meshes have .16 and less, noisy ones 0; a coarse
/// marching-cubes mesh has .4.
const WITNESS_SHARE: f64 = 0.3;
/// Share of all labels that must be witnesses off the surface: one witness on a noisy mesh proves nothing.
const OFF_SHARE_OF_ALL: f64 = 0.1;
/// Where this share of all labels is planes that leave less than ...
const EXACT_SHARE: f64 = 0.88;
/// ... this residual, in h, ...
const EXACT_RMS: f64 = 1e-4;
/// ... a smaller share off the surface is no chance: of the samples of an octahedron on grids along its axes .03 to .11
/// are, by other sampling .02 at most.
const EXACT_OFF_SHARE: f64 = 0.025;

/// What became of a strip.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Fate {
    /// It is a chamfer.
    Kept,
    /// Its vertices are too far from the fits that should explain them.
    FarFromFits,
    /// It is short and its fits are poor.
    PoorFits,
    /// Its vertices lie on the inner side of their fits: a round.
    Round,
    /// It is short and rests on guesses.
    Guessed,
    /// It is short, and most of what is round it was left alone.
    Fragment,
    /// It lies on a cone that ends in an apex.
    Cone,
}

impl std::fmt::Display for Fate {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(match self {
            Self::Kept => "recovered",
            Self::FarFromFits => "too far from the fits beside it",
            Self::PoorFits => "short, between poor fits",
            Self::Round => "rounded",
            Self::Guessed => "short, made of guesses",
            Self::Fragment => "a fragment of what was left alone",
            Self::Cone => "on a cone beside its apex",
        })
    }
}

/// Candidate edges that share triangles, and why they are believed or not. Lengths in mean edges.
#[derive(Clone, Debug, Serialize)]
pub struct Strip {
    /// How many edges it has.
    pub n_edges: usize,
    /// Mean distance of the ends from the fits of their regions.
    pub displacement: f64,
    /// Mean residual of the fits of the ends.
    pub rms: f64,
    /// Mean distance of the doubtful ends towards the inner side of their regions' fits ...
    pub inward: f64,
    /// ... and how many ends that is the mean of.
    pub n_inward: usize,
    /// Share of ends that carry a guess instead of a region's fit.
    pub guessed: f64,
    /// What became of it.
    pub fate: Fate,
}

/// Whether the samples beside chamfers are off the surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct OffSurface {
    /// Share of the labels that are good enough to tell.
    pub witnesses: f64,
    /// Share of the witnesses' vertices that are off the surface.
    pub share: f64,
    /// Share of the labels that are planes without a residual.
    pub exact: f64,
}

impl OffSurface {
    /// Whether they are, so that they have to be moved.
    pub(super) fn is_likely(self) -> bool {
        let is_polyhedron = self.exact >= EXACT_SHARE && self.share >= EXACT_OFF_SHARE;
        is_polyhedron
            || self.share >= OFF_SHARE
                && self.witnesses >= WITNESS_SHARE
                && self.share * self.witnesses >= OFF_SHARE_OF_ALL
    }
}

/// The median residual of the region fits, in h; 0 where there is none.
pub(super) fn noise(fits: &VertexFits) -> f64 {
    let is_witness = |fit: &&Fit| fit.source == FitSource::Region && fit.n_members >= WITNESS_MEMBERS;
    let mut rms: Vec<f64> = fits.iter().map(|(_, fit)| fit).filter(is_witness).map(|fit| fit.rms).collect();
    if rms.is_empty() {
        return 0.0;
    }
    let middle = rms.len() / 2;
    let is_even = rms.len().is_multiple_of(2);
    let (lower, &mut median, _) = rms.select_nth_unstable_by(middle, f64::total_cmp);
    let below = lower.iter().copied().fold(0.0, f64::max);
    if is_even { median.midpoint(below) } else { median }
}

/// Step 9: how many of the doubtful ends of `chamfers` are off the surface.
pub(super) fn off_surface(surface: &Surface, fits: &VertexFits, chamfers: &[Half]) -> OffSurface {
    let (mut n_labels, mut n_witnesses, mut n_off, mut n_exact) = (0, 0, 0, 0);
    let ends = ends_of(surface.mesh, chamfers);
    for fit in ends.into_iter().filter(|&v| !surface.interior[v]).filter_map(|v| fits.get(v)) {
        n_labels += 1;
        let is_region = fit.source == FitSource::Region;
        if is_region && fit.n_members >= WITNESS_MEMBERS && fit.rms < WITNESS_RMS {
            n_witnesses += 1;
            n_exact += usize::from(fit.rms < EXACT_RMS);
            n_off += usize::from(fit.displacement.abs() > OFF_DISPLACEMENT.max(OFF_IN_RMS * fit.rms));
        }
    }
    let share = |part: usize, whole: usize| part as f64 / whole.max(1) as f64;
    OffSurface {
        witnesses: share(n_witnesses, n_labels),
        share: share(n_off, n_witnesses),
        exact: share(n_exact, n_labels),
    }
}

/// The vertices of `edges`, ascending, each once.
pub(super) fn ends_of(mesh: &Mesh, edges: &[Half]) -> Vec<Vert> {
    let mut ends: Vec<Vert> = edges.iter().flat_map(|&h| mesh.ends(h)).collect();
    ends.sort_unstable();
    ends.dedup();
    ends
}

/// Steps 8 and 8b: groups `candidates` into strips and judges each. Returns the strip of each candidate,
/// and the strips in the order of their lowest edges.
pub(super) fn judge_strips(
    surface: &Surface,
    fits: &VertexFits,
    candidates: &[Half],
    noise: f64,
) -> (Vec<u32>, Vec<Strip>) {
    let (strip_of, n_strips) = group_by_triangles(surface.mesh, candidates);
    let mut sums = vec![Sums::default(); n_strips];
    for (&h, &strip) in candidates.iter().zip(&strip_of) {
        sums[strip as usize].add(surface, fits, h);
    }
    let mut strips: Vec<Strip> = sums.iter().map(|sums| sums.strip(noise)).collect();
    rounds::judge_by_radius(surface, fits, candidates, &strip_of, &mut strips, noise);
    cancel_fragments(&mut strips);
    (strip_of, strips)
}

/// Where the gates cancelled most of the candidates, the mesh is round, and what they let through in short
/// strips are fragments of the same rounds.
fn cancel_fragments(strips: &mut [Strip]) {
    let n_edges = |strips: &mut dyn Iterator<Item = &Strip>| strips.map(|strip| strip.n_edges).sum::<usize>();
    let all = n_edges(&mut strips.iter());
    let kept = n_edges(&mut strips.iter().filter(|strip| strip.fate == Fate::Kept));
    if (kept as f64) < MOSTLY_KEPT * all as f64 {
        for strip in strips.iter_mut().filter(|strip| strip.fate == Fate::Kept && strip.n_edges < LONG_STRIP)
        {
            strip.fate = Fate::Fragment;
        }
    }
}

/// Makes a strip of its own of those of `edges` that are candidates: the one that `strip` makes of the strip that the
/// first of them was in.
pub(super) fn set_apart(
    edges: &[Half],
    candidates: &[Half],
    strip_of: &mut [u32],
    strips: &mut Vec<Strip>,
    strip: impl FnOnce(&Strip) -> Strip,
) {
    let places: Vec<usize> = edges.iter().filter_map(|h| candidates.binary_search(h).ok()).collect();
    let Some(&first) = places.first() else { return };
    let own = Strip { n_edges: places.len(), ..strip(&strips[strip_of[first] as usize]) };
    for i in places {
        strips[strip_of[i] as usize].n_edges -= 1;
        strip_of[i] = strips.len() as u32;
    }
    strips.push(own);
}

/// Numbers the groups of `edges` that share triangles, in the order of their lowest edges.
fn group_by_triangles(mesh: &Mesh, edges: &[Half]) -> (Vec<u32>, usize) {
    let mut parents: Vec<u32> = (0..edges.len() as u32).collect();
    fn root(parents: &mut [u32], mut i: u32) -> u32 {
        while parents[i as usize] != i {
            parents[i as usize] = parents[parents[i as usize] as usize];
            i = parents[i as usize];
        }
        i
    }
    let beside = |(i, &h): (usize, &Half)| {
        let faces = [Some(h), mesh.twin(h)].into_iter().flatten();
        let others = faces.flat_map(|h| [h.next(), h.prev()]);
        let among_edges = others.filter_map(|other| edges.binary_search(&mesh.edge(other)).ok());
        among_edges.map(move |j| [i as u32, j as u32])
    };
    let pairs: Vec<[u32; 2]> = edges.par_iter().enumerate().flat_map_iter(beside).collect();
    for pair in pairs {
        let [a, b] = pair.map(|i| root(&mut parents, i));
        parents[a.max(b) as usize] = a.min(b);
    }
    // The root of a group is its lowest edge.
    let (mut group, mut n_groups) = (Vec::with_capacity(edges.len()), 0);
    for i in 0..edges.len() as u32 {
        let root = root(&mut parents, i);
        group.push(if root == i { n_groups } else { group[root as usize] });
        n_groups += u32::from(root == i);
    }
    (group, n_groups as usize)
}

/// What is summed up over the edges of a strip.
#[derive(Clone, Default)]
pub(super) struct Sums {
    n_edges: usize,
    displacement: f64,
    rms: f64,
    inward: f64,
    n_inward: usize,
    n_guessed: usize,
}

impl Sums {
    pub fn add(&mut self, surface: &Surface, fits: &VertexFits, h: Half) {
        let ends = surface.mesh.ends(h);
        let (Some(p), Some(q)) = (fits.get(ends[0]), fits.get(ends[1])) else { return };
        self.n_edges += 1;
        // Positive where the two fits make a ridge, negative where they make a valley.
        let along = surface.mesh.point(ends[1]) - surface.mesh.point(ends[0]);
        let bend = along.dot(q.normal) - along.dot(p.normal);
        for (v, fit) in ends.into_iter().zip([p, q]) {
            self.rms += fit.rms;
            if fit.source != FitSource::Region {
                self.n_guessed += 1;
            } else if !surface.interior[v] {
                self.displacement += fit.displacement.abs();
                if fit.displacement != 0.0 && bend != 0.0 {
                    self.inward += fit.displacement * bend.signum();
                    self.n_inward += 1;
                }
            }
        }
    }

    pub fn strip(&self, noise: f64) -> Strip {
        let n_ends = (2 * self.n_edges).max(1) as f64;
        let mut strip = Strip {
            n_edges: self.n_edges,
            displacement: self.displacement / n_ends,
            rms: self.rms / n_ends,
            inward: self.inward / self.n_inward.max(1) as f64,
            n_inward: self.n_inward,
            guessed: self.n_guessed as f64 / n_ends,
            fate: Fate::Kept,
        };
        strip.fate = strip.judge(noise);
        strip
    }
}

impl Strip {
    fn judge(&self, noise: f64) -> Fate {
        let round = ROUND_DISPLACEMENT.max(ROUND_DISPLACEMENT_AND_RMS - self.rms);
        let is_clean = noise < CLEAN_NOISE && self.guessed < FEW_GUESSED;
        let max_rms = if is_clean { CURVED_STRIP_RMS } else { STRIP_RMS };
        if self.displacement > STRIP_DISPLACEMENT + STRIP_DISPLACEMENT_PER_NOISE * noise {
            Fate::FarFromFits
        } else if self.rms > max_rms && self.n_edges < LONG_STRIP {
            Fate::PoorFits
        } else if self.inward > round && self.guessed < ROUND_GUESSED && self.n_inward >= ROUND_ENDS {
            Fate::Round
        } else if self.n_edges < SHORT_STRIP && self.guessed > MAX_GUESSED {
            Fate::Guessed
        } else {
            Fate::Kept
        }
    }
}
