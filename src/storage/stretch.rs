//! Parts of record files that some thread reads or writes on its own, and their checksums.
//!
//! Who hands a stretch out takes its checksum back, in the order of the stretches, so that the
//! whole file is still checked as one.

use std::{fs::File, path::PathBuf, sync::Arc};

use zerocopy::IntoBytes as _;

use super::{IO_BLOCK_BYTES, Record, system};
use crate::error::{IoContext as _, Result};

/// An open file that can say what it is called when something goes wrong.
#[derive(Debug)]
pub(super) struct NamedFile {
    pub(super) file: File,
    pub(super) path: PathBuf,
}

/// A range of bytes of an open record file.
#[derive(Debug)]
pub struct Stretch {
    file: Arc<NamedFile>,
    /// Where the next read or write goes; at most `end`.
    offset: u64,
    end: u64,
}

/// The checksum of a stretch.
#[derive(Clone, Debug, Default)]
pub struct Sum(pub(super) crc32fast::Hasher);

impl Stretch {
    pub(super) fn new(file: &Arc<NamedFile>, offset: u64, size_bytes: u64) -> Self {
        Self { file: Arc::clone(file), offset, end: offset + size_bytes }
    }

    /// Bytes not yet read or written.
    #[must_use]
    pub fn left_bytes(&self) -> u64 {
        self.end - self.offset
    }

    /// Fills `records` with the next ones, and adds them to `sum`.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn read<R: Record>(&mut self, records: &mut [R], sum: &mut Sum) -> Result<()> {
        for block in records.as_mut_bytes().chunks_mut(IO_BLOCK_BYTES) {
            let offset = self.advance(block.len());
            system::read_exact_at(&self.file.file, block, offset).at("read", &self.file.path)?;
            sum.0.update(block);
        }
        Ok(())
    }

    /// Writes the next records, and adds them to `sum`.
    ///
    /// # Errors
    /// [`crate::Error::Io`] when the disk does not take them.
    pub fn write<R: Record>(&mut self, records: &[R], sum: &mut Sum) -> Result<()> {
        for block in records.as_bytes().chunks(IO_BLOCK_BYTES) {
            sum.0.update(block);
            self.write_bytes(block)?;
        }
        Ok(())
    }

    /// Writes the next bytes, whose checksum is known already.
    pub(super) fn write_bytes(&mut self, bytes: &[u8]) -> Result<()> {
        let offset = self.advance(bytes.len());
        system::write_all_at(&self.file.file, bytes, offset).at("write", &self.file.path)
    }

    fn advance(&mut self, size_bytes: usize) -> u64 {
        let offset = self.offset;
        self.offset += size_bytes as u64;
        assert!(self.offset <= self.end, "past the end of a stretch");
        offset
    }
}

/// Buffers that are full and wait to be written, and empty ones to go on with.
#[derive(Debug)]
pub struct FullBuffers {
    full: Vec<(Stretch, Vec<u8>)>,
    full_bytes: usize,
    full_bytes_max: usize,
    empty: Vec<Vec<u8>>,
}

impl FullBuffers {
    /// No buffers. When about `full_bytes_max` wait, they are written by whoever adds one.
    #[must_use]
    pub fn new(full_bytes_max: usize) -> Self {
        Self { full: Vec::new(), full_bytes: 0, full_bytes_max, empty: Vec::new() }
    }

    /// Writes all that wait.
    ///
    /// # Errors
    /// [`crate::Error::Io`] when the disk does not take them.
    pub fn write(&mut self) -> Result<()> {
        for (mut stretch, mut buffer) in self.full.drain(..) {
            stretch.write_bytes(&buffer)?;
            buffer.clear();
            self.empty.push(buffer);
        }
        self.full_bytes = 0;
        Ok(())
    }

    /// Takes a full buffer and gives an empty one.
    pub(super) fn exchange(&mut self, stretch: Stretch, buffer: Vec<u8>) -> Result<Vec<u8>> {
        let capacity = buffer.capacity();
        self.full_bytes += buffer.len();
        self.full.push((stretch, buffer));
        if self.full_bytes >= self.full_bytes_max {
            self.write()?;
        }
        Ok(self.empty.pop().unwrap_or_else(|| Vec::with_capacity(capacity)))
    }
}
