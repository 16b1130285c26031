//! From spilled runs to an indexed mesh, in bounded memory: the last steps of OoCSx
//! `[LS01 §3.1]`.
//!
//! Cells are merged by id and numbered in that order. The corners of the triangles are looked up
//! in the sorted ids, as many ids at a time as fit in memory: runs stay sorted, so merging them
//! removes duplicates. Then vertices that no triangle refers to are left out.

use rayon::prelude::*;

use super::{
    Config, Outcome, Quadrics,
    assemble::{self, Representatives},
    spill::{CellRecord, CellTriangle, RANKED, Run},
    sums::SUMS,
    table::{add, widen},
    used::Used,
};
use crate::{
    error::Result,
    external::reduce,
    geometry::CellId,
    progress::{Meter, Monitor, StageId},
    soup::{ATTRIBUTES_MAX, Column, IndexedMesh, Triangles, Vertex, VertexQuadric},
    storage::{Record, RecordFile, RecordWriter, Workspace},
};

/// Least memory to work with.
const MEMORY_BYTES_MIN: u64 = 4 << 20;

/// Makes the mesh of `runs`.
pub(super) fn on_disk<V: Vertex>(
    runs: Vec<Run>,
    config: &Config,
    workspace: &Workspace,
    monitor: &Monitor,
) -> Result<Outcome<V>> {
    let spills = runs.len() as u64;
    let memory = workspace.budget().reserve_share(1.0, MEMORY_BYTES_MIN);
    let reduce_config = reduce::Config { stage: StageId::Assemble, memory_bytes: memory.bytes() };
    let (cells, triangles): (Vec<_>, Vec<_>) =
        runs.into_iter().map(|run| (run.cells, run.triangles)).unzip();
    let merged = merge_cells::<V>(cells, config, &reduce_config, workspace, monitor)?;
    let Merged { ids, vertices, quadrics } = merged;
    let ranked = rank_corners(triangles, &ids, memory.bytes(), workspace, monitor)?;
    let cells = ids.count();
    drop(ids);
    let mut used = Used::none(cells);
    let mut writer = RecordWriter::create(workspace, "ranked", None)?;
    reduce::reduce(
        ranked,
        |_, _| (),
        &reduce_config,
        workspace,
        monitor,
        |batch| {
            batch.iter().flat_map(CellTriangle::ranks).for_each(|rank| used.mark(rank));
            writer.extend(batch)
        },
    )?;
    used.number();
    let triangles = renumber(&writer.finish()?, &used, workspace)?;
    let vertices = Column::File(keep_used(&vertices, &used, workspace)?);
    let keep_quadrics = |quadrics| keep_used(&quadrics, &used, workspace).map(Column::File);
    let quadrics = quadrics.map(keep_quadrics).transpose()?;
    let mesh = IndexedMesh { vertices, triangles: Triangles::File(triangles) };
    Ok(Outcome { mesh, quadrics, cells, spills })
}

/// All cells, by id.
struct Merged<V> {
    ids: RecordFile<u64>,
    vertices: RecordFile<V>,
    /// Where they are passed on.
    quadrics: Option<RecordFile<VertexQuadric>>,
}

/// Adds up the partial sums of each cell and places its vertex.
fn merge_cells<V: Vertex>(
    runs: Vec<RecordFile<CellRecord>>,
    config: &Config,
    reduce_config: &reduce::Config,
    workspace: &Workspace,
    monitor: &Monitor,
) -> Result<Merged<V>> {
    let mut ids = RecordWriter::create(workspace, "cell-ids", None)?;
    let mut vertices = RecordWriter::create(workspace, "cell-vertices", None)?;
    let mut quadrics = match config.quadrics {
        Quadrics::PassOn => Some(RecordWriter::create(workspace, "cell-quadrics", None)?),
        Quadrics::Drop => None,
    };
    // The last cell of a batch may go on in the next.
    let mut pending: Vec<CellRecord> = Vec::new();
    let mut flush = |records: &[CellRecord]| -> Result<()> {
        let groups: Vec<&[CellRecord]> = records.chunk_by(|a, b| a.id == b.id).collect();
        let all: Vec<_> = groups.par_iter().map(|group| place::<V>(group, config)).collect();
        let mut placed = Representatives::default();
        for one in all {
            placed.push(one);
        }
        for group in groups {
            ids.push(&group[0].id)?;
        }
        if let Some(writer) = &mut quadrics {
            writer.extend(&placed.quadrics)?;
        }
        vertices.extend(&placed.vertices)
    };
    let no_equal_keys = |_: &mut CellRecord, _: &CellRecord| unreachable!("ties differ");
    reduce::reduce(runs, no_equal_keys, reduce_config, workspace, monitor, |batch| {
        pending.extend_from_slice(batch);
        let last = pending.last().map_or(0, |record| record.id);
        let complete = pending.partition_point(|record| record.id < last);
        flush(&pending[..complete])?;
        pending.drain(..complete);
        Ok(())
    })?;
    flush(&pending)?;
    let quadrics = quadrics.map(RecordWriter::finish).transpose()?;
    Ok(Merged { ids: ids.finish()?, vertices: vertices.finish()?, quadrics })
}

