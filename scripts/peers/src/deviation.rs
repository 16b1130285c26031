//! How far one surface (or curve) is from another: samples spread evenly over the
//! first, each to the nearest point of the second. The same figures for the same
//! seed on any number of threads.

use crate::bvh::Bvh;
use crate::primitive::{Point, Primitive};
use crate::random::Random;
use rayon::iter::{IntoParallelIterator, ParallelIterator};

/// Samples that share a random stream and are summed together.
const CHUNK_COUNT: u64 = 4096;

/// Distances one way, in model units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Deviation {
    /// The root of the mean of the squared distances.
    pub rms: f64,
    /// The mean distance.
    pub mean: f64,
    /// The largest distance among the samples, a lower bound of the true one.
    pub max: f64,
    /// The sample with the largest distance.
    pub max_at: Point,
}

impl Deviation {
    /// Joins the two ways: both count the same for the means, the larger for the max.
    #[must_use]
    pub fn symmetric(self, other: Self) -> Self {
        let larger = if self.max >= other.max { self } else { other };
        Self {
            rms: f64::midpoint(self.rms * self.rms, other.rms * other.rms).sqrt(),
            mean: f64::midpoint(self.mean, other.mean),
            ..larger
        }
    }
}

/// Measures from samples of `from`, evenly by area or length, to the nearest points
/// of `to`. Sample `i` of `n` lies in the `i`-th of `n` equal shares of the surface,
/// in the order of the tree, which makes sums steadier than free samples would.
#[must_use]
pub fn measure<P: Primitive>(
    from: &Bvh<P>,
    to: &Bvh<P>,
    samples: u64,
    seed: u64,
) -> Option<Deviation> {
    let shares = Shares::new(from.primitives());
    if samples == 0 || shares.total() <= 0.0 {
        return None;
    }
    let chunks: Vec<Sums> = (0..samples.div_ceil(CHUNK_COUNT))
        .into_par_iter()
        .map(|chunk| {
            let range = chunk * CHUNK_COUNT..((chunk + 1) * CHUNK_COUNT).min(samples);
            let mut random = Random::new(seed, chunk);
            let mut sums = Sums::default();
            let mut nearest = 0;
            for i in range {
                let share = (i as f64 + random.unit()) / samples as f64;
                let primitive = from.primitives()[shares.find(share)];
                let point = primitive.point(random.unit(), random.unit());
                let distance_sq;
                (distance_sq, nearest) = to.nearest(point, nearest);
                sums.add(distance_sq, point);
            }
            sums
        })
        .collect();
    // One after the other, so that rounding does not depend on the threads.
    let sums = chunks.into_iter().fold(Sums::default(), Sums::join);
    let count = samples as f64;
    Some(Deviation {
        rms: (sums.squares / count).sqrt(),
        mean: sums.distances / count,
        max: sums.max_sq.sqrt(),
        max_at: sums.max_at,
    })
}

#[derive(Default)]
struct Sums {
    distances: f64,
    squares: f64,
    max_sq: f64,
    max_at: Point,
}

impl Sums {
    fn add(&mut self, distance_sq: f64, point: Point) {
        self.distances += distance_sq.sqrt();
        self.squares += distance_sq;
        if distance_sq > self.max_sq {
            self.max_sq = distance_sq;
            self.max_at = point;
        }
    }

    fn join(self, other: Self) -> Self {
        let larger = if other.max_sq > self.max_sq { &other } else { &self };
        Self {
            distances: self.distances + other.distances,
            squares: self.squares + other.squares,
            max_sq: larger.max_sq,
            max_at: larger.max_at,
        }
    }
}

/// Where each primitive's share of the whole measure ends.
struct Shares(Vec<f64>);

impl Shares {
    fn new(primitives: &[impl Primitive]) -> Self {
        let mut sum = 0.0;
        let add = |p| {
            sum += Primitive::measure(p);
            sum
        };
        Self(primitives.iter().map(add).collect())
    }

    fn total(&self) -> f64 {
        self.0.last().copied().unwrap_or(0.0)
    }

    /// Returns the primitive at a place in `[0, 1)`, never one without measure.
    fn find(&self, share: f64) -> usize {
        let wanted = share * self.total();
        self.0.partition_point(|&end| end <= wanted).min(self.0.len() - 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::primitive::{Segment, Triangle};

    /// A unit square and a copy of half of it, a quarter above:
    /// ```text
    ///  +--+      (upper copy: the lower triangle only)
    ///  |\ |
    ///  +--+
    /// ```
    #[test]
    fn the_two_ways_differ_when_one_surface_is_part_of_the_other() {
        let half = |z| Triangle([[0.0, 0.0, z], [1.0, 0.0, z], [0.0, 1.0, z]]);
        let rest = Triangle([[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
        let whole = Bvh::new(&[half(0.0), rest]).expect("two");
        let part = Bvh::new(&[half(0.25)]).expect("one");
        let back = measure(&part, &whole, 10_000, 1).expect("has area");
        assert!((back.rms - 0.25).abs() < 1e-9 && (back.max - 0.25).abs() < 1e-9);
        let there = measure(&whole, &part, 10_000, 1).expect("has area");
        // The far corner is √½ beside the diagonal and ¼ below.
        assert!(there.max > 0.72 && there.max < 0.7501, "{there:?}");
        let both = there.symmetric(back);
        assert!(both.max.to_bits() == there.max.to_bits() && both.rms > back.rms);
    }

    #[test]
    fn segments_are_sampled_by_length() {
        let long = Segment([[0.0; 3], [9.0, 0.0, 0.0]]);
        let short = Segment([[0.0, 1.0, 0.0], [1.0, 1.0, 0.0]]);
        let both = Bvh::new(&[long, short]).expect("two");
        let one = Bvh::new(&[long]).expect("one");
        let deviation = measure(&both, &one, 100_000, 1).expect("has length");
        assert!((deviation.mean - 0.1).abs() < 1e-3, "{deviation:?}");
    }
}
