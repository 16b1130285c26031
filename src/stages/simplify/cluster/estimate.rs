//! How many cells meet a wanted number of triangles: from a sample of the vertices, before any
//! cell is summed.

use crate::{
    geometry::{Bounds, CELLS_PER_AXIS_MAX, Grid, Sample},
    progress::{Monitor, StageId},
};

/// Triangles per occupied cell: 2 for a closed manifold; representatives without triangles and
/// boundaries make it less, folds more. 1.98 to 2.16 on closed scans at 50 % to 1 %, 1.8 to 2.3
/// on the rest but for one volumetric mesh (`scripts/quality_cluster.py`).
const TRIANGLES_PER_CELL: f64 = 2.0;

/// Area of a random plane section of a cube, relative to its mean, in sixteenths of the sections
/// from small to large: how unevenly the vertices of a locally flat surface are spread over the
/// cells it crosses. Computed from 400,000 random planes; their mean area is 2/3 in theory, and
/// was 0.6669.
const SECTION_AREAS: [f64; 16] = [
    0.0083, 0.0571, 0.1523, 0.2881, 0.4507, 0.6301, 0.8165, 1.0059, 1.1941, 1.3751, 1.5050, 1.5534,
    1.6088, 1.6780, 1.7711, 1.9055,
];

/// The number of cells along the longest side of `bounds` at which clustering leaves about
/// `triangles`, and the count expected there.
#[must_use]
pub fn cells_for(
    sample: &Sample,
    bounds: &Bounds,
    triangles: u64,
    monitor: &Monitor,
) -> (u32, u64) {
    /// Cells grow with about the square of their number per side: a few steps settle it.
    const STEPS_MAX: u64 = 12;
    let meter = monitor.meter(StageId::Estimate, None);
    let wanted = triangles.max(1) as f64;
    let expected = |cells: u32| {
        // No more than a few steps of a few milliseconds: not worth stopping in the middle.
        let _ = meter.add(1);
        TRIANGLES_PER_CELL * occupied_cells(sample, bounds, cells)
    };
    let mut cells = (wanted / 8.0).sqrt().clamp(1.0, f64::from(CELLS_PER_AXIS_MAX)) as u32;
    let mut best = (cells, expected(cells));
    for _ in 0..STEPS_MAX {
        let factor = (wanted / best.1.max(1.0)).sqrt();
        cells =
            (f64::from(best.0) * factor).round().clamp(1.0, f64::from(CELLS_PER_AXIS_MAX)) as u32;
        if cells == best.0 {
            break;
        }
        let next = (cells, expected(cells));
        let better = (next.1 / wanted).ln().abs() < (best.1 / wanted).ln().abs();
        if !better {
            break;
        }
        best = next;
    }
    meter.finish();
    (best.0, best.1 as u64)
}

/// How many cells hold a vertex, when the sample is all we know: few of the vertices fall in any
/// cell, so most cells of a fine grid are not seen at all. If the points of a sample fall in a
/// cell like raindrops, with a mean of λ times its section area, the number of different cells
/// they hit tells λ.
fn occupied_cells(sample: &Sample, bounds: &Bounds, cells: u32) -> f64 {
    let Some(grid) = Grid::with_cells(bounds, cells) else { return 0.0 };
    let cell_of = |point: &[f32; 3]| grid.cell_of(grid.to_grid(*point));
    let mut hit: Vec<_> = sample.points.iter().map(cell_of).collect();
    hit.sort_unstable();
    hit.dedup();
    let (points, hit) = (sample.points.len() as f64, hit.len() as f64);
    if points == 0.0 || points as u64 >= sample.vertices {
        return hit;
    }
    let crossed = points / mean_hits(hit / points);
    // Of the cells the surface crosses, those count that hold at least one of all vertices.
    let vertices = sample.vertices as f64;
    crossed * (1.0 - share_missed(vertices / crossed))
}

/// λ at which `hit_per_point` different cells are hit per point: (1 − missed(λ)) / λ.
fn mean_hits(hit_per_point: f64) -> f64 {
    let (mut low, mut high) = (1e-9_f64, 1e9_f64);
    for _ in 0..80 {
        let middle = (low * high).sqrt();
        if (1.0 - share_missed(middle)) / middle > hit_per_point {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}

/// Share of the crossed cells that no point falls in, at `mean` points a cell.
fn share_missed(mean: f64) -> f64 {
    let missed: f64 = SECTION_AREAS.iter().map(|area| (-mean * area).exp()).sum();
    missed / SECTION_AREAS.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Sampler;

    /// Points on a tilted square, evenly: a known number of cells.
    fn square(side: u32) -> (Vec<[f32; 3]>, Bounds) {
        let mut bounds = Bounds::default();
        let step = |i: u32| i as f32 / side as f32;
        let points: Vec<_> = (0..side * side)
            .map(|i| {
                [step(i % side), step(i / side), 0.37 * step(i % side) + 0.21 * step(i / side)]
            })
            .collect();
        for point in &points {
            bounds.add(*point);
        }
        (points, bounds)
    }

    #[test]
    fn occupied_cells_are_known_within_a_tenth_far_beyond_the_sample() {
        let (points, bounds) = square(1500);
        let mut sampler = Sampler::default();
        sampler.look(points.iter().copied());
        let sample = Sampler::finish(vec![sampler], points.len() as u64);
        for cells in [20, 100, 300, 600, 1000] {
            let grid = Grid::with_cells(&bounds, cells).unwrap();
            let mut all: Vec<_> = points.iter().map(|p| grid.cell_of(grid.to_grid(*p))).collect();
            all.sort_unstable();
            all.dedup();
            let ratio = occupied_cells(&sample, &bounds, cells) / all.len() as f64;
            assert!((0.9..1.1).contains(&ratio), "{cells} cells: {ratio}");
        }
    }
}
