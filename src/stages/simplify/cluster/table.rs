//! The partial sums of the cells that were seen, and the triangles between them.

use super::{
    placed::{BLOCK, Block, Placed},
    sums::{CellSums, LIMIT, SUMS, TotalSums, WEIGHT},
};
use crate::{
    geometry::{CellId, Grid},
    soup::{ATTRIBUTES_MAX, Triangle, Vertex},
};

/// Cells in first-touch order, found by id through open addressing.
pub(super) struct CellTable<V: Vertex> {
    /// Index into the arrays below plus one, or 0. Length a power of two.
    slots: Vec<u32>,
    pub(super) ids: Vec<CellId>,
    pub(super) sums: Vec<CellSums>,
    pub(super) attributes: Vec<V::Sums>,
    /// Triangles with three different cells, as indices into the arrays above.
    pub(super) triangles: Vec<[u32; 3]>,
    /// What did not fit 32 bits.
    pub(super) overflow: Vec<Overflow>,
    /// The cells seen last, by the high bits of their hashes: on coherent input nearly every
    /// look-up ends here, in the caches of the core.
    recent: Box<[(CellId, u32)]>,
    /// Triangles without area.
    pub(super) degenerate: u64,
    /// First record of the first batch with one.
    pub(super) degenerate_first: Option<u64>,
}

/// Sums moved out of a cell before they could overflow.
#[derive(Clone, Copy, Debug)]
pub(super) struct Overflow {
    pub(super) id: CellId,
    pub(super) sums: TotalSums,
    pub(super) attributes: [i64; ATTRIBUTES_MAX],
}

/// Bits of the key into [`CellTable::recent`]: 4096 cells, 64 KiB.
const RECENT_BITS: u32 = 12;
const NO_CELL: CellId = CellId(u64::MAX);
/// Slots of an empty table.
const SLOTS_MIN: usize = 1 << 10;

impl<V: Vertex> CellTable<V> {
    pub(super) fn new() -> Self {
        Self {
            slots: vec![0; SLOTS_MIN],
            ids: Vec::new(),
            sums: Vec::new(),
            attributes: Vec::new(),
            triangles: Vec::new(),
            overflow: Vec::new(),
            recent: vec![(NO_CELL, 0); 1 << RECENT_BITS].into_boxed_slice(),
            degenerate: 0,
            degenerate_first: None,
        }
    }

    /// Bytes in use, and those that spilling takes beside them.
    pub(super) fn size_bytes(&self) -> u64 {
        let order_and_rank = 2 * size_of::<u32>();
        let cell = size_of::<CellId>() + size_of::<CellSums>() + size_of::<V::Sums>();
        let cell = cell + order_and_rank;
        let bytes = self.slots.len() * size_of::<u32>()
            + self.ids.len() * cell
            + self.triangles.len() * size_of::<[u32; 3]>()
            + self.overflow.len() * size_of::<Overflow>();
        bytes as u64
    }

    /// Gives back the memory of the index: from here on cells are known by their place only.
    pub(super) fn drop_index(&mut self) {
        self.slots = Vec::new();
        self.ids = Vec::new();
    }

    /// Forgets all cells and triangles, keeps the memory.
    pub(super) fn clear(&mut self) {
        self.slots.fill(0);
        self.ids.clear();
        self.sums.clear();
        self.attributes.clear();
        self.triangles.clear();
        self.overflow.clear();
        self.recent.fill((NO_CELL, 0));
    }

    /// Adds a batch of triangles that begins with record `first`.
    pub(super) fn add(&mut self, grid: &Grid, triangles: &[Triangle<V>], first: u64) {
        let degenerate = self.degenerate;
        let mut block = Block::new();
        for triangles in triangles.chunks(BLOCK) {
            block.fill(grid, triangles);
            self.add_block(&block, triangles);
        }
        if degenerate == 0 && self.degenerate > 0 {
            self.degenerate_first = Some(first);
        }
    }

    /// Adds all cells and triangles to `other` and forgets them. `places` is overwritten.
    pub(super) fn pour_into(&mut self, other: &mut Self, places: &mut Vec<u32>) {
        places.clear();
        places.extend(self.ids.iter().map(|id| other.find_slowly(*id)));
        for ((place, sums), attributes) in places.iter().zip(&self.sums).zip(&self.attributes) {
            other.add_sums(*place as usize, sums, attributes);
        }
        let placed = |cell: u32| places[cell as usize];
        other.triangles.extend(self.triangles.iter().map(|triangle| triangle.map(placed)));
        for entry in self.overflow.drain(..) {
            other.put_aside(entry);
        }
        self.clear();
    }

    /// Adds what another table has of a cell.
    #[inline]
    fn add_sums(&mut self, cell: usize, add: &CellSums, more: &V::Sums) {
        let is_far = add_to(&mut self.sums[cell], add);
        for (sum, add) in self.attributes[cell].as_mut().iter_mut().zip(more.as_ref()) {
            *sum += add;
        }
        if is_far {
            self.move_out(cell);
        }
    }

