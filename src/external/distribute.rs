//! Records into buckets on disk, by a number each record gives.
//!
//! The input is taken in parts that fit the processor's cache. Each thread reads a part of its
//! own, partitions it, adds it to the buckets when its turn has come, and writes those buffers
//! that this filled.

use std::sync::Mutex;

use super::{
    partition::{BUCKETS_MAX, Part, part_records},
    turns::{Spare, Steps, in_turns},
};
use crate::{
    error::Result,
    storage::{
        FileEntry, FullBuffers, Kept, Record, RecordFile, RecordWriter, Stretch, Sum, Workspace,
        open_files_max,
    },
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

/// Mean size of one write to a bucket: below it the calls weigh more than the bytes, above it a
/// further pass weighs more than the calls.
const PIECE_BYTES: u64 = 1 << 14;
/// Even with next to no memory a pass must get somewhere.
const BUCKETS_MIN: u64 = 8;

/// Sends records to numbered buckets. Records of a bucket keep the order they were pushed in.
pub struct Distributor<R, F> {
    /// Never longer than `chunk_records_max`.
    chunk: Vec<R>,
    chunk_records_max: usize,
    buckets: Buckets<R>,
    bucket_of: F,
}

impl<R: Record, F: Fn(&R) -> usize + Sync> Distributor<R, F> {
    /// Starts a distribution. `bucket_of` gives numbers below `config.buckets`.
    ///
    /// # Errors
    /// [`crate::Error::Io`] when the files cannot be made.
    pub fn new(name: &str, config: &Config, workspace: &Workspace, bucket_of: F) -> Result<Self> {
        let chunk_records_max = chunk_records(config.memory_bytes / 2, size_of::<R>());
        let buckets = Buckets::create(workspace, name, config)?;
        Ok(Self { chunk: Vec::new(), chunk_records_max, buckets, bucket_of })
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
        self.buckets.append(&self.chunk, &self.bucket_of, |_, record| *record)?;
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
    memory_bytes: u64,
    spare: Spare<UnderWay<R>>,
}

/// A bucket's buffer: a few pages even with next to no memory, and no more than is gained by.
const BUFFER_BYTES_MIN: u64 = 1 << 12;
const BUFFER_BYTES_MAX: u64 = 1 << 16;

impl<R: Record> Buckets<R> {
    /// A quarter of the memory is for buffers, a sixteenth for those that wait to be written, an
    /// eighth for the parts under way; the rest is the caller's.
    pub(super) fn create(workspace: &Workspace, name: &str, config: &Config) -> Result<Self> {
        let Config { buckets, memory_bytes } = *config;
        assert!(buckets <= BUCKETS_MAX, "too many buckets");
        let buffer_bytes = buffer_bytes(config);
        let create = |_| RecordWriter::create_buffered(workspace, name, None, buffer_bytes);
        let writers = (0..buckets).map(create).collect::<Result<_>>()?;
        Ok(Self { writers, memory_bytes, spare: Spare::default() })
    }

    /// Goes on with buckets that were noted, see [`Self::kept`].
    pub(super) fn reopen(
        workspace: &Workspace,
        entries: &[FileEntry],
        config: &Config,
    ) -> Result<Self> {
        let (memory_bytes, buffer_bytes) = (config.memory_bytes, buffer_bytes(config));
        let reopen = |entry| RecordWriter::reopen(workspace, entry, buffer_bytes);
        let writers = entries.iter().map(reopen).collect::<Result<_>>()?;
        Ok(Self { writers, memory_bytes, spare: Spare::default() })
    }

    /// The buckets as they are now, to be noted.
    pub(super) fn kept(&mut self) -> Result<Vec<Kept>> {
        self.writers.iter_mut().map(RecordWriter::kept).collect()
    }

    /// Sends `records` to their buckets, in order. `convert` makes what is stored of a record
    /// and its position in `records`.
    pub(super) fn append<S: Sync>(
        &mut self,
        records: &[S],
        bucket_of: impl Fn(&S) -> usize + Sync,
        convert: impl Fn(usize, &S) -> R + Sync,
    ) -> Result<()> {
        let (buckets, part_records) = (self.writers.len(), self.part_records());
        let mut parts = records.chunks(part_records).enumerate();
        let next = || Ok(parts.next());
        let work = |(i, source): (usize, &[S]), under_way: &mut UnderWay<R>| {
            let convert = |at, record: &S| convert(i * part_records + at, record);
            under_way.part.fill(source, buckets, &bucket_of, convert);
            Ok(())
        };
        self.append_parts(next, work, |_| Ok(()))
    }

    /// Sends a whole file to the buckets. `seen` is told of every part.
    pub(super) fn append_file(
        &mut self,
        file: RecordFile<R>,
        seen: impl Fn(usize) -> Result<()> + Sync,
        bucket_of: impl Fn(&R) -> usize + Sync,
        convert: impl Fn(usize, &R) -> R + Sync,
    ) -> Result<()> {
        let (buckets, part_records) = (self.writers.len(), self.part_records());
        let scanner = Mutex::new(file.scan()?);
        drop(file);
        let next = || {
            let mut scanner = scanner.lock().expect(WHOLE);
            let (stretch, count) = scanner.claim(part_records as u64);
            Ok((count > 0).then_some((stretch, count as usize)))
        };
        let work = |(mut stretch, count): (Stretch, usize), under_way: &mut UnderWay<R>| {
            seen(count)?;
            let UnderWay { source, sum, part, .. } = under_way;
            source.resize(count, R::new_zeroed());
            *sum = Sum::default();
            stretch.read(source, sum)?;
            part.fill(source, buckets, &bucket_of, &convert);
            Ok(())
        };
        self.append_parts(next, work, |under_way| {
            let count = under_way.source.len() as u64;
            scanner.lock().expect(WHOLE).absorb(count, &under_way.sum)
        })?;
        let mut scanner = scanner.into_inner().expect(WHOLE);
        // An empty file has a checksum, too.
        scanner.absorb(0, &Sum::default())
    }

    /// Takes parts from `next`, has them filled by `work`, and adds them to the buckets in order.
    /// `added` is called in the same order.
    fn append_parts<I: Send>(
        &mut self,
        next: impl FnMut() -> Result<Option<I>> + Send,
        work: impl Fn(I, &mut UnderWay<R>) -> Result<()> + Sync,
        added: impl Fn(&UnderWay<R>) -> Result<()> + Sync,
    ) -> Result<()> {
        let threads = rayon::current_num_threads();
        let full_bytes_max = self.memory_bytes as usize / 16 / threads;
        let steps = Steps {
            next,
            work,
            turn: |under_way: &mut UnderWay<R>| {
                added(under_way)?;
                let UnderWay { part, full, .. } = under_way;
                for (bucket, writer) in self.writers.iter_mut().enumerate() {
                    writer.extend_deferred(part.bucket(bucket), full)?;
                }
                Ok(())
            },
            after: |under_way: &mut UnderWay<R>| under_way.full.write(),
        };
        in_turns(threads, &self.spare, || UnderWay::new(full_bytes_max), steps)
    }

    /// Each thread has a part, and the source of it.
    fn part_records(&self) -> usize {
        part_records::<R>(self.memory_bytes / 8 / rayon::current_num_threads() as u64)
    }

    pub(super) fn finish(self) -> Result<Vec<RecordFile<R>>> {
        self.writers.into_iter().map(RecordWriter::finish).collect()
    }
}

/// Bytes of the buffer of each bucket.
fn buffer_bytes(config: &Config) -> usize {
    let bytes = config.memory_bytes / 4 / config.buckets.max(1) as u64;
    bytes.clamp(BUFFER_BYTES_MIN, BUFFER_BYTES_MAX) as usize
}

const WHOLE: &str = "a panic of one thread ends all";

/// What a thread of a distribution holds.
struct UnderWay<R> {
    source: Vec<R>,
    sum: Sum,
    part: Part<R>,
    full: FullBuffers,
}

impl<R> UnderWay<R> {
    fn new(full_bytes_max: usize) -> Self {
        let full = FullBuffers::new(full_bytes_max);
        Self { source: Vec::new(), sum: Sum::default(), part: Part::default(), full }
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
