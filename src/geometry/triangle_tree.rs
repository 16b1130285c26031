//! Triangles in the order of a Morton curve with boxes around runs of them, as a
//! [`PointTree`](super::PointTree) has points: how far a point is from the nearest one.

use glam::DVec3;

use super::{
    Bounds,
    bounds::reach_sq,
    box_tree::{BoxTree, FANOUT, order_along_curve},
    closest_point::distance_sq_to_triangle,
};

/// Triangles, and boxes around them.
pub struct TriangleTree {
    /// Along the curve.
    triangles: Vec<[[f32; 3]; 3]>,
    boxes: BoxTree,
}

impl TriangleTree {
    /// Bytes a triangle takes in a tree while it is made, beside those it is made of.
    pub const BYTES_PER_TRIANGLE: u64 = 36 + 16 + 4;

    /// A tree of fewer than 2³² finite triangles, at least one.
    #[must_use]
    pub fn new(triangles: &[[[f32; 3]; 3]]) -> Self {
        assert!(!triangles.is_empty(), "nothing is near to no triangle");
        let whole = bounds_of(triangles);
        let middle = |[a, b, c]: &[[f32; 3]; 3]| (corner(*a) + corner(*b) + corner(*c)) / 3.0;
        let order = order_along_curve(triangles, [whole.min, whole.max].map(corner), middle);
        let triangles: Vec<_> = order.iter().map(|index| triangles[*index as usize]).collect();
        let boxes = BoxTree::new(&triangles, bounds_of);
        Self { triangles, boxes }
    }

    /// The square of the distance of `point` from the nearest triangle. `hint` is the place of one
    /// that may be near; it becomes that of the nearest, for points near this one.
    #[must_use]
    pub fn distance_sq(&self, point: [f64; 3], hint: &mut usize) -> f64 {
        let at = DVec3::from_array(point);
        let mut best_sq = f64::INFINITY;
        let leaf = (*hint).min(self.triangles.len() - 1) / FANOUT;
        self.boxes.search(Bounds::around(point), leaf, |leaf| {
            let first = leaf * FANOUT;
            let end = (first + FANOUT).min(self.triangles.len());
            for (place, corners) in (first..end).zip(&self.triangles[first..end]) {
                let distance_sq = distance_sq_to_triangle(corners.map(|c| corner(c) - at));
                if distance_sq < best_sq {
                    (best_sq, *hint) = (distance_sq, place);
                }
            }
            reach_sq(best_sq)
        });
        best_sq
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
