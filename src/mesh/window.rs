//! A mesh that lives in a stream: triangles come in at one side and go out at the other, and only
//! what lies between is in core `[WK03 §3]`.
//!
//! What is not final yet lies on the interface towards the unread, `P_ab`, and is left alone. The
//! stream comes in the order of a sweep, so a vertex is final once the sweep has passed it. That
//! tells a true boundary from `P_ab` as soon as it is read, where the paper has to keep every
//! boundary triangle to the end `[WK03 §6]`.

use glam::Vec3;

use super::{
    ByQuadric, State,
    by_quadric::{boundary_quadric, face_quadric},
    classify::{classify, is_end},
    position_index::PositionIndex,
    ring::Wing,
    surface::{Mesh, NONE},
    weld::add_colors,
};
use crate::soup::{SweepAxis, SweepPlace, Triangle, Vertex, smallest_corner};

/// The in-core part of a stream.
pub struct Window {
    /// What is in core.
    pub mesh: Mesh<ByQuadric>,
    axis: SweepAxis,
    /// Faces and vertices that fit.
    faces_max: usize,
    vertices_max: usize,
    /// Vertices that are not final, in the order in which they came.
    open: Vec<u32>,
    /// The open vertices by position: the look-up table of `P_ab` `[WK03 §4.2]`.
    index: PositionIndex,
    /// Triangles read since the open vertices were looked through.
    unsettled: usize,
    figures: Figures,
}

/// What was counted on the way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Figures {
    /// Most faces in core at a time.
    pub faces_most: usize,
    /// Triangles left out because two of their corners were one point, or because a vertex had
    /// more faces than are counted.
    pub degenerate: u64,
    /// Vertices whose faces are no fan: left alone.
    pub complex_vertices: u64,
    /// Vertices on a true boundary.
    pub boundary_vertices: u64,
}

/// Triangles between two looks through the open vertices, at least: few enough that what they
/// touch stays in the cache. With more open vertices than that it is their number, so that the
/// looks cost each triangle the same.
const SETTLE_TRIANGLES_MIN: usize = 1 << 12;

/// Vertices there is room for, for each four faces: a closed surface has two, a boundary some
/// more. Where there are more still, the window is full with fewer faces.
const VERTICES_PER_FOUR_FACES: usize = 3;

impl Window {
    /// An empty window with room for `faces_max` faces.
    #[must_use]
    pub fn new(axis: SweepAxis, faces_max: usize) -> Self {
        let mut window = Self {
            mesh: Mesh::empty(),
            axis,
            faces_max: 0,
            vertices_max: 0,
            open: Vec::new(),
            index: PositionIndex::with_room_for(SETTLE_TRIANGLES_MIN),
            unsettled: 0,
            figures: Figures::default(),
        };
        window.grow(faces_max);
        window
    }

    /// Makes room for `faces_max` faces in all.
    pub fn grow(&mut self, faces_max: usize) {
        self.faces_max = faces_max;
        self.vertices_max = faces_max / 4 * VERTICES_PER_FOUR_FACES + 8;
        self.mesh.make_room(self.vertices_max);
    }

    /// Faces there is room for.
    #[must_use]
    pub fn faces_max(&self) -> usize {
        self.faces_max
    }

    /// What was counted so far.
    #[must_use]
    pub fn figures(&self) -> Figures {
        self.figures
    }

