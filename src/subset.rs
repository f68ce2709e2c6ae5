//! A set of elements of a mesh with their ranks: a bit for each element there is, so that even the set of a
//! large mesh stays in the cache.

use std::marker::PhantomData;

use crate::mesh::Element;

/// A set of vertices, faces or half-edges.
#[derive(Clone, Debug)]
pub(crate) struct Subset<I> {
    words: Vec<u64>,
    kind: PhantomData<I>,
}

impl<I: Element> Subset<I> {
    /// The elements of `members`, of `n` that there are.
    pub(crate) fn of(n: usize, members: impl IntoIterator<Item = I>) -> Self {
        let mut set = Self { words: vec![0; n.div_ceil(64)], kind: PhantomData };
        members.into_iter().for_each(|i| _ = set.insert(i));
        set
    }

    /// Whether it was no member before.
    #[inline]
    pub(crate) fn insert(&mut self, i: I) -> bool {
        let (word, bit) = (&mut self.words[i.at() / 64], 1 << (i.at() % 64));
        let is_new = *word & bit == 0;
        *word |= bit;
        is_new
    }

    #[inline]
    pub(crate) fn contains(&self, i: I) -> bool {
        self.words[i.at() / 64] >> (i.at() % 64) & 1 == 1
    }

    /// The members, ascending.
    pub(crate) fn iter(&self) -> impl Iterator<Item = I> + '_ {
        self.words.iter().enumerate().flat_map(|(word, &bits)| {
            let rest = |&bits: &u64| Some(bits & (bits - 1)).filter(|&rest| rest != 0);
            let each = std::iter::successors(Some(bits).filter(|&bits| bits != 0), rest);
            each.map(move |bits| I::of(64 * word + bits.trailing_zeros() as usize))
        })
    }

    /// The members in their order, each with its rank.
    pub(crate) fn ranked(self) -> Ranked<I> {
        let count = |sum: &mut u32, word: &u64| Some(std::mem::replace(sum, *sum + word.count_ones()));
        let before = self.words.iter().scan(0, count).collect();
        Ranked { members: self.iter().collect(), before, set: self }
    }
}

/// A set that knows how many of its members are lower than a given one.
#[derive(Clone, Debug)]
pub(crate) struct Ranked<I> {
    set: Subset<I>,
    /// For each word of the set the members in the words before it.
    before: Vec<u32>,
    /// Ascending.
    members: Vec<I>,
}

impl<I: Element> Ranked<I> {
    /// The members, ascending.
    pub(crate) fn members(&self) -> &[I] {
        &self.members
    }

    /// How many members are lower than `i`, if it is one of them.
    #[inline]
    pub(crate) fn rank(&self, i: I) -> Option<usize> {
        let lower = self.set.words[i.at() / 64] & ((1 << (i.at() % 64)) - 1);
        self.set.contains(i).then(|| (self.before[i.at() / 64] + lower.count_ones()) as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Vert;

    #[test]
    fn members_come_back_in_their_order_with_their_ranks() {
        let members = [200, 0, 63, 64, 127, 5, 63];
        let set = Subset::of(201, members.map(Vert::new));
        assert!(set.contains(Vert::new(200)) && !set.contains(Vert::new(199)));
        let set = set.ranked();
        assert_eq!(set.members(), [0, 5, 63, 64, 127, 200].map(Vert::new));
        assert_eq!([0, 5, 63, 64, 127, 200].map(|i| set.rank(Vert::new(i)).unwrap()), [0, 1, 2, 3, 4, 5]);
        assert_eq!(set.rank(Vert::new(1)), None);
        assert!(Subset::<Vert>::of(0, []).ranked().members().is_empty());
    }
}
