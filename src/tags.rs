//! Which edges are sharp, as data that every pass can carry along.

use crate::mesh::{Half, Mesh, PerHalf, Vert};

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
