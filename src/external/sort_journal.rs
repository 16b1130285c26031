//! A sort that is noted in the journal of its workspace, so that a run can go on from what another
//! one has sent to the disk.
//!
//! What is on the disk is the first so many records that were pushed. Whoever goes on pushes all
//! of them again, in the same order, and those are passed over: no caller needs to know how far a
//! sort had come.

use serde::{Deserialize, Serialize};

use super::{
    Keyed, SortKey as _,
    distribute::{self, Buckets},
    sort::{Config, Sorter, Spilled},
    sort_distribution::{Bucket, Distribution},
    sort_merge::Runs,
    splitters::Splitters,
};
use crate::{
    error::{Error, Result},
    progress::Monitor,
    storage::{Recalled, RecordFile, Workspace},
};

/// What is noted of a sort.
#[derive(Serialize, Deserialize)]
struct Figures {
    /// Records in the files, the first ones that were pushed.
    held: u64,
    way: Way,
}

#[derive(Serialize, Deserialize)]
enum Way {
    /// Into buckets between these keys; more will come.
    ToBuckets { bounds: Vec<String> },
    /// Into sorted runs; more will come.
    ToRuns,
    /// All records are in buckets, in their order. Of each, whether all of its keys are equal.
    InBuckets { one_key: Vec<bool> },
    /// All records are in sorted runs.
    InRuns,
}

impl<'a, R: Keyed> Sorter<'a, R> {
    /// Starts a sort, or goes on with one that is noted as [`Config::step`].
    ///
    /// # Errors
    /// [`Error::Damaged`] when what is noted is not there.
    pub fn noted(
        config: &Config,
        workspace: &'a Workspace,
        monitor: &'a Monitor<'a>,
    ) -> Result<Self> {
        let mut sorter = Self::new(config, workspace, monitor);
        let Some(step) = config.step else { return Ok(sorter) };
        let Some(recalled) = workspace.recall::<Figures>(step) else { return Ok(sorter) };
        let Recalled { figures: Figures { held, way }, files } = recalled;
        let finished = || files.iter().map(|file| RecordFile::adopt(workspace, file));
        sorter.spilled = match way {
            Way::ToBuckets { bounds } => {
                let bounds: Option<Vec<_>> = bounds.iter().map(|b| R::Key::from_hex(b)).collect();
                let splitters = bounds.and_then(Splitters::of_noted);
                let Some(splitters) = splitters.filter(|s| s.count() == files.len()) else {
                    return Err(damaged(workspace, "a sort is noted with other buckets"));
                };
                let memory_bytes = config.memory_bytes / 2;
                let config = distribute::Config { buckets: files.len(), memory_bytes };
                let buckets = Buckets::reopen(workspace, &files, &config)?;
                Spilled::ToBuckets(Distribution { splitters, buckets })
            }
            Way::InBuckets { one_key } => {
                let buckets = finished().zip(one_key);
                let buckets = buckets.map(|(file, one_key)| Ok(Bucket { file: file?, one_key }));
                Spilled::InBuckets(buckets.collect::<Result<_>>()?)
            }
            Way::ToRuns | Way::InRuns => {
                let runs =
                    Runs::of_files(finished().collect::<Result<_>>()?, config, workspace, monitor);
                let runs = Box::new(runs);
                if matches!(way, Way::InRuns) {
                    Spilled::InRuns(runs)
                } else {
                    Spilled::ToRuns(runs)
                }
            }
        };
        (sorter.held, sorter.held_before) = (held, held);
        if sorter.is_filled() {
            (sorter.count, sorter.passed_over) = (held, held);
        }
        Ok(sorter)
    }

    /// Whether all records are there: nothing has to be pushed.
    #[must_use]
    pub fn is_filled(&self) -> bool {
        matches!(self.spilled, Spilled::InBuckets(_) | Spilled::InRuns(_))
    }

    /// Leaves out records that are on the disk already.
    pub(super) fn without_held<'r>(&mut self, records: &'r [R]) -> &'r [R] {
        let again = self.held_before.saturating_sub(self.passed_over).min(records.len() as u64);
        self.passed_over += again;
        &records[again as usize..]
    }

    /// Notes what is on the disk, if it is time; the chunk is empty.
    pub(super) fn checkpoint(&mut self) -> Result<()> {
        let Some(step) = self.config.step else { return Ok(()) };
        let Some(due) = self.workspace.due() else { return Ok(()) };
        let (way, files) = match &mut self.spilled {
            Spilled::ToBuckets(Distribution { splitters, buckets }) => {
                let bounds = splitters.bounds().iter().map(|bound| bound.to_hex()).collect();
                (Way::ToBuckets { bounds }, buckets.kept()?)
            }
            Spilled::ToRuns(runs) => (Way::ToRuns, runs.kept()),
            Spilled::Nothing | Spilled::InBuckets(_) | Spilled::InRuns(_) => return Ok(()),
        };
        self.workspace.checkpoint(&due, step, &Figures { held: self.held, way }, files)
    }

    /// Checks that what was on the disk when this run began has been pushed again.
    pub(super) fn check_held(&self) -> Result<()> {
        if self.passed_over < self.held_before {
            let what = "fewer records came again than it holds of a sort";
            return Err(damaged(self.workspace, what));
        }
        Ok(())
    }
}

/// Notes that all records are in these buckets.
pub(super) fn note_buckets<R: Keyed>(
    buckets: &[Bucket<R>],
    held: u64,
    config: &Config,
    workspace: &Workspace,
) -> Result<()> {
    let Some(step) = config.step else { return Ok(()) };
    let one_key = buckets.iter().map(|bucket| bucket.one_key).collect();
    let files = buckets.iter().map(|bucket| bucket.file.kept()).collect();
    workspace.note(step, &Figures { held, way: Way::InBuckets { one_key } }, files)
}

/// Notes that all records are in these runs.
pub(super) fn note_runs<R: Keyed>(
    runs: &Runs<'_, R>,
    held: u64,
    config: &Config,
    workspace: &Workspace,
) -> Result<()> {
    let Some(step) = config.step else { return Ok(()) };
    workspace.note(step, &Figures { held, way: Way::InRuns }, runs.kept())
}

fn damaged(workspace: &Workspace, what: &'static str) -> Error {
    Error::Damaged { path: workspace.path().to_owned(), what }
}
