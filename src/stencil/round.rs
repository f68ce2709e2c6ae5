//! How far from the middle of its edge the new vertex is on a surface or curve that is round.
//!
//! ```text
//!            x              Four points of a circle with the same angle t from one to the next. The four-point
//!       q---------p         rule puts x at R sin²(t/2) cos(t/2) / 2 above the middle of p q, the circle is
//!      /           \        2 R sin²(t/4) above it: 1 / (cos²(t/4) cos(t/2)) times as far. For 16 points
//!     a             b       that is 1.03, for six 1.24.
//! ```
//!
//! Based on: Dyn, Levin and Luzzatto 2003 (subdivision that reproduces exponentials, here the four-point rule with the
//! weights of a circle). Butterfly is the four-point rule round a cylinder whose lattice is even, so that the same
//! factor makes it exact there. Nothing in the papers, whose scheme is exact for cubics, but leaves what its first level
//! misses a circle by: three levels on 16 points end .0008 of the radius from it, here .0003, and each one is as good
//! as the first.
//! Differs: the angle is not given, but read off the normals or turns at both ends of each edge.
//! In/out: what normals or turns there are at the ends of an edge -> displacements and factors.

use glam::DVec3;

/// A curve that turns by more than this at a vertex has a corner there: 60 degrees, a hexagon's turn. The
/// hole of five edges that a scan leaves in a plane is no circle, and bent into one it only grows
/// (fandisk scan_20k: Emax 0.748 % of the diagonal, with this rule 0.673 %, which it has without bending).
const MAX_TURN_COS: f64 = 0.5;

/// Whether a curve that arrives in a vertex along `before` and leaves it along `after` goes on smoothly.
pub(super) fn is_smooth_turn(before: DVec3, after: DVec3) -> bool {
    before.dot(after) >= MAX_TURN_COS * before.length() * after.length()
}

/// How far from the middle of `edge` a surface is expected that has these unit normals at the two ends.
///
/// ```text
///      n \   x   / m      From p the parabola that leaves p at a right angle to n and arrives in q, from q
///         \  .  /         the one that leaves q at a right angle to m: a quarter of their slopes against
///          p - q          the edge. The two agree on a sphere; on noise they do not.
/// ```
pub(super) fn expected_by_normals(edge: DVec3, n: DVec3, m: DVec3) -> [DVec3; 2] {
    let up = (n + m).normalize_or_zero();
    // A normal that lies flat would promise the moon; its slope ends at that of 78 degrees.
    let slope = |normal: DVec3| normal.dot(edge) / normal.dot(up).max(0.2);
    [-0.25 * slope(n) * up, 0.25 * slope(m) * up]
}

/// How many times as far from the middle of its edge as a stencil puts it a new vertex is on a cylinder or circle that
/// turns by an angle with this cosine from one end of the edge to the other. What turns by more than [`MAX_TURN_COS`] is
/// as round as a hexagon.
pub(super) fn roundness(cosine: f64) -> f64 {
    let half = (0.5 * (1.0 + cosine.max(MAX_TURN_COS))).sqrt(); // And cos²(t/4) is (1 + half) / 2.
    2.0 / (half * (1.0 + half))
}

/// The cosine of the angle by which a circle turns if the ends of an edge expect the new vertex so far from the middle,
/// in lengths of the edge: that is an eighth of the sine.
pub(super) fn turn_of_bulge(bulge: f64) -> f64 {
    (1.0 - (8.0 * bulge).powi(2)).max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use approx::assert_relative_eq;
    use glam::DVec2;

    #[test]
    fn the_four_point_rule_times_the_roundness_is_on_the_circle() {
        for n in [6, 7, 16, 100] {
            let [a, p, q, b] = [-1.5, -0.5, 0.5, 1.5].map(|i| DVec2::from_angle(TAU * i / f64::from(n)));
            let middle = p.midpoint(q);
            let way = (p + q) * (9.0 / 16.0) - (a + b) / 16.0 - middle;
            assert_relative_eq!((middle + roundness(p.dot(q)) * way).length(), 1.0, epsilon = 1e-12);
            let bulge = middle.distance((a + b) / 2.0) / 8.0 / p.distance(q);
            assert_relative_eq!(turn_of_bulge(bulge), p.dot(q), epsilon = 1e-12);
        }
    }

    #[test]
    fn what_is_flat_is_not_round_and_nothing_is_rounder_than_a_hexagon() {
        let of = |degrees: f64| roundness(degrees.to_radians().cos());
        assert_eq!([of(0.0), turn_of_bulge(0.0)], [1.0; 2]);
        assert!(of(59.9) < of(60.0) && of(60.0) < 1.25);
        assert_eq!([60.1, 90.0, 180.0].map(of), [roundness(0.5); 3]);
        assert_eq!([0.2, f64::INFINITY, f64::NAN].map(turn_of_bulge), [0.0; 3]);
    }
}
