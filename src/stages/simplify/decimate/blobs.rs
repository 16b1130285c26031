//! A sample of a surface in connected pieces: all triangles of some cells of a grid.

use std::sync::atomic::{AtomicUsize, Ordering};

use hashbrown::{HashMap, HashSet};

use crate::{
    geometry::{Bounds, CellId, Grid, Sample, spread},
    soup::{Triangle, Vertex},
};

/// Triangles of a cell, about: wide enough for a core that its border does not touch.
const BLOB_TRIANGLES: f64 = 4096.0;
/// Cells along the longest side at most.
const CELLS_MAX: u32 = 1 << 10;
/// Share of the triangles that are sampled, and how many at least and at most. Chosen by hand: a
/// few percent of the time for an error of a few percent in the count that a threshold leaves.
const SHARE: f64 = 0.03;
const TRIANGLES_MIN: f64 = 48_000.0;
const TRIANGLES_MAX: f64 = 400_000.0;
/// With fewer cells, chance would decide how much of the detail is among them: cells of a small
/// mesh are made smaller instead.
const BLOBS: f64 = 48.0;
/// Where so few cells would have to be left out, the sample is not worth it.
const STEP_MIN: usize = 4;
/// A sample that is so many times too large is of no use: it would not fit.
const CROWD: f64 = 2.0;

/// Which triangles are sampled. Follows from the surface alone, not from any order.
pub struct Blobs {
    grid: Grid,
    cells: HashSet<CellId>,
    /// By some bits of its indices, whether a cell may be one of them.
    filter: Vec<u64>,
    taken: AtomicUsize,
    taken_max: usize,
}

/// Bits of [`Blobs::filter`].
const FILTER_BITS: u32 = 16;

impl Blobs {
    /// Chooses cells by a sample of the vertices; `None` for a mesh so small that nearly all would
    /// be chosen.
    #[must_use]
    pub fn choose(sample: &Sample, bounds: &Bounds) -> Option<Self> {
        // By what the sample tells, which is the same however the surface is stored.
        let triangles = 2 * sample.distinct;
        let wanted = (triangles as f64 * SHARE).clamp(TRIANGLES_MIN, TRIANGLES_MAX);
        let blob_triangles = BLOB_TRIANGLES.min(wanted / BLOBS);
        let scales = std::iter::successors(Some(4), |cells| Some(2 * cells));
        let candidates = scales.take_while(|cells| *cells <= CELLS_MAX).filter_map(|cells| {
            let grid = Grid::with_cells(bounds, cells)?;
            let mut occupied: Vec<CellId> =
                sample.points.iter().map(|point| cell_of(&grid, *point)).collect();
            occupied.sort_unstable();
            occupied.dedup();
            let misfit = triangles as f64 / occupied.len().max(1) as f64 / blob_triangles;
            Some((misfit.ln().abs(), grid, occupied))
        });
        let best = candidates.min_by(|(a, ..), (b, ..)| a.total_cmp(b));
        let (_, grid, mut occupied) = best?;
        let blob_triangles = triangles as f64 / occupied.len() as f64;
        // One of so many, evenly spread over the surface: detail is not, either.
        let step = (triangles as f64 / wanted) as usize;
        if step < STEP_MIN {
            return None;
        }
        occupied.sort_unstable_by_key(|cell| along_curve(*cell));
        let occupied: Vec<CellId> = occupied.into_iter().skip(step / 2).step_by(step).collect();
        let mut filter = vec![0; 1 << (FILTER_BITS - 6)];
        for cell in &occupied {
            let bit = filter_bit(*cell);
            filter[bit / 64] |= 1_u64 << (bit % 64);
        }
        let taken_max = (occupied.len() as f64 * blob_triangles * CROWD) as usize;
        let cells = occupied.into_iter().collect();
        Some(Self { grid, cells, filter, taken: AtomicUsize::new(0), taken_max })
    }

    /// Whether a triangle is in the sample, as long as that is not too large.
    #[inline]
    pub fn takes<V: Vertex>(&self, triangle: &Triangle<V>) -> bool {
        let cell = self.cell_of(triangle);
        let bit = filter_bit(cell);
        self.filter[bit / 64] & (1 << (bit % 64)) != 0
            && self.cells.contains(&cell)
            && self.taken.fetch_add(1, Ordering::Relaxed) < self.taken_max
    }

    /// Whether more triangles would have been taken than there was room for.
    pub(super) fn is_crowded(&self) -> bool {
        self.taken.load(Ordering::Relaxed) > self.taken_max
    }

    /// The sampled triangles by their cells.
    pub(super) fn sort<V: Vertex>(&self, sample: Vec<Triangle<V>>) -> Vec<Vec<Triangle<V>>> {
        let mut blobs = HashMap::<CellId, Vec<Triangle<V>>>::new();
        for triangle in sample {
            blobs.entry(self.cell_of(&triangle)).or_default().push(triangle);
        }
        let mut blobs: Vec<_> = blobs.into_iter().collect();
        blobs.sort_unstable_by_key(|(cell, _)| *cell);
        blobs.into_iter().map(|(_, triangles)| triangles).collect()
    }

    /// A triangle belongs to the cell of its least coordinates: whatever the order of its corners.
    #[inline]
    fn cell_of<V: Vertex>(&self, triangle: &Triangle<V>) -> CellId {
        let [a, b, c] = triangle.0.map(|vertex| vertex.position());
        let least = |axis: usize| a[axis].min(b[axis]).min(c[axis]);
        cell_of(&self.grid, [least(0), least(1), least(2)])
    }
}

#[inline]
fn cell_of(grid: &Grid, point: [f32; 3]) -> CellId {
    CellId::new(grid.cell_of(grid.to_grid(point)))
}

#[inline]
fn filter_bit(cell: CellId) -> usize {
    (cell.0.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> (64 - FILTER_BITS)) as usize
}

/// Place of a cell on a Morton curve: cells that follow each other are near each other.
fn along_curve(cell: CellId) -> u32 {
    let [x, y, z] = cell.indices().map(spread);
    x | y << 1 | z << 2
}
