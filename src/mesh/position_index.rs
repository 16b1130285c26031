//! Vertices by position, while some come and others go.

use glam::Vec3;

use super::{surface::NONE, weld::hash};

/// Vertices by position: open addressing, at most three quarters full. Where a vertex is, its owner tells.
pub struct PositionIndex {
    slots: Vec<u32>,
    count: usize,
}

impl PositionIndex {
    /// An empty index with room for so many; it grows beyond.
    #[must_use]
    pub fn with_room_for(vertices: usize) -> Self {
        let slots = (vertices / 2 * 3).next_power_of_two().max(16);
        Self { slots: vec![NONE; slots], count: 0 }
    }

    /// The vertex at `position`, or `new`, which is at home there from now on.
    #[inline]
    pub fn find_or_add(&mut self, position: Vec3, new: u32, at: impl Fn(u32) -> Vec3) -> u32 {
        let mut slot = self.first_slot(position);
        loop {
            match self.slots[slot] {
                NONE => break,
                vertex if at(vertex) == position => return vertex,
                _ => slot = (slot + 1) & (self.slots.len() - 1),
            }
        }
        self.slots[slot] = new;
        self.count += 1;
        if 4 * self.count > 3 * self.slots.len() {
            let at = |vertex| if vertex == new { position } else { at(vertex) };
            let slots = std::mem::take(&mut self.slots);
            self.slots = vec![NONE; 2 * slots.len()];
            slots.into_iter().filter(|v| *v != NONE).for_each(|v| self.place(v, at(v)));
        }
        new
    }

    #[inline]
    fn first_slot(&self, position: Vec3) -> usize {
        hash(position) as usize & (self.slots.len() - 1)
    }

    fn place(&mut self, vertex: u32, position: Vec3) {
        let mut slot = self.first_slot(position);
        while self.slots[slot] != NONE {
            slot = (slot + 1) & (self.slots.len() - 1);
        }
        self.slots[slot] = vertex;
    }

    /// Forgets all vertices but these, each at a position of its own.
    pub(super) fn refill(&mut self, vertices: &[u32], at: impl Fn(u32) -> Vec3) {
        let slots = (2 * vertices.len()).next_power_of_two().max(16);
        if self.slots.len() > SLACK * slots || self.slots.len() < slots {
            self.slots = vec![NONE; slots];
        } else {
            self.slots.fill(NONE);
        }
        for vertex in vertices {
            self.place(*vertex, at(*vertex));
        }
        self.count = vertices.len();
    }
}

/// A table this many times too large is made anew, smaller.
const SLACK: usize = 8;
