//! Positions on whole steps along the longest side, before anything is decimated: so what is
//! refined again is exactly what was made progressive.

use crate::{
    error::Result,
    soup::{IndexedMesh, Vertex},
};

/// A mesh on whole steps.
pub(super) struct Quantized<V> {
    /// Positions in steps from `min`, below 2^bits. Each has a face.
    pub(super) vertices: Vec<V>,
    /// Of three different vertices each.
    pub(super) faces: Vec<[u32; 3]>,
    /// Faces left out, of fewer.
    pub(super) degenerate: u64,
    /// Where coordinates of 0 lie, relative to what positions were relative to.
    pub(super) min: [f64; 3],
    /// Model units from one to the next.
    pub(super) step: f64,
}

/// Quantises a mesh of finite positions.
pub(super) fn quantize<V: Vertex>(mesh: IndexedMesh<V>, bits: u32) -> Result<Quantized<V>> {
    let mut faces = mesh.triangles.into_memory()?;
    let vertices = mesh.vertices.into_memory()?;
    let before = faces.len();
    faces.retain(|[a, b, c]| a != b && b != c && c != a);
    let degenerate = (before - faces.len()) as u64;
    let (mut min, mut max) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    let mut numbers = vec![u32::MAX; vertices.len()];
    for vertex in faces.as_flattened() {
        numbers[*vertex as usize] = 0;
        let position = vertices[*vertex as usize].position().map(f64::from);
        for axis in 0..3 {
            min[axis] = min[axis].min(position[axis]);
            max[axis] = max[axis].max(position[axis]);
        }
    }
    let longest = (0..3).map(|axis| max[axis] - min[axis]).fold(0.0, f64::max);
    let largest = f64::from((1_u32 << bits) - 1);
    let step = if longest > 0.0 { longest / largest } else { 1.0 };
    let mut kept = Vec::with_capacity(vertices.len());
    for (vertex, number) in vertices.iter().zip(&mut numbers) {
        if *number == 0 {
            *number = kept.len() as u32;
            let position = vertex.position();
            let steps = |axis: usize| {
                let steps = ((f64::from(position[axis]) - min[axis]) / step).round();
                steps.clamp(0.0, largest) as f32
            };
            kept.push(V::new([steps(0), steps(1), steps(2)], vertex.color()));
        }
    }
    for face in &mut faces {
        *face = face.map(|vertex| numbers[vertex as usize]);
    }
    Ok(Quantized { vertices: kept, faces, degenerate, min, step })
}
