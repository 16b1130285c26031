//! Resolves references by index: for each index the record of a table that stands there.
//!
//! A table that fits is simply looked into. Otherwise references go to the block of the table
//! they point into, each block is loaded once and its references resolved, and the values go to
//! the range of slots they belong to, where each range is put in place in memory. Three passes,
//! all sequential, whatever the order of the references.

use super::{
    distribute::{self, Buckets, buckets_max, chunk_records},
    join_place::Placement,
    join_resolve::{Reference, References, block_shift, resolve},
};
use crate::{
    error::Result,
    progress::{Monitor, StageId},
    storage::{Record, RecordFile, RecordWriter, Workspace},
};

/// What a join may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Stage that progress is reported for.
    pub stage: StageId,
    /// Bytes of memory to hold, reserved by the caller. A table of up to half of it is held.
    pub memory_bytes: u64,
}

/// Takes indices into a table and gives the records there, in the order of the indices.
///
/// Temporary disk: 8 bytes a reference, then a record and 4 bytes a reference.
pub struct Join<'a, T> {
    config: Config,
    workspace: &'a Workspace,
    monitor: &'a Monitor<'a>,
    table: RecordFile<T>,
    way: Way<T>,
    slots: u64,
}

/// What the later passes of a join need to know.
pub(super) struct Job<'a> {
    pub(super) stage: StageId,
    pub(super) memory_bytes: u64,
    pub(super) workspace: &'a Workspace,
    pub(super) monitor: &'a Monitor<'a>,
}

impl Job<'_> {
    /// For loops over records within a pass that is metered as a whole.
    pub(super) fn check(&self) -> Result<()> {
        Ok(self.monitor.check(self.stage)?)
    }
}

enum Way<T> {
    /// The table is in memory, the values go straight to the result.
    Resident { table: Vec<T>, values: RecordWriter<T>, batch: Vec<T> },
    /// References gather, and are distributed by block of the table.
    Distributed(Gathering),
}

/// References on their way to the disk.
struct Gathering {
    /// Never longer than `chunk_indices_max`.
    chunk: Vec<u64>,
    chunk_indices_max: usize,
    /// A block is `1 << block_shift` records of the table.
    block_shift: u32,
    buckets: distribute::Config,
    /// The current lap, in which a slot fits 32 bits, and those before it.
    lap: Buckets<Reference>,
    lap_slots: u64,
    lap_slots_max: u64,
    laps: Vec<References>,
}

/// Slots of a lap: what the 32 bits of [`Reference::slot`] can tell apart.
const LAP_SLOTS_MAX: u64 = 1 << 32;

impl<'a, T: Record> Join<'a, T> {
    /// Starts a join with `table`, whose records are found by their position.
    ///
    /// # Errors
    /// [`crate::Error::Io`] when files cannot be made, [`crate::Error::Damaged`] when the table
    /// is not as it was written.
    pub fn new(
        table: RecordFile<T>,
        config: &Config,
        workspace: &'a Workspace,
        monitor: &'a Monitor<'a>,
    ) -> Result<Self> {
        let fits = table.count() * size_of::<T>() as u64 <= config.memory_bytes / 2;
        let way = if fits {
            let values = RecordWriter::create(workspace, "joined", None)?;
            Way::Resident { table: table.read_all()?, values, batch: Vec::new() }
        } else {
            Way::Distributed(Gathering::new::<T>(table.count(), config, workspace)?)
        };
        Ok(Self { config: *config, workspace, monitor, table, way, slots: 0 })
    }

    /// Adds references: the first index ever pushed is slot 0, and so on. All indices are within
    /// the table; that is for whoever read them from an input to see to.
    ///
    /// # Errors
    /// [`crate::Error::Io`] when the disk does not take them.
    pub fn push(&mut self, indices: &[u64]) -> Result<()> {
        let count = self.table.count();
        assert!(indices.iter().all(|index| *index < count), "an index outside the table");
        self.slots += indices.len() as u64;
        match &mut self.way {
            Way::Resident { table, values, batch } => {
                for indices in indices.chunks(RESIDENT_BATCH) {
                    batch.clear();
                    batch.extend(indices.iter().map(|index| table[*index as usize]));
                    values.extend(batch)?;
                }
                Ok(())
            }
            Way::Distributed(gathering) => gathering.push(indices, self.workspace),
        }
    }

