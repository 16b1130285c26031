//! Progress and cancellation, as one small thing passed down.
//!
//! It draws nothing: an [`Observer`] receives events and decides what a person sees.

use std::{
    fmt,
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
};

/// Names a stage in events, errors, file names and reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum StageId {
    /// One sequential read of the input: counts, bounds, vertex table.
    Import,
    /// Indexed mesh to triangle soup.
    Dereference,
    /// How far triangles are from sorted.
    Measure,
    /// Records put in the order of their key.
    Sort,
    /// Soup to indexed mesh.
    Weld,
    /// The cell size that meets a triangle count.
    Estimate,
    /// Quadrics summed by grid cell.
    Cluster,
    /// Cell representatives and the triangles between them.
    Assemble,
    /// Edges collapsed, slab by slab.
    Decimate,
    /// The exact count, and where the vertices lie best.
    Finish,
    /// Edges collapsed, each with what undoes it.
    Record,
    /// A recording turned round into a progressive mesh.
    Encode,
    /// A progressive mesh read as far as is wanted.
    Refine,
    /// The result written in the user's format.
    Export,
    /// A synthetic surface made.
    Generate,
    /// Counts, bounds and order of triangles.
    Info,
    /// Edges, vertices and components of a surface counted.
    Topology,
    /// Areas and bounds of surfaces that will be compared.
    Survey,
    /// Points of a surface that will be measured.
    Sample,
    /// Points measured against the triangles of another surface.
    Compare,
    /// Triangles drawn.
    Render,
    /// A mesh put into a page.
    Document,
}

impl StageId {
    /// Name in messages and reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Import => "import",
            Self::Dereference => "dereference",
            Self::Measure => "measure",
            Self::Sort => "sort",
            Self::Weld => "weld",
            Self::Estimate => "estimate",
            Self::Cluster => "cluster",
            Self::Assemble => "assemble",
            Self::Decimate => "decimate",
            Self::Finish => "finish",
            Self::Record => "record",
            Self::Encode => "encode",
            Self::Refine => "refine",
            Self::Export => "export",
            Self::Generate => "generate",
            Self::Info => "info",
            Self::Topology => "topology",
            Self::Survey => "survey",
            Self::Sample => "sample",
            Self::Compare => "compare",
            Self::Render => "render",
            Self::Document => "document",
        }
    }
}

impl fmt::Display for StageId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The caller raised [`Cancel`]. Not a fault: nothing is wrong with the data.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("cancelled during {0}")]
pub struct Cancelled(pub StageId);

/// Something worth telling the caller.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Event {
    /// A pass begins.
    Started {
        /// Stage.
        stage: StageId,
        /// Records this pass will visit, or more if some are left out as defects; `None` when
        /// only the end of a stream will tell.
        total: Option<u64>,
        /// Bytes on disk that visiting all of them reads or writes, where that is known.
        bytes: Option<u64>,
    },
    /// `done` records visited. Never decreases within a pass.
    Advanced {
        /// Stage.
        stage: StageId,
        /// Records visited so far.
        done: u64,
    },
    /// The pass visited all its records.
    Finished {
        /// Stage.
        stage: StageId,
        /// Records visited.
        done: u64,
    },
}

/// How much a pass has before it. What is not known is `None`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Amount {
    /// Records.
    pub records: Option<u64>,
    /// Bytes on disk that visiting all of them reads or writes.
    pub bytes: Option<u64>,
}

impl From<Option<u64>> for Amount {
    fn from(records: Option<u64>) -> Self {
        Self { records, bytes: None }
    }
}

/// Receives events. Called from worker threads; must not block.
pub trait Observer: Sync {
    /// Handles one event.
    fn on(&self, event: &Event);
}

/// Ignores everything.
impl Observer for () {
    fn on(&self, _: &Event) {}
}

impl<F: Fn(&Event) + Sync> Observer for F {
    fn on(&self, event: &Event) {
        self(event);
    }
}

/// A flag the caller raises to stop a job. Clones share the flag.
#[derive(Clone, Debug, Default)]
pub struct Cancel(Arc<AtomicBool>);

