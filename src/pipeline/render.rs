//! A picture of a mesh: the inputs read as for any job, and drawn instead of written.

use std::{
    io::{self, Write as _},
    path::{Path, PathBuf},
};

use super::{
    DefectReport, Job, Task, prepare,
    run::{Run, check_target},
};
use crate::{
    error::{Error, IoContext as _, Result},
    formats::{Compression, Format, OnDefect},
    progress::Monitor,
    soup::{ColoredPoint, InputPath, OpenInput, Point, Vertex},
    stages::{
        convert::{
            export::Target,
            import::{self, Need},
        },
        inspect::render::{self as stage, Picture},
    },
    storage::OutputFile,
};

/// What to draw, how, and with what.
#[derive(Clone, Debug)]
pub struct Render {
    /// The inputs: one mesh, in this order.
    pub inputs: Vec<InputPath>,
    /// Format of all inputs; recognised when `None`.
    pub input_format: Option<Format>,
    /// Policy for bad records.
    pub on_defect: OnDefect,
    /// Where the picture goes, as PNG.
    pub target: Target,
    /// What it shows.
    pub config: stage::Config,
    /// Whether the colours of vertices are shown.
    pub colors: Colors,
    /// Memory to keep to, in bytes, beside a constant of at most 64 MiB.
    pub memory_bytes: u64,
    /// Threads to work with, at least 1.
    pub threads: usize,
    /// Folder for the workspace, which is used for soups that can be read only once, and when the
    /// vertices do not fit in memory.
    pub temp_dir: PathBuf,
}

/// What becomes of vertex colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Colors {
    /// They are shown where there are any.
    Shown,
    /// Surfaces are plain.
    Ignored,
}

/// What was drawn.
#[derive(Clone, Debug)]
pub struct RenderReport {
    /// Triangles, polygons taken apart.
    pub triangles: u64,
    /// Bytes of the picture, as PNG; 0 on standard output.
    pub bytes: u64,
    /// By kind.
    pub defects: Vec<DefectReport>,
}

/// Draws a picture of the inputs: a pass over them, and one before it over soups.
///
/// # Errors
/// [`Error::Input`] when an input is not what it says or has no faces, [`Error::Resource`] when the
/// picture does not fit the memory, [`Error::Io`] and [`Error::Request`] as
/// [`prepare`](super::prepare), cancellation. Nothing is left under the output's name then.
pub fn render(render: &Render, monitor: &Monitor) -> Result<RenderReport> {
    check_size(&render.config)?;
    check_target(&render.inputs, &render.target)?;
    let Render { config, colors, target, .. } = render;
    let prepared = prepare(reading(render))?;
    let outcome = prepared.with_room(monitor, |run, inputs| {
        if run.colored && *colors == Colors::Shown {
            draw::<ColoredPoint>(run, inputs, config)
        } else {
            draw::<Point>(run, inputs, config)
        }
    })?;
    let bytes = write(&outcome.picture, target)?;
    let mut report = super::Report::default();
    report.add_findings(&outcome.findings);
    Ok(RenderReport { triangles: outcome.triangles, bytes, defects: report.defects })
}

/// Refuses pictures that cannot be made in any memory.
pub(super) fn check_size(config: &stage::Config) -> Result<()> {
    let stage::Config { size, samples, .. } = *config;
    let side_max = stage::SIDE_SAMPLES_MAX / samples;
    if size.width.max(size.height) <= side_max {
        return Ok(());
    }
    let text = format!(
        "a picture of {}x{} is too large: with {samples}x{samples} samples a pixel, at most \
         {side_max} pixels along a side",
        size.width, size.height
    );
    Err(Error::Request(text))
}

/// The job that reads the same in the same way. A soup is its task since that, too, needs the
/// triangles as they come; it is never written.
fn reading(render: &Render) -> Job {
    Job {
        task: Task::Soup,
        inputs: render.inputs.clone(),
        input_format: render.input_format,
        on_defect: render.on_defect,
        target: Target::Stdout,
        output_format: Format::Soup,
        compression: Compression::None,
        memory_bytes: render.memory_bytes,
        threads: render.threads,
        temp_dir: render.temp_dir.clone(),
        progressive: None,
        keeping: None,
    }
}

fn draw<V: Vertex>(
    run: &Run,
    inputs: Vec<OpenInput>,
    config: &stage::Config,
) -> Result<stage::Outcome> {
    let budget = run.workspace.budget();
    let needed_bytes = stage::memory_bytes(config.size, config.samples);
    let Some(_picture) = budget.reserve(needed_bytes) else {
        let available_bytes = budget.available_bytes();
        return Err(Error::Resource { what: "the picture", needed_bytes, available_bytes });
    };
    let once = |open: &OpenInput| !open.reader.declared().indexed && !open.input.is_repeatable();
    // What can be read only once and is needed twice is set aside by a survey only.
    let need = if inputs.iter().any(once) { Need::Survey } else { Need::Triangles };
    let import::Outcome { source, .. } = run.import::<V>(inputs, need)?;
    stage::render(&source, config, budget, run.monitor)
}

/// Writes a picture to where it is wanted; returns its size, 0 for a stream.
pub(super) fn write(picture: &Picture, target: &Target) -> Result<u64> {
    let mut bytes = Vec::new();
    let path = target.path();
    picture.write_png(&mut bytes).at("encode", path)?;
    match target {
        Target::File(path, overwrite) => {
            let mut file = OutputFile::create(path, *overwrite)?;
            file.write_all(&bytes).at("write", path)?;
            file.finish()
        }
        Target::Stdout => {
            let mut stdout = io::stdout().lock();
            stdout.write_all(&bytes).and_then(|()| stdout.flush()).at("write", Path::new("-"))?;
            Ok(0)
        }
    }
}
