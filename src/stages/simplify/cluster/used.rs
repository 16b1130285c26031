//! Which cells have a triangle, and their numbers among those.

/// A set of ranks below a fixed count: one bit each, and a running count per word.
pub(super) struct Used {
    words: Vec<u64>,
    /// Members before each word; filled in by [`Self::number`].
    before: Vec<u64>,
}

impl Used {
    /// The empty set of ranks below `count`.
    pub(super) fn none(count: u64) -> Self {
        Self { words: vec![0; count.div_ceil(64) as usize], before: Vec::new() }
    }

    /// Adds a rank.
    pub(super) fn mark(&mut self, rank: u64) {
        self.words[(rank / 64) as usize] |= 1 << (rank % 64);
    }

    /// Numbers the members in order. Call when all are in.
    pub(super) fn number(&mut self) {
        let mut total = 0;
        self.before.clear();
        for word in &self.words {
            self.before.push(total);
            total += u64::from(word.count_ones());
        }
    }

    /// Whether `rank` is a member.
    pub(super) fn contains(&self, rank: u64) -> bool {
        self.words[(rank / 64) as usize] >> (rank % 64) & 1 == 1
    }

    /// Number of the member `rank`.
    pub(super) fn number_of(&self, rank: u64) -> u64 {
        debug_assert!(self.contains(rank), "only members have numbers");
        let word = (rank / 64) as usize;
        let below = self.words[word] & ((1 << (rank % 64)) - 1);
        self.before[word] + u64::from(below.count_ones())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn members_are_numbered_in_order() {
        let mut used = Used::none(200);
        for rank in [199, 3, 64, 63] {
            used.mark(rank);
        }
        used.number();
        assert_eq!([3, 63, 64, 199].map(|rank| used.number_of(rank)), [0, 1, 2, 3]);
        assert!(!used.contains(4));
    }
}
