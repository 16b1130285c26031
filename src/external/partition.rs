//! Cuts a batch in memory into buckets, stably, on all threads of the current pool.

use rayon::prelude::*;

use crate::storage::Record;

/// Room for the partitioned copy of a batch.
#[derive(Debug)]
pub(super) struct Scratch<R> {
    records: Vec<R>,
    /// Bucket of each source record.
    ids: Vec<u16>,
}

impl<R> Default for Scratch<R> {
    fn default() -> Self {
        Self { records: Vec::new(), ids: Vec::new() }
    }
}

impl<R: Record> Scratch<R> {
    /// The first `count` records of the room, whatever they hold.
    pub(super) fn records_mut(&mut self, count: usize) -> &mut [R] {
        if self.records.len() < count {
            self.records.resize(count, R::new_zeroed());
        }
        &mut self.records[..count]
    }
}

/// One part of a batch, ordered by bucket. Parts are in input order.
pub(super) struct Part<'a, R> {
    records: &'a [R],
    /// Bucket `i` lies from `starts[i]` to `starts[i + 1]`.
    starts: Vec<usize>,
}

impl<R> Part<'_, R> {
    /// The records of one bucket, in input order.
    pub(super) fn bucket(&self, bucket: usize) -> &[R] {
        &self.records[self.starts[bucket]..self.starts[bucket + 1]]
    }
}

/// Largest number of buckets [`partition`] can make.
pub(super) const BUCKETS_MAX: usize = 1 << 12;

/// A part is worth a thread from this many records on.
const PART_RECORDS_MIN: usize = 1 << 12;

/// Bytes that partitioning takes per record of a batch, beside the batch.
pub(super) const fn scratch_bytes<R>() -> usize {
    size_of::<R>() + size_of::<u16>()
}

/// Copies `source` into `scratch`, ordered by `bucket_of`. `convert` makes the record that is
/// stored from the source record and its position in `source`.
pub(super) fn partition<'a, S: Sync, R: Record>(
    source: &[S],
    scratch: &'a mut Scratch<R>,
    buckets: usize,
    bucket_of: impl Fn(&S) -> usize + Sync,
    convert: impl Fn(usize, &S) -> R + Sync,
) -> Vec<Part<'a, R>> {
    assert!(buckets <= BUCKETS_MAX, "too many buckets");
    scratch.records_mut(source.len());
    if scratch.ids.len() < source.len() {
        scratch.ids.resize(source.len(), 0);
    }
    let parts = rayon::current_num_threads().min(source.len() / PART_RECORDS_MIN).max(1);
    let part_records = source.len().div_ceil(parts).max(1);
    let records = &mut scratch.records[..source.len()];
    let ids = &mut scratch.ids[..source.len()];
    source
        .par_chunks(part_records)
        .zip(records.par_chunks_mut(part_records))
        .zip(ids.par_chunks_mut(part_records))
        .enumerate()
        .map(|(part, ((source, records), ids))| {
            let starts = count_buckets(source, ids, buckets, &bucket_of);
            let first = part * part_records;
            let mut ends = starts.clone();
            for ((offset, record), id) in source.iter().enumerate().zip(&*ids) {
                let end = &mut ends[usize::from(*id)];
                records[*end] = convert(first + offset, record);
                *end += 1;
            }
            Part { records, starts }
        })
        .collect()
}

/// Notes the bucket of each record and returns where each bucket starts.
fn count_buckets<S>(
    source: &[S],
    ids: &mut [u16],
    buckets: usize,
    bucket_of: impl Fn(&S) -> usize,
) -> Vec<usize> {
    let mut starts = vec![0; buckets + 1];
    for (record, id) in source.iter().zip(ids) {
        let bucket = bucket_of(record);
        *id = bucket as u16;
        starts[bucket + 1] += 1;
    }
    for bucket in 0..buckets {
        starts[bucket + 1] += starts[bucket];
    }
    starts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buckets_keep_the_order_of_the_input_over_all_parts() {
        let source: Vec<u64> = (0..50_000).map(|i| i * 7919 % 50_021).collect();
        let mut scratch = Scratch::default();
        let parts = partition(
            &source,
            &mut scratch,
            10,
            |n| (*n % 10) as usize,
            |at, n| [*n, at as u64, 0],
        );
        for bucket in 0..10 {
            let found = parts.iter().flat_map(|part| part.bucket(bucket)).map(|r| (r[0], r[1]));
            let all = source.iter().zip(0..).map(|(n, at)| (*n, at));
            assert!(found.eq(all.filter(|(n, _)| *n % 10 == bucket as u64)));
        }
    }

    #[test]
    fn nothing_has_no_parts() {
        let mut scratch = Scratch::<u64>::default();
        assert!(partition(&[0_u64; 0], &mut scratch, 3, |_| 0, |_, n| *n).is_empty());
    }
}
