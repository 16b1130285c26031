//! Our own progressive meshes (docs/FORMATS.md): header, blocks and their columns, to be read from
//! any stream and written to one. What splits do to a mesh is not known here.

mod block;
mod columns;
mod header;
mod pack;
mod reader;
mod split;

pub use block::{BATCH_SPLITS_MAX, Deviation};
pub use header::{Channels, FACES_MAX, HEADER_BYTES, Header, VERTICES_MAX};
pub use pack::{Packed, pack_base, pack_batch, write};
pub use reader::Reader;
pub use split::{Base, Kind, Split, SplitBatch};
