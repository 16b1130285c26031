//! Workspaces that earlier runs have left: found by their job, looked at, and taken over.

use std::{
    collections::BTreeMap,
    fs::{self, File},
    io,
    os::unix::fs::FileExt as _,
    path::{Path, PathBuf},
    sync::{Arc, atomic::Ordering},
    time::Duration,
};

use rustix::fs::{FlockOperation, flock};
use zerocopy::FromBytes as _;

use super::{
    FileEntry, Manifest, ManifestFault, Workspace,
    journal::{Journal, MANIFEST},
    record::{HEADER_BYTES, Header, OwnedFile, file_bytes},
    workspace::{LOCK, PREFIX, UNLOCKED},
};
use crate::error::{IoContext as _, Result};

/// A workspace without a lock may be one that is just being made. Chosen by hand: that takes a
/// moment.
const BEGINNING: Duration = Duration::from_secs(60);

/// A workspace of a job that is there already.
#[derive(Debug)]
pub struct Left {
    /// The folder.
    pub path: PathBuf,
    /// Bytes of all files in it.
    pub size_bytes: u64,
    /// What can be done with it.
    pub condition: Condition,
}

/// What can be done with a workspace that is there already.
#[derive(Debug)]
pub enum Condition {
    /// Nothing: a run that lives works in it.
    InUse,
    /// A run can go on from it, who holds this lock.
    Resumable(Manifest, File),
    /// It can be removed by who holds this lock: the run ended before there was anything to keep,
    /// or what it kept is damaged or of another version.
    Useless(Option<ManifestFault>, Option<File>),
}

/// Finds the workspaces in `parent` of the job known by `key`, see [`Workspace::create_for`], in
/// the order of their names.
///
/// # Errors
/// [`crate::Error::Io`] when the folder cannot be read.
pub fn find_left(parent: &Path, key: &str) -> Result<Vec<Left>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(parent).at("read the folder", parent)? {
        let path = entry.at("read the folder", parent)?.path();
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        let is_of_job = name.strip_prefix(PREFIX).is_some_and(|rest| rest.starts_with(key));
        if is_of_job && path.is_dir() {
            let condition = condition_of(&path);
            found.push(Left { size_bytes: bytes_in(&path), condition, path });
        }
    }
    found.sort_by(|a, b| a.path.cmp(&b.path));
    Ok(found)
}

fn condition_of(path: &Path) -> Condition {
    if path.to_str().is_some_and(|path| path.ends_with(UNLOCKED)) {
        return Condition::Useless(None, None);
    }
    let Ok(lock) = File::options().read(true).write(true).open(path.join(LOCK)) else {
        return Condition::Useless(None, None);
    };
    if flock(&lock, FlockOperation::NonBlockingLockExclusive).is_err() {
        return Condition::InUse;
    }
    let manifest = match fs::read(path.join(MANIFEST)) {
        Ok(bytes) => Manifest::from_bytes(&bytes),
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            return Condition::Useless(None, Some(lock));
        }
        Err(_) => Err(ManifestFault::Torn),
    };
    match manifest {
        Ok(manifest) => Condition::Resumable(manifest, lock),
        Err(fault) => Condition::Useless(Some(fault), Some(lock)),
    }
}

fn bytes_in(folder: &Path) -> u64 {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let bytes = entries.map(|entry| match entry.metadata() {
        Ok(found) if found.is_dir() => bytes_in(&entry.path()),
        Ok(found) => found.len(),
        Err(_) => 0,
    });
    bytes.sum()
}

impl Left {
    /// Takes a resumable workspace over: what is noted and whole stays, everything else in the
    /// folder goes. Returns the names of the steps that were noted, but whose files are not as they
    /// should be: they will be done again. The folder stays when the workspace is dropped, unless
    /// [`Workspace::to_be_removed`] is called.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn take_over(self, interval: Duration) -> Result<Option<(Workspace, Vec<String>)>> {
        let Condition::Resumable(mut manifest, lock) = self.condition else { return Ok(None) };
        let path = self.path;
        let is_whole = |file: &FileEntry| is_whole(&path, file);
        let damaged = manifest.steps.iter().filter(|(_, step)| !step.files.iter().all(is_whole));
        let damaged: Vec<String> = damaged.map(|(name, _)| name.clone()).collect();
        for step in &damaged {
            manifest.steps.remove(step);
        }
        remove_unnamed(&path, &manifest)?;
        let mut workspace = Workspace::take_over(path, lock);
        let serial = manifest.files().filter_map(|file| serial_of(&file.name)).max();
        workspace.serial.store(serial.map_or(0, |last| last + 1), Ordering::Relaxed);
        let mut held = BTreeMap::new();
        for (name, step) in &manifest.steps {
            let own = |file: &FileEntry| {
                let path = workspace.path().join(&file.name);
                let bytes = fs::metadata(&path).map_or(0, |found| found.len());
                workspace.disk.take(bytes);
                Arc::new(OwnedFile { path, bytes, disk: workspace.disk(), is_given_up: false })
            };
            held.insert(name.clone(), step.files.iter().map(own).collect());
        }
        workspace.disk.name(manifest.files().map(|file| file.name.clone()));
        workspace.journal = Some(Journal::resumed(manifest, held, interval));
        Ok(Some((workspace, damaged)))
    }

    /// Removes a useless workspace, if it is certain that nobody is about to begin in it: its lock is
    /// held, or has been missing for long.
    ///
    /// # Errors
    /// [`crate::Error::Io`] when it cannot be removed.
    pub fn remove_if_old(self) -> Result<()> {
        let Condition::Useless(_, lock) = &self.condition else { return Ok(()) };
        let age = || fs::metadata(&self.path).ok()?.modified().ok()?.elapsed().ok();
        if lock.is_none() && age().is_none_or(|age| age < BEGINNING) {
            return Ok(());
        }
        fs::remove_dir_all(&self.path).at("remove", &self.path)
    }
}

