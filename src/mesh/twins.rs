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
/// The faces at a vertex hold both half-edges of all its edges, so each vertex finds the twins of the
/// half-edges that leave it, without hashing and in parallel. A vertex with very many edges sorts them.
pub(super) fn pair_twins(faces: &[[Vert; 3]], fans: &Fans) -> Twins {
    // Each entry is written once, at the vertex that its half-edge leaves.
    let twins: Vec<AtomicU32> =
        (0..3 * faces.len()).into_par_iter().map(|_| AtomicU32::new(Half::NONE.0)).collect();
    let set = |h: Half, twin: Half| twins[h.index()].store(twin.0, Ordering::Relaxed);
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

/// Finds the twins of the at most `N` half-edges `leaving` `v`. None, and nothing set, when one of the faces is
/// collapsed or one of the edges irregular.
#[inline]
fn pair_few<const N: usize>(
    faces: &[[Vert; 3]],
    v: Vert,
    leaving: &[Half],
    set: impl Fn(Half, Half),
) -> Option<()> {
    const NEXT: [usize; 3] = [1, 2, 0];
    let (mut to, mut from, mut before) = ([Vert::NONE; N], [Vert::NONE; N], [Half::NONE; N]);
    for (i, &h) in leaving.iter().enumerate() {
        let (face, next) = (h.face(), NEXT[h.corner()]);
        let corners = &faces[face.index()];
        (to[i], from[i], before[i]) = (corners[next], corners[NEXT[next]], face.half(NEXT[next]));
        if to[i] == v || from[i] == v || to[i] == from[i] {
            return None;
        }
    }
    let (mut twins, mut taken) = ([Half::NONE; N], 0);
    for (&w, twin) in to.iter().zip(&mut twins).take(leaving.len()) {
        // A bit for each place of `w`, without a branch, so that several are compared at a time.
        let places = |verts: &[Vert; N]| (0..N).fold(0u32, |bits, i| bits | u32::from(verts[i] == w) << i);
        let found = places(&from);
        if found.is_power_of_two() && taken & found == 0 {
            // If `w` is twice in `to`, the second one finds the same place.
            taken |= found;
            *twin = before[found.trailing_zeros() as usize];
        } else if found != 0 || !places(&to).is_power_of_two() {
            return None;
        }
    }
    leaving.iter().zip(twins).for_each(|(&h, twin)| set(h, twin));
    Some(())
}

/// Finds the twins of the half-edges `leaving` `v`, whatever their faces are, and counts what is irregular.
/// An irregular edge counts at its lower vertex, unless no half-edge of it leaves that one.
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
        spokes.push((corners[h.next().corner()], false, h));
        spokes.push((corners[h.prev().corner()], true, h.prev()));
    }
    spokes.sort_unstable();
    for edge in spokes.chunk_by(|x, y| x.0 == y.0) {
        let n_leaving = edge.iter().filter(|spoke| !spoke.1).count();
        let is_mine = n_leaving > 0 && (v < edge[0].0 || n_leaving == edge.len());
        match *edge {
            [_] => {}
            [(_, false, h), (_, true, twin)] => set(h, twin),
            [_, _] => defects.misoriented_edges += usize::from(is_mine),
            _ => defects.non_manifold_edges += usize::from(is_mine),
        }
    }
}
