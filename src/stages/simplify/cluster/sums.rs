//! What one triangle adds to the cells of its corners, as integers.
//!
//! Integer sums do not depend on their order: the result has the same bytes for any budget,
//! thread count and pattern of spills. Sixteen `i32` fill one cache line. In local coordinates
//! (unit cells, origin at the cell's centre), over the corners x of triangles with unit normal n
//! and area w in this cell, the sums are, in this order:
//!
//! ```text
//! 0..4    w·(nx nx, nx ny, nx nz), w                      nz nz follows from |n| = 1
//! 4..8    w·(n·x)·n, w·ny ny                              planes: Σ w (n·p − n·x)²
//! 8..12   m, m·x with m = Σ over both half-edges e at x of e × n     edge planes, summed
//! 12..16  w·x, w·ny nz                                    mean position
//! ```
//!
//! `[LS01]` weighs planes by squared area and edges by squared length; we weigh by area and
//! length, which does not change when a triangle is split, and fits 32 bits (docs/PAPERS.md).

use glam::{DMat3, DVec3, Vec3A, Vec4};

use crate::geometry::Quadric;

/// Number of sums per cell, besides those of attributes.
pub(super) const SUMS: usize = 16;

/// Sums of one cell over some triangles.
pub(super) type CellSums = [i32; SUMS];

/// The same over all triangles.
pub(super) type TotalSums = [i64; SUMS];

/// Index of Σ w.
pub(super) const WEIGHT: usize = 3;

/// Fixed point: this much is 1. With a cell crossed by 1 M triangles, each still adds about 100.
pub(super) const ONE: f32 = (1 << 26) as f32;

/// Areas and edge lengths, in cells, are cut to these, so that no single number reaches
/// [`LIMIT`]: a triangle larger than its cells adds no more weight by being larger still.
const AREA_MAX: f32 = 4.0;
const EDGE_MAX: f32 = 4.0;

/// Sums at or beyond this are moved to wider ones before the next addition. No corner adds more
/// than 2·2·[`EDGE_MAX`]·√3/2·[`ONE`] < `LIMIT`, so an `i32` cannot overflow.
pub(super) const LIMIT: i32 = 1 << 30;

/// A triangle in grid coordinates, seen from its cells.
pub(super) struct Stamp {
    /// Unit normal, or zero.
    normal: Vec3A,
    /// Area, cut.
    area: f32,
    /// Per corner: the sum of its two half-edges, each cut.
    edges: [Vec3A; 3],
    /// |cross product|, uncut.
    pub(super) twice_area: f32,
}

impl Stamp {
    /// The stamp of the triangle with these corners, the last number of each without a meaning.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "measured: a tenth of the pass")]
    pub(super) fn new(corners: &[[f64; 4]; 3]) -> Self {
        let [a, b, c] = corners;
        let edge = |from: &[f64; 4], to: &[f64; 4]| {
            let edge: [f32; 4] = std::array::from_fn(|axis| (to[axis] - from[axis]) as f32);
            Vec3A::from_vec4(Vec4::from_array(edge))
        };
        let (ab, bc, ca) = (edge(a, b), edge(b, c), edge(c, a));
        let cross = ab.cross(-ca);
        let twice_area = cross.length();
        let normal = if twice_area > f32::MIN_POSITIVE { cross / twice_area } else { Vec3A::ZERO };
        let mut half_edges = [ab, bc, ca];
        let is_long = |edge: Vec3A| edge.length_squared() > EDGE_MAX * EDGE_MAX;
        if is_long(ab) | is_long(bc) | is_long(ca) {
            half_edges = half_edges.map(|edge| edge.clamp_length_max(EDGE_MAX));
        }
        let [ab, bc, ca] = half_edges;
        let edges = [ca + ab, ab + bc, bc + ca];
        Self { normal, area: (0.5 * twice_area).min(AREA_MAX), edges, twice_area }
    }

    /// What two corners add when they share a cell, and the third does not.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "measured: a tenth of the pass")]
    pub(super) fn pair(&self, [i, j]: [usize; 2], locals: &[Vec3A; 3]) -> CellSums {
        let planes = [i, j].map(|corner| self.edges[corner].cross(self.normal));
        let offset = planes[0].dot(locals[i]) + planes[1].dot(locals[j]);
        let mean = (locals[i] + locals[j]) * 0.5;
        self.fixed(2.0 * self.area, locals[i], planes[0] + planes[1], offset, mean)
    }

    /// What corner `index` at `local` adds to its cell.
    #[inline]
    pub(super) fn corner(&self, index: usize, local: Vec3A) -> CellSums {
        let edge_plane = self.edges[index].cross(self.normal);
        self.fixed(self.area, local, edge_plane, edge_plane.dot(local), local)
    }

    /// What all three corners add when they share a cell: the edge normals cancel.
    #[inline]
    pub(super) fn whole(&self, locals: [Vec3A; 3]) -> CellSums {
        let mean = (locals[0] + locals[1] + locals[2]) / 3.0;
        self.fixed(3.0 * self.area, locals[0], Vec3A::ZERO, 2.0 * self.twice_area, mean)
    }

    #[inline(always)]
    #[expect(clippy::inline_always, reason = "measured: a tenth of the pass")]
    fn fixed(&self, w: f32, on_plane: Vec3A, m: Vec3A, m_offset: f32, mean: Vec3A) -> CellSums {
        let n = self.normal;
        let wn = n * w;
        let planes = (n * wn.x).extend(w);
        let offsets = (wn * n.dot(on_plane)).extend(wn.y * n.y);
        let rows = [planes, offsets, m.extend(m_offset), (mean * w).extend(wn.y * n.z)];
        let mut sums: CellSums = zerocopy::transmute!(rows.map(to_fixed));
        // A triangle without area still says where its corners are.
        sums[WEIGHT] = sums[WEIGHT].max(1);
        sums
    }
}