/// Removes whatever is not noted: files half written, and those of steps that are done again.
fn remove_unnamed(folder: &Path, manifest: &Manifest) -> Result<()> {
    for entry in fs::read_dir(folder).at("read the folder", folder)? {
        let path = entry.at("read the folder", folder)?.path();
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        if name == LOCK || name == MANIFEST || manifest.files().any(|file| file.name == name) {
            continue;
        }
        let removed =
            if path.is_dir() { fs::remove_dir_all(&path) } else { fs::remove_file(&path) };
        removed.at("remove", &path)?;
    }
    Ok(())
}

/// Whether a file is there and has the header and the length it should have, or, unfinished, all
/// the records that were noted.
fn is_whole(folder: &Path, entry: &FileEntry) -> bool {
    let path = folder.join(&entry.name);
    let Ok(file) = File::options().read(true).open(&path) else { return false };
    let Ok(length) = file_bytes(&file, &path) else { return false };
    let records_bytes = entry.count.checked_mul(u64::from(entry.record_bytes));
    let expected = records_bytes.and_then(|bytes| bytes.checked_add(HEADER_BYTES as u64));
    if !entry.finished {
        return expected.is_some_and(|expected| expected <= length);
    }
    let mut bytes = [0; HEADER_BYTES];
    if file.read_exact_at(&mut bytes, 0).is_err() {
        return false;
    }
    let header = Header::read_from_bytes(&bytes).expect("the buffer has the header's size");
    expected == Some(length) && header.matches(entry)
}

