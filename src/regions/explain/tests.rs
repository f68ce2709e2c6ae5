use super::*;
use crate::mesh::Mesh;
use crate::regions::tests::{cut_cube, labels};

#[test]
fn vertices_beside_an_edge_take_the_side_they_lie_on() {
    let m = cut_cube(6);
    let normals = m.face_normals();
    let fits = explain_by_regions(&Surface::new(&m, &normals, &labels(&m).1));
    assert!(fits.iter().count() > 100);
    for (v, fit) in fits.iter() {
        let p = m.point(v);
        let outward = DVec3::from(p.to_array().map(|c| f64::from(c == 6.0) - f64::from(c == 0.0)));
        assert!(fit.normal.distance(outward) < 1e-9, "{v:?} at {p}: {}", fit.normal);
        assert!(fit.displacement.abs() < 1e-9 && fit.source == FitSource::Region);
    }
}

#[test]
fn what_nothing_explains_is_part_of_an_exact_side_if_that_is_not_too_far() {
    // A sample in the middle of a side goes inside, and all of them may be a little uneven.
    let flat = cut_cube(10);
    let h = Surface::new(&flat, &flat.face_normals(), &labels(&flat).1).h;
    let sample = |off: f64, uneven: f64, is_marching_cubes: bool| {
        let (mut points, faces) = flat.clone().into_parts();
        let v = Vert::new(points.iter().position(|p| *p == DVec3::new(4.5, 4.5, 0.0)).unwrap());
        points.iter_mut().enumerate().for_each(|(i, p)| p.z += uneven * (7.0 * i as f64).sin());
        points[v.index()].z += off * h;
        let m = Mesh::new(points, faces).unwrap();
        let normals = m.face_normals();
        let surface = Surface::new(&m, &normals, &labels(&m).1);
        assert!(!surface.interior[v]);
        let mut fits = VertexFits::none(m.n_verts(), surface.doubtful.clone());
        explain_by_exact_sides(&surface, &mut fits, is_marching_cubes);
        fits.get(v).map(|fit| (fit.normal, fit.displacement))
    };
    let found = |off: f64, uneven: f64| sample(off, uneven, true);
    let (normal, displacement) = found(0.45, 0.0).unwrap();
    assert!(normal.distance(-DVec3::Z) < 1e-4 && (displacement - 0.45).abs() < 0.02, "{displacement}");
    assert_eq!(found(0.55, 0.0), None);
    assert_eq!(found(0.45, 1e-3), None);
    assert_eq!([1e-4, 2e-4].map(|uneven| found(0.45, uneven).is_some()), [true, false]);
    // Those of surface nets may be deeper.
    assert_eq!([0.65, 0.75].map(|off| sample(off, 0.0, false).is_some()), [true, false]);
}

#[test]
fn interior_vertices_take_the_fit_beside_them_where_it_is_that_of_their_region() {
    let m = cut_cube(6);
    let normals = m.face_normals();
    let mut surface = Surface::new(&m, &normals, &labels(&m).1);
    let fits = explain_by_regions(&surface);
    let beside: Vec<Vert> = fits.verts.iter().copied().filter(|&v| surface.interior[v]).collect();
    assert!(beside.len() > 20);
    let taken = |surface: &Surface, fits: &VertexFits| {
        beside.iter().filter_map(|&v| fit_from_beside(surface, fits, v)).collect::<Vec<_>>()
    };
    let found = taken(&surface, &fits);
    assert_eq!(found.len(), beside.len());
    for (&v, fit) in beside.iter().zip(&found) {
        // The vertex that it was made for is another one, on the same plane.
        assert!(fit.origin != m.point(v) && fit.displacement.abs() < 1e-9 && fit.distance == 0.0);
        assert!(fit.normal.dot(fit.origin - m.point(v)).abs() < 1e-9);
    }
    // Planes of the same direction that are 0.1 h off are another surface's, and so are others that lean.
    let changed = |change: &dyn Fn(&mut Fit)| {
        let mut fits = fits.clone();
        fits.fits.iter_mut().flatten().for_each(change);
        taken(&surface, &fits).len()
    };
    let (h, lean) = (surface.h, 25f64.to_radians().tan());
    assert_eq!(changed(&|fit| fit.origin += 0.04 * h * fit.normal), beside.len());
    assert_eq!(changed(&|fit| fit.origin += 0.1 * h * fit.normal), 0);
    assert_eq!(changed(&|fit| fit.coefficients[1] = lean), 0);
    // Off by 0.04 h above: so far the vertex is from it, along its normal.
    let mut above = fits.clone();
    above.fits.iter_mut().flatten().for_each(|fit| fit.origin += 0.04 * h * fit.normal);
    assert!(taken(&surface, &above).iter().all(|fit| (fit.displacement - 0.04).abs() < 1e-9));
    // Without doubtful vertices beside it there is none.
    surface.near.interior.fill(true);
    assert_eq!(taken(&surface, &fits).len(), 0);
}

