//! Triangles in the order of a sweep `[WK03 §1]`, see [`SweepKey`](crate::soup::SweepKey).
//!
//! Two ways to the same order, byte by byte. A stream that is nearly sorted is put in order as it
//! passes, within a window in memory; any other is sorted, on disk where it does not fit. What is
//! sorted is the soup: an indexed mesh is dereferenced as it is read.

mod batch;
mod record;
#[cfg(test)]
mod tests;
mod window;

use serde::{Deserialize, Serialize};

use crate::{
    error::Result,
    external::sort::{self, Engine, Sorter},
    formats::Findings,
    geometry::{Bounds, MAXIMA_DEFAULT},
    progress::{Monitor, StageId},
    soup::{
        Minima, OrderMeter, Point, Source, SweepAxis, Taken, Triangle, Vertex, for_each_in_order,
    },
    storage::Workspace,
};

use batch::Batch;
use record::SweepRecord;
use window::Window;

/// What presort needs to know.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// The axis to sort along.
    pub axis: SweepAxis,
    /// How.
    pub method: Method,
    /// Bytes of memory to hold, reserved by the caller; buffers of some batches lie beside it.
    pub memory_bytes: u64,
    /// What [`Method::Sort`] is called in the journal of the workspace, and what was found meanwhile.
    /// Only if the source gives the same triangles in the same order to a run that goes on.
    pub steps: Option<Steps>,
}

/// What the sort of a job is called.
pub const STEPS: Steps = Steps { sorted: "sorted", found: "sorted: found" };

/// Names in a journal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Steps {
    /// The sorted triangles.
    pub sorted: &'static str,
    /// What the pass over the source found.
    pub found: &'static str,
}

/// How to sort. The result is the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// In passing: the stream is at most so many triangles late along the axis, as
    /// [`measure_order`] measures it or somebody promises. Fits when [`window_bytes`] do; where so
    /// many triangles tie that more must wait than fits, the rest is sorted as by [`Self::Sort`].
    Absorb {
        /// How many triangles the worst one is late.
        displacement_max: u64,
    },
    /// In memory when it fits, on disk when not.
    Sort,
}

/// What presort did.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Outcome {
    /// Triangles passed on.
    pub triangles: u64,
    /// How many triangles the worst one was late, if all were absorbed.
    pub displacement_max: Option<u64>,
    /// Triangles that waited in the window at most; 0 when there was none.
    pub held_max: u64,
    /// Triangles did not fit in memory and were sorted on disk.
    pub on_disk: bool,
    /// What the pass over the source found.
    pub findings: Findings,
}

/// Bytes of memory that absorbing takes, ties apart.
#[must_use]
pub fn window_bytes<V: Vertex>(displacement_max: u64) -> u64 {
    window::triangles_max(displacement_max).saturating_mul(waiting_bytes::<V>())
}

/// Bytes of a triangle that waits: itself, and a share of a batch that has partly gone.
fn waiting_bytes<V: Vertex>() -> u64 {
    let record_bytes = size_of::<SweepRecord<V>>() as u64;
    record_bytes + record_bytes / 4
}

/// Bytes of memory in which so many triangles are sorted without the disk.
#[must_use]
pub fn sort_bytes<V: Vertex>(triangles: u64) -> u64 {
    // Two bytes for the number of a bucket, twice, and one for the records that divide unevenly.
    triangles.saturating_mul(2 * size_of::<SweepRecord<V>>() as u64 + 5)
}

/// Bytes on disk of a triangle that is being sorted.
#[must_use]
pub fn disk_bytes_per_triangle(colored: bool) -> u64 {
    let plain = size_of::<SweepRecord<Point>>() as u64;
    plain + if colored { 12 } else { 0 }
}

