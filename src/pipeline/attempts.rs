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
    storage::Reservation,
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
    /// The memory of the mesh, when there was so much left.
    _held: Option<Reservation>,
}

/// A count within this factor of the wanted one is met: 25 %, the promise for clustering.
const TOLERANCE: f64 = 1.25;
/// Beyond this factor the clustering is done again, in case another grid does better.
const TOLERANCE_AT_ONCE: f64 = 1.2;
/// A grid that differs less from the last one is not tried.
const STEP_MIN: f64 = 1e-3;
/// Times the input is clustered at most. The estimate is good for large meshes; small ones, whose
/// counts jump from grid to grid, are done again in no time.
const ATTEMPTS_MAX: u32 = 6;

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
        // Nothing is not one triangle, nor infinitely far from it.
        let count = (self.mesh.counts().triangles as f64).max(0.5);
        self.wanted.map_or(1.0, |wanted| count / wanted.max(1) as f64)
    }
}

/// The search for the number of cells, not always whole, along the longest side.
#[derive(Default)]
struct Search {
    /// Cells that gave too few triangles, last.
    few: Option<f64>,
    /// Cells that gave too many, last.
    many: Option<f64>,
    /// Attempts in a row that were off in the same direction as the one before.
    repeated: i32,
    /// Whether the last attempt gave too few.
    last_few: bool,
}

impl Search {
    /// Cells that should do better than `cells`, which gave `ratio` times the wanted count.
    fn next(&mut self, cells: f64, ratio: f64) -> f64 {
        let is_few = ratio < 1.0;
        let is_first = self.few.is_none() && self.many.is_none();
        self.repeated = if is_few == self.last_few && !is_first { self.repeated + 1 } else { 0 };
        self.last_few = is_few;
        let side = if is_few { &mut self.few } else { &mut self.many };
        *side = Some(cells);
        // Triangles grow with the square of the cells, about; where they do not, steps grow.
        let step = cells * ratio.powf(-0.5 * f64::from(1 << self.repeated.min(4)));
        let next = match (self.few, self.many) {
            (Some(few), Some(many)) => {
                let is_between = step > few.min(many) && step < few.max(many);
                if is_between && self.repeated == 0 { step } else { (few * many).sqrt() }
            }
            _ => step,
        };
        next.clamp(1.0, f64::from(CELLS_PER_AXIS_MAX))
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
        let mut search = Search::default();
        for attempt in 1..=ATTEMPTS_MAX {
            let outcome = if let Some(outcome) = imported.take() {
                outcome
            } else {
                let inputs = reopen.iter().map(Input::open).collect::<Result<_>>()?;
                self.import(inputs, Need::Survey)?
            };
            let longest = outcome.survey.bounds.size().max_element();
            let (grid, estimated) = self.grid(&outcome.survey, simplify.goal, cells)?;
            let (next, outcome) = self.cluster_once(outcome, simplify, grid, !repeatable)?;
            imported = outcome;
            let (ratio, off_by) = (next.ratio(), next.off_by());
            let tried = cells.unwrap_or_else(|| (longest / grid.cell_size()).max(1.0));
            let estimate = estimated.or(best.as_ref().and_then(|b| b.report.triangles_estimated));
            if best.as_ref().is_none_or(|best| off_by < best.off_by()) {
                best = Some(next);
            }
            let report = &mut best.as_mut().expect("the first is better than none").report;
            (report.attempts, report.triangles_estimated) = (attempt, estimate);
            let more = search.next(tried, ratio);
            let is_stuck = longest <= 0.0 || (more / tried - 1.0).abs() < STEP_MIN;
            if off_by <= TOLERANCE_AT_ONCE || is_stuck {
                break;
            }
            cells = Some(more);
        }
        Ok(best.expect("the first attempt is better than none"))
    }

    /// The cells to use and the count expected of them.
    fn grid(&self, survey: &Survey, goal: Goal, cells: Option<f64>) -> Result<(Grid, Option<u64>)> {
        let bounds = &survey.bounds;
        let (grid, estimated) = match (cells, goal.triangles_wanted(survey.triangles())) {
            (Some(cells), _) => {
                (Grid::with_cell_size(bounds, bounds.size().max_element() / cells), None)
            }
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
        grid: Grid,
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
            triangles_estimated: None,
            spills: clustered.spills,
            attempts: 1,
        };
        let wanted = simplify.goal.triangles_wanted(triangles_in);
        let mesh = clustered.mesh;
        // As long as it is held, there is less for another attempt.
        let held = self.workspace.budget().reserve(mesh.memory_bytes());
        let clustered =
            Clustered { mesh, survey, findings, triangles_in, wanted, report, _held: held };
        Ok((clustered, kept))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cells tried until the count is within the tolerance.
    fn attempts(wanted: f64, triangles: impl Fn(f64) -> f64, first: f64) -> u32 {
        let (mut search, mut cells) = (Search::default(), first);
        for attempt in 1..=ATTEMPTS_MAX {
            let ratio = triangles(cells) / wanted;
            if ratio.max(1.0 / ratio) <= TOLERANCE_AT_ONCE {
                return attempt;
            }
            cells = search.next(cells, ratio);
        }
        panic!("{wanted} is not met, at last with {cells} cells");
    }

    #[test]
    fn a_surface_is_met_at_the_second_attempt() {
        assert_eq!(attempts(1000.0, |cells| 5.0 * cells * cells, 100.0), 2);
        assert_eq!(attempts(1000.0, |cells| 5.0 * cells * cells, 1.0), 2);
    }

    #[test]
    fn a_count_that_stands_still_is_left_in_growing_steps() {
        // Far fewer vertices than cells: nothing happens until they are nearly as few.
        assert!(attempts(500.0, |cells| cells.powi(2).min(1000.0), 3000.0) <= 6);
        assert!(attempts(400.0, |cells| 3.0 * cells, 2.0) <= 5);
    }
}