    /// Whether there is no room for a further triangle.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.mesh.faces_left >= self.faces_max || self.mesh.spots.len() + 3 > self.vertices_max
    }

    /// Whether hardly a triangle fits, once the places of what is gone are used again.
    #[must_use]
    pub fn is_nearly_full(&self) -> bool {
        let is_near = |count: usize, most: usize| count > most - most / 32;
        is_near(self.mesh.faces_left, self.faces_max)
            || is_near(self.mesh.spots.len() + 3, self.vertices_max)
    }

    /// READ: inserts triangles while there is room, and returns how many it took. They come in the
    /// order of their places, over all calls `[WK03 §4.2]`.
    pub fn append<V: Vertex>(&mut self, triangles: &[Triangle<V>]) -> usize {
        for (taken, triangle) in triangles.iter().enumerate() {
            if self.is_full() {
                return taken;
            }
            if self.unsettled >= self.open.len().max(SETTLE_TRIANGLES_MIN) {
                self.settle(Some(smallest_corner(triangle, self.axis).1));
            }
            self.unsettled += 1;
            self.insert(triangle);
        }
        triangles.len()
    }

    fn insert<V: Vertex>(&mut self, triangle: &Triangle<V>) {
        let face = triangle.0.map(|corner| self.vertex_at(corner.position()));
        let [a, b, c] = face;
        let is_degenerate = a == b || b == c || c == a;
        let mesh = &mut self.mesh;
        if is_degenerate || !face.iter().all(|vertex| mesh.rings.has_room(*vertex)) {
            self.figures.degenerate += 1;
            return;
        }
        if V::COLORED {
            mesh.colors.resize(mesh.spots.len(), super::Color::default());
            add_colors(triangle, face, &mut mesh.colors);
        }
        mesh.rings.push(a, Wing { next: b, prev: c });
        mesh.rings.push(b, Wing { next: c, prev: a });
        mesh.rings.push(c, Wing { next: a, prev: b });
        if let Some(quadric) = face_quadric(face.map(|vertex| mesh.position(vertex))) {
            for vertex in face {
                mesh.held[vertex as usize].add_matrix(&quadric);
            }
        }
        mesh.faces_left += 1;
        self.figures.faces_most = self.figures.faces_most.max(mesh.faces_left);
    }

    /// The open vertex at a position, a new one if there is none.
    #[inline]
    fn vertex_at(&mut self, position: [f32; 3]) -> u32 {
        let position = Vec3::from_array(position) + Vec3::ZERO;
        let (new, spots) = (self.mesh.spots.len() as u32, &self.mesh.spots);
        let vertex =
            self.index.find_or_add(position, new, |vertex| spots[vertex as usize].position());
        if vertex == new {
            self.mesh.add_vertex(position, State::OPEN);
            self.open.push(new);
        }
        vertex
    }

    /// Finalizes the vertices before `floor`, the place of the next triangle: no later one can
    /// have them. All of them at the end of the stream.
    pub fn settle(&mut self, floor: Option<SweepPlace>) {
        let mut open = std::mem::take(&mut self.open);
        open.retain(|vertex| {
            let place = SweepPlace::of(self.mesh.position(*vertex).to_array(), self.axis);
            let is_open = floor.is_some_and(|floor| place >= floor);
            if !is_open {
                self.finalize(*vertex);
            }
            is_open
        });
        self.open = open;
        self.unsettled = 0;
        self.refill_index();
    }

    fn refill_index(&mut self) {
        let spots = &self.mesh.spots;
        self.index.refill(&self.open, |vertex| spots[vertex as usize].position());
    }

    /// Makes of an open vertex what its faces, now complete, say it is.
    fn finalize(&mut self, vertex: u32) {
        let state = classify(self.mesh.rings.of(vertex));
        if state != State::INNER {
            self.mesh.add_final_boundaries(vertex);
            let is_complex = state == State::COMPLEX && self.mesh.rings.count(vertex) > 0;
            self.figures.complex_vertices += u64::from(is_complex);
            self.figures.boundary_vertices += u64::from(state == State::BOUNDARY);
        }
        self.mesh.states[vertex as usize] = state;
    }

    /// Faces at `P_ab`: they have a vertex that is not final.
    #[must_use]
    pub fn front_faces(&self) -> usize {
        let count = |vertex: &u32| {
            let is_before =
                |other: u32| other < *vertex && self.mesh.states[other as usize].has(State::OPEN);
            let ring = self.mesh.rings.of(*vertex).iter();
            ring.filter(|wing| !is_before(wing.next) && !is_before(wing.prev)).count()
        };
        self.open.iter().map(count).sum()
    }

    /// Gives the places of vertices that are gone to others. Numbers of vertices change, their
    /// order does not.
    pub fn compact(&mut self) {
        let mut new = 0;
        let mesh = &self.mesh;
        let number = |vertex: u32| {
            let is_left =
                mesh.rings.count(vertex) > 0 || mesh.states[vertex as usize] == State::OPEN;
            let number = if is_left { new } else { NONE };
            new += u32::from(is_left);
            number
        };
        let old_to_new: Vec<u32> = (0..mesh.spots.len() as u32).map(number).collect();
        self.mesh.compact(&old_to_new);
        for vertex in &mut self.open {
            *vertex = old_to_new[*vertex as usize];
        }
        self.refill_index();
    }
}

impl Mesh<ByQuadric> {
    fn make_room(&mut self, vertices: usize) {
        // Memory that is not touched costs nothing; moving the arrays would.
        self.spots.reserve_exact(vertices.saturating_sub(self.spots.len()));
        self.held.reserve_exact(vertices.saturating_sub(self.held.len()));
        self.states.reserve_exact(vertices.saturating_sub(self.states.len()));
        self.costs.reserve_exact(vertices.saturating_sub(self.costs.len()));
        self.rings.make_room(vertices);
    }

