//! Decimation under an error bound `[CKS98 §6–8]`: no vertex of the input is farther from the result
//! than a tolerance.
//!
//! The stream, in the order of a sweep, is cut into slabs by triangle count, never by thread count.
//! Each is decimated on its own with its interfaces frozen, as far as the tolerance allows; then all
//! but a strip beside the interfaces is finished, and what was removed there is forgotten. Strips of
//! neighbours are joined, decimated and finished in turn, until nothing is left to join.

mod journal;
mod piece;
mod slab;
#[cfg(test)]
mod tests;
mod tree;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use self::{journal::Saved, piece::Piece, tree::Tree};
use crate::{
    error::{Error, Result},
    mesh::{Bound, ByDeviation, Patch, face_bytes, unit_of},
    progress::{Meter, Monitor, StageId},
    soup::{Cutter, IndexedMesh, Slab, SweepAxis, Triangle, Vertex},
    storage::{Budget, Reservation, StreamEnd, Workspace},
};

/// What decimation under a bound needs to know.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// The axis the stream is sorted along.
    pub axis: SweepAxis,
    /// Triangles in the stream, about, when known: polygons count as one.
    pub triangles: Option<u64>,
    /// The same, when it is exact, for the progress.
    pub triangles_exact: Option<u64>,
    /// What the result keeps to.
    pub bound: Bound,
    /// Whether the tolerance is raised, up to that of the bound, no further than the wanted number
    /// of faces takes; then all of the mesh is in memory at once.
    pub is_counted: bool,
    /// Triangles of a slab at least: [`SLAB_TRIANGLES_MIN`], but for tests.
    pub slab_triangles_min: u64,
}

/// What decimation under a bound did.
pub struct Outcome<V> {
    /// The result.
    pub mesh: IndexedMesh<V>,
    /// The tolerance that holds: that of the bound, or less where the wanted number of faces came
    /// first.
    pub tolerance: f64,
    /// Slabs the stream was cut into.
    pub slabs: u64,
    /// What was noticed.
    pub figures: Figures,
}

/// What was noticed of the triangles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Figures {
    /// Triangles left out because two of their corners were one point.
    pub degenerate: u64,
    /// Vertices of those only, too far from all others: each is kept as a triangle of one point.
    pub loose_vertices: u64,
    /// Vertices that were added because several sheets of the surface touched in one.
    pub split_vertices: u64,
    /// Vertices left alone because their faces are no fan.
    pub complex_vertices: u64,
}

impl Figures {
    fn add(&mut self, other: &Self) {
        self.degenerate += other.degenerate;
        self.loose_vertices += other.loose_vertices;
        self.split_vertices += other.split_vertices;
        self.complex_vertices += other.complex_vertices;
    }
}

/// Triangles of a slab at least.
pub const SLAB_TRIANGLES_MIN: u64 = 1 << 16;

/// Slabs that are worked on together, for each thread: where one takes longer than the others,
/// threads go on with the next. Chosen by hand.
const SLABS_PER_THREAD: usize = 2;

/// What [`Error::Resource`] names when the mesh does not fit.
pub const SLAB: &str = "a slab of the mesh";
/// What [`Error::Resource`] names when what has been done does not fit.
const RESULT: &str = "what the error bound leaves of the mesh";
/// What [`Error::Resource`] names when a count is wanted.
pub const WHOLE: &str = "the whole mesh, which a count under an error bound takes,";

impl Config {
    /// Bytes of memory for each triangle that is worked on.
    #[must_use]
    pub fn triangle_bytes<V: Vertex>() -> u64 {
        // A quarter more for what the allocator keeps of the memory of meshes before.
        let mesh_bytes = face_bytes::<V, ByDeviation>() / 4 * 5;
        mesh_bytes + size_of::<Triangle<V>>() as u64
    }

    /// Bytes of memory it takes at least: for the whole mesh or for a slab, and one to be filled.
    #[must_use]
    pub fn memory_bytes<V: Vertex>(&self) -> u64 {
        let triangles = self.triangles.unwrap_or(0);
        if self.is_counted {
            return triangles * Self::triangle_bytes::<V>();
        }
        let bytes = Self::triangle_bytes::<V>() + size_of::<Triangle<V>>() as u64;
        triangles.min(self.slab_triangles_min) * bytes
    }

    fn slab_triangles_min(&self) -> usize {
        if self.is_counted { usize::MAX } else { self.slab_triangles_min as usize }
    }
}

