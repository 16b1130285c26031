//! How far two meshes are from each other, both ways. The report is the JSON of `compare --json`;
//! its names are a contract.

use std::{collections::BTreeMap, path::PathBuf};

use serde::Serialize;

use super::{
    BoundsReport, ComparePicture, DefectInfo, Detail, Info, Job, Simplify, Task, TopologyReport,
    info, prepare,
    run::{Room, room},
    topology,
};
use crate::{
    error::{Error, Fault, Position, Result},
    formats::{Format, OnDefect},
    progress::Monitor,
    soup::{InputPath, OpenInput, Point, Source},
    stages::{
        convert::{
            dereference,
            export::Target as Output,
            import::{self, Need},
            presort,
        },
        inspect::deviation::{self, Outcome, Surface, Target},
    },
    storage::Workspace,
};

/// What to compare, and with what.
#[derive(Clone, Debug)]
pub struct Compare {
    /// The mesh that lengths are relative to.
    pub a: CompareInput,
    /// The other one.
    pub b: CompareInput,
    /// Policy for bad records.
    pub on_defect: OnDefect,
    /// Points spread over each mesh by area.
    pub samples: u64,
    /// Which points.
    pub seed: u64,
    /// The picture of both, if one is wanted.
    pub picture: Option<ComparePicture>,
    /// Memory to keep to, in bytes, beside a constant of at most 64 MiB.
    pub memory_bytes: u64,
    /// Threads to work with, at least 1.
    pub threads: usize,
    /// Folder for the workspace, which is used when vertices do not fit in memory and for standard
    /// input.
    pub temp_dir: PathBuf,
}

/// A mesh to compare.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CompareInput {
    /// One mesh, in this order.
    pub paths: Vec<InputPath>,
    /// Format of all of them; recognised when `None`.
    pub format: Option<Format>,
}

/// How far two meshes are from each other. Lengths are in model units.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CompareReport {
    /// The first mesh.
    pub a: ComparedReport,
    /// The second mesh.
    pub b: ComparedReport,
    /// Diagonal of the box around the triangles of `a`.
    pub diagonal: f64,
    /// The boxes around both have a point in common. If not, the meshes lie in different places or
    /// are in different units.
    pub boxes_meet: bool,
    /// The greatest distance both ways.
    pub max: f64,
    /// From points of `a` to the nearest points of `b`.
    pub a_to_b: DeviationReport,
    /// From points of `b` to the nearest points of `a`.
    pub b_to_a: DeviationReport,
    /// Which points.
    pub samples: SamplesReport,
    /// How both hang together.
    pub topology: BothTopologies,
}

/// How two meshes hang together.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct BothTopologies {
    /// The first mesh.
    pub a: TopologyReport,
    /// The second mesh.
    pub b: TopologyReport,
}

/// A mesh that was compared.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ComparedReport {
    /// Where it is.
    pub path: String,
    /// Triangles, polygons taken apart.
    pub triangles: u64,
    /// Their area.
    pub area: f64,
    /// Box around them.
    pub bounds: Option<BoundsReport>,
    /// By kind.
    pub defects: BTreeMap<&'static str, DefectInfo>,
}

/// Distances from the points of one mesh to the other.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct DeviationReport {
    /// The greatest, of samples and vertices.
    pub max: f64,
    /// The root mean square of the samples; as all that follows, of the samples by area alone.
    pub rms: f64,
    /// The mean.
    pub mean: f64,
    /// Half of the area is no farther away.
    pub p50: f64,
    /// 95 % of the area.
    pub p95: f64,
    /// 99 % of the area.
    pub p99: f64,
    /// The point that is farthest away.
    pub max_at: [f64; 3],
    /// The same as shares of [`CompareReport::diagonal`].
    pub relative: RelativeReport,
    /// What is not known.
    pub confidence: ConfidenceReport,
}

/// Distances as shares of [`CompareReport::diagonal`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RelativeReport {
    /// See [`DeviationReport::max`].
    pub max: f64,
    /// See [`DeviationReport::rms`].
    pub rms: f64,
    /// See [`DeviationReport::mean`].
    pub mean: f64,
    /// See [`DeviationReport::p50`].
    pub p50: f64,
    /// See [`DeviationReport::p95`].
    pub p95: f64,
    /// See [`DeviationReport::p99`].
    pub p99: f64,
}

