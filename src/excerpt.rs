//! The part of a refined mesh that cleaning looks at, cut out and put back.
//!
//! ```text
//!   old mesh       . . . . . . . . . .        Rings of faces round the split ones are cut out and refined
//!   rings            o o o o o o              for themselves, with numbers of their own: all that edits
//!   split faces        x x x                  do costs what the excerpt costs, not what the mesh does.
//! ```
//!
//! Its vertices and faces are numbered in the order of the refined mesh, old vertices first: whatever is
//! decided by an index is decided as in the whole.
//!
//! In/out: the old mesh, its inserts and its split faces -> `Excerpt`; the edited excerpt -> the new mesh.
//! Cost: O(excerpt) to cut out; one copy of the mesh to put back.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use crate::edit::Edited;
use crate::mesh::{Face, Half, Mesh, PerVert, Vert};
use crate::refine::{Inserts, Lineage, Place, Refined, Split};
use crate::subset::{Ranked, Subset};

/// Rings of faces round the split ones: at the vertices of split faces, and at the vertices of those. Where edits ask
/// for a vertex beyond, a wider excerpt is cut.
pub(crate) const RINGS: usize = 2;

/// So many rings more round tips, where flips go on from edge to edge. With none most meshes with a cone need a wider
/// excerpt, with one a flat cone does, with two none of 295 inputs.
const TIP_RINGS: usize = 2;

/// Faces per unit of parallel work.
const CHUNK: usize = 8192;

/// A part of a mesh, refined.
pub(crate) struct Excerpt<'m> {
    before: &'m Mesh,
    inserts: &'m Inserts,
    /// The old faces of the excerpt, ascending.
    faces: Vec<Face>,
    /// Its old vertices.
    verts: Ranked<Vert>,
    /// The excerpt refined, as if there was nothing else; but the parents are faces of the whole mesh.
    pub refined: Refined,
    /// Whether all faces at a vertex are in the excerpt. `[V of the excerpt]`
    pub is_whole: PerVert<bool>,
}

/// The new mesh.
pub(crate) struct Rejoined {
    pub mesh: Mesh,
    /// Where its faces come from, if that was asked for.
    pub lineage: Option<Lineage>,
    /// Old vertices that were collapsed, ascending. Inserted vertices stand in their slots, as far as there are any.
    pub replaced: Vec<Vert>,
    pub now: Now,
}

/// What vertices and faces of the refined mesh became.
pub(crate) struct Now {
    n_old: usize,
    /// All new faces in their order.
    turns: Vec<Turn>,
    /// The old vertices of the excerpt ...
    verts: Ranked<Vert>,
    /// ... and what its vertices, old and inserted, are now.
    now: Vec<Vert>,
}

/// Some new faces: in turns come old ones and those of the excerpt.
struct Turn {
    /// The index of the first one.
    first: usize,
    /// First come these old faces, which are not in the excerpt, ...
    same: Range<usize>,
    /// ... then these faces of the edited excerpt.
    own: Range<usize>,
}

impl Now {
    /// The face that is old face `f` now, unless it was in the excerpt.
    pub(crate) fn face(&self, f: Face) -> Option<Face> {
        let turn = self.turns.get(self.turns.partition_point(|turn| turn.same.end <= f.index()))?;
        let i = f.index().checked_sub(turn.same.start)?;
        Some(Face::new(turn.first + i))
    }

    /// The faces that come from the excerpt.
    pub(crate) fn faces_of_excerpt(&self) -> Vec<Face> {
        let first_own = |turn: &Turn| turn.first + turn.same.len();
        self.turns.iter().flat_map(|turn| (first_own(turn)..).take(turn.own.len())).map(Face::new).collect()
    }

    /// The vertex that `v` is now, or was collapsed into.
    pub(crate) fn of(&self, v: Vert) -> Vert {
        let slot = match v.index().checked_sub(self.n_old) {
            Some(i) => Some(self.verts.members().len() + i),
            None => self.verts.rank(v),
        };
        slot.map_or(v, |i| self.now[i])
    }
}