/// The vertex of one cell, and its quadric if that is passed on.
fn place<V: Vertex>(group: &[CellRecord], config: &Config) -> (V, Option<VertexQuadric>) {
    let (mut sums, mut attributes) = ([0; SUMS], [0; ATTRIBUTES_MAX]);
    for record in group {
        add(&mut sums, &record.sums.map(i64::from));
        add(&mut attributes, &widen(&record.attributes));
    }
    assemble::representative(CellId(group[0].id), &sums, attributes, config)
}

/// Replaces cell ids by their ranks in `ids`, in each run. Ids are taken into memory in pieces;
/// every piece is one pass over the triangles.
fn rank_corners(
    mut runs: Vec<RecordFile<CellTriangle>>,
    ids: &RecordFile<u64>,
    memory_bytes: u64,
    workspace: &Workspace,
    monitor: &Monitor,
) -> Result<Vec<RecordFile<CellTriangle>>> {
    let piece = (memory_bytes / 2 / size_of::<u64>() as u64).max(1 << 16);
    let passes = ids.count().div_ceil(piece).max(1);
    let records: u64 = runs.iter().map(RecordFile::count).sum();
    let meter = monitor.meter(StageId::Assemble, Some(records * passes));
    for first in (0..passes).map(|pass| pass * piece) {
        let count = piece.min(ids.count() - first);
        let mut known = Vec::with_capacity(count as usize);
        let mut scanner = ids.scan_range(first, count)?;
        while let Some(batch) = scanner.next_batch()? {
            known.extend_from_slice(batch);
        }
        runs = runs
            .into_iter()
            .map(|run| rank_known(&run, &known, first, workspace, &meter))
            .collect::<Result<_>>()?;
    }
    meter.finish();
    Ok(runs)
}

/// Replaces the ids that are in `known`, whose first has rank `first`.
fn rank_known(
    run: &RecordFile<CellTriangle>,
    known: &[u64],
    first: u64,
    workspace: &Workspace,
    meter: &Meter,
) -> Result<RecordFile<CellTriangle>> {
    let rank_all = |triangles: &mut [CellTriangle]| {
        let mut near = [0; 3];
        for triangle in triangles {
            for (corner, near) in triangle.0.iter_mut().zip(&mut near) {
                *near = position_near(known, *corner, *near);
                if known.get(*near) == Some(corner) {
                    *corner = RANKED | (first + *near as u64);
                }
            }
        }
    };
    let mut writer = RecordWriter::create(workspace, "ranked", Some(run.count()))?;
    let mut scanner = run.scan()?;
    let mut ranked = Vec::new();
    while let Some(batch) = scanner.next_batch()? {
        ranked.clear();
        ranked.extend_from_slice(batch);
        ranked.par_chunks_mut(RANKED_AT_ONCE).for_each(rank_all);
        writer.extend(&ranked)?;
        meter.add(batch.len() as u64)?;
    }
    writer.finish()
}

/// Triangles ranked by one task, each from where the one before it was found.
const RANKED_AT_ONCE: usize = 1 << 11;

/// Where `id` stands in ascending `ids`, or would stand: searched from `near` in steps that
/// double, since neighbouring triangles lie between neighbouring cells.
fn position_near(ids: &[u64], id: u64, near: usize) -> usize {
    let mut step = 1;
    let (mut low, mut high) = (near.min(ids.len()), near.min(ids.len()));
    // Everything before `low` is smaller than the id, everything from `high` on is not.
    while low > 0 && ids[low - 1] >= id {
        high = low - 1;
        low = low.saturating_sub(step);
        step *= 2;
    }
    while high < ids.len() && ids[high] < id {
        low = high + 1;
        high = (high + step).min(ids.len());
        step *= 2;
    }
    low + ids[low..high].partition_point(|other| *other < id)
}

/// The triangles with the numbers of their cells among the used ones.
fn renumber(
    ranked: &RecordFile<CellTriangle>,
    used: &Used,
    workspace: &Workspace,
) -> Result<RecordFile<[u64; 3]>> {
    let mut writer = RecordWriter::create(workspace, "triangles", Some(ranked.count()))?;
    let mut scanner = ranked.scan()?;
    while let Some(batch) = scanner.next_batch()? {
        for triangle in batch {
            writer.push(&triangle.ranks().map(|rank| used.number_of(rank)))?;
        }
    }
    writer.finish()
}

/// What belongs to used cells.
fn keep_used<R: Record>(
    of_cells: &RecordFile<R>,
    used: &Used,
    workspace: &Workspace,
) -> Result<RecordFile<R>> {
    let mut writer = RecordWriter::create(workspace, "used", None)?;
    let mut scanner = of_cells.scan()?;
    let mut rank = 0;
    while let Some(batch) = scanner.next_batch()? {
        for record in batch {
            if used.contains(rank) {
                writer.push(record)?;
            }
            rank += 1;
        }
    }
    writer.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_id_is_found_from_everywhere() {
        let ids: Vec<u64> = (0..40).map(|i| i * i).collect();
        for count in [0, 1, 2, 40] {
            for id in 0..1600 {
                let expected = ids[..count].partition_point(|other| *other < id);
                for near in 0..=count + 1 {
                    assert_eq!(position_near(&ids[..count], id, near), expected, "{id} {near}");
                }
            }
        }
    }
}
