//! Joins vertices that stand in one place, for the filter's eyes only.
//!
//! Many exporters write one vertex per corner, or split vertices along material seams. The passes must
//! see one surface there; the file must keep its vertices. So the faces get the lowest vertex of each
//! place as their corners, and [`Attributes::split`] remembers which vertex of the file each corner had.
//! New vertices are one in the file where the file's vertices are one on both sides, else several.
//!
//! In/out: points `[V]`, faces `[F]` -> the same arrays with corners joined; and back.
//! Cost: O(vertices looked at), a hash table of 16 bytes each for a while.

use std::hash::BuildHasher;

use foldhash::fast::RandomState;

use glam::DVec3;

use crate::attributes::{Attributes, Split};
use crate::mesh::{Mesh, Vert};

/// Which vertices count as one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Weld {
    /// Each vertex for itself.
    None,
    /// Those with equal coordinates; -0 equals 0.
    #[default]
    Exact,
    /// Those within this distance of the first one in a place.
    Distance(f64),
}

impl std::str::FromStr for Weld {
    type Err = String;

    /// `none`, `exact` or a distance.
    fn from_str(word: &str) -> Result<Self, String> {
        match word {
            "none" => Ok(Self::None),
            "exact" => Ok(Self::Exact),
            _ => match word.parse() {
                Ok(distance) if distance >= 0.0 && f64::is_finite(distance) => Ok(Self::Distance(distance)),
                _ => Err(format!("{word:?} is neither \"none\" nor \"exact\" nor a distance")),
            },
        }
    }
}

/// For each of `points` the lowest one of `among` that stands in its place, `[V]`; none if each stands
/// alone. `among` is ascending: all vertices, or those on borders, since joining others changes no surface.
#[must_use]
pub fn weld(points: &[DVec3], among: impl IntoIterator<Item = Vert>, weld: Weld) -> Option<Vec<Vert>> {
    let mut places = match weld {
        Weld::None => return None,
        Weld::Exact | Weld::Distance(0.0) => Places::exact(),
        Weld::Distance(distance) => Places::within(distance),
    };
    let mut among = among.into_iter().peekable();
    among.peek()?;
    let mut firsts: Vec<Vert> = (0..points.len()).map(Vert::new).collect();
    let mut is_joined = false;
    for v in among {
        let first = places.find_or_add(points, v);
        is_joined |= first != v;
        firsts[v.index()] = first;
    }
    is_joined.then_some(firsts)
}

/// A hash table of points by place. No result depends on its (random) hash.
pub(crate) struct Places {
    hasher: RandomState,
    /// The width of a grid cell; 0 for a cell per place.
    cell: f64,
    /// The last point of each bucket, and the one before each point in its bucket.
    buckets: Vec<Vert>,
    links: Vec<(Vert, Vert)>,
}

impl Places {
    /// Points with equal coordinates are in one place.
    pub fn exact() -> Self {
        Self::within(0.0)
    }

    fn within(cell: f64) -> Self {
        Self { hasher: RandomState::default(), cell, buckets: vec![Vert::NONE; 64], links: Vec::new() }
    }

    /// The lowest of the points found so far that is in the place of `points[v]`; if there is none, `v`,
    /// which others can be found at from now on.
    pub fn find_or_add(&mut self, points: &[DVec3], v: Vert) -> Vert {
        let point = points[v.index()];
        let found = if self.cell > 0.0 { self.near(points, point) } else { self.at(points, point) };
        if found.is_some() {
            return found;
        }
        if self.links.len() >= self.buckets.len() {
            self.grow(points);
        }
        self.link(points, v);
        v
    }

    fn at(&self, points: &[DVec3], point: DVec3) -> Vert {
        let mut here = self.buckets[self.bucket(point)];
        while here.is_some() {
            let (v, before) = self.links[here.index()];
            if points[v.index()] == point {
                return v;
            }
            here = before;
        }
        Vert::NONE
    }

