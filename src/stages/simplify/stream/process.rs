//! READ, DECIMATE and WRITE on a window of fixed size `[WK03 §4.1]`.

use super::{Config, Target, resolution::Resolution};
use crate::{
    error::{Error, Result},
    mesh::{self, Choice, Decimated, Window},
    progress::{Meter, Monitor, StageId},
    soup::{SweepPlace, Triangle, Vertex, smallest_corner},
};

/// The stream between its two ends.
pub(super) struct Stream<'a, V> {
    config: &'a Config,
    monitor: &'a Monitor<'a>,
    meter: &'a Meter<'a>,
    pub(super) window: Window,
    choice: Choice,
    pub(super) resolution: Resolution,
    pub(super) counts: Counts,
    /// Released, and not yet passed on.
    out: Vec<Triangle<V>>,
}

/// What was counted on the way.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Counts {
    /// Times the window was full.
    pub(super) rounds: u64,
    /// Most faces at `P_ab` when the window was full.
    pub(super) front_max: u64,
    /// Faces written while the stream was under way.
    pub(super) early: u64,
    /// Those of them that were not next to `P_bc`.
    pub(super) inside: u64,
    /// Faces written before they were coarse enough, because nothing else would make room.
    pub(super) forced: u64,
}

/// Where released triangles go.
pub(super) type Sink<'a, V> = dyn FnMut(&[Triangle<V>]) -> Result<()> + 'a;

/// Of a full window, this share at least must become room; a window that is larger is tried before
/// triangles are written that are not coarse enough. Chosen by hand: half of what READ wants.
const ROOM_SHARE: usize = 4;
/// A window of which less than this share becomes room will not do.
const ROOM_SHARE_LEAST: usize = 32;
/// What [`Error::Resource`] names.
const FRONT: &str = "a window for the front of the mesh";
/// Faces removed between two looks whether the job is cancelled.
const SLICE_FACES: usize = 1 << 15;

impl<'a, V: Vertex> Stream<'a, V> {
    pub(super) fn new(config: &'a Config, monitor: &'a Monitor<'a>, meter: &'a Meter<'a>) -> Self {
        let ratio = match config.target {
            Target::Ratio(ratio) => ratio,
            Target::Count { triangles, of } => triangles as f64 / of.max(1) as f64,
        };
        Self {
            config,
            monitor,
            meter,
            window: Window::new(config.axis, config.window_triangles),
            choice: Choice::new(config.choices as usize, config.seed),
            resolution: Resolution { ratio, read: 0, written: 0 },
            counts: Counts::default(),
            out: Vec::new(),
        }
    }

    /// Takes triangles in the order of their places; released ones go to `sink`.
    pub(super) fn push(
        &mut self,
        mut triangles: &[Triangle<V>],
        sink: &mut Sink<'_, V>,
    ) -> Result<()> {
        while let Some(first) = triangles.first() {
            if self.window.is_full() {
                self.make_room(smallest_corner(first, self.config.axis).1, sink)?;
            }
            let taken = self.window.append(triangles);
            self.resolution.read += taken as u64;
            self.meter.add(taken as u64)?;
            triangles = &triangles[taken..];
        }
        Ok(())
    }

    /// One round of the loop: DECIMATE and WRITE, until half of a full window is room.
    fn make_room(&mut self, floor: SweepPlace, sink: &mut Sink<'_, V>) -> Result<()> {
        self.window.settle(Some(floor));
        self.counts.rounds += 1;
        let front = self.window.front_faces();
        self.counts.front_max = self.counts.front_max.max(front as u64);
        let full = self.window.mesh.faces_left();
        let step = self.resolution.step(full);
        self.decimate(step.decimate_to)?;
        let wanted = self.resolution.in_core_wanted();
        let surplus = self.window.mesh.faces_left().saturating_sub(step.write_to);
        self.write(surplus.min(wanted), sink)?;
        let most = full - full / ROOM_SHARE;
        if self.window.mesh.faces_left() > most && !self.grow() {
            // Better a finer piece than no result.
            let before = self.resolution.written;
            let surplus = self.window.mesh.faces_left() - step.write_to;
            self.write(surplus, sink)?;
            self.counts.forced += self.resolution.written - before;
        }
        self.window.compact();
        let is_stuck = self.window.mesh.faces_left() > full - full / ROOM_SHARE_LEAST;
        if is_stuck && self.window.is_nearly_full() {
            return Err(self.front_too_large(front));
        }
        Ok(())
    }

    /// Doubles the window, as far as it may grow.
    fn grow(&mut self) -> bool {
        let faces_max = self.window.faces_max();
        let larger = (2 * faces_max).min(self.config.window_triangles_max);
        if larger > faces_max {
            self.window.grow(larger);
        }
        larger > faces_max
    }

    fn front_too_large(&self, front: usize) -> Error {
        // The window must hold the front and as much again, and the front is still growing.
        let triangles = (4 * front).max(2 * self.window.faces_max()) as u64;
        Error::Resource {
            what: FRONT,
            needed_bytes: super::budget_bytes::<V>(triangles).max(2 * self.config.budget_bytes),
            available_bytes: self.config.budget_bytes,
        }
    }

    fn decimate(&mut self, faces: usize) -> Result<Decimated> {
        let mesh = &mut self.window.mesh;
        while mesh.faces_left() > faces + 1 {
            let slice = faces.max(mesh.faces_left().saturating_sub(SLICE_FACES));
            if self.choice.decimate(mesh, slice) == Decimated::Stuck {
                return Ok(Decimated::Stuck);
            }
            self.monitor.check(StageId::Decimate)?;
        }
        Ok(Decimated::Reached)
    }

    fn write(&mut self, faces: usize, sink: &mut Sink<'_, V>) -> Result<()> {
        let mut left = faces;
        while left > 0 {
            let slice = left.min(SLICE_FACES);
            self.out.clear();
            let mesh = &mut self.window.mesh;
            let released = mesh::release(mesh, slice, &mut self.choice, &mut self.out);
            self.resolution.written += released.faces as u64;
            self.counts.early += released.faces as u64;
            self.counts.inside += released.inside as u64;
            sink(&self.out)?;
            self.monitor.check(StageId::Decimate)?;
            if released.faces < slice {
                break;
            }
            left -= slice;
        }
        Ok(())
    }

    /// Brings what is left to the exact count and writes it: the concluding phase. Returns the
    /// count that was asked for, and whether more are left because nothing legal was.
    pub(super) fn conclude(&mut self, sink: &mut Sink<'_, V>) -> Result<(u64, bool)> {
        self.window.settle(None);
        self.window.compact();
        let target = match self.config.target {
            Target::Ratio(ratio) => (ratio * self.resolution.read as f64).round() as u64,
            Target::Count { triangles, .. } => triangles,
        };
        let target = target.max(1);
        let left = target.saturating_sub(self.resolution.written) as usize;
        self.decimate(left)?;
        let mesh = &mut self.window.mesh;
        // The last odd one, and what chance does not find.
        let finished = mesh::finish(mesh, left);
        self.resolution.written += finished.faces as u64;
        mesh::release_all(mesh, |triangles| sink(triangles))?;
        Ok((target, self.resolution.written > target))
    }
}
