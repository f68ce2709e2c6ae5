//! The smooth regions in the neighbourhood of one doubtful vertex (step 3).
//!
//! ```text
//!   N---N---N . . M---M      N, M  the clusters of the patch of v: members of regions that edges join within it
//!   | / | /  .  v  . \ |      .   doubtful vertices, over which the search goes on
//!   N---N . . . . . . M      Parts of a region that are joined only beyond the patch are two clusters: a thin plate has
//!                            two sides, however they meet elsewhere.
//! ```
//!
//! Based on: nothing in the papers.
//! In/out: `Surface`, a set of regions and a vertex -> clusters, the nearest first.
//! Cost: O(vertices of the patch), at most [`MAX_MEMBERS`]; no allocation once the lists have grown.

use std::ops::Range;

use glam::DVec3;

use super::Surface;
use super::near::Near;
use crate::mesh::Vert;

/// Every vertex this far (in h) from the centre is in the patch. By distance and not by rings: on slivers
/// rings mean nothing (error ratio 1.5 h .377, 2.2 h .264, 3 h .169).
const REACH: f64 = 3.0;
/// Within a smooth region the patch goes on to this distance (in h), so that fits rest on enough samples.
pub(super) const REACH_IN_REGION: f64 = 4.5;
/// A patch of evenly spaced vertices has some 80 of them, one full of slivers 300. More are of no use, and
/// a mesh with most of its vertices in one place would take time in the square of their number.
pub(super) const MAX_MEMBERS: usize = 1024;

/// The square of a distance that follows from others may be less than so many times what follows: more than rounding
/// to [`f32`] makes of it.
const ROUNDING_SLACK: f64 = 1.001;

/// What the regions of a patch consist of. Vertices go by their numbers among the near ones.
pub(super) trait Regions {
    /// Whether `v` is part of a region.
    fn is_member(&self, v: u32) -> bool;
    /// Whether the neighbours `v` and `w`, both part of a region, are part of the same one.
    fn are_joined(&self, v: u32, w: u32) -> bool;
}

/// The interior vertices alone, joined by any edge.
impl Regions for Surface<'_> {
    #[inline]
    fn is_member(&self, v: u32) -> bool {
        self.near.interior[v as usize]
    }

    #[inline]
    fn are_joined(&self, _: u32, _: u32) -> bool {
        true
    }
}

/// A vertex of a region in the patch.
#[derive(Clone, Copy)]
pub(super) struct Member {
    /// Its number among the near vertices.
    pub near: u32,
    /// The square of how far it is from the centre, roughly.
    squared: f32,
}

/// The members of regions in the patch that are joined within it: one smooth region.
#[derive(Clone)]
pub(super) struct Cluster {
    members: Range<usize>,
    nearest: Vert,
    nearest_squared: f64,
}

impl Cluster {
    /// From the centre to the nearest vertex of the cluster.
    pub fn distance(&self) -> f64 {
        self.nearest_squared.sqrt()
    }
}

/// Finds patches one after the other in the same memory.
#[derive(Default)]
pub(super) struct Patch {
    /// The members of regions, cluster by cluster.
    members: Vec<Member>,
    clusters: Vec<Cluster>,
    /// The other vertices, by their numbers among the near ones.
    doubtful: Vec<u32>,
    /// Members of a region found beside another one, some of them more than once, by their numbers.
    seeds: Vec<u32>,
    known: Stamps,
    /// Those of one vertex's neighbours that are not known, of a member of a region and of another vertex.
    fresh: Vec<u32>,
    fresh_beside: Vec<u32>,
    centre: DVec3,
    /// The squares of how far the search goes.
    reach: f64,
    reach_in_region: f64,
}