/// 1.5·2⁵²: an `f64` at this size has its unit in the last place, so that adding it rounds to the
/// nearest integer, and the low bits are that integer in two's complement. Unlike `as i32`, which
/// saturates, this is two instructions and runs on vectors.
const ROUND_TO_INTEGER: f64 = 6_755_399_441_055_744.0;

/// Rounds to the nearest fixed-point numbers; below 2³¹ in magnitude.
#[inline(always)]
#[expect(clippy::inline_always, reason = "measured: a tenth of the pass")]
fn to_fixed(values: Vec4) -> [i32; 4] {
    let rounded = (values * ONE).to_array().map(|value| f64::from(value) + ROUND_TO_INTEGER);
    rounded.map(|value| (value.to_bits() as u32).cast_signed())
}

/// The planes of a cell's faces, weighted by area.
pub(super) fn to_surface(sums: &TotalSums) -> Quadric {
    let s = sums.map(|sum| sum as f64 / f64::from(ONE));
    let (xx, xy, xz, yy, yz) = (s[0], s[1], s[2], s[7], s[15]);
    let zz = (s[WEIGHT] - xx - yy).max(0.0);
    let a = DMat3::from_cols_array(&[xx, xy, xz, xy, yy, yz, xz, yz, zz]);
    Quadric { a, b: DVec3::new(s[4], s[5], s[6]) }
}

/// The quadric of a cell and the mean of its corners. `boundary_weight` is the 1 − λ of
/// `[LS01 §3.2]`.
pub(super) fn to_quadric(sums: &TotalSums, boundary_weight: f64) -> (Quadric, DVec3) {
    let s = sums.map(|sum| sum as f64 / f64::from(ONE));
    let Quadric { a, b } = to_surface(sums);
    let surface = 1.0 - boundary_weight;
    let mut quadric = Quadric { a: a * surface, b: b * surface };
    quadric.add_plane(boundary_weight, DVec3::new(s[8], s[9], s[10]), s[11]);
    let mean = DVec3::new(s[12], s[13], s[14]) / s[WEIGHT];
    (quadric, mean)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stamp_of(corners: [DVec3; 3]) -> Stamp {
        Stamp::new(&corners.map(|corner| corner.extend(0.0).to_array()))
    }

    fn local(p: DVec3) -> Vec3A {
        (p - p.floor() - 0.5).as_vec3a()
    }

    #[test]
    fn three_corners_in_one_cell_add_up_to_the_whole() {
        let corners =
            [DVec3::new(4.1, 2.2, 0.3), DVec3::new(4.9, 2.4, 0.5), DVec3::new(4.3, 2.8, 0.9)];
        let stamp = stamp_of(corners);
        let whole = stamp.whole(corners.map(local));
        let mut sum = [0; SUMS];
        for (index, corner) in corners.iter().enumerate() {
            for (total, add) in sum.iter_mut().zip(stamp.corner(index, local(*corner))) {
                *total += add;
            }
        }
        for lane in 0..SUMS {
            let difference = (whole[lane] - sum[lane]).abs();
            assert!(difference <= 32, "lane {lane}: {} {}", whole[lane], sum[lane]);
        }
    }

    /// ```text
    ///  c---d     two coplanar triangles abc' and bdc: the edge bc cancels, at b and at c
    ///  | \ |
    ///  a---b
    /// ```
    #[test]
    fn edge_planes_of_coplanar_neighbours_cancel() {
        let [a, b, c, d] =
            [(0.2, 0.2), (0.8, 0.2), (0.2, 0.8), (0.8, 0.8)].map(|(x, y)| DVec3::new(x, y, 0.5));
        let (left, right) = (stamp_of([a, b, c]), stamp_of([b, d, c]));
        // Round a closed square all boundary edges remain: their normals add up to zero.
        let mut total = [0_i64; SUMS];
        for (stamp, corners) in [(&left, [a, b, c]), (&right, [b, d, c])] {
            for (lane, add) in stamp.whole(corners.map(local)).into_iter().enumerate() {
                total[lane] += i64::from(add);
            }
        }
        assert_eq!(&total[8..11], &[0, 0, 0]);
        // At b alone: ab and bd remain, pointing to −y and +x.
        let at_b = [left.corner(1, local(b)), right.corner(0, local(b))];
        let m: Vec<f32> = (8..11).map(|i| (at_b[0][i] + at_b[1][i]) as f32 / ONE).collect();
        assert!((m[0] - 0.6).abs() < 1e-6 && (m[1] + 0.6).abs() < 1e-6 && m[2] == 0.0, "{m:?}");
    }

    #[test]
    fn nothing_a_triangle_adds_reaches_the_limit() {
        let far = DVec3::new(2e6, 1e6, 5e5);
        let stamp = stamp_of([DVec3::ZERO, far, DVec3::new(-1e6, 2e6, 1e3)]);
        for corner in 0..3 {
            let sums = stamp.corner(corner, Vec3A::splat(0.5));
            assert!(sums.iter().all(|sum| sum.abs() < LIMIT), "{sums:?}");
        }
    }

    #[test]
    fn a_triangle_without_area_still_has_a_mean() {
        let at = DVec3::new(0.7, 0.6, 0.5);
        let sums = stamp_of([at; 3]).whole([local(at); 3]);
        let (_, mean) = to_quadric(&sums.map(i64::from), 0.5);
        assert!(mean.abs().max_element() <= 0.5 && sums[WEIGHT] == 1);
    }
}
