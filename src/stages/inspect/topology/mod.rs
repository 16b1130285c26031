//! How a surface hangs together: its edges, vertices and components, counted in one pass over a
//! sorted stream of which only the front is in memory.
//!
//! Corners with one position are one vertex. The stream is cut into slabs, each with all the faces
//! of the vertices that become final in it, and so independent of the others: only components are
//! joined from slab to slab. It changes nothing, and draws no conclusions.

mod components;
mod config;
mod cutter;
mod ring;
mod slab;
#[cfg(test)]
mod tests;
mod work;

pub use config::{Config, FRONT, MEMORY_BYTES_MIN, NEW_TRIANGLES_MIN};
pub use slab::SLIVER_QUALITY;

use cutter::{Counts, Cutter};
use work::{Sums, Work};

use crate::{
    error::Result,
    progress::{Monitor, StageId},
    soup::{Triangle, Vertex},
};

/// How a surface hangs together. A *face* is a triangle with three distinct corners, whether it has
/// an area or not, and whether there is another one like it; only faces have edges and vertices.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    /// Triangles seen.
    pub triangles: u64,
    /// Triangles that are faces.
    pub faces: u64,
    /// Positions that faces have.
    pub vertices: u64,
    /// Pairs of vertices that are neighbours in a face.
    pub edges: u64,
    /// Edges with one face.
    pub boundary_edges: u64,
    /// Edges with three faces or more.
    pub non_manifold_edges: u64,
    /// Edges whose two faces run along them in the same direction: one face shows its back where the
    /// other shows its front.
    pub inconsistent_edges: u64,
    /// Vertices at the ends of boundary edges.
    pub boundary_vertices: u64,
    /// Vertices whose faces are not one fan, open or closed: sheets touch there, or a non-manifold
    /// edge ends.
    pub non_manifold_vertices: u64,
    /// Sets of faces that are connected through common vertices.
    pub components: u64,
    /// Triangles without area: no faces, or with their corners on a line.
    pub degenerate: u64,
    /// Faces with the three vertices of another one, the first of each set apart.
    pub duplicate_faces: u64,
    /// Triangles with an area, but a quality below [`SLIVER_QUALITY`].
    pub slivers: u64,
    /// Most triangles of a front, where slabs began.
    pub front_max: u64,
}

impl Outcome {
    /// Vertices − edges + faces: 2 for a sphere, 0 for a torus, one less for each hole in it; sums of
    /// those for several components.
    #[must_use]
    pub fn euler_characteristic(&self) -> i64 {
        self.vertices.cast_signed() - self.edges.cast_signed() + self.faces.cast_signed()
    }
}

/// Counts what the triangles are made of that `feed` passes to its argument: in batches of any size,
/// in the order of [`SweepKey`](crate::soup::SweepKey) along [`Config::axis`].
///
/// Memory: [`Config::memory_bytes`]. The counts, but for [`Outcome::front_max`], depend on the
/// triangles only.
///
/// # Errors
/// [`Error::Resource`](crate::Error::Resource) for [`FRONT`] when the front of the sweep does not fit
/// the memory, what `feed` returns, cancellation.
pub fn topology<V: Vertex>(
    config: &Config,
    monitor: &Monitor,
    feed: impl FnOnce(&mut dyn FnMut(&[Triangle<V>]) -> Result<()>) -> Result<()>,
) -> Result<Outcome> {
    let meter = monitor.meter(StageId::Topology, config.triangles);
    let work = Work::new(config, &meter);
    let counts = if rayon::current_num_threads() > 1 {
        rayon::in_place_scope(|scope| cut_and_start(config, &work, Some(scope), feed))?
    } else {
        cut_and_start(config, &work, None, feed)?
    };
    let outcome = outcome(&counts, &work.finish()?);
    meter.finish();
    Ok(outcome)
}

/// Cuts the stream into slabs, and has them looked at.
fn cut_and_start<'scope, V: Vertex>(
    config: &Config,
    work: &'scope Work<'scope>,
    others: Option<&rayon::Scope<'scope>>,
    feed: impl FnOnce(&mut dyn FnMut(&[Triangle<V>]) -> Result<()>) -> Result<()>,
) -> Result<Counts> {
    let mut cutter = Cutter::new(config)?;
    let mut start = |slab| work.start(others, slab);
    feed(&mut |triangles| cutter.push(triangles, &mut start))?;
    let (slab, counts) = cutter.finish();
    start(slab)?;
    Ok(counts)
}

fn outcome(counts: &Counts, sums: &Sums) -> Outcome {
    let tally = &sums.tally;
    let edges = |ends: u64| {
        assert!(ends.is_multiple_of(2), "an edge has two ends");
        ends / 2
    };
    assert!(tally.duplicate_corners.is_multiple_of(3), "a face has three corners");
    Outcome {
        triangles: counts.triangles,
        faces: counts.triangles - counts.collapsed,
        vertices: tally.vertices,
        edges: edges(tally.edge_ends),
        boundary_edges: edges(tally.boundary_ends),
        non_manifold_edges: edges(tally.non_manifold_ends),
        inconsistent_edges: edges(tally.inconsistent_ends),
        boundary_vertices: tally.boundary_vertices,
        non_manifold_vertices: tally.non_manifold_vertices,
        components: sums.components.count,
        degenerate: counts.collapsed + sums.flat,
        duplicate_faces: tally.duplicate_corners / 3,
        slivers: sums.slivers,
        front_max: counts.front_max,
    }
}
