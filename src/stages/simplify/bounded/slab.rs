//! One slab: from triangles to what the bound leaves of them.

use glam::Vec3;

use super::{Config, Figures, Piece, piece::Border};
use crate::{
    mesh::{Mesh, weld},
    soup::{Slab, SweepPlace, Vertex},
    storage::Reservation,
};

/// Decimates a slab; vertices that have faces in other slabs stay. The slab's memory is `room`, as
/// long as that takes.
pub(super) fn decimate<V: Vertex>(
    slab: Slab<V>,
    config: &Config,
    unit: f32,
    room: Reservation,
) -> Piece {
    let Slab { index, triangles, front, until } = slab;
    let mut welded = weld(&triangles);
    drop(triangles);
    let mut shared: Vec<u32> = front.iter().filter_map(|p| welded.find(*p)).collect();
    if let Some(until) = until {
        let positions = welded.patch.positions.iter().zip(0..);
        let is_open = |p: &Vec3| SweepPlace::of(p.to_array(), config.axis) >= until;
        shared.extend(positions.filter(|(p, _)| is_open(p)).map(|(_, vertex)| vertex));
    }
    shared.sort_unstable();
    shared.dedup();
    welded.patch.shared = shared;
    welded.patch.unit = unit;
    if config.bound.limits.normal.is_some() {
        welded.patch.add_normals();
    }
    let degenerate = welded.degenerate;
    // Only triangles that are left out can leave a vertex without any.
    let loose = if degenerate > 0 { welded.patch.loose() } else { Vec::new() };
    let mut mesh = Mesh::of_original(welded.into_patch());
    // A tolerance that rises is nothing to go by.
    let tolerance = if config.is_counted { 0.0 } else { config.bound.tolerance };
    let far = mesh.hang_loose(&loose, tolerance);
    let figures = Figures {
        degenerate,
        loose_vertices: far.len() as u64,
        split_vertices: mesh.split_vertices() as u64,
        ..Figures::default()
    };
    let mut piece = Piece::of_mesh(mesh, config, ((0, index), Border { front, until }), room);
    piece.figures.add(&figures);
    piece.add_loose(&far);
    piece
}
