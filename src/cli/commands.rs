//! The commands, from what was typed to the exit code.

use std::{
    fs, io,
    io::Write as _,
    path::Path,
    process::ExitCode,
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    },
};

use meshmill::{
    Error, Result,
    formats::{Counts, Precision, WriteOptions},
    pipeline::{self, Job, Report, StageReport, Task},
    progress::{Cancel, Monitor},
    stages::{
        convert::export::{self, Target},
        generate,
    },
    storage::{OutputFile, Overwrite, Workspace},
};
use signal_hook::consts::{SIGINT, SIGTERM};

use super::{
    args::{Convert, Generate, Kind, Machine, Simplify},
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

/// Plans and runs a job; `None` after a dry run.
fn run_job(job: Job, args: &Convert, session: &Session) -> Result<Option<Report>> {
    let to_stdout = job.target == Target::Stdout;
    let prepared = pipeline::prepare(job)?;
    if args.dry_run {
        return print(&prepared.plan.to_string()).map(|()| None);
    }
    if args.run.verbose {
        session.display.say(prepared.plan.to_string().trim_end());
    } else {
        for note in &prepared.plan.notes {
            session.display.say(&format!("note: {note}"));
        }
    }
    let mut report = prepared.run(&session.monitor())?;
    report.peak_memory_bytes = host::peak_memory_bytes().unwrap_or_default();
    report.stages = session
        .display
        .stages()
        .into_iter()
        .map(|stage| StageReport {
            name: stage.name.to_owned(),
            seconds: stage.seconds,
            records: stage.records,
        })
        .collect();
    if let Some(path) = &args.run.report {
        write_report(&report, path)?;
    }
    tell(&report, args, to_stdout, session)?;
    Ok(Some(report))
}

/// Tells the person what came of it.
fn tell(report: &Report, args: &Convert, to_stdout: bool, session: &Session) -> Result<()> {
    for defect in &report.defects {
        let place = if defect.first.is_empty() {
            String::new()
        } else {
            format!(", first at {}", defect.first)
        };
        let (kind, count) = (defect.kind.replace('_', " "), figures::count(defect.count));
        session.display.say(&format!("defect: {kind}: {count}{place}"));
    }
    if !report.dropped.is_empty() {
        session.display.say(&format!("not carried: {}", report.dropped.join(", ")));
    }
    if report.reached_target == Some(false) {
        session.display.say("the wanted count was not met within 25 %: no grid comes nearer");
    }
    let line = format!(
        "{}: {} triangles of {} in {:.1} s, {} of memory",
        args.output.path.display(),
        figures::count(report.output.triangles),
        figures::count(report.input.triangles),
        report.seconds,
        bytesize::ByteSize(report.peak_memory_bytes),
    );
    if to_stdout || args.run.machine.quiet {
        session.display.say(&line);
        return Ok(());
    }
    print(&format!("{line}\n"))
}

/// Writes to standard output, where results go.
pub(super) fn print(text: &str) -> Result<()> {
    let written = io::stdout().write_all(text.as_bytes());
    written.map_err(|source| Error::Io { verb: "write", path: "-".into(), source })
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
        if let Target::File(path, Overwrite::Refuse) = &target
            && fs::exists(path).unwrap_or(false)
        {
            return Err(Error::Request(format!("{} exists", path.display())));
        }
        let write = WriteOptions { precision: Precision::Single, origin: [0.0; 3], colors: false };
        let export = export::Config { target, format, compression, write };
        let folder = args.output.path.parent().filter(|folder| *folder != Path::new(""));
        let workspace = Workspace::create(&job::temp_dir(&args.run.machine, folder, host))?;
        let threads =
            rayon::ThreadPoolBuilder::new().num_threads(job::threads(&args.run.machine, host));
        let threads = threads.build().map_err(|error| Error::Request(error.to_string()))?;
        let monitor = session.monitor();
        let made = threads.install(|| make(&config, &export, &workspace, &monitor))?;
        let counts = figures::count(made.triangles);
        let line = format!("{}: {counts} triangles", args.output.path.display());
        session.display.say(&line);
        Ok(outcome::DONE)
    })
}

/// Generates into the output. Formats with both counts in front need them first.
fn make(
    config: &generate::Config,
    export: &export::Config,
    workspace: &Workspace,
    monitor: &Monitor,
) -> Result<Counts> {
    let known = config.layout == generate::Layout::Indexed;
    let counts = if known { Some(generate::count(config, monitor)?) } else { None };
    let (made, _) = export::export_batches(counts, export, workspace, |send| {
        generate::generate(config, monitor, send)
    })?;
    Ok(made.counts)
}