impl Patch {
    /// Searches the patch of `centre`, by edges, so much wider. Round a member of a region it finds nothing but that
    /// region.
    ///
    /// A region is flooded to its end as soon as the search comes upon it, so that it is found once and
    /// whole; doubtful vertices wait until then, and regions that are joined to none of these even longer.
    pub fn search(&mut self, surface: &Surface, regions: &impl Regions, centre: Vert, wider: f64) {
        self.members.clear();
        self.clusters.clear();
        self.doubtful.clear();
        self.seeds.clear();
        self.known.clear(surface.near.verts.len());
        let centre = surface.near.of[centre];
        let reach = |times: f64| (times * surface.h + wider).powi(2);
        (self.reach, self.reach_in_region) = (reach(REACH), reach(REACH_IN_REGION));
        self.centre = surface.near.points[centre as usize];
        self.known.insert(centre);
        if regions.is_member(centre) {
            self.flood_region(surface, regions, centre, centre);
            return;
        }
        self.doubtful.push(centre);
        let mut next = 0;
        while self.room() > 0 {
            if let Some(&v) = self.doubtful.get(next) {
                next += 1;
                let n_fresh = self.known.pick_others(surface.near.neighbours(v), &mut self.fresh_beside);
                for i in 0..n_fresh {
                    self.enter(surface, regions, centre, self.fresh_beside[i], self.reach);
                }
            } else if let Some(seed) = self.seeds.pop() {
                self.enter(surface, regions, centre, seed, f64::INFINITY);
            } else {
                break;
            }
        }
        sort_within(&mut self.clusters, self.reach);
    }

    /// How many more vertices the patch may have.
    fn room(&self) -> usize {
        MAX_MEMBERS - self.members.len() - self.doubtful.len()
    }

    /// Takes `v` into the patch, and the region that it is part of, unless it is known or farther away than
    /// the root of `reach`.
    #[inline]
    fn enter(&mut self, surface: &Surface, regions: &impl Regions, centre: u32, v: u32, reach: f64) {
        let points = &surface.near.points;
        if self.known.contains(v) {
            return;
        }
        let squared = points[v as usize].distance_squared(points[centre as usize]);
        if squared > reach || self.room() == 0 {
            return;
        }
        self.known.insert(v);
        if regions.is_member(v) {
            self.flood_region(surface, regions, centre, v);
        } else {
            self.doubtful.push(v);
        }
    }

    /// Makes a cluster of the members of regions that are joined to `seed` (known already) within reach, and
    /// notes the other vertices beside it.
    fn flood_region(&mut self, surface: &Surface, regions: &impl Regions, centre: u32, seed: u32) {
        let near = &surface.near;
        let (verts, points) = (&near.verts[..], &near.points[..]);
        let mut room = self.room();
        let Self { members, doubtful, seeds, known, fresh, reach, reach_in_region, .. } = self;
        let origin = points[centre as usize];
        let squared_to = |i: u32| points[i as usize].distance_squared(origin);
        let first = members.len();
        let mut next = first;
        let (mut nearest, mut nearest_squared) = (verts[seed as usize], squared_to(seed));
        members.push(Member { near: seed, squared: nearest_squared as f32 });
        room -= 1;
        'flood: while let Some(&Member { near: from, .. }) = members.get(next) {
            let n_fresh = known.pick_others(near.neighbours(from), fresh);
            for &i in &fresh[..n_fresh] {
                let squared = squared_to(i);
                let is_member = regions.is_member(i);
                if squared > if is_member { *reach_in_region } else { *reach } {
                    known.insert(i); // Out of reach from wherever else the search comes upon it.
                    continue;
                }
                if room == 0 {
                    break 'flood;
                }
                if is_member && !regions.are_joined(from, i) {
                    seeds.push(i);
                    continue;
                }
                known.insert(i);
                room -= 1;
                if is_member {
                    members.push(Member { near: i, squared: squared as f32 });
                    let vert = verts[i as usize];
                    if squared < nearest_squared || squared == nearest_squared && vert < nearest {
                        (nearest, nearest_squared) = (vert, squared);
                    }
                } else {
                    doubtful.push(i);
                }
            }
            next += 1;
        }
        self.clusters.push(Cluster { members: first..members.len(), nearest, nearest_squared });
    }

    /// The clusters, the nearest first. All of them come within reach.
    pub fn clusters(&self) -> &[Cluster] {
        &self.clusters
    }

    /// Puts into `seen` those clusters that come within reach of `origin`, as far from there as they are and the
    /// nearest first. It has to lie within what the search was wider by.
    pub fn clusters_from(&self, surface: &Surface, origin: DVec3, seen: &mut Vec<Cluster>) {
        let Near { verts, points, .. } = &surface.near;
        seen.clear();
        let moved = self.centre.distance(origin);
        for cluster in &self.clusters {
            // Some member is within the distance and `moved` of `origin`: so the nearest one is within `moved` more of the
            // centre.
            let most = (ROUNDING_SLACK * (cluster.distance() + 2.0 * moved).powi(2)) as f32;
            let (mut nearest_squared, mut nearest) = (f64::INFINITY, Vert::new(0));
            for member in self.members(cluster).iter().filter(|member| member.squared <= most) {
                let (point, vert) = (points[member.near as usize], verts[member.near as usize]);
                let squared = point.distance_squared(origin);
                if squared < nearest_squared || squared == nearest_squared && vert < nearest {
                    (nearest_squared, nearest) = (squared, vert);
                }
            }
            seen.push(Cluster { members: cluster.members.clone(), nearest, nearest_squared });
        }
        sort_within(seen, (REACH * surface.h).powi(2));
    }

    /// The members of `cluster`.
    pub fn members(&self, cluster: &Cluster) -> &[Member] {
        &self.members[cluster.members.clone()]
    }
}

