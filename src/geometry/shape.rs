//! What a triangle is like by itself: whether it has an area, and how far from equilateral it is.

use glam::DVec3;

/// Whether two corners are equal or all three on a line: the cross product of two sides is zero.
/// In double precision, where neither the least nor the greatest coordinates of single precision
/// leave the range.
#[must_use]
#[inline]
pub fn has_no_area(corners: &[[f32; 3]; 3]) -> bool {
    let [u, v] = sides(corners);
    u.x * v.y == u.y * v.x && u.y * v.z == u.z * v.y && u.z * v.x == u.x * v.z
}

/// Whether the quality 4√3·area / Σ edge², which is 1 for an equilateral triangle and 0 for one
/// without area, is below `quality`.
#[must_use]
#[inline]
pub fn is_worse_than(corners: &[[f32; 3]; 3], quality: f64) -> bool {
    let [u, v] = sides(corners);
    let edges_sq = u.length_squared() + v.length_squared() + (v - u).length_squared();
    // Squared, which needs no root: area is half of the cross product, so that (4√3·area)² is
    // 12 |u × v|².
    12.0 * u.cross(v).length_squared() < (quality * edges_sq) * (quality * edges_sq)
}

#[inline]
fn sides(corners: &[[f32; 3]; 3]) -> [DVec3; 2] {
    let [a, b, c] = corners.map(|corner| DVec3::from_array(corner.map(f64::from)));
    [b - a, c - a]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_without_area_have_equal_corners_or_lie_on_a_line() {
        assert!(has_no_area(&[[7.0; 3], [7.0; 3], [8.0; 3]]));
        assert!(has_no_area(&[[0.1, 0.2, 0.3]; 3]));
        assert!(has_no_area(&[[1.0; 3], [2.0; 3], [4.0; 3]]));
        assert!(!has_no_area(&[[1.0; 3], [2.0; 3], [4.0, 4.0, 4.000_000_5]]));
    }

    #[test]
    fn tiny_and_huge_triangles_have_area_and_the_same_quality() {
        for scale in [1e-38_f32, 1e-30, 1.0, 1e30, 1e38] {
            let corners = [[0.0; 3], [scale, 0.0, 0.0], [0.0, scale, 0.0]];
            assert!(!has_no_area(&corners), "{scale}");
            // 4√3 · ½ / (1 + 1 + 2) = √3 / 2.
            assert!(!is_worse_than(&corners, 0.866) && is_worse_than(&corners, 0.867), "{scale}");
        }
    }

    #[test]
    fn quality_is_1_for_an_equilateral_triangle_and_0_without_area() {
        let equilateral = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        assert!(
            !is_worse_than(&equilateral, 1.0 - 1e-12) && is_worse_than(&equilateral, 1.0 + 1e-12)
        );
        let line = [[1.0; 3], [2.0; 3], [4.0; 3]];
        assert!(!is_worse_than(&line, 0.0) && is_worse_than(&line, 1e-9));
        // A needle of length 1 and width w: about 2√3·w / 2 = √3·w.
        let needle = |w: f32| [[0.0; 3], [1.0, 0.0, 0.0], [1.0, w, 0.0]];
        assert!(is_worse_than(&needle(0.057), 0.1) && !is_worse_than(&needle(0.059), 0.1));
    }
}
