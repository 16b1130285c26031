//! What is to be done, completely: plain data, made from the command line or by a program.

use std::{path::PathBuf, time::Duration};

use super::{Keep, Progressive};
use crate::{
    formats::{Compression, Format, OnDefect},
    geometry::Placement,
    soup::{InputPath, SweepAxis},
    stages::{convert::export::Target, simplify::decimate::Metric},
};

/// One job.
#[derive(Clone, Debug)]
pub struct Job {
    /// What to do with the inputs.
    pub task: Task,
    /// The inputs: one mesh, in this order.
    pub inputs: Vec<InputPath>,
    /// Format of all inputs; recognised when `None`.
    pub input_format: Option<Format>,
    /// Policy for bad records.
    pub on_defect: OnDefect,
    /// Where the result goes.
    pub target: Target,
    /// Format of the result.
    pub output_format: Format,
    /// Compression of the result.
    pub compression: Compression,
    /// Memory to keep to, in bytes, beside a constant of at most 64 MiB.
    pub memory_bytes: u64,
    /// Threads to work with, at least 1.
    pub threads: usize,
    /// Folder for the workspace; must exist.
    pub temp_dir: PathBuf,
    /// The mesh that comes of it is made progressive; `None`: it is written as it is. Goes with a task
    /// that ends in an indexed mesh.
    pub progressive: Option<Progressive>,
    /// What it begins with and what it leaves; `None`: with nothing and nothing, even when it fails.
    pub keeping: Option<Keeping>,
}

/// What a job does with a workspace that was left for it, and what it leaves itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Keeping {
    /// What it begins with.
    pub start: Start,
    /// What becomes of the workspace when the job is done.
    pub end: End,
    /// Time between two checkpoints, at least; what is done in less is not kept when a job fails.
    pub interval: Duration,
}

impl Keeping {
    /// Between two checkpoints, where nobody says otherwise: as much work as a person does not mind
    /// to lose, and far more than a checkpoint takes.
    pub const INTERVAL: Duration = Duration::from_secs(60);

    /// From the start, leaving nothing when done.
    pub const PLAIN: Self = Self { start: Start::Anew, end: End::Remove, interval: Self::INTERVAL };
}

/// What a job begins with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// Nothing, and what was left by others is not touched.
    Anew,
    /// What a run that died left of the same job, if there is any.
    Resume,
}

/// What becomes of the workspace of a job that is done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// It goes.
    Remove,
    /// It stays.
    Keep,
}

/// What to do.
#[derive(Clone, Debug, PartialEq)]
pub enum Task {
    /// Fewer triangles.
    Simplify(Simplify),
    /// Indexed mesh to triangle soup, order kept.
    Soup,
    /// Any mesh to a soup sorted along an axis.
    Sort(Sort),
    /// Soup to indexed mesh.
    Weld,
}

/// How to sort.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sort {
    /// Along which axis; along the longest side of the bounding box when `None`, the first of
    /// equals.
    pub axis: Option<SweepAxis>,
}

/// How to simplify.
#[derive(Clone, Debug, PartialEq)]
pub struct Simplify {
    /// How far.
    pub goal: Goal,
    /// By what.
    pub method: Method,
    /// Decimation: what it goes by.
    pub metric: Metric,
    /// Decimation: how edges are chosen.
    pub selection: Selection,
    /// Multiple choice: candidates for each decision, at least 1.
    pub choices: u32,
    /// Multiple choice: which candidates.
    pub seed: u64,
    /// The inputs are promised to be sorted along this axis, or nearly: one pass will do.
    pub assume_sorted: Option<SweepAxis>,
    /// Clustering: share of edge quadrics, 0 to 1.
    pub boundary_weight: f64,
    /// Clustering: where representatives may lie in their cells.
    pub placement: Placement,
    /// Decimation under an error bound: what it keeps to.
    pub keep: Keep,
    /// Measure how far the result is from the inputs, by so many samples on each.
    pub measure: Option<u64>,
}

/// How triangles become fewer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Bounded where there is an error bound, clustering for a goal in cells; otherwise edge collapses on the sorted stream if they fit
    /// the memory, and if not, hybrid.
    Auto,
    /// Edge collapses on the sorted stream: exact counts, the best fidelity, topology kept.
    Stream,
    /// One vertex for each cell of a grid.
    Cluster,
    /// Clustering to a few times the goal, then edge collapses on what that leaves.
    Hybrid,
    /// Edge collapses that leave no vertex of the input farther away than a tolerance.
    Bounded,
}

impl Method {
    /// All of them.
    pub const ALL: [Self; 5] =
        [Self::Auto, Self::Stream, Self::Cluster, Self::Hybrid, Self::Bounded];

    /// Its name, as on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Stream => "stream",
            Self::Cluster => "cluster",
            Self::Hybrid => "hybrid",
            Self::Bounded => "bounded",
        }
    }
}

/// How decimation chooses the edges to collapse.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Selection {
    /// Every edge below a threshold that rises, in parallel slabs.
    Threshold,
    /// The best of a few random ones, in a single pass on a window.
    MultipleChoice,
}

impl Simplify {
    /// Whether this is done in a single pass on a window.
    #[must_use]
    pub fn is_streaming(&self) -> bool {
        self.selection == Selection::MultipleChoice
            && !self.begins_with_cells()
            && !self.is_bounded()
    }

    /// Whether an error bound is kept to.
    #[must_use]
    pub fn is_bounded(&self) -> bool {
        match self.method {
            Method::Auto => self.keep.max_error.is_some(),
            method => method == Method::Bounded,
        }
    }

    /// Whether this is done by clustering.
    #[must_use]
    pub fn is_clustering(&self) -> bool {
        match self.method {
            Method::Auto => matches!(self.goal, Goal::Cells(_) | Goal::CellSize(_)),
            Method::Stream | Method::Hybrid | Method::Bounded => false,
            Method::Cluster => true,
        }
    }

    /// Whether the first that is done is clustering.
    #[must_use]
    pub fn begins_with_cells(&self) -> bool {
        self.method == Method::Hybrid || self.is_clustering()
    }
}

impl Goal {
    /// Triangles wanted of so many; `None` for other goals.
    #[must_use]
    pub fn triangles_wanted(self, triangles: u64) -> Option<u64> {
        match self {
            Self::Triangles(count) => Some(count),
            Self::Ratio(ratio) => Some((triangles as f64 * ratio).round() as u64),
            Self::Cells(_) | Self::CellSize(_) | Self::Tolerance => None,
        }
    }
}

/// How far to simplify.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Goal {
    /// About this many triangles.
    Triangles(u64),
    /// About this share of the input's triangles, above 0, at most 1.
    Ratio(f64),
    /// Cubic cells, this many along the longest side of the bounding box.
    Cells(u32),
    /// Cubic cells with this edge, in model units.
    CellSize(f64),
    /// As far as the error bound allows.
    Tolerance,
}