    /// Adds the planes that stand on the boundary edges at `vertex`, which is final now, to both
    /// ends; those to vertices that were final before have been added then.
    fn add_final_boundaries(&mut self, vertex: u32) {
        let p = self.position(vertex);
        let ring = self.rings.of(vertex);
        for index in 0..ring.len() {
            let ring = self.rings.of(vertex);
            let wing = ring[index];
            let (u, w) = (self.position(wing.next), self.position(wing.prev));
            let n = (u - p).cross(w - p);
            let is_due =
                |other: u32| is_end(ring, other) && self.states[other as usize].has(State::OPEN);
            let due = [(wing.next, u), (wing.prev, w)].map(|(other, end)| {
                let quadric = boundary_quadric(p, end, n).filter(|_| is_due(other));
                quadric.map(|quadric| (other, quadric))
            });
            for (other, quadric) in due.into_iter().flatten() {
                self.held[vertex as usize].add_matrix(&quadric);
                self.held[other as usize].add_matrix(&quadric);
            }
        }
    }

    fn compact(&mut self, old_to_new: &[u32]) {
        self.rings.compact(old_to_new);
        retain(&mut self.spots, old_to_new);
        retain(&mut self.held, old_to_new);
        retain(&mut self.states, old_to_new);
        retain(&mut self.costs, old_to_new);
        retain(&mut self.colors, old_to_new);
    }
}

