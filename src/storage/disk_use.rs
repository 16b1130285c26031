//! The files of a workspace: how much disk they take, and when those that nobody needs go.

use std::{
    collections::HashSet,
    fs,
    path::{Path, PathBuf},
    sync::{
        Mutex, MutexGuard, PoisonError,
        atomic::{AtomicU64, Ordering},
    },
};

/// Temporary bytes on disk now and at most, and the files that must stay.
#[derive(Debug, Default)]
pub(super) struct DiskUse {
    pub(super) current: AtomicU64,
    pub(super) peak: AtomicU64,
    pins: Mutex<Pins>,
}

#[derive(Debug, Default)]
struct Pins {
    /// Files the manifest on disk names, or is about to.
    named: HashSet<String>,
    /// Those of them that nobody needs any more, and their bytes.
    dead: Vec<(PathBuf, u64)>,
}

impl DiskUse {
    pub(super) fn take(&self, bytes: u64) {
        let now = self.current.fetch_add(bytes, Ordering::Relaxed) + bytes;
        self.peak.fetch_max(now, Ordering::Relaxed);
    }

    pub(super) fn give_back(&self, bytes: u64) {
        self.current.fetch_sub(bytes, Ordering::Relaxed);
    }

    /// Removes a file, as soon as no manifest names it.
    pub(super) fn remove(&self, path: &Path, bytes: u64) {
        let mut pins = self.pins();
        let name = path.file_name().and_then(|name| name.to_str());
        if name.is_some_and(|name| pins.named.contains(name)) {
            pins.dead.push((path.to_owned(), bytes));
            return;
        }
        drop(pins);
        // The workspace removes what cannot be removed here.
        let _ = fs::remove_file(path);
        self.give_back(bytes);
    }

    /// These are named, too.
    pub(super) fn name(&self, names: impl Iterator<Item = String>) {
        self.pins().named.extend(names);
    }

    /// From now on exactly these are named: of all others the dead ones go.
    pub(super) fn name_only(&self, names: HashSet<String>) {
        let mut pins = self.pins();
        pins.named = names;
        let dead = std::mem::take(&mut pins.dead);
        drop(pins);
        for (path, bytes) in dead {
            self.remove(&path, bytes);
        }
    }

    pub(super) fn dead_bytes(&self) -> u64 {
        self.pins().dead.iter().map(|(_, bytes)| bytes).sum()
    }

    fn pins(&self) -> MutexGuard<'_, Pins> {
        self.pins.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
