//! How late the worst value of a stream comes to be in increasing order.
//!
//! The lateness of a value is its index minus the index of the first value before it that is
//! greater, and 0 without one. That first greater value is always a *maximum*: greater than all
//! before it. So it is enough to remember the maxima, increasing in value and index, and to
//! search them. There are as many as values when the stream is in order, so old ones are merged
//! when there are too many: a merged entry has the index of its first maximum and the value of
//! its last, which makes a lateness too large, never too small.

/// The greatest lateness of a stream of values.
pub struct Lateness {
    /// Values seen.
    count: u64,
    /// Increasing strictly in both fields.
    maxima: Vec<Maximum>,
    /// Above this many, maxima are merged.
    maxima_max: usize,
    /// The greatest value seen.
    top: f32,
    /// So many of the maxima are further back than `displacement_max`.
    reach: usize,
    /// The greatest value among these: only a smaller value is later than all before it.
    limit: f32,
    displacement_max: u64,
}

/// One or several successive maxima.
#[derive(Clone, Copy)]
struct Maximum {
    /// The last and greatest.
    value: f32,
    /// Index of the first.
    first: u64,
}

/// Merged maxima span at most their age divided by `maxima_max / MAXIMA_PER_PART`. Since each two
/// entries are then older than the next two by that factor, at most half of the room is taken by
/// streams of up to e³⁰ values.
pub const MAXIMA_PER_PART: usize = 128;

/// A good number of maxima to remember. Chosen by hand: 1 MiB, and a lateness at most 0.2 % too
/// large.
pub const MAXIMA_DEFAULT: usize = 1 << 16;

impl Lateness {
    /// Starts a stream. At most `maxima_max` maxima are remembered, at least [`MAXIMA_PER_PART`] and
    /// 16 bytes each: they decide how exact the result is.
    #[must_use]
    pub fn new(maxima_max: usize) -> Self {
        assert!(maxima_max >= MAXIMA_PER_PART, "too few to merge");
        let (top, limit) = (f32::NEG_INFINITY, f32::NEG_INFINITY);
        let maxima = Vec::new();
        Self { count: 0, maxima, maxima_max, top, reach: 0, limit, displacement_max: 0 }
    }

    /// The greatest lateness so far: 0 exactly when the values are in order, otherwise never too
    /// small, and too large by at most its `maxima_max / MAXIMA_PER_PART`th part.
    #[must_use]
    pub fn displacement_max(&self) -> u64 {
        self.displacement_max
    }

    /// How late `value` would be if it came next, as exactly as [`Self::displacement_max`].
    #[must_use]
    pub fn late_by(&self, value: f32) -> u64 {
        let greater = self.maxima.partition_point(|known| known.value <= value);
        self.maxima.get(greater).map_or(0, |first| self.count - first.first)
    }

    /// Continues the stream; values are finite.
    pub fn add(&mut self, values: &[f32]) {
        for value in values {
            while let Some(next) = self.maxima.get(self.reach)
                && next.first + self.displacement_max < self.count
            {
                self.limit = next.value;
                self.reach += 1;
            }
            if *value > self.top {
                self.remember(*value);
            } else if *value < self.limit {
                self.note_late(*value);
            }
            self.count += 1;
        }
    }

    fn remember(&mut self, value: f32) {
        if self.maxima.len() == self.maxima_max {
            self.merge();
        }
        self.top = value;
        self.maxima.push(Maximum { value, first: self.count });
    }

    /// A value comes later than any before it.
    fn note_late(&mut self, value: f32) {
        self.reach = self.maxima[..self.reach].partition_point(|known| known.value <= value);
        self.displacement_max = self.count - self.maxima[self.reach].first;
        self.find_limit();
    }

    fn find_limit(&mut self) {
        let last = self.reach.checked_sub(1).map(|last| self.maxima[last].value);
        self.limit = last.unwrap_or(f32::NEG_INFINITY);
    }

