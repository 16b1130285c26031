//! How a mesh hangs together, after vertices at equal positions are made one: that
//! is what a file of loose triangles and an indexed one can be compared by.

use crate::mesh::Mesh;
use crate::primitive::{Primitive, Segment, Triangle};
use rayon::slice::ParallelSliceMut;

/// The counts of one mesh.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Topology {
    /// All triangles of the file.
    pub triangles: usize,
    /// Distinct positions.
    pub vertices: usize,
    /// Edges with exactly one triangle.
    pub boundary_edges: usize,
    /// Edges with three triangles or more.
    pub non_manifold_edges: usize,
    /// Sets of triangles connected through common vertices.
    pub components: usize,
    /// Triangles without area; those with two equal corners count for nothing else.
    pub degenerate_triangles: usize,
}

/// Counts what a mesh is made of, and returns its boundary.
#[must_use]
pub fn examine(mesh: &Mesh) -> (Topology, Vec<Segment>) {
    let welded = Welded::new(mesh);
    let mut edges = Vec::with_capacity(3 * mesh.triangles.len());
    let mut degenerate_triangles = 0;
    let mut sets = Sets::new(welded.positions.len());
    for &triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|v| welded.remap[v as usize]);
        if Triangle(mesh.corners(triangle)).measure() == 0.0 {
            degenerate_triangles += 1;
        }
        if a != b && b != c && c != a {
            edges.extend([edge(a, b), edge(b, c), edge(c, a)]);
            sets.unite(a, b);
            sets.unite(a, c);
        }
    }
    edges.par_sort_unstable();
    let mut boundary = Vec::new();
    let mut non_manifold_edges = 0;
    for group in edges.chunk_by(|a, b| a == b) {
        match group.len() {
            1 => boundary.push(welded.segment(group[0])),
            2 => {}
            _ => non_manifold_edges += 1,
        }
    }
    let topology = Topology {
        triangles: mesh.triangles.len(),
        vertices: welded.positions.len(),
        boundary_edges: boundary.len(),
        non_manifold_edges,
        components: sets.count,
        degenerate_triangles,
    };
    (topology, boundary)
}

/// The distinct positions, and for each vertex which one it has.
struct Welded {
    positions: Vec<[f32; 3]>,
    remap: Vec<u32>,
}

impl Welded {
    fn new(mesh: &Mesh) -> Self {
        // Adding zero makes -0 and 0 the same bytes, by which positions are compared.
        let plain: Vec<[f32; 3]> = mesh.positions.iter().map(|p| p.map(|x| x + 0.0)).collect();
        if plain.is_empty() {
            return Self { positions: plain, remap: Vec::new() };
        }
        let (count, remap) = meshopt::generate_vertex_remap(&plain, None);
        Self { positions: meshopt::remap_vertex_buffer(&plain, count, &remap), remap }
    }

    fn segment(&self, edge: u64) -> Segment {
        Segment([(edge >> 32) as u32, edge as u32].map(|v| self.positions[v as usize]))
    }
}

/// Packs the two ends, the smaller one in the upper half.
fn edge(a: u32, b: u32) -> u64 {
    u64::from(a.min(b)) << 32 | u64::from(a.max(b))
}

/// Disjoint sets of vertices, as trees of parents.
struct Sets {
    parents: Vec<u32>,
    /// How many sets the vertices used so far make.
    count: usize,
}

/// The parent of a vertex that no triangle has used yet.
const UNUSED: u32 = u32::MAX;

impl Sets {
    fn new(count: usize) -> Self {
        Self { parents: vec![UNUSED; count], count: 0 }
    }

    fn find(&mut self, mut v: u32) -> u32 {
        if self.parents[v as usize] == UNUSED {
            self.parents[v as usize] = v;
            self.count += 1;
        }
        loop {
            let parent = self.parents[v as usize];
            if parent == v {
                return v;
            }
            let grandparent = self.parents[parent as usize];
            self.parents[v as usize] = grandparent;
            v = grandparent;
        }
    }

    fn unite(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        if a != b {
            // The smaller index becomes the root: short paths on coherent meshes.
            self.parents[a.max(b) as usize] = a.min(b);
            self.count -= 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two triangles on a common edge, stored twice over as loose corners, a third
    /// one apart, a fourth without area, and a vertex nobody uses.
    /// ```text
    ///  2--3    4-6
    ///  |\ |    |/
    ///  0-\1    5
    /// ```
    #[test]
    fn counts_are_of_the_welded_mesh() {
        let at = |x: u8, y: u8| [f32::from(x), f32::from(y), -0.0];
        let mut positions = vec![at(0, 0), at(1, 0), at(0, 1), at(1, 1)];
        positions.extend([at(5, 1), at(5, 0), at(6, 1), at(9, 9)]);
        positions.extend([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]);
        let triangles = vec![[0, 1, 2], [8, 9, 3], [5, 6, 4], [0, 0, 1]];
        let mesh = Mesh { positions, triangles, origin: [0.0; 3] };
        let (topology, boundary) = examine(&mesh);
        let expected = Topology {
            triangles: 4,
            vertices: 8,
            boundary_edges: 7,
            non_manifold_edges: 0,
            components: 2,
            degenerate_triangles: 1,
        };
        assert_eq!(topology, expected);
        assert_eq!(boundary.len(), 7);
    }
}