/// Decimates a stream. `feed` passes all triangles to the sink it is given, in the order of
/// [`crate::soup::SweepKey`] along [`Config::axis`].
///
/// Memory: for slabs, [`Config::triangle_bytes`] of each, and for the result. No temporary disk.
///
/// # Errors
/// What `feed` fails with, cancellation, [`Error::Resource`] when a slab or the result does not fit
/// the budget.
pub fn decimate<V: Vertex>(
    config: &Config,
    workspace: &Workspace,
    monitor: &Monitor,
    feed: impl FnOnce(&mut dyn FnMut(&[Triangle<V>]) -> Result<()>) -> Result<()>,
) -> Result<Outcome<V>> {
    let budget = workspace.budget();
    let (needed_bytes, available_bytes) = (config.memory_bytes::<V>(), budget.limit_bytes());
    if needed_bytes > available_bytes {
        let what = if config.is_counted { WHOLE } else { SLAB };
        return Err(Error::Resource { what, needed_bytes, available_bytes });
    }
    let meter = monitor.meter(StageId::Decimate, config.triangles_exact);
    let mut work = Work::<V>::new(config, &meter, workspace)?;
    if let Some(end) = work.saved.end {
        work.slabs = end.slabs;
        meter.add(end.triangles)?;
    } else {
        let mut cutter = Cutter::new(config.axis, config.slab_triangles_min());
        feed(&mut |triangles| cutter.push(triangles, &mut |slab| work.add(slab)))?;
        cutter.finish().map_or(Ok(()), |slab| work.add(slab))?;
        work.decimate_waiting()?;
        work.note_end()?;
    }
    let (slabs, tree) = (work.slabs, work.tree);
    meter.finish();
    let open_faces = tree.open_faces();
    let meter = monitor.meter(StageId::Finish, Some(open_faces));
    let whole = tree.finish(config, budget)?;
    meter.add(open_faces)?;
    meter.finish();
    monitor.check(StageId::Finish)?;
    let Piece { finished, figures, tolerance, room: _room, .. } = whole;
    let mesh = Patch::join(finished, |_| false).into_indexed();
    Ok(Outcome { mesh, tolerance, slabs, figures })
}

/// The slabs of a stream, a few at a time.
struct Work<'a, V> {
    config: &'a Config,
    meter: &'a Meter<'a>,
    workspace: &'a Workspace,
    budget: &'a Budget,
    /// Slabs that wait for the others they are worked on with, and the memory that takes.
    waiting: Vec<(Slab<V>, Reservation)>,
    /// As of [`Patch::unit`], once a slab is there.
    unit: Option<f32>,
    slabs: u64,
    tree: Tree,
    /// What is left of slabs, in files.
    saved: Saved,
}

impl<'a, V: Vertex> Work<'a, V> {
    /// Begins with what a run before this one has left.
    fn new(config: &'a Config, meter: &'a Meter<'a>, workspace: &'a Workspace) -> Result<Self> {
        let budget = workspace.budget();
        let saved = journal::recall(workspace)?;
        let pieces = saved
            .load(RESULT, budget, |name, figures, words, room| figures.piece(name, words, room))?;
        Ok(Self {
            config,
            meter,
            workspace,
            budget,
            waiting: Vec::new(),
            unit: None,
            slabs: 0,
            tree: Tree::of_pieces(pieces),
            saved,
        })
    }

    fn add(&mut self, slab: Slab<V>) -> Result<()> {
        self.unit.get_or_insert_with(|| unit_of(&slab.triangles));
        if self.saved.holds(slab.index) {
            self.slabs += 1;
            return Ok(self.meter.add(slab.triangles.len() as u64)?);
        }
        let bytes = slab.triangles.len() as u64 * Config::triangle_bytes::<V>();
        let mut room = self.budget.reserve(bytes);
        if room.is_none() {
            self.decimate_waiting()?;
            room = self.budget.reserve(bytes);
        }
        let available_bytes = self.budget.available_bytes();
        let room = room.ok_or(Error::Resource {
            what: if self.slabs == 0 { SLAB } else { RESULT },
            needed_bytes: bytes,
            available_bytes,
        })?;
        self.waiting.push((slab, room));
        self.slabs += 1;
        if self.waiting.len() >= SLABS_PER_THREAD * rayon::current_num_threads() {
            self.decimate_waiting()?;
        }
        Ok(())
    }

    /// Decimates the slabs that wait, and what they complete.
    fn decimate_waiting(&mut self) -> Result<()> {
        let unit = self.unit.unwrap_or(1.0);
        let slabs = std::mem::take(&mut self.waiting);
        let pieces = slabs.into_par_iter().map(|(slab, room)| {
            let triangles = slab.triangles.len() as u64;
            let piece = slab::decimate(slab, self.config, unit, room);
            self.meter.add(triangles)?;
            Ok(piece)
        });
        let pieces = pieces.collect::<Result<Vec<Piece>>>()?;
        self.tree.add(pieces, self.config, self.budget)?;
        // Only here is each slab either in the tree, or not begun.
        match self.workspace.due() {
            Some(due) => journal::save(&mut self.saved, &due, self.tree.pieces(), self.workspace),
            None => Ok(()),
        }
    }

    /// Notes that all slabs are done, unless all of it took next to no time.
    fn note_end(&mut self) -> Result<()> {
        let Some(due) = self.workspace.milestone() else { return Ok(()) };
        self.saved.end = Some(StreamEnd { slabs: self.slabs, triangles: self.meter.done() });
        journal::save(&mut self.saved, &due, self.tree.pieces(), self.workspace)
    }
}