#[test]
fn every_doubtful_vertex_is_in_one_group_beside_its_first() {
    let m = cut_cube(6);
    let normals = m.face_normals();
    let surface = Surface::new(&m, &normals, &labels(&m).1);
    let fits = VertexFits::none(m.n_verts(), surface.doubtful.clone());
    let (verts, groups) = groups(&surface, &fits);
    let name = |&i: &u32| surface.near.verts[i as usize];
    let mut grouped: Vec<Vert> = verts.iter().map(name).collect();
    grouped.sort_unstable();
    let others = surface.doubtful.iter().copied().filter(|&v| !surface.interior[v]);
    assert_eq!(grouped, others.collect::<Vec<_>>());
    assert!(4 * groups.len() < verts.len(), "{} of {}", groups.len(), verts.len());
    let mut next = 0;
    for group in groups {
        assert!(group.start == next && !group.is_empty());
        next = group.end;
        let first = verts[group.start];
        let is_beside = |i: &u32| surface.near.neighbours(first).contains(i);
        assert!(verts[group.start + 1..group.end].iter().all(is_beside));
    }
    assert_eq!(next, verts.len());
}

#[test]
fn vertices_of_a_group_have_the_fits_that_they_would_have_alone() {
    let m = cut_cube(6);
    let normals = m.face_normals();
    let surface = Surface::new(&m, &normals, &labels(&m).1);
    let fits = VertexFits::none(m.n_verts(), surface.doubtful.clone());
    let (verts, groups) = groups(&surface, &fits);
    let mut explainer = Explainer::default();
    let (mut together, mut alone) = (Vec::new(), Vec::new());
    groups.iter().for_each(|g| explainer.explain_group(&surface, &verts[g.clone()], &mut together));
    verts.iter().for_each(|&i| explainer.explain_group(&surface, &[i], &mut alone));
    assert_eq!(together.len(), alone.len());
    for ((v, fit), (w, own)) in together.iter().zip(&alone) {
        assert!(v == w && fit.origin == own.origin && fit.distance == own.distance);
        assert!(fit.normal.distance(own.normal) < 1e-9, "{v:?}: {} {}", fit.normal, own.normal);
        assert!((fit.displacement - own.displacement).abs() < 1e-9);
    }
}