/// Passes all triangles of `source` to `sink` in the order of
/// [`SweepKey`](crate::soup::SweepKey), in batches of any size.
///
/// One pass over the source, on all threads; `sink` runs on the calling one. Memory:
/// [`Config::memory_bytes`]. Temporary disk: none, or about the size of the triangles, see
/// [`Method`].
///
/// # Errors
/// What reading the source fails with, [`Error::NotSorted`](crate::Error::NotSorted) when a
/// triangle is later than was promised and can no longer be passed on in order, a full disk,
/// cancellation, and what `sink` returns.
pub fn presort<V: Vertex>(
    source: &Source<V>,
    config: &Config,
    workspace: &Workspace,
    monitor: &Monitor,
    sink: impl FnMut(&[Triangle<V>]) -> Result<()>,
) -> Result<Outcome> {
    let sort = sort::Config {
        stage: StageId::Sort,
        memory_bytes: config.memory_bytes,
        engine: Engine::Auto,
        step: None,
    };
    let sorter = || Sorter::<SweepRecord<V>>::new(&sort, workspace, monitor);
    // What another run has begun to sort is sorted to its end.
    let is_begun = config.steps.is_some_and(|steps| workspace.is_noted(steps.sorted));
    let method = if is_begun { Method::Sort } else { config.method };
    let mut sink = Sink { axis: config.axis, triangles: 0, batch: Vec::new(), to: sink };
    let outcome = match method {
        Method::Absorb { displacement_max } => {
            let mut stream = Stream {
                window: Window::new(config.axis, displacement_max),
                held_max: (config.memory_bytes / waiting_bytes::<V>()) as usize,
                overflow: None,
            };
            let fill = |taken: &Taken<'_, V>, batch: &mut Batch<V>| {
                batch.fill(taken.triangles, config.axis);
            };
            let findings = pass(source, (workspace, monitor), fill, |batch| {
                stream.take(batch, &sorter, &mut sink)
            })?;
            stream.finish(findings, &mut sink)?
        }
        Method::Sort => {
            let sort = sort::Config { step: config.steps.map(|steps| steps.sorted), ..sort };
            let mut sorter = Sorter::<SweepRecord<V>>::noted(&sort, workspace, monitor)?;
            let convert = |taken: &Taken<'_, V>, records: &mut Vec<SweepRecord<V>>| {
                records.clear();
                let all = taken.triangles.iter();
                records.extend(all.map(|triangle| SweepRecord::new(triangle, config.axis)));
            };
            let found = config.steps.map(|steps| steps.found).filter(|_| sorter.is_filled());
            let findings = match found.and_then(|step| workspace.recall::<Findings>(step)) {
                Some(found) => found.figures,
                None => {
                    pass(source, (workspace, monitor), convert, |records| sorter.push(records))?
                }
            };
            if let Some(steps) = config.steps {
                workspace.note(steps.found, &findings, Vec::new())?;
            }
            let on_disk = sorter.is_on_disk();
            sorter.finish_into(|records| sink.pass_on(records))?;
            Outcome { triangles: 0, displacement_max: None, held_max: 0, on_disk, findings }
        }
    };
    Ok(Outcome { triangles: sink.triangles, ..outcome })
}

/// Passes over the source: `make` works on all threads, what it made is handed to `take` in order.
fn pass<V: Vertex, T: Default + Send>(
    source: &Source<V>,
    (workspace, monitor): (&Workspace, &Monitor),
    make: impl Fn(&Taken<'_, V>, &mut T) + Sync,
    take: impl FnMut(&mut T) -> Result<()>,
) -> Result<Findings> {
    let meter = monitor.meter(StageId::Sort, source.amount());
    let findings = for_each_in_order(source, &meter, workspace.budget(), make, take)?;
    meter.finish();
    Ok(findings)
}

/// Where sorted records go: as triangles again, to the caller's sink.
struct Sink<V, S> {
    axis: SweepAxis,
    triangles: u64,
    batch: Vec<Triangle<V>>,
    to: S,
}

/// Triangles of a batch for the sink: they stay in the cache while they are turned back.
const BATCH_TRIANGLES: usize = 1 << 13;

impl<V: Vertex, S: FnMut(&[Triangle<V>]) -> Result<()>> Sink<V, S> {
    fn pass_on(&mut self, records: &[SweepRecord<V>]) -> Result<()> {
        self.triangles += records.len() as u64;
        for records in records.chunks(BATCH_TRIANGLES) {
            self.batch.clear();
            self.batch.extend(records.iter().map(|record| record.triangle(self.axis)));
            (self.to)(&self.batch)?;
        }
        Ok(())
    }
}

/// A stream being put in order.
struct Stream<'a, V: Vertex> {
    window: Window<V>,
    /// Above so many, what waits goes to the sorter.
    held_max: usize,
    /// Sorts what waits and all the rest, once the window is too small.
    overflow: Option<Sorter<'a, SweepRecord<V>>>,
}

