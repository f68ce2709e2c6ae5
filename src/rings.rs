//! Collects what lies round an element ring by ring, however its neighbours are told.
//!
//! In/out: an element and a way to ask for neighbours -> those so many rings round it, itself first.
//! Cost: O(found²) comparisons in one short list: cheaper than a set for the few dozen that rings hold.

/// Puts `centre` into `found` and what is at most so many `rings` away from it, ring by ring, each once and at most
/// `max` in all; `around` gives the neighbours of each. Takes time in the square of what it finds.
pub(crate) fn collect_rings<T: Copy + PartialEq, N: Iterator<Item = T>>(
    centre: T,
    rings: usize,
    max: usize,
    around: impl Fn(T) -> N,
    found: &mut Vec<T>,
) {
    found.clear();
    found.push(centre);
    let mut ring_start = 0;
    for _ in 0..rings {
        let ring = ring_start..found.len();
        ring_start = found.len();
        for i in ring {
            for w in around(found[i]) {
                if found.len() >= max {
                    return;
                }
                if !found.contains(&w) {
                    found.push(w);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rings_come_one_after_the_other_up_to_so_many() {
        let collected = |rings, max| {
            let mut found = vec![7];
            collect_rings(
                0,
                rings,
                max,
                |i: i32| [i - 1, i + 1].into_iter().filter(|j| *j != -2),
                &mut found,
            );
            found
        };
        assert_eq!(collected(0, 9), [0]);
        assert_eq!(collected(1, 9), [0, -1, 1]);
        assert_eq!(collected(3, 9), [0, -1, 1, 2, 3], "what does not belong leads nowhere");
        assert_eq!(collected(3, 4), [0, -1, 1, 2]);
    }
}
