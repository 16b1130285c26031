//! What a job did, for scripts: the JSON of `--report`. Names are a contract.

use serde::Serialize;

use super::{CompareReport, Plan, plan::MEMORY_BYTES_CONSTANT};
use crate::{formats::Findings, geometry::Bounds};

/// All of it.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Report {
    /// The inputs together.
    pub input: InputReport,
    /// The result.
    pub output: OutputReport,
    /// Whether a wanted count was met within the method's tolerance; `None` without one.
    pub reached_target: Option<bool>,
    /// What ended the simplification: `target`, `error` when no collapse is left that keeps to the
    /// error bound, `cells`, `resolution` when no grid comes
    /// nearer to the target, `topology` when no collapse is left that keeps the surface what it
    /// is, `parity` when the last odd triangle could only go together with another, or `window`
    /// when triangles had to leave a window before they were coarse enough.
    pub stopped_by: Option<&'static str>,
    /// Simplification: `stream`, `cluster`, `hybrid` or `bounded`.
    pub method: Option<&'static str>,
    /// Why that, where it was left open.
    pub method_reason: Option<String>,
    /// Clustering: what it worked with.
    pub cluster: Option<ClusterReport>,
    /// Sorting: what it worked with.
    pub sort: Option<SortReport>,
    /// Decimation: what it worked with.
    pub decimate: Option<DecimateReport>,
    /// Decimation under an error bound: what it worked with, and what holds.
    pub bounded: Option<BoundedReport>,
    /// Decimation after clustering: what it worked with.
    pub hybrid: Option<HybridReport>,
    /// Decimation in a single pass: what it worked with.
    pub stream: Option<StreamReport>,
    /// A progressive mesh: what it is made of.
    pub progressive: Option<ProgressiveReport>,
    /// A progressive mesh refined: how far.
    pub refine: Option<RefineReport>,
    /// Simplification: how far the result is from the inputs, if that was to be measured and there
    /// is a result.
    pub deviation: Option<CompareReport>,
    /// What the plan had told, for comparison with what came.
    pub estimates: EstimatesReport,
    /// Largest resident set of the process.
    pub peak_memory_bytes: u64,
    /// Largest total of temporary files.
    pub temporary_bytes_peak: u64,
    /// Wall clock.
    pub seconds: f64,
    /// Per stage, in order of first appearance.
    pub stages: Vec<StageReport>,
    /// Attributes not carried.
    pub dropped: Vec<String>,
    /// Defects by kind.
    pub defects: Vec<DefectReport>,
}

/// The inputs of a job.
#[derive(Clone, Debug, Default, Serialize)]
pub struct InputReport {
    /// Triangles read (after polygons were triangulated).
    pub triangles: u64,
    /// Vertices; `None` for soups.
    pub vertices: Option<u64>,
    /// Bounding box in model units, when the job needed it.
    pub bounds: Option<BoundsReport>,
}

/// A bounding box in model units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct BoundsReport {
    /// Smallest coordinates.
    pub min: [f64; 3],
    /// Largest coordinates.
    pub max: [f64; 3],
}

/// The result of a job.
#[derive(Clone, Debug, Default, Serialize)]
pub struct OutputReport {
    /// Triangles written.
    pub triangles: u64,
    /// Vertices written; `None` for soups.
    pub vertices: Option<u64>,
    /// Bytes written; 0 when they went to standard output.
    pub bytes: u64,
}

/// How clustering went.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct ClusterReport {
    /// Cells along x, y, z.
    pub cells: [u32; 3],
    /// Edge of a cell in model units.
    pub cell_size: f64,
    /// Cells that held vertices.
    pub cells_occupied: u64,
    /// Triangles the estimate promised for the first attempt, when there was one.
    pub triangles_estimated: Option<u64>,
    /// Runs spilled to disk.
    pub spills: u64,
    /// Times the input was clustered to meet the count.
    pub attempts: u32,
}

/// How sorting went.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct SortReport {
    /// `x`, `y` or `z`.
    pub axis: &'static str,
    /// How many triangles the worst one came late, where that was measured.
    pub displacement_max: Option<u64>,
    /// Triangles were sorted on disk: they neither fit in memory nor were they nearly in order.
    pub on_disk: bool,
}

