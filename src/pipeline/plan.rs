//! What a job will do, before it does it: pure, from facts about the inputs.

use std::path::PathBuf;

use super::{
    Choice, Goal, Job, Method, Metric, Selection, Simplify, Task, attempts::Purpose, bounded,
    decimation, expected, hybrid, method, progressive, sort, streaming,
};
use crate::{
    error::{Error, Result},
    formats::{Compression, Declared, Format},
    progress::StageId,
    soup::{ColoredPoint, InputPath, OpenInput, Point, Triangle},
    stages::convert::{export::Target, presort},
    storage::is_stream,
};

/// What is known of an input before it is read.
#[derive(Clone, Debug)]
pub struct InputFacts {
    /// Where it is.
    pub path: InputPath,
    /// What its header says.
    pub declared: Declared,
    /// Bytes on disk, `None` for a stream.
    pub size_bytes: Option<u64>,
    /// It can be read again.
    pub repeatable: bool,
}

impl InputFacts {
    /// What is known of an open input.
    #[must_use]
    pub fn of(open: &OpenInput) -> Self {
        Self {
            path: open.input.path.clone(),
            declared: open.reader.declared().clone(),
            size_bytes: open.size_bytes,
            repeatable: open.input.is_repeatable(),
        }
    }
}

/// The stages of a job and what they need.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// In order.
    pub stages: Vec<PlannedStage>,
    /// By what triangles become fewer, for simplification.
    pub method: Option<Choice>,
    /// Vertices, as far as headers and sizes tell.
    pub vertices: Option<u64>,
    /// Faces and soup triangles, as far as headers and sizes tell.
    pub records: Option<u64>,
    /// Peak memory at most: the budget and what lies beside it.
    pub memory_bytes: u64,
    /// Peak memory, about; more, up to what is allowed, where triangles must be sorted on disk.
    pub memory_expected_bytes: u64,
    /// Peak of temporary files, at most; `None` when only the end of a stream will tell.
    pub temporary_bytes: Option<u64>,
    /// Where they go.
    pub temp_dir: PathBuf,
    /// What is free there; `None` before the machine has been looked at.
    pub temp_dir_available_bytes: Option<u64>,
    /// The part of that which triangles in order, or nearly so, do not need.
    pub unsorted_bytes: u64,
    /// Seconds by stage, about, in order; empty when nobody knows how much there is to do, or before
    /// the machine has been looked at.
    pub seconds: Vec<(StageId, f64)>,
    /// Seconds more where triangles turn out not to be nearly sorted.
    pub unsorted_seconds: f64,
    /// Size of the result, about; `None` when not known.
    pub output_bytes: Option<u64>,
    /// What is worth knowing: spooling, spilling.
    pub notes: Vec<String>,
}

/// A stage of a plan.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlannedStage {
    /// Stage.
    pub stage: StageId,
    /// What it does here.
    pub what: String,
}

/// Memory beside the budget: the program, its buffers, the allocator's slack.
pub(super) const MEMORY_BYTES_CONSTANT: u64 = 64 << 20;
/// Least budget a job is accepted with.
pub(super) const MEMORY_BYTES_MIN: u64 = 1 << 20;
/// Share of the budget a vertex table may take when clustering needs memory beside it.
const TABLE_SHARE_CLUSTER: f64 = 0.6;
/// The same when triangles are sorted beside it.
const TABLE_SHARE_SORT: f64 = 0.5;
/// The same for decimation, which needs more beside it.
const TABLE_SHARE_DECIMATE: f64 = 0.3;
/// The same when nothing else does.
const TABLE_SHARE_CONVERT: f64 = 0.9;
/// Bytes a cell and its two triangles take in the tables of clustering.
pub(super) const CLUSTER_BYTES_PER_CELL: u64 = 110;
/// Bytes a cell and its triangles take on disk while runs are merged: the runs themselves, ids,
/// vertices, and two generations of triangles; with overlap between runs.
const SPILL_BYTES_PER_CELL: u64 = 400;
/// Bytes of memory a triangle takes while its corners are welded there.
const WELD_BYTES_IN_MEMORY: u64 = 96;
/// Bytes a triangle takes at most while corners are sorted on disk to weld them: its three corners
/// with their positions, and those that are on their way back with numbers. What a step has read stays
/// until the next one is finished, so that a run that dies can go on.
const WELD_BYTES_PER_TRIANGLE: u64 = 3 * (24 + 36);
/// Bytes of a line of text that holds a vertex or a face, at least.
const LINE_BYTES_MIN: u64 = 7;
/// Bytes of a stored corner.
const CORNER_BYTES: u64 = 8;

/// Sizes of the records of a job.
#[derive(Clone, Copy)]
pub(super) struct Sizes {
    pub(super) vertex: u64,
    pub(super) triangle: u64,
}

