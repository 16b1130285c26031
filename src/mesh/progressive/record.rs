//! A mesh decimated to a base, with every collapse recorded.
//!
//! In rounds: each takes some of the cheapest collapses that leave each other's surroundings alone,
//! so that their splits can be undone together, and any part of them.

use glam::Vec3;

use super::round::Round;
use crate::{
    mesh::{Mesh, Metric, surface::NONE},
    progress::{Cancelled, Meter},
};

/// A collapse as it was done.
#[derive(Clone, Copy, Debug)]
pub(super) struct Collapse {
    pub(super) removed: u32,
    pub(super) kept: u32,
    /// The third vertices of the faces that went: of that which has the kept vertex as its next one,
    /// seen from the removed vertex, and of that which has it before.
    pub(super) apexes: [Option<u32>; 2],
    /// Where the kept vertex was, and where it is now.
    pub(super) places: [[u32; 3]; 2],
}

/// Colours of a collapse: of the kept vertex before and after, and of the removed one.
pub(super) type Colors = [[u8; 4]; 3];

/// What is left of a mesh, and how it came to that.
pub struct Recording {
    /// In the order they were done.
    pub(super) collapses: Vec<Collapse>,
    /// Beside them; empty without colours.
    pub(super) colors: Vec<Colors>,
    /// The end of each round in `collapses`.
    pub(super) rounds: Vec<usize>,
    /// By vertex of the mesh, where it was last.
    pub(super) positions: Vec<[u32; 3]>,
    /// The colours of vertices as they are now; empty without.
    pub(super) last_colors: Vec<[u8; 4]>,
    /// What is left.
    pub(super) faces: Vec<[u32; 3]>,
    /// Vertices that were added because several sheets of the surface touched in one.
    pub split_vertices: usize,
    /// Vertices left alone because their faces are no fan.
    pub complex_vertices: usize,
}

/// Bytes of memory that a collapse takes in a recording, for each of the two faces that go.
pub const RECORD_FACE_BYTES: u64 = (size_of::<Collapse>() + size_of::<Colors>()) as u64 / 2;

/// Decimates a mesh whose positions are whole numbers, not negative and below 2^bits, to `faces` faces
/// or until no collapse is legal; kept vertices stay on whole numbers.
///
/// # Errors
/// Cancellation; the meter counts the faces that went.
pub fn record<M: Metric>(
    mesh: Mesh<M>,
    bits: u32,
    faces: usize,
    meter: &Meter,
) -> Result<Recording, Cancelled> {
    let vertices = mesh.positions_count();
    let mut recording = Recording {
        collapses: Vec::with_capacity(vertices),
        colors: Vec::new(),
        rounds: Vec::new(),
        positions: Vec::new(),
        last_colors: Vec::new(),
        faces: Vec::new(),
        split_vertices: mesh.split_vertices(),
        complex_vertices: mesh.complex_vertices(),
    };
    let mut round = Round::new(mesh, bits);
    while round.mesh.faces_left() > faces {
        let before = round.mesh.faces_left();
        if !round.run(faces, &mut recording) {
            break;
        }
        meter.add((before - round.mesh.faces_left()) as u64)?;
    }
    let mesh = round.mesh;
    recording.positions = (0..vertices as u32).map(|vertex| steps(mesh.position(vertex))).collect();
    recording.last_colors = mesh.colors.iter().map(crate::mesh::Color::mean).collect();
    recording.faces = mesh.faces_by_vertex();
    Ok(recording)
}

/// A position on whole numbers.
#[inline]
pub(super) fn steps(position: Vec3) -> [u32; 3] {
    position.to_array().map(|coordinate| coordinate as u32)
}

impl<M: Metric> Mesh<M> {
    /// Vertices, those that are gone included.
    fn positions_count(&self) -> usize {
        self.spots.len()
    }

    /// What is left of the faces, in the order of their first vertices.
    fn faces_by_vertex(&self) -> Vec<[u32; 3]> {
        let mut faces = Vec::with_capacity(self.faces_left);
        for vertex in 0..self.spots.len() as u32 {
            let ring = self.rings.of(vertex).iter();
            let first = ring.filter(|wing| vertex < wing.next && vertex < wing.prev);
            faces.extend(first.map(|wing| [vertex, wing.next, wing.prev]));
        }
        faces
    }
}

/// An apex if it is one.
#[inline]
pub(super) fn known(apex: u32) -> Option<u32> {
    (apex != NONE).then_some(apex)
}
