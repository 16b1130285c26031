//! What is left of a stretch of the stream: some of it finished, some that can still change.

use std::collections::HashSet;

use glam::Vec3;

use super::{Config, Figures, RESULT, tree::FAMILY};
use crate::{
    error::{Error, Result},
    mesh::{ByDeviation, Mesh, Patch, Settled, decimate_bounded, decimate_to_count, face_bytes},
    soup::{Point, SweepAxis, SweepPlace},
    storage::{Budget, PieceName, Reservation},
};

/// Where a stretch of the stream borders on others.
#[derive(Debug, Default)]
pub(super) struct Border {
    /// Vertices that earlier stretches have and this one may have.
    pub(super) front: Vec<[f32; 3]>,
    /// Place of the first triangle after it: vertices that are not before it may have faces there.
    pub(super) until: Option<SweepPlace>,
}

/// What is left of a stretch of the stream.
pub(super) struct Piece {
    /// Where it belongs.
    pub(super) name: PieceName,
    pub(super) border: Border,
    /// What can still change: within [`OPEN_EDGES`] of a vertex that has faces elsewhere.
    pub(super) open: Patch<ByDeviation>,
    /// What will not; in order.
    pub(super) finished: Vec<Patch<ByDeviation>>,
    pub(super) figures: Figures,
    /// The tolerance that holds.
    pub(super) tolerance: f64,
    /// The memory it holds.
    pub(super) room: Reservation,
}

/// Edges from an interface within which vertices may still be removed once it opens. On a gyroid of 1 M
/// triangles in slabs of 65,536, one edge leaves 0.2 % more than four.
const OPEN_EDGES: usize = 1;

impl Piece {
    /// Decimates a mesh, and takes apart what is finished. What that no longer needs of `room` is
    /// given back.
    pub(super) fn of_mesh(
        mut mesh: Mesh<ByDeviation>,
        config: &Config,
        (name, border): (PieceName, Border),
        mut room: Reservation,
    ) -> Self {
        let tolerance = if config.is_counted {
            decimate_to_count(&mut mesh, &config.bound)
        } else {
            decimate_bounded(&mut mesh, &config.bound);
            config.bound.tolerance
        };
        let Settled { finished, open, complex_vertices } = mesh.settle(OPEN_EDGES);
        let bytes = finished.size_bytes() + open.size_bytes() + size_of_val(&border.front[..]);
        room.shrink_to(bytes as u64);
        let figures = Figures { complex_vertices, ..Figures::default() };
        Self { name, border, open, finished: vec![finished], figures, tolerance, room }
    }

    /// What is left of nothing.
    pub(super) fn nothing() -> Self {
        Self {
            name: (0, 0),
            border: Border::default(),
            open: Patch::default(),
            finished: Vec::new(),
            figures: Figures::default(),
            tolerance: 0.0,
            room: Reservation::default(),
        }
    }

    /// Keeps vertices that nothing is near, each as a face of one point.
    pub(super) fn add_loose(&mut self, loose: &[Vec3]) {
        if loose.is_empty() {
            return;
        }
        let faces = (0..loose.len() as u32).map(|vertex| [vertex; 3]).collect();
        let (positions, carried) = (loose.to_vec(), vec![(); loose.len()]);
        self.finished.push(Patch { positions, carried, faces, ..Patch::default() });
    }

    /// Faces that can still change.
    pub(super) fn open_faces(&self) -> u64 {
        self.open.faces.len() as u64
    }

    /// Joins neighbours, in their order, and decimates what was frozen between them.
    pub(super) fn join(family: Vec<Self>, config: &Config, budget: &Budget) -> Result<Self> {
        let bytes = family.iter().map(|piece| mesh_bytes(&piece.open)).sum();
        let Some(mut room) = budget.reserve(bytes) else {
            let available_bytes = budget.available_bytes();
            return Err(Error::Resource { what: RESULT, needed_bytes: bytes, available_bytes });
        };
        let (mut name, mut border) = ((0, 0), Border::default());
        let mut figures = Figures::default();
        let (mut opens, mut finished) = (Vec::new(), Vec::new());
        for (number, piece) in family.into_iter().enumerate() {
            border.until = piece.border.until;
            if number == 0 {
                border.front = piece.border.front;
                name = (piece.name.0 + 1, piece.name.1 / FAMILY as u64);
            }
            opens.push(piece.open);
            finished.extend(piece.finished);
            figures.add(&piece.figures);
            room.absorb(piece.room);
        }
        let patch = Patch::join(opens, border.is_shared(config.axis));
        let mesh = Mesh::of_open(patch);
        figures.split_vertices += mesh.split_vertices() as u64;
        let mut joined = Self::of_mesh(mesh, config, (name, border), Reservation::default());
        finished.append(&mut joined.finished);
        joined.figures.add(&figures);
        let finished_bytes: usize = finished.iter().map(Patch::size_bytes).sum();
        room.shrink_to((finished_bytes + joined.open.size_bytes()) as u64);
        Ok(Self { finished, room, ..joined })
    }
}

/// Bytes of memory of the mesh that is made of a patch, beside the patch.
fn mesh_bytes(patch: &Patch<ByDeviation>) -> u64 {
    let faces = patch.faces.len() as u64 * face_bytes::<Point, ByDeviation>();
    faces + patch.hung.len() as u64 * HUNG_BYTES
}

/// Bytes that a vertex which hangs takes in a mesh, and the joined patch before that.
const HUNG_BYTES: u64 = 56;

impl Border {
    /// Says of a position whether a vertex there may have faces beyond the border.
    fn is_shared(&self, axis: SweepAxis) -> impl Fn([f32; 3]) -> bool + use<> {
        let bits = |position: &[f32; 3]| position.map(|c| (c + 0.0).to_bits());
        let front: HashSet<[u32; 3]> = self.front.iter().map(bits).collect();
        let until = self.until;
        move |position| {
            front.contains(&bits(&position))
                || until.is_some_and(|until| SweepPlace::of(position, axis) >= until)
        }
    }
}
