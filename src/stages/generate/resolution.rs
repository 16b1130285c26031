//! The grid spacing that gives the wanted number of triangles.
//!
//! Triangles grow with the inverse square of the spacing, nearly: noise adds area as finer octaves
//! appear. So: find the spacing of a small surface, scale it up, and correct by counting a sample
//! of the tiles at full resolution. Every step is a pure function of the configuration.

use super::{
    Config,
    field::{BRICK, Field},
    iso_surface::count_tiles,
};
use crate::{
    Result,
    formats::Counts,
    progress::{Meter, Monitor, StageId},
};

/// Good enough, relative to the wanted count. Small counts come in steps and may not reach it.
const TOLERANCE: f64 = 0.005;

/// Corrections at most, chosen by hand: with the interval kept, they halve what is left.
const ROUNDS: usize = 16;

/// The small surface that tells the area, in triangles: 0.1 s.
const CALIBRATION_TRIANGLES: u64 = 200_000;

/// Tiles counted at most; chosen by hand, the count is then known within some thousandths.
const TILES_SAMPLED: usize = 4096;

/// A wider spacing leaves a single sample inside, which is the smallest surface there is.
const SPACING_MAX: f64 = 1.3;

/// The field of `config` on the grid that meets its triangle count best.
pub(super) fn solve(config: &Config, monitor: &Monitor<'_>) -> Result<Field> {
    let meter = monitor.meter(StageId::Estimate, None);
    let small = config.triangles.min(CALIBRATION_TRIANGLES);
    // 24 triangles to begin with: the surface around one sample.
    let first = (SPACING_MAX * (24.0 / small as f64).sqrt()).min(SPACING_MAX);
    let mut spacing = approach(config, small, first, &meter)?;
    if config.triangles > small {
        let scaled = spacing * (small as f64 / config.triangles as f64).sqrt();
        spacing = approach(config, config.triangles, scaled, &meter)?;
    }
    meter.finish();
    Ok(Field::new(config, spacing))
}

/// The spacing whose count is nearest to `wanted`, beginning at `spacing`.
fn approach(config: &Config, wanted: u64, mut spacing: f64, meter: &Meter<'_>) -> Result<f64> {
    let (mut too_fine, mut too_coarse) = (0.0, f64::INFINITY);
    let mut best = (f64::INFINITY, spacing);
    for _ in 0..ROUNDS {
        let triangles = estimate(&Field::new(config, spacing), meter)?;
        let ratio = triangles / wanted as f64;
        if (ratio - 1.0).abs() < best.0 {
            best = ((ratio - 1.0).abs(), spacing);
        }
        if best.0 < TOLERANCE {
            break;
        }
        if ratio > 1.0 {
            too_fine = spacing;
        } else {
            too_coarse = spacing;
        }
        let guess = (spacing * ratio.max(0.01).sqrt()).min(SPACING_MAX);
        spacing = if guess > too_fine && guess < too_coarse {
            guess
        } else if too_fine > 0.0 && too_coarse.is_finite() {
            (too_fine * too_coarse).sqrt()
        } else {
            break;
        };
    }
    Ok(best.1)
}

/// Triangles of `field`, from all of its tiles or an even sample of them.
fn estimate(field: &Field, meter: &Meter<'_>) -> Result<f64> {
    let per_axis = field.cells() / BRICK[1];
    let all = per_axis * per_axis;
    let tiles: Vec<_> = if all <= TILES_SAMPLED {
        (0..all).map(|tile| (tile % per_axis, tile / per_axis)).collect()
    } else {
        (0..TILES_SAMPLED).map(|sample| sampled_tile(sample, per_axis)).collect()
    };
    let Counts { triangles, .. } = count_tiles(field, &tiles, meter)?;
    Ok(triangles as f64 * (all as f64 / tiles.len() as f64))
}

/// Tiles on a lattice of the golden ratio: even along both axes, in step with neither.
fn sampled_tile(sample: usize, per_axis: usize) -> (usize, usize) {
    // 2^32 divided by the golden ratio.
    let turned = (sample as u32).wrapping_mul(0x9E37_79B9);
    let y = (u64::from(turned) * per_axis as u64) >> 32;
    (y as usize, (2 * sample + 1) * per_axis / (2 * TILES_SAMPLED))
}
