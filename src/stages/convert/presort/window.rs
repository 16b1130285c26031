//! The order made in passing: triangles wait in memory until none can come that precedes them.
//!
//! A stream that is at most `displacement_max` triangles late brings, after `n` triangles, none
//! below the greatest of the least coordinates of all but the last `displacement_max` of them.
//! What lies strictly below that *floor* is passed on in order; what ties with it waits, because
//! its ties may still come. So the order is right for ties of any number, whatever the batches
//! the stream comes in.

use std::collections::VecDeque;

use super::{batch::Batch, record::SweepRecord};
use crate::{
    error::{Error, Result},
    external::{Keyed as _, waves},
    geometry::{Lateness, MAXIMA_DEFAULT},
    soup::{SweepAxis, Vertex},
};

/// Triangles between two looks at what can go, at least: one batch of most formats.
const STEP_TRIANGLES_MIN: u64 = 1 << 15;
/// Triangles merged together: with their copies, they stay in a second-level cache.
const PART_TRIANGLES: usize = 1 << 13;
/// One key in so many is looked at to cut what goes into parts of about equal size.
const SAMPLE_STEP: usize = 1 << 8;

/// The triangles that wait.
pub(super) struct Window<V> {
    axis: SweepAxis,
    displacement_max: u64,
    /// Triangles taken between two looks.
    step: u64,
    /// One a batch, in order of the input. None is empty.
    runs: VecDeque<Run<V>>,
    /// Of each step not further back than the displacement: the triangles taken at its end, and
    /// the greatest of the least coordinates up to there.
    tops: VecDeque<(u64, f32)>,
    /// Nothing below may come any more.
    floor: f32,
    taken: u64,
    /// The greatest of the least coordinates.
    top: f32,
    looked_at: u64,
    lateness: Lateness,
    held: usize,
    /// Most triangles held at a time.
    pub(super) held_max: usize,
    /// Memory of runs that have gone.
    spare: Vec<Vec<SweepRecord<V>>>,
}

/// What is left of a batch.
struct Run<V> {
    records: Vec<SweepRecord<V>>,
    /// Those before have gone.
    start: usize,
}

/// What goes, in one piece.
#[derive(Clone, Copy, Debug)]
enum Share {
    /// What lies below the floor.
    Settled,
    /// All of it: the stream has ended.
    All,
}

impl<V: Vertex> Window<V> {
    pub(super) fn new(axis: SweepAxis, displacement_max: u64) -> Self {
        Self {
            axis,
            displacement_max,
            step: step(displacement_max),
            runs: VecDeque::new(),
            tops: VecDeque::new(),
            floor: f32::NEG_INFINITY,
            taken: 0,
            top: f32::NEG_INFINITY,
            looked_at: 0,
            lateness: Lateness::new(MAXIMA_DEFAULT),
            held: 0,
            held_max: 0,
            spare: Vec::new(),
        }
    }

    /// Notes the next batch, without taking it.
    ///
    /// # Errors
    /// [`Error::NotSorted`] when a triangle is later than what waits could make up for.
    pub(super) fn check(&mut self, least: &[f32]) -> Result<()> {
        let late = least.iter().position(|key| *key < self.floor);
        self.lateness.add(&least[..late.unwrap_or(least.len())]);
        let Some(late) = late else {
            self.top = least.iter().fold(self.top, |top, key| if *key > top { *key } else { top });
            self.taken += least.len() as u64;
            return Ok(());
        };
        Err(Error::NotSorted {
            axis: self.axis.name(),
            triangle: self.taken + late as u64,
            late_by: self.lateness.late_by(least[late]),
            late_by_max: self.displacement_max,
        })
    }

    /// Takes a batch that [`Self::check`] has noted, and passes on what can go.
    pub(super) fn take(
        &mut self,
        batch: &mut Batch<V>,
        sink: impl FnMut(&[SweepRecord<V>]) -> Result<()>,
    ) -> Result<()> {
        if !batch.records.is_empty() {
            let room = self.spare.pop().unwrap_or_default();
            let records = std::mem::replace(&mut batch.records, room);
            self.held += records.len();
            self.held_max = self.held_max.max(self.held);
            self.runs.push_back(Run { records, start: 0 });
        }
        if self.taken - self.looked_at < self.step {
            return Ok(());
        }
        self.looked_at = self.taken;
        self.tops.push_back((self.taken, self.top));
        let settled = self.taken.saturating_sub(self.displacement_max);
        let before = self.floor;
        while let Some((end, top)) = self.tops.front()
            && *end <= settled
        {
            self.floor = *top;
            self.tops.pop_front();
        }
        if self.floor > before { self.release(Share::Settled, sink) } else { Ok(()) }
    }

