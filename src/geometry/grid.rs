//! A grid of cubic cells over a bounding box, and the ids of its cells.

use glam::DVec3;

use super::Bounds;

/// Bits of a cell id per axis.
const AXIS_BITS: u32 = 21;
/// Largest number of cells along one axis: three of them must fit a [`CellId`].
pub const CELLS_PER_AXIS_MAX: u32 = 1 << AXIS_BITS;

/// A cell, as one number: z, y, x from the high bits down, so that cells in id order lie in
/// slices along z.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CellId(pub u64);

impl CellId {
    /// The id of the cell with these indices, each below [`CELLS_PER_AXIS_MAX`].
    #[must_use]
    pub fn new(cell: [u32; 3]) -> Self {
        let [x, y, z] = cell.map(u64::from);
        Self(z << (2 * AXIS_BITS) | y << AXIS_BITS | x)
    }

    /// Indices of the cell along x, y, z.
    #[must_use]
    pub fn indices(self) -> [u32; 3] {
        let mask = u64::from(CELLS_PER_AXIS_MAX - 1);
        [self.0, self.0 >> AXIS_BITS, self.0 >> (2 * AXIS_BITS)].map(|bits| (bits & mask) as u32)
    }
}

/// Cubic cells over a bounding box. Positions become *grid coordinates*, in which every cell is
/// a unit cube, and *local coordinates* in [−½, ½] around a cell's centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    min: DVec3,
    cell_size: f64,
    cells_per_unit: f64,
    /// Largest index per axis, so that the far side of the box belongs to the last cell.
    index_max: [u32; 3],
}

/// Where a position is. The fourth numbers fill vectors and mean nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Located {
    /// Grid coordinates.
    pub point: [f64; 4],
    /// Indices of its cell.
    pub cell: [u32; 4],
    /// Local coordinates in that cell.
    pub local: [f32; 4],
}

impl Grid {
    /// Cells of edge `cell_size` over `bounds`, `None` when they would not be numbers or more
    /// than [`CELLS_PER_AXIS_MAX`] along an axis.
    #[must_use]
    pub fn with_cell_size(bounds: &Bounds, cell_size: f64) -> Option<Self> {
        let cells_per_unit = 1.0 / cell_size;
        let counts = (bounds.size() * cells_per_unit).ceil().max(DVec3::ONE);
        // Also false for NaN.
        let usable = counts.max_element() <= f64::from(CELLS_PER_AXIS_MAX)
            && cell_size > 0.0
            && cells_per_unit.is_finite();
        usable.then(|| Self {
            min: DVec3::from_array(bounds.min.map(f64::from)),
            cell_size,
            cells_per_unit,
            index_max: counts.to_array().map(|count| count as u32 - 1),
        })
    }

    /// `cells` cells along the longest side of `bounds`.
    #[must_use]
    pub fn with_cells(bounds: &Bounds, cells: u32) -> Option<Self> {
        let longest = bounds.size().max_element();
        // A box without extent has one cell, of any size.
        let longest = if longest > 0.0 { longest } else { 1.0 };
        let mut grid = Self::with_cell_size(bounds, longest / f64::from(cells))?;
        // Rounding may have made it one more.
        grid.index_max = grid.index_max.map(|index| index.min(cells - 1));
        Some(grid)
    }

    /// Edge of a cell in model units.
    #[must_use]
    pub fn cell_size(&self) -> f64 {
        self.cell_size
    }

    /// Cells along each axis.
    #[must_use]
    pub fn cells(&self) -> [u32; 3] {
        self.index_max.map(|index| index + 1)
    }

    /// Grid coordinates of a position inside the box.
    #[inline]
    #[must_use]
    pub fn to_grid(&self, position: [f32; 3]) -> DVec3 {
        (DVec3::from_array(position.map(f64::from)) - self.min) * self.cells_per_unit
    }

    /// Indices of the cell that holds a point in grid coordinates.
    #[inline]
    #[must_use]
    pub fn cell_of(&self, point: DVec3) -> [u32; 3] {
        let [x, y, z] = self.index_max;
        [floor(point.x).min(x), floor(point.y).min(y), floor(point.z).min(z)]
    }

