//! What a parser or writer can fail with, before anybody knows the path.

use std::{io, path::Path};

use crate::error::{Error, Fault, InputFault, Position};

/// A fault without a path; [`Self::in_file`] makes it the crate's [`Error`].
#[derive(Debug)]
pub enum FormatError {
    /// The input breaks the rules of its format.
    Input(InputFault),
    /// Reading or writing failed.
    Io {
        /// "read" or "write".
        verb: &'static str,
        /// The cause.
        source: io::Error,
    },
    /// The format cannot count what is to be written.
    Limit {
        /// Format name.
        format: &'static str,
        /// Thing counted.
        what: &'static str,
        /// Largest count of the format.
        limit: u64,
        /// Count asked for.
        count: u64,
    },
}

/// Result of parsing or writing.
pub(super) type Result<T, E = FormatError> = std::result::Result<T, E>;

impl FormatError {
    /// An input fault with its place.
    #[must_use]
    pub fn input(at: Position, fault: Fault) -> Self {
        Self::Input(InputFault { at, fault })
    }

    /// A failed write.
    #[must_use]
    pub fn write(source: io::Error) -> Self {
        Self::Io { verb: "write", source }
    }

    /// A failed read at `byte`. Errors that decompressors report as I/O become input faults.
    #[must_use]
    pub fn read(source: io::Error, byte: u64) -> Self {
        match source.kind() {
            io::ErrorKind::UnexpectedEof => {
                Self::input(Position::byte(byte), Fault::Truncated { inside: "the data" })
            }
            io::ErrorKind::InvalidData | io::ErrorKind::InvalidInput | io::ErrorKind::Other
                if source.raw_os_error().is_none() =>
            {
                Self::input(Position::byte(byte), Fault::Compression(source.to_string()))
            }
            _ => Self::Io { verb: "read", source },
        }
    }

    /// The same error, in a file.
    #[must_use]
    pub fn in_file(self, path: &Path) -> Error {
        match self {
            Self::Input(fault) => Error::input(path, fault),
            Self::Io { verb, source } => Error::Io { verb, path: path.to_owned(), source },
            Self::Limit { format, what, limit, count } => {
                Error::FormatLimit { path: path.to_owned(), format, what, limit, count }
            }
        }
    }
}
