//! Which neighbours decide where the new vertex of an edge goes, and with what weights.
//!
//! Sharp and border edges *cut* the mesh. What an end of an edge is depends on its sector: the triangles
//! round that end from one cut edge to the next, on the side where the edge lies.
//!
//! ```text
//!    3 = = v = = 0     v is a crease end: k = 3 triangles between two cut edges (=),
//!     \   / \   /      spokes 0 to k counter-clockwise, the two outer ones on the curve.
//!      \ /   \ /       Without a cut edge, or with one (a dead end), v is an interior end:
//!       2 - - 1        k triangles all round, spoke 0 is the edge itself.
//! ```
//!
//! An end is *regular* when it is interior with k = 6 or crease with k = 3.
//!
//! Based on: Zorin, Schröder and Sweldens 1996 with Zorin's later corrections; Sharpen&Bend section 4.2.
//! Differs: no mesh is cut and healed; a sector is a walk round a vertex. Paper silent: where several
//! fans touch in a vertex each counts for itself; edges with three or more faces form curves of their
//! own; an interior end of two triangles wants the middle. What is round goes farther than the weights say (`round.rs`).
//! In/out: `Mesh` + `Tags` -> `Stencils`, which gives a [`Proposal`] per edge.
//! Cost: O(F) for all edges: ends of very many triangles are summed once, not once an edge.

mod curve;
mod round;
mod sector;
#[cfg(test)]
mod tests;

use std::f64::consts::PI;

use glam::DVec3;
use rayon::prelude::*;

use crate::mesh::{Half, Mesh, PerHalf, PerVert, Vert};
use crate::refine::Knots;
use crate::tags::Tags;

use round::{expected_by_normals, is_smooth_turn, roundness, turn_of_bulge};
use sector::{End, Harmonics, Known, Sector, WIDE};

/// How a new vertex was placed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Rule {
    /// Both ends interior and regular.
    R1,
    /// On a curve, both ends with exactly two cut edges.
    R2,
    /// One regular interior end, one regular crease end.
    R3,
    /// Two regular crease ends on one corner.
    R4,
    /// Two regular crease ends on two curves.
    R5,
    /// On a curve, one end with exactly two cut edges.
    R6,
    /// One extraordinary end, a crease vertex.
    E1,
    /// One extraordinary end, an interior vertex.
    E2,
    /// Two extraordinary ends: the mean of what each would do.
    Mean,
    /// In the middle of a cut edge: no curve goes on at either end.
    Midpoint,
}

impl Rule {
    /// All rules, each at the place of its number.
    pub(crate) const ALL: [Self; 10] = [
        Self::R1,
        Self::R2,
        Self::R3,
        Self::R4,
        Self::R5,
        Self::R6,
        Self::E1,
        Self::E2,
        Self::Mean,
        Self::Midpoint,
    ];

    /// Whether the edge is sharp or a border.
    #[must_use]
    pub fn is_on_curve(self) -> bool {
        matches!(self, Self::R2 | Self::R6 | Self::Midpoint)
    }
}

/// What the stencils say about the new vertex of an edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Proposal {
    /// Where it goes.
    pub point: DVec3,
    /// Why there.
    pub rule: Rule,
    /// How far from the middle each end by itself would expect it, as displacements: along a surface from
    /// the normals at the two ends, along a curve from its two sides. No weights are in these: they tell
    /// whether the neighbourhood is smooth enough for the stencil to mean anything.
    pub expected: [DVec3; 2],
}

/// What the two ends of an edge are and expect: all but where the new vertex goes.
#[derive(Clone, Copy, Debug)]
pub struct Site {
    /// The lower half-edge of the edge.
    h: Half,
    /// The rule that will place the vertex.
    pub rule: Rule,
    /// As in [`Proposal`].
    pub expected: [DVec3; 2],
    /// Cosine of the angle by which the surface or the curve turns from one end to the other, if it is round.
    turn: f64,
    ends: Ends,
}

