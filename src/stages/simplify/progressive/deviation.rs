//! How far the finest mesh is from those on the way to it: samples of it, measured against a few of
//! them, and interpolated between.

use glam::DVec3;
use rayon::prelude::*;

use crate::{
    formats::progressive::{Deviation, Packed},
    geometry::TriangleTree,
    mesh::progressive::Growing,
    soup::Vertex,
};

/// Points by area, for the root mean square. Chosen by hand: it is right to about a per cent.
const POINTS: usize = 8_000;
/// Vertices besides, for the maximum.
const VERTICES: usize = 4_000;
/// Meshes are measured when they have this share of the faces more than the last one: each halving
/// of the faces, from this share of the finest on.
const LAST_SHARE: f64 = 0.5;
/// Points that one thread looks up one after the other: they are near each other.
const POINTS_PER_CHUNK: usize = 1 << 10;

/// Samples of the finest mesh, and how far they were from the meshes so far.
pub(super) struct Course {
    /// In steps: first those by area, then vertices.
    points: Vec<[f64; 3]>,
    by_area: usize,
    /// Faces at which a mesh is measured next.
    next: f64,
    /// Faces of the finest mesh.
    faces: usize,
    measured: Vec<Measured>,
}

/// How far the samples were from a mesh, in steps.
#[derive(Clone, Copy, Debug)]
struct Measured {
    faces: f64,
    rms: f64,
    max: f64,
}

impl Course {
    /// Bytes of memory for each face of the finest mesh.
    pub(super) const FACE_BYTES: u64 = 36 + TriangleTree::BYTES_PER_TRIANGLE;

    /// Takes samples of a mesh on whole steps.
    pub(super) fn of<V: Vertex>(vertices: &[V], faces: &[[u32; 3]]) -> Self {
        let at =
            |vertex: u32| DVec3::from_array(vertices[vertex as usize].position().map(f64::from));
        let area = |face: &[u32; 3]| {
            let [a, b, c] = face.map(at);
            (b - a).cross(c - a).length()
        };
        let total: f64 = faces.iter().map(area).sum();
        let gap = total / POINTS as f64;
        let mut points = Vec::with_capacity(POINTS + VERTICES);
        let (mut passed, mut dice) = (gap / 2.0, 0.5_f64);
        for face in faces {
            passed += area(face);
            let [a, b, c] = face.map(at);
            while passed >= gap && points.len() < POINTS {
                passed -= gap;
                // Steps of the golden ratio are evenly spread, and of no rhythm.
                dice = (dice + 0.618_033_988_749_894_9).fract();
                let (u, v) = (dice.sqrt(), (dice * 97.0).fract());
                points.push((a * (1.0 - u) + b * (u * (1.0 - v)) + c * (u * v)).to_array());
            }
        }
        let by_area = points.len();
        let stride = vertices.len().div_ceil(VERTICES).max(1);
        let corners = vertices.iter().step_by(stride);
        points.extend(corners.map(|vertex| vertex.position().map(f64::from)));
        let faces = faces.len();
        let mut next = faces as f64 * LAST_SHARE;
        while next > 64.0 {
            next /= 2.0;
        }
        Self { points, by_area, next, faces, measured: Vec::new() }
    }

    /// Sees a mesh on the way, with more faces than the last one.
    pub(super) fn look(&mut self, mesh: &Growing) {
        let faces = mesh.faces().len();
        let is_first = self.measured.is_empty();
        if faces == 0 || (!is_first && (faces as f64) < self.next) || faces == self.faces {
            return;
        }
        while self.next <= faces as f64 {
            self.next *= 2.0;
        }
        if self.next > self.faces as f64 * LAST_SHARE * 1.01 {
            self.next = f64::INFINITY;
        }
        let position = |vertex: u32| mesh.positions()[vertex as usize].map(|c| c as f32);
        let triangles: Vec<_> = mesh.faces().par_iter().map(|face| face.map(position)).collect();
        let tree = TriangleTree::new(&triangles);
        drop(triangles);
        let distances = |points: &[[f64; 3]]| {
            let chunks = points.par_chunks(POINTS_PER_CHUNK).map(|points| {
                let mut hint = 0;
                let (mut sum, mut max) = (0.0, 0.0_f64);
                for point in points {
                    let distance_sq = tree.distance_sq(*point, &mut hint);
                    sum += distance_sq;
                    max = max.max(distance_sq);
                }
                (sum, max)
            });
            let all: Vec<(f64, f64)> = chunks.collect();
            // In order, so that the sum is the same for any number of threads.
            all.into_iter()
                .fold((0.0, 0.0_f64), |(sum, most), (part, max)| (sum + part, most.max(max)))
        };
        let (sum, max) = distances(&self.points[..self.by_area]);
        let (_, max_at_vertices) = distances(&self.points[self.by_area..]);
        let rms = (sum / self.by_area.max(1) as f64).sqrt();
        let max = max.max(max_at_vertices).sqrt();
        self.measured.push(Measured { faces: faces as f64, rms, max: max.max(rms) });
    }

    /// Blocks with the distances of the meshes that they complete, in model units.
    pub(super) fn finish(
        mut self,
        packed: impl Iterator<Item = Packed>,
        step: f64,
    ) -> Vec<(Packed, Deviation)> {
        // A finer mesh may by chance be farther away from the samples.
        let mut least = (0.0_f64, 0.0_f64);
        for measured in self.measured.iter_mut().rev() {
            least = (least.0.max(measured.rms), least.1.max(measured.max));
            (measured.rms, measured.max) = least;
        }
        let (mut faces, mut last) = (0.0, Deviation { rms: f32::MAX, max: f32::MAX });
        let with_deviation = |packed: Packed| {
            faces += f64::from(packed.faces);
            let (rms, max) = self.at(faces);
            let deviation = Deviation {
                rms: ((rms * step) as f32).min(last.rms),
                max: ((max * step) as f32).min(last.max),
            };
            last = deviation;
            (packed, deviation)
        };
        packed.map(with_deviation).collect()
    }

    /// Root mean square and maximum of a mesh with so many faces.
    fn at(&self, faces: f64) -> (f64, f64) {
        if faces >= self.faces as f64 {
            return (0.0, 0.0);
        }
        let after = self.measured.iter().position(|measured| measured.faces >= faces);
        match after {
            Some(0) => (self.measured[0].rms, self.measured[0].max),
            Some(after) => {
                let (one, two) = (self.measured[after - 1], self.measured[after]);
                let share = (faces / one.faces).ln() / (two.faces / one.faces).ln();
                let between = |a: f64, b: f64| {
                    if a <= 0.0 || b <= 0.0 { b.max(0.0) } else { a * (b / a).powf(share) }
                };
                (between(one.rms, two.rms), between(one.max, two.max))
            }
            None => {
                // To nothing at the finest mesh.
                let Some(last) = self.measured.last() else { return (0.0, 0.0) };
                let share = (self.faces as f64 - faces) / (self.faces as f64 - last.faces);
                (last.rms * share, last.max * share.sqrt())
            }
        }
    }
}
