//! A batch of triangles in the order of the sweep, made on any thread while it is in the cache.

use super::record::SweepRecord;
use crate::soup::{SweepAxis, Triangle, Vertex, smallest_corner};

/// Triangles that came together.
pub(super) struct Batch<V> {
    /// In the order of their keys; of equal keys in that of the input.
    pub(super) records: Vec<SweepRecord<V>>,
    /// The least coordinates along the sweep axis, in the order of the input.
    pub(super) least: Vec<f32>,
    /// See [`entry`].
    entries: Vec<u128>,
}

impl<V> Default for Batch<V> {
    fn default() -> Self {
        Self { records: Vec::new(), least: Vec::new(), entries: Vec::new() }
    }
}

/// What is sorted in place of a triangle: its place, its index, and which corner is the smallest.
/// Less than half as long, and one comparison of integers, which is what sorting is made of.
fn entry<V: Vertex>(triangle: &Triangle<V>, index: usize, axis: SweepAxis) -> u128 {
    let (smallest, place) = smallest_corner(triangle, axis);
    debug_assert!(index < 1 << 30, "a batch is small");
    place.bits() << 32 | (index << 2 | smallest) as u128
}

impl<V: Vertex> Batch<V> {
    /// Takes triangles in place of those before.
    pub(super) fn fill(&mut self, triangles: &[Triangle<V>], axis: SweepAxis) {
        let Self { records, least, entries } = self;
        entries.clear();
        entries.extend(triangles.iter().enumerate().map(|(i, one)| entry(one, i, axis)));
        if !entries.is_sorted() {
            entries.sort_unstable();
        }
        records.clear();
        records.extend(entries.iter().map(|entry| {
            let (index, smallest) = (*entry as u32 as usize >> 2, *entry as usize & 3);
            SweepRecord::turned(&triangles[index], smallest, axis)
        }));
        let mut start = 0;
        for group in entries.chunk_by(|a, b| a >> 32 == b >> 32) {
            let end = start + group.len();
            if group.len() > 1 {
                records[start..end].sort_by_key(SweepRecord::tie_break);
            }
            start = end;
        }
        least.clear();
        let coordinate = axis.index();
        least.extend(triangles.iter().map(|triangle| {
            let [a, b, c] = triangle.0.map(|vertex| vertex.position()[coordinate]);
            a.min(b).min(c)
        }));
    }
}