/// How decimation went.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct DecimateReport {
    /// `quadric` or `volume`.
    pub metric: &'static str,
    /// The sweep axis.
    pub axis: &'static str,
    /// How many triangles the worst one was late along that axis; `None` when the order was neither
    /// measured nor put right in passing.
    pub displacement_max: Option<u64>,
    /// Triangles were sorted on disk: they neither fit in memory nor were they nearly in order.
    pub sorted_on_disk: bool,
    /// Slabs the stream was cut into.
    pub slabs: u64,
    /// Triangles left out because two of their corners were one point.
    pub degenerate: u64,
    /// Vertices that were added because several sheets of the surface touched in one.
    pub split_vertices: u64,
    /// Vertices left alone because their faces are no fan.
    pub complex_vertices: u64,
}

/// How decimation under an error bound went.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct BoundedReport {
    /// No vertex of the input is farther than this from the result, in model units.
    pub max_error: f64,
    /// The same as a share of the diagonal of the input's bounding box, where that is known.
    pub max_error_share: Option<f64>,
    /// `error`, `shape` or `smooth`.
    pub fairing: &'static str,
    /// The sweep axis.
    pub axis: &'static str,
    /// How many triangles the worst one was late along that axis; `None` when the order was neither
    /// measured nor put right in passing.
    pub displacement_max: Option<u64>,
    /// Triangles were sorted on disk: they neither fit in memory nor were they nearly in order.
    pub sorted_on_disk: bool,
    /// Slabs the stream was cut into.
    pub slabs: u64,
    /// Triangles left out because two of their corners were one point.
    pub degenerate: u64,
    /// Vertices of those only, too far from all others: each is kept as a triangle of one point.
    pub loose_vertices: u64,
    /// Vertices that were added because several sheets of the surface touched in one.
    pub split_vertices: u64,
    /// Vertices left alone because their faces are no fan.
    pub complex_vertices: u64,
}

/// How decimation after clustering went.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct HybridReport {
    /// `quadric` or `volume`.
    pub metric: &'static str,
    /// Triangles that clustering left.
    pub triangles_clustered: u64,
    /// Vertices left alone because their faces are no fan.
    pub complex_vertices: u64,
}

/// How decimation in a single pass went.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct StreamReport {
    /// The sweep axis.
    pub axis: &'static str,
    /// How many triangles the worst one was late along that axis; `None` when they were sorted
    /// without measuring.
    pub displacement_max: Option<u64>,
    /// Triangles were sorted on disk: they neither fit in memory nor were they nearly in order.
    pub sorted_on_disk: bool,
    /// Triangles the window had room for.
    pub window_triangles: u64,
    /// Triangles in the window at most.
    pub window_max: u64,
    /// Triangles that waited for their neighbours at most, when the window was full.
    pub front_max: u64,
    /// Times the window was full.
    pub rounds: u64,
    /// Triangles written.
    pub written: u64,
    /// Those of them that were written before the end of the stream.
    pub written_early: u64,
    /// Those of them that were not next to what had been written already.
    pub written_inside: u64,
    /// Those of them that were finer than they should be, because the window had to be emptied.
    pub written_forced: u64,
    /// Triangles left out because two of their corners were one point.
    pub degenerate: u64,
    /// Vertices left alone because their faces are no fan.
    pub complex_vertices: u64,
    /// Vertices on a boundary, decimated and written like any other.
    pub boundary_vertices: u64,
}

/// What a progressive mesh is made of.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct ProgressiveReport {
    /// `quadric` or `volume`.
    pub metric: &'static str,
    /// Triangles of the base.
    pub base_triangles: u64,
    /// Bytes up to the end of the base.
    pub base_bytes: u64,
    /// Batches of splits after it.
    pub batches: u64,
    /// Bits of a coordinate.
    pub bits: u32,
    /// What positions were rounded to multiples of, model units.
    pub step: f64,
    /// Bytes of the file by triangles of the finest mesh.
    pub bytes_per_triangle: f64,
    /// Triangles left out because two of their corners were one vertex.
    pub degenerate: u64,
    /// Vertices that were added because several sheets of the surface touched in one.
    pub split_vertices: u64,
    /// Vertices left alone because their faces are no fan.
    pub complex_vertices: u64,
}

/// How far a progressive mesh was refined.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct RefineReport {
    /// Batches of the whole file.
    pub batches: u64,
    /// Batches that were used, the last one perhaps in part.
    pub batches_used: u64,
    /// The file ends before what was wanted.
    pub is_cut: bool,
    /// How far the finest mesh is from the result, as the file states it: root mean square, model
    /// units.
    pub rms_at_most: f64,
    /// The same, the largest distance that was seen.
    pub max_at_most: f64,
    /// What positions are multiples of, model units.
    pub step: f64,
}

/// What a plan told of a job, and what came.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct EstimatesReport {
    /// Largest resident set of the process.
    pub memory_bytes: EstimatedReport,
    /// Largest total of temporary files, once it was known whether triangles must be sorted.
    pub temporary_bytes: EstimatedReport,
    /// Wall clock.
    pub seconds: EstimatedReport,
}

