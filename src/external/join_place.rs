//! The end of a join: values go to files by range of slots, and each range is put in order in
//! memory, by writing every value where it belongs.

use std::sync::Mutex;

use super::{join::Job, join_resolve::Placed, waves};
use crate::{
    error::Result,
    storage::{Record, RecordFile, RecordWriter, open_files_max},
};

/// Values on their way to their slots.
pub(super) struct Placement<'a, T: Record> {
    job: &'a Job<'a>,
    /// Slots of all ranges but the last, which may have fewer.
    range_slots: u64,
    writers: Vec<RecordWriter<Placed<T>>>,
    /// Values of one append, with slots that count from their range.
    batch: Vec<Placed<T>>,
}

/// Slots whose values may be in memory: two ranges are, one being filled, one being emitted.
fn range_slots_max<T>(memory_bytes: u64) -> u64 {
    (memory_bytes / 2 / size_of::<T>() as u64).max(1)
}

/// Smaller ranges gain nothing: these fit the second-level cache.
const RANGE_BYTES: u64 = 1 << 20;
/// Buffer of a range. With less, writes are small; with more, ranges are few and a further pass
/// is needed sooner.
const BUFFER_BYTES_MIN: u64 = 1 << 12;
/// Even with next to no memory a pass must get somewhere.
const RANGES_MIN: u64 = 8;

impl<'a, T: Record> Placement<'a, T> {
    pub(super) fn create(slots: u64, job: &'a Job<'a>) -> Result<Self> {
        let memory_bytes = job.memory_bytes;
        let ranges_max = memory_bytes / 8 / BUFFER_BYTES_MIN;
        let ranges_max = ranges_max.clamp(RANGES_MIN, open_files_max() as u64);
        let slots_small = (RANGE_BYTES / size_of::<T>() as u64).max(1);
        let range_slots = range_slots_max::<T>(memory_bytes).min(slots_small);
        let range_slots = range_slots.max(slots.div_ceil(ranges_max));
        assert!(range_slots <= 1 << u32::BITS, "more than 2^32 slots for each of the ranges");
        let ranges = slots.div_ceil(range_slots);
        let buffer_bytes = (memory_bytes / 8 / ranges.max(1)) as usize;
        let create = |_| RecordWriter::create_buffered(job.workspace, "values", None, buffer_bytes);
        let writers = (0..ranges).map(create).collect::<Result<_>>()?;
        Ok(Self { job, range_slots, writers, batch: Vec::new() })
    }

    /// Adds values whose slots count from `first_slot` and ascend.
    pub(super) fn append(&mut self, first_slot: u64, mut values: &[Placed<T>]) -> Result<()> {
        while let Some(first) = values.first() {
            let range = (first_slot + u64::from(first.slot)) / self.range_slots;
            let range_first = range * self.range_slots;
            let range_end = range_first + self.range_slots;
            let in_range = |v: &Placed<T>| first_slot + u64::from(v.slot) < range_end;
            let (now, later) = values.split_at(values.partition_point(in_range));
            self.batch.clear();
            self.batch.extend(now.iter().map(|placed| Placed {
                slot: (first_slot + u64::from(placed.slot) - range_first) as u32,
                value: placed.value,
            }));
            self.writers[range as usize].extend(&self.batch)?;
            values = later;
        }
        Ok(())
    }

    /// Passes all values to `sink` in order of their slots.
    pub(super) fn finish_into(self, sink: &mut dyn FnMut(&[T]) -> Result<()>) -> Result<()> {
        let Self { job, range_slots, writers, .. } = self;
        let files = writers.into_iter().map(RecordWriter::finish).collect::<Result<Vec<_>>>()?;
        if range_slots > range_slots_max::<T>(job.memory_bytes) {
            for file in files {
                cut_range(file, job)?.finish_into(sink)?;
            }
            return Ok(());
        }
        let range_bytes = range_slots * size_of::<T>() as u64;
        let width_max = 2 * rayon::current_num_threads() as u64;
        let width = (job.memory_bytes / 2 / range_bytes.max(1)).clamp(1, width_max) as usize;
        let spare = Mutex::new(Vec::<Vec<T>>::new());
        let take_spare = || spare.lock().expect("no thread panics with the list in hand").pop();
        let work = |file: RecordFile<Placed<T>>| {
            let new = || vec![T::new_zeroed(); range_slots as usize];
            let mut values = take_spare().unwrap_or_else(new);
            let count = file.count() as usize;
            place(file, &mut values)?;
            Ok((values, count))
        };
        let mut files = files.into_iter();
        waves::in_order(
            width,
            || Ok(files.next()),
            work,
            |(values, count)| {
                for batch in values[..count].chunks(EMIT_VALUES) {
                    sink(batch)?;
                }
                spare.lock().expect("no thread panics with the list in hand").push(values);
                Ok(())
            },
        )
    }
}

/// Values passed on at a time, so that a large result can be cancelled too.
const EMIT_VALUES: usize = 1 << 16;

/// Writes each value of a range to its place. Every slot occurs once, so nothing is left over.
fn place<T: Record>(file: RecordFile<Placed<T>>, values: &mut [T]) -> Result<()> {
    let mut scanner = file.scan()?;
    drop(file);
    while let Some(batch) = scanner.next_batch()? {
        for placed in batch {
            values[placed.slot as usize] = placed.value;
        }
    }
    Ok(())
}

/// Distributes a range that is too large for memory over smaller ones.
fn cut_range<'a, T: Record>(
    file: RecordFile<Placed<T>>,
    job: &'a Job<'a>,
) -> Result<Placement<'a, T>> {
    let mut smaller = Placement::create(file.count(), job)?;
    let mut scanner = file.scan()?;
    drop(file);
    while let Some(batch) = scanner.next_batch()? {
        job.check()?;
        // The file is made of stretches with ascending slots, one for each block of the table.
        for stretch in batch.chunk_by(|a, b| a.slot <= b.slot) {
            smaller.append(0, stretch)?;
        }
    }
    Ok(smaller)
}
