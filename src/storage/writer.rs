//! Writes a record file, front to back.

use std::{marker::PhantomData, sync::Arc};

use zerocopy::IntoBytes as _;

use super::{
    FileEntry, FullBuffers, IO_BLOCK_BYTES, Record, RecordFile, Stretch, Sum, Workspace,
    record::{HEADER_BYTES, Header, OwnedFile, file_bytes},
    stretch::NamedFile,
    system,
};
use crate::error::{Error, IoContext as _, Result};

/// Appends records to a new file of the workspace. The file counts as finished, and may be read,
/// only after [`Self::finish`]; dropped before that, it is removed.
pub struct RecordWriter<R> {
    file: Arc<NamedFile>,
    /// Grows `bytes` as it is written to, or promised to be.
    owned: OwnedFile,
    buffer: Vec<u8>,
    /// The buffer is written out when it holds this many bytes.
    buffer_bytes: usize,
    checksum: crc32fast::Hasher,
    /// Bytes of stretches whose checksums have not come back.
    promised_bytes: u64,
    count: u64,
    marker: PhantomData<R>,
}

impl<R: Record> RecordWriter<R> {
    /// Creates `name` in `workspace`. With `count_expected` the disk space is allocated first, so
    /// that a full disk is an early, clean error.
    ///
    /// # Errors
    /// [`crate::Error::Io`] when the file cannot be made or the disk is full.
    pub fn create(workspace: &Workspace, name: &str, count_expected: Option<u64>) -> Result<Self> {
        Self::create_buffered(workspace, name, count_expected, IO_BLOCK_BYTES)
    }

    /// As [`Self::create`], with a buffer of `buffer_bytes` instead of [`IO_BLOCK_BYTES`]: for
    /// writers that are many, or are given large slices (those pass the buffer by).
    ///
    /// # Errors
    /// As [`Self::create`].
    pub fn create_buffered(
        workspace: &Workspace,
        name: &str,
        count_expected: Option<u64>,
        buffer_bytes: usize,
    ) -> Result<Self> {
        let path = workspace.new_path(name);
        let file = system::create_new(&path).at("create", &path)?;
        let disk = workspace.disk();
        let file = Arc::new(NamedFile { file, path: path.clone() });
        let owned = OwnedFile { path, bytes: 0, disk, is_given_up: false };
        if let Some(bytes) = count_expected.and_then(|n| n.checked_mul(size_of::<R>() as u64)) {
            system::allocate(&file.file, bytes + HEADER_BYTES as u64)
                .at("allocate", &owned.path)?;
        }
        let buffer_bytes = buffer_bytes.clamp(HEADER_BYTES, IO_BLOCK_BYTES);
        let mut buffer = Vec::with_capacity(buffer_bytes + size_of::<R>());
        buffer.resize(HEADER_BYTES, 0);
        let checksum = crc32fast::Hasher::new();
        let (promised_bytes, count) = (0, 0);
        let marker = PhantomData;
        Ok(Self { file, owned, buffer, buffer_bytes, checksum, promised_bytes, count, marker })
    }

    /// Goes on with a file that was noted unfinished, behind the records that were noted: what a run
    /// that died wrote behind them is cut off.
    ///
    /// # Errors
    /// [`Error::Damaged`] when there is no such file, or less in it than was noted.
    pub fn reopen(workspace: &Workspace, entry: &FileEntry, buffer_bytes: usize) -> Result<Self> {
        let path = workspace.path().join(&entry.name);
        if entry.finished || entry.record_bytes as usize != size_of::<R>() {
            return Err(Error::Damaged { path, what: "holds records of another kind" });
        }
        let file = system::reopen(&path).at("open", &path)?;
        let records_bytes = entry.count.saturating_mul(size_of::<R>() as u64);
        let bytes = records_bytes.saturating_add(HEADER_BYTES as u64);
        if file_bytes(&file, &path)? < bytes {
            return Err(Error::Damaged { path, what: "holds fewer records than were noted" });
        }
        system::set_len(&file, bytes).at("truncate", &path)?;
        workspace.give_up(&entry.name);
        let disk = workspace.disk();
        disk.take(bytes);
        let file = Arc::new(NamedFile { file, path: path.clone() });
        let owned = OwnedFile { path, bytes, disk, is_given_up: false };
        let buffer_bytes = buffer_bytes.clamp(HEADER_BYTES, IO_BLOCK_BYTES);
        let buffer = Vec::with_capacity(buffer_bytes + size_of::<R>());
        let checksum = crc32fast::Hasher::new_with_initial_len(entry.checksum, records_bytes);
        let (promised_bytes, count, marker) = (0, entry.count, PhantomData);
        Ok(Self { file, owned, buffer, buffer_bytes, checksum, promised_bytes, count, marker })
    }

