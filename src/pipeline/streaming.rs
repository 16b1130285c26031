//! Decimation in a single pass: a stream put in order in passing, a window, and out.

use super::{
    Goal, Job, Plan, Report, Simplify, StreamReport,
    plan::{Sizes, weld_bytes},
    run::{Run, report_input},
};
use crate::{
    error::{Error, Result},
    formats::{Compression, Format},
    progress::{Monitor, StageId},
    soup::{OpenInput, Point, Source, SweepAxis, Triangle, Vertex},
    stages::{
        convert::{
            export::{self, Target},
            import::{self, Need, Survey},
            presort::{self, Method},
            reindex,
        },
        simplify::stream,
    },
    storage::{RecordWriter, Workspace},
};

/// A stream that is said to be sorted may be late by so many triangles, if the memory is there to
/// make up for it. Chosen by hand: far more than surfaces made slice by slice need, and beside a
/// window of a few hundred MiB it is little.
const LATE_MAX: u64 = 1 << 20;
/// Share of the budget that putting triangles in order may take, and what it may take in any case,
/// as long as that is at most half.
const ORDER_SHARE: u64 = 4;
const ORDER_BYTES_MIN: u64 = 12 << 20;

/// Triangles of the window at first, however much memory there is. Chosen by hand: on an
/// iso-surface of 1 M triangles windows of 75 K and 187 K have the same error, larger ones less as
/// they come to hold nearly all of the mesh, and are slower, for the cache; beyond 1 M it was not
/// measured. Where the front of the mesh needs more, the window grows.
pub(super) const WINDOW_TRIANGLES: usize = 1 << 22;

/// What measuring the order is called in the journal of the workspace.
const ORDER: &str = "order";

/// Adds the stream to a plan.
pub(super) fn plan(job: &Job, simplify: &Simplify, sizes: Sizes, plan: &mut Plan) {
    let sort = match simplify.assume_sorted {
        Some(axis) => {
            format!("take the triangles as they come, nearly sorted along {}", axis.name())
        }
        None => "put the triangles in the order of a sweep".to_owned(),
    };
    plan.stage(StageId::Sort, sort);
    let bytes = job.memory_bytes - job.memory_bytes / ORDER_SHARE;
    let window = stream::window_triangles::<Point>(bytes).min(WINDOW_TRIANGLES);
    plan.stage(
        StageId::Decimate,
        format!("collapse edges in a window of {window} triangles, and let go what is coarse"),
    );
    let wanted = plan.records.and_then(|count| simplify.goal.triangles_wanted(count));
    let stl_bytes = wanted.map(|count| count * 50);
    plan.output_bytes = stl_bytes;
    if simplify.assume_sorted.is_none() {
        let disk_bytes = presort::disk_bytes_per_triangle(sizes.is_colored());
        plan.add_unsorted(plan.records.map(|count| count * disk_bytes));
        plan.notes.push("triangles that are nearly sorted are not sorted on disk".to_owned());
    }
    let is_streamed = job.target == Target::Stdout || job.compression != Compression::None;
    match job.output_format {
        Format::Ply | Format::Obj => {
            plan.add_temporary(wanted.map(|count| count * sizes.triangle));
            plan.add_temporary(weld_bytes(job, wanted));
            plan.stage(StageId::Weld, "number the vertices of what was let go".to_owned());
            plan.notes.push(
                "an indexed mesh begins with its vertices: triangles that are let go are set aside \
                 until they can be numbered, which --output-format soup saves"
                    .to_owned(),
            );
        }
        Format::Stl if is_streamed => {
            plan.add_temporary(stl_bytes);
            plan.notes
                .push("an stl begins with its count: set aside until that is known".to_owned());
        }
        _ => {}
    }
}

/// A stream ready to run.
struct Streaming<V> {
    source: Source<V>,
    survey: Survey,
    sort: presort::Config,
    config: stream::Config,
    /// How many triangles the worst one is late, if that was measured.
    displacement_max: Option<u64>,
}

/// What came of it.
struct Streamed {
    stream: stream::Outcome,
    sorted: presort::Outcome,
}

