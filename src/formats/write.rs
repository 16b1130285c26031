//! The writing side of a format.

use super::{Batch, fault::Result};

/// Number type of written coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// `float`.
    Single,
    /// `double`, where the format has it.
    Double,
}

/// How to write.
#[derive(Clone, Copy, Debug)]
pub struct WriteOptions {
    /// Number type of coordinates.
    pub precision: Precision,
    /// Added to every position, in `f64`.
    pub origin: [f64; 3],
    /// Vertex colours are written (where the format has them).
    pub colors: bool,
}

impl WriteOptions {
    /// The origin as what is added to a position: -0 for 0, as `-0.0 + 0.0` loses its sign.
    pub(super) fn shift(&self) -> [f64; 3] {
        self.origin.map(|coordinate| if coordinate == 0.0 { -0.0 } else { coordinate })
    }
}

/// What will be written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Vertices; 0 for a soup.
    pub vertices: u64,
    /// Triangles.
    pub triangles: u64,
}

/// A writer under way. Indexed formats take all vertices, then all faces (triangles only);
/// soup formats take [`super::Content::Soup`].
pub trait MeshWriter: Send {
    /// Appends a batch.
    ///
    /// # Errors
    /// [`super::FormatError::Io`] when the output does not take it.
    fn write_batch(&mut self, batch: &Batch) -> Result<()>;

    /// Writes what follows the data and flushes. Returns the header to be written over the first
    /// bytes of the output when the counts given at the start were not the final ones; of the
    /// same length as the one already written.
    ///
    /// # Errors
    /// As [`Self::write_batch`], and [`super::FormatError::Limit`] when the format cannot count
    /// what came.
    fn finish(&mut self) -> Result<Option<Vec<u8>>>;
}
