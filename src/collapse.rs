//! Removes the degenerate faces that subdivision left at inserted vertices.
//!
//! ```text
//!   needle: one tiny angle          cap: two tiny angles
//!     p------------.                      .  r
//!     q------------'                 p ---------- q
//!   collapse p-q                     flip p-q (the edge opposite to a tiny angle is *long*)
//! ```
//!
//! Based on: Sharpen&Bend section 3.3 (an angle below 1 degree is degenerate).
//! Differs: caps are flipped, since collapsing as the paper says would destroy them; only faces that own
//! an inserted vertex count (the user's own slivers stay); a collapse must keep the surface a surface and
//! must not turn a good face over (Paper silent).
//! In/out: edits the refined mesh in place; says how many faces were mended and how many left.
//! Cost: O(faces at inserted vertices), up to 20 times.

use glam::DVec3;
use rayon::prelude::*;

use crate::edit::Edit;
use crate::geometry::inner_angles;
use crate::mesh::{Face, Vert};

/// A face with a smaller angle is degenerate, in radians: the paper's 1 degree.
const MIN_ANGLE: f64 = std::f64::consts::PI / 180.0;
/// A collapse may not turn a good face by more than 78 degrees.
const MIN_TURN_COSINE: f64 = 0.2;
/// A cap's shortest side is longer than this share of its longest: otherwise two of its points nearly
/// coincide, and a collapse is the cure.
const CAP_SIDE: f64 = 0.05;
/// Each round mends what the one before uncovered; three suffice in practice.
const MAX_ROUNDS: usize = 20;

/// What became of the degenerate faces.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct CollapseCounts {
    /// Needles collapsed.
    pub collapsed: usize,
    /// Caps flipped.
    pub flipped: usize,
    /// Degenerate faces that neither could mend.
    pub left: usize,
}

/// Mends the degenerate faces among `faces` that own an inserted vertex. `is_moved` says of an inserted
/// vertex whether it went onto its feature: such a vertex is kept first, then any inserted one.
pub(crate) fn collapse_degenerate_faces(
    edit: &mut Edit<'_>,
    faces: &[Face],
    is_moved: impl Fn(Vert) -> bool,
) -> CollapseCounts {
    let mut counts = CollapseCounts::default();
    for _ in 0..MAX_ROUNDS {
        let mut mended = 0;
        counts.left = 0;
        for f in degenerate_faces(edit, faces) {
            if !edit.stands(f) || smallest_angle(edit, f) >= MIN_ANGLE {
                continue;
            }
            match mend(edit, f, &is_moved) {
                Mended::Collapsed => counts.collapsed += 1,
                Mended::Flipped => counts.flipped += 1,
                Mended::Not => {
                    counts.left += 1;
                    continue;
                }
            }
            mended += 1;
        }
        if mended == 0 {
            break;
        }
    }
    counts
}

/// The degenerate faces with an inserted vertex, the smallest angle first (a tie goes to the lower face).
fn degenerate_faces(edit: &Edit<'_>, faces: &[Face]) -> Vec<Face> {
    let owns_inserted = |f: Face| edit.corners(f).iter().any(|&v| edit.is_inserted(v));
    let mut found: Vec<(u64, Face)> = faces
        .par_iter()
        .filter(|&&f| edit.stands(f) && owns_inserted(f) && !is_clearly_wide(edit.triangle(f)))
        .map(|&f| (smallest_angle(edit, f), f))
        .filter(|&(angle, _)| angle < MIN_ANGLE)
        .map(|(angle, f)| (angle.to_bits(), f)) // Angles are not negative: their bits order as they do.
        .collect();
    found.sort_unstable();
    found.into_iter().map(|(_, f)| f).collect()
}

/// Whether all angles of a triangle are well above [`MIN_ANGLE`]: told without computing any. The smallest angle
/// lies between the two longest sides.
fn is_clearly_wide([a, b, c]: [DVec3; 3]) -> bool {
    /// The square of the sine of twice the angle.
    const WIDE: f64 = 4.0 * MIN_ANGLE * MIN_ANGLE;
    let sides = [a.distance_squared(b), b.distance_squared(c), c.distance_squared(a)];
    let shortest = sides[0].min(sides[1]).min(sides[2]);
    let of_longer_two = if shortest == sides[0] {
        sides[1] * sides[2]
    } else if shortest == sides[1] {
        sides[2] * sides[0]
    } else {
        sides[0] * sides[1]
    };
    (b - a).cross(c - a).length_squared() > WIDE * of_longer_two
}

