//! Decimation to a wanted count: the stream put in order, cut into slabs, and finished.

use serde::{Deserialize, Serialize};

use super::{
    DecimateReport, Goal, Job, Simplify,
    run::Run,
    streaming::{count_unknown, sort_config},
};
use crate::{
    error::Result,
    formats::Findings,
    soup::{ColoredPoint, Point, Source, SweepAxis, Triangle, Vertex},
    stages::{
        convert::{
            import::{self, Survey},
            presort::{self, Method},
        },
        simplify::decimate::{self, Wanted},
    },
};

/// A decimated mesh and how it came about.
pub(super) struct Decimated<V> {
    pub(super) outcome: decimate::Outcome<V>,
    pub(super) survey: Survey,
    pub(super) findings: Findings,
    /// Triangles of the input.
    pub(super) triangles_in: u64,
    pub(super) report: DecimateReport,
}

impl<V: Vertex> Decimated<V> {
    /// Whether the count is the wanted one, or one below it where only pairs of triangles can go.
    pub(super) fn is_met(&self) -> bool {
        self.outcome.mesh.counts().triangles <= self.outcome.triangles_target
    }
}

/// What a first pass over the triangles tells.
struct Sampled<V> {
    order: presort::Order,
    blobs: Option<decimate::Blobs>,
    triangles: Vec<Triangle<V>>,
}

impl<V: Vertex> Sampled<V> {
    fn threshold(self, config: &decimate::Config) -> Option<decimate::Threshold> {
        decimate::threshold(config, self.blobs.as_ref()?, self.triangles)
    }
}

/// What the first pass and the feeding of the slabs are called in the journal of the workspace.
const LOOKED: &str = "order and threshold";
pub(super) const FED: &str = "slabs: fed";

/// What a first pass over the triangles tells, for the journal: numbers by their bits.
#[derive(Serialize, Deserialize)]
struct Looked {
    order: presort::Order,
    /// Cost, unit and share.
    threshold: Option<(u32, u32, u64)>,
}

impl Looked {
    fn new(order: presort::Order, threshold: Option<decimate::Threshold>) -> Self {
        let bits = |t: decimate::Threshold| (t.cost.to_bits(), t.unit.to_bits(), t.share.to_bits());
        Self { order, threshold: threshold.map(bits) }
    }

    fn threshold(&self) -> Option<decimate::Threshold> {
        let (cost, unit, share) = self.threshold?;
        let (cost, unit) = (f32::from_bits(cost), f32::from_bits(unit));
        Some(decimate::Threshold { cost, unit, share: f64::from_bits(share) })
    }
}

/// Share of the budget that the window of a nearly sorted stream may take; beyond it the stream
/// is sorted like any other.
const WINDOW_SHARE: u64 = 4;

/// Bytes of memory that decimating so many triangles slab by slab needs, about, on one thread: for
/// the mesh that slabs leave, and before that for a slab and what waits, in the three quarters of it
/// that putting triangles in order leaves them.
pub(super) fn memory_bytes(simplify: &Simplify, triangles: u64) -> u64 {
    let config = config(simplify, triangles).as_sampled();
    let rest_bytes = config.rest_bytes::<ColoredPoint>();
    // While slabs are worked on, what is left of the others waits, at less than half of what it
    // takes as a mesh.
    rest_bytes.max((config.slab_bytes::<ColoredPoint>(1) + rest_bytes / 2) / 3 * 4)
}

/// Decimation of so many triangles, as far as it is known before they are read.
fn config(simplify: &Simplify, triangles: u64) -> decimate::Config {
    decimate::Config {
        axis: SweepAxis::X,
        triangles: Some(triangles),
        triangles_exact: None,
        wanted: Wanted::Triangles(simplify.goal.triangles_wanted(triangles).unwrap_or(triangles)),
        metric: simplify.metric,
        slab_triangles_min: decimate::SLAB_TRIANGLES_MIN,
        threshold: None,
    }
}

/// Triangles of a front for each of the square root of all, as that of a gyroid is, and bytes a triangle
/// takes in the window that puts them in order.
const FRONT_WIDTH: u64 = 40;
const WINDOW_BYTES: u64 = 50;

/// Whether so many triangles are put in order in passing however they come.
pub(super) fn absorbs_any(job: &Job, triangles: u64) -> bool {
    let left = (job.memory_bytes as f64 * (1.0 - job.table_share())) as u64;
    let late = Some(triangles);
    let sort = sort_config::<ColoredPoint>(SweepAxis::X, late, left / WINDOW_SHARE);
    sort.method != Method::Sort
}

/// Bytes of memory that decimation slab by slab takes at its peak, about: what waits to be a slab, those
/// that are worked on, and what is left of the others; or the last mesh.
pub(super) fn expected_bytes(job: &Job, simplify: &Simplify, triangles: u64) -> u64 {
    let config = config(simplify, triangles).as_sampled();
    let slab = config.slab_triangles().min(triangles);
    let slabs = triangles / slab.max(1);
    let triangle_bytes = size_of::<Triangle<Point>>() as u64;
    let (face_bytes, rest_bytes) = (config.face_bytes::<Point>(), config.rest_bytes::<Point>());
    if slabs < 2 {
        return triangles * (face_bytes + triangle_bytes);
    }
    // One more waits, and one is being filled.
    let at_work = slabs.min(job.threads as u64);
    let slabs_bytes = slab * (at_work * face_bytes + 2 * triangle_bytes);
    // What is late waits in a window, about as wide as the front.
    let window_bytes = slab.min(2 * triangles.isqrt() * FRONT_WIDTH) * WINDOW_BYTES;
    rest_bytes.max(slabs_bytes + window_bytes + rest_bytes / 2)
}