    fn add_block(&mut self, block: &Block, triangles: &[Triangle<V>]) {
        let has_no_area = |placed: &&Placed| placed.stamp.twice_area <= f32::MIN_POSITIVE;
        self.degenerate += block.placed.iter().filter(has_no_area).count() as u64;
        for (placed, index) in block.in_cells(1) {
            let cell = self.find(placed.cells[0]);
            self.put(cell, &placed.stamp.whole(placed.locals), &triangles[index].0);
        }
        for (placed, index) in block.in_cells(2) {
            let Placed { cells, locals, stamp, .. } = placed;
            let vertices = &triangles[index].0;
            // Corners that share a cell are added as one.
            let (alone, [i, j]) = placed.alone_and_others();
            let both = self.find(cells[i]);
            self.put(both, &stamp.pair([i, j], locals), &[vertices[i], vertices[j]]);
            let other = self.find(cells[alone]);
            let sums = stamp.corner(alone, locals[alone]);
            self.put(other, &sums, &vertices[alone..=alone]);
        }
        for (placed, index) in block.in_cells(3) {
            let Placed { cells, locals, stamp, .. } = placed;
            let vertices = &triangles[index].0;
            let found = cells.map(|cell| self.find(cell));
            for corner in 0..3 {
                let sums = stamp.corner(corner, locals[corner]);
                self.put(found[corner], &sums, &vertices[corner..=corner]);
            }
            self.triangles.push(found);
        }
    }

    /// Index of a cell, new if it must be.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "measured: a tenth of the pass")]
    fn find(&mut self, cell: [u32; 3]) -> u32 {
        let id = CellId::new(cell);
        let near = (hash(id) >> (u64::BITS - RECENT_BITS)) as usize;
        let recent = &mut self.recent[near];
        if recent.0 == id {
            return recent.1;
        }
        let index = self.find_slowly(id);
        self.recent[near] = (id, index);
        index
    }

    #[inline(never)]
    fn find_slowly(&mut self, id: CellId) -> u32 {
        let mask = self.slots.len() - 1;
        let mut slot = hash(id) as usize & mask;
        loop {
            match self.slots[slot] {
                0 => break,
                entry if self.ids[entry as usize - 1] == id => return entry - 1,
                _ => slot = (slot + 1) & mask,
            }
        }
        self.ids.push(id);
        self.sums.push([0; SUMS]);
        self.attributes.push(V::Sums::default());
        let entry = self.ids.len() as u32;
        self.slots[slot] = entry;
        // At most three quarters full.
        if self.ids.len() * 4 > self.slots.len() * 3 {
            self.rehash();
        }
        entry - 1
    }

    fn rehash(&mut self) {
        let mask = self.slots.len() * 2 - 1;
        // The old slots are not needed to make the new ones: free them first.
        self.slots = Vec::new();
        self.slots = vec![0; mask + 1];
        for (index, id) in self.ids.iter().enumerate() {
            let mut slot = hash(*id) as usize & mask;
            while self.slots[slot] != 0 {
                slot = (slot + 1) & mask;
            }
            self.slots[slot] = index as u32 + 1;
        }
    }

    /// Adds to a cell what some vertices of a triangle bring, their attributes in equal shares.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "measured: a tenth of the pass")]
    fn put(&mut self, cell: u32, add: &CellSums, vertices: &[V]) {
        let is_far = add_to(&mut self.sums[cell as usize], add);
        if size_of::<V::Sums>() > 0 {
            let attributes = self.attributes[cell as usize].as_mut();
            let (each, rest) =
                (add[WEIGHT] / vertices.len() as i32, add[WEIGHT] as usize % vertices.len());
            for (index, vertex) in vertices.iter().enumerate() {
                // The whole weight is shared out: what is left over would darken the mean.
                let weight = each + i32::from(index < rest);
                for (sum, add) in attributes.iter_mut().zip(vertex.weigh(weight).as_ref()) {
                    *sum += add;
                }
            }
        }
        if is_far {
            self.move_out(cell as usize);
        }
    }

    /// Attribute sums never exceed the sum of weights, so both move together.
    #[cold]
    fn move_out(&mut self, cell: usize) {
        let sums = std::mem::replace(&mut self.sums[cell], [0; SUMS]).map(i64::from);
        let attributes = widen(std::mem::take(&mut self.attributes[cell]).as_ref());
        self.put_aside(Overflow { id: self.ids[cell], sums, attributes });
    }

    fn put_aside(&mut self, entry: Overflow) {
        self.overflow.push(entry);
        // All triangles in one cell: keep one entry a cell, not one every few thousand triangles.
        if self.overflow.len() >= 1 << 12 && self.overflow.len() > 2 * self.ids.len().min(1 << 20) {
            self.compact_overflow();
        }
    }

    /// Sorts the overflow by cell and adds up equal cells.
    pub(super) fn compact_overflow(&mut self) {
        self.overflow.sort_unstable_by_key(|entry| entry.id);
        self.overflow.dedup_by(|next, kept| {
            let same = next.id == kept.id;
            if same {
                add(&mut kept.sums, &next.sums);
                add(&mut kept.attributes, &next.attributes);
            }
            same
        });
    }
}

/// Adds sums that are both within ±[`LIMIT`], and tells whether one of the results is not.
#[inline(always)]
#[expect(clippy::inline_always, reason = "measured: a tenth of the pass")]
fn add_to(sums: &mut CellSums, add: &CellSums) -> bool {
    const { assert!(LIMIT == 1 << (i32::BITS - 2)) };
    let mut far = 0;
    for (sum, add) in sums.iter_mut().zip(add) {
        *sum += add;
        // The two highest bits differ.
        far |= *sum ^ (*sum << 1);
    }
    far < 0
}

/// Adds slices, element by element.
pub(super) fn add(total: &mut [i64], more: &[i64]) {
    for (total, more) in total.iter_mut().zip(more) {
        *total += more;
    }
}

/// Attribute sums as wide numbers; those a payload does not have are 0.
pub(super) fn widen(sums: &[i32]) -> [i64; ATTRIBUTES_MAX] {
    std::array::from_fn(|i| sums.get(i).copied().map_or(0, i64::from))
}

/// Spreads ids over the slots: the high half of a product with 2⁶⁴/φ.
#[inline]
fn hash(id: CellId) -> u64 {
    let product = id.0.wrapping_mul(0x9E37_79B9_7F4A_7C15);
    product ^ product >> 32
}
