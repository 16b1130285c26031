//! The order of a sorted soup: along an axis, by each triangle's smallest vertex.
//!
//! Vertices are compared by their coordinates in cyclic order from the sweep axis on, −0 as +0.
//! A triangle has the place of its smallest vertex, so once the stream has passed a vertex's
//! place, no later triangle can use the vertex: it is final. That holds where a million triangles
//! share one coordinate, too.

use super::{Triangle, Vertex};
use crate::geometry::ordered_f32;

/// The axis a soup is sorted along.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SweepAxis {
    /// The first coordinate.
    X,
    /// The second.
    Y,
    /// The third.
    Z,
}

impl SweepAxis {
    /// All of them, by [`Self::index`].
    pub const ALL: [Self; 3] = [Self::X, Self::Y, Self::Z];

    /// 0, 1 or 2.
    #[must_use]
    pub fn index(self) -> usize {
        self as usize
    }

    /// `x`, `y` or `z`.
    #[must_use]
    pub fn name(self) -> &'static str {
        ["x", "y", "z"][self.index()]
    }

    /// The coordinates in the order in which they are compared: from this axis on.
    #[must_use]
    #[inline]
    pub fn to_front<T: Copy>(self, [x, y, z]: [T; 3]) -> [T; 3] {
        match self {
            Self::X => [x, y, z],
            Self::Y => [y, z, x],
            Self::Z => [z, x, y],
        }
    }

    /// Undoes [`Self::to_front`].
    #[must_use]
    #[inline]
    pub fn from_front<T: Copy>(self, [a, b, c]: [T; 3]) -> [T; 3] {
        match self {
            Self::X => [a, b, c],
            Self::Y => [c, a, b],
            Self::Z => [b, c, a],
        }
    }
}

/// Place of a vertex in the order, 96 bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct SweepPlace(u128);

impl SweepPlace {
    /// Place of a position along `axis`; coordinates are finite.
    #[must_use]
    #[inline]
    pub fn of(position: [f32; 3], axis: SweepAxis) -> Self {
        Self::of_front(axis.to_front(position))
    }

    /// As an integer of the same order, below 2⁹⁶.
    #[must_use]
    #[inline]
    pub fn bits(self) -> u128 {
        self.0
    }

    /// As hexadecimal digits, for what has no integers so large.
    #[must_use]
    pub fn to_digits(self) -> String {
        format!("{:x}", self.0)
    }

    /// The place that these are the digits of, if it is one.
    #[must_use]
    pub fn of_digits(digits: &str) -> Option<Self> {
        u128::from_str_radix(digits, 16).ok().map(Self)
    }

    /// As [`Self::of`], of coordinates that [`SweepAxis::to_front`] has ordered.
    #[must_use]
    #[inline]
    pub fn of_front(front: [f32; 3]) -> Self {
        let bits = front.map(|coordinate| u128::from(ordered_f32(coordinate + 0.0)));
        Self(bits[0] << 64 | bits[1] << 32 | bits[2])
    }
}

/// Place of a triangle in the order: that of its smallest vertex, then a number that tells apart
/// triangles which share it. Equal keys belong to equal triangles, but for one pair in 2³⁰ of
/// those that share their smallest vertex; such a pair keeps the order of the input.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct SweepKey(u128);

impl SweepKey {
    /// Key of a triangle along `axis`; coordinates are finite.
    #[must_use]
    #[inline]
    pub fn of<V: Vertex>(triangle: &Triangle<V>, axis: SweepAxis) -> Self {
        let (smallest, place) = smallest_corner(triangle, axis);
        Self::new(place, tie_break(triangle, smallest))
    }

    /// Puts a key together.
    #[must_use]
    #[inline]
    pub fn new(place: SweepPlace, tie_break: u32) -> Self {
        Self(place.0 << 32 | u128::from(tie_break))
    }

    /// Place of the triangle's smallest vertex. Vertices at lesser places are final.
    #[must_use]
    #[inline]
    pub fn place(self) -> SweepPlace {
        SweepPlace(self.0 >> 32)
    }

    /// As an integer of the same order.
    #[must_use]
    #[inline]
    pub fn bits(self) -> u128 {
        self.0
    }
}

/// Index and place of the triangle's smallest corner, the first of equals.
#[must_use]
#[inline]
pub fn smallest_corner<V: Vertex>(triangle: &Triangle<V>, axis: SweepAxis) -> (usize, SweepPlace) {
    let places = triangle.0.map(|vertex| SweepPlace::of(vertex.position(), axis));
    let first = usize::from(places[1] < places[0]);
    let smallest = if places[2] < places[first] { 2 } else { first };
    (smallest, places[smallest])
}