    /// Where a position inside the box is, by the same numbers as [`Self::to_grid`] and
    /// [`Self::cell_of`] give: without a branch, and on vectors.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "measured: a tenth of clustering's pass")]
    #[must_use]
    pub fn locate(&self, position: [f32; 3]) -> Located {
        let four = |[x, y, z]: [f64; 3]| [x, y, z, 0.0];
        let min = four(self.min.to_array());
        let last = four(self.index_max.map(f64::from));
        let position = four(position.map(f64::from));
        let point: [f64; 4] =
            std::array::from_fn(|axis| (position[axis] - min[axis]) * self.cells_per_unit);
        let floor: [f64; 4] = std::array::from_fn(|axis| {
            let rounded = (point[axis] + ROUND_TO_INTEGER) - ROUND_TO_INTEGER;
            let floor = rounded - if rounded > point[axis] { 1.0 } else { 0.0 };
            if floor < last[axis] { floor } else { last[axis] }
        });
        let cell = floor.map(|index| (index + ROUND_TO_INTEGER).to_bits() as u32);
        let local = std::array::from_fn(|axis| (point[axis] - (floor[axis] + 0.5)) as f32);
        Located { point, cell, local }
    }

    /// Position, in model units, of a point in the local coordinates of `cell`.
    #[must_use]
    pub fn to_model(&self, cell: CellId, local: DVec3) -> [f32; 3] {
        let centre = DVec3::from_array(cell.indices().map(|i| f64::from(i) + 0.5));
        (self.min + (centre + local) * self.cell_size).to_array().map(|c| c as f32)
    }
}

/// 2⁵²: adding it rounds a smaller number to an integer, which is then in the low bits.
const ROUND_TO_INTEGER: f64 = 4_503_599_627_370_496.0;

/// The integer part of a number between 0 and 2³¹. `as u32` does the same, but saturates beyond,
/// which costs a compare and a branch for each of nine coordinates of a triangle.
#[inline]
fn floor(value: f64) -> u32 {
    let rounded = value + ROUND_TO_INTEGER;
    let too_large = rounded - ROUND_TO_INTEGER > value;
    (rounded.to_bits() as u32).wrapping_sub(u32::from(too_large))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bounds(max: [f32; 3]) -> Bounds {
        Bounds { min: [0.0; 3], max }
    }

    #[test]
    fn ids_keep_indices_and_order_by_slices() {
        let cell = [3, CELLS_PER_AXIS_MAX - 1, 17];
        assert_eq!(CellId::new(cell).indices(), cell);
        assert!(CellId::new([9, 9, 1]) > CellId::new([10, 10, 0]));
    }

    #[test]
    fn floor_is_the_integer_part() {
        for value in [0.0, 0.49, 0.5, 0.51, 1.0, 1.5, 2.5, 3.999_999, 2_097_151.5, 1e-300] {
            assert_eq!(floor(value), value as u32, "{value}");
        }
        assert_eq!(floor(0.999_999_999_999_999_9), 0);
    }

    #[test]
    fn a_position_is_located_as_by_its_steps() {
        let grid = Grid::with_cell_size(&bounds([8.0, 4.0, 1.3]), 0.013).unwrap();
        for i in 0..1000_u16 {
            let share = f32::from(i) / 999.0;
            let position = [8.0 * share, 4.0 - 4.0 * share, 1.3 * share];
            let located = grid.locate(position);
            let point = grid.to_grid(position);
            let cell = grid.cell_of(point);
            assert_eq!(
                (&located.point[..3], &located.cell[..3]),
                (&point.to_array()[..], &cell[..])
            );
            let centre = DVec3::from_array(cell.map(|index| f64::from(index) + 0.5));
            assert_eq!(located.local[..3], (point - centre).as_vec3().to_array());
        }
    }

    #[test]
    fn the_far_corner_belongs_to_the_last_cell() {
        let grid = Grid::with_cells(&bounds([8.0, 4.0, 0.0]), 4).unwrap();
        assert_eq!(grid.cells(), [4, 2, 1]);
        assert_eq!(grid.cell_of(grid.to_grid([8.0, 4.0, 0.0])), [3, 1, 0]);
        let id = CellId::new([3, 1, 0]);
        assert_eq!(grid.to_model(id, DVec3::new(0.5, 0.5, -0.5)), [8.0, 4.0, 0.0]);
    }

    #[test]
    fn impossible_cells_are_refused() {
        assert!(Grid::with_cell_size(&bounds([1.0; 3]), 0.0).is_none());
        assert!(Grid::with_cell_size(&bounds([1.0; 3]), f64::NAN).is_none());
        assert!(Grid::with_cell_size(&bounds([1e30; 3]), 1.0).is_none());
        assert!(Grid::with_cells(&bounds([0.0; 3]), 5).is_some());
        assert!(Grid::with_cells(&bounds([1e-30; 3]), 500).is_some());
    }
}
