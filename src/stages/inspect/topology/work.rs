//! The slabs of a stream on all threads, in the memory there is.

use std::{
    collections::BTreeMap,
    sync::{
        Mutex, MutexGuard, PoisonError,
        atomic::{AtomicU64, Ordering},
    },
    time::Duration,
};

use super::{
    Config,
    components::{Components, SlabComponents},
    config::{SLAB_TRIANGLE_BYTES, WAITING_TRIANGLE_BYTES, slabs_under_way},
    cutter::Slab,
    ring::Tally,
    slab,
};
use crate::{
    error::Result,
    progress::{Cancelled, Meter},
};

/// How long the thread that reads sleeps where it has to wait and there is nothing else to do.
const NAP: Duration = Duration::from_micros(100);

/// Slabs that are done and wait for one before them, at most; their components take some memory.
const DONE_MAX: usize = 64;

/// What the threads share.
pub(super) struct Work<'a> {
    meter: &'a Meter<'a>,
    memory_bytes: u64,
    /// Slabs that are worked on or wait for a thread, at most.
    under_way_max: u64,
    under_way: AtomicU64,
    /// Bytes of those.
    held_bytes: AtomicU64,
    sums: Mutex<Sums>,
}

/// What came of the slabs so far.
#[derive(Default)]
pub(super) struct Sums {
    pub(super) tally: Tally,
    pub(super) flat: u64,
    pub(super) slivers: u64,
    pub(super) components: Components,
    /// The slab whose components come next.
    next: u64,
    done: BTreeMap<u64, SlabComponents>,
    cancelled: Option<Cancelled>,
}

impl<'a> Work<'a> {
    pub(super) fn new(config: &Config, meter: &'a Meter<'a>) -> Self {
        Self {
            meter,
            memory_bytes: config.memory_bytes,
            under_way_max: slabs_under_way(rayon::current_num_threads()),
            under_way: AtomicU64::new(0),
            held_bytes: AtomicU64::new(0),
            sums: Mutex::default(),
        }
    }

    /// Gives a slab to the other threads, or works on it here if there are none or they have enough
    /// to do.
    pub(super) fn start<'scope>(
        &'scope self,
        others: Option<&rayon::Scope<'scope>>,
        slab: Slab,
    ) -> Result<()>
    where
        'a: 'scope,
    {
        let triangles = slab.triangles.len() as u64;
        let waiting_bytes = triangles * WAITING_TRIANGLE_BYTES;
        let bytes = triangles * SLAB_TRIANGLE_BYTES;
        while !self.has_room(bytes + waiting_bytes) {
            // Another slab gives its memory back before long, or it is this thread's to work on.
            if rayon::yield_now() != Some(rayon::Yield::Executed) {
                std::thread::sleep(NAP);
            }
        }
        self.held_bytes.fetch_add(bytes, Ordering::AcqRel);
        let before = self.under_way.fetch_add(1, Ordering::AcqRel);
        match others {
            Some(scope) if before + 1 < self.under_way_max => scope.spawn(move |_| self.run(slab)),
            _ => self.run(slab),
        }
        let cancelled = self.sums().cancelled;
        Ok(cancelled.map_or(Ok(()), Err)?)
    }

    fn has_room(&self, bytes: u64) -> bool {
        if self.under_way.load(Ordering::Acquire) == 0 {
            // Slabs are cut so that one fits alone.
            return true;
        }
        let fits = self.held_bytes.load(Ordering::Acquire) + bytes <= self.memory_bytes;
        fits && self.sums().done.len() < DONE_MAX
    }

    fn run(&self, slab: Slab) {
        let examined = slab::examine(&slab);
        let (index, triangles) = (slab.index, slab.triangles.len());
        let new = (triangles - slab.front) as u64;
        drop(slab);
        let mut sums = self.sums();
        sums.tally.add(&examined.tally);
        sums.flat += examined.flat;
        sums.slivers += examined.slivers;
        sums.add_components(index, examined.components);
        sums.cancelled = self.meter.add(new).err().or(sums.cancelled);
        drop(sums);
        self.held_bytes.fetch_sub(triangles as u64 * SLAB_TRIANGLE_BYTES, Ordering::AcqRel);
        self.under_way.fetch_sub(1, Ordering::AcqRel);
    }

    fn sums(&self) -> MutexGuard<'_, Sums> {
        self.sums.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What came of all slabs.
    pub(super) fn finish(self) -> Result<Sums> {
        let sums = self.sums.into_inner().unwrap_or_else(PoisonError::into_inner);
        if let Some(cancelled) = sums.cancelled {
            return Err(cancelled.into());
        }
        assert!(sums.done.is_empty(), "every slab has had its turn");
        Ok(sums)
    }
}

impl Sums {
    /// Adds the components of a slab as soon as those of all before it are.
    fn add_components(&mut self, index: u64, components: SlabComponents) {
        self.done.insert(index, components);
        while let Some(components) = self.done.remove(&self.next) {
            self.components.add(&components);
            self.next += 1;
        }
    }
}
