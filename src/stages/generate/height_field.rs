//! A regular grid of heights with fractal noise: the surface a terrain scan has. It has a
//! boundary. Two triangles a cell, rows along y, so the counts are known beforehand.

use std::ops::Range;

use rayon::iter::{IndexedParallelIterator, ParallelIterator};
use rayon::slice::ParallelSliceMut;

use super::{
    Config, Layout, Outcome,
    delivery::{Delivery, Sink},
    noise::{Noise, NoiseWindow, Spectrum},
    sweep::sweep,
};
use crate::{
    Result,
    formats::{Content, Counts},
    geometry::Bounds,
    progress::{Meter, Monitor, StageId},
};

/// Side of the square along x, in model units; y has as many as its rows give.
const SIDE: f64 = 2.0;

/// Wavelength of the coarsest noise, in model units. Chosen by hand: four hills across.
const WAVELENGTH: f64 = 0.5;

/// Wavelength of the finest noise, in cells, at least.
const WAVELENGTH_MIN_CELLS: f64 = 4.0;

/// Rows whose heights are made at once.
const BAND_ROWS: usize = 64;

/// Rows one task makes: they share the hashed noise lattice.
const TASK_ROWS: usize = 8;

/// Cells along both axes.
#[derive(Clone, Copy)]
struct Extent {
    columns: usize,
    rows: usize,
}

impl Extent {
    fn of(config: &Config) -> Self {
        let columns = ((config.triangles as f64 / 2.0).sqrt().round() as u64).max(1);
        let rows = ((config.triangles + columns) / (2 * columns)).max(1);
        Self { columns: columns as usize, rows: rows as usize }
    }

    fn triangles(self) -> u64 {
        2 * self.columns as u64 * self.rows as u64
    }

    fn vertices(self) -> u64 {
        (self.columns as u64 + 1) * (self.rows as u64 + 1)
    }
}

/// Heights over a grid.
struct Terrain {
    extent: Extent,
    x: Vec<f32>,
    y: Vec<f32>,
    noise: Noise,
}

/// Counts by formula.
pub(super) fn count(config: &Config) -> Counts {
    let extent = Extent::of(config);
    Counts { vertices: extent.vertices(), triangles: extent.triangles() }
}

/// Delivers the height field.
pub(super) fn generate(
    config: &Config,
    monitor: &Monitor<'_>,
    sink: &mut Sink<'_>,
) -> Result<Outcome> {
    let terrain = Terrain::new(config);
    let extent = terrain.extent;
    match config.layout {
        Layout::Soup => {
            let bounds = deliver_soup(&terrain, monitor, sink)?;
            Ok(Outcome { counts: Counts { vertices: 0, triangles: extent.triangles() }, bounds })
        }
        Layout::Indexed => {
            let bounds = deliver_vertices(&terrain, monitor, sink)?;
            deliver_faces(extent, monitor, sink)?;
            Ok(Outcome { counts: count(config), bounds })
        }
    }
}

impl Terrain {
    fn new(config: &Config) -> Self {
        let extent = Extent::of(config);
        let spacing = SIDE / extent.columns as f64;
        let axis = |cells: usize| -> Vec<f64> {
            (0..=cells).map(|i| (i as f64 - cells as f64 / 2.0) * spacing).collect()
        };
        let (x, y) = (axis(extent.columns), axis(extent.rows));
        let spectrum = Spectrum {
            wavelength: WAVELENGTH,
            amplitude: config.noise * SIDE,
            wavelength_min: WAVELENGTH_MIN_CELLS * spacing,
            seed: config.seed,
        };
        let noise = Noise::new(&spectrum, [&x, &y, &[0.0]]);
        let single = |axis: &[f64]| axis.iter().map(|&c| c as f32).collect();
        Self { extent, x: single(&x), y: single(&y), noise }
    }

