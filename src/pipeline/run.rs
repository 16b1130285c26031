//! Doing a job: inputs opened, the plan made, the stages run one after the other.

use std::{path::Path, time::Instant};

use super::{
    BoundsReport, Compare, InputFacts, InputReport, Job, Method, OutputReport, Plan, Report,
    Simplify, Task,
    attempts::{Clustered, Imported, Purpose},
    compare::compare,
    decimation::Decimated,
    expected,
    machine::Machine,
    method,
    plan::{check_request, plan},
    progressive,
    resume::{Beginning, note_method, note_start, settle},
};
use crate::{
    error::{Error, IoContext as _, Result},
    formats::{Findings, Format, Origin, Precision, WriteOptions},
    progress::Monitor,
    soup::{ColoredPoint, IndexedMesh, Input, InputPath, OpenInput, Point, Vertex},
    stages::convert::{
        dereference,
        export::{self, Target},
        import::{self, Need, Survey},
        reindex,
    },
    storage::{Budget, Workspace, available_disk_bytes, is_stream},
};

/// A job whose inputs are open and whose plan is made; nothing is written yet.
pub struct Prepared {
    job: Job,
    inputs: Vec<OpenInput>,
    /// Where it keeps a journal.
    beginning: Option<Beginning>,
    /// The method was left to us.
    is_method_open: bool,
    /// What will be done.
    pub plan: Plan,
}

/// Opens the inputs of `job` and plans it.
///
/// # Errors
/// [`Error::Input`] when an input's header is wrong, [`Error::Io`] when it cannot be opened,
/// [`Error::Request`] and [`Error::Resource`] when the job cannot be done as asked.
pub fn prepare(job: Job) -> Result<Prepared> {
    check_request(&job)?;
    check_target(&job.inputs, &job.target)?;
    let beginning = Beginning::of(&job)?;
    let open = |(index, path): (usize, &InputPath)| {
        let (format, on_defect) = (job.input_format, job.on_defect);
        let input = Input { path: path.clone(), format, on_defect, origin: Origin::undecided() };
        beginning.as_ref().map_or_else(|| input.open(), |beginning| beginning.open(&input, index))
    };
    let inputs = job.inputs.iter().enumerate().map(open).collect::<Result<Vec<_>>>()?;
    let is_method_open = matches!(&job.task, Task::Simplify(s) if s.method == Method::Auto);
    let mut job = job;
    let chosen_before = beginning.as_ref().and_then(Beginning::method);
    if let (Task::Simplify(simplify), Some(method)) = (&mut job.task, chosen_before) {
        simplify.method = method;
    }
    let facts: Vec<_> = inputs.iter().map(InputFacts::of).collect();
    let mut plan = plan(&job, &facts)?;
    let declared = progressive::triangles_declared(plan.records, plan.vertices);
    let job = progressive::settled(job, declared);
    let held_bytes = beginning.as_ref().map_or(0, Beginning::held_bytes);
    check_disk(&job, &plan, held_bytes)?;
    let input_bytes = facts.iter().map(|facts| facts.size_bytes).sum();
    let machine = Machine::measure(&facts);
    plan.temp_dir_available_bytes = available_disk_bytes(&job.temp_dir).ok();
    plan.seconds = expected::seconds(&job, &plan, input_bytes, machine);
    plan.unsorted_seconds = expected::unsorted_seconds(&job, &plan, machine);
    let (chosen, _) = method::choose(&job, plan.records)?;
    plan.notes.extend(beginning.iter().flat_map(|beginning| beginning.notes.iter().cloned()));
    Ok(Prepared { job: Job { task: chosen.task, ..job }, inputs, beginning, is_method_open, plan })
}

/// Refuses an output that is an input, or that cannot be made.
pub(super) fn check_target(inputs: &[InputPath], target: &Target) -> Result<()> {
    let Target::File(path, _) = target else { return Ok(()) };
    let same = |input: &InputPath| match (input, path.canonicalize()) {
        (InputPath::File(input), Ok(output)) => input.canonicalize().is_ok_and(|i| i == output),
        _ => false,
    };
    if inputs.iter().any(same) {
        let text = format!("{} is an input and cannot be the output", path.display());
        return Err(Error::Request(text));
    }
    target.check()
}

