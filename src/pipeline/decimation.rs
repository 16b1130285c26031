//! Decimation to a wanted count: the stream put in order, cut into slabs, and finished.

use super::{DecimateReport, run::Run};
use crate::{
    error::Result,
    formats::Findings,
    soup::{OpenInput, Source, SweepAxis, Vertex},
    stages::{
        convert::{
            import::{Need, Outcome, Survey},
            presort::{self, Method, Order},
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
    /// Triangles asked for.
    pub(super) wanted: u64,
    pub(super) report: DecimateReport,
}

impl<V: Vertex> Decimated<V> {
    /// Whether the count is the wanted one, or one below it where only pairs of triangles can go.
    pub(super) fn is_met(&self) -> bool {
        self.outcome.mesh.counts().triangles <= self.wanted.max(1)
    }
}

/// Share of the budget that the window of a nearly sorted stream may take; beyond it the stream
/// is sorted like any other.
const WINDOW_SHARE: u64 = 4;

impl Run<'_> {
    /// Decimates the inputs to `wanted` triangles of so many.
    pub(super) fn decimate_to_goal<V: Vertex>(
        &self,
        inputs: Vec<OpenInput>,
        metric: decimate::Metric,
        wanted: impl FnOnce(u64) -> u64,
    ) -> Result<Decimated<V>> {
        let Outcome { source, survey } = self.import::<V>(inputs, Need::Order)?;
        let axis = SweepAxis::ALL[survey.bounds.longest_axis()];
        let order = match (survey.displacement_max, source.records()) {
            (Some(displacement_max), Some(triangles)) => Order { displacement_max, triangles },
            _ => presort::measure_order(&source, self.monitor)?,
        };
        let wanted = wanted(order.triangles).max(1);
        let triangles = Some(order.triangles);
        let config =
            decimate::Config { axis, triangles, wanted: Wanted::Triangles(wanted), metric };
        let displacement_max = order.displacement_max[axis.index()];
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
            displacement_max,
            sorted_on_disk: sorted.on_disk,
            slabs: outcome.slabs,
            degenerate: outcome.degenerate,
            complex_vertices: outcome.complex_vertices,
        };
        let (findings, triangles_in) = (sorted.findings, sorted.triangles);
        Ok(Decimated { outcome, survey, findings, triangles_in, wanted, report })
    }

    /// How the stream is put in order, in the memory that the slabs leave.
    fn presort_config<V: Vertex>(
        &self,
        axis: SweepAxis,
        displacement_max: u64,
        config: &decimate::Config,
    ) -> presort::Config {
        let available = self.workspace.budget().available_bytes();
        let slabs = config.slab_bytes(self.job.threads as u64);
        let left = available.saturating_sub(slabs).max(available / WINDOW_SHARE);
        let window_bytes = presort::window_bytes::<V>(displacement_max);
        let absorbs = window_bytes <= available / WINDOW_SHARE;
        let method = if absorbs { Method::Absorb { displacement_max } } else { Method::Sort };
        let memory_bytes = if absorbs { (2 * window_bytes).clamp(1 << 20, left) } else { left };
        presort::Config { axis, method, memory_bytes }
    }
}
