//! One tile of the grid, 8 × 8 rows of cells: finds the cells the surface passes through.
//!
//! Values are computed two slices at a time, and only in bricks the surface may reach; signs
//! become bits, so that 64 cells without a change of sign cost a few instructions.

use std::ops::Range;

use super::{
    field::{BRICK, Field, Side},
    noise::NoiseWindow,
    tetrahedra::EDGE_ENDS,
};

/// Bricks whose signs make one word.
const BRICKS_PER_WORD: usize = 64 / BRICK[0];

/// A vertex keeps at least this part of its edge away from both ends. So a corner the surface
/// passes exactly does not make triangles of no area. Chosen by hand: the distance is far above
/// the rounding of single precision up to [`super::TRIANGLES_MAX`], and far below what is seen.
const EDGE_MARGIN: f32 = 1.0 / 32.0;

/// Receives the cells with a change of sign, x fastest, then y, then z.
pub(super) trait Visitor {
    /// One cell.
    fn cell(&mut self, cell: &Cell<'_>);

    /// A row of the tile has ended. Called for every row, of which there are 64.
    fn end_row(&mut self);
}

/// A cell that the surface passes through.
pub(super) struct Cell<'a> {
    field: &'a Field,
    /// Sample at the cell's lowest corner.
    pub(super) corner: [usize; 3],
    /// Corners inside the surface, a bit each.
    pub(super) inside: u8,
    /// Values along the four rows of samples at its sides: y fastest, then z.
    rows: [&'a [f32]; 4],
}

impl Cell<'_> {
    /// Where the surface crosses `edge`: a function of the edge alone, so that all cells around
    /// it find the same bits.
    pub(super) fn crossing(&self, edge: usize) -> [f32; 3] {
        let (a, d) = EDGE_ENDS[edge];
        let (low, high) = (self.value(a), self.value(a | d));
        // Signs differ, so this is never 0/0; zero counts as outside.
        let part = (low / (low - high)).clamp(EDGE_MARGIN, 1.0 - EDGE_MARGIN);
        let step = part * self.field.spacing();
        std::array::from_fn(|axis| {
            let sample = self.corner[axis] + usize::from(a >> axis & 1);
            let start = self.field.coordinates()[sample];
            if d >> axis & 1 == 1 { start + step } else { start }
        })
    }

    fn value(&self, corner: u8) -> f32 {
        self.rows[usize::from(corner >> 1)][self.corner[0] + usize::from(corner & 1)]
    }
}

/// Memory of [`scan`], reused from tile to tile.
#[derive(Default)]
pub(super) struct Scratch {
    window: NoiseWindow,
    /// Samples to evaluate in each row.
    runs: Vec<Range<usize>>,
    /// Signs of a row where nothing is evaluated: a bit per sample, set inside.
    certain: Vec<u64>,
    /// Values and signs of two slices of nine rows.
    slices: [Slice; 2],
}

#[derive(Default)]
struct Slice {
    values: Vec<f32>,
    inside: Vec<u64>,
}

/// Visits the cells of tile (`tile_y`, `tile_z`) that the surface passes through.
pub(super) fn scan<V: Visitor>(
    field: &Field,
    (tile_y, tile_z): (usize, usize),
    scratch: &mut Scratch,
    visitor: &mut V,
) {
    let (y, z) = (tile_y * BRICK[1], tile_z * BRICK[2]);
    scratch.find_runs(field, y, z);
    let (Some(first), Some(last)) = (scratch.runs.first(), scratch.runs.last()) else {
        (0..BRICK[1] * BRICK[2]).for_each(|_| visitor.end_row());
        return;
    };
    let rows = y..y + BRICK[1] + 1;
    let xs = first.start..last.end;
    field.place_noise(&mut scratch.window, &xs, &rows, &(z..z + BRICK[2] + 1));
    for up in 0..=BRICK[2] {
        scratch.evaluate_slice(field, &rows, z + up);
        if up > 0 {
            visit_layer(field, (y, z + up - 1), &scratch.slices, visitor);
        }
    }
}

