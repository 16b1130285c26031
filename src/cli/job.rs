//! What was typed, and what it means on this machine: pure, and tested flag by flag.

use std::{
    path::{Path, PathBuf},
    time::Duration,
};

use meshmill::{
    Error, Result,
    formats::{self, Compression, Format},
    geometry,
    pipeline::{self, End, Job, Keeping, Start, Task},
    soup::{InputPath, SweepAxis},
    stages::convert::export::Target,
    storage::Overwrite,
};

use super::args::{
    Axis, Compare, Convert, Goal, Info, Inputs, Machine, Method, Metric, OnDefect, Output,
    Placement, Selection, Simplify, Sort, SortedAxis,
};

/// What the machine offers.
#[derive(Clone, Debug)]
pub(super) struct Host {
    /// Memory that could be used now.
    pub(super) memory_bytes_available: u64,
    /// Processors.
    pub(super) threads: usize,
    /// `$TMPDIR`.
    pub(super) temp_dir: Option<PathBuf>,
    /// Standard output is a terminal.
    pub(super) stdout_is_terminal: bool,
}

/// Where results go, with what they look like.
pub(super) struct Destination {
    pub(super) target: Target,
    pub(super) format: Format,
    pub(super) compression: Compression,
}

/// The job of `simplify`.
pub(super) fn simplify(args: &Simplify, host: &Host) -> Result<Job> {
    let placement = match args.placement {
        Placement::Constrained => geometry::Placement::Constrained,
        Placement::Clamped => geometry::Placement::Clamped,
        Placement::Free => geometry::Placement::Free,
    };
    let method = match args.method {
        Method::Auto => pipeline::Method::Auto,
        Method::Stream => pipeline::Method::Stream,
        Method::Cluster => pipeline::Method::Cluster,
        Method::Hybrid => pipeline::Method::Hybrid,
        Method::Bounded => pipeline::Method::Bounded,
    };
    let metric = match args.metric {
        Metric::Quadric => pipeline::Metric::Quadric,
        Metric::Volume => pipeline::Metric::Volume,
    };
    let simplify = pipeline::Simplify {
        goal: goal(&args.goal),
        method,
        metric,
        selection: selection(args),
        choices: args.choosing.choices,
        seed: args.choosing.seed,
        assume_sorted: args.choosing.assume_sorted.map(|axis| match axis {
            SortedAxis::X => SweepAxis::X,
            SortedAxis::Y => SweepAxis::Y,
            SortedAxis::Z => SweepAxis::Z,
        }),
        boundary_weight: args.boundary_weight,
        placement,
        measure: args.measure.then_some(args.samples),
        keep: args.keep.meaning(args.goal.max_error),
    };
    convert(&args.convert, Task::Simplify(simplify), host)
}

/// How edges are chosen. A stream may be endless, and only a window holds it in any memory.
fn selection(args: &Simplify) -> pipeline::Selection {
    let is_bounded = args.goal.max_error.is_some() || args.method == Method::Bounded;
    let promised = args.choosing.assume_sorted.filter(|_| !is_bounded);
    match (args.choosing.selection, promised) {
        (Some(Selection::Threshold), _) | (None, None) => pipeline::Selection::Threshold,
        (Some(Selection::MultipleChoice), _) | (None, Some(_)) => {
            pipeline::Selection::MultipleChoice
        }
    }
}

/// The job of `sort`.
pub(super) fn sort(args: &Sort, host: &Host) -> Result<Job> {
    let axis = match args.axis {
        Axis::Longest => None,
        Axis::X => Some(SweepAxis::X),
        Axis::Y => Some(SweepAxis::Y),
        Axis::Z => Some(SweepAxis::Z),
    };
    convert(&args.convert, Task::Sort(pipeline::Sort { axis }), host)
}

