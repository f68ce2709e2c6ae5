//! The fits of a mesh, by vertex.

use rayon::prelude::*;

use crate::fit::Fit;
use crate::mesh::{PerVert, Vert};

/// The fits of the vertices that have one.
#[derive(Clone, Debug, Default)]
pub struct VertexFits {
    /// For each vertex its place in the next two, `u32::MAX` if it has none. `[V]`
    pub(super) slot: PerVert<u32>,
    pub(super) verts: Vec<Vert>,
    pub(super) fits: Vec<Option<Fit>>,
}

impl VertexFits {
    /// No fit yet, and room for those of `verts` (ascending).
    pub(super) fn none(n_verts: usize, verts: Vec<Vert>) -> Self {
        let mut slot = PerVert::filled(n_verts, u32::MAX);
        for (i, &v) in verts.iter().enumerate() {
            slot[v] = i as u32;
        }
        let fits = verts.par_iter().map(|_| None).collect();
        Self { slot, verts, fits }
    }

    /// The fit of `v`, if it has one.
    #[inline]
    #[must_use]
    pub fn get(&self, v: Vert) -> Option<&Fit> {
        self.fits.get(self.slot[v] as usize)?.as_ref()
    }

    /// All vertices with a fit, ascending.
    pub fn iter(&self) -> impl Iterator<Item = (Vert, &Fit)> {
        self.verts.iter().zip(&self.fits).filter_map(|(&v, fit)| Some((v, fit.as_ref()?)))
    }

    /// The fits of tests.
    #[cfg(test)]
    pub(super) fn of(n_verts: usize, fits: impl IntoIterator<Item = (Vert, Fit)>) -> Self {
        let (verts, fits): (Vec<_>, Vec<_>) = fits.into_iter().unzip();
        let mut made = Self::none(n_verts, verts);
        made.fits = fits.into_iter().map(Some).collect();
        made
    }

    /// Leaves `v` without a fit.
    pub(super) fn remove(&mut self, v: Vert) {
        self.fits[self.slot[v] as usize] = None;
    }

    pub(super) fn set(&mut self, v: Vert, fit: Fit) {
        self.fits[self.slot[v] as usize] = Some(fit);
    }
}
