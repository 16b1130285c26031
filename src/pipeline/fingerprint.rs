//! What the result of a job depends on, to be compared with the job that left a workspace: the
//! inputs by size, time and a look at both ends, and every option that decides bytes.

use std::{
    fs::File,
    os::unix::fs::{FileExt as _, MetadataExt as _},
    path::{Path, PathBuf},
};

use super::{Goal, Job, Simplify, Sort, Task};
use crate::{
    error::{IoContext as _, Result},
    formats::{Format, OnDefect},
    soup::InputPath,
    stages::convert::export::Target,
    storage::{Fingerprint, is_stream},
};

/// Bytes that are looked at, at either end of an input.
const END_BYTES: u64 = 1 << 16;

/// Everything the result of `job` depends on. The memory is left out where it decides nothing.
pub(super) fn fingerprint(job: &Job) -> Result<Fingerprint> {
    let mut print = Fingerprint::new();
    let Job { task, inputs, input_format, on_defect, target, output_format, compression, .. } = job;
    let mut set = |name: &str, value: String| drop(print.insert(name.to_owned(), value));
    match task {
        Task::Simplify(simplify) => {
            set("command", "simplify".to_owned());
            set_simplify(simplify, &mut set);
            if simplify.is_streaming() {
                // The window is as large as fits.
                set("memory", job.memory_bytes.to_string());
            }
        }
        Task::Soup => set("command", "soup".to_owned()),
        Task::Sort(Sort { axis }) => {
            set("command", "sort".to_owned());
            set("axis", axis.map_or("longest", |axis| axis.name()).to_owned());
        }
        Task::Weld => set("command", "weld".to_owned()),
    }
    if let Some(progressive) = &job.progressive {
        set("progressive", format!("{progressive:?}"));
    }
    set("input format", input_format.map_or("recognised", Format::name).to_owned());
    set("on defect", if *on_defect == OnDefect::Fail { "fail" } else { "skip" }.to_owned());
    set("output", name_of(target));
    set("output format", output_format.name().to_owned());
    set("compression", format!("{compression:?}"));
    let names: Vec<String> = inputs.iter().map(|input| absolute(input.as_path())).collect();
    set("inputs", names.join(" "));
    for input in inputs {
        set_input(input, &mut set)?;
    }
    Ok(print)
}

fn set_simplify(simplify: &Simplify, set: &mut impl FnMut(&str, String)) {
    // All of it by name, so that whoever adds a field comes by here.
    let Simplify {
        goal,
        method,
        metric,
        selection,
        choices,
        seed,
        assume_sorted,
        boundary_weight,
        placement,
        keep,
        measure: _,
    } = simplify;
    let (name, value) = match goal {
        Goal::Triangles(count) => ("target faces", count.to_string()),
        Goal::Ratio(ratio) => ("ratio", format!("{ratio:?}")),
        Goal::Cells(cells) => ("cells", cells.to_string()),
        Goal::CellSize(size) => ("cell size", format!("{size:?}")),
        Goal::Tolerance => ("goal", "error bound".to_owned()),
    };
    set(name, value);
    set("method", method.name().to_owned());
    set("metric", metric.name().to_owned());
    set("selection", format!("{selection:?}"));
    set("choices", choices.to_string());
    set("seed", seed.to_string());
    set("assume sorted", assume_sorted.map_or("no", |axis| axis.name()).to_owned());
    set("boundary weight", format!("{boundary_weight:?}"));
    set("placement", format!("{placement:?}"));
    set("error bound", format!("{keep:?}"));
}

/// A file by its size, its time, and its ends; a stream has none of these.
fn set_input(input: &InputPath, set: &mut impl FnMut(&str, String)) -> Result<()> {
    let InputPath::File(path) = input else { return Ok(()) };
    if !path.is_file() {
        return Ok(());
    }
    let file = File::options().read(true).open(path).at("open", path)?;
    let found = file.metadata().at("examine", path)?;
    let size_bytes = found.len();
    let end = |offset: u64| -> Result<String> {
        let mut bytes = vec![0; END_BYTES.min(size_bytes) as usize];
        file.read_exact_at(&mut bytes, offset).at("read", path)?;
        Ok(format!("{:08x}", crc32fast::hash(&bytes)))
    };
    let mut set = |what: &str, value: String| set(&format!("{}: {what}", path.display()), value);
    set("size", size_bytes.to_string());
    set("time of change", format!("{}.{:09}", found.mtime(), found.mtime_nsec()));
    set("first bytes", end(0)?);
    set("last bytes", end(size_bytes.saturating_sub(END_BYTES))?);
    Ok(())
}

/// What the workspace of a job is called, so that it can be found: by its output, which no two jobs
/// can have. Streams take any number of results, and jobs that write there are told apart by all of
/// `print`.
pub(super) fn key(job: &Job, print: &Fingerprint) -> String {
    let text = if is_exclusive(job) { name_of(&job.target) } else { format!("{print:?}") };
    // FNV-1a: short, and the same in every version.
    let hash = text.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    });
    format!("{hash:016x}-")
}

/// Whether the output is a file, which only one run at a time can make.
pub(super) fn is_exclusive(job: &Job) -> bool {
    matches!(&job.target, Target::File(path, _) if !is_stream(path))
}

fn name_of(target: &Target) -> String {
    match target {
        Target::File(path, _) => absolute(path),
        Target::Stdout => "-".to_owned(),
    }
}

/// A path that means the same from anywhere; the file need not be there.
fn absolute(path: &Path) -> String {
    if path == Path::new("-") {
        return "-".to_owned();
    }
    let folder = path.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."));
    let in_folder = || Some(folder.canonicalize().ok()?.join(path.file_name()?));
    let found = path.canonicalize().ok().or_else(in_folder);
    found.unwrap_or_else(|| PathBuf::from(path)).display().to_string()
}
