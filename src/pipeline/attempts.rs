//! Clustering to a wanted count: estimated, done, and done again where the estimate was off.

use serde::{Deserialize, Serialize};

use super::{ClusterReport, Goal, Simplify, hybrid::FACTOR, run::Run};
use crate::{
    error::{Error, Result},
    formats::Findings,
    geometry::{CELLS_PER_AXIS_MAX, Grid},
    soup::{Column, IndexedMesh, Input, OpenInput, Vertex, VertexQuadric},
    stages::{
        convert::import::{Need, Outcome, Survey},
        simplify::{cluster, decimate::Metric},
    },
    storage::Reservation,
};

/// What a clustering is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    /// It is the result.
    Result,
    /// Its triangles are decimated to the wanted ones.
    Decimation,
}

impl Purpose {
    /// Triangles that clustering is to leave of so many; `None` for goals in cells.
    pub(super) fn triangles_wanted(self, goal: Goal, triangles: u64) -> Option<u64> {
        let wanted = goal.triangles_wanted(triangles);
        match self {
            Self::Result => wanted,
            Self::Decimation => {
                wanted.map(|wanted| wanted.saturating_mul(FACTOR).min(triangles.max(1)))
            }
        }
    }

    /// Triangles that clustering must leave in any case.
    fn triangles_least(self, goal: Goal, triangles: u64) -> u64 {
        match self {
            Self::Result => 0,
            Self::Decimation => goal.triangles_wanted(triangles).unwrap_or(0),
        }
    }
}

/// Inputs that have been imported, and can be again.
pub(super) struct Imported<V> {
    pub(super) outcome: Outcome<V>,
    pub(super) inputs: Vec<Input>,
}

/// A clustered mesh and how it came about.
pub(super) struct Clustered<V> {
    pub(super) mesh: IndexedMesh<V>,
    /// If they are for decimation, by a metric that remembers them.
    pub(super) quadrics: Option<Column<VertexQuadric>>,
    pub(super) survey: Survey,
    pub(super) findings: Findings,
    /// Triangles of the input.
    pub(super) triangles_in: u64,
    /// Triangles asked for, if a count or ratio was.
    pub(super) wanted: Option<u64>,
    /// Triangles that must be left.
    least: u64,
    pub(super) report: ClusterReport,
    /// The memory of the mesh, when there was so much left.
    _held: Option<Reservation>,
}

/// A count within this factor of the wanted one is met: 25 %, the promise for clustering.
const TOLERANCE: f64 = 1.25;
/// Beyond this factor the clustering is done again, in case another grid does better.
pub(super) const TOLERANCE_AT_ONCE: f64 = 1.2;
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

    /// Whether there is no need to look for a better grid.
    fn is_good(&self) -> bool {
        self.is_enough() && self.off_by() <= TOLERANCE_AT_ONCE
    }

    fn is_enough(&self) -> bool {
        self.mesh.counts().triangles >= self.least
    }

    /// How good it is, with the cells it was made of.
    fn standing(&self, cells: Option<u64>) -> Standing {
        Standing { cells, off_by: self.off_by().to_bits(), is_enough: self.is_enough() }
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

/// Whether the source is given back after a clustering.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kept {
    /// It can be made again.
    No,
    /// There is no other.
    Source,
}

/// What the attempts so far are called in the journal of the workspace.
const TRIED: &str = "cluster: attempts";

/// The attempts so far. Numbers of cells are the bits of an `f64`; without one, the cells are those
/// of the first attempt, from the estimate.
#[derive(Default, Serialize, Deserialize)]
struct Tried {
    made: u32,
    search: Search,
    /// Cells of the next one.
    next: Option<u64>,
    best: Option<Standing>,
    /// Triangles that the first was expected to leave.
    estimated: Option<u64>,
}

/// How good an attempt was.
#[derive(Serialize, Deserialize)]
struct Standing {
    cells: Option<u64>,
    /// Bits of [`Clustered::off_by`].
    off_by: u64,
    is_enough: bool,
}

