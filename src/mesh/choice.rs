//! DECIMATE: the best of a few random half-edges, again and again `[WK03 §4.3]` `[WK02]`.
//!
//! No queue, no global order: of a handful of candidates the one with the smallest quadric error
//! is collapsed.

use rand_xoshiro::{
    Xoshiro256PlusPlus,
    rand_core::{RngCore as _, SeedableRng as _},
};

use super::{
    ByQuadric, State,
    classify::is_end,
    metric::Candidate,
    ring::Wing,
    surface::{Mesh, NONE},
};

/// Draws candidates, and chooses among them.
pub struct Choice {
    dice: Xoshiro256PlusPlus,
    /// Candidates for each decision.
    choices: usize,
    candidates: Vec<HalfEdge>,
    ring: Vec<Wing>,
}

/// A collapse of one vertex into another.
#[derive(Clone, Copy, Debug)]
struct HalfEdge {
    removed: u32,
    into: Candidate,
}

/// How a decimation ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decimated {
    /// With the number of faces asked for, or one more.
    Reached,
    /// With more: chance finds hardly a collapse any more that is legal.
    Stuck,
}

/// Decisions in a row without a legal collapse before decimation is given up.
const MISSES_MAX: usize = 64;
/// Vertices looked at for one candidate, at most: most of them may be gone or on an interface.
const DRAWS_MAX: usize = 64;

impl Choice {
    /// Chooses among so many candidates, at least 1, drawn as `seed` says.
    #[must_use]
    pub fn new(choices: usize, seed: u64) -> Self {
        let dice = Xoshiro256PlusPlus::seed_from_u64(seed);
        Self { dice, choices: choices.max(1), candidates: Vec::new(), ring: Vec::new() }
    }

    /// Candidates for each decision.
    pub(super) fn choices(&self) -> usize {
        self.choices
    }

    /// A number below `count`, which is not 0.
    #[inline]
    pub(super) fn below(&mut self, count: usize) -> usize {
        // The upper half of the product is as even as 64 random bits make it.
        ((u128::from(self.dice.next_u64()) * count as u128) >> 64) as usize
    }

    /// Collapses edges until `faces` faces are left, or one more where two go at a time.
    pub fn decimate(&mut self, mesh: &mut Mesh<ByQuadric>, faces: usize) -> Decimated {
        let mut misses = 0;
        while mesh.faces_left > faces + 1 {
            self.pick_candidates(mesh);
            self.candidates.sort_unstable_by(|a, b| a.into.cost.total_cmp(&b.into.cost));
            if self.collapse_best(mesh) {
                misses = 0;
            } else {
                misses += 1;
                if misses > MISSES_MAX {
                    return Decimated::Stuck;
                }
            }
        }
        Decimated::Reached
    }

    fn pick_candidates(&mut self, mesh: &Mesh<ByQuadric>) {
        self.candidates.clear();
        for _ in 0..self.choices {
            if let Some(half_edge) = self.draw(mesh) {
                self.candidates.push(half_edge);
            }
        }
    }

    /// A random half-edge that leaves neither interface and does not lead to `P_ab`.
    #[inline]
    fn draw(&mut self, mesh: &Mesh<ByQuadric>) -> Option<HalfEdge> {
        let vertices = mesh.spots.len();
        for _ in 0..DRAWS_MAX.min(vertices) {
            let removed = self.below(vertices) as u32;
            if !mesh.is_removable(removed) {
                continue;
            }
            let ring = mesh.rings.of(removed);
            let kept = if mesh.states[removed as usize] == State::INNER {
                ring[self.below(ring.len())].next
            } else {
                // Along the boundary: one of the two ends of the fan.
                let ends = ring.iter().flat_map(|wing| [wing.next, wing.prev]);
                let mut ends = ends.filter(|other| is_end(ring, *other));
                ends.nth(self.below(2)).unwrap_or(NONE)
            };
            if kept == NONE || mesh.states[kept as usize].has(State::OPEN) {
                continue;
            }
            let to = mesh.position(kept);
            let step = to - mesh.position(removed);
            let cost = mesh.quadric(removed).at(step) + mesh.spots[kept as usize].error();
            return Some(HalfEdge { removed, into: Candidate { kept, cost, to } });
        }
        None
    }

    /// Collapses the cheapest candidate that is legal.
    fn collapse_best(&mut self, mesh: &mut Mesh<ByQuadric>) -> bool {
        for candidate in &self.candidates {
            let HalfEdge { removed, into } = *candidate;
            self.ring.clear();
            self.ring.extend_from_slice(mesh.rings.of(removed));
            if mesh.is_legal(removed, &into, &self.ring) && !closes_on_written(mesh, &self.ring) {
                mesh.collapse(removed, &into, &self.ring);
                return true;
            }
        }
        false
    }
}

/// Whether a collapse would leave one face between three vertices of `P_bc`: it may have been
/// written already, looking the other way.
#[inline]
fn closes_on_written(mesh: &Mesh<ByQuadric>, ring: &[Wing]) -> bool {
    let is_frozen = |wing: &Wing| mesh.states[wing.next as usize].has(State::FROZEN);
    ring.len() == 3 && ring.iter().all(is_frozen)
}