/// What samples leave open, see [`deviation::Confidence`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ConfidenceReport {
    /// How sure the other numbers are: 0.95.
    pub level: f64,
    /// The root mean square is known to plus or minus this.
    pub rms_error: f64,
    /// The mean is known to plus or minus this.
    pub mean_error: f64,
    /// The greatest distance of the samples alone.
    pub samples_max: f64,
    /// The share of the area, at most, that is farther away than that.
    pub unseen_share: f64,
}

/// Which points were measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct SamplesReport {
    /// Points by area, on each mesh.
    pub count: u64,
    /// What decides their places.
    pub seed: u64,
    /// Corners of triangles that were looked at beside them, for the greatest distance only: all
    /// there are, a vertex once for each of its triangles.
    pub corners: u64,
}

/// Each mesh is opened as if it had this part of the memory to itself; its vertices take a share of
/// that, the rest is for the points.
const MEMORY_PARTS: u64 = 3;
/// Share of the memory that is left which the vertices of a mesh may take.
const TABLE_SHARE: f64 = 0.3;

/// Compares two meshes. Reads each about eight times; standard input is set aside first.
///
/// # Errors
/// [`Error::Input`] when an input is not what it says, has no faces or none with an area,
/// [`Error::Io`], [`Error::Request`] and [`Error::Resource`] as [`prepare`](super::prepare) and
/// [`deviation::deviation`], cancellation.
pub fn compare(compare: &Compare, monitor: &Monitor) -> Result<CompareReport> {
    if compare.a.is_stdin() && compare.b.is_stdin() {
        let text = "only one of the two meshes can be standard input";
        return Err(Error::Request(text.to_owned()));
    }
    compare.picture.as_ref().map_or(Ok(()), |picture| picture.check(compare))?;
    let [a, b] = [compare.open(&compare.a)?, compare.open(&compare.b)?];
    let workspace = Workspace::create(&compare.temp_dir)?;
    let room = room(compare.threads, workspace, compare.memory_bytes)?;
    room.threads.install(|| compare.measure([a, b], &room, monitor))
}

impl CompareInput {
    /// Whether it is standard input.
    fn is_stdin(&self) -> bool {
        self.paths.contains(&InputPath::Stdin)
    }

    /// For errors, captions and reports: the first file, and how many there are beside it.
    pub(super) fn name(&self, name: impl Fn(&InputPath) -> String) -> String {
        let first = self.paths.first().map(name).unwrap_or_default();
        match self.paths.len() {
            0 | 1 => first,
            count => format!("{first} and {} more", count - 1),
        }
    }
}

impl Compare {
    /// How far the result of a job is from its inputs, if that is to be measured.
    pub(super) fn of_result(job: &Job) -> Option<Self> {
        let Task::Simplify(Simplify { measure: Some(samples), seed, .. }) = job.task else {
            return None;
        };
        let Output::File(output, _) = &job.target else { return None };
        Some(Self {
            a: CompareInput { paths: job.inputs.clone(), format: job.input_format },
            b: CompareInput {
                paths: vec![InputPath::File(output.clone())],
                format: Some(job.output_format),
            },
            on_defect: job.on_defect,
            samples,
            seed,
            picture: None,
            memory_bytes: job.memory_bytes,
            threads: job.threads,
            temp_dir: job.temp_dir.clone(),
        })
    }

    /// Opens a mesh, and looks whether the disk has room for what has to be set aside.
    fn open(&self, mesh: &CompareInput) -> Result<Vec<OpenInput>> {
        let reading = info::reading(Info {
            detail: Detail::Topology,
            inputs: mesh.paths.clone(),
            input_format: mesh.format,
            on_defect: self.on_defect,
            memory_bytes: self.memory_bytes / MEMORY_PARTS,
            threads: self.threads,
            temp_dir: self.temp_dir.clone(),
        });
        Ok(prepare(reading)?.into_inputs())
    }

