//! What holds for every mesh that is sharpened, whatever it is. Tests and fuzz targets share it.
#![allow(dead_code)] // Each of them uses some of it.

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec3;
use sharpen::mesh::{EdgeDefects, Mesh, Vert};
use sharpen::{Method, Options, Sharpened, sharpen};

/// What no pass may change of a mesh's shape.
#[derive(Debug, PartialEq, Eq)]
pub struct Topology {
    /// Used vertices - edges + faces.
    pub euler: isize,
    pub components: usize,
    pub border_loops: usize,
    pub defects: EdgeDefects,
}

/// Whether a face names three vertices.
fn is_whole([a, b, c]: &[Vert; 3]) -> bool {
    a != b && b != c && c != a
}

/// The edges with the ways in which faces run along them, true from the lower vertex to the higher one. Faces that name
/// a vertex twice have none.
fn edges(mesh: &Mesh) -> BTreeMap<[usize; 2], Vec<bool>> {
    let mut edges: BTreeMap<[usize; 2], Vec<bool>> = BTreeMap::new();
    for f in mesh.faces().iter().filter(|f| is_whole(f)) {
        for i in 0..3 {
            let (a, b) = (f[i].index(), f[(i + 1) % 3].index());
            edges.entry([a.min(b), a.max(b)]).or_default().push(a < b);
        }
    }
    edges
}

fn is_regular(ways: &[bool]) -> bool {
    ways.len() == 2 && ways[0] != ways[1]
}

/// Whether two sheets may hang together at an edge: it has four faces, two of either way.
fn is_pinched(ways: &[bool]) -> bool {
    ways.len() == 4 && ways.iter().filter(|&&way| way).count() == 2
}

/// The edges of three faces or more.
fn non_manifold(mesh: &Mesh) -> BTreeMap<[usize; 2], Vec<bool>> {
    let mut edges = edges(mesh);
    edges.retain(|_, ways| ways.len() > 2);
    edges.values_mut().for_each(|ways| ways.sort_unstable());
    edges
}

/// The edges of `old` that `new` no longer has as such an edge: all of them were pinched, and the others are as they
/// were.
fn loosened(old: &Mesh, new: &Mesh) -> BTreeSet<[usize; 2]> {
    let (mut gone, left) = (non_manifold(old), non_manifold(new));
    for (edge, ways) in &left {
        assert_eq!(gone.remove(edge).as_ref(), Some(ways), "another non-manifold edge {edge:?}");
    }
    assert!(gone.values().all(|ways| is_pinched(ways)), "{gone:?} were not pinched");
    gone.into_keys().collect()
}

/// Merges what belongs together.
struct Union(Vec<usize>);

impl Union {
    fn find(&mut self, mut i: usize) -> usize {
        while self.0[i] != i {
            self.0[i] = self.0[self.0[i]];
            i = self.0[i];
        }
        i
    }

    fn join(&mut self, i: usize, j: usize) {
        let (i, j) = (self.find(i), self.find(j));
        self.0[i] = j;
    }

    /// The number of sets among `of`.
    fn count(&mut self, of: impl Iterator<Item = usize>) -> usize {
        of.map(|i| self.find(i)).collect::<BTreeSet<_>>().len()
    }
}

impl Topology {
    /// Bending splits every edge in two.
    fn bent(mut self, levels: u32) -> Self {
        self.defects.non_manifold_edges <<= levels;
        self.defects.misoriented_edges <<= levels;
        self
    }

    /// From the faces alone, without half-edges; without those that name a vertex twice. Whether pinched edges count as
    /// borders can be chosen.
    pub fn of(mesh: &Mesh, pinched_are_borders: bool) -> Self {
        let edges = edges(mesh);
        let used: BTreeSet<usize> = edges.keys().flatten().copied().collect();
        let mut whole = Union((0..mesh.n_verts()).collect());
        edges.keys().for_each(|&[a, b]| whole.join(a, b));
        // A border is what has no opposite; its loops are counted as connected sets.
        let mut border = Union((0..mesh.n_verts()).collect());
        let is_open = |ways: &[bool]| !is_regular(ways) && (pinched_are_borders || !is_pinched(ways));
        let open: Vec<[usize; 2]> = edges.iter().filter(|(_, ways)| is_open(ways)).map(|(&e, _)| e).collect();
        open.iter().for_each(|&[a, b]| border.join(a, b));
        let n_faces = edges.values().flatten().count() / 3;
        Self {
            euler: used.len() as isize - edges.len() as isize + n_faces as isize,
            components: whole.count(used.into_iter()),
            border_loops: border.count(open.into_iter().flatten()),
            defects: mesh.defects(),
        }
    }
}

/// Whether two faces have the same corners. Where both are split, what joins the new vertices is doubled.
fn has_doubled_faces(mesh: &Mesh) -> bool {
    let sorted = |f: &[Vert; 3]| {
        let mut f = *f;
        f.sort_unstable();
        f
    };
    mesh.faces().iter().map(sorted).collect::<BTreeSet<_>>().len() < mesh.n_faces()
}

