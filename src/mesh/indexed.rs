//! Indexed meshes on their way into a mesh in core, and out of it.

use glam::Vec3;
use rayon::prelude::*;

use super::{
    Color, Memory, Mesh, Metric, Patch, Threads,
    patch::unit_of_lengths,
    split::{complex, drop_lone_pairs, restore_copies, split_fans},
};
use crate::{
    geometry::spread,
    soup::{Column, IndexedMesh, Triangles, Vertex, VertexQuadric},
};

impl<M: Metric> Mesh<M> {
    /// Makes a mesh of vertices and the faces between them; every vertex has a face. With what the
    /// vertices stand for it is a mesh that has been decimated already, otherwise one as it was
    /// scanned.
    #[must_use]
    pub fn of_indexed<V: Vertex>(
        vertices: Vec<V>,
        mut faces: Vec<[u32; 3]>,
        quadrics: Option<Vec<VertexQuadric>>,
    ) -> Self {
        let mut positions: Vec<Vec3> = vertices
            .iter()
            .map(|vertex| Vec3::from_array(vertex.position()) + Vec3::ZERO)
            .collect();
        let mut colors = colors_by_area(&vertices, &positions, &faces);
        drop(vertices);
        let is_complex = complex(positions.len(), &faces);
        restore_copies(&is_complex, &mut faces);
        let added = split_fans(&positions, &mut faces, &is_complex);
        let quadrics = quadrics.map(|quadrics| shared_out(quadrics, &added));
        for source in added {
            positions.push(positions[source as usize]);
            colors.extend(colors.get(source as usize).copied());
        }
        drop_lone_pairs(positions.len(), &mut faces);
        let order = along_curve(&positions);
        let carried = quadrics.map(|quadrics| {
            let carried = |vertex: &u32| M::pass_on(&quadrics[*vertex as usize]);
            order.iter().map(carried).collect::<Vec<M::Carried>>()
        });
        positions = in_order(&positions, &order);
        colors = in_order(&colors, &order);
        put_in_places(&order, &mut faces);
        drop(order);
        let unit = unit_of_faces(&positions, &faces);
        let patch = Patch::<M> { positions, colors, faces, unit, ..Patch::default() };
        match carried {
            // Where the boundary is shows only now: no face of any vertex is missing.
            Some(carried) => {
                let joined = (0..patch.positions.len() as u32).collect();
                Self::of_decimated(Patch { carried, joined, ..patch }, Threads::All)
            }
            None => Self::of_original(patch),
        }
    }
}

impl<M: Memory> Mesh<M> {
    /// Makes a mesh of vertices as they were scanned, and the faces between them, none of which is
    /// added or left out.
    #[must_use]
    pub fn of_scanned<V: Vertex>(vertices: &[V], mut faces: Vec<[u32; 3]>) -> Self {
        let positions: Vec<Vec3> =
            vertices.iter().map(|vertex| Vec3::from_array(vertex.position())).collect();
        let colors = colors_by_area(vertices, &positions, &faces);
        let order = along_curve(&positions);
        let (positions, colors) = (in_order(&positions, &order), in_order(&colors, &order));
        put_in_places(&order, &mut faces);
        let unit = unit_of_faces(&positions, &faces);
        Self::of_original(Patch { positions, colors, faces, unit, ..Patch::default() })
    }
}

/// The corners of faces after their vertices were put in this order.
fn put_in_places(order: &[u32], faces: &mut [[u32; 3]]) {
    let mut places = vec![0_u32; order.len()];
    for (place, vertex) in (0..).zip(order) {
        places[*vertex as usize] = place;
    }
    for face in faces {
        *face = face.map(|v| places[v as usize]);
    }
}

/// [`Patch::unit`] by the edges of some faces.
fn unit_of_faces(positions: &[Vec3], faces: &[[u32; 3]]) -> f32 {
    let edge = |[a, b, _]: &[u32; 3]| {
        let [a, b] = [*a, *b].map(|v| positions[v as usize].as_dvec3());
        a.distance(b)
    };
    unit_of_lengths(faces.iter().map(edge))
}

/// The vertices along a Morton curve through 1024 cells of the box a side, those of one cell in
/// their order: in a whole mesh a block is a small part of the box.
fn along_curve(positions: &[Vec3]) -> Vec<u32> {
    const CELLS: f32 = 1024.0;
    let low = positions.iter().fold(Vec3::INFINITY, |low, p| low.min(*p));
    let high = positions.iter().fold(Vec3::NEG_INFINITY, |high, p| high.max(*p));
    let longest = (high - low).max_element();
    let scale = if longest > 0.0 { CELLS / longest } else { 0.0 };
    let key = |position: &Vec3| {
        let cell = ((*position - low) * scale).min(Vec3::splat(CELLS - 1.0));
        spread(cell.x as u32) | spread(cell.y as u32) << 1 | spread(cell.z as u32) << 2
    };
    let mut keys: Vec<(u32, u32)> = positions.iter().map(key).zip(0..).collect();
    keys.par_sort_unstable();
    keys.into_iter().map(|(_, vertex)| vertex).collect()
}

/// Values in this order; none where there are none.
fn in_order<T: Copy>(values: &[T], order: &[u32]) -> Vec<T> {
    if values.is_empty() {
        return Vec::new();
    }
    order.iter().map(|vertex| values[*vertex as usize]).collect()
}

