//! Files of the user: inputs opened, outputs that appear under their name only when complete.

use std::{
    fs::{self, File},
    io::{self, Seek as _, Write},
    path::{Path, PathBuf},
};

use rustix::fs::{Access, access};
use tempfile::NamedTempFile;

use super::system;
use crate::error::{IoContext as _, Result};

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
/// [`crate::Error::Io`] when it does not exist, cannot be read, or is a directory.
pub fn open_input(path: &Path) -> Result<File> {
    let file = File::options().read(true).open(path).at("open", path)?;
    if file.metadata().at("examine", path)?.is_dir() {
        return Err(io::Error::from(io::ErrorKind::IsADirectory)).at("read", path);
    }
    Ok(file)
}

/// Whether `path` is there and neither a file nor a folder: a device or a pipe. It is written to
/// as it is, front to back.
#[must_use]
pub fn is_stream(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|found| !found.is_file() && !found.is_dir())
}

/// Refuses an output that cannot be made, before any work is done for it: one that is a folder, a
/// link to nothing, or in a folder that cannot be written to. Names that are taken are the
/// caller's to judge.
///
/// # Errors
/// [`crate::Error::Io`], as [`OutputFile::create`] would fail.
pub fn check_output(path: &Path) -> Result<()> {
    let path = &resolve(path)?;
    match fs::metadata(path) {
        Ok(found) if found.is_dir() => {
            Err(io::Error::from(io::ErrorKind::IsADirectory)).at("write", path)
        }
        Ok(found) if !found.is_file() => access(path, Access::WRITE_OK).at("write", path),
        _ => {
            let folder = folder_of(path);
            access(folder, Access::WRITE_OK | Access::EXEC_OK).at("write in the folder", folder)
        }
    }
}

/// The folder a file is in.
fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."))
}

/// Where a link leads: the file there is replaced, not the link. Links to streams stay as they
/// are, since that of standard output may lead to a pipe without a name.
fn resolve(path: &Path) -> Result<PathBuf> {
    if !is_stream(path) && fs::symlink_metadata(path).is_ok_and(|found| found.is_symlink()) {
        return fs::canonicalize(path).at("follow the link", path);
    }
    Ok(path.to_owned())
}

/// A file being written beside its final name as `NAME.*.partial`; [`Self::finish`] syncs and
/// renames it, dropping it removes it. A device or pipe of that name is written to directly.
#[derive(Debug)]
pub struct OutputFile {
    sink: Sink,
    path: PathBuf,
    overwrite: Overwrite,
}

#[derive(Debug)]
enum Sink {
    Partial(NamedTempFile),
    Stream {
        file: File,
        /// Streams cannot tell their position.
        written_bytes: u64,
    },
}

