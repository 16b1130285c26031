//! Partial sums on disk: a table that is full becomes a run of cells and a run of triangles.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use super::{
    sums::{LIMIT, SUMS},
    table::{CellTable, Overflow, widen},
    triples::rotate,
};
use crate::{
    error::Result,
    external::Keyed,
    geometry::CellId,
    soup::{ATTRIBUTES_MAX, Vertex},
    storage::{Record, RecordFile, RecordWriter, Workspace},
};

/// Partial sums of one cell. A cell may have several in one run, and one in each run; they are
/// merged without adding, because their sum may not fit 32 bits.
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout)]
#[repr(C)]
pub(super) struct CellRecord {
    pub(super) id: u64,
    /// Makes the key of every record different: the run in the high half, a count in the low.
    pub(super) tie: u64,
    pub(super) sums: [i32; SUMS],
    pub(super) attributes: [i32; ATTRIBUTES_MAX],
}

impl Record for CellRecord {
    const KIND: [u8; 4] = *b"CELL";
}

impl Keyed for CellRecord {
    type Key = u128;

    fn key(&self) -> u128 {
        u128::from(self.id) << 64 | u128::from(self.tie)
    }
}

/// A triangle by its cells: their ids when spilled, later their ranks, marked by [`RANKED`].
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout)]
#[repr(transparent)]
pub(super) struct CellTriangle(pub(super) [u64; 3]);

/// Set in a corner that is a rank; ids and ranks stay below it.
pub(super) const RANKED: u64 = 1 << 63;

/// Bits of a rank in the key of a triangle: three of them make 126.
const RANK_BITS: u32 = 42;

impl CellTriangle {
    /// The ranks of the cells, once all corners are ranks.
    pub(super) fn ranks(&self) -> [u64; 3] {
        debug_assert!(self.0.iter().all(|corner| corner & RANKED != 0), "a corner without rank");
        self.0.map(|corner| corner & !RANKED)
    }
}

impl Record for CellTriangle {
    const KIND: [u8; 4] = *b"CTRI";
}

impl Keyed for CellTriangle {
    type Key = u128;

    fn key(&self) -> u128 {
        let [a, b, c] = self.ranks().map(u128::from);
        a << (2 * RANK_BITS) | b << RANK_BITS | c
    }
}

/// One spilled table.
pub(super) struct Run {
    /// By id.
    pub(super) cells: RecordFile<CellRecord>,
    /// Cell ids of the corners, rotated, in order, without duplicates.
    pub(super) triangles: RecordFile<CellTriangle>,
}

/// Writes `table` to run number `serial` and empties it.
pub(super) fn spill<V: Vertex>(
    table: &mut CellTable<V>,
    serial: u32,
    workspace: &Workspace,
) -> Result<Run> {
    let run = copy(table, serial, workspace)?;
    table.clear();
    Ok(run)
}

/// Writes `table` to run number `serial` and leaves it as it is, its triangles in another order and
/// each once.
pub(super) fn copy<V: Vertex>(
    table: &mut CellTable<V>,
    serial: u32,
    workspace: &Workspace,
) -> Result<Run> {
    let mut order: Vec<u32> = (0..table.ids.len() as u32).collect();
    order.sort_unstable_by_key(|index| table.ids[*index as usize]);
    let cells = write_cells(table, &order, u64::from(serial) << 32, workspace)?;
    let triangles = write_triangles(table, &order, workspace)?;
    for triangle in &mut table.triangles {
        *triangle = triangle.map(|rank| order[rank as usize]);
    }
    Ok(Run { cells, triangles })
}

fn write_cells<V: Vertex>(
    table: &mut CellTable<V>,
    order: &[u32],
    mut tie: u64,
    workspace: &Workspace,
) -> Result<RecordFile<CellRecord>> {
    let mut writer = RecordWriter::create(workspace, "cells", None)?;
    table.compact_overflow();
    let mut moved = table.overflow.iter().peekable();
    for &index in order {
        let id = table.ids[index as usize];
        while let Some(entry) = moved.next_if(|entry| entry.id == id) {
            write_overflow(entry, &mut tie, &mut writer)?;
        }
        let attributes = widen(table.attributes[index as usize].as_ref()).map(|sum| sum as i32);
        let sums = table.sums[index as usize];
        writer.push(&CellRecord { id: id.0, tie, sums, attributes })?;
        tie += 1;
    }
    writer.finish()
}

/// Writes wide sums as several narrow ones.
fn write_overflow(
    entry: &Overflow,
    tie: &mut u64,
    writer: &mut RecordWriter<CellRecord>,
) -> Result<()> {
    let (mut sums, mut attributes) = (entry.sums, entry.attributes);
    while sums.iter().chain(&attributes).any(|sum| *sum != 0) {
        let take = |sum: &mut i64| {
            let part = (*sum).clamp(-i64::from(LIMIT), i64::from(LIMIT));
            *sum -= part;
            part as i32
        };
        let record = CellRecord {
            id: entry.id.0,
            tie: *tie,
            sums: sums.each_mut().map(take),
            attributes: attributes.each_mut().map(take),
        };
        writer.push(&record)?;
        *tie += 1;
    }
    Ok(())
}

fn write_triangles<V: Vertex>(
    table: &mut CellTable<V>,
    order: &[u32],
    workspace: &Workspace,
) -> Result<RecordFile<CellTriangle>> {
    // Ranks stand for ids: they have the same order and half the size.
    let mut ranks = vec![0_u32; order.len()];
    for (rank, index) in (0..).zip(order) {
        ranks[*index as usize] = rank;
    }
    let triangles = &mut table.triangles;
    for triangle in triangles.iter_mut() {
        *triangle = rotate(triangle.map(|index| ranks[index as usize]));
    }
    triangles.sort_unstable();
    triangles.dedup();
    let mut writer = RecordWriter::create(workspace, "cell-triangles", None)?;
    let id = |rank: u32| -> CellId { table.ids[order[rank as usize] as usize] };
    for triangle in triangles.iter() {
        writer.push(&CellTriangle(triangle.map(|rank| id(rank).0)))?;
    }
    writer.finish()
}
