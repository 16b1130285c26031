//! `progressive`: a mesh of any size simplified to what a progressive mesh is to hold, and made one in
//! the same job.

use std::io::{self, Write as _};

use super::{
    Job, Metric, OutputReport, Plan, ProgressiveReport, Report, Task, plan::Sizes, run::Run,
};
use crate::{
    error::{Error, IoContext as _, Result},
    formats::{Compression, Findings, Format, progressive as format},
    mesh::{self, ByQuadric, ByVolume},
    progress::StageId,
    soup::{ColoredPoint, IndexedMesh, Point, Vertex},
    stages::{
        convert::export::Target,
        simplify::{hybrid, progressive as stage},
    },
    storage::OutputFile,
};

/// What a progressive mesh is to hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progressive {
    /// Triangles at most: a mesh of more is simplified first.
    pub triangles_max: u64,
    /// Which collapses come first, on the way to the base, too.
    pub metric: Metric,
    /// Bits of a coordinate, 4 to 24.
    pub bits: u32,
    /// Triangles of the base, about.
    pub base_triangles: u64,
}

/// Bytes of a triangle of the result, about.
const BYTES_PER_TRIANGLE: u64 = 4;

/// Refuses what is wrong whatever the inputs are.
pub(super) fn check_request(job: &Job) -> Result<()> {
    let is_progressive = job.progressive.is_some();
    let text = if is_progressive != (job.output_format == Format::Progressive) {
        "pm is what progressive writes, and nothing else does"
    } else if is_progressive && job.compression != Compression::None {
        "a progressive mesh is compressed already"
    } else if job.output_format == Format::Glb {
        "glb is written by refine only"
    } else {
        return Ok(());
    };
    Err(Error::Request(text.to_owned()))
}

/// The job as it is done: so few triangles need no decimation.
pub(super) fn settled(job: Job, triangles: Option<u64>) -> Job {
    if matches!(job.task, Task::Simplify(_)) && is_small(&job, triangles) {
        return Job { task: Task::Weld, ..job };
    }
    job
}

/// Whether a mesh of so many triangles becomes progressive as it is.
pub(super) fn is_small(job: &Job, triangles: Option<u64>) -> bool {
    let most = job.progressive.map(|progressive| progressive.triangles_max);
    most.zip(triangles).is_some_and(|(most, triangles)| triangles <= most)
}

/// Triangles by what the headers say: how many strips make is about two for a vertex.
pub(super) fn triangles_declared(records: Option<u64>, vertices: Option<u64>) -> Option<u64> {
    records.or(vertices.filter(|count| *count > 0).map(|count| 2 * count))
}

fn memory_bytes<V: Vertex>(metric: Metric, triangles: u64) -> u64 {
    match metric {
        Metric::Quadric => stage::memory_bytes::<V, ByQuadric>(triangles),
        Metric::Volume => stage::memory_bytes::<V, ByVolume>(triangles),
    }
}

/// Share of [`memory_bytes`] that is in use at a time: measured on 2 M triangles.
const IN_USE: f64 = 0.55;

/// Bytes of memory that making a mesh progressive takes, about; 0 where none is made.
pub(super) fn expected_bytes(job: &Job, plan: &Plan, sizes: Sizes) -> u64 {
    let (most_bytes, _) = needed(job, plan, sizes).unwrap_or_default();
    (most_bytes as f64 * IN_USE) as u64
}

/// Bytes of memory for the triangles there will be, as far as they are known, and how many they are.
fn needed(job: &Job, plan: &Plan, sizes: Sizes) -> Option<(u64, u64)> {
    let progressive = job.progressive?;
    let declared = triangles_declared(plan.records, plan.vertices)?;
    let triangles = declared.min(progressive.triangles_max);
    let bytes =
        if sizes.is_colored() { memory_bytes::<ColoredPoint> } else { memory_bytes::<Point> };
    Some((bytes(progressive.metric, triangles), triangles))
}

