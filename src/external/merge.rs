//! Merges sorted runs, block by block instead of record by record.
//!
//! Blocks arrive in the order of their first keys. When one arrives, all records of earlier
//! blocks that are smaller than its first key are final: they are taken out as a batch of a few
//! sorted pieces, and the standard library's sort, which finds such pieces, merges them on
//! another thread. A run that dominates, or runs that do not overlap, are merely copied.
//! Equal keys come out in the order of the runs.

use super::{Keyed, SortKey, waves};
use crate::{
    error::Result,
    storage::{Record, RecordFile, RecordScanner, RecordWriter, Workspace, open_files_max},
};

/// How a merge divides its memory.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shape {
    /// Records of a block; two blocks of each run are in memory.
    pub(super) block_records: usize,
    /// Runs of one merge.
    pub(super) runs_max: usize,
    /// Records merged on one thread at a time.
    pub(super) batch_records: usize,
    /// Batches under way at a time.
    pub(super) width: usize,
}

/// DESIGN.md §3 measured 64 to 128 KiB as the best size of a block.
const BLOCK_BYTES: u64 = 1 << 17;
/// Large enough to be worth a task, small enough for the second-level cache.
const BATCH_BYTES: u64 = 1 << 19;

impl Shape {
    /// Half of the memory for blocks, the other half for three waves of batches.
    pub(super) fn within<R>(memory_bytes: u64) -> Self {
        let records = |bytes: u64| (bytes / size_of::<R>() as u64).max(1) as usize;
        let block_bytes = BLOCK_BYTES.min(memory_bytes / 64).max(size_of::<R>() as u64);
        let width = 2 * rayon::current_num_threads();
        let batch_bytes = BATCH_BYTES.min(memory_bytes / (8 * width as u64));
        Self {
            block_records: records(block_bytes),
            runs_max: (memory_bytes / 4 / block_bytes).clamp(2, open_files_max() as u64) as usize,
            batch_records: records(batch_bytes),
            width,
        }
    }
}

/// A piece of a sorted run. Never empty.
#[derive(Debug)]
pub(super) struct Block<R> {
    /// Orders equal keys: by run, then by place in the run. Each block has its own.
    pub(super) sequence: u64,
    pub(super) records: Vec<R>,
}

impl<R: Keyed> Block<R> {
    /// What blocks have to be ordered by when they arrive.
    pub(super) fn rank(&self) -> (R::Key, u64) {
        (self.records[0].key(), self.sequence)
    }
}

/// Merges the blocks that `next` gives in order of [`Block::rank`]. Each batch goes through
/// `work` on some thread, then to `emit` in order, on this one.
pub(super) fn merge_blocks<R: Keyed>(
    shape: &Shape,
    mut next: impl FnMut() -> Result<Option<Block<R>>>,
    work: impl Fn(&mut Vec<R>) -> Result<()> + Sync,
    mut emit: impl FnMut(&[R]) -> Result<()>,
) -> Result<()> {
    let mut open = Open { blocks: Vec::new() };
    let gather = || -> Result<Option<Batch<R>>> {
        let mut batch = Batch { records: Vec::new(), ends: Vec::new() };
        while batch.records.len() < shape.batch_records {
            let Some(block) = next()? else {
                open.release_below((R::Key::MAX, u64::MAX), &mut batch);
                break;
            };
            open.release_below(block.rank(), &mut batch);
            open.insert(block);
        }
        Ok((!batch.records.is_empty()).then_some(batch))
    };
    let sort = |mut batch: Batch<R>| {
        batch.sort();
        work(&mut batch.records)?;
        Ok(batch.records)
    };
    waves::in_order(shape.width, gather, sort, |records| emit(&records))
}

/// Blocks that have arrived and are not used up, in order of their sequence.
struct Open<R> {
    blocks: Vec<(Block<R>, usize)>,
}

impl<R: Keyed> Open<R> {
    fn insert(&mut self, block: Block<R>) {
        let place = self.blocks.partition_point(|(other, _)| other.sequence < block.sequence);
        self.blocks.insert(place, (block, 0));
    }

