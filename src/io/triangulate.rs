//! Cuts polygons into triangles.
//!
//! Every polygon of n corners gives exactly n - 2 triangles that use all of its corners, so no edge to
//! a neighbour opens and nothing is lost, however degenerate it is. A simple polygon, concave or with
//! flat corners, is cut inside and without overlap: ears are clipped, the shortest diagonal first, which
//! for a quadrilateral is the shorter diagonal that stays inside.
//!
//! Based on: Meisters, "Polygons have ears", 1975; a kd-tree finds the corners inside an ear.
//! Differs: ear clippers made for drawing (earcut) drop flat and repeated corners; that would tear the
//! mesh. A polygon that crosses itself has no right cut: it gets some cut, in the same time.
//! In/out: corners `[n]` in order; triples of corner numbers, in the polygon's orientation.
//! Cost: O(n log n) for all but contrived polygons; a budget keeps those near it, too.

#[cfg(test)]
mod tests;
mod tree;

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::{DVec2, DVec3};

use tree::Tree;

/// Cuts the polygon `corners` and appends its triangles, as numbers of corners, to `triangles`.
pub(super) fn triangulate(corners: &[DVec3], triangles: &mut Vec<[u32; 3]>) {
    match corners {
        [] | [_] | [_, _] => {}
        [_, _, _] => triangles.push([0, 1, 2]),
        [a, b, c, d] => triangles.extend(quadrilateral([*a, *b, *c, *d])),
        _ => Clipper::new(corners).clip_all(triangles),
    }
}

/// The shorter diagonal that leaves a triangle on each side of it; if none does, the shorter.
fn quadrilateral(corners: [DVec3; 4]) -> [[u32; 3]; 2] {
    let unit = unit_of(&corners);
    let [a, b, c, d] = corners.map(|p| p / unit);
    let normal = (c - a).cross(d - b);
    let is_turned = |p: DVec3, q: DVec3, r: DVec3| (q - p).cross(r - p).dot(normal) > 0.0;
    let is_inside = [is_turned(a, b, c) && is_turned(a, c, d), is_turned(a, b, d) && is_turned(b, c, d)];
    let takes_second = match is_inside {
        [true, false] => false,
        [false, true] => true,
        _ => b.distance_squared(d) < a.distance_squared(c),
    };
    if takes_second { [[0, 1, 3], [1, 2, 3]] } else { [[0, 1, 2], [0, 2, 3]] }
}

/// The largest coordinate; 1 where there is none but zero.
fn unit_of(corners: &[DVec3]) -> f64 {
    let largest = corners.iter().fold(0.0, |most: f64, p| most.max(p.abs().max_element()));
    if largest > 0.0 { largest } else { 1.0 }
}

/// Twice the area of a triangle, positive when it turns to the left.
fn turn(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    (b - a).perp_dot(c - a)
}

/// Clips the ears of one polygon.
struct Clipper {
    /// The corners in space, and in the plane whose axes span the polygon best; there the polygon runs
    /// counter-clockwise.
    space: Vec<DVec3>,
    plane: Vec<DVec2>,
    next: Vec<u32>,
    previous: Vec<u32>,
    left: usize,
    tree: Tree,
    /// Ears to try: the length of the diagonal, squared, as bits (which order like the number), and
    /// previous corner, tip and next corner.
    ears: BinaryHeap<Reverse<(u64, [u32; 3])>>,
    /// How many more corners may be looked at before any corner is taken for an ear.
    budget: usize,
}

impl Clipper {
    /// Looks per corner and in all. Simple polygons of random corners need 30 to 100 per corner.
    const BUDGET: [usize; 2] = [400, 1_000_000];
    /// How often an ear is forced before the polygon is given up as one that crosses itself.
    const PATIENCE: usize = 32;

    fn new(corners: &[DVec3]) -> Self {
        let unit = unit_of(corners);
        let space: Vec<DVec3> = corners.iter().map(|&p| p / unit - corners[0] / unit).collect();
        let plane = flattened(&space);
        let n = space.len() as u32;
        Self {
            next: (0..n).map(|i| (i + 1) % n).collect(),
            previous: (0..n).map(|i| (i + n - 1) % n).collect(),
            left: corners.len(),
            tree: Tree::new(&plane),
            ears: BinaryHeap::with_capacity(corners.len()),
            budget: Self::BUDGET[0] * corners.len() + Self::BUDGET[1],
            space,
            plane,
        }
    }