impl Site {
    /// How many times as far from the middle of the edge as the stencil puts it the new vertex is on a cylinder or circle
    /// with these ends.
    #[must_use]
    pub fn roundness(&self) -> f64 {
        roundness(self.turn)
    }

    /// Whether the edge lies in a surface and an end of it on a curve.
    #[must_use]
    pub fn is_beside_curve(&self) -> bool {
        let is_crease = |sector: &Sector| matches!(sector.end, End::Crease { .. });
        matches!(&self.ends, Ends::InSurface(_, sectors) if sectors.iter().any(is_crease))
    }
}

/// What decides about a new vertex.
#[derive(Clone, Copy, Debug)]
enum Ends {
    /// On a curve: the vertices before and after the edge, seen from its middle.
    OnCurve([DVec3; 2]),
    /// In a surface: the twin, and the sectors of the two half-edges.
    InSurface(Half, [Sector; 2]),
}

/// The stencils of a mesh, ready to be asked edge by edge.
#[derive(Debug)]
pub struct Stencils<'m> {
    mesh: &'m Mesh,
    /// Sharp and border edges, on both half-edges. `[3F]`
    is_cut: PerHalf<bool>,
    knots: Knots,
    /// The normals of vertices without a cut edge, which count for all edges there. `[V]`
    rounds: PerVert<Option<DVec3>>,
    /// For each half-edge that leaves a wide end: what the end is, and its sums. Ascending.
    wide: Vec<(Half, End, Known)>,
    /// The weights of the spokes round an interior end of k triangles, from the edge on, up to [`WIDE`].
    spoke_weights: Vec<Vec<f64>>,
}

impl<'m> Stencils<'m> {
    /// Prepares the stencils of `mesh` with the sharp edges of `tags`.
    #[must_use]
    pub fn new(mesh: &'m Mesh, tags: &Tags) -> Self {
        let mut is_cut = tags.sharp_halves(mesh);
        let add_border = |(h, is_cut): (usize, &mut bool)| *is_cut |= mesh.is_border(Half::new(h));
        is_cut.as_mut_slice().par_iter_mut().enumerate().for_each(add_border);
        let mut stencils = Self::bare(mesh, is_cut);
        let rounds = (0..mesh.n_verts()).into_par_iter().map(|v| stencils.round_normal(Vert::new(v)));
        stencils.rounds = rounds.collect::<Vec<_>>().into();
        let is_wide = |v: &Vert| mesh.leaving(*v).len() > WIDE;
        stencils.wide = mesh.verts().filter(is_wide).flat_map(|v| stencils.wide_ends(v)).collect();
        stencils.wide.sort_unstable_by_key(|&(h, ..)| h);
        stencils
    }

    /// The stencils without anything summed beforehand.
    fn bare(mesh: &'m Mesh, is_cut: PerHalf<bool>) -> Self {
        let rounds = PerVert::filled(mesh.n_verts(), None);
        let spoke_weights = (0..=WIDE).map(spoke_weights).collect();
        Self { mesh, is_cut, knots: Knots::of(mesh), rounds, wide: Vec::new(), spoke_weights }
    }

    /// Whether the edge of `h` is sharp or a border.
    #[must_use]
    pub fn is_cut(&self, h: Half) -> bool {
        self.is_cut[h]
    }

    /// Where the new vertex on the edge of `h` goes, and why. The same for both half-edges.
    #[must_use]
    pub fn place(&self, h: Half) -> Proposal {
        let site = self.look(h);
        Proposal { point: self.point(&site), rule: site.rule, expected: site.expected }
    }

    /// What the ends of the edge of `h` are and expect. The same for both half-edges.
    #[must_use]
    pub fn look(&self, h: Half) -> Site {
        let h = self.mesh.edge(h);
        match self.mesh.twin(h) {
            Some(twin) if !self.is_cut[h] => self.look_in_surface(h, twin),
            _ => self.look_on_curve(h),
        }
    }

