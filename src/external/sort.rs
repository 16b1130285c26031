//! Sorts any number of records by their keys, stably, within a given memory.
//!
//! What fits in memory is sorted there and never touches the disk. What does not goes through
//! one of two engines, which give the same records in the same order: by distribution, when the
//! keys seen first tell enough about the rest, or by merging.

use super::{
    Keyed,
    distribute::chunk_records,
    in_memory::{sample_slice, scratch_bytes, sort_parallel},
    sort_distribution::{Bucket, Distribution, bucket_count, cut_large, emit_sorted, write_sorted},
    sort_journal::{note_buckets, note_runs},
    sort_merge::Runs,
    splitters::drifts,
};
use crate::{
    error::Result,
    progress::{Meter, Monitor, StageId},
    storage::{IO_BLOCK_BYTES, RecordFile, RecordWriter, Workspace},
};

/// How records that do not fit in memory are sorted. The result is the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Engine {
    /// Distribution, unless the first records are in an order that makes their keys no sample of
    /// the later ones; then merging.
    Auto,
    /// Into buckets by ranges of the key. Each record is written once, twice if a sample misled.
    Distribution,
    /// Sorted runs, merged. Each record is written once, more often only if there are more runs
    /// than memory has blocks for.
    Merge,
}

/// What a sort may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Stage that progress is reported for.
    pub stage: StageId,
    /// Bytes of memory to hold, reserved by the caller. Half of it is for records; the other
    /// half for their copies while they are moved.
    pub memory_bytes: u64,
    /// How to sort what does not fit.
    pub engine: Engine,
    /// What the sort is called in the journal of its workspace, see [`Sorter::noted`]; it is not
    /// noted without.
    pub step: Option<&'static str>,
}

/// Sorts a file, which is removed as soon as it has been read (if no one else holds it).
///
/// Memory: [`Config::memory_bytes`]. Temporary disk: the size of the input, once while it is
/// read (beside the input) and once while the result is written.
///
/// # Errors
/// [`crate::Error::Io`], [`crate::Error::Damaged`] when a file is not as it was written,
/// [`crate::Error::Cancelled`].
pub fn sort<R: Keyed>(
    input: RecordFile<R>,
    config: &Config,
    workspace: &Workspace,
    monitor: &Monitor<'_>,
) -> Result<RecordFile<R>> {
    let mut sorter = Sorter::new(config, workspace, monitor);
    sorter.fill_from(input)?;
    sorter.finish()
}

/// Sorts a file as [`sort`] does and passes the records to `sink`, in batches, in order.
///
/// # Errors
/// As [`sort`], and what `sink` returns.
pub fn sort_into<R: Keyed>(
    input: RecordFile<R>,
    config: &Config,
    workspace: &Workspace,
    monitor: &Monitor<'_>,
    sink: impl FnMut(&[R]) -> Result<()>,
) -> Result<()> {
    let mut sorter = Sorter::new(config, workspace, monitor);
    sorter.fill_from(input)?;
    sorter.finish_into(sink)
}

/// Takes records in any order and gives them back sorted: for callers who make the records, so
/// that the unsorted ones need no file.
pub struct Sorter<'a, R: Keyed> {
    pub(super) config: Config,
    pub(super) workspace: &'a Workspace,
    monitor: &'a Monitor<'a>,
    /// Never longer than `chunk_records_max`.
    chunk: Vec<R>,
    chunk_records_max: usize,
    pub(super) spilled: Spilled<'a, R>,
    pub(super) count: u64,
    /// Records on the disk, the first ones.
    pub(super) held: u64,
    /// Those of them that were there before this run, and how many of those have come again.
    pub(super) held_before: u64,
    pub(super) passed_over: u64,
}

