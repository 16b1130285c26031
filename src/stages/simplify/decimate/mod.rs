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

use std::{
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicU64, AtomicUsize, Ordering},
    },
    time::Duration,
};

use cutter::{Cutter, Slab};

use crate::{
    error::{Error, Result},
    mesh::{self, ByQuadric, ByVolume, Mesh, Patch},
    progress::{Meter, Monitor, StageId},
    soup::{Column, IndexedMesh, SweepAxis, Triangle, Triangles, Vertex},
    storage::{Budget, Reservation, Workspace},
};

/// What decimation needs to know.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// The axis the stream is sorted along.
    pub axis: SweepAxis,
    /// Triangles in the stream, when known; a slab or so more does no harm.
    pub triangles: Option<u64>,
    /// How many are wanted.
    pub wanted: Wanted,
    /// What decides which edges are collapsed, and where to.
    pub metric: Metric,
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
    /// Vertices left alone because their faces are no fan: non-manifold edges and vertices.
    pub complex_vertices: u64,
}

/// Triangles of a slab at least: large enough that few of its vertices lie on an interface.
const SLAB_TRIANGLES_MIN: u64 = 1 << 18;
/// Triangles of a slab, times the square root of all, as they turn out on a ball of gyroid: the
/// front of a surface grows like this square root.
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
/// Bytes a triangle of the slab being filled takes.
const FILLING_BYTES_PER_TRIANGLE: u64 = 48;
/// What [`Error::Resource`] names when a slab does not fit.
const SLAB: &str = "a slab of the mesh";
/// What [`Error::Resource`] names when the last mesh does not fit.
const REST: &str = "the mesh that slabs leave";
/// Bytes a triangle takes between slabs and the last mesh, and in it.
const REST_BYTES_PER_TRIANGLE: u64 = 110;

impl Config {
    /// Triangles of a slab, about.
    #[must_use]
    pub fn slab_triangles(&self) -> u64 {
        let by_front = |triangles: u64| ((triangles as f64).sqrt() * SLAB_ROOT_FACTOR) as u64;
        SLAB_TRIANGLES_MIN.max(self.triangles.map_or(0, by_front))
    }

    /// Share of its vertices that a block of a slab keeps.
    fn share(&self) -> f64 {
        let ratio = match (self.wanted, self.triangles) {
            (Wanted::Ratio(ratio), _) => ratio,
            (Wanted::Triangles(wanted), Some(triangles)) => wanted as f64 / triangles.max(1) as f64,
            (Wanted::Triangles(_), None) => 1.0,
        };
        (ratio * SHARE_FACTOR + SHARE_EXTRA).min(1.0)
    }

    /// Bytes of memory the slabs take on `threads` threads, about.
    #[must_use]
    pub fn slab_bytes(&self, threads: u64) -> u64 {
        let triangles = self.slab_triangles().min(self.triangles.unwrap_or(u64::MAX));
        // One more is being filled.
        triangles * (threads * SLAB_BYTES_PER_TRIANGLE + FILLING_BYTES_PER_TRIANGLE)
    }

    /// Bytes of memory that what is left of all slabs takes, about; 0 when nothing is known.
    #[must_use]
    pub fn rest_bytes(&self) -> u64 {
        let triangles = self.triangles.unwrap_or(0);
        // Interfaces keep all their vertices.
        let interfaces = triangles / self.slab_triangles();
        let at_interfaces = interfaces * INTERFACE_FACTOR * triangles.isqrt();
        let inside = (triangles as f64 * self.share()) as u64;
        (inside + at_interfaces).min(triangles) * REST_BYTES_PER_TRIANGLE
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
    let (needed_bytes, available_bytes) = (config.rest_bytes(), workspace.budget().limit_bytes());
    if needed_bytes > available_bytes {
        return Err(Error::Resource { what: REST, needed_bytes, available_bytes });
    }
    let meter = monitor.meter(StageId::Decimate, config.triangles);
    let work = Work::<M> {
        limit: mesh::Limit { cost: f32::INFINITY, share: config.share(), faces: 0 },
        meter: &meter,
        axis: config.axis,
        budget: workspace.budget(),
        under_way: AtomicUsize::new(0),
        faces_left: AtomicU64::new(0),
        done: Mutex::default(),
    };
    rayon::in_place_scope(|scope| {
        let mut cutter = Cutter::new(config.axis, SLAB_TRIANGLES_MIN as usize);
        let (mut unit, work) = (None, &work);
        let mut start = |slab: Slab<V>| {
            let unit = *unit.get_or_insert_with(|| mesh::unit_of(&slab.triangles));
            let (room, is_alone) = work.admit(slab.triangles.len() as u64)?;
            // One slab for each other thread; this one reads, and works when all are busy.
            if is_alone {
                work.run(slab, unit, room);
            } else {
                scope.spawn(move |_| work.run(slab, unit, room));
            }
            work.check()
        };
        feed(&mut |triangles| cutter.push(triangles, &mut start))?;
        cutter.finish().map_or(Ok(()), start)
    })?;
    work.check()?;
    let Work { done, .. } = work;
    let triangles = meter.done();
    meter.finish();
    let mut done = done.into_inner().unwrap_or_else(PoisonError::into_inner);
    done.slabs.sort_unstable_by_key(|slab| slab.index);
    finish(config.axis, done.slabs, config.triangles_target(triangles), (workspace, monitor))
}

/// What the threads share.
struct Work<'a, M: mesh::Metric> {
    limit: mesh::Limit,
    axis: SweepAxis,
    meter: &'a Meter<'a>,
    budget: &'a Budget,
    under_way: AtomicUsize,
    /// Faces that slabs have left so far.
    faces_left: AtomicU64,
    done: Mutex<Done<M>>,
}

