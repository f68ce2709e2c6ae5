//! Which edges are sharp, as data that every pass can carry along.
//!
//! Based on: Sharpen&Bend section 4.1.
//! Differs: strictly, every edge between two tagged vertices is sharp, which tags smooth surfaces (200
//! edges of a sphere); by default only edges at inserted vertices, and old edges that filter 3bis found,
//! where the surface bends by at least [`MIN_SHARP_ANGLE`] in the end.
//! In/out: the cleaned mesh and what is tagged -> `Tags`.
//! Cost: O(edges at tagged vertices).

use crate::classify::dihedral_angle;
use crate::mesh::{Half, Mesh, PerHalf, PerVert, Vert};

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
        let mut sharp: Vec<_> = sharp.into_iter().map(|[a, b]| [a.min(b), a.max(b)]).collect();
        sharp.retain(|[a, b]| a != b);
        sharp.sort_unstable();
        sharp.dedup();
        let mut tagged: Vec<_> = tagged.into_iter().chain(sharp.iter().flatten().copied()).collect();
        tagged.sort_unstable();
        tagged.dedup();
        Self { sharp, tagged }
    }

    /// The papers' sharp edges: every edge of `mesh` between two tagged vertices.
    #[must_use]
    pub fn between_tagged(mesh: &Mesh, is_tagged: &PerVert<bool>) -> Self {
        let ends = |h: Half| [mesh.from(h), mesh.to(h)];
        let sharp = mesh.edges().map(ends).filter(|edge| edge.iter().all(|&v| is_tagged[v]));
        Self::new(sharp, mesh.verts().filter(|&v| is_tagged[v]))
    }

    /// Those of `candidates` that are edges of `mesh` and bend it by at least [`MIN_SHARP_ANGLE`]. An
    /// edge without an angle (a border, a face without area) keeps its tag.
    #[must_use]
    pub fn where_bent(mesh: &Mesh, candidates: impl IntoIterator<Item = [Vert; 2]>) -> Self {
        let normals = mesh.face_normals();
        let bends = |h: Half| dihedral_angle(mesh, &normals, h).is_none_or(|angle| angle >= MIN_SHARP_ANGLE);
        let half = |[a, b]: [Vert; 2]| mesh.half_between(a, b).or_else(|| mesh.half_between(b, a));
        let is_sharp = |edge: &[Vert; 2]| half(*edge).is_some_and(bends);
        Self::new(candidates.into_iter().filter(is_sharp), [])
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
        for &[a, b] in &self.sharp {
            for (from, to) in [(a, b), (b, a)] {
                let along = |h: &&Half| mesh.to(**h) == to;
                for &h in mesh.leaving(from).iter().filter(along) {
                    flags[h] = true;
                }
            }
        }
        flags
    }
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
}
