//! What holds for every mesh.

use std::collections::HashSet;

mod common;
#[path = "common/laws.rs"]
mod laws;
#[path = "common/random.rs"]
mod random;

use glam::DVec3;
use laws::{bits, obey_laws};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use random::{Numbers, any_mesh, map, options, rotation, sampling};
use sharpen::mesh::Vert;
use sharpen::{Mesh, Options, Report, sharpen};

/// Few cases, since there is no optimisation here, and the same in each run: `PROPTEST_CASES` asks for more,
/// `PROPTEST_RNG_SEED` for others.
fn config() -> ProptestConfig {
    let mut config = ProptestConfig { failure_persistence: None, ..ProptestConfig::default() };
    if config.rng_seed == RngSeed::Random {
        config.rng_seed = RngSeed::Fixed(1);
    }
    let cases = if std::env::var_os("PROPTEST_CASES").is_some() { config.cases } else { 48 };
    ProptestConfig { cases, ..config }
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn any_mesh_by_default(mesh in any_mesh()) {
        obey_laws(&mesh.0, &Options::default());
    }

    #[test]
    fn any_mesh_with_any_options(mesh in any_mesh(), options in options()) {
        obey_laws(&mesh.0, &options);
    }
}

/// Whether untangling did something. Of moves that are as good it takes the first, which is another one
/// when faces have another order or points another last bit: seen in one mesh of a thousand.
fn had_to_choose(report: &Report) -> bool {
    report.untangled.is_some_and(|u| u.collapsed + u.loosened + u.flipped + u.respaced + u.moved_back > 0)
}

/// Checks that `f`, applied before or after, makes the same mesh but for `tolerance` in each point.
fn commutes(
    mesh: &Mesh,
    options: &Options,
    tolerance: f64,
    f: impl Fn(DVec3) -> DVec3,
) -> Result<(), TestCaseError> {
    let plain = sharpen(mesh, options).unwrap();
    let moved = sharpen(&map(mesh, &f), options).unwrap();
    prop_assert_eq!(moved.report.found.chamfer_edges, plain.report.found.chamfer_edges);
    if moved.mesh.faces() != plain.mesh.faces() {
        prop_assert!(had_to_choose(&plain.report), "other faces");
        return Ok(());
    }
    for (i, (p, q)) in plain.mesh.points().iter().zip(moved.mesh.points()).enumerate() {
        let off = f(*p).distance(*q);
        prop_assert!(
            off <= tolerance,
            "vertex {} of {} is off by {:e}, may by {:e}",
            i,
            mesh.n_verts(),
            off,
            tolerance
        );
    }
    Ok(())
}

/// Shares of the diagonal. 99 of 100 meshes keep 3e-16, all of 2000 this.
const TOLERANCE: f64 = 1e-9;

/// Bending weighs displacements against the noise of their surroundings, which here goes down to 1e-4: each
/// level makes so much more of what rounding does.
fn steepness(options: &Options) -> f64 {
    100f64.powi(options.bend as i32)
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn powers_of_two_scale_bit_for_bit(mesh in any_mesh(), options in options(), power in -40..40i32) {
        commutes(&mesh.0, &options, 0.0, |p| p * 2f64.powi(power))?;
    }

    #[test]
    fn any_scale_commutes(mesh in sampling(), options in options(), power in -6.0..6.0f64) {
        let scale = 10f64.powf(power);
        commutes(&mesh, &options, TOLERANCE * scale * mesh.diagonal() * steepness(&options), |p| p * scale)?;
    }

    #[test]
    fn rotation_commutes(mesh in sampling(), options in options(), rotation in rotation()) {
        commutes(&mesh, &options, TOLERANCE * mesh.diagonal() * steepness(&options), |p| rotation * p)?;
    }

    /// Up to some million diagonals away. The offset itself loses no bit, but what the mesh gets there has
    /// fewer.
    #[test]
    fn offset_commutes(
        mesh in sampling(),
        options in options(),
        offset in [-1000..1000i32, -1000..1000i32, -1000..1000i32],
        power in 0..13,
    ) {
        let offset = DVec3::from(offset.map(f64::from)) * 2f64.powi(power);
        let times = if options.bend == 0 { 8.0 } else { 1e5 };
        let tolerance = TOLERANCE * mesh.diagonal() * steepness(&options) + times * f64::EPSILON * offset.length();
        commutes(&mesh, &options, tolerance, |p| p + offset)?;
    }

    #[test]
    fn any_number_of_threads_makes_the_same_bits(mesh in any_mesh(), options in options()) {
        let [one, two, seven] = [1, 2, 7].map(|n| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
            pool.install(|| sharpen(&mesh.0, &options)).unwrap()
        });
        for other in [two, seven] {
            prop_assert_eq!(bits(one.mesh.points()), bits(other.mesh.points()));
            prop_assert_eq!(one.mesh.faces(), other.mesh.faces());
            prop_assert_eq!(one.tags.sharp_edges(), other.tags.sharp_edges());
        }
    }

    #[test]
    fn the_order_of_the_faces_does_not_matter(mesh in sampling(), options in options(), seed in any::<u64>()) {
        let mut order: Vec<usize> = (0..mesh.n_faces()).collect();
        let mut random = Numbers(seed);
        order.sort_by_cached_key(|_| random.next());
        let faces = order.iter().map(|&f| {
            let mut corners = mesh.faces()[f];
            corners.rotate_left(random.next() as usize % 3);
            corners
        });
        let shuffled = Mesh::new(mesh.points().to_vec(), faces.collect()).unwrap();
        let (plain, other) = (sharpen(&mesh, &options).unwrap(), sharpen(&shuffled, &options).unwrap());
        prop_assert_eq!(plain.report.found.chamfer_edges, other.report.found.chamfer_edges);
        prop_assert_eq!(plain.report.found.corner_triangles, other.report.found.corner_triangles);
        let tolerance = TOLERANCE * mesh.diagonal() * steepness(&options);
        let n_other = n_other_triangles(&plain.mesh, &other.mesh, tolerance);
        prop_assert!(n_other == 0 || had_to_choose(&plain.report), "{} other triangles", n_other);
    }
}

/// How many triangles of `a` are not in `b`, whatever their order and that of their corners, where points
/// within `tolerance` are one.
fn n_other_triangles(a: &Mesh, b: &Mesh, tolerance: f64) -> usize {
    let nearest = |p: DVec3| {
        let off = |v: &Vert| b.point(*v).distance(p);
        b.verts().min_by(|v, w| off(v).total_cmp(&off(w))).filter(|v| off(v) <= tolerance)
    };
    let in_b: Vec<Option<Vert>> = a.points().iter().copied().map(nearest).collect();
    let first_first = |f: [Option<Vert>; 3]| {
        let i = (0..3).min_by_key(|&i| f[i]).unwrap_or(0);
        [f[i], f[(i + 1) % 3], f[(i + 2) % 3]]
    };
    let there: HashSet<_> = b.faces().iter().map(|f| first_first(f.map(Some))).collect();
    let here = a.faces().iter().map(|f| first_first(f.map(|v| in_b[v.index()])));
    here.filter(|f| !there.contains(f)).count()
}