impl<'m> Excerpt<'m> {
    /// Cuts out so many `rings` of faces round those that are `split`, and more round `tips`.
    pub(crate) fn new(
        before: &'m Mesh,
        inserts: &'m Inserts,
        split: &Split,
        tips: &[Vert],
        rings: usize,
    ) -> Self {
        let (n_verts, n_faces) = (before.n_verts(), before.n_faces());
        let mut faces = Subset::of(n_faces, []);
        let mut verts = Subset::of(n_verts, tips.iter().copied());
        let mut whole = Subset::of(n_verts, []);
        let mut ring = tips.to_vec();
        for i in 0..TIP_RINGS + rings {
            if i == TIP_RINGS {
                split.faces.iter().for_each(|&f| _ = faces.insert(f));
                let corners = split.faces.iter().flat_map(|&f| before.corners(f));
                ring.extend(corners.filter(|&v| verts.insert(v)));
            }
            whole = verts.clone();
            let mut next = Vec::new();
            for &v in &ring {
                for f in before.leaving(v).iter().map(|h| h.face()) {
                    if faces.insert(f) {
                        next.extend(before.corners(f).into_iter().filter(|&w| verts.insert(w)));
                    }
                }
            }
            ring = next;
        }
        let (faces, verts) = (faces.iter().collect::<Vec<_>>(), verts.ranked());
        let refined = refine_excerpt(before, inserts, split, &faces, &verts);
        let is_whole = verts.members().iter().map(|&v| whole.contains(v));
        let is_whole = is_whole.chain(inserts.points.iter().map(|_| true)).collect::<Vec<_>>().into();
        Self { before, inserts, faces, verts, refined, is_whole }
    }

    /// How many old vertices the excerpt has: they come first.
    pub(crate) fn n_old(&self) -> usize {
        self.verts.members().len()
    }

    /// The old vertices, ascending, as vertices of the whole mesh.
    pub(crate) fn old_verts(&self) -> &[Vert] {
        self.verts.members()
    }

    /// The vertex of the excerpt that is old vertex `v` of the whole mesh.
    pub(crate) fn own(&self, v: Vert) -> Option<Vert> {
        self.verts.rank(v).map(Vert::new)
    }

    /// Where old vertex `v` of the whole mesh is before the edits, which move no old vertex.
    pub(crate) fn old_point(&self, v: Vert) -> DVec3 {
        self.inserts.old_point(self.before, v)
    }

    /// The vertex of the whole refined mesh that is vertex `v` of the excerpt.
    pub(crate) fn whole(&self, v: Vert) -> Vert {
        match v.index().checked_sub(self.n_old()) {
            Some(i) => Vert::new(self.before.n_verts() + i),
            None => self.verts.members()[v.index()],
        }
    }

    /// Puts the excerpt back as edits have left it. Says where faces come from if it `keeps_lineage`.
    pub(crate) fn rejoin(self, edited: Edited, keeps_lineage: bool) -> Rejoined {
        let turns = self.turns(&edited);
        let (points, faces) =
            rayon::join(|| self.rejoin_points(&edited), || self.rejoin_faces(&edited, &turns));
        let lineage = keeps_lineage.then(|| self.rejoin_lineage(&edited, &turns));
        let mesh = Mesh::of_valid_parts(points, faces);
        debug_assert_eq!(mesh.check(), Ok(()));
        let [replaced, now] = [&edited.replaced, edited.now.as_slice()]
            .map(|verts| verts.iter().map(|&v| self.whole(v)).collect());
        Rejoined {
            mesh,
            lineage,
            replaced,
            now: Now { n_old: self.before.n_verts(), turns, verts: self.verts, now },
        }
    }

    fn rejoin_points(&self, edited: &Edited) -> Vec<DVec3> {
        let n_added = edited.mesh.n_verts() - self.n_old();
        let mut points = Vec::with_capacity(self.before.n_verts() + n_added);
        points.extend_from_slice(self.before.points());
        for &(v, point) in &self.inserts.moved {
            points[v.index()] = point;
        }
        points.extend_from_slice(&edited.mesh.points()[self.n_old()..]);
        for &v in &edited.replaced {
            points[self.whole(v).index()] = edited.mesh.point(v);
        }
        points
    }

    fn rejoin_faces(&self, edited: &Edited, turns: &[Turn]) -> Vec<[Vert; 3]> {
        let mut faces = Vec::with_capacity(self.n_new_faces(edited));
        for Turn { same, own, .. } in turns {
            faces.extend_from_slice(&self.before.faces()[same.clone()]);
            let own = &edited.mesh.faces()[own.clone()];
            faces.extend(own.iter().map(|corners| corners.map(|v| self.whole(v))));
        }
        faces
    }

    fn rejoin_lineage(&self, edited: &Edited, turns: &[Turn]) -> Lineage {
        let n_faces = self.n_new_faces(edited);
        let (mut parents, mut corners) = (Vec::with_capacity(n_faces), Vec::with_capacity(3 * n_faces));
        let mut foreign = Vec::with_capacity(edited.lineage.foreign.len());
        let mut own_foreign = edited.lineage.foreign.iter().peekable();
        for Turn { same, own, .. } in turns {
            parents.extend(same.clone().map(Face::new));
            corners.extend(same.clone().flat_map(|_| [0, 1, 2].map(Place::Corner)));
            let halves = 3 * own.start..3 * own.end;
            while let Some(&(h, weights)) = own_foreign.next_if(|(h, _)| h.index() < halves.end) {
                foreign.push((Half::new(corners.len() + h.index() - halves.start), weights));
            }
            parents.extend_from_slice(&edited.lineage.parents.as_slice()[own.clone()]);
            corners.extend_from_slice(&edited.lineage.corners.as_slice()[halves]);
        }
        Lineage { parents: parents.into(), corners: corners.into(), foreign }
    }

