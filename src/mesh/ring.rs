//! The faces around each vertex, side by side in memory.
//!
//! A ring is all there is of the faces: each lies in the rings of its three vertices. Looking at a
//! vertex then costs one cache line, where walking a list of faces would wait for one after the
//! other.

use rayon::prelude::*;

use super::{Threads, surface::NONE};

/// A face as one of its vertices sees it: the two others, counter-clockwise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub struct Wing {
    /// The vertex after it.
    pub next: u32,
    /// The vertex before it.
    pub prev: u32,
}

impl Wing {
    #[inline]
    pub(super) fn has(self, vertex: u32) -> bool {
        self.next == vertex || self.prev == vertex
    }
}

/// A face as each of its vertices sees it.
#[inline]
fn corners([a, b, c]: [u32; 3]) -> impl Iterator<Item = (u32, Wing)> {
    [(a, b, c), (b, c, a), (c, a, b)].into_iter().map(|(v, next, prev)| (v, Wing { next, prev }))
}

/// Faces of a ring that lie in its cache line.
pub(super) const NEAR_FACES: usize = 8;

/// A ring of up to [`NEAR_FACES`] faces; of a larger one, `next` of the first is its number among
/// the far ones.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(64))]
struct Line([Wing; NEAR_FACES]);

/// All rings.
#[derive(Debug, Default)]
pub(super) struct Rings {
    lines: Vec<Line>,
    counts: Vec<u16>,
    far: Vec<Vec<Wing>>,
    far_free: Vec<u32>,
}

/// Faces counted at a vertex; further ones would be lost, so that they are refused.
const RING_FACES_MAX: usize = u16::MAX as usize;

impl Rings {
    /// Bytes of memory of a vertex.
    pub(super) const VERTEX_BYTES: usize = size_of::<Line>() + size_of::<u16>();

    /// Makes the rings of faces over `vertices` vertices; returns the faces left out because a
    /// vertex had too many.
    pub(super) fn of_faces(vertices: usize, faces: &[[u32; 3]], threads: Threads) -> (Self, usize) {
        if threads == Threads::All
            && let Some(rings) = Self::of_faces_on_all_threads(vertices, faces)
        {
            return (rings, 0);
        }
        let mut rings = Self {
            lines: vec![Line::default(); vertices],
            counts: vec![0; vertices],
            ..Self::default()
        };
        let mut refused = 0;
        for face in faces {
            if face.iter().all(|vertex| rings.has_room(*vertex)) {
                corners(*face).for_each(|(vertex, wing)| rings.push(vertex, wing));
            } else {
                refused += 1;
            }
        }
        (rings, refused)
    }

    /// As [`Self::of_faces`]; `None` where a vertex has too many. Each thread goes over all faces,
    /// for those of its own vertices.
    fn of_faces_on_all_threads(vertices: usize, faces: &[[u32; 3]]) -> Option<Self> {
        let all = (0..vertices).into_par_iter();
        let (mut lines, mut counts) = (Vec::new(), Vec::new());
        all.map(|_| (Line::default(), 0_u16)).unzip_into_vecs(&mut lines, &mut counts);
        let each = vertices.div_ceil(rayon::current_num_threads()).max(1);
        let parts = lines.par_chunks_mut(each).zip(counts.par_chunks_mut(each)).enumerate();
        let fill = |(part, (lines, counts)): (usize, (&mut [Line], &mut [u16]))| {
            let mut beyond = Vec::new();
            for (vertex, wing) in faces.iter().flat_map(|face| corners(*face)) {
                let index = (vertex as usize).wrapping_sub(part * each);
                let Some(line) = lines.get_mut(index) else { continue };
                match line.0.get_mut(usize::from(counts[index])) {
                    Some(free) => {
                        *free = wing;
                        counts[index] += 1;
                    }
                    None => beyond.push((vertex, wing)),
                }
            }
            beyond
        };
        let beyond: Vec<Vec<(u32, Wing)>> = parts.map(fill).collect();
        let mut rings = Self { lines, counts, ..Self::default() };
        for (vertex, wing) in beyond.into_iter().flatten() {
            if !rings.has_room(vertex) {
                return None;
            }
            rings.push(vertex, wing);
        }
        Some(rings)
    }

