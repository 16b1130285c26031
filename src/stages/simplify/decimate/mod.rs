//! Stream decimation by parallel slabs: edge collapses at the quality of an in-core method, on a
//! stream in the order of a sweep `[WK03]`.
//!
//! The stream is cut into slabs by triangle count, never by thread count, so that the result does
//! not depend on either. Each slab is decimated on its own with its interfaces frozen; what is left
//! of all slabs, with their accumulated quadrics, is one mesh in core that is brought to exactly
//! the wanted number of triangles by one threshold for all of it. The seams are inside that mesh,
//! and so are no longer there.

mod blobs;
mod journal;
mod piece;
mod rest;
mod slab;
#[cfg(test)]
mod tests;
mod threshold;
mod tree;
mod work;

pub use blobs::Blobs;
use piece::Piece;
pub use threshold::{Threshold, threshold};
use work::{REST, Work, busy_bytes, slabs_under_way};

use crate::{
    error::{Error, Result},
    mesh::{self, ByQuadric, ByVolume, Limit, Mesh, Patch, Threads},
    progress::{Monitor, StageId},
    soup::{Cutter, IndexedMesh, Slab, SweepAxis, Triangle, Vertex},
    storage::{StreamEnd, Workspace},
};

/// What decimation needs to know.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// The axis the stream is sorted along.
    pub axis: SweepAxis,
    /// Triangles in the stream, about, when known: polygons count as one.
    pub triangles: Option<u64>,
    /// The same, when it is exact, for the progress.
    pub triangles_exact: Option<u64>,
    /// How many are wanted.
    pub wanted: Wanted,
    /// What decides which edges are collapsed, and where to.
    pub metric: Metric,
    /// Triangles of a slab at least: [`SLAB_TRIANGLES_MIN`], but for tests.
    pub slab_triangles_min: u64,
    /// Up to what cost slabs are decimated, if that is known; else to a share of their vertices.
    pub threshold: Option<Threshold>,
}

/// How many triangles are wanted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wanted {
    /// So many, of a stream whose length is known.
    Triangles(u64),
    /// This share of the stream.
    Ratio(f64),
}

/// What decimation goes by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Metric {
    /// Error quadrics: distances from the surface as it was `[GH97, WK03]`. The faster one.
    Quadric,
    /// Volumes: what each collapse sweeps over, keeping the volume `[LT98]`. The more faithful.
    Volume,
}

impl Metric {
    /// Its name, as on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Quadric => "quadric",
            Self::Volume => "volume",
        }
    }
}

/// What decimation did.
pub struct Outcome<V> {
    /// The result.
    pub mesh: IndexedMesh<V>,
    /// Triangles that were wanted in the end.
    pub triangles_target: u64,
    /// Slabs the stream was cut into.
    pub slabs: u64,
    /// Triangles left out because two of their corners were one point.
    pub degenerate: u64,
    /// Vertices that were added because several sheets of the surface touched in one.
    pub split_vertices: u64,
    /// Vertices left alone because their faces are no fan: non-manifold edges and vertices.
    pub complex_vertices: u64,
}

/// Triangles of a slab at least: large enough that few of its vertices lie on an interface.
pub const SLAB_TRIANGLES_MIN: u64 = 1 << 18;
/// Triangles of a slab, times the square root of all, as they turn out on a ball of gyroid: the
/// front of a surface grows like this square root.
const SLAB_ROOT_FACTOR: f64 = 80.0;

/// A block keeps this many times its fair share of the wanted triangles, so that detailed blocks
/// are not decimated more than one threshold for all would. Measured on igea, a range map and the
/// armadillo, to 10 %: the error is 1 to 4 % above that without slabs at 1.5, 1 to 3 % at 2, and
/// 6 to 30 % at 1.
const SHARE_FACTOR: f64 = 1.5;
/// And a little more, where the fair share is tiny and the rest costs nothing. The more slabs are
/// joined, the less: detail evens out.
const SHARE_EXTRA: f64 = 0.02;

/// Triangles left at an interface, times the square root of all: 14,600 of the 10 M of a gyroid.
const INTERFACE_FACTOR: u64 = 5;

impl Config {
    /// Triangles of a slab, about.
    #[must_use]
    pub fn slab_triangles(&self) -> u64 {
        let by_front = |triangles: u64| ((triangles as f64).sqrt() * SLAB_ROOT_FACTOR) as u64;
        self.slab_triangles_min.max(self.triangles.map_or(0, by_front))
    }