    /// Where the new vertex goes.
    #[must_use]
    pub fn point(&self, site: &Site) -> DVec3 {
        let h = site.h;
        let [p, q] = match site.ends {
            // before    p    new    q    after
            //   o-------o-----x-----o------o
            // -1/16   9/16        9/16   -1/16
            Ends::OnCurve([before, after]) => {
                return self.from(h).midpoint(self.to(h)) - (before + after) / 16.0;
            }
            Ends::InSurface(twin, [p, q]) => [(h, p), (twin, q)],
        };
        match (p.1.end.is_regular(), q.1.end.is_regular()) {
            (true, true) => self.place_regular(p, q),
            (false, false) => self.wish(p).midpoint(self.wish(q)),
            (false, true) => self.wish(p),
            (true, false) => self.wish(q),
        }
    }

    /// The curve rules: R2, R6 and the middle.
    fn look_on_curve(&self, h: Half) -> Site {
        let (p, q) = (self.from(h), self.to(h));
        let middle = p.midpoint(q);
        let along = (q - p).normalize_or_zero();
        let from_middle = |v: Vert| self.mesh.point(v) - middle;
        // The mirror in the perpendicular bisector of p q, and what is common to a point and its mirror.
        let mirror = |w: DVec3| w - 2.0 * w.dot(along) * along;
        let across = |w: DVec3| w - w.dot(along) * along;
        let (before, after, rule) = match (self.curve_before(h), self.curve_after(h)) {
            (Some(a), Some(b)) => (from_middle(a), from_middle(b), Rule::R2),
            (Some(a), None) => (from_middle(a), mirror(from_middle(a)), Rule::R6),
            (None, Some(b)) => (mirror(from_middle(b)), from_middle(b), Rule::R6),
            (None, None) => (DVec3::ZERO, DVec3::ZERO, Rule::Midpoint),
        };
        let half = (q - p) / 2.0;
        let turns_little = |(w, end): (DVec3, DVec3)| is_smooth_turn(end - w, -end);
        // An edge at a corner of its curve stays straight.
        let expected = match [(before, -half), (after, half)].into_iter().all(turns_little) {
            true => [before, after].map(|w| across(w) / -8.0),
            false => [DVec3::ZERO; 2],
        };
        let turn = turn_of_bulge(0.5 * (expected[0] + expected[1]).length() / (q - p).length());
        Site { h, rule, expected, turn, ends: Ends::OnCurve([before, after]) }
    }

    /// The surface rules, for an edge that is no cut.
    fn look_in_surface(&self, h: Half, twin: Half) -> Site {
        let (p, q) = (self.sector(h), self.sector(twin));
        let (n, m) = (self.normal(p), self.normal(q));
        let expected = expected_by_normals(self.to(h) - self.from(h), n, m);
        let (rule, ends) = (surface_rule(p.end, q.end), Ends::InSurface(twin, [p, q]));
        Site { h, rule, expected, turn: n.dot(m), ends }
    }

    /// The rules for two regular ends, each given with the half-edge that leaves it.
    fn place_regular(&self, (h, p): (Half, Sector), (twin, q): (Half, Sector)) -> DVec3 {
        match (p.end, q.end) {
            (End::Interior { .. }, End::Interior { .. }) => self.place_r1(h, twin),
            (End::Interior { .. }, End::Crease { i, .. }) => self.place_r3(h, twin, i),
            (End::Crease { i, .. }, End::Interior { .. }) => self.place_r3(twin, h, i),
            // The curve passes on the right of a half-edge at spoke 1, on the left of one at spoke 2. Seen
            // from the other end, sides change.
            (End::Crease { i, .. }, End::Crease { i: j, .. }) if i == j => self.place_r5(h, twin, i == 1),
            (End::Crease { i, .. }, End::Crease { .. }) => self.place_r4(h, twin, i == 1),
        }
    }

    /// Exact for cubics on the regular lattice.
    fn place_r1(&self, h: Half, twin: Half) -> DVec3 {
        //     -1/16 --- 1/8 --- -1/16
        //          \   /   \   /
        //           p --x-- q          ends 1/2
        //          /   \   /   \
        //     -1/16 --- 1/8 --- -1/16
        let (p, q) = (self.from(h), self.to(h));
        // The second spokes on either side.
        let wings = |h: Half, twin: Half| [self.opposite(self.ccw(h)), self.to(self.cw(twin.next()))];
        let ([a, b], [c, d]) = (wings(h, twin), wings(twin, h));
        (p + q) / 2.0 + (self.opposite(h) + self.opposite(twin)) / 8.0 - (a + b + c + d) / 16.0
    }