impl Sizes {
    /// Whether vertices have a colour.
    pub(super) fn is_colored(self) -> bool {
        self.vertex > size_of::<Point>() as u64
    }
}

impl Job {
    /// Share of the budget that vertex tables may take.
    pub(super) fn table_share(&self) -> f64 {
        match self.task {
            Task::Simplify(ref simplify) if !simplify.begins_with_cells() => TABLE_SHARE_DECIMATE,
            Task::Simplify(_) => TABLE_SHARE_CLUSTER,
            Task::Sort(_) => TABLE_SHARE_SORT,
            Task::Soup | Task::Weld => TABLE_SHARE_CONVERT,
        }
    }
}

/// Decides the stages of `job` and estimates what they need.
///
/// # Errors
/// [`Error::Request`] when the request contradicts itself, [`Error::Resource`] when the memory
/// cannot suffice.
pub fn plan(job: &Job, inputs: &[InputFacts]) -> Result<Plan> {
    check_request(job)?;
    let records = inputs.iter().map(|facts| facts.declared.faces).sum();
    let indexed = |facts: &&InputFacts| facts.declared.indexed;
    let vertices = inputs.iter().filter(indexed).map(|facts| facts.declared.vertices).sum();
    let declared = progressive::triangles_declared(records, vertices);
    let settled = progressive::settled(job.clone(), declared);
    let (job, method) = &method::choose(&settled, records)?;
    let mut plan = Plan {
        stages: Vec::new(),
        vertices,
        method: method.clone(),
        records,
        memory_bytes: job.memory_bytes + MEMORY_BYTES_CONSTANT,
        memory_expected_bytes: 0,
        temporary_bytes: Some(0),
        temp_dir: job.temp_dir.clone(),
        temp_dir_available_bytes: None,
        unsorted_bytes: 0,
        seconds: Vec::new(),
        unsorted_seconds: 0.0,
        output_bytes: None,
        notes: Vec::new(),
    };
    let sizes = if inputs.iter().any(|facts| facts.declared.colors) {
        let triangle = size_of::<Triangle<ColoredPoint>>() as u64;
        Sizes { vertex: size_of::<ColoredPoint>() as u64, triangle }
    } else {
        Sizes { vertex: size_of::<Point>() as u64, triangle: size_of::<Triangle<Point>>() as u64 }
    };
    for facts in inputs {
        if facts.declared.indexed {
            plan_vertices(job, facts, sizes, &mut plan);
        } else {
            plan_soup(job, facts, sizes, &mut plan);
        }
    }
    match &job.task {
        Task::Simplify(simplify) if simplify.is_bounded() => {
            bounded::plan(job, simplify, sizes, &mut plan)?;
        }
        Task::Simplify(simplify) if simplify.is_clustering() => {
            plan_clustering(job, (simplify.goal, Purpose::Result), sizes, &mut plan);
        }
        Task::Simplify(simplify) if simplify.method == Method::Hybrid => {
            hybrid::plan(job, simplify, sizes, &mut plan);
        }
        Task::Simplify(simplify) if simplify.is_streaming() => {
            streaming::plan(job, simplify, sizes, &mut plan);
        }
        Task::Simplify(simplify) => plan_decimation(job, simplify, sizes, &mut plan),
        Task::Sort(how) => sort::plan(job, *how, inputs, sizes, &mut plan),
        Task::Weld => plan_weld(job, &mut plan),
        Task::Soup => {}
    }
    progressive::plan(job, sizes, &mut plan)?;
    plan_export(job, &mut plan);
    plan.memory_expected_bytes = expected::memory_bytes(job, &plan, sizes);
    Ok(plan)
}

