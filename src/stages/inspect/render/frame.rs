//! The z-buffer: for each sample of the picture what lies nearest, shared by all threads.
//!
//! A sample is one number, its depth before what is seen there, and the least one wins. So a frame
//! does not depend on the order in which triangles come, nor on how many threads draw them.

use std::sync::atomic::{AtomicU64, Ordering};

use glam::{Vec2, Vec3, Vec3A};
use rayon::prelude::*;

/// The samples of a picture, in square tiles: triangles that follow each other lie side by side, in
/// any direction, and so do their samples in memory.
pub(super) struct Frame {
    pub(super) width: usize,
    pub(super) height: usize,
    tiles_per_row: usize,
    samples: Vec<AtomicU64>,
}

/// Samples along the side of a tile, as a power of two. Half a kilobyte: eight cache lines, each of
/// four by two samples.
const TILE_SHIFT: usize = 3;
const TILE_MASK: usize = (1 << TILE_SHIFT) - 1;

/// A sample that no triangle covers.
const EMPTY: u64 = u64::MAX;

/// What is seen at a sample, packed behind its depth.
///
/// ```text
/// plain    edge 1 | back 1 | x of the normal 15 | y of the normal 15
/// coloured edge 1 | back 1 | light 9 | red 7 | green 7 | blue 7
/// ```
/// A plain sample is lit when the picture is made; with colours there is room for the light only.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Seen(pub(super) u32);

const EDGE: u32 = 1 << 31;
const BACK: u32 = 1 << 30;
/// Greatest of 15 bits with a sign, and of 9 and 7 bits without.
const NORMAL_MAX: f32 = 16383.0;
const LIGHT_MAX: f32 = 511.0;
const COLOR_MAX: f32 = 127.0;

impl Frame {
    /// A frame with nothing in it.
    pub(super) fn new(width: usize, height: usize) -> Self {
        let empty = || AtomicU64::new(EMPTY);
        let [tiles_per_row, tile_rows] = [width, height].map(|side| side.div_ceil(1 << TILE_SHIFT));
        let count = (tiles_per_row * tile_rows) << (2 * TILE_SHIFT);
        let samples = (0..count).into_par_iter().map(|_| empty()).collect();
        Self { width, height, tiles_per_row, samples }
    }

    /// Bytes a frame takes.
    pub(super) fn memory_bytes(width: u64, height: u64) -> u64 {
        let [width, height] = [width, height].map(|side| side.next_multiple_of(1 << TILE_SHIFT));
        width.saturating_mul(height).saturating_mul(size_of::<AtomicU64>() as u64)
    }

    /// A sample.
    #[inline]
    pub(super) fn at(&self, row: usize, column: usize) -> &AtomicU64 {
        let tile = (row >> TILE_SHIFT) * self.tiles_per_row + (column >> TILE_SHIFT);
        let (y, x) = (row & TILE_MASK, column & TILE_MASK);
        let in_tile = (y >> 1) << 4 | (x >> 2) << 3 | (y & 1) << 2 | x & 3;
        &self.samples[tile << (2 * TILE_SHIFT) | in_tile]
    }

    /// Depth and what is seen at a sample, if anything is.
    pub(super) fn sample(&self, row: usize, column: usize) -> Option<(f32, Seen)> {
        let sample = self.at(row, column).load(Ordering::Relaxed);
        let seen = || (f32::from_bits((sample >> 32) as u32), Seen(sample as u32));
        (sample != EMPTY).then(seen)
    }
}

/// The depth of a sample as the part of it that decides: floats that are not negative are in the
/// order of their bits.
#[inline]
pub(super) fn key(depth: f32) -> u64 {
    u64::from(depth.to_bits()) << 32
}

/// Whether something at `key` might be nearer than what is at a sample.
#[inline]
pub(super) fn may_be_seen(sample: &AtomicU64, key: u64) -> bool {
    key <= sample.load(Ordering::Relaxed)
}

/// Shows something at a sample, if nothing nearer is there.
#[inline]
pub(super) fn show(sample: &AtomicU64, key: u64, seen: Seen) {
    sample.fetch_min(key | u64::from(seen.0), Ordering::Relaxed);
}

impl Seen {
    /// A plain surface, of a normal that need not have any length.
    #[inline]
    pub(super) fn plain(normal: Vec3A) -> Self {
        let (normal, back) = towards_viewer(normal);
        let at = |coordinate: f32| (coordinate * NORMAL_MAX + (NORMAL_MAX + 1.5)) as u32;
        Self(back | at(normal.x) << 15 | at(normal.y))
    }

