//! How well the recovered creases and corners are supported, and what was left alone and why.
//!
//! Based on: nothing in the papers.
//! In/out: the mesh, its `RegionLabels` and the `Placement` -> `Verdict`, the longest creases first.
//! Cost: O(V) to look for what is beyond reach, O(candidates) for the rest, in parallel but for the grouping.

use std::collections::BTreeMap;

use rayon::prelude::*;
use serde::Serialize;

use super::{Apex, Fate, RegionLabels};
use crate::fit::{Fit, FitSource};
use crate::mesh::{Face, Half, Mesh, Vert};
use crate::place::{Outcome, Placement};
use crate::subset::Subset;

/// What speaks for a recovered crease or corner.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Support {
    /// Where one of its new vertices is: where to look.
    pub at: [f64; 3],
    /// Chamfer edges that it was made of; three for a corner, none for the tip of a cone.
    pub edges: usize,
    /// Fewest samples that a fit beside it rests on; 0 for a guess.
    pub least_samples: usize,
    /// Mean number of samples of the fits beside it.
    pub mean_samples: f64,
    /// Mean residual of the fits beside it, in mean edge lengths.
    pub rms: f64,
    /// Share of ends that carry a guess instead of a region's fit.
    pub guessed: f64,
    /// Share of its new vertices that found their place.
    pub placed: f64,
}

/// The verdict over a mesh. Shares are of chamfer edges.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Verdict {
    /// The recovered creases, from corner to corner, the longest first.
    pub creases: Vec<Support>,
    /// The recovered corners.
    pub corners: Vec<Support>,
    /// How many chamfer edges the shares are of.
    pub edges: usize,
    /// Share of chamfers that were recovered.
    pub recovered: f64,
    /// Share of chamfers that were left alone, by reason.
    pub abstained: BTreeMap<Fate, f64>,
    /// Share of edges beside doubtful vertices that nothing can be said of: an end has no fit, because no
    /// smooth face at least three samples wide is near.
    pub impossible: f64,
    /// The noise of the samples: the median residual of the fits, in mean edge lengths.
    pub noise: f64,
    /// Whether the samples beside the creases were off the surface, as marching cubes puts them.
    pub samples_off_surface: bool,
}

/// Sums up what `labels` and `placement` say of `mesh`.
#[must_use]
pub fn verdict(mesh: &Mesh, labels: &RegionLabels, placement: &Placement) -> Verdict {
    let mut abstained: BTreeMap<Fate, usize> = BTreeMap::new();
    for strip in &labels.strips {
        *abstained.entry(strip.fate).or_default() += strip.n_edges;
    }
    let recovered = abstained.remove(&Fate::Kept).unwrap_or(0);
    let impossible = labels.beyond_reach(mesh).len();
    let edges = labels.candidates.len() + impossible;
    let all = edges.max(1) as f64;

    let support = |edges: &[Half], at: Vert| support(mesh, labels, placement, edges, at);
    let inserted = |h: Half| placement.inserts.on_edge[h];
    let mut creases: Vec<Support> =
        creases(mesh, labels).par_iter().map(|edges| support(edges, inserted(edges[0]))).collect();
    creases.sort_by_key(|crease| std::cmp::Reverse(crease.edges));
    let corner = |&f: &Face| Some(support(&f.halves(), placement.inserts.centre(f)?));
    let corners = labels.corner_faces.iter().filter_map(corner);
    Verdict {
        creases,
        corners: corners.chain(labels.apexes.iter().map(support_of_apex)).collect(),
        edges,
        recovered: recovered as f64 / all,
        abstained: abstained.into_iter().map(|(fate, n)| (fate, n as f64 / all)).collect(),
        impossible: impossible as f64 / all,
        noise: labels.noise,
        samples_off_surface: labels.off_surface.is_likely(),
    }
}