    /// Exact for quadratics. `i` is the spoke of the edge in the sector of the crease end.
    fn place_r3(&self, from_interior: Half, from_crease: Half, i: usize) -> DVec3 {
        //       -1/8 --- 3/16 -- -1/16
        //      /    \   /   \   //
        //     0 ----- p --x-- q          p 5/8, q 3/8; // the curve (or all of it mirrored)
        //      \    /   \   //
        //       -1/16 -- 1/16
        let ring = if i == 2 { [1, 2, 4, 5] } else { [5, 4, 2, 1] };
        let [a, b, c, near] = self.spokes(from_interior, ring);
        let far = self.far_on_curve(from_crease, i == 1);
        let (p, q) = (self.from(from_interior), self.from(from_crease));
        (10.0 * p + 6.0 * q + 3.0 * a - 2.0 * b - c + near - far) / 16.0
    }

    /// Exact for quadratics.
    fn place_r4(&self, h: Half, twin: Half, curves_meet_right: bool) -> DVec3 {
        //     -1/8 --- 1/4 --- -1/8
        //        \\   /   \   //
        //          p --x-- q         ends 1/2; the curves \\ and // meet in a corner
        //           \\   //
        //              0
        let apart = self.opposite(if curves_meet_right { h } else { twin });
        let far = self.far_on_curve(h, curves_meet_right) + self.far_on_curve(twin, !curves_meet_right);
        (self.from(h) + self.to(h)) / 2.0 + apart / 4.0 - far / 8.0
    }

    /// Exact for linear functions.
    fn place_r5(&self, h: Half, twin: Half, curves_are_right: bool) -> DVec3 {
        //     -1/16 --- 1/16
        //         \\   /   \\
        //           p --x-- q          ends 1/2; a strip one edge wide between two curves
        //            \\   /   \\
        //             1/16 --- -1/16
        let near = self.opposite(h) + self.opposite(twin);
        let far = self.far_on_curve(h, curves_are_right) + self.far_on_curve(twin, curves_are_right);
        (self.from(h) + self.to(h)) / 2.0 + (near - far) / 16.0
    }

    /// The neighbours of an interior end that are `numbers` spokes counter-clockwise of `h`.
    fn spokes<const N: usize>(&self, h: Half, numbers: [usize; N]) -> [DVec3; N] {
        numbers.map(|n| self.to((0..n).fold(h, |h, _| self.ccw(h))))
    }

    /// The neighbour two spokes from `h`, across two triangles: the second cut edge of a regular crease end.
    fn far_on_curve(&self, h: Half, is_ccw: bool) -> DVec3 {
        // Counter-clockwise the last spoke may be a border, which no half-edge leaves along.
        if is_ccw { self.opposite(self.ccw(h)) } else { self.to(self.cw(self.cw(h))) }
    }

    /// Where an extraordinary end would have the new vertex on the edge of `h`, which leaves it.
    fn wish(&self, (h, sector): (Half, Sector)) -> DVec3 {
        match (sector.known, sector.end) {
            (Some(known), _) => known.wish,
            (None, End::Interior { k }) if k <= WIDE => self.wish_of_round(h, k),
            _ => wish(sector.end, &self.harmonics(sector), self.from(h), self.to(h)),
        }
    }

    /// The same for an interior end of `k` triangles, by its row of weights.
    fn wish_of_round(&self, h: Half, k: usize) -> DVec3 {
        let centre = self.from(h);
        if k < 3 {
            return centre.midpoint(self.to(h));
        }
        let (mut spoke, mut sum) = (h, 0.75 * centre);
        for &weight in &self.spoke_weights[k] {
            sum += weight * self.to(spoke);
            spoke = self.ccw(spoke);
        }
        sum
    }

