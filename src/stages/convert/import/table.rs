//! Reading vertices into a table, in memory as long as that is within the budget.

use rayon::prelude::*;

use super::Config;
use crate::{
    error::Result,
    formats::Batch,
    soup::{Vertex, VertexTable},
    storage::{RecordWriter, Reservation, Workspace},
};

/// A vertex table that moves to disk when it outgrows its share of the budget.
pub(super) struct TableBuilder<V: Vertex> {
    place: Place<V>,
    /// Vertices so far.
    pub(super) count: u64,
    /// Bytes the table may take in memory.
    memory_bytes_max: u64,
}

enum Place<V: Vertex> {
    Memory(Vec<V>, Reservation),
    File(RecordWriter<V>),
}

/// Vertices added by one thread at a time, at least.
const TOGETHER: usize = 1 << 13;
/// Vertices reserved at a time when their number is not known.
const GROWTH_MIN: u64 = 1 << 16;
/// Share of the budget whose pages of a mapped table may be resident; and at least so much.
pub(super) const RESIDENT_SHARE: f64 = 0.25;
pub(super) const RESIDENT_BYTES_MIN: u64 = 4 << 20;

impl<V: Vertex> TableBuilder<V> {
    /// A table of no vertices, with room for `declared`.
    pub(super) fn new(
        declared: Option<u64>,
        config: &Config,
        workspace: &Workspace,
    ) -> Result<Self> {
        let limit = workspace.budget().available_bytes();
        let memory_bytes_max = (limit as f64 * config.table_share) as u64;
        let bytes = declared.map(|count| count.saturating_mul(size_of::<V>() as u64));
        let reservation = workspace
            .budget()
            .reserve(bytes.unwrap_or(0))
            .filter(|reservation| reservation.bytes() <= memory_bytes_max);
        let place = match reservation {
            Some(reservation) => Place::Memory(Vec::new(), reservation),
            None => Place::File(RecordWriter::create(workspace, "vertices", declared)?),
        };
        Ok(Self { place, count: 0, memory_bytes_max })
    }

    /// Adds the vertices of a batch, for which there is room, on all threads.
    pub(super) fn extend(&mut self, batch: &Batch) -> Result<()> {
        self.count += batch.positions.len() as u64;
        match &mut self.place {
            Place::Memory(vertices, _) => {
                let positions = batch.positions.par_iter().with_min_len(TOGETHER);
                if V::COLORED && !batch.colors.is_empty() {
                    let pairs = positions.zip(&batch.colors);
                    vertices.par_extend(pairs.map(|(position, color)| V::new(*position, *color)));
                } else {
                    vertices.par_extend(positions.map(|p| V::new(*p, [255; 4])));
                }
                Ok(())
            }
            Place::File(writer) => {
                for (index, position) in batch.positions.iter().enumerate() {
                    let color = batch.colors.get(index).copied().unwrap_or([255; 4]);
                    writer.push(&V::new(*position, color))?;
                }
                Ok(())
            }
        }
    }

    /// Makes sure that the next batch has room, on disk if not in memory.
    pub(super) fn make_room(&mut self, more: u64, workspace: &Workspace) -> Result<()> {
        let Place::Memory(vertices, reservation) = &mut self.place else { return Ok(()) };
        let needed = (vertices.len() as u64 + more) * size_of::<V>() as u64;
        if needed <= reservation.bytes() {
            return Ok(());
        }
        let growth = (reservation.bytes() / 2).max(GROWTH_MIN * size_of::<V>() as u64);
        let growth = growth.max(needed - reservation.bytes());
        let fits = reservation.bytes() + growth <= self.memory_bytes_max;
        if fits && reservation.grow(growth) {
            let room = reservation.bytes() as usize / size_of::<V>() - vertices.len();
            vertices.reserve_exact(room);
            return Ok(());
        }
        let mut writer = RecordWriter::create(workspace, "vertices", None)?;
        writer.extend(vertices)?;
        self.place = Place::File(writer);
        Ok(())
    }

    /// The table.
    pub(super) fn finish(self, workspace: &Workspace) -> Result<VertexTable<V>> {
        Ok(match self.place {
            Place::Memory(vertices, reservation) => VertexTable::Memory(vertices, reservation),
            Place::File(writer) => {
                let share = workspace.budget().available_bytes() as f64 * RESIDENT_SHARE;
                let resident_bytes_max = (share as u64).max(RESIDENT_BYTES_MIN);
                VertexTable::File { records: writer.finish()?.map()?, resident_bytes_max }
            }
        })
    }
}
