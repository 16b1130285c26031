//! Vertex clustering with quadrics `[LS01]`: every grid cell that holds vertices becomes one
//! vertex, every triangle between three different cells stays.
//!
//! OoCS and OoCSx are one algorithm here: tables of partial sums in memory that spill sorted runs
//! when their budget is full. With room enough nothing spills, and it is OoCS; with little, the
//! runs are merged, and it is OoCSx. The result is the same, byte by byte.

mod assemble;
mod estimate;
mod journal;
mod merge;
mod placed;
mod shared;
mod spill;
mod sums;
mod table;
mod triples;
mod used;

use std::sync::{
    Mutex, PoisonError,
    atomic::{AtomicBool, AtomicU32, AtomicU64, AtomicUsize, Ordering},
};

pub use estimate::cells_for;
use journal::Progress;
use rayon::prelude::*;
use shared::{OwnTable, SharedTable, THREADS_PER_TABLE};
use spill::Run;
use table::CellTable;

use crate::{
    error::{Position, Result},
    formats::{DefectKind, Findings},
    geometry::{Grid, Placement},
    progress::{Meter, Monitor, StageId},
    soup::{Column, IndexedMesh, Pass, Scratch, Source, Vertex, VertexQuadric},
    storage::Workspace,
};

/// What clustering needs to know.
#[derive(Clone, Copy, Debug)]
pub struct Config {
    /// The cells.
    pub grid: Grid,
    /// Share of the edge quadrics in each cell's sum, 0 to 1; the rest are plane quadrics. The
    /// 1 − λ of `[LS01 §3.2]`, see [`BOUNDARY_WEIGHT`].
    pub boundary_weight: f64,
    /// Where representatives may lie.
    pub placement: Placement,
    /// Memory that the assembly will find, in bytes: the tables take no more than leaves it room,
    /// even if there is more now. The whole budget, if the source is dropped in between.
    pub assembly_bytes: u64,
    /// Whether vertices come with their quadrics.
    pub quadrics: Quadrics,
}

/// What becomes of the cells' quadrics when the vertices are placed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quadrics {
    /// They go.
    Drop,
    /// They are passed on with the vertices, for what decimates the mesh further `[GS02]`.
    PassOn,
}

/// λ = ½ `[LS01 §3.2]`.
pub const BOUNDARY_WEIGHT: f64 = 0.5;

/// Sums over all triangles of a source, in memory and in runs on disk.
pub struct Partials<V: Vertex> {
    tables: Vec<CellTable<V>>,
    runs: Vec<Run>,
    /// What the pass over the source found.
    pub findings: Findings,
    /// Triangles of the source.
    pub triangles: u64,
    progress: Progress,
}

/// What clustering did.
pub struct Outcome<V> {
    /// The result: vertices in the order of their cells, triangles in the order of their
    /// vertices.
    pub mesh: IndexedMesh<V>,
    /// Of the surface each vertex stands for, where they are passed on; boundaries are not in them.
    pub quadrics: Option<Column<VertexQuadric>>,
    /// Cells that held vertices.
    pub cells: u64,
    /// Runs spilled to disk.
    pub spills: u64,
}

/// Least memory of tables for each thread; below it the spills would be smaller than their buffers.
const TABLE_BYTES_MIN: u64 = 1 << 20;

/// What the assembly holds at its peak, relative to the tables it starts from: entries, ranks and
/// a second copy of the triangles beside the sums.
const ASSEMBLY_FACTOR: f64 = 1.35;
/// The same with quadrics, a third of the tables, beside the vertices.
const ASSEMBLY_FACTOR_QUADRICS: f64 = 1.7;

