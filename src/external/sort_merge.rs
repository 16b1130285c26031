//! The engine that merges: sorted runs kept, and put in order again, by the `extsort` crate.
//!
//! The crate is fed blocks of sorted runs, not records, ordered by their first key and their
//! place; what it gives back are the blocks that [`merge_blocks`] wants. It has traps, and this
//! file is the only one that may name it. Each guard below has a test that shows its trap.

use std::{
    cmp::Ordering,
    io::{self, Read, Write},
    ops::Range,
    sync::Arc,
};

use extsort::{ExternalSorter, PushExternalSorter, Sortable, SortedIterator};
use zerocopy::{FromBytes, FromZeros as _, Immutable, IntoBytes, KnownLayout};

use super::{
    Keyed, SortKey,
    in_memory::sort_parallel,
    merge::{Block, FileBlocks, Shape, merge_blocks, narrow_runs},
    sort::Config,
};
use crate::{
    error::{Error, Result},
    progress::{Meter, Monitor},
    storage::{ForeignFolder, Kept, RecordFile, RecordWriter, Workspace},
};

/// Sorted runs on disk.
pub(super) struct Runs<'a, R: Keyed> {
    config: Config,
    workspace: &'a Workspace,
    monitor: &'a Monitor<'a>,
    shape: Shape,
    group: Option<Group<R>>,
    /// Groups that are merged already, in input order.
    merged: Vec<RecordFile<R>>,
    /// Runs are files of ours at once, so that they can be noted.
    is_noted: bool,
}

impl<'a, R: Keyed> Runs<'a, R> {
    pub(super) fn new(config: &Config, workspace: &'a Workspace, monitor: &'a Monitor<'a>) -> Self {
        Self::of_files(Vec::new(), config, workspace, monitor)
    }

    /// Goes on behind runs that are there.
    pub(super) fn of_files(
        merged: Vec<RecordFile<R>>,
        config: &Config,
        workspace: &'a Workspace,
        monitor: &'a Monitor<'a>,
    ) -> Self {
        let shape = Shape::within::<R>(config.memory_bytes);
        let is_noted = config.step.is_some() && workspace.is_journaled();
        Self { config: *config, workspace, monitor, shape, group: None, merged, is_noted }
    }

    /// The runs, to be noted.
    pub(super) fn kept(&self) -> Vec<Kept> {
        self.merged.iter().map(RecordFile::kept).collect()
    }

    /// Sorts a chunk of the input and stores it as a run. All chunks but the last have the same
    /// length. Gives the emptied vector back.
    pub(super) fn spill(&mut self, mut chunk: Vec<R>) -> Result<Vec<R>> {
        sort_parallel(&mut chunk);
        if self.is_noted {
            let count = Some(chunk.len() as u64);
            let mut writer = RecordWriter::create(self.workspace, "run", count)?;
            writer.extend(&chunk)?;
            self.merged.push(writer.finish()?);
            chunk.clear();
            return Ok(chunk);
        }
        if self.group.as_ref().is_some_and(|group| group.runs == self.shape.runs_max) {
            self.merge_group()?;
        }
        let group = match &mut self.group {
            Some(group) => group,
            empty => {
                let blocks = chunk.len().div_ceil(self.shape.block_records);
                empty.insert(Group::new(self.workspace, blocks)?)
            }
        };
        group.push_run(chunk, self.shape.block_records)
    }

    /// Passes all records to `sink` in order.
    pub(super) fn merge_into(mut self, mut sink: impl FnMut(&[R]) -> Result<()>) -> Result<()> {
        if self.merged.is_empty() {
            let Some(group) = self.group.take() else { return Ok(()) };
            let meter = self.meter(group.records);
            return group.merge_into(&self.shape, meter, sink);
        }
        self.merge_group()?;
        let runs = std::mem::take(&mut self.merged);
        let runs = narrow_runs(runs, &self.shape, self.workspace, |group, writer| {
            self.merge_files(group, |records| writer.extend(records))
        })?;
        self.merge_files(runs, &mut sink)
    }

    /// Makes one file of the runs so far: as many as one merge can take.
    fn merge_group(&mut self) -> Result<()> {
        let Some(group) = self.group.take() else { return Ok(()) };
        let meter = self.meter(group.records);
        let mut writer = RecordWriter::create(self.workspace, "run", Some(group.records))?;
        group.merge_into(&self.shape, meter, |records| writer.extend(records))?;
        self.merged.push(writer.finish()?);
        Ok(())
    }

