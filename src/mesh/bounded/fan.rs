//! The faces that a collapse would make, and how far points are from them.
//!
//! In double precision: differences of coordinates of single precision are as good as exact then. A
//! distance that cannot be told reliably is taken for the one to an edge, which is never smaller, so
//! that no rounding breaks the bound.

use glam::{DVec3, Vec3};

use super::super::{Mesh, ring::Wing};
use super::{
    attributes::{Attributes, Look},
    hanging::{ByDeviation, Point},
};

/// A face relative to its corner that all faces of the fan share.
#[derive(Clone, Copy, Debug)]
struct Face {
    others: [u32; 2],
    a: DVec3,
    b: DVec3,
    n: DVec3,
    aa: f64,
    ab: f64,
    bb: f64,
    /// |n|² = aa·bb − ab².
    n_sq: f64,
    /// Whether the face is wide enough to tell what lies above it.
    is_wide: bool,
}

/// Below this, as the squared sine of its angle, a face is taken for its edges. With rounding of
/// 2⁻⁵³ the place above a wider one is right to 10⁻¹⁰ of its edges.
const SINE_SQ_MIN: f64 = 1e-6;

/// Faces around one corner.
#[derive(Debug, Default)]
pub(super) struct Fan {
    vertex: u32,
    corner: DVec3,
    faces: Vec<Face>,
}

impl Fan {
    /// The faces of a ring, once its vertex has become `corner`.
    pub(super) fn fill(&mut self, mesh: &Mesh<ByDeviation>, corner: u32, ring: &[Wing]) {
        self.vertex = corner;
        self.corner = mesh.position(corner).as_dvec3();
        self.faces.clear();
        for wing in ring.iter().filter(|wing| !wing.has(corner)) {
            self.push(mesh, [wing.next, wing.prev]);
        }
    }

    /// Adds the faces of `kept` that stay as they are.
    pub(super) fn extend(&mut self, mesh: &Mesh<ByDeviation>, removed: u32, kept: u32) {
        for wing in mesh.rings.of(kept).iter().filter(|wing| !wing.has(removed)) {
            self.push(mesh, [wing.next, wing.prev]);
        }
    }

    fn push(&mut self, mesh: &Mesh<ByDeviation>, others: [u32; 2]) {
        let [a, b] = others.map(|other| mesh.position(other).as_dvec3() - self.corner);
        let n = a.cross(b);
        let (aa, ab, bb) = (a.length_squared(), a.dot(b), b.length_squared());
        let n_sq = n.length_squared();
        let is_wide = n_sq > SINE_SQ_MIN * aa * bb && n_sq > 0.0;
        self.faces.push(Face { others, a, b, n, aa, ab, bb, n_sq, is_wide });
    }

    /// Whether a point is within a tolerance, given squared, of one of the faces.
    #[inline]
    pub(super) fn is_within(&self, point: Vec3, tolerance_sq: f64) -> bool {
        let x = point.as_dvec3() - self.corner;
        self.faces.iter().any(|face| face.is_within(x, tolerance_sq))
    }

    /// Whether a removed vertex can hang at one of the faces.
    #[inline]
    pub(super) fn takes(&self, point: &Point, tolerance_sq: f64, attributes: &Attributes) -> bool {
        if !attributes.are_limited() {
            return self.is_within(point.position, tolerance_sq);
        }
        let x = point.position.as_dvec3() - self.corner;
        self.faces.iter().any(|face| {
            face.is_within(x, tolerance_sq)
                && attributes.allow(point.vertex, &face.look(self.vertex, x))
        })
    }

    /// Whether the middles of edges from a point to some vertices are within a tolerance.
    pub(super) fn are_within(
        &self,
        mesh: &Mesh<ByDeviation>,
        from: Vec3,
        ends: &[u32],
        tolerance_sq: f64,
    ) -> bool {
        let middle = |end: &u32| from.midpoint(mesh.position(*end));
        ends.iter().all(|end| self.is_within(middle(end), tolerance_sq))
    }