    fn measure(
        &self,
        [a, b]: [Vec<OpenInput>; 2],
        room: &Room,
        monitor: &Monitor,
    ) -> Result<CompareReport> {
        let budget = room.workspace.budget();
        let (source_a, origin_a) = import(a, room, monitor)?;
        let (source_b, origin_b) = import(b, room, monitor)?;
        let a = survey(&self.a, &source_a, origin_a, (room, monitor))?;
        let b = survey(&self.b, &source_b, origin_b, (room, monitor))?;
        let config = deviation::Config { samples: self.samples, seed: self.seed };
        let measure = |from: &Surface<Point>, to: &Surface<Point>| {
            deviation::deviation(from, &Target::new(to, budget), &config, budget, monitor)
        };
        let (a_to_b, b_to_a) = (measure(&a, &b)?, measure(&b, &a)?);
        let count = |source: &Source<Point>, surface: &Surface<Point>| {
            let workspace = &room.workspace;
            let (order, _) = presort::measure_order(source, workspace, monitor, |_| false)?;
            topology::count(source, &surface.bounds, order, workspace, monitor)
        };
        let topology = BothTopologies { a: count(&source_a, &a)?, b: count(&source_b, &b)? };
        if let Some(picture) = &self.picture {
            picture.make(self, [&a, &b], &a_to_b, (budget, monitor))?;
        }
        let diagonal = a.bounds.diagonal();
        let (bounds_a, bounds_b) = (bounds(&a), bounds(&b));
        let meet = |a: &BoundsReport, b: &BoundsReport| {
            (0..3).all(|axis| a.min[axis] <= b.max[axis] && b.min[axis] <= a.max[axis])
        };
        let boxes_meet = bounds_a.zip(bounds_b).is_some_and(|(a, b)| meet(&a, &b));
        Ok(CompareReport {
            a: compared(&self.a, &a),
            b: compared(&self.b, &b),
            diagonal,
            boxes_meet,
            max: a_to_b.max.max(b_to_a.max),
            a_to_b: DeviationReport::new(&a_to_b, diagonal),
            b_to_a: DeviationReport::new(&b_to_a, diagonal),
            samples: SamplesReport {
                count: self.samples,
                seed: self.seed,
                corners: 3 * (a.triangles + b.triangles),
            },
            topology,
        })
    }
}

/// A mesh as triangles that can be read again and again, and their origin. Colours play no part.
fn import(
    inputs: Vec<OpenInput>,
    room: &Room,
    monitor: &Monitor,
) -> Result<(Source<Point>, [f64; 3])> {
    // A soup is read again as it is, without the pass that a survey would take; a pipe cannot be.
    let again = inputs.iter().all(|open| open.input.is_repeatable());
    let need = if again { Need::Triangles } else { Need::Survey };
    let config = import::Config { need, table_share: TABLE_SHARE };
    let imported = import::import(inputs, &config, &room.workspace, monitor)?;
    let source = dereference::dereference(imported.source, &room.workspace, monitor)?;
    Ok((source, imported.survey.origin))
}

fn survey<'a>(
    mesh: &CompareInput,
    source: &'a Source<Point>,
    origin: [f64; 3],
    (room, monitor): (&Room, &Monitor),
) -> Result<Surface<'a, Point>> {
    let surface = deviation::survey(source, origin, room.workspace.budget(), monitor)?;
    if surface.area > 0.0 {
        return Ok(surface);
    }
    let fault = Fault::NoArea { triangles: surface.triangles };
    let path = mesh.name(|path| path.as_path().display().to_string()).into();
    Err(Error::Input { path, at: Position::default(), fault })
}

fn bounds(surface: &Surface<Point>) -> Option<BoundsReport> {
    BoundsReport::new(&surface.bounds, surface.origin)
}

fn compared(mesh: &CompareInput, surface: &Surface<Point>) -> ComparedReport {
    ComparedReport {
        path: mesh.name(InputPath::to_string),
        triangles: surface.triangles,
        area: surface.area,
        bounds: bounds(surface),
        defects: info::defects(&surface.findings),
    }
}

impl DeviationReport {
    fn new(outcome: &Outcome, diagonal: f64) -> Self {
        let Outcome { max, max_at, statistics } = *outcome;
        let deviation::Statistics { rms, mean, p50, p95, p99, confidence, .. } = statistics;
        let relative = RelativeReport {
            max: max / diagonal,
            rms: rms / diagonal,
            mean: mean / diagonal,
            p50: p50 / diagonal,
            p95: p95 / diagonal,
            p99: p99 / diagonal,
        };
        let confidence = ConfidenceReport {
            level: 0.95,
            rms_error: confidence.rms_error,
            mean_error: confidence.mean_error,
            samples_max: statistics.max,
            unseen_share: confidence.unseen_share,
        };
        Self { max, rms, mean, p50, p95, p99, max_at, relative, confidence }
    }
}