/// Adds what a progressive mesh takes, where that is wanted, to a plan; refuses what cannot fit.
pub(super) fn plan(job: &Job, sizes: Sizes, plan: &mut Plan) -> Result<()> {
    let Some(progressive) = job.progressive else { return Ok(()) };
    let Progressive { metric, bits, base_triangles, .. } = progressive;
    let what = format!("collapse edges by {} to {base_triangles} triangles", metric.name());
    plan.stage(StageId::Record, what);
    plan.stage(StageId::Encode, format!("turn the collapses round, {bits} bits a coordinate"));
    let needed = needed(job, plan, sizes);
    plan.output_bytes = needed.map(|(_, triangles)| triangles * BYTES_PER_TRIANGLE);
    let (needed_bytes, available_bytes) = (needed.map_or(0, |(bytes, _)| bytes), job.memory_bytes);
    if needed_bytes > available_bytes {
        return Err(Error::Resource { what: stage::PROGRESSIVE, needed_bytes, available_bytes });
    }
    Ok(())
}

impl Run<'_> {
    /// Makes a mesh progressive and writes it.
    pub(super) fn export_progressive<V: Vertex>(
        &self,
        mesh: IndexedMesh<V>,
        progressive: &Progressive,
        (origin, findings): ([f64; 3], &Findings),
        report: &mut Report,
    ) -> Result<()> {
        let outcome = match progressive.metric {
            Metric::Quadric => self.encode::<V, ByQuadric>(mesh, progressive, origin),
            Metric::Volume => self.encode::<V, ByVolume>(mesh, progressive, origin),
        }?;
        let meter = self.monitor.meter(StageId::Export, Some(outcome.triangles));
        let bytes = write(&outcome, &self.job.target)?;
        meter.add(outcome.triangles)?;
        meter.finish();
        let to_file = matches!(self.job.target, Target::File(..));
        report.output = OutputReport {
            triangles: outcome.triangles,
            vertices: Some(outcome.vertices),
            bytes: if to_file { bytes } else { 0 },
        };
        let base = &outcome.blocks[0].0;
        report.progressive = Some(ProgressiveReport {
            metric: progressive.metric.name(),
            base_triangles: base.faces.into(),
            base_bytes: format::HEADER_BYTES as u64 + base.size_bytes(),
            batches: outcome.blocks.len() as u64 - 1,
            bits: progressive.bits,
            step: outcome.header.step,
            bytes_per_triangle: bytes as f64 / outcome.triangles as f64,
            degenerate: outcome.degenerate,
            split_vertices: outcome.split_vertices,
            complex_vertices: outcome.complex_vertices,
        });
        report.add_findings(findings);
        Ok(())
    }

    fn encode<V: Vertex, M: mesh::Metric>(
        &self,
        mesh: IndexedMesh<V>,
        progressive: &Progressive,
        origin: [f64; 3],
    ) -> Result<stage::Outcome> {
        let Progressive { triangles_max, bits, base_triangles, .. } = *progressive;
        // Polygons are more triangles than the header said.
        let mesh = if mesh.counts().triangles > triangles_max {
            let config = hybrid::Config { triangles_target: triangles_max };
            let whole = hybrid::Clustered { mesh, quadrics: None };
            hybrid::decimate::<V, M>(whole, &config, self.workspace, self.monitor)?.mesh
        } else {
            mesh
        };
        let config = stage::Config { bits, base_triangles };
        stage::encode::<V, M>(mesh, origin, &config, self.workspace, self.monitor)
    }
}

/// Writes a progressive mesh to where it is wanted; returns its size.
fn write(outcome: &stage::Outcome, target: &Target) -> Result<u64> {
    let (path, stage::Outcome { header, blocks, .. }) = (target.path(), outcome);
    match target {
        Target::File(path, overwrite) => {
            let mut file = OutputFile::create(path, *overwrite)?;
            format::write(&mut file, header, blocks).at("write", path)?;
            file.finish()
        }
        Target::Stdout => {
            let mut stdout = io::stdout().lock();
            let written = format::write(&mut stdout, header, blocks);
            written.and_then(|bytes| stdout.flush().map(|()| bytes)).at("write", path)
        }
    }
}
