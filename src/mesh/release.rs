//! WRITE: faces leave the mesh for good `[WK03 §4.4]`.
//!
//! A face that is written takes its vertices to the interface `P_bc`: they are moved to where their
//! quadrics are least, once, and are frozen from then on, so that what is written later fits.

use super::{
    ByQuadric, Choice, State,
    classify::is_end,
    place::place,
    ring::Wing,
    surface::{Mesh, Spot},
};
use crate::soup::{Triangle, Vertex};

/// What writing came to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Released {
    /// Faces written.
    pub faces: usize,
    /// Those of them that were not adjacent to `P_bc`, because no such face could be written.
    pub inside: usize,
}

/// A face by its vertices, counter-clockwise.
type Face = [u32; 3];

/// Faces drawn inside for one decision, for each candidate.
const DRAWS_MAX: usize = 64;

/// The vertices of `P_bc` that may have a face to write.
struct Rim(Vec<u32>);

/// Takes `faces` faces out of the mesh, as far as there are any without a vertex on `P_ab`, and
/// appends them to `out`. Each is the one with the largest error of a few random ones next to
/// `P_bc`; only where there is none next to it, of any.
pub fn release<V: Vertex>(
    mesh: &mut Mesh<ByQuadric>,
    faces: usize,
    choice: &mut Choice,
    out: &mut Vec<Triangle<V>>,
) -> Released {
    let mut rim = Rim::of(mesh);
    let mut released = Released::default();
    while released.faces < faces {
        let beside = largest_error(mesh, choice, |choice, mesh| rim.draw(mesh, choice));
        let found = beside.or_else(|| {
            released.inside += 1;
            largest_error(mesh, choice, |choice, mesh| draw_inside(mesh, choice))
        });
        let Some(face) = found else {
            released.inside -= 1;
            break;
        };
        mesh.write(face, out);
        released.faces += 1;
        for vertex in face {
            rim.add(mesh, vertex);
        }
    }
    rim.forget(mesh);
    released
}

/// Moves all vertices that are not frozen to their best places, and passes all faces to `sink`, in
/// the order of their first vertices. The mesh is complete: nothing is on `P_ab`.
///
/// # Errors
/// What `sink` returns.
pub fn release_all<V: Vertex, E>(
    mesh: &mut Mesh<ByQuadric>,
    mut sink: impl FnMut(&[Triangle<V>]) -> Result<(), E>,
) -> Result<(), E> {
    place(mesh);
    let mut batch = Vec::with_capacity(BATCH_FACES);
    for vertex in 0..mesh.spots.len() as u32 {
        let is_first = |wing: &&Wing| vertex < wing.next && vertex < wing.prev;
        for wing in mesh.rings.of(vertex).iter().filter(is_first) {
            batch.push(mesh.triangle([vertex, wing.next, wing.prev]));
        }
        if batch.len() >= BATCH_FACES {
            sink(&batch)?;
            batch.clear();
        }
    }
    if batch.is_empty() { Ok(()) } else { sink(&batch) }
}

/// Faces passed on together.
const BATCH_FACES: usize = 1 << 12;

/// Of as many faces as there are choices, the one with the largest error.
fn largest_error(
    mesh: &mut Mesh<ByQuadric>,
    choice: &mut Choice,
    mut draw: impl FnMut(&mut Choice, &mut Mesh<ByQuadric>) -> Option<Face>,
) -> Option<Face> {
    let mut best: Option<(f32, Face)> = None;
    for _ in 0..choice.choices() {
        let Some(face) = draw(choice, mesh) else { break };
        let error = mesh.face_error(face);
        if best.is_none_or(|(largest, _)| error > largest) {
            best = Some((error, face));
        }
    }
    best.map(|(_, face)| face)
}

/// A random face without a vertex on `P_ab`.
fn draw_inside(mesh: &Mesh<ByQuadric>, choice: &mut Choice) -> Option<Face> {
    let vertices = mesh.spots.len();
    let is_open = |vertex: u32| mesh.states[vertex as usize].has(State::OPEN);
    (0..DRAWS_MAX.min(vertices)).find_map(|_| {
        let vertex = choice.below(vertices) as u32;
        let ring = mesh.rings.of(vertex);
        if ring.is_empty() {
            return None;
        }
        let wing = ring[choice.below(ring.len())];
        let face = [vertex, wing.next, wing.prev];
        (!face.into_iter().any(is_open)).then_some(face)
    })
}

