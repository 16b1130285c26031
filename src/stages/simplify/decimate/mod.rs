//! Stream decimation by parallel slabs: edge collapses at the quality of an in-core method, on a
//! stream in the order of a sweep `[WK03]`.
//!
//! The stream is cut into slabs by triangle count, never by thread count, so that the result does
//! not depend on either. Each slab is decimated on its own with its interfaces frozen; what is left
//! of all slabs, with their accumulated quadrics, is one mesh in core that is brought to exactly
//! the wanted number of triangles by one threshold for all of it. The seams are inside that mesh,
//! and so are no longer there.

mod cutter;
mod groups;
mod slab;

use std::sync::{
    Mutex, PoisonError,
    atomic::{AtomicUsize, Ordering},
};

use cutter::{Cutter, Slab};

use crate::{
    error::{Error, Result},
    mesh::{self, ByQuadric, Mesh, Metric, Patch},
    progress::{Meter, Monitor, StageId},
    soup::{Column, IndexedMesh, SweepAxis, Triangle, Triangles, Vertex},
    storage::{Reservation, Workspace},
};

/// What decimation needs to know.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// The axis the stream is sorted along.
    pub axis: SweepAxis,
    /// Triangles in the stream.
    pub triangles: u64,
    /// Triangles wanted.
    pub triangles_target: u64,
}

/// What decimation did.
pub struct Outcome<V> {
    /// The result.
    pub mesh: IndexedMesh<V>,
    /// Slabs the stream was cut into.
    pub slabs: u64,
    /// Triangles left out because two of their corners were one point.
    pub degenerate: u64,
    /// Vertices left alone because their faces are no fan: non-manifold edges and vertices.
    pub complex_vertices: u64,
    /// No collapse was left that would keep the surface what it is.
    pub is_stuck: bool,
}

/// Triangles of a slab at least: large enough that few of its vertices lie on an interface.
const SLAB_TRIANGLES_MIN: u64 = 1 << 18;
/// Triangles of a slab, times the square root of all: an interface of a surface grows like this
/// square root, so that the share of frozen vertices stays the same.
const SLAB_ROOT_FACTOR: f64 = 80.0;

/// A block keeps this many times its fair share of the wanted triangles, so that detailed blocks
/// are not decimated more than one threshold for all would. Measured on igea, a range map and the
/// armadillo, to 10 %: the error is 1 to 4 % above that without slabs at 1.5, 1 to 3 % at 2, and
/// 6 to 30 % at 1.
const SHARE_FACTOR: f64 = 1.5;
/// And a little more, where the fair share is tiny and the rest costs nothing.
const SHARE_EXTRA: f64 = 0.02;

/// Triangles left at an interface, times the square root of all: 14,600 of the 10 M of a gyroid.
const INTERFACE_FACTOR: u64 = 5;

/// Bytes a triangle of a slab takes while the slab is decimated: itself, the weld, the mesh.
const SLAB_BYTES_PER_TRIANGLE: u64 = 150;
/// What [`Error::Resource`] names when the last mesh does not fit.
const REST: &str = "the mesh that slabs leave";
/// Bytes a triangle takes between slabs and the last mesh, and in it.
const REST_BYTES_PER_TRIANGLE: u64 = 110;

impl Config {
    /// Triangles of a slab.
    #[must_use]
    pub fn slab_triangles(&self) -> u64 {
        SLAB_TRIANGLES_MIN.max(((self.triangles as f64).sqrt() * SLAB_ROOT_FACTOR) as u64)
    }

    /// Share of its vertices that a block of a slab keeps.
    fn share(&self) -> f64 {
        let ratio = self.triangles_target as f64 / self.triangles.max(1) as f64;
        (ratio * SHARE_FACTOR + SHARE_EXTRA).min(1.0)
    }

    /// Bytes of memory the slabs take on `threads` threads, at least with one at a time.
    #[must_use]
    pub fn slab_bytes(&self, threads: u64) -> u64 {
        // One more is being filled.
        self.slab_triangles().min(self.triangles) * (threads * SLAB_BYTES_PER_TRIANGLE + 36)
    }

