//! Patches as numbers of four bytes, one list after the other, as they lie in memory.

use serde::{Deserialize, Serialize};
use zerocopy::{FromBytes, Immutable, IntoBytes};

use super::{Memory, Patch};
use crate::error::Result;

/// How long the lists of a patch are, and the rest of it.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct PatchFigures {
    positions: usize,
    carried: usize,
    colors: usize,
    normals: usize,
    shared: usize,
    joined: usize,
    settled: usize,
    faces: usize,
    hung: usize,
    /// Bits of [`Patch::unit`].
    unit: u32,
}

impl<M: Memory> Patch<M> {
    /// What [`Self::of_words`] has to know.
    #[must_use]
    pub fn figures(&self) -> PatchFigures {
        PatchFigures {
            positions: self.positions.len(),
            carried: self.carried.len(),
            colors: self.colors.len(),
            normals: self.normals.len(),
            shared: self.shared.len(),
            joined: self.joined.len(),
            settled: self.settled.len(),
            faces: self.faces.len(),
            hung: self.hung.len(),
            unit: self.unit.to_bits(),
        }
    }

    /// Passes all lists to `write`.
    ///
    /// # Errors
    /// Those of `write`.
    pub fn write_words(&self, mut write: impl FnMut(&[u32]) -> Result<()>) -> Result<()> {
        write(as_words(&self.positions))?;
        write(as_words(&self.carried))?;
        write(as_words(&self.colors))?;
        write(as_words(&self.normals))?;
        write(&self.shared)?;
        write(&self.joined)?;
        write(&self.settled)?;
        write(as_words(&self.faces))?;
        write(as_words(&self.hung))
    }

    /// Takes a patch off the front of what [`Self::write_words`] wrote.
    #[must_use]
    pub fn of_words(words: &mut &[u32], figures: &PatchFigures) -> Self {
        Self {
            positions: take_words(words, figures.positions),
            carried: take_words(words, figures.carried),
            colors: take_words(words, figures.colors),
            normals: take_words(words, figures.normals),
            shared: take_words(words, figures.shared),
            joined: take_words(words, figures.joined),
            settled: take_words(words, figures.settled),
            faces: take_words(words, figures.faces),
            hung: take_words(words, figures.hung),
            unit: f32::from_bits(figures.unit),
        }
    }
}

/// Things made of numbers of four bytes, as those.
#[must_use]
pub fn as_words<T: IntoBytes + Immutable>(things: &[T]) -> &[u32] {
    // What has no size may lie anywhere.
    if size_of_val(things) == 0 {
        return &[];
    }
    <[u32]>::ref_from_bytes(things.as_bytes()).expect("made of numbers of four bytes")
}

/// Takes the next `count` things off the front.
#[must_use]
pub fn take_words<T: FromBytes>(words: &mut &[u32], count: usize) -> Vec<T> {
    let one = |things: &mut &[u32]| {
        let (thing, later) = things.split_at(size_of::<T>() / size_of::<u32>());
        *things = later;
        T::read_from_bytes(thing.as_bytes()).expect("made of numbers of four bytes")
    };
    (0..count).map(|_| one(words)).collect()
}
