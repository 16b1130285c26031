//! Points in the order of a Morton curve with boxes around runs of them: what is near a place is
//! found by walking down the boxes. Made once, in one array a level; it never changes.

use glam::DVec3;
use rayon::prelude::*;

use super::{
    Bounds,
    bounds::reach_sq,
    morton::{WIDE_BITS, spread_wide},
};

/// Points of a leaf, and children of a node: their boxes fill three vector registers a side.
/// Chosen by hand.
pub const FANOUT: usize = 8;

/// Points, and boxes around them.
pub struct PointTree {
    /// The points, along the curve.
    points: Vec<[f64; 3]>,
    /// Of each point, its index in what the tree was made of.
    order: Vec<u32>,
    /// Boxes around each [`FANOUT`] points, then around each so many boxes, up to a single one.
    levels: Vec<Vec<Bounds>>,
}

/// A point found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// Its place along the curve.
    pub place: usize,
    /// The square of its distance.
    pub distance_sq: f64,
}

impl PointTree {
    /// Bytes a point takes in a tree while it is made, beside those it is made of.
    pub const BYTES_PER_POINT: u64 = 24 + 4 + 16 + 4;

    /// A tree of fewer than 2³² finite points.
    #[must_use]
    pub fn new(points: &[[f64; 3]]) -> Self {
        let mut keys = keys_along_curve(points);
        keys.par_sort_unstable();
        let order: Vec<u32> = keys.into_iter().map(|(_, index)| index).collect();
        let points: Vec<_> = order.iter().map(|index| points[*index as usize]).collect();
        let around = |run: &[[f64; 3]]| {
            let boxes = run.iter().map(|point| Bounds::around(*point));
            boxes.reduce(|one, other| one.union(&other)).unwrap_or_default()
        };
        let mut levels = vec![points.par_chunks(FANOUT).map(around).collect::<Vec<_>>()];
        while let Some(last) = levels.last().filter(|last| last.len() > 1) {
            let union = |run: &[Bounds]| run.iter().fold(Bounds::default(), Bounds::union);
            let next = last.chunks(FANOUT).map(union).collect();
            levels.push(next);
        }
        Self { points, order, levels }
    }

    /// The points along the curve.
    #[must_use]
    pub fn points(&self) -> &[[f64; 3]] {
        &self.points
    }

    /// Of the points along the curve, their indices in what the tree was made of.
    #[must_use]
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// The boxes, from those of the leaves to a single one. The children of box `i` are those from
    /// `i` times [`FANOUT`] on, or points below the leaves.
    #[must_use]
    pub fn levels(&self) -> &[Vec<Bounds>] {
        &self.levels
    }

    /// Length of the diagonal of the box around all points.
    #[must_use]
    pub fn diagonal(&self) -> f64 {
        self.levels.last().and_then(|top| top.first()).map_or(0.0, Bounds::diagonal)
    }

    /// The point nearest to `point`. `hint` is the place of one that may be near, such as what was
    /// found for the point before; the nearer, the shorter the search. The tree is not empty.
    #[must_use]
    pub fn nearest(&self, point: [f64; 3], hint: usize) -> Found {
        let mut search = Search {
            tree: self,
            point: DVec3::from_array(point),
            around: Bounds::around(point),
            best: Found { place: hint, distance_sq: f64::INFINITY },
            reach_sq: f32::INFINITY,
        };
        let leaf = hint / FANOUT;
        search.look_at(leaf);
        search.descend(self.levels.len() - 1, 0);
        search.best
    }
}

/// A search for the nearest point.
struct Search<'a> {
    tree: &'a PointTree,
    point: DVec3,
    around: Bounds,
    best: Found,
    reach_sq: f32,
}

impl Search<'_> {
    /// Looks at the points of a leaf.
    fn look_at(&mut self, leaf: usize) {
        let first = leaf * FANOUT;
        let end = (first + FANOUT).min(self.tree.points.len());
        for (place, point) in (first..end).zip(&self.tree.points[first..end]) {
            let distance_sq = DVec3::from_array(*point).distance_squared(self.point);
            if distance_sq < self.best.distance_sq {
                self.best = Found { place, distance_sq };
                self.reach_sq = reach_sq(distance_sq);
            }
        }
    }

    /// Looks at what is in reach of a node's children, the nearest first.
    fn descend(&mut self, level: usize, node: usize) {
        if level == 0 {
            return self.look_at(node);
        }
        let below = &self.tree.levels[level - 1];
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

/// Each point's place along the curve through their box, and its index.
fn keys_along_curve(points: &[[f64; 3]]) -> Vec<(u64, u32)> {
    let (low, high) = points.iter().fold(
        (DVec3::splat(f64::INFINITY), DVec3::splat(f64::NEG_INFINITY)),
        |(low, high), point| {
            let point = DVec3::from_array(*point);
            (low.min(point), high.max(point))
        },
    );
    let cells = (1_u64 << WIDE_BITS) as f64;
    let longest = (high - low).max_element();
    let scale = if longest > 0.0 { (cells - 1.0) / longest } else { 0.0 };
    let key = |(index, point): (usize, &[f64; 3])| {
        let at = (DVec3::from_array(*point) - low) * scale;
        let [x, y, z] = at.to_array().map(|cell| spread_wide(cell as u64));
        (x | y << 1 | z << 2, index as u32)
    };
    points.par_iter().enumerate().map(key).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers that look like chance.
    fn scattered(count: u64, scale: f64) -> Vec<[f64; 3]> {
        let mut state = 1_u64;
        let mut number = || {
            state = state.wrapping_mul(0x5851_F42D_4C95_7F2D).wrapping_add(0x1405_7B7E_F767_814F);
            (state >> 33) as f64 / 2_f64.powi(31) * scale
        };
        (0..count).map(|_| [number(), number(), number()]).collect()
    }

    #[test]
    fn the_nearest_point_is_that_of_a_search_through_all() {
        for (count, scale) in [(1, 1.0), (7, 1.0), (8, 0.0), (9, 1e30), (1000, 1e-30), (4097, 1e6)]
        {
            let points = scattered(count, scale);
            let tree = PointTree::new(&points);
            for query in scattered(200, 1.3 * scale + f64::MIN_POSITIVE) {
                let at = DVec3::from_array(query);
                let distance = |point: &[f64; 3]| DVec3::from_array(*point).distance_squared(at);
                let expected = points.iter().map(distance).fold(f64::INFINITY, f64::min);
                for hint in [0, count as usize - 1] {
                    let found = tree.nearest(query, hint);
                    assert_eq!(found.distance_sq, expected);
                    let index = tree.order()[found.place] as usize;
                    assert_eq!(distance(&points[index]), expected);
                }
            }
        }
    }

    #[test]
    fn boxes_hold_what_is_below_them() {
        let tree = PointTree::new(&scattered(1000, 7.0));
        assert_eq!(tree.levels().iter().map(Vec::len).collect::<Vec<_>>(), [125, 16, 2, 1]);
        for (place, point) in tree.points().iter().enumerate() {
            let mut node = place;
            for level in tree.levels() {
                node /= FANOUT;
                assert_eq!(level[node].gap_sq(&Bounds::around(*point)), 0.0);
            }
        }
    }
}