fn smallest_angle(edit: &Edit<'_>, f: Face) -> f64 {
    inner_angles(edit.triangle(f)).into_iter().fold(f64::INFINITY, f64::min)
}

enum Mended {
    Collapsed,
    Flipped,
    Not,
}

fn mend(edit: &mut Edit<'_>, f: Face, is_moved: impl Fn(Vert) -> bool) -> Mended {
    let angles = inner_angles(edit.triangle(f));
    let corners = edit.corners(f);
    let sides =
        [0, 1, 2].map(|i| edit.point(corners[(i + 1) % 3]).distance(edit.point(corners[(i + 2) % 3])));
    let (shortest, longest) = sides.iter().fold((f64::INFINITY, 0.0f64), |(s, l), &x| (s.min(x), l.max(x)));
    let widest = (0..3).max_by(|&i, &j| angles[i].total_cmp(&angles[j])).unwrap_or(0);
    if angles[widest] > std::f64::consts::PI - 2.0 * MIN_ANGLE && shortest > CAP_SIDE * longest {
        let flipped = flip(edit, f, corners[(widest + 1) % 3], corners[(widest + 2) % 3]);
        return if flipped { Mended::Flipped } else { Mended::Not };
    }
    let tip = (0..3).min_by(|&i, &j| angles[i].total_cmp(&angles[j])).unwrap_or(0);
    let (p, q) = (corners[(tip + 1) % 3], corners[(tip + 2) % 3]);
    let worth = |v: Vert| (edit.is_inserted(v) && is_moved(v), edit.is_inserted(v), std::cmp::Reverse(v));
    let (kept, gone) = if worth(p) >= worth(q) { (p, q) } else { (q, p) };
    if collapse(edit, gone, kept) || collapse(edit, kept, gone) { Mended::Collapsed } else { Mended::Not }
}

fn collapse(edit: &mut Edit<'_>, gone: Vert, kept: Vert) -> bool {
    let Some(beside) = edit.collapsible(gone, kept) else { return false };
    let turns_over = |f: Face| {
        let before = edit.triangle(f);
        let after = edit.corners(f).map(|v| edit.point(if v == gone { kept } else { v }));
        let [n, m] = [before, after].map(|[a, b, c]| (b - a).cross(c - a));
        let is_good = || inner_angles(before).into_iter().all(|angle| angle >= MIN_ANGLE);
        n.dot(m) < MIN_TURN_COSINE * n.length() * m.length() && is_good()
    };
    if edit.faces_at(gone).iter().copied().filter(|f| !beside.contains(f)).any(turns_over) {
        return false;
    }
    edit.collapse(gone, kept);
    true
}

