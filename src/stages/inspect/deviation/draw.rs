//! Points spread evenly over the area of a surface.
//!
//! The area is laid out in a row, triangle by triangle, and cut into as many equal parts as there
//! are samples; each part has one, at a place in it that only the seed and its number decide.

use std::ops::Range;

use glam::DVec3;

use super::survey::{Measured, Surface, mixed};
use crate::{
    error::Result,
    progress::{Monitor, StageId},
    soup::{Vertex, for_each_in_order},
    storage::Budget,
};

/// Which samples.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sampling {
    /// How many in all.
    pub(super) count: u64,
    pub(super) seed: u64,
}

/// The numbers that the place of a sample takes.
#[derive(Clone, Copy)]
enum Lane {
    Part,
    FirstSide,
    SecondSide,
}

impl Sampling {
    /// A number from 0 to 1, without 1.
    fn chance(&self, sample: u64, lane: Lane) -> f64 {
        let number = mixed(mixed(self.seed).wrapping_add(4 * sample + lane as u64));
        (number >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// How much of the area lies before a sample.
    fn place(&self, sample: u64, area: f64) -> f64 {
        (sample as f64 + self.chance(sample, Lane::Part)) / self.count as f64 * area
    }

    /// Where a sample lies on the triangle it has come to.
    fn on(&self, corners: [[f32; 3]; 3], sample: u64) -> [f64; 3] {
        let [a, b, c] = corners.map(|corner| DVec3::from_array(corner.map(f64::from)));
        let along = self.chance(sample, Lane::FirstSide).sqrt();
        let across = along * self.chance(sample, Lane::SecondSide);
        (a + (along - across) * (b - a) + across * (c - a)).to_array()
    }
}

/// The samples with the numbers `wanted`, in their order and in the coordinates of `surface`. One
/// pass over it.
///
/// # Errors
/// What reading the source fails with, or cancellation.
pub(super) fn draw<V: Vertex>(
    surface: &Surface<V>,
    sampling: &Sampling,
    wanted: Range<u64>,
    budget: &Budget,
    monitor: &Monitor,
) -> Result<Vec<[f64; 3]>> {
    let mut points = Vec::with_capacity((wanted.end - wanted.start) as usize);
    let mut next = wanted.start;
    let mut next_place = sampling.place(next, surface.area);
    let mut before = 0.0;
    let mut last = None;
    let meter = monitor.meter(StageId::Sample, surface.source.amount());
    for_each_in_order(surface.source, &meter, budget, Measured::fill, |measured| {
        for (corners, area) in measured.corners.iter().zip(&measured.areas) {
            // The sums are those of the survey: the same numbers in the same order.
            before += area;
            if *area > 0.0 {
                last = Some(*corners);
            }
            while next_place < before && next < wanted.end {
                points.push(sampling.on(*corners, next));
                next += 1;
                next_place = sampling.place(next, surface.area);
            }
        }
        Ok(())
    })?;
    meter.finish();
    // Rounding can take the place of the last sample to the very end of the area.
    let corners =
        last.into_iter().flat_map(|corners| (next..wanted.end).map(move |s| (corners, s)));
    points.extend(corners.map(|(corners, sample)| sampling.on(corners, sample)));
    Ok(points)
}