impl Run<'_> {
    /// Decimates by multiple choice, in one pass where the order is promised.
    pub(super) fn simplify_by_stream<V: Vertex>(
        &self,
        inputs: Vec<OpenInput>,
        simplify: &Simplify,
    ) -> Result<Report> {
        let prepared = self.prepare_stream::<V>(inputs, simplify)?;
        let export = self.export_config::<V>(prepared.survey.origin);
        let (workspace, monitor) = (self.workspace, self.monitor);
        let mut report;
        if self.job.output_format.is_indexed() {
            let mut released = RecordWriter::create(workspace, "released", None)?;
            let mut keep = |triangles: &[Triangle<V>]| released.extend(triangles);
            let done = prepared.run(workspace, monitor, &mut keep)?;
            let released = Source::stored(released.finish()?);
            let welded = reindex::reindex(&released, workspace, monitor)?;
            report = prepared.report(&done);
            drop(released);
            let findings = &done.sorted.findings;
            self.export_mesh(welded.mesh, &prepared.survey, findings, &mut report)?;
        } else {
            let (done, written) = export::export_triangles(None, &export, workspace, |send| {
                prepared.run(workspace, monitor, send)
            })?;
            report = prepared.report(&done);
            self.report_output(&written, &done.sorted.findings, &mut report);
        }
        Ok(report)
    }

    fn prepare_stream<V: Vertex>(
        &self,
        inputs: Vec<OpenInput>,
        simplify: &Simplify,
    ) -> Result<Streaming<V>> {
        let (source, survey, order) = self.ordered_source::<V>(inputs, simplify)?;
        let axis = simplify.assume_sorted.unwrap_or(SweepAxis::ALL[survey.bounds.longest_axis()]);
        let displacement_max = order.map(|order| order.displacement_max[axis.index()]);
        let available = self.workspace.budget().available_bytes();
        let order_bytes = (available / ORDER_SHARE).max(ORDER_BYTES_MIN.min(available / 2));
        let sort = sort_config::<V>(axis, displacement_max, order_bytes);
        let triangles = match (order, simplify.goal) {
            (Some(order), _) => Some(order.triangles),
            // Polygons are counted as triangles only by a pass over them.
            (None, Goal::Triangles(_)) if source.triangles() < source.records() => {
                Some(self.measured_order(&source)?.triangles)
            }
            _ => source.triangles(),
        };
        let target = match simplify.goal {
            Goal::Ratio(ratio) => stream::Target::Ratio(ratio),
            Goal::Triangles(triangles_wanted) => {
                let of = triangles.ok_or_else(count_unknown)?;
                stream::Target::Count { triangles: triangles_wanted, of }
            }
            Goal::Cells(_) | Goal::CellSize(_) | Goal::Tolerance => {
                unreachable!("a stream has a count to meet")
            }
        };
        let window_bytes = available.saturating_sub(sort.memory_bytes).max(available / 2);
        let window_max = stream::window_triangles::<V>(window_bytes);
        let config = stream::Config {
            axis,
            target,
            choices: simplify.choices,
            seed: simplify.seed,
            window_triangles: window_max.min(WINDOW_TRIANGLES),
            window_triangles_max: window_max,
            budget_bytes: self.job.memory_bytes,
        };
        Ok(Streaming { source, survey, sort, config, displacement_max })
    }

    /// The triangles, and what must be known of them to put them in order.
    pub(super) fn import_ordered<V: Vertex>(
        &self,
        inputs: Vec<OpenInput>,
        simplify: &Simplify,
    ) -> Result<import::Outcome<V>> {
        let need = simplify.assume_sorted.map_or(Need::Order, |_| Need::Triangles);
        self.import::<V>(inputs, need)
    }

    /// The triangles, and how far from sorted they are unless that is promised.
    fn ordered_source<V: Vertex>(
        &self,
        inputs: Vec<OpenInput>,
        simplify: &Simplify,
    ) -> Result<(Source<V>, Survey, Option<presort::Order>)> {
        let import::Outcome { source, survey } = self.import_ordered::<V>(inputs, simplify)?;
        if simplify.assume_sorted.is_some() {
            return Ok((source, survey, None));
        }
        let order = self.order_of(&source, &survey)?;
        Ok((source, survey, Some(order)))
    }

    /// How far from sorted the triangles are, by a pass over them, in this run or one before it.
    pub(super) fn measured_order<V: Vertex>(&self, source: &Source<V>) -> Result<presort::Order> {
        if let Some(recalled) = self.workspace.recall(ORDER) {
            return Ok(recalled.figures);
        }
        let (order, _) = presort::measure_order(source, self.workspace, self.monitor, |_| false)?;
        self.workspace.note(ORDER, &order, Vec::new())?;
        Ok(order)
    }

    /// How far from sorted the triangles are: as was found when they were imported, or by a pass.
    pub(super) fn order_of<V: Vertex>(
        &self,
        source: &Source<V>,
        survey: &Survey,
    ) -> Result<presort::Order> {
        Ok(match (survey.displacement_max, source.records()) {
            (Some(displacement_max), Some(triangles)) => {
                presort::Order { displacement_max, triangles }
            }
            _ => self.measured_order(source)?,
        })
    }
}

