//! Fans at pinched edges: four faces meet there, two of them running either way, as where two sheets hang together.
//! One of the sheets may let go.
//!
//! ```text
//!    r2---r3---r4        Four faces have both a and b: b-a-r5 and b-r1-a of the fan of b from a round to a, and two of
//!     | `. | .´ |        another sheet, which is not drawn. Once a has taken the fan over, it is a-r1-r2, a-r2-r3,
//!     |   `b´   |        a-r3-r4 and a-r4-r5, and a-b has the two of the other sheet alone.
//!     | .´ | `. |
//!    r1----a----r5
//! ```
//!
//! The fan was a disk with b inside and is one without, with the same edges round it: these keep their faces. Two faces
//! are gone, and two edges more than have come; b-r1 .. b-r5 had two faces each, and so have a-r2 .. a-r4, which did not
//! exist. The two others at a-b keep b in use.
//!
//! In/out: a face, a vertex and a pinched edge -> the fan; a vertex of its ring -> the faces that it gets.
//! Cost: O(valence) to find a fan and to ask whether a vertex may take it.

use super::Edit;
use crate::mesh::{Face, Vert};

/// Faces one after the other round a vertex, of which the last one meets the first along a pinched edge.
#[derive(Clone, Debug)]
pub(crate) struct Fan {
    pub gone: Vert,
    pub faces: Vec<Face>,
    /// The other corners in the same order: each face has the one with its index and the next one.
    pub ring: Vec<Vert>,
}

impl Fan {
    /// The faces without vertex `i` of the ring.
    pub(crate) fn without(&self, i: usize) -> impl Iterator<Item = Face> + '_ {
        let n = self.faces.len();
        (1..n - 1).map(move |k| self.faces[(i + k) % n])
    }

    /// The two faces with vertex `i` of the ring.
    fn with(&self, i: usize) -> [Face; 2] {
        let n = self.faces.len();
        [self.faces[(i + n - 1) % n], self.faces[i]]
    }

    /// The vertices of the ring that are not beside its vertex `i`.
    fn across(&self, i: usize) -> impl Iterator<Item = Vert> + '_ {
        let n = self.ring.len();
        (2..n - 1).map(move |k| self.ring[(i + k) % n])
    }
}

impl Edit<'_> {
    /// Whether exactly four faces have both `a` and `b`, two of them running either way. One that names a vertex twice
    /// runs both ways.
    fn is_pinched(&self, a: Vert, b: Vert) -> bool {
        let (mut n, mut n_forth, mut n_back) = (0, 0, 0);
        for f in self.faces_with(a, b) {
            n += 1;
            n_forth += usize::from(self.runs(f, a, b));
            n_back += usize::from(self.runs(f, b, a));
        }
        (n, n_forth, n_back) == (4, 2, 2)
    }

    /// The fan of `gone` from `f` at a pinched edge `gone`-`other` round to that edge, if its edges inside have
    /// two faces each that agree on the direction, and if it has faces to hand over.
    pub(crate) fn fan_from(&self, f: Face, gone: Vert, other: Vert) -> Option<Fan> {
        if !self.is_pinched(gone, other) {
            return None;
        }
        let (mut faces, mut ring) = (vec![f], vec![other]);
        // No face comes twice: each has two edges at `gone`, and each of those inside has two faces.
        loop {
            let (last, from) = (*faces.last()?, *ring.last()?);
            let to = self.third(last, gone, from);
            if to == other {
                return (faces.len() > 2).then_some(Fan { gone, faces, ring });
            }
            if to == gone {
                return None; // It names a vertex twice.
            }
            ring.push(to);
            faces.push(self.faces_beside(gone, to)?.into_iter().find(|&g| g != last)?);
        }
    }

    /// Whether vertex `i` of the ring of `fan` may take its faces over: none of the edges and faces that would come is
    /// there already, and no face is turned over.
    pub(crate) fn may_take(&self, fan: &Fan, i: usize) -> bool {
        let kept = fan.ring[i];
        let has_ring = |&f: &Face| fan.ring.iter().all(|&v| self.has_corner(f, v));
        let is_one_face = || fan.ring.len() == 3 && self.faces_at(kept).iter().any(has_ring);
        let moved = |f: Face| self.faces[f].map(|v| if v == fan.gone { kept } else { v });
        !fan.across(i).any(|v| self.are_neighbours(v, kept))
            && !is_one_face()
            && !fan.without(i).any(|f| self.is_turned(moved(f)))
    }

    /// Gives the faces of `fan` to vertex `i` of its ring, which [`may_take`](Self::may_take) them: the two that have
    /// it are removed. The indices of the others come back.
    pub(crate) fn hand_over(&mut self, fan: &Fan, i: usize) -> Vec<Face> {
        let (gone, kept) = (fan.gone, fan.ring[i]);
        fan.with(i).into_iter().for_each(|f| self.remove(f));
        let others: Vec<Face> = fan.without(i).collect();
        for &f in &others {
            self.faces[f] = self.faces[f].map(|v| if v == gone { kept } else { v });
        }
        self.list(gone).retain(|f| !others.contains(f));
        self.list(kept).extend(&others);
        others
    }
}

