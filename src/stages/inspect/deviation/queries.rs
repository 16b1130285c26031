//! Points that wait in memory for the triangles of a surface to pass by: how far each is from the
//! nearest so far, in a tree that leads triangles only to those they may be nearer to.
//!
//! Threads offer triangles at the same time. A distance only ever shrinks, and the least of all is
//! the same in whatever order they came.

use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};

use glam::DVec3;
use rayon::prelude::*;

use super::block::Group;
use crate::geometry::{Bounds, FANOUT, PointTree, reach_sq};

/// Points, each with the square of its distance.
pub(super) struct Queries {
    tree: PointTree,
    /// By place in the tree: [`reach_sq`] of what was known before any triangle came.
    known: Vec<f32>,
    /// By place in the tree: the bits of the square of the distance from the nearest triangle so
    /// far, infinite before any.
    best: Vec<AtomicU64>,
    /// By level and node: the bits of [`reach_sq`] of the greatest distance below it that can still
    /// matter, [`DONE`] when none can. Perhaps that of a moment ago, when it was greater.
    reach: Vec<Vec<AtomicU32>>,
    /// Points that are known to be this near need no better answer.
    enough_sq: f64,
}

/// Less than any gap: nothing is in reach.
const DONE: f32 = -1.0;

/// Points that one thread looks up one after the other.
const POINTS_PER_CHUNK: usize = 1 << 10;

/// What is known beforehand is raised by this share of the size of everything: the same distance,
/// measured to a triangle, comes out a few bits greater or less.
const NOISE: f64 = 1e-14;

impl Queries {
    /// Bytes of a point, beside what is given to [`Self::new`].
    pub(super) const BYTES_PER_POINT: u64 = PointTree::BYTES_PER_POINT + 4 + 8 + 2;

    /// Points, of whom it is known that the surface goes through all `picks`. Those found to be as
    /// near as `enough` are not followed further.
    pub(super) fn new(points: &[[f64; 3]], picks: &PointTree, enough: f64) -> Self {
        let tree = PointTree::new(points);
        let enough_sq = enough * enough;
        let sizes = [&tree, picks].map(PointTree::diagonal);
        let noise = NOISE * (sizes[0] + sizes[1]);
        let look_up = |chunk: &[[f64; 3]]| {
            let mut hint = 0;
            let look_up = |point: &[f64; 3]| {
                let found = picks.nearest(*point, hint);
                hint = found.place;
                found.distance_sq
            };
            chunk.iter().map(look_up).collect::<Vec<_>>()
        };
        let picked = tree.points().par_chunks(POINTS_PER_CHUNK).flat_map_iter(look_up);
        // The distance from a pick is an answer only where any that is near enough will do: others
        // never depend on the picks.
        let start = |distance_sq: f64| {
            let best = if distance_sq < enough_sq { distance_sq } else { f64::INFINITY };
            (reach_sq((distance_sq.sqrt() + noise).powi(2)), AtomicU64::new(best.to_bits()))
        };
        let (known, best): (Vec<f32>, Vec<_>) = picked.map(start).unzip();
        let reach = tree.levels().iter().map(|level| {
            let nodes = std::iter::repeat_with(|| AtomicU32::new(DONE.to_bits()));
            nodes.take(level.len()).collect::<Vec<_>>()
        });
        let queries = Self { reach: reach.collect(), tree, known, best, enough_sq };
        for level in 0..queries.reach.len() {
            let nodes = 0..queries.reach[level].len();
            nodes.into_par_iter().for_each(|node| queries.update(level, node));
        }
        queries
    }

    /// Whether no point can come to another answer.
    pub(super) fn are_done(&self) -> bool {
        self.reach.last().is_none_or(|top| top.iter().all(|reach| read(reach) == DONE))
    }

    /// Looks whether triangles are nearer to some of the points.
    pub(super) fn offer(&self, group: &Group<'_>) {
        let top = self.reach.len() - 1;
        if self.is_reached(top, 0, &group.bounds) {
            self.descend(top, 0, group);
        }
    }

    /// The distances, in the order of the points as they were given.
    pub(super) fn finish(self) -> Vec<f64> {
        let mut distances = vec![0.0; self.best.len()];
        for (index, best) in self.tree.order().iter().zip(self.best) {
            let best_sq = f64::from_bits(best.into_inner());
            debug_assert!(best_sq.is_finite(), "the triangle of the nearest pick came, too");
            distances[*index as usize] = best_sq.sqrt();
        }
        distances
    }

    fn is_reached(&self, level: usize, node: usize, bounds: &Bounds) -> bool {
        let gap_sq = self.tree.levels()[level][node].gap_sq(bounds);
        // An infinite gap is not beyond an infinite reach.
        gap_sq <= read(&self.reach[level][node])
    }

    /// Takes triangles to what they may be nearer to below a node; whether anything was.
    fn descend(&self, level: usize, node: usize, group: &Group<'_>) -> bool {
        let mut is_nearer = false;
        if level == 0 {
            for place in self.children(level, node) {
                is_nearer |= self.measure(place, group);
            }
        } else {
            for child in self.children(level, node) {
                if self.is_reached(level - 1, child, &group.bounds) {
                    is_nearer |= self.descend(level - 1, child, group);
                }
            }
        }
        if is_nearer {
            self.update(level, node);
        }
        is_nearer
    }

    /// The nodes or points below a node.
    fn children(&self, level: usize, node: usize) -> std::ops::Range<usize> {
        let count = if level == 0 { self.best.len() } else { self.reach[level - 1].len() };
        node * FANOUT..((node + 1) * FANOUT).min(count)
    }

    /// Sets the reach of a node to the greatest of those below it.
    fn update(&self, level: usize, node: usize) {
        let below = self.children(level, node);
        let reach = if level == 0 {
            below.map(|place| self.reach_of(place, self.best_sq(place))).fold(DONE, f32::max)
        } else {
            self.reach[level - 1][below].iter().map(read).fold(DONE, f32::max)
        };
        self.reach[level][node].store(reach.to_bits(), Relaxed);
    }

    /// Measures a point against those of a group that may be nearer than the nearest so far.
    fn measure(&self, place: usize, group: &Group<'_>) -> bool {
        let known_sq = self.best_sq(place);
        let reach = self.reach_of(place, known_sq);
        let point = self.tree.points()[place];
        let around = Bounds::around(point);
        if around.gap_sq(&group.bounds) > reach {
            return false;
        }
        let best_sq = group.nearest_sq(DVec3::from_array(point), &around, (known_sq, reach));
        if best_sq < known_sq {
            // Distances are not negative, so their bits are in the order of their values.
            self.best[place].fetch_min(best_sq.to_bits(), Relaxed);
        }
        best_sq < known_sq
    }

    fn best_sq(&self, place: usize) -> f64 {
        f64::from_bits(self.best[place].load(Relaxed))
    }

    /// How far a triangle that changes the answer of a point can be.
    fn reach_of(&self, place: usize, best_sq: f64) -> f32 {
        if best_sq <= self.enough_sq { DONE } else { reach_sq(best_sq).min(self.known[place]) }
    }
}

fn read(reach: &AtomicU32) -> f32 {
    f32::from_bits(reach.load(Relaxed))
}
