//! What the blocks hold, taken out of their columns.

use super::Deviation;

/// The coarsest mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Base {
    /// Positions in steps from the origin.
    pub positions: Vec<[u32; 3]>,
    /// RGBA by vertex; empty without colours.
    pub colors: Vec<[u8; 4]>,
    /// Corners; each vertex is one of `positions`, no two of a face are the same.
    pub faces: Vec<[u32; 3]>,
    /// How far the finest mesh is from it.
    pub deviation: Deviation,
}

/// What a split does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kind {
    /// Two faces more, anywhere in a fan.
    #[default]
    Between,
    /// One face more; the new vertex takes the first faces of an open fan.
    First,
    /// One face more; the new vertex takes the last faces of an open fan.
    Last,
}

impl Kind {
    /// Faces that it adds.
    #[inline]
    #[must_use]
    pub fn faces(self) -> u32 {
        if self == Self::Between { 2 } else { 1 }
    }

    /// The number that stands for it.
    pub(super) fn number(self) -> u32 {
        match self {
            Self::Between => 0,
            Self::First => 1,
            Self::Last => 2,
        }
    }

    /// What the remainder of a number by three stands for.
    pub(super) fn of_number(number: u32) -> Self {
        match number % 3 {
            0 => Self::Between,
            1 => Self::First,
            _ => Self::Last,
        }
    }
}

/// A vertex becoming two, as it is stored: differences modulo the range of what they are of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Split {
    /// The vertex that is split.
    pub parent: u32,
    /// What it does.
    pub kind: Kind,
    /// Where in the parent's fan the faces begin that the new vertex takes.
    pub first: u32,
    /// How many they are.
    pub taken: u32,
    /// The parent's place after less that before, in steps.
    pub step: [i32; 3],
    /// The new vertex's place less its guess, in steps.
    pub rest: [i32; 3],
    /// The parent's colour after less that before.
    pub color_step: [u8; 4],
    /// The new vertex's colour less the parent's before.
    pub color_rest: [u8; 4],
}

/// Splits that do not touch each other, by increasing parents.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SplitBatch {
    /// Byte at which its block begins.
    pub at: u64,
    /// The splits.
    pub splits: Vec<Split>,
    /// Faces they add.
    pub faces: u32,
    /// How far the finest mesh is from the one with all of them.
    pub deviation: Deviation,
}
