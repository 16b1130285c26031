//! The private folder of one job, and the disk it uses.

use std::{
    fs::{self, File},
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
};

use rustix::{
    fs::{FlockOperation, flock, statvfs},
    process::{Resource, getrlimit},
};
use tempfile::TempDir;

use super::{
    Budget,
    disk_use::DiskUse,
    journal::{Journal, MANIFEST},
    system,
};
use crate::error::{IoContext as _, Result};

/// The room one job has: a locked folder for temporary files, removed with all its contents on
/// drop unless it is kept, and a memory budget.
#[derive(Debug)]
pub struct Workspace {
    /// Dropped, and its files with it, before the folder is.
    pub(super) journal: Option<Journal>,
    folder: Folder,
    /// Held locked as long as the folder is in use.
    _lock: File,
    pub(super) disk: Arc<DiskUse>,
    pub(super) serial: AtomicU64,
    budget: Budget,
}

/// What workspaces are called, before what tells them apart.
pub(super) const PREFIX: &str = "meshmill-";
/// What ends their names until they are locked: one that is found without it has been locked.
pub(super) const UNLOCKED: &str = ".new";
/// Name of the file that is locked.
pub(super) const LOCK: &str = "lock";

/// A folder that goes with all its contents.
#[derive(Debug)]
struct Folder {
    path: PathBuf,
    is_kept: bool,
}

impl Drop for Folder {
    fn drop(&mut self) {
        let is_wanted =
            self.is_kept || std::thread::panicking() && self.path.join(MANIFEST).exists();
        if !is_wanted {
            // First of all, so that nobody goes on from what is left if this is interrupted.
            let _ = fs::remove_file(self.path.join(MANIFEST));
            let _ = fs::remove_dir_all(&self.path);
        }
    }
}

impl Workspace {
    /// Makes a new folder inside `parent`; memory is not limited before [`Self::with_budget`].
    ///
    /// # Errors
    /// [`crate::Error::Io`] when `parent` does not exist or cannot be written to.
    pub fn create(parent: &Path) -> Result<Self> {
        Self::create_for(parent, "")
    }

    /// As [`Self::create`], for a job that is known by `key`: so that its workspace can be found.
    ///
    /// # Errors
    /// As [`Self::create`].
    pub fn create_for(parent: &Path, key: &str) -> Result<Self> {
        let folder = tempfile::Builder::new()
            .prefix(&format!("{PREFIX}{key}"))
            .suffix(UNLOCKED)
            .tempdir_in(parent)
            .at("create a temporary folder in", parent)?;
        let mut folder = Folder { path: folder.keep(), is_kept: false };
        let path = folder.path.join(LOCK);
        let lock = system::create_new(&path).at("create", &path)?;
        flock(&lock, FlockOperation::NonBlockingLockExclusive).at("lock", &path)?;
        let locked = folder.path.with_extension("");
        system::rename(&folder.path, &locked).at("rename", &folder.path)?;
        folder.path = locked;
        Ok(Self::in_folder(folder, lock))
    }

    /// Takes over a folder whose lock is held.
    pub(super) fn take_over(path: PathBuf, lock: File) -> Self {
        Self::in_folder(Folder { path, is_kept: true }, lock)
    }

    fn in_folder(folder: Folder, lock: File) -> Self {
        let (disk, serial) = (Arc::default(), AtomicU64::new(0));
        Self { journal: None, folder, _lock: lock, disk, serial, budget: Budget::new(u64::MAX) }
    }

    /// The same folder with a memory budget.
    #[must_use]
    pub fn with_budget(self, budget: Budget) -> Self {
        Self { budget, ..self }
    }

    /// The memory of the job.
    #[must_use]
    pub fn budget(&self) -> &Budget {
        &self.budget
    }

    /// A workspace for unit tests.
    #[cfg(test)]
    pub(crate) fn for_test() -> Self {
        Self::create(Path::new("/tmp")).expect("/tmp can be written to")
    }

