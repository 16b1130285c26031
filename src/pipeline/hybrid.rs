//! Clustering to a few times the wanted triangles, then decimation of what that leaves `[GS02]`.

use super::{
    HybridReport, Job, Method, Metric, Plan, Report, Simplify, Task,
    attempts::{Clustered, Imported, Purpose, TOLERANCE_AT_ONCE},
    decimation::Decimated,
    plan::{Sizes, plan_clustering},
    resume::note_method,
    run::{Run, report_input},
};
use crate::{
    error::{Error, Result},
    mesh::{self, ByQuadric, ByVolume},
    progress::StageId,
    soup::{ColoredPoint, Input, Vertex, VertexQuadric},
    stages::simplify::hybrid,
};

/// Clustering leaves this many times the wanted triangles. To 1 % of a CT scan of 6 M triangles and of
/// a gyroid of 4 M, the RMS error is 25 % and 15 % above that of slabs with twice as many, 11 % and
/// 9 % with four times, 10 % and 11 % with eight, 19 % and 31 % with sixteen: finer cells bend less
/// of the surface, but leave more pieces where sheets touch. Time and memory grow with the factor.
pub(super) const FACTOR: u64 = 4;

/// Where slabs leave more than so many times the wanted triangles, and no collapse is legal any more,
/// clustering goes first: it unties what collapses must leave alone. Below it a few triangles too many
/// do less harm than what clustering does to details.
const STUCK_FACTOR: f64 = 1.25;

/// Bytes of memory that decimating needs after clustering so many triangles.
pub(super) fn memory_bytes(simplify: &Simplify, triangles: u64) -> u64 {
    let clustered = Purpose::Decimation.triangles_wanted(simplify.goal, triangles).unwrap_or(0);
    // With colours, whether there are any or not: the choice of a method does not hang on them.
    let (face_bytes, quadric_bytes) = match simplify.metric {
        Metric::Quadric => {
            (mesh::face_bytes::<ColoredPoint, ByQuadric>(), size_of::<VertexQuadric>() as u64)
        }
        Metric::Volume => (mesh::face_bytes::<ColoredPoint, ByVolume>(), 0),
    };
    // What clustering made is still there when the mesh is made of it: a vertex for two faces.
    let vertex_bytes = size_of::<ColoredPoint>() as u64 + quadric_bytes;
    let made_bytes = size_of::<[u32; 3]>() as u64 + vertex_bytes.div_ceil(2);
    (clustered as f64 * TOLERANCE_AT_ONCE) as u64 * (face_bytes + made_bytes)
}

/// Refuses what cannot fit.
pub(super) fn check_memory(
    simplify: &Simplify,
    triangles: Option<u64>,
    available_bytes: u64,
) -> Result<()> {
    let needed_bytes = triangles.map_or(0, |triangles| memory_bytes(simplify, triangles));
    if needed_bytes <= available_bytes {
        return Ok(());
    }
    Err(Error::Resource { what: hybrid::CLUSTERED, needed_bytes, available_bytes })
}

/// Adds clustering and decimation to a plan.
pub(super) fn plan(job: &Job, simplify: &Simplify, sizes: Sizes, plan: &mut Plan) {
    plan_clustering(job, (simplify.goal, Purpose::Decimation), sizes, plan);
    let metric = simplify.metric.name();
    plan.stage(
        StageId::Finish,
        format!("collapse edges by {metric} to the exact count, place the vertices"),
    );
    let wanted = plan.records.and_then(|count| simplify.goal.triangles_wanted(count));
    plan.output_bytes = wanted.map(|count| count * (13 + sizes.vertex / 2));
}

impl Run<'_> {
    /// Whether what slabs have left is too far from the goal, and hybrid can be tried.
    pub(super) fn hybrid_is_better<V: Vertex>(
        &self,
        decimated: &Decimated<V>,
        inputs: &[Input],
        simplify: &Simplify,
    ) -> bool {
        let left = decimated.outcome.mesh.counts().triangles as f64;
        left > STUCK_FACTOR * decimated.outcome.triangles_target as f64
            && decimated.outcome.triangles_target > 0
            && inputs.iter().all(Input::is_repeatable)
            && check_memory(simplify, Some(decimated.triangles_in), self.job.memory_bytes).is_ok()
    }

    /// Simplifies once more, after slabs got stuck at so many triangles.
    pub(super) fn simplify_by_hybrid_instead<V: Vertex>(
        &self,
        inputs: &[Input],
        simplify: &Simplify,
        triangles_left: u64,
    ) -> Result<Report> {
        let reason = format!(
            "slabs were left with {triangles_left} triangles, no further collapse keeping the \
             surface what it is: clustering first"
        );
        let task = Task::Simplify(Simplify { method: Method::Hybrid, ..simplify.clone() });
        note_method(&Job { task, ..self.job.clone() }, self.workspace)?;
        let open = inputs.iter().map(Input::open).collect::<Result<_>>()?;
        let imported = self.import_for_clustering::<V>(open)?;
        let report = self.simplify_by_hybrid(imported, simplify)?;
        Ok(Report { method_reason: Some(reason), ..report })
    }

    pub(super) fn simplify_by_hybrid<V: Vertex>(
        &self,
        imported: Imported<V>,
        simplify: &Simplify,
    ) -> Result<Report> {
        let clustered = self.cluster_to_goal(imported, simplify, Purpose::Decimation)?;
        let Clustered { mesh, quadrics, survey, findings, triangles_in, report: cells, .. } =
            clustered;
        let wanted = simplify.goal.triangles_wanted(triangles_in).unwrap_or(triangles_in).max(1);
        let config = hybrid::Config { triangles_target: wanted };
        let clustered = hybrid::Clustered { mesh, quadrics };
        let (workspace, monitor) = (self.workspace, self.monitor);
        let outcome = match simplify.metric {
            Metric::Quadric => {
                hybrid::decimate::<V, ByQuadric>(clustered, &config, workspace, monitor)
            }
            Metric::Volume => {
                hybrid::decimate::<V, ByVolume>(clustered, &config, workspace, monitor)
            }
        }?;
        let mut report = report_input(&survey, triangles_in);
        report.method = Some(Method::Hybrid.name());
        let is_short = outcome.triangles_clustered < wanted;
        let is_over = outcome.mesh.counts().triangles > wanted;
        report.reached_target = Some(!is_short && !is_over);
        report.stopped_by = Some(match (is_short, is_over) {
            (true, _) => "resolution",
            (_, true) => "topology",
            _ => "target",
        });
        report.cluster = Some(cells);
        report.hybrid = Some(HybridReport {
            metric: simplify.metric.name(),
            triangles_clustered: outcome.triangles_clustered,
            complex_vertices: outcome.complex_vertices,
        });
        self.export_mesh(outcome.mesh, &survey, &findings, &mut report)?;
        Ok(report)
    }
}
