//! Synthetic surfaces of any size, streamed: to try out and to measure everything else with.
//!
//! Deterministic in every bit: the same [`Config`] gives the same batches on any platform and for
//! any thread count. Memory grows with the square root of the triangles (two slabs of eight
//! layers of cells), never with the triangles. It writes no files.
//!
//! The closed kinds are iso-surfaces, drawn by marching tetrahedra: watertight, consistently
//! oriented, no edge with more than two triangles, no triangle without an area. Triangles come in
//! the order of the sweep along z, as from any program that marches through cubes. The tests see
//! to it that a sphere is one: Euler characteristic 2, at the noise of [`NOISE_DEFAULT`].

mod delivery;
mod field;
mod height_field;
mod iso_surface;
mod noise;
mod numbering;
mod resolution;
mod sweep;
#[cfg(test)]
mod tests;
mod tetrahedra;
mod tile;

use crate::{
    Error, Result,
    formats::{Batch, Counts},
    geometry::Bounds,
    progress::Monitor,
};

/// What to make.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// The surface.
    pub kind: Kind,
    /// Triangles wanted, 1 to [`TRIANGLES_MAX`]. A height field has as many within one row.
    /// The closed kinds come within 3 % from 10,000 triangles on, within 15 % from 1000 on, and
    /// have 24 at least.
    pub triangles: u64,
    /// Amplitude of the fractal noise, 0 to [`NOISE_MAX`], relative to the size of a feature: the
    /// sphere's radius, half a period of the gyroid, the height field's side. All octaves
    /// together never exceed it; their slopes are equal, down to a wavelength of some cells.
    pub noise: f64,
    /// Stream of the noise. Surfaces with equal seeds are the same at every resolution, but for
    /// the finest octaves.
    pub seed: u64,
    /// What is delivered.
    pub layout: Layout,
}

/// A surface. All lie around the origin, with a radius of about 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A ball filled by one of the gyroid's two labyrinths, four periods across; closed, of high
    /// genus.
    Gyroid,
    /// A sphere; closed.
    Sphere,
    /// A square of hills over the xy plane, z up; with a boundary.
    HeightField,
}

/// Kind of the delivered records.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// Triangles with their own three positions.
    Soup,
    /// First all vertices, then all faces. Numbers follow the sweep: the vertices of a face are
    /// near each other.
    Indexed,
}

/// What was made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// Records delivered.
    pub counts: Counts,
    /// The box around all positions.
    pub bounds: Bounds,
}

/// Noise for a surface as rough as a good scan. Chosen by hand: slopes of about 10 %.
pub const NOISE_DEFAULT: f64 = 0.05;

/// More noise could move the surface beyond the middle of the grid.
pub const NOISE_MAX: f64 = 0.3;

/// More triangles would be so small that single precision does not tell their corners apart.
pub const TRIANGLES_MAX: u64 = 100_000_000_000;

/// Counts exactly what [`generate`] will deliver.
///
/// The closed kinds take one sweep over the field, which is nearly as long as [`generate`] takes
/// for a soup; a height field takes no time.
///
/// # Errors
/// [`Error::Request`] when `config` is out of range, [`Error::Cancelled`].
pub fn count(config: &Config, monitor: &Monitor<'_>) -> Result<Counts> {
    check(config)?;
    let counts = match config.kind {
        Kind::HeightField => height_field::count(config),
        Kind::Gyroid | Kind::Sphere => {
            iso_surface::count(&resolution::solve(config, monitor)?, monitor)?
        }
    };
    Ok(match config.layout {
        Layout::Soup => Counts { vertices: 0, ..counts },
        Layout::Indexed => counts,
    })
}

/// Makes the surface and hands it to `sink` in batches, on the caller's thread.
///
/// Soup takes one sweep over the field, an indexed mesh two. Progress counts cells of the grid
/// for the closed kinds and records for a height field; each sweep is a pass of its own.
///
/// # Errors
/// [`Error::Request`] when `config` is out of range, [`Error::Cancelled`], and whatever `sink`
/// returns.
pub fn generate(
    config: &Config,
    monitor: &Monitor<'_>,
    sink: &mut dyn FnMut(&Batch) -> Result<()>,
) -> Result<Outcome> {
    check(config)?;
    match config.kind {
        Kind::HeightField => height_field::generate(config, monitor, sink),
        Kind::Gyroid | Kind::Sphere => {
            let field = resolution::solve(config, monitor)?;
            iso_surface::generate(&field, config.layout, monitor, sink)
        }
    }
}

fn check(config: &Config) -> Result<()> {
    if !(1..=TRIANGLES_MAX).contains(&config.triangles) {
        return Err(Error::Request(format!(
            "{} triangles cannot be generated, 1 to {TRIANGLES_MAX} can",
            config.triangles
        )));
    }
    if !(0.0..=NOISE_MAX).contains(&config.noise) {
        return Err(Error::Request(format!(
            "a noise of {} is outside 0 to {NOISE_MAX}",
            config.noise
        )));
    }
    Ok(())
}