impl Cancel {
    /// Asks the job to stop at the next batch boundary. Idempotent; any thread.
    pub fn raise(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether [`Self::raise`] was called.
    #[must_use]
    pub fn is_raised(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// The flag itself, for a signal handler that may do nothing but store a bool.
    #[must_use]
    pub fn flag(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.0)
    }
}

/// The listener and the stop flag of one job.
pub struct Monitor<'a> {
    /// Listener.
    pub observer: &'a dyn Observer,
    /// Stop flag.
    pub cancel: Cancel,
}

impl<'a> Monitor<'a> {
    /// A monitor that reports to nobody and is never cancelled.
    #[must_use]
    pub fn silent() -> Monitor<'static> {
        Monitor { observer: &(), cancel: Cancel::default() }
    }

    /// Starts counting one pass, of so many records if that is known.
    #[must_use]
    pub fn meter(&'a self, stage: StageId, amount: impl Into<Amount>) -> Meter<'a> {
        let Amount { records: total, bytes } = amount.into();
        self.observer.on(&Event::Started { stage, total, bytes });
        Meter { monitor: self, stage, done: AtomicU64::new(0), total }
    }

    /// Starts counting one pass over so many records that lie on disk as they lie in memory.
    #[must_use]
    pub fn meter_of<R>(&'a self, stage: StageId, records: u64) -> Meter<'a> {
        let bytes = Some(records.saturating_mul(size_of::<R>() as u64));
        self.meter(stage, Amount { records: Some(records), bytes })
    }

    /// Notices cancellation in work that is part of a pass already metered.
    ///
    /// # Errors
    /// [`Cancelled`] once the caller has raised the flag.
    pub fn check(&self, stage: StageId) -> Result<(), Cancelled> {
        if self.cancel.is_raised() { Err(Cancelled(stage)) } else { Ok(()) }
    }
}

/// Records between two events.
const STEP: u64 = 1 << 16;

/// Counts records, reports them, and notices cancellation: one call for all three,
/// so that no loop can report progress and forget to be stoppable. Worker threads share one.
pub struct Meter<'a> {
    monitor: &'a Monitor<'a>,
    stage: StageId,
    done: AtomicU64,
    total: Option<u64>,
}

impl Meter<'_> {
    /// Adds a batch.
    ///
    /// # Errors
    /// [`Cancelled`] once the caller has raised the flag.
    pub fn add(&self, records: u64) -> Result<(), Cancelled> {
        let before = self.done.fetch_add(records, Ordering::Relaxed);
        if self.monitor.cancel.is_raised() {
            return Err(Cancelled(self.stage));
        }
        let done = before + records;
        if before / STEP != done / STEP {
            self.monitor.observer.on(&Event::Advanced { stage: self.stage, done });
        }
        Ok(())
    }

    /// Records counted so far.
    #[must_use]
    pub fn done(&self) -> u64 {
        self.done.load(Ordering::Relaxed)
    }

    /// Ends the pass. It may have visited less than its total: a header counts the records that
    /// a reader leaves out, too.
    pub fn finish(self) {
        let done = self.done();
        debug_assert!(self.total.is_none_or(|total| done <= total), "{}", self.stage);
        self.monitor.observer.on(&Event::Finished { stage: self.stage, done });
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::*;

    #[test]
    fn events_are_few_monotone_and_complete() {
        let seen = Mutex::new(Vec::new());
        let observer = |event: &Event| seen.lock().unwrap().push(event.clone());
        let monitor = Monitor { observer: &observer, cancel: Cancel::default() };
        let meter = monitor.meter(StageId::Sort, Some(300_000));
        for _ in 0..3000 {
            meter.add(100).unwrap();
        }
        meter.finish();
        let seen = seen.into_inner().unwrap();
        assert!(matches!(seen[0], Event::Started { total: Some(300_000), .. }));
        assert!(matches!(seen[seen.len() - 1], Event::Finished { done: 300_000, .. }));
        assert_eq!(seen.len(), 2 + 4);
    }

    #[test]
    fn a_raised_flag_stops_the_next_batch() {
        let monitor = Monitor::silent();
        let meter = monitor.meter(StageId::Sort, Some(2));
        meter.add(1).unwrap();
        monitor.cancel.raise();
        assert_eq!(meter.add(1), Err(Cancelled(StageId::Sort)));
    }
}
