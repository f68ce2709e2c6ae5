//! Holds new vertices back where faces would turn over.
//!
//! Based on: nothing; the papers are silent. Plain Butterfly turns thousands of faces over on a mesh full
//! of slivers, because what is a small displacement along an edge is a large one across a sliver.
//!
//! All in the middle is always safe: then each child lies in its parent. So each new vertex starts where it
//! wants to be, and in each round every face looks at its children; the new vertices of a child that has
//! turned too far halve their way, at the fourth objection they stay in the middle. A round reads only
//! what the round before left, so that no order matters; it ends because ways only grow shorter.
//!
//! Rejected: a limit by the heights of the triangles at the edge needs no rounds, but takes from curved
//! surfaces what it should not: at a quarter of the height 2 to 7 percentage points of the L2 error come
//! back (cylinder mi_8k .670 instead of .604 of the error without bending), at a tenth 7 to 11.
//! In/out: shifts `[N]` -> points `[N]`.
//! Cost: O(F) for the first round, then only faces beside vertices that moved; about six rounds.

use glam::DVec3;
use rayon::prelude::*;

use crate::mesh::{Face, Half, Mesh, PerFace, has_repeated_vertex};
use crate::refine::Inserts;
use crate::stencil::Stencils;

/// A child may turn this far against its parent: 60 degrees. This is what makes the pass safe whatever the
/// normals round about are worth; where they are worth something the next rule fires first, and without
/// this one no figure on 31 inputs changes.
const MAX_TURN_COS: f64 = 0.5;
/// A child may turn this far against the surface round its parent, or as far as the parent has: 45 degrees.
/// Slivers have normals of their own, and without this rule they turn over little by little (fandisk
/// mi_20k_n05: 460 flipped faces, with it 388, in the middle 401). 20 degrees gains nothing more.
const MAX_OFF_SURFACE_COS: f64 = std::f64::consts::FRAC_1_SQRT_2;
/// No two children may fold by more than this on their common edge, 150 degrees, or than their parents do.
/// A measured fold is 170 degrees: what comes near may become one at the next level. It costs up to 0.2
/// percentage points of L2 (cylinder mi_8k .570, without .568).
const MAX_FOLD_COS: f64 = -0.866_025_403_784_438_6;

/// What is left of a new vertex's way after so many objections.
const WAY_LEFT: [f64; 4] = [1.0, 0.5, 0.25, 0.0];

/// New vertices on their way from the middles of their edges to where they want to be.
pub(super) struct Draft<'a> {
    mesh: &'a Mesh,
    inserts: &'a Inserts,
    /// The lowest half-edge of each new vertex. `[N]`
    edges: &'a [Half],
    /// Where each wants to be, from the middle. `[N]`
    shifts: Vec<DVec3>,
    /// How often a face has objected. `[N]`
    objections: Vec<u8>,
    /// Unit normals, zero where there is none. `[F]`
    parents: PerFace<DVec3>,
    /// The unit normal of each face with its neighbours across edges that are no cut. `[F]`
    surface: PerFace<DVec3>,
}

impl<'a> Draft<'a> {
    pub(super) fn new(
        mesh: &'a Mesh,
        stencils: &Stencils<'_>,
        inserts: &'a Inserts,
        edges: &'a [Half],
        shifts: Vec<DVec3>,
    ) -> Self {
        let faces = || (0..mesh.n_faces()).into_par_iter().map(Face::new);
        let area = |f: Face| {
            let [a, b, c] = mesh.triangle(f);
            (b - a).cross(c - a)
        };
        let areas: PerFace<DVec3> = faces().map(area).collect::<Vec<_>>().into();
        let beside = |h: &Half| mesh.twin(*h).filter(|_| !stencils.is_cut(*h)).map(|twin| areas[twin.face()]);
        let around = |f: Face| areas[f] + f.halves().iter().filter_map(beside).sum::<DVec3>();
        let surface: Vec<_> = faces().map(|f| around(f).normalize_or_zero()).collect();
        Self {
            mesh,
            inserts,
            edges,
            objections: vec![0; shifts.len()],
            shifts,
            parents: mesh.face_normals(),
            surface: surface.into(),
        }
    }

    /// Takes vertices back until no face objects; gives how many were.
    pub(super) fn retreat(&mut self) -> usize {
        let mesh = self.mesh;
        // Where nothing wants to move nobody has anything to object to.
        let is_still = |f: Face| self.has_no_way(f) && self.neighbours(f).all(|g| self.has_no_way(g));
        let all = (0..mesh.n_faces()).into_par_iter().map(Face::new);
        let mut faces: Vec<Face> = all.filter(|&f| !is_still(f)).collect();
        while !faces.is_empty() {
            let objections = faces.par_iter().flat_map_iter(|&f| self.objections(f));
            let mut halves: Vec<Half> = objections.map(|h| self.edges[self.slot(h)]).collect();
            halves.sort_unstable();
            halves.dedup();
            halves.retain(|&h| usize::from(self.objections[self.slot(h)]) + 1 < WAY_LEFT.len());
            faces.clear();
            for h in halves {
                let slot = self.slot(h);
                self.objections[slot] += 1;
                faces.extend([Some(h), mesh.twin(h)].into_iter().flatten().map(Half::face));
            }
            // An edge is looked at from one of its faces: the neighbours must look again as well.
            for i in 0..faces.len() {
                let beside = faces[i];
                faces.extend(self.neighbours(beside));
            }
            faces.par_sort_unstable();
            faces.dedup();
        }
        self.objections.iter().filter(|&&n| n > 0).count()
    }