fn serial_of(name: &str) -> Option<u64> {
    name.split('-').next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::storage::{Fingerprint, RecordFile, RecordWriter};

    const EVER: Duration = Duration::from_secs(1 << 20);

    /// A folder for workspaces, and one in it with 1000 numbers noted as finished and 500 as a part
    /// of more, left as a run leaves it that dies.
    fn left(key: &str) -> (tempfile::TempDir, PathBuf) {
        let parent = tempfile::tempdir().unwrap();
        let workspace = Workspace::create_for(parent.path(), key).unwrap();
        let workspace = workspace.with_journal(Fingerprint::new(), Duration::ZERO);
        let numbers = |count| (0..count).collect::<Vec<u64>>();
        let mut writer = RecordWriter::create(&workspace, "whole", None).unwrap();
        writer.extend(&numbers(1000)).unwrap();
        let whole = writer.finish().unwrap();
        workspace.note("whole", &7, vec![whole.kept()]).unwrap();
        let mut part = RecordWriter::<u64>::create(&workspace, "part", None).unwrap();
        part.extend(&numbers(500)).unwrap();
        let due = workspace.due().unwrap();
        let kept = part.kept().unwrap();
        workspace.checkpoint(&due, "part", &8, vec![kept]).unwrap();
        part.extend(&[9; 100_000]).unwrap();
        let path = workspace.path().to_owned();
        // As if nobody had been there to drop it: only the lock goes with the process.
        std::mem::forget(part);
        std::mem::forget(whole);
        drop(workspace.keep());
        (parent, path)
    }

    fn take_over(parent: &Path) -> (Workspace, Vec<String>) {
        let mut found = find_left(parent, "").unwrap();
        assert_eq!(found.len(), 1);
        found.remove(0).take_over(EVER).unwrap().unwrap()
    }

    #[test]
    fn what_was_noted_is_there_and_nothing_else() {
        let (parent, path) = left("job-");
        fs::write(path.join("00009-half"), b"torn").unwrap();
        fs::create_dir(path.join("runs-1")).unwrap();
        let (workspace, damaged) = take_over(parent.path());
        assert!(damaged.is_empty());
        assert_eq!(workspace.noted(), ["part", "whole"]);
        let count = fs::read_dir(&path).unwrap().count();
        assert_eq!(count, 4, "lock, manifest and two files");
        let recalled = workspace.recall::<u32>("whole").unwrap();
        let file = RecordFile::<u64>::adopt(&workspace, &recalled.files[0]).unwrap();
        assert_eq!((recalled.figures, file.read_all().unwrap().len()), (7, 1000));
        let part = workspace.recall::<u32>("part").unwrap();
        let mut writer = RecordWriter::<u64>::reopen(&workspace, &part.files[0], 1 << 12).unwrap();
        writer.extend(&(500..100_000).collect::<Vec<u64>>()).unwrap();
        let whole = writer.finish().unwrap();
        assert_eq!(whole.read_all().unwrap(), (0..100_000).collect::<Vec<u64>>());
        assert!(workspace.new_path("next").to_str().unwrap().contains("00002-next"));
        drop((file, whole));
        drop(workspace.to_be_removed());
        assert!(!path.exists());
    }

    fn cut(path: &Path, bytes: u64) {
        File::options().write(true).open(path).unwrap().set_len(bytes).unwrap();
    }

    #[test]
    fn a_step_whose_file_is_not_whole_is_done_again() {
        type Change = fn(&Path);
        let cases: [(&str, Change, &str); 4] = [
            ("00000-whole", |path| fs::remove_file(path).unwrap(), "whole"),
            ("00001-part", |path| fs::remove_file(path).unwrap(), "part"),
            ("00000-whole", |path| cut(path, 999), "whole"),
            ("00000-whole", |path| fs::write(path, [0; 8064]).unwrap(), "whole"),
        ];
        for (file, change, step) in cases {
            let (parent, path) = left("");
            change(&path.join(file));
            let (workspace, damaged) = take_over(parent.path());
            assert_eq!(damaged, [step]);
            assert!(!workspace.is_noted(step) && !path.join(file).exists(), "{file}");
            drop(workspace.to_be_removed());
        }
        let (parent, path) = left("");
        cut(&path.join("00001-part"), 64 + 8 * 500);
        assert!(take_over(parent.path()).1.is_empty(), "all that counts is there");
    }

    #[test]
    fn a_flipped_bit_in_what_was_noted_is_found_when_it_is_read() {
        let (parent, path) = left("");
        for name in ["00000-whole", "00001-part"] {
            let file = File::options().write(true).open(path.join(name)).unwrap();
            file.write_all_at(&[0xff], 1000).unwrap();
        }
        let (workspace, damaged) = take_over(parent.path());
        assert!(damaged.is_empty());
        let files = |step| workspace.recall::<u32>(step).unwrap().files;
        let whole = RecordFile::<u64>::adopt(&workspace, &files("whole")[0]).unwrap();
        assert!(whole.read_all().is_err() && whole.verify().is_err());
        let part = RecordWriter::<u64>::reopen(&workspace, &files("part")[0], 0).unwrap();
        assert!(part.finish().unwrap().read_all().is_err());
    }

    #[test]
    fn a_living_run_keeps_its_workspace() {
        let parent = tempfile::tempdir().unwrap();
        let workspace = Workspace::create_for(parent.path(), "job-").unwrap();
        let found = find_left(parent.path(), "job-").unwrap();
        assert!(matches!(found[0].condition, Condition::InUse));
        assert!(find_left(parent.path(), "other-").unwrap().is_empty());
        drop(workspace);
        assert!(find_left(parent.path(), "job-").unwrap().is_empty());
    }

    #[test]
    fn a_workspace_that_is_just_being_made_is_left_alone() {
        let parent = tempfile::tempdir().unwrap();
        let path = parent.path().join("meshmill-job-x.new");
        fs::create_dir(&path).unwrap();
        fs::write(path.join(LOCK), b"").unwrap();
        let mut found = find_left(parent.path(), "job-").unwrap();
        assert!(matches!(found[0].condition, Condition::Useless(None, None)));
        found.remove(0).remove_if_old().unwrap();
        assert!(path.exists());
        let long_ago = std::time::SystemTime::now() - 2 * BEGINNING;
        File::options().read(true).open(&path).unwrap().set_modified(long_ago).unwrap();
        find_left(parent.path(), "job-").unwrap().remove(0).remove_if_old().unwrap();
        assert!(!path.exists());
    }

    #[test]
    fn a_damaged_manifest_makes_a_workspace_useless() {
        let (parent, path) = left("");
        let mut bytes = fs::read(path.join(MANIFEST)).unwrap();
        let last = bytes.len() - 1;
        bytes[last] ^= 1;
        fs::write(path.join(MANIFEST), bytes).unwrap();
        let found = find_left(parent.path(), "").unwrap().remove(0);
        let is_damaged =
            matches!(found.condition, Condition::Useless(Some(ManifestFault::Checksum), _));
        assert!(is_damaged, "{:?}", found.condition);
        found.remove_if_old().unwrap();
        assert!(!path.exists());
    }
}
