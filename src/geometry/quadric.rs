//! Quadric error functions over one unit cell: minimised freely, or inside the cell.

use glam::{DMat3, DVec2, DVec3};

/// E(x) = xᵀ A x − 2 bᵀ x, up to a constant: squared distances to planes, weighted. `A` is
/// symmetric and positive semidefinite. Coordinates are local to a cell, [−½, ½] per axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quadric {
    /// Matrix of second order.
    pub a: DMat3,
    /// Vector of first order.
    pub b: DVec3,
}

impl Default for Quadric {
    /// E = 0 everywhere.
    fn default() -> Self {
        Self { a: DMat3::ZERO, b: DVec3::ZERO }
    }
}

/// Where the representative of a cell may lie `[LS01 §3.2]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Placement {
    /// At the minimum inside the cell: on its boundary, minimised there, if the free one is
    /// outside.
    Constrained,
    /// At the free minimum, moved to the nearest point of the cell.
    Clamped,
    /// At the free minimum, wherever it is.
    Free,
}

/// Weight of "stay near the mean of the vertices", relative to the trace of `A`: it decides the
/// directions that flat and straight pieces leave open, and bends the others by less than 1/1000
/// of the distance. Chosen by hand: large enough for `f64` on the flattest cell, small beside any curvature.
const MEAN_WEIGHT: f64 = 1e-3;

impl Quadric {
    /// Adds `weight`·(n·x − d)².
    pub fn add_plane(&mut self, weight: f64, n: DVec3, d: f64) {
        let scaled = n * weight;
        self.a += DMat3::from_cols(scaled * n.x, scaled * n.y, scaled * n.z);
        self.b += scaled * d;
    }

    /// E at `x`.
    #[must_use]
    pub fn evaluate(&self, x: DVec3) -> f64 {
        x.dot(self.a * x - 2.0 * self.b)
    }

    /// The point that minimises E, kept near `mean` where E does not care.
    #[must_use]
    pub fn minimise(mut self, mean: DVec3, placement: Placement) -> DVec3 {
        let trace = self.a.x_axis.x + self.a.y_axis.y + self.a.z_axis.z;
        if !trace.is_normal() {
            return mean;
        }
        let weight = trace * MEAN_WEIGHT;
        self.a += DMat3::from_diagonal(DVec3::splat(weight));
        self.b += mean * weight;
        let free = solve3(&self.a, self.b).unwrap_or(mean);
        let inside = free.abs().max_element() <= 0.5;
        match placement {
            Placement::Free => free,
            _ if inside => free,
            Placement::Clamped => free.clamp(DVec3::splat(-0.5), DVec3::splat(0.5)),
            Placement::Constrained => self.minimise_on_cell(),
        }
    }

    /// The point on the surface of the cell that minimises E: reduced problems on the six faces
    /// (two unknowns) and the twelve edges (one unknown, clamped to the corners). E is convex,
    /// so the best of these is the minimum over the cell when the free one is outside.
    fn minimise_on_cell(&self) -> DVec3 {
        let mut best = (f64::INFINITY, DVec3::ZERO);
        let mut consider = |x: DVec3| {
            let error = self.evaluate(x);
            if error < best.0 {
                best = (error, x);
            }
        };
        for axis in 0..3 {
            let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
            for side in [-0.5, 0.5] {
                if let Some(x) = self.minimise_on_face(axis, side) {
                    consider(x);
                }
                for other in [-0.5, 0.5] {
                    let mut x = DVec3::ZERO;
                    x[axis] = side;
                    x[u] = other;
                    let slope = self.b[v] - self.a.col(axis)[v] * side - self.a.col(u)[v] * other;
                    x[v] = (slope / self.a.col(v)[v]).clamp(-0.5, 0.5);
                    consider(x);
                }
            }
        }
        best.1
    }

