//! A bounded sample of positions from a stream of any length.

/// A sample of positions: the same for any number of threads that took it, and any order.
#[derive(Clone, Debug, Default)]
pub struct Sample {
    /// The positions, each once.
    pub points: Vec<[f32; 3]>,
    /// Distinct vertices that the sample stands for, about.
    pub vertices: u64,
    /// The same, as the sample itself tells: by how many positions there are to a share of all
    /// hashes. Follows from the positions alone.
    pub distinct: u64,
}

/// Picks positions by a hash of them: about 131,072 of however many come.
#[derive(Clone, Debug)]
pub struct Sampler {
    /// A position is in the sample when its hash is at most this.
    threshold: u64,
    picked: Vec<Picked>,
}

/// The hash of a position, and the position.
type Picked = (u64, [f32; 3]);

/// Most points of a sample. Chosen by hand: the count of cells seen twice, on which the estimate
/// rests when cells are many, is then known to 3 % at 5 M cells, and a look takes 4 ms.
const SAMPLE_MAX: usize = 1 << 17;

/// So many times that are picked before it is worth looking for duplicates: corners of a soup are
/// about six to a vertex.
const CROWD: usize = 4;

impl Default for Sampler {
    fn default() -> Self {
        Self { threshold: u64::MAX, picked: Vec::new() }
    }
}

impl Sampler {
    /// Looks at positions. Those that are not finite are passed over.
    pub fn look(&mut self, positions: impl Iterator<Item = [f32; 3]>) {
        for position in positions {
            let hash = hash(position);
            if hash <= self.threshold && position.iter().all(|c| c.is_finite()) {
                // Before, so that the list is never twice as large as it may be full.
                if self.picked.len() == CROWD * SAMPLE_MAX {
                    self.thin_out(SAMPLE_MAX);
                }
                self.picked.push((hash, position));
            }
        }
    }

    /// Halves the share of positions in the sample until it is small enough.
    fn thin_out(&mut self, count_max: usize) {
        let by_hash = |(hash, _): &Picked| *hash;
        // Mostly the half with the larger hashes goes: it is not put in order for nothing.
        let half = self.threshold / 2;
        self.picked.sort_unstable_by_key(|picked| by_hash(picked) > half);
        let (smaller, larger) = {
            let count = self.picked.partition_point(|picked| by_hash(picked) <= half);
            self.picked.split_at_mut(count)
        };
        smaller.sort_unstable_by_key(by_hash);
        if smaller.chunk_by(|a, b| a.0 == b.0).count() > count_max {
            let count = smaller.len();
            self.picked.truncate(count);
        } else {
            larger.sort_unstable_by_key(by_hash);
        }
        // Of two positions with one hash one is lost: among 10 M vertices, once in 400,000 meshes.
        self.picked.dedup_by_key(|picked| by_hash(picked));
        while self.picked.len() > count_max {
            self.threshold /= 2;
            self.picked.truncate(self.picked.partition_point(|(hash, _)| *hash <= self.threshold));
        }
    }

    /// One sample of what all `samplers` looked at; `vertices` is how many distinct vertices
    /// that were.
    #[must_use]
    pub fn finish(samplers: Vec<Self>, vertices: u64) -> Sample {
        let threshold = samplers.iter().map(|s| s.threshold).min().unwrap_or(u64::MAX);
        let picked = samplers.into_iter().flat_map(|s| s.picked);
        let picked = picked.filter(|(hash, _)| *hash <= threshold).collect();
        let mut all = Self { threshold, picked };
        all.thin_out(SAMPLE_MAX);
        let share = all.threshold as f64 / u64::MAX as f64;
        let distinct = (all.picked.len() as f64 / share) as u64;
        let points = all.picked.into_iter().map(|(_, point)| point).collect();
        Sample { points, vertices, distinct }
    }
}

/// Mixes the bits of a position, −0 as +0, with the finaliser of `MurmurHash3` at the end: regular
/// meshes are not to be sampled along their rows.
#[inline]
fn hash(position: [f32; 3]) -> u64 {
    let [a, b, c] = position.map(|coordinate| u64::from((coordinate + 0.0).to_bits()));
    let x = (a | b << 32).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ c.rotate_left(23);
    let x = (x ^ (x >> 33)).wrapping_mul(0xFF51_AFD7_ED55_8CCD);
    let x = (x ^ (x >> 33)).wrapping_mul(0xC4CE_B9FE_1A85_EC53);
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
        one.look(points.iter().copied());
        let mut two = [Sampler::default(), Sampler::default()];
        for (index, chunk) in points.chunks(10_000).enumerate() {
            // Backwards, and some of them again.
            let again = chunk.iter().rev().chain(&chunk[..index]).copied();
            two[usize::from(index % 3 == 0)].look(again);
        }
        let [one, two] =
            [vec![one], two.to_vec()].map(|samplers| Sampler::finish(samplers, 1_000_000));
        assert_eq!(one.points, two.points);
        assert!((990_000..1_010_000).contains(&one.distinct), "{}", one.distinct);
        assert!((SAMPLE_MAX / 2..=SAMPLE_MAX).contains(&one.points.len()));
    }
}
