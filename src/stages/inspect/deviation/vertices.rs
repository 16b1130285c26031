//! The vertices of a surface, looked at for the greatest distance only.
//!
//! Most are so near to a sample whose distance is known that they cannot be farther away than the
//! farthest of the samples. What is left is measured like any other point.

use glam::DVec3;

use super::{
    nearest::{Target, distances},
    queries::Queries,
    survey::{Surface, mixed},
};
use crate::{
    error::Result,
    geometry::PointTree,
    progress::{Monitor, StageId},
    soup::{Taken, Vertex, for_each_in_order},
    storage::{Budget, Reservation},
};

/// Points with known distances, which say of points near them that they are not far away.
pub(super) struct Cover {
    tree: PointTree,
    /// By place in the tree.
    distances: Vec<f64>,
    _room: Reservation,
}

/// Bytes a point takes in a cover.
pub(super) const COVER_BYTES_PER_POINT: u64 = PointTree::BYTES_PER_POINT + 8;

/// The greatest distance at a vertex.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Farthest {
    pub(super) distance: f64,
    /// In the coordinates of the target.
    pub(super) at: [f64; 3],
}

/// Vertices of a batch that may be farther away than any sample.
#[derive(Default)]
struct Doubtful {
    points: Vec<[f64; 3]>,
    /// Vertices looked at lately: each comes several times, mostly soon.
    recent: Vec<[u32; 3]>,
}

/// Vertices remembered; a power of two.
const RECENT: usize = 1 << 12;
/// One in so many vertices of a batch is asked about first, and all of them if at least one in
/// [`NEAR_SHARE`] of those is near a sample that says enough. Chosen by hand.
const ASKED_STEP: usize = 16;
const NEAR_SHARE: usize = 3;
/// Bits of no number that is finite.
const NO_VERTEX: [u32; 3] = [u32::MAX; 3];
/// Share of what memory is left that vertices may take, while they wait and are measured.
const WAITING_SHARE: f64 = 0.8;
const WAITING_MIN: u64 = 1 << 12;
/// A bound is raised by this before it is trusted: it was rounded.
const BOUND_SLACK: f64 = 1.0 + 1e-12;

impl Cover {
    /// Of points in the coordinates of the target, with their distances.
    pub(super) fn new(points: &[[f64; 3]], distances: &[f64], budget: &Budget) -> Self {
        let room = budget.reserve_share(0.0, points.len() as u64 * COVER_BYTES_PER_POINT);
        let tree = PointTree::new(points);
        let distances = tree.order().iter().map(|index| distances[*index as usize]).collect();
        Self { tree, distances, _room: room }
    }

    /// Whether `point` is certainly no farther away than `distance`. `hint` is where to look first;
    /// it becomes where this one was found.
    fn is_within(&self, point: [f64; 3], distance: f64, hint: &mut usize) -> bool {
        let bound = |between_sq: f64, place: usize| {
            (between_sq.sqrt() + self.distances[place]) * BOUND_SLACK <= distance
        };
        let between = DVec3::from_array(self.tree.points()[*hint]) - DVec3::from_array(point);
        if bound(between.length_squared(), *hint) {
            return true;
        }
        let found = self.tree.nearest(point, *hint);
        *hint = found.place;
        bound(found.distance_sq, found.place)
    }
}

/// The vertex of `from` that is farthest from `target`, if it is farther than `floor`. Of equals
/// the least by its coordinates: the same for any memory, number of threads, and order.
///
/// A pass over `from`, and one over the target for as many vertices as fit.
///
/// # Errors
/// What reading the surfaces fails with, or cancellation.
pub(super) fn farthest_vertex<V: Vertex>(
    from: &Surface<V>,
    target: &Target<'_, '_, V>,
    (cover, floor): (&Cover, f64),
    budget: &Budget,
    monitor: &Monitor,
) -> Result<Option<Farthest>> {
    let bytes_per_point = 24 + Queries::BYTES_PER_POINT + 16;
    let share = (budget.available_bytes() as f64 * WAITING_SHARE) as u64 / bytes_per_point;
    let waiting_max = share.max(WAITING_MIN) as usize;
    let mut room = budget.reserve_share(0.0, 0);
    let shift = shift(from, target);
    let mut waiting: Vec<[f64; 3]> = Vec::new();
    let mut farthest: Option<Farthest> = None;
    let mut measure = |waiting: &mut Vec<[f64; 3]>| -> Result<()> {
        let distances = distances(waiting, target, floor, budget, monitor)?;
        for (at, distance) in waiting.drain(..).zip(distances) {
            let is_farther = farthest.is_none_or(|known| {
                distance > known.distance || (distance == known.distance && at < known.at)
            });
            if distance > floor && is_farther {
                farthest = Some(Farthest { distance, at });
            }
        }
        Ok(())
    };
    let meter = monitor.meter(StageId::Sample, from.source.amount());
    let look = |taken: &Taken<'_, V>, doubtful: &mut Doubtful| {
        doubtful.look(taken, shift, |point, hint| cover.is_within(point, floor, hint));
    };
    for_each_in_order(from.source, &meter, budget, look, |doubtful| {
        for points in doubtful.points.chunks(waiting_max) {
            if waiting.len() + points.len() > waiting_max {
                measure(&mut waiting)?;
            }
            waiting.extend_from_slice(points);
            let bytes = waiting.capacity() as u64 * 24;
            if bytes > room.bytes() {
                room.absorb(budget.reserve_share(0.0, bytes - room.bytes()));
            }
        }
        Ok(())
    })?;
    meter.finish();
    measure(&mut waiting)?;
    Ok(farthest)
}

/// What is added to positions of `from` to make them relative to the origin of `target`.
pub(super) fn shift<V>(from: &Surface<V>, target: &Target<'_, '_, V>) -> DVec3 {
    DVec3::from_array(from.origin) - DVec3::from_array(target.surface.origin)
}

impl Doubtful {
    /// Takes the vertices of a batch, in place of those before, that `is_near` does not hold for; or
    /// all of them where it seldom holds, since asking costs nearly as much as measuring.
    fn look<V: Vertex>(
        &mut self,
        taken: &Taken<'_, V>,
        shift: DVec3,
        is_near: impl Fn([f64; 3], &mut usize) -> bool,
    ) {
        self.points.clear();
        self.recent.clear();
        self.recent.resize(RECENT, NO_VERTEX);
        for vertex in taken.triangles.iter().flat_map(|triangle| &triangle.0) {
            let position = vertex.position();
            let bits = position.map(f32::to_bits);
            let [a, b, c] = bits.map(u64::from);
            let slot = mixed(a ^ b << 24 ^ c << 40) as usize % RECENT;
            if self.recent[slot] != bits {
                self.recent[slot] = bits;
                let point = DVec3::from_array(position.map(f64::from)) + shift;
                self.points.push(point.to_array());
            }
        }
        let mut hint = 0;
        let asked = self.points.iter().step_by(ASKED_STEP);
        let near = asked.clone().filter(|point| is_near(**point, &mut hint)).count();
        if near * NEAR_SHARE >= asked.count() {
            self.points.retain(|point| !is_near(*point, &mut hint));
        }
    }
}
