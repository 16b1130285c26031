//! The error quadric of a vertex, relative to the vertex: small numbers that single precision
//! holds, wherever the mesh lies.

use glam::{DMat3, DVec3, Vec3, Vec4};
use zerocopy::{FromBytes, Immutable, IntoBytes};

/// E(x) = dᵀ A d + 2 b·d + c with d = x − p, for a vertex at p: squared distances to the planes of
/// the faces it stands for, each weighted by the face's area.
///
/// A vertex of the original mesh lies on all its planes: b and c are zero.
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct Quadric {
    /// A: xx, xy, xz, yy, yz, zz.
    a: [f32; 6],
    b: Vec3,
    c: f32,
}

impl Quadric {
    /// The plane through the vertex with normal `n`, weighted: (n·d)² / `scale`, so that with an
    /// unnormalised normal of twice the area, `scale` 2·|n| weighs by area.
    #[inline]
    pub(super) fn of_plane(n: Vec3, scale: f32) -> Self {
        let m = n / scale;
        let a = [m.x * n.x, m.x * n.y, m.x * n.z, m.y * n.y, m.y * n.z, m.z * n.z];
        Self { a, ..Self::default() }
    }

    /// A, row by row from the diagonal on, and b; nothing at the vertex.
    pub(super) fn of_parts(a: [f32; 6], b: [f32; 3]) -> Self {
        Self { a, b: Vec3::from_array(b), c: 0.0 }
    }

    /// The sum, both relative to one vertex.
    #[inline]
    pub fn add(&mut self, other: &Self) {
        for (sum, term) in self.a.iter_mut().zip(other.a) {
            *sum += term;
        }
        self.b += other.b;
        self.c += other.c;
    }

    /// Adds all but the value at the vertex, which lies elsewhere.
    #[inline]
    pub(super) fn add_matrix(&mut self, other: &Self) {
        for (sum, term) in self.a.iter_mut().zip(other.a) {
            *sum += term;
        }
        self.b += other.b;
    }

    /// Adds `weight`·|d|²: the wish to stay near, which decides between collapses where the
    /// surface is flat.
    #[inline]
    pub(super) fn add_point(&mut self, weight: f32) {
        self.a[0] += weight;
        self.a[3] += weight;
        self.a[5] += weight;
    }

    #[inline]
    fn apply(&self, d: Vec3) -> Vec3 {
        let [xx, xy, xz, yy, yz, zz] = self.a;
        Vec3::new(
            xx * d.x + xy * d.y + xz * d.z,
            xy * d.x + yy * d.y + yz * d.z,
            xz * d.x + yz * d.y + zz * d.z,
        )
    }

    /// E at a distance `d` from the vertex.
    #[inline]
    pub(super) fn at(&self, d: Vec3) -> f32 {
        d.dot(self.apply(d) + 2.0 * self.b) + self.c
    }

    /// E at four distances at once, given by coordinates.
    #[inline]
    pub(super) fn at_four(&self, x: Vec4, y: Vec4, z: Vec4) -> Vec4 {
        let [xx, xy, xz, yy, yz, zz] = self.a;
        let b = self.b;
        let by_x = xx * x + 2.0 * (xy * y + xz * z + Vec4::splat(b.x));
        let by_y = yy * y + 2.0 * (yz * z + Vec4::splat(b.y));
        let by_z = zz * z + Vec4::splat(2.0 * b.z);
        x * by_x + y * by_y + z * by_z + Vec4::splat(self.c)
    }

    /// E at the vertex: what the collapses into it have cost.
    #[inline]
    pub(super) fn at_vertex(&self) -> f32 {
        self.c
    }

    /// This quadric without its value at the vertex, which lies elsewhere.
    #[inline]
    pub(super) fn with_value(mut self, c: f32) -> Self {
        self.c = c;
        self
    }

    /// The same E, relative to a vertex `t` away.
    #[inline]
    pub(super) fn moved(&self, t: Vec3) -> Self {
        Self { a: self.a, b: self.b + self.apply(t), c: self.at(t).max(0.0) }
    }

    /// Where E is least, as a distance from the vertex; directions that E leaves open are not
    /// taken. `None` for a quadric of nothing.
    pub(super) fn minimum(&self) -> Option<Vec3> {
        let [xx, xy, xz, yy, yz, zz] = self.a.map(f64::from);
        let stay = (xx + yy + zz) * STAY_WEIGHT;
        if !stay.is_normal() {
            return None;
        }
        let a = DMat3::from_cols(
            DVec3::new(xx + stay, xy, xz),
            DVec3::new(xy, yy + stay, yz),
            DVec3::new(xz, yz, zz + stay),
        );
        let d = (a.inverse() * -self.b.as_dvec3()).as_vec3();
        d.is_finite().then_some(d)
    }
}

/// Weight of "stay where you are", relative to the trace of A, when the minimum is looked for.
/// Chosen by hand: small beside any curvature, large enough to hold the vertex on flat pieces.
const STAY_WEIGHT: f64 = 1e-4;

#[cfg(test)]
mod tests {
    use super::*;

    fn corner() -> Quadric {
        let mut sum = Quadric::default();
        for n in [Vec3::X, Vec3::new(0.6, 0.8, 0.0), Vec3::Z] {
            sum.add(&Quadric::of_plane(n, 1.0));
        }
        sum
    }

    #[test]
    fn a_quadric_is_the_same_seen_from_anywhere() {
        let quadric = corner();
        let t = Vec3::new(0.5, -2.0, 3.0);
        let moved = quadric.moved(t).moved(Vec3::new(-1.0, 0.5, 0.25));
        for x in [Vec3::ZERO, Vec3::ONE, Vec3::new(0.1, 7.0, -3.0)] {
            let (near, far) = (quadric.at(x), moved.at(x - t + Vec3::new(1.0, -0.5, -0.25)));
            assert!((near - far).abs() <= 1e-4 * near.max(1.0), "{near} {far}");
            let four = quadric.at_four(Vec4::splat(x.x), Vec4::splat(x.y), Vec4::splat(x.z));
            assert!((four - near).abs().max_element() <= 1e-5 * near.max(1.0), "{four} {near}");
        }
    }

    #[test]
    fn the_minimum_of_three_planes_is_their_corner() {
        let away = Vec3::new(0.25, -0.5, 1.0);
        let found = corner().moved(away).minimum().unwrap();
        assert!((found + away).length() < 1e-2, "{found}");
        assert_eq!(Quadric::default().minimum(), None);
    }
}
