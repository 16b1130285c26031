//! A clustering in the journal of its workspace: the runs that were spilled, how the tables stood,
//! and up to which record of the source that holds.
//!
//! Whoever goes on adds to new tables what follows in the source. Sums are integers, so that it does
//! not matter into how many runs they are cut.

use serde::{Deserialize, Serialize};

use super::{Config, spill::Run};
use crate::{
    error::Result,
    formats::Findings,
    storage::{Due, Kept, RecordFile, Workspace},
};

/// What a clustering is called.
pub(super) const STEP: &str = "cluster";

/// How far a pass over the source has come.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct Progress {
    /// Records of the source, from the first on.
    pub(super) records: u64,
    /// Triangles of them.
    pub(super) triangles: u64,
    /// Those without area, and the first record of a batch with one.
    pub(super) degenerate: u64,
    pub(super) degenerate_first: Option<u64>,
    /// What was found by then, but for what the readers of the inputs will find again.
    pub(super) findings: Findings,
    /// The number of the next run.
    pub(super) serial: u32,
    /// There are no more records.
    pub(super) is_over: bool,
}

#[derive(Serialize, Deserialize)]
struct Figures {
    /// The grid, as far as one of this job differs from another.
    cell_size: u64,
    progress: Progress,
}

/// What a run before this one did with the same cells.
pub(super) fn recall(config: &Config, workspace: &Workspace) -> Result<(Progress, Vec<Run>)> {
    let recalled = workspace.recall::<Figures>(STEP);
    let is_same = |figures: &Figures| figures.cell_size == config.grid.cell_size().to_bits();
    let Some(recalled) = recalled.filter(|recalled| is_same(&recalled.figures)) else {
        workspace.forget(STEP)?;
        return Ok(Default::default());
    };
    let run = |pair: &[_]| {
        let cells = RecordFile::adopt(workspace, &pair[0])?;
        Ok(Run { cells, triangles: RecordFile::adopt(workspace, &pair[1])? })
    };
    let runs = recalled.files.chunks_exact(2).map(run).collect::<Result<_>>()?;
    Ok((recalled.figures.progress, runs))
}

/// Notes how far the pass has come, at a checkpoint.
pub(super) fn checkpoint(
    due: &Due,
    progress: &Progress,
    files: Vec<Kept>,
    config: &Config,
    workspace: &Workspace,
) -> Result<()> {
    let cell_size = config.grid.cell_size().to_bits();
    workspace.checkpoint(due, STEP, &Figures { cell_size, progress: progress.clone() }, files)
}

/// Notes that all there is to sum is in these runs.
pub(super) fn note(
    progress: &Progress,
    runs: &[Run],
    config: &Config,
    workspace: &Workspace,
) -> Result<()> {
    let cell_size = config.grid.cell_size().to_bits();
    let progress = Progress { is_over: true, ..progress.clone() };
    workspace.note(STEP, &Figures { cell_size, progress }, kept(runs))
}

/// The files of runs, in their order.
pub(super) fn kept(runs: &[Run]) -> Vec<Kept> {
    runs.iter().flat_map(|run| [run.cells.kept(), run.triangles.kept()]).collect()
}
