//! A sample of a surface in connected pieces: all triangles of some cells of a grid.

use std::sync::atomic::{AtomicUsize, Ordering};

use hashbrown::{HashMap, HashSet};

use crate::{
    geometry::{Bounds, CellId, Grid, Sample},
    soup::{Triangle, Vertex},
};

/// Triangles of a cell, about: wide enough for a core that its border does not touch.
const BLOB_TRIANGLES: f64 = 4096.0;
/// Cells along the longest side at most.
const CELLS_MAX: u32 = 1 << 10;
/// Share of the triangles that are sampled, and how many at most. Chosen by hand: an error of a
/// few percent in the count that a threshold leaves, for a few percent of the time.
const SHARE: f64 = 0.04;
const TRIANGLES_MAX: f64 = 400_000.0;
/// Fewer cells would be no sample.
const BLOBS_MIN: usize = 8;
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
    /// Chooses cells by a sample of the vertices; `None` where there are too few to choose from.
    #[must_use]
    pub fn choose(sample: &Sample, bounds: &Bounds, triangles: u64) -> Option<Self> {
        let mut scales = std::iter::successors(Some(4), |cells| Some(2 * cells));
        let scales = scales.by_ref().take_while(|cells| *cells <= CELLS_MAX);
        let candidates = scales.filter_map(|cells| {
            let grid = Grid::with_cells(bounds, cells)?;
            let mut occupied: Vec<CellId> =
                sample.points.iter().map(|point| cell_of(&grid, *point)).collect();
            occupied.sort_unstable();
            occupied.dedup();
            let blob_triangles = triangles as f64 / occupied.len().max(1) as f64;
            let misfit = (blob_triangles / BLOB_TRIANGLES).ln().abs();
            Some((misfit, grid, occupied, blob_triangles))
        });
        let best = candidates.min_by(|(a, ..), (b, ..)| a.total_cmp(b));
        let (_, grid, mut occupied, blob_triangles) = best?;
        let wanted = (triangles as f64 * SHARE).min(TRIANGLES_MAX);
        let blobs = ((wanted / blob_triangles).ceil() as usize).max(BLOBS_MIN);
        if blobs * 4 > occupied.len() {
            return None;
        }
        occupied.sort_unstable_by_key(|cell| (hash(*cell), *cell));
        occupied.truncate(blobs);
        let mut filter = vec![0; 1 << (FILTER_BITS - 6)];
        for cell in &occupied {
            let bit = filter_bit(*cell);
            filter[bit / 64] |= 1_u64 << (bit % 64);
        }
        let taken_max = (blobs as f64 * blob_triangles * CROWD) as usize;
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

fn hash(cell: CellId) -> u64 {
    let x = (cell.0 ^ (cell.0 >> 31)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let x = (x ^ (x >> 29)).wrapping_mul(0x94D0_49BB_1331_11EB);
    x ^ (x >> 32)
}
