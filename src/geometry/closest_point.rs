//! The distance from a point to a triangle.

use glam::DVec3;

/// The square of the distance from the origin to the triangle `a, b, c`: a triangle around a point
/// is handed over relative to it. Right for triangles without area, too: they are a line or a point.
///
/// In double precision throughout: the differences of two coordinates of single precision are
/// then as good as exact, and none of their products leaves the range.
#[inline]
#[must_use]
pub fn distance_sq_to_triangle([a, b, c]: [DVec3; 3]) -> f64 {
    let (ab, bc, ca) = (b - a, c - b, a - c);
    let n = ab.cross(bc);
    // The origin lies above the triangle when it is on the inner side of all three edges.
    let inside = [n.cross(ab).dot(a), n.cross(bc).dot(b), n.cross(ca).dot(c)];
    let n_sq = n.length_squared();
    if n_sq > 0.0 && inside.iter().all(|side| *side <= 0.0) {
        let height = n.dot(a);
        return height * height / n_sq;
    }
    distance_sq_to_segment(a, ab)
        .min(distance_sq_to_segment(b, bc))
        .min(distance_sq_to_segment(c, ca))
}

/// The square of the distance from the origin to the segment from `a` to `a + ab`.
#[inline]
fn distance_sq_to_segment(a: DVec3, ab: DVec3) -> f64 {
    let length_sq = ab.length_squared();
    let along = -a.dot(ab);
    let share = if length_sq > 0.0 { (along / length_sq).clamp(0.0, 1.0) } else { 0.0 };
    (a + share * ab).length_squared()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn distance(point: [f64; 3], corners: [[f64; 3]; 3]) -> f64 {
        let point = DVec3::from_array(point);
        distance_sq_to_triangle(corners.map(|corner| DVec3::from_array(corner) - point)).sqrt()
    }

    /// ```text
    ///   y
    ///   3 c
    ///     |  \
    ///   0 a----b
    ///     0    4 x
    /// ```
    const TRIANGLE: [[f64; 3]; 3] = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 3.0, 0.0]];

    #[test]
    fn the_nearest_point_is_on_the_face_an_edge_or_a_corner() {
        for (point, expected) in [
            ([1.0, 1.0, -2.0], 2.0),
            ([1.0, 1.0, 0.0], 0.0),
            ([2.0, -3.0, 4.0], 5.0),
            ([4.0, 3.0, 0.0], 12.0 / 5.0),
            ([-2.0, -1.0, 2.0], 3.0),
            ([7.0, 0.0, 4.0], 5.0),
            ([0.0, 3.0, 0.0], 0.0),
        ] {
            for turn in 0..3 {
                let mut corners = TRIANGLE;
                corners.rotate_left(turn);
                let found = distance(point, corners);
                assert!((found - expected).abs() < 1e-15, "{point:?}: {found}");
                corners.swap(0, 1);
                let found = distance(point, corners);
                assert!((found - expected).abs() < 1e-15, "{point:?}, turned over: {found}");
            }
        }
    }

    #[test]
    fn a_triangle_without_area_is_a_line_or_a_point() {
        let line = [[0.0; 3], [1.0; 3], [3.0; 3]];
        assert_eq!(distance([2.0; 3], line), 0.0);
        assert_eq!(distance([4.0, 3.0, 3.0], line), 1.0);
        assert_eq!(distance([0.0, 3.0, 4.0], [[0.0; 3]; 3]), 5.0);
    }

    #[test]
    fn tiny_and_huge_triangles_keep_the_relative_precision() {
        for scale in [1e-37, 1e-20, 1.0, 1e20, 1e37] {
            let corners = TRIANGLE.map(|corner| corner.map(|c| c * scale));
            let found = distance([scale, scale, 2.0 * scale], corners);
            assert!((found / scale - 2.0).abs() < 1e-14, "{scale}: {found}");
        }
    }
}
