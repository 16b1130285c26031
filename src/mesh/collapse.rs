//! Edge collapses: the cheapest that is legal.

use glam::Vec3;

use super::{
    State,
    metric::{Candidate, Memory, Metric},
    ring::Wing,
    surface::{Mesh, NONE},
};

/// Cosine of the largest angle a collapse may turn a face by, squared: a little over 75 degrees.
/// Measured by the prototype of the design: less lets folds through, more refuses too much.
const TURN_COSINE_SQ: f32 = 0.0625;

/// Collapses tried at a vertex before it is left until its ring changes.
const TRIES_MAX: usize = 3;

impl<M: Metric> Mesh<M> {
    /// Finds the cheapest legal collapse that removes `vertex`, costing less than `cost_limit`,
    /// and leaves the vertex's ring in `ring`. Without one, sets the vertex's cost: what the
    /// cheapest would cost, or infinite when those tried are illegal.
    #[inline]
    pub(super) fn best_collapse(
        &mut self,
        vertex: u32,
        cost_limit: f32,
        ring: &mut Vec<Wing>,
    ) -> Option<Candidate> {
        ring.clear();
        ring.extend_from_slice(self.rings.of(vertex));
        M::prepare(self, vertex);
        let mut tried = [NONE; TRIES_MAX];
        for slot in 0..TRIES_MAX {
            let best = M::cheapest(self, vertex, ring, &tried[..slot]);
            let Some(best) = best.filter(|best| best.cost < cost_limit) else {
                self.costs[vertex as usize] = best.map_or(f32::INFINITY, |best| best.cost);
                return None;
            };
            if self.is_legal(vertex, &best, ring) {
                return Some(best);
            }
            tried[slot] = best.kept;
        }
        self.costs[vertex as usize] = f32::INFINITY;
        None
    }

    /// Cost of the cheapest collapse that removes `vertex`, legal or not.
    #[inline]
    pub(super) fn cheapest_cost(&mut self, vertex: u32) -> f32 {
        M::prepare(self, vertex);
        self.prepared_cost(vertex)
    }

    /// As [`Self::cheapest_cost`], of a vertex that is prepared.
    #[inline]
    pub(super) fn prepared_cost(&self, vertex: u32) -> f32 {
        let best = M::cheapest(self, vertex, self.rings.of(vertex), &[]);
        best.map_or(f32::INFINITY, |best| best.cost)
    }
}

impl<M: Memory> Mesh<M> {
    /// Whether collapsing `removed`, whose ring is given, into `kept` keeps the surface what it
    /// is: the link condition, no face turned over `[WK03 §4.3]`.
    pub(super) fn is_legal(&self, removed: u32, best: &Candidate, ring: &[Wing]) -> bool {
        let kept = best.kept;
        let is_inner = self.states[removed as usize] == State::INNER;
        let apexes = apexes(ring, kept);
        let shared = apexes.iter().filter(|apex| **apex != NONE).count();
        if shared != if is_inner { 2 } else { 1 } {
            return false;
        }
        // The last face of a piece of surface.
        if ring.len() == 1 && self.rings.count(kept) == 1 {
            return false;
        }
        if self.states[kept as usize].has(State::FROZEN)
            && !self.is_alone_frozen(ring, kept, apexes)
        {
            return false;
        }
        self.keeps_faces_up(removed, kept, ring, best.to)
            && self.links_apart(removed, kept, ring, apexes)
            && (!M::MOVES_KEPT || self.keeps_faces_up(kept, removed, self.rings.of(kept), best.to))
    }

    /// Edges between two frozen vertices may exist where we cannot see: no collapse may make one.
    fn is_alone_frozen(&self, ring: &[Wing], kept: u32, apexes: [u32; 2]) -> bool {
        ring.iter().flat_map(|wing| [wing.next, wing.prev]).all(|other| {
            other == kept
                || apexes.contains(&other)
                || !self.states[other as usize].has(State::FROZEN)
        })
    }

    /// Whether the faces of `ring`, that of `vertex`, look the way they did when `vertex` moves;
    /// those that `other` shares will be gone.
    #[inline]
    fn keeps_faces_up(&self, vertex: u32, other: u32, ring: &[Wing], to: Vec3) -> bool {
        let from = self.position(vertex);
        ring.iter().all(|wing| {
            wing.has(other)
                || stays_up(self.position(wing.next), self.position(wing.prev), from, to)
        })
    }

    /// The link condition: removed and kept have no neighbour in common but the apexes of the
    /// faces they share, and no face would come to lie on another.
    #[inline]
    fn links_apart(&self, removed: u32, kept: u32, ring: &[Wing], apexes: [u32; 2]) -> bool {
        self.rings.of(kept).iter().all(|wing| {
            if wing.has(removed) {
                return true;
            }
            let (is_next, is_prev) = (apexes.contains(&wing.next), apexes.contains(&wing.prev));
            !(is_next && is_prev)
                && (is_next || !has(ring, wing.next))
                && (is_prev || !has(ring, wing.prev))
        })
    }
}

/// Whether a face of the ring has this vertex.
#[inline]
fn has(ring: &[Wing], vertex: u32) -> bool {
    // No early end: this way the compiler compares several at once.
    ring.iter().fold(false, |found, wing| found | wing.has(vertex))
}

/// The third vertices of the ring's faces at `kept`: two of a closed fan, one of an open one.
/// The same apex twice counts as none.
#[inline]
pub(super) fn apexes(ring: &[Wing], kept: u32) -> [u32; 2] {
    let mut found = [NONE; 2];
    for wing in ring {
        if wing.next == kept {
            found[0] = wing.prev;
        } else if wing.prev == kept {
            found[1] = wing.next;
        }
    }
    if found[0] == found[1] { [NONE; 2] } else { found }
}

/// Whether the face over the edge from `u` to `w` still looks the same way, roughly, when its
/// third vertex moves. A face without area looks no way, and may become any.
#[inline]
fn stays_up(u: Vec3, w: Vec3, from: Vec3, to: Vec3) -> bool {
    let edge = w - u;
    let (before, after) = ((u - from).cross(edge), (u - to).cross(edge));
    let dot = before.dot(after);
    let (before_sq, after_sq) = (before.length_squared(), after.length_squared());
    (dot > 0.0 && dot * dot > TURN_COSINE_SQ * before_sq * after_sq)
        || (before_sq == 0.0 && after_sq > 0.0)
}
