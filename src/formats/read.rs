//! The reading side of a format: what is asked of it and what it answers.

use serde::{Deserialize, Serialize};

use super::{Batch, Findings, Format, Origin, fault::Result};

/// What happens to a single bad vertex or face. Truncation is never skipped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OnDefect {
    /// A coordinate that is not finite or an index out of range ends the read.
    Fail,
    /// Bad soup triangles and faces with indices out of range are left out and counted. Vertices
    /// that are not finite are counted and stay, as NaN in all three coordinates, so that indices
    /// keep their meaning; whoever resolves the faces drops those that refer to them.
    Skip,
}

/// How to read.
#[derive(Clone, Copy, Debug)]
pub struct ReadOptions {
    /// Policy for bad records.
    pub on_defect: OnDefect,
    /// The origin, where an earlier file of the same mesh has decided it.
    pub origin: Origin,
    /// Bytes of the (uncompressed) input when known; lets counts that lie be found early.
    pub size_bytes: Option<u64>,
}

/// What an input says of itself before its records are read.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[expect(clippy::struct_excessive_bools, reason = "independent facts, each read by its name")]
pub struct Declared {
    /// Whether the batches are vertices and faces, or soup.
    pub indexed: bool,
    /// Vertices, when the header says so.
    pub vertices: Option<u64>,
    /// Faces or soup triangles, when the header says so and is believed.
    pub faces: Option<u64>,
    /// Vertex colours are carried.
    pub colors: bool,
    /// Positions have more than single precision: write `double` to keep it.
    pub double: bool,
    /// Every vertex comes before the first face.
    pub vertices_first: bool,
    /// Bounds in model units, when the header has them (our own soup only).
    pub bounds: Option<[[f64; 3]; 2]>,
}

/// A parser under way.
pub trait MeshReader: Send {
    /// What the input turned out to be.
    fn format(&self) -> Format;

    /// What the header says.
    fn declared(&self) -> &Declared;

    /// Resets `batch` and fills it with the next records, all of one kind and at least one;
    /// `false` when the input is complete and consistent.
    ///
    /// # Errors
    /// The first broken rule, with its place.
    fn read_batch(&mut self, batch: &mut Batch) -> Result<bool>;

    /// Defects and dropped attributes so far.
    fn findings(&self) -> &Findings;

    /// The origin of the positions, final once the first vertex batch was returned.
    fn origin(&self) -> Origin;

    /// Bytes of (uncompressed) input consumed, for progress.
    fn bytes_read(&self) -> u64;
}
