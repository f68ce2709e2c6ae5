//! Carries attributes from a mesh to the mesh that a pass made of it.
//!
//! What belongs to a face goes to its children. A new corner mixes the corners of its parent, on each
//! side of a seam for itself: two sides that had the same entries at both ends of the split edge have
//! one entry in common at the new corner, too.
//!
//! Cost: O(F) for each channel that is there, nothing for others.

use std::collections::HashMap;

use super::{Attributes, Channel, Column, Mark, Polygons, Split, Statement};
use crate::mesh::{Face, Half, Mesh, PerFace, PerHalf, PerVert, Vert};
use crate::refine::{Lineage, Place};

/// The columns of whole numbers that are quantities, not labels: they mix.
const COLOURS: [&str; 4] = ["red", "green", "blue", "alpha"];

/// One rebuild: where each face and corner comes from.
pub(super) struct Step<'a> {
    pub lineage: &'a Lineage,
    pub old: &'a Mesh,
    pub new: &'a Mesh,
}

impl Step<'_> {
    /// The parent of the face of `h` and the weights of the parent's corners at the corner `h` leaves.
    pub fn weights(&self, h: Half) -> (Face, [f64; 3]) {
        let mut weights = [0.0; 3];
        match self.lineage.corners[h] {
            Place::Corner(i) => weights[i as usize] = 1.0,
            Place::Mid(i) => {
                weights[i as usize] = 0.5;
                weights[(i as usize + 1) % 3] = 0.5;
            }
            Place::Centre => weights = [1.0 / 3.0; 3],
            Place::Foreign => {
                let found = self.lineage.foreign.binary_search_by_key(&h, |&(half, _)| half);
                weights = found.map_or([1.0 / 3.0; 3], |i| self.lineage.foreign[i].1);
            }
        }
        (self.lineage.parents[h.face()], weights)
    }

    /// Which new faces are their parent, whole and with the same vertices in the same places.
    pub fn intact(&self) -> PerFace<bool> {
        let parents = self.lineage.parents.as_slice();
        let is_intact = |f: Face| {
            let i = f.index();
            let is_only = (i == 0 || parents[i - 1] != parents[i]) && parents.get(i + 1) != Some(&parents[i]);
            let place = |k: usize| self.lineage.corners[f.half(k)];
            let is_whole = (0..3).all(|k| place(k) == Place::Corner(k as u8));
            let is_same = self.new.corners(f) == self.old.corners(parents[i]);
            is_only && is_whole && is_same && self.new.triangle(f) == self.old.triangle(parents[i])
        };
        self.new.face_ids().map(is_intact).collect::<Vec<_>>().into()
    }
}

impl Attributes {
    /// The attributes of `new`, which a pass made of `old`. Also what could not be carried, one line each.
    ///
    /// Normals are computed anew at vertices whose faces changed, split along the edges `sharp` of `new`
    /// and where they were split before; all others stay.
    #[must_use]
    pub fn carry(
        mut self,
        lineage: &Lineage,
        old: &Mesh,
        new: &Mesh,
        sharp: &[[Vert; 2]],
    ) -> (Self, Vec<String>) {
        let mut notices = Vec::new();
        if self.is_plain() {
            return (self, notices);
        }
        let step = Step { lineage, old, new };
        let intact = step.intact();
        let (split, newcomers) = match &self.split {
            Some(split) => {
                let (split, newcomers) = step.carry_split(split);
                (Some(split), newcomers)
            }
            None => (None, step.new_verts()),
        };
        let n_verts = split.as_ref().map_or(new.n_verts(), |split| split.joined_in.len());
        for column in &mut self.vertex_columns {
            step.carry_vertex_column(column, self.split.as_ref(), &newcomers, n_verts);
        }
        for column in &mut self.face_columns {
            let parents = lineage.parents.as_slice().iter();
            column.values = parents.map(|parent| column.values[parent.index()]).collect();
        }
        self.split = split;
        step.carry_channel(&mut self.texture);
        step.carry_channel(&mut self.normals);
        step.carry_marks(&mut self.marks, n_verts, &mut notices);
        self.polygons = step.carry_polygons(&self.polygons, &intact);
        self.renew_normals(&step, &intact, sharp);
        self.texture.compact();
        self.normals.compact();
        (self, notices)
    }
}

