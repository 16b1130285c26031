//! The last stage: a soup or an indexed mesh becomes the user's file.

mod output;
mod write;

use std::path::PathBuf;

pub use write::{export_batches, export_mesh, export_soup};

use crate::{
    formats::{Compression, Counts, Findings, Format, WriteOptions},
    storage::Overwrite,
};

/// Where the result goes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Target {
    /// A file, under its name when complete.
    File(PathBuf, Overwrite),
    /// Standard output.
    Stdout,
}

/// What export needs to know.
#[derive(Clone, Debug)]
pub struct Config {
    /// Where to.
    pub target: Target,
    /// Format of the output.
    pub format: Format,
    /// Compression around it.
    pub compression: Compression,
    /// Numbers, origin, colours.
    pub write: WriteOptions,
}

impl Config {
    /// Whether the header can be written over when everything else is.
    fn is_seekable(&self) -> bool {
        self.compression == Compression::None && matches!(self.target, Target::File(..))
    }
}

/// What export did.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Written.
    pub counts: Counts,
    /// Size of the output.
    pub size_bytes: u64,
    /// What the pass over the source found; empty for an indexed mesh.
    pub findings: Findings,
}
