//! Clustering to a wanted count: estimated, done, and done again where the estimate was off.

use super::{ClusterReport, Goal, Simplify, run::Run};
use crate::{
    error::{Error, Result},
    formats::Findings,
    geometry::{CELLS_PER_AXIS_MAX, Grid},
    soup::{IndexedMesh, Input, OpenInput, Vertex},
    stages::{
        convert::import::{Need, Outcome, Survey},
        simplify::cluster,
    },
};

/// A clustered mesh and how it came about.
pub(super) struct Clustered<V> {
    pub(super) mesh: IndexedMesh<V>,
    pub(super) survey: Survey,
    pub(super) findings: Findings,
    /// Triangles of the input.
    pub(super) triangles_in: u64,
    /// Triangles asked for, if a count or ratio was.
    pub(super) wanted: Option<u64>,
    pub(super) report: ClusterReport,
}

/// A count within this factor of the wanted one is met: 25 %, the promise for clustering.
const TOLERANCE: f64 = 1.25;
/// Beyond this factor the clustering is done again, in case another grid does better.
const TOLERANCE_AT_ONCE: f64 = 1.2;
/// Times the input is clustered at most.
const ATTEMPTS_MAX: u32 = 4;

impl<V: Vertex> Clustered<V> {
    /// Whether the count is the wanted one, within the promised tolerance.
    pub(super) fn is_met(&self) -> bool {
        self.off_by() <= TOLERANCE
    }

    /// Factor between the count and the wanted one, at least 1.
    fn off_by(&self) -> f64 {
        let ratio = self.ratio();
        ratio.max(1.0 / ratio)
    }

    fn ratio(&self) -> f64 {
        let count = self.mesh.counts().triangles.max(1) as f64;
        self.wanted.map_or(1.0, |wanted| count / wanted.max(1) as f64)
    }

    /// Cells along the longest side that should do better, if any: triangles grow with their
    /// square, about.
    fn better_cells(&self) -> Option<u32> {
        let longest = f64::from(self.report.cells.into_iter().max().unwrap_or(1));
        let cells = (longest / self.ratio().sqrt()).round();
        let cells = cells.clamp(1.0, f64::from(CELLS_PER_AXIS_MAX));
        (self.off_by() > TOLERANCE_AT_ONCE && cells != longest).then_some(cells as u32)
    }
}

impl Run<'_> {
    /// Clusters the inputs; again with other cells while that brings the count nearer to the
    /// wanted one.
    pub(super) fn cluster_to_goal<V: Vertex>(
        &self,
        inputs: Vec<OpenInput>,
        simplify: &Simplify,
    ) -> Result<Clustered<V>> {
        let reopen: Vec<Input> = inputs.iter().map(|open| open.input.clone()).collect();
        let repeatable = reopen.iter().all(Input::is_repeatable);
        let mut imported = Some(self.import::<V>(inputs, Need::Survey)?);
        let (mut best, mut cells): (Option<Clustered<V>>, _) = (None, None);
        for attempt in 1..=ATTEMPTS_MAX {
            let outcome = if let Some(outcome) = imported.take() {
                outcome
            } else {
                let inputs = reopen.iter().map(Input::open).collect::<Result<_>>()?;
                self.import(inputs, Need::Survey)?
            };
            let grid = self.grid(&outcome.survey, simplify.goal, cells)?;
            let (next, outcome) = self.cluster_once(outcome, simplify, grid, !repeatable)?;
            imported = outcome;
            cells = next.better_cells();
            if let Some(best) = best.as_mut().filter(|best| best.off_by() <= next.off_by()) {
                best.report.attempts = attempt;
                break;
            }
            let estimated = best.as_ref().and_then(|best| best.report.triangles_estimated);
            let best = best.insert(next);
            best.report.attempts = attempt;
            best.report.triangles_estimated = best.report.triangles_estimated.or(estimated);
            if cells.is_none() {
                break;
            }
        }
        Ok(best.expect("the first attempt is better than none"))
    }

    /// The cells to use and the count expected of them.
    fn grid(&self, survey: &Survey, goal: Goal, cells: Option<u32>) -> Result<(Grid, Option<u64>)> {
        let bounds = &survey.bounds;
        let (grid, estimated) = match (cells, wanted(goal, survey.triangles())) {
            (Some(cells), _) => (Grid::with_cells(bounds, cells), None),
            (None, Some(wanted)) => {
                let (cells, count) =
                    cluster::cells_for(&survey.sample, bounds, wanted, self.monitor);
                (Grid::with_cells(bounds, cells), Some(count))
            }
            (None, None) => match goal {
                Goal::CellSize(size) => (Grid::with_cell_size(bounds, size), None),
                Goal::Cells(cells) => (Grid::with_cells(bounds, cells), None),
                Goal::Triangles(_) | Goal::Ratio(_) => unreachable!("these want a count"),
            },
        };
        let grid = grid.ok_or_else(|| {
            let text = "cells this small would be more than 2097152 along one side";
            Error::Request(text.to_owned())
        })?;
        Ok((grid, estimated))
    }

    /// Clusters once. The source is given back only to `keep` it: its memory serves the assembly
    /// when it can be made again.
    fn cluster_once<V: Vertex>(
        &self,
        outcome: Outcome<V>,
        simplify: &Simplify,
        (grid, triangles_estimated): (Grid, Option<u64>),
        keep: bool,
    ) -> Result<(Clustered<V>, Option<Outcome<V>>)> {
        let (boundary_weight, placement) = (simplify.boundary_weight, simplify.placement);
        let budget = self.workspace.budget();
        let assembly_bytes = if keep { budget.available_bytes() } else { budget.limit_bytes() };
        let config = cluster::Config { grid, boundary_weight, placement, assembly_bytes };
        let mut partials =
            cluster::accumulate(&outcome.source, &config, self.workspace, self.monitor)?;
        let (findings, triangles_in) = (std::mem::take(&mut partials.findings), partials.triangles);
        let survey = outcome.survey.clone();
        let kept = keep.then_some(outcome);
        let clustered = cluster::assemble(partials, &config, self.workspace, self.monitor)?;
        let report = ClusterReport {
            cells: grid.cells(),
            cell_size: grid.cell_size(),
            cells_occupied: clustered.cells,
            triangles_estimated,
            spills: clustered.spills,
            attempts: 1,
        };
        let wanted = wanted(simplify.goal, triangles_in);
        let mesh = clustered.mesh;
        Ok((Clustered { mesh, survey, findings, triangles_in, wanted, report }, kept))
    }
}

/// The count that `goal` asks for, of `triangles`.
fn wanted(goal: Goal, triangles: u64) -> Option<u64> {
    match goal {
        Goal::Triangles(count) => Some(count),
        Goal::Ratio(ratio) => Some((triangles as f64 * ratio).round() as u64),
        Goal::Cells(_) | Goal::CellSize(_) => None,
    }
}
