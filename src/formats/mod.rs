//! Parsers and writers over `BufRead` and `Write`. They never open a file, so each works on
//! standard input and is a fuzz target. Both directions speak [`Batch`].

mod batch;
mod block;
mod compression;
pub mod cursor;
mod detect;
mod fault;
mod findings;
mod format;
pub mod glb;
pub mod obj;
pub mod off;
mod open;
mod origin;
pub mod ply;
#[cfg(test)]
mod probe;
pub mod progressive;
mod read;
pub mod soup;
mod source;
pub mod stl;
pub mod text;
mod triangles;
mod write;

pub use batch::{Batch, Content, Faces};
pub use compression::{Compression, Encoder};
pub use fault::FormatError;
pub use findings::{Defect, DefectKind, Findings};
pub use format::Format;
pub use open::{create, open};
pub use origin::Origin;
pub use read::{Declared, MeshReader, OnDefect, ReadOptions};
pub use source::Source;
pub use write::{Counts, MeshWriter, Precision, WriteOptions};

/// Records a reader puts in one [`Batch`], about; chosen by hand: a batch of corners and
/// positions stays in the second-level cache.
pub const BATCH_RECORDS: usize = 1 << 15;
