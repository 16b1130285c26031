//! One round of a recording: the cheapest collapses that leave each other alone.

use glam::Vec3;
use rayon::prelude::*;

use super::{
    FAN_FACES_MAX, Recording,
    record::{Collapse, known, steps},
};
use crate::mesh::{
    Mesh, Metric, State,
    collapse::apexes,
    metric::Candidate,
    ring::Wing,
    surface::{NONE, UNKNOWN},
};

/// Share of the vertices that are candidates of a round. Chosen by hand: fewer make more batches, each
/// with a head and columns of its own, more come away from the order of cost.
const SHARE: f64 = 0.09;

/// A round that does less than this share of its candidates is followed by one with twice as many.
const FEW: usize = 8;

/// Vertices whose costs are computed together, on all threads: what that takes meanwhile is bounded.
const TOGETHER: usize = 1 << 17;

/// Times the cheapest are chosen: costs that are computed anew make others the cheapest.
const LOOKS: usize = 2;

/// Collapses tried at a vertex before it is left until its ring changes.
const TRIES_MAX: usize = 3;

/// Rounds under way.
pub(super) struct Round<M: Metric> {
    pub(super) mesh: Mesh<M>,
    /// Vertices that are left, and may have to be looked at.
    left: Vec<u32>,
    /// By vertex, the cost that was computed last, perhaps before its surroundings changed;
    /// [`UNKNOWN`] before any was.
    last: Vec<f32>,
    /// By vertex, the last round in which it was near a removed one: neither removed nor kept in it
    /// any more.
    near_removed: Vec<u32>,
    /// By vertex, the last round in which it was near a kept one: not removed in it any more.
    near_kept: Vec<u32>,
    number: u32,
    share: f64,
    /// The largest coordinate.
    largest: f32,
    order: Vec<(u32, u32)>,
    /// Vertices whose costs are computed.
    stale: Vec<u32>,
    ring: Vec<Wing>,
}

impl<M: Metric> Round<M> {
    pub(super) fn new(mesh: Mesh<M>, bits: u32) -> Self {
        let vertices = mesh.spots.len();
        Self {
            left: (0..vertices as u32).collect(),
            last: vec![UNKNOWN; vertices],
            near_removed: vec![0; vertices],
            near_kept: vec![0; vertices],
            number: 0,
            share: SHARE,
            largest: ((1_u32 << bits) - 1) as f32,
            order: Vec::new(),
            stale: Vec::new(),
            ring: Vec::new(),
            mesh,
        }
    }

    /// Does a round, but does not go below `faces`; returns whether there will be another.
    pub(super) fn run(&mut self, faces: usize, recording: &mut Recording) -> bool {
        self.number += 1;
        if !self.rank_candidates(faces) {
            return false;
        }
        let candidates = std::mem::take(&mut self.order);
        let limit = candidates.last().map_or(0.0, |(bits, _)| f32::from_bits(*bits).next_up());
        let before = recording.collapses.len();
        for &(_, vertex) in &candidates {
            if self.mesh.faces_left <= faces {
                break;
            }
            if self.near_removed[vertex as usize] == self.number
                || self.near_kept[vertex as usize] == self.number
            {
                continue;
            }
            if let Some(best) = self.best(vertex, limit) {
                self.collapse(vertex, &best, recording);
            }
        }
        let done = recording.collapses.len() - before;
        if done > 0 {
            recording.rounds.push(recording.collapses.len());
        }
        let is_few = done < candidates.len() / FEW;
        self.share = if is_few { (2.0 * self.share).min(1.0) } else { SHARE };
        self.order = candidates;
        true
    }

    /// Lists the cheapest vertices behind the bits of their costs, in the order of the costs.
    ///
    /// What has changed since its cost was computed has mostly become dearer: it is looked at again
    /// once the old cost is among the cheapest. Returns whether there is any left.
    fn rank_candidates(&mut self, faces: usize) -> bool {
        let Self { mesh, left, last, order, stale, .. } = self;
        order.clear();
        stale.clear();
        left.retain(|vertex| mesh.is_removable(*vertex));
        for &vertex in &*left {
            let (cost, last) = (mesh.costs[vertex as usize], &mut last[vertex as usize]);
            if cost != UNKNOWN {
                *last = cost;
            } else if *last == UNKNOWN || !last.is_finite() {
                stale.push(vertex);
            }
        }
        look_again(mesh, stale, last);
        let ranked = left.iter().map(|vertex| (last[*vertex as usize], *vertex));
        let finite = ranked.filter(|(cost, _)| cost.is_finite());
        order.extend(finite.map(|(cost, vertex)| (cost.to_bits(), vertex)));
        // Near the end a round would take too much, and not the cheapest.
        let surplus = mesh.faces_left - faces;
        let wanted = ((order.len() as f64 * self.share) as usize).min(surplus).max(1);
        for _ in 0..LOOKS {
            if wanted < order.len() {
                order.select_nth_unstable(wanted);
            }
            stale.clear();
            let chosen = order.iter().take(wanted).map(|(_, vertex)| *vertex);
            stale.extend(chosen.filter(|vertex| mesh.costs[*vertex as usize] == UNKNOWN));
            stale.sort_unstable();
            look_again(mesh, stale, last);
            for (bits, vertex) in order.iter_mut().take(wanted) {
                *bits = last[*vertex as usize].to_bits();
            }
        }
        let is_any = !order.is_empty();
        order.truncate(wanted);
        order.retain(|(bits, _)| f32::from_bits(*bits).is_finite());
        order.sort_unstable();
        is_any
    }