impl Step<'_> {
    /// The vertices that are new, or new in the place of an old one, ascending, each with a corner of a
    /// new face that tells best where it comes from.
    fn new_verts(&self) -> Vec<(Vert, Half)> {
        const UNUSED: (u8, Half) = (u8::MAX, Half::NONE);
        let mut best = vec![UNUSED; self.new.n_verts()];
        for h in self.new.halves() {
            let v = self.new.from(h);
            let rank = match self.lineage.corners[h] {
                Place::Corner(i) if self.old.from(self.lineage.parents[h.face()].half(i as usize)) == v => 0,
                Place::Mid(_) => 1,
                Place::Centre => 2,
                Place::Corner(_) | Place::Foreign => 3,
            };
            best[v.index()] = best[v.index()].min((rank, h));
        }
        let source = |(v, best): (usize, (u8, Half))| match best {
            // Without a face it keeps its values, or has none if it is new.
            UNUSED | (0, _) => None,
            (_, h) => Some((Vert::new(v), h)),
        };
        best.into_iter().enumerate().filter_map(source).collect()
    }

    /// The file vertices of the new mesh: those of the old one, and for each new vertex one for each pair
    /// of file vertices that it lies between. Also the new ones, as [`new_verts`](Self::new_verts) does.
    fn carry_split(&self, split: &Split) -> (Split, Vec<(Vert, Half)>) {
        let mut files = FileVerts {
            at: PerHalf::filled(self.new.n_halves(), Vert::NONE),
            joined_in: split.joined_in.as_slice().to_vec(),
            first: PerVert::filled(self.new.n_verts(), Vert::NONE),
            newcomers: Vec::new(),
        };
        // Corners first: they show which slots of old vertices are free for new ones.
        let at_corner = |h: Half, i: u8| split.at[self.lineage.parents[h.face()].half(i as usize)];
        for h in self.new.halves() {
            let Place::Corner(i) = self.lineage.corners[h] else { continue };
            let (v, file_vert) = (self.new.from(h), at_corner(h, i));
            if split.joined_in[file_vert] == v {
                files.at[h] = file_vert;
                files.first[v] = files.first[v].min(file_vert);
            }
        }
        let mut between: HashMap<(Vert, Vert, Vert), Vert> = HashMap::new();
        for h in self.new.halves() {
            let Place::Mid(i) = self.lineage.corners[h] else { continue };
            let (v, a, b) = (self.new.from(h), at_corner(h, i), at_corner(h, (i + 1) % 3));
            let key = (v, a.min(b), a.max(b));
            files.at[h] = *between.entry(key).or_insert_with(|| files.add(v, h));
        }
        for h in self.new.halves().filter(|&h| !files.at[h].is_some()).collect::<Vec<_>>() {
            let v = self.new.from(h);
            files.at[h] = if files.first[v].is_some() { files.first[v] } else { files.add(v, h) };
        }
        files.put_in_order(split.joined_in.len());
        (Split { at: files.at, joined_in: files.joined_in.into() }, files.newcomers)
    }

    /// Mixes the values of the new vertices from those of their parent's corners.
    fn carry_vertex_column(
        &self,
        column: &mut Column,
        old_split: Option<&Split>,
        newcomers: &[(Vert, Half)],
        n_verts: usize,
    ) {
        let rounds = column.kind.is_whole();
        let mixes = !rounds || COLOURS.contains(&column.name.as_str());
        let value = |&(_, h): &(Vert, Half)| {
            let (parent, weights) = self.weights(h);
            let corner = |i: usize| {
                let half = parent.half(i);
                column.values[old_split.map_or(self.old.from(half), |split| split.at[half]).index()]
            };
            if mixes {
                let parts = (0..3).filter(|&i| weights[i] > 0.0).map(|i| weights[i] * corner(i));
                let mixed: f64 = parts.sum();
                if rounds { mixed.round() } else { mixed }
            } else {
                // A label: the nearest corner's, the first one's of several.
                corner((1..3).fold(0, |best, i| if weights[i] > weights[best] { i } else { best }))
            }
        };
        let values: Vec<f64> = newcomers.iter().map(value).collect();
        column.values.resize(n_verts, f64::NAN);
        for ((v, _), value) in newcomers.iter().zip(values) {
            column.values[v.index()] = value;
        }
    }

    /// Finds the entries of the new corners and adds those between old ones.
    fn carry_channel(&self, channel: &mut Channel) {
        if channel.at.is_empty() {
            return;
        }
        let old_at = std::mem::take(&mut channel.at);
        let mut at = Vec::with_capacity(self.new.n_halves());
        let mut between: HashMap<(u32, u32), u32> = HashMap::new();
        let mut last_centre = (Face::NONE, Channel::NONE);
        for h in self.new.halves() {
            if let Place::Corner(i) = self.lineage.corners[h] {
                at.push(old_at[self.lineage.parents[h.face()].half(i as usize)]);
                continue;
            }
            let (parent, weights) = self.weights(h);
            let corners = parent.halves().map(|half| old_at[half]);
            if (0..3).any(|i| weights[i] > 0.0 && corners[i] == Channel::NONE) {
                at.push(Channel::NONE);
                continue;
            }
            at.push(match self.lineage.corners[h] {
                Place::Mid(i) => {
                    let (a, b) = (corners[i as usize], corners[(i as usize + 1) % 3]);
                    let (a, b) = (a.min(b), a.max(b));
                    let mut mix = || channel.mix([a, b, b], [0.5, 0.5, 0.0]);
                    if a == b { a } else { *between.entry((a, b)).or_insert_with(&mut mix) }
                }
                Place::Centre => {
                    if last_centre.0 != parent {
                        last_centre = (parent, channel.mix(corners, weights));
                    }
                    last_centre.1
                }
                Place::Corner(_) | Place::Foreign => channel.mix(corners, weights),
            });
        }
        channel.at = at.into();
    }

    /// Puts each mark before the first face that comes from the face it stood before, or from a later one.
    fn carry_marks(&self, marks: &mut Vec<Mark>, n_verts: usize, notices: &mut Vec<String>) {
        let parents = self.lineage.parents.as_slice();
        for mark in marks.iter_mut() {
            mark.face = parents.partition_point(|parent| parent.index() < mark.face as usize) as u32;
        }
        let before = marks.len();
        marks.retain(|mark| match &mark.what {
            Statement::Text(_) => true,
            Statement::Line(corners) => corners.iter().all(|(v, _)| v.index() < n_verts),
            Statement::Points(points) => points.iter().all(|v| v.index() < n_verts),
        });
        if marks.len() < before {
            let count = before - marks.len();
            notices.push(format!("left out: {count} lines or points whose vertices are gone"));
        }
    }

    /// The polygons whose triangles are all intact.
    fn carry_polygons(&self, polygons: &Polygons, intact: &PerFace<bool>) -> Polygons {
        let parents = self.lineage.parents.as_slice();
        let mut carried = Polygons::default();
        for (first, sides) in polygons.iter() {
            let n = sides.len() - 2;
            let now = parents.partition_point(|parent| parent.index() < first);
            let is_whole = |i: usize| {
                parents.get(now + i).is_some_and(|parent| parent.index() == first + i)
                    && intact[Face::new(now + i)]
            };
            if (0..n).all(is_whole) {
                carried.push(now, sides.iter().map(|h| Half::new(h.index() - 3 * first + 3 * now)));
            }
        }
        carried
    }
}

