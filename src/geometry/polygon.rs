//! Polygons into triangles: every corner kept, orientation kept, concave ones by ear clipping in
//! the polygon's plane.

use earcut::Earcut;
use glam::DVec3;

/// Stands for "no triangle has this edge".
const NONE: u32 = u32::MAX;

/// Fills `out` with the `n - 2` triangles of a polygon of `n` corners, as indices of its corners.
///
/// Each corner is in a triangle, also where corners coincide or lie on a line: neighbours share
/// them, and leaving them out would tear the surface. A polygon without a plane, or that crosses
/// itself so that it has no such triangles, becomes a fan. Fewer than three corners give nothing.
pub fn triangulate(polygon: &[[f32; 3]], out: &mut Vec<[u32; 3]>) {
    out.clear();
    match polygon.len() {
        0..=2 => {}
        3 => out.push([0, 1, 2]),
        4 => out.extend(split_quad(polygon)),
        _ => {
            let points: Vec<_> = polygon.iter().map(|&point| wide(point)).collect();
            let normal = newell_normal(&points);
            if !is_fan_unflipped(&points, normal) && clip_ears(&points, normal, out).is_some() {
                return;
            }
            out.clear();
            out.extend((2..polygon.len() as u32).map(|corner| [0, corner - 1, corner]));
        }
    }
}

/// By the diagonal that turns neither half over; by the shorter one if both do well.
fn split_quad(polygon: &[[f32; 3]]) -> [[u32; 3]; 2] {
    let points: [DVec3; 4] = std::array::from_fn(|corner| wide(polygon[corner]));
    let [a, b, c, d] = points;
    // The cross product of the diagonals is twice the area vector of the quad.
    let normal = (c - a).cross(d - b);
    let halves = [[[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]]];
    let is_unflipped = |halves: &[[u32; 3]; 2]| {
        halves.iter().all(|half| {
            let [a, b, c] = half.map(|corner| points[corner as usize]);
            (b - a).cross(c - a).dot(normal) > 0.0
        })
    };
    let is_second_shorter = (d - b).length_squared() < (c - a).length_squared();
    match (is_unflipped(&halves[0]), is_unflipped(&halves[1])) {
        (true, false) => halves[0],
        (false, true) => halves[1],
        _ => halves[usize::from(is_second_shorter)],
    }
}

/// Twice the area vector: Σ pᵢ × pᵢ₊₁, relative to a corner so that far polygons lose no digits.
fn newell_normal(points: &[DVec3]) -> DVec3 {
    let first = points[0];
    points.windows(2).map(|pair| (pair[0] - first).cross(pair[1] - first)).sum()
}

/// Whether the fan around the first corner has only triangles that face along `normal`: true of
/// strictly convex polygons.
fn is_fan_unflipped(points: &[DVec3], normal: DVec3) -> bool {
    let first = points[0];
    points[1..].windows(2).all(|pair| (pair[0] - first).cross(pair[1] - first).dot(normal) > 0.0)
}

/// Ear clipping; `None` when the result does not have every edge of the polygon.
fn clip_ears(points: &[DVec3], normal: DVec3, out: &mut Vec<[u32; 3]>) -> Option<()> {
    if !normal.is_finite() || normal == DVec3::ZERO || points.len() >= NONE as usize / 2 {
        return None;
    }
    let flat = project(points, normal);
    let mut corners = Vec::new();
    Earcut::new().earcut_slice::<u32>(&flat, &[], &mut corners);
    out.extend(corners.as_chunks::<3>().0);
    // All triangles come out with the same orientation, whichever that is.
    let area: f64 = out.iter().map(|triangle| area_twice(&flat, *triangle)).sum();
    if area < 0.0 {
        for triangle in out.iter_mut() {
            triangle.swap(1, 2);
        }
    }
    insert_left_out(points.len(), out)?;
    (out.len() == points.len() - 2).then_some(())
}

