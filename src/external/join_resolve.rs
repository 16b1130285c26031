//! The middle of a join: block after block of the table is loaded, and what refers into it is
//! given its value.

use zerocopy::{FromBytes, FromZeros as _, Immutable, IntoBytes, KnownLayout};

use super::{
    distribute::{self, Buckets, buckets_max},
    join::Job,
    waves,
};
use crate::{
    error::Result,
    storage::{Record, RecordFile, RecordScanner},
};

/// A reference in the bucket of a block. Eight bytes, because there are three a triangle.
#[derive(Clone, Copy, Debug, FromBytes, IntoBytes, Immutable, KnownLayout)]
#[repr(C)]
pub(super) struct Reference {
    /// Position in the block.
    pub(super) offset: u32,
    /// Slot within the lap. Ascends within a bucket.
    pub(super) slot: u32,
}

impl Record for Reference {
    const KIND: [u8; 4] = *b"REFR";
}

/// A value and the slot it belongs to, in the terms of whoever holds it.
#[derive(Clone, Copy, Debug, FromBytes, IntoBytes, Immutable, KnownLayout)]
#[repr(C, packed)]
pub(super) struct Placed<T> {
    pub(super) slot: u32,
    pub(super) value: T,
}

impl<T: Record> Record for Placed<T> {
    const KIND: [u8; 4] = *b"PLCD";
}

/// References of one lap, by block.
pub(super) struct References {
    /// What to add to [`Reference::slot`].
    pub(super) first_slot: u64,
    pub(super) files: Vec<RecordFile<Reference>>,
}

/// Bits of the offset in a block: such that a block takes a quarter of the memory, but there are
/// no more than `blocks_max` of them; blocks too large for memory are cut later.
pub(super) fn block_shift<T>(table_count: u64, memory_bytes: u64, blocks_max: usize) -> u32 {
    let shift_fit = block_records_max::<T>(memory_bytes).ilog2();
    let shift_few = table_count.div_ceil(blocks_max as u64).next_power_of_two().ilog2();
    let shift = shift_fit.max(shift_few);
    assert!(shift <= u32::BITS, "a table of more than 2^32 records for each of the blocks");
    shift
}

/// Records of the table that may be in memory.
fn block_records_max<T>(memory_bytes: u64) -> u64 {
    (memory_bytes / 4 / size_of::<T>() as u64).max(1)
}

/// References resolved by one task.
const BATCH_REFERENCES: u64 = 1 << 15;

/// Passes the value of every reference to `emit`, with the slot that the slots in the batch
/// count from. Batches come by block; within a batch, slots ascend.
pub(super) fn resolve<T: Record>(
    table: RecordFile<T>,
    laps: Vec<References>,
    block_shift: u32,
    job: &Job<'_>,
    emit: impl FnMut(u64, &[Placed<T>]) -> Result<()>,
) -> Result<()> {
    let scanner = table.scan()?;
    drop(table);
    Resolver { scanner, job, block: Vec::new(), emit }.resolve_blocks(laps, block_shift)
}

struct Resolver<'a, T, E> {
    /// Reads the whole table, once, so that its checksum is checked.
    scanner: RecordScanner<T>,
    job: &'a Job<'a>,
    block: Vec<T>,
    emit: E,
}

impl<T: Record, E: FnMut(u64, &[Placed<T>]) -> Result<()>> Resolver<'_, T, E> {
    /// Resolves references into consecutive blocks, beginning where the scanner stands.
    fn resolve_blocks(&mut self, mut laps: Vec<References>, shift: u32) -> Result<()> {
        // From the last block to the first, so that each can be taken off the end.
        for lap in &mut laps {
            lap.files.reverse();
        }
        while laps.iter().any(|lap| !lap.files.is_empty()) {
            let of_block =
                laps.iter_mut().filter_map(|lap| Some((lap.first_slot, lap.files.pop()?)));
            let of_block = of_block.collect();
            let count = self.scanner.left().min(1 << shift);
            if count <= block_records_max::<T>(self.job.memory_bytes) {
                self.resolve_block(of_block, count as usize)?;
            } else {
                self.cut_block(of_block, count, shift)?;
            }
        }
        Ok(())
    }

    fn resolve_block(
        &mut self,
        files: Vec<(u64, RecordFile<Reference>)>,
        count: usize,
    ) -> Result<()> {
        if self.block.len() < count {
            self.block = vec![T::new_zeroed(); count];
        }
        let block = &mut self.block[..count];
        self.scanner.read_into(block)?;
        let block = &*block;
        let placed_bytes = (size_of::<Reference>() + size_of::<Placed<T>>()) as u64;
        let width = 2 * rayon::current_num_threads();
        let batch = self.job.memory_bytes / 4 / (3 * width as u64 * placed_bytes);
        let batch = batch.clamp(1, BATCH_REFERENCES) as usize;
        for (first_slot, file) in files {
            let mut scanner = file.scan()?;
            drop(file);
            let next = || {
                let count = scanner.left().min(batch as u64) as usize;
                let mut references = vec![Reference::new_zeroed(); count];
                scanner.read_into(&mut references)?;
                Ok((count > 0).then_some(references))
            };
            let work = |references: Vec<Reference>| {
                let place = |r: Reference| Placed { slot: r.slot, value: block[r.offset as usize] };
                Ok(references.into_iter().map(place).collect::<Vec<_>>())
            };
            waves::in_order(width, next, work, |placed| (self.emit)(first_slot, &placed))?;
        }
        Ok(())
    }

    /// Distributes the references of a block that is too large for memory over smaller ones.
    fn cut_block(
        &mut self,
        files: Vec<(u64, RecordFile<Reference>)>,
        count: u64,
        shift: u32,
    ) -> Result<()> {
        let shift_smaller =
            block_shift::<T>(count, self.job.memory_bytes, buckets_max(self.job.memory_bytes));
        assert!(shift_smaller < shift, "cutting makes blocks smaller");
        let blocks = count.div_ceil(1 << shift_smaller) as usize;
        let memory_bytes = self.job.memory_bytes;
        let config = distribute::Config { buckets: blocks, memory_bytes };
        let mut laps = Vec::with_capacity(files.len());
        for (first_slot, file) in files {
            let mut buckets = Buckets::create(self.job.workspace, "references", &config)?;
            buckets.append_file(
                file,
                |_| self.job.check(),
                |r| (r.offset >> shift_smaller) as usize,
                |_, r| Reference { offset: r.offset & ((1 << shift_smaller) - 1), slot: r.slot },
            )?;
            laps.push(References { first_slot, files: buckets.finish()? });
        }
        self.resolve_blocks(laps, shift_smaller)
    }
}
