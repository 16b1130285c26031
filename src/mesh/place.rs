//! Moves the vertices that are left to where their quadrics are least.

use glam::Vec3;

use super::{ByQuadric, State, ring::Wing, surface::Mesh};

/// Moves every vertex that is not frozen to the optimum of its quadric, as far as no face turns
/// over and no further than its longest edge `[WK03 §4.4]`.
pub(super) fn place(mesh: &mut Mesh<ByQuadric>) {
    for vertex in 0..mesh.spots.len() as u32 {
        let state = mesh.states[vertex as usize];
        let is_bound = state.has(State::FROZEN) || state.has(State::COMPLEX);
        if is_bound || mesh.rings.count(vertex) == 0 {
            continue;
        }
        let Some(step) = mesh.quadric(vertex).minimum() else { continue };
        if let Some(to) = mesh.reachable(vertex, step) {
            mesh.move_to(vertex, to);
        }
    }
}

/// Fractions of the way that are tried.
const FRACTIONS: [f32; 3] = [1.0, 0.5, 0.25];

impl Mesh<ByQuadric> {
    pub(super) fn reachable(&self, vertex: u32, step: Vec3) -> Option<Vec3> {
        let (from, ring) = (self.position(vertex), self.rings.of(vertex));
        let reach_sq = ring.iter().fold(0.0_f32, |reach, face| {
            let to_next = self.position(face.next).distance_squared(from);
            reach.max(to_next).max(self.position(face.prev).distance_squared(from))
        });
        if step.length_squared() > reach_sq {
            return None;
        }
        let places = FRACTIONS.iter().map(|fraction| from + step * *fraction);
        let mut places = places.filter(|to| self.keeps_ring_up(from, *to, ring));
        places.next()
    }

    fn keeps_ring_up(&self, from: Vec3, to: Vec3, ring: &[Wing]) -> bool {
        ring.iter().all(|face| {
            let (u, w) = (self.position(face.next), self.position(face.prev));
            let edge = w - u;
            (u - from).cross(edge).dot((u - to).cross(edge)) > 0.0
        })
    }
}