#[cfg(test)]
mod tests {
    use std::collections::{BTreeMap, BTreeSet};

    use crate::edit::Edit;
    use crate::edit::tests::{all_whole, v};
    use crate::mesh::tests::mesh;
    use crate::mesh::{Face, Vert};
    use crate::refine::{Inserts, refine};

    type Faces = Vec<[usize; 3]>;

    /// Two sheets that share edge 0-1. That of vertices 2 and 3 is above; the fan of 1 below runs along 4-5-6-7.
    const PINCHED: [[usize; 3]; 9] =
        [[0, 1, 2], [0, 3, 1], [0, 2, 4], [0, 7, 3], [0, 4, 1], [1, 4, 5], [1, 5, 6], [1, 6, 7], [0, 1, 7]];

    /// The same with a fan of one face between the two that go.
    const SHORT: [[usize; 3]; 7] =
        [PINCHED[0], PINCHED[1], PINCHED[2], [0, 5, 3], PINCHED[4], PINCHED[5], [0, 1, 5]];

    /// The first as a part of a closed surface.
    fn closed() -> Faces {
        [&PINCHED[..], &[[2, 8, 4], [8, 5, 4], [8, 6, 5], [8, 7, 6], [8, 3, 7], [1, 8, 2], [1, 3, 8]]]
            .concat()
    }

    /// The fan of `gone` that starts with face `first` at `gone`-`other`, and the faces once it belongs to vertex `i` of
    /// its ring, if that is allowed.
    fn handed(
        faces: &[[usize; 3]],
        [first, gone, other]: [usize; 3],
        i: usize,
    ) -> Option<(Vec<usize>, Faces)> {
        let m = mesh(&[[0.; 3]; 9], faces);
        let refined = refine(&m, &Inserts::none()).unwrap();
        let is_whole = all_whole(&m);
        let mut edit = Edit::new(&refined, 9, &is_whole);
        let fan = edit.fan_from(Face::new(first), v(gone), v(other))?;
        if i >= fan.ring.len() || !edit.may_take(&fan, i) {
            return None;
        }
        let others = edit.hand_over(&fan, i);
        assert_eq!(others.len(), fan.faces.len() - 2);
        // Faces at a vertex are those that have it as a corner.
        for u in (0..9).map(v) {
            let mut known = edit.faces_at(u).to_vec();
            known.sort_unstable();
            let with = |&f: &Face| edit.stands(f) && edit.has_corner(f, u);
            assert_eq!(known, m.face_ids().filter(with).collect::<Vec<_>>());
        }
        let stand = m.face_ids().filter(|&f| edit.stands(f));
        let after = stand.map(|f| edit.corners(f).map(Vert::index)).collect();
        Some((fan.faces.into_iter().map(Face::index).collect(), after))
    }

    fn handed_over(faces: &[[usize; 3]], first: usize) -> Option<(Vec<usize>, Faces)> {
        handed(faces, [first, 1, 0], 0)
    }

    #[test]
    fn a_pinched_edge_is_loosened_by_handing_a_fan_over() {
        let after = [&PINCHED[..4], &[[0, 4, 5], [0, 5, 6], [0, 6, 7]]].concat();
        assert_eq!(handed_over(&PINCHED, 4), Some((vec![4, 5, 6, 7, 8], after.clone())));
        assert_eq!(handed_over(&PINCHED, 8), Some((vec![8, 7, 6, 5, 4], after)));
    }

    #[test]
    fn a_fan_may_go_to_another_vertex_of_its_ring() {
        let after = |i| handed(&closed(), [4, 1, 0], i).map(|(_, faces)| faces[4..7].to_vec());
        assert_eq!(after(2), Some(vec![[0, 4, 5], [5, 6, 7], [0, 5, 7]]));
        assert_eq!(after(4), Some(vec![[0, 4, 7], [7, 4, 5], [7, 5, 6]]));
        let joined = [&closed()[..], &[[5, 7, 8]]].concat();
        let is_allowed = |i| handed(&joined, [4, 1, 0], i).is_some();
        assert_eq!([2, 3, 4].map(is_allowed), [false, true, false], "5 and 7 are joined");
    }

