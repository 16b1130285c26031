//! Reads a record file front to back, in blocks, without mapping it.

use std::{fs::File, sync::Arc};

use zerocopy::FromBytes as _;

use super::{
    IO_BLOCK_BYTES, Record, RecordFile, Stretch, Sum,
    record::{HEADER_BYTES, Header, file_bytes},
    stretch::NamedFile,
    system,
};
use crate::error::{Error, IoContext as _, Result};

/// A sequential read under way. Checks the file's checksum when it has seen all of it.
pub struct RecordScanner<R> {
    file: Arc<NamedFile>,
    source: RecordFile<R>,
    batch: Vec<R>,
    /// Where the next record is, in bytes.
    offset: u64,
    /// Records not yet read, nor claimed.
    left: u64,
    /// Records claimed whose checksum has not come back.
    claimed: u64,
    /// The checksum so far and the one to meet, when the whole file is read.
    checksum: Option<(Sum, u32)>,
}

impl<R: Record> RecordScanner<R> {
    pub(super) fn open(source: RecordFile<R>, first: u64, count: u64) -> Result<Self> {
        assert!(first + count <= source.count, "range lies outside the file");
        let path = source.path();
        let file = system::open(path).at("open", path)?;
        let header = read_header::<R>(&file, &source)?;
        let offset = HEADER_BYTES as u64 + first * size_of::<R>() as u64;
        let whole = count == source.count;
        let checksum = whole.then(|| (Sum::default(), header.checksum));
        let file = Arc::new(NamedFile { file, path: path.to_owned() });
        Ok(Self { file, source, batch: Vec::new(), offset, left: count, claimed: 0, checksum })
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
        let count = self.left.min(records.len() as u64);
        let (mut stretch, _) = self.claim(count);
        let records = &mut records[..count as usize];
        match &mut self.checksum {
            Some((sum, _)) => stretch.read(records, sum)?,
            None => stretch.read(records, &mut Sum::default())?,
        }
        self.absorb(count, &Sum::default())?;
        Ok(count as usize)
    }

    /// Hands the next `count` records, or as many as are left, to be read on any thread. The
    /// checksum goes to [`Self::absorb`].
    pub fn claim(&mut self, count: u64) -> (Stretch, u64) {
        let count = self.left.min(count);
        let bytes = count * size_of::<R>() as u64;
        let stretch = Stretch::new(&self.file, self.offset, bytes);
        self.offset += bytes;
        self.left -= count;
        self.claimed += count;
        (stretch, count)
    }

    /// Takes the checksums of claimed records, in their order.
    ///
    /// # Errors
    /// [`Error::Damaged`] when this was the last of the whole file, and it is not what was
    /// written.
    pub fn absorb(&mut self, count: u64, sum: &Sum) -> Result<()> {
        self.claimed -= count;
        if let Some((whole, _)) = &mut self.checksum {
            whole.0.combine(&sum.0);
        }
        if self.left + self.claimed == 0 { self.check() } else { Ok(()) }
    }

    /// Records not yet returned.
    #[must_use]
    pub fn left(&self) -> u64 {
        self.left
    }

    fn check(&mut self) -> Result<()> {
        if let Some((sum, expected)) = self.checksum.take()
            && sum.0.finalize() != expected
        {
            let what = "the contents do not match their checksum";
            return Err(Error::Damaged { path: self.source.path().to_owned(), what });
        }
        Ok(())
    }
}

/// Reads and checks the header of `source`.
pub(super) fn read_header<R: Record>(file: &File, source: &RecordFile<R>) -> Result<Header> {
    let path = source.path();
    let length = file_bytes(file, path)?;
    if length < HEADER_BYTES as u64 {
        let what = "shorter than its header";
        return Err(Error::Damaged { path: path.to_owned(), what });
    }
    let mut bytes = [0; HEADER_BYTES];
    system::read_exact_at(file, &mut bytes, 0).at("read", path)?;
    let header = Header::read_from_bytes(&bytes).expect("the buffer has the header's size");
    header.check::<R>(path, length)?;
    if header.count != source.count || header.checksum != source.checksum {
        let what = "the record count or checksum has changed";
        return Err(Error::Damaged { path: path.to_owned(), what });
    }
    Ok(header)
}
