//! The table that threads share: each adds triangles to a small one of its own, which stays in its
//! caches, and pours that into the shared one when it is full.
//!
//! Threads that take batches of one input in turns see the same cells. With a large table each,
//! those cells took their room once a thread, and spills came so much sooner.

use std::sync::{
    Mutex, PoisonError, TryLockError,
    atomic::{AtomicU32, Ordering},
};

use super::{
    journal,
    spill::{self, Run},
    table::CellTable,
};
use crate::{
    error::Result,
    geometry::Grid,
    soup::{Triangle, Vertex},
    storage::{Kept, Workspace},
};

/// A table for several threads, and the runs it was spilled to.
pub(super) struct SharedTable<'a, V: Vertex> {
    filling: Mutex<Filling<V>>,
    /// The table is spilled beyond this size.
    table_bytes_max: u64,
    /// A thread's own table is never much larger.
    own_bytes_max: u64,
    /// Runs spilled so far, by all tables of a job.
    serial: &'a AtomicU32,
    workspace: &'a Workspace,
}

struct Filling<V: Vertex> {
    table: CellTable<V>,
    runs: Vec<Run>,
}

/// Threads that share a table. Pouring takes some hundredths of each one's time.
pub(super) const THREADS_PER_TABLE: usize = 4;
/// Largest size of a thread's own table. Half of it, which is what it has unless others pour at
/// the same time, fits a second-level cache.
const OWN_BYTES_MAX: u64 = 2 << 20;
/// Triangles added between two looks at the size.
const TRIANGLES_PER_CHECK: usize = 1 << 12;

impl<'a, V: Vertex> SharedTable<'a, V> {
    /// An empty table for `threads` threads, which takes `memory_bytes` together with theirs.
    pub(super) fn new(
        memory_bytes: u64,
        threads: usize,
        serial: &'a AtomicU32,
        workspace: &'a Workspace,
    ) -> Self {
        let threads = threads as u64;
        let own_bytes_max = OWN_BYTES_MAX.min(memory_bytes / (4 * threads));
        let table_bytes_max = memory_bytes - own_bytes_max * threads;
        let filling = Filling { table: CellTable::new(), runs: Vec::new() };
        Self { filling: Mutex::new(filling), table_bytes_max, own_bytes_max, serial, workspace }
    }

    /// Adds triangles to the table of a thread, a batch that begins with record `first`, and pours
    /// it when it is full.
    pub(super) fn add(
        &self,
        own: &mut OwnTable<V>,
        grid: &Grid,
        triangles: &[Triangle<V>],
        first: u64,
    ) -> Result<()> {
        for triangles in triangles.chunks(TRIANGLES_PER_CHECK) {
            own.table.add(grid, triangles, first);
            let size_bytes = own.table.size_bytes();
            if size_bytes > self.own_bytes_max {
                self.pour(own)?;
            } else if size_bytes > self.own_bytes_max / 2 {
                match self.filling.try_lock() {
                    Ok(mut filling) => self.pour_into(&mut filling, own)?,
                    // Another thread pours, or spills: there is room to go on.
                    Err(TryLockError::WouldBlock) => {}
                    Err(TryLockError::Poisoned(_)) => self.pour(own)?,
                }
            }
        }
        Ok(())
    }

    /// Pours what a thread's table holds; all that is left in it is what it counted.
    pub(super) fn pour(&self, own: &mut OwnTable<V>) -> Result<()> {
        let filling = self.filling.lock();
        self.pour_into(&mut filling.unwrap_or_else(PoisonError::into_inner), own)
    }

    fn pour_into(&self, filling: &mut Filling<V>, own: &mut OwnTable<V>) -> Result<()> {
        own.table.pour_into(&mut filling.table, &mut own.places);
        if filling.table.size_bytes() > self.table_bytes_max {
            let serial = self.serial.fetch_add(1, Ordering::Relaxed);
            filling.runs.push(spill::spill(&mut filling.table, serial, self.workspace)?);
        }
        Ok(())
    }

    /// The runs so far and a copy of the table, to be noted.
    pub(super) fn kept(&self) -> Result<Vec<Kept>> {
        let mut filling = self.filling.lock().unwrap_or_else(PoisonError::into_inner);
        let Filling { table, runs } = &mut *filling;
        let mut files = journal::kept(runs);
        if !table.ids.is_empty() {
            let serial = self.serial.fetch_add(1, Ordering::Relaxed);
            files.extend(journal::kept(&[spill::copy(table, serial, self.workspace)?]));
        }
        Ok(files)
    }

    /// What was poured: the table, and the runs it was spilled to before.
    pub(super) fn into_parts(self) -> (CellTable<V>, Vec<Run>) {
        let filling = self.filling.into_inner().unwrap_or_else(PoisonError::into_inner);
        (filling.table, filling.runs)
    }
}

/// What one thread adds to.
pub(super) struct OwnTable<V: Vertex> {
    pub(super) table: CellTable<V>,
    /// Of the cells poured last: their places in the shared table.
    places: Vec<u32>,
}

impl<V: Vertex> OwnTable<V> {
    pub(super) fn new() -> Self {
        Self { table: CellTable::new(), places: Vec::new() }
    }
}
