//! Finds the points in a triangle.

use glam::DVec2;

/// A kd-tree from which points can be removed.
pub(super) struct Tree {
    points: Vec<DVec2>,
    /// The points so that each node owns a range; a node's halves are its children's.
    order: Vec<u32>,
    /// Where each point stands in `order`; whether it was removed.
    rank: Vec<u32>,
    is_removed: Vec<bool>,
    /// By node; the children of node k are 2k + 1 and 2k + 2.
    boxes: Vec<(DVec2, DVec2)>,
    alive: Vec<u32>,
}

impl Tree {
    const LEAF: usize = 8;

    pub fn new(points: &[DVec2]) -> Self {
        let n = points.len();
        let nodes = 2 * n.div_ceil(Self::LEAF).next_power_of_two();
        let mut tree = Self {
            points: points.to_vec(),
            order: (0..n as u32).collect(),
            rank: vec![0; n],
            is_removed: vec![false; n],
            boxes: vec![(DVec2::ZERO, DVec2::ZERO); nodes],
            alive: vec![0; nodes],
        };
        tree.build(0, 0, n);
        for (rank, &i) in tree.order.iter().enumerate() {
            tree.rank[i as usize] = rank as u32;
        }
        tree
    }

    fn build(&mut self, node: usize, from: usize, to: usize) {
        let points = &self.points;
        let range = &mut self.order[from..to];
        let first = points[range[0] as usize];
        let (low, high) = range.iter().fold((first, first), |(low, high), &i| {
            (low.min(points[i as usize]), high.max(points[i as usize]))
        });
        self.boxes[node] = (low, high);
        self.alive[node] = (to - from) as u32;
        if to - from > Self::LEAF {
            let by_y = high.y - low.y > high.x - low.x;
            let key = |i: u32| if by_y { points[i as usize].y } else { points[i as usize].x };
            range.select_nth_unstable_by((to - from) / 2, |&i, &j| key(i).total_cmp(&key(j)).then(i.cmp(&j)));
            let middle = usize::midpoint(from, to);
            self.build(2 * node + 1, from, middle);
            self.build(2 * node + 2, middle, to);
        }
    }

    pub fn remove(&mut self, point: u32) {
        self.is_removed[point as usize] = true;
        let rank = self.rank[point as usize] as usize;
        let (mut node, mut from, mut to) = (0, 0, self.order.len());
        self.alive[node] -= 1;
        while to - from > Self::LEAF {
            let middle = usize::midpoint(from, to);
            (node, from, to) =
                if rank < middle { (2 * node + 1, from, middle) } else { (2 * node + 2, middle, to) };
            self.alive[node] -= 1;
        }
    }

    /// Whether `test` holds for some point that is left near `triangle`; also when the budget, one per
    /// look, runs out.
    pub fn any_in(&self, triangle: &[DVec2; 3], test: impl Fn(u32) -> bool, budget: &mut usize) -> bool {
        let mut stack = vec![(0, 0, self.order.len())];
        while let Some((node, from, to)) = stack.pop() {
            let cost = if to - from > Self::LEAF { 1 } else { 1 + to - from };
            *budget = budget.saturating_sub(cost);
            if *budget == 0 {
                return true;
            }
            if self.alive[node] == 0 || is_apart(triangle, self.boxes[node]) {
                continue;
            }
            if to - from > Self::LEAF {
                let middle = usize::midpoint(from, to);
                stack.push((2 * node + 1, from, middle));
                stack.push((2 * node + 2, middle, to));
            } else if self.order[from..to].iter().any(|&i| !self.is_removed[i as usize] && test(i)) {
                return true;
            }
        }
        false
    }
}

/// Whether the box is beyond a side of the triangle (which turns to the left), or of its own.
fn is_apart(triangle: &[DVec2; 3], (low, high): (DVec2, DVec2)) -> bool {
    let [a, b, c] = *triangle;
    if a.max(b).max(c).cmplt(low).any() || a.min(b).min(c).cmpgt(high).any() {
        return true;
    }
    let (centre, half) = ((low + high) * 0.5, (high - low) * 0.5);
    [(a, b), (b, c), (c, a)].into_iter().any(|(p, q)| {
        let inward = (q - p).perp();
        // A little slack: a point on the side must be found whatever the rounding.
        inward.dot(centre - p) + inward.abs().dot(half) < -1e-12 * inward.abs().element_sum()
    })
}
