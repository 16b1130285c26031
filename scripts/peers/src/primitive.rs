//! What distances are measured between: triangles of a surface, segments of its
//! boundary. The arithmetic is `f64` on `f32` coordinates.

/// A piece of a surface or curve that has a nearest point.
pub trait Primitive: Copy + Send + Sync {
    /// Returns the corners, of which the bounding box is that of the piece.
    fn corners(&self) -> &[[f32; 3]];

    /// Returns the area or the length, by which samples are spread.
    fn measure(&self) -> f64;

    /// Maps two uniform numbers in `[0, 1)` to a uniform point on the piece.
    fn point(&self, u: f64, v: f64) -> Point;

    /// Returns the squared distance to the nearest point of the piece.
    fn distance_sq(&self, point: Point) -> f64;
}

/// A position in space.
pub type Point = [f64; 3];

/// Three corners.
#[derive(Debug, Clone, Copy)]
pub struct Triangle(pub [[f32; 3]; 3]);

/// Two ends.
#[derive(Debug, Clone, Copy)]
pub struct Segment(pub [[f32; 3]; 2]);

impl Primitive for Triangle {
    fn corners(&self) -> &[[f32; 3]] {
        &self.0
    }

    fn measure(&self) -> f64 {
        let [a, b, c] = self.0.map(wide);
        let n = cross(sub(b, a), sub(c, a));
        0.5 * dot(n, n).sqrt()
    }

    fn point(&self, u: f64, v: f64) -> Point {
        let [a, b, c] = self.0.map(wide);
        let root = u.sqrt();
        let on_bc = add_scaled(b, v, sub(c, b));
        add_scaled(a, root, sub(on_bc, a))
    }

    fn distance_sq(&self, p: Point) -> f64 {
        let [a, b, c] = self.0.map(wide);
        let q = nearest_on_triangle(p, a, b, c);
        let d = sub(p, q);
        let distance_sq = dot(d, d);
        if distance_sq.is_finite() {
            return distance_sq;
        }
        // A triangle without area: it is its own outline.
        let edges = [[a, b], [b, c], [c, a]];
        edges.iter().map(|e| segment_distance_sq(p, e[0], e[1])).fold(f64::INFINITY, f64::min)
    }
}

impl Primitive for Segment {
    fn corners(&self) -> &[[f32; 3]] {
        &self.0
    }

    fn measure(&self) -> f64 {
        let [a, b] = self.0.map(wide);
        let d = sub(b, a);
        dot(d, d).sqrt()
    }

    fn point(&self, u: f64, _: f64) -> Point {
        let [a, b] = self.0.map(wide);
        add_scaled(a, u, sub(b, a))
    }

    fn distance_sq(&self, p: Point) -> f64 {
        let [a, b] = self.0.map(wide);
        segment_distance_sq(p, a, b)
    }
}

/// The nearest point by the region of the triangle's plane the point projects to
/// (Ericson, Real-Time Collision Detection, 5.1.5). Not finite without area.
fn nearest_on_triangle(p: Point, a: Point, b: Point, c: Point) -> Point {
    let (ab, ac, ap) = (sub(b, a), sub(c, a), sub(p, a));
    let (d1, d2) = (dot(ab, ap), dot(ac, ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = sub(p, b);
    let (d3, d4) = (dot(ab, bp), dot(ac, bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return add_scaled(a, d1 / (d1 - d3), ab);
    }
    let cp = sub(p, c);
    let (d5, d6) = (dot(ab, cp), dot(ac, cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return add_scaled(a, d2 / (d2 - d6), ac);
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return add_scaled(b, (d4 - d3) / ((d4 - d3) + (d5 - d6)), sub(c, b));
    }
    let sum = va + vb + vc;
    add_scaled(add_scaled(a, vb / sum, ab), vc / sum, ac)
}

fn segment_distance_sq(p: Point, a: Point, b: Point) -> f64 {
    let (ab, ap) = (sub(b, a), sub(p, a));
    let length_sq = dot(ab, ab);
    let t = if length_sq > 0.0 { (dot(ap, ab) / length_sq).clamp(0.0, 1.0) } else { 0.0 };
    let d = sub(p, add_scaled(a, t, ab));
    dot(d, d)
}

fn wide(p: [f32; 3]) -> Point {
    p.map(f64::from)
}

fn sub(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn add_scaled(a: Point, scale: f64, b: Point) -> Point {
    [a[0] + scale * b[0], a[1] + scale * b[1], a[2] + scale * b[2]]
}

fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Point, b: Point) -> Point {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    /// Nearest by trying many points of the triangle: never below, hardly above.
    #[test]
    fn the_nearest_point_is_as_near_as_any() {
        let mut random = Random::new(7, 0);
        for _ in 0..200 {
            let mut corner = || [(); 3].map(|()| f32::from(random.bits().to_le_bytes()[0]) / 64.0);
            let triangle = Triangle([corner(), corner(), corner()]);
            let p = wide(corner());
            let exact = triangle.distance_sq(p).sqrt();
            let mut tried = f64::INFINITY;
            for i in 0..=100 {
                for j in 0..=100 {
                    let d = sub(p, triangle.point(f64::from(i) / 100.0, f64::from(j) / 100.0));
                    tried = tried.min(dot(d, d).sqrt());
                }
            }
            assert!(exact <= tried + 1e-12 && tried < exact + 0.3, "{exact} {tried}");
        }
    }

    #[test]
    fn a_triangle_without_area_is_its_outline() {
        let flat = Triangle([[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]);
        let dot = Triangle([[1.0, 0.0, 0.0]; 3]);
        assert!((flat.distance_sq([1.5, 2.0, 0.0]) - 4.0).abs() < 1e-12);
        assert!((flat.distance_sq([3.0, 0.0, 0.0]) - 1.0).abs() < 1e-12);
        assert!((dot.distance_sq([1.0, 0.0, 3.0]) - 9.0).abs() < 1e-12);
    }
}