    /// Merges neighbours as far as each entry's span, small against its age, allows.
    fn merge(&mut self) {
        let parts = (self.maxima_max / MAXIMA_PER_PART) as u64;
        let mut kept = 0;
        for next in 1..self.maxima.len() {
            // A maximum merged here could be anywhere before the one that follows.
            let end = self.maxima.get(next + 1).map_or(self.count, |after| after.first);
            let first = self.maxima[kept].first;
            if (end - 1 - first).saturating_mul(parts) <= self.count - first {
                self.maxima[kept].value = self.maxima[next].value;
            } else {
                kept += 1;
                self.maxima[kept] = self.maxima[next];
            }
        }
        self.maxima.truncate(kept + 1);
        let oldest = self.count - self.displacement_max;
        self.reach = self.maxima.partition_point(|known| known.first < oldest);
        self.find_limit();
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// By the definition, looking at all pairs.
    fn brute_force(values: &[f32]) -> u64 {
        let lateness = |(index, value): (usize, &f32)| {
            let earlier = values[..index].iter().position(|earlier| earlier > value);
            earlier.map_or(0, |earlier| (index - earlier) as u64)
        };
        values.iter().enumerate().map(lateness).max().unwrap_or(0)
    }

    /// Fed in pieces, which must not matter.
    fn measured(values: &[f32], maxima_max: usize) -> u64 {
        let mut lateness = Lateness::new(maxima_max);
        values.chunks(7).for_each(|piece| lateness.add(piece));
        assert!(lateness.maxima.len() <= maxima_max);
        lateness.displacement_max()
    }

    /// Numbers that look random and are the same each time.
    fn noise(index: u64) -> u64 {
        (index + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40
    }

    proptest! {
        #[test]
        fn a_short_stream_is_measured_exactly(values in prop::collection::vec(-9_i8..9, 0..120)) {
            let values: Vec<f32> = values.into_iter().map(f32::from).collect();
            prop_assert_eq!(measured(&values, MAXIMA_PER_PART), brute_force(&values));
        }
    }

    #[test]
    fn zeros_of_either_sign_are_equal() {
        assert_eq!(measured(&[0.0, -0.0, 0.0], MAXIMA_PER_PART), 0);
    }

    #[test]
    fn a_falling_stream_is_as_late_as_it_is_long() {
        let values: Vec<f32> = (0_u16..5000).map(|index| -f32::from(index)).collect();
        assert_eq!(measured(&values, MAXIMA_PER_PART), 4999);
    }

    #[test]
    fn a_rising_stream_is_in_order_however_often_it_is_merged() {
        let values: Vec<f32> = (0..1_000_000).map(|index| index as f32).collect();
        assert_eq!(measured(&values, MAXIMA_PER_PART), 0);
        assert_eq!(measured(&values, 8 * MAXIMA_PER_PART), 0);
    }

    #[test]
    fn merging_makes_a_lateness_too_large_by_a_small_part_of_it_at_most() {
        for (spread, parts) in [1, 10, 300, 4000].into_iter().flat_map(|s| [(s, 1), (s, 8)]) {
            // Rising, with some that fall back by up to `spread`, now and then by more.
            let value = |index: u64| {
                let far = if noise(index).is_multiple_of(1000) { 3 } else { 1 };
                index as f32 - (noise(index) % 7 / 6 * (noise(2 * index) % spread) * far) as f32
            };
            let values: Vec<f32> = (0..20_000).map(value).collect();
            let (exact, found) = (brute_force(&values), measured(&values, parts * MAXIMA_PER_PART));
            let slack = found / parts as u64;
            assert!(found >= exact && found - exact <= slack, "{exact} {found} {spread} {parts}");
            assert_eq!(found == 0, exact == 0);
        }
    }

    #[test]
    fn one_that_is_late_by_little_is_measured_exactly_however_long_the_stream() {
        let mut values: Vec<f32> = (0..1_000_000).map(|index| index as f32).collect();
        values[700_000..=700_005].rotate_left(1);
        assert_eq!(measured(&values, 8 * MAXIMA_PER_PART), 5);
    }

    #[test]
    fn merging_leaves_half_of_the_room() {
        let mut lateness = Lateness::new(8 * MAXIMA_PER_PART);
        let values: Vec<f32> = (0..1_000_000).map(|index| index as f32).collect();
        for value in &values {
            let before = lateness.maxima.len();
            lateness.add(&[*value]);
            let after = lateness.maxima.len();
            assert!(after > before || after <= lateness.maxima_max / 2 + 1);
        }
    }
}
