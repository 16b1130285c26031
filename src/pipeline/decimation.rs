//! Decimation to a wanted count: the stream put in order, cut into slabs, and finished.

use super::{
    DecimateReport, Goal, Simplify,
    run::Run,
    streaming::{count_unknown, sort_config},
};
use crate::{
    error::Result,
    formats::Findings,
    soup::{ColoredPoint, Source, SweepAxis, Triangle, Vertex},
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

/// Share of the budget that the window of a nearly sorted stream may take; beyond it the stream
/// is sorted like any other.
const WINDOW_SHARE: u64 = 4;

/// Bytes of memory that decimating so many triangles slab by slab needs, about, on one thread: for
/// the mesh that slabs leave, and before that for a slab and what waits, in the three quarters of it
/// that putting triangles in order leaves them.
pub(super) fn memory_bytes(simplify: &Simplify, triangles: u64) -> u64 {
    let config = decimate::Config {
        axis: SweepAxis::X,
        triangles: Some(triangles),
        wanted: Wanted::Triangles(simplify.goal.triangles_wanted(triangles).unwrap_or(triangles)),
        metric: simplify.metric,
        slab_triangles_min: decimate::SLAB_TRIANGLES_MIN,
        threshold: None,
    }
    .as_sampled();
    let rest_bytes = config.rest_bytes::<ColoredPoint>();
    // While slabs are worked on, what is left of the others waits, at less than half of what it
    // takes as a mesh.
    rest_bytes.max((config.slab_bytes::<ColoredPoint>(1) + rest_bytes / 2) / 3 * 4)
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
        let sampled = match simplify.assume_sorted {
            Some(_) => None,
            None => Some(self.sample(&source, &survey)?),
        };
        let order = sampled.as_ref().map(|sampled| sampled.order);
        let triangles = order.map(|order| order.triangles).or(source.records());
        let wanted = match (simplify.goal, triangles) {
            (Goal::Ratio(ratio), _) => Wanted::Ratio(ratio),
            (goal, Some(triangles)) => {
                Wanted::Triangles(goal.triangles_wanted(triangles).unwrap_or(triangles))
            }
            (_, None) => return Err(count_unknown()),
        };
        let metric = simplify.metric;
        let slab_triangles_min = decimate::SLAB_TRIANGLES_MIN;
        let threshold = None;
        let mut config =
            decimate::Config { axis, triangles, wanted, metric, slab_triangles_min, threshold };
        config.threshold = sampled.and_then(|sampled| sampled.threshold(&config));
        let displacement_max = order.map(|order| order.displacement_max[axis.index()]);
        let sort = self.presort_config::<V>(axis, displacement_max, &config);
        let mut sorted = None;
        let outcome = decimate::decimate(&config, self.workspace, self.monitor, |sink| {
            // The vertex table goes before what is left of the slabs needs its memory.
            let source: Source<V> = source;
            let _room = self.workspace.budget().reserve(sort.memory_bytes);
            sorted = Some(presort::presort(&source, &sort, self.workspace, self.monitor, sink)?);
            Ok(())
        })?;
        let sorted = sorted.expect("decimation has fed itself");
        let report = DecimateReport {
            metric: metric.name(),
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
        let slabs = config.slab_bytes::<V>(self.job.threads);
        let left = available.saturating_sub(slabs).max(available / WINDOW_SHARE);
        sort_config::<V>(axis, displacement_max, left)
    }
}
