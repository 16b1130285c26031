//! Cuts the range of keys into buckets of about equal size, from a sample.
//!
//! A key that fills a bucket of its own gets one: such a bucket needs no sorting at any size,
//! which is what makes equal keys harmless.

use super::SortKey;

/// The bounds between buckets.
#[derive(Clone, Debug)]
pub(super) struct Splitters<K> {
    /// Strictly ascending. Bucket `i` holds the keys from bound `i - 1` up to but not bound `i`.
    bounds: Vec<K>,
    /// For each range of the keys between the first bound and the last, cut evenly: the bounds
    /// below it.
    below: Vec<u16>,
    /// Width of those ranges, as a power of two.
    shift: u32,
    /// Steps of a search, without branches, among the bounds of the range that has the most:
    /// one or two where keys are spread evenly, as many as in all bounds where they are crowded.
    steps: u32,
    /// The bounds, and the largest key after them as often as a search may look there.
    padded: Vec<K>,
}

/// Ranges that keys are looked up in, for each bound: most of them have no bound inside.
const RANGES_PER_BOUND: usize = 8;

impl<K: SortKey> Splitters<K> {
    /// Bounds for about `buckets` buckets (at most two more). Whatever the sample, a set of
    /// keys that contains it is cut in such a way that each bucket is either of one key or
    /// smaller than the set; so distributing again and again comes to an end.
    pub(super) fn choose(mut sample: Vec<K>, buckets: usize) -> Self {
        assert!(!sample.is_empty() && buckets >= 2, "nothing to choose from");
        sample.sort_unstable();
        let first = sample[0];
        let mut bounds = vec![first];
        let mut heavy = Some(first);
        for i in 1..buckets {
            let key = sample[i * sample.len() / buckets];
            if bounds.last() != Some(&key) {
                // The successor of a heavy key may be this very one.
                close_heavy(&mut bounds, heavy.take());
            }
            if bounds.last() == Some(&key) {
                heavy = heavy.or(Some(key));
            } else {
                bounds.push(key);
            }
        }
        close_heavy(&mut bounds, heavy);
        debug_assert!(bounds.is_sorted_by(|a, b| a < b), "bounds ascend");
        Self::of_bounds(bounds)
    }

    /// Those with the bounds of others, see [`Self::bounds`]; `None` if they are no bounds.
    pub(super) fn of_noted(bounds: Vec<K>) -> Option<Self> {
        let are_bounds = !bounds.is_empty() && bounds.is_sorted_by(|a, b| a < b);
        (are_bounds && bounds.len() < usize::from(u16::MAX)).then(|| Self::of_bounds(bounds))
    }

    /// The bounds between the buckets.
    pub(super) fn bounds(&self) -> &[K] {
        &self.bounds
    }

    fn of_bounds(bounds: Vec<K>) -> Self {
        let (first, last) = (bounds[0], bounds[bounds.len() - 1]);
        let bits = last.bits_above(first);
        let shift = bits.saturating_sub((bounds.len() * RANGES_PER_BOUND).ilog2());
        let mut inside = vec![0_u16; last.digit_above(first, shift) + 1];
        assert!(u16::try_from(bounds.len()).is_ok(), "too many buckets");
        for bound in &bounds {
            inside[bound.digit_above(first, shift)] += 1;
        }
        let most = inside.iter().copied().max().unwrap_or(0);
        let steps = u16::BITS - most.leading_zeros();
        let mut below = inside;
        let mut sum = 0;
        for count in &mut below {
            sum += std::mem::replace(count, sum);
        }
        let mut padded = bounds.clone();
        padded.resize(bounds.len() + (1 << steps), K::MAX);
        Self { bounds, below, shift, steps, padded }
    }

    /// Number of buckets.
    pub(super) fn count(&self) -> usize {
        self.bounds.len() + 1
    }