/// What has left memory.
pub(super) enum Spilled<'a, R: Keyed> {
    Nothing,
    ToBuckets(Distribution<R>),
    ToRuns(Box<Runs<'a, R>>),
    /// All of it, before this run began.
    InBuckets(Vec<Bucket<R>>),
    InRuns(Box<Runs<'a, R>>),
}

/// Keys of the first memory load that decide the engine and the buckets.
const SAMPLE_KEYS: usize = 1 << 12;

impl<'a, R: Keyed> Sorter<'a, R> {
    /// Starts a sort. Allocates as records come.
    #[must_use]
    pub fn new(config: &Config, workspace: &'a Workspace, monitor: &'a Monitor<'a>) -> Self {
        let record_bytes = size_of::<R>() + scratch_bytes::<R>();
        Self {
            config: *config,
            workspace,
            monitor,
            chunk: Vec::new(),
            chunk_records_max: chunk_records(config.memory_bytes, record_bytes),
            spilled: Spilled::Nothing,
            count: 0,
            held: 0,
            held_before: 0,
            passed_over: 0,
        }
    }

    /// Adds records. Counting and cancelling is up to the loop that makes them.
    ///
    /// # Errors
    /// [`crate::Error::Io`] when the disk does not take what does not fit in memory.
    pub fn push(&mut self, mut records: &[R]) -> Result<()> {
        if self.is_filled() {
            return Ok(());
        }
        self.count += records.len() as u64;
        records = self.without_held(records);
        while !records.is_empty() {
            if self.chunk.len() == self.chunk_records_max {
                self.spill()?;
            }
            let room = self.chunk_records_max - self.chunk.len();
            let (now, later) = records.split_at(room.min(records.len()));
            self.reserve_chunk(now.len());
            self.chunk.extend_from_slice(now);
            records = later;
        }
        Ok(())
    }

    /// Records added so far.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Whether what was added did not fit in memory.
    #[must_use]
    pub fn is_on_disk(&self) -> bool {
        !matches!(self.spilled, Spilled::Nothing)
    }

    /// Ends the input: what went to the disk is there in whole, and noted if it is to be.
    ///
    /// # Errors
    /// As [`sort`].
    pub fn end_input(&mut self) -> Result<()> {
        self.check_held()?;
        let Self { config, workspace, monitor, count, .. } = self;
        let buckets = match std::mem::replace(&mut self.spilled, Spilled::Nothing) {
            Spilled::Nothing => return Ok(()),
            Spilled::ToRuns(mut runs) => {
                drop(runs.spill(std::mem::take(&mut self.chunk))?);
                note_runs(&runs, *count, config, workspace)?;
                self.spilled = Spilled::InRuns(runs);
                return Ok(());
            }
            Spilled::InRuns(runs) => {
                self.spilled = Spilled::InRuns(runs);
                return Ok(());
            }
            Spilled::ToBuckets(mut distribution) => {
                distribution.append(&std::mem::take(&mut self.chunk))?;
                distribution.finish()?
            }
            Spilled::InBuckets(buckets) => buckets,
        };
        // With less memory than in the run before, buckets that were small enough are not.
        let buckets = cut_large(buckets, config, workspace, monitor)?;
        note_buckets(&buckets, *count, config, workspace)?;
        self.spilled = Spilled::InBuckets(buckets);
        Ok(())
    }

    /// Sorts what was added and writes it to a file.
    ///
    /// # Errors
    /// As [`sort`].
    pub fn finish(mut self) -> Result<RecordFile<R>> {
        self.end_input()?;
        let Self { config, workspace, monitor, count, .. } = self;
        let mut writer = RecordWriter::create(workspace, "sorted", Some(count))?;
        if let Spilled::InBuckets(buckets) = self.spilled {
            let meter = monitor.meter_of::<R>(config.stage, count);
            write_sorted(buckets, config.memory_bytes, &meter, &mut writer)?;
            meter.finish();
        } else {
            self.finish_into(|records| writer.extend(records))?;
        }
        writer.finish()
    }

    /// Sorts what was added and passes it to `sink`, in batches, in order.
    ///
    /// # Errors
    /// As [`sort`], and what `sink` returns.
    pub fn finish_into(mut self, mut sink: impl FnMut(&[R]) -> Result<()>) -> Result<()> {
        self.end_input()?;
        let Self { config, monitor, mut chunk, spilled, count, .. } = self;
        let memory_bytes = config.memory_bytes;
        match spilled {
            Spilled::InRuns(runs) => return runs.merge_into(sink),
            Spilled::InBuckets(buckets) => {
                let meter = monitor.meter_of::<R>(config.stage, count);
                emit_sorted(buckets, memory_bytes, |records| emit(records, &meter, &mut sink))?;
                meter.finish();
            }
            Spilled::Nothing => {
                sort_parallel(&mut chunk);
                let meter = monitor.meter_of::<R>(config.stage, count);
                emit(&chunk, &meter, &mut sink)?;
                meter.finish();
            }
            Spilled::ToBuckets(_) | Spilled::ToRuns(_) => unreachable!("the input has ended"),
        }
        Ok(())
    }

    /// Reads a whole file. Its size and a sample of its keys are known before.
    fn fill_from(&mut self, input: RecordFile<R>) -> Result<()> {
        let fits = input.count() <= self.chunk_records_max as u64;
        let meter = self.monitor.meter_of::<R>(self.config.stage, input.count());
        if !fits && self.config.engine != Engine::Merge {
            let memory_bytes = self.config.memory_bytes;
            let mut distribution = Distribution::of_file(&input, self.workspace, memory_bytes)?;
            self.count = input.count();
            distribution.append_file(input, &meter)?;
            meter.finish();
            self.spilled = Spilled::ToBuckets(distribution);
            return Ok(());
        }
        let mut scanner = input.scan()?;
        drop(input);
        let block_records = (IO_BLOCK_BYTES / size_of::<R>()).max(1);
        while scanner.left() > 0 {
            if self.chunk.len() == self.chunk_records_max {
                self.spill()?;
            }
            let room = self.chunk_records_max - self.chunk.len();
            let count = room.min(block_records).min(scanner.left() as usize);
            self.reserve_chunk(scanner.left() as usize);
            let start = self.chunk.len();
            self.chunk.resize(start + count, R::new_zeroed());
            scanner.read_into(&mut self.chunk[start..])?;
            self.count += count as u64;
            meter.add(count as u64)?;
        }
        meter.finish();
        Ok(())
    }

    /// Makes room for `more` records, doubling as a vector does but never past the limit.
    fn reserve_chunk(&mut self, more: usize) {
        let needed = self.chunk.len() + more;
        if needed > self.chunk.capacity() {
            let wanted = needed.max(2 * self.chunk.capacity()).min(self.chunk_records_max);
            self.chunk.reserve_exact(wanted - self.chunk.len());
        }
    }

    /// Empties the chunk.
    fn spill(&mut self) -> Result<()> {
        if matches!(self.spilled, Spilled::Nothing) {
            self.spilled = self.choose_engine()?;
        }
        self.held += self.chunk.len() as u64;
        match &mut self.spilled {
            Spilled::Nothing | Spilled::InBuckets(_) | Spilled::InRuns(_) => {
                unreachable!("an engine was chosen above, and nothing is pushed after the end")
            }
            Spilled::ToBuckets(distribution) => {
                distribution.append(&self.chunk)?;
                self.chunk.clear();
            }
            Spilled::ToRuns(runs) => {
                self.chunk = runs.spill(std::mem::take(&mut self.chunk))?;
            }
        }
        self.checkpoint()
    }

    /// Decides by the first full chunk.
    fn choose_engine(&self) -> Result<Spilled<'a, R>> {
        let sample = sample_slice(&self.chunk, SAMPLE_KEYS);
        let merge = match self.config.engine {
            Engine::Auto => drifts(&sample),
            Engine::Distribution => false,
            Engine::Merge => true,
        };
        Ok(if merge {
            Spilled::ToRuns(Box::new(Runs::new(&self.config, self.workspace, self.monitor)))
        } else {
            let buckets = bucket_count(None, self.config.memory_bytes);
            Spilled::ToBuckets(Distribution::create(
                self.workspace,
                sample,
                buckets,
                self.config.memory_bytes / 2,
            )?)
        })
    }
}