    /// A surface that has a colour, 0 to 255, and is lit by `light` of its normal, 0 to 1.
    #[inline]
    pub(super) fn colored(normal: Vec3A, color: Vec3A, light: impl Fn(Vec3) -> f32) -> Self {
        let (normal, back) = towards_viewer(normal);
        let light = (light(normal.into()) * LIGHT_MAX + 0.5) as u32;
        let color = color * (COLOR_MAX / 255.0) + 0.5;
        let [red, green, blue] = color.to_array().map(|channel| channel as u32);
        Self(back | light.min(LIGHT_MAX as u32) << 21 | red << 14 | green << 7 | blue)
    }

    /// The same on an edge of a triangle.
    pub(super) fn on_edge(self) -> Self {
        Self(self.0 | EDGE)
    }

    pub(super) fn is_edge(self) -> bool {
        self.0 & EDGE != 0
    }

    /// Whether the surface is seen from its back.
    pub(super) fn is_back(self) -> bool {
        self.0 & BACK != 0
    }

    /// The normal of a plain sample, of length 1 and towards the viewer: against z.
    pub(super) fn normal(self) -> Vec3 {
        let at = |bits: u32| ((bits & 0x7FFF) as f32 - (NORMAL_MAX + 1.0)) / NORMAL_MAX;
        let across = Vec2::new(at(self.0 >> 15), at(self.0));
        across.extend(-(1.0 - across.length_squared()).max(0.0).sqrt())
    }

    /// Light and colour of a coloured sample, each 0 to 1.
    pub(super) fn light_and_color(self) -> (f32, Vec3) {
        let channel = |shift: u32| (self.0 >> shift & 0x7F) as f32 / COLOR_MAX;
        let light = (self.0 >> 21 & 0x1FF) as f32 / LIGHT_MAX;
        (light, Vec3::new(channel(14), channel(7), channel(0)))
    }
}

/// A normal of length 1 that does not point away from the viewer, and the mark of the back if it
/// had to be turned for that.
#[inline]
fn towards_viewer(normal: Vec3A) -> (Vec3A, u32) {
    let length_sq = normal.length_squared();
    // Triangles without area or too small for squares: as if they faced the viewer.
    if !(length_sq > 0.0 && length_sq < f32::INFINITY) {
        return (Vec3A::NEG_Z, 0);
    }
    let normal = normal * length_sq.sqrt().recip();
    if normal.z > 0.0 { (-normal, BACK) } else { (normal, 0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_wins_whatever_comes_first() {
        let (near, far) = (Seen::plain(Vec3A::NEG_Z), Seen::plain(Vec3A::new(0.6, 0.0, -0.8)));
        for order in [[(1.0, near), (2.0, far)], [(2.0, far), (1.0, near)]] {
            let frame = Frame::new(2, 1);
            assert_eq!(frame.sample(0, 1), None);
            for (depth, seen) in order {
                show(frame.at(0, 1), key(depth), seen);
            }
            assert_eq!(frame.sample(0, 1), Some((1.0, near)));
            assert!(may_be_seen(frame.at(0, 1), key(0.5)));
            assert!(!may_be_seen(frame.at(0, 1), key(1.5)));
        }
    }

    #[test]
    fn normals_come_back_towards_the_viewer() {
        let normals = [[0.0, 0.0, -1.0], [3.0, 4.0, -1.0], [-1.0, 0.0, 0.0], [0.1, -0.7, 2.0]];
        for normal in normals.map(Vec3A::from_array) {
            let seen = Seen::plain(normal);
            let expected = normal.normalize() * if normal.z > 0.0 { -1.0 } else { 1.0 };
            let error = (Vec3::from(expected) - seen.normal()).length();
            assert!(error < 0.02, "{normal} became {}", seen.normal());
            assert_eq!((seen.is_back(), seen.is_edge()), (normal.z > 0.0, false));
            assert!(seen.on_edge().is_edge());
        }
        assert_eq!(Seen::plain(Vec3A::ZERO).normal(), Vec3::NEG_Z);
    }

    #[test]
    fn colours_and_their_light_come_back() {
        let seen = Seen::colored(Vec3A::Z, Vec3A::new(255.0, 0.0, 128.0), |_| 0.5);
        let (light, color) = seen.light_and_color();
        assert!((light - 0.5).abs() < 2e-3 && (color - Vec3::new(1.0, 0.0, 0.5)).length() < 6e-3);
        assert!(seen.is_back() && !seen.is_edge());
        assert!(Seen::colored(Vec3A::Z, Vec3A::ZERO, |_| 1.0).light_and_color().0 == 1.0);
    }
}
