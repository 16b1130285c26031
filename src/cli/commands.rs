//! The commands, from what was typed to the exit code.

use std::{
    io,
    io::Write as _,
    path::{Path, PathBuf},
    process::ExitCode,
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    },
    time::Instant,
};

use meshmill::{
    Error, Result,
    formats::{Counts, Precision, WriteOptions},
    pipeline::{self, Job, OutputReport, Plan, Report, StageReport, Task},
    progress::{Cancel, Monitor},
    stages::{convert::export, generate},
    storage::{OutputFile, Overwrite, Workspace, check_output, is_stream},
};
use signal_hook::consts::{SIGINT, SIGTERM};

use super::{
    args::{Convert, Generate, Kind, Machine, Run, Simplify, Sort},
    display::{Display, Volume},
    figures, host,
    job::{self, Destination, Host},
    outcome,
};

/// What a command runs under: the display and the signals.
pub(super) struct Session {
    pub(super) display: Display,
    cancel: Cancel,
    signal: Arc<AtomicUsize>,
}

impl Session {
    fn start(machine: &Machine) -> io::Result<Self> {
        let volume = if machine.quiet { Volume::Quiet } else { Volume::Normal };
        let display = Display::new(machine.progress, volume);
        let (cancel, signal) = (Cancel::default(), Arc::<AtomicUsize>::default());
        for number in [SIGINT, SIGTERM] {
            // The first signal raises the flag, the second ends the process at once.
            signal_hook::flag::register_conditional_shutdown(number, 128 + number, cancel.flag())?;
            signal_hook::flag::register_usize(number, Arc::clone(&signal), number as usize)?;
            signal_hook::flag::register(number, cancel.flag())?;
        }
        Ok(Self { display, cancel, signal })
    }

    pub(super) fn monitor(&self) -> Monitor<'_> {
        Monitor { observer: &self.display, cancel: self.cancel.clone() }
    }

    fn end(&self, result: Result<u8>) -> ExitCode {
        match result {
            Ok(code) => ExitCode::from(code),
            Err(error) => {
                let signal = self.signal.load(Ordering::Relaxed);
                outcome::fail(&error, (signal > 0).then_some(signal as i32), &self.display)
            }
        }
    }
}

/// Runs `work` in a session.
pub(super) fn in_session(machine: &Machine, work: impl FnOnce(&Session) -> Result<u8>) -> ExitCode {
    match Session::start(machine) {
        Ok(session) => {
            let result = work(&session);
            session.end(result)
        }
        // Signals cannot be caught: the machine is in a bad way.
        Err(_) => ExitCode::from(outcome::FAILED),
    }
}

/// `meshmill simplify`.
pub(super) fn simplify(args: &Simplify, host: &Host) -> ExitCode {
    in_session(&args.convert.run.machine, |session| {
        let report = run_job(job::simplify(args, host)?, &args.convert, session)?;
        let short = report.is_some_and(|report| report.reached_target == Some(false));
        Ok(if short && args.strict { outcome::SHORT_OF_TARGET } else { outcome::DONE })
    })
}

/// `meshmill soup` and `meshmill weld`.
pub(super) fn convert(args: &Convert, task: Task, host: &Host) -> ExitCode {
    in_session(&args.run.machine, |session| {
        run_job(job::convert(args, task, host)?, args, session)?;
        Ok(outcome::DONE)
    })
}

/// `meshmill sort`.
pub(super) fn sort(args: &Sort, host: &Host) -> ExitCode {
    in_session(&args.convert.run.machine, |session| {
        run_job(job::sort(args, host)?, &args.convert, session)?;
        Ok(outcome::DONE)
    })
}

/// Plans and runs a job; `None` after a dry run.
pub(super) fn run_job(job: Job, args: &Convert, session: &Session) -> Result<Option<Report>> {
    let to_stdout = args.output.path == Path::new("-");
    check_report(&args.run, &args.inputs.paths, &args.output.path)?;
    let prepared = pipeline::prepare(job)?;
    if args.dry_run {
        return print(&prepared.plan.to_string()).map(|()| None);
    }
    if args.run.verbose {
        session.display.say(prepared.plan.to_string().trim_end());
    } else {
        session.display.say(&format!("plan: {}", prepared.plan.summary()));
        let choice = prepared.plan.method.iter().filter(|choice| choice.reason.is_some());
        choice.for_each(|choice| session.display.say(&format!("method: {choice}")));
        for note in &prepared.plan.notes {
            session.display.say(&format!("note: {note}"));
        }
    }
    let plan = prepared.plan.clone();
    session.display.expect(&plan.seconds);
    let mut report = prepared.run(&session.monitor())?;
    session.display.close();
    complete_report(&mut report, Some(&plan), &args.run, session)?;
    tell(&report, args, to_stdout, session)?;
    Ok(Some(report))
}

/// Adds to a report what the process knows of itself, and writes it where that is wanted.
pub(super) fn complete_report(
    report: &mut Report,
    plan: Option<&Plan>,
    run: &Run,
    session: &Session,
) -> Result<()> {
    report.peak_memory_bytes = host::peak_memory_bytes().unwrap_or_default();
    if let Some(plan) = plan {
        report.compare_with(plan);
    }
    let stages = session.display.stages().into_iter();
    let stages = stages.map(|stage| StageReport {
        name: stage.name.to_owned(),
        seconds: stage.seconds,
        records: stage.records,
    });
    report.stages = stages.collect();
    run.report.as_ref().map_or(Ok(()), |path| write_report(report, path))
}

