//! The slabs of a stream on all threads, in the memory there is.

use std::{
    sync::{
        Mutex, MutexGuard, PoisonError,
        atomic::{AtomicU64, AtomicUsize, Ordering},
    },
    time::Duration,
};

use super::{
    Config,
    journal::{self, Saved},
    piece::{Extent, Piece},
    slab,
    tree::{Tree, faces_of},
};
use crate::{
    error::{Error, Result},
    mesh::{self, Mesh, Threads},
    progress::Meter,
    soup::{Slab, Vertex},
    storage::{Budget, Reservation, StreamEnd, Workspace},
};

/// What [`Error::Resource`] names when a slab does not fit.
const SLAB: &str = "a slab of the mesh";
/// What [`Error::Resource`] names when the last mesh does not fit.
pub(super) const REST: &str = "the mesh that slabs leave";

/// How long a thread sleeps before it looks for memory again.
const NAP: Duration = Duration::from_micros(200);

/// What the threads share.
pub(super) struct Work<'a, M: mesh::Metric> {
    config: &'a Config,
    meter: &'a Meter<'a>,
    workspace: &'a Workspace,
    budget: &'a Budget,
    /// Bytes of a face in a mesh.
    face_bytes: u64,
    /// As of [`busy_bytes`].
    busy_bytes: u64,
    /// Slabs that are begun or wait for a thread.
    under_way: AtomicUsize,
    /// Slabs and joins that hold memory to work in, and will give it back.
    holders: Mutex<usize>,
    /// Faces that are left of those that are done.
    faces_left: AtomicU64,
    tree: Mutex<Tree<M>>,
    failure: Mutex<Option<Error>>,
    /// What is in files. Locked before the tree.
    saved: Mutex<Saved>,
}

impl<'a, M: mesh::Metric> Work<'a, M> {
    pub(super) fn new<V: Vertex>(
        config: &'a Config,
        meter: &'a Meter<'a>,
        workspace: &'a Workspace,
    ) -> Result<Self> {
        let budget = workspace.budget();
        let saved = journal::recall(workspace)?;
        let pieces = saved
            .load(REST, budget, |name, figures, words, room| figures.piece(name, words, room))?;
        let work = Self {
            config,
            meter,
            workspace,
            budget,
            face_bytes: mesh::face_bytes::<V, M>(),
            busy_bytes: busy_bytes(mesh::face_bytes::<V, M>()),
            under_way: AtomicUsize::new(0),
            holders: Mutex::default(),
            faces_left: AtomicU64::new(0),
            tree: Mutex::default(),
            failure: Mutex::default(),
            saved: Mutex::new(saved),
        };
        for piece in pieces {
            work.add(piece);
        }
        Ok(work)
    }

    /// The end of the stream, if a run before this one has come to it and is done with all slabs.
    pub(super) fn end_noted(&self) -> Result<Option<StreamEnd>> {
        let end = self.saved().end;
        if let Some(end) = end {
            self.meter.add(end.triangles)?;
        }
        Ok(end)
    }

    /// Writes down what is left of the slabs that are done, if it is time.
    fn checkpoint(&self) -> Result<()> {
        let Some(due) = self.workspace.due() else { return Ok(()) };
        let mut saved = self.saved();
        journal::save(&mut saved, &due, self.tree().pieces(), self.workspace)
    }

    /// The same when all slabs are cut and done, unless all of it took next to no time.
    pub(super) fn note_end(&self, end: StreamEnd) -> Result<()> {
        let Some(due) = self.workspace.milestone() else { return Ok(()) };
        let mut saved = self.saved();
        saved.end = Some(end);
        journal::save(&mut saved, &due, self.tree().pieces(), self.workspace)
    }

