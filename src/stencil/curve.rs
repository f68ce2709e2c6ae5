//! How the curves of cut edges go on from edge to edge.

use super::Stencils;
use crate::mesh::{Half, Vert};

impl Stencils<'_> {
    /// Where the curve through the edge of `h` goes on before its start: the neighbour along the only
    /// other cut edge in the fan.
    pub(super) fn curve_before(&self, h: Half) -> Option<Vert> {
        self.curve_beyond(h, Some(h), self.mesh.twin(h))
    }

    /// Where it goes on after the end of `h`.
    pub(super) fn curve_after(&self, h: Half) -> Option<Vert> {
        self.curve_beyond(h, self.mesh.twin(h), Some(h))
    }

    /// The neighbour along the only other cut edge at one end of `edge`; of its half-edges one leaves that
    /// end, one arrives. None at a corner or dead end.
    ///
    /// The walk ends at the second other cut edge: all curves through one vertex cost a few turns in all.
    fn curve_beyond(&self, edge: Half, leaving: Option<Half>, arriving: Option<Half>) -> Option<Vert> {
        let knot = self.knots.around(self.mesh, edge);
        if !knot.is_empty() {
            return self.knot_beyond(
                edge,
                if leaving == Some(edge) { self.mesh.from(edge) } else { self.mesh.to(edge) },
            );
        }
        let mut found = None;
        let mut next = leaving;
        while let Some(h) = next {
            next = self.mesh.rotate_ccw(h);
            if next.is_some() && next == leaving {
                return found;
            }
            if self.is_cut[h.prev()]
                && found.replace(self.curve_neighbour(h.prev(), self.mesh.opposite(h))?).is_some()
            {
                return None;
            }
        }
        let mut next = arriving.map(Half::next);
        while let Some(h) = next {
            if self.is_cut[h] && found.replace(self.curve_neighbour(h, self.mesh.to(h))?).is_some() {
                return None;
            }
            next = self.mesh.rotate_cw(h);
        }
        found
    }

    /// The same for an edge of three faces or more, which has no fan of its own: among all fans at `v`.
    fn knot_beyond(&self, edge: Half, v: Vert) -> Option<Vert> {
        let ends = self.mesh.ends(edge);
        let mut found = None;
        for &h in self.mesh.leaving(v) {
            for (spoke, neighbour) in [(h, self.mesh.to(h)), (h.prev(), self.mesh.opposite(h))] {
                let is_new = self.is_cut[spoke] && !ends.contains(&neighbour) && found != Some(neighbour);
                if is_new && found.replace(neighbour).is_some() {
                    return None;
                }
            }
        }
        found
    }

    /// The neighbour along a cut edge, unless that edge is a knot: no curve of one fan runs on into it.
    fn curve_neighbour(&self, cut: Half, neighbour: Vert) -> Option<Vert> {
        self.knots.around(self.mesh, cut).is_empty().then_some(neighbour)
    }
}