    /// Where the new vertices are now.
    pub(super) fn into_points(self) -> Vec<DVec3> {
        (0..self.shifts.len()).into_par_iter().map(|slot| self.point(slot)).collect()
    }

    /// Whether all new vertices of `f` want to stay in the middle.
    fn has_no_way(&self, f: Face) -> bool {
        let stays = |h: Half| !self.inserts.on_edge[h].is_some() || self.shifts[self.slot(h)] == DVec3::ZERO;
        f.halves().into_iter().all(stays)
    }

    fn neighbours(&self, f: Face) -> impl Iterator<Item = Face> + '_ {
        f.halves().into_iter().filter_map(|h| self.mesh.twin(h)).map(Half::face)
    }

    fn slot(&self, h: Half) -> usize {
        self.inserts.on_edge[h].index() - self.mesh.n_verts()
    }

    fn point(&self, slot: usize) -> DVec3 {
        self.inserts.points[slot] + WAY_LEFT[usize::from(self.objections[slot])] * self.shifts[slot]
    }

    /// The half-edges whose new vertices should retreat, as far as face `f` is to say.
    fn objections(&self, f: Face) -> impl Iterator<Item = Half> + use<> {
        let halves = f.halves();
        let mut objections = [Half::NONE; 9];
        if !has_repeated_vertex(&self.mesh.corners(f)) {
            let children = self.children(f);
            let has_turned = children.map(|child| self.has_turned(f, child));
            let is_folded = |i: usize| children[i].dot(children[3]) < MAX_FOLD_COS;
            for i in 0..3 {
                // The child at corner i has its new vertices on half-edges i and i - 1.
                if has_turned[i] || has_turned[(i + 1) % 3] || has_turned[3] || (0..3).any(is_folded) {
                    objections[i] = halves[i];
                }
            }
            for i in 0..3 {
                let Some(twin) = self.mesh.twin(halves[i]).filter(|&twin| twin > halves[i]) else { continue };
                for (end, other) in self.folds_across(f, i, twin, &children).into_iter().enumerate() {
                    if let Some(other) = other {
                        objections[i] = halves[i];
                        let own = (i + if end == 0 { 2 } else { 1 }) % 3;
                        objections[own] = halves[own];
                        objections[3 + 2 * i + end] = other;
                    }
                }
            }
        }
        objections.into_iter().filter(|h| h.is_some())
    }

    /// Whether the children of both faces fold too far over the edge `i` of `f`, at its start and at its
    /// end: the other half-edge whose new vertex the neighbour's child has there.
    ///
    /// ```text
    ///            \   / own child
    ///     start --o-m-o-- end          m the new vertex, at both
    ///          ^ / \ ^ neighbour's child
    ///        other   other
    /// ```
    fn folds_across(&self, f: Face, i: usize, twin: Half, children: &[DVec3; 4]) -> [Option<Half>; 2] {
        let g = twin.face();
        let parents = self.parents[f].dot(self.parents[g]);
        if self.parents[f] == DVec3::ZERO || self.parents[g] == DVec3::ZERO {
            return [None; 2];
        }
        let neighbours = self.children(g);
        let limit = MAX_FOLD_COS.min(parents - 1e-9);
        let at_start = children[i].dot(neighbours[twin.next().corner()]) < limit;
        let at_end = children[(i + 1) % 3].dot(neighbours[twin.corner()]) < limit;
        [at_start.then_some(twin.next()), at_end.then_some(twin.prev())]
    }

    /// Whether a child with unit normal `child` has turned too far.
    fn has_turned(&self, f: Face, child: DVec3) -> bool {
        let (parent, surface) = (self.parents[f], self.surface[f]);
        // A parent without area, or a child: the dot product is zero.
        child.dot(parent) < MAX_TURN_COS
            || child.dot(surface) < MAX_OFF_SURFACE_COS.min(parent.dot(surface) - 1e-9)
    }

    /// The unit normals of the children of `f`: those at its three corners, then the inner one.
    fn children(&self, f: Face) -> [DVec3; 4] {
        let [a, b, c] = self.mesh.triangle(f);
        let [x, y, z] = f.halves().map(|h| self.point(self.slot(h)));
        let normal = |p: DVec3, q: DVec3, r: DVec3| (q - p).cross(r - p).normalize_or_zero();
        [normal(a, x, z), normal(b, y, x), normal(c, z, y), normal(x, y, z)]
    }
}
