//! Bytes on disk: fixed-size records in finished files, the workspace they live in, the memory
//! they may take, and output files that appear under their name only when complete.

mod budget;
mod disk_use;
mod faults;
mod heap;
mod journal;
mod left;
mod manifest;
mod mapped;
mod output;
mod rate;
mod record;
mod scanner;
mod slab_files;
mod stretch;
mod system;
mod workspace;
mod writer;

pub use budget::{Budget, Reservation};
pub use faults::plan_fault;
pub use heap::{HugePages, share_heap};
pub use journal::{Due, Kept, Recalled};
pub use left::{Condition, Left, find_left};
pub use manifest::{FileEntry, Fingerprint, Manifest, ManifestFault, Step};
pub use mapped::MappedRecords;
pub use output::{OutputFile, Overwrite, check_output, is_stream, open_input};
pub use rate::read_rate;
pub use record::{Record, RecordFile};
pub use scanner::RecordScanner;
pub use slab_files::{Lineage, PieceName, SlabFiles, StreamEnd};
pub use stretch::{FullBuffers, Stretch, Sum};
pub use workspace::{ForeignFolder, Workspace, available_disk_bytes, open_files_max};
pub use writer::RecordWriter;

/// Bytes per `read()` and `write()` of our own files. Measured: 256 KiB to 1 MiB is the plateau;
/// 8 KiB and 8 MiB are about three times slower.
pub const IO_BLOCK_BYTES: usize = 1 << 18;