#[test]
fn fits_do_not_depend_on_what_was_explained_before() {
    // Turned, so that the same plane is not the same to the last bit from everywhere.
    let turn = glam::DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -1.1, 2.0);
    let (points, faces) = cut_cube(6).into_parts();
    let m = Mesh::new(points.into_iter().map(|p| turn * p).collect(), faces).unwrap();
    let normals = m.face_normals();
    let surface = Surface::new(&m, &normals, &labels(&m).1);
    let fits = VertexFits::none(m.n_verts(), surface.doubtful.clone());
    let (verts, groups) = groups(&surface, &fits);
    let mut worker = Explainer::default();
    let (mut found, mut fresh) = (Vec::new(), Vec::new());
    for group in groups {
        worker.explain_group(&surface, &verts[group.clone()], &mut found);
        Explainer::default().explain_group(&surface, &verts[group], &mut fresh);
    }
    let bits = |found: &[(Vert, Fit)]| {
        found.iter().map(|(v, fit)| (*v, fit.coefficients, fit.frame)).collect::<Vec<_>>()
    };
    assert!(found.len() > 100);
    assert_eq!(bits(&found), bits(&fresh));
}

#[test]
fn groups_are_the_same_at_any_scale_and_ascend() {
    let grouped = |scale: f64| {
        let (points, faces) = cut_cube(6).into_parts();
        let m = Mesh::new(points.into_iter().map(|p| scale * p).collect(), faces).unwrap();
        let normals = m.face_normals();
        let surface = Surface::new(&m, &normals, &labels(&m).1);
        groups(&surface, &VertexFits::none(m.n_verts(), surface.doubtful.clone()))
    };
    let (verts, groups) = grouped(1.0);
    assert_eq!((&verts, &groups), (&grouped(128.0).0, &grouped(128.0).1));
    assert!(groups.into_iter().all(|group| verts[group][1..].is_sorted()));
}

#[test]
fn a_vertex_far_from_all_regions_has_no_fit() {
    let m = cut_cube(6);
    let (normals, labels) = labels(&m);
    let surface = Surface::new(&m, &normals, &labels);
    let fits = explain_by_regions(&surface);
    // One on the chamfers, pulled outwards along its normal.
    let v = *fits.verts.iter().find(|&&v| !surface.interior[v] && fits.get(v).is_some()).unwrap();
    let off = |by: f64| {
        let (mut points, faces) = m.clone().into_parts();
        points[v.index()] += by * surface.h * fits.get(v).unwrap().normal;
        let m = Mesh::new(points, faces).unwrap();
        let normals = m.face_normals();
        let mut surface = Surface::new(&m, &normals, &labels);
        surface.h = 1.0;
        explain_by_regions(&surface).get(v).map(|fit| fit.displacement.abs())
    };
    let [near, far] = [0.3, 0.4].map(off);
    assert!(near.is_some_and(|off| off > 0.3) && far.is_none(), "{near:?} {far:?}");
}

#[test]
fn interior_vertices_take_the_fit_of_the_nearest_one() {
    let m = cut_cube(6);
    let normals = m.face_normals();
    let surface = Surface::new(&m, &normals, &labels(&m).1);
    let mut fits = explain_by_regions(&surface);
    // Each fit is known by its vertex.
    let verts = fits.verts.clone();
    fits.fits.iter_mut().zip(&verts).for_each(|(fit, v)| {
        if let Some(fit) = fit {
            fit.n_members = v.index();
        }
    });
    let mut n_choices = 0;
    for &v in verts.iter().filter(|&&v| surface.interior[v]) {
        let giver = Vert::new(fit_from_beside(&surface, &fits, v).unwrap().n_members);
        let near = &surface.near;
        let neighbours = near.neighbours(near.of[v]).iter().map(|&i| near.verts[i as usize]);
        let others = neighbours.filter(|&w| !surface.interior[w]);
        let distances: Vec<f64> = others.map(|w| m.point(w).distance(m.point(v))).collect();
        let least = distances.iter().copied().fold(f64::INFINITY, f64::min);
        assert_eq!(m.point(giver).distance(m.point(v)), least);
        n_choices += usize::from(distances.iter().any(|&d| d > least + 0.1));
    }
    assert!(n_choices > 5, "{n_choices}");
}