    /// Writes what waits in the buffer, and says what the file holds so far.
    pub(super) fn entry(&mut self) -> Result<FileEntry> {
        self.flush()?;
        assert_eq!(self.promised_bytes, 0, "a stretch was not written");
        Ok(FileEntry {
            name: self.owned.name(),
            count: self.count,
            record_bytes: size_of::<R>() as u32,
            checksum: self.checksum.clone().finalize(),
            finished: false,
        })
    }

    /// Appends one record.
    ///
    /// # Errors
    /// [`crate::Error::Io`] when the disk does not take it.
    pub fn push(&mut self, record: &R) -> Result<()> {
        self.buffer.extend_from_slice(record.as_bytes());
        self.count += 1;
        if self.buffer.len() >= self.buffer_bytes {
            self.flush()?;
        }
        Ok(())
    }

    /// Appends records in order.
    ///
    /// # Errors
    /// As [`Self::push`].
    pub fn extend(&mut self, records: &[R]) -> Result<()> {
        let mut bytes = records.as_bytes();
        self.count += records.len() as u64;
        while !bytes.is_empty() {
            if self.buffer.is_empty() && bytes.len() >= self.buffer_bytes {
                let (now, later) = bytes.split_at(bytes.len().min(IO_BLOCK_BYTES));
                self.write(now)?;
                bytes = later;
                continue;
            }
            let room = self.buffer_bytes.saturating_sub(self.buffer.len());
            let (now, later) = bytes.split_at(room.min(bytes.len()));
            self.buffer.extend_from_slice(now);
            bytes = later;
            if self.buffer.len() >= self.buffer_bytes {
                self.flush()?;
            }
        }
        Ok(())
    }

    /// Appends records in order, as [`Self::extend`] does, but leaves the writing of full buffers
    /// to whoever owns `full`: so that this call is short, and can be made in turn by threads that
    /// then write at the same time.
    ///
    /// # Errors
    /// As [`Self::push`].
    pub fn extend_deferred(&mut self, records: &[R], full: &mut FullBuffers) -> Result<()> {
        let mut bytes = records.as_bytes();
        self.count += records.len() as u64;
        loop {
            // Copying much to write it elsewhere costs more than the others' wait.
            if self.buffer.is_empty() && bytes.len() >= self.buffer_bytes {
                let (now, later) = bytes.split_at(bytes.len().min(IO_BLOCK_BYTES));
                self.write(now)?;
                bytes = later;
                continue;
            }
            let room = self.buffer_bytes.saturating_sub(self.buffer.len());
            let (now, later) = bytes.split_at(room.min(bytes.len()));
            self.buffer.extend_from_slice(now);
            bytes = later;
            if bytes.is_empty() {
                return Ok(());
            }
            let stretch = self.count_buffer();
            self.buffer = full.exchange(stretch, std::mem::take(&mut self.buffer))?;
        }
    }

    /// Promises that the next `count` records will be written to the stretch returned, on any
    /// thread. Its checksum goes to [`Self::absorb`].
    ///
    /// # Errors
    /// As [`Self::push`].
    pub fn promise(&mut self, count: u64) -> Result<Stretch> {
        self.flush()?;
        let bytes = count * size_of::<R>() as u64;
        let stretch = Stretch::new(&self.file, self.owned.bytes, bytes);
        self.owned.grow(bytes);
        self.promised_bytes += bytes;
        self.count += count;
        Ok(stretch)
    }

    /// Takes the checksums of promised stretches, in their order, when they have been written and
    /// before anything is appended behind them.
    pub fn absorb(&mut self, count: u64, sum: &Sum) {
        self.promised_bytes -= count * size_of::<R>() as u64;
        self.checksum.combine(&sum.0);
    }

    /// Records appended so far.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Writes the header and hands the file over for reading.
    ///
    /// # Errors
    /// As [`Self::push`].
    pub fn finish(mut self) -> Result<RecordFile<R>> {
        self.flush()?;
        assert_eq!(self.promised_bytes, 0, "a stretch was not written");
        let checksum = self.checksum.finalize();
        let header = Header::of::<R>(self.count, checksum);
        let file = &self.file.file;
        system::write_all_at(file, header.as_bytes(), 0).at("write", &self.owned.path)?;
        // Gives back what was allocated and not needed.
        system::set_len(file, self.owned.bytes).at("truncate", &self.owned.path)?;
        header.check::<R>(&self.owned.path, self.owned.bytes)?;
        let (file, count) = (Arc::new(self.owned), self.count);
        Ok(RecordFile { file, count, checksum, marker: PhantomData })
    }

    fn flush(&mut self) -> Result<()> {
        let mut stretch = self.count_buffer();
        stretch.write_bytes(&self.buffer)?;
        self.buffer.clear();
        Ok(())
    }

