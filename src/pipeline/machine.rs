//! How fast this machine is, by a short measurement.

use std::time::Instant;

use super::InputFacts;
use crate::{
    mesh::{ByQuadric, Limit, Mesh, sweep_blocks, unit_of, weld},
    soup::{InputPath, Point, Triangle},
    storage::read_rate,
};

/// What times are reckoned from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Machine {
    /// How many times as long work takes here as on the machine whose figures are in
    /// `expected.rs`.
    pub(super) slowness: f64,
    /// Bytes per second at which the inputs can be read; `None` when that is not known.
    pub(super) read_rate: Option<f64>,
}

/// Inputs smaller than this are done before a measurement would be worth it.
const MEASURED_BYTES_MIN: u64 = 64 << 20;

impl Machine {
    /// The machine that the figures are from.
    pub(super) const REFERENCE: Self = Self { slowness: 1.0, read_rate: None };

    /// Measures this machine in some 30 ms, unless the inputs are small. An input that cannot be read is
    /// found out by those who need it.
    pub(super) fn measure(inputs: &[InputFacts]) -> Self {
        let bytes: Option<u64> = inputs.iter().map(|facts| facts.size_bytes).sum();
        if bytes.is_some_and(|bytes| bytes < MEASURED_BYTES_MIN) {
            return Self::REFERENCE;
        }
        // What is read from a pipe is gone.
        let files = inputs.iter().filter(|facts| facts.repeatable);
        let largest = files.max_by_key(|facts| facts.size_bytes);
        let read_rate = match largest.map(|facts| &facts.path) {
            Some(InputPath::File(path)) => read_rate(path).ok().flatten(),
            _ => None,
        };
        Self { slowness: slowness(), read_rate }
    }
}

/// Squares along a side of the surface that is decimated to see how long it takes.
const SIDE: u32 = 96;
/// Seconds that took on the reference machine.
const REFERENCE_S: f64 = 5.9e-3;
/// It is done so often, and the shortest time counts: something else may have come in between.
const TIMES: u32 = 3;

/// How many times as long as the reference machine this one takes to collapse edges.
fn slowness() -> f64 {
    let triangles = hills();
    let unit = unit_of(&triangles);
    let seconds = (0..TIMES).map(|_| {
        let started = Instant::now();
        let mut patch = weld::<Point, ByQuadric>(&triangles).into_patch();
        patch.unit = unit;
        let mut mesh = Mesh::of_original(patch);
        sweep_blocks(&mut mesh, &Limit { cost: f32::INFINITY, share: 0.1, faces: 0 });
        started.elapsed().as_secs_f64()
    });
    seconds.fold(f64::INFINITY, f64::min) / REFERENCE_S
}

/// A square of hills.
fn hills() -> Vec<Triangle<Point>> {
    let at = |x: u32, y: u32| {
        let [u, v] = [x, y].map(|coordinate| coordinate as f32 * 0.17);
        Point([x as f32, y as f32, 3.0 * (u.sin() * v.cos() + 0.2 * (3.1 * u).cos())])
    };
    let square = |x, y| {
        let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
        [Triangle([a, b, c]), Triangle([a, c, d])]
    };
    (0..SIDE).flat_map(|y| (0..SIDE).flat_map(move |x| square(x, y))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_machine_has_a_speed() {
        assert_eq!(hills().len(), 2 * (SIDE * SIDE) as usize);
        let slowness = slowness();
        assert!(slowness > 0.0 && slowness.is_finite());
    }
}
