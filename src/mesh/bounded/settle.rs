//! What of a decimated mesh is finished, and what can still change when its interfaces open.

use super::super::{Mesh, Patch, State, Threads, ring::Wing, surface::NONE};
use super::hanging::ByDeviation;

/// A mesh taken apart. Both parts know the vertices between them.
pub struct Settled {
    /// Faces that will not change; what hangs at them is forgotten. Its vertices that have faces
    /// elsewhere are shared.
    pub finished: Patch<ByDeviation>,
    /// The faces around vertices that may still be removed. Those between it and the finished part
    /// are settled.
    pub open: Patch<ByDeviation>,
    /// Vertices of the finished part that cannot be removed because their faces are no fan.
    pub complex_vertices: u64,
}

impl Mesh<ByDeviation> {
    /// Takes apart what is within `edges` edges of an interface, and the rest.
    #[must_use]
    pub fn settle(self, edges: usize) -> Settled {
        let is_open = self.near_interface(edges);
        let has_open = |face: &[u32; 3]| face.iter().any(|vertex| is_open[*vertex as usize]);
        let mut finished = self.part(|face| !has_open(face));
        let mut open = self.part(has_open);
        // Here as well as there.
        for (old, new) in open.numbers.iter().enumerate() {
            if *new != NONE && !is_open[old] {
                open.patch.settled.push(*new);
                if finished.numbers[old] != NONE {
                    finished.patch.shared.push(finished.numbers[old]);
                }
            }
        }
        for (old, new) in finished.numbers.iter().enumerate() {
            if *new != NONE && self.states[old].has(State::FROZEN) {
                finished.patch.shared.push(*new);
            }
        }
        for (old, new) in open.numbers.iter().enumerate() {
            if *new != NONE && is_open[old] && self.states[old].has(State::FROZEN) {
                open.patch.shared.push(*new);
            }
        }
        finished.patch.shared.sort_unstable();
        finished.patch.shared.dedup();
        let is_complex = |old: &usize| {
            finished.numbers[*old] != NONE && self.states[*old] == State::COMPLEX && !is_open[*old]
        };
        let complex_vertices = (0..self.states.len()).filter(is_complex).count() as u64;
        self.hang_in(&mut open, has_open);
        Settled { finished: finished.patch, open: open.patch, complex_vertices }
    }

    /// Which vertices are within so many edges of one that has faces elsewhere, unless those are
    /// finished.
    fn near_interface(&self, edges: usize) -> Vec<bool> {
        let is_interface = |state: &State| state.has(State::FROZEN) && !state.has(State::SETTLED);
        let mut is_near: Vec<bool> = self.states.iter().map(is_interface).collect();
        let mut border: Vec<u32> =
            (0..).zip(&is_near).filter(|(_, is_near)| **is_near).map(|(v, _)| v).collect();
        for _ in 0..edges {
            let mut next = Vec::new();
            for wing in border.iter().flat_map(|vertex| self.rings.of(*vertex)) {
                for vertex in [wing.next, wing.prev] {
                    let is_settled = self.states[vertex as usize].has(State::SETTLED);
                    if !is_settled && !std::mem::replace(&mut is_near[vertex as usize], true) {
                        next.push(vertex);
                    }
                }
            }
            border = next;
        }
        is_near
    }

    /// Some of the faces, with their vertices in their order.
    fn part(&self, takes: impl Fn(&[u32; 3]) -> bool) -> Part {
        let mut faces = Vec::new();
        let mut is_used = vec![false; self.states.len()];
        for vertex in 0..self.states.len() as u32 {
            let first = |wing: &&Wing| vertex < wing.next && vertex < wing.prev;
            for wing in self.rings.of(vertex).iter().filter(first) {
                let face = [vertex, wing.next, wing.prev];
                if takes(&face) {
                    faces.push(face);
                    for corner in face {
                        is_used[corner as usize] = true;
                    }
                }
            }
        }
        let used = is_used.iter().filter(|is_used| **is_used).count();
        let mut numbers = vec![NONE; self.states.len()];
        let mut patch = Patch {
            positions: Vec::with_capacity(used),
            carried: vec![(); used],
            faces,
            unit: self.unit,
            ..Patch::default()
        };
        for (old, number) in numbers.iter_mut().enumerate().filter(|(old, _)| is_used[*old]) {
            *number = patch.positions.len() as u32;
            patch.positions.push(self.position(old as u32));
            patch.colors.extend(self.colors.get(old));
            patch.normals.extend(self.normals.get(old));
        }
        for face in &mut patch.faces {
            *face = face.map(|vertex| numbers[vertex as usize]);
        }
        Part { patch, numbers }
    }

    /// Adds to a part, which has some of the faces, the vertices that hang at them.
    fn hang_in(&self, part: &mut Part, takes: impl Fn(&[u32; 3]) -> bool) {
        for (vertex, face) in self.hung().into_iter().filter(|(_, face)| takes(face)) {
            part.patch.positions.push(self.position(vertex));
            part.patch.carried.push(());
            part.patch.colors.extend(self.colors.get(vertex as usize));
            part.patch.normals.extend(self.normals.get(vertex as usize));
            part.patch.hung.push(face.map(|corner| part.numbers[corner as usize]));
        }
    }
}

/// A part of a mesh, and the numbers of its vertices by those they had.
struct Part {
    patch: Patch<ByDeviation>,
    numbers: Vec<u32>,
}

impl Mesh<ByDeviation> {
    /// As [`Self::of_joined`], with the vertices that hang at the faces.
    #[must_use]
    pub fn of_open(mut patch: Patch<ByDeviation>) -> Self {
        let split = patch.split();
        let mesh = Self::of_decimated(patch, Threads::This);
        Self { split, ..mesh }
    }
}
