//! Follows creases whose angle falls below that of a chamfer: they fade into a face.
//!
//! ```text
//!   A---A---A---A---A       angle between A and B    50   42   36   31   25
//!   | / | / | / | / |       a chamfer                 x
//!   B---B---B---B---B       where it goes on               x    x    x
//! ```
//!
//! Based on: hysteresis, as in Canny's edge detector (1986); nothing in the papers.
//! In/out: candidates and their strips -> more candidates, in strips that were kept.
//! Cost: O(chamfer edges).

use super::VertexFits;
use super::gates::{Fate, Strip};
use super::noise::NOISY_RMS;
use super::surface::Surface;
use crate::fit::{Fit, FitSource};
use crate::mesh::{Half, Mesh};

/// A kept strip goes on as long as the fits of the ends differ by this angle, in radians. Of a fandisk's
/// creases 97 % come back without, 98 at 36 degrees, 99 at 30 and no more at 25.
const FADING_ANGLE: f64 = 30.0 * std::f64::consts::PI / 180.0;
/// Fits with a larger residual (in h) do not tell such an angle.
const MAX_RMS: f64 = 0.08;

/// Whether small angles mean anything: noise (the median residual, in h) makes them anywhere, and so do
/// samples off the surface, by which a bracket on marching cubes loses up to 25 % of L2.
pub(super) fn can_follow(noise: f64, is_off_surface: bool) -> bool {
    noise <= NOISY_RMS && !is_off_surface
}

/// Adds to strips that were kept the edges beside them on which they go on with a smaller angle.
pub(super) fn follow(
    surface: &Surface,
    fits: &VertexFits,
    candidates: &mut Vec<Half>,
    strip_of: &mut Vec<u32>,
    strips: &mut [Strip],
) {
    let is_kept = |&(_, &strip): &(&Half, &u32)| strips[strip as usize].fate == Fate::Kept;
    let kept = candidates.iter().zip(strip_of.iter()).filter(is_kept);
    let mut todo: Vec<(Half, u32)> = kept.map(|(&h, &strip)| (h, strip)).collect();
    let mut found: Vec<(Half, u32)> = Vec::new();
    while !todo.is_empty() {
        let is_new = |h: Half| {
            candidates.binary_search(&h).is_err() && found.binary_search_by_key(&h, |&(h, _)| h).is_err()
        };
        let beside = todo.iter().flat_map(|&(h, strip)| beside(surface.mesh, h).map(move |h| (h, strip)));
        todo = beside.filter(|&(h, _)| is_new(h) && is_fading(surface, fits, h)).collect();
        todo.sort_unstable();
        todo.dedup_by_key(|&mut (h, _)| h);
        found.extend(&todo);
        found.sort_unstable();
    }
    for &(_, strip) in &found {
        strips[strip as usize].n_edges += 1;
    }
    found.extend(candidates.iter().copied().zip(strip_of.iter().copied()));
    found.sort_unstable();
    (*candidates, *strip_of) = found.into_iter().unzip();
}

/// The other edges of the faces beside `h`.
fn beside(mesh: &Mesh, h: Half) -> impl Iterator<Item = Half> {
    let faces = [Some(h), mesh.twin(h)].into_iter().flatten();
    faces.flat_map(|h| [h.next(), h.prev()]).map(|h| mesh.edge(h))
}

/// Whether the fits of the ends of `h` make at least the fading angle.
fn is_fading(surface: &Surface, fits: &VertexFits, h: Half) -> bool {
    let Surface { mesh, interior, .. } = surface;
    let (a, b) = (mesh.from(h), mesh.to(h));
    let is_good = |fit: &&Fit| fit.source == FitSource::Region && fit.rms < MAX_RMS;
    let fit = |v| fits.get(v).filter(is_good);
    let (Some(p), Some(q)) = (fit(a), fit(b)) else { return false };
    let middle = mesh.point(a).midpoint(mesh.point(b));
    let normal = |fit: &Fit| fit.evaluate(middle, surface.h).1;
    normal(p).dot(normal(q)) < FADING_ANGLE.cos() && !mesh.is_border(h) && !(interior[a] && interior[b])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Vert;
    use crate::regions::gates;
    use crate::regions::label::tests::surface;
    use crate::regions::patch::tests::strip;
    use crate::regions::tests::planes;
    use glam::{DVec3, dvec3};

    #[test]
    fn a_crease_is_followed_until_its_angle_is_too_small() {
        // Odd vertices face up; the even ones are tilted by less and less.
        let m = strip(8);
        let normals = m.face_normals();
        let surface = surface(&m, &normals);
        let tilt = |v: usize| {
            let angle =
                if v % 2 == 1 { 0.0 } else { [50.0_f64, 42.0, 36.0, 31.0, 25.0, 20.0, 15.0, 10.0][v / 2] };
            dvec3(0.0, angle.to_radians().sin(), angle.to_radians().cos())
        };
        let list: Vec<_> = (0..16).map(|v| (v, tilt(v), 0.0, FitSource::Region)).collect();
        let fits = planes(&m, &list);
        let edge = |a, b| m.edge(m.half_between(Vert::new(a), Vert::new(b)).unwrap());
        let followed = |fits: &VertexFits, fate| {
            let mut candidates = vec![edge(0, 3)];
            let (mut strip_of, mut strips) = gates::judge_strips(&surface, fits, &candidates, 0.0);
            strips[0].fate = fate;
            follow(&surface, fits, &mut candidates, &mut strip_of, &mut strips);
            assert_eq!((strip_of.len(), strips[0].n_edges), (candidates.len(), candidates.len()));
            candidates
        };
        let mut expected =
            [(0, 3), (2, 3), (2, 5), (4, 5), (4, 7), (6, 7), (6, 9)].map(|(a, b)| edge(a, b)).to_vec();
        expected.sort_unstable();
        assert_eq!(followed(&fits, Fate::Kept), expected);
        assert_eq!(followed(&fits, Fate::Round), [edge(0, 3)], "a strip that was left alone");
        assert!(can_follow(0.0, false) && !can_follow(0.03, false) && !can_follow(0.0, true));
        // A poor fit, a guess, and no fit at the second column.
        for change in [|fit: &mut Fit| fit.rms = 0.09, |fit: &mut Fit| fit.source = FitSource::Adopted] {
            let mut fits = planes(&m, &list);
            change(fits.fits[2].as_mut().unwrap());
            assert_eq!(followed(&fits, Fate::Kept), [edge(0, 3)]);
        }
        let fits =
            planes(&m, &[(0, DVec3::Y, 0.0, FitSource::Region), (3, DVec3::Z, 0.0, FitSource::Region)]);
        assert_eq!(followed(&fits, Fate::Kept), [edge(0, 3)]);
    }
}
