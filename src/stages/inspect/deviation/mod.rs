//! How far one surface is from another: of points spread over the one by area, and of its vertices,
//! the distances to the nearest point of the other.
//!
//! Both may be larger than memory. The points wait in memory in rounds while the triangles of the
//! other surface pass by, see [`distances`].
//!
//! Nothing is said of the way back: that is another call.

mod block;
mod draw;
mod nearest;
mod queries;
mod statistics;
mod survey;
#[cfg(test)]
mod tests;
mod vertices;

pub use nearest::{Target, distances};
pub use statistics::{Confidence, Statistics};
pub use survey::{Surface, survey};

use self::{
    draw::Sampling,
    queries::Queries,
    vertices::{COVER_BYTES_PER_POINT, Cover, farthest_vertex, shift},
};
use crate::{
    error::{Error, Result},
    progress::Monitor,
    soup::Vertex,
    storage::Budget,
};

/// How a deviation is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Points spread over the surface by area, at least 1. 8 bytes each are held to the end.
    pub samples: u64,
    /// Which points: the same seed gives the same ones.
    pub seed: u64,
}

/// How far a surface is from another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// Greatest distance of all samples and all vertices.
    pub max: f64,
    /// Where on the surface that is, in model units: of equals, the first sample, or else the vertex
    /// with the least coordinates.
    pub max_at: [f64; 3],
    /// Of the samples by area alone: vertices would weigh fine parts more.
    pub statistics: Statistics,
}

/// Share of what memory is left that samples may take, with what it takes to measure them.
const SAMPLES_SHARE: f64 = 0.9;
/// Samples that are worked on at least, whatever the memory.
const SAMPLES_MIN: u64 = 1 << 12;
const BYTES_PER_SAMPLE: u64 = 24 + Queries::BYTES_PER_POINT + 2 * 8;

/// Measures how far `from` is from `target`. Both have triangles, and `from` has an area.
///
/// Takes two passes over `from` and two over the target; more of all where the points do not fit in
/// the memory at once. The result is the same for any memory and number of threads.
///
/// # Errors
/// [`Error::Resource`] when the budget cannot hold a distance for each sample, what reading the
/// surfaces fails with, cancellation.
pub fn deviation<V: Vertex>(
    from: &Surface<V>,
    target: &Target<'_, '_, V>,
    config: &Config,
    budget: &Budget,
    monitor: &Monitor,
) -> Result<Outcome> {
    assert!(config.samples > 0 && from.area > 0.0, "{config:?}, {} of area", from.area);
    let sampling = Sampling { count: config.samples, seed: config.seed };
    let all_bytes = config.samples.saturating_mul(size_of::<f64>() as u64);
    let few = config.samples <= SAMPLES_MIN;
    let all_room = budget.reserve(all_bytes).or_else(|| few.then(|| budget.reserve_share(0.0, 0)));
    let _all_room = all_room.ok_or_else(|| Error::Resource {
        what: "a distance for each sample",
        needed_bytes: all_bytes,
        available_bytes: budget.available_bytes(),
    })?;
    let shift = shift(from, target);
    let mut all: Vec<f64> = Vec::with_capacity(config.samples as usize);
    let mut farthest = (f64::NEG_INFINITY, [0.0; 3]);
    let mut cover = None;
    while (all.len() as u64) < config.samples {
        let first = all.len() as u64;
        let bytes = (budget.available_bytes() as f64 * SAMPLES_SHARE) as u64;
        let count = (bytes / BYTES_PER_SAMPLE).max(SAMPLES_MIN).min(config.samples - first);
        let _room = budget.reserve_share(0.0, count * size_of::<[f64; 3]>() as u64);
        let mut points = draw::draw(from, &sampling, first..first + count, budget, monitor)?;
        for point in &mut points {
            *point = (glam::DVec3::from_array(*point) + shift).to_array();
        }
        let distances = distances(&points, target, 0.0, budget, monitor)?;
        for (point, distance) in points.iter().zip(&distances) {
            if *distance > farthest.0 {
                farthest = (*distance, *point);
            }
        }
        // Another round means that there is no room for two; any one will do.
        let fits = budget.available_bytes() >= count * COVER_BYTES_PER_POINT;
        if cover.is_none() && (fits || count <= SAMPLES_MIN) {
            cover = Some(Cover::new(&points, &distances, budget));
        }
        all.extend(distances);
    }
    let statistics = Statistics::of(&mut all);
    let cover = cover.unwrap_or_else(|| Cover::new(&[farthest.1], &[farthest.0], budget));
    let vertex = farthest_vertex(from, target, (&cover, statistics.max), budget, monitor)?;
    let (max, at) = vertex.map_or(farthest, |vertex| (vertex.distance, vertex.at));
    let origin = target.surface.origin;
    let max_at = std::array::from_fn(|axis| at[axis] + origin[axis]);
    Ok(Outcome { max, max_at, statistics })
}