    /// Moves the records below `bound` into `batch`.
    fn release_below(&mut self, bound: (R::Key, u64), batch: &mut Batch<R>) {
        for (block, used) in &mut self.blocks {
            let rest = &block.records[*used..];
            let count = rest.partition_point(|record| (record.key(), block.sequence) < bound);
            batch.records.extend_from_slice(&rest[..count]);
            *used += count;
        }
        self.blocks.retain(|(block, used)| *used < block.records.len());
        batch.ends.push(batch.records.len());
    }
}

/// Records taken out together. Those before an end are not larger than those after it.
struct Batch<R> {
    records: Vec<R>,
    ends: Vec<usize>,
}

impl<R: Keyed> Batch<R> {
    fn sort(&mut self) {
        let mut start = 0;
        for end in &self.ends {
            self.records[start..*end].sort_by_key(R::key);
            start = *end;
        }
    }
}

/// Reads several sorted files as one stream of blocks in order of their rank.
pub(super) struct FileBlocks<R> {
    /// The next block of each run that has one, and where the blocks after it come from.
    runs: Vec<(Block<R>, RecordScanner<R>)>,
    block_records: usize,
}

/// The run's number stands in the bits above this one of a sequence.
const RUN_SHIFT: u32 = 44;

impl<R: Keyed> FileBlocks<R> {
    /// Opens `runs`, whose order decides between equal keys. The files go as they are used up.
    pub(super) fn open(runs: Vec<RecordFile<R>>, block_records: usize) -> Result<Self> {
        let mut blocks = Self { runs: Vec::with_capacity(runs.len()), block_records };
        for (run, file) in (0_u64..).zip(runs) {
            let mut scanner = file.scan()?;
            if let Some(block) = read_block(&mut scanner, run << RUN_SHIFT, block_records)? {
                blocks.runs.push((block, scanner));
            }
        }
        Ok(blocks)
    }

    pub(super) fn next(&mut self) -> Result<Option<Block<R>>> {
        let ranks = self.runs.iter().map(|(block, _)| block.rank());
        let Some((first, _)) = ranks.enumerate().min_by_key(|(_, rank)| *rank) else {
            return Ok(None);
        };
        let (block, scanner) = &mut self.runs[first];
        match read_block(scanner, block.sequence + 1, self.block_records)? {
            Some(later) => Ok(Some(std::mem::replace(block, later))),
            None => Ok(Some(self.runs.remove(first).0)),
        }
    }
}

fn read_block<R: Record>(
    scanner: &mut RecordScanner<R>,
    sequence: u64,
    block_records: usize,
) -> Result<Option<Block<R>>> {
    let mut records = vec![R::new_zeroed(); scanner.left().min(block_records as u64) as usize];
    scanner.read_into(&mut records)?;
    Ok((!records.is_empty()).then_some(Block { sequence, records }))
}

/// Merges `runs` in groups of neighbours, with `merge_group`, until one merge can take the rest.
pub(super) fn narrow_runs<R: Keyed>(
    mut runs: Vec<RecordFile<R>>,
    shape: &Shape,
    workspace: &Workspace,
    mut merge_group: impl FnMut(Vec<RecordFile<R>>, &mut RecordWriter<R>) -> Result<()>,
) -> Result<Vec<RecordFile<R>>> {
    while runs.len() > shape.runs_max {
        let mut wider = Vec::with_capacity(runs.len().div_ceil(shape.runs_max));
        let mut rest = runs.into_iter();
        loop {
            let group: Vec<_> = rest.by_ref().take(shape.runs_max).collect();
            if group.len() < 2 {
                wider.extend(group);
                break;
            }
            let mut writer = RecordWriter::create(workspace, "run", None)?;
            merge_group(group, &mut writer)?;
            wider.push(writer.finish()?);
        }
        runs = wider;
    }
    Ok(runs)
}
