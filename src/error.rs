//! The one error type that leaves the crate, and the faults an input can have.
//!
//! Errors hold values; the text is made in `Display`: place first, then fact. Hints for a person
//! at a terminal belong to the command line, not here.

use std::{
    fmt, io,
    path::{Path, PathBuf},
};

use serde::{Deserialize, Serialize};

use crate::progress::Cancelled;

/// Result with this crate's [`Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// A place inside an input. Every field that is known is filled in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Position {
    /// 1-based line, for text formats only.
    pub line: Option<u64>,
    /// 0-based index of the record (vertex, face or soup triangle).
    pub record: Option<u64>,
    /// Bytes from the start of the (decompressed) input.
    pub byte: Option<u64>,
}

impl Position {
    /// A place known by its line.
    #[must_use]
    pub fn line(line: u64) -> Self {
        Self { line: Some(line), ..Self::default() }
    }

    /// A place known by its byte offset.
    #[must_use]
    pub fn byte(byte: u64) -> Self {
        Self { byte: Some(byte), ..Self::default() }
    }

    /// The same place, with the record it lies in.
    #[must_use]
    pub fn in_record(self, record: u64) -> Self {
        Self { record: Some(record), ..self }
    }
}

impl fmt::Display for Position {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let fields = [("line", self.line), ("record", self.record), ("byte", self.byte)];
        let mut separator = "";
        for (name, value) in fields {
            if let Some(value) = value {
                write!(f, "{separator}{name} {value}")?;
                separator = ", ";
            }
        }
        Ok(())
    }
}