    #[test]
    fn no_fan_is_handed_over_where_the_surface_would_be_another() {
        let refuses =
            |faces: &[[usize; 3]], more: &[[usize; 3]]| handed_over(&[faces, more].concat(), 4).is_none();
        let with = |more| refuses(&PINCHED, more);
        let instead = |of: [usize; 3], by: [usize; 3]| PINCHED.map(|f| if f == of { by } else { f });
        const ASIDE: [usize; 3] = [8, 2, 3];
        assert!(!with(&[ASIDE]), "another face does not matter");
        assert!(with(&[[0, 5, 8]]), "0 and 5 are joined already");
        assert!(refuses(&instead([1, 5, 6], ASIDE), &[]), "the fan does not close");
        assert!(
            refuses(&instead([1, 5, 6], [1, 5, 5]), &[]),
            "a face that names a vertex twice closes nothing"
        );
        assert!(with(&[[1, 5, 8]]), "nor is it a fan where an edge inside has three faces");
        assert!(refuses(&instead([0, 3, 1], ASIDE), &[]), "edge 0-1 has three faces");
        assert!(refuses(&instead([0, 3, 1], [0, 1, 3]), &[]), "three of four run the same way");
        assert!(with(&[[0, 1, 8]]) && with(&[[0, 1, 8], [1, 0, 8]]), "five, and six");
        assert!(refuses(&instead([0, 3, 1], [0, 1, 1]), &[]), "one names a vertex twice");
        let two = instead([0, 3, 1], [0, 1, 1]).map(|f| if f == [0, 1, 2] { ASIDE } else { f });
        assert!(refuses(&two, &[]), "without that one there are two");
        assert!(!refuses(&SHORT, &[]));
        assert!(refuses(&SHORT, &[[0, 4, 5]]), "that face would have a twin");
        assert!(
            refuses(&[PINCHED[0], PINCHED[1], PINCHED[2], PINCHED[3], PINCHED[4], [0, 1, 4]], &[]),
            "it has none"
        );
    }

    #[test]
    fn no_fan_becomes_a_face_of_the_refined_mesh_turned_over() {
        let is_taken = |was_there: [usize; 3]| {
            let m = mesh(&[[0.; 3]; 9], &[&SHORT[..], &[was_there]].concat());
            let refined = refine(&m, &Inserts::none()).unwrap();
            let is_whole = all_whole(&m);
            let mut edit = Edit::new(&refined, 9, &is_whole);
            edit.remove(Face::new(SHORT.len()));
            let fan = edit.fan_from(Face::new(4), v(1), v(0)).unwrap();
            edit.may_take(&fan, 0)
        };
        assert!(is_taken([0, 4, 5]) && !is_taken([0, 5, 4]));
    }

    /// The edges with the ways in which faces run along them, without faces that name a vertex twice.
    fn edges(faces: &[[usize; 3]]) -> BTreeMap<[usize; 2], Vec<bool>> {
        let mut edges: BTreeMap<_, Vec<bool>> = BTreeMap::new();
        for [a, b, c] in faces.iter().filter(|[a, b, c]| a != b && b != c && c != a) {
            for [p, q] in [[a, b], [b, c], [c, a]] {
                edges.entry([*p.min(q), *p.max(q)]).or_default().push(p < q);
            }
        }
        edges.values_mut().for_each(|ways| ways.sort_unstable());
        edges
    }

    /// How many faces each set of corners has, and the vertices in use.
    fn inventory(faces: &[[usize; 3]]) -> (BTreeMap<[usize; 3], usize>, BTreeSet<usize>) {
        let mut counts = BTreeMap::new();
        for f in faces {
            let mut corners = *f;
            corners.sort_unstable();
            *counts.entry(corners).or_default() += 1;
        }
        (counts, faces.iter().flatten().copied().collect())
    }

    /// Checks what changes when a fan at edge `gone`-`other` is handed over.
    fn check(before: &[[usize; 3]], after: &[[usize; 3]], pinched: [usize; 2]) {
        const REGULAR: [bool; 2] = [false, true];
        let (old, new) = (edges(before), edges(after));
        for (edge, ways) in &old {
            match new.get(edge) {
                Some(now) if *edge == pinched => {
                    assert_eq!((&ways[..], &now[..]), (&[false, false, true, true][..], &REGULAR[..]))
                }
                Some(now) => assert_eq!(now, ways),
                None => assert_eq!(ways[..], REGULAR),
            }
        }
        assert!(new.iter().all(|(edge, ways)| old.contains_key(edge) || ways[..] == REGULAR));
        assert_eq!((new.len() + 2, after.len() + 2), (old.len(), before.len()));
        let ((doubled, used), (now_doubled, now_used)) = (inventory(before), inventory(after));
        assert_eq!(used, now_used);
        assert!(now_doubled.iter().all(|(corners, &n)| n == 1 || doubled.get(corners) == Some(&n)));
    }

    #[test]
    fn nothing_but_the_pinched_edge_changes_whatever_is_merged_or_added() {
        let faces = || (0..9).flat_map(|a| (a + 1..9).flat_map(move |b| (a + 1..9).map(move |c| [a, b, c])));
        let added = faces().map(|more| [&closed()[..], &[more]].concat());
        let merge =
            |u: usize, w: usize| closed().into_iter().map(move |f| f.map(|t| if t == u { w } else { t }));
        let merged = (0..9).flat_map(|u| (0..9).map(move |w| merge(u, w).collect()));
        let starts = [[4, 1, 0], [8, 1, 0], [0, 0, 1], [4, 0, 1]];
        let mut n_handed = 0;
        for before in added.chain(merged) {
            for (start, i) in starts.into_iter().flat_map(|start| (0..5).map(move |i| (start, i))) {
                if let Some((_, after)) = handed(&before, start, i) {
                    check(&before, &after, [0, 1]);
                    n_handed += 1;
                }
            }
        }
        assert!(n_handed > 100, "{n_handed}");
    }
}
