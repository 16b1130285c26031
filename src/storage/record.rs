//! What a record is, the header of a record file, and the handle of a finished one.

use std::{
    fs,
    marker::PhantomData,
    path::{Path, PathBuf},
    sync::Arc,
};

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use super::{
    FileEntry, MappedRecords, RecordScanner, Workspace, disk_use::DiskUse, scanner, system,
};
use crate::error::{Error, IoContext as _, Result};

/// A plain fixed-size value, stored as it lies in memory (little-endian machines only).
pub trait Record:
    FromBytes + IntoBytes + Immutable + KnownLayout + Copy + Send + Sync + 'static
{
    /// Four letters in the file header that name the record type.
    const KIND: [u8; 4];
}

impl Record for u32 {
    const KIND: [u8; 4] = *b"U32 ";
}

impl Record for u64 {
    const KIND: [u8; 4] = *b"U64 ";
}

impl Record for [u64; 3] {
    const KIND: [u8; 4] = *b"U643";
}

/// First eight bytes of a record file.
pub(super) const MAGIC: [u8; 8] = *b"meshmill";
/// Format version; a reader accepts its own only, temporary files do not outlive a version.
pub(super) const VERSION: u32 = 1;

/// The 64 bytes before the first record; docs/FORMATS.md draws them.
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout)]
#[repr(C)]
pub(super) struct Header {
    pub(super) magic: [u8; 8],
    pub(super) version: u32,
    pub(super) kind: [u8; 4],
    pub(super) record_bytes: u32,
    /// CRC-32 of all record bytes.
    pub(super) checksum: u32,
    pub(super) count: u64,
    pub(super) reserved: [u8; 32],
}

/// Bytes before the first record.
pub(super) const HEADER_BYTES: usize = size_of::<Header>();

impl Header {
    pub(super) fn of<R: Record>(count: u64, checksum: u32) -> Self {
        Self {
            magic: MAGIC,
            version: VERSION,
            kind: R::KIND,
            record_bytes: size_of::<R>() as u32,
            checksum,
            count,
            reserved: [0; 32],
        }
    }

    /// Whether this is the header of a file that was noted as finished, of whatever records.
    pub(super) fn matches(&self, entry: &FileEntry) -> bool {
        (self.magic, self.version) == (MAGIC, VERSION)
            && self.record_bytes == entry.record_bytes
            && (self.count, self.checksum) == (entry.count, entry.checksum)
    }

    /// Checks that this header belongs to a file of `R` of `file_bytes` bytes.
    pub(super) fn check<R: Record>(&self, path: &Path, file_bytes: u64) -> Result<()> {
        let damaged = |what| Err(Error::Damaged { path: path.to_owned(), what });
        if self.magic != MAGIC || self.version != VERSION {
            return damaged("not a record file of this version");
        }
        if self.kind != R::KIND || self.record_bytes as usize != size_of::<R>() {
            return damaged("holds records of another kind");
        }
        let expected = self.count.checked_mul(size_of::<R>() as u64);
        if expected.and_then(|bytes| bytes.checked_add(HEADER_BYTES as u64)) != Some(file_bytes) {
            return damaged("the length does not match the record count");
        }
        Ok(())
    }
}

/// A finished file of records. Clones share it; the file is removed with the last one.
#[derive(Clone, Debug)]
pub struct RecordFile<R> {
    pub(super) file: Arc<OwnedFile>,
    pub(super) count: u64,
    /// CRC-32 of all record bytes.
    pub(super) checksum: u32,
    pub(super) marker: PhantomData<R>,
}

/// A file in the workspace that is removed, and its bytes given back, on drop.
#[derive(Debug)]
pub(super) struct OwnedFile {
    pub(super) path: PathBuf,
    pub(super) bytes: u64,
    pub(super) disk: Arc<DiskUse>,
    /// Somebody else owns it.
    pub(super) is_given_up: bool,
}

impl OwnedFile {
    /// Counts bytes that were written, or are about to be.
    pub(super) fn grow(&mut self, bytes: u64) {
        self.bytes += bytes;
        self.disk.take(bytes);
    }
}

impl OwnedFile {
    /// Its name in the workspace.
    pub(super) fn name(&self) -> String {
        self.path.file_name().unwrap_or_default().to_string_lossy().into_owned()
    }

    /// Hands the file over to another owner.
    pub(super) fn give_up(mut self) {
        self.disk.give_back(self.bytes);
        self.is_given_up = true;
    }
}

impl Drop for OwnedFile {
    fn drop(&mut self) {
        if !self.is_given_up {
            self.disk.remove(&self.path, self.bytes);
        }
    }
}

impl<R: Record> RecordFile<R> {
    /// Number of records.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Bytes on disk.
    #[must_use]
    pub fn size_bytes(&self) -> u64 {
        self.file.bytes
    }

    /// Where the file is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.file.path
    }

    /// A file that was noted as finished, by this run or the one before: one handle more of it.
    /// Its contents are checked when it is read.
    ///
    /// # Errors
    /// [`Error::Damaged`] when there is no such file, or it holds other records.
    pub fn adopt(workspace: &Workspace, entry: &FileEntry) -> Result<Self> {
        let path = workspace.path().join(&entry.name);
        let Some(file) = workspace.held(&entry.name).filter(|_| entry.finished) else {
            return Err(Error::Damaged { path, what: "is noted, but not there" });
        };
        let (count, checksum) = (entry.count, entry.checksum);
        let adopted = Self { file, count, checksum, marker: PhantomData };
        scanner::read_header(&system::open(&path).at("open", &path)?, &adopted)?;
        Ok(adopted)
    }

    /// Reads the whole file and checks that it is as it was written: for files that will be mapped,
    /// whose contents nobody checks on the way.
    ///
    /// # Errors
    /// As [`Self::read_all`].
    pub fn verify(&self) -> Result<()> {
        let mut scanner = self.scan()?;
        while scanner.next_batch()?.is_some() {}
        Ok(())
    }

    pub(super) fn entry(&self) -> FileEntry {
        FileEntry {
            name: self.file.name(),
            count: self.count,
            record_bytes: size_of::<R>() as u32,
            checksum: self.checksum,
            finished: true,
        }
    }

    /// Starts a sequential read of all records.
    ///
    /// # Errors
    /// [`Error::Io`] when the file cannot be opened, [`Error::Damaged`] when it is not ours.
    pub fn scan(&self) -> Result<RecordScanner<R>> {
        self.scan_range(0, self.count)
    }

    /// Starts a sequential read of `count` records from record `first`. The checksum is checked
    /// only when the range is the whole file.
    ///
    /// # Errors
    /// As [`Self::scan`].
    pub fn scan_range(&self, first: u64, count: u64) -> Result<RecordScanner<R>> {
        RecordScanner::open(self.clone(), first, count)
    }

    /// Maps the file for random reading.
    ///
    /// # Errors
    /// As [`Self::scan`].
    pub fn map(&self) -> Result<MappedRecords<R>> {
        MappedRecords::open(self.clone())
    }

    /// Reads every record into memory, in order. The caller has reserved the room.
    ///
    /// # Errors
    /// As [`Self::scan`], and when the contents do not match their checksum.
    pub fn read_all(&self) -> Result<Vec<R>> {
        let mut records = vec![R::new_zeroed(); self.count as usize];
        self.scan()?.read_into(&mut records)?;
        Ok(records)
    }
}

/// Length of an open file.
pub(super) fn file_bytes(file: &fs::File, path: &Path) -> Result<u64> {
    Ok(file.metadata().at("examine", path)?.len())
}
