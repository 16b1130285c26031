//! What many distances amount to, and how well the samples tell.

/// Distances of samples by area, in model units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Statistics {
    /// Samples, at least 1.
    pub count: u64,
    /// The root of the mean square.
    pub rms: f64,
    /// The mean.
    pub mean: f64,
    /// Half of the area is no farther away than this.
    pub p50: f64,
    /// 95 % of the area.
    pub p95: f64,
    /// 99 % of the area.
    pub p99: f64,
    /// The greatest of the samples; vertices may be farther.
    pub max: f64,
    /// The index of the first sample that far away.
    pub max_index: usize,
    /// What is not known of them.
    pub confidence: Confidence,
}

/// How far from the truth statistics of samples can be, with 95 % confidence.
///
/// The errors are those of samples drawn independently; ours are spread evenly, which makes them
/// smaller.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Confidence {
    /// The mean is known to plus or minus this.
    pub mean_error: f64,
    /// The root mean square is known to plus or minus this.
    pub rms_error: f64,
    /// The share of the area, at most, that is farther away than [`Statistics::max`]: had it been
    /// more, one of the samples would have hit it.
    pub unseen_share: f64,
}

/// Standard deviations to both sides that hold 95 % of a normal distribution.
const DEVIATIONS_95: f64 = 1.959_963_984_540_054;

impl Statistics {
    /// Of distances in the order of the samples, at least one; leaves them in another order.
    pub(super) fn of(distances: &mut [f64]) -> Self {
        let count = distances.len() as f64;
        let (mut sum, mut sum_sq) = (0.0, 0.0);
        let (mut max, mut max_index) = (f64::NEG_INFINITY, 0);
        for (index, distance) in distances.iter().copied().enumerate() {
            sum += distance;
            sum_sq += distance * distance;
            if distance > max {
                (max, max_index) = (distance, index);
            }
        }
        let (mean, mean_sq) = (sum / count, sum_sq / count);
        let rms = mean_sq.sqrt();
        let (mut spread, mut spread_sq) = (0.0, 0.0);
        for distance in distances.iter() {
            spread += (distance - mean).powi(2);
            spread_sq += (distance * distance - mean_sq).powi(2);
        }
        let error = |spread: f64| DEVIATIONS_95 * (spread / count).sqrt() / count.sqrt();
        let confidence = Confidence {
            mean_error: error(spread),
            // The error of a root is that of the square, divided by twice the root.
            rms_error: if rms > 0.0 { error(spread_sq) / (2.0 * rms) } else { 0.0 },
            unseen_share: -(0.05_f64.ln() / count).exp_m1(),
        };
        let [p50, p95, p99] = [0.5, 0.95, 0.99].map(|share| percentile(distances, share));
        let count = distances.len() as u64;
        Self { count, rms, mean, p50, p95, p99, max, max_index, confidence }
    }
}

/// The least of the distances that so large a share of them does not exceed.
fn percentile(distances: &mut [f64], share: f64) -> f64 {
    let rank = (share * distances.len() as f64).ceil() as usize;
    let place = rank.clamp(1, distances.len()) - 1;
    *distances.select_nth_unstable_by(place, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statistics_are_those_of_the_definition() {
        let mut distances: Vec<f64> = (0..100).map(|i| f64::from(i * 37 % 100) + 1.0).collect();
        let statistics = Statistics::of(&mut distances);
        assert_eq!((statistics.mean, statistics.max, statistics.count), (50.5, 100.0, 100));
        assert_eq!(statistics.max_index, 27);
        assert_eq!([statistics.p50, statistics.p95, statistics.p99], [50.0, 95.0, 99.0]);
        assert!((statistics.rms - 3383.5_f64.sqrt()).abs() < 1e-12);
        let confidence = statistics.confidence;
        // 1.96 times 28.87 by the root of 100.
        assert!((confidence.mean_error - 5.657_7).abs() < 1e-3, "{confidence:?}");
        // The squares spread by 3009.2 around 3383.5; by twice the root of that.
        assert!((confidence.rms_error - 5.069_7).abs() < 1e-3, "{confidence:?}");
        assert!((confidence.unseen_share - 0.029_5).abs() < 1e-4, "{confidence:?}");
    }

    #[test]
    fn equal_distances_are_known_exactly() {
        for distance in [0.0, 2.0] {
            let statistics = Statistics::of(&mut [distance; 7]);
            assert_eq!(
                (statistics.rms, statistics.mean, statistics.p99),
                (distance, distance, distance)
            );
            assert_eq!(
                (statistics.confidence.mean_error, statistics.confidence.rms_error),
                (0.0, 0.0)
            );
            assert_eq!(statistics.max_index, 0);
        }
    }
}