/// Sums the quadrics of all triangles by cell: one pass over `source` on all threads of the
/// current pool. Takes the memory that is left in the workspace's budget, and spills beyond it.
///
/// # Errors
/// What reading the source fails with, a full disk, or cancellation.
pub fn accumulate<V: Vertex>(
    source: &Source<V>,
    config: &Config,
    workspace: &Workspace,
    monitor: &Monitor,
) -> Result<Partials<V>> {
    let threads = workspace.budget().threads();
    let factor = match config.quadrics {
        Quadrics::Drop => ASSEMBLY_FACTOR,
        Quadrics::PassOn => ASSEMBLY_FACTOR_QUADRICS,
    };
    let room = (config.assembly_bytes as f64 / factor) as u64;
    let share = room as f64 / workspace.budget().available_bytes().max(1) as f64;
    let memory = workspace.budget().reserve_share(share.min(1.0), TABLE_BYTES_MIN * threads as u64);
    let tables = threads.div_ceil(THREADS_PER_TABLE);
    let table_bytes = memory.bytes() / tables as u64;
    let (mut progress, mut runs) = journal::recall(config, workspace)?;
    let serial = AtomicU32::new(progress.serial);
    let new = |_| SharedTable::new(table_bytes, threads.div_ceil(tables), &serial, workspace);
    let tables: Vec<SharedTable<V>> = (0..tables).map(new).collect();
    let pass = source.pass();
    let meter = monitor.meter(StageId::Cluster, source.amount());
    // What the inputs' readers find is noted only when they have come to their end.
    let is_known = progress.is_over;
    if !is_known {
        pass.skip(progress.records, &progress.findings)?;
    }
    meter.add(progress.records)?;
    while !progress.is_over {
        let leg = Leg { config, pass: &pass, meter: &meter, tables: &tables, workspace };
        leg.run(threads, &mut progress)?;
        progress.serial = serial.load(Ordering::Relaxed);
        if let (false, Some(due)) = (progress.is_over, workspace.due()) {
            let states = tables.par_iter().map(SharedTable::kept).collect::<Result<Vec<_>>>()?;
            progress.serial = serial.load(Ordering::Relaxed);
            let files = journal::kept(&runs).into_iter().chain(states.into_iter().flatten());
            journal::checkpoint(&due, &progress, files.collect(), config, workspace)?;
        }
    }
    meter.finish();
    let found = pass.finish();
    if !is_known {
        progress.findings = found;
    }
    let mut findings = progress.findings.clone();
    let first = progress.degenerate_first;
    let at = first.map_or(Position::default(), |record| Position::default().in_record(record));
    findings.add(DefectKind::Degenerate, progress.degenerate, at);
    let parts = tables.into_iter().map(SharedTable::into_parts);
    let (tables, spilled): (Vec<_>, Vec<Vec<_>>) = parts.unzip();
    runs.extend(spilled.into_iter().flatten());
    Ok(Partials { tables, runs, findings, triangles: progress.triangles, progress })
}

/// A stretch of the pass, to its end or to the next checkpoint.
struct Leg<'a, V: Vertex> {
    config: &'a Config,
    pass: &'a Pass<'a, V>,
    meter: &'a Meter<'a>,
    tables: &'a [SharedTable<'a, V>],
    workspace: &'a Workspace,
}

impl<V: Vertex> Leg<'_, V> {
    /// Adds to the tables on all threads; in the end all that was read is in them.
    fn run(&self, threads: usize, progress: &mut Progress) -> Result<()> {
        let (thread, triangles) = (AtomicUsize::new(0), AtomicU64::new(0));
        let is_due = AtomicBool::new(false);
        let work = || -> Result<CellTable<V>> {
            let thread = thread.fetch_add(1, Ordering::Relaxed);
            let shared = &self.tables[thread % self.tables.len()];
            let mut own = OwnTable::new();
            let mut scratch = Scratch::default();
            while !is_due.load(Ordering::Relaxed) {
                let Some(taken) = self.pass.next(&mut scratch)? else { break };
                triangles.fetch_add(taken.triangles.len() as u64, Ordering::Relaxed);
                shared.add(&mut own, &self.config.grid, taken.triangles, taken.first_record)?;
                self.meter.add(taken.records)?;
                if self.workspace.due().is_some() {
                    is_due.store(true, Ordering::Relaxed);
                }
            }
            shared.pour(&mut own)?;
            Ok(own.table)
        };
        for table in on_every_thread(threads, work)? {
            progress.degenerate += table.degenerate;
            let firsts = [progress.degenerate_first, table.degenerate_first];
            progress.degenerate_first = firsts.into_iter().flatten().min();
        }
        progress.triangles += triangles.into_inner();
        (progress.records, progress.findings) = self.pass.position();
        progress.is_over = !is_due.into_inner();
        Ok(())
    }
}

/// Makes the simplified mesh of the sums.
///
/// # Errors
/// A full disk, or cancellation.
pub fn assemble<V: Vertex>(
    mut partials: Partials<V>,
    config: &Config,
    workspace: &Workspace,
    monitor: &Monitor,
) -> Result<Outcome<V>> {
    if partials.runs.is_empty() {
        return assemble::in_memory(partials.tables, config, monitor);
    }
    let serial = partials.progress.serial;
    let tables = partials.tables.into_par_iter().filter(|table| !table.ids.is_empty());
    let tables = tables.collect::<Vec<_>>().into_par_iter().enumerate();
    let last = tables.map(|(i, mut table)| spill::spill(&mut table, serial + i as u32, workspace));
    partials.runs.extend(last.collect::<Result<Vec<_>>>()?);
    journal::note(&partials.progress, &partials.runs, config, workspace)?;
    merge::on_disk(partials.runs, config, workspace, monitor)
}

/// Runs `work` once on each of `threads` threads of the current pool; the first error wins.
fn on_every_thread<T: Send>(threads: usize, work: impl Fn() -> Result<T> + Sync) -> Result<Vec<T>> {
    let done = Mutex::new(Vec::with_capacity(threads));
    rayon::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|_| {
                let result = work();
                done.lock().unwrap_or_else(PoisonError::into_inner).push(result);
            });
        }
    });
    done.into_inner().unwrap_or_else(PoisonError::into_inner).into_iter().collect()
}
