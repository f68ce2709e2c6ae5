//! The operations that untangling chooses from, each with what allows it and what it gains.
//!
//! ```text
//!   flip        the other diagonal of two faces, either of which may follow either fit
//!   collapse    a vertex into a neighbour: off creases anywhere, on a crease along it only
//!   loosen      a fan of faces from one end of an edge of four faces to another vertex (`loosen.rs`)
//!   merge       two crease vertices into one between them on the crease, or two corners that nearly coincide
//!   respace     one crease vertex or a run of them along the crease (`respace.rs`)
//!   back        an inserted vertex towards the middle of its edge: it leaves the feature, the last resort
//! ```
//!
//! Based on: nothing in the papers, which collapse what has an angle below 1 degree.
//! In/out: a bad face -> the operation on its edges and corners that lowers the energy most; carries it out.
//! Cost: O(faces at its corners) for each operation: some 6 microseconds a bad face.

#[cfg(test)]
mod tests;

use glam::DVec3;

use super::{CREASE_TOLERANCE, FACE_TOLERANCE, MIN_GAIN, UntangleCounts, Zone};
use crate::edit::Fan;
use crate::mesh::{Face, Vert};

/// Two corners joined by a crease edge shorter than this (in mean edge lengths) may merge: what should be one apex of
/// a pyramid may have become two. Half and double change nothing on 251 inputs; without, 21 change, and
/// the largest errors of seven pyramids and icosahedra grow 60 times and more.
const CORNER_MERGE: f64 = 0.25;
/// Going back towards the middle is the last resort, as it takes a vertex off its feature: it must gain this much,
/// more than one sliver is worth. At 0.001 the largest errors of ten among 251 inputs grow 3 to 96 times; at 1 ten
/// change, L2 of three falls by 2 to 6 %, but a fandisk and a scanned wedge cut themselves in two and four places more;
/// at 0.25 four change, by less than 1 % ...
const BACK_GAIN: f64 = 0.5;
/// ... and going further than a part of the way must gain this much more. No more than a tie-break: half and double
/// change 5 of 251 inputs, at 0 five, some for better and some for worse.
const FURTHER_BACK_GAIN: f64 = 0.25;
/// Shares of the way back to the middle that are tried, the shortest first: with halves alone L2 of four
/// stars and icosahedra grows by 20 to 40 %; with eighths it falls by 5 to 9 % on as many, but six folds come.
const BACK_SHARES: [f64; 4] = [0.25, 0.5, 0.75, 1.0];
/// Energies that differ by less are equal.
const ROUNDING: f64 = 1e-9;
/// Gains are compared in this many parts of one bad face's energy: a thousandth of what an operation must gain, a
/// thousand times what rounding makes of a sum, so that ties are ties on every machine.
const GAIN_PARTS: f64 = 1e6;
/// A face that is off its fit may become so many times as far off: where its farthest corner stays, rounding is no
/// reason to refuse. At 1 nothing changes on 31 inputs, at 1.01 two hardly do.
const RESIDUAL_SLACK: f64 = 1.0001;

/// What to do about a bad face.
#[derive(Clone, Debug)]
pub(super) enum Operation {
    Flip { faces: [Face; 2], triangles: [[Vert; 3]; 2] },
    Collapse { gone: Vert, kept: Vert },
    Loosen { fan: Fan, to: usize },
    Merge { gone: Vert, kept: Vert, to: DVec3 },
    Respace { vertices: Vec<Vert>, to: Vec<DVec3> },
    MoveBack { vertex: Vert, to: DVec3 },
}

/// An operation with what decides between it and others.
struct Candidate {
    /// Energy gained, see [`GAIN_PARTS`]: less is rounding.
    gain: i64,
    /// Flip, collapse or loosen, merge, one vertex, a run, back: of equal gains the gentler operation.
    rank: u8,
    length_squared: f64,
    vertices: [Vert; 2],
    operation: Operation,
}

impl Candidate {
    fn new(gain: f64, rank: u8, length_squared: f64, vertices: [Vert; 2], operation: Operation) -> Self {
        Self { gain: (gain * GAIN_PARTS).round() as i64, rank, length_squared, vertices, operation }
    }

    fn is_before(&self, other: &Self) -> bool {
        let order = other.gain.cmp(&self.gain).then(self.rank.cmp(&other.rank));
        let order = order.then(self.length_squared.total_cmp(&other.length_squared));
        order.then(self.vertices.cmp(&other.vertices)).is_lt()
    }
}