    /// The bucket of `key`. Larger keys never have smaller buckets.
    #[inline]
    pub(super) fn bucket(&self, key: K) -> usize {
        let (first, last) = (self.bounds[0], self.bounds[self.bounds.len() - 1]);
        let range = key.clamp(first, last).digit_above(first, self.shift);
        let mut bucket = usize::from(self.below[range]);
        for step in (0..self.steps).rev() {
            // Bounds beyond this range are larger than the key, too.
            let half = 1 << step;
            bucket += half * usize::from(self.padded[bucket + half - 1] <= key);
        }
        // The largest key passes the copies of itself too.
        bucket.min(self.bounds.len())
    }

    /// Whether all records of a bucket have the same key.
    pub(super) fn is_one_key(&self, bucket: usize) -> bool {
        let Some(first) = bucket.checked_sub(1).map(|i| self.bounds[i]) else { return false };
        match self.bounds.get(bucket) {
            Some(end) => first.successor() == Some(*end),
            None => first == K::MAX,
        }
    }
}

/// Ends the bucket of a heavy key right after it.
fn close_heavy<K: SortKey>(bounds: &mut Vec<K>, heavy: Option<K>) {
    bounds.extend(heavy.and_then(K::successor));
}

/// Whether a sample in input order says little about what is still to come: somewhere in it a
/// piece lies off the middle of the whole, as in an input that is sorted or coherent in space.
pub(super) fn drifts<K: SortKey>(sample: &[K]) -> bool {
    let piece_keys = sample.len() / DRIFT_PIECES;
    if piece_keys < DRIFT_PIECE_KEYS_MIN {
        return false;
    }
    let mut sorted = sample.to_vec();
    sorted.sort_unstable();
    let low = sorted[sample.len() / 4];
    let high = sorted[sample.len() / 4 * 3];
    sample.chunks_exact(piece_keys).any(|piece| {
        let mut piece = piece.to_vec();
        let (_, median, _) = piece.select_nth_unstable(piece_keys / 2);
        *median < low || *median > high
    })
}

/// Pieces looked at one by one. Chosen by hand: a sorted input shows in any number from 2.
const DRIFT_PIECES: usize = 16;
/// The median of 32 random keys lies outside the middle half of all keys once in 500 pieces.
const DRIFT_PIECE_KEYS_MIN: usize = 32;

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn any_sample_gives_buckets_that_get_smaller(
            sample in prop::collection::vec(0_u32..20, 1..100),
            buckets in 2_usize..40,
        ) {
            let splitters = Splitters::choose(sample.clone(), buckets);
            prop_assert!(splitters.count() <= buckets + 2);
            let ids: Vec<usize> = sample.iter().map(|key| splitters.bucket(*key)).collect();
            for bucket in 0..splitters.count() {
                let inside = ids.iter().filter(|id| **id == bucket).count();
                prop_assert!(splitters.is_one_key(bucket) || inside < sample.len());
            }
            for key in (0..25).chain([u32::MAX]) {
                let below = splitters.bounds.iter().filter(|bound| **bound <= key).count();
                prop_assert_eq!(splitters.bucket(key), below);
            }
        }
    }

    #[test]
    fn a_heavy_key_has_a_bucket_of_its_own() {
        let splitters = Splitters::choose(vec![1_u64, 7, 7, 7, 7, 7, 7, 9], 4);
        let bucket = splitters.bucket(7);
        assert!(splitters.is_one_key(bucket));
        assert!(splitters.bucket(6) < bucket && splitters.bucket(8) > bucket);
        let last = Splitters::choose(vec![u64::MAX; 5], 4);
        assert!(last.is_one_key(last.bucket(u64::MAX)) && last.bucket(3) == 0);
    }

    #[test]
    fn a_sorted_sample_drifts_and_a_shuffled_one_does_not() {
        let sorted: Vec<u64> = (0..1024).collect();
        let shuffled: Vec<u64> = sorted.iter().map(|i| i * 389 % 1024).collect();
        assert!(drifts(&sorted) && !drifts(&shuffled) && !drifts(&[5_u64; 1024]));
    }
}