    fn from(&self, h: Half) -> DVec3 {
        self.mesh.point(self.mesh.from(h))
    }

    fn to(&self, h: Half) -> DVec3 {
        self.mesh.point(self.mesh.to(h))
    }

    fn opposite(&self, h: Half) -> DVec3 {
        self.mesh.point(self.mesh.opposite(h))
    }

    /// The next half-edge round a vertex where a sector is known to go on.
    fn ccw(&self, h: Half) -> Half {
        self.mesh.rotate_ccw(h).expect("a sector has no border inside")
    }

    fn cw(&self, h: Half) -> Half {
        self.mesh.rotate_cw(h).expect("a sector has no border inside")
    }
}

/// The rule for an edge in a surface between these two ends.
fn surface_rule(p: End, q: End) -> Rule {
    match (p.is_regular(), q.is_regular()) {
        (false, false) => Rule::Mean,
        (false, true) => p.extraordinary_rule(),
        (true, false) => q.extraordinary_rule(),
        (true, true) => match (p, q) {
            (End::Interior { .. }, End::Interior { .. }) => Rule::R1,
            (End::Crease { i, .. }, End::Crease { i: j, .. }) if i == j => Rule::R5,
            (End::Crease { .. }, End::Crease { .. }) => Rule::R4,
            _ => Rule::R3,
        },
    }
}

/// E2: the weights of the `k` neighbours of an interior end, from the one that the edge goes to.
///
/// The neighbour at angle a = 2πj/k has weight (1/4 + cos a + f cos 2a) / k with f the
/// [`second_harmonic`]; the end itself has 3/4.
fn spoke_weights(k: usize) -> Vec<f64> {
    let n = k as f64;
    let weight = |angle: f64| (0.25 + angle.cos() + second_harmonic(k) * (2.0 * angle).cos()) / n;
    (0..k).map(|j| weight(2.0 * PI * j as f64 / n)).collect()
}

/// f = 1/2 is Zorin's (1/4 + cos a + 1/2 cos 2a) / k. For k = 4 the second harmonic is the last one there
/// is and half as strong, for k = 3 it is the first one again: f = 1/4 and 0 make Zorin's rows
/// (3/8, 0, -1/8, 0) and (5/12, -1/12, -1/12).
fn second_harmonic(k: usize) -> f64 {
    match k {
        0..=3 => 0.0,
        4 => 0.25,
        _ => 0.5,
    }
}

/// Where an extraordinary end at `centre` would have the new vertex on the edge to `spoke`. Exact for
/// linear functions.
fn wish(end: End, sums: &Harmonics, centre: DVec3, spoke: DVec3) -> DVec3 {
    match end {
        End::Interior { k: 0..3 } => centre.midpoint(spoke),
        End::Interior { k } => {
            0.75 * centre + (0.25 * sums.all + sums.cos[0] + second_harmonic(k) * sums.cos[1]) / k as f64
        }
        // E1, with t = π/k and the edge at spoke i:
        //   centre                 1 - sin t sin it / (k (1 - cos t))
        //   neighbour 0 < j < k    (sin it sin jt + 1/2 sin 2it sin 2jt) / k
        //   neighbours 0 and k     ±(cos(it) / 4 - sin 2t sin 2it / (4k (cos t - cos 2t)))
        End::Crease { k, i } => {
            let n = k as f64;
            let ((sin_t, cos_t), (sin_2t, cos_2t)) = ((PI / n).sin_cos(), (2.0 * PI / n).sin_cos());
            let ((sin_it, cos_it), sin_2it) =
                ((i as f64 * PI / n).sin_cos(), (2.0 * i as f64 * PI / n).sin());
            let at_centre = 1.0 - sin_t * sin_it / (n * (1.0 - cos_t));
            let at_ends = 0.25 * cos_it - sin_2t * sin_2it / (4.0 * n * (cos_t - cos_2t));
            at_centre * centre
                + at_ends * sums.first_less_last
                + (sin_it * sums.sin[0] + 0.5 * sin_2it * sums.sin[1]) / n
        }
    }
}
