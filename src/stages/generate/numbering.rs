//! Vertex numbers without a vertex table: a vertex is known by the cell that owns its edge, and
//! cells are numbered in sweep order, so the number follows from the row's first number, the
//! cell's rank in it, and the edges before.

use rayon::iter::{IntoParallelIterator, ParallelIterator};

use super::{
    field::BRICK,
    sweep::Rows,
    tetrahedra::{CASES, EDGE_ENDS, EDGES, own_crossed},
    tile::{Cell, Visitor},
};

/// A cell the surface passes through.
#[derive(Clone, Copy, Default)]
pub(super) struct FoundCell {
    x: u32,
    /// Vertices owned by cells before it in its row.
    rank: u32,
    inside: u8,
}

/// The cells of one tile.
#[derive(Default)]
pub(super) struct CellsFound {
    rows: Rows<FoundCell>,
    /// Vertices in the row at hand, so far.
    rank: u32,
}

impl Visitor for CellsFound {
    fn cell(&mut self, cell: &Cell<'_>) {
        let found = FoundCell { x: cell.corner[0] as u32, rank: self.rank, inside: cell.inside };
        self.rank += own_crossed(cell.inside).count_ones();
        self.rows.items.push(found);
    }

    fn end_row(&mut self) {
        self.rows.end_row();
        self.rank = 0;
    }
}

/// The cells of one slab, and the number of the first vertex of each row.
pub(super) struct NumberedSlab {
    tiles: Vec<CellsFound>,
    rows_y: usize,
    /// Layer by layer.
    firsts: Vec<u64>,
}

/// One row of cells with its first vertex number.
#[derive(Clone, Copy)]
struct Row<'a> {
    cells: &'a [FoundCell],
    first: u64,
}

impl NumberedSlab {
    /// Numbers the rows on from `vertices`, which becomes the first number of the next slab.
    pub(super) fn new(tiles: Vec<CellsFound>, vertices: &mut u64) -> Self {
        let rows_y = tiles.len() * BRICK[1];
        let mut slab = Self { tiles, rows_y, firsts: Vec::with_capacity(rows_y * BRICK[2]) };
        for layer in 0..BRICK[2] {
            for y in 0..rows_y {
                slab.firsts.push(*vertices);
                let last = slab.cells(y, layer).last();
                *vertices += last
                    .map_or(0, |cell| u64::from(cell.rank + own_crossed(cell.inside).count_ones()));
            }
        }
        slab
    }

    /// A slab the surface does not reach.
    pub(super) fn empty(rows_y: usize) -> Self {
        Self { tiles: Vec::new(), rows_y, firsts: vec![0; rows_y * BRICK[2]] }
    }

    fn cells(&self, y: usize, layer: usize) -> &[FoundCell] {
        self.tiles.get(y / BRICK[1]).map_or(&[], |tile| tile.rows.row(layer, y % BRICK[1]))
    }

    fn row(&self, y: usize, layer: usize) -> Row<'_> {
        if y == self.rows_y {
            return Row { cells: &[], first: 0 };
        }
        Row { cells: self.cells(y, layer), first: self.firsts[layer * self.rows_y + y] }
    }
}

/// The faces of `slab`, tile by tile, as vertex numbers. `above` is the next slab of the sweep.
pub(super) fn connect_slab(slab: &NumberedSlab, above: &NumberedSlab) -> Vec<Rows<u64>> {
    (0..slab.tiles.len())
        .into_par_iter()
        .map(|tile| {
            let mut corners = Rows::default();
            for layer in 0..BRICK[2] {
                for y in tile * BRICK[1]..(tile + 1) * BRICK[1] {
                    let (up, up_layer) =
                        if layer + 1 < BRICK[2] { (slab, layer + 1) } else { (above, 0) };
                    let sides = [
                        slab.row(y, layer),
                        slab.row(y + 1, layer),
                        up.row(y, up_layer),
                        up.row(y + 1, up_layer),
                    ];
                    connect_row(sides, &mut corners.items);
                    corners.end_row();
                }
            }
            corners
        })
        .collect()
}

/// The faces of the cells of row `sides[0]`; the others are its neighbours up y, z, and both.
fn connect_row(sides: [Row<'_>; 4], corners: &mut Vec<u64>) {
    let mut at = [0; 4];
    for cell in sides[0].cells {
        for (side, at) in sides.iter().zip(&mut at) {
            while side.cells.get(*at).is_some_and(|other| other.x < cell.x) {
                *at += 1;
            }
        }
        let mut numbers = [0; EDGES];
        let mut crossed = CASES.crossed(cell.inside);
        while crossed != 0 {
            let edge = crossed.trailing_zeros() as usize;
            crossed &= crossed - 1;
            let (a, d) = EDGE_ENDS[edge];
            let side = usize::from(a >> 1);
            numbers[edge] = number(&sides[side], at[side], cell.x + u32::from(a & 1), d);
        }
        let edges = CASES.corners(cell.inside);
        corners.extend(edges.iter().map(|&edge| numbers[usize::from(edge)]));
    }
}

/// The number of the vertex on the edge along `d` that the cell at `x` owns. That edge is
/// crossed, so the cell is in the row: at `at` or just behind it.
fn number(row: &Row<'_>, at: usize, x: u32, d: u8) -> u64 {
    let owner = if row.cells[at].x == x { row.cells[at] } else { row.cells[at + 1] };
    debug_assert_eq!(owner.x, x);
    let before = own_crossed(owner.inside) & ((1 << (d - 1)) - 1);
    row.first + u64::from(owner.rank + before.count_ones())
}
