//! Triangles on their way past the points: some of them at a time, put in order along a curve so
//! that neighbours go together, as a group with one box.

use glam::DVec3;

use super::queries::Queries;
use crate::{
    geometry::{Bounds, distance_sq_to_triangle, reach_sq, spread_wide},
    soup::{Triangle, Vertex},
};

/// Triangles that are worked on together, in a few arrays that are used again.
#[derive(Default)]
pub(super) struct Block {
    /// As they came.
    arrived: Vec<[[f32; 3]; 3]>,
    /// Places along the curve and indices.
    keys: Vec<u64>,
    /// Along the curve.
    corners: Vec<[[f32; 3]; 3]>,
    /// Their boxes, one array for each side: they are compared many at a time.
    low: [Vec<f32>; 3],
    high: [Vec<f32>; 3],
}

/// Triangles that are near each other.
pub(super) struct Group<'a> {
    /// The box around them.
    pub(super) bounds: Bounds,
    corners: &'a [[[f32; 3]; 3]],
    low: [&'a [f32]; 3],
    high: [&'a [f32]; 3],
}

/// A block is full with so many triangles: 3 MiB. Chosen by hand: fewer make groups of triangles in
/// no order wider, more leave the cache.
pub(super) const TRIANGLES_PER_BLOCK: usize = 1 << INDEX_BITS;
const INDEX_BITS: u32 = 15;
/// Bits of a place along the curve for each axis.
const AXIS_BITS: u32 = 16;
/// Triangles of a group at most. Chosen by hand.
const TRIANGLES_PER_GROUP: usize = 32;
/// A group of `n` triangles is split when its box is so many times the root of `n` as wide as the
/// triangles are: those that go together on a surface stay below.
const LOOSE: f32 = 2.0;
/// Boxes that are compared in one go.
const LANES: usize = 8;

impl Block {
    /// Adds triangles.
    pub(super) fn add<V: Vertex>(&mut self, triangles: &[Triangle<V>]) {
        let corners = |triangle: &Triangle<V>| triangle.0.map(|vertex| vertex.position());
        self.arrived.extend(triangles.iter().map(corners));
    }

    /// Whether there are enough to be worked on.
    pub(super) fn is_full(&self) -> bool {
        self.arrived.len() >= TRIANGLES_PER_BLOCK
    }

    /// Offers all triangles to `queries`, and is empty.
    pub(super) fn offer_to(&mut self, queries: &Queries) {
        let mut arrived = std::mem::take(&mut self.arrived);
        for triangles in arrived.chunks(TRIANGLES_PER_BLOCK) {
            self.put_in_order(triangles);
            let mut first = 0;
            while first < triangles.len() {
                let end = (first + TRIANGLES_PER_GROUP).min(triangles.len());
                self.offer_groups(first, end, queries);
                first = end;
            }
        }
        arrived.clear();
        self.arrived = arrived;
    }

    fn put_in_order(&mut self, triangles: &[[[f32; 3]; 3]]) {
        let mut bounds = Bounds::default();
        bounds.add_triangles(triangles.iter().copied());
        let size = bounds.size();
        let longest = size.max_element();
        let cells = (1_u64 << AXIS_BITS) as f64 - 1.0;
        let scale = if longest > 0.0 { cells / longest } else { 0.0 };
        let low = DVec3::from_array(bounds.min.map(f64::from));
        self.keys.clear();
        self.keys.extend(triangles.iter().enumerate().map(|(index, corners)| {
            let [a, b, c] = corners.map(|corner| DVec3::from_array(corner.map(f64::from)));
            let at = ((a + b + c) / 3.0 - low) * scale;
            let [x, y, z] = at.to_array().map(|cell| spread_wide(cell as u64));
            (x | y << 1 | z << 2) << INDEX_BITS | index as u64
        }));
        self.keys.sort_unstable();
        let index = |key: &u64| (*key & (TRIANGLES_PER_BLOCK as u64 - 1)) as usize;
        self.corners.clear();
        self.corners.extend(self.keys.iter().map(|key| triangles[index(key)]));
        for axis in 0..3 {
            let least = |[a, b, c]: &[[f32; 3]; 3]| a[axis].min(b[axis]).min(c[axis]);
            let most = |[a, b, c]: &[[f32; 3]; 3]| a[axis].max(b[axis]).max(c[axis]);
            self.low[axis].clear();
            self.low[axis].extend(self.corners.iter().map(least));
            self.high[axis].clear();
            self.high[axis].extend(self.corners.iter().map(most));
        }
    }

    /// Offers a run of triangles, in halves as long as they are scattered.
    fn offer_groups(&self, first: usize, end: usize, queries: &Queries) {
        let mut bounds = Bounds::default();
        let mut width = 0.0;
        for axis in 0..3 {
            let (low, high) = (&self.low[axis][first..end], &self.high[axis][first..end]);
            bounds.min[axis] = low.iter().fold(f32::INFINITY, |least, low| least.min(*low));
            bounds.max[axis] = high.iter().fold(f32::NEG_INFINITY, |most, high| most.max(*high));
            width += low.iter().zip(high).map(|(low, high)| high - low).sum::<f32>();
        }
        let count = end - first;
        let whole = (0..3).map(|axis| bounds.max[axis] - bounds.min[axis]).sum::<f32>();
        if count > 1 && whole > LOOSE * width / (count as f32).sqrt() {
            let middle = first + count / 2;
            self.offer_groups(first, middle, queries);
            self.offer_groups(middle, end, queries);
            return;
        }
        queries.offer(&Group {
            bounds,
            corners: &self.corners[first..end],
            low: self.low.each_ref().map(|low| &low[first..end]),
            high: self.high.each_ref().map(|high| &high[first..end]),
        });
    }
}

impl Group<'_> {
    /// The square of the distance from `point` to the nearest triangle, or `best_sq` if that is
    /// less. `around` is the box around the point, `reach` how far it is worth looking.
    pub(super) fn nearest_sq(
        &self,
        point: DVec3,
        around: &Bounds,
        (mut best_sq, mut reach): (f64, f32),
    ) -> f64 {
        let mut gaps_sq = [0.0; LANES];
        for first in (0..self.corners.len()).step_by(LANES) {
            let end = (first + LANES).min(self.corners.len());
            let gaps_sq = &mut gaps_sq[..end - first];
            gaps_sq.fill(0.0);
            for axis in 0..3 {
                let (low, high) = (&self.low[axis][first..end], &self.high[axis][first..end]);
                let (min, max) = (around.min[axis], around.max[axis]);
                for ((gap_sq, low), high) in gaps_sq.iter_mut().zip(low).zip(high) {
                    let gap = if *low - max > min - *high { *low - max } else { min - *high };
                    let gap = if gap > 0.0 { gap } else { 0.0 };
                    *gap_sq += gap * gap;
                }
            }
            for (gap_sq, corners) in gaps_sq.iter().zip(&self.corners[first..end]) {
                if *gap_sq <= reach {
                    let corner = |at: [f32; 3]| DVec3::from_array(at.map(f64::from)) - point;
                    let distance_sq = distance_sq_to_triangle(corners.map(corner));
                    if distance_sq < best_sq {
                        best_sq = distance_sq;
                        reach = reach.min(reach_sq(best_sq));
                    }
                }
            }
        }
        best_sq
    }
}