    /// Bytes of memory that what is left of all slabs takes, about.
    #[must_use]
    pub fn rest_bytes(&self) -> u64 {
        // Interfaces keep all their vertices.
        let interfaces = self.triangles / self.slab_triangles();
        let at_interfaces = interfaces * INTERFACE_FACTOR * self.triangles.isqrt();
        let inside = (self.triangles as f64 * self.share()) as u64;
        (inside + at_interfaces).min(self.triangles) * REST_BYTES_PER_TRIANGLE
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
    decimate_by::<V, ByQuadric>(config, workspace, monitor, feed)
}

fn decimate_by<V: Vertex, M: Metric>(
    config: &Config,
    workspace: &Workspace,
    monitor: &Monitor,
    feed: impl FnOnce(&mut dyn FnMut(&[Triangle<V>]) -> Result<()>) -> Result<()>,
) -> Result<Outcome<V>> {
    let (threads, room) = slab_room(config, workspace)?;
    let meter = monitor.meter(StageId::Decimate, Some(config.triangles));
    let work = Work::<M> {
        limit: mesh::Limit { cost: f32::INFINITY, share: config.share(), faces: 0 },
        meter: &meter,
        axis: config.axis,
        under_way: AtomicUsize::new(0),
        done: Mutex::default(),
    };
    let slabs = rayon::in_place_scope(|scope| {
        let mut cutter = Cutter::new(config.axis, config.slab_triangles() as usize);
        let mut slabs = 0;
        let mut start = |slab: Slab<V>| {
            slabs += 1;
            // One slab for each other thread; this one reads, and works when all are busy.
            if work.under_way.fetch_add(1, Ordering::AcqRel) + 1 < threads {
                scope.spawn(|_| work.run(slab));
            } else {
                work.run(slab);
            }
            work.check()
        };
        feed(&mut |triangles| cutter.push(triangles, &mut start))?;
        if let Some(last) = cutter.finish() {
            start(last)?;
        }
        Ok::<_, Error>(slabs)
    })?;
    work.check()?;
    let Work { done, .. } = work;
    meter.finish();
    let mut done = done.into_inner().unwrap_or_else(PoisonError::into_inner);
    done.slabs.sort_unstable_by_key(|slab| slab.index);
    drop(room);
    let degenerate = done.slabs.iter().map(|slab| slab.degenerate).sum();
    finish(config, done.slabs, workspace, monitor, (slabs, degenerate))
}

/// Slabs that can be worked on at a time, and the memory for them.
fn slab_room(config: &Config, workspace: &Workspace) -> Result<(usize, Reservation)> {
    let budget = workspace.budget();
    let (needed_bytes, available_bytes) = (config.rest_bytes(), budget.limit_bytes());
    if needed_bytes > available_bytes {
        return Err(Error::Resource { what: REST, needed_bytes, available_bytes });
    }
    for threads in (1..=rayon::current_num_threads()).rev() {
        if let Some(room) = budget.reserve(config.slab_bytes(threads as u64)) {
            return Ok((threads, room));
        }
    }
    let (needed_bytes, available_bytes) = (config.slab_bytes(1), budget.available_bytes());
    Err(Error::Resource { what: "a slab of the mesh", needed_bytes, available_bytes })
}

/// What the threads share.
struct Work<'a, M: Metric> {
    limit: mesh::Limit,
    axis: SweepAxis,
    meter: &'a Meter<'a>,
    under_way: AtomicUsize,
    done: Mutex<Done<M>>,
}

struct Done<M: Metric> {
    slabs: Vec<slab::Decimated<M>>,
    failure: Option<Error>,
}

impl<M: Metric> Default for Done<M> {
    fn default() -> Self {
        Self { slabs: Vec::new(), failure: None }
    }
}

impl<M: Metric> Work<'_, M> {
    fn run<V: Vertex>(&self, slab: Slab<V>) {
        let triangles = slab.triangles.len() as u64;
        let decimated = slab::decimate(slab, self.axis, &self.limit);
        let counted = self.meter.add(triangles);
        let mut done = self.done.lock().unwrap_or_else(PoisonError::into_inner);
        match counted {
            Ok(()) => done.slabs.push(decimated),
            Err(cancelled) => done.failure = Some(cancelled.into()),
        }
        self.under_way.fetch_sub(1, Ordering::AcqRel);
    }

    fn check(&self) -> Result<()> {
        let failure = self.done.lock().unwrap_or_else(PoisonError::into_inner).failure.take();
        failure.map_or(Ok(()), Err)
    }
}

/// Joins what is left and brings it to the wanted count.
fn finish<V: Vertex, M: Metric>(
    config: &Config,
    slabs: Vec<slab::Decimated<M>>,
    workspace: &Workspace,
    monitor: &Monitor,
    (slab_count, degenerate): (u64, u64),
) -> Result<Outcome<V>> {
    let faces: u64 = slabs.iter().map(|slab| slab.patch.faces.len() as u64).sum();
    let needed_bytes = faces * REST_BYTES_PER_TRIANGLE;
    let Some(_room) = workspace.budget().reserve(needed_bytes) else {
        let available_bytes = workspace.budget().available_bytes();
        return Err(Error::Resource { what: REST, needed_bytes, available_bytes });
    };
    let meter = monitor.meter(StageId::Finish, Some(faces));
    let target = usize::try_from(config.triangles_target).unwrap_or(usize::MAX);
    let patches = groups::decimate(slabs, config.axis, target);
    monitor.check(StageId::Finish)?;
    let mut mesh = Mesh::of_decimated(Patch::join(patches, |_| false));
    let complex_vertices = mesh.complex_vertices() as u64;
    let finished = mesh::finish(&mut mesh, target);
    M::place(&mut mesh);
    meter.add(faces)?;
    meter.finish();
    let patch = mesh.into_patch();
    let vertex = |(index, position): (usize, &glam::Vec3)| {
        V::new(position.to_array(), patch.colors.get(index).map_or([255; 4], mesh::Color::mean))
    };
    let vertices = patch.positions.iter().enumerate().map(vertex).collect();
    let mesh = IndexedMesh {
        vertices: Column::Memory(vertices),
        triangles: Triangles::Memory(patch.faces),
    };
    let is_stuck = finished.is_stuck;
    Ok(Outcome { mesh, slabs: slab_count, degenerate, complex_vertices, is_stuck })
}