impl Standing {
    /// Whether there are enough triangles where there were not, or a count nearer to the wanted one.
    fn is_better_than(&self, other: &Self) -> bool {
        match (self.is_enough, other.is_enough) {
            (true, false) => true,
            (false, true) => false,
            _ => f64::from_bits(self.off_by) < f64::from_bits(other.off_by),
        }
    }
}

/// The search for the number of cells, not always whole, along the longest side.
#[derive(Default, Serialize, Deserialize)]
struct Search {
    /// Cells that gave too few triangles, last.
    few: Option<Cells>,
    /// Cells that gave too many, last.
    many: Option<Cells>,
    /// Attempts in a row that were off in the same direction as the one before.
    repeated: i32,
    /// Whether the last attempt gave too few.
    last_few: bool,
}

/// A number of cells by its bits: journals hold integers.
#[derive(Clone, Copy, Serialize, Deserialize)]
struct Cells(u64);

impl Cells {
    fn get(self) -> f64 {
        f64::from_bits(self.0)
    }
}

impl Search {
    /// Cells that should do better than `cells`, which gave `ratio` times the wanted count.
    fn next(&mut self, cells: f64, ratio: f64) -> f64 {
        let is_few = ratio < 1.0;
        let is_first = self.few.is_none() && self.many.is_none();
        self.repeated = if is_few == self.last_few && !is_first { self.repeated + 1 } else { 0 };
        self.last_few = is_few;
        let side = if is_few { &mut self.few } else { &mut self.many };
        *side = Some(Cells(cells.to_bits()));
        // Triangles grow with the square of the cells, about; where they do not, steps grow.
        let step = cells * ratio.powf(-0.5 * f64::from(1 << self.repeated.min(4)));
        let next = match (self.few.map(Cells::get), self.many.map(Cells::get)) {
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
    /// Imports what clustering needs.
    pub(super) fn import_for_clustering<V: Vertex>(
        &self,
        inputs: Vec<OpenInput>,
    ) -> Result<Imported<V>> {
        let reopen = inputs.iter().map(|open| open.input.clone()).collect();
        Ok(Imported { outcome: self.import::<V>(inputs, Need::Survey)?, inputs: reopen })
    }

    /// Clusters the inputs; again with other cells while that brings the count nearer to the
    /// wanted one.
    pub(super) fn cluster_to_goal<V: Vertex>(
        &self,
        imported: Imported<V>,
        simplify: &Simplify,
        purpose: Purpose,
    ) -> Result<Clustered<V>> {
        let Imported { outcome, inputs: reopen } = imported;
        let repeatable = reopen.iter().all(Input::is_repeatable);
        let mut imported = Some(outcome);
        let noted = self.workspace.recall::<Tried>(TRIED).map(|recalled| recalled.figures);
        let mut tried = noted.unwrap_or_default();
        let mut best: Option<Clustered<V>> = None;
        while tried.made < ATTEMPTS_MAX {
            let outcome = self.again(&mut imported, &reopen)?;
            let longest = outcome.survey.bounds.size().max_element();
            let cells = tried.next.map(f64::from_bits);
            let (grid, estimated) = self.grid(&outcome.survey, (simplify.goal, purpose), cells)?;
            let kept = if repeatable { Kept::No } else { Kept::Source };
            let (next, outcome) = self.cluster_once(outcome, (simplify, purpose), grid, kept)?;
            imported = outcome;
            let (ratio, is_good) = (next.ratio(), next.is_good());
            let of = cells.unwrap_or_else(|| (longest / grid.cell_size()).max(1.0));
            tried.made += 1;
            tried.estimated = estimated.or(tried.estimated);
            let standing = next.standing(tried.next);
            if tried.best.as_ref().is_none_or(|best| standing.is_better_than(best)) {
                (tried.best, best) = (Some(standing), Some(next));
            }
            let more = tried.search.next(of, ratio);
            let is_stuck = longest <= 0.0 || (more / of - 1.0).abs() < STEP_MIN;
            if is_good || is_stuck {
                break;
            }
            tried.next = Some(more.to_bits());
            self.workspace.note(TRIED, &tried, Vec::new())?;
        }
        let mut best = if let Some(best) = best {
            best
        } else {
            // It was made by a run before this one.
            let outcome = self.again(&mut imported, &reopen)?;
            let cells = tried.best.as_ref().and_then(|best| best.cells).map(f64::from_bits);
            let (grid, _) = self.grid(&outcome.survey, (simplify.goal, purpose), cells)?;
            self.cluster_once(outcome, (simplify, purpose), grid, Kept::No)?.0
        };
        (best.report.attempts, best.report.triangles_estimated) = (tried.made, tried.estimated);
        Ok(best)
    }

    /// The inputs as they were imported, or imported again.
    fn again<V: Vertex>(
        &self,
        imported: &mut Option<Outcome<V>>,
        reopen: &[Input],
    ) -> Result<Outcome<V>> {
        if let Some(outcome) = imported.take() {
            return Ok(outcome);
        }
        let inputs = reopen.iter().map(Input::open).collect::<Result<_>>()?;
        self.import(inputs, Need::Survey)
    }

    /// The cells to use and the count expected of them.
    fn grid(
        &self,
        survey: &Survey,
        (goal, purpose): (Goal, Purpose),
        cells: Option<f64>,
    ) -> Result<(Grid, Option<u64>)> {
        let bounds = &survey.bounds;
        let wanted = purpose.triangles_wanted(goal, survey.triangles());
        let (grid, estimated) = match (cells, wanted) {
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
                Goal::Triangles(_) | Goal::Ratio(_) | Goal::Tolerance => {
                    unreachable!("these want a count, or no cells")
                }
            },
        };
        let grid = grid.ok_or_else(|| {
            let text = "cells this small would be more than 2097152 along one side";
            Error::Request(text.to_owned())
        })?;
        Ok((grid, estimated))
    }

    /// Clusters once. Where the source can be made again, its memory serves the assembly.
    fn cluster_once<V: Vertex>(
        &self,
        outcome: Outcome<V>,
        (simplify, purpose): (&Simplify, Purpose),
        grid: Grid,
        kept: Kept,
    ) -> Result<(Clustered<V>, Option<Outcome<V>>)> {
        let (boundary_weight, placement) = (simplify.boundary_weight, simplify.placement);
        let budget = self.workspace.budget();
        let assembly_bytes = match kept {
            Kept::Source => budget.available_bytes(),
            Kept::No => budget.limit_bytes(),
        };
        let quadrics = match (purpose, simplify.metric) {
            (Purpose::Decimation, Metric::Quadric) => cluster::Quadrics::PassOn,
            _ => cluster::Quadrics::Drop,
        };
        let config = cluster::Config { grid, boundary_weight, placement, assembly_bytes, quadrics };
        let mut partials =
            cluster::accumulate(&outcome.source, &config, self.workspace, self.monitor)?;
        let (findings, triangles_in) = (std::mem::take(&mut partials.findings), partials.triangles);
        let survey = outcome.survey.clone();
        let kept = (kept == Kept::Source).then_some(outcome);
        let clustered = cluster::assemble(partials, &config, self.workspace, self.monitor)?;
        let report = ClusterReport {
            cells: grid.cells(),
            cell_size: grid.cell_size(),
            cells_occupied: clustered.cells,
            triangles_estimated: None,
            spills: clustered.spills,
            attempts: 1,
        };
        let cluster::Outcome { mesh, quadrics, .. } = clustered;
        let quadric_bytes = match &quadrics {
            Some(Column::Memory(quadrics)) => size_of_val(quadrics.as_slice()) as u64,
            _ => 0,
        };
        let clustered = Clustered {
            survey,
            findings,
            triangles_in,
            wanted: purpose.triangles_wanted(simplify.goal, triangles_in),
            least: purpose.triangles_least(simplify.goal, triangles_in),
            report,
            // As long as it is held, there is less for another attempt.
            _held: self.workspace.budget().reserve(mesh.memory_bytes() + quadric_bytes),
            mesh,
            quadrics,
        };
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