#[test]
fn clusters_seen_from_elsewhere_are_as_far_as_their_nearest_members() {
    let m = cut_cube(12);
    let normals = m.face_normals();
    let surface = Surface::new(&m, &normals, &labels(&m).1);
    let (mut patch, mut seen) = (Patch::default(), Vec::new());
    let mut n_seen = 0;
    for &v in surface.doubtful.iter().filter(|&&v| !surface.interior[v]) {
        let around: Vec<_> = surface.neighbours(v).map(|w| m.point(w)).chain([m.point(v)]).collect();
        patch.search(&surface, &surface, v, 2.0 * surface.h);
        for origin in around {
            let nearest = |cluster: &Cluster| {
                let distances = patch
                    .members(cluster)
                    .iter()
                    .map(|&Member { near: i, .. }| surface.near.points[i as usize].distance_squared(origin));
                distances.fold(f64::INFINITY, f64::min).sqrt()
            };
            patch.clusters_from(&surface, origin, &mut seen);
            assert!(seen.is_sorted_by_key(Cluster::distance));
            assert!(seen.iter().all(|cluster| cluster.distance() == nearest(cluster)));
            let is_within = |cluster: &&Cluster| nearest(cluster) < 2.999 * surface.h;
            assert!(seen.len() >= patch.clusters().iter().filter(is_within).count());
            n_seen += seen.len();
        }
    }
    assert!(n_seen > 1000, "{n_seen}");
}

#[test]
fn samples_are_those_within_reach_and_deep_ones_are_trusted() {
    let m = cut_cube(12);
    let normals = m.face_normals();
    let surface = Surface::new(&m, &normals, &labels(&m).1);
    let v = *surface.doubtful.iter().find(|&&v| !surface.interior[v]).unwrap();
    let mut patch = Patch::default();
    patch.search(&surface, &surface, v, 1.0);
    let mut samples = Samples::default();
    samples.take(&surface, &patch, &patch.clusters()[0], m.point(v));
    let Samples { all, n_deep, .. } = &samples;
    assert!(*n_deep > 0 && *n_deep < all.len());
    assert!(all.iter().all(|sample| sample.offset.length() <= REACH_IN_REGION));
    let weighs = |trust| move |s: &Sample| *s == Sample::new(s.offset, s.normal, trust);
    assert!(all[..*n_deep].iter().all(weighs(1.0)));
    assert!(all[*n_deep..].iter().all(weighs(SHALLOW_TRUST)));
    assert!(all.len() < patch.members(&patch.clusters()[0]).len(), "the patch is wider");
}

// Deep samples with heights `deep(x)` in two rows, and as many that are not deep, at height `outer`.
fn fit_of(n_deep: usize, outer: f64, deep: fn(f64) -> f64) -> Option<Fit> {
    let sample = |i: usize, z: f64, trust| {
        let offset = DVec3::new((i / 2) as f64, (i % 2) as f64, z);
        Sample::new(offset, DVec3::Z, trust)
    };
    let inner = (0..n_deep).map(|i| sample(i, deep((i / 2) as f64), 1.0));
    let outer = (0..n_deep).map(|i| sample(i, outer, SHALLOW_TRUST));
    let mut samples = Samples { all: inner.chain(outer).collect(), n_deep, ..Samples::default() };
    samples.fit(DVec3::ZERO, &mut Fitter::default())
}

#[test]
fn deep_samples_on_a_plane_are_believed_if_they_are_enough() {
    let fit = |n_deep, deep| fit_of(n_deep, 0.2, deep).unwrap();
    let exact = fit(ERODED_MEMBERS, |_| 0.0);
    assert!(exact.is_plane() && exact.displacement.abs() < 1e-9 && exact.n_members == ERODED_MEMBERS);
    assert_eq!(fit(ERODED_MEMBERS - 1, |_| 0.0).n_members, 2 * (ERODED_MEMBERS - 1));
    // They leave a third of what all leave at least: no better.
    let rough = fit(ERODED_MEMBERS, |x| if x % 2.0 == 1.0 { 0.15 } else { 0.0 });
    assert_eq!(rough.n_members, 2 * ERODED_MEMBERS);
    // The last two are a little off the plane of the others.
    let nearly = fit(ERODED_MEMBERS, |x| if x == 3.0 { 0.002 } else { 0.0 });
    assert_eq!(nearly.n_members, ERODED_MEMBERS);
}