impl OutputFile {
    /// Starts an output file that will be called `path`.
    ///
    /// # Errors
    /// [`crate::Error::Io`] when the name is taken ([`Overwrite::Refuse`]) or is a directory, or the
    /// folder cannot be written to.
    pub fn create(path: &Path, overwrite: Overwrite) -> Result<Self> {
        let path = resolve(path)?;
        if is_stream(&path) {
            let file = File::options().write(true).open(&path).at("open", &path)?;
            return Ok(Self { sink: Sink::Stream { file, written_bytes: 0 }, path, overwrite });
        }
        match fs::metadata(&path) {
            Ok(found) if found.is_dir() => {
                return Err(io::Error::from(io::ErrorKind::IsADirectory)).at("write", &path);
            }
            Ok(_) if overwrite == Overwrite::Refuse => {
                return Err(io::Error::from(io::ErrorKind::AlreadyExists)).at("create", &path);
            }
            _ => {}
        }
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let create = || {
            tempfile::Builder::new()
                .prefix(&format!("{name}."))
                .suffix(".partial")
                .permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666))
                .tempfile_in(folder_of(&path))
        };
        let partial = system::create_by(create).at("create", &path)?;
        Ok(Self { sink: Sink::Partial(partial), path, overwrite })
    }

    /// Reserves disk space for `bytes`, so that a full disk is an early, clean error.
    ///
    /// # Errors
    /// [`crate::Error::Io`] when the disk is full.
    pub fn allocate(&self, bytes: u64) -> Result<()> {
        match &self.sink {
            Sink::Partial(partial) => {
                system::allocate(partial.as_file(), bytes).at("allocate", &self.path)
            }
            Sink::Stream { .. } => Ok(()),
        }
    }

    /// Final name.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Overwrites the first bytes, for headers whose counts are known only at the end.
    ///
    /// # Errors
    /// [`crate::Error::Io`] when the disk does not take it, or this is a stream.
    pub fn patch(&mut self, bytes: &[u8]) -> Result<()> {
        let file = match &self.sink {
            Sink::Partial(partial) => partial.as_file(),
            Sink::Stream { file, .. } => file,
        };
        system::overwrite(file, bytes).at("write", &self.path)
    }

    /// Syncs the file and gives it its name. Returns its size.
    ///
    /// # Errors
    /// [`crate::Error::Io`] when the disk is full or the name was taken meanwhile.
    pub fn finish(self) -> Result<u64> {
        let Self { sink, path, overwrite } = self;
        let mut partial = match sink {
            Sink::Partial(partial) => partial,
            Sink::Stream { written_bytes, .. } => return Ok(written_bytes),
        };
        let file = partial.as_file_mut();
        let size_bytes = file.stream_position().at("write", &path)?;
        system::set_len(file, size_bytes).at("truncate", &path)?;
        system::sync(file).at("sync", &path)?;
        let rename = || match overwrite {
            Overwrite::Replace => partial.persist(&path),
            Overwrite::Refuse => partial.persist_noclobber(&path),
        };
        let renamed = system::rename_by(|| rename().map_err(|failed| failed.error));
        renamed.map(drop).at("rename to", &path)?;
        Ok(size_bytes)
    }
}

impl Write for OutputFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match &mut self.sink {
            Sink::Partial(partial) => system::write(partial.as_file(), bytes),
            Sink::Stream { file, written_bytes } => {
                let written = system::write(file, bytes)?;
                *written_bytes += written as u64;
                Ok(written)
            }
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match &mut self.sink {
            Sink::Partial(partial) => partial.as_file_mut().flush(),
            Sink::Stream { file, .. } => file.flush(),
        }
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

    #[test]
    fn a_device_is_written_to_and_stays_a_device() {
        let null = Path::new("/dev/null");
        let mut output = OutputFile::create(null, Overwrite::Refuse).unwrap();
        output.write_all(b"gone").unwrap();
        assert_eq!(output.finish().unwrap(), 4);
        assert!(is_stream(null));
        let mut full = OutputFile::create(Path::new("/dev/full"), Overwrite::Refuse).unwrap();
        assert!(full.write_all(b"no room").is_err());
    }

    #[test]
    fn a_link_stays_and_the_file_it_leads_to_is_replaced() {
        let workspace = Workspace::for_test();
        let [file, link] = ["file", "link"].map(|name| workspace.path().join(name));
        std::os::unix::fs::symlink(&file, &link).unwrap();
        assert!(check_output(&link).is_err(), "a link to nothing");
        fs::write(&file, b"old").unwrap();
        assert!(OutputFile::create(&link, Overwrite::Refuse).is_err());
        let mut output = OutputFile::create(&link, Overwrite::Replace).unwrap();
        output.write_all(b"new").unwrap();
        output.finish().unwrap();
        assert!(link.is_symlink());
        assert_eq!(fs::read(&file).unwrap(), b"new");
    }

    #[test]
    fn what_cannot_be_written_is_known_beforehand() {
        let workspace = Workspace::for_test();
        check_output(&workspace.path().join("new")).unwrap();
        check_output(Path::new("/dev/null")).unwrap();
        assert!(check_output(workspace.path()).is_err());
        let error = check_output(&workspace.path().join("no/such/folder/file")).unwrap_err();
        assert!(error.to_string().ends_with("no/such/folder"), "{error}");
    }
}
