//! The private folder of one job, and the disk it uses.

use std::{
    fs::File,
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

use super::Budget;
use crate::error::{IoContext as _, Result};

/// Temporary bytes on disk now and at most.
#[derive(Debug, Default)]
pub(super) struct DiskUse {
    current: AtomicU64,
    peak: AtomicU64,
}

impl DiskUse {
    pub(super) fn take(&self, bytes: u64) {
        let now = self.current.fetch_add(bytes, Ordering::Relaxed) + bytes;
        self.peak.fetch_max(now, Ordering::Relaxed);
    }

    pub(super) fn give_back(&self, bytes: u64) {
        self.current.fetch_sub(bytes, Ordering::Relaxed);
    }
}

/// The room one job has: a new, locked folder for temporary files, removed with all its contents
/// on drop, and a memory budget.
#[derive(Debug)]
pub struct Workspace {
    folder: TempDir,
    /// Held locked as long as the folder is in use.
    _lock: File,
    disk: Arc<DiskUse>,
    serial: AtomicU64,
    budget: Budget,
}

impl Workspace {
    /// Makes a new folder inside `parent`; memory is not limited before [`Self::with_budget`].
    ///
    /// # Errors
    /// [`crate::Error::Io`] when `parent` does not exist or cannot be written to.
    pub fn create(parent: &Path) -> Result<Self> {
        let folder = tempfile::Builder::new()
            .prefix("meshmill-")
            .tempdir_in(parent)
            .at("create a temporary folder in", parent)?;
        let path = folder.path().join("lock");
        let lock = File::options().write(true).create_new(true).open(&path).at("create", &path)?;
        flock(&lock, FlockOperation::NonBlockingLockExclusive).at("lock", &path)?;
        let disk = Arc::default();
        let budget = Budget::new(u64::MAX);
        Ok(Self { folder, _lock: lock, disk, serial: AtomicU64::new(0), budget })
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
        self.folder.path()
    }

    /// Leaves the folder in place when dropped, and says where it is.
    #[must_use]
    pub fn keep(mut self) -> PathBuf {
        self.folder.disable_cleanup(true);
        self.folder.path().to_owned()
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
        self.folder.path().join(format!("{serial:05}-{name}"))
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