struct Done<M: mesh::Metric> {
    slabs: Vec<slab::Decimated<M>>,
    failure: Option<Error>,
}

impl<M: mesh::Metric> Default for Done<M> {
    fn default() -> Self {
        Self { slabs: Vec::new(), failure: None }
    }
}

impl<M: mesh::Metric> Work<'_, M> {
    /// Finds memory for a slab of so many triangles, after others if need be, and says whether it
    /// is to be worked on by the calling thread.
    fn admit(&self, triangles: u64) -> Result<(Reservation, bool)> {
        let needed_bytes = self.faces_left.load(Ordering::Relaxed) * REST_BYTES_PER_TRIANGLE;
        let available_bytes = self.budget.limit_bytes();
        if needed_bytes > available_bytes {
            // Better said now than at the end of the stream.
            return Err(Error::Resource { what: REST, needed_bytes, available_bytes });
        }
        let bytes = triangles * (SLAB_BYTES_PER_TRIANGLE + FILLING_BYTES_PER_TRIANGLE);
        loop {
            let is_alone = self.under_way.load(Ordering::Acquire) == 0;
            if let Some(room) = self.budget.reserve(bytes) {
                let threads = rayon::current_num_threads();
                let before = self.under_way.fetch_add(1, Ordering::AcqRel);
                return Ok((room, before + 1 >= threads));
            }
            if is_alone {
                let available_bytes = self.budget.available_bytes();
                return Err(Error::Resource { what: SLAB, needed_bytes: bytes, available_bytes });
            }
            if rayon::yield_now().is_none_or(|done| done == rayon::Yield::Idle) {
                std::thread::sleep(Duration::from_millis(1));
            }
        }
    }

    fn run<V: Vertex>(&self, slab: Slab<V>, unit: f32, room: Reservation) {
        let triangles = slab.triangles.len() as u64;
        let decimated = slab::decimate(slab, self.axis, (&self.limit, unit));
        let faces_left = decimated.patch.faces.len() as u64;
        self.faces_left.fetch_add(faces_left, Ordering::Relaxed);
        let counted = self.meter.add(triangles);
        let mut done = self.done.lock().unwrap_or_else(PoisonError::into_inner);
        match counted {
            Ok(()) => done.slabs.push(decimated),
            Err(cancelled) => done.failure = Some(cancelled.into()),
        }
        drop(done);
        drop(room);
        self.under_way.fetch_sub(1, Ordering::AcqRel);
    }

    fn check(&self) -> Result<()> {
        let failure = self.done.lock().unwrap_or_else(PoisonError::into_inner).failure.take();
        failure.map_or(Ok(()), Err)
    }
}

/// Joins what is left and brings it to the wanted count.
fn finish<V: Vertex, M: mesh::Metric>(
    axis: SweepAxis,
    slabs: Vec<slab::Decimated<M>>,
    triangles_target: u64,
    (workspace, monitor): (&Workspace, &Monitor),
) -> Result<Outcome<V>> {
    let faces: u64 = slabs.iter().map(|slab| slab.patch.faces.len() as u64).sum();
    let degenerate = slabs.iter().map(|slab| slab.degenerate).sum();
    let slab_count = slabs.len() as u64;
    let needed_bytes = faces * REST_BYTES_PER_TRIANGLE;
    let Some(_room) = workspace.budget().reserve(needed_bytes) else {
        let available_bytes = workspace.budget().available_bytes();
        return Err(Error::Resource { what: REST, needed_bytes, available_bytes });
    };
    let meter = monitor.meter(StageId::Finish, Some(faces));
    let target = usize::try_from(triangles_target).unwrap_or(usize::MAX);
    let patches = groups::decimate(slabs, axis, target);
    monitor.check(StageId::Finish)?;
    let mut mesh = Mesh::of_decimated(Patch::join(patches, |_| false));
    let complex_vertices = mesh.complex_vertices() as u64;
    mesh::finish(&mut mesh, target);
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
    Ok(Outcome { mesh, triangles_target, slabs: slab_count, degenerate, complex_vertices })
}