/// Passes `records` on in batches, so that a large result can be cancelled too.
fn emit<R: Keyed>(
    records: &[R],
    meter: &Meter<'_>,
    mut sink: impl FnMut(&[R]) -> Result<()>,
) -> Result<()> {
    for batch in records.chunks((IO_BLOCK_BYTES * 4 / size_of::<R>()).max(1)) {
        meter.add(batch.len() as u64)?;
        sink(batch)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::{
        Error,
        external::testing::{Item, file_of, files_left, items},
    };

    const ENGINES: [Engine; 3] = [Engine::Auto, Engine::Distribution, Engine::Merge];

    fn config(engine: Engine, memory_bytes: u64) -> Config {
        Config { stage: StageId::Sort, memory_bytes, engine, step: None }
    }

    /// Sorts as a file and as records pushed, and checks both against the standard library.
    fn sorts_as_the_oracle(input: &[Item], config: &Config) {
        let mut expected = input.to_vec();
        expected.sort_by_key(Keyed::key);
        let workspace = Workspace::for_test();
        let monitor = Monitor::silent();
        let file = sort(file_of(&workspace, input), config, &workspace, &monitor).unwrap();
        assert!(file.read_all().unwrap() == expected, "file, {config:?}");
        assert_eq!(files_left(&workspace), 1, "the result is all that is left");
        drop(file);
        let mut sorter = Sorter::new(config, &workspace, &monitor);
        input.chunks(77).for_each(|batch| sorter.push(batch).unwrap());
        let mut found = Vec::new();
        sorter
            .finish_into(|records| {
                found.extend_from_slice(records);
                Ok(())
            })
            .unwrap();
        assert!(found == expected, "pushed, {config:?}");
        assert_eq!((files_left(&workspace), workspace.disk_bytes()), (0, 0));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn any_keys_are_sorted_stably_by_any_engine_in_any_memory(
            keys in prop::collection::vec(prop_oneof![0..9_u64, any::<u64>(), Just(u64::MAX)], 0..1500)
        ) {
            for engine in ENGINES {
                for memory_bytes in [0, 900, 9000, 1 << 20] {
                    // Next to no memory means a file for every few records.
                    let keys = if memory_bytes == 0 { &keys[..keys.len() / 10] } else { &keys };
                    sorts_as_the_oracle(&items(keys.iter().copied()), &config(engine, memory_bytes));
                }
            }
        }
    }

    #[test]
    fn every_shape_of_keys_is_sorted_stably_by_every_engine() {
        let n = 30_000_u64;
        let shapes: [Vec<u64>; 7] = [
            (0..n).collect(),
            (0..n).rev().collect(),
            vec![7; n as usize],
            vec![u64::MAX; n as usize],
            (0..n).map(|i| i.wrapping_mul(0x9e37_79b9_7f4a_7c15)).collect(),
            (0..n).map(|i| if i % 10 == 0 { i } else { 12_345 }).collect(),
            // The first records say nothing about the later ones.
            (0..n).map(|i| if i < 20_000 { i % 5 } else { 5 + i * 7919 % 10_007 }).collect(),
        ];
        for keys in shapes {
            for engine in ENGINES {
                sorts_as_the_oracle(&items(keys.iter().copied()), &config(engine, 50_000));
            }
        }
    }

    #[test]
    fn every_number_of_records_around_a_full_memory_is_sorted() {
        let memory_bytes = 5000;
        let record_bytes = size_of::<Item>() + scratch_bytes::<Item>();
        let full = chunk_records(memory_bytes, record_bytes) as u64;
        for engine in ENGINES {
            for chunks in [0, 1, 2, 3, 40] {
                for n in (chunks * full).saturating_sub(1)..=chunks * full + 1 {
                    let keys = (0..n).map(|i| i * 7919 % 10_007);
                    sorts_as_the_oracle(&items(keys), &config(engine, memory_bytes));
                }
            }
        }
    }

    #[test]
    fn what_fits_in_memory_never_touches_the_disk() {
        let workspace = Workspace::for_test();
        let monitor = Monitor::silent();
        let mut sorter = Sorter::new(&config(Engine::Auto, 1 << 20), &workspace, &monitor);
        sorter.push(&items((0..1000).rev())).unwrap();
        sorter.finish_into(|_| Ok(())).unwrap();
        assert_eq!(workspace.disk_bytes_peak(), 0);
    }

    #[test]
    fn the_number_of_threads_does_not_show() {
        let input = items((0..100_000_u64).map(|i| i * 7919 % 10_007));
        for threads in [1, 2, 5] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            for engine in ENGINES {
                pool.install(|| sorts_as_the_oracle(&input, &config(engine, 300_000)));
            }
        }
    }

    #[test]
    fn a_cancelled_sort_leaves_nothing() {
        let input = items((0..50_000_u64).map(|i| i * 7919 % 10_007));
        for engine in ENGINES {
            // Raised at the first event, or when the result begins to come out.
            for from_sink in [false, true] {
                let workspace = Workspace::for_test();
                let monitor = Monitor::silent();
                let file = file_of(&workspace, &input);
                if !from_sink {
                    monitor.cancel.raise();
                }
                let config = config(engine, 100_000);
                let outcome = sort_into(file, &config, &workspace, &monitor, |_| {
                    monitor.cancel.raise();
                    Ok(())
                });
                assert!(matches!(outcome, Err(Error::Cancelled(_))), "{engine:?}");
                assert_eq!((files_left(&workspace), workspace.disk_bytes()), (0, 0));
            }
        }
    }
}