/// Flips edge `a`-`b` of face `f` if that widens the smallest of the six angles.
fn flip(edit: &mut Edit<'_>, f: Face, a: Vert, b: Vert) -> bool {
    let Some([_, g]) = edit.faces_beside(a, b).filter(|faces| faces[0] == f) else { return false };
    let Some(flipped) = edit.flippable([f, g], a, b) else { return false };
    let narrowest = |triangles: [[Vert; 3]; 2]| {
        let angles = triangles.into_iter().flat_map(|t| inner_angles(t.map(|v| edit.point(v))));
        angles.fold(f64::INFINITY, f64::min)
    };
    // One part in 10^9: equal but for rounding is no gain.
    if narrowest(flipped) <= narrowest([edit.corners(f), edit.corners(g)]) * (1.0 + 1e-9) {
        return false;
    }
    edit.flip([f, g], flipped);
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tests::mesh;
    use crate::mesh::{Mesh, PerVert};
    use crate::refine::{Inserts, refine};
    use glam::dvec3;

    fn mended(m: &Mesh, n_old: usize) -> (CollapseCounts, Vec<[usize; 3]>) {
        let inserts = Inserts::none();
        let refined = refine(m, &inserts).unwrap();
        let is_whole = PerVert::filled(m.n_verts(), true);
        let mut edit = Edit::new(&refined, n_old, &is_whole);
        let faces: Vec<_> = m.face_ids().collect();
        let counts = collapse_degenerate_faces(&mut edit, &faces, |_| true);
        let edited = edit.finish(m, &inserts, |v| v, true).unwrap();
        (counts, edited.mesh.faces().iter().map(|f| f.map(Vert::index)).collect())
    }

    /// An octagon of border vertices 2..=9 round two middle vertices 0 and 1, `gap` apart.
    ///
    /// ```text
    ///       4--3
    ///      /    \
    ///     5      2
    ///     |  01  |
    ///     6      9
    ///      \    /
    ///       7--8
    /// ```
    fn octagon(gap: f64) -> Mesh {
        let mut points = vec![[-gap / 2., 0., 0.], [gap / 2., 0., 0.]];
        points.extend((0..8).map(|i| {
            let angle = (f64::from(i) + 0.5) * std::f64::consts::FRAC_PI_4;
            [angle.cos(), angle.sin(), 0.]
        }));
        let faces = [
            [1, 9, 2],
            [1, 2, 3],
            [1, 3, 0],
            [0, 3, 4],
            [0, 4, 5],
            [0, 5, 6],
            [0, 6, 7],
            [0, 7, 1],
            [1, 7, 8],
            [1, 8, 9],
        ];
        mesh(&points, &faces)
    }

    #[test]
    fn a_needle_is_collapsed_into_the_inserted_vertex() {
        let (counts, faces) = mended(&octagon(0.001), 1);
        assert_eq!(counts, CollapseCounts { collapsed: 1, flipped: 0, left: 0 });
        // Vertex 0, the only old one, is gone; the last vertex, 9, stands in its slot.
        let expected =
            [[1, 0, 2], [1, 2, 3], [1, 3, 4], [1, 4, 5], [1, 5, 6], [1, 6, 7], [1, 7, 8], [1, 8, 0]];
        assert_eq!(faces, expected);
    }

    #[test]
    fn slivers_of_the_users_own_stay() {
        let m = octagon(0.001);
        let (counts, faces) = mended(&m, 10);
        assert_eq!(counts, CollapseCounts::default());
        assert_eq!(faces.len(), m.n_faces());
    }

    #[test]
    fn a_good_triangle_is_left_alone() {
        assert_eq!(mended(&octagon(0.5), 0).0, CollapseCounts::default());
    }

    #[test]
    fn what_is_clearly_wide_has_no_angle_below_the_limit() {
        let narrow = |degrees: f64, turn: usize| {
            let mut t = [dvec3(0., 0., 0.), dvec3(1., 0., 0.), DVec3::ZERO];
            t[2] = 0.9 * dvec3(degrees.to_radians().cos(), degrees.to_radians().sin(), 0.);
            t.rotate_left(turn);
            is_clearly_wide(t)
        };
        for turn in 0..3 {
            assert!(!narrow(0.0, turn) && !narrow(1.01, turn) && !narrow(1.9, turn));
            assert!(narrow(2.1, turn) && narrow(90.0, turn) && !narrow(178.9, turn));
        }
        assert!(!is_clearly_wide([DVec3::ONE; 3]) && !is_clearly_wide([DVec3::NAN; 3]));
    }

    // 3---2     Vertex 4 lies on the diagonal 0-2 but for a hair: face 0 2 4 is a cap.
    // | / |
    // 0---1
    #[test]
    fn a_cap_is_flipped() {
        let m = mesh(
            &[[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.], [0.499, 0.501, 0.]],
            &[[0, 1, 2], [0, 2, 4], [2, 3, 4], [3, 0, 4]],
        );
        let (counts, faces) = mended(&m, 4);
        assert_eq!(counts, CollapseCounts { collapsed: 0, flipped: 1, left: 0 });
        assert_eq!(faces, [[1, 2, 4], [0, 1, 4], [2, 3, 4], [3, 0, 4]]);
    }
}