/// Refuses a job that the disks cannot hold, which has `held_bytes` of what it needs.
fn check_disk(job: &Job, plan: &Plan, held_bytes: u64) -> Result<()> {
    let check = |what, folder: &Path, needed_bytes: Option<u64>| {
        let available_bytes = available_disk_bytes(folder)?;
        match needed_bytes {
            Some(needed_bytes) if needed_bytes > available_bytes => {
                Err(Error::Resource { what, needed_bytes, available_bytes })
            }
            _ => Ok(()),
        }
    };
    let more_bytes = plan.temporary_bytes.map(|bytes| bytes.saturating_sub(held_bytes));
    check("the folder for temporary files", &job.temp_dir, more_bytes)?;
    match &job.target {
        Target::File(path, _) if !is_stream(path) => {
            let folder = path.parent().filter(|folder| *folder != Path::new(""));
            check("the output", folder.unwrap_or(Path::new(".")), plan.output_bytes)
        }
        Target::File(..) | Target::Stdout => Ok(()),
    }
}

impl Prepared {
    /// Runs the plan.
    ///
    /// # Errors
    /// What the stages fail with; nothing is left under the output's name then.
    pub fn run(self, monitor: &Monitor) -> Result<Report> {
        let started = Instant::now();
        let reason = self.plan.method.as_ref().and_then(|choice| choice.reason.clone());
        let measure = Compare::of_result(&self.job);
        let mut report = self.with_room(monitor, |run, inputs| {
            // Colours that the output cannot hold would decide ties, and the order of what it holds
            // would depend on what it does not.
            let is_colored = match run.job.task {
                Task::Sort(_) => run.colored && run.job.output_format != Format::Stl,
                _ => run.colored,
            };
            let report = if is_colored {
                run.task::<ColoredPoint>(inputs)
            } else {
                run.task::<Point>(inputs)
            };
            let temporary_bytes_peak = run.workspace.disk_bytes_peak();
            report.map(|report| Report { temporary_bytes_peak, ..report })
        })?;
        report.method_reason = report.method_reason.or(reason);
        if let Some(measure) = measure.filter(|_| report.output.triangles > 0) {
            report.deviation = Some(compare(&measure, monitor)?);
        }
        report.seconds = started.elapsed().as_secs_f64();
        Ok(report)
    }

    /// The inputs alone, for work of another kind.
    pub(super) fn into_inputs(self) -> Vec<OpenInput> {
        self.inputs
    }

    /// Does `work` on the job's threads, with its workspace and budget.
    pub(super) fn with_room<T: Send>(
        self,
        monitor: &Monitor,
        work: impl FnOnce(&Run, Vec<OpenInput>) -> Result<T> + Send,
    ) -> Result<T> {
        let Self { job, inputs, beginning, is_method_open, .. } = self;
        let workspace = match beginning {
            Some(beginning) => beginning.workspace(&job.temp_dir)?,
            None => Workspace::create(&job.temp_dir)?,
        };
        let Room { threads, workspace } = room(job.threads, workspace, job.memory_bytes)?;
        let colored = inputs.iter().any(|open| open.reader.declared().colors);
        let double = inputs.iter().any(|open| open.reader.declared().double);
        let run =
            Run { job: &job, is_method_open, colored, double, workspace: &workspace, monitor };
        let result = note_start(&job, &inputs, &workspace)
            .and_then(|()| threads.install(|| work(&run, inputs)));
        settle(workspace, &job, result)
    }
}

/// Where work is done.
pub(super) struct Room {
    pub(super) threads: rayon::ThreadPool,
    /// With its budget.
    pub(super) workspace: Workspace,
}

/// Starts threads, and gives a workspace its budget.
pub(super) fn room(threads: usize, workspace: Workspace, memory_bytes: u64) -> Result<Room> {
    let threads = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let threads = threads.map_err(std::io::Error::other).at("start threads in", Path::new("."))?;
    let workspace = workspace.with_budget(Budget::new(memory_bytes));
    Ok(Room { threads, workspace })
}