fn goal(args: &Goal) -> pipeline::Goal {
    match (args.ratio, args.target_faces, args.cells, args.cell_size) {
        (Some(ratio), ..) => pipeline::Goal::Ratio(ratio),
        (_, Some(count), ..) => pipeline::Goal::Triangles(count),
        (_, _, Some(cells), _) => pipeline::Goal::Cells(cells),
        (.., Some(size)) => pipeline::Goal::CellSize(size),
        (None, None, None, None) => pipeline::Goal::Tolerance,
    }
}

/// The job of `soup` and `weld`, and the frame of `simplify`.
pub(super) fn convert(args: &Convert, task: Task, host: &Host) -> Result<Job> {
    let Destination { target, format, compression } = destination(&args.output, host)?;
    let folder = match &target {
        Target::File(path, _) => path.parent().filter(|folder| *folder != Path::new("")),
        Target::Stdout => None,
    };
    Ok(Job {
        task,
        inputs: input_paths(&args.inputs),
        input_format: args.inputs.input_format,
        on_defect: on_defect(args.inputs.on_defect),
        output_format: format,
        compression,
        memory_bytes: memory_bytes(&args.run.machine, host),
        threads: threads(&args.run.machine, host),
        temp_dir: temp_dir(&args.run.machine, folder, host),
        target,
        progressive: None,
        keeping: Some(keeping(args)),
    })
}

/// What the job begins with and what it leaves.
fn keeping(args: &Convert) -> Keeping {
    Keeping {
        // A dry run does not even tidy up.
        start: if args.resume && !args.dry_run { Start::Resume } else { Start::Anew },
        end: if args.keep_temp { End::Keep } else { End::Remove },
        interval: Duration::from_secs(args.checkpoint_seconds.into()),
    }
}

/// Folder for temporary files where there is no output. Unlike `/tmp` it is on a disk.
const TEMP_DIR_WITHOUT_OUTPUT: &str = "/var/tmp";

/// What `info` looks at.
pub(super) fn info(args: &Info, host: &Host) -> pipeline::Info {
    let detail = if args.topology { pipeline::Detail::Topology } else { pipeline::Detail::OnePass };
    pipeline::Info {
        detail,
        inputs: input_paths(&args.inputs),
        input_format: args.inputs.input_format,
        on_defect: on_defect(args.inputs.on_defect),
        memory_bytes: memory_bytes(&args.machine, host),
        threads: threads(&args.machine, host),
        temp_dir: temp_dir(&args.machine, Some(Path::new(TEMP_DIR_WITHOUT_OUTPUT)), host),
    }
}

/// What `compare` compares.
pub(super) fn compare(args: &Compare, host: &Host) -> Result<pipeline::Compare> {
    let mesh = |path: &PathBuf| pipeline::CompareInput {
        paths: vec![input_path(path)],
        format: args.input_format,
    };
    Ok(pipeline::Compare {
        a: mesh(&args.a),
        b: mesh(&args.b),
        on_defect: on_defect(args.on_defect),
        samples: args.samples,
        seed: args.seed,
        picture: args.picture.meaning()?,
        memory_bytes: memory_bytes(&args.machine, host),
        threads: threads(&args.machine, host),
        temp_dir: temp_dir(&args.machine, Some(Path::new(TEMP_DIR_WITHOUT_OUTPUT)), host),
    })
}

/// Where `output` is and in which format.
pub(super) fn destination(output: &Output, host: &Host) -> Result<Destination> {
    let path = &output.path;
    let overwrite = if output.force { Overwrite::Replace } else { Overwrite::Refuse };
    let is_stream = path == Path::new("-");
    if is_stream && host.stdout_is_terminal {
        let text = "a mesh is not written to a terminal; redirect standard output";
        return Err(Error::Request(text.to_owned()));
    }
    let format = output.format.or_else(|| Format::from_path(path)).ok_or_else(|| {
        let name = if is_stream { "standard output".into() } else { path.display().to_string() };
        Error::Request(format!("the format of {name} is not clear; say --output-format"))
    })?;
    let target = if is_stream { Target::Stdout } else { Target::File(path.clone(), overwrite) };
    Ok(Destination { target, format, compression: Compression::from_path(path) })
}