    /// Looks into the cell of `point` and those round it.
    fn near(&self, points: &[DVec3], point: DVec3) -> Vert {
        let mut found = Vert::NONE;
        for i in 0..27 {
            let step = DVec3::new(f64::from(i % 3), f64::from(i / 3 % 3), f64::from(i / 9)) - DVec3::ONE;
            let mut here = self.buckets[self.hash_bucket((point / self.cell).floor() + step)];
            while here.is_some() {
                let (v, before) = self.links[here.index()];
                if v < found && points[v.index()].distance(point) <= self.cell {
                    found = v;
                }
                here = before;
            }
        }
        found
    }

    fn bucket(&self, point: DVec3) -> usize {
        self.hash_bucket(if self.cell > 0.0 { (point / self.cell).floor() } else { point })
    }

    fn hash_bucket(&self, key: DVec3) -> usize {
        // Adding 0 makes -0 positive.
        let bits = (key + DVec3::ZERO).to_array().map(f64::to_bits);
        self.hasher.hash_one(bits) as usize & (self.buckets.len() - 1)
    }

    fn link(&mut self, points: &[DVec3], v: Vert) {
        let bucket = self.bucket(points[v.index()]);
        let link = Vert::new(self.links.len());
        self.links.push((v, std::mem::replace(&mut self.buckets[bucket], link)));
    }

    fn grow(&mut self, points: &[DVec3]) {
        self.buckets = vec![Vert::NONE; 4 * self.buckets.len()];
        for link in std::mem::take(&mut self.links) {
            self.link(points, link.0);
        }
    }
}

impl Attributes {
    /// Gives the corners of `faces` the vertices that [`weld`] found, and remembers what they were.
    pub fn join(&mut self, faces: &mut [[Vert; 3]], firsts: &[Vert]) {
        let corners = faces.as_flattened_mut();
        self.split = Some(Split { at: corners.to_vec().into(), joined_in: firsts.to_vec().into() });
        corners.iter_mut().for_each(|v| *v = firsts[v.index()]);
    }

    /// The file's own vertices and faces of a `mesh` that was made of joined ones: `points` are the
    /// file's; a vertex that was moved is moved with all that it was joined of. None if nothing was
    /// joined.
    #[must_use]
    pub fn part(&self, points: &[DVec3], mesh: &Mesh) -> Option<(Vec<DVec3>, Vec<[Vert; 3]>)> {
        let split = self.split.as_ref()?;
        let place = |(i, &v): (usize, &Vert)| match (points.get(i), points.get(v.index())) {
            // The mesh's vertex stands where the file's stood that it is named after: it did not move.
            (Some(&own), Some(&first)) if is_same(mesh.point(v), first) => own,
            _ => mesh.point(v),
        };
        let parted = split.joined_in.as_slice().iter().enumerate().map(place).collect();
        let (faces, []) = split.at.as_slice().as_chunks::<3>() else { return None };
        Some((parted, faces.to_vec()))
    }
}

