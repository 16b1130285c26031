//! Records into buckets on disk, by a number each record gives.
//!
//! Records gather in memory; a full memory is partitioned on all threads and each bucket's share
//! appended to its file in one piece. So there is no buffer per bucket, and writes are large.

use rayon::prelude::*;

use super::partition::{BUCKETS_MAX, Part, Scratch, partition, scratch_bytes};
use crate::{
    error::Result,
    storage::{Record, RecordFile, RecordWriter, Workspace, open_files_max},
};

/// What a [`Distributor`] may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Buckets; at most [`buckets_max`] keep the writes large, any number up to
    /// [`open_files_max`] works.
    pub buckets: usize,
    /// Bytes of memory to hold, reserved by the caller.
    pub memory_bytes: u64,
}

/// Buckets that one pass over the records can fill well within `memory_bytes`.
#[must_use]
pub fn buckets_max(memory_bytes: u64) -> usize {
    let by_memory = memory_bytes / 2 / PIECE_BYTES;
    by_memory.clamp(BUCKETS_MIN, open_files_max() as u64) as usize
}

/// Mean size of one append to a bucket: below it the calls weigh more than the bytes, above it a
/// further pass weighs more than the calls.
const PIECE_BYTES: u64 = 1 << 14;
/// Even with next to no memory a pass must get somewhere.
const BUCKETS_MIN: u64 = 8;

/// Sends records to numbered buckets. Records of a bucket keep the order they were pushed in.
pub struct Distributor<R, F> {
    chunk: Vec<R>,
    chunk_records_max: usize,
    scratch: Scratch<R>,
    buckets: Buckets<R>,
    bucket_of: F,
}

impl<R: Record, F: Fn(&R) -> usize + Sync> Distributor<R, F> {
    /// Starts a distribution. `bucket_of` gives numbers below `config.buckets`.
    ///
    /// # Errors
    /// [`crate::Error::Io`] when the files cannot be made.
    pub fn new(name: &str, config: &Config, workspace: &Workspace, bucket_of: F) -> Result<Self> {
        let record_bytes = size_of::<R>() + scratch_bytes::<R>();
        let chunk_records_max = chunk_records(config.memory_bytes, record_bytes);
        let buckets = Buckets::create(workspace, name, config.buckets)?;
        let scratch = Scratch::default();
        Ok(Self { chunk: Vec::new(), chunk_records_max, scratch, buckets, bucket_of })
    }

    /// Adds records.
    ///
    /// # Errors
    /// [`crate::Error::Io`] when the disk does not take them.
    pub fn push(&mut self, mut records: &[R]) -> Result<()> {
        while !records.is_empty() {
            if self.chunk.len() == self.chunk_records_max {
                self.spill()?;
            }
            let room = self.chunk_records_max - self.chunk.len();
            let (now, later) = records.split_at(room.min(records.len()));
            self.chunk.extend_from_slice(now);
            records = later;
        }
        Ok(())
    }

    /// Finishes all buckets, in order of their numbers; some may be empty.
    ///
    /// # Errors
    /// As [`Self::push`].
    pub fn finish(mut self) -> Result<Vec<RecordFile<R>>> {
        self.spill()?;
        self.buckets.finish()
    }

    fn spill(&mut self) -> Result<()> {
        let count = self.buckets.count();
        let parts = partition(&self.chunk, &mut self.scratch, count, &self.bucket_of, |_, r| *r);
        self.buckets.append(&parts)?;
        self.chunk.clear();
        Ok(())
    }
}

/// Records of `record_bytes` that `memory_bytes` hold, at least one.
pub(super) fn chunk_records(memory_bytes: u64, record_bytes: usize) -> usize {
    (memory_bytes / record_bytes as u64).max(1) as usize
}

/// The files of a distribution under way.
pub(super) struct Buckets<R> {
    writers: Vec<RecordWriter<R>>,
}

/// What is smaller than this waits in its bucket for more; larger appends are not copied.
const WRITER_BUFFER_BYTES: usize = 1 << 12;

impl<R: Record> Buckets<R> {
    pub(super) fn create(workspace: &Workspace, name: &str, count: usize) -> Result<Self> {
        assert!(count <= BUCKETS_MAX, "too many buckets");
        let create = |_| RecordWriter::create_buffered(workspace, name, None, WRITER_BUFFER_BYTES);
        Ok(Self { writers: (0..count).map(create).collect::<Result<_>>()? })
    }

    pub(super) fn count(&self) -> usize {
        self.writers.len()
    }

    /// Appends a partitioned batch, each bucket in the order of the parts.
    pub(super) fn append(&mut self, parts: &[Part<'_, R>]) -> Result<()> {
        self.writers.par_iter_mut().enumerate().try_for_each(|(bucket, writer)| {
            parts.iter().try_for_each(|part| writer.extend(part.bucket(bucket)))
        })
    }

    pub(super) fn finish(self) -> Result<Vec<RecordFile<R>>> {
        self.writers.into_iter().map(RecordWriter::finish).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::external::testing::files_left;

    #[test]
    fn buckets_hold_their_records_in_the_order_pushed() {
        let workspace = Workspace::for_test();
        let numbers: Vec<u64> = (0..10_000).map(|n| n * 7919 % 10_007).collect();
        for memory_bytes in [0, 100, 5000, 1 << 20] {
            let config = Config { buckets: 11, memory_bytes };
            let mut distributor =
                Distributor::new("numbers", &config, &workspace, |n: &u64| (n / 1000) as usize)
                    .unwrap();
            numbers.chunks(77).for_each(|batch| distributor.push(batch).unwrap());
            for (bucket, file) in distributor.finish().unwrap().iter().enumerate() {
                let of_bucket = numbers.iter().filter(|n| **n / 1000 == bucket as u64);
                assert!(file.read_all().unwrap().iter().eq(of_bucket), "{memory_bytes}");
            }
        }
        assert_eq!((files_left(&workspace), workspace.disk_bytes()), (0, 0));
    }

    #[test]
    fn a_distribution_given_up_leaves_nothing() {
        let workspace = Workspace::for_test();
        let config = Config { buckets: 2, memory_bytes: 100 };
        let mut distributor =
            Distributor::new("numbers", &config, &workspace, |n: &u64| (n % 2) as usize).unwrap();
        distributor.push(&[1; 10_000]).unwrap();
        drop(distributor);
        assert_eq!((files_left(&workspace), workspace.disk_bytes()), (0, 0));
    }
}
