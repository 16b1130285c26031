//! A bounded sample of positions from a stream of any length.

/// A sample of positions, the same for any number of threads that took it.
#[derive(Clone, Debug, Default)]
pub struct Sample {
    /// The positions.
    pub points: Vec<[f32; 3]>,
    /// Distinct vertices that the sample stands for, about.
    pub vertices: u64,
}

/// Picks positions by a hash of their index: about 131,072 of however many come.
#[derive(Clone, Debug)]
pub struct Sampler {
    /// An index is in the sample when its hash is at most this.
    threshold: u64,
    picked: Vec<(u64, [f32; 3])>,
}

/// Most points of a sample. Chosen by hand: the count of cells seen twice, on which the estimate
/// rests when cells are many, is then known to 3 % at 5 M cells, and a look takes 4 ms.
const SAMPLE_MAX: usize = 1 << 17;

impl Default for Sampler {
    fn default() -> Self {
        Self { threshold: u64::MAX, picked: Vec::new() }
    }
}

impl Sampler {
    /// Looks at positions with consecutive indices from `first`. Positions that are not finite
    /// are passed over.
    pub fn look(&mut self, first: u64, positions: impl Iterator<Item = [f32; 3]>) {
        for (index, position) in (first..).zip(positions) {
            if hash(index) <= self.threshold && position.iter().all(|c| c.is_finite()) {
                self.picked.push((index, position));
                if self.picked.len() > 2 * SAMPLE_MAX {
                    self.thin_out(2 * SAMPLE_MAX);
                }
            }
        }
    }

    /// Halves the share of indices in the sample until it is small enough.
    fn thin_out(&mut self, count_max: usize) {
        while self.picked.len() > count_max {
            self.threshold /= 2;
            self.picked.retain(|(index, _)| hash(*index) <= self.threshold);
        }
    }

    /// One sample of what all `samplers` looked at; `vertices` is how many distinct vertices
    /// that were.
    #[must_use]
    pub fn finish(samplers: Vec<Self>, vertices: u64) -> Sample {
        let threshold = samplers.iter().map(|s| s.threshold).min().unwrap_or(u64::MAX);
        let picked = samplers.into_iter().flat_map(|s| s.picked);
        let picked = picked.filter(|(index, _)| hash(*index) <= threshold).collect();
        let mut all = Self { threshold, picked };
        all.thin_out(SAMPLE_MAX);
        all.picked.sort_unstable_by_key(|(index, _)| *index);
        Sample { points: all.picked.into_iter().map(|(_, point)| point).collect(), vertices }
    }
}

/// Mixes the bits of an index (the finaliser of MurmurHash3), so that regular meshes are not
/// sampled along their rows.
fn hash(index: u64) -> u64 {
    let mut x = index ^ (index >> 33);
    x = x.wrapping_mul(0xFF51_AFD7_ED55_8CCD);
    x ^= x >> 33;
    x = x.wrapping_mul(0xC4CE_B9FE_1A85_EC53);
    x ^ (x >> 33)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(side: u32) -> Vec<[f32; 3]> {
        (0..side * side).map(|i| [(i % side) as f32, (i / side) as f32, 0.0]).collect()
    }

    #[test]
    fn the_sample_does_not_depend_on_who_took_it() {
        let points = square(1000);
        let mut one = Sampler::default();
        one.look(0, points.iter().copied());
        let mut two = [Sampler::default(), Sampler::default()];
        for (index, chunk) in points.chunks(10_000).enumerate() {
            two[usize::from(index % 3 == 0)].look(index as u64 * 10_000, chunk.iter().copied());
        }
        let [one, two] =
            [vec![one], two.to_vec()].map(|samplers| Sampler::finish(samplers, 1_000_000));
        assert_eq!(one.points, two.points);
        assert!((SAMPLE_MAX / 2..=SAMPLE_MAX).contains(&one.points.len()));
    }
}
