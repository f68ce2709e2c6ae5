//! What an end of an edge is in its sector, and what the stencils sum over its neighbours.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use super::{Rule, Stencils, wish};
use crate::mesh::{Half, Vert};

/// An end with more triangles than this has its sums made beforehand, for all its edges at once. Below,
/// walking round it for each edge is cheaper than keeping the sums; 64 bounds the walk.
pub(super) const WIDE: usize = 64;

/// What one end of an edge is in its sector.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum End {
    /// No cut edge or one: `k` triangles all round.
    Interior { k: usize },
    /// Between two cut edges: `k` triangles, and the edge is spoke `i` of `0..=k`, counter-clockwise.
    Crease { k: usize, i: usize },
}

impl End {
    pub(super) fn is_regular(self) -> bool {
        matches!(self, Self::Interior { k: 6 } | Self::Crease { k: 3, .. })
    }

    /// The angle between neighbouring spokes if the end were flat and even.
    fn angle(self) -> f64 {
        match self {
            Self::Interior { k } => 2.0 * PI / k as f64,
            Self::Crease { k, .. } => PI / k as f64,
        }
    }

    pub(super) fn extraordinary_rule(self) -> Rule {
        match self {
            Self::Interior { .. } => Rule::E2,
            Self::Crease { .. } => Rule::E1,
        }
    }
}

/// A sector as seen from one of the half-edges in it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sector {
    /// The half-edge along spoke 0, leaving the vertex.
    pub first: Half,
    /// What the vertex is there.
    pub end: End,
    /// The unit normal of the sector, where it is known beforehand.
    pub normal: Option<DVec3>,
    /// What was summed beforehand, at a wide end.
    pub known: Option<Known>,
}

impl Sector {
    /// A sector of which nothing is known beforehand.
    fn new(first: Half, end: End) -> Self {
        Self { first, end, normal: None, known: None }
    }
}

/// What is summed over all neighbours of an end.
#[derive(Clone, Copy, Debug)]
pub(super) struct Known {
    /// Where the end, if extraordinary, wants the new vertex of an edge.
    pub wish: DVec3,
    /// The unit normal of the sector; zero if it has none.
    pub normal: DVec3,
}

