//! Which edges are sharp, as data that every pass can carry along.
//!
//! Based on: Sharpen&Bend section 4.1.
//! Differs: strictly, every edge between two tagged vertices is sharp, which tags smooth surfaces (200
//! edges of a sphere); by default only edges at inserted vertices, and old edges that filter 3bis found,
//! where the surface bends by at least `MIN_SHARP_ANGLE` in the end.
//! In/out: the cleaned mesh and what is tagged -> `Tags`.
//! Cost: O(edges at tagged vertices).

use rayon::prelude::*;

use crate::classify::dihedral_angle;
use crate::geometry::{angle_between, unit_normal};
use crate::mesh::{Face, Half, Mesh, PerHalf, Vert};
use crate::subset::Subset;

/// An edge with a smaller dihedral angle in the output is not sharp, in radians: 15 degrees. With it a
/// sphere has no sharp edge and a block with round edges 46 instead of 2523.
const MIN_SHARP_ANGLE: f64 = 15.0 * std::f64::consts::PI / 180.0;

/// The sharp edges of a mesh and its tagged vertices.
///
/// Edges are kept as pairs of vertices rather than as flags on half-edges: they are few, and a pair
/// survives any rebuild that keeps its vertices.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Tags {
    /// Sharp edges, lower vertex first, ascending, each once.
    sharp: Vec<[Vert; 2]>,
    /// Tagged vertices, ascending, each once.
    tagged: Vec<Vert>,
}

impl Tags {
    /// Makes the tags from sharp edges and tagged vertices in any order. The ends of sharp edges are
    /// tagged in any case.
    #[must_use]
    pub fn new(sharp: impl IntoIterator<Item = [Vert; 2]>, tagged: impl IntoIterator<Item = Vert>) -> Self {
        let sharp = in_order(sharp.into_iter().collect());
        let mut tagged: Vec<_> = tagged.into_iter().chain(sharp.iter().flatten().copied()).collect();
        tagged.par_sort_unstable();
        tagged.dedup();
        Self { sharp, tagged }
    }

    /// The same tags and these tagged vertices: corners without a sharp edge, as the tips of cones are.
    #[must_use]
    pub fn with_tagged(self, vertices: impl IntoIterator<Item = Vert>) -> Self {
        let mut vertices = vertices.into_iter().peekable();
        if vertices.peek().is_none() { self } else { Self::new(self.sharp, vertices.chain(self.tagged)) }
    }

    /// The papers' sharp edges: every edge of `mesh` between two of the `tagged` vertices.
    #[must_use]
    pub fn between_tagged(mesh: &Mesh, tagged: impl IntoIterator<Item = Vert>) -> Self {
        let tagged = Subset::of(mesh.n_verts(), tagged);
        let is_sharp = |edge: &[Vert; 2]| edge.iter().all(|&v| tagged.contains(v));
        let edges = |&[a, b, c]: &[Vert; 3]| [[a, b], [b, c], [c, a]].into_iter().filter(is_sharp);
        let sharp: Vec<_> = mesh.faces().par_iter().flat_map_iter(edges).collect();
        Self { sharp: in_order(sharp), tagged: tagged.iter().collect() }
    }

    /// Those of `candidates` that are edges of `mesh` and bend it by at least `MIN_SHARP_ANGLE`. An
    /// edge without an angle (a border, a face without area) keeps its tag.
    #[must_use]
    pub fn where_bent(mesh: &Mesh, candidates: impl IntoIterator<Item = [Vert; 2]>) -> Self {
        Self::where_bent_beside(mesh, &mesh.face_ids().collect::<Vec<_>>(), candidates)
    }

