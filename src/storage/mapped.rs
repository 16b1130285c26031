//! Read-only mapping of a finished record file. All `unsafe` on memory is here.
//!
//! Mapped reading is for random access; what is read front to back goes through
//! [`super::RecordScanner`], which stays small without help.
#![expect(unsafe_code, reason = "memory maps; see SAFETY below")]

use std::{
    ops::Range,
    sync::atomic::{AtomicU64, Ordering},
};

use memmap2::{Advice, Mmap, UncheckedAdvice};
use zerocopy::FromBytes as _;

use super::{Record, RecordFile, record::HEADER_BYTES, scanner::read_header, system};
use crate::error::{IoContext as _, Result};

/// A finished file seen as a slice of records. The pages it keeps resident are bounded by
/// whoever reads: call [`Self::touched`] with what was read.
pub struct MappedRecords<R> {
    map: Mmap,
    /// Keeps the file alive.
    source: RecordFile<R>,
    /// Bytes read since the pages were last given back.
    touched_bytes: AtomicU64,
}

impl<R: Record> MappedRecords<R> {
    pub(super) fn open(source: RecordFile<R>) -> Result<Self> {
        let path = source.path();
        let file = system::open(path).at("open", path)?;
        read_header(&file, &source)?;
        // SAFETY: the file was finished before its `RecordFile` existed, nothing in this crate
        // writes to a finished file, and the workspace is a private folder of this process that
        // its lock keeps other runs out of; so the mapped bytes do not change or shrink.
        let map = unsafe { Mmap::map(&file) }.at("map", path)?;
        map.advise(Advice::Random).at("advise on", path)?;
        Ok(Self { map, source, touched_bytes: AtomicU64::new(0) })
    }

    /// The file itself.
    #[must_use]
    pub fn file(&self) -> RecordFile<R> {
        self.source.clone()
    }

    /// All records, in file order.
    #[must_use]
    pub fn as_slice(&self) -> &[R] {
        <[R]>::ref_from_bytes(&self.map[HEADER_BYTES..])
            .expect("the header's length check holds and 64 is a multiple of every alignment")
    }

    /// The records of one range.
    #[must_use]
    pub fn range(&self, range: Range<u64>) -> &[R] {
        &self.as_slice()[range.start as usize..range.end as usize]
    }

    /// Notes that `bytes` of pages were read; past `resident_bytes_max` gives all pages back.
    ///
    /// # Errors
    /// [`crate::Error::Io`] when the system refuses.
    pub fn touched(&self, bytes: u64, resident_bytes_max: u64) -> Result<()> {
        let total = self.touched_bytes.fetch_add(bytes, Ordering::Relaxed) + bytes;
        if total > resident_bytes_max {
            self.touched_bytes.store(0, Ordering::Relaxed);
            // SAFETY: the mapping is shared and read-only, so pages dropped here are read again
            // from the unchanged file; references into the slice stay valid.
            unsafe { self.map.unchecked_advise(UncheckedAdvice::DontNeed) }
                .at("advise on", self.source.path())?;
        }
        Ok(())
    }
}
