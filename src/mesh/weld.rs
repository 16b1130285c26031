//! Soup to patch: corners with one position become one vertex, numbered along a Morton curve.
//!
//! The triangles are taken in the order of the curve's cells, and every cell has a stretch of the
//! table of vertices to itself. So what is looked up lies near what was looked up before, and so
//! do the vertices of a face for all that comes after.

use glam::{Vec3, Vec3A};

use super::{Color, Memory, Patch, curve::Curve, surface::NONE};
use crate::soup::{Triangle, Vertex};

/// What welding gives.
pub struct Welded<M: Memory> {
    /// The surface, with nothing remembered; no vertex is shared yet.
    pub patch: Patch<M>,
    /// Triangles left out because two of their corners are one vertex.
    pub degenerate: u64,
    table: Table,
}

/// Triangles fetched at a time: they lie far apart, and the processor fetches several at once if
/// nothing else is to be done between them.
const AHEAD: usize = 16;

/// Welds triangles by exact position (−0 is +0).
#[must_use]
pub fn weld<V: Vertex, M: Memory>(triangles: &[Triangle<V>]) -> Welded<M> {
    let place = |corner: &V| Vec3A::from_array(corner.position());
    let curve = Curve::around(triangles.iter().flat_map(|triangle| &triangle.0).map(place));
    let cells = triangles.iter().map(|t| t.0.map(|corner| curve.cell(place(&corner))));
    let cells: Vec<[u16; 3]> = cells.collect();
    let mut table = Table::new(curve, &cells);
    let mut patch = Patch::<M>::default();
    let mut degenerate = 0;
    patch.faces.reserve(triangles.len());
    patch.positions.reserve(triangles.len() / 2);
    let mut ahead = Vec::with_capacity(AHEAD);
    for numbers in by_cell(&cells).chunks(AHEAD) {
        let fetch = |number: &u32| (triangles[*number as usize], cells[*number as usize]);
        ahead.clear();
        ahead.extend(numbers.iter().map(fetch));
        for (triangle, cells) in &ahead {
            let mut face = [NONE; 3];
            for ((vertex, corner), cell) in face.iter_mut().zip(&triangle.0).zip(cells) {
                let position = Vec3::from_array(corner.position()) + Vec3::ZERO;
                *vertex = table.find_or_add(position, *cell, &mut patch.positions);
            }
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
    }
    Welded { patch, degenerate, table }
}

impl<M: Memory> Welded<M> {
    /// The surface.
    #[must_use]
    pub fn into_patch(self) -> Patch<M> {
        self.patch
    }

    /// The vertex at a position.
    #[must_use]
    pub fn find(&self, position: [f32; 3]) -> Option<u32> {
        self.table.find(Vec3::from_array(position) + Vec3::ZERO, &self.patch.positions)
    }
}

/// The numbers of triangles, given by the cells of their corners, in the order of their least
/// cells; those of one cell in their own order.
fn by_cell(cells: &[[u16; 3]]) -> Vec<u32> {
    let least = |[a, b, c]: &[u16; 3]| usize::from(*a.min(b).min(c));
    let mut starts = counted(cells.iter().map(least));
    let mut numbers = vec![0; cells.len()];
    for (cells, number) in cells.iter().zip(0..) {
        let start = &mut starts[least(cells)];
        numbers[*start as usize] = number;
        *start += 1;
    }
    numbers
}

/// For each cell, how many of these are of cells before it; and all of them at the end.
fn counted(cells: impl Iterator<Item = usize>) -> Vec<u32> {
    let mut starts = vec![0; Curve::CELLS + 1];
    cells.for_each(|cell| starts[cell] += 1);
    let mut before = 0;
    for start in &mut starts {
        before += std::mem::replace(start, before);
    }
    starts
}

/// Vertices by position: open addressing, in a stretch for each cell.
struct Table {
    curve: Curve,
    /// For each cell, corners in cells before it.
    starts: Vec<u32>,
    slots: Vec<u32>,
}

impl Table {
    /// Room for so many corners, of which none need be at one position: at most two thirds full,
    /// in all and in each stretch.
    fn new(curve: Curve, cells: &[[u16; 3]]) -> Self {
        let starts = counted(cells.iter().flatten().map(|cell| usize::from(*cell)));
        let slots = Self::first_slot(starts[Curve::CELLS]) + 1;
        Self { curve, starts, slots: vec![NONE; slots] }
    }

    #[inline]
    fn first_slot(corners: u32) -> usize {
        corners as usize + corners as usize / 2
    }

    /// The vertex at a position in a cell, which is a new one if there was none.
    #[inline]
    fn find_or_add(&mut self, position: Vec3, cell: u16, positions: &mut Vec<Vec3>) -> u32 {
        let slot = self.probe(position, cell, positions);
        if self.slots[slot] == NONE {
            self.slots[slot] = positions.len() as u32;
            positions.push(position);
        }
        self.slots[slot]
    }

    fn find(&self, position: Vec3, positions: &[Vec3]) -> Option<u32> {
        let vertex = self.slots[self.probe(position, self.curve.cell(position.into()), positions)];
        (vertex != NONE).then_some(vertex)
    }

    /// The slot of a position, or the free one where it would be. One is always free.
    #[inline]
    fn probe(&self, position: Vec3, cell: u16, positions: &[Vec3]) -> usize {
        let cell = usize::from(cell);
        let [first, end] = [self.starts[cell], self.starts[cell + 1]].map(Self::first_slot);
        let mut slot = first + ((u64::from(hash(position)) * (end - first) as u64) >> 32) as usize;
        loop {
            match self.slots[slot] {
                NONE => return slot,
                vertex if positions[vertex as usize] == position => return slot,
                _ => slot += 1,
            }
            if slot == self.slots.len() {
                slot = 0;
            }
        }
    }
}

/// Mixes the bits of a position.
#[inline]
pub(super) fn hash(position: Vec3) -> u32 {
    let [x, y, z] = position.to_array().map(|c| u64::from(c.to_bits()));
    let low = x | y << 32;
    let mixed = (low ^ z.rotate_left(17)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let mixed = (mixed ^ mixed >> 29).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    (mixed >> 32) as u32
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
        let mut corners = [0, 1].map(|face| {
            welded.patch.faces[face].map(|v| welded.patch.positions[v as usize].to_array())
        });
        corners.sort_by(|a, b| a[0].partial_cmp(&b[0]).unwrap());
        assert_eq!(corners, [[p0.0, p1.0, also_p2.0], [p1.0, [1.0, 1.0, 0.0], also_p2.0]]);
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
