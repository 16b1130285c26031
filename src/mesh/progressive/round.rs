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
    pieces::pieces,
    ring::Wing,
    surface::{NONE, UNKNOWN},
};

/// Share of the vertices that are candidates of a round. Measured on igea and bunnyct: with 0.09 the
/// beginning of a file is a tenth worse and the file 4 % larger; 0.4 gains 1 %, and takes longer.
const SHARE: f64 = 0.25;

/// A round that does less than this share of its candidates is followed by one with twice as many.
const FEW: usize = 8;

/// Times the cheapest are chosen: costs that are computed anew make others the cheapest.
const LOOKS: usize = 2;

/// Vertices that one thread looks at one after the other.
const PIECE: usize = 1 << 9;

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
        let before = recording.collapses.len();
        self.collapse_some(&candidates, faces, recording);
        let done = recording.collapses.len() - before;
        if done > 0 {
            recording.rounds.push(recording.collapses.len());
        }
        let is_few = done < candidates.len() / FEW;
        self.share = if is_few { (2.0 * self.share).min(1.0) } else { SHARE };
        self.order = candidates;
        true
    }

    /// Lists the cheapest vertices behind the bits of their costs, in the order they are tried.
    ///
    /// What has changed since its cost was computed has mostly become dearer: it is looked at again
    /// once the old cost is among the cheapest. Returns whether there is any left.
    fn rank_candidates(&mut self, faces: usize) -> bool {
        let Self { mesh, left, last, order, .. } = self;
        let still = left
            .par_chunks(PIECE)
            .flat_map_iter(|some| some.iter().copied().filter(|vertex| mesh.is_removable(*vertex)));
        *left = still.collect();
        M::prepare_all(mesh, left);
        look_at(mesh, left, last, |last| !last.is_finite());
        let ranked = left.par_chunks(PIECE).flat_map_iter(|some| {
            let ranked = some.iter().map(|vertex| (last[*vertex as usize], *vertex));
            let finite = ranked.filter(|(cost, _)| cost.is_finite());
            finite.map(|(cost, vertex)| (cost.to_bits(), vertex))
        });
        *order = ranked.collect();
        // Near the end a round would take too much, and not the cheapest.
        let surplus = mesh.faces_left - faces;
        let wanted = ((order.len() as f64 * self.share) as usize).min(surplus).max(1);
        for _ in 0..LOOKS {
            if wanted < order.len() {
                order.select_nth_unstable(wanted);
            }
            let chosen = order.len().min(wanted);
            order[..chosen].par_sort_unstable_by_key(|(_, vertex)| *vertex);
            let vertices: Vec<u32> = order[..chosen].iter().map(|(_, vertex)| *vertex).collect();
            look_at(mesh, &vertices, last, |_| true);
            for (bits, vertex) in &mut order[..chosen] {
                *bits = last[*vertex as usize].to_bits();
            }
        }
        let is_any = !order.is_empty();
        order.truncate(wanted);
        order.retain(|(bits, _)| f32::from_bits(*bits).is_finite());
        // The cheaper half goes first; which of a half does matters less than that vertices near each
        // other in memory are looked at together.
        let half = order.len() / 2;
        if half > 0 {
            order.select_nth_unstable(half);
            let (cheaper, dearer) = order.split_at_mut(half);
            cheaper.par_sort_unstable_by_key(|(_, vertex)| *vertex);
            dearer.par_sort_unstable_by_key(|(_, vertex)| *vertex);
        }
        is_any
    }

    /// Does those collapses of some candidates that leave each other alone, but does not go below
    /// `faces`.
    fn collapse_some(
        &mut self,
        candidates: &[(u32, u32)],
        faces: usize,
        recording: &mut Recording,
    ) {
        let limit = candidates.iter().map(|(bits, _)| f32::from_bits(*bits)).fold(0.0, f32::max);
        let found = candidates.par_iter().with_min_len(PIECE);
        let found: Vec<_> = found.map(|(_, vertex)| self.best(*vertex, limit.next_up())).collect();
        for (&(_, vertex), best) in candidates.iter().zip(found) {
            if self.mesh.faces_left <= faces {
                break;
            }
            if self.is_near(&self.near_removed, vertex) || self.is_near(&self.near_kept, vertex) {
                continue;
            }
            match best {
                Ok(best) if self.is_near(&self.near_removed, best.kept) => {}
                Ok(best) => self.collapse(vertex, &best, recording),
                Err(cost) => self.mesh.costs[vertex as usize] = cost,
            }
        }
    }

    /// Whether a vertex is marked in this round.
    #[inline]
    fn is_near(&self, marks: &[u32], vertex: u32) -> bool {
        marks[vertex as usize] == self.number
    }

    /// The cheapest collapse of a vertex that is legal and can be recorded, if it costs less than
    /// `limit`; without one, what the vertex's cost is then.
    fn best(&self, vertex: u32, limit: f32) -> std::result::Result<Candidate, f32> {
        let ring = self.mesh.rings.of(vertex);
        let mut tried = [NONE; TRIES_MAX];
        for slot in 0..TRIES_MAX {
            let best = M::cheapest(&self.mesh, vertex, ring, &tried[..slot]);
            let Some(best) = best.filter(|best| best.cost < limit) else {
                return Err(best.map_or(f32::INFINITY, |best| best.cost));
            };
            let to = best.to.round().clamp(Vec3::ZERO, Vec3::splat(self.largest));
            let best = Candidate { to, ..best };
            if self.can_be_recorded(vertex, ring, best.kept)
                && self.mesh.is_legal(vertex, &best, ring)
            {
                return Ok(best);
            }
            tried[slot] = best.kept;
        }
        Err(f32::INFINITY)
    }

    /// Whether the kept vertex has one fan that a split can begin with, and no vertex loses its last
    /// face.
    fn can_be_recorded(&self, removed: u32, ring: &[Wing], kept: u32) -> bool {
        let Mesh { states, rings, .. } = &self.mesh;
        let is_fan =
            states[kept as usize] == State::INNER || states[kept as usize] == State::BOUNDARY;
        let stays = |apex: u32| apex == NONE || rings.count(apex) > 1;
        is_fan
            && rings.count(removed) + rings.count(kept) <= FAN_FACES_MAX
            && apexes(ring, kept).into_iter().all(stays)
    }

    /// Does a collapse that was legal when its round began, if it still is.
    fn collapse(&mut self, removed: u32, best: &Candidate, recording: &mut Recording) {
        let kept = best.kept;
        self.ring.clear();
        self.ring.extend_from_slice(self.mesh.rings.of(removed));
        // The removed vertex and its ring have not changed, but what is around those may have.
        if !self.can_be_recorded(removed, &self.ring, kept)
            || (self.is_near(&self.near_kept, kept)
                && !self.mesh.is_legal(removed, best, &self.ring))
        {
            return;
        }
        let mesh = &mut self.mesh;
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

/// Takes over the costs of ascending vertices, and computes those that are not known where the `last`
/// one asks for it.
fn look_at<M: Metric>(
    mesh: &mut Mesh<M>,
    vertices: &[u32],
    last: &mut [f32],
    is_asked: impl Fn(f32) -> bool + Sync,
) {
    let mut costs = std::mem::take(&mut mesh.costs);
    let of_last = pieces(vertices, last).into_par_iter();
    pieces(vertices, &mut costs).into_par_iter().zip(of_last).for_each(|(costs, lasts)| {
        for &vertex in costs.vertices {
            let place = (vertex - costs.first) as usize;
            let (cost, last) = (&mut costs.values[place], &mut lasts.values[place]);
            if *cost == UNKNOWN && (*last == UNKNOWN || is_asked(*last)) {
                let best = M::cheapest(mesh, vertex, mesh.rings.of(vertex), &[]);
                *cost = best.map_or(f32::INFINITY, |best| best.cost);
            }
            if *cost != UNKNOWN {
                *last = *cost;
            }
        }
    });
    mesh.costs = costs;
}
