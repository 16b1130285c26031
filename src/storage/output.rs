//! Files of the user: inputs opened, outputs that appear under their name only when complete.

use std::{
    fs::{self, File},
    io::{self, Seek as _, SeekFrom, Write},
    path::{Path, PathBuf},
};

use tempfile::NamedTempFile;

use super::writer::allocate;
use crate::error::{Error, IoContext as _, Result};

/// What to do when the output name is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Overwrite {
    /// Fail and leave it.
    Refuse,
    /// Replace it, when the new file is complete.
    Replace,
}

/// Opens a user's file for reading, front to back.
///
/// # Errors
/// [`Error::Io`] when it does not exist, cannot be read, or is a directory.
pub fn open_input(path: &Path) -> Result<File> {
    let file = File::options().read(true).open(path).at("open", path)?;
    if file.metadata().at("examine", path)?.is_dir() {
        return Err(io::Error::from(io::ErrorKind::IsADirectory)).at("read", path);
    }
    Ok(file)
}

/// A file being written beside its final name as `NAME.*.partial`; [`Self::finish`] syncs and
/// renames it, dropping it removes it.
#[derive(Debug)]
pub struct OutputFile {
    partial: NamedTempFile,
    path: PathBuf,
    overwrite: Overwrite,
}

impl OutputFile {
    /// Starts an output file that will be called `path`.
    ///
    /// # Errors
    /// [`Error::Io`] when the name is taken ([`Overwrite::Refuse`]) or is a directory, or the
    /// folder cannot be written to.
    pub fn create(path: &Path, overwrite: Overwrite) -> Result<Self> {
        match fs::metadata(path) {
            Ok(found) if found.is_dir() => {
                return Err(io::Error::from(io::ErrorKind::IsADirectory)).at("write", path);
            }
            Ok(_) if overwrite == Overwrite::Refuse => {
                return Err(io::Error::from(io::ErrorKind::AlreadyExists)).at("create", path);
            }
            _ => {}
        }
        let folder = match path.parent() {
            Some(folder) if folder != Path::new("") => folder,
            _ => Path::new("."),
        };
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let partial = tempfile::Builder::new()
            .prefix(&format!("{name}."))
            .suffix(".partial")
            .permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666))
            .tempfile_in(folder)
            .at("create", path)?;
        Ok(Self { partial, path: path.to_owned(), overwrite })
    }

    /// Reserves disk space for `bytes`, so that a full disk is an early, clean error.
    ///
    /// # Errors
    /// [`Error::Io`] when the disk is full.
    pub fn allocate(&self, bytes: u64) -> Result<()> {
        allocate(self.partial.as_file(), bytes).at("allocate", &self.path)
    }

    /// Final name.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Overwrites the first bytes, for headers whose counts are known only at the end.
    ///
    /// # Errors
    /// [`Error::Io`] when the disk does not take it.
    pub fn patch(&mut self, bytes: &[u8]) -> Result<()> {
        let file = self.partial.as_file_mut();
        let mut write = || {
            file.seek(SeekFrom::Start(0))?;
            file.write_all(bytes)?;
            file.seek(SeekFrom::End(0))
        };
        write().map(drop).at("write", &self.path)
    }

    /// Syncs the file and gives it its name. Returns its size.
    ///
    /// # Errors
    /// [`Error::Io`] when the disk is full or the name was taken meanwhile.
    pub fn finish(mut self) -> Result<u64> {
        let file = self.partial.as_file_mut();
        let size_bytes = file.stream_position().at("write", &self.path)?;
        file.set_len(size_bytes).at("truncate", &self.path)?;
        file.sync_all().at("sync", &self.path)?;
        let renamed = match self.overwrite {
            Overwrite::Replace => self.partial.persist(&self.path),
            Overwrite::Refuse => self.partial.persist_noclobber(&self.path),
        };
        renamed.map(drop).map_err(|failed| Error::Io {
            verb: "rename to",
            path: self.path,
            source: failed.error,
        })?;
        Ok(size_bytes)
    }
}

impl Write for OutputFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.partial.as_file_mut().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.partial.as_file_mut().flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::storage::Workspace;

    #[test]
    fn a_name_is_a_complete_file() {
        let workspace = Workspace::for_test();
        let path = workspace.path().join("out.bin");
        let mut output = OutputFile::create(&path, Overwrite::Refuse).unwrap();
        output.write_all(b"....rest").unwrap();
        assert!(!path.exists());
        output.patch(b"head").unwrap();
        assert_eq!(output.finish().unwrap(), 8);
        assert_eq!(fs::read(&path).unwrap(), b"headrest");
        assert!(OutputFile::create(&path, Overwrite::Refuse).is_err());
        let mut output = OutputFile::create(&path, Overwrite::Replace).unwrap();
        output.write_all(b"new").unwrap();
        drop(output);
        assert_eq!(fs::read(&path).unwrap(), b"headrest");
        let partials = fs::read_dir(workspace.path()).unwrap().count();
        assert_eq!(partials, 2, "only the lock and the output are left");
    }

    #[test]
    fn a_folder_is_no_input_and_no_output() {
        let workspace = Workspace::for_test();
        assert!(open_input(workspace.path()).is_err());
        assert!(OutputFile::create(workspace.path(), Overwrite::Replace).is_err());
    }
}
