//! How far points are from a surface of any size: the points wait in memory, the surface passes
//! by, once for as many points as fit.
//!
//! Nothing of the surface is kept, and no answer depends on what part of it was at hand: the
//! nearest triangle is found wherever it lies.

use std::sync::{Mutex, PoisonError};

use super::{block::Block, queries::Queries, survey::Surface};
use crate::{
    error::Result,
    geometry::PointTree,
    progress::{Meter, Monitor, StageId},
    soup::{Pass, Scratch, Vertex},
    storage::{Budget, Reservation},
};

/// A surface that points are measured against, with a tree of some of its vertices.
pub struct Target<'s, 'a, V> {
    pub(super) surface: &'s Surface<'a, V>,
    picks: PointTree,
    _room: Reservation,
}

/// Points that are worked on at least, whatever the memory.
const POINTS_MIN: u64 = 1 << 12;
/// Share of what memory is left that points may take.
const POINTS_SHARE: f64 = 0.9;

impl<'s, 'a, V: Vertex> Target<'s, 'a, V> {
    /// Makes a surface ready. It has triangles.
    #[must_use]
    pub fn new(surface: &'s Surface<'a, V>, budget: &Budget) -> Self {
        assert!(surface.triangles > 0, "a surface without triangles is near to nothing");
        let count = surface.picks.len() as u64;
        let room = budget.reserve_share(0.0, count * PointTree::BYTES_PER_POINT);
        let picks: Vec<_> = surface.picks.iter().map(|pick| pick.map(f64::from)).collect();
        Self { surface, picks: PointTree::new(&picks), _room: room }
    }
}

/// The distances of `points` from the nearest point of a surface, in their order. The points are
/// relative to the origin of the surface.
///
/// A point as near as `enough` is not followed further: its distance is then not greater than
/// `enough`, and may be less than what is returned. With 0 all distances are exact (to the last bits
/// of double precision), and the same for any memory and number of threads.
///
/// Takes a pass over the surface for as many points as fit in the memory that is left, and the
/// distances beside them.
///
/// # Errors
/// What reading the surface fails with, or cancellation.
pub fn distances<V: Vertex>(
    points: &[[f64; 3]],
    target: &Target<'_, '_, V>,
    enough: f64,
    budget: &Budget,
    monitor: &Monitor,
) -> Result<Vec<f64>> {
    let mut distances = Vec::with_capacity(points.len());
    while distances.len() < points.len() {
        let left = &points[distances.len()..];
        let bytes = (budget.available_bytes() as f64 * POINTS_SHARE) as u64;
        let bytes_per_point = Queries::BYTES_PER_POINT + size_of::<f64>() as u64;
        let count = (bytes / bytes_per_point).max(POINTS_MIN).min(left.len() as u64);
        let _room = budget.reserve_share(0.0, count * bytes_per_point);
        let queries = Queries::new(&left[..count as usize], &target.picks, enough);
        if !queries.are_done() {
            pass_by(target.surface, &queries, budget, monitor)?;
        }
        distances.extend(queries.finish());
    }
    Ok(distances)
}

/// Takes all triangles of a surface past the points.
fn pass_by<V: Vertex>(
    surface: &Surface<V>,
    queries: &Queries,
    budget: &Budget,
    monitor: &Monitor,
) -> Result<()> {
    let meter = monitor.meter(StageId::Compare, surface.source.amount());
    let pass = surface.source.pass();
    let failed = Mutex::new(Ok(()));
    rayon::scope(|scope| {
        for _ in 0..budget.threads() {
            scope.spawn(|_| {
                if let Err(error) = offer_share(&pass, queries, &meter) {
                    *failed.lock().unwrap_or_else(PoisonError::into_inner) = Err(error);
                }
            });
        }
    });
    failed.into_inner().unwrap_or_else(PoisonError::into_inner)?;
    meter.finish();
    Ok(())
}

/// One thread's share of a pass.
fn offer_share<V: Vertex>(pass: &Pass<'_, V>, queries: &Queries, meter: &Meter) -> Result<()> {
    let mut scratch = Scratch::default();
    let mut block = Block::default();
    while let Some(taken) = pass.next(&mut scratch)? {
        block.add(taken.triangles);
        if block.is_full() {
            block.offer_to(queries);
        }
        meter.add(taken.records)?;
    }
    block.offer_to(queries);
    Ok(())
}