/// A face of `new` that runs round the corners of a face of `old` the other way, where each mesh has one face
/// with these corners only, and where none of them was `replaced`: another vertex has its index now.
fn turned_face(old: &Mesh, new: &Mesh, replaced: &[usize]) -> Option<[Vert; 3]> {
    let mut ways: BTreeMap<[Vert; 3], [Vec<bool>; 2]> = BTreeMap::new();
    for (i, mesh) in [old, new].into_iter().enumerate() {
        for f in mesh.faces().iter().filter(|f| is_whole(f)) {
            let mut sorted = *f;
            sorted.sort_unstable();
            let is_ascending = (0..3).any(|k| [f[k], f[(k + 1) % 3], f[(k + 2) % 3]] == sorted);
            ways.entry(sorted).or_default()[i].push(is_ascending);
        }
    }
    let is_same = |face: &[Vert; 3]| !face.iter().any(|v| replaced.contains(&v.index()));
    let is_turned = |ways: &[Vec<bool>; 2]| ways.iter().all(|way| way.len() == 1) && ways[0] != ways[1];
    ways.into_iter().find(|(face, ways)| is_same(face) && is_turned(ways)).map(|(face, _)| face)
}

/// The bits of points.
pub fn bits(points: &[DVec3]) -> Vec<[u64; 3]> {
    points.iter().map(|p| p.to_array().map(f64::to_bits)).collect()
}

/// Sharpens `mesh` and checks all that holds for every mesh with finite coordinates.
pub fn obey_laws(mesh: &Mesh, options: &Options) -> Sharpened {
    let sharpened = sharpen(mesh, options).expect("a mesh of this size is no problem");
    let (new, report) = (&sharpened.mesh, &sharpened.report);
    new.check().expect("the output is a mesh");
    assert!(new.points().iter().all(|p| p.is_finite()), "a number that is none");

    // Old vertices keep index and bits, but for those that the report counts.
    let n = mesh.n_verts();
    assert!(new.n_verts() >= n);
    let (old_bits, new_bits) = (bits(mesh.points()), bits(&new.points()[..n]));
    let n_changed = (0..n).filter(|&i| old_bits[i] != new_bits[i]).count();
    if options.denoise == 0 {
        assert!(n_changed <= report.moved_vertices + report.replaced_vertices.len(), "{n_changed} moved");
        if options.method != Method::Regions {
            assert_eq!(report.moved_vertices, 0);
        }
    }
    if !report.changed {
        assert_eq!((n_changed, new.n_verts(), new.faces()), (0, n, mesh.faces()));
    }

    // Where an edge of four faces has two now, it is no border any more. Without any such edge nothing else changes.
    let n_loosened = report.untangled.map_or(0, |untangled| untangled.loosened);
    let topology = |mesh: &Mesh| Topology::of(mesh, n_loosened == 0);
    let (mut before, after) = (topology(mesh), topology(new));
    before.defects.non_manifold_edges -= n_loosened;
    assert_eq!(report.left_alone.defects, before.defects);
    before = before.bent(options.bend);
    if options.bend > 0 {
        // Of a face in a line come four, of one in a point only itself.
        before.defects.collapsed_faces = after.defects.collapsed_faces;
    }
    assert_eq!(after.components, before.components);
    if !has_doubled_faces(mesh) {
        assert_eq!(after, before, "another surface");
    }

    if let Some(turned) = turned_face(mesh, new, &report.replaced_vertices) {
        panic!("face {turned:?} is turned over");
    }

    // Every vertex that was used is, but for those that were collapsed; and border edges stay or are split.
    let used =
        |mesh: &Mesh| -> BTreeSet<usize> { mesh.faces().iter().flatten().map(|v| v.index()).collect() };
    let (used_before, used_after) = (used(mesh), used(new));
    let left_over: Vec<_> = used_before.difference(&used_after).collect();
    assert!(left_over.iter().all(|v| report.replaced_vertices.contains(v)), "left over: {left_over:?}");
    assert!(used_after.range(..n).all(|v| used_before.contains(v)), "an unused vertex is used");
    assert!((n..new.n_verts()).all(|v| used_after.contains(&v)), "a new vertex is of no use");
    if options.bend == 0 && options.method != Method::Paper && !has_doubled_faces(mesh) {
        let loosened = loosened(mesh, new);
        assert_eq!(loosened.len(), n_loosened);
        keep_borders(mesh, new, &loosened, |v| {
            v.index() >= n || report.replaced_vertices.contains(&v.index())
        });
    }
    sharpened
}

/// Checks that the borders of `old` are those of `new`, but for edges that were `loosened`; a crease that reaches the
/// border splits an edge of it at a new vertex.
fn keep_borders(old: &Mesh, new: &Mesh, loosened: &BTreeSet<[usize; 2]>, is_new: impl Fn(&Vert) -> bool) {
    let borders = |mesh: &Mesh| -> BTreeSet<[Vert; 2]> {
        let border = mesh.halves().filter(|&h| mesh.is_border(h) && is_whole(&mesh.corners(h.face())));
        border.map(|h| [mesh.from(h), mesh.to(h)]).collect()
    };
    let (mut old, new) = (borders(old), borders(new));
    old.retain(|[a, b]| !loosened.contains(&[a.min(b).index(), a.max(b).index()]));
    let mut rest = new.clone();
    for [a, b] in &old {
        let halves = new.range([*a, Vert::new(0)]..).take_while(|edge| edge[0] == *a).map(|edge| edge[1]);
        let middle = || halves.filter(&is_new).find(|&v| new.contains(&[v, *b]));
        let parts = if new.contains(&[*a, *b]) {
            vec![[*a, *b]]
        } else {
            let middle = middle().unwrap_or_else(|| panic!("border edge {a:?} {b:?} is no more"));
            vec![[*a, middle], [middle, *b]]
        };
        parts.iter().for_each(|edge| assert!(rest.remove(edge), "{edge:?} of two border edges"));
    }
    assert_eq!(rest, BTreeSet::new(), "another border");
}
