//! What is done of a job, kept in its workspace now and then, so that it can be resumed.
//!
//! Whoever finishes a step, or a part of one, *notes* it, with its figures and files; from time to
//! time, at a *checkpoint*, the files are synced and the manifest is written with all that is noted.
//! Files that the manifest on disk names stay until one that does not name them is there.

use std::{
    collections::{BTreeMap, HashSet},
    fs::{self, File},
    path::{Path, PathBuf},
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

use serde::{Serialize, de::DeserializeOwned};

use super::{
    FileEntry, Fingerprint, Manifest, Record, RecordFile, RecordWriter, Step, Workspace,
    manifest::is_exact, record::OwnedFile, system,
};
use crate::error::{IoContext as _, Result};

/// Name of the manifest in its workspace, and while it is written.
pub(super) const MANIFEST: &str = "manifest";
const MANIFEST_NEW: &str = "manifest.new";

/// A checkpoint takes at most one part in so many of the time.
const COST_SHARE: u32 = 20;
/// With more new files than this, the whole file system is synced instead of each of them.
const SYNCED_ONE_BY_ONE: usize = 8;
/// Where files that wait for the next manifest to be removed take more than this part of the disk
/// that is used, the next manifest comes at once.
const DEAD_SHARE: u64 = 4;

/// What is done of a job.
#[derive(Debug)]
pub(super) struct Journal {
    /// Time between two checkpoints, at least.
    interval: Duration,
    /// Not if the job could not be resumed whatever was kept of it.
    is_open: AtomicBool,
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    noted: Manifest,
    /// The finished files of each step: they live as long as it is noted.
    held: BTreeMap<String, Vec<Arc<OwnedFile>>>,
    /// Files that are on the disk for certain.
    synced: HashSet<String>,
    started_at: Instant,
    saved_at: Instant,
    /// What the last checkpoint took.
    cost: Duration,
    /// Whether more is noted than the manifest says.
    is_ahead: bool,
}

/// A checkpoint that is due, from the moment it was.
#[derive(Debug)]
pub struct Due(Instant);

/// A file to be noted.
#[derive(Debug)]
pub struct Kept {
    entry: FileEntry,
    /// Of a finished one.
    file: Option<Arc<OwnedFile>>,
}

/// A step that was noted, by this run or the one before.
#[derive(Debug)]
pub struct Recalled<T> {
    /// What was noted of it.
    pub figures: T,
    /// The files it made.
    pub files: Vec<FileEntry>,
}

impl Journal {
    pub(super) fn new(job: Fingerprint, interval: Duration) -> Self {
        let noted = Manifest { job, steps: BTreeMap::new() };
        Self::resumed(noted, BTreeMap::new(), interval)
    }

    /// The journal of a run that goes on from `noted`.
    pub(super) fn resumed(
        noted: Manifest,
        held: BTreeMap<String, Vec<Arc<OwnedFile>>>,
        interval: Duration,
    ) -> Self {
        let now = Instant::now();
        let synced =
            noted.files().filter(|file| file.finished).map(|file| file.name.clone()).collect();
        let (started_at, saved_at, cost) = (now, now, Duration::ZERO);
        let state = State { noted, held, synced, started_at, saved_at, cost, is_ahead: false };
        Self { interval, is_open: AtomicBool::new(true), state: Mutex::new(state) }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn due(&self, state: &State) -> Option<Due> {
        let wait = self.interval.max(if self.interval.is_zero() {
            Duration::ZERO
        } else {
            state.cost.saturating_mul(COST_SHARE)
        });
        (state.saved_at.elapsed() >= wait).then(|| Due(Instant::now()))
    }
}

impl State {
    fn set(&mut self, name: &str, step: Step, files: Vec<Kept>) {
        let held = files.into_iter().filter_map(|kept| kept.file).collect();
        self.noted.steps.insert(name.to_owned(), step);
        self.held.insert(name.to_owned(), held);
        self.is_ahead = true;
    }
}

impl Workspace {
    /// Starts a journal of `job`: what is noted from here on is kept every `interval`, or a little
    /// more seldom where that would cost much.
    #[must_use]
    pub fn with_journal(mut self, job: Fingerprint, interval: Duration) -> Self {
        self.journal = Some(Journal::new(job, interval));
        self
    }

    /// Whether steps are noted at all.
    #[must_use]
    pub fn is_journaled(&self) -> bool {
        self.open_journal().is_some()
    }

    /// Gives up keeping anything: the job could not be resumed, since what it read is gone.
    pub fn close_journal(&self) {
        if let Some(journal) = &self.journal {
            journal.is_open.store(false, Ordering::Relaxed);
        }
    }

    fn open_journal(&self) -> Option<&Journal> {
        self.journal.as_ref().filter(|journal| journal.is_open.load(Ordering::Relaxed))
    }

    /// Whether it is time for a checkpoint.
    #[must_use]
    pub fn due(&self) -> Option<Due> {
        let journal = self.open_journal()?;
        journal.due(&journal.state())
    }

    /// A checkpoint at the end of much work, if the run is not so short that it keeps nothing.
    #[must_use]
    pub fn milestone(&self) -> Option<Due> {
        let journal = self.open_journal()?;
        let is_long = journal.state().started_at.elapsed() >= journal.interval;
        (is_long || self.has_manifest()).then(|| Due(Instant::now()))
    }

    /// What was noted of a step; `None` where nothing was, or nothing that is understood.
    #[must_use]
    pub fn recall<T: DeserializeOwned>(&self, step: &str) -> Option<Recalled<T>> {
        let step = self.open_journal()?.state().noted.steps.get(step).cloned()?;
        let figures = serde_json::from_value(step.figures).ok()?;
        Some(Recalled { figures, files: step.files })
    }

    /// Whether something is noted of a step.
    #[must_use]
    pub fn is_noted(&self, step: &str) -> bool {
        self.open_journal().is_some_and(|journal| journal.state().noted.steps.contains_key(step))
    }

    /// Names of the steps that are noted.
    #[must_use]
    pub fn noted(&self) -> Vec<String> {
        let steps = |journal: &Journal| journal.state().noted.steps.keys().cloned().collect();
        self.open_journal().map(steps).unwrap_or_default()
    }

    /// Notes a step in place of what was noted of it before. Its files, which are finished, live as
    /// long as that is so.
    ///
    /// # Errors
    /// As [`Self::checkpoint`], where one is due.
    pub fn note(&self, step: &str, figures: &impl Serialize, files: Vec<Kept>) -> Result<()> {
        let Some(journal) = self.open_journal() else { return Ok(()) };
        debug_assert!(files.iter().all(|kept| kept.file.is_some()), "unfinished files change");
        let mut state = journal.state();
        state.set(step, step_of(figures, &files), files);
        match journal.due(&state) {
            Some(due) => self.save(&mut state, &due),
            None if self.disk.dead_bytes() > self.disk_bytes() / DEAD_SHARE => {
                self.save(&mut state, &Due(Instant::now()))
            }
            None => Ok(()),
        }
    }

    /// Forgets a step, and with it its files.
    ///
    /// # Errors
    /// As [`Self::checkpoint`], where one is due.
    pub fn forget(&self, step: &str) -> Result<()> {
        let Some(journal) = self.open_journal() else { return Ok(()) };
        let mut state = journal.state();
        if state.noted.steps.remove(step).is_none() {
            return Ok(());
        }
        state.held.remove(step);
        state.is_ahead = true;
        if self.disk.dead_bytes() > self.disk_bytes() / DEAD_SHARE {
            return self.save(&mut state, &Due(Instant::now()));
        }
        Ok(())
    }

    /// Notes a step, whose files may be unfinished, and writes the manifest.
    ///
    /// # Errors
    /// [`crate::Error::Io`] when the disk does not take it. The manifest before it stays.
    pub fn checkpoint(
        &self,
        due: &Due,
        step: &str,
        figures: &impl Serialize,
        files: Vec<Kept>,
    ) -> Result<()> {
        let Some(journal) = self.open_journal() else { return Ok(()) };
        let mut state = journal.state();
        state.set(step, step_of(figures, &files), files);
        self.save(&mut state, due)
    }

    /// Writes a manifest of what is noted, if there is anything that the one on disk does not say.
    ///
    /// # Errors
    /// As [`Self::checkpoint`].
    pub fn save_noted(&self) -> Result<()> {
        let Some(journal) = self.open_journal() else { return Ok(()) };
        let mut state = journal.state();
        if state.is_ahead { self.save(&mut state, &Due(Instant::now())) } else { Ok(()) }
    }

    /// Leaves the folder, if a run can go on from what is in it and it is worth it, and says where it
    /// is and how large; else removes it.
    #[must_use]
    pub fn leave(self) -> Option<(PathBuf, u64)> {
        if !self.is_worth_keeping() {
            drop(self.to_be_removed());
            return None;
        }
        // Where the disk is full, the manifest before it says less, but is still there.
        let _ = self.save_noted();
        if !self.has_manifest() {
            drop(self.to_be_removed());
            return None;
        }
        let size_bytes = self.disk_bytes();
        Some((self.keep(), size_bytes))
    }

    /// Whether what is noted is worth keeping when the run fails: it took at least as long as two
    /// checkpoints are apart.
    fn is_worth_keeping(&self) -> bool {
        self.open_journal().is_some_and(|journal| {
            let state = journal.state();
            !state.noted.steps.is_empty()
                && (state.started_at.elapsed() >= journal.interval || self.has_manifest())
        })
    }

    /// Forgets the step that a damaged file belongs to.
    pub fn forget_file(&self, path: &Path) {
        let Some(journal) = self.open_journal() else { return };
        let name = path.file_name().and_then(|name| name.to_str());
        let mut state = journal.state();
        let is_of = |step: &Step| step.files.iter().any(|file| Some(file.name.as_str()) == name);
        let damaged: Vec<String> = (state.noted.steps.iter())
            .filter(|(_, step)| is_of(step))
            .map(|(name, _)| name.clone())
            .collect();
        for step in damaged {
            state.noted.steps.remove(&step);
            state.held.remove(&step);
            state.is_ahead = true;
        }
    }

    /// A file that is noted.
    pub(super) fn held(&self, name: &str) -> Option<Arc<OwnedFile>> {
        let state = self.open_journal()?.state();
        state.held.values().flatten().find(|file| file.name() == name).cloned()
    }

    /// Leaves an unfinished file that was noted to who goes on with it.
    pub(super) fn give_up(&self, name: &str) {
        let Some(journal) = self.open_journal() else { return };
        let mut state = journal.state();
        for files in state.held.values_mut() {
            if let Some(at) = files.iter().position(|file| file.name() == name)
                && let Some(file) = Arc::into_inner(files.swap_remove(at))
            {
                file.give_up();
            }
        }
    }

    fn has_manifest(&self) -> bool {
        self.path().join(MANIFEST).exists()
    }

    fn save(&self, state: &mut State, due: &Due) -> Result<()> {
        let names: HashSet<String> = state.noted.files().map(|file| file.name.clone()).collect();
        // Before anything is written: what is named must not go meanwhile.
        self.disk.name(names.iter().cloned());
        let folder = system::open(self.path()).at("open", self.path())?;
        self.sync_files(&folder, state)?;
        let (new, path) = (self.path().join(MANIFEST_NEW), self.path().join(MANIFEST));
        // Left by a run that died here.
        let _ = fs::remove_file(&new);
        let file = system::create_new(&new).at("create", &new)?;
        system::write_all_at(&file, &state.noted.to_bytes(), 0).at("write", &new)?;
        system::sync(&file).at("sync", &new)?;
        system::rename(&new, &path).at("rename to", &path)?;
        system::sync(&folder).at("sync", self.path())?;
        self.disk.name_only(names);
        let finished = state.noted.files().filter(|file| file.finished);
        state.synced = finished.map(|file| file.name.clone()).collect();
        state.is_ahead = false;
        state.cost = due.0.elapsed();
        state.saved_at = Instant::now();
        Ok(())
    }

    fn sync_files(&self, folder: &File, state: &State) -> Result<()> {
        let is_new = |file: &&FileEntry| !state.synced.contains(&file.name);
        if state.noted.files().filter(is_new).count() > SYNCED_ONE_BY_ONE {
            return system::sync_all_of(folder).at("sync", self.path());
        }
        for file in state.noted.files().filter(is_new) {
            let path = self.path().join(&file.name);
            let file = system::open(&path).at("open", &path)?;
            system::sync(&file).at("sync", &path)?;
        }
        Ok(())
    }
}

fn step_of(figures: &impl Serialize, files: &[Kept]) -> Step {
    let figures = serde_json::to_value(figures).expect("figures are plain data");
    debug_assert!(is_exact(&figures), "{figures}");
    Step { figures, files: files.iter().map(|kept| kept.entry.clone()).collect() }
}

impl<R: Record> RecordFile<R> {
    /// This file, to be noted.
    #[must_use]
    pub fn kept(&self) -> Kept {
        Kept { entry: self.entry(), file: Some(Arc::clone(&self.file)) }
    }
}

impl<R: Record> RecordWriter<R> {
    /// The records appended so far, to be noted at a checkpoint: all of them are written.
    ///
    /// # Errors
    /// As [`Self::push`].
    pub fn kept(&mut self) -> Result<Kept> {
        Ok(Kept { entry: self.entry()?, file: None })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const EVER: Duration = Duration::from_secs(1 << 20);

    fn journaled(interval: Duration) -> Workspace {
        Workspace::for_test().with_journal(Fingerprint::new(), interval)
    }

    fn file_of(workspace: &Workspace, count: u64) -> RecordFile<u64> {
        let mut writer = RecordWriter::create(workspace, "numbers", None).unwrap();
        writer.extend(&(0..count).collect::<Vec<u64>>()).unwrap();
        writer.finish().unwrap()
    }

    #[test]
    fn files_live_as_long_as_their_step_is_noted() {
        let workspace = journaled(EVER);
        let file = file_of(&workspace, 100);
        let path = file.path().to_owned();
        workspace.note("step", &(), vec![file.kept()]).unwrap();
        drop(file);
        assert!(path.exists() && !workspace.has_manifest());
        workspace.forget("step").unwrap();
        assert!(!path.exists());
        assert_eq!(workspace.disk_bytes(), 0);
    }

    #[test]
    fn a_file_that_the_manifest_names_stays_until_another_one_does_not() {
        let workspace = journaled(EVER);
        // So much else that this one is not worth a manifest of its own.
        let other = file_of(&workspace, 10_000);
        let file = file_of(&workspace, 100);
        let path = file.path().to_owned();
        let due = Due(Instant::now());
        workspace.checkpoint(&due, "step", &(), vec![file.kept()]).unwrap();
        drop(file);
        workspace.forget("step").unwrap();
        assert!(path.exists());
        workspace.checkpoint(&due, "other", &(), vec![other.kept()]).unwrap();
        assert!(!path.exists() && other.path().exists());
    }

    #[test]
    fn a_short_run_keeps_nothing_and_a_long_one_all_it_noted() {
        let leave = |interval| {
            let workspace = journaled(interval);
            let file = file_of(&workspace, 100);
            workspace.note("step", &5, vec![file.kept()]).unwrap();
            drop(file);
            workspace.leave()
        };
        assert_eq!(leave(EVER), None);
        let (path, size_bytes) = leave(Duration::ZERO).unwrap();
        assert!(size_bytes >= 800 && path.join(MANIFEST).exists());
        fs::remove_dir_all(path).unwrap();
    }

    #[test]
    fn a_journal_that_is_closed_notes_nothing() {
        let workspace = journaled(Duration::ZERO);
        workspace.close_journal();
        workspace.note("step", &5, Vec::new()).unwrap();
        assert!(workspace.due().is_none() && workspace.recall::<u32>("step").is_none());
        assert_eq!(workspace.leave(), None);
    }
}