    /// The minimum of E with x\[axis\] = `side`, if it lies on that face of the cell.
    fn minimise_on_face(&self, axis: usize, side: f64) -> Option<DVec3> {
        let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
        let fixed = self.a.col(axis) * side;
        let right = DVec2::new(self.b[u] - fixed[u], self.b[v] - fixed[v]);
        let (uu, uv, vv) = (self.a.col(u)[u], self.a.col(u)[v], self.a.col(v)[v]);
        let determinant = uu * vv - uv * uv;
        let mut x = DVec3::ZERO;
        x[axis] = side;
        x[u] = (right.x * vv - right.y * uv) / determinant;
        x[v] = (right.y * uu - right.x * uv) / determinant;
        (x.abs().max_element() <= 0.5).then_some(x)
    }
}

/// Solves A x = b for a symmetric positive definite A; `None` when it is not.
fn solve3(a: &DMat3, b: DVec3) -> Option<DVec3> {
    let cofactor = a.y_axis.cross(a.z_axis);
    let determinant = a.x_axis.dot(cofactor);
    if !determinant.is_normal() {
        return None;
    }
    let inverse_transposed =
        DMat3::from_cols(cofactor, a.z_axis.cross(a.x_axis), a.x_axis.cross(a.y_axis));
    // The adjugate of a symmetric matrix is symmetric.
    Some(inverse_transposed * b / determinant)
}

#[cfg(test)]
mod tests {
    use glam::Vec3Swizzles as _;
    use proptest::prelude::*;

    use super::*;

    /// Three planes through (0.3, 0.1, −0.2), one of them slanted.
    fn corner(at: DVec3) -> Quadric {
        let mut quadric = Quadric::default();
        for n in [DVec3::X, DVec3::new(0.6, 0.8, 0.0), DVec3::Z] {
            quadric.add_plane(1.0, n, n.dot(at));
        }
        quadric
    }

    #[test]
    fn the_corner_of_three_planes_is_found() {
        let at = DVec3::new(0.3, 0.1, -0.2);
        let x = corner(at).minimise(DVec3::ZERO, Placement::Constrained);
        assert!(x.distance(at) < 5e-3, "{x}");
    }

    #[test]
    fn one_plane_leaves_the_mean_projected_onto_it() {
        let mut quadric = Quadric::default();
        quadric.add_plane(2.0, DVec3::Z, 0.25);
        let x = quadric.minimise(DVec3::new(0.1, -0.2, 0.0), Placement::Constrained);
        assert!(x.distance(DVec3::new(0.1, -0.2, 0.25)) < 1e-3, "{x}");
    }

    #[test]
    fn no_plane_at_all_leaves_the_mean() {
        let mean = DVec3::new(0.1, 0.2, 0.3);
        assert_eq!(Quadric::default().minimise(mean, Placement::Constrained), mean);
    }

    proptest! {
        /// Against a dense search over the cell.
        #[test]
        fn the_constrained_minimum_beats_every_point_of_the_cell(
            planes in prop::collection::vec((prop::array::uniform3(-1.0..1.0f64), -2.0..2.0f64), 1..5),
        ) {
            let mut quadric = Quadric::default();
            for (n, d) in planes {
                quadric.add_plane(1.0, DVec3::from_array(n), d);
            }
            quadric.a += DMat3::from_diagonal(DVec3::splat(1e-6));
            let x = quadric.minimise_on_cell();
            prop_assert!(x.abs().max_element() <= 0.5);
            let steps = 8;
            let at = |i: i32| f64::from(i) / f64::from(steps) - 0.5;
            for i in 0..=steps {
                for j in 0..=steps {
                    for (k, axis) in [(0, 0), (steps, 0), (0, 1), (steps, 1), (0, 2), (steps, 2)] {
                        let mut point = DVec3::new(at(i), at(j), at(k));
                        point = match axis { 0 => point.zxy(), 1 => point.yzx(), _ => point };
                        prop_assert!(quadric.evaluate(x) <= quadric.evaluate(point) + 1e-9);
                    }
                }
            }
        }
    }
}
