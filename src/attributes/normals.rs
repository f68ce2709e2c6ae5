//! Normals anew where the surface changed.
//!
//! A vertex is touched when one of its faces is new or has moved. The corners at a touched vertex fall
//! into sectors: the corners on both sides of an edge are in one sector unless the edge is sharp or the
//! file had different normals on its sides. Each sector gets the mean of its faces' normals, weighted by
//! their angles. Where the file has no normal, none is made.
//!
//! Cost: O(F) if there are normals.

use glam::DVec3;

use super::carry::Step;
use super::{Attributes, Channel};
use crate::geometry::{inner_angles, unit_normal};
use crate::mesh::{Half, Mesh, PerFace, PerHalf, PerVert, Vert};
use crate::refine::Place;
use crate::tags::Tags;

/// The columns that hold one normal per vertex.
const COLUMNS: [&str; 3] = ["nx", "ny", "nz"];

impl Attributes {
    /// Computes the normals at touched vertices; the others were carried already.
    pub(super) fn renew_normals(&mut self, step: &Step, intact: &PerFace<bool>, sharp: &[[Vert; 2]]) {
        let has_columns = self.columns(COLUMNS).is_some();
        if self.normals.at.is_empty() && !has_columns {
            return;
        }
        let mesh = step.new;
        let touched = touched_verts(step, intact);
        if !self.normals.at.is_empty() {
            let is_sharp = Tags::new(sharp.iter().copied(), []).sharp_halves(mesh);
            for v in mesh.verts().filter(|&v| touched[v]) {
                renew_at(v, step, &is_sharp, &mut self.normals);
            }
        }
        if has_columns {
            self.renew_columns(mesh, &touched);
        }
    }

    /// One normal per (file) vertex, from all its faces.
    fn renew_columns(&mut self, mesh: &Mesh, touched: &PerVert<bool>) {
        let n_verts = self.split.as_ref().map_or(mesh.n_verts(), |split| split.joined_in.len());
        let mut sums = vec![DVec3::ZERO; n_verts];
        for h in mesh.halves().filter(|&h| touched[mesh.from(h)]) {
            let v = self.split.as_ref().map_or(mesh.from(h), |split| split.at[h]);
            sums[v.index()] += weighted_normal(mesh, h);
        }
        for (axis, name) in COLUMNS.into_iter().enumerate() {
            let Some(column) = self.vertex_columns.iter_mut().find(|column| column.name == name) else {
                return;
            };
            for (value, sum) in column.values.iter_mut().zip(&sums) {
                if let Some(normal) = sum.try_normalize() {
                    *value = normal[axis];
                }
            }
        }
    }
}

/// The vertices of faces that are new or have a corner that moved.
fn touched_verts(step: &Step, intact: &PerFace<bool>) -> PerVert<bool> {
    let mesh = step.new;
    let has_moved = |v: Vert| step.old.point(v) != mesh.point(v);
    let mut touched = PerVert::filled(mesh.n_verts(), false);
    for f in mesh.face_ids() {
        if !intact[f] || mesh.corners(f).into_iter().any(has_moved) {
            for v in mesh.corners(f) {
                touched[v] = true;
            }
        }
    }
    touched
}

/// The normal of the face of `h`, times its angle at the corner that `h` leaves.
fn weighted_normal(mesh: &Mesh, h: Half) -> DVec3 {
    let triangle = mesh.triangle(h.face());
    unit_normal(triangle).map_or(DVec3::ZERO, |normal| normal * inner_angles(triangle)[h.corner()])
}

/// A normal within this distance of the carried one is the same: files have as few as four decimals.
const SAME: f64 = 2e-4;

/// Gives each sector at `v` a normal of its own, or leaves it the carried one if that still holds.
fn renew_at(v: Vert, step: &Step, is_sharp: &PerHalf<bool>, normals: &mut Channel) {
    for mut sector in sectors(v, step, is_sharp, normals) {
        sector.sort_unstable();
        let normal = match *sector {
            [h] => unit_normal(step.new.triangle(h.face())),
            _ => sector.iter().map(|&h| weighted_normal(step.new, h)).sum::<DVec3>().try_normalize(),
        };
        sector.retain(|&h| normals.at[h] != Channel::NONE);
        let (Some(normal), Some(&first)) = (normal, sector.first()) else { continue };
        // Without a sign before zero.
        let normal = normal + DVec3::ZERO;
        let is_foreign = |h: Half| step.lineage.corners[h] == Place::Foreign;
        let carried = normals.at[sector.iter().copied().find(|&h| !is_foreign(h)).unwrap_or(first)];
        let value = |entry: u32| DVec3::from(normals.values[entry as usize]);
        // The corners of a flat face have one entry in common.
        let of_face = first.face().halves().map(|h| normals.at[h]).into_iter();
        let of_face = of_face.filter(|&entry| entry != Channel::NONE).find(|&entry| value(entry) == normal);
        let entry = if value(carried).distance(normal) < SAME {
            carried
        } else {
            of_face.unwrap_or_else(|| normals.push(normal.to_array(), 3))
        };
        sector.iter().for_each(|&h| normals.at[h] = entry);
    }
}

/// The corners at `v`, as the half-edges that leave it, in runs without a sharp or split edge.
fn sectors(v: Vert, step: &Step, is_sharp: &PerHalf<bool>, normals: &Channel) -> Vec<Vec<Half>> {
    let mesh = step.new;
    let value = |h: Half| match normals.at[h] {
        Channel::NONE => None,
        entry => Some(normals.values[entry as usize].map(f64::to_bits)),
    };
    let is_foreign = |h: Half| step.lineage.corners[h] == Place::Foreign;
    let is_smooth = |g: Half, h: Half| is_foreign(g) || is_foreign(h) || value(g) == value(h);
    // The edge between a corner and the next one counter-clockwise is that of the previous half-edge.
    let ccw = |h: Half| mesh.rotate_ccw(h).filter(|&next| !is_sharp[h.prev()] && is_smooth(h, next));
    let cw = |h: Half| mesh.rotate_cw(h).filter(|&next| !is_sharp[h] && is_smooth(h, next));

    let corners = mesh.leaving(v);
    let mut is_taken = vec![false; corners.len()];
    let mut take = |h: &Half| {
        let i = corners.binary_search(h).unwrap_or_default();
        !std::mem::replace(&mut is_taken[i], true)
    };
    let mut sectors = Vec::new();
    for &start in corners {
        if take(&start) {
            let mut sector = vec![start];
            sector.extend(std::iter::successors(ccw(start), |&h| ccw(h)).take_while(&mut take));
            sector.extend(std::iter::successors(cw(start), |&h| cw(h)).take_while(&mut take));
            sectors.push(sector);
        }
    }
    sectors
}