/// Sorts clusters by how far they are, without those farther than the root of `reach`.
fn sort_within(clusters: &mut Vec<Cluster>, reach: f64) {
    clusters.retain(|cluster| cluster.nearest_squared <= reach);
    clusters.sort_unstable_by(|a, b| {
        a.nearest_squared.total_cmp(&b.nearest_squared).then(a.nearest.cmp(&b.nearest))
    });
}

/// A set of numbers that is emptied at no cost: those are in it that carry the present stamp.
#[derive(Default)]
struct Stamps {
    stamps: Vec<u32>,
    present: u32,
}

impl Stamps {
    /// Empties the set, and makes room for numbers below `n`.
    fn clear(&mut self, n: usize) {
        if self.stamps.len() != n || self.present == u32::MAX {
            *self = Self { stamps: vec![0; n], present: 0 };
        }
        self.present += 1;
    }

    #[inline]
    fn contains(&self, i: u32) -> bool {
        self.stamps[i as usize] == self.present
    }

    /// Puts those of `all` that are not in it at the front of `others`, and says how many they are. Without a branch: one
    /// in five is, and no processor guesses which.
    #[inline]
    fn pick_others(&self, all: &[u32], others: &mut Vec<u32>) -> usize {
        if others.len() < all.len() {
            others.resize(all.len(), 0);
        }
        let mut n = 0;
        for &i in all {
            others[n] = i;
            n += usize::from(!self.contains(i));
        }
        n
    }