/// Tells apart triangles that share their smallest vertex: 30 bits of a hash of all that is stored
/// of the triangle, bit for bit and in its order, above the index of the smallest corner.
#[must_use]
#[inline]
pub fn tie_break<V: Vertex>(triangle: &Triangle<V>, smallest: usize) -> u32 {
    // Multilinear hashing: the sum of words times random odd numbers, of which the upper half is
    // good. It has no chain of operations that wait for each other.
    let mut sum = 0_u64;
    for (vertex, factors) in triangle.0.iter().zip(&FACTORS) {
        let [x, y, z] = vertex.position().map(f32::to_bits);
        let color = if V::COLORED { u32::from_le_bytes(vertex.color()) } else { 0 };
        for (word, factor) in [x, y, z, color].into_iter().zip(factors) {
            sum = sum.wrapping_add(u64::from(word).wrapping_mul(*factor));
        }
    }
    (sum >> 32) as u32 & !3 | smallest as u32
}

/// Random odd numbers, for each corner those of x, y, z and the colour: digits of π after the
/// point, as in Blowfish's tables, the last bit set.
const FACTORS: [[u64; 4]; 3] = [
    [0x243F_6A88_85A3_08D3, 0x1319_8A2E_0370_7345, 0xA409_3822_299F_31D1, 0x082E_FA98_EC4E_6C89],
    [0x4528_21E6_38D0_1377, 0xBE54_66CF_34E9_0C6D, 0xC0AC_29B7_C97C_50DD, 0x3F84_D5B5_B547_0917],
    [0x9216_D5D9_8979_FB1B, 0xD131_0BA6_98DF_B5AD, 0x2FFD_72DB_D01A_DFB7, 0xB8E1_AFED_6A26_7E97],
];

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::soup::{ColoredPoint, Point};

    fn triangle(corners: [[f32; 3]; 3]) -> Triangle<Point> {
        Triangle(corners.map(Point))
    }

    proptest! {
        #[test]
        fn a_triangle_has_the_place_of_its_smallest_vertex(
            corners: [[i8; 3]; 3], axis in 0..3_usize
        ) {
            let axis = SweepAxis::ALL[axis];
            let corners = corners.map(|corner| corner.map(f32::from));
            let front = corners.map(|corner| axis.to_front(corner));
            let least = front.into_iter().min_by(|a, b| a.partial_cmp(b).unwrap()).unwrap();
            let place = SweepKey::of(&triangle(corners), axis).place();
            prop_assert_eq!(place, SweepPlace::of_front(least));
            prop_assert!(corners.iter().all(|corner| SweepPlace::of(*corner, axis) >= place));
            prop_assert_eq!(front.map(|front| axis.from_front(front)), corners);
        }
    }

    #[test]
    fn the_sweep_axis_comes_first_and_the_others_in_cyclic_order() {
        let fronts = SweepAxis::ALL.map(|axis| axis.to_front(["x", "y", "z"]));
        assert_eq!(fronts, [["x", "y", "z"], ["y", "z", "x"], ["z", "x", "y"]]);
    }

    #[test]
    fn zeros_of_either_sign_have_one_place_and_keys_of_their_own() {
        let of = |zero: f32| {
            SweepKey::of(&triangle([[zero, 0.0, 0.0], [1.0; 3], [2.0; 3]]), SweepAxis::X)
        };
        assert_eq!(of(0.0).place(), of(-0.0).place());
        assert_ne!(of(0.0), of(-0.0));
    }

    #[test]
    fn whatever_is_stored_tells_triangles_apart() {
        let [a, b, c, d] = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let fan = [[a, b, c], [b, c, a], [c, a, b], [a, c, b], [a, b, d], [a, a, b], [a, a, a]];
        let mut keys = fan.map(|corners| SweepKey::of(&triangle(corners), SweepAxis::Z).bits());
        keys.sort_unstable();
        assert!(keys.windows(2).all(|pair| pair[0] != pair[1]));
        let colored = |red| {
            let corner = |position| ColoredPoint { position, color: [red, 0, 0, 255] };
            SweepKey::of(&Triangle([a, b, c].map(corner)), SweepAxis::X)
        };
        assert_ne!(colored(1), colored(2));
    }
}