impl Scratch {
    fn find_runs(&mut self, field: &Field, y: usize, z: usize) {
        let cells = field.cells();
        self.runs.clear();
        self.certain.clear();
        self.certain.resize(cells / 64 + 1, 0);
        for x in (0..cells).step_by(BRICK[0]) {
            match field.certain_side([x, y, z]) {
                Some(Side::Outside) => {}
                Some(Side::Inside) => self.certain[x / 64] |= 0xFFFF << (x % 64),
                // The last sample of a brick is the first of the next, which may be certain.
                None => match self.runs.last_mut() {
                    Some(run) if run.end == x + 1 => run.end = x + BRICK[0] + 1,
                    _ => self.runs.push(x..x + BRICK[0] + 1),
                },
            }
        }
    }

    fn evaluate_slice(&mut self, field: &Field, rows: &Range<usize>, z: usize) {
        let samples = field.cells() + 1;
        let words = self.certain.len();
        let slice = &mut self.slices[z % 2];
        slice.values.resize(rows.len() * samples, 0.0);
        slice.inside.resize(rows.len() * words, 0);
        let values = slice.values.chunks_exact_mut(samples);
        for ((y, row), inside) in rows.clone().zip(values).zip(slice.inside.chunks_exact_mut(words))
        {
            inside.copy_from_slice(&self.certain);
            for run in &self.runs {
                field.evaluate(&mut self.window, (y, z), run, row);
                gather_signs(row, run, inside);
            }
        }
    }
}

/// Sets the bits of the bricks in `run`; they are clear where `inside` was not certain.
fn gather_signs(row: &[f32], run: &Range<usize>, inside: &mut [u64]) {
    for (brick, values) in row[run.start..run.end - 1].chunks_exact(BRICK[0]).enumerate() {
        let mut bits = 0u32;
        for (lane, &value) in values.iter().enumerate() {
            bits |= if value < 0.0 { 1 << lane } else { 0 };
        }
        let brick = run.start / BRICK[0] + brick;
        inside[brick / BRICKS_PER_WORD] |= u64::from(bits) << (brick % BRICKS_PER_WORD * BRICK[0]);
    }
}

/// Visits the cells between slices `z` and `z + 1`.
fn visit_layer<V: Visitor>(
    field: &Field,
    (y, z): (usize, usize),
    slices: &[Slice; 2],
    visitor: &mut V,
) {
    let samples = field.cells() + 1;
    let words = slices[0].inside.len() / (BRICK[1] + 1);
    let (low, high) = (&slices[z % 2], &slices[(z + 1) % 2]);
    for row in 0..BRICK[1] {
        let sides = [(low, row), (low, row + 1), (high, row), (high, row + 1)];
        let rows = sides.map(|(slice, row)| &slice.values[row * samples..][..samples]);
        let inside = sides.map(|(slice, row)| &slice.inside[row * words..][..words]);
        visit_row(&Cell { field, corner: [0, y + row, z], inside: 0, rows }, inside, visitor);
        visitor.end_row();
    }
}

fn visit_row<V: Visitor>(first: &Cell<'_>, inside: [&[u64]; 4], visitor: &mut V) {
    for word in 0..inside[0].len() {
        let here = inside.map(|row| row[word]);
        let next =
            inside.map(|row| row[word] >> 1 | row.get(word + 1).copied().unwrap_or_default() << 63);
        let any = here.into_iter().chain(next).fold(0, |any, bits| any | bits);
        let all = here.into_iter().chain(next).fold(u64::MAX, |all, bits| all & bits);
        let mut mixed = any & !all;
        while mixed != 0 {
            let bit = mixed.trailing_zeros();
            mixed &= mixed - 1;
            let mut corners = 0;
            for row in 0..4 {
                corners |= (here[row] >> bit & 1) << (2 * row);
                corners |= (next[row] >> bit & 1) << (2 * row + 1);
            }
            let x = word * 64 + bit as usize;
            let corner = [x, first.corner[1], first.corner[2]];
            visitor.cell(&Cell { corner, inside: corners as u8, ..*first });
        }
    }
}
