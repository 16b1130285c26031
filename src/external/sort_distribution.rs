//! The engine that distributes: buckets by ranges of the key, each then sorted in memory.
//!
//! It writes every record once, as long as the sample it took its ranges from was a fair one;
//! buckets that turn out too large are cut again, from a sample of their own.

use std::sync::Mutex;

use super::{
    Keyed,
    distribute::{self, Buckets, buckets_max},
    in_memory::{Place, sort_to_either},
    sort::Config,
    splitters::Splitters,
    turns::{Spare, Steps, in_turns},
    waves,
};
use crate::{
    error::Result,
    progress::{Meter, Monitor},
    storage::{IO_BLOCK_BYTES, Record, RecordFile, RecordWriter, Stretch, Sum, Workspace},
};

/// Aimed size of a bucket: with its scratch it about fits a second-level cache of 2 MiB. Measured
/// with 24-byte records: 1.4 MB sort in 20 ns each, 4 MB in 32, 5.8 MB in 35.
const BUCKET_BYTES: u64 = 3 << 19;

/// Buckets to cut into: enough for small ones if the size of the whole is known, as many as can
/// be filled well if not.
pub(super) fn bucket_count(size_bytes: Option<u64>, memory_bytes: u64) -> usize {
    let most = buckets_max(memory_bytes);
    let Some(size_bytes) = size_bytes else { return most };
    let bucket_bytes = BUCKET_BYTES.min(memory_bytes / 16).max(1);
    size_bytes.div_ceil(bucket_bytes).clamp(2, most as u64) as usize
}

/// A distribution under way.
pub(super) struct Distribution<R: Keyed> {
    pub(super) splitters: Splitters<R::Key>,
    pub(super) buckets: Buckets<R>,
}

/// A bucket on disk, not yet sorted.
pub(super) struct Bucket<R> {
    pub(super) file: RecordFile<R>,
    /// All keys are equal, so that the bucket is sorted as it is.
    pub(super) one_key: bool,
}

impl<R: Keyed> Distribution<R> {
    pub(super) fn create(
        workspace: &Workspace,
        sample: Vec<R::Key>,
        buckets: usize,
        memory_bytes: u64,
    ) -> Result<Self> {
        let splitters = Splitters::choose(sample, buckets);
        let config = distribute::Config { buckets: splitters.count(), memory_bytes };
        let buckets = Buckets::create(workspace, "bucket", &config)?;
        Ok(Self { splitters, buckets })
    }

    /// Starts a distribution by a sample of `file`.
    pub(super) fn of_file(
        file: &RecordFile<R>,
        workspace: &Workspace,
        memory_bytes: u64,
    ) -> Result<Self> {
        let size_bytes = file.count() * size_of::<R>() as u64;
        let buckets = bucket_count(Some(size_bytes), memory_bytes);
        Self::create(workspace, sample_file(file)?, buckets, memory_bytes)
    }

    /// Sends a chunk of the input to the buckets.
    pub(super) fn append(&mut self, chunk: &[R]) -> Result<()> {
        let bucket_of = |record: &R| self.splitters.bucket(record.key());
        self.buckets.append(chunk, bucket_of, |_, record| *record)
    }

    /// Sends a whole file to the buckets.
    pub(super) fn append_file(&mut self, file: RecordFile<R>, meter: &Meter<'_>) -> Result<()> {
        let bucket_of = |record: &R| self.splitters.bucket(record.key());
        let seen = |count: usize| Ok(meter.add(count as u64)?);
        self.buckets.append_file(file, seen, bucket_of, |_, record| *record)
    }

    /// The buckets that are not empty, in order of their keys.
    pub(super) fn finish(self) -> Result<Vec<Bucket<R>>> {
        let Self { splitters, buckets } = self;
        let files = buckets.finish()?.into_iter().enumerate();
        let buckets = files.map(|(i, file)| Bucket { file, one_key: splitters.is_one_key(i) });
        Ok(buckets.filter(|bucket| bucket.file.count() > 0).collect())
    }
}