    /// Gives a slab to the other threads, or works on it here when they have enough to do.
    pub(super) fn start<'scope, V: Vertex>(
        &'scope self,
        others: Option<&rayon::Scope<'scope>>,
        slab: Slab<V>,
        unit: f32,
    ) -> Result<()>
    where
        'a: 'scope,
    {
        let triangles = slab.triangles.len() as u64;
        if self.saved().holds(slab.index) {
            return Ok(self.meter.add(triangles)?);
        }
        self.checkpoint()?;
        let room = self.room_for_slab::<V>(triangles)?;
        let before = self.under_way.fetch_add(1, Ordering::AcqRel);
        match others {
            Some(scope) if before < given_away(rayon::current_num_threads()) => {
                scope.spawn(move |_| self.run(slab, unit, room));
            }
            _ => self.run(slab, unit, room),
        }
        self.check()
    }

    /// Memory for a slab's triangles, once there is enough to work on them, too.
    fn room_for_slab<V: Vertex>(&self, triangles: u64) -> Result<Reservation> {
        let to_wait = triangles * size_of::<[V; 3]>() as u64;
        let bytes = to_wait + triangles * self.busy_bytes;
        loop {
            // In this order: what is done after the first look gives its memory back before it.
            let is_alone = self.under_way.load(Ordering::Acquire) == 0;
            if let Some(mut room) = self.budget.reserve(bytes) {
                room.shrink_to(to_wait);
                self.check_rest()?;
                return Ok(room);
            }
            self.wait_for_memory(bytes, is_alone)?;
        }
    }

    /// Memory to work on a slab of so many triangles.
    fn room_to_work(&self, triangles: u64, room: &mut Reservation) -> Result<()> {
        let bytes = triangles * self.busy_bytes;
        loop {
            // One look at both: another slab, or a join, may take the memory in between.
            let mut holders = self.holders();
            if room.grow(bytes) {
                *holders += 1;
                return Ok(());
            }
            let is_alone = *holders == 0;
            drop(holders);
            self.wait_for_memory(bytes, is_alone)?;
        }
    }

    /// Comes back when there may be more memory; fails when nobody is left to give any back.
    fn wait_for_memory(&self, needed_bytes: u64, is_alone: bool) -> Result<()> {
        if self.join_ready() {
            return Ok(());
        }
        if is_alone {
            let available_bytes = self.budget.available_bytes();
            return Err(Error::Resource { what: SLAB, needed_bytes, available_bytes });
        }
        std::thread::sleep(NAP);
        Ok(())
    }

    /// Better said now than at the end of the stream: what is left already is too much.
    fn check_rest(&self) -> Result<()> {
        let needed_bytes = self.faces_left.load(Ordering::Relaxed) * self.face_bytes;
        let available_bytes = self.budget.limit_bytes();
        if needed_bytes > available_bytes && !self.join_ready() {
            return Err(Error::Resource { what: REST, needed_bytes, available_bytes });
        }
        Ok(())
    }

    fn run<V: Vertex>(&self, slab: Slab<V>, unit: f32, mut room: Reservation) {
        let triangles = slab.triangles.len() as u64;
        let done = self.room_to_work(triangles, &mut room).and_then(|()| {
            let limit = self.config.slab_limit();
            let piece = slab::decimate(slab, self.config.axis, (&limit, unit), room);
            self.add(piece);
            *self.holders() -= 1;
            Ok(self.meter.add(triangles)?)
        });
        if let Err(error) = done {
            let mut failure = self.failure.lock().unwrap_or_else(PoisonError::into_inner);
            failure.get_or_insert(error);
        }
        while self.join_ready() {}
        self.under_way.fetch_sub(1, Ordering::AcqRel);
    }

    fn add(&self, piece: Piece<M>) {
        self.faces_left.fetch_add(piece.faces(), Ordering::Relaxed);
        self.tree().add(piece, |family| self.faces_after(family));
    }

    /// Faces that are left of neighbours when they are joined and decimated, about.
    fn faces_after(&self, family: &[Piece<M>]) -> u64 {
        let (faces, shared) = family.iter().fold((0, 0), |(faces, shared), piece| {
            (faces + piece.faces(), shared + piece.patch.shared.len() as u64)
        });
        if self.config.threshold.is_some() {
            // Most of what is shared is shared among them, with two faces a vertex.
            return faces - (3 * shared / 2).min(faces);
        }
        let triangles = family.iter().map(|piece| piece.extent.triangles).sum();
        let level = family.first().map_or(0, |piece| piece.extent.level);
        self.config.faces_left(level + 1, triangles)
    }

    /// Joins neighbours that wait for it, if there are any and the memory is there.
    fn join_ready(&self) -> bool {
        let admit = |family: &[Piece<M>]| self.room_for_mesh(family);
        let mut holders = self.holders();
        let Some((family, room)) = self.tree().take_ready(admit) else { return false };
        *holders += 1;
        drop(holders);
        let faces_before = faces_of(&family);
        let mut joined = Piece::join(family, self.config.axis);
        let frozen = 2 * joined.patch.shared.len();
        joined.room.absorb(room);
        let mut mesh = Mesh::of_joined(joined.patch, Threads::This);
        if self.config.threshold.is_some() {
            mesh::sweep_blocks(&mut mesh, &self.config.slab_limit());
        } else {
            let Extent { level, triangles, .. } = joined.extent;
            // A frozen vertex has a face or two.
            mesh::approach(&mut mesh, self.config.faces_left(level, triangles) as usize + frozen);
        }
        self.add(Piece::of_mesh(mesh, joined.extent, joined.room));
        self.faces_left.fetch_sub(faces_before, Ordering::Relaxed);
        *self.holders() -= 1;
        true
    }

    /// What pieces need beside what they hold to become a mesh.
    fn room_for_mesh(&self, pieces: &[Piece<M>]) -> Option<Reservation> {
        let held: u64 = pieces.iter().map(|piece| piece.room.bytes()).sum();
        self.budget.reserve((faces_of(pieces) * self.face_bytes).saturating_sub(held))
    }

    /// All that is left, in the order of the stream, and the memory to make one mesh of it.
    pub(super) fn finish(self) -> Result<(Vec<Piece<M>>, Reservation)> {
        self.check()?;
        while self.join_ready() {}
        let Self { budget, face_bytes, .. } = self;
        let tree = std::mem::take(&mut *self.tree());
        let pieces = tree.into_pieces();
        match self.room_for_mesh(&pieces) {
            Some(room) => Ok((pieces, room)),
            None => Err(Error::Resource {
                what: REST,
                needed_bytes: faces_of(&pieces) * face_bytes,
                available_bytes: budget.limit_bytes(),
            }),
        }
    }

    /// Locked before [`Self::tree`] where both are.
    fn holders(&self) -> MutexGuard<'_, usize> {
        self.holders.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn saved(&self) -> MutexGuard<'_, Saved> {
        self.saved.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn tree(&self) -> MutexGuard<'_, Tree<M>> {
        self.tree.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn check(&self) -> Result<()> {
        let failure = self.failure.lock().unwrap_or_else(PoisonError::into_inner).take();
        failure.map_or(Ok(()), Err)
    }
}

/// Bytes of a triangle of a slab that is worked on, by those of a face in a mesh: a quarter more for
/// what the allocator keeps of the memory of meshes before.
pub(super) fn busy_bytes(face_bytes: u64) -> u64 {
    face_bytes / 4 * 5
}

/// Slabs that other threads have begun or that wait for them, at most: one waits, so that they do
/// not run out of work while the one that reads has taken a slab itself. On a pool of their own, for
/// else the reading thread takes them from the pool itself, whenever it waits for a batch.
fn given_away(threads: usize) -> usize {
    threads
}

/// Slabs in memory at most, the one that is being filled apart.
pub(super) fn slabs_under_way(threads: usize) -> usize {
    if threads == 1 { 1 } else { given_away(threads) + 1 }
}
