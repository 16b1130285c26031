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

/// Pages held to be at hand: the rows of a grid, or the front of a scan, lie on a few pages that
/// take turns.
const PAGES_AT_HAND: usize = 64;

/// How often a corner lies on a page of a vertex file that was not used lately: an upper bound of
/// the pages they touch.
#[must_use]
pub fn page_changes<V>(corners: &[u64]) -> u64 {
    let per_page = (PAGE_BYTES / size_of::<V>()) as u64;
    let (mut at_hand, mut changes) = ([u64::MAX; PAGES_AT_HAND], 0);
    for corner in corners {
        let page = corner / per_page;
        let last = &mut at_hand[page as usize % PAGES_AT_HAND];
        changes += u64::from(*last != page);
        *last = page;
    }
    changes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::soup::Point;

    #[test]
    fn pages_that_take_turns_are_local() {
        // Two rows of a grid, five pages apart.
        let rows = (0..300).flat_map(|i| [i, i + 1, i + 341 * 5]).collect::<Vec<u64>>();
        assert_eq!(page_changes::<Point>(&rows), 2);
        let scattered = (0..300).map(|i| i * 104_729 % 1_000_003).collect::<Vec<u64>>();
        assert!(page_changes::<Point>(&scattered) > 250);
    }
}
