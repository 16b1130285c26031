//! What is left of neighbouring slabs, joined and decimated by one threshold for all of the mesh.
//!
//! The threshold is known only when all slabs are done. Groups of them then go on in parallel;
//! that leaves little to the last mesh, which one thread has to finish.

use std::collections::HashSet;

use rayon::prelude::*;

use super::slab::Decimated;
use crate::{
    mesh::{Limit, Mesh, Metric, Patch, sweep_blocks},
    soup::{SweepAxis, SweepPlace},
};

/// Slabs of a group: their interfaces become a fourth, and groups enough are left for all threads.
const GROUP_SLABS: usize = 4;

/// Part of the surplus of faces that groups are to take away. The rest goes in the order of its
/// cost, from all of the mesh; and the threshold is guessed.
const SURPLUS_SHARE: f64 = 0.75;

/// Joins each few slabs, in order, and brings all together near `faces` faces.
pub(super) fn decimate<M: Metric>(
    slabs: Vec<Decimated<M>>,
    axis: SweepAxis,
    faces: usize,
) -> Vec<Patch<M>> {
    let left: usize = slabs.iter().map(|slab| slab.patch.faces.len()).sum();
    let surplus = left.saturating_sub(faces);
    if slabs.len() < 2 || surplus == 0 {
        return slabs.into_iter().map(|slab| slab.patch).collect();
    }
    let share = surplus as f64 * SURPLUS_SHARE / left as f64;
    let mut costs: Vec<f32> = slabs.iter().flat_map(|slab| &slab.costs).copied().collect();
    let Some(cost) = at_rank(&mut costs, share) else {
        return slabs.into_iter().map(|slab| slab.patch).collect();
    };
    let limit = Limit { cost, share: 0.0, faces: 0 };
    let mut slabs = slabs.into_iter();
    let groups = std::iter::from_fn(|| {
        let group: Vec<Decimated<M>> = slabs.by_ref().take(GROUP_SLABS).collect();
        (!group.is_empty()).then_some(group)
    });
    let groups: Vec<Vec<Decimated<M>>> = groups.collect();
    groups.into_par_iter().map(|group| decimate_group(group, axis, &limit)).collect()
}

fn decimate_group<M: Metric>(group: Vec<Decimated<M>>, axis: SweepAxis, limit: &Limit) -> Patch<M> {
    let bits = |position: &[f32; 3]| position.map(|c| (c + 0.0).to_bits());
    let front: HashSet<[u32; 3]> =
        group.first().into_iter().flat_map(|slab| &slab.front).map(bits).collect();
    let until = group.last().and_then(|slab| slab.until);
    let is_shared = |position: [f32; 3]| {
        front.contains(&bits(&position))
            || until.is_some_and(|until| SweepPlace::of(position, axis) >= until)
    };
    let patches = group.into_iter().map(|slab| slab.patch).collect();
    let mut mesh = Mesh::of_decimated(Patch::join(patches, is_shared));
    sweep_blocks(&mut mesh, limit);
    mesh.into_patch()
}

/// The cost that a share of all costs lie below.
fn at_rank(costs: &mut [f32], share: f64) -> Option<f32> {
    let rank = (costs.len() as f64 * share) as usize;
    if rank >= costs.len() {
        return None;
    }
    let (_, cost, _) = costs.select_nth_unstable_by(rank, f32::total_cmp);
    Some(*cost)
}