/// The inputs of any command.
pub(super) fn input_paths(args: &Inputs) -> Vec<InputPath> {
    args.paths.iter().map(|path| input_path(path)).collect()
}

pub(super) fn input_path(path: &Path) -> InputPath {
    if path == Path::new("-") { InputPath::Stdin } else { InputPath::File(path.to_owned()) }
}

/// Policy for bad records.
pub(super) fn on_defect(typed: OnDefect) -> formats::OnDefect {
    match typed {
        OnDefect::Fail => formats::OnDefect::Fail,
        OnDefect::Skip => formats::OnDefect::Skip,
    }
}

/// Memory to keep to.
pub(super) fn memory_bytes(args: &Machine, host: &Host) -> u64 {
    args.memory.unwrap_or(host.memory_bytes_available / 2)
}

/// Threads to work with.
pub(super) fn threads(args: &Machine, host: &Host) -> usize {
    args.threads.map_or(host.threads, usize::from)
}

/// Folder for temporary files: where there is most likely room, beside the output.
pub(super) fn temp_dir(args: &Machine, output_folder: Option<&Path>, host: &Host) -> PathBuf {
    let chosen = args.temp_dir.clone().or_else(|| host.temp_dir.clone());
    chosen.unwrap_or_else(|| output_folder.unwrap_or(Path::new(".")).to_owned())
}

#[cfg(test)]
mod tests {
    use clap::Parser as _;

    use super::*;
    use crate::cli::args::{Cli, Command};

    fn host() -> Host {
        Host {
            memory_bytes_available: 8 << 30,
            threads: 6,
            temp_dir: None,
            stdout_is_terminal: false,
        }
    }

    fn job(line: &str) -> Result<Job> {
        let words = std::iter::once("meshmill").chain(line.split(' '));
        match Cli::try_parse_from(words).expect("the line parses").command {
            Command::Simplify(args) => simplify(&args, &host()),
            Command::Soup(args) => convert(&args, Task::Soup, &host()),
            Command::Sort(args) => sort(&args, &host()),
            other => panic!("{other:?} is no job"),
        }
    }

    #[test]
    fn defaults_come_from_the_machine() {
        let job = job("soup a.ply -o out/b.stl").unwrap();
        assert_eq!((job.memory_bytes, job.threads), (4 << 30, 6));
        assert_eq!(job.temp_dir, Path::new("out"));
        assert_eq!(job.output_format, Format::Stl);
        assert_eq!(job.target, Target::File("out/b.stl".into(), Overwrite::Refuse));
        assert_eq!(job.inputs, [InputPath::File("a.ply".into())]);
    }

    #[test]
    fn every_goal_is_understood() {
        let goal = |line: &str| match job(line).unwrap().task {
            Task::Simplify(simplify) => simplify.goal,
            other => panic!("{other:?}"),
        };
        assert_eq!(goal("simplify a -o b.ply --ratio 1%"), pipeline::Goal::Ratio(0.01));
        assert_eq!(goal("simplify a -o b.ply -t 100k"), pipeline::Goal::Triangles(100_000));
        assert_eq!(goal("simplify a -o b.ply --cells 64"), pipeline::Goal::Cells(64));
        assert_eq!(goal("simplify a -o b.ply --cell-size .5"), pipeline::Goal::CellSize(0.5));
    }