    fn merge_files(
        &self,
        runs: Vec<RecordFile<R>>,
        sink: impl FnMut(&[R]) -> Result<()>,
    ) -> Result<()> {
        let meter = self.meter(runs.iter().map(RecordFile::count).sum());
        let mut blocks = FileBlocks::open(runs, self.shape.block_records)?;
        let count = |records: &mut Vec<R>| Ok(meter.add(records.len() as u64)?);
        merge_blocks(&self.shape, || blocks.next(), count, sink)?;
        meter.finish();
        Ok(())
    }

    fn meter(&self, records: u64) -> Meter<'a> {
        self.monitor.meter_of::<R>(self.config.stage, records)
    }
}

type Compare<R> = fn(&Stored<R>, &Stored<R>) -> Ordering;

/// Runs under one `extsort` sorter, in a folder of their own: two sorters in one folder
/// overwrite each other's segments, and the crate never removes a folder it was given.
struct Group<R: Keyed> {
    sorter: PushExternalSorter<Stored<R>, Compare<R>>,
    folder: ForeignFolder,
    /// Blocks after which the crate writes a segment: those of a full run. At least 2.
    blocks_per_segment: u64,
    runs: usize,
    blocks: u64,
    records: u64,
}

impl<R: Keyed> Group<R> {
    fn new(workspace: &Workspace, blocks_per_run: usize) -> Result<Self> {
        // With one block a segment, every push writes one, and no sentinel could be a last one
        // that does not.
        let blocks_per_segment = blocks_per_run.max(2);
        let folder = ForeignFolder::create(workspace, "runs-")?;
        let sorter = ExternalSorter::new()
            // The crate writes when it holds more than this.
            .with_segment_size(blocks_per_segment - 1)
            // Its heap would read 20 blocks ahead in each segment; without it, one.
            .with_heap_iter_segment_count(usize::MAX)
            .with_sort_dir(folder.path().to_owned())
            .pushed_by(Stored::compare as Compare<R>);
        let blocks_per_segment = blocks_per_segment as u64;
        Ok(Self { sorter, folder, blocks_per_segment, runs: 0, blocks: 0, records: 0 })
    }

    fn push_run(&mut self, run: Vec<R>, block_records: usize) -> Result<Vec<R>> {
        self.folder.count(size_of_val(run.as_slice()) as u64);
        self.records += run.len() as u64;
        self.runs += 1;
        let run = Arc::new(run);
        for start in (0..run.len()).step_by(block_records) {
            let range = start..run.len().min(start + block_records);
            self.push(Records::InRun(Arc::clone(&run), range))?;
        }
        // Still shared if the crate keeps the last, shorter run in memory.
        let mut run = Arc::try_unwrap(run).unwrap_or_default();
        run.clear();
        Ok(run)
    }

    fn push(&mut self, records: Records<R>) -> Result<()> {
        let block = Stored { sequence: self.blocks, records };
        self.blocks += 1;
        self.sorter.push(block).map_err(|source| failure("write in", &self.folder, source))
    }

    /// Adds an empty block, which is the last in any order, where the crate needs one: if the
    /// last push wrote a segment, it would forget all segments and yield nothing at all.
    fn push_sentinel_if_needed(&mut self) -> Result<()> {
        if self.blocks.is_multiple_of(self.blocks_per_segment) {
            self.push(Records::Own(Vec::new()))?;
        }
        Ok(())
    }

    fn merge_into(
        mut self,
        shape: &Shape,
        meter: Meter<'_>,
        sink: impl FnMut(&[R]) -> Result<()>,
    ) -> Result<()> {
        self.push_sentinel_if_needed()?;
        let Self { sorter, folder, blocks, records, .. } = self;
        let sorted = sorter.done().map_err(|source| failure("read in", &folder, source))?;
        let mut stream = Stream { sorted, folder, blocks_left: blocks, records_left: records };
        let count = |records: &mut Vec<R>| Ok(meter.add(records.len() as u64)?);
        merge_blocks(shape, || stream.next(), count, sink)?;
        meter.finish();
        Ok(())
    }
}

/// What the crate gives back, counted: to it, a torn segment is merely a shorter one.
struct Stream<R: Keyed> {
    sorted: SortedIterator<Stored<R>, Compare<R>>,
    folder: ForeignFolder,
    blocks_left: u64,
    records_left: u64,
}

