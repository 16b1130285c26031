//! The vertices of an indexed mesh, found by index.

use super::Vertex;
use crate::{
    error::Result,
    storage::{MappedRecords, Reservation},
};

/// Vertices by index, in memory or mapped.
pub enum VertexTable<V> {
    /// All in memory, with the room they were given.
    Memory(Vec<V>, Reservation),
    /// In a finished file. Fast when indices are local, see [`Self::note_corners`].
    File {
        /// The vertices.
        records: MappedRecords<V>,
        /// Pages of the file that may be resident.
        resident_bytes_max: u64,
    },
}

/// Bytes per page of memory.
const PAGE_BYTES: usize = 4096;

impl<V: Vertex> VertexTable<V> {
    /// All vertices.
    #[must_use]
    pub fn as_slice(&self) -> &[V] {
        match self {
            Self::Memory(vertices, _) => vertices,
            Self::File { records, .. } => records.as_slice(),
        }
    }

    /// Notes that these vertices were read, so that a mapped table stays within its residency.
    ///
    /// # Errors
    /// [`crate::Error::Io`] when the system refuses to give pages back.
    pub fn note_corners(&self, corners: &[u64]) -> Result<()> {
        match self {
            Self::Memory(..) => Ok(()),
            Self::File { records, resident_bytes_max } => {
                let pages = page_changes::<V>(corners);
                records.touched(pages * PAGE_BYTES as u64, *resident_bytes_max)
            }
        }
    }
}

/// How often consecutive corners lie on different pages of a vertex file: an upper bound of the
/// pages they touch.
#[must_use]
pub fn page_changes<V>(corners: &[u64]) -> u64 {
    let per_page = (PAGE_BYTES / size_of::<V>()) as u64;
    let changes = corners.windows(2).filter(|pair| pair[0] / per_page != pair[1] / per_page);
    changes.count() as u64 + 1
}