    /// Counts the buffer as written, and says where it goes.
    fn count_buffer(&mut self) -> Stretch {
        // The place of the header passes through the buffer once, outside the checksum.
        let skip = if self.owned.bytes == 0 { HEADER_BYTES } else { 0 };
        self.checksum.update(&self.buffer[skip..]);
        let bytes = self.buffer.len() as u64;
        let stretch = Stretch::new(&self.file, self.owned.bytes, bytes);
        self.owned.grow(bytes);
        stretch
    }

    /// Writes record bytes past the empty buffer.
    fn write(&mut self, bytes: &[u8]) -> Result<()> {
        debug_assert!(self.buffer.is_empty() && self.owned.bytes > 0, "the header goes first");
        debug_assert!(self.promised_bytes == 0, "checksums come in order");
        self.checksum.update(bytes);
        Stretch::new(&self.file, self.owned.bytes, bytes.len() as u64).write_bytes(bytes)?;
        self.owned.grow(bytes.len() as u64);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::{
        fs::{self, File},
        io::Read as _,
        os::unix::fs::FileExt as _,
    };

    use super::*;
    use crate::error::Error;

    fn workspace() -> Workspace {
        Workspace::for_test()
    }

    #[test]
    fn records_come_back_in_order() {
        let workspace = workspace();
        let mut writer = RecordWriter::<u64>::create(&workspace, "numbers", Some(100_000)).unwrap();
        writer.extend(&(0..99_999).collect::<Vec<u64>>()).unwrap();
        writer.push(&99_999).unwrap();
        let file = writer.finish().unwrap();
        assert_eq!(file.count(), 100_000);
        assert_eq!(file.read_all().unwrap(), (0..100_000).collect::<Vec<u64>>());
        assert_eq!(
            file.scan_range(70_000, 2).unwrap().next_batch().unwrap(),
            Some(&[70_000, 70_001][..])
        );
    }

    #[test]
    fn the_size_of_the_buffer_does_not_show_in_the_file() {
        let workspace = workspace();
        let numbers: Vec<u64> = (0..100_000).collect();
        let bytes = [0, 100, 1 << 16, IO_BLOCK_BYTES].map(|buffer_bytes| {
            let name = "numbers";
            let mut writer =
                RecordWriter::<u64>::create_buffered(&workspace, name, None, buffer_bytes).unwrap();
            writer.extend(&numbers[..1]).unwrap();
            writer.extend(&numbers[1..77_777]).unwrap();
            writer.push(&77_777).unwrap();
            writer.extend(&numbers[77_778..]).unwrap();
            let file = writer.finish().unwrap();
            assert_eq!(file.read_all().unwrap(), numbers);
            fs::read(file.path()).unwrap()
        });
        assert!(bytes.iter().all(|other| *other == bytes[0]));
    }

    #[test]
    fn an_unfinished_file_leaves_nothing() {
        let workspace = workspace();
        let mut writer = RecordWriter::<u64>::create(&workspace, "numbers", None).unwrap();
        writer.extend(&[1; 100_000]).unwrap();
        let path = writer.owned.path.clone();
        assert!(path.exists() && workspace.disk_bytes() > 0);
        drop(writer);
        assert!(!path.exists());
        assert_eq!(workspace.disk_bytes(), 0);
    }

    #[test]
    fn a_flipped_bit_is_found_at_the_end_of_the_scan() {
        let workspace = workspace();
        let mut writer = RecordWriter::<u64>::create(&workspace, "numbers", None).unwrap();
        writer.extend(&[7; 1000]).unwrap();
        let file = writer.finish().unwrap();
        let disk = File::options().write(true).open(file.path()).unwrap();
        disk.write_all_at(&[6], HEADER_BYTES as u64 + 4000).unwrap();
        assert!(matches!(file.read_all(), Err(Error::Damaged { .. })));
    }

    #[test]
    fn a_torn_file_is_refused() {
        let workspace = workspace();
        let mut writer = RecordWriter::<u64>::create(&workspace, "numbers", None).unwrap();
        writer.extend(&[7; 1000]).unwrap();
        let file = writer.finish().unwrap();
        let mut bytes = Vec::new();
        fs::OpenOptions::new()
            .read(true)
            .open(file.path())
            .unwrap()
            .read_to_end(&mut bytes)
            .unwrap();
        for length in [0, 10, HEADER_BYTES, bytes.len() - 1] {
            fs::write(file.path(), &bytes[..length]).unwrap();
            assert!(matches!(file.scan(), Err(Error::Damaged { .. })), "{length} bytes");
            assert!(matches!(file.map(), Err(Error::Damaged { .. })), "{length} bytes");
        }
    }
}