    fn n_new_faces(&self, edited: &Edited) -> usize {
        self.before.n_faces() - self.faces.len() + edited.mesh.n_faces()
    }

    /// The new faces in their order.
    fn turns(&self, edited: &Edited) -> Vec<Turn> {
        let parents = edited.lineage.parents.as_slice();
        let (mut turns, mut first, mut old, mut own) = (Vec::new(), 0, 0, 0);
        let mut push = |same: Range<usize>, own: Range<usize>| {
            let n = same.len() + own.len();
            turns.push(Turn { first, same, own });
            first += n;
        };
        for run in self.faces.chunk_by(|f, g| f.index() + 1 == g.index()) {
            let end = run[run.len() - 1].index() + 1;
            let n_own = parents[own..].iter().take_while(|parent| parent.index() < end).count();
            push(old..run[0].index(), own..own + n_own);
            (old, own) = (end, own + n_own);
        }
        push(old..self.before.n_faces(), own..own);
        turns
    }
}

/// Refines the old `faces` of `before`, whose vertices are `verts`.
fn refine_excerpt(
    before: &Mesh,
    inserts: &Inserts,
    split: &Split,
    faces: &[Face],
    verts: &Ranked<Vert>,
) -> Refined {
    let mut points: Vec<_> = verts.members().iter().map(|&v| before.point(v)).collect();
    for &(v, point) in &inserts.moved {
        if let Some(i) = verts.rank(v) {
            points[i] = point;
        }
    }
    points.extend_from_slice(&inserts.points);
    let own = |v: Vert| match v.index().checked_sub(before.n_verts()) {
        Some(i) => Vert::new(verts.members().len() + i),
        None => verts.rank(v).map_or(Vert::NONE, Vert::new),
    };

    let pieces: Vec<Piece> =
        faces.par_chunks(CHUNK).map(|faces| refine_piece(before, split, faces, own)).collect();
    let n_faces = faces.len() + split.children.len() - split.faces.len();
    let (mut corners, mut parents) = (Vec::with_capacity(n_faces), Vec::with_capacity(n_faces));
    let mut places = Vec::with_capacity(n_faces);
    let mut children = Vec::with_capacity(split.children.len());
    for piece in pieces {
        children.extend(piece.children.iter().map(|i| Face::new(corners.len() + i)));
        corners.extend(piece.corners);
        places.extend(piece.places);
        parents.extend(piece.parents);
    }
    Refined {
        mesh: Mesh::of_valid_parts(points, corners),
        lineage: Lineage {
            parents: parents.into(),
            corners: places.into_flattened().into(),
            foreign: Vec::new(),
        },
        creases: split.creases.iter().map(|edge| edge.map(own)).collect(),
        middles: split.middles.clone(),
        children,
    }
}

/// Some refined faces.
struct Piece {
    corners: Vec<[Vert; 3]>,
    places: Vec<[Place; 3]>,
    parents: Vec<Face>,
    /// Which of them are children of split faces.
    children: Vec<usize>,
}

impl Piece {
    /// Room for the children of so many faces, of which few are split.
    fn with_capacity(n_faces: usize) -> Self {
        let n = 2 * n_faces;
        let (corners, places) = (Vec::with_capacity(n), Vec::with_capacity(n));
        Self { corners, places, parents: Vec::with_capacity(n), children: Vec::new() }
    }

    /// Adds faces that are not split.
    fn keep(&mut self, before: &Mesh, faces: &[Face], own: impl Fn(Vert) -> Vert) {
        self.corners.extend(faces.iter().map(|&f| before.corners(f).map(&own)));
        self.places.extend(faces.iter().map(|_| [0, 1, 2].map(Place::Corner)));
        self.parents.extend_from_slice(faces);
    }
}