/// Tells the person what came of it.
fn tell(report: &Report, args: &Convert, to_stdout: bool, session: &Session) -> Result<()> {
    for defect in &report.defects {
        session.display.say(&figures::defect(defect));
    }
    if !report.dropped.is_empty() {
        session.display.say(&format!("not carried: {}", report.dropped.join(", ")));
    }
    if let Some(sort) = &report.sort {
        session.display.say(&figures::order(sort));
    }
    if report.reached_target == Some(false) || report.stopped_by == Some("parity") {
        session.display.say(figures::shortfall(report.stopped_by));
    }
    if let Some(vertices) = report.left_alone().filter(|_| report.progressive.is_none()) {
        session.display.say(&figures::left_alone(vertices));
    }
    let mut line = format!(
        "{}: {} triangles of {} in {:.1} s, {} of memory",
        args.output.path.display(),
        figures::count(report.output.triangles),
        figures::count(report.input.triangles),
        report.seconds,
        bytesize::ByteSize(report.peak_memory_bytes),
    );
    if let Some(bounded) = &report.bounded {
        line.extend(["\n", &figures::bound(bounded)]);
    }
    if let Some(deviation) = &report.deviation {
        line.extend(["\n", &figures::deviation(deviation)]);
    }
    if to_stdout || args.run.machine.quiet {
        session.display.say(&line);
        return Ok(());
    }
    print(&format!("{line}\n"))
}

/// Writes to standard output, where results go. That nobody reads them any more does not make the
/// work undone.
pub(super) fn print(text: &str) -> Result<()> {
    match io::stdout().write_all(text.as_bytes()) {
        Err(source) if source.kind() != io::ErrorKind::BrokenPipe => {
            Err(Error::Io { verb: "write", path: "-".into(), source })
        }
        _ => Ok(()),
    }
}

/// Refuses a report that would replace an input or the output, or that cannot be written.
pub(super) fn check_report(run: &Run, inputs: &[PathBuf], output: &Path) -> Result<()> {
    let Some(report) = &run.report else { return Ok(()) };
    let is_report =
        |path: &Path| path == report || place(path).is_some_and(|at| place(report) == Some(at));
    if !is_stream(report) && inputs.iter().map(PathBuf::as_path).chain([output]).any(is_report) {
        let text = format!("{} is a mesh of this job and cannot be the report", report.display());
        return Err(Error::Request(text));
    }
    check_output(report)
}

/// Where a file is, or would be, by whatever name.
fn place(path: &Path) -> Option<PathBuf> {
    let folder = path.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."));
    path.canonicalize().ok().or_else(|| Some(folder.canonicalize().ok()?.join(path.file_name()?)))
}

fn write_report(report: &Report, path: &Path) -> Result<()> {
    let mut file = OutputFile::create(path, Overwrite::Replace)?;
    let json = serde_json::to_string_pretty(report).map_err(io::Error::from);
    let written = json.and_then(|json| writeln!(file, "{json}"));
    written.map_err(|source| Error::Io { verb: "write", path: path.to_owned(), source })?;
    file.finish().map(drop)
}

/// `meshmill generate`.
pub(super) fn generate(args: &Generate, host: &Host) -> ExitCode {
    in_session(&args.run.machine, |session| {
        let started = Instant::now();
        check_report(&args.run, &[], &args.output.path)?;
        let Destination { target, format, compression } = job::destination(&args.output, host)?;
        let indexed =
            matches!(format, meshmill::formats::Format::Ply | meshmill::formats::Format::Obj);
        let config = generate::Config {
            kind: match args.kind {
                Kind::Gyroid => generate::Kind::Gyroid,
                Kind::Sphere => generate::Kind::Sphere,
                Kind::HeightField => generate::Kind::HeightField,
            },
            triangles: args.triangles,
            noise: args.noise,
            seed: args.seed,
            layout: if indexed { generate::Layout::Indexed } else { generate::Layout::Soup },
        };
        target.check()?;
        let write = WriteOptions { precision: Precision::Single, origin: [0.0; 3], colors: false };
        let export = export::Config { target, format, compression, write };
        let folder = args.output.path.parent().filter(|folder| *folder != Path::new(""));
        let workspace = Workspace::create(&job::temp_dir(&args.run.machine, folder, host))?;
        let threads =
            rayon::ThreadPoolBuilder::new().num_threads(job::threads(&args.run.machine, host));
        let threads = threads.build().map_err(|error| Error::Request(error.to_string()))?;
        let monitor = session.monitor();
        let (made, bytes) = threads.install(|| make(&config, &export, &workspace, &monitor))?;
        let vertices = indexed.then_some(made.vertices);
        let mut report = Report {
            output: OutputReport { triangles: made.triangles, vertices, bytes },
            temporary_bytes_peak: workspace.disk_bytes_peak(),
            seconds: started.elapsed().as_secs_f64(),
            ..Report::default()
        };
        complete_report(&mut report, None, &args.run, session)?;
        let counts = figures::count(made.triangles);
        let line = format!("{}: {counts} triangles", args.output.path.display());
        session.display.say(&line);
        Ok(outcome::DONE)
    })
}

/// Generates into the output; returns what was made and its size. Formats with both counts in front need them first.
fn make(
    config: &generate::Config,
    export: &export::Config,
    workspace: &Workspace,
    monitor: &Monitor,
) -> Result<(Counts, u64)> {
    let known = config.layout == generate::Layout::Indexed;
    let counts = if known { Some(generate::count(config, monitor)?) } else { None };
    let (made, size_bytes) = export::export_batches(counts, export, workspace, |send| {
        generate::generate(config, monitor, send)
    })?;
    Ok((made.counts, size_bytes))
}