    /// The same, where all faces beside `candidates` are among these `faces`, each once.
    pub(crate) fn where_bent_beside(
        mesh: &Mesh,
        faces: &[Face],
        candidates: impl IntoIterator<Item = [Vert; 2]>,
    ) -> Self {
        let candidates = in_order(candidates.into_iter().collect());
        let is_end = Subset::of(mesh.n_verts(), candidates.iter().flatten().copied());
        // One pass over the faces finds those beside each candidate, without the mesh's twins.
        let has_edge_between_ends =
            |&f: &Face| mesh.corners(f).map(|v| usize::from(is_end.contains(v))).iter().sum::<usize>() >= 2;
        let candidates_of = |f: Face| {
            let [a, b, c] = mesh.corners(f);
            let edges = [[a, b], [b, c], [c, a]].map(|[v, w]| [v.min(w), v.max(w)]);
            let edges = edges.into_iter().filter(|edge| edge.iter().all(|&v| is_end.contains(v)));
            let number = |edge: [Vert; 2]| candidates.binary_search(&edge).ok();
            edges.filter_map(number).map(move |i| (i, f))
        };
        let faces = faces.par_iter().copied().filter(has_edge_between_ends);
        let pairs: Vec<(usize, Face)> = faces.flat_map_iter(candidates_of).collect();
        let mut beside = vec![Beside::NONE; candidates.len()];
        pairs.into_iter().for_each(|(i, f)| beside[i].add(f));
        let bends = |beside: &Beside| beside.angle(mesh).is_none_or(|angle| angle >= MIN_SHARP_ANGLE);
        let is_sharp = |(_, beside): &(&[Vert; 2], &Beside)| beside.n > 0 && bends(beside);
        let sharp: Vec<_> = candidates.iter().zip(&beside).filter(is_sharp).map(|(&edge, _)| edge).collect();
        let tagged = Subset::of(mesh.n_verts(), sharp.iter().flatten().copied());
        Self { tagged: tagged.iter().collect(), sharp }
    }

    /// The sharp edges, lower vertex first, ascending.
    #[must_use]
    pub fn sharp_edges(&self) -> &[[Vert; 2]] {
        &self.sharp
    }

    /// The tagged vertices, ascending.
    #[must_use]
    pub fn tagged(&self) -> &[Vert] {
        &self.tagged
    }

    /// Flags both half-edges of each sharp edge. A pair that `mesh` has no edge for flags nothing. `[3F]`
    #[must_use]
    pub fn sharp_halves(&self, mesh: &Mesh) -> PerHalf<bool> {
        let mut flags = PerHalf::filled(mesh.n_halves(), false);
        self.halves_of_sharp_edges(mesh).for_each(|h| flags[h] = true);
        flags
    }

    /// Both half-edges of each sharp edge, and all of one with more faces.
    pub(crate) fn halves_of_sharp_edges(&self, mesh: &Mesh) -> impl Iterator<Item = Half> {
        let mut halves = Vec::with_capacity(2 * self.sharp.len());
        // One look at a fan finds all its sharp edges, be they two or a hundred thousand.
        for spokes in self.directed().chunk_by(|a, b| a[0] == b[0]) {
            let v = spokes[0][0];
            let leaving = if v.index() < mesh.n_verts() { mesh.leaving(v) } else { &[] };
            let is_sharp = |h: &Half| spokes.binary_search(&[v, mesh.to(*h)]).is_ok();
            halves.extend(leaving.iter().copied().filter(is_sharp));
        }
        halves.into_iter()
    }

    /// The sharp edges in both directions, ascending.
    fn directed(&self) -> Vec<[Vert; 2]> {
        let mut directed: Vec<_> = self.sharp.iter().flat_map(|&[a, b]| [[a, b], [b, a]]).collect();
        directed.sort_unstable();
        directed
    }
}

/// The faces beside an edge: how many, and the first two.
#[derive(Clone, Copy)]
struct Beside {
    n: usize,
    faces: [Face; 2],
}

impl Beside {
    const NONE: Self = Self { n: 0, faces: [Face::NONE; 2] };

    fn add(&mut self, f: Face) {
        if let Some(slot) = self.faces.get_mut(self.n) {
            *slot = f;
        }
        self.n += 1;
    }

    /// The dihedral angle of the edge, if it has two faces and both have an area.
    fn angle(&self, mesh: &Mesh) -> Option<f64> {
        if self.n != 2 {
            return None;
        }
        let [n, m] = self.faces.map(|f| unit_normal(mesh.triangle(f)));
        Some(angle_between(n?, m?))
    }
}

