//! Multiple choice on a whole mesh in core, written for clarity: what the stream is held against.

use glam::{DMat4, DVec3, DVec4};

use crate::soup::{Point, Triangle};

/// Decimates a closed surface to `target` faces by the best of `choices` random half-edges, and
/// moves each vertex that is left to the least of its quadric.
pub(super) fn decimated(
    soup: &[Triangle<Point>],
    target: usize,
    choices: usize,
) -> Vec<[DVec3; 3]> {
    let mut mesh = Mesh::of(soup);
    let mut dice = Dice(99);
    while mesh.faces.len() > target {
        let mut drawn: Vec<(f64, usize, usize)> = (0..choices)
            .map(|_| {
                let face = mesh.faces[dice.below(mesh.faces.len())];
                let k = dice.below(3);
                let (from, to) = (face[k], face[(k + 1) % 3]);
                let at = mesh.positions[to].extend(1.0);
                (at.dot((mesh.quadrics[from] + mesh.quadrics[to]) * at), from, to)
            })
            .collect();
        drawn.sort_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((_, from, to)) = drawn.into_iter().find(|(_, from, to)| mesh.allows(*from, *to))
        {
            mesh.collapse(from, to);
        }
    }
    mesh.place();
    mesh.faces.iter().map(|face| face.map(|vertex| mesh.positions[vertex])).collect()
}

struct Mesh {
    positions: Vec<DVec3>,
    quadrics: Vec<DMat4>,
    faces: Vec<[usize; 3]>,
}

struct Dice(u64);

impl Dice {
    fn below(&mut self, count: usize) -> usize {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % count
    }
}

impl Mesh {
    fn of(soup: &[Triangle<Point>]) -> Self {
        let mut known = std::collections::HashMap::new();
        let mut mesh = Self { positions: Vec::new(), quadrics: Vec::new(), faces: Vec::new() };
        for triangle in soup {
            let face = triangle.0.map(|corner| {
                *known.entry(corner.0.map(f32::to_bits)).or_insert_with(|| {
                    mesh.positions.push(DVec3::from_array(corner.0.map(f64::from)));
                    mesh.quadrics.push(DMat4::ZERO);
                    mesh.positions.len() - 1
                })
            });
            let [a, b, c] = face.map(|vertex| mesh.positions[vertex]);
            let n = (b - a).cross(c - a);
            let plane = n.normalize().extend(-n.normalize().dot(a));
            let outer = DMat4::from_cols(
                plane * plane.x,
                plane * plane.y,
                plane * plane.z,
                plane * plane.w,
            );
            for vertex in face {
                mesh.quadrics[vertex] += outer * (0.5 * n.length());
            }
            mesh.faces.push(face);
        }
        mesh
    }

    fn around(&self, vertex: usize) -> impl Iterator<Item = [usize; 3]> {
        self.faces.iter().copied().filter(move |face| face.contains(&vertex))
    }

    /// The link condition, and no face turned by more than 75 degrees.
    fn allows(&self, from: usize, to: usize) -> bool {
        let neighbours = |vertex: usize| {
            let mut all: Vec<usize> =
                self.around(vertex).flatten().filter(|v| *v != vertex).collect();
            all.sort_unstable();
            all.dedup();
            all
        };
        let (a, b) = (neighbours(from), neighbours(to));
        if a.iter().filter(|vertex| b.contains(vertex)).count() != 2 || a.len() < 4 || b.len() < 4 {
            return false;
        }
        let normal = |face: [usize; 3], moved: bool| {
            let [a, b, c] = face.map(|v| self.positions[if moved && v == from { to } else { v }]);
            (b - a).cross(c - a)
        };
        self.around(from).filter(|face| !face.contains(&to)).all(|face| {
            let (before, after) = (normal(face, false), normal(face, true));
            before.dot(after) > 0.25 * before.length() * after.length()
        })
    }

    fn collapse(&mut self, from: usize, to: usize) {
        let quadric = self.quadrics[from];
        self.quadrics[to] += quadric;
        self.faces.retain(|face| !(face.contains(&from) && face.contains(&to)));
        for vertex in self.faces.iter_mut().flatten().filter(|vertex| **vertex == from) {
            *vertex = to;
        }
    }

    fn place(&mut self) {
        for vertex in 0..self.positions.len() {
            if self.around(vertex).next().is_none() {
                continue;
            }
            // In place of the last row: the vertex lies at w = 1, and a little wish to stay.
            let p = self.positions[vertex];
            let to_p = DMat4::from_translation(p);
            let mut local = to_p.transpose() * self.quadrics[vertex] * to_p;
            let trace = local.x_axis.x + local.y_axis.y + local.z_axis.z;
            for (axis, column) in
                [&mut local.x_axis, &mut local.y_axis, &mut local.z_axis].into_iter().enumerate()
            {
                column[axis] += 1e-4 * trace;
                column.w = 0.0;
            }
            local.w_axis.w = 1.0;
            let step = (local.inverse() * DVec4::W).truncate();
            if step.is_finite() && step.length() < 0.5 {
                self.positions[vertex] = p + step;
            }
        }
    }
}
