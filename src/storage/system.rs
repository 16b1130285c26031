//! The one place through which our own files, and what is written for the user, meet the operating
//! system: so that tests can make any of these calls fail.

use std::{
    fs::{self, File},
    io::{self, Write as _},
    os::unix::fs::FileExt as _,
    path::Path,
};

use rustix::fs::{FallocateFlags, fallocate};

use super::faults::{Call, Fate, fate};

/// Creates a file that is not there, to be written and read.
pub(super) fn create_new(path: &Path) -> io::Result<File> {
    admit(Call::Create)?;
    File::options().read(true).write(true).create_new(true).open(path)
}

/// Opens one of our files for reading.
pub(super) fn open(path: &Path) -> io::Result<File> {
    admit(Call::Open)?;
    File::options().read(true).open(path)
}

/// Opens one of our files to append to it.
pub(super) fn reopen(path: &Path) -> io::Result<File> {
    admit(Call::Open)?;
    File::options().read(true).write(true).open(path)
}

/// Fills `bytes` from `offset` on.
pub(super) fn read_exact_at(file: &File, bytes: &mut [u8], offset: u64) -> io::Result<()> {
    admit(Call::Read)?;
    file.read_exact_at(bytes, offset)
}

/// Writes all of `bytes` at `offset`.
pub(super) fn write_all_at(file: &File, bytes: &[u8], offset: u64) -> io::Result<()> {
    match fate(Call::Write, bytes.len(), false) {
        Fate::Done | Fate::Short(_) => file.write_all_at(bytes, offset),
        Fate::Fails(written, error) => {
            file.write_all_at(&bytes[..written], offset)?;
            Err(error)
        }
        Fate::Flipped => {
            let mut bytes = bytes.to_vec();
            let middle = bytes.len() / 2;
            bytes[middle] ^= 1;
            file.write_all_at(&bytes, offset)
        }
    }
}

/// Appends some of `bytes` to an output.
pub(super) fn write(mut file: &File, bytes: &[u8]) -> io::Result<usize> {
    match fate(Call::Write, bytes.len(), true) {
        Fate::Done | Fate::Flipped => file.write(bytes),
        Fate::Short(written) => file.write(&bytes[..written]),
        Fate::Fails(written, error) => {
            file.write_all(&bytes[..written])?;
            Err(error)
        }
    }
}

/// Reserves disk space; file systems that cannot are left to fail at the write.
pub(super) fn allocate(file: &File, bytes: u64) -> io::Result<()> {
    if let Fate::Fails(_, error) = fate(Call::Allocate, bytes as usize, false) {
        return Err(error);
    }
    match fallocate(file, FallocateFlags::KEEP_SIZE, 0, bytes.max(1)) {
        Err(rustix::io::Errno::OPNOTSUPP | rustix::io::Errno::NOSYS) => Ok(()),
        other => Ok(other?),
    }
}

/// Cuts a file, or gives back what was allocated behind its end.
pub(super) fn set_len(file: &File, bytes: u64) -> io::Result<()> {
    admit(Call::SetLength)?;
    file.set_len(bytes)
}

/// Waits until a file, or what a folder says, is on the disk.
pub(super) fn sync(file: &File) -> io::Result<()> {
    admit(Call::Sync)?;
    file.sync_all()
}

/// Waits until all that was written to the file system of `folder` is on the disk: for many files
/// this is far cheaper than one after the other.
pub(super) fn sync_all_of(folder: &File) -> io::Result<()> {
    admit(Call::Sync)?;
    Ok(rustix::fs::syncfs(folder)?)
}

/// Gives a file another name, in place of what has it.
pub(super) fn rename(from: &Path, to: &Path) -> io::Result<()> {
    admit(Call::Rename)?;
    fs::rename(from, to)
}

/// Lets somebody else create a file.
pub(super) fn create_by<T>(create: impl FnOnce() -> io::Result<T>) -> io::Result<T> {
    admit(Call::Create)?;
    create()
}

/// Lets somebody else give a file another name.
pub(super) fn rename_by<T>(rename: impl FnOnce() -> io::Result<T>) -> io::Result<T> {
    admit(Call::Rename)?;
    rename()
}

/// Writes all of `bytes` over the beginning of an output.
pub(super) fn overwrite(file: &File, bytes: &[u8]) -> io::Result<()> {
    match fate(Call::Write, bytes.len(), true) {
        Fate::Done | Fate::Flipped | Fate::Short(_) => file.write_all_at(bytes, 0),
        Fate::Fails(written, error) => {
            file.write_all_at(&bytes[..written], 0)?;
            Err(error)
        }
    }
}

fn admit(call: Call) -> io::Result<()> {
    match fate(call, 0, false) {
        Fate::Fails(_, error) => Err(error),
        Fate::Done | Fate::Short(_) | Fate::Flipped => Ok(()),
    }
}