    #[inline]
    fn insert(&mut self, i: u32) {
        self.stamps[i as usize] = self.present;
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::mesh::tests::mesh;
    use crate::mesh::{Mesh, PerFace};
    use crate::regions::near::Near;
    use crate::regions::tests::labels;

    /// A strip of squares along x, one h apart, and the interior flags of its columns.
    ///
    /// ```text
    ///   1---3---5---7---9-
    ///   | / | / | / | / |      column c: vertices 2c and 2c + 1
    ///   0---2---4---6---8-
    /// ```
    fn clusters(mesh: &Mesh, interior: &[usize], centre: usize) -> Vec<(f64, Vec<usize>)> {
        let (normals, labels) = labels(mesh);
        let mut surface = Surface::new(mesh, &normals, &labels);
        surface.h = 1.0;
        for v in mesh.verts() {
            surface.interior[v] = interior.contains(&(v.index() / 2));
        }
        surface.near = Near::around(&surface, &mesh.verts().collect::<Vec<_>>());
        let mut patch = Patch::default();
        patch.search(&surface, &surface, Vert::new(0), 0.0);
        patch.search(&surface, &surface, Vert::new(centre), 0.0);
        let members = |cluster: &Cluster| {
            let vertex = |m: &Member| surface.near.verts[m.near as usize];
            let mut verts: Vec<_> = patch.members(cluster).iter().map(|m| vertex(m).index()).collect();
            verts.sort_unstable();
            verts
        };
        patch.clusters().iter().map(|cluster| (cluster.distance(), members(cluster))).collect()
    }

    /// The strip of the picture above.
    pub(in crate::regions) fn strip(columns: usize) -> Mesh {
        let points: Vec<_> = (0..2 * columns).map(|i| [(i / 2) as f64, (i % 2) as f64, 0.0]).collect();
        let square = |c: usize| [[2 * c, 2 * c + 2, 2 * c + 3], [2 * c, 2 * c + 3, 2 * c + 1]];
        mesh(&points, &(0..columns - 1).flat_map(square).collect::<Vec<_>>())
    }

    #[test]
    fn two_regions_are_found_apart_and_the_nearer_one_first() {
        // From vertex 8 in column 4: columns 0 to 2 are 2 h away, columns 5 on 1 h. Within a region the
        // patch goes on to 4.5 h: to column 0, and to column 8 on the right.
        let found = clusters(&strip(12), &[0, 1, 2, 5, 6, 7, 8, 9, 10, 11], 8);
        let right = (10..=17).collect::<Vec<_>>();
        assert_eq!(found, [(1.0, right), (2.0, vec![0, 1, 2, 3, 4, 5])]);
    }

    #[test]
    fn a_region_beyond_reach_is_none() {
        assert_eq!(clusters(&strip(12), &[8, 9, 10, 11], 8), []);
        // Column 7 is 3 h away and in; from there the region is entered up to 4.5 h.
        assert_eq!(clusters(&strip(12), &[7, 8, 9, 10, 11], 8), [(3.0, vec![14, 15, 16, 17])]);
    }

    #[test]
    fn an_interior_vertex_finds_its_own_region_only() {
        assert_eq!(clusters(&strip(12), &[0, 1, 2, 4, 5], 8), [(0.0, vec![8, 9, 10, 11])]);
    }

    /// All but column 10 of a strip, in two regions: below column `border` and from there on.
    struct TwoRegions<'a> {
        near: &'a Near,
        border: usize,
    }

    impl TwoRegions<'_> {
        fn column(&self, v: u32) -> usize {
            self.near.verts[v as usize].index() / 2
        }
    }

    impl Regions for TwoRegions<'_> {
        fn is_member(&self, v: u32) -> bool {
            self.column(v) != 10
        }

        fn are_joined(&self, v: u32, w: u32) -> bool {
            (self.column(v) < self.border) == (self.column(w) < self.border)
        }
    }

    #[test]
    fn regions_that_are_not_joined_are_found_apart() {
        let mesh = strip(11);
        let (normals, labels) = labels(&mesh);
        let mut surface = Surface::new(&mesh, &normals, &labels);
        surface.h = 1.0;
        surface.near = Near::around(&surface, &mesh.verts().collect::<Vec<_>>());
        let found = |border| {
            let mut patch = Patch::default();
            patch.search(&surface, &TwoRegions { near: &surface.near, border }, Vert::new(20), 0.0);
            let of = |cluster: &Cluster| (cluster.distance(), patch.members(cluster).len());
            patch.clusters().iter().map(of).collect::<Vec<_>>()
        };
        // From column 10 the patch goes on to column 6; the second region begins with column 7.
        assert_eq!(found(0), [(1.0, 8)]);
        assert_eq!(found(8), [(1.0, 4), (3.0, 4)]);
        assert_eq!(found(7), [(1.0, 6)], "column 6 is 4 h away");
    }

    #[test]
    fn a_patch_of_coincident_vertices_is_bounded() {
        // All points within reach of each other.
        let n = 2 * MAX_MEMBERS;
        let (mut points, faces) = strip(n).into_parts();
        points.iter_mut().for_each(|p| p.x *= 1e-6);
        let m = Mesh::new(points, faces).unwrap();
        let normals: PerFace<DVec3> = m.face_normals();
        let (_, labels) = labels(&m);
        let mut surface = Surface::new(&m, &normals, &labels);
        (surface.h, surface.interior[Vert::new(n)]) = (1.0, false);
        surface.near = Near::around(&surface, &m.verts().collect::<Vec<_>>());
        let mut patch = Patch::default();
        patch.search(&surface, &surface, Vert::new(n), 0.0);
        assert_eq!(patch.members.len() + patch.doubtful.len(), MAX_MEMBERS);
        assert_eq!(
            (0..surface.near.verts.len() as u32).filter(|&i| patch.known.contains(i)).count(),
            MAX_MEMBERS
        );
    }
}