/// Places of a file where a sample looks, and keys it takes at each: 16,384 keys, 16 for each of
/// 1024 buckets, keep the largest bucket within about twice the mean.
const SAMPLE_PLACES: u64 = 1024;
const SAMPLE_KEYS_EACH: u64 = 16;

/// Keys from all over a file.
fn sample_file<R: Keyed>(file: &RecordFile<R>) -> Result<Vec<R::Key>> {
    let places = SAMPLE_PLACES.min(file.count());
    let mut sample = Vec::new();
    for place in 0..places {
        let first = place * file.count() / places;
        let end = (place + 1) * file.count() / places;
        let mut batch = vec![R::new_zeroed(); SAMPLE_KEYS_EACH.min(end - first) as usize];
        file.scan_range(first, batch.len() as u64)?.read_into(&mut batch)?;
        sample.extend(batch.iter().map(R::key));
    }
    Ok(sample)
}

/// Bytes of a bucket that sorts within `memory_bytes`: itself, its scratch, and both again for
/// the bucket before it, which is being handed over.
fn bucket_bytes_max(memory_bytes: u64) -> u64 {
    memory_bytes / 4
}

/// Cuts buckets that are too large to be sorted in memory until there are none.
pub(super) fn cut_large<R: Keyed>(
    mut buckets: Vec<Bucket<R>>,
    config: &Config,
    workspace: &Workspace,
    monitor: &Monitor<'_>,
) -> Result<Vec<Bucket<R>>> {
    let memory_bytes = config.memory_bytes;
    let is_large = |bucket: &Bucket<R>| {
        let fits = bucket.file.size_bytes() <= bucket_bytes_max(memory_bytes);
        !(fits || bucket.one_key || bucket.file.count() == 1)
    };
    while buckets.iter().any(is_large) {
        let large = buckets.iter().filter(|bucket| is_large(bucket));
        let meter = monitor.meter_of::<R>(config.stage, large.map(|b| b.file.count()).sum());
        let mut smaller = Vec::with_capacity(buckets.len());
        for bucket in buckets {
            if !is_large(&bucket) {
                smaller.push(bucket);
                continue;
            }
            let mut distribution = Distribution::of_file(&bucket.file, workspace, memory_bytes)?;
            distribution.append_file(bucket.file, &meter)?;
            smaller.extend(distribution.finish()?);
        }
        meter.finish();
        buckets = smaller;
    }
    Ok(buckets)
}

/// Sorts each bucket on some thread and passes the records to `sink` in order.
pub(super) fn emit_sorted<R: Keyed>(
    buckets: Vec<Bucket<R>>,
    memory_bytes: u64,
    mut sink: impl FnMut(&[R]) -> Result<()>,
) -> Result<()> {
    let largest = largest_records(&buckets);
    let width_max = 2 * rayon::current_num_threads();
    let width = (buckets_at_once::<R>(largest, memory_bytes) / 2).clamp(1, width_max);
    let spare = Mutex::new(Vec::<Memory<R>>::new());
    let take_spare = || spare.lock().expect("no thread panics with the list in hand").pop();
    let work = |bucket: Bucket<R>| {
        if bucket.one_key {
            return Ok(Sorted::OnDisk(bucket.file));
        }
        let mut memory = take_spare().unwrap_or_else(|| Memory::new(largest));
        let count = memory.sort(bucket.file)?.len();
        Ok(Sorted::InMemory(memory, count))
    };
    let mut buckets = buckets.into_iter();
    waves::in_order(
        width,
        || Ok(buckets.next()),
        work,
        |sorted| match sorted {
            Sorted::InMemory(memory, count) => {
                sink(&memory.records[..count])?;
                spare.lock().expect("no thread panics with the list in hand").push(memory);
                Ok(())
            }
            Sorted::OnDisk(file) => {
                let mut scanner = file.scan()?;
                while let Some(batch) = scanner.next_batch()? {
                    sink(batch)?;
                }
                Ok(())
            }
        },
    )
}

