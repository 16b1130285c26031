//! A Morton curve through the cells of a box: points that are near each other in space are mostly
//! in cells that follow each other.

use glam::Vec3A;

use crate::geometry::spread;

/// Bits per axis: cells of one 32nd of the box, each with a handful of vertices of a cache-sized
/// block.
const AXIS_BITS: u32 = 5;
const AXIS_CELLS: usize = 1 << AXIS_BITS;

/// The cells of a box, cubic: a flat slab is cut only where it is wide.
#[derive(Clone, Copy, Debug)]
pub(super) struct Curve {
    low: Vec3A,
    scale: f32,
}

/// The bits of a coordinate as they lie in the number of a cell.
static SPREAD: [u16; AXIS_CELLS] = {
    let mut spread_bits = [0; AXIS_CELLS];
    let mut n = 0;
    while n < AXIS_CELLS {
        spread_bits[n] = spread(n as u32) as u16;
        n += 1;
    }
    spread_bits
};

/// Added to a small number, leaves its nearest whole one in the lowest bits: faster than to cast.
const WHOLE: f32 = 8_388_608.0;

impl Curve {
    /// How many cells there are.
    pub(super) const CELLS: usize = 1 << (3 * AXIS_BITS);

    /// The curve through the box around some points.
    pub(super) fn around(points: impl Iterator<Item = Vec3A>) -> Self {
        let none = (Vec3A::INFINITY, Vec3A::NEG_INFINITY);
        let grow = |(low, high): (Vec3A, Vec3A), point| (low.min(point), high.max(point));
        let (low, high) = points.fold(none, grow);
        let longest = (high - low).max_element();
        let scale = if longest > 0.0 { AXIS_CELLS as f32 / longest } else { 0.0 };
        Self { low, scale }
    }

    /// The number of the cell that a point is in, along the curve.
    #[inline]
    pub(super) fn cell(&self, point: Vec3A) -> u16 {
        let last = Vec3A::splat((AXIS_CELLS - 1) as f32);
        let at = ((point - self.low) * self.scale).min(last) + Vec3A::splat(WHOLE);
        let [x, y, z] = at.to_array().map(|c| SPREAD[c.to_bits() as usize % AXIS_CELLS]);
        x | y << 1 | z << 2
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn octants_are_one_after_the_other() {
        let points = (0..1000_u32)
            .map(|i| Vec3A::new((i * 7 % 10) as f32, (i / 10 % 10) as f32, (i / 100) as f32));
        let curve = Curve::around(points.clone());
        let mut points: Vec<Vec3A> = points.collect();
        points.sort_by_key(|point| curve.cell(*point));
        let mut octants: Vec<u32> =
            points.iter().map(|p| p.cmpge(Vec3A::splat(4.6)).bitmask()).collect();
        octants.dedup();
        assert_eq!(octants, [0, 1, 2, 3, 4, 5, 6, 7]);
    }

    #[test]
    fn a_point_and_nothing_have_a_curve() {
        assert_eq!(Curve::around([Vec3A::ONE].into_iter()).cell(Vec3A::ONE), 0);
        let _ = Curve::around(std::iter::empty());
    }
}