/// Refuses what is wrong whatever the inputs are.
pub(super) fn check_request(job: &Job) -> Result<()> {
    if job.memory_bytes < MEMORY_BYTES_MIN {
        let (needed_bytes, available_bytes) = (MEMORY_BYTES_MIN, job.memory_bytes);
        return Err(Error::Resource { what: "the job", needed_bytes, available_bytes });
    }
    let streams = job.inputs.iter().filter(|path| **path == InputPath::Stdin).count();
    if streams > 0 && job.inputs.len() > 1 {
        return Err(Error::Request("standard input must be the only input".to_owned()));
    }
    if let Task::Simplify(simplify) = &job.task {
        bounded::check_request(simplify)?;
        let has_count = simplify.is_bounded() || simplify.goal.triangles_wanted(0).is_some();
        if !has_count && !simplify.is_clustering() {
            return Err(Error::Request("cells are a goal for clustering only".to_owned()));
        }
    }
    if let Task::Simplify(simplify) = &job.task
        && simplify.begins_with_cells()
        && simplify.selection == Selection::MultipleChoice
    {
        let text = "clustering takes triangles in any order and chooses no edges";
        return Err(Error::Request(text.to_owned()));
    }
    if let Task::Simplify(simplify) = &job.task
        && simplify.method == Method::Hybrid
        && simplify.assume_sorted.is_some()
    {
        let text = "clustering takes triangles in any order: no promise of one is needed";
        return Err(Error::Request(text.to_owned()));
    }
    if let Task::Simplify(simplify) = &job.task
        && simplify.is_streaming()
        && simplify.metric == Metric::Volume
    {
        let text = "multiple choice in one pass goes by quadrics: --metric quadric";
        return Err(Error::Request(text.to_owned()));
    }
    if let Task::Simplify(simplify) = &job.task
        && simplify.measure.is_some()
        && (streams > 0 || !matches!(&job.target, Target::File(path, _) if !is_stream(path)))
    {
        let text = "measuring reads the input and the result again: neither can be a pipe";
        return Err(Error::Request(text.to_owned()));
    }
    progressive::check_request(job)?;
    let format = job.output_format.name();
    let indexed = job.output_format.is_indexed();
    let refused = match job.task {
        _ if job.output_format == Format::Off => "off can be read but not written".to_owned(),
        Task::Soup | Task::Sort(_) if indexed => {
            format!("{format} is indexed; a soup is written as stl or soup")
        }
        Task::Weld if !indexed => format!("{format} has no indices; weld writes ply or obj"),
        _ => return Ok(()),
    };
    Err(Error::Request(refused))
}

fn plan_soup(job: &Job, facts: &InputFacts, sizes: Sizes, plan: &mut Plan) {
    let path = name(&facts.path);
    if !is_read_twice(job) {
        return;
    }
    if facts.repeatable {
        plan.stage(StageId::Import, format!("measure {path} (one pass)"));
        return;
    }
    plan.add_temporary(facts.declared.faces.map(|count| count * sizes.triangle));
    plan.stage(StageId::Import, format!("set {path} aside and measure it"));
    plan.notes.push(format!("{path} can be read only once and is needed twice: set aside on disk"));
}

/// Whether the task needs to know its input before it begins with it.
fn is_read_twice(job: &Job) -> bool {
    matches!(&job.task, Task::Simplify(simplify) if simplify.assume_sorted.is_none())
}

/// An input, in words.
pub(super) fn name(path: &InputPath) -> String {
    match path {
        InputPath::Stdin => "standard input".to_owned(),
        InputPath::File(_) => path.to_string(),
    }
}

fn plan_vertices(job: &Job, facts: &InputFacts, sizes: Sizes, plan: &mut Plan) {
    let is_needed_twice = is_read_twice(job);
    let path = name(&facts.path);
    let lines = facts.size_bytes.map(|bytes| bytes / LINE_BYTES_MIN);
    let table_bytes = facts.declared.vertices.or(lines).map(|count| count * sizes.vertex);
    let share = job.memory_bytes as f64 * job.table_share();
    let known = facts.declared.vertices.map(|count| count * sizes.vertex);
    let in_memory = known.is_some_and(|bytes| bytes as f64 <= share);
    let mut what = format!("read the vertices of {path} into memory");
    if !in_memory {
        plan.add_temporary(table_bytes);
        what += ", or on disk if they outgrow their share of it";
    }
    let needed_twice = is_needed_twice && !facts.repeatable;
    if !facts.declared.vertices_first || needed_twice {
        let faces = facts.declared.faces.or(lines);
        plan.add_temporary(faces.map(|count| count * 3 * CORNER_BYTES));
        what += "; set the faces aside";
    }
    plan.stage(StageId::Import, what);
    if !in_memory {
        // When indices turn out not to be local, references and soup lie side by side.
        let faces = facts.declared.faces.or(lines);
        plan.add_unsorted(faces.map(|count| count * 3 * (16 + 8 + 2 * sizes.vertex)));
        plan.stage(
            StageId::Dereference,
            "look up corners block by block, on disk if they are scattered".into(),
        );
    }
}