impl Run<'_> {
    /// Decimates a stream to a count or a share of it, in one pass where the order is promised.
    pub(super) fn decimate_to_goal<V: Vertex>(
        &self,
        imported: import::Outcome<V>,
        simplify: &Simplify,
    ) -> Result<Decimated<V>> {
        let import::Outcome { source, survey } = imported;
        let axis = simplify.assume_sorted.unwrap_or(SweepAxis::ALL[survey.bounds.longest_axis()]);
        // One slab has no neighbours whose threshold it has to share, and is put in order whole.
        let is_small = source.records().is_some_and(|count| count <= decimate::SLAB_TRIANGLES_MIN);
        let is_one_slab = is_small && simplify.assume_sorted.is_none();
        let looked = match simplify.assume_sorted {
            None if !is_one_slab => Some(self.look(&source, &survey, simplify)?),
            _ => None,
        };
        let order = looked.map(|(order, _)| order);
        let counted = order.map(|order| order.triangles);
        let triangles = counted.or(source.records());
        let triangles_exact = counted.or(source.triangles());
        let wanted = match (simplify.goal, triangles) {
            (Goal::Ratio(ratio), _) => Wanted::Ratio(ratio),
            (goal, Some(triangles)) => {
                Wanted::Triangles(goal.triangles_wanted(triangles).unwrap_or(triangles))
            }
            (_, None) => return Err(count_unknown()),
        };
        let config = decimate::Config {
            axis,
            triangles,
            triangles_exact,
            wanted,
            metric: simplify.metric,
            slab_triangles_min: decimate::SLAB_TRIANGLES_MIN,
            threshold: looked.and_then(|(_, threshold)| threshold),
        };
        let displacement_max = order.map(|order| order.displacement_max[axis.index()]);
        let mut sort = self.presort_config::<V>(axis, displacement_max, &config);
        if is_one_slab {
            sort.method = Method::Sort;
        }
        let mut sorted = None;
        let outcome = decimate::decimate(&config, self.workspace, self.monitor, |sink| {
            // The vertex table goes before what is left of the slabs needs its memory.
            let source: Source<V> = source;
            let _room = self.workspace.budget().reserve(sort.memory_bytes);
            let outcome = presort::presort(&source, &sort, self.workspace, self.monitor, sink)?;
            self.workspace.note(FED, &outcome, Vec::new())?;
            sorted = Some(outcome);
            Ok(())
        })?;
        let noted = || Some(self.workspace.recall(FED)?.figures);
        let sorted: presort::Outcome = sorted.or_else(noted).expect("decimation was fed");
        let report = DecimateReport {
            metric: simplify.metric.name(),
            axis: axis.name(),
            displacement_max: displacement_max.or(sorted.displacement_max),
            sorted_on_disk: sorted.on_disk,
            slabs: outcome.slabs,
            degenerate: outcome.degenerate,
            split_vertices: outcome.split_vertices,
            complex_vertices: outcome.complex_vertices,
        };
        let (findings, triangles_in) = (sorted.findings, sorted.triangles);
        Ok(Decimated { outcome, survey, findings, triangles_in, report })
    }

    /// What a first pass tells: the order, and the threshold for all slabs; or what it told a run
    /// before this one.
    fn look<V: Vertex>(
        &self,
        source: &Source<V>,
        survey: &Survey,
        simplify: &Simplify,
    ) -> Result<(presort::Order, Option<decimate::Threshold>)> {
        if let Some(recalled) = self.workspace.recall::<Looked>(LOOKED) {
            return Ok((recalled.figures.order, recalled.figures.threshold()));
        }
        let sampled = self.sample(source, survey)?;
        let order = sampled.order;
        let threshold = sampled.threshold(&config(simplify, order.triangles));
        self.workspace.note(LOOKED, &Looked::new(order, threshold), Vec::new())?;
        Ok((order, threshold))
    }

    /// Measures the order of all triangles, and takes some of them aside.
    fn sample<V: Vertex>(&self, source: &Source<V>, survey: &Survey) -> Result<Sampled<V>> {
        let blobs = decimate::Blobs::choose(&survey.sample, &survey.bounds);
        let is_chosen = |triangle: &Triangle<V>| blobs.as_ref().is_some_and(|b| b.takes(triangle));
        let (order, triangles) =
            presort::measure_order(source, self.workspace, self.monitor, is_chosen)?;
        Ok(Sampled { order, blobs, triangles })
    }

    /// How the stream is put in order: in passing in a share of the memory, or in all of it that
    /// the slabs leave.
    fn presort_config<V: Vertex>(
        &self,
        axis: SweepAxis,
        displacement_max: Option<u64>,
        config: &decimate::Config,
    ) -> presort::Config {
        let available = self.workspace.budget().available_bytes();
        let in_passing = sort_config::<V>(axis, displacement_max, available / WINDOW_SHARE);
        if in_passing.method != Method::Sort {
            return in_passing;
        }
        // What slabs leave waits beside the sort, at less than half of what it takes as a mesh.
        let slabs = config.slab_bytes::<V>(self.job.threads) + config.rest_bytes::<V>() / 2;
        let left = available.saturating_sub(slabs).max(available / WINDOW_SHARE);
        sort_config::<V>(axis, displacement_max, left)
    }
}