impl Stencils<'_> {
    /// The unit normal of the vertex in a sector; zero if it has none.
    ///
    /// Based on: Max 1999, whose weights make it exact on a sphere however the faces lie. Weights by area
    /// or angle tell slivers on a curved surface from noise less well.
    pub(super) fn normal(&self, sector: Sector) -> DVec3 {
        if let Some(normal) = sector.normal {
            return normal;
        }
        let centre = self.from(sector.first);
        let sum: DVec3 = self.halves_of(sector).map(|h| self.weighted_normal(centre, h)).sum();
        sum.normalize_or_zero()
    }

    /// What the triangle of `h`, which leaves `centre`, adds to the normal there.
    fn weighted_normal(&self, centre: DVec3, h: Half) -> DVec3 {
        let (a, b) = (self.to(h) - centre, self.opposite(h) - centre);
        // A face without area has no say, rather than too much.
        let weighted = a.cross(b) / (a.length_squared() * b.length_squared());
        if weighted.is_finite() { weighted } else { DVec3::ZERO }
    }

    /// The unit normal of `v` where all its triangles are one sector without any cut edge: what each edge
    /// there would else sum by itself.
    pub(super) fn round_normal(&self, v: Vert) -> Option<DVec3> {
        let leaving = self.mesh.leaving(v);
        if leaving.len() > WIDE {
            return None;
        }
        let (first, centre) = (*leaving.first()?, self.mesh.point(v));
        let (mut h, mut sum) = (first, DVec3::ZERO);
        for n in 0..leaving.len() {
            if self.is_cut[h] || n > 0 && h == first {
                return None; // A cut, or one of several fans.
            }
            sum += self.weighted_normal(centre, h);
            h = self.mesh.rotate_ccw(h)?;
        }
        (h == first).then(|| sum.normalize_or_zero())
    }

    /// The half-edges that leave the vertex in a sector, one per triangle.
    fn halves_of(&self, Sector { first, end, .. }: Sector) -> impl Iterator<Item = Half> + '_ {
        let (End::Interior { k } | End::Crease { k, .. }) = end;
        std::iter::successors(Some(first), |&h| self.mesh.rotate_ccw(h)).take(k)
    }

    /// The sector of `h`, which leaves the end and is no cut. Walks over at most [`WIDE`] triangles.
    pub(super) fn sector(&self, h: Half) -> Sector {
        let v = self.mesh.from(h);
        if let Some(normal) = self.rounds[v] {
            let end = End::Interior { k: self.mesh.leaving(v).len() };
            return Sector { normal: Some(normal), ..Sector::new(h, end) };
        }
        match self.wide.binary_search_by_key(&h, |&(h, ..)| h) {
            Ok(found) => {
                let (_, end, known) = self.wide[found];
                Sector { first: h, end, normal: Some(known.normal), known: Some(known) }
            }
            Err(_) => self.walk_sector(h),
        }
    }

    /// Walks counter-clockwise from `h` to a cut edge, or all round; then clockwise.
    fn walk_sector(&self, h: Half) -> Sector {
        let (mut last, mut k) = (h, 1);
        while !self.is_cut[last.prev()] {
            last = self.ccw(last);
            if last == h {
                return Sector::new(h, End::Interior { k });
            }
            k += 1;
        }
        let (mut first, mut i) = (h, 0);
        while !self.is_cut[first] {
            first = self.cw(first);
            i += 1;
        }
        k += i;
        if self.mesh.twin(first) == Some(last.prev()) {
            // One cut edge alone: a dead end.
            return Sector::new(h, End::Interior { k });
        }
        Sector::new(first, End::Crease { k, i })
    }

    /// The sums over the neighbours in a sector that the rules for extraordinary ends are made of.
    pub(super) fn harmonics(&self, sector: Sector) -> Harmonics {
        let step = sector.end.angle();
        let mut sums = Harmonics::default();
        let turn = DVec2::from_angle(step);
        let mut angle = DVec2::X;
        let mut last = sector.first;
        for h in self.halves_of(sector) {
            sums.add(angle, self.to(h));
            angle = turn.rotate(angle);
            last = h;
        }
        if let End::Crease { .. } = sector.end {
            sums.add(angle, self.opposite(last));
            sums.first_less_last = self.to(sector.first) - self.opposite(last);
        }
        sums
    }

    /// The sums of the wide ends at `v`, for each half-edge that leaves them and is no cut.
    pub(super) fn wide_ends(&self, v: Vert) -> Vec<(Half, End, Known)> {
        let leaving = self.mesh.leaving(v);
        let mut is_done = vec![false; leaving.len()];
        let mut wide = Vec::new();
        // From a cut edge the walk never turns back, so that all sectors together cost one turn.
        let (cut, rest): (Vec<_>, Vec<_>) = (0..leaving.len()).partition(|&n| self.is_cut[leaving[n]]);
        for n in cut.into_iter().chain(rest) {
            if is_done[n] {
                continue;
            }
            let sector = self.walk_sector(leaving[n]);
            let (sums, normal) = (self.harmonics(sector), self.normal(sector));
            for (i, h) in self.halves_of(sector).enumerate() {
                is_done[leaving.binary_search(&h).unwrap_or(n)] = true;
                let (k, end, sums) = match sector.end {
                    end @ End::Interior { k } => (k, end, sums.turned(i as f64 * end.angle())),
                    End::Crease { k, .. } => (k, End::Crease { k, i }, sums),
                };
                if k > WIDE && !self.is_cut[h] {
                    let wish = wish(end, &sums, self.from(h), self.to(h));
                    wide.push((h, end, Known { wish, normal }));
                }
            }
        }
        wide
    }
}

/// The neighbours of an end, summed as they are and times cosine and sine of once and twice their angle.
///
/// The angle of spoke j is j times 2π/k at an interior end, j times π/k at a crease end.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Harmonics {
    pub all: DVec3,
    pub cos: [DVec3; 2],
    pub sin: [DVec3; 2],
    /// The neighbour at spoke 0 less that at spoke k.
    pub first_less_last: DVec3,
}

impl Harmonics {
    /// Adds the neighbour at the angle whose cosine and sine are given.
    fn add(&mut self, angle: DVec2, neighbour: DVec3) {
        let twice = angle.rotate(angle);
        self.all += neighbour;
        for (i, angle) in [angle, twice].into_iter().enumerate() {
            self.cos[i] += angle.x * neighbour;
            self.sin[i] += angle.y * neighbour;
        }
    }

    /// The same sums with angles counted from `angle`.
    fn turned(&self, angle: f64) -> Self {
        let mut turned = *self;
        for i in 0..2 {
            let (sin, cos) = ((i + 1) as f64 * angle).sin_cos();
            turned.cos[i] = cos * self.cos[i] + sin * self.sin[i];
            turned.sin[i] = cos * self.sin[i] - sin * self.cos[i];
        }
        turned
    }
}