    /// References added so far.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.slots
    }

    /// The values of all references, in slot order, in a file.
    ///
    /// # Errors
    /// As [`Self::finish_into`].
    pub fn finish(self) -> Result<RecordFile<T>> {
        match self.way {
            Way::Resident { values, .. } => values.finish(),
            Way::Distributed(_) => {
                let mut writer = RecordWriter::create(self.workspace, "joined", Some(self.slots))?;
                self.finish_into(|values| writer.extend(values))?;
                writer.finish()
            }
        }
    }

    /// Passes the values of all references to `sink`, in batches, in slot order.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Damaged`] when a file is not as it was written,
    /// [`crate::Error::Cancelled`], and what `sink` returns.
    pub fn finish_into(self, mut sink: impl FnMut(&[T]) -> Result<()>) -> Result<()> {
        let Self { config, workspace, monitor, table, way, slots } = self;
        match way {
            Way::Resident { values, table: in_memory, .. } => {
                drop(in_memory);
                let values = values.finish()?;
                let meter = monitor.meter_of::<T>(config.stage, slots);
                let mut scanner = values.scan()?;
                while let Some(batch) = scanner.next_batch()? {
                    meter.add(batch.len() as u64)?;
                    sink(batch)?;
                }
                meter.finish();
                Ok(())
            }
            Way::Distributed(gathering) => {
                let block_shift = gathering.block_shift;
                let laps = gathering.finish(workspace)?;
                let Config { stage, memory_bytes } = config;
                let job = Job { stage, memory_bytes, workspace, monitor };
                let mut placement = Placement::create(slots, &job)?;
                let meter = monitor.meter_of::<T>(stage, slots);
                resolve(table, laps, block_shift, &job, |first_slot, values| {
                    meter.add(values.len() as u64)?;
                    placement.append(first_slot, values)
                })?;
                meter.finish();
                let meter = monitor.meter_of::<T>(stage, slots);
                placement.finish_into(&mut |values| {
                    meter.add(values.len() as u64)?;
                    sink(values)
                })?;
                meter.finish();
                Ok(())
            }
        }
    }
}

/// Values gathered between two writes when the table is in memory.
const RESIDENT_BATCH: usize = 1 << 14;

impl Gathering {
    fn new<T: Record>(table_count: u64, config: &Config, workspace: &Workspace) -> Result<Self> {
        let memory_bytes = config.memory_bytes;
        let blocks_max = buckets_max(memory_bytes);
        let block_shift = block_shift::<T>(table_count, memory_bytes, blocks_max);
        let blocks = table_count.div_ceil(1 << block_shift) as usize;
        let buckets = distribute::Config { buckets: blocks, memory_bytes };
        Ok(Self {
            chunk: Vec::new(),
            chunk_indices_max: chunk_records(memory_bytes / 2, size_of::<u64>()),
            block_shift,
            lap: Buckets::create(workspace, "references", &buckets)?,
            buckets,
            lap_slots: 0,
            lap_slots_max: LAP_SLOTS_MAX,
            laps: Vec::new(),
        })
    }

    fn push(&mut self, mut indices: &[u64], workspace: &Workspace) -> Result<()> {
        while !indices.is_empty() {
            if self.chunk.len() == self.chunk_indices_max {
                self.spill(workspace)?;
            }
            let room = self.chunk_indices_max - self.chunk.len();
            let (now, later) = indices.split_at(room.min(indices.len()));
            self.chunk.extend_from_slice(now);
            indices = later;
        }
        Ok(())
    }

    fn spill(&mut self, workspace: &Workspace) -> Result<()> {
        let chunk = std::mem::take(&mut self.chunk);
        let mut rest = chunk.as_slice();
        while !rest.is_empty() {
            if self.lap_slots == self.lap_slots_max {
                self.finish_lap(workspace)?;
            }
            let room = (self.lap_slots_max - self.lap_slots).min(rest.len() as u64);
            let (now, later) = rest.split_at(room as usize);
            let (first_slot, shift) = (self.lap_slots, self.block_shift);
            self.lap.append(
                now,
                |index| (index >> shift) as usize,
                |at, index| Reference {
                    offset: (index & ((1 << shift) - 1)) as u32,
                    slot: (first_slot + at as u64) as u32,
                },
            )?;
            self.lap_slots += room;
            rest = later;
        }
        self.chunk = chunk;
        self.chunk.clear();
        Ok(())
    }