/// What the stages of one run share.
pub(super) struct Run<'a> {
    pub(super) job: &'a Job,
    /// As in [`Prepared`].
    is_method_open: bool,
    /// An input has vertex colours.
    pub(super) colored: bool,
    /// An input has more than single precision.
    double: bool,
    pub(super) workspace: &'a Workspace,
    pub(super) monitor: &'a Monitor<'a>,
}

impl Run<'_> {
    fn task<V: Vertex>(&self, inputs: Vec<OpenInput>) -> Result<Report> {
        match &self.job.task {
            Task::Simplify(simplify) => self.simplify::<V>(inputs, simplify),
            Task::Soup => self.soup::<V>(inputs),
            Task::Sort(sort) => self.sort::<V>(inputs, *sort),
            Task::Weld => self.weld::<V>(inputs),
        }
    }

    /// Reads the inputs as far as must be before the triangles can be used.
    pub(super) fn import<V: Vertex>(
        &self,
        inputs: Vec<OpenInput>,
        need: Need,
    ) -> Result<import::Outcome<V>> {
        let config = import::Config { need, table_share: self.job.table_share() };
        let (workspace, monitor) = (self.workspace, self.monitor);
        let again: Vec<Input> = inputs.iter().map(|open| open.input.clone()).collect();
        let recalled = import::recall(&again, &config, workspace, monitor)?;
        let imported = if let Some(imported) = recalled {
            imported
        } else {
            let imported = import::import(inputs, &config, workspace, monitor)?;
            import::note(&imported, &again, workspace)?;
            imported
        };
        let stored = imported.source.parts_stored();
        let source = dereference::dereference(imported.source, workspace, monitor)?;
        let imported = import::Outcome { source, ..imported };
        if imported.source.parts_stored() > stored {
            import::note(&imported, &again, workspace)?;
        }
        Ok(imported)
    }

    fn soup<V: Vertex>(&self, inputs: Vec<OpenInput>) -> Result<Report> {
        let import::Outcome { source, survey } = self.import::<V>(inputs, Need::Triangles)?;
        let config = self.export_config::<V>(survey.origin);
        let written = export::export_soup(&source, &config, self.workspace, self.monitor)?;
        let mut report = report_input(&survey, written.counts.triangles);
        self.report_output(&written, &written.findings, &mut report);
        Ok(report)
    }

    fn weld<V: Vertex>(&self, inputs: Vec<OpenInput>) -> Result<Report> {
        self.weld_imported(self.import::<V>(inputs, Need::Triangles)?)
    }

    fn weld_imported<V: Vertex>(&self, imported: import::Outcome<V>) -> Result<Report> {
        let import::Outcome { source, survey } = imported;
        let welded = reindex::reindex(&source, self.workspace, self.monitor)?;
        drop(source);
        let mut report = report_input(&survey, welded.mesh.counts().triangles);
        self.export_mesh(welded.mesh, &survey, &welded.findings, &mut report)?;
        Ok(report)
    }

    fn simplify<V: Vertex>(&self, inputs: Vec<OpenInput>, simplify: &Simplify) -> Result<Report> {
        if simplify.is_bounded() {
            self.simplify_by_bound::<V>(inputs, simplify)
        } else if simplify.is_clustering() {
            self.simplify_by_clustering::<V>(inputs, simplify)
        } else if simplify.is_streaming() {
            self.simplify_by_stream::<V>(inputs, simplify)
        } else if simplify.method == Method::Hybrid {
            let imported = self.import_for_clustering::<V>(inputs)?;
            self.simplify_by_hybrid(imported, simplify)
        } else {
            self.simplify_by_decimation::<V>(inputs, simplify)
        }
    }

    fn simplify_by_decimation<V: Vertex>(
        &self,
        inputs: Vec<OpenInput>,
        simplify: &Simplify,
    ) -> Result<Report> {
        let reopen: Vec<Input> = inputs.iter().map(|open| open.input.clone()).collect();
        let outcome = self.import_ordered::<V>(inputs, simplify)?;
        // Where headers do not say how many triangles there are, the method is chosen only now.
        if progressive::is_small(self.job, Some(outcome.survey.triangles())) {
            return self.weld_imported(outcome);
        }
        let (job, choice) = method::choose(self.job, Some(outcome.survey.triangles()))?;
        note_method(&job, self.workspace)?;
        let method_reason = choice.and_then(|choice| choice.reason);
        if let Task::Simplify(simplify) = &job.task
            && simplify.method == Method::Hybrid
        {
            let imported = Imported { outcome, inputs: reopen };
            let report = self.simplify_by_hybrid(imported, simplify)?;
            return Ok(Report { method_reason, ..report });
        }
        let decimated = self.decimate_to_goal(outcome, simplify)?;
        if self.is_method_open && self.hybrid_is_better(&decimated, &reopen, simplify) {
            let left = decimated.outcome.mesh.counts().triangles;
            drop(decimated);
            return self.simplify_by_hybrid_instead::<V>(&reopen, simplify, left);
        }
        let mut report = report_input(&decimated.survey, decimated.triangles_in);
        report.method = Some(Method::Stream.name());
        report.method_reason = method_reason;
        report.reached_target = Some(decimated.is_met());
        report.stopped_by = Some(if decimated.is_met() { "target" } else { "topology" });
        report.decimate = Some(decimated.report);
        let Decimated { outcome, survey, findings, .. } = decimated;
        self.export_mesh(outcome.mesh, &survey, &findings, &mut report)?;
        Ok(report)
    }

    fn simplify_by_clustering<V: Vertex>(
        &self,
        inputs: Vec<OpenInput>,
        simplify: &Simplify,
    ) -> Result<Report> {
        let imported = self.import_for_clustering::<V>(inputs)?;
        let clustered = self.cluster_to_goal(imported, simplify, Purpose::Result)?;
        if clustered.mesh.counts().triangles == 0 && clustered.triangles_in > 0 {
            let text = format!(
                "cells of size {} leave none of {} triangles: no triangle reaches into three cells",
                clustered.report.cell_size, clustered.triangles_in
            );
            return Err(Error::Request(text));
        }
        let mut report = report_input(&clustered.survey, clustered.triangles_in);
        report.method = Some(Method::Cluster.name());
        report.reached_target = clustered.wanted.map(|_| clustered.is_met());
        report.stopped_by = Some(match report.reached_target {
            None => "cells",
            Some(true) => "target",
            Some(false) => "resolution",
        });
        report.cluster = Some(clustered.report);
        let Clustered { mesh, survey, findings, .. } = clustered;
        self.export_mesh(mesh, &survey, &findings, &mut report)?;
        Ok(report)
    }

    pub(super) fn export_mesh<V: Vertex>(
        &self,
        mesh: IndexedMesh<V>,
        survey: &Survey,
        findings: &Findings,
        report: &mut Report,
    ) -> Result<()> {
        if let Some(progressive) = self.job.progressive {
            return self.export_progressive(mesh, &progressive, (survey.origin, findings), report);
        }
        let config = self.export_config::<V>(survey.origin);
        let written = export::export_mesh(&mesh, &config, self.workspace, self.monitor)?;
        self.report_output(&written, findings, report);
        Ok(())
    }

    pub(super) fn export_config<V: Vertex>(&self, origin: [f64; 3]) -> export::Config {
        let far = origin != [0.0; 3];
        let precision = if self.double || far { Precision::Double } else { Precision::Single };
        export::Config {
            target: self.job.target.clone(),
            format: self.job.output_format,
            compression: self.job.compression,
            write: WriteOptions { precision, origin, colors: V::COLORED },
        }
    }

    pub(super) fn report_output(
        &self,
        written: &export::Outcome,
        findings: &Findings,
        report: &mut Report,
    ) {
        let indexed = self.job.output_format.is_indexed();
        report.output = OutputReport {
            triangles: written.counts.triangles,
            vertices: indexed.then_some(written.counts.vertices),
            bytes: written.size_bytes,
        };
        let mut findings = findings.clone();
        if self.colored && self.job.output_format == Format::Stl {
            findings.drop_attribute("vertex colours (stl has none)");
        }
        report.add_findings(&findings);
    }
}

pub(super) fn report_input(survey: &Survey, triangles: u64) -> Report {
    let input = InputReport {
        triangles,
        vertices: (survey.vertices > 0).then_some(survey.vertices),
        bounds: BoundsReport::new(&survey.bounds, survey.origin),
    };
    Report { input, ..Report::default() }
}