    #[test]
    fn a_promise_of_order_means_multiple_choice() {
        let simplify = |flags: &str| {
            let line = format!("simplify a -o b.ply --ratio 1%{flags}");
            job(&line).map(|job| match job.task {
                Task::Simplify(simplify) => simplify,
                other => panic!("{other:?}"),
            })
        };
        let plain = simplify("").unwrap();
        assert_eq!(plain.selection, pipeline::Selection::Threshold);
        assert_eq!((plain.choices, plain.seed, plain.assume_sorted), (8, 0, None));
        let chosen = simplify(" --selection multiple-choice --choices 12 --seed 7").unwrap();
        assert_eq!(chosen.selection, pipeline::Selection::MultipleChoice);
        assert_eq!((chosen.choices, chosen.seed), (12, 7));
        let promised = simplify(" --assume-sorted y").unwrap();
        assert!(promised.is_streaming());
        assert_eq!(promised.assume_sorted, Some(SweepAxis::Y));
        let both = simplify(" --assume-sorted y --selection threshold").unwrap();
        assert!(!both.is_streaming() && both.assume_sorted.is_some());
    }

    #[test]
    fn every_axis_is_understood() {
        let axis = |line: &str| match job(line).unwrap().task {
            Task::Sort(sort) => sort.axis,
            other => panic!("{other:?}"),
        };
        assert_eq!(axis("sort a -o b.stl"), None);
        assert_eq!(axis("sort a -o b.stl --axis longest"), None);
        assert_eq!(axis("sort a -o b.stl --axis x"), Some(SweepAxis::X));
        assert_eq!(axis("sort a -o b.soup --axis z"), Some(SweepAxis::Z));
    }

    #[test]
    fn a_goal_is_one_of_them() {
        for line in ["simplify a -o b.ply", "simplify a -o b.ply -t 5 --cells 9"] {
            let words = std::iter::once("meshmill").chain(line.split(' '));
            assert!(Cli::try_parse_from(words).is_err(), "{line}");
        }
    }

    #[test]
    fn flags_of_running_are_taken_over() {
        let job = job(
            "soup - -o - --output-format soup --memory 64MiB -j 2 --temp-dir t --on-defect skip",
        )
        .unwrap();
        assert_eq!((job.memory_bytes, job.threads), (64 << 20, 2));
        assert_eq!((job.temp_dir.as_path(), job.target), (Path::new("t"), Target::Stdout));
        assert_eq!(job.on_defect, formats::OnDefect::Skip);
        assert_eq!(job.inputs, [InputPath::Stdin]);
    }

    #[test]
    fn compression_is_looked_through_and_an_unknown_name_refused() {
        let job = job("soup a.ply -o b.stl.zst --force").unwrap();
        assert_eq!((job.output_format, job.compression), (Format::Stl, Compression::Zstd));
        assert!(super::tests::job("soup a.ply -o b.xyz").is_err());
    }

    #[test]
    fn info_takes_inputs_and_its_share_of_the_machine() {
        let info = |line: &str| match Cli::try_parse_from(line.split(' ')).unwrap().command {
            Command::Info(args) => (args.json, super::info(&args, &host())),
            other => panic!("{other:?}"),
        };
        let (json, plain) = info("meshmill info a.ply b.ply");
        assert_eq!(plain.detail, pipeline::Detail::OnePass);
        assert_eq!(
            (json, plain.inputs.len(), plain.on_defect),
            (false, 2, formats::OnDefect::Fail)
        );
        assert_eq!((plain.memory_bytes, plain.threads), (4 << 30, 6));
        assert_eq!(plain.temp_dir, Path::new("/var/tmp"));
        let line = "meshmill info - --json --input-format stl --on-defect skip --memory 64MiB -j 1 \
             --temp-dir t";
        let (json, other) = info(line);
        assert_eq!(info("meshmill info a.ply --topology").1.detail, pipeline::Detail::Topology);
        assert_eq!((json, other.input_format), (true, Some(Format::Stl)));
        assert_eq!((other.on_defect, other.memory_bytes), (formats::OnDefect::Skip, 64 << 20));
        assert_eq!((other.temp_dir.as_path(), other.threads), (Path::new("t"), 1));
    }
}