impl Rim {
    fn of(mesh: &mut Mesh<ByQuadric>) -> Self {
        let mut rim = Self(Vec::new());
        for vertex in 0..mesh.states.len() as u32 {
            if mesh.states[vertex as usize].has(State::FROZEN) {
                rim.add(mesh, vertex);
            }
        }
        rim
    }

    /// Adds a frozen vertex, once, if it has faces.
    fn add(&mut self, mesh: &mut Mesh<ByQuadric>, vertex: u32) {
        let state = &mut mesh.states[vertex as usize];
        if mesh.rings.count(vertex) > 0 && !state.has(State::LISTED) {
            *state = state.with(State::LISTED);
            self.0.push(vertex);
        }
    }

    /// A random face with an edge on `P_bc` and no vertex on `P_ab`. Vertices that have none are taken
    /// from the list: they get one only when a face beside them is written, which lists them again.
    fn draw(&mut self, mesh: &mut Mesh<ByQuadric>, choice: &mut Choice) -> Option<Face> {
        while !self.0.is_empty() {
            let at = choice.below(self.0.len());
            let vertex = self.0[at];
            let ring = mesh.rings.of(vertex);
            let state = |other: u32| mesh.states[other as usize];
            let is_edge = |other: u32| state(other).has(State::FROZEN) && is_end(ring, other);
            let is_beside = |wing: &&Wing| {
                let is_open =
                    state(wing.next).has(State::OPEN) || state(wing.prev).has(State::OPEN);
                !is_open && (is_edge(wing.next) || is_edge(wing.prev))
            };
            let mut beside = ring.iter().filter(is_beside);
            if let Some(first) = beside.next() {
                let second = beside.next().filter(|_| choice.below(2) == 1);
                let wing = second.unwrap_or(first);
                return Some([vertex, wing.next, wing.prev]);
            }
            self.0.swap_remove(at);
            let state = &mut mesh.states[vertex as usize];
            *state = state.without(State::LISTED);
        }
        None
    }

    fn forget(self, mesh: &mut Mesh<ByQuadric>) {
        for vertex in self.0 {
            let state = &mut mesh.states[vertex as usize];
            *state = state.without(State::LISTED);
        }
    }
}

impl Mesh<ByQuadric> {
    /// The sum of the errors of a face's vertices, at its centre.
    fn face_error(&self, face: Face) -> f32 {
        let [a, b, c] = face.map(|vertex| self.position(vertex));
        let centre = (a + b + c) / 3.0;
        let at = |vertex: u32| self.quadric(vertex).at(centre - self.position(vertex));
        face.into_iter().map(at).sum()
    }

    /// Takes a face out, its vertices placed and frozen.
    fn write<V: Vertex>(&mut self, face: Face, out: &mut Vec<Triangle<V>>) {
        let [a, b, c] = face;
        for vertex in face {
            self.freeze(vertex);
        }
        out.push(self.triangle(face));
        self.rings.take_out(a, Wing { next: b, prev: c });
        self.rings.take_out(b, Wing { next: c, prev: a });
        self.rings.take_out(c, Wing { next: a, prev: b });
        self.faces_left -= 1;
    }

    /// Freezes a vertex at its best place. All its faces are still here, so none turns over.
    fn freeze(&mut self, vertex: u32) {
        let state = self.states[vertex as usize];
        if state.has(State::FROZEN) {
            return;
        }
        self.states[vertex as usize] = state.frozen();
        if state.has(State::COMPLEX) {
            return;
        }
        let quadric = self.quadric(vertex);
        let to = quadric.minimum().and_then(|step| self.reachable(vertex, step));
        let Some(to) = to else { return };
        // Others will be collapsed into it: its quadric comes along.
        let moved = quadric.moved(to - self.position(vertex));
        self.spots[vertex as usize] = Spot(to.extend(moved.at_vertex()));
        self.held[vertex as usize] = moved;
    }

    /// A face as it is written.
    fn triangle<V: Vertex>(&self, face: Face) -> Triangle<V> {
        Triangle(face.map(|vertex| {
            let color = self.colors.get(vertex as usize).map_or([255; 4], super::Color::mean);
            V::new(self.position(vertex).to_array(), color)
        }))
    }
}
