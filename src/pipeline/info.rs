//! What a mesh is like: the inputs read as for any job, and measured instead of written. The
//! report is the JSON of `info --json`; its names are a contract.

use std::{collections::BTreeMap, path::PathBuf};

use serde::Serialize;

use super::{BoundsReport, Job, Sort, Task, TopologyReport, prepare, run::Run, topology};
use crate::{
    error::{Position, Result},
    formats::{Compression, Findings, Format, OnDefect},
    progress::Monitor,
    soup::{ColoredPoint, InputPath, OpenInput, Point, Vertex},
    stages::{
        convert::{
            export::Target,
            import::{self, Need},
            presort,
        },
        inspect::info as stage,
    },
};

/// What to look at, and with what.
#[derive(Clone, Debug)]
pub struct Info {
    /// How closely.
    pub detail: Detail,
    /// The inputs: one mesh, in this order.
    pub inputs: Vec<InputPath>,
    /// Format of all inputs; recognised when `None`.
    pub input_format: Option<Format>,
    /// Policy for bad records.
    pub on_defect: OnDefect,
    /// Memory to keep to, in bytes, beside a constant of at most 64 MiB.
    pub memory_bytes: u64,
    /// Threads to work with, at least 1.
    pub threads: usize,
    /// Folder for the workspace, which is used when the vertices do not fit in memory.
    pub temp_dir: PathBuf,
}

/// How closely to look.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Detail {
    /// What one pass over the inputs tells.
    OnePass,
    /// Edges and components, too, for which the triangles are put in the order of a sweep.
    Topology,
}

/// What a mesh is like.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct InfoReport {
    /// Format of the inputs; several in order of appearance, with commas between.
    pub format: String,
    /// Triangles, polygons taken apart.
    pub triangles: u64,
    /// Vertices, whether used by triangles or not; `None` when an input is a soup.
    pub vertices: Option<u64>,
    /// Box around all triangles in model units; `None` without triangles.
    pub bounds: Option<BoundsReport>,
    /// What is carried with each vertex: `position`, and `color` if there are colours.
    pub attributes: Vec<&'static str>,
    /// Attributes of the inputs that are not carried.
    pub dropped: Vec<String>,
    /// How far the triangles are from being sorted.
    pub order: OrderReport,
    /// How the surface hangs together.
    pub topology: TopologyFacts,
    /// By kind.
    pub defects: BTreeMap<&'static str, DefectInfo>,
}

/// How far the triangles are from the order of their least coordinates along an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct OrderReport {
    /// `x`, `y` or `z`: the longest side of the bounds.
    pub axis: &'static str,
    /// The triangles are in order.
    pub sorted: bool,
    /// How many triangles the worst one is late, see
    /// [`crate::stages::inspect::info::Outcome::displacement_max`].
    pub displacement_max: u64,
    /// The same along x, y and z.
    pub displacement_max_xyz: [u64; 3],
}

/// What the counts suggest about the surface, and what was counted of it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TopologyFacts {
    /// Of the inputs as they are; nothing is proved by it. Nearly 2 on a closed surface with few handles, less with boundaries or where vertices are
    /// not shared, 1/3 when no vertex is shared; `None` when an input is a soup.
    pub triangles_per_vertex: Option<f64>,
    /// With [`Detail::Topology`].
    #[serde(flatten)]
    pub counted: Option<TopologyReport>,
}

/// A kind of defect.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct DefectInfo {
    /// Occurrences.
    pub count: u64,
    /// Place of the first in its input, in words; `None` when it is not known.
    pub first: Option<String>,
}

/// Names of the axes.
const AXES: [&str; 3] = ["x", "y", "z"];

/// Looks at the inputs: one pass, memory within the budget, and temporary files only for indexed
/// inputs whose vertices do not fit in it. What [`Detail::Topology`] takes is said at
/// [`topology`](super::topology()).
///
/// # Errors
/// [`crate::Error::Input`] when an input is not what it says or has no faces,
/// [`crate::Error::Io`], [`crate::Error::Request`] and [`crate::Error::Resource`] as
/// [`prepare`](super::prepare), cancellation.
pub fn info(info: Info, monitor: &Monitor) -> Result<InfoReport> {
    let detail = info.detail;
    in_room(reading(info), monitor, |run, inputs| {
        if run.colored {
            look::<ColoredPoint>(run, inputs, detail)
        } else {
            look::<Point>(run, inputs, detail)
        }
    })
}

