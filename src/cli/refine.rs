//! `refine`: a progressive mesh as a mesh of any count or error.

use std::{
    path::{Path, PathBuf},
    process::ExitCode,
};

use clap::Args;
use meshmill::{
    Result,
    pipeline::{self, MaxError, RefineDetail, Report},
    stages::convert::export::Target,
};

use super::{
    args::{Output, Run},
    commands::{Session, check_report, complete_report, in_session, print},
    figures,
    job::{self, Destination, Host},
    outcome, values,
};

/// A progressive mesh (.pm), whole or cut, to a mesh of any count or error; as far as it goes where
/// nothing is said.
#[derive(Debug, Args)]
pub(super) struct Refine {
    /// The progressive mesh; `-` is standard input
    #[arg(value_name = "IN")]
    input: PathBuf,

    #[command(flatten)]
    output: Output,

    #[command(flatten)]
    detail: Detail,

    #[command(flatten)]
    run: Run,
}

/// How far to refine: one of them, or all there is.
#[derive(Debug, Args)]
#[group(multiple = false)]
struct Detail {
    /// Triangles wanted: 500k, 2M; met exactly, or one fewer where only two at a time can come
    #[arg(short, long, value_name = "N", value_parser = values::count)]
    target_faces: Option<u64>,

    /// Share of the triangles of the finest mesh: 0.01 or 1%
    #[arg(long, value_name = "R", value_parser = values::ratio)]
    ratio: Option<f64>,

    /// Until the file states that the finest mesh is nowhere farther away: 0.2 in model units, or 0.05%
    /// of the diagonal of the coarsest mesh
    #[arg(long, value_name = "E", value_parser = values::max_error)]
    max_error: Option<MaxError>,
}

/// `meshmill refine`.
pub(super) fn refine(args: &Refine, host: &Host) -> ExitCode {
    in_session(&args.run.machine, |session| {
        check_report(&args.run, std::slice::from_ref(&args.input), &args.output.path)?;
        let mut report = pipeline::refine(&meaning(args, host)?, &session.monitor())?;
        complete_report(&mut report, None, &args.run, session)?;
        tell(&report, args, session)?;
        Ok(outcome::DONE)
    })
}

fn meaning(args: &Refine, host: &Host) -> Result<pipeline::Refine> {
    let Destination { target, format, compression } = job::destination(&args.output, host)?;
    let detail = match (args.detail.target_faces, args.detail.ratio, args.detail.max_error) {
        (Some(count), ..) => RefineDetail::Triangles(count),
        (_, Some(ratio), _) => RefineDetail::Ratio(ratio),
        (.., Some(error)) => RefineDetail::MaxError(error),
        (None, None, None) => RefineDetail::All,
    };
    let folder = match &target {
        Target::File(path, _) => path.parent().filter(|folder| *folder != Path::new("")),
        Target::Stdout => None,
    };
    Ok(pipeline::Refine {
        input: job::input_path(&args.input),
        detail,
        output_format: format,
        compression,
        memory_bytes: job::memory_bytes(&args.run.machine, host),
        threads: job::threads(&args.run.machine, host),
        temp_dir: job::temp_dir(&args.run.machine, folder, host),
        target,
    })
}

/// Tells the person what came of it.
fn tell(report: &Report, args: &Refine, session: &Session) -> Result<()> {
    let Some(refined) = &report.refine else { return Ok(()) };
    if refined.is_cut {
        let (used, all) = (figures::count(refined.batches_used), figures::count(refined.batches));
        session.display.say(&format!(
            "warning: {} is cut: {used} of {all} batches are there, and all of them were used",
            args.input.display()
        ));
    } else if report.reached_target == Some(false) {
        session.display.say("the file has nothing nearer to what was asked for");
    }
    let line = format!(
        "{}: {} triangles of {} in {:.1} s; the finest is at most {} away, rms {}",
        args.output.path.display(),
        figures::count(report.output.triangles),
        figures::count(report.input.triangles),
        report.seconds,
        figures::length(refined.max_at_most),
        figures::length(refined.rms_at_most),
    );
    if args.output.path == Path::new("-") || args.run.machine.quiet {
        session.display.say(&line);
        return Ok(());
    }
    print(&format!("{line}\n"))
}
