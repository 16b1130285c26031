//! Triangles in the order of a Morton curve with boxes around runs of them, as a
//! [`PointTree`](super::PointTree) has points: how far a point is from the nearest one.

use glam::DVec3;
use rayon::prelude::*;

use super::{
    Bounds,
    bounds::reach_sq,
    closest_point::distance_sq_to_triangle,
    morton::{WIDE_BITS, spread_wide},
    point_tree::FANOUT,
};

/// Triangles, and boxes around them.
pub struct TriangleTree {
    /// Along the curve.
    triangles: Vec<[[f32; 3]; 3]>,
    /// Boxes around each [`FANOUT`] triangles, then around each so many boxes, up to a single one.
    levels: Vec<Vec<Bounds>>,
}

impl TriangleTree {
    /// Bytes a triangle takes in a tree while it is made, beside those it is made of.
    pub const BYTES_PER_TRIANGLE: u64 = 36 + 16 + 4;

    /// A tree of fewer than 2³² finite triangles, at least one.
    #[must_use]
    pub fn new(triangles: &[[[f32; 3]; 3]]) -> Self {
        assert!(!triangles.is_empty(), "nothing is near to no triangle");
        let whole = bounds_of(triangles);
        let (low, high) = (corner(whole.min), corner(whole.max));
        let longest = (high - low).max_element();
        let cells = (1_u64 << WIDE_BITS) as f64;
        let scale = if longest > 0.0 { (cells - 1.0) / longest } else { 0.0 };
        let key = |(index, [a, b, c]): (usize, &[[f32; 3]; 3])| {
            let at = ((corner(*a) + corner(*b) + corner(*c)) / 3.0 - low) * scale;
            let [x, y, z] = at.to_array().map(|cell| spread_wide(cell as u64));
            (x | y << 1 | z << 2, index as u32)
        };
        let mut keys: Vec<(u64, u32)> = triangles.par_iter().enumerate().map(key).collect();
        keys.par_sort_unstable();
        let triangles: Vec<_> =
            keys.into_iter().map(|(_, index)| triangles[index as usize]).collect();
        let mut levels = vec![triangles.par_chunks(FANOUT).map(bounds_of).collect::<Vec<_>>()];
        while let Some(last) = levels.last().filter(|last| last.len() > 1) {
            let union = |run: &[Bounds]| run.iter().fold(Bounds::default(), Bounds::union);
            let next = last.chunks(FANOUT).map(union).collect();
            levels.push(next);
        }
        Self { triangles, levels }
    }

    /// The square of the distance of `point` from the nearest triangle. `hint` is the place of one
    /// that may be near; it becomes that of the nearest, for points near this one.
    #[must_use]
    pub fn distance_sq(&self, point: [f64; 3], hint: &mut usize) -> f64 {
        let mut search = Search {
            tree: self,
            point: DVec3::from_array(point),
            around: Bounds::around(point),
            place: (*hint).min(self.triangles.len() - 1),
            best_sq: f64::INFINITY,
            reach_sq: f32::INFINITY,
        };
        search.look_at(search.place / FANOUT);
        search.descend(self.levels.len() - 1, 0);
        *hint = search.place;
        search.best_sq
    }
}

fn corner(position: [f32; 3]) -> DVec3 {
    DVec3::from_array(position.map(f64::from))
}

fn bounds_of(triangles: &[[[f32; 3]; 3]]) -> Bounds {
    let mut bounds = Bounds::default();
    bounds.add_triangles(triangles.iter().copied());
    bounds
}

/// A search for the nearest triangle.
struct Search<'a> {
    tree: &'a TriangleTree,
    point: DVec3,
    around: Bounds,
    place: usize,
    best_sq: f64,
    reach_sq: f32,
}

impl Search<'_> {
    /// Looks at the triangles of a leaf.
    fn look_at(&mut self, leaf: usize) {
        let first = leaf * FANOUT;
        let end = (first + FANOUT).min(self.tree.triangles.len());
        for (place, corners) in (first..end).zip(&self.tree.triangles[first..end]) {
            let distance_sq = distance_sq_to_triangle(corners.map(|at| corner(at) - self.point));
            if distance_sq < self.best_sq {
                (self.best_sq, self.place) = (distance_sq, place);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_triangle_is_that_of_a_search_through_all() {
        let mut state = 1_u64;
        let mut number = || {
            state = state.wrapping_mul(0x5851_F42D_4C95_7F2D).wrapping_add(0x1405_7B7E_F767_814F);
            (state >> 40) as f32
        };
        for count in [1, 8, 9, 700] {
            let mut position = || [number(), number(), number()];
            let triangles: Vec<_> =
                (0..count).map(|_| [position(), position(), position()]).collect();
            let tree = TriangleTree::new(&triangles);
            let mut hint = 0;
            for _ in 0..50 {
                let point = position().map(f64::from);
                let relative = |at: [f32; 3]| corner(at) - DVec3::from_array(point);
                let distance =
                    |corners: &[[f32; 3]; 3]| distance_sq_to_triangle(corners.map(relative));
                let expected = triangles.iter().map(distance).fold(f64::INFINITY, f64::min);
                assert_eq!(tree.distance_sq(point, &mut hint), expected);
            }
        }
    }
}