impl Zone<'_, '_, '_> {
    /// The operation on the edges or corners of `f` that gains most, if any gains.
    pub(super) fn best_operation(&mut self, f: Face, may_move_back: bool) -> Option<Operation> {
        let t = self.edit.corners(f);
        let mut candidates = Vec::new();
        for i in 0..3 {
            let (a, b) = (t[i], t[(i + 1) % 3]);
            let length_squared = self.length_squared(a, b);
            let mut push = |gain, rank, length_squared, vertices, operation| {
                candidates.push(Candidate::new(gain, rank, length_squared, vertices, operation));
            };
            if let Some((gain, faces, triangles)) = self.try_flip(f, a, b) {
                push(gain, 0, 0.0, [a, b], Operation::Flip { faces, triangles });
            }
            for (gone, kept) in [(a, b), (b, a)] {
                if let Some(gain) = self.try_collapse(gone, kept, false) {
                    push(gain, 1, length_squared, [gone, kept], Operation::Collapse { gone, kept });
                } else if let Some((gain, fan, to)) = self.try_loosen(f, gone, kept) {
                    push(gain, 1, length_squared, [gone, kept], Operation::Loosen { fan, to });
                }
            }
            if self.edit.is_inserted(a) && self.edit.is_inserted(b) {
                let (gone, kept) = if self.crease(b).len() >= self.crease(a).len() { (a, b) } else { (b, a) };
                if let Some((gain, to)) = self.try_merge(gone, kept) {
                    push(gain, 2, length_squared, [gone, kept], Operation::Merge { gone, kept, to });
                }
                if let Some((gain, vertices, to)) = self.try_run(a, b) {
                    push(gain, 4, 0.0, [a, b], Operation::Respace { vertices, to });
                }
            }
            if let Some((gain, to)) = self.try_respace(a) {
                push(gain, 3, 0.0, [a, a], Operation::Respace { vertices: vec![a], to: vec![to] });
            }
        }
        if may_move_back && candidates.is_empty() {
            for v in t {
                if let Some((gain, to)) = self.try_back(v) {
                    let operation = Operation::MoveBack { vertex: v, to };
                    candidates.push(Candidate::new(gain, 5, 0.0, [v, v], operation));
                }
            }
        }
        candidates.into_iter().reduce(|x, y| if y.is_before(&x) { y } else { x }).map(|best| best.operation)
    }

    /// Carries out `operation`; the faces that it touched come back.
    pub(super) fn apply(&mut self, operation: Operation, counts: &mut UntangleCounts) -> Vec<Face> {
        match operation {
            Operation::Flip { faces, triangles } => {
                counts.flipped += 1;
                self.edit.flip(faces, triangles);
                faces.into_iter().for_each(|f| self.forget(f));
                faces.to_vec()
            }
            Operation::Collapse { gone, kept } => {
                counts.collapsed += 1;
                self.collapse(gone, kept)
            }
            Operation::Loosen { fan, to } => {
                counts.loosened += 1;
                let touched = self.edit.hand_over(&fan, to);
                touched.iter().for_each(|&f| self.forget(f));
                touched
            }
            Operation::Merge { gone, kept, to } => {
                counts.collapsed += 1;
                self.collapse(gone, kept);
                self.move_vertices(&[kept], &[to])
            }
            Operation::Respace { vertices, to } => {
                counts.respaced += vertices.len();
                self.move_vertices(&vertices, &to)
            }
            Operation::MoveBack { vertex, to } => {
                counts.moved_back += 1;
                self.move_vertices(&[vertex], &[to])
            }
        }
    }

    fn move_vertices(&mut self, vertices: &[Vert], to: &[DVec3]) -> Vec<Face> {
        let mut touched = Vec::new();
        for (&v, &point) in vertices.iter().zip(to) {
            self.edit.move_to(v, point);
            touched.extend(self.edit.faces_at(v));
        }
        touched.iter().for_each(|&f| self.forget(f));
        touched
    }

    /// Removes `gone`; its faces and creases go to `kept`.
    pub(super) fn collapse(&mut self, gone: Vert, kept: Vert) -> Vec<Face> {
        let touched = self.edit.collapse(gone, kept);
        touched.iter().for_each(|&f| self.forget(f));
        if self.edit.is_inserted(gone) {
            for w in std::mem::take(&mut self.creases[gone.index() - self.n_old]) {
                let list = &mut self.creases[w.index() - self.n_old];
                list.retain(|&v| v != gone);
                if w != kept {
                    join(list, kept);
                    join(&mut self.creases[kept.index() - self.n_old], w);
                }
            }
        }
        touched
    }

    /// What collapsing `gone` into `kept` gains, if it is allowed. With `even_if_equal` a collapse that
    /// gains nothing is allowed too.
    pub(super) fn try_collapse(&mut self, gone: Vert, kept: Vert, even_if_equal: bool) -> Option<f64> {
        let n_creases = self.crease(gone).len();
        let along = self.is_crease(gone, kept);
        let is_free = n_creases == 0 || (along && n_creases <= 2);
        let is_labelled = self.edit.is_inserted(gone) || self.context.fits[gone].is_some();
        if !self.is_inner[gone] || !is_free || !is_labelled {
            return None;
        }
        let beside = self.edit.faces_beside(gone, kept)?;
        if along && self.would_join_creases(gone, kept, beside) {
            return None;
        }
        let faces = self.edit.faces_at(gone).to_vec();
        let old: f64 = faces.iter().map(|&f| self.value_of(f)).sum();
        let limit = if even_if_equal { old + ROUNDING } else { old - MIN_GAIN };
        let others = faces.into_iter().filter(|f| !beside.contains(f));
        let new = self.energy_with(&[gone], &[self.edit.point(kept)], others, limit)?;
        if along && n_creases == 2 {
            let &other = self.crease(gone).iter().find(|&&w| w != kept)?;
            let middle = self.edit.point(other).midpoint(self.edit.point(kept));
            if !self.is_on_its_fits(middle, gone, other) {
                return None;
            }
        }
        // Last, as it costs most: few collapses gain.
        self.edit.collapsible(gone, kept).map(|_| old - new)
    }

    /// The energy of face `f` once an operation has made it `triangle`, unless it leaves its fit.
    fn allowed(&self, f: Face, triangle: [DVec3; 3]) -> Option<f64> {
        let residual = self.residual_of(triangle, f);
        let was_so_far = || residual <= RESIDUAL_SLACK * self.residual_of(self.edit.triangle(f), f);
        let is_allowed = residual <= FACE_TOLERANCE || was_so_far();
        is_allowed.then(|| self.value(self.energy_of(triangle, f)))
    }

    /// The energy of `faces` with `vertices` moved `to` other places, if none of them leaves its fit and the sum is
    /// less than `limit`.
    pub(super) fn energy_with(
        &self,
        vertices: &[Vert],
        to: &[DVec3],
        faces: impl IntoIterator<Item = Face>,
        limit: f64,
    ) -> Option<f64> {
        let mut sum = 0.0;
        for f in faces {
            let triangle = self.edit.corners(f).map(|v| self.point_with(vertices, to, v));
            sum += self.allowed(f, triangle)?;
            if sum >= limit {
                return None;
            }
        }
        (sum < limit).then_some(sum)
    }

    /// Where `v` is with `vertices` moved `to` other places.
    pub(super) fn point_with(&self, vertices: &[Vert], to: &[DVec3], v: Vert) -> DVec3 {
        vertices.iter().position(|&w| w == v).map_or_else(|| self.edit.point(v), |i| to[i])
    }

    /// Whether a vertex opposite to `gone`-`kept` is joined to both by creases: these would become one.
    fn would_join_creases(&self, gone: Vert, kept: Vert, beside: [Face; 2]) -> bool {
        let opposite = beside.map(|f| self.edit.third(f, gone, kept));
        opposite.iter().any(|&v| self.is_crease(v, gone) && self.is_crease(v, kept))
    }

    /// Whether `point`, the middle of a crease edge, lies on the fits of the faces beside `a`-`b`.
    pub(super) fn is_on_its_fits(&self, point: DVec3, a: Vert, b: Vert) -> bool {
        let h = self.context.mean_edge;
        let is_near =
            |f: Face| self.fit(f).is_none_or(|fit| fit.evaluate(point, h).0.abs() <= CREASE_TOLERANCE);
        self.edit.faces_with(a, b).all(is_near)
    }

    /// What the other diagonal of the faces beside edge `a`-`b` of `f` gains. Either new triangle may
    /// follow either fit; the faces come in the order of the triangles.
    fn try_flip(&mut self, f: Face, a: Vert, b: Vert) -> Option<(f64, [Face; 2], [[Vert; 3]; 2])> {
        if self.is_crease(a, b) {
            return None;
        }
        let [_, g] =
            self.edit.faces_beside(a, b).filter(|beside| beside[0] == f && self.in_zone(beside[1]))?;
        let has_three = |v: Vert| !self.edit.has_four_neighbours(v);
        if has_three(a) || has_three(b) {
            return None;
        }
        let triangles = self.edit.on_other_diagonal([f, g], a, b)?;
        let points = triangles.map(|t| t.map(|v| self.edit.point(v)));
        let old = self.value_of(f) + self.value_of(g);
        let mut best: Option<(f64, [Face; 2])> = None;
        for faces in [[f, g], [g, f]] {
            let first = self.allowed(faces[0], points[0]);
            let second = self.allowed(faces[1], points[1]);
            if let (Some(first), Some(second)) = (first, second) {
                let gain = old - first - second;
                if gain > MIN_GAIN && best.is_none_or(|(most, _)| gain > most + ROUNDING) {
                    best = Some((gain, faces));
                }
            }
        }
        // Last, as it costs most: few flips gain.
        let best = best.filter(|_| !triangles.into_iter().any(|t| self.edit.is_turned(t)));
        best.map(|(gain, faces)| (gain, faces, triangles))
    }

    /// Merges crease edge `gone`-`kept`: to a point between them on their crease, or, where two corners
    /// nearly coincide, to one of them or their middle.
    fn try_merge(&mut self, gone: Vert, kept: Vert) -> Option<(f64, DVec3)> {
        if !self.is_crease(gone, kept) || !self.is_inner[gone] {
            return None;
        }
        let beside = self.edit.collapsible(gone, kept)?;
        if !self.edit.is_surrounded(kept) || self.would_join_creases(gone, kept, beside) {
            return None;
        }
        let (p, q) = (self.edit.point(gone), self.edit.point(kept));
        let next = |v: Vert, not: Vert| self.crease(v).iter().copied().find(|&w| w != not);
        let mut places: Vec<DVec3> = Vec::new();
        if self.is_along_crease(gone) && self.is_along_crease(kept) {
            let (w, z) = (next(gone, kept)?, next(kept, gone)?);
            if w != z {
                let between = [p.midpoint(q), self.edit.point(w).midpoint(self.edit.point(z))];
                places.extend(between.iter().filter_map(|&from| self.project(from, gone, kept)));
            }
        }
        let both_corners = self.crease(gone).len() >= 3 && self.crease(kept).len() >= 3;
        if both_corners && p.distance(q) < CORNER_MERGE * self.context.mean_edge {
            places.extend([q, p, p.midpoint(q)]);
        }
        let gains = places.into_iter().filter_map(|to| Some((self.merge_gain(gone, kept, beside, to)?, to)));
        gains.collect::<Vec<_>>().into_iter().reduce(|x, y| if y.0 > x.0 { y } else { x })
    }

    fn merge_gain(&mut self, gone: Vert, kept: Vert, beside: [Face; 2], to: DVec3) -> Option<f64> {
        let mut faces = [self.edit.faces_at(gone), self.edit.faces_at(kept)].concat();
        faces.sort_unstable();
        faces.dedup();
        let old: f64 = faces.iter().map(|&f| self.value_of(f)).sum();
        let others = faces.into_iter().filter(|f| !beside.contains(f));
        let new = self.energy_with(&[gone, kept], &[to; 2], others, old - MIN_GAIN)?;
        let stays_on_crease = |&v: &Vert| {
            self.crease(v)
                .iter()
                .filter(|&&w| w != gone && w != kept)
                .all(|&w| self.is_on_its_fits(to.midpoint(self.edit.point(w)), v, w))
        };
        [gone, kept].iter().all(stays_on_crease).then_some(old - new)
    }

    /// Moves an inserted vertex part of the way back to the middle of its edge or face.
    fn try_back(&mut self, v: Vert) -> Option<(f64, DVec3)> {
        let middle = self.context.refined.middles[v.index().checked_sub(self.n_old)?];
        let faces = self.edit.faces_at(v).to_vec();
        let old: f64 = faces.iter().map(|&f| self.value_of(f)).sum();
        let mut best: Option<(f64, DVec3)> = None;
        for share in BACK_SHARES {
            let to = self.edit.point(v).lerp(middle, share);
            let at = |w: Vert| if w == v { to } else { self.edit.point(w) };
            let energy = |&f: &Face| self.value(self.energy_of(self.edit.corners(f).map(at), f));
            let new: f64 = faces.iter().map(energy).sum();
            if new < old - BACK_GAIN && best.is_none_or(|(least, _)| new < least - FURTHER_BACK_GAIN) {
                best = Some((new, to));
            }
        }
        best.map(|(new, to)| (old - new, to))
    }
}

/// Adds `v` to an ascending list, once.
fn join(list: &mut Vec<Vert>, v: Vert) {
    if let Err(at) = list.binary_search(&v) {
        list.insert(at, v);
    }
}
