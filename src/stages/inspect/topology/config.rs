//! What topology needs to know, and the sizes of slabs.

use crate::soup::SweepAxis;

/// What topology needs to know.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// The axis the stream is sorted along.
    pub axis: SweepAxis,
    /// Triangles of the stream, about, if that is known: for the display only.
    pub triangles: Option<u64>,
    /// New triangles of a slab, at least; a hint, [`NEW_TRIANGLES_MIN`] unless slabs are to be
    /// small. It does not change what comes out.
    pub new_triangles_min: usize,
    /// Bytes of memory to hold, reserved by the caller. The front needs 300 for each of its
    /// triangles; with more, slabs are larger and worked on in parallel.
    pub memory_bytes: u64,
}

/// A good value of [`Config::new_triangles_min`]: what is looked up stays in a second-level cache.
pub const NEW_TRIANGLES_MIN: usize = 1 << 15;

/// Least value of [`Config::memory_bytes`] that is of use: a front of some thousand triangles.
pub const MEMORY_BYTES_MIN: u64 = 4 << 20;

/// What [`Error::Resource`](crate::Error::Resource) names when the front does not fit: another axis
/// may have a smaller one.
pub const FRONT: &str = "the front of the sweep";

/// New triangles for each one of the front: those of the front are looked at once more in every
/// slab.
pub(super) const NEW_PER_FRONT: usize = 3;

/// Where memory is short, a slab may have so many triangles of the front for each new one.
pub(super) const FRONT_PER_NEW_MAX: usize = 8;

/// Triangles of a slab at most: its corners are counted with 32 bits.
pub(super) const SLAB_TRIANGLES_MAX: u64 = 1 << 28;

/// Bytes of a triangle of a slab that is worked on, where no two triangles share a vertex: its
/// corners, their vertices' numbers, positions, slots in the table, rings and sets, and as much
/// again of positions as a growing array has spare.
pub(super) const SLAB_TRIANGLE_BYTES: u64 = 36 + 12 + 36 + 36 + 24 + 24 + 12 + 36;

/// Bytes of a triangle in the slab that is being filled.
pub(super) const WAITING_TRIANGLE_BYTES: u64 = 36;

/// Slabs that are worked on or wait for a thread, at most.
pub(super) fn slabs_under_way(threads: usize) -> u64 {
    if threads == 1 { 1 } else { threads as u64 + 1 }
}