/// Keeps the values of vertices that have a new number.
fn retain<T: Copy>(values: &mut Vec<T>, old_to_new: &[u32]) {
    let mut kept = 0;
    for (old, new) in old_to_new.iter().enumerate().take(values.len()) {
        if *new != NONE {
            values[kept] = values[old];
            kept += 1;
        }
    }
    values.truncate(kept);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        mesh::{Choice, release},
        soup::{Point, SweepKey},
    };

    /// A sheet along x with hills, in the order of the sweep: `length` times 10 squares.
    fn sheet(length: u32) -> Vec<Triangle<Point>> {
        let corner =
            |x: u32, y: u32| Point([x as f32, y as f32, ((x * 7 + y * 5) % 11) as f32 * 0.02]);
        let square = |i: u32| {
            let (x, y) = (i / 10, i % 10);
            let [a, b, c, d] =
                [corner(x, y), corner(x + 1, y), corner(x + 1, y + 1), corner(x, y + 1)];
            [Triangle([a, b, c]), Triangle([c, d, a])]
        };
        let mut soup: Vec<_> = (0..length * 10).flat_map(square).collect();
        soup.sort_by_key(|triangle| SweepKey::of(triangle, SweepAxis::X));
        soup
    }

    fn place(x: f32) -> SweepPlace {
        SweepPlace::of([x, 0.0, 0.0], SweepAxis::X)
    }

    /// All faces by the positions of their corners, the smallest corner first.
    fn faces(mesh: &Mesh<ByQuadric>) -> Vec<[[u32; 3]; 3]> {
        let bits = |vertex: u32| mesh.position(vertex).to_array().map(f32::to_bits);
        let of = |vertex: u32| {
            let ring = mesh.rings.of(vertex).iter();
            let first = ring.filter(move |wing| vertex < wing.next && vertex < wing.prev);
            first.map(move |wing| [vertex, wing.next, wing.prev])
        };
        let mut faces: Vec<_> =
            (0..mesh.spots.len() as u32).flat_map(of).map(|face| face.map(bits)).collect();
        faces.sort_unstable();
        faces
    }

    #[test]
    fn vertices_are_welded_across_reads_as_long_as_they_are_open() {
        let soup = sheet(2);
        let mut window = Window::new(SweepAxis::X, 100);
        for triangle in &soup {
            assert_eq!(window.append(std::slice::from_ref(triangle)), 1);
        }
        assert_eq!((window.mesh.spots.len(), window.mesh.faces_left), (33, 40));
        // What is passed is not found any more; what is not, is.
        window.settle(Some(place(1.5)));
        assert_eq!(window.open.len(), 11);
        let again =
            |at: [f32; 3]| Triangle([Point(at), Point([9.0, 0.0, 0.0]), Point([9.0, 1.0, 0.0])]);
        window.append(&[again([2.0, 0.0, 0.06])]);
        let spots = window.mesh.spots.len();
        assert_eq!(
            spots,
            33 + 3 - usize::from(soup.iter().any(|t| t.0.contains(&Point([2.0, 0.0, 0.06]))))
        );
        window.append(&[again([0.0, 0.0, 0.0])]);
        assert_eq!(window.mesh.spots.len(), spots + 1);
    }

    #[test]
    fn nothing_is_collapsed_from_or_into_what_is_not_final() {
        let mut window = Window::new(SweepAxis::X, 1000);
        window.append(&sheet(20));
        window.settle(Some(place(12.0)));
        let open: Vec<(u32, Vec3, super::super::Quadric)> = window
            .open
            .iter()
            .map(|v| (*v, window.mesh.position(*v), window.mesh.quadric(*v)))
            .collect();
        assert_eq!(open.len(), 9 * 11);
        let before = window.mesh.faces_left;
        Choice::new(8, 1).decimate(&mut window.mesh, before * 7 / 10);
        assert!(window.mesh.faces_left <= before * 7 / 10 + 1, "what is final is decimated");
        for (vertex, position, quadric) in open {
            assert!(window.mesh.rings.count(vertex) > 0 || position.x == 12.0);
            assert_eq!(
                (window.mesh.position(vertex), window.mesh.quadric(vertex)),
                (position, quadric)
            );
        }
        // Nor is any face written that has a vertex there.
        let mut out = Vec::<Triangle<Point>>::new();
        release(&mut window.mesh, 1000, &mut Choice::new(8, 1), &mut out);
        assert!(!out.is_empty());
        let is_open = |corner: &Point| place(corner.0[0]) >= place(12.0);
        assert!(!out.iter().any(|triangle| triangle.0.iter().any(is_open)));
    }

    #[test]
    fn what_was_written_stays_where_it_is_through_all_that_follows() {
        let mut window = Window::new(SweepAxis::X, 1000);
        let (soup, mut choice) = (sheet(30), Choice::new(8, 3));
        assert_eq!(window.append(&soup), 600);
        window.settle(Some(place(20.0)));
        choice.decimate(&mut window.mesh, 350);
        let mut out = Vec::<Triangle<Point>>::new();
        let released = release(&mut window.mesh, 40, &mut choice, &mut out);
        assert_eq!((released.faces, out.len(), released.inside), (40, 40, 1));
        let frozen = |mesh: &Mesh<ByQuadric>| -> Vec<[u32; 3]> {
            let vertices = 0..mesh.states.len() as u32;
            let is_rim =
                |v: &u32| mesh.states[*v as usize].has(State::FROZEN) && mesh.rings.count(*v) > 0;
            let bits = |v: u32| mesh.position(v).to_array().map(f32::to_bits);
            vertices.filter(is_rim).map(bits).collect()
        };
        let rim = frozen(&window.mesh);
        assert!(!rim.is_empty());
        choice.decimate(&mut window.mesh, 220);
        window.compact();
        window.settle(None);
        choice.decimate(&mut window.mesh, 100);
        // A vertex of the rim may have lost its last face here, but none has moved or come.
        let after = frozen(&window.mesh);
        assert!(!after.is_empty() && after.iter().all(|vertex| rim.contains(vertex)));
        let written: Vec<[u32; 3]> =
            out.iter().flat_map(|t| t.0).map(|corner| corner.0.map(f32::to_bits)).collect();
        assert!(after.iter().all(|vertex| written.contains(vertex)), "no crack");
    }

    #[test]
    fn compacting_changes_numbers_only() {
        let mut window = Window::new(SweepAxis::X, 1000);
        window.append(&sheet(20));
        window.settle(Some(place(15.0)));
        Choice::new(8, 1).decimate(&mut window.mesh, 200);
        let (before, spots) = (faces(&window.mesh), window.mesh.spots.len());
        window.compact();
        let mesh = &window.mesh;
        assert!(mesh.spots.len() < spots && faces(mesh) == before);
        assert_eq!([mesh.held.len(), mesh.states.len(), mesh.costs.len()], [mesh.spots.len(); 3]);
        assert!(window.open.iter().all(|vertex| mesh.states[*vertex as usize] == State::OPEN));
    }

    #[test]
    fn boundary_quadrics_are_those_of_a_mesh_that_is_read_at_once() {
        let soup = sheet(12);
        let mut window = Window::new(SweepAxis::X, 1000);
        for (index, triangles) in soup.chunks(37).enumerate() {
            if index > 0 {
                window.settle(Some(smallest_corner(&triangles[0], SweepAxis::X).1));
            }
            window.append(triangles);
        }
        window.settle(None);
        assert_eq!(window.figures.boundary_vertices, 2 * (12 + 10));
        let whole = Mesh::<ByQuadric>::of_original(super::super::weld(&soup).into_patch());
        let probe = Vec3::new(0.3, -0.2, 0.5);
        for vertex in 0..window.mesh.spots.len() as u32 {
            let position = window.mesh.position(vertex);
            let same =
                (0..whole.spots.len() as u32).find(|other| whole.position(*other) == position);
            let (ours, theirs) = (window.mesh.quadric(vertex), whole.quadric(same.unwrap()));
            assert!((ours.at(probe) - theirs.at(probe)).abs() < 1e-4, "at {position}");
        }
    }
}
