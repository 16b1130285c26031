//! How far a stream of triangles is from the order of a sweep, along all axes at once.
//!
//! Two steps, because only the second needs the triangles in order: the least coordinates of a
//! batch, on any thread; then their lateness.

use super::{Triangle, Vertex};
use crate::geometry::{Bounds, Lateness};

/// Along each axis, the least coordinate of each triangle of a batch.
#[derive(Clone, Debug, Default)]
pub struct Minima([Vec<f32>; 3]);

impl Minima {
    /// Takes the triangles of a batch in place of those before, and adds them to `bounds`.
    /// Coordinates are finite.
    pub fn fill<V: Vertex>(&mut self, triangles: &[Triangle<V>], bounds: &mut Bounds) {
        for (axis, keys) in self.0.iter_mut().enumerate() {
            keys.resize(triangles.len(), 0.0);
            let [min, max] = extent(triangles, axis, keys);
            bounds.min[axis] = bounds.min[axis].min(min);
            bounds.max[axis] = bounds.max[axis].max(max);
        }
    }

    /// Triangles of the batch.
    #[must_use]
    pub fn count(&self) -> usize {
        self.0[0].len()
    }
}

/// Sets `keys` to the triangles' least coordinates along an axis; returns the least and the
/// greatest of all. Coordinates are finite, so plain comparisons do, and are faster.
fn extent<V: Vertex>(triangles: &[Triangle<V>], axis: usize, keys: &mut [f32]) -> [f32; 2] {
    let lesser = |a: f32, b: f32| if b < a { b } else { a };
    let greater = |a: f32, b: f32| if b > a { b } else { a };
    let (mut min, mut max) = (f32::INFINITY, f32::NEG_INFINITY);
    for (triangle, key) in triangles.iter().zip(keys) {
        let [a, b, c] = triangle.0.map(|vertex| vertex.position()[axis]);
        *key = lesser(lesser(a, b), c);
        min = lesser(min, *key);
        max = greater(max, greater(greater(a, b), c));
    }
    [min, max]
}

/// The lateness of triangles along each axis, by their least coordinates.
pub struct OrderMeter([Lateness; 3]);

impl OrderMeter {
    /// Starts a stream, see [`Lateness::new`].
    #[must_use]
    pub fn new(maxima_max: usize) -> Self {
        Self([(); 3].map(|()| Lateness::new(maxima_max)))
    }

    /// Continues the stream.
    pub fn add(&mut self, minima: &Minima) {
        for (lateness, keys) in self.0.iter_mut().zip(&minima.0) {
            lateness.add(keys);
        }
    }

    /// Along each axis, how many triangles the worst one is late, see
    /// [`Lateness::displacement_max`].
    #[must_use]
    pub fn displacement_max(&self) -> [u64; 3] {
        self.0.each_ref().map(Lateness::displacement_max)
    }
}