    /// Passes on all that waits: the stream has ended.
    pub(super) fn finish(
        &mut self,
        sink: impl FnMut(&[SweepRecord<V>]) -> Result<()>,
    ) -> Result<()> {
        self.release(Share::All, sink)
    }

    /// Passes on a share of what waits: merged in parts, by ranges of the key, on all threads.
    fn release(
        &mut self,
        share: Share,
        mut sink: impl FnMut(&[SweepRecord<V>]) -> Result<()>,
    ) -> Result<()> {
        let floor = self.floor;
        let end = |run: &Run<V>| match share {
            Share::Settled => run.records.partition_point(|record| record.least() < floor),
            Share::All => run.records.len(),
        };
        let ends: Vec<usize> = self.runs.iter().map(end).collect();
        let pieces = self.runs.iter().zip(&ends).map(|(run, end)| &run.records[run.start..*end]);
        let pieces: Vec<&[SweepRecord<V>]> = pieces.filter(|piece| !piece.is_empty()).collect();
        let bounds = bounds(&pieces);
        let mut parts = 0..=bounds.len();
        waves::in_order(
            2 * rayon::current_num_threads(),
            || Ok(parts.next()),
            |part| Ok(merged(&pieces, &bounds, part)),
            |records| sink(&records),
        )?;
        for (run, end) in self.runs.iter_mut().zip(ends) {
            self.held -= end - run.start;
            run.start = end;
        }
        let spare = &mut self.spare;
        self.runs.retain_mut(|run| {
            let is_left = run.start < run.records.len();
            if !is_left {
                spare.push(std::mem::take(&mut run.records));
            }
            is_left
        });
        Ok(())
    }

    /// Gives up what waits.
    pub(super) fn give_up(
        &mut self,
        mut to: impl FnMut(&[SweepRecord<V>]) -> Result<()>,
    ) -> Result<()> {
        self.spare = Vec::new();
        self.held = 0;
        self.runs.drain(..).try_for_each(|run| to(&run.records[run.start..]))
    }

    /// Triangles that wait.
    pub(super) fn held(&self) -> usize {
        self.held
    }

    /// How many triangles the worst one was late so far.
    pub(super) fn displacement_found(&self) -> u64 {
        self.lateness.displacement_max()
    }
}

/// Keys that cut sorted pieces into parts of about [`PART_TRIANGLES`], in order.
fn bounds<V: Vertex>(pieces: &[&[SweepRecord<V>]]) -> Vec<u128> {
    let total: usize = pieces.iter().map(|piece| piece.len()).sum();
    let parts = total.div_ceil(PART_TRIANGLES);
    let keys = pieces.iter().flat_map(|piece| piece.iter().step_by(SAMPLE_STEP));
    let mut sample: Vec<u128> = keys.map(SweepRecord::key).collect();
    sample.sort_unstable();
    (1..parts).map(|part| sample[part * sample.len() / parts]).collect()
}

/// The records of one part, in order.
fn merged<V: Vertex>(
    pieces: &[&[SweepRecord<V>]],
    bounds: &[u128],
    part: usize,
) -> Vec<SweepRecord<V>> {
    let below = |piece: &[SweepRecord<V>], bound: u128| piece.partition_point(|r| r.key() < bound);
    let mut records = Vec::with_capacity(2 * PART_TRIANGLES);
    for piece in pieces {
        let start = part.checked_sub(1).map_or(0, |before| below(piece, bounds[before]));
        let end = bounds.get(part).map_or(piece.len(), |bound| below(piece, *bound));
        records.extend_from_slice(&piece[start..end]);
    }
    // The standard library's stable sort finds the sorted pieces and merges them.
    records.sort_by_key(SweepRecord::key);
    records
}

/// Triangles between two looks: with half as many as may be late, no more than twice as many wait.
fn step(displacement_max: u64) -> u64 {
    (displacement_max / 2).max(STEP_TRIANGLES_MIN)
}

/// Triangles that a window holds at most, ties apart.
pub(super) fn triangles_max(displacement_max: u64) -> u64 {
    // One step under way, longer by a batch at most; and if triangles are late, one that is settled
    // but for its end, longer likewise.
    let under_way = step(displacement_max) + STEP_TRIANGLES_MIN;
    let unsettled = if displacement_max == 0 { 0 } else { under_way };
    displacement_max.saturating_add(under_way + unsettled)
}