/// A count was asked for in a single pass over an input of unknown length.
pub(super) fn count_unknown() -> Error {
    let text = "how many triangles there are shows at the end of this input: a single pass can \
                keep a share of them (--ratio), not a number";
    Error::Request(text.to_owned())
}

/// How the stream is put in order in so much memory: in passing if it is, or is said to be, nearly
/// sorted.
pub(super) fn sort_config<V: Vertex>(
    axis: SweepAxis,
    displacement_max: Option<u64>,
    memory_bytes: u64,
) -> presort::Config {
    // Ties wait beside what is late.
    let needed_bytes = |late: u64| presort::window_bytes::<V>(late) / 4 * 5;
    // The least window is a few batches, and those lie beside the budget.
    let memory_bytes = memory_bytes.max(2 * needed_bytes(0));
    let absorb = |late| Method::Absorb { displacement_max: late };
    let method = match displacement_max {
        Some(late) if needed_bytes(late) <= memory_bytes => absorb(late),
        Some(_) => Method::Sort,
        None => {
            let mut halves = std::iter::successors(Some(LATE_MAX), |late| Some(late / 2));
            absorb(
                halves.find(|late| *late == 0 || needed_bytes(*late) <= memory_bytes).unwrap_or(0),
            )
        }
    };
    presort::Config { axis, method, memory_bytes, steps: Some(presort::STEPS) }
}

impl<V: Vertex> Streaming<V> {
    fn run(
        &self,
        workspace: &Workspace,
        monitor: &Monitor,
        out: &mut dyn FnMut(&[Triangle<V>]) -> Result<()>,
    ) -> Result<Streamed> {
        let mut sorted = None;
        let half_bytes = workspace.budget().available_bytes() / 2;
        let _room = workspace.budget().reserve(self.sort.memory_bytes.min(half_bytes));
        let outcome = stream::decimate(&self.config, workspace, monitor, out, |sink| {
            sorted = Some(presort::presort(&self.source, &self.sort, workspace, monitor, sink)?);
            Ok(())
        })?;
        Ok(Streamed { stream: outcome, sorted: sorted.expect("the stream has been fed") })
    }

    fn report(&self, done: &Streamed) -> Report {
        let Streamed { stream, sorted } = done;
        let mut report = report_input(&self.survey, sorted.triangles);
        report.method = Some(super::Method::Stream.name());
        report.reached_target = Some(stream.triangles_written <= stream.triangles_target);
        report.stopped_by = Some(match stream.triangles_written.cmp(&stream.triangles_target) {
            std::cmp::Ordering::Equal => "target",
            std::cmp::Ordering::Less => "parity",
            std::cmp::Ordering::Greater if stream.is_stuck => "topology",
            std::cmp::Ordering::Greater => "window",
        });
        report.stream = Some(StreamReport {
            axis: self.config.axis.name(),
            displacement_max: self.displacement_max.or(sorted.displacement_max),
            sorted_on_disk: sorted.on_disk,
            window_triangles: stream.window_triangles,
            window_max: stream.window_max,
            front_max: stream.front_max,
            rounds: stream.rounds,
            written: stream.triangles_written,
            written_early: stream.written_early,
            written_inside: stream.written_inside,
            written_forced: stream.written_forced,
            degenerate: stream.degenerate,
            complex_vertices: stream.complex_vertices,
            boundary_vertices: stream.boundary_vertices,
        });
        report
    }
}
