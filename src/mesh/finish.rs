//! Brings a mesh to an exact number of faces.

use rayon::prelude::*;

use super::{
    Limit, State,
    metric::Metric,
    pieces::pieces,
    surface::{Mesh, UNKNOWN},
    sweep_blocks_while,
};
use crate::progress::{Cancelled, Meter};

/// What finishing came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Finished {
    /// Faces that are left.
    pub faces: usize,
    /// Whether no legal collapse is left, at any cost.
    pub is_stuck: bool,
}

/// Sweeps stop at this many times the wanted number of faces; the rest goes in order of cost.
const SWEEP_MARGIN: f64 = 1.06;

/// Largest part of the surplus that one round of sweeps takes away, so that the threshold, which
/// is extrapolated, is corrected on the way.
const ROUND_SHARE: f64 = 0.6;

/// Decimates `mesh` to `faces` faces, or one fewer where only two at a time can go.
pub fn finish<M: Metric>(mesh: &mut Mesh<M>, faces: usize) -> Finished {
    // One more: the last of an odd number must be chosen with care.
    mesh.know_costs();
    sweep_to(mesh, faces_swept_to(faces), faces + 1, &mut |_| true);
    let is_stuck = !collapse_in_order(mesh, faces);
    Finished { faces: mesh.faces_left, is_stuck }
}

/// As [`finish`], adding the faces that go to a meter.
///
/// # Errors
/// Cancellation, between two blocks.
pub fn finish_metered<M: Metric>(
    mesh: &mut Mesh<M>,
    faces: usize,
    meter: &Meter,
) -> Result<Finished, Cancelled> {
    let mut added = Ok(());
    let mut add = |gone: usize| {
        added = meter.add(gone as u64);
        added.is_ok()
    };
    mesh.know_costs();
    sweep_to(mesh, faces_swept_to(faces), faces + 1, &mut add);
    added?;
    let before = mesh.faces_left;
    let is_stuck = !collapse_in_order(mesh, faces);
    meter.add((before - mesh.faces_left) as u64)?;
    Ok(Finished { faces: mesh.faces_left, is_stuck })
}

/// What sweeps leave to be removed in the order of cost.
fn faces_swept_to(faces: usize) -> usize {
    (faces as f64 * SWEEP_MARGIN) as usize
}

/// Decimates `mesh` to about `faces` faces, and not below, by one threshold for all of it.
pub fn approach<M: Metric>(mesh: &mut Mesh<M>, faces: usize) {
    sweep_to(mesh, faces, faces, &mut |_| true);
}

/// Sweeps with thresholds that rise until `faces` are left, no collapse is, or `go_on` says no; never
/// goes below `least`.
fn sweep_to<M: Metric>(
    mesh: &mut Mesh<M>,
    faces: usize,
    least: usize,
    go_on: &mut dyn FnMut(usize) -> bool,
) {
    let mut cost = 0.0_f32;
    while mesh.faces_left > faces {
        let before = mesh.faces_left;
        let surplus = before - least.min(faces);
        let aim = (before - (surplus as f64 * ROUND_SHARE) as usize).max(faces);
        cost = guess_cost(mesh, aim).max(cost * 1.05).max(f32::MIN_POSITIVE);
        if !sweep_blocks_while(mesh, &Limit { cost, share: 0.0, faces: least }, go_on) {
            return;
        }
        if mesh.faces_left == before && !cost.is_finite() {
            break;
        }
        if mesh.faces_left == before {
            cost *= 2.0;
        }
    }
}

/// Vertices looked at to guess a threshold.
const SAMPLE_VERTICES: usize = 1 << 14;

