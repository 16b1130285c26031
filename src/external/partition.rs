//! Cuts a part of the input, small enough for the processor's own cache, into buckets, stably.
//!
//! Measured on one core, 24-byte records into 256 buckets: 10 ns a record where source and target
//! stay in the second-level cache, 27 ns where they do not.

use crate::storage::Record;

/// Bytes of a part: with its source, half of a second-level cache of 1 MiB.
const PART_BYTES: usize = 1 << 18;

/// Largest number of buckets of a part.
pub(super) const BUCKETS_MAX: usize = 1 << 12;

/// Records of a part that fits `memory_bytes` with its source: at least one.
pub(super) fn part_records<R>(memory_bytes: u64) -> usize {
    (PART_BYTES.min((memory_bytes / 2) as usize) / size_of::<R>()).max(1)
}

/// A part of the input, ordered by bucket. Reusable.
#[derive(Debug)]
pub(super) struct Part<R> {
    records: Vec<R>,
    /// Bucket of each source record.
    ids: Vec<u16>,
    /// Bucket `i` lies from `starts[i]` to `starts[i + 1]`.
    starts: Vec<u32>,
    /// Where the next record of each bucket goes.
    ends: Vec<u32>,
}

impl<R> Default for Part<R> {
    fn default() -> Self {
        Self { records: Vec::new(), ids: Vec::new(), starts: Vec::new(), ends: Vec::new() }
    }
}

impl<R: Record> Part<R> {
    /// Copies `source` here, ordered by `bucket_of`. `convert` makes the record to be stored from
    /// the source record and its position in `source`.
    pub(super) fn fill<S>(
        &mut self,
        source: &[S],
        buckets: usize,
        bucket_of: impl Fn(&S) -> usize,
        convert: impl Fn(usize, &S) -> R,
    ) {
        assert!(buckets <= BUCKETS_MAX && u32::try_from(source.len()).is_ok(), "too large a part");
        if self.records.len() < source.len() {
            self.records = vec![R::new_zeroed(); source.len()];
            self.ids = vec![0; source.len()];
        }
        self.starts.clear();
        self.starts.resize(buckets + 1, 0);
        for (record, id) in source.iter().zip(&mut self.ids) {
            let bucket = bucket_of(record);
            *id = bucket as u16;
            self.starts[bucket + 1] += 1;
        }
        for bucket in 0..buckets {
            self.starts[bucket + 1] += self.starts[bucket];
        }
        self.ends.clone_from(&self.starts);
        for ((position, record), id) in source.iter().enumerate().zip(&self.ids) {
            let end = &mut self.ends[usize::from(*id)];
            self.records[*end as usize] = convert(position, record);
            *end += 1;
        }
    }

    /// The records of one bucket, in input order.
    pub(super) fn bucket(&self, bucket: usize) -> &[R] {
        &self.records[self.starts[bucket] as usize..self.starts[bucket + 1] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buckets_keep_the_order_of_the_input() {
        let mut part = Part::default();
        for count in [5000, 0, 300] {
            let source: Vec<u64> = (0..count).map(|i| i * 7919 % 10_007).collect();
            part.fill(&source, 10, |n| (*n % 10) as usize, |at, n| [*n, at as u64, 0]);
            for bucket in 0..10 {
                let found = part.bucket(bucket).iter().map(|r| (r[0], r[1]));
                let all = source.iter().copied().zip(0..);
                assert!(found.eq(all.filter(|(n, _)| *n % 10 == bucket as u64)));
            }
        }
    }
}