impl<R: Keyed> Stream<R> {
    fn next(&mut self) -> Result<Option<Block<R>>> {
        while let Some(stored) = self.sorted.next() {
            let stored = stored.map_err(|source| failure("read in", &self.folder, source))?;
            let Stored { sequence, records } = stored;
            let (Some(blocks), Some(rest)) = (
                self.blocks_left.checked_sub(1),
                self.records_left.checked_sub(records.as_slice().len() as u64),
            ) else {
                return Err(self.damaged("sorted runs gave back more than they were given"));
            };
            (self.blocks_left, self.records_left) = (blocks, rest);
            let records = records.into_vec();
            if !records.is_empty() {
                return Ok(Some(Block { sequence, records }));
            }
        }
        if (self.blocks_left, self.records_left) != (0, 0) {
            return Err(self.damaged("sorted runs gave back less than they were given"));
        }
        Ok(None)
    }

    fn damaged(&self, what: &'static str) -> Error {
        Error::Damaged { path: self.folder.path().to_owned(), what }
    }
}

/// A block as the crate handles it.
struct Stored<R> {
    /// Place in the order of pushing. Blocks of equal first keys keep it; without it their order
    /// would depend on the segment size.
    sequence: u64,
    /// Empty in a sentinel only.
    records: Records<R>,
}

enum Records<R> {
    /// Part of a run that is on its way to the disk, not copied.
    InRun(Arc<Vec<R>>, Range<usize>),
    /// Read back.
    Own(Vec<R>),
}

impl<R: Keyed> Records<R> {
    fn as_slice(&self) -> &[R] {
        match self {
            Self::InRun(run, range) => &run[range.clone()],
            Self::Own(records) => records,
        }
    }

    fn into_vec(self) -> Vec<R> {
        match self {
            Self::InRun(run, range) => run[range].to_vec(),
            Self::Own(records) => records,
        }
    }
}

impl<R: Keyed> Stored<R> {
    /// A total order: no two blocks of a sorter share their sequence.
    fn rank(&self) -> (bool, R::Key, u64) {
        let first = self.records.as_slice().first();
        (first.is_none(), first.map_or(R::Key::MAX, R::key), self.sequence)
    }

    fn compare(a: &Self, b: &Self) -> Ordering {
        a.rank().cmp(&b.rank())
    }
}

/// What stands before the records of a block in a segment.
#[derive(FromBytes, IntoBytes, Immutable, KnownLayout)]
#[repr(C)]
struct StoredHeader {
    sequence: u64,
    count: u32,
    /// CRC-32 of the sequence and the records.
    checksum: u32,
}

impl StoredHeader {
    fn checksum(sequence: u64, records: &[u8]) -> u32 {
        let mut hasher = crc32fast::Hasher::new();
        hasher.update(sequence.as_bytes());
        hasher.update(records);
        hasher.finalize()
    }
}

/// A block is never larger, so a damaged count cannot ask for more memory than this. Generous:
/// one record may be larger than a block is meant to be.
const STORED_BYTES_MAX: usize = 1 << 24;

impl<R: Keyed> Sortable for Stored<R> {
    fn encode<W: Write>(&self, writer: &mut W) -> io::Result<()> {
        let records = self.records.as_slice();
        let bytes = records.as_bytes();
        let header = StoredHeader {
            sequence: self.sequence,
            count: records.len() as u32,
            checksum: StoredHeader::checksum(self.sequence, bytes),
        };
        writer.write_all(header.as_bytes())?;
        writer.write_all(bytes)
    }

    fn decode<Source: Read>(reader: &mut Source) -> io::Result<Self> {
        let mut header = StoredHeader::new_zeroed();
        // The end of a segment shows here, as an `UnexpectedEof` that the crate waits for.
        reader.read_exact(header.as_mut_bytes())?;
        let count = header.count as usize;
        if count > STORED_BYTES_MAX / size_of::<R>() {
            return Err(io::ErrorKind::InvalidData.into());
        }
        let mut records = vec![R::new_zeroed(); count];
        let bytes = records.as_mut_slice().as_mut_bytes();
        reader.read_exact(bytes)?;
        if StoredHeader::checksum(header.sequence, bytes) != header.checksum {
            return Err(io::ErrorKind::InvalidData.into());
        }
        Ok(Self { sequence: header.sequence, records: Records::Own(records) })
    }
}

fn failure(verb: &'static str, folder: &ForeignFolder, source: io::Error) -> Error {
    let path = folder.path().to_owned();
    // The crate reports an early end only where a segment has no first block.
    if matches!(source.kind(), io::ErrorKind::InvalidData | io::ErrorKind::UnexpectedEof) {
        return Error::Damaged { path, what: "a block of a sorted run is not as it was written" };
    }
    Error::Io { verb, path, source }
}

#[cfg(test)]
mod traps;
