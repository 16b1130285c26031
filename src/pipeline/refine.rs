//! `refine`: a progressive mesh, whole or cut, to a mesh of any count or error.

use std::{io, path::PathBuf, time::Instant};

use super::{
    InputReport, MaxError, OutputReport, RefineReport, Report,
    run::{Room, check_target, room},
};
use crate::{
    error::{Error, Result},
    formats::{
        Compression, Format, Precision, WriteOptions,
        progressive::{Channels, Header},
    },
    progress::Monitor,
    soup::{ColoredPoint, InputPath, Point, Vertex},
    stages::convert::{
        export::{self, Target},
        refine as stage,
    },
    storage::{Workspace, open_input},
};

/// What to refine, how far, and with what.
#[derive(Clone, Debug)]
pub struct Refine {
    /// The progressive mesh.
    pub input: InputPath,
    /// How far.
    pub detail: Detail,
    /// Where the result goes.
    pub target: Target,
    /// Format of the result.
    pub output_format: Format,
    /// Compression of the result.
    pub compression: Compression,
    /// Memory to keep to, in bytes, beside a constant of at most 64 MiB.
    pub memory_bytes: u64,
    /// Threads to work with, at least 1.
    pub threads: usize,
    /// Folder for the workspace.
    pub temp_dir: PathBuf,
}

/// How far to refine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Detail {
    /// As far as it goes.
    All,
    /// To this many triangles, or one fewer.
    Triangles(u64),
    /// To this share of the triangles of the finest mesh, above 0, at most 1.
    Ratio(f64),
    /// Until no more than this is stated as the largest distance from the finest mesh; a share is of
    /// the diagonal of the coarsest mesh.
    MaxError(MaxError),
}

/// Refines a progressive mesh and writes it.
///
/// # Errors
/// [`Error::Input`] when it is not what it says as far as it is read, or is cut in the base,
/// [`Error::Resource`] when the mesh does not fit the memory, [`Error::Request`], [`Error::Io`],
/// cancellation.
pub fn refine(refine: &Refine, monitor: &Monitor) -> Result<Report> {
    let started = Instant::now();
    let format = refine.output_format;
    if matches!(format, Format::Off | Format::Progressive) {
        return Err(Error::Request(format!("refine does not write {}", format.name())));
    }
    check_target(std::slice::from_ref(&refine.input), &refine.target)?;
    let workspace = Workspace::create(&refine.temp_dir)?;
    let Room { threads, workspace } = room(refine.threads, workspace, refine.memory_bytes)?;
    let done = threads.install(|| in_room(refine, &workspace, monitor));
    drop(workspace.to_be_removed());
    let report = done?;
    Ok(Report { seconds: started.elapsed().as_secs_f64(), ..report })
}

fn in_room(refine: &Refine, workspace: &Workspace, monitor: &Monitor) -> Result<Report> {
    let (input, budget) = (&refine.input, workspace.budget());
    let stream: Box<dyn io::Read + Send> = match input {
        InputPath::Stdin => Box::new(io::stdin()),
        InputPath::File(path) => Box::new(open_input(path)?),
    };
    let detail = match refine.detail {
        Detail::All => stage::Detail::All,
        Detail::Triangles(count) => stage::Detail::Triangles(count),
        Detail::MaxError(MaxError::Length(length)) => stage::Detail::Length(length),
        Detail::MaxError(MaxError::Share(share)) => stage::Detail::Share(share),
        Detail::Ratio(ratio) => stage::Detail::Ratio(ratio),
    };
    let outcome = stage::refine(stream, input, detail, budget, monitor)?;
    if outcome.header.channels == Channels::None {
        write::<Point>(&outcome, refine, workspace, monitor)
    } else {
        write::<ColoredPoint>(&outcome, refine, workspace, monitor)
    }
}

fn write<V: Vertex>(
    outcome: &stage::Outcome,
    refine: &Refine,
    workspace: &Workspace,
    monitor: &Monitor,
) -> Result<Report> {
    let header = &outcome.header;
    let options =
        WriteOptions { precision: precision(header), origin: header.origin, colors: V::COLORED };
    let config = export::Config {
        target: refine.target.clone(),
        format: refine.output_format,
        compression: refine.compression,
        write: options,
    };
    let mesh = outcome.indexed::<V>();
    let written = export::export_mesh(&mesh, &config, workspace, monitor)?;
    Ok(Report {
        input: InputReport {
            triangles: header.faces.into(),
            vertices: Some(header.vertices.into()),
            bounds: None,
        },
        output: OutputReport {
            triangles: written.counts.triangles,
            vertices: refine.output_format.is_indexed().then_some(written.counts.vertices),
            bytes: written.size_bytes,
        },
        reached_target: Some(outcome.is_met),
        refine: Some(RefineReport {
            batches: header.batches.into(),
            batches_used: outcome.batches.into(),
            is_cut: outcome.is_cut,
            rms_at_most: outcome.deviation.rms.into(),
            max_at_most: outcome.deviation.max.into(),
            step: header.step,
        }),
        ..Report::default()
    })
}

/// Double where single precision would move positions by more than a small part of a step.
fn precision(header: &Header) -> Precision {
    let size = header.step * f64::from(1_u32 << header.bits);
    let far = header.origin.iter().fold(0.0_f64, |far, c| far.max(c.abs()));
    let single = (far + size) * f64::from(f32::EPSILON);
    if single > header.step / 4.0 { Precision::Double } else { Precision::Single }
}