/// Adds clustering to a plan.
pub(super) fn plan_clustering(
    job: &Job,
    (goal, purpose): (Goal, Purpose),
    sizes: Sizes,
    plan: &mut Plan,
) {
    let wanted = match (goal, plan.records) {
        (Goal::Ratio(_), None) => None,
        (_, records) => purpose.triangles_wanted(goal, records.unwrap_or(u64::MAX)),
    };
    if matches!(goal, Goal::Triangles(_) | Goal::Ratio(_)) {
        plan.stage(StageId::Estimate, "find the cell size for the wanted count".to_owned());
    }
    plan.stage(StageId::Cluster, "sum quadrics by cell (one pass)".to_owned());
    plan.stage(StageId::Assemble, "place the vertices, number the triangles".to_owned());
    // Without a wanted count, every triangle could be in cells of its own.
    let cells = wanted.map(|count| count / 2).or(plan.records.map(|count| count / 2));
    let table_bytes = plan.vertices.map_or(0, |count| count * sizes.vertex);
    let room = job.memory_bytes.saturating_sub(table_bytes);
    if cells.is_none_or(|cells| cells * CLUSTER_BYTES_PER_CELL > room) {
        plan.add_temporary(cells.map(|cells| cells * SPILL_BYTES_PER_CELL));
        plan.notes.push("sums that outgrow the memory are spilled to disk and merged".to_owned());
    }
    plan.output_bytes = wanted.map(|count| count * (13 + sizes.vertex / 2));
}

fn plan_decimation(job: &Job, simplify: &Simplify, sizes: Sizes, plan: &mut Plan) {
    let wanted = plan.records.and_then(|count| simplify.goal.triangles_wanted(count));
    let is_measured = simplify.assume_sorted.is_none();
    if is_measured && plan.vertices.is_some_and(|count| count > 0) {
        plan.stage(StageId::Measure, "measure how far the triangles are from sorted".to_owned());
    }
    plan.stage(StageId::Sort, "put the triangles in the order of a sweep".to_owned());
    plan.stage(
        StageId::Decimate,
        format!("collapse edges by {}, slab by slab", simplify.metric.name()),
    );
    plan.stage(StageId::Finish, "join the slabs, meet the count, place the vertices".to_owned());
    let fits = plan.records.is_some_and(|count| decimation::absorbs_any(job, count));
    if is_measured && !fits {
        let disk_bytes = presort::disk_bytes_per_triangle(sizes.is_colored());
        plan.add_unsorted(plan.records.map(|count| count * disk_bytes));
        plan.notes.push("triangles that are nearly sorted are not sorted on disk".to_owned());
    }
    plan.output_bytes = wanted.map(|count| count * (13 + sizes.vertex / 2));
}

fn plan_weld(job: &Job, plan: &mut Plan) {
    plan.stage(StageId::Weld, "give equal positions one number".to_owned());
    let bytes = weld_bytes(job, plan.records);
    plan.add_temporary(bytes);
    if bytes != Some(0) {
        plan.notes.push("corners that outgrow the memory are sorted on disk".to_owned());
    }
}

/// Bytes on disk that welding so many triangles takes at most.
pub(super) fn weld_bytes(job: &Job, triangles: Option<u64>) -> Option<u64> {
    let fits = triangles.is_some_and(|count| count * WELD_BYTES_IN_MEMORY <= job.memory_bytes);
    if fits { Some(0) } else { triangles.map(|count| count * WELD_BYTES_PER_TRIANGLE) }
}

fn plan_export(job: &Job, plan: &mut Plan) {
    let name = match &job.target {
        Target::File(path, _) => path.display().to_string(),
        Target::Stdout => "standard output".to_owned(),
    };
    if matches!(job.task, Task::Soup | Task::Sort(_)) {
        let bytes = if job.output_format == Format::Stl { 50 } else { 36 };
        plan.output_bytes = plan.records.map(|count| count * bytes);
        let streamed = job.target == Target::Stdout || job.compression != Compression::None;
        if streamed && job.output_format == Format::Stl {
            plan.add_temporary(plan.output_bytes);
            plan.notes
                .push("an stl begins with its count: set aside until that is known".to_owned());
        }
    }
    plan.stage(StageId::Export, format!("write {name} ({})", job.output_format.name()));
    if let Task::Simplify(Simplify { measure: Some(samples), .. }) = job.task {
        let what = format!("measure how far {name} is from the input, {samples} samples each way");
        plan.stage(StageId::Compare, what);
    }
}

impl Plan {
    /// Seconds from beginning to end, about, if that can be told.
    #[must_use]
    pub fn seconds(&self) -> Option<f64> {
        let seconds = self.seconds.iter().map(|(_, seconds)| seconds);
        (!self.seconds.is_empty()).then(|| seconds.sum())
    }

    pub(super) fn stage(&mut self, stage: StageId, what: String) {
        self.stages.push(PlannedStage { stage, what });
    }

    /// Adds temporary files that triangles in order, or nearly so, do not need.
    pub(super) fn add_unsorted(&mut self, bytes: Option<u64>) {
        self.add_temporary(bytes);
        self.unsorted_bytes += bytes.unwrap_or(0);
    }

    /// Adds temporary files; the sum is unknown as soon as a part is.
    pub(super) fn add_temporary(&mut self, bytes: Option<u64>) {
        self.temporary_bytes = self.temporary_bytes.zip(bytes).map(|(total, more)| total + more);
    }
}