#[test]
fn deep_samples_on_a_curve_are_believed_if_the_others_disagree() {
    let members = |off: f64| {
        let sample = |i: usize, trust: f64| {
            let (x, y) = ((i / 2) as f64, (i % 2) as f64);
            let z = 0.05 * x * x + if trust < 1.0 { off * (1.0 - x) } else { 0.0 };
            Sample::new(DVec3::new(x, y, z), DVec3::new(-0.1 * x, 0.0, 1.0).normalize(), trust)
        };
        let trusts = [1.0, SHALLOW_TRUST];
        let all = trusts.into_iter().flat_map(|trust| (0..8).map(move |i| sample(i, trust))).collect();
        let mut samples = Samples { all, n_deep: 8, ..Samples::default() };
        samples.fit(DVec3::ZERO, &mut Fitter::default()).unwrap().n_members
    };
    assert_eq!([0.01, 0.2].map(members), [16, 8]);
}

#[test]
fn where_all_samples_agree_all_count() {
    // They leave 0.001 h, which is no better than what the deep ones leave.
    let fit = fit_of(ERODED_MEMBERS, 0.001, |x| if x % 2.0 == 1.0 { 0.002 } else { 0.0 }).unwrap();
    assert!(fit.rms > ERODED_GAIN * ERODED_RMS && fit.rms < ERODED_RMS, "{}", fit.rms);
    assert_eq!(fit.n_members, 2 * ERODED_MEMBERS);
}

#[test]
fn fits_are_shared_in_a_group_if_they_are_exact() {
    // A cube that is a little uneven: the residuals of its sides are about EXACT_RMS.
    let (mut points, faces) = cut_cube(8).into_parts();
    points.iter_mut().enumerate().for_each(|(i, p)| *p += 0.004 * (7.0 * i as f64).sin());
    let m = Mesh::new(points, faces).unwrap();
    let normals = m.face_normals();
    let surface = Surface::new(&m, &normals, &labels(&m).1);
    let (verts, groups) = groups(&surface, &VertexFits::none(m.n_verts(), surface.doubtful.clone()));
    let (mut explainer, mut found) = (Explainer::default(), Vec::new());
    let (mut shared, mut n_own) = (Vec::new(), 0);
    for group in groups {
        found.clear();
        explainer.explain_group(&surface, &verts[group], &mut found);
        for (i, (_, fit)) in found.iter().enumerate().skip(1) {
            let is_shared = found[..i].iter().any(|(_, giver)| giver.frame == fit.frame);
            if is_shared { shared.push(fit.rms) } else { n_own += 1 }
        }
    }
    let largest = shared.iter().copied().fold(0.0, f64::max);
    assert!(largest > 7e-4 && largest <= 1e-3 && n_own > 20, "{largest} {} {n_own}", shared.len());
}

#[test]
fn samples_that_no_smooth_surface_passes_through_have_no_fit() {
    let fit = |a: f64| {
        let sample = |i: usize| {
            let z = if (i + i / 4).is_multiple_of(2) { a } else { -a };
            let offset = DVec3::new((i % 4) as f64 - 1.5, (i / 4) as f64 - 1.0, z);
            Sample::new(offset, DVec3::Z, SHALLOW_TRUST)
        };
        let mut samples = Samples { all: (0..12).map(sample).collect(), n_deep: 0, ..Samples::default() };
        samples.fit(DVec3::ZERO, &mut Fitter::default())
    };
    assert_eq!([0.23, 0.27].map(|a| fit(a).is_some()), [true, false]);
}