/// Does `work` with the inputs of a job, on its threads and with its memory.
pub(super) fn in_room<T: Send>(
    job: Job,
    monitor: &Monitor,
    work: impl FnOnce(&Run, Vec<OpenInput>) -> Result<T> + Send,
) -> Result<T> {
    prepare(job)?.with_room(monitor, work)
}

/// The job that reads the same in the same way: `soup`, too, needs the triangles once and as they
/// come, and `sort` needs them in order. Nothing is written.
pub(super) fn reading(info: Info) -> Job {
    let task = match info.detail {
        Detail::OnePass => Task::Soup,
        Detail::Topology => Task::Sort(Sort { axis: None }),
    };
    Job {
        task,
        inputs: info.inputs,
        input_format: info.input_format,
        on_defect: info.on_defect,
        target: Target::Stdout,
        output_format: Format::Soup,
        compression: Compression::None,
        memory_bytes: info.memory_bytes,
        threads: info.threads,
        temp_dir: info.temp_dir,
        progressive: None,
        keeping: None,
    }
}

fn look<V: Vertex>(run: &Run, inputs: Vec<OpenInput>, detail: Detail) -> Result<InfoReport> {
    let mut formats: Vec<&str> = Vec::new();
    for name in inputs.iter().map(|open| open.reader.format().name()) {
        if !formats.contains(&name) {
            formats.push(name);
        }
    }
    let indexed = inputs.iter().all(|open| open.reader.declared().indexed);
    let is_repeatable = inputs.iter().all(|open| open.input.is_repeatable());
    // What is read once and needed twice has to be set aside.
    let need = match detail {
        Detail::Topology if !is_repeatable => Need::Survey,
        _ => Need::Triangles,
    };
    let import::Outcome { source, survey } = run.import::<V>(inputs, need)?;
    let config = stage::Config { maxima_max: stage::MAXIMA_DEFAULT };
    let outcome = stage::info(&source, &config, run.monitor)?;
    let counted = match detail {
        Detail::OnePass => None,
        Detail::Topology => {
            let displacement_max = outcome.displacement_max;
            let order = presort::Order { displacement_max, triangles: outcome.triangles };
            Some(topology::count(&source, &outcome.bounds, order, run.workspace, run.monitor)?)
        }
    };
    let vertices = indexed.then_some(survey.vertices);
    let ratio = |vertices: u64| outcome.triangles as f64 / vertices as f64;
    let colors: &[_] = if V::COLORED { &["color"] } else { &[] };
    Ok(InfoReport {
        format: formats.join(", "),
        triangles: outcome.triangles,
        vertices,
        bounds: BoundsReport::new(&outcome.bounds, survey.origin),
        attributes: [&["position"], colors].concat(),
        order: order(&outcome),
        topology: TopologyFacts {
            triangles_per_vertex: vertices.filter(|count| *count > 0).map(ratio),
            counted,
        },
        defects: defects(&outcome.findings),
        dropped: outcome.findings.dropped,
    })
}

fn order(outcome: &stage::Outcome) -> OrderReport {
    let axis = outcome.bounds.longest_axis();
    let displacement_max = outcome.displacement_max[axis];
    OrderReport {
        axis: AXES[axis],
        sorted: displacement_max == 0,
        displacement_max,
        displacement_max_xyz: outcome.displacement_max,
    }
}

pub(super) fn defects(findings: &Findings) -> BTreeMap<&'static str, DefectInfo> {
    let defects = findings.defects.iter().map(|defect| {
        let known = defect.first != Position::default();
        let first = known.then(|| defect.first.to_string());
        (defect.kind.name(), DefectInfo { count: defect.count, first })
    });
    defects.collect()
}