    /// Share of the triangles that is wanted, as far as it is known.
    fn ratio(&self) -> Option<f64> {
        match (self.wanted, self.triangles) {
            (Wanted::Ratio(ratio), _) => Some(ratio),
            (Wanted::Triangles(wanted), of) => Some(wanted as f64 / of?.max(1) as f64),
        }
    }

    /// The same, with what a sample of the surface would tell as far as memory is concerned.
    #[must_use]
    pub fn as_sampled(self) -> Self {
        Self { threshold: self.ratio().map(Threshold::expected), ..self }
    }

    /// What slabs are decimated to.
    fn slab_limit(&self) -> Limit {
        match self.threshold {
            Some(threshold) => Limit { cost: threshold.cost, share: 0.0, faces: 0 },
            None => Limit { cost: f32::INFINITY, share: self.share(0), faces: 0 },
        }
    }

    /// Share of the triangles that is left, interfaces apart, of slabs and of levels of joined ones.
    fn share(&self, level: u32) -> f64 {
        let ratio = self.ratio().unwrap_or(1.0);
        let by_ratio = || {
            let extra = SHARE_EXTRA / (tree::FAMILY as f64).powi(level as i32);
            (ratio * SHARE_FACTOR + extra).min(1.0)
        };
        self.threshold.map_or_else(by_ratio, |threshold| threshold.share)
    }

    /// Faces that are to be left of so many triangles at a level, interfaces apart.
    fn faces_left(&self, level: u32, triangles: u64) -> u64 {
        (triangles as f64 * self.share(level)) as u64
    }

    /// Bytes of memory the slabs take on `threads` threads, about.
    #[must_use]
    pub fn slab_bytes<V: Vertex>(&self, threads: usize) -> u64 {
        let triangles = self.slab_triangles().min(self.triangles.unwrap_or(u64::MAX));
        let triangle_bytes = size_of::<Triangle<V>>() as u64;
        let each = busy_bytes(self.face_bytes::<V>()) + triangle_bytes;
        // One more is being filled.
        triangles * (slabs_under_way(threads) as u64 * each + triangle_bytes)
    }

    /// Bytes of memory that what is left of all slabs takes, about; 0 when nothing is known.
    #[must_use]
    pub fn rest_bytes<V: Vertex>(&self) -> u64 {
        let triangles = self.triangles.unwrap_or(0);
        let slabs = triangles.div_ceil(self.slab_triangles().max(1));
        let interfaces = slabs.saturating_sub(1) * INTERFACE_FACTOR * triangles.isqrt();
        let faces = tree::faces_left(slabs, |level, joined| {
            self.faces_left(level, triangles) + interfaces / joined
        });
        faces.min(triangles) * self.face_bytes::<V>()
    }

    /// Bytes of memory a face takes in a mesh that is decimated.
    #[must_use]
    pub fn face_bytes<V: Vertex>(&self) -> u64 {
        match self.metric {
            Metric::Quadric => mesh::face_bytes::<V, ByQuadric>(),
            Metric::Volume => mesh::face_bytes::<V, ByVolume>(),
        }
    }

    fn triangles_target(&self, triangles: u64) -> u64 {
        let target = match self.wanted {
            Wanted::Triangles(wanted) => wanted,
            Wanted::Ratio(ratio) => (triangles as f64 * ratio).round() as u64,
        };
        target.max(1)
    }
}

/// Decimates a stream. `feed` passes all triangles to the sink it is given, in the order of
/// [`crate::soup::SweepKey`] along [`Config::axis`].
///
/// Memory: [`Config::slab_bytes`] and [`Config::rest_bytes`]. No temporary disk.
///
/// # Errors
/// What `feed` fails with, cancellation, [`Error::Resource`] when what is left of the slabs does
/// not fit the budget.
pub fn decimate<V: Vertex>(
    config: &Config,
    workspace: &Workspace,
    monitor: &Monitor,
    feed: impl FnOnce(&mut dyn FnMut(&[Triangle<V>]) -> Result<()>) -> Result<()>,
) -> Result<Outcome<V>> {
    match config.metric {
        Metric::Quadric => decimate_by::<V, ByQuadric>(config, workspace, monitor, feed),
        Metric::Volume => decimate_by::<V, ByVolume>(config, workspace, monitor, feed),
    }
}