/// The points in the coordinate plane that is most nearly the polygon's, counter-clockwise.
fn project(points: &[DVec3], normal: DVec3) -> Vec<[f64; 2]> {
    let axis = normal.abs().max_position();
    let (mut u, mut v) = ((axis + 1) % 3, (axis + 2) % 3);
    if normal[axis] < 0.0 {
        (u, v) = (v, u);
    }
    points.iter().map(|point| [point[u], point[v]]).collect()
}

fn area_twice(flat: &[[f64; 2]], triangle: [u32; 3]) -> f64 {
    let [a, b, c] = triangle.map(|corner| flat[corner as usize]);
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Ear clipping leaves out corners that lie on a line or on each other. Between two corners that
/// it kept, a triangle (a, b, q) has the edge that skips them: it becomes a fan around q.
///
/// ```text
///        q                q
///       / \      to     / | \
///      a---b           a--c--b
/// ```
fn insert_left_out(count: usize, triangles: &mut Vec<[u32; 3]>) -> Option<()> {
    let mut is_kept = vec![false; count];
    triangles.iter().flatten().for_each(|&corner| is_kept[corner as usize] = true);
    let kept: Vec<u32> = (0..count as u32).filter(|&corner| is_kept[corner as usize]).collect();
    if kept.len() == count {
        return Some(());
    }
    let mut next = vec![NONE; count];
    for (index, &corner) in kept.iter().enumerate() {
        next[corner as usize] = kept[(index + 1) % kept.len()];
    }
    // Triangle at each kept corner that has the edge to the next one. A fan put in place of a
    // triangle moves its other edges: the last piece takes over what comes after the edge.
    let mut owner = vec![NONE; count];
    for (index, triangle) in triangles.iter().enumerate() {
        for side in 0..3 {
            let (a, b) = (triangle[side], triangle[(side + 1) % 3]);
            if next[a as usize] == b {
                owner[a as usize] = index as u32;
            }
        }
    }
    for &a in &kept {
        let b = next[a as usize];
        let steps = (b as usize + count - a as usize) % count;
        if steps == 1 {
            continue;
        }
        let index = *triangles.get(owner[a as usize] as usize).map(|_| &owner[a as usize])?;
        let triangle = triangles[index as usize];
        let side = triangle.iter().position(|&corner| corner == a)?;
        let q = triangle[(side + 2) % 3];
        let at = |step: usize| ((a as usize + step) % count) as u32;
        // The first piece keeps the edge (q, a), the last one takes (b, q).
        triangles[index as usize] = [a, at(1), q];
        triangles.extend((1..steps).map(|step| [at(step), at(step + 1), q]));
        if next[b as usize] == q {
            owner[b as usize] = triangles.len() as u32 - 1;
        }
    }
    Some(())
}

fn wide(point: [f32; 3]) -> DVec3 {
    DVec3::from_array(point.map(f64::from))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Checks what holds for any polygon, and answers the sum of the triangles' areas and the
    /// polygon's own area.
    fn areas(polygon: &[[f32; 3]]) -> (f64, f64) {
        let mut triangles = Vec::new();
        triangulate(polygon, &mut triangles);
        assert_eq!(triangles.len(), polygon.len() - 2, "{triangles:?}");
        for corner in 0..polygon.len() as u32 {
            let next = (corner + 1) % polygon.len() as u32;
            let has_edge = |t: &[u32; 3]| (0..3).any(|i| [t[i], t[(i + 1) % 3]] == [corner, next]);
            assert_eq!(triangles.iter().filter(|t| has_edge(t)).count(), 1, "{triangles:?}");
        }
        let points: Vec<_> = polygon.iter().map(|&point| wide(point)).collect();
        let area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|corner| points[corner as usize]);
            (b - a).cross(c - a)
        };
        let normal = newell_normal(&points).normalize_or_zero();
        let least = triangles.iter().map(|t| area(t).dot(normal)).fold(0.0, f64::min);
        assert!(least > -1e-9, "a triangle is turned over: {triangles:?}");
        let sum = triangles.iter().map(|t| area(t).length() / 2.0).sum();
        (sum, newell_normal(&points).length() / 2.0)
    }

    fn assert_covered(polygon: &[[f32; 3]]) {
        // Every start and both orientations, in three planes.
        for turn in 0..polygon.len() {
            let mut turned = polygon.to_vec();
            turned.rotate_left(turn);
            for axes in [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1]] {
                let mut placed: Vec<_> = turned.iter().map(|p| axes.map(|axis| p[axis])).collect();
                for _ in 0..2 {
                    let (sum, area) = areas(&placed);
                    assert!(
                        (sum - area).abs() <= 1e-6 * area,
                        "{sum} instead of {area}: {placed:?}"
                    );
                    placed.reverse();
                }
            }
        }
    }

    fn flat(points: &[[f32; 2]]) -> Vec<[f32; 3]> {
        points.iter().map(|&[x, y]| [x, y, 0.0]).collect()
    }

    /// ```text
    ///   4-----.     .-----2
    ///   |       `3'       |
    ///   0-----------------1
    /// ```
    #[test]
    fn a_concave_face_is_covered_once() {
        let points = flat(&[[0., 0.], [2., 0.], [2., 1.], [1., 0.4], [0., 1.]]);
        assert_covered(&points);
        let (_, area) = areas(&points);
        assert!((area - 1.4).abs() < 1e-6);
    }

    #[test]
    fn a_quad_is_split_where_neither_half_turns_over() {
        // An arrowhead: only the diagonal through the notch is inside.
        assert_covered(&flat(&[[0., 0.], [1., 3.], [0., 1.], [-1., 3.]]));
        let mut out = Vec::new();
        let long = [[0., 0., 0.], [3., 1., 0.], [6., 0., 0.], [3., -1., 0.]];
        triangulate(&long, &mut out);
        assert_eq!(out, [[0, 1, 3], [1, 2, 3]]);
    }

    /// ```text
    ///   6--5--4
    ///   7     3
    ///   0--1--2
    /// ```
    #[test]
    fn corners_on_a_line_are_kept() {
        let square =
            [[0., 0.], [1., 0.], [2., 0.], [2., 1.], [2., 2.], [1., 2.], [0., 2.], [0., 1.]];
        assert_covered(&flat(&square));
        let ell = [[0., 0.], [1., 0.], [2., 0.], [3., 0.], [3., 1.], [1., 1.], [1., 2.], [0., 2.]];
        assert_covered(&flat(&ell));
        // One triangle with corners on all its sides.
        let side = [[0., 0.], [1., 0.], [3., 0.], [2., 1.], [1., 2.], [0., 3.], [0., 2.], [0., 1.]];
        assert_covered(&flat(&side));
    }

    #[test]
    fn a_star_and_a_comb_are_covered() {
        let star: Vec<_> = (0..20)
            .map(|tip| {
                let (radius, angle) =
                    (if tip % 2 == 0 { 3.0 } else { 1.0 }, tip as f32 * 0.314_159);
                [radius * angle.cos(), radius * angle.sin()]
            })
            .collect();
        assert_covered(&flat(&star));
        let mut comb = vec![[0., 0.], [90., 0.]];
        comb.extend(
            (0..90).rev().map(|tooth| [tooth as f32, if tooth % 2 == 0 { 9. } else { 1. }]),
        );
        assert_covered(&flat(&comb));
    }

    #[test]
    fn degenerate_polygons_lose_nothing() {
        let nan = f32::NAN;
        let cases = [
            flat(&[[0., 0.]; 6]),
            flat(&[[0., 0.], [1., 0.], [2., 0.], [3., 0.], [4., 0.]]),
            flat(&[[0., 0.], [1., 0.], [nan, 0.], [3., 0.], [4., 1.]]),
            flat(&[[0., 0.], [2., 2.], [2., 0.], [0., 2.], [1., 5.]]),
            flat(&[[0., 0.], [2., 0.], [2., 0.], [2., 2.], [0., 2.], [1., 1.]]),
        ];
        for polygon in cases {
            let mut out = Vec::new();
            triangulate(&polygon, &mut out);
            assert_eq!(out.len(), polygon.len() - 2);
            let is_used = |corner: u32| out.iter().flatten().any(|&c| c == corner);
            assert!((0..polygon.len() as u32).all(is_used), "{out:?}");
        }
    }
}