    /// The two other corners of the nearest face that a removed vertex can hang at.
    pub(super) fn nearest(&self, point: &Point, attributes: &Attributes) -> Option<[u32; 2]> {
        let x = point.position.as_dvec3() - self.corner;
        let mut best: Option<([u32; 2], f64)> = None;
        for face in &self.faces {
            let distance_sq = face.distance_sq(x);
            if best.is_none_or(|(_, least)| distance_sq < least)
                && (!attributes.are_limited()
                    || attributes.allow(point.vertex, &face.look(self.vertex, x)))
            {
                best = Some((face.others, distance_sq));
            }
        }
        best.map(|(others, _)| others)
    }
}

impl Face {
    #[inline]
    fn is_within(&self, x: DVec3, tolerance_sq: f64) -> bool {
        let height = self.n.dot(x);
        if self.is_wide && height * height > tolerance_sq * self.n_sq {
            return false;
        }
        self.distance_sq(x) <= tolerance_sq
    }

    /// The face at the place that is nearest to `x`; `vertex` is its first corner.
    fn look(&self, vertex: u32, x: DVec3) -> Look {
        let [next, prev] = self.others;
        let look = |shares| Look { corners: [vertex, next, prev], shares, normal: self.n };
        let (xa, xb) = (x.dot(self.a), x.dot(self.b));
        let (u, v) = (self.bb * xa - self.ab * xb, self.aa * xb - self.ab * xa);
        let w = self.n_sq - u - v;
        if self.is_wide && u >= 0.0 && v >= 0.0 && w >= 0.0 {
            return look([w, u, v].map(|share| share / self.n_sq));
        }
        let (y, edge) = (x - self.a, self.b - self.a);
        let along_a = share_along(xa, self.aa);
        let along_b = share_along(xb, self.bb);
        let along_edge = share_along(y.dot(edge), edge.length_squared());
        let sides = [
            ((x - along_a * self.a).length_squared(), [1.0 - along_a, along_a, 0.0]),
            ((x - along_b * self.b).length_squared(), [1.0 - along_b, 0.0, along_b]),
            ((y - along_edge * edge).length_squared(), [0.0, 1.0 - along_edge, along_edge]),
        ];
        let nearest = sides.into_iter().min_by(|one, two| one.0.total_cmp(&two.0));
        look(nearest.map_or([1.0, 0.0, 0.0], |(_, shares)| shares))
    }

    /// Never smaller than it is, but for rounding.
    #[inline]
    fn distance_sq(&self, x: DVec3) -> f64 {
        let (xa, xb) = (x.dot(self.a), x.dot(self.b));
        // Barycentric coordinates, times n_sq.
        let u = self.bb * xa - self.ab * xb;
        let v = self.aa * xb - self.ab * xa;
        let w = self.n_sq - u - v;
        if self.is_wide && u >= 0.0 && v >= 0.0 && w >= 0.0 {
            let height = self.n.dot(x);
            return height * height / self.n_sq;
        }
        let mut least = f64::INFINITY;
        if v <= 0.0 || !self.is_wide {
            least = least.min(to_segment_sq(x, self.a, xa, self.aa));
        }
        if u <= 0.0 || !self.is_wide {
            least = least.min(to_segment_sq(x, self.b, xb, self.bb));
        }
        if w <= 0.0 || !self.is_wide {
            let (y, edge) = (x - self.a, self.b - self.a);
            least = least.min(to_segment_sq(y, edge, y.dot(edge), edge.length_squared()));
        }
        least
    }
}

/// The square of the distance from `x` to the segment from the origin to `end`.
#[inline]
fn to_segment_sq(x: DVec3, end: DVec3, along: f64, length_sq: f64) -> f64 {
    (x - share_along(along, length_sq) * end).length_squared()
}

#[inline]
fn share_along(along: f64, length_sq: f64) -> f64 {
    if length_sq > 0.0 { (along / length_sq).clamp(0.0, 1.0) } else { 0.0 }
}
