//! A mesh that grows by splits: what both sides of a progressive mesh have in core.

use super::HalfEdges;
use crate::{
    error::Fault,
    formats::progressive::{Base, Channels, Header, Kind, Split},
};

/// Half-edges with positions and colours.
#[derive(Clone, Debug)]
pub struct Growing {
    half_edges: HalfEdges,
    /// In steps from the origin.
    positions: Vec<[u32; 3]>,
    /// Empty without colours.
    colors: Vec<[u8; 4]>,
    channels: Channels,
    /// What coordinates are modulo, less 1.
    mask: u32,
}

impl Growing {
    /// Bytes of memory of a face, with its share of the vertices.
    pub const FACE_BYTES: u64 = HalfEdges::FACE_BYTES + 8;

    /// The base alone, with the header's bits and channels.
    #[must_use]
    pub fn of_base(base: &Base, header: &Header) -> Self {
        Self {
            half_edges: HalfEdges::of_faces(base.positions.len(), &base.faces),
            positions: base.positions.clone(),
            colors: base.colors.clone(),
            channels: header.channels,
            mask: (1 << header.bits) - 1,
        }
    }

    /// Makes room for so many vertices and faces in all.
    pub fn make_room(&mut self, vertices: usize, faces: usize) {
        self.half_edges.make_room(vertices, faces);
        self.positions.reserve_exact(vertices.saturating_sub(self.positions.len()));
        if self.channels != Channels::None {
            self.colors.reserve_exact(vertices.saturating_sub(self.colors.len()));
        }
    }

    /// Splits a vertex.
    ///
    /// # Errors
    /// As [`HalfEdges::split`].
    #[inline]
    pub fn split(&mut self, split: &Split) -> Result<(), Fault> {
        self.half_edges.split(split)?;
        let before = self.positions[split.parent as usize];
        let add = |position: u32, step: i32| position.wrapping_add(step as u32) & self.mask;
        let after = std::array::from_fn(|axis| add(before[axis], split.step[axis]));
        let guess = guess(before, after);
        let new = std::array::from_fn(|axis| add(guess[axis], split.rest[axis]));
        self.positions[split.parent as usize] = after;
        self.positions.push(new);
        if self.channels != Channels::None {
            let color = self.colors[split.parent as usize];
            let moved = |step: [u8; 4]| {
                let mut color: [u8; 4] = std::array::from_fn(|c| color[c].wrapping_add(step[c]));
                if self.channels == Channels::Rgb {
                    color[3] = 255;
                }
                color
            };
            let (parent, new) = (moved(split.color_step), moved(split.color_rest));
            self.colors[split.parent as usize] = parent;
            self.colors.push(new);
        }
        Ok(())
    }

    /// Corners by face.
    #[must_use]
    pub fn faces(&self) -> &[[u32; 3]] {
        self.half_edges.faces()
    }

    /// Positions by vertex, in steps from the origin.
    #[must_use]
    pub fn positions(&self) -> &[[u32; 3]] {
        &self.positions
    }

    /// RGBA by vertex; empty without colours.
    #[must_use]
    pub fn colors(&self) -> &[[u8; 4]] {
        &self.colors
    }

    /// How the faces meet.
    #[must_use]
    pub fn half_edges(&self) -> &HalfEdges {
        &self.half_edges
    }

    /// The kind of split, its first face and how many it takes, so that a new vertex lies between
    /// the neighbours `apexes` of `parent`; `None` where there is no such split. Without the first,
    /// it is at the beginning of an open fan, without the second, at the end.
    pub(super) fn sector(
        &self,
        parent: u32,
        apexes: [Option<u32>; 2],
        walked: &mut Vec<u32>,
    ) -> Option<(Kind, u32, u32)> {
        let fan = self.half_edges.walk(parent, walked)?;
        let place = |vertex: u32| {
            let place = self.half_edges.neighbours(fan, walked).position(|found| found == vertex);
            place.map(|place| place as u32)
        };
        let count = self.half_edges.neighbours(fan, walked).count() as u32;
        let is_open = fan == super::half_edges::Fan::Open;
        match apexes {
            [Some(from), Some(to)] => {
                let (from, to) = (place(from)?, place(to)?);
                let taken =
                    if to > from || is_open { to.checked_sub(from)? } else { to + count - from };
                (taken > 0).then_some((Kind::Between, from, taken))
            }
            [None, Some(to)] if is_open => Some((Kind::First, 0, place(to)?)),
            [Some(from), None] if is_open => Some((Kind::Last, 0, count - 1 - place(from)?)),
            _ => None,
        }
    }
}

/// Where a new vertex is expected: as if its parent had lain in the middle of the two. Modulo 2³².
pub(super) fn guess(before: [u32; 3], after: [u32; 3]) -> [u32; 3] {
    std::array::from_fn(|axis| before[axis].wrapping_mul(2).wrapping_sub(after[axis]))
}