/// What is wrong with an input: a broken rule of its format, with the values that break it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Fault {
    /// The input ends too early.
    #[error("the input ends inside {inside}")]
    Truncated {
        /// The part that is incomplete ("the header", "the vertices").
        inside: &'static str,
    },
    /// The input holds nothing.
    #[error("the input is empty")]
    Empty,
    /// The input is well-formed but has no triangles.
    #[error("the input has no faces ({vertices} vertices)")]
    NoFaces {
        /// Vertices found.
        vertices: u64,
    },
    /// The input has triangles, but none with an area.
    #[error("none of {triangles} faces has an area")]
    NoArea {
        /// Triangles found.
        triangles: u64,
    },
    /// Something else stands where the format wants a certain thing.
    #[error("expected {expected}, found {found:?}")]
    Syntax {
        /// What the format wants here.
        expected: &'static str,
        /// What stands here, shortened.
        found: String,
    },
    /// A face refers to a vertex that does not exist.
    #[error("index {index} is out of range, there are {vertices} vertices")]
    IndexOutOfRange {
        /// The index as written in the input.
        index: i64,
        /// Vertices the index may refer to.
        vertices: u64,
    },
    /// A coordinate is NaN, infinite, or too large for single precision.
    #[error("a coordinate is not a finite number")]
    NotFinite,
    /// A count in the input contradicts what follows, or cannot be true.
    #[error("{what} is said to be {count}, at most {limit} is possible")]
    CountImpossible {
        /// The thing counted.
        what: &'static str,
        /// The count as written.
        count: u64,
        /// The largest value that could be true.
        limit: u64,
    },
    /// The encoding or a feature of it is not one we read.
    #[error("{0} is not supported")]
    Unsupported(&'static str),
    /// A compressed input does not decompress.
    #[error("the compressed data is damaged: {0}")]
    Compression(String),
    /// A checksum or trailer contradicts the data.
    #[error("{0} does not match the data")]
    Corrupt(&'static str),
}

/// A [`Fault`] with its place, as parsers report it; the path is added where the file was opened.
#[derive(Clone, Debug, PartialEq)]
pub struct InputFault {
    /// Place in the input.
    pub at: Position,
    /// Broken rule.
    pub fault: Fault,
}

/// Everything that can go wrong in a job.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An input is not what it says.
    #[error("{}{}{at}: {fault}", path.display(), if *at == Position::default() { "" } else { ", " })]
    Input {
        /// Input file (`-` for standard input).
        path: PathBuf,
        /// Place in it.
        at: Position,
        /// Broken rule.
        fault: Fault,
    },
    /// A soup that is said to be sorted is not.
    #[error(
        "triangle {triangle}: {late_by} triangles late in the order along {axis}, \
         {late_by_max} can be made up for"
    )]
    NotSorted {
        /// `x`, `y` or `z`.
        axis: &'static str,
        /// 0-based index of the triangle, over all inputs.
        triangle: u64,
        /// How many triangles it is late.
        late_by: u64,
        /// How many it may be late.
        late_by_max: u64,
    },
    /// The operating system refused something.
    #[error("cannot {verb} {}", path.display())]
    Io {
        /// What was being done.
        verb: &'static str,
        /// File concerned.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// One of our own files is not as we wrote it.
    #[error("{}: {what}", path.display())]
    Damaged {
        /// File concerned.
        path: PathBuf,
        /// What is wrong with it.
        what: &'static str,
    },
    /// The output format cannot hold the result.
    #[error("{}: {format} can count {limit} {what}, the result has {count}", path.display())]
    FormatLimit {
        /// Output file.
        path: PathBuf,
        /// Format name.
        format: &'static str,
        /// The thing counted.
        what: &'static str,
        /// Largest count of the format.
        limit: u64,
        /// Count of the result.
        count: u64,
    },
    /// All records of the input were bad and left out: an empty output would pass for a mesh.
    #[error("{}: no triangle is left to write", path.display())]
    NothingLeft {
        /// Output file.
        path: PathBuf,
    },
    /// The budget or the disk cannot suffice for the job.
    #[error("{what} needs {needed_bytes} bytes, {available_bytes} are available")]
    Resource {
        /// What is short and for what.
        what: &'static str,
        /// Bytes the job needs.
        needed_bytes: u64,
        /// Bytes there are.
        available_bytes: u64,
    },
    /// The request contradicts itself or the input.
    #[error("{0}")]
    Request(String),
    /// A job failed, and what it had done by then is kept: a run can go on from it.
    #[error("{error}")]
    Unfinished {
        /// Why it failed.
        error: Box<Error>,
        /// Where what is done is.
        workspace: PathBuf,
        /// Bytes it takes on disk.
        size_bytes: u64,
    },
    /// The caller asked us to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

impl Error {
    /// An [`Error::Input`].
    #[must_use]
    pub fn input(path: &Path, fault: InputFault) -> Self {
        Self::Input { path: path.to_owned(), at: fault.at, fault: fault.fault }
    }
}

/// Attaches path and verb to a bare [`io::Error`].
pub(crate) trait IoContext<T> {
    fn at(self, verb: &'static str, path: &Path) -> Result<T>;
}

impl<T> IoContext<T> for io::Result<T> {
    fn at(self, verb: &'static str, path: &Path) -> Result<T> {
        self.map_err(|source| Error::Io { verb, path: path.to_owned(), source })
    }
}

impl<T> IoContext<T> for Result<T, rustix::io::Errno> {
    fn at(self, verb: &'static str, path: &Path) -> Result<T> {
        self.map_err(io::Error::from).at(verb, path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_input_error_reads_place_first_then_fact() {
        let error = Error::input(
            Path::new("scan.ply"),
            InputFault { at: Position::line(7).in_record(2), fault: Fault::NotFinite },
        );
        let text = "scan.ply, line 7, record 2: a coordinate is not a finite number";
        assert_eq!(error.to_string(), text);
    }

    #[test]
    fn an_input_error_without_a_place_names_the_file_only() {
        let fault = InputFault { at: Position::default(), fault: Fault::Empty };
        assert_eq!(Error::input(Path::new("a"), fault).to_string(), "a: the input is empty");
    }
}
