//! The neighbourhood of one doubtful vertex, and the smooth regions in it (step 3).

use glam::DVec3;

use super::Surface;
use crate::mesh::Vert;

/// Every vertex this far (in h) from the centre is in the patch. By distance and not by rings: on slivers
/// rings mean nothing (error ratio 1.5 h .377, 2.2 h .264, 3 h .169).
const REACH: f64 = 3.0;
/// Within a smooth region the patch goes on to this distance (in h), so that fits rest on enough samples.
const REACH_IN_REGION: f64 = 4.5;
/// A patch of evenly spaced vertices has some 80 of them, one full of slivers 300. More are of no use, and
/// a mesh with most of its vertices in one place would take time in the square of their number.
pub(super) const MAX_MEMBERS: usize = 1024;

/// A vertex of the patch.
struct Member {
    vertex: Vert,
    offset: DVec3,
    /// Square of its distance from the centre, in units of h².
    distance_squared: f64,
    is_interior: bool,
    /// Another member of its cluster with a lower place, or itself.
    parent: u32,
}

/// The interior vertices of the patch that are joined within it: one smooth region.
#[derive(Clone, Copy)]
pub(super) struct Cluster {
    root: u32,
    nearest_squared: f64,
    nearest: Vert,
}

impl Cluster {
    /// From the centre to the nearest vertex of the cluster, in h.
    pub fn distance(&self) -> f64 {
        self.nearest_squared.sqrt()
    }
}

/// Finds patches one after the other in the same memory.
#[derive(Default)]
pub(super) struct Patch {
    members: Vec<Member>,
    clusters: Vec<Cluster>,
    table: Table,
}

impl Patch {
    /// Searches breadth first from `centre`, by edges.
    pub fn search(&mut self, surface: &Surface, centre: Vert) {
        self.members.clear();
        self.table.clear();
        let origin = surface.mesh.point(centre);
        self.enter(surface, centre, DVec3::ZERO);
        let mut next = 0;
        while let Some(member) = self.members.get(next) {
            let is_interior = member.is_interior;
            for &w in surface.neighbours.of_vertex(member.vertex) {
                if let Some(known) = self.table.get(w) {
                    // Each edge is seen from both ends, the second time with both ends known.
                    if (known as usize) < next && is_interior && self.members[known as usize].is_interior {
                        self.join(known, next as u32);
                    }
                    continue;
                }
                let offset = (surface.mesh.point(w) - origin) / surface.h;
                let distance_squared = offset.length_squared();
                let is_near = distance_squared <= REACH * REACH
                    || (distance_squared <= REACH_IN_REGION * REACH_IN_REGION
                        && is_interior
                        && surface.interior[w]);
                if is_near && self.members.len() < MAX_MEMBERS {
                    self.enter(surface, w, offset);
                }
            }
            next += 1;
        }
        self.find_clusters();
    }

    fn enter(&mut self, surface: &Surface, vertex: Vert, offset: DVec3) {
        let place = self.members.len() as u32;
        let is_interior = surface.interior[vertex];
        let distance_squared = offset.length_squared();
        self.members.push(Member { vertex, offset, distance_squared, is_interior, parent: place });
        self.table.insert(vertex, place);
    }

    fn root(&mut self, mut place: u32) -> u32 {
        while self.members[place as usize].parent != place {
            let parent = self.members[place as usize].parent;
            let grandparent = self.members[parent as usize].parent;
            self.members[place as usize].parent = grandparent;
            place = grandparent;
        }
        place
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.members[a.max(b) as usize].parent = a.min(b);
    }

    fn find_clusters(&mut self) {
        self.clusters.clear();
        for place in 0..self.members.len() as u32 {
            if !self.members[place as usize].is_interior {
                continue;
            }
            let root = self.root(place);
            let Member { vertex, distance_squared, .. } = self.members[place as usize];
            // A root comes before the other members of its cluster.
            if root == place {
                self.clusters.push(Cluster { root, nearest_squared: distance_squared, nearest: vertex });
                continue;
            }
            let is_its = |cluster: &&mut Cluster| cluster.root == root;
            let nearer = |cluster: &&mut Cluster| {
                (distance_squared, vertex) < (cluster.nearest_squared, cluster.nearest)
            };
            if let Some(cluster) = self.clusters.iter_mut().find(is_its).filter(nearer) {
                (cluster.nearest_squared, cluster.nearest) = (distance_squared, vertex);
            }
        }
        self.clusters.retain(|cluster| cluster.nearest_squared <= REACH * REACH);
        self.clusters.sort_unstable_by(|a, b| {
            a.nearest_squared.total_cmp(&b.nearest_squared).then(a.nearest.cmp(&b.nearest))
        });
    }

    /// The clusters that come within reach, the nearest first.
    pub fn clusters(&self) -> &[Cluster] {
        &self.clusters
    }

    /// The cluster that the centre itself belongs to, if it is an interior vertex.
    pub fn own_cluster(&self) -> Option<Cluster> {
        // The centre was entered first, so it is the root of its cluster.
        self.clusters.iter().copied().find(|cluster| cluster.root == 0)
    }

    /// The members of `cluster` with their offsets from the centre, in h.
    pub fn members(&mut self, cluster: Cluster) -> impl Iterator<Item = (Vert, DVec3)> {
        for place in 0..self.members.len() as u32 {
            let root = self.root(place);
            self.members[place as usize].parent = root;
        }
        let is_member = move |member: &&Member| member.is_interior && member.parent == cluster.root;
        self.members.iter().filter(is_member).map(|member| (member.vertex, member.offset))
    }
}

/// Where each vertex of the patch stands in it: open addressing, at most half full.
struct Table {
    slots: Vec<(Vert, u32)>,
    n_used: usize,
}

impl Default for Table {
    fn default() -> Self {
        Self { slots: vec![(Vert::NONE, 0); 512], n_used: 0 }
    }
}

impl Table {
    fn clear(&mut self) {
        self.slots.fill((Vert::NONE, 0));
        self.n_used = 0;
    }

    /// The slot that holds `v`, or the free one where it belongs.
    #[inline]
    fn slot(&self, v: Vert) -> usize {
        let mask = self.slots.len() - 1;
        // Fibonacci hashing: neighbouring indices are spread over the table.
        let mut slot = (v.index().wrapping_mul(0x9E37_79B9) >> 8) & mask;
        while self.slots[slot].0 != v && self.slots[slot].0.is_some() {
            slot = (slot + 1) & mask;
        }
        slot
    }

    #[inline]
    fn get(&self, v: Vert) -> Option<u32> {
        let (vertex, place) = self.slots[self.slot(v)];
        vertex.is_some().then_some(place)
    }

    fn insert(&mut self, v: Vert, place: u32) {
        if 2 * (self.n_used + 1) > self.slots.len() {
            let larger = vec![(Vert::NONE, 0); 2 * self.slots.len()];
            for (vertex, place) in std::mem::replace(&mut self.slots, larger) {
                if vertex.is_some() {
                    let slot = self.slot(vertex);
                    self.slots[slot] = (vertex, place);
                }
            }
        }
        let slot = self.slot(v);
        self.slots[slot] = (v, place);
        self.n_used += 1;
    }
}
