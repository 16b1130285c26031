//! Points in the order of a Morton curve with boxes around runs of them: which is the nearest. Made
//! once; it never changes.

use glam::DVec3;

use super::{
    Bounds,
    bounds::reach_sq,
    box_tree::{BoxTree, FANOUT, order_along_curve},
};

/// Points, and boxes around them.
pub struct PointTree {
    /// The points, along the curve.
    points: Vec<[f64; 3]>,
    /// Of each point, its index in what the tree was made of.
    order: Vec<u32>,
    boxes: BoxTree,
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
        let at = |point: &[f64; 3]| DVec3::from_array(*point);
        let (low, high) = points.iter().map(at).fold(
            (DVec3::splat(f64::INFINITY), DVec3::splat(f64::NEG_INFINITY)),
            |(low, high), point| (low.min(point), high.max(point)),
        );
        let order = order_along_curve(points, [low, high], at);
        let points: Vec<_> = order.iter().map(|index| points[*index as usize]).collect();
        let boxes = BoxTree::new(&points, |run| {
            let boxes = run.iter().map(|point| Bounds::around(*point));
            boxes.reduce(|one, other| one.union(&other)).unwrap_or_default()
        });
        Self { points, order, boxes }
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
        &self.boxes.levels
    }

    /// Length of the diagonal of the box around all points.
    #[must_use]
    pub fn diagonal(&self) -> f64 {
        self.boxes.levels.last().and_then(|top| top.first()).map_or(0.0, Bounds::diagonal)
    }

    /// The point nearest to `point`. `hint` is the place of one that may be near, such as what was
    /// found for the point before; the nearer, the shorter the search. The tree is not empty.
    #[must_use]
    pub fn nearest(&self, point: [f64; 3], hint: usize) -> Found {
        let at = DVec3::from_array(point);
        let mut best = Found { place: hint, distance_sq: f64::INFINITY };
        self.boxes.search(Bounds::around(point), hint / FANOUT, |leaf| {
            let first = leaf * FANOUT;
            let end = (first + FANOUT).min(self.points.len());
            for (place, point) in (first..end).zip(&self.points[first..end]) {
                let distance_sq = DVec3::from_array(*point).distance_squared(at);
                if distance_sq < best.distance_sq {
                    best = Found { place, distance_sq };
                }
            }
            reach_sq(best.distance_sq)
        });
        best
    }
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
