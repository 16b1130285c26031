//! Reads a record file front to back, in blocks, without mapping it.

use std::{
    fs::File,
    io::{Read as _, Seek as _, SeekFrom},
};

use zerocopy::{FromBytes as _, IntoBytes as _};

use super::{
    IO_BLOCK_BYTES, Record, RecordFile,
    record::{HEADER_BYTES, Header, file_bytes},
};
use crate::error::{Error, IoContext as _, Result};

/// A sequential read under way. Checks the file's checksum when it has seen all of it.
pub struct RecordScanner<R> {
    file: File,
    source: RecordFile<R>,
    batch: Vec<R>,
    /// Records not yet read.
    left: u64,
    /// The checksum so far and the one to meet, when the whole file is read.
    checksum: Option<(crc32fast::Hasher, u32)>,
}

impl<R: Record> RecordScanner<R> {
    pub(super) fn open(source: RecordFile<R>, first: u64, count: u64) -> Result<Self> {
        assert!(first + count <= source.count, "range lies outside the file");
        let path = source.path();
        let mut file = File::options().read(true).open(path).at("open", path)?;
        let header = read_header::<R>(&mut file, &source)?;
        if first > 0 {
            let offset = HEADER_BYTES as u64 + first * size_of::<R>() as u64;
            file.seek(SeekFrom::Start(offset)).at("seek in", path)?;
        }
        let whole = count == source.count;
        let checksum = whole.then(|| (crc32fast::Hasher::new(), header.checksum));
        Ok(Self { file, source, batch: Vec::new(), left: count, checksum })
    }

    /// The next records, `None` after the last.
    ///
    /// # Errors
    /// [`Error::Io`] when reading fails; [`Error::Damaged`] when the whole file has been read
    /// and is not what was written.
    pub fn next_batch(&mut self) -> Result<Option<&[R]>> {
        let batch_records = (IO_BLOCK_BYTES / size_of::<R>()).max(1);
        let count = self.left.min(batch_records as u64) as usize;
        if count == 0 {
            self.check()?;
            return Ok(None);
        }
        if self.batch.len() != count {
            self.batch = vec![R::new_zeroed(); count];
        }
        let mut batch = std::mem::take(&mut self.batch);
        let read = self.read_into(&mut batch);
        self.batch = batch;
        read?;
        Ok(Some(&self.batch))
    }

    /// Fills the front of `records` with the next ones and says how many: fewer than asked for
    /// only at the end. Nothing is copied on the way.
    ///
    /// # Errors
    /// As [`Self::next_batch`].
    pub fn read_into(&mut self, records: &mut [R]) -> Result<usize> {
        let count = self.left.min(records.len() as u64) as usize;
        for block in records[..count].as_mut_bytes().chunks_mut(IO_BLOCK_BYTES) {
            self.file.read_exact(block).at("read", self.source.path())?;
            if let Some((hasher, _)) = &mut self.checksum {
                hasher.update(block);
            }
        }
        self.left -= count as u64;
        if self.left == 0 {
            self.check()?;
        }
        Ok(count)
    }

    /// Records not yet returned.
    #[must_use]
    pub fn left(&self) -> u64 {
        self.left
    }

    fn check(&mut self) -> Result<()> {
        if let Some((hasher, expected)) = self.checksum.take()
            && hasher.finalize() != expected
        {
            let what = "the contents do not match their checksum";
            return Err(Error::Damaged { path: self.source.path().to_owned(), what });
        }
        Ok(())
    }
}

/// Reads and checks the header of `source`.
pub(super) fn read_header<R: Record>(file: &mut File, source: &RecordFile<R>) -> Result<Header> {
    let path = source.path();
    let length = file_bytes(file, path)?;
    if length < HEADER_BYTES as u64 {
        let what = "shorter than its header";
        return Err(Error::Damaged { path: path.to_owned(), what });
    }
    let mut bytes = [0; HEADER_BYTES];
    file.read_exact(&mut bytes).at("read", path)?;
    let header = Header::read_from_bytes(&bytes).expect("the buffer has the header's size");
    header.check::<R>(path, length)?;
    if header.count != source.count {
        let what = "the record count has changed";
        return Err(Error::Damaged { path: path.to_owned(), what });
    }
    Ok(header)
}