fn decimate_by<V: Vertex, M: mesh::Metric>(
    config: &Config,
    workspace: &Workspace,
    monitor: &Monitor,
    feed: impl FnOnce(&mut dyn FnMut(&[Triangle<V>]) -> Result<()>) -> Result<()>,
) -> Result<Outcome<V>> {
    let (needed_bytes, available_bytes) =
        (config.rest_bytes::<V>(), workspace.budget().limit_bytes());
    if needed_bytes > available_bytes {
        return Err(Error::Resource { what: REST, needed_bytes, available_bytes });
    }
    let meter = monitor.meter(StageId::Decimate, config.triangles_exact);
    let work = Work::<M>::new::<V>(config, &meter, workspace)?;
    let slabs = if let Some(end) = work.end_noted()? {
        end.slabs
    } else {
        let slabs = match other_threads() {
            Some(pool) => {
                pool.in_place_scope(|scope| cut_and_start(config, &work, Some(scope), feed))?
            }
            None => cut_and_start(config, &work, None, feed)?,
        };
        work.check()?;
        work.note_end(StreamEnd { slabs, triangles: meter.done() })?;
        slabs
    };
    let (pieces, _room) = work.finish()?;
    let triangles_target = config.triangles_target(meter.done());
    meter.finish();
    let outcome = finish(config.axis, pieces, triangles_target, monitor)?;
    Ok(Outcome { slabs, ..outcome })
}

/// Threads for the slabs beside those of the current pool, which are busy with reading for a small
/// part of the time only; none where one thread is to do all.
fn other_threads() -> Option<rayon::ThreadPool> {
    let threads = rayon::current_num_threads() - 1;
    let pool = || rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    (threads > 0).then(pool)?.ok()
}

/// Cuts the stream into slabs, has them decimated, and returns their number.
fn cut_and_start<'scope, V: Vertex, M: mesh::Metric>(
    config: &Config,
    work: &'scope Work<'scope, M>,
    others: Option<&rayon::Scope<'scope>>,
    feed: impl FnOnce(&mut dyn FnMut(&[Triangle<V>]) -> Result<()>) -> Result<()>,
) -> Result<u64> {
    let mut cutter = Cutter::new(config.axis, config.slab_triangles_min as usize);
    let mut unit = config.threshold.map(|threshold| threshold.unit);
    let mut slabs = 0;
    let mut start = |slab: Slab<V>| {
        slabs += 1;
        let unit = *unit.get_or_insert_with(|| mesh::unit_of(&slab.triangles));
        work.start(others, slab, unit)
    };
    feed(&mut |triangles| cutter.push(triangles, &mut start))?;
    cutter.finish().map_or(Ok(()), start)?;
    Ok(slabs)
}

/// Joins what is left and brings it to the wanted count.
fn finish<V: Vertex, M: mesh::Metric>(
    axis: SweepAxis,
    pieces: Vec<Piece<M>>,
    triangles_target: u64,
    monitor: &Monitor,
) -> Result<Outcome<V>> {
    let faces = tree::faces_of(&pieces);
    let degenerate = pieces.iter().map(|piece| piece.extent.degenerate).sum();
    // Where only pairs of triangles can go, one more does.
    let surplus = faces.saturating_sub(triangles_target);
    let meter = monitor.meter(StageId::Finish, Some(surplus + 1));
    let target = usize::try_from(triangles_target).unwrap_or(usize::MAX);
    let pieces = rest::decimate(pieces, axis, target, &meter)?;
    monitor.check(StageId::Finish)?;
    let split: u64 = pieces.iter().map(|piece| piece.extent.split).sum();
    let patches = pieces.into_iter().map(|piece| piece.patch).collect();
    let mut mesh = Mesh::of_joined(Patch::join(patches, |_| false), Threads::All);
    let split_vertices = split + mesh.split_vertices() as u64;
    let complex_vertices = mesh.complex_vertices() as u64;
    monitor.check(StageId::Finish)?;
    mesh::finish_metered(&mut mesh, target, &meter)?;
    M::place(&mut mesh);
    meter.finish();
    let mesh = mesh.into_patch().into_indexed();
    Ok(Outcome { mesh, triangles_target, slabs: 0, degenerate, split_vertices, complex_vertices })
}
