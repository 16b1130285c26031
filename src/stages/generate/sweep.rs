//! The sweep over a grid in slabs: one slab is made by all threads while the one before it is
//! delivered, in order, by the caller's thread.

use rayon::iter::{IntoParallelIterator, ParallelIterator};

use super::{
    field::{BRICK, Field},
    tile::{Scratch, Visitor, scan},
};
use crate::{Result, progress::Meter};

/// Makes `count` slabs and delivers them in order. `deliver` runs on the caller's thread only;
/// at most two slabs are in memory.
pub(super) fn sweep<T: Send>(
    count: usize,
    make: impl Fn(usize) -> Result<T> + Sync,
    mut deliver: impl FnMut(T) -> Result<()>,
) -> Result<()> {
    let mut ready = if count > 0 { Some(make(0)?) } else { None };
    let mut slab = 0;
    while let Some(made) = ready.take() {
        slab += 1;
        let mut next = None;
        let delivered = rayon::in_place_scope(|scope| {
            if slab < count {
                scope.spawn(|_| next = Some(make(slab)));
            }
            deliver(made)
        });
        delivered?;
        ready = next.transpose()?;
    }
    Ok(())
}

/// What the rows of one tile gave: layer by layer, and in each layer row by row.
#[derive(Default)]
pub(super) struct Rows<T> {
    pub(super) items: Vec<T>,
    /// End of each row in `items`.
    ends: Vec<usize>,
}

impl<T> Rows<T> {
    /// Ends a row.
    pub(super) fn end_row(&mut self) {
        self.ends.push(self.items.len());
    }

    /// Row `row` of layer `layer`.
    pub(super) fn row(&self, layer: usize, row: usize) -> &[T] {
        let row = layer * BRICK[1] + row;
        &self.items[self.end_before(row)..self.ends[row]]
    }

    /// All rows of layer `layer`.
    pub(super) fn layer(&self, layer: usize) -> &[T] {
        &self.items[self.end_before(layer * BRICK[1])..self.end_before((layer + 1) * BRICK[1])]
    }

    fn end_before(&self, row: usize) -> usize {
        if row == 0 { 0 } else { self.ends[row - 1] }
    }
}

/// Visits slab `slab` of `field`, its tiles in parallel, each with a visitor of its own.
pub(super) fn scan_slab<V: Visitor + Default + Send>(
    field: &Field,
    slab: usize,
    meter: &Meter<'_>,
) -> Result<Vec<V>> {
    (0..field.cells() / BRICK[1])
        .into_par_iter()
        .map_init(Scratch::default, |scratch, tile| {
            let mut visitor = V::default();
            scan(field, (tile, slab), scratch, &mut visitor);
            meter.add(tile_cells(field))?;
            Ok(visitor)
        })
        .collect()
}

/// Cells of one tile: the unit of progress is a cell, since how many triangles there will be is
/// not known before.
pub(super) fn tile_cells(field: &Field) -> u64 {
    (field.cells() * BRICK[1] * BRICK[2]) as u64
}
