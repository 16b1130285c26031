//! What is left of a stretch of the stream, and joining such pieces.

use std::collections::HashSet;

use crate::{
    mesh::{Mesh, Metric, Patch},
    soup::{SweepAxis, SweepPlace},
    storage::Reservation,
};

/// Which stretch of the stream a piece is of.
#[derive(Debug)]
pub(super) struct Extent {
    /// 0 for a slab; one more than that of the pieces that were joined to this one.
    pub(super) level: u32,
    /// Counts the pieces of a level.
    pub(super) index: u64,
    /// Triangles of the stream.
    pub(super) triangles: u64,
    /// Those of them that were left out because two of their corners were one point.
    pub(super) degenerate: u64,
    /// Vertices that were added where sheets touch.
    pub(super) split: u64,
    /// Vertices that earlier pieces have and this one may have.
    pub(super) front: Vec<[f32; 3]>,
    /// Place of the first triangle after it: vertices that are not before it may have faces there.
    pub(super) until: Option<SweepPlace>,
}

/// What is left of a stretch of the stream.
pub(super) struct Piece<M: Metric> {
    pub(super) extent: Extent,
    /// Its frozen vertices are the shared ones.
    pub(super) patch: Patch<M>,
    /// What it would cost to remove some of its vertices.
    pub(super) costs: Vec<f32>,
    /// The memory it holds.
    pub(super) room: Reservation,
}

/// Of each so many vertices one is asked for its cost: a few hundred of a piece.
const COST_STEP: usize = 128;

impl<M: Metric> Piece<M> {
    /// What is left in a mesh; what it no longer needs of `room` is given back.
    pub(super) fn of_mesh(mut mesh: Mesh<M>, mut extent: Extent, mut room: Reservation) -> Self {
        extent.split += mesh.split_vertices() as u64;
        let costs = mesh.sample_costs(COST_STEP);
        let patch = mesh.into_patch();
        let front_bytes = extent.front.len() * size_of::<[f32; 3]>();
        room.shrink_to((patch.size_bytes() + front_bytes) as u64);
        Self { extent, patch, costs, room }
    }

    /// Faces that are left.
    pub(super) fn faces(&self) -> u64 {
        self.patch.faces.len() as u64
    }

    /// Joins neighbours, in their order. Vertices between them are no longer frozen.
    pub(super) fn join(pieces: Vec<Self>, axis: SweepAxis) -> Joined<M> {
        let (mut extents, mut patches) = (Vec::new(), Vec::new());
        let mut room = Reservation::default();
        for piece in pieces {
            extents.push(piece.extent);
            patches.push(piece.patch);
            room.absorb(piece.room);
        }
        let extent = Extent::around(extents);
        let bits = |position: &[f32; 3]| position.map(|c| (c + 0.0).to_bits());
        let front: HashSet<[u32; 3]> = extent.front.iter().map(bits).collect();
        let is_shared = |position: [f32; 3]| {
            front.contains(&bits(&position))
                || extent.until.is_some_and(|until| SweepPlace::of(position, axis) >= until)
        };
        let patch = Patch::join(patches, is_shared);
        Joined { extent, patch, room }
    }
}

/// Pieces joined to one, not yet a mesh.
pub(super) struct Joined<M: Metric> {
    pub(super) extent: Extent,
    pub(super) patch: Patch<M>,
    /// The memory they held.
    pub(super) room: Reservation,
}

impl Extent {
    fn around(extents: Vec<Self>) -> Self {
        let (level, index) = extents.first().map_or((0, 0), |first| (first.level, first.index));
        let mut whole = Self {
            level: level + 1,
            index: index / super::tree::FAMILY as u64,
            triangles: 0,
            degenerate: 0,
            split: 0,
            front: Vec::new(),
            until: None,
        };
        for (number, extent) in extents.into_iter().enumerate() {
            whole.triangles += extent.triangles;
            whole.degenerate += extent.degenerate;
            whole.split += extent.split;
            whole.until = extent.until;
            if number == 0 {
                whole.front = extent.front;
            }
        }
        whole
    }
}