/// Refines some `faces`. `own` says which vertex of the excerpt one of the refined mesh is.
fn refine_piece(before: &Mesh, split: &Split, faces: &[Face], own: impl Fn(Vert) -> Vert) -> Piece {
    let mut piece = Piece::with_capacity(faces.len());
    let mut rest = faces;
    let first = faces.first().map_or(0, |f| split.faces.partition_point(|g| g < f));
    for (i, &f) in split.faces.iter().enumerate().skip(first) {
        let Some(n_kept) = rest.iter().position(|&g| g == f) else { break };
        piece.keep(before, &rest[..n_kept], &own);
        rest = &rest[n_kept + 1..];
        for child in split.children(i) {
            piece.children.push(piece.corners.len());
            piece.corners.push(child.map(|(v, _)| own(v)));
            piece.places.push(child.map(|(_, place)| place));
            piece.parents.push(f);
        }
    }
    piece.keep(before, rest, &own);
    piece
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::edit::Edit;
    use crate::mesh::tests::mesh;
    use crate::refine::{refine, split};

    const N: usize = 9;

    /// A sheet of 8 x 8 squares whose middle one has its diagonal split.
    fn sheet() -> (Mesh, Inserts) {
        let points: Vec<_> = (0..N * N).map(|i| [(i % N) as f64, (i / N) as f64, 0.0]).collect();
        let corners = (0..N * (N - 1)).filter(|i| i % N != N - 1);
        let squares = corners.flat_map(|i| [[i, i + 1, i + N + 1], [i, i + N + 1, i + N]]);
        let m = mesh(&points, &squares.collect::<Vec<_>>());
        let middle = N * N / 2;
        let diagonal = m.edge(m.half_between(Vert::new(middle), Vert::new(middle + N + 1)).unwrap());
        let inserts = Inserts::in_the_middle(&m, |h| m.edge(h) == diagonal, &[]);
        (m, inserts)
    }

    #[test]
    fn who_asks_beyond_the_rings_gets_a_wider_excerpt() {
        let (m, inserts) = sheet();
        let split = split(&m, &inserts).unwrap();
        // Old vertices that are so many squares away from the split one, to the left and below, ask for their faces.
        let is_too_small = |rings: usize, away: usize| {
            let excerpt = Excerpt::new(&m, &inserts, &split, &[], rings);
            let edit = Edit::new(&excerpt.refined, excerpt.n_old(), &excerpt.is_whole);
            let v = Vert::new(N * N / 2 - (N + 1) * away);
            let own = excerpt.old_verts().binary_search(&v).expect("it is in the excerpt");
            assert_eq!(excerpt.whole(Vert::new(own)), v);
            let n_faces = edit.faces_at(Vert::new(own)).len();
            assert_eq!(edit.is_at_fringe(), n_faces < 6);
            edit.is_at_fringe()
        };
        assert_eq!([is_too_small(1, 0), is_too_small(1, 1)], [false, true]);
        assert_eq!([is_too_small(2, 0), is_too_small(2, 1), is_too_small(2, 2)], [false, false, true]);
    }

    #[test]
    fn tips_have_two_more_rings() {
        let (m, inserts) = sheet();
        let excerpt = Excerpt::new(&m, &inserts, &split(&m, &inserts).unwrap(), &[Vert::new(0)], 1);
        let is_whole = |i: usize| excerpt.own(Vert::new((N + 1) * i)).map(|v| excerpt.is_whole[v]);
        assert_eq!([2, 3, 4, 7].map(is_whole), [Some(true), Some(false), Some(true), None]);
    }

    #[test]
    fn an_excerpt_put_back_without_edits_is_the_refined_mesh() {
        let (m, inserts) = sheet();
        let split = split(&m, &inserts).unwrap();
        let expected = refine(&m, &inserts).unwrap();
        for rings in 1..=5 {
            let excerpt = Excerpt::new(&m, &inserts, &split, &[], rings);
            let edit = Edit::new(&excerpt.refined, excerpt.n_old(), &excerpt.is_whole);
            let edited = edit.finish(&m, &inserts, |v| excerpt.whole(v), true).unwrap();
            let Rejoined { mesh, lineage, replaced, now } = excerpt.rejoin(edited, true);
            assert_eq!((mesh.points(), mesh.faces()), (expected.mesh.points(), expected.mesh.faces()));
            let lineage = lineage.unwrap();
            assert_eq!(lineage.parents, expected.lineage.parents);
            assert_eq!(lineage.corners, expected.lineage.corners);
            assert!(replaced.is_empty() && mesh.verts().all(|v| now.of(v) == v));
            let of_excerpt = now.faces_of_excerpt();
            let is_same = |(f, g): (Face, Face)| mesh.corners(g) == m.corners(f);
            let outside: Vec<_> = m.face_ids().filter_map(|f| Some((f, now.face(f)?))).collect();
            assert!(outside.iter().copied().all(is_same));
            assert_eq!(outside.len() + of_excerpt.len(), mesh.n_faces());
            assert!(outside.iter().all(|(_, g)| !of_excerpt.contains(g)));
        }
    }
}