impl<'a, V: Vertex> Stream<'a, V> {
    fn take(
        &mut self,
        batch: &mut Batch<V>,
        sorter: &impl Fn() -> Sorter<'a, SweepRecord<V>>,
        sink: &mut Sink<V, impl FnMut(&[Triangle<V>]) -> Result<()>>,
    ) -> Result<()> {
        self.window.check(&batch.least)?;
        if let Some(overflow) = &mut self.overflow {
            return overflow.push(&batch.records);
        }
        self.window.take(batch, |records| sink.pass_on(records))?;
        if self.window.held() > self.held_max {
            let sorter = self.overflow.insert(sorter());
            self.window.give_up(|records| sorter.push(records))?;
        }
        Ok(())
    }

    fn finish(
        mut self,
        findings: Findings,
        sink: &mut Sink<V, impl FnMut(&[Triangle<V>]) -> Result<()>>,
    ) -> Result<Outcome> {
        let (held_max, found) = (self.window.held_max as u64, self.window.displacement_found());
        let displacement_max = self.overflow.is_none().then_some(found);
        let on_disk = self.overflow.as_ref().is_some_and(Sorter::is_on_disk);
        if let Some(overflow) = self.overflow {
            overflow.finish_into(|records| sink.pass_on(records))?;
        } else {
            self.window.finish(|records| sink.pass_on(records))?;
        }
        Ok(Outcome { triangles: 0, displacement_max, held_max, on_disk, findings })
    }
}

/// How the triangles of a source are ordered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Order {
    /// Along each axis, how many triangles the worst one is late by its least coordinate, see
    /// [`OrderMeter::displacement_max`].
    pub displacement_max: [u64; 3],
    /// Triangles there are.
    pub triangles: u64,
}

/// Measures how far the triangles of `source` are from sorted, and counts them. Those that
/// `is_chosen` are returned, too, in their order. One pass, on all threads; memory for the chosen
/// ones.
///
/// # Errors
/// What reading the source fails with, cancellation.
pub fn measure_order<V: Vertex>(
    source: &Source<V>,
    workspace: &Workspace,
    monitor: &Monitor,
    is_chosen: impl Fn(&Triangle<V>) -> bool + Sync,
) -> Result<(Order, Vec<Triangle<V>>)> {
    let meter = monitor.meter(StageId::Measure, source.amount());
    let mut order = OrderMeter::new(MAXIMA_DEFAULT);
    let look = |taken: &Taken<'_, V>, batch: &mut Measured<V>| {
        batch.minima.fill(taken.triangles, &mut batch.bounds);
        batch.count = taken.triangles.len() as u64;
        let chosen = taken.triangles.iter().filter(|triangle| is_chosen(triangle));
        batch.chosen.extend(chosen);
    };
    let (mut triangles, mut chosen) = (0, Vec::new());
    for_each_in_order(source, &meter, workspace.budget(), look, |batch| {
        order.add(&batch.minima);
        triangles += batch.count;
        chosen.append(&mut batch.chosen);
        Ok(())
    })?;
    meter.finish();
    Ok((Order { displacement_max: order.displacement_max(), triangles }, chosen))
}

/// What a thread measures of a batch.
struct Measured<V> {
    minima: Minima,
    bounds: Bounds,
    count: u64,
    chosen: Vec<Triangle<V>>,
}

impl<V> Default for Measured<V> {
    fn default() -> Self {
        Self { minima: Minima::default(), bounds: Bounds::default(), count: 0, chosen: Vec::new() }
    }
}
