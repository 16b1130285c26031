//! One slab: from triangles to what is left of them.

use super::piece::{Extent, Piece};
use crate::{
    mesh::{Limit, Mesh, Metric, sweep_blocks, weld},
    soup::{Slab, SweepAxis, SweepPlace, Vertex},
    storage::Reservation,
};

/// Decimates a slab to `limit`; vertices that have faces in other slabs stay. The slab's memory is
/// `room`, as long as that takes.
pub(super) fn decimate<V: Vertex, M: Metric>(
    slab: Slab<V>,
    axis: SweepAxis,
    (limit, unit): (&Limit, f32),
    room: Reservation,
) -> Piece<M> {
    let Slab { index, triangles, front, until } = slab;
    let count = triangles.len() as u64;
    let mut welded = weld(&triangles);
    drop(triangles);
    let mut shared: Vec<u32> = front.iter().filter_map(|p| welded.find(*p)).collect();
    if let Some(until) = until {
        let positions = welded.patch.positions.iter().zip(0..);
        let is_open = |position: &glam::Vec3| SweepPlace::of(position.to_array(), axis) >= until;
        shared.extend(positions.filter(|(p, _)| is_open(p)).map(|(_, vertex)| vertex));
    }
    shared.sort_unstable();
    shared.dedup();
    let degenerate = welded.degenerate;
    welded.patch.shared = shared;
    welded.patch.unit = unit;
    let mut mesh = Mesh::of_original(welded.into_patch());
    sweep_blocks(&mut mesh, limit);
    Piece::of_mesh(
        mesh,
        Extent { level: 0, index, triangles: count, degenerate, split: 0, front, until },
        room,
    )
}
