//! Threshold sweeps: block after block, collapse whatever costs less than a threshold that rises.
//!
//! A block is a stretch of vertices in memory, small enough for the cache. All its sweeps are done
//! before the next block is begun; that is where the speed comes from. One threshold for all
//! blocks spreads the error as a global greedy decimation would.

use super::{
    metric::Metric,
    ring::Wing,
    surface::{Mesh, UNKNOWN},
};

/// The first vertex of the block that a vertex is in.
#[inline]
pub(super) fn block_start(vertex: u32) -> u32 {
    vertex & !(BLOCK_VERTICES as u32 - 1)
}

/// When to leave a block.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limit {
    /// No collapse costs this or more, in the unit of the metric.
    pub cost: f32,
    /// A block is not brought below this share of its vertices.
    pub share: f64,
    /// The mesh is not brought below this number of faces.
    pub faces: usize,
}

/// Vertices of a block: with their rings and quadrics they fill a second-level cache of 1 MiB.
const BLOCK_VERTICES: usize = 1 << 13;

/// The first threshold of a block is guessed from one in so many of its vertices. Without effect on
/// the error: the costs of the others are looked for when they are needed.
const FIRST_SAMPLE: usize = 8;

/// At the last threshold, sweeps go on while they collapse more than this share of the vertices.
const REST_SHARE: usize = 200;

/// Decimates all blocks of a mesh to a limit.
pub fn sweep_blocks<M: Metric>(mesh: &mut Mesh<M>, limit: &Limit) {
    sweep_blocks_while(mesh, limit, &mut |_| true);
}

/// Decimates all blocks of a mesh to a limit, as long as `go_on`, which is told after each block how
/// many faces have gone in it, says so; returns whether it did to the end.
pub fn sweep_blocks_while<M: Metric>(
    mesh: &mut Mesh<M>,
    limit: &Limit,
    go_on: &mut dyn FnMut(usize) -> bool,
) -> bool {
    let mut block = Vec::with_capacity(BLOCK_VERTICES);
    let mut ring = Vec::new();
    let vertices = mesh.spots.len();
    let mut start = 0;
    while start < vertices {
        let end = (start + BLOCK_VERTICES).min(vertices);
        // A rest of a block is done with the last whole one.
        let end = if vertices - end < BLOCK_VERTICES / 2 { vertices } else { end };
        block.clear();
        block.extend((start as u32..end as u32).filter(|vertex| mesh.rings.count(*vertex) > 0));
        let before = mesh.faces_left;
        sweep_block(mesh, &mut block, limit, &mut ring);
        start = end;
        if !go_on(before - mesh.faces_left) {
            return false;
        }
        if mesh.faces_left <= limit.faces {
            break;
        }
    }
    true
}

fn sweep_block<M: Metric>(
    mesh: &mut Mesh<M>,
    block: &mut Vec<u32>,
    limit: &Limit,
    ring: &mut Vec<Wing>,
) {
    let least = (block.len() as f64 * limit.share) as usize;
    block.retain(|vertex| mesh.is_removable(*vertex));
    let mut threshold = first_threshold(mesh, block).min(limit.cost);
    loop {
        let before = block.len();
        let budget = before.saturating_sub(least);
        let collapsed = sweep(mesh, block, threshold, (budget, limit.faces), ring);
        if collapsed > 0 {
            block.retain(|vertex| mesh.rings.count(*vertex) > 0);
        }
        let is_last = threshold >= limit.cost;
        if collapsed >= budget
            || mesh.faces_left <= limit.faces
            || (is_last && collapsed * REST_SHARE <= before)
            || (!threshold.is_finite())
        {
            return;
        }
        threshold = (threshold * M::STEP).min(limit.cost);
    }
}

/// Collapses each vertex of the block that costs less than `threshold`, until `budget` vertices
/// are gone or few enough faces are left.
fn sweep<M: Metric>(
    mesh: &mut Mesh<M>,
    block: &[u32],
    threshold: f32,
    (budget, faces_least): (usize, usize),
    ring: &mut Vec<Wing>,
) -> usize {
    let mut collapsed = 0;
    for &vertex in block {
        if mesh.costs[vertex as usize] >= threshold {
            continue;
        }
        let Some(best) = mesh.best_collapse(vertex, threshold, ring) else { continue };
        mesh.collapse(vertex, &best, ring);
        collapsed += 1;
        if collapsed >= budget || mesh.faces_left <= faces_least {
            break;
        }
    }
    collapsed
}

impl<M: Metric> Mesh<M> {
    /// The cost of removing a vertex, computed if need be.
    #[inline]
    pub(super) fn known_cost(&mut self, vertex: u32) -> f32 {
        if self.costs[vertex as usize] == UNKNOWN {
            self.costs[vertex as usize] = self.cheapest_cost(vertex);
        }
        self.costs[vertex as usize]
    }
}

/// A threshold to begin with.
fn first_threshold<M: Metric>(mesh: &mut Mesh<M>, block: &[u32]) -> f32 {
    let mut costs = Vec::with_capacity(block.len() / FIRST_SAMPLE + 1);
    for &vertex in block.iter().step_by(FIRST_SAMPLE) {
        let cost = mesh.known_cost(vertex);
        if cost.is_finite() {
            costs.push(cost);
        }
    }
    if costs.is_empty() {
        return f32::INFINITY;
    }
    let rank = costs.len() / M::FIRST_SHARE;
    let (_, cost, _) = costs.select_nth_unstable_by(rank, f32::total_cmp);
    cost.max(f32::MIN_POSITIVE)
}