    /// The cheapest collapse of a vertex that is legal and can be recorded, if it costs less than
    /// `limit`. One that waits for another round leaves the cost as it is.
    fn best(&mut self, vertex: u32, limit: f32) -> Option<Candidate> {
        self.ring.clear();
        self.ring.extend_from_slice(self.mesh.rings.of(vertex));
        M::prepare(&mut self.mesh, vertex);
        let mut tried = [NONE; TRIES_MAX];
        for slot in 0..TRIES_MAX {
            let best = M::cheapest(&self.mesh, vertex, &self.ring, &tried[..slot]);
            let Some(best) = best.filter(|best| best.cost < limit) else {
                self.mesh.costs[vertex as usize] = best.map_or(f32::INFINITY, |best| best.cost);
                return None;
            };
            let to = best.to.round().clamp(Vec3::ZERO, Vec3::splat(self.largest));
            let best = Candidate { to, ..best };
            if self.can_be_recorded(vertex, best.kept)
                && self.mesh.is_legal(vertex, &best, &self.ring)
            {
                let is_free = self.near_removed[best.kept as usize] != self.number;
                return is_free.then_some(best);
            }
            tried[slot] = best.kept;
        }
        self.mesh.costs[vertex as usize] = f32::INFINITY;
        None
    }

    /// Whether the kept vertex has one fan that a split can begin with, and no vertex loses its last
    /// face.
    fn can_be_recorded(&self, removed: u32, kept: u32) -> bool {
        let Mesh { states, rings, .. } = &self.mesh;
        let is_fan =
            states[kept as usize] == State::INNER || states[kept as usize] == State::BOUNDARY;
        let stays = |apex: u32| apex == NONE || rings.count(apex) > 1;
        is_fan
            && rings.count(removed) + rings.count(kept) <= FAN_FACES_MAX
            && apexes(&self.ring, kept).into_iter().all(stays)
    }

    fn collapse(&mut self, removed: u32, best: &Candidate, recording: &mut Recording) {
        let (kept, mesh) = (best.kept, &mut self.mesh);
        for wing in &self.ring {
            self.near_removed[wing.next as usize] = self.number;
            self.near_removed[wing.prev as usize] = self.number;
        }
        for wing in mesh.rings.of(kept) {
            self.near_kept[wing.next as usize] = self.number;
            self.near_kept[wing.prev as usize] = self.number;
        }
        let color = |mesh: &Mesh<M>, vertex: u32| mesh.colors[vertex as usize].mean();
        let is_colored = !mesh.colors.is_empty();
        let colors = is_colored.then(|| (color(mesh, kept), color(mesh, removed)));
        recording.collapses.push(Collapse {
            removed,
            kept,
            apexes: apexes(&self.ring, kept).map(known),
            places: [steps(mesh.position(kept)), steps(best.to)],
        });
        mesh.collapse(removed, best, &self.ring);
        mesh.costs[kept as usize] = UNKNOWN;
        debug_assert_eq!(
            mesh.position(kept),
            best.to,
            "a metric that moves vertices moves this one"
        );
        if let Some((before, gone)) = colors {
            recording.colors.push([before, color(&self.mesh, kept), gone]);
        }
    }
}

/// Computes the costs of some vertices.
fn look_again<M: Metric>(mesh: &mut Mesh<M>, vertices: &[u32], last: &mut [f32]) {
    for vertices in vertices.chunks(TOGETHER) {
        M::prepare_all(mesh, vertices);
        let cost = |vertex: &u32| {
            let best = M::cheapest(mesh, *vertex, mesh.rings.of(*vertex), &[]);
            best.map_or(f32::INFINITY, |best| best.cost)
        };
        let costs: Vec<f32> = vertices.par_iter().with_min_len(1 << 9).map(cost).collect();
        for (vertex, cost) in vertices.iter().zip(costs) {
            mesh.costs[*vertex as usize] = cost;
            last[*vertex as usize] = cost;
        }
    }
}