fn is_same(a: DVec3, b: DVec3) -> bool {
    a.to_array().map(f64::to_bits) == b.to_array().map(f64::to_bits)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;

    fn firsts(points: &[[f64; 3]], how: Weld) -> Option<Vec<usize>> {
        let points: Vec<DVec3> = points.iter().map(|&p| p.into()).collect();
        weld(&points, (0..points.len()).map(Vert::new), how)
            .map(|firsts| firsts.into_iter().map(Vert::index).collect())
    }

    #[test]
    fn equal_points_are_joined_in_the_first() {
        let points = [[0., 0., 0.], [1., 0., 0.], [-0., 0., -0.], [1., 0., 0.], [1., 0., 1e-300]];
        assert_eq!(firsts(&points, Weld::Exact), Some(vec![0, 1, 0, 1, 4]));
        assert_eq!(firsts(&points, Weld::Distance(0.0)), Some(vec![0, 1, 0, 1, 4]));
        assert_eq!(firsts(&points, Weld::None), None);
        assert_eq!(firsts(&points[..2], Weld::Exact), None);
    }

    #[test]
    fn near_points_are_joined_in_the_first_and_not_in_chains() {
        let points =
            [[0., 0., 0.], [0.9, 0., 0.], [1.8, 0., 0.], [-0.9, 0., 0.], [0., 0., 1.0], [-3., 0., 0.]];
        assert_eq!(firsts(&points, Weld::Distance(1.0)), Some(vec![0, 0, 2, 0, 0, 5]));
        // Far from the origin a cell is less than the distance of two floats.
        let far = [[1e300, 0., 0.], [1e300, 0., 0.], [1e300, 1e290, 0.]];
        assert_eq!(firsts(&far, Weld::Distance(1e-300)), Some(vec![0, 0, 2]));
    }

    #[test]
    fn joining_agrees_with_comparing_all_pairs() {
        // A grid with steps of 1 and small offsets, in a scrambled order.
        let at = |i: usize| (i * 7919 % 1000) as f64;
        let points: Vec<DVec3> = (0..3000)
            .map(|i| dvec3(at(i) % 10., (at(i) / 10.).floor() % 10., 0.3 * (i / 1000) as f64))
            .collect();
        for (how, distance) in [(Weld::Exact, 0.0), (Weld::Distance(0.45), 0.45), (Weld::Distance(1.0), 1.0)]
        {
            let found = weld(&points, (0..points.len()).map(Vert::new), how).unwrap();
            let mut firsts: Vec<usize> = Vec::new();
            for (i, p) in points.iter().enumerate() {
                let first = firsts.iter().copied().find(|&j| points[j].distance(*p) <= distance);
                firsts.extend(first.is_none().then_some(i));
                assert_eq!(found[i].index(), first.unwrap_or(i), "{how:?} {i}");
            }
        }
    }

    #[test]
    fn the_command_line_names_them() {
        assert_eq!("exact".parse(), Ok(Weld::Exact));
        assert_eq!("none".parse(), Ok(Weld::None));
        assert_eq!("1e-3".parse(), Ok(Weld::Distance(1e-3)));
        for word in ["nan", "-1", "inf", "near", ""] {
            assert!(word.parse::<Weld>().is_err(), "{word}");
        }
    }

    // 2---1 5    Two triangles with vertices of their own along the seam 0-1 = 3-5 (4 is the far corner).
    // | / / |
    // 0 3---4
    #[test]
    fn a_mesh_that_did_not_change_is_parted_into_itself() {
        let points = [[0., 0., 0.], [1., 1., 0.], [0., 1., 0.], [-0., 0., 0.], [1., 0., 0.], [1., 1., 0.]];
        let points: Vec<DVec3> = points.into_iter().map(DVec3::from).collect();
        let faces = [[0, 1, 2], [3, 4, 5]].map(|f: [usize; 3]| f.map(Vert::new));
        let mut attributes = Attributes::default();
        let mut joined = faces.to_vec();
        attributes.join(&mut joined, &weld(&points, (0..points.len()).map(Vert::new), Weld::Exact).unwrap());
        assert_eq!(joined, [[0, 1, 2], [0, 4, 1]].map(|f: [usize; 3]| f.map(Vert::new)));
        let mesh = Mesh::new(points.clone(), joined).unwrap();
        let (parted, parted_faces) = attributes.part(&points, &mesh).unwrap();
        assert!(parted.iter().zip(&points).all(|(a, b)| is_same(*a, *b)), "{parted:?}");
        assert_eq!(parted_faces, faces);

        // A vertex that moved takes both of its file's vertices along.
        let mut moved = points.clone();
        moved[0] = dvec3(0., 0., 9.);
        let mesh = Mesh::new(moved, mesh.faces().to_vec()).unwrap();
        let (parted, _) = attributes.part(&points, &mesh).unwrap();
        assert_eq!([parted[0], parted[3], parted[5]], [dvec3(0., 0., 9.), dvec3(0., 0., 9.), points[5]]);
    }
}
