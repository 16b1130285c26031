//! One slab: from triangles to what is left of them.

use super::cutter::Slab;
use crate::{
    mesh::{Limit, Mesh, Metric, Patch, sweep_blocks, weld},
    soup::{SweepAxis, SweepPlace, Vertex},
};

/// What is left of a slab.
pub(super) struct Decimated<M: Metric> {
    pub(super) index: u64,
    /// Its frozen vertices are the shared ones.
    pub(super) patch: Patch<M>,
    /// What it would cost to remove some of its vertices.
    pub(super) costs: Vec<f32>,
    /// As of the slab.
    pub(super) front: Vec<[f32; 3]>,
    /// As of the slab.
    pub(super) until: Option<SweepPlace>,
    pub(super) degenerate: u64,
}

/// Of each so many vertices one is asked for its cost: a thousand of a slab.
const COST_STEP: usize = 128;

/// Decimates a slab to `limit`; vertices that have faces in other slabs stay.
pub(super) fn decimate<V: Vertex, M: Metric>(
    slab: Slab<V>,
    axis: SweepAxis,
    (limit, unit): (&Limit, f32),
) -> Decimated<M> {
    let Slab { index, triangles, front, until } = slab;
    let mut welded = weld(&triangles);
    drop(triangles);
    let mut shared: Vec<u32> = front.iter().filter_map(|p| welded.find(*p)).collect();
    if let Some(until) = until {
        let positions = welded.patch.positions.iter().zip(0..);
        let is_open = |position: &glam::Vec3| SweepPlace::of(position.to_array(), axis) >= until;
        shared.extend(positions.filter(|(p, _)| is_open(p)).map(|(_, vertex)| vertex));
    }
    shared.sort_unstable();
    shared.dedup();
    let degenerate = welded.degenerate;
    welded.patch.shared = shared;
    welded.patch.unit = unit;
    let mut mesh = Mesh::of_original(welded.into_patch());
    sweep_blocks(&mut mesh, limit);
    let costs = mesh.sample_costs(COST_STEP);
    Decimated { index, patch: mesh.into_patch(), costs, front, until, degenerate }
}