    /// Faces at a vertex: none when it is gone.
    #[inline]
    pub(super) fn count(&self, vertex: u32) -> usize {
        usize::from(self.counts[vertex as usize])
    }

    /// The faces at a vertex, in no order.
    #[inline]
    pub(super) fn of(&self, vertex: u32) -> &[Wing] {
        let (line, count) = (&self.lines[vertex as usize], self.count(vertex));
        match line.0.get(..count) {
            Some(near) => near,
            None => &self.far[line.0[0].next as usize],
        }
    }

    #[inline]
    fn of_mut(&mut self, vertex: u32) -> &mut [Wing] {
        let (line, count) = (&mut self.lines[vertex as usize], self.counts[vertex as usize]);
        match usize::from(count) {
            count @ 0..=NEAR_FACES => &mut line.0[..count],
            _ => &mut self.far[line.0[0].next as usize],
        }
    }

    /// Adds a face to a ring, which [`Self::has_room`].
    #[inline]
    pub(super) fn push(&mut self, vertex: u32, wing: Wing) {
        let (line, count) = (&mut self.lines[vertex as usize], self.counts[vertex as usize]);
        let count = usize::from(count);
        self.counts[vertex as usize] += 1;
        match line.0.get_mut(count) {
            Some(free) => *free = wing,
            None if count == NEAR_FACES => {
                let number = self.far_free.pop().unwrap_or_else(|| {
                    self.far.push(Vec::with_capacity(2 * NEAR_FACES));
                    self.far.len() as u32 - 1
                });
                let far = &mut self.far[number as usize];
                far.clear();
                far.extend_from_slice(&line.0);
                far.push(wing);
                line.0[0].next = number;
            }
            None => self.far[line.0[0].next as usize].push(wing),
        }
    }

    /// Whether the ring of `vertex` can take a face.
    #[inline]
    pub(super) fn has_room(&self, vertex: u32) -> bool {
        self.count(vertex) < RING_FACES_MAX
    }

    /// Makes room for so many vertices in all.
    pub(super) fn make_room(&mut self, vertices: usize) {
        self.lines.reserve_exact(vertices.saturating_sub(self.lines.len()));
        self.counts.reserve_exact(vertices.saturating_sub(self.counts.len()));
    }

    /// Adds a vertex without faces.
    #[inline]
    pub(super) fn add_vertex(&mut self) {
        self.lines.push(Line::default());
        self.counts.push(0);
    }

    /// Takes a face out of the ring of `vertex`, which has it.
    pub(super) fn take_out(&mut self, vertex: u32, wing: Wing) {
        let ring = self.of_mut(vertex);
        let last = ring.len() - 1;
        let at = ring.iter().position(|other| *other == wing);
        debug_assert!(at.is_some(), "a face is in the rings of its vertices");
        ring.swap(at.unwrap_or(last), last);
        self.truncate(vertex, last);
    }

    /// Renumbers the vertices, in their order, and forgets those that have no new number; they
    /// have no faces.
    pub(super) fn compact(&mut self, old_to_new: &[u32]) {
        let renumber = |wing: &mut Wing| {
            wing.next = old_to_new[wing.next as usize];
            wing.prev = old_to_new[wing.prev as usize];
        };
        let mut left = 0;
        for (old, new) in old_to_new.iter().enumerate() {
            if *new == NONE {
                debug_assert_eq!(self.counts[old], 0, "what goes has no faces");
                continue;
            }
            self.of_mut(old as u32).iter_mut().for_each(renumber);
            self.lines[left] = self.lines[old];
            self.counts[left] = self.counts[old];
            left += 1;
        }
        self.lines.truncate(left);
        self.counts.truncate(left);
    }