/// File vertices while they are made.
struct FileVerts {
    at: PerHalf<Vert>,
    joined_in: Vec<Vert>,
    /// The lowest file vertex of each vertex of the new mesh, or the first new one.
    first: PerVert<Vert>,
    newcomers: Vec<(Vert, Half)>,
}

impl FileVerts {
    /// A file vertex for the mesh's vertex `v`, seen at `h`: in the slot of a vertex that is gone, if `v`
    /// has taken such a slot in the mesh.
    fn add(&mut self, v: Vert, h: Half) -> Vert {
        let has_slot = !self.first[v].is_some() && self.joined_in.get(v.index()) == Some(&v);
        let added = if has_slot { v } else { Vert::new(self.joined_in.len()) };
        if !has_slot {
            self.joined_in.push(v);
        }
        self.first[v] = self.first[v].min(added);
        self.newcomers.push((added, h));
        added
    }

    /// Numbers the vertices from `start` on in the mesh's order: first one for each vertex of the mesh, as
    /// if nothing was joined, then the further ones.
    fn put_in_order(&mut self, start: usize) {
        let is_further = |&i: &usize| self.first[self.joined_in[i]].index() != i;
        let mut order: Vec<usize> = (start..self.joined_in.len()).collect();
        order.sort_by_key(|i| (is_further(i), self.joined_in[*i]));
        let mut now: Vec<Vert> = (0..self.joined_in.len()).map(Vert::new).collect();
        for (rank, &i) in order.iter().enumerate() {
            now[i] = Vert::new(start + rank);
        }
        self.at.as_mut_slice().iter_mut().for_each(|v| *v = now[v.index()]);
        self.newcomers.iter_mut().for_each(|(v, _)| *v = now[v.index()]);
        self.newcomers.sort_unstable();
        let joined: Vec<Vert> = order.iter().map(|&i| self.joined_in[i]).collect();
        self.joined_in.truncate(start);
        self.joined_in.extend(joined);
    }
}