/// The threshold at which about `aim` faces are left: as many vertices cost less now as must go,
/// and since each collapse makes its neighbours dearer, only some of those will.
fn guess_cost<M: Metric>(mesh: &mut Mesh<M>, aim: usize) -> f32 {
    let mut costs = mesh.sample_costs((mesh.spots.len() / SAMPLE_VERTICES).max(1));
    if costs.is_empty() {
        return f32::INFINITY;
    }
    let share = 1.0 - aim as f64 / mesh.faces_left as f64;
    let rank = ((costs.len() as f64 * share) as usize).min(costs.len() - 1);
    let (_, cost, _) = costs.select_nth_unstable_by(rank, f32::total_cmp);
    *cost
}

impl<M: Metric> Mesh<M> {
    /// Looks for all costs that are not known, on all threads.
    fn know_costs(&mut self) {
        let is_unknown =
            |vertex: &u32| self.costs[*vertex as usize] == UNKNOWN && self.is_removable(*vertex);
        let unknown: Vec<u32> =
            (0..self.costs.len() as u32).into_par_iter().filter(is_unknown).collect();
        M::prepare_all(self, &unknown);
        let mut costs = std::mem::take(&mut self.costs);
        pieces(&unknown, &mut costs).into_par_iter().for_each(|piece| {
            for &vertex in piece.vertices {
                piece.values[(vertex - piece.first) as usize] = self.prepared_cost(vertex);
            }
        });
        self.costs = costs;
    }

    /// What it costs to remove a vertex, for one of each `step` vertices; those that cannot be
    /// removed are passed over.
    #[must_use]
    pub fn sample_costs(&mut self, step: usize) -> Vec<f32> {
        let vertices = (0..self.spots.len() as u32).step_by(step);
        let removable: Vec<u32> = vertices.filter(|vertex| self.is_removable(*vertex)).collect();
        removable.into_iter().map(|vertex| self.known_cost(vertex)).collect()
    }
}

/// Collapses the cheapest vertices until `faces` are left; `false` when none can be collapsed any
/// more.
fn collapse_in_order<M: Metric>(mesh: &mut Mesh<M>, faces: usize) -> bool {
    let mut ring = Vec::new();
    let mut order = Vec::new();
    while mesh.faces_left > faces {
        let is_odd = mesh.faces_left == faces + 1;
        fill_order(mesh, is_odd.then_some(State::BOUNDARY), &mut order);
        if order.is_empty() && is_odd {
            // On a closed surface two go at a time.
            fill_order(mesh, None, &mut order);
        }
        if order.is_empty() {
            return false;
        }
        // More than are missing: some will have become dearer by then.
        let wanted = mesh.faces_left - faces;
        if wanted < order.len() {
            order.select_nth_unstable(wanted);
            order.truncate(wanted);
        }
        order.sort_unstable();
        let limit = order.last().map_or(0.0, |(bits, _)| f32::from_bits(*bits).next_up());
        for &(bits, vertex) in &order {
            let cost = f32::from_bits(bits);
            if mesh.faces_left <= faces || (mesh.faces_left == faces + 1 && !is_odd) {
                break;
            }
            let known = mesh.costs[vertex as usize];
            if mesh.rings.count(vertex) == 0 || (known != UNKNOWN && known > cost) {
                continue;
            }
            if let Some(best) = mesh.best_collapse(vertex, limit, &mut ring) {
                mesh.collapse(vertex, &best, &ring);
            }
        }
    }
    true
}

/// Lists the vertices that can be removed behind the bits of their costs, which are in the order
/// of the costs: all, or only those on a boundary, whose collapses take one face.
fn fill_order<M: Metric>(mesh: &mut Mesh<M>, only: Option<State>, order: &mut Vec<(u32, u32)>) {
    order.clear();
    mesh.know_costs();
    for vertex in 0..mesh.spots.len() as u32 {
        let is_wanted = only.is_none_or(|state| mesh.states[vertex as usize] == state);
        if is_wanted && mesh.is_removable(vertex) {
            let cost = mesh.costs[vertex as usize];
            if cost.is_finite() {
                order.push((cost.to_bits(), vertex));
            }
        }
    }
}
