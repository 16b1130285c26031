//! From tables in memory to an indexed mesh: cells in id order, one vertex each.

use rayon::prelude::*;

use super::{
    Config, Outcome,
    sums::{SUMS, TotalSums, WEIGHT, to_quadric},
    table::{CellTable, Overflow, add, widen},
    triples::{rotate, sort_and_dedup},
    used::Used,
};
use crate::{
    error::Result,
    geometry::CellId,
    progress::{Monitor, StageId},
    soup::{ATTRIBUTES_MAX, Column, IndexedMesh, Triangles, Vertex},
};

/// A cell of one table.
#[derive(Clone, Copy)]
struct Entry {
    id: CellId,
    table: u32,
    index: u32,
}

/// Cells per parallel task.
const CHUNK: usize = 1 << 12;

/// Makes the mesh of `tables`.
pub(super) fn in_memory<V: Vertex>(
    mut tables: Vec<CellTable<V>>,
    config: &Config,
    monitor: &Monitor,
) -> Result<Outcome<V>> {
    let entries = sorted_entries(&tables);
    tables.iter_mut().for_each(CellTable::drop_index);
    let meter = monitor.meter(StageId::Assemble, Some(entries.len() as u64));
    let mut overflow: Vec<Overflow> =
        tables.iter_mut().flat_map(|table| std::mem::take(&mut table.overflow)).collect();
    overflow.sort_unstable_by_key(|entry| entry.id);
    let (mut triangles, cells) = number_triangles(&entries, &mut tables);
    let mut used = Used::none(cells);
    triangles.iter().flatten().for_each(|rank| used.mark(u64::from(*rank)));
    used.number();
    let chunks = cell_chunks(&entries);
    let vertices = chunks.into_par_iter().map(|chunk| {
        let mut vertices = Vec::new();
        let cells = entries[chunk.range].chunk_by(|a, b| a.id == b.id);
        for (cell, group) in (chunk.first_cell..).zip(cells) {
            if used.contains(cell) {
                let (sums, attributes) = total(group, &tables, &overflow);
                vertices.push(representative(group[0].id, &sums, attributes, config));
            }
        }
        meter.add(0)?;
        Ok(vertices)
    });
    let vertices = vertices.collect::<Result<Vec<Vec<V>>>>()?.concat();
    meter.add(entries.len() as u64)?;
    meter.finish();
    let number = |rank: u32| used.number_of(u64::from(rank)) as u32;
    triangles.par_iter_mut().for_each(|triangle| *triangle = triangle.map(number));
    let mesh =
        IndexedMesh { vertices: Column::Memory(vertices), triangles: Triangles::Memory(triangles) };
    Ok(Outcome { mesh, cells, spills: 0 })
}

/// The vertex that stands for a cell.
pub(super) fn representative<V: Vertex>(
    id: CellId,
    sums: &TotalSums,
    attributes: [i64; ATTRIBUTES_MAX],
    config: &Config,
) -> V {
    let (quadric, mean) = to_quadric(sums, config.boundary_weight);
    let local = quadric.minimise(mean, config.placement);
    V::mean(config.grid.to_model(id, local), attributes, sums[WEIGHT])
}

/// The cells of all tables by id; equal ids are neighbours.
fn sorted_entries<V: Vertex>(tables: &[CellTable<V>]) -> Vec<Entry> {
    let mut entries = Vec::with_capacity(tables.iter().map(|table| table.ids.len()).sum());
    for (table, cells) in (0..).zip(tables) {
        entries.extend((0..).zip(&cells.ids).map(|(index, id)| Entry { id: *id, table, index }));
    }
    entries.par_sort_unstable_by_key(|entry| (entry.id, entry.table));
    entries
}

/// The triangles of all tables in terms of the cells' ranks, sorted, without duplicates; and the
/// number of cells.
fn number_triangles<V: Vertex>(
    entries: &[Entry],
    tables: &mut [CellTable<V>],
) -> (Vec<[u32; 3]>, u64) {
    let mut ranks: Vec<Vec<u32>> = tables.iter().map(|table| vec![0; table.sums.len()]).collect();
    let mut cells = 0;
    for group in entries.chunk_by(|a, b| a.id == b.id) {
        for entry in group {
            ranks[entry.table as usize][entry.index as usize] = cells;
        }
        cells += 1;
    }
    let mut all = Vec::new();
    for (table, ranks) in tables.iter_mut().zip(&ranks) {
        let triangles = std::mem::take(&mut table.triangles);
        let ranked = triangles.iter().map(|t| rotate(t.map(|cell| ranks[cell as usize])));
        all.extend(ranked);
    }
    (sort_and_dedup(all, cells as usize), u64::from(cells))
}

/// Entries of whole cells, for one task.
struct CellChunk {
    range: std::ops::Range<usize>,
    /// Rank of the first cell.
    first_cell: u64,
}

/// Cuts the entries into chunks that do not split a cell.
fn cell_chunks(entries: &[Entry]) -> Vec<CellChunk> {
    let (mut chunks, mut start, mut end, mut cell, mut first_cell) = (Vec::new(), 0, 0, 0, 0);
    for group in entries.chunk_by(|a, b| a.id == b.id) {
        end += group.len();
        cell += 1;
        if end - start >= CHUNK {
            chunks.push(CellChunk { range: start..end, first_cell });
            (start, first_cell) = (end, cell);
        }
    }
    chunks.push(CellChunk { range: start..end, first_cell });
    chunks
}

/// Sums of one cell over all tables.
fn total<V: Vertex>(
    group: &[Entry],
    tables: &[CellTable<V>],
    overflow: &[Overflow],
) -> (TotalSums, [i64; ATTRIBUTES_MAX]) {
    let (mut sums, mut attributes) = ([0; SUMS], [0; ATTRIBUTES_MAX]);
    for entry in group {
        let (table, index) = (&tables[entry.table as usize], entry.index as usize);
        add(&mut sums, &table.sums[index].map(i64::from));
        add(&mut attributes, &widen(table.attributes[index].as_ref()));
    }
    let first = overflow.partition_point(|moved| moved.id < group[0].id);
    for moved in overflow[first..].iter().take_while(|moved| moved.id == group[0].id) {
        add(&mut sums, &moved.sums);
        add(&mut attributes, &moved.attributes);
    }
    (sums, attributes)
}