/// A bucket in memory, in order; or one on disk that is in order already.
enum Sorted<R> {
    InMemory(Memory<R>, usize),
    OnDisk(RecordFile<R>),
}

/// Sorts each bucket on some thread, which also writes it to its place.
pub(super) fn write_sorted<R: Keyed>(
    buckets: Vec<Bucket<R>>,
    memory_bytes: u64,
    meter: &Meter<'_>,
    writer: &mut RecordWriter<R>,
) -> Result<()> {
    let largest = largest_records(&buckets);
    let width = buckets_at_once::<R>(largest, memory_bytes);
    let writer = Mutex::new(writer);
    let writer = || writer.lock().expect("no thread panics with the writer in hand");
    let mut buckets = buckets.into_iter();
    let next = || {
        let Some(bucket) = buckets.next() else { return Ok(None) };
        let place = writer().promise(bucket.file.count())?;
        Ok(Some((bucket, place)))
    };
    let work = |(bucket, mut place): (Bucket<R>, Stretch), under_way: &mut Writing<R>| {
        under_way.count = bucket.file.count();
        under_way.sum = Sum::default();
        let mut write = |records: &[R]| {
            meter.add(records.len() as u64)?;
            place.write(records, &mut under_way.sum)
        };
        if bucket.one_key {
            let mut scanner = bucket.file.scan()?;
            while let Some(batch) = scanner.next_batch()? {
                write(batch)?;
            }
            return Ok(());
        }
        let memory = under_way.memory.get_or_insert_with(|| Memory::new(largest));
        let batch_records = (IO_BLOCK_BYTES / size_of::<R>()).max(1);
        memory.sort(bucket.file)?.chunks(batch_records).try_for_each(write)
    };
    let turn = |under_way: &mut Writing<R>| {
        writer().absorb(under_way.count, &under_way.sum);
        Ok(())
    };
    let state = || Writing { memory: None, count: 0, sum: Sum::default() };
    let steps = Steps { next, work, turn, after: |_: &mut Writing<R>| Ok(()) };
    in_turns(width, &Spare::default(), state, steps)
}

/// What a thread holds that writes buckets.
struct Writing<R> {
    /// Made for the first bucket that needs sorting.
    memory: Option<Memory<R>>,
    count: u64,
    sum: Sum,
}

/// Records of the largest bucket that is sorted in memory.
fn largest_records<R: Record>(buckets: &[Bucket<R>]) -> usize {
    let in_memory = buckets.iter().filter(|bucket| !bucket.one_key);
    in_memory.map(|bucket| bucket.file.count()).max().unwrap_or(0) as usize
}

/// Buckets that may be in memory, each with its scratch.
fn buckets_at_once<R>(largest: usize, memory_bytes: u64) -> usize {
    (memory_bytes / 2 / (largest * size_of::<R>()).max(1) as u64).max(1) as usize
}

/// Room for one bucket and for sorting it, used again and again.
struct Memory<R> {
    records: Vec<R>,
    scratch: Vec<R>,
}

impl<R: Keyed> Memory<R> {
    fn new(largest: usize) -> Self {
        let room = || vec![R::new_zeroed(); largest];
        Self { records: room(), scratch: room() }
    }

    /// Reads a bucket, removes it, and leaves it at the front of the records, in order.
    fn sort(&mut self, file: RecordFile<R>) -> Result<&[R]> {
        let count = file.scan()?.read_into(&mut self.records)?;
        drop(file);
        let Self { records, scratch } = self;
        if sort_to_either(&mut records[..count], &mut scratch[..count]) == Place::Scratch {
            std::mem::swap(records, scratch);
        }
        Ok(&self.records[..count])
    }
}