    /// Forgets the last faces of a vertex.
    fn truncate(&mut self, vertex: u32, count: usize) {
        let before = self.count(vertex);
        let line = &mut self.lines[vertex as usize];
        if before > NEAR_FACES {
            let number = line.0[0].next;
            let far = &mut self.far[number as usize];
            far.truncate(count);
            if count <= NEAR_FACES {
                line.0[..count].copy_from_slice(far);
                self.far_free.push(number);
            }
        }
        self.counts[vertex as usize] = count as u16;
    }

    /// Makes `kept` of `removed` in the ring of `vertex`.
    #[inline]
    pub(super) fn rename(&mut self, vertex: u32, removed: u32, kept: u32) {
        let other = |found: u32| if found == removed { kept } else { found };
        let rename = |wing: Wing| Wing { next: other(wing.next), prev: other(wing.prev) };
        if self.count(vertex) <= NEAR_FACES {
            // What lies behind the count does not matter, and a whole line is a few instructions.
            let line = &mut self.lines[vertex as usize].0;
            *line = line.map(rename);
        } else {
            for wing in self.of_mut(vertex) {
                *wing = rename(*wing);
            }
        }
    }

    /// Forgets the face at `vertex` whose two other corners have become one.
    #[inline]
    pub(super) fn drop_folded(&mut self, vertex: u32) {
        let ring = self.of_mut(vertex);
        let last = ring.len() - 1;
        if let Some(folded) = ring.iter().position(|wing| wing.next == wing.prev) {
            ring[folded] = ring[last];
            self.truncate(vertex, last);
        }
    }

    /// Moves the faces of `removed` to the ring of `kept`; those that have both are gone. Returns
    /// their number. `ring` is a copy of the ring of `removed`.
    #[inline]
    pub(super) fn unite(&mut self, removed: u32, kept: u32, ring: &[Wing]) -> usize {
        let around = self.of_mut(kept);
        let mut left = 0;
        for index in 0..around.len() {
            let wing = around[index];
            around[left] = wing;
            left += usize::from(!wing.has(removed));
        }
        let gone = around.len() - left;
        self.truncate(kept, left);
        for wing in ring.iter().filter(|wing| !wing.has(kept)) {
            self.push(kept, *wing);
        }
        self.truncate(removed, 0);
        gone
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A fan of `count` faces around vertex 0.
    fn fan(count: u32) -> Vec<[u32; 3]> {
        (0..count).map(|i| [0, 1 + i, 1 + (i + 1) % count]).collect()
    }

    #[test]
    fn rings_of_any_size_are_kept_and_shrink_again() {
        for count in [3, 8, 9, 40] {
            let of_faces = |by| Rings::of_faces(count as usize + 1, &fan(count), by);
            let (mut rings, refused) = of_faces(Threads::This);
            assert_eq!((rings.count(0), refused), (count as usize, 0));
            let (by_all, _) = of_faces(Threads::All);
            assert!((0..=count).all(|vertex| by_all.of(vertex) == rings.of(vertex)));
            let expected: Vec<Wing> =
                fan(count).iter().map(|f| Wing { next: f[1], prev: f[2] }).collect();
            assert_eq!(rings.of(0), expected);
            for removed in 2..count {
                rings.rename(0, removed, removed + 1);
                rings.drop_folded(0);
                assert_eq!(rings.count(0), (count - (removed - 1)) as usize);
                assert!(!rings.of(0).iter().any(|wing| wing.has(removed)));
            }
        }
    }

    #[test]
    fn uniting_drops_the_faces_of_both() {
        //   2---3        2---3
        //  / \ / \   →    \ / \
        // 5---0---1        0---1     (5 is removed into 0; 4 is below)
        let faces = [[0, 1, 3], [0, 3, 2], [0, 2, 5], [5, 4, 0], [0, 4, 1], [5, 2, 6], [5, 6, 4]];
        let (mut rings, _) = Rings::of_faces(7, &faces, Threads::This);
        let ring = rings.of(5).to_vec();
        assert_eq!(rings.unite(5, 0, &ring), 2);
        assert_eq!((rings.count(5), rings.count(0)), (0, 5));
        assert!(rings.of(0).contains(&Wing { next: 2, prev: 6 }));
    }
}