    fn clip_all(mut self, triangles: &mut Vec<[u32; 3]>) {
        triangles.reserve(self.left - 2);
        let mut some = 0;
        let mut patience = Self::PATIENCE;
        self.push_all(some);
        while self.left > 3 {
            let ear = match self.pop_ear() {
                Some(ear) => ear,
                None if patience > 0 && self.budget > 0 => {
                    patience -= 1;
                    self.push_all(some);
                    // The heap holds every corner now; the best is forced, and all have another chance.
                    match self.ears.pop() {
                        Some(Reverse((_, ear))) => ear,
                        None => self.triple(some),
                    }
                }
                None => {
                    self.budget = 0;
                    self.triple(some)
                }
            };
            triangles.push(ear);
            some = ear[0];
            self.clip(ear);
        }
        triangles.push(self.triple(some));
    }

    fn triple(&self, tip: u32) -> [u32; 3] {
        [self.previous[tip as usize], tip, self.next[tip as usize]]
    }

    /// The next ear that holds no other corner; without a budget, the next at all.
    fn pop_ear(&mut self) -> Option<[u32; 3]> {
        while let Some(Reverse((_, ear))) = self.ears.pop() {
            let is_current = self.triple(ear[1]) == ear;
            if is_current && (self.budget == 0 || self.is_ear(ear)) {
                return Some(ear);
            }
        }
        None
    }

    fn is_ear(&mut self, [a, tip, c]: [u32; 3]) -> bool {
        let triangle = [a, tip, c].map(|i| self.plane[i as usize]);
        if turn(triangle[0], triangle[1], triangle[2]) <= 0.0 {
            return false;
        }
        let (plane, next, previous) = (&self.plane, &self.next, &self.previous);
        let blocks = |i: u32| {
            let p = plane[i as usize];
            if i == a || i == tip || i == c || p == triangle[0] || p == triangle[2] {
                return false;
            }
            if p != triangle[1] {
                return (0..3).all(|k| turn(triangle[k], triangle[(k + 1) % 3], p) >= 0.0);
            }
            // Another corner in the same place as the tip blocks if an edge of it runs into the ear.
            [next[i as usize], previous[i as usize]].map(|end| plane[end as usize]).iter().any(|&end| {
                turn(triangle[0], triangle[1], end) > 0.0 && turn(triangle[1], triangle[2], end) > 0.0
            })
        };
        !self.tree.any_in(&triangle, blocks, &mut self.budget)
    }

    fn clip(&mut self, [a, tip, c]: [u32; 3]) {
        self.next[a as usize] = c;
        self.previous[c as usize] = a;
        // A clipped corner is its own neighbour: no ear in the heap is current at it any more.
        self.next[tip as usize] = tip;
        self.previous[tip as usize] = tip;
        self.tree.remove(tip);
        self.left -= 1;
        self.push(a);
        self.push(c);
    }

    fn push(&mut self, tip: u32) {
        let ear = self.triple(tip);
        let [a, _, c] = ear.map(|i| self.space[i as usize]);
        let [p, q, r] = ear.map(|i| self.plane[i as usize]);
        // Corners that are not convex come last: they are forced only when nothing else is left.
        let bits = a.distance_squared(c).to_bits() | (u64::from(turn(p, q, r) <= 0.0) << 63);
        self.ears.push(Reverse((bits, ear)));
    }

    fn push_all(&mut self, some: u32) {
        self.ears.clear();
        let mut tip = some;
        loop {
            self.push(tip);
            tip = self.next[tip as usize];
            if tip == some {
                return;
            }
        }
    }
}

/// The polygon without the coordinate along which its normal (Newell's) is longest, counter-clockwise.
fn flattened(space: &[DVec3]) -> Vec<DVec2> {
    let edges = space.iter().zip(space.iter().cycle().skip(1));
    let normal = edges.fold(DVec3::ZERO, |sum, (&p, &q)| sum + p.cross(q));
    let size = normal.abs();
    let axes: fn(&DVec3) -> DVec2 = if size.z >= size.x && size.z >= size.y {
        if normal.z >= 0.0 { |p| DVec2::new(p.x, p.y) } else { |p| DVec2::new(p.y, p.x) }
    } else if size.y >= size.x {
        if normal.y >= 0.0 { |p| DVec2::new(p.z, p.x) } else { |p| DVec2::new(p.x, p.z) }
    } else if normal.x >= 0.0 {
        |p| DVec2::new(p.y, p.z)
    } else {
        |p| DVec2::new(p.z, p.y)
    };
    space.iter().map(axes).collect()
}