    fn finish_lap(&mut self, workspace: &Workspace) -> Result<()> {
        let fresh = Buckets::create(workspace, "references", &self.buckets)?;
        let files = std::mem::replace(&mut self.lap, fresh).finish()?;
        let first_slot = self.laps.len() as u64 * self.lap_slots_max;
        self.laps.push(References { first_slot, files });
        self.lap_slots = 0;
        Ok(())
    }

    fn finish(mut self, workspace: &Workspace) -> Result<Vec<References>> {
        self.spill(workspace)?;
        if self.lap_slots > 0 {
            self.finish_lap(workspace)?;
        }
        Ok(self.laps)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::{
        Error,
        external::testing::{file_of, files_left},
    };

    const STAGE: StageId = StageId::Dereference;

    /// Twelve bytes like a vertex, and another size than anything a join stores by itself.
    type Value = [u64; 3];

    fn table_of(count: u64) -> Vec<Value> {
        (0..count).map(|i| [i, i * i, !i]).collect()
    }

    fn joined(
        table: &[Value],
        indices: &[u64],
        memory_bytes: u64,
        lap_slots_max: u64,
    ) -> Vec<Value> {
        let workspace = Workspace::for_test();
        let monitor = Monitor::silent();
        let config = Config { stage: STAGE, memory_bytes };
        let mut join =
            Join::new(file_of(&workspace, table), &config, &workspace, &monitor).unwrap();
        if let Way::Distributed(gathering) = &mut join.way {
            gathering.lap_slots_max = lap_slots_max;
        }
        indices.chunks(1000).for_each(|batch| join.push(batch).unwrap());
        let file = join.finish().unwrap();
        let found = file.read_all().unwrap();
        assert_eq!(files_left(&workspace), 1, "the result is all that is left");
        drop(file);
        assert_eq!((files_left(&workspace), workspace.disk_bytes()), (0, 0));
        found
    }

    fn joins_as_a_gather(table_count: u64, indices: &[u64]) {
        let table = table_of(table_count);
        let expected: Vec<Value> = indices.iter().map(|i| table[*i as usize]).collect();
        for memory_bytes in [0, 700, 20_000, 1 << 22] {
            // Next to no memory means a file for every few records.
            let count = if memory_bytes == 0 { indices.len().min(300) } else { indices.len() };
            for lap_slots_max in [LAP_SLOTS_MAX, 1001] {
                let found = joined(&table, &indices[..count], memory_bytes, lap_slots_max);
                assert!(found == expected[..count], "{memory_bytes} bytes, {lap_slots_max} a lap");
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]
        #[test]
        fn any_references_are_resolved(
            (table_count, indices) in (1_u64..3000)
                .prop_flat_map(|count| (Just(count), prop::collection::vec(0..count, 0..2000)))
        ) {
            joins_as_a_gather(table_count, &indices);
        }
    }

    #[test]
    fn every_shape_of_references_is_resolved() {
        let n = 5000;
        joins_as_a_gather(n, &[]);
        joins_as_a_gather(n, &(0..n).collect::<Vec<_>>());
        joins_as_a_gather(n, &(0..3 * n).rev().map(|i| i / 3).collect::<Vec<_>>());
        joins_as_a_gather(n, &vec![n - 1; 10_000]);
        joins_as_a_gather(n, &(0..20_000).map(|i| i * 7919 % n).collect::<Vec<_>>());
        joins_as_a_gather(1, &[0; 10]);
    }

    #[test]
    #[should_panic(expected = "an index outside the table")]
    fn an_index_outside_the_table_is_our_own_bug() {
        joined(&table_of(10), &[10], 0, LAP_SLOTS_MAX);
    }

    #[test]
    fn a_cancelled_join_leaves_nothing() {
        let indices: Vec<u64> = (0..20_000).map(|i| i * 7919 % 5000).collect();
        for from_sink in [false, true] {
            let workspace = Workspace::for_test();
            let monitor = Monitor::silent();
            let table = file_of(&workspace, &table_of(5000));
            let config = Config { stage: STAGE, memory_bytes: 20_000 };
            let mut join = Join::new(table, &config, &workspace, &monitor).unwrap();
            join.push(&indices).unwrap();
            if !from_sink {
                monitor.cancel.raise();
            }
            let outcome = join.finish_into(|_| {
                monitor.cancel.raise();
                Ok(())
            });
            assert!(matches!(outcome, Err(Error::Cancelled(_))));
            assert_eq!((files_left(&workspace), workspace.disk_bytes()), (0, 0));
        }
    }
}