impl Channel {
    /// The mean of three entries, weighted: a new entry, unless they are all the same.
    fn mix(&mut self, entries: [u32; 3], weights: [f64; 3]) -> u32 {
        let mut used =
            entries.into_iter().zip(weights).filter(|&(_, weight)| weight > 0.0).map(|(entry, _)| entry);
        let bits = |entry: u32| (self.values[entry as usize].map(f64::to_bits), self.widths[entry as usize]);
        if let Some(first) = used.next()
            && used.all(|entry| bits(entry) == bits(first))
        {
            return first;
        }
        let mut value = [0.0; 3];
        let mut width = 0;
        for (entry, weight) in entries.into_iter().zip(weights).filter(|&(_, weight)| weight > 0.0) {
            let part = self.values[entry as usize];
            value = [0, 1, 2].map(|k| value[k] + weight * part[k]);
            width = width.max(self.widths[entry as usize]);
        }
        self.push(value, width)
    }

    /// Drops the entries that are neither the file's nor used by a corner.
    pub(super) fn compact(&mut self) {
        let mut now = vec![Self::NONE; self.values.len() - self.from_file];
        for &entry in self.at.as_slice().iter().filter(|&&entry| entry != Self::NONE) {
            if let Some(used) = (entry as usize).checked_sub(self.from_file) {
                now[used] = 0;
            }
        }
        let mut next = self.from_file;
        for (i, now) in now.iter_mut().enumerate().filter(|(_, now)| **now == 0) {
            *now = next as u32;
            self.values[next] = self.values[self.from_file + i];
            self.widths[next] = self.widths[self.from_file + i];
            next += 1;
        }
        self.values.truncate(next);
        self.widths.truncate(next);
        for entry in self.at.as_mut_slice().iter_mut().filter(|entry| **entry != Self::NONE) {
            if let Some(used) = (*entry as usize).checked_sub(self.from_file) {
                *entry = now[used];
            }
        }
    }
}