    /// The folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.folder.path
    }

    /// Leaves the folder in place when dropped, and says where it is.
    #[must_use]
    pub fn keep(mut self) -> PathBuf {
        self.folder.is_kept = true;
        self.folder.path.clone()
    }

    /// Removes the folder when dropped, even if it was there before.
    #[must_use]
    pub fn to_be_removed(mut self) -> Self {
        self.folder.is_kept = false;
        self
    }

    /// Bytes of temporary files now.
    #[must_use]
    pub fn disk_bytes(&self) -> u64 {
        self.disk.current.load(Ordering::Relaxed)
    }

    /// Bytes of temporary files at their peak.
    #[must_use]
    pub fn disk_bytes_peak(&self) -> u64 {
        self.disk.peak.load(Ordering::Relaxed)
    }

    /// A path for a new file. The serial number makes it unique.
    pub(super) fn new_path(&self, name: &str) -> PathBuf {
        let serial = self.serial.fetch_add(1, Ordering::Relaxed);
        self.folder.path.join(format!("{serial:05}-{name}"))
    }

    pub(super) fn disk(&self) -> Arc<DiskUse> {
        Arc::clone(&self.disk)
    }
}

/// A private folder inside a [`Workspace`], for files that a foreign library makes by itself.
/// It is removed with its contents on drop.
#[derive(Debug)]
pub struct ForeignFolder {
    folder: TempDir,
    /// Bytes counted by [`Self::count`] so far.
    bytes: u64,
    disk: Arc<DiskUse>,
}

impl ForeignFolder {
    /// Makes an empty folder in `workspace`.
    ///
    /// # Errors
    /// [`crate::Error::Io`] when the folder cannot be made.
    pub fn create(workspace: &Workspace, name: &str) -> Result<Self> {
        let folder = tempfile::Builder::new()
            .prefix(name)
            .tempdir_in(workspace.path())
            .at("create a temporary folder in", workspace.path())?;
        Ok(Self { folder, bytes: 0, disk: workspace.disk() })
    }

    /// The folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Counts `bytes` that the library is about to write here.
    pub fn count(&mut self, bytes: u64) {
        self.bytes += bytes;
        self.disk.take(bytes);
    }
}

impl Drop for ForeignFolder {
    fn drop(&mut self) {
        self.disk.give_back(self.bytes);
    }
}

/// Files one out-of-core step may hold open: a quarter of what the process may, since steps run
/// beside each other, and no more than make one faster.
#[must_use]
pub fn open_files_max() -> usize {
    let limit = getrlimit(Resource::Nofile).current.unwrap_or(u64::MAX);
    (limit / 4).clamp(8, OPEN_FILES_MAX as u64) as usize
}

/// More buckets hardly make a step faster: 1.5 GB in as many pieces fit the processor's cache.
const OPEN_FILES_MAX: usize = 1024;

/// Bytes an unprivileged process may still write to the file system of `path`.
///
/// # Errors
/// [`crate::Error::Io`] when `path` does not exist.
pub fn available_disk_bytes(path: &Path) -> Result<u64> {
    let stat = statvfs(path).at("examine the file system of", path)?;
    Ok(stat.f_bavail.saturating_mul(stat.f_frsize))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_folder_goes_with_the_workspace_unless_kept() {
        let workspace = Workspace::for_test();
        let path = workspace.path().to_owned();
        assert!(path.is_dir());
        drop(workspace);
        assert!(!path.exists());
        let kept = Workspace::for_test().keep();
        assert!(kept.is_dir());
        std::fs::remove_dir_all(kept).unwrap();
    }

    #[test]
    fn a_missing_parent_is_an_error_that_names_it() {
        let error = Workspace::create(Path::new("/no/such/folder")).unwrap_err();
        assert!(error.to_string().contains("/no/such/folder"), "{error}");
    }
}