/// Shares out the quadric of a vertex between it and those that were part of it, which follow on the
/// others: each plane is counted once.
fn shared_out(mut quadrics: Vec<VertexQuadric>, added: &[u32]) -> Vec<VertexQuadric> {
    let mut start = 0;
    while start < added.len() {
        let source = added[start];
        let parts = added[start..].iter().take_while(|other| **other == source).count();
        let share = 1.0 / (1 + parts) as f32;
        let VertexQuadric { a, b } = quadrics[source as usize];
        let part =
            VertexQuadric { a: a.map(|entry| entry * share), b: b.map(|entry| entry * share) };
        quadrics[source as usize] = part;
        quadrics.extend(std::iter::repeat_n(part, parts));
        start += parts;
    }
    quadrics
}

/// The colours of vertices, weighted by the areas of the faces around them; none of a payload
/// without.
fn colors_by_area<V: Vertex>(vertices: &[V], positions: &[Vec3], faces: &[[u32; 3]]) -> Vec<Color> {
    if !V::COLORED {
        return Vec::new();
    }
    let mut colors = vec![Color::default(); vertices.len()];
    for face in faces {
        let [a, b, c] = face.map(|v| positions[v as usize]);
        let weight = (b - a).cross(c - a).length().max(f32::MIN_POSITIVE);
        for vertex in face {
            colors[*vertex as usize].weight += weight;
        }
    }
    for (color, vertex) in colors.iter_mut().zip(vertices) {
        color.rgba = vertex.color().map(|channel| color.weight * f32::from(channel));
    }
    colors
}

impl<M: Memory> Patch<M> {
    /// Takes it as a finished mesh.
    #[must_use]
    pub fn into_indexed<V: Vertex>(self) -> IndexedMesh<V> {
        let vertex = |(index, position): (usize, &Vec3)| {
            V::new(position.to_array(), self.colors.get(index).map_or([255; 4], Color::mean))
        };
        let vertices = self.positions.iter().enumerate().map(vertex).collect();
        IndexedMesh { vertices: Column::Memory(vertices), triangles: Triangles::Memory(self.faces) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        mesh::{ByQuadric, ByVolume},
        soup::{ColoredPoint, Point},
    };

    /// A square of hills, `side` vertices a side.
    fn hills(side: u32) -> (Vec<Point>, Vec<[u32; 3]>) {
        let vertex = |i: u32| {
            let (x, y) = ((i % side) as f32, (i / side) as f32);
            Point([x, y, (0.7 * x).sin() + (0.5 * y).cos()])
        };
        let quads = (0..side * side).filter(|i| i % side < side - 1 && i / side < side - 1);
        let faces = quads.flat_map(|i| [[i, i + 1, i + side], [i + 1, i + side + 1, i + side]]);
        ((0..side * side).map(vertex).collect(), faces.collect())
    }

    /// What each vertex stands for when it stands for itself.
    fn own_planes(vertices: &[Point], faces: &[[u32; 3]]) -> Vec<VertexQuadric> {
        let mut sums = vec![VertexQuadric::default(); vertices.len()];
        for face in faces {
            let [a, b, c] = face.map(|v| Vec3::from_array(vertices[v as usize].0));
            let n = (b - a).cross(c - a);
            let m = n / (2.0 * n.length());
            let entries = [m.x * n.x, m.x * n.y, m.x * n.z, m.y * n.y, m.y * n.z, m.z * n.z];
            for vertex in face {
                let sum = &mut sums[*vertex as usize].a;
                sum.iter_mut().zip(entries).for_each(|(sum, entry)| *sum += entry);
            }
        }
        sums
    }

    #[test]
    fn vertices_that_stand_for_themselves_cost_as_much_as_scanned_ones() {
        let (vertices, faces) = hills(40);
        let passed_on = own_planes(&vertices, &faces);
        let mut scanned = Mesh::<ByQuadric>::of_indexed(vertices.clone(), faces.clone(), None);
        let mut clustered = Mesh::<ByQuadric>::of_indexed(vertices, faces, Some(passed_on));
        let costs = scanned.sample_costs(1);
        assert!(costs.len() > 1500);
        for (scanned, clustered) in costs.into_iter().zip(clustered.sample_costs(1)) {
            assert!((scanned - clustered).abs() <= 1e-3 * scanned + 1e-6, "{scanned} {clustered}");
        }
    }

    #[test]
    fn parts_of_a_vertex_share_its_quadric_and_its_colour() {
        let corner = |x, y, z, red| ColoredPoint { position: [x, y, z], color: [red, 0, 0, 255] };
        // Two triangles that touch in vertex 0.
        let vertices = vec![
            corner(0.0, 0.0, 0.0, 90),
            corner(1.0, 0.0, 0.0, 0),
            corner(0.0, 1.0, 0.0, 0),
            corner(-1.0, 0.0, 1.0, 0),
            corner(0.0, -1.0, 1.0, 0),
        ];
        let faces = vec![[0, 1, 2], [0, 3, 4]];
        let quadrics = vec![VertexQuadric { a: [2.0; 6], b: [4.0; 3] }; 5];
        let shared = shared_out(quadrics.clone(), &[0]);
        assert_eq!(shared.len(), 6);
        assert_eq!((shared[0], shared[5]), (shared[5], VertexQuadric { a: [1.0; 6], b: [2.0; 3] }));
        let mesh = Mesh::<ByVolume>::of_indexed(vertices, faces, Some(quadrics));
        let whole: IndexedMesh<ColoredPoint> = mesh.into_patch().into_indexed();
        let Column::Memory(vertices) = whole.vertices else { panic!("it is in memory") };
        let parts = vertices.iter().filter(|v| v.position == [0.0; 3] && v.color[0] == 90);
        assert_eq!((vertices.len(), parts.count()), (6, 2));
    }
}
