//! Stream decimation by multiple choice, in a single pass on a window in core `[WK03]`.
//!
//! Triangles come in the order of a sweep, as [`presort`](crate::stages::convert::presort) passes
//! them on, and leave as soon as they are coarse enough: nothing is set aside, and nothing is
//! needed to be known of the stream but the share of it that is wanted.

#[cfg(test)]
mod oracle;
mod process;
mod resolution;
#[cfg(test)]
mod tests;

use process::Stream;

use crate::{
    error::{Error, Result},
    progress::{Monitor, StageId},
    soup::{SweepAxis, Triangle, Vertex},
    storage::Workspace,
};

/// What stream decimation needs to know.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// The axis the stream is sorted along.
    pub axis: SweepAxis,
    /// How many triangles are wanted.
    pub target: Target,
    /// Candidates for each decision, at least 1: more are slower and more faithful.
    pub choices: u32,
    /// Which candidates.
    pub seed: u64,
    /// Triangles in core at first, see [`window_triangles`].
    pub window_triangles: usize,
    /// Triangles in core at most, when the front of the mesh needs so many.
    pub window_triangles_max: usize,
    /// Memory there is, for what errors say.
    pub budget_bytes: u64,
}

/// How many triangles are wanted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// This share of the triangles there turn out to be.
    Ratio(f64),
    /// This many.
    Count {
        /// Triangles wanted.
        triangles: u64,
        /// Triangles in the stream.
        of: u64,
    },
}

/// What stream decimation did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    /// Triangles read.
    pub triangles_read: u64,
    /// Triangles asked for.
    pub triangles_target: u64,
    /// Triangles written.
    pub triangles_written: u64,
    /// Those of them that were written before the end of the stream.
    pub written_early: u64,
    /// Those of them that were not next to what had been written already.
    pub written_inside: u64,
    /// Those of them that were finer than they should be, because the window had to be emptied.
    pub written_forced: u64,
    /// Triangles the window has room for, at last.
    pub window_triangles: u64,
    /// Triangles in core at most.
    pub window_max: u64,
    /// Triangles that waited for their neighbours at most, of a full window.
    pub front_max: u64,
    /// Times the window was full.
    pub rounds: u64,
    /// Triangles left out because two of their corners were one point.
    pub degenerate: u64,
    /// Vertices left alone because their faces are no fan: non-manifold edges and vertices.
    pub complex_vertices: u64,
    /// Vertices on a boundary, decimated and written like any other.
    pub boundary_vertices: u64,
    /// No collapse was left that would keep the surface what it is.
    pub is_stuck: bool,
}

/// Bytes of memory that a triangle of the window takes: three quarters of a vertex, with its ring,
/// quadric, position and colour, and its part of the look-up table of the front.
const BYTES_PER_TRIANGLE: u64 = 112;
/// The same for colours.
const COLOR_BYTES_PER_TRIANGLE: u64 = 15;

/// Bytes of memory that a window of so many triangles takes.
#[must_use]
pub fn window_bytes<V: Vertex>(triangles: u64) -> u64 {
    let colors = if V::COLORED { COLOR_BYTES_PER_TRIANGLE } else { 0 };
    triangles.saturating_mul(BYTES_PER_TRIANGLE + colors)
}

/// Triangles of the window that fits in so much memory.
#[must_use]
pub fn window_triangles<V: Vertex>(memory_bytes: u64) -> usize {
    (memory_bytes / window_bytes::<V>(1)) as usize
}

/// Decimates a stream. `feed` passes all triangles to the sink it is given, in the order of
/// [`crate::soup::SweepKey`] along [`Config::axis`]; what is left of them goes to `out`, in
/// batches, as it is released.
///
/// One pass. Memory: [`window_bytes`] of [`Config::window_triangles_max`]. No temporary disk.
/// Source: `[WK03 §4]`; see docs/PAPERS.md for what differs.
///
/// # Errors
/// What `feed` fails with, what `out` returns, cancellation, [`Error::Resource`] when the front of
/// the mesh does not fit the window.
pub fn decimate<V: Vertex>(
    config: &Config,
    workspace: &Workspace,
    monitor: &Monitor,
    out: &mut dyn FnMut(&[Triangle<V>]) -> Result<()>,
    feed: impl FnOnce(&mut dyn FnMut(&[Triangle<V>]) -> Result<()>) -> Result<()>,
) -> Result<Outcome> {
    let needed_bytes = window_bytes::<V>(config.window_triangles_max as u64);
    let Some(_room) = workspace.budget().reserve(needed_bytes) else {
        let available_bytes = workspace.budget().available_bytes();
        return Err(Error::Resource { what: "the window", needed_bytes, available_bytes });
    };
    let total = match config.target {
        Target::Ratio(_) => None,
        Target::Count { of, .. } => Some(of),
    };
    let meter = monitor.meter(StageId::Decimate, total);
    let mut stream = Stream::new(config, monitor, &meter);
    feed(&mut |triangles| stream.push(triangles, out))?;
    let (triangles_target, is_stuck) = stream.conclude(out)?;
    let (counts, figures) = (stream.counts, stream.window.figures());
    let outcome = Outcome {
        triangles_read: stream.resolution.read,
        triangles_target,
        triangles_written: stream.resolution.written,
        written_early: counts.early,
        written_inside: counts.inside,
        written_forced: counts.forced,
        window_triangles: stream.window.faces_max() as u64,
        window_max: figures.faces_most as u64,
        front_max: counts.front_max,
        rounds: counts.rounds,
        degenerate: figures.degenerate,
        complex_vertices: figures.complex_vertices,
        boundary_vertices: figures.boundary_vertices,
        is_stuck,
    };
    meter.finish();
    Ok(outcome)
}

/// Memory for a job whose window holds so many triangles.
fn budget_bytes<V: Vertex>(triangles: u64) -> u64 {
    window_bytes::<V>(triangles) / 3 * 4
}
