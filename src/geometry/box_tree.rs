//! Boxes around runs of things that lie in the order of a Morton curve: what is near a place is found
//! by walking down the boxes.

use glam::DVec3;
use rayon::prelude::*;

use super::{
    Bounds,
    morton::{WIDE_BITS, spread_wide},
};

/// Things of a leaf, and children of a node: their boxes fill three vector registers a side.
/// Chosen by hand.
pub const FANOUT: usize = 8;

/// The boxes, in one array a level.
pub(super) struct BoxTree {
    /// Around each [`FANOUT`] things, then around each so many boxes, up to a single one.
    pub(super) levels: Vec<Vec<Bounds>>,
}

impl BoxTree {
    /// A tree of things along the curve, given the box around some of them.
    pub(super) fn new<T: Sync>(
        things: &[T],
        around: impl Fn(&[T]) -> Bounds + Send + Sync,
    ) -> Self {
        let mut levels = vec![things.par_chunks(FANOUT).map(around).collect::<Vec<_>>()];
        while let Some(last) = levels.last().filter(|last| last.len() > 1) {
            let union = |run: &[Bounds]| run.iter().fold(Bounds::default(), Bounds::union);
            let next = last.chunks(FANOUT).map(union).collect();
            levels.push(next);
        }
        Self { levels }
    }

    /// Has `look` look at a leaf that may be near, and then at all in reach of what is in `around`,
    /// the nearest first. It returns the reach it has then, squared: that of the nearest so far.
    pub(super) fn search(&self, around: Bounds, leaf: usize, mut look: impl FnMut(usize) -> f32) {
        let reach_sq = look(leaf);
        let mut search = Search { levels: &self.levels, around, reach_sq, look };
        search.descend(self.levels.len() - 1, 0);
    }
}

/// A walk down the boxes.
struct Search<'a, L> {
    levels: &'a [Vec<Bounds>],
    around: Bounds,
    reach_sq: f32,
    look: L,
}

impl<L: FnMut(usize) -> f32> Search<'_, L> {
    /// Looks at what is in reach of a node's children, the nearest first.
    fn descend(&mut self, level: usize, node: usize) {
        if level == 0 {
            self.reach_sq = (self.look)(node);
            return;
        }
        let below = &self.levels[level - 1];
        let first = node * FANOUT;
        let children = &below[first..(first + FANOUT).min(below.len())];
        let mut gaps = [f32::INFINITY; FANOUT];
        for (gap, child) in gaps.iter_mut().zip(children) {
            *gap = child.gap_sq(&self.around);
        }
        let mut left = (1_u32 << children.len()) - 1;
        while left != 0 {
            let mut next = left.trailing_zeros() as usize;
            for child in next + 1..children.len() {
                if left >> child & 1 == 1 && gaps[child] < gaps[next] {
                    next = child;
                }
            }
            // None of those that are left is nearer.
            if gaps[next] > self.reach_sq {
                return;
            }
            left &= !(1 << next);
            self.descend(level - 1, first + next);
        }
    }
}

/// Indices of fewer than 2³² things along the curve through the box from `low` to `high`, by where
/// each is.
pub(super) fn order_along_curve<T: Sync>(
    things: &[T],
    [low, high]: [DVec3; 2],
    at: impl Fn(&T) -> DVec3 + Send + Sync,
) -> Vec<u32> {
    let cells = (1_u64 << WIDE_BITS) as f64;
    let longest = (high - low).max_element();
    let scale = if longest > 0.0 { (cells - 1.0) / longest } else { 0.0 };
    let key = |(index, thing): (usize, &T)| {
        let cell = (at(thing) - low) * scale;
        let [x, y, z] = cell.to_array().map(|cell| spread_wide(cell as u64));
        (x | y << 1 | z << 2, index as u32)
    };
    let mut keys: Vec<(u64, u32)> = things.par_iter().enumerate().map(key).collect();
    keys.par_sort_unstable();
    keys.into_iter().map(|(_, index)| index).collect()
}