    /// Positions of rows `rows`, one row after the other.
    fn positions(&self, rows: &Range<usize>) -> Vec<[f32; 3]> {
        let width = self.x.len();
        let mut positions = vec![[0.0; 3]; width * rows.len()];
        positions.par_chunks_mut(width * TASK_ROWS).enumerate().for_each(|(task, positions)| {
            let first = rows.start + task * TASK_ROWS;
            let ys = first..first + positions.len() / width;
            let mut window = NoiseWindow::default();
            window.place(&self.noise, &(0..width), &ys, &(0..1));
            let mut heights = vec![0.0; width];
            for (y, row) in ys.zip(positions.chunks_exact_mut(width)) {
                heights.fill(0.0);
                window.add_row(&self.noise, (y, 0), &(0..width), &mut heights);
                for ((position, x), height) in row.iter_mut().zip(&self.x).zip(&heights) {
                    *position = [*x, self.y[y], *height];
                }
            }
        });
        positions
    }

    /// Sweeps over all rows in bands of [`BAND_ROWS`]; a band also has the first row of the next
    /// one when `overlap` is 1.
    fn sweep(
        &self,
        overlap: usize,
        mut deliver: impl FnMut(&[[f32; 3]]) -> Result<()>,
    ) -> Result<Bounds> {
        let mut bounds = Bounds::default();
        let rows = self.y.len();
        let make = |band: usize| {
            let start = band * BAND_ROWS;
            let positions = self.positions(&(start..(start + BAND_ROWS + overlap).min(rows)));
            let mut bounds = Bounds::default();
            for position in &positions {
                bounds.add(*position);
            }
            Ok((positions, bounds))
        };
        sweep((rows - overlap).div_ceil(BAND_ROWS), make, |(positions, band)| {
            bounds = bounds.union(&band);
            deliver(&positions)
        })?;
        Ok(bounds)
    }
}

fn deliver_soup(terrain: &Terrain, monitor: &Monitor<'_>, sink: &mut Sink<'_>) -> Result<Bounds> {
    let meter = monitor.meter(StageId::Generate, Some(terrain.extent.triangles()));
    let mut delivery = Delivery::new(Content::Soup, sink);
    let width = terrain.x.len();
    let mut soup = Vec::new();
    let bounds = terrain.sweep(1, |positions| {
        for (low, high) in positions.chunks(width).zip(positions[width..].chunks(width)) {
            soup.clear();
            for (low, high) in low.windows(2).zip(high.windows(2)) {
                let (a, b, c, d) = (low[0], low[1], high[0], high[1]);
                soup.extend_from_slice(&[a, b, d, a, d, c]);
            }
            meter.add(soup.len() as u64 / 3)?;
            delivery.positions(&soup)?;
        }
        Ok(())
    })?;
    delivery.finish()?;
    meter.finish();
    Ok(bounds)
}

fn deliver_vertices(
    terrain: &Terrain,
    monitor: &Monitor<'_>,
    sink: &mut Sink<'_>,
) -> Result<Bounds> {
    let meter = monitor.meter(StageId::Generate, Some(terrain.extent.vertices()));
    let mut delivery = Delivery::new(Content::Vertices, sink);
    let bounds = terrain.sweep(0, |positions| {
        meter.add(positions.len() as u64)?;
        delivery.positions(positions)
    })?;
    delivery.finish()?;
    meter.finish();
    Ok(bounds)
}

/// The faces as in [`deliver_soup`].
fn deliver_faces(extent: Extent, monitor: &Monitor<'_>, sink: &mut Sink<'_>) -> Result<()> {
    let meter: Meter<'_> = monitor.meter(StageId::Generate, Some(extent.triangles()));
    let mut delivery = Delivery::new(Content::Faces, sink);
    let width = extent.columns as u64 + 1;
    let mut corners = Vec::new();
    for row in 0..extent.rows as u64 {
        corners.clear();
        for a in row * width..row * width + width - 1 {
            let (b, c, d) = (a + 1, a + width, a + width + 1);
            corners.extend_from_slice(&[a, b, d, a, d, c]);
        }
        meter.add(2 * extent.columns as u64)?;
        delivery.corners(&corners)?;
    }
    delivery.finish()?;
    meter.finish();
    Ok(())
}
