//! The last stage: a soup or an indexed mesh becomes the user's file.

mod output;
mod write;

use std::{
    fs,
    path::{Path, PathBuf},
};

pub use write::{export_batches, export_mesh, export_soup, export_triangles};

use crate::{
    error::{Error, Result},
    formats::{Compression, Counts, Findings, Format, WriteOptions},
    storage::{Overwrite, check_output, is_stream},
};

/// Where the result goes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Target {
    /// A file, under its name when complete.
    File(PathBuf, Overwrite),
    /// Standard output.
    Stdout,
}

impl Target {
    /// Refuses an output that cannot be made, before any work is done for it.
    ///
    /// # Errors
    /// [`Error::Request`] when its name is taken and not to be replaced, [`Error::Io`] when it
    /// could not be written.
    pub fn check(&self) -> Result<()> {
        let Self::File(path, overwrite) = self else { return Ok(()) };
        let is_taken = fs::symlink_metadata(path).is_ok() && !is_stream(path);
        if is_taken && *overwrite == Overwrite::Refuse {
            return Err(Error::Request(format!("{} exists", path.display())));
        }
        check_output(path)
    }

    /// What errors name.
    #[must_use]
    pub fn path(&self) -> &Path {
        match self {
            Self::File(path, _) => path,
            Self::Stdout => Path::new("-"),
        }
    }
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
        let is_file = matches!(&self.target, Target::File(path, _) if !is_stream(path));
        is_file && self.compression == Compression::None
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
