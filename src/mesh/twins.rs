//! Pairs the half-edges of each edge.
//!
//! In/out: faces `[F]` + their fans -> the twin of each half-edge `[3F]`, if its edge is regular.
//! Cost: O(F log k), k the largest number of edges at one vertex; parallel.

use std::sync::atomic::{AtomicU32, Ordering};

use rayon::prelude::*;

use super::{CHUNK, Fans, Half, PerHalf, Vert, has_repeated_vertex};

/// What is irregular about the edges of a mesh. Such edges stay borders.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct EdgeDefects {
    /// Edges with three or more faces.
    pub non_manifold_edges: usize,
    /// Edges with two faces that run the same way along it: their orientations disagree.
    pub misoriented_edges: usize,
    /// Faces that name one vertex twice. They have no twins at all.
    pub collapsed_faces: usize,
}

/// The twin of each half-edge, and what stood in the way of others.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Twins {
    pub of: PerHalf<Half>,
    /// How many have none.
    pub n_borders: usize,
    pub defects: EdgeDefects,
}

/// Pairs each half-edge with the one that runs the other way, where these two are alone on their edge.
///
/// The faces at a vertex hold both half-edges of all its edges, so the lower end of each edge pairs them, without
/// hashing and in parallel. A vertex with very many edges sorts them.
pub(super) fn pair_twins(faces: &[[Vert; 3]], fans: &Fans) -> Twins {
    // Each entry is written once at most, at the lower end of its edge.
    let twins: Vec<AtomicU32> =
        (0..3 * faces.len()).into_par_iter().map(|_| AtomicU32::new(Half::NONE.0)).collect();
    let set = |h: Half, twin: Half| {
        twins[h.index()].store(twin.0, Ordering::Relaxed);
        twins[twin.index()].store(h.0, Ordering::Relaxed);
    };
    let n_verts = fans.n_verts();
    let defects = (0..n_verts.div_ceil(CHUNK))
        .into_par_iter()
        .map_init(Vec::new, |spokes, chunk| {
            let mut defects = EdgeDefects::default();
            for v in (CHUNK * chunk..n_verts.min(CHUNK * (chunk + 1))).map(Vert::new) {
                let leaving = fans.leaving(v);
                let paired = match leaving.len() {
                    0..=8 => pair_few::<8>(faces, v, leaving, set),
                    9..=16 => pair_few::<16>(faces, v, leaving, set),
                    _ => None,
                };
                paired.unwrap_or_else(|| pair_many(faces, v, leaving, spokes, set, &mut defects));
            }
            defects
        })
        .reduce(EdgeDefects::default, |a, b| EdgeDefects {
            non_manifold_edges: a.non_manifold_edges + b.non_manifold_edges,
            misoriented_edges: a.misoriented_edges + b.misoriented_edges,
            collapsed_faces: a.collapsed_faces + b.collapsed_faces,
        });
    let of = twins.into_iter().map(|twin| Half(twin.into_inner())).collect::<Vec<_>>();
    let n_borders = of.par_iter().filter(|twin| !twin.is_some()).count();
    Twins { of: of.into(), n_borders, defects }
}

/// Pairs the half-edges of those edges that have `v` as their lower end, given the at most `N` half-edges `leaving` it.
/// None, and nothing set, when one of the faces is collapsed or one of these edges is not regular.
#[inline]
fn pair_few<const N: usize>(
    faces: &[[Vert; 3]],
    v: Vert,
    leaving: &[Half],
    set: impl Fn(Half, Half),
) -> Option<()> {
    let from_of = |h: Half| faces.as_flattened()[h.index()];
    // The half-edges to higher vertices and from them, and these vertices. Without a branch: no processor guesses
    // which vertex is higher.
    let (mut to, mut out, mut n_out) = ([Vert::NONE; N], [Half::NONE; N], 0);
    let (mut from, mut back, mut n_back) = ([Vert::NONE; N], [Half::NONE; N], 0);
    for &h in leaving {
        let (w, before) = (from_of(h.next()), h.prev());
        let u = from_of(before);
        if w == v || u == v || w == u {
            return None;
        }
        (to[n_out], out[n_out]) = (w, h);
        n_out += usize::from(w > v);
        (from[n_back], back[n_back]) = (u, before);
        n_back += usize::from(u > v);
    }
    if n_out != n_back {
        return None;
    }
    let (mut twins, mut taken) = ([Half::NONE; N], 0);
    for (&w, twin) in to.iter().zip(&mut twins).take(n_out) {
        // A bit for each place of `w`, without a branch, so that all are compared at a time; from the second bit on, as
        // a shift by nothing is not done along with the others. Behind the first `n_back` is no higher vertex.
        let found = (0..N).fold(0u32, |bits, i| bits | if from[i] == w { 2 << i } else { 0 });
        // If `w` is twice in `to`, the second one finds the same place.
        if !found.is_power_of_two() || taken & found != 0 {
            return None;
        }
        taken |= found;
        *twin = back[found.trailing_zeros() as usize - 1];
    }
    out.into_iter().zip(twins).take(n_out).for_each(|(h, twin)| set(h, twin));
    Some(())
}

/// Pairs the half-edges of those edges that have `v` as their lower end, whatever the faces at `v` are, and counts
/// what is irregular.
fn pair_many(
    faces: &[[Vert; 3]],
    v: Vert,
    leaving: &[Half],
    spokes: &mut Vec<(Vert, bool, Half)>,
    set: impl Fn(Half, Half),
    defects: &mut EdgeDefects,
) {
    spokes.clear();
    for &h in leaving {
        let corners = &faces[h.face().index()];
        if has_repeated_vertex(corners) {
            // Counted where its lowest half-edge leaves.
            defects.collapsed_faces += usize::from(h.corner() == 0);
            continue;
        }
        let both = [(corners[h.next().corner()], false, h), (corners[h.prev().corner()], true, h.prev())];
        spokes.extend(both.into_iter().filter(|spoke| v < spoke.0));
    }
    spokes.sort_unstable();
    for edge in spokes.chunk_by(|x, y| x.0 == y.0) {
        match *edge {
            [_] => {}
            [(_, false, h), (_, true, twin)] => set(h, twin),
            [_, _] => defects.misoriented_edges += 1,
            _ => defects.non_manifold_edges += 1,
        }
    }
}
