//! Soup to patch: corners with one position become one vertex, numbered along a Morton curve.

use glam::Vec3;

use super::{Color, Metric, Patch, morton::morton_places, surface::NONE};
use crate::soup::{Triangle, Vertex};

/// What welding gives.
pub struct Welded<M: Metric> {
    /// The surface, with nothing remembered; no vertex is shared yet.
    pub patch: Patch<M>,
    /// Triangles left out because two of their corners are one vertex.
    pub degenerate: u64,
    /// Where to find vertices by position, as they were numbered first.
    index: PositionIndex,
    /// From the first numbers to those of the patch.
    places: Vec<u32>,
}

/// Welds triangles by exact position (−0 is +0). Faces keep the order of the triangles.
#[must_use]
pub fn weld<V: Vertex, M: Metric>(triangles: &[Triangle<V>]) -> Welded<M> {
    let mut index = PositionIndex::with_room_for(triangles.len() / 2);
    let mut patch = Patch::<M>::default();
    let mut degenerate = 0;
    patch.faces.reserve(triangles.len());
    for triangle in triangles {
        let face = triangle.0.map(|corner| {
            let position = Vec3::from_array(corner.position()) + Vec3::ZERO;
            let (new, known) = (patch.positions.len() as u32, &mut patch.positions);
            let vertex = index.find_or_add(position, new, |vertex| known[vertex as usize]);
            if vertex == new {
                known.push(position);
            }
            vertex
        });
        if V::COLORED {
            patch.colors.resize(patch.positions.len(), Color::default());
            add_colors(triangle, face, &mut patch.colors);
        }
        let [a, b, c] = face;
        if a == b || b == c || c == a {
            degenerate += 1;
        } else {
            patch.faces.push(face);
        }
    }
    let places = morton_places(&patch.positions);
    reorder(&mut patch.positions, &places);
    reorder(&mut patch.colors, &places);
    for face in &mut patch.faces {
        *face = face.map(|v| places[v as usize]);
    }
    Welded { patch, degenerate, index, places }
}

impl<M: Metric> Welded<M> {
    /// The surface.
    #[must_use]
    pub fn into_patch(self) -> Patch<M> {
        self.patch
    }

    /// The vertex at a position.
    #[must_use]
    pub fn find(&self, position: [f32; 3]) -> Option<u32> {
        self.index.find(position, |vertex| {
            let place = self.places[vertex as usize];
            (place, self.patch.positions[place as usize])
        })
    }
}

/// Adds the colours of a triangle's corners to their vertices, weighted by its area; a triangle
/// without area still has a say where there is no other.
pub(super) fn add_colors<V: Vertex>(triangle: &Triangle<V>, face: [u32; 3], colors: &mut [Color]) {
    let [a, b, c] = triangle.0.map(|v| Vec3::from_array(v.position()));
    let weight = (b - a).cross(c - a).length().max(f32::MIN_POSITIVE);
    for (vertex, corner) in face.into_iter().zip(triangle.0) {
        let color = &mut colors[vertex as usize];
        for (sum, channel) in color.rgba.iter_mut().zip(corner.color()) {
            *sum += weight * f32::from(channel);
        }
        color.weight += weight;
    }
}

fn reorder<T: Copy + Default>(values: &mut Vec<T>, places: &[u32]) {
    if values.is_empty() {
        return;
    }
    let mut ordered = vec![T::default(); values.len()];
    for (value, place) in values.iter().zip(places) {
        ordered[*place as usize] = *value;
    }
    *values = ordered;
}

/// Vertices by position: open addressing, at most three quarters full. Where a vertex is, its owner tells.
pub(super) struct PositionIndex {
    slots: Vec<u32>,
    count: usize,
}

impl PositionIndex {
    pub(super) fn with_room_for(vertices: usize) -> Self {
        let slots = (vertices / 2 * 3).next_power_of_two().max(16);
        Self { slots: vec![NONE; slots], count: 0 }
    }

    /// The vertex at `position`, or `new`, which is at home there from now on.
    #[inline]
    pub(super) fn find_or_add(
        &mut self,
        position: Vec3,
        new: u32,
        at: impl Fn(u32) -> Vec3,
    ) -> u32 {
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

    /// The vertex at a position; `look_up` gives its number and position by its first number.
    fn find(&self, position: [f32; 3], look_up: impl Fn(u32) -> (u32, Vec3)) -> Option<u32> {
        let position = Vec3::from_array(position) + Vec3::ZERO;
        let mut slot = self.first_slot(position);
        while self.slots[slot] != NONE {
            let (vertex, at) = look_up(self.slots[slot]);
            if at == position {
                return Some(vertex);
            }
            slot = (slot + 1) & (self.slots.len() - 1);
        }
        None
    }

    #[inline]
    fn first_slot(&self, position: Vec3) -> usize {
        let [x, y, z] = position.to_array().map(|c| u64::from(c.to_bits()));
        let low = x | y << 32;
        let mixed = (low ^ z.rotate_left(17)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let mixed = (mixed ^ mixed >> 29).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        (mixed >> 32) as usize & (self.slots.len() - 1)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::ByQuadric;
    use crate::soup::{ColoredPoint, Point};

    #[test]
    fn equal_positions_become_one_vertex() {
        // 2---3
        // | \ |
        // 0---1
        let [p0, p1, p2, p3] =
            [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [-0.0, 1.0, 0.0], [1.0, 1.0, -0.0]].map(Point);
        let also_p2 = Point([0.0, 1.0, 0.0]);
        let welded = weld::<_, ByQuadric>(&[
            Triangle([p0, p1, p2]),
            Triangle([p1, p3, also_p2]),
            Triangle([p2, p0, also_p2]),
        ]);
        assert_eq!((welded.patch.positions.len(), welded.patch.faces.len()), (4, 2));
        assert_eq!(welded.degenerate, 1);
        let found = welded.find([1.0, 1.0, 0.0]).unwrap();
        assert_eq!(welded.patch.positions[found as usize], Vec3::new(1.0, 1.0, 0.0));
        assert_eq!(welded.find([2.0, 0.0, 0.0]), None);
        let [a, b, c] = welded.patch.faces[0].map(|v| welded.patch.positions[v as usize]);
        assert_eq!([a, b, c].map(|p| p.to_array()), [p0.0, p1.0, [0.0, 1.0, 0.0]]);
    }

    #[test]
    fn many_vertices_are_found_again() {
        let point = |i: u32| Point([i as f32, (i * 7 % 13) as f32, 0.5]);
        let triangles: Vec<Triangle<Point>> =
            (0..5000).map(|i| Triangle([point(i), point(i + 1), point(i + 2)])).collect();
        let welded = weld::<_, ByQuadric>(&triangles);
        assert_eq!(welded.patch.positions.len(), 5002);
        assert!((0..5002).all(|i| welded.find(point(i).0).is_some()));
    }

    #[test]
    fn a_vertex_has_the_mean_colour_of_its_corners_by_area() {
        let corner = |x, y, red| ColoredPoint { position: [x, y, 0.0], color: [red, 0, 0, 255] };
        let small = Triangle([corner(0.0, 0.0, 0), corner(1.0, 0.0, 0), corner(0.0, 1.0, 0)]);
        let large = Triangle([corner(0.0, 0.0, 100), corner(0.0, 3.0, 0), corner(-1.0, 0.0, 0)]);
        let welded = weld::<_, ByQuadric>(&[small, large]);
        let origin = welded.find([0.0; 3]).unwrap();
        assert_eq!(welded.patch.colors[origin as usize].mean(), [75, 0, 0, 255]);
    }
}