/// Edges with the lower vertex first, ascending, each once; without those from a vertex to itself.
fn in_order(mut edges: Vec<[Vert; 2]>) -> Vec<[Vert; 2]> {
    edges.retain(|[a, b]| a != b);
    edges.iter_mut().for_each(|[a, b]| (*a, *b) = (*a.min(b), *a.max(b)));
    edges.par_sort_unstable();
    edges.dedup();
    edges
}

/// Tags the edges with two faces that meet at a dihedral angle of `radians` or more: the sharp edges of a
/// mesh that nothing else is known of. A face without area has no angle.
///
/// Based on: the threshold of Hoppe et al. 1994, which Sharpen&Bend section 4.1 compares with.
#[must_use]
pub fn tags_by_dihedral(mesh: &Mesh, radians: f64) -> Tags {
    let normals = mesh.face_normals();
    let is_sharp = |h: &Half| dihedral_angle(mesh, &normals, *h).is_some_and(|angle| angle >= radians);
    Tags::new(mesh.edges().filter(is_sharp).map(|h| mesh.ends(h)), [])
}

/// Chains the sharp edges into polylines, each from one corner or dead end (a vertex with other than two
/// sharp edges) to the next. A closed loop starts at its lowest vertex and repeats it at its end.
///
/// Each sharp edge is in exactly one polyline. The order depends on vertex indices alone: open ones by
/// their lower end first, then loops.
#[must_use]
pub fn polylines(tags: &Tags) -> Vec<Vec<Vert>> {
    let directed = tags.directed();
    let mut is_used = vec![false; directed.len()];
    let spokes = |v: Vert| {
        let start = directed.partition_point(|&[from, _]| from < v);
        start..start + directed[start..].partition_point(|&[from, _]| from == v)
    };
    let mut chain = |first: usize| -> Option<Vec<Vert>> {
        let mut edge = first;
        let mut line = vec![directed[first][0]];
        while !is_used[edge] {
            let [from, to] = directed[edge];
            is_used[edge] = true;
            is_used[directed.binary_search(&[to, from]).ok()?] = true;
            line.push(to);
            match spokes(to) {
                two if two.len() == 2 => edge = two.start + usize::from(directed[two.start][1] == from),
                _ => break,
            }
        }
        (line.len() > 1).then_some(line)
    };
    let is_end = |e: &usize| spokes(directed[*e][0]).len() != 2;
    let (open, closed): (Vec<_>, Vec<_>) = (0..directed.len()).partition(is_end);
    open.into_iter().chain(closed).filter_map(&mut chain).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tests::mesh;

    #[test]
    fn tags_are_ordered_unique_and_include_the_ends_of_sharp_edges() {
        let v = Vert::new;
        let tags = Tags::new([[v(3), v(1)], [v(1), v(3)], [v(0), v(3)], [v(2), v(2)]], [v(5)]);
        assert_eq!(tags.sharp_edges(), [[v(0), v(3)], [v(1), v(3)]]);
        assert_eq!(tags.tagged(), [v(0), v(1), v(3), v(5)]);
    }

    #[test]
    fn both_halves_of_a_sharp_edge_are_flagged() {
        let m = mesh(&[[0.; 3], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]], &[[0, 1, 2], [0, 2, 3]]);
        let tags = Tags::new([[Vert::new(2), Vert::new(0)], [Vert::new(1), Vert::new(3)]], []);
        assert_eq!(tags.sharp_halves(&m).as_slice(), [false, false, true, true, false, false]);
    }

    #[test]
    fn more_vertices_are_tagged_without_a_sharp_edge() {
        let v = Vert::new;
        let tags = Tags::new([[v(4), v(2)]], []).with_tagged([v(7), v(3), v(4)]);
        assert_eq!((tags.sharp_edges(), tags.tagged()), (&[[v(2), v(4)]][..], &[v(2), v(3), v(4), v(7)][..]));
        assert_eq!(tags.clone().with_tagged([]), tags);
    }

    #[test]
    fn vertices_that_were_tagged_before_stay_so() {
        let v = Vert::new;
        assert_eq!(Tags::new([], [v(9)]).with_tagged([v(1)]).tagged(), [v(1), v(9)]);
    }

    #[test]
    fn edges_between_two_tagged_vertices_are_the_papers_sharp_ones() {
        let m = mesh(&[[0.; 3], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]], &[[0, 1, 2], [0, 2, 3]]);
        let tags = Tags::between_tagged(&m, [3, 0, 2].map(Vert::new));
        assert_eq!(tags.sharp_edges(), [[0, 2], [0, 3], [2, 3]].map(|e| e.map(Vert::new)));
        assert_eq!(tags.tagged(), [0, 2, 3].map(Vert::new));
        assert!(
            Tags::between_tagged(&m, [1, 3].map(Vert::new)).sharp_edges().is_empty(),
            "no edge joins them"
        );
    }

    //   3---2---5     a sheet that is bent along 0-2 and 1-2; face 4-1-6, with 6 between 1 and 4, has no area
    //   | / | \ |
    //   0---1---4
    #[test]
    fn candidates_are_sharp_where_the_mesh_bends_by_15_degrees() {
        let v = Vert::new;
        let sharp = |degrees: f64, candidates: &[[usize; 2]]| {
            let (sine, cosine) = degrees.to_radians().sin_cos();
            let points = [[0.; 3], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.], [1. + cosine, 0., sine]];
            let points =
                [&points[..], &[[1. + cosine, 1., sine], [1. + cosine / 2., 0., sine / 2.]]].concat();
            let m = mesh(&points, &[[0, 1, 2], [2, 3, 0], [1, 4, 2], [4, 5, 2], [4, 1, 6]]);
            let tags = Tags::where_bent(&m, candidates.iter().map(|edge| edge.map(v)));
            assert!(tags.tagged().len() >= tags.sharp_edges().len());
            tags.sharp_edges().iter().map(|edge| edge.map(Vert::index)).collect::<Vec<_>>()
        };
        // In any order of the two; 0-2 lies in the plane, and no edge joins 0 and 5.
        assert_eq!(sharp(16.0, &[[2, 1], [0, 2], [5, 0]]), [[1, 2]]);
        assert_eq!(sharp(-16.0, &[[1, 2]]), [[1, 2]]);
        assert_eq!(sharp(14.0, &[[2, 1], [0, 2], [5, 0]]), [[0; 2]; 0]);
        // Borders have no angle, nor has an edge of a face without area.
        assert_eq!(sharp(0.0, &[[0, 3], [4, 1], [2, 1]]), [[0, 3], [1, 4]]);
    }

    #[test]
    fn the_dihedral_angle_decides_what_is_sharp() {
        // A roof over 0-1 whose halves meet at a right angle, a flat continuation at 1-2, a border.
        let points = [[0., 0., 1.], [0., 3., 1.], [1., 0., 0.], [-1., 0., 0.], [1., 3., 0.], [5., 5., 5.]];
        let m = mesh(&points, &[[0, 2, 1], [0, 1, 3], [1, 2, 4], [5, 5, 5]]);
        let sharp = |degrees: f64| tags_by_dihedral(&m, degrees.to_radians()).sharp_edges().to_vec();
        assert_eq!(sharp(89.9), [[Vert::new(0), Vert::new(1)]]);
        assert_eq!(sharp(90.1), [[Vert::NONE; 2]; 0]);
        assert_eq!(sharp(0.0).len(), 2, "borders have no angle");
    }

    //      5--6
    //      | /       a dead end, a corner of three, a loop through it, and a loop alone
    //   0--2--1--4
    #[test]
    fn polylines_run_from_corner_to_corner() {
        let edges = [[0, 2], [2, 1], [1, 4], [2, 5], [5, 6], [6, 2], [9, 8], [8, 7], [7, 9]];
        let tags = Tags::new(edges.map(|e| e.map(Vert::new)), []);
        let lines: Vec<Vec<_>> =
            polylines(&tags).iter().map(|l| l.iter().map(|v| v.index()).collect()).collect();
        assert_eq!(lines, [vec![0, 2], vec![2, 1, 4], vec![2, 5, 6, 2], vec![7, 8, 9, 7]]);
        assert!(polylines(&Tags::default()).is_empty());
    }
}
