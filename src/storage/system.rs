//! The one place through which our own files, and what is written for the user, meet the operating
//! system: so that one place can make any of it fail.

use std::{
    fs::{self, File},
    io::{self, Write as _},
    os::unix::fs::FileExt as _,
    path::Path,
};

use rustix::fs::{FallocateFlags, fallocate};

/// Creates a file that is not there, to be written and read.
pub(super) fn create_new(path: &Path) -> io::Result<File> {
    File::options().read(true).write(true).create_new(true).open(path)
}

/// Opens one of our files for reading.
pub(super) fn open(path: &Path) -> io::Result<File> {
    File::options().read(true).open(path)
}

/// Opens one of our files to append to it.
pub(super) fn reopen(path: &Path) -> io::Result<File> {
    File::options().read(true).write(true).open(path)
}

/// Fills `bytes` from `offset` on.
pub(super) fn read_exact_at(file: &File, bytes: &mut [u8], offset: u64) -> io::Result<()> {
    file.read_exact_at(bytes, offset)
}

/// Writes all of `bytes` at `offset`.
pub(super) fn write_all_at(file: &File, bytes: &[u8], offset: u64) -> io::Result<()> {
    file.write_all_at(bytes, offset)
}

/// Appends some of `bytes`.
pub(super) fn write(mut file: &File, bytes: &[u8]) -> io::Result<usize> {
    file.write(bytes)
}

/// Reserves disk space; file systems that cannot are left to fail at the write.
pub(super) fn allocate(file: &File, bytes: u64) -> io::Result<()> {
    match fallocate(file, FallocateFlags::KEEP_SIZE, 0, bytes.max(1)) {
        Err(rustix::io::Errno::OPNOTSUPP | rustix::io::Errno::NOSYS) => Ok(()),
        other => Ok(other?),
    }
}

/// Cuts a file, or gives back what was allocated behind its end.
pub(super) fn set_len(file: &File, bytes: u64) -> io::Result<()> {
    file.set_len(bytes)
}

/// Waits until a file, or what a folder says, is on the disk.
pub(super) fn sync(file: &File) -> io::Result<()> {
    file.sync_all()
}

/// Waits until all that was written to the file system of `folder` is on the disk: for many files
/// this is far cheaper than one after the other.
pub(super) fn sync_all_of(folder: &File) -> io::Result<()> {
    Ok(rustix::fs::syncfs(folder)?)
}

/// Gives a file another name, in place of what has it.
pub(super) fn rename(from: &Path, to: &Path) -> io::Result<()> {
    fs::rename(from, to)
}
