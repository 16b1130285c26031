//! A triangle as it is sorted: its key costs next to nothing, and nothing of it is lost.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::{
    external::Keyed,
    soup::{SweepAxis, SweepKey, SweepPlace, Triangle, Vertex, smallest_corner, tie_break},
    storage::Record,
};

/// A triangle turned so that its smallest corner comes first, with coordinates in the order in
/// which they are compared. 40 bytes, where a key beside the triangle would make 52; it is asked
/// for its key some ten times. Packed, as bytes of any record of ours have to be without gaps.
#[derive(Clone, Copy, FromBytes, IntoBytes, Immutable, KnownLayout)]
#[repr(C, packed)]
pub(super) struct SweepRecord<V> {
    corners: [V; 3],
    /// [`tie_break`]: its last two bits tell which corner of the triangle is the first here.
    tie_break: u32,
}

/// The corners from each of them on: looked up, because which one is the smallest is chance, and
/// a branch on it would be mispredicted.
const TURNS: [[usize; 3]; 3] = [[0, 1, 2], [1, 2, 0], [2, 0, 1]];
/// The corners back again.
const TURNS_BACK: [[usize; 3]; 4] = [TURNS[0], TURNS[2], TURNS[1], TURNS[0]];

impl<V: Vertex> Record for SweepRecord<V> {
    const KIND: [u8; 4] = *b"SWP ";
}

impl<V: Vertex> Keyed for SweepRecord<V> {
    type Key = u128;

    #[inline]
    fn key(&self) -> u128 {
        let Self { corners: [first, ..], tie_break } = *self;
        SweepKey::new(SweepPlace::of_front(first.position()), tie_break).bits()
    }
}

impl<V: Vertex> SweepRecord<V> {
    #[inline]
    pub(super) fn new(triangle: &Triangle<V>, axis: SweepAxis) -> Self {
        let (smallest, _) = smallest_corner(triangle, axis);
        Self::turned(triangle, smallest, axis)
    }

    /// The record of a triangle whose smallest corner is known.
    #[inline]
    pub(super) fn turned(triangle: &Triangle<V>, smallest: usize, axis: SweepAxis) -> Self {
        let tie_break = tie_break(triangle, smallest);
        let corners = TURNS[smallest].map(|corner| {
            let vertex = triangle.0[corner];
            V::new(axis.to_front(vertex.position()), vertex.color())
        });
        Self { corners, tie_break }
    }

    /// The triangle as it was.
    #[inline]
    pub(super) fn triangle(&self, axis: SweepAxis) -> Triangle<V> {
        let Self { corners, tie_break } = *self;
        let turn = TURNS_BACK[(tie_break & 3) as usize];
        Triangle(turn.map(|corner| {
            let vertex = corners[corner];
            V::new(axis.from_front(vertex.position()), vertex.color())
        }))
    }

    /// What tells it from others with the same smallest corner.
    #[inline]
    pub(super) fn tie_break(&self) -> u32 {
        self.tie_break
    }

    /// The least coordinate along the sweep axis.
    #[inline]
    pub(super) fn least(&self) -> f32 {
        let [first, ..] = self.corners;
        first.position()[0]
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::soup::ColoredPoint;

    proptest! {
        #[test]
        fn a_triangle_comes_back_as_it_was_and_has_its_key(
            corners: [([i8; 3], [u8; 4]); 3], axis in 0..3_usize
        ) {
            let axis = SweepAxis::ALL[axis];
            let corner = |(position, color): ([i8; 3], _)| {
                // Some zeros are negative.
                ColoredPoint { position: position.map(|c| f32::from(c) * -0.5), color }
            };
            let triangle = Triangle(corners.map(corner));
            let record = SweepRecord::new(&triangle, axis);
            let back = record.triangle(axis);
            prop_assert_eq!(back.as_bytes(), triangle.as_bytes());
            prop_assert_eq!(record.key(), SweepKey::of(&triangle, axis).bits());
            let least = triangle.0.map(|v| v.position[axis.index()]);
            prop_assert_eq!(record.least(), least.into_iter().fold(f32::INFINITY, f32::min));
        }
    }
}