/// The chamfer edges in groups that share triangles with two chamfer edges: corner triangles part them.
fn creases(mesh: &Mesh, labels: &RegionLabels) -> Vec<Vec<Half>> {
    let chamfers = Subset::of(mesh.n_halves(), labels.chamfers.iter().copied());
    let is_chamfer = |h: &Half| chamfers.contains(mesh.edge(*h));
    let mut done = Subset::of(mesh.n_halves(), []);
    let mut groups = Vec::new();
    for &start in &labels.chamfers {
        if !done.insert(start) {
            continue;
        }
        let mut group = vec![start];
        let mut next = 0;
        while next < group.len() {
            for h in [Some(group[next]), mesh.twin(group[next])].into_iter().flatten() {
                let beside = h.face().halves();
                if beside.iter().filter(|h| is_chamfer(h)).count() == 2 {
                    group.extend(beside.iter().filter(|h| is_chamfer(h) && done.insert(mesh.edge(**h))));
                }
            }
            next += 1;
        }
        groups.push(group);
    }
    groups
}

fn support(mesh: &Mesh, labels: &RegionLabels, placement: &Placement, edges: &[Half], at: Vert) -> Support {
    let new = |v: Vert| v.index() - mesh.n_verts();
    let ends = edges.iter().flat_map(|&h| mesh.ends(h));
    let fits: Vec<&Fit> = ends.filter_map(|v| labels.fits.get(v)).collect();
    let samples = |fit: &&Fit| if fit.source == FitSource::Region { fit.n_members } else { 0 };
    let share = |part: usize, whole: usize| part as f64 / whole.max(1) as f64;
    let n_guesses = fits.iter().filter(|fit| fit.source != FitSource::Region).count();
    let is_placed = |&&h: &&Half| placement.outcomes[new(placement.inserts.on_edge[h])] == Outcome::Moved;
    Support {
        at: placement.inserts.points[new(at)].to_array(),
        edges: edges.len(),
        least_samples: fits.iter().map(samples).min().unwrap_or(0),
        mean_samples: share(fits.iter().map(samples).sum(), fits.len()),
        rms: fits.iter().map(|fit| fit.rms).sum::<f64>() / fits.len().max(1) as f64,
        guessed: share(n_guesses, fits.len()),
        placed: share(edges.iter().filter(is_placed).count(), edges.len()),
    }
}

/// What speaks for the tip of a cone.
fn support_of_apex(apex: &Apex) -> Support {
    Support {
        at: apex.point.to_array(),
        least_samples: apex.n_samples,
        mean_samples: apex.n_samples as f64,
        rms: apex.rms,
        placed: 1.0,
        ..Support::default()
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::cut_cube;
    use super::*;
    use crate::regions::{label_by_fits, place_by_fits};

    #[test]
    fn a_cube_has_twelve_supported_creases_and_eight_corners() {
        let n = 8;
        let m = cut_cube(n);
        let (normals, labels) = super::super::tests::labels(&m);
        let regions = label_by_fits(&m, &normals, &labels, 0.0);
        let placement = place_by_fits(&m, &regions, None);
        let verdict = verdict(&m, &regions, &placement);
        assert_eq!(verdict.creases.len(), 12);
        for crease in &verdict.creases {
            assert_eq!((crease.edges, crease.placed, crease.guessed), (2 * n - 1, 1.0, 0.0));
            assert!(crease.least_samples >= 4 && crease.rms < 1e-6, "{crease:?}");
            // Two coordinates are those of the cube's sides: 0 or 8.
            assert_eq!(crease.at.iter().filter(|x| x.min((*x - 8.0).abs()).abs() < 1e-9).count(), 2);
        }
        assert_eq!(verdict.corners.len(), 8);
        assert!(verdict.corners.iter().all(|corner| corner.edges == 3 && corner.placed == 1.0));
        assert_eq!((verdict.edges, verdict.recovered, verdict.impossible), (12 * (2 * n - 1), 1.0, 0.0));
        assert!(verdict.abstained.is_empty() && !verdict.samples_off_surface);
    }
}
