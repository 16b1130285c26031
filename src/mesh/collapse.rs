//! Half-edge collapses: what they cost, and whether they are legal.

use glam::{Mat4, Vec3, Vec4};

use super::{
    State,
    classify::is_end,
    ring::Wing,
    surface::{Mesh, NONE},
};

/// Cosine of the largest angle a collapse may turn a face by, squared: a little over 75 degrees.
/// Measured by the prototype of the design: less lets folds through, more refuses too much.
const TURN_COSINE_SQ: f32 = 0.0625;

/// A collapse of a vertex into a neighbour.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    pub(super) kept: u32,
    pub(super) cost: f32,
}

/// Collapses tried at a vertex before it is left until its ring changes.
const TRIES_MAX: usize = 3;

impl Mesh {
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
        let mut tried = [NONE; TRIES_MAX];
        for slot in 0..TRIES_MAX {
            let best = self.cheapest(vertex, ring, &tried[..slot]);
            let Some(best) = best.filter(|best| best.cost < cost_limit) else {
                self.costs[vertex as usize] = best.map_or(f32::INFINITY, |best| best.cost);
                return None;
            };
            if self.is_legal(vertex, best.kept, ring) {
                return Some(best);
            }
            tried[slot] = best.kept;
        }
        self.costs[vertex as usize] = f32::INFINITY;
        None
    }

    /// Cost of the cheapest collapse that removes `vertex`, legal or not.
    #[inline]
    pub(super) fn cheapest_cost(&self, vertex: u32) -> f32 {
        let best = self.cheapest(vertex, self.rings.of(vertex), &[]);
        best.map_or(f32::INFINITY, |best| best.cost)
    }

    /// The neighbour that costs least to collapse into, except some.
    #[inline]
    fn cheapest(&self, vertex: u32, ring: &[Wing], except: &[u32]) -> Option<Candidate> {
        let is_inner = self.states[vertex as usize] == State::INNER;
        if is_inner && except.is_empty() && !ring.is_empty() {
            return self.cheapest_inside(vertex, ring);
        }
        let quadric = self.quadric(vertex);
        let from = self.position(vertex);
        let mut best = Candidate { kept: NONE, cost: f32::INFINITY };
        let mut consider = |other: u32| {
            let target = &self.spots[other as usize];
            let cost = quadric.at(target.position() - from) + target.error();
            if cost < best.cost && !except.contains(&other) {
                best = Candidate { kept: other, cost };
            }
        };
        if is_inner {
            for wing in ring {
                consider(wing.next);
            }
        } else {
            // Along the boundary only.
            for wing in ring {
                for other in [wing.next, wing.prev] {
                    if is_end(ring, other) {
                        consider(other);
                    }
                }
            }
        }
        best.cost = best.cost.max(0.0);
        (best.kept != NONE).then_some(best)
    }

    /// As [`Self::cheapest`] of a vertex inside the surface, four neighbours at a time.
    #[inline]
    fn cheapest_inside(&self, vertex: u32, ring: &[Wing]) -> Option<Candidate> {
        let quadric = self.quadric(vertex);
        let from = self.position(vertex);
        let mut best = Candidate { kept: NONE, cost: f32::INFINITY };
        for four in ring.chunks(4) {
            // The last neighbour stands in for those that are missing.
            let others: [u32; 4] = std::array::from_fn(|i| four[i.min(four.len() - 1)].next);
            let spots = others.map(|other| self.spots[other as usize].0);
            let [x, y, z, error] = transposed(spots);
            let (x, y, z) = (x - from.x, y - from.y, z - from.z);
            let costs = (quadric.at_four(x, y, z) + error).to_array();
            for (other, cost) in others.into_iter().zip(costs) {
                if cost < best.cost {
                    best = Candidate { kept: other, cost };
                }
            }
        }
        best.cost = best.cost.max(0.0);
        (best.kept != NONE).then_some(best)
    }

    /// Whether collapsing `removed`, whose ring is given, into `kept` keeps the surface what it
    /// is: the link condition, no face turned over `[WK03 §4.3]`.
    fn is_legal(&self, removed: u32, kept: u32, ring: &[Wing]) -> bool {
        let is_inner = self.states[removed as usize] == State::INNER;
        let apexes = apexes(ring, kept);
        let shared = apexes.iter().filter(|apex| **apex != NONE).count();
        if shared != if is_inner { 2 } else { 1 } {
            return false;
        }
        if self.states[kept as usize].has(State::FROZEN)
            && !self.is_alone_frozen(ring, kept, apexes)
        {
            return false;
        }
        self.keeps_faces_up(removed, kept, ring) && self.links_apart(removed, kept, ring, apexes)
    }

    /// Edges between two frozen vertices may exist where we cannot see: no collapse may make one.
    fn is_alone_frozen(&self, ring: &[Wing], kept: u32, apexes: [u32; 2]) -> bool {
        ring.iter().flat_map(|wing| [wing.next, wing.prev]).all(|other| {
            other == kept
                || apexes.contains(&other)
                || !self.states[other as usize].has(State::FROZEN)
        })
    }

    #[inline]
    fn keeps_faces_up(&self, removed: u32, kept: u32, ring: &[Wing]) -> bool {
        let (from, to) = (self.position(removed), self.position(kept));
        ring.iter().all(|wing| {
            wing.has(kept) || stays_up(self.position(wing.next), self.position(wing.prev), from, to)
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

#[inline]
fn transposed(rows: [Vec4; 4]) -> [Vec4; 4] {
    let columns = Mat4::from_cols(rows[0], rows[1], rows[2], rows[3]).transpose();
    [columns.x_axis, columns.y_axis, columns.z_axis, columns.w_axis]
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
fn apexes(ring: &[Wing], kept: u32) -> [u32; 2] {
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
