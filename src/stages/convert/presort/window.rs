//! The order made in passing: triangles wait in memory until none can come that precedes them.
//!
//! A stream that is at most `displacement_max` triangles late brings, after `n` triangles, none
//! below the greatest of the least coordinates of all but the last `displacement_max` of them.
//! What lies strictly below that *floor* is sorted and passed on; what ties with it waits,
//! because its ties may still come. So the order is right for ties of any number, whatever the
//! blocks the stream comes in.

use std::collections::VecDeque;

use super::record::SweepRecord;
use crate::{
    error::{Error, Result},
    external::sort_parallel,
    geometry::{Lateness, MAXIMA_DEFAULT},
    soup::{SweepAxis, Vertex},
};

/// Triangles that are looked at together, at least: the sort of so many is worth two threads, and
/// their 1.3 MB still lie in the cache. Measured: a quarter of it takes 10 % longer, and four times
/// as many 10 %.
pub(super) const STEP_TRIANGLES_MIN: u64 = 1 << 15;

/// The triangles that wait.
pub(super) struct Window<V> {
    axis: SweepAxis,
    displacement_max: u64,
    /// Triangles taken between two looks at what can go.
    step: u64,
    held: Vec<SweepRecord<V>>,
    /// Of each step not further back than the displacement, and the one before: the triangles
    /// taken at its end, and the greatest of their least coordinates.
    tops: VecDeque<(u64, f32)>,
    /// Nothing below may come any more.
    floor: f32,
    taken: u64,
    top: f32,
    looked_at: u64,
    lateness: Lateness,
    /// The least coordinates of a batch.
    keys: Vec<f32>,
    /// Most triangles held at a time.
    pub(super) held_max: u64,
}

impl<V: Vertex> Window<V> {
    pub(super) fn new(axis: SweepAxis, displacement_max: u64) -> Self {
        Self {
            axis,
            displacement_max,
            step: step(displacement_max),
            held: Vec::new(),
            tops: VecDeque::new(),
            floor: f32::NEG_INFINITY,
            taken: 0,
            top: f32::NEG_INFINITY,
            looked_at: 0,
            lateness: Lateness::new(MAXIMA_DEFAULT),
            keys: Vec::new(),
            held_max: 0,
        }
    }

    /// Notes the next triangles, without taking them.
    ///
    /// # Errors
    /// [`Error::NotSorted`] when one is later than what waits could make up for.
    pub(super) fn check(&mut self, records: &[SweepRecord<V>]) -> Result<()> {
        self.keys.clear();
        self.keys.extend(records.iter().map(SweepRecord::least));
        let late = self.keys.iter().position(|key| *key < self.floor);
        self.lateness.add(&self.keys[..late.unwrap_or(records.len())]);
        let Some(late) = late else {
            self.top = self.keys.iter().fold(self.top, |top, key| top.max(*key));
            self.taken += records.len() as u64;
            return Ok(());
        };
        Err(Error::NotSorted {
            axis: self.axis.name(),
            triangle: self.taken + late as u64,
            late_by: self.lateness.late_by(self.keys[late]),
            late_by_max: self.displacement_max,
        })
    }

    /// Takes triangles that [`Self::check`] has noted. Moves those that can go to `ready`, which
    /// is empty, in order.
    pub(super) fn take(&mut self, records: &[SweepRecord<V>], ready: &mut Vec<SweepRecord<V>>) {
        self.held.extend_from_slice(records);
        self.held_max = self.held_max.max(self.held.len() as u64);
        if self.taken - self.looked_at < self.step {
            return;
        }
        self.looked_at = self.taken;
        self.tops.push_back((self.taken, self.top));
        let settled = self.taken.saturating_sub(self.displacement_max);
        let mut floor = self.floor;
        while let Some((end, top)) = self.tops.front()
            && *end <= settled
        {
            floor = *top;
            self.tops.pop_front();
        }
        if floor > self.floor {
            self.floor = floor;
            self.release(ready);
        }
    }

    /// Moves what lies below the floor to `ready`, in order.
    fn release(&mut self, ready: &mut Vec<SweepRecord<V>>) {
        let floor = self.floor;
        ready.extend(self.held.extract_if(.., |record| record.least() < floor));
        sort_parallel(ready);
    }

    /// Gives up what waits, in order of the input.
    pub(super) fn give_up(&mut self) -> Vec<SweepRecord<V>> {
        std::mem::take(&mut self.held)
    }

    /// Triangles that wait.
    pub(super) fn held(&self) -> usize {
        self.held.len()
    }

    /// How many triangles the worst one was late so far.
    pub(super) fn displacement_found(&self) -> u64 {
        self.lateness.displacement_max()
    }
}

/// Triangles between two looks: with half as many as may be late, each is looked at three times.
fn step(displacement_max: u64) -> u64 {
    (displacement_max / 2).max(STEP_TRIANGLES_MIN)
}

/// Triangles that a window holds at most, ties apart.
pub(super) fn triangles_max(displacement_max: u64) -> u64 {
    // Two steps: one under way, and one that is settled but for its end.
    displacement_max.saturating_add(2 * step(displacement_max)).saturating_add(STEP_TRIANGLES_MIN)
}