/// A figure that was estimated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct EstimatedReport {
    /// What the plan said; `None` where it could not tell.
    pub planned: Option<f64>,
    /// What it was.
    pub actual: f64,
    /// The first by the second, where both say something.
    pub ratio: Option<f64>,
}

impl EstimatedReport {
    /// An estimate and what came.
    #[must_use]
    pub fn new(planned: Option<f64>, actual: f64) -> Self {
        let ratio = planned.filter(|_| actual > 0.0).map(|planned| planned / actual);
        Self { planned, actual, ratio }
    }
}

/// Memory beside a sort on disk.
const SORT_BYTES_BESIDE: u64 = 28 << 20;

impl Report {
    /// Sets what `plan` had told beside what came.
    pub fn compare_with(&mut self, plan: &Plan) {
        let on_disk = self.decimate.as_ref().map(|report| report.sorted_on_disk);
        let on_disk = on_disk.or(self.sort.as_ref().map(|report| report.on_disk));
        let on_disk = on_disk.or(self.stream.as_ref().map(|report| report.sorted_on_disk));
        let is_spared = on_disk == Some(false);
        let spared_bytes = if is_spared { plan.unsorted_bytes } else { 0 };
        let more_seconds = if is_spared { 0.0 } else { plan.unsorted_seconds };
        let seconds = plan.seconds().map(|seconds| seconds + more_seconds);
        let is_known = on_disk.is_some() || plan.unsorted_bytes == 0;
        let temporary_bytes = plan.temporary_bytes.filter(|_| is_known);
        let temporary_bytes = temporary_bytes.map(|bytes| (bytes - spared_bytes) as f64);
        // A sort takes what it gets.
        let most_bytes = plan.memory_bytes - MEMORY_BYTES_CONSTANT;
        let sort_bytes = most_bytes / 10 * 9 + SORT_BYTES_BESIDE;
        let least_bytes = if on_disk == Some(true) { sort_bytes } else { 0 };
        let memory_bytes = Some(plan.memory_expected_bytes.max(least_bytes) as f64);
        self.estimates = EstimatesReport {
            memory_bytes: EstimatedReport::new(memory_bytes, self.peak_memory_bytes as f64),
            temporary_bytes: EstimatedReport::new(
                temporary_bytes,
                self.temporary_bytes_peak as f64,
            ),
            seconds: EstimatedReport::new(seconds, self.seconds),
        };
    }
}

/// One stage.
#[derive(Clone, Debug, Serialize)]
pub struct StageReport {
    /// Name.
    pub name: String,
    /// Wall clock, all passes.
    pub seconds: f64,
    /// Records visited, all passes.
    pub records: u64,
}

/// One kind of defect.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DefectReport {
    /// Kind.
    pub kind: &'static str,
    /// Occurrences.
    pub count: u64,
    /// Place of the first, in words.
    pub first: String,
}

impl Report {
    /// Vertices that were left alone because their faces are no fan, if they are more than a tenth of
    /// those of the result: then they decide what it is.
    #[must_use]
    pub fn left_alone(&self) -> Option<u64> {
        let counts = [
            self.decimate.as_ref().map(|report| report.complex_vertices),
            self.bounded.as_ref().map(|report| report.complex_vertices),
            self.hybrid.as_ref().map(|report| report.complex_vertices),
            self.stream.as_ref().map(|report| report.complex_vertices),
            self.progressive.as_ref().map(|report| report.complex_vertices),
        ];
        let count = counts.into_iter().flatten().max()?;
        let vertices = self.output.vertices.unwrap_or(self.output.triangles / 2);
        (count > vertices / 10).then_some(count)
    }

    /// Takes over what readers found.
    pub fn add_findings(&mut self, findings: &Findings) {
        self.dropped.clone_from(&findings.dropped);
        self.defects = findings
            .defects
            .iter()
            .map(|defect| DefectReport {
                kind: defect.kind.name(),
                count: defect.count,
                first: defect.first.to_string(),
            })
            .collect();
    }
}

impl BoundsReport {
    /// The box in model units; `None` when it is empty.
    #[must_use]
    pub fn new(bounds: &Bounds, origin: [f64; 3]) -> Option<Self> {
        let at =
            |corner: [f32; 3]| std::array::from_fn(|axis| f64::from(corner[axis]) + origin[axis]);
        (!bounds.is_empty()).then(|| Self { min: at(bounds.min), max: at(bounds.max) })
    }
}
