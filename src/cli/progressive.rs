//! `progressive`: a mesh of any size becomes one that refines while it loads.

use std::process::ExitCode;

use clap::Args;
use meshmill::{
    Result,
    geometry::Placement,
    pipeline::{self, Job, Keep, Method, Selection, Task},
};

use super::{
    args::{Convert, Metric},
    commands::{in_session, run_job},
    job::{self, Host},
    outcome, values,
};

/// A mesh of any size to a progressive one (.pm): a coarse mesh, and what refines it step by step.
///
/// Any beginning of the file that has the coarse mesh is a mesh, so that it can be shown while the
/// rest loads; `refine` takes any triangle count or error out of it again. Positions are rounded to
/// --bits first; what is refined to the end is exactly that. More than --triangles are simplified
/// first, out of core.
#[derive(Debug, Args)]
pub(super) struct Progressive {
    #[command(flatten)]
    pub(super) convert: Convert,

    #[command(flatten)]
    pub(super) fineness: Fineness,
}

/// How fine a progressive mesh is, and how coarse it begins.
#[derive(Clone, Debug, Args)]
pub(super) struct Fineness {
    /// Triangles at most: what a mesh has more is simplified away first
    #[arg(short, long, value_name = "N", value_parser = values::count, default_value = "2M")]
    pub(super) triangles: u64,

    /// Steps along the longest side of the bounding box, as a power of two: 14 are 16,384
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(4..=24), default_value = "14")]
    pub(super) bits: u32,

    /// Triangles of the coarsest mesh
    #[arg(long, value_name = "N", value_parser = values::count, default_value = "500")]
    pub(super) base: u64,

    /// What decides which edges go first, and where their ends meet
    #[arg(long, value_enum, default_value_t = Metric::Volume)]
    pub(super) metric: Metric,
}

/// `meshmill progressive`.
pub(super) fn progressive(args: &Progressive, host: &Host) -> ExitCode {
    in_session(&args.convert.run.machine, |session| {
        run_job(meaning(&args.convert, &args.fineness, host)?, &args.convert, session)?;
        Ok(outcome::DONE)
    })
}

/// The job that makes such a mesh.
pub(super) fn meaning(convert: &Convert, fineness: &Fineness, host: &Host) -> Result<Job> {
    let metric = match fineness.metric {
        Metric::Quadric => pipeline::Metric::Quadric,
        Metric::Volume => pipeline::Metric::Volume,
    };
    let simplify = pipeline::Simplify {
        goal: pipeline::Goal::Triangles(fineness.triangles),
        method: Method::Auto,
        metric,
        selection: Selection::Threshold,
        choices: 8,
        seed: 0,
        assume_sorted: None,
        boundary_weight: 0.5,
        placement: Placement::Constrained,
        keep: Keep::default(),
        measure: None,
    };
    let progressive = pipeline::Progressive {
        triangles_max: fineness.triangles,
        metric,
        bits: fineness.bits,
        base_triangles: fineness.base,
    };
    let job = job::convert(convert, Task::Simplify(simplify), host)?;
    Ok(Job { progressive: Some(progressive), ..job })
}
