//! Volumes that edge collapses sweep over, four edges at a time.
//!
//! All is relative to the vertex that is removed, and in units of about an edge, so that single
//! precision holds it wherever the mesh lies and however small its faces are.

use glam::{Mat4, Vec3, Vec4};

/// Sums over the faces around a vertex: `H` = Σ n nᵀ and `g` = Σ n of their normals n, as long as
/// twice their areas. Neither depends on the origin.
///
/// With the origin at the vertex all its faces lie on planes n·x = 0, so that these sums are all
/// there is to know; seen from `e` away, Σ(n·x − n·e)² = xᵀHx − 2·x·(He) + e·(He).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(16))]
pub struct Sums {
    /// Rows: `H.xx H.xy H.xz H.yy`, `H.yz H.zz g.x g.y`, `g.z` and the position of the vertex.
    rows: [Vec4; 3],
}

/// What marks sums that must be computed: the trace of `H` is not negative.
const STALE: f32 = -1.0;

impl Sums {
    /// Sums that must be computed.
    pub(super) const STALE: Self = Self { rows: [Vec4::splat(STALE); 3] };

    #[inline]
    pub(super) fn is_stale(&self) -> bool {
        self.rows[0].x == STALE
    }

    /// Of a vertex at `position`, from the sums of four lanes each: `H` and `g`.
    #[inline]
    pub(super) fn of_lanes(h: &[Vec4; 6], g: &[Vec4; 3], position: Vec3) -> Self {
        let first = transposed([h[0], h[1], h[2], h[3]]);
        let second = transposed([h[4], h[5], g[0], g[1]]);
        let sum = |lanes: [Vec4; 4]| (lanes[0] + lanes[1]) + (lanes[2] + lanes[3]);
        let third = position.extend(0.0);
        let third = Vec4::new(g[2].element_sum(), third.x, third.y, third.z);
        Self { rows: [sum(first), sum(second), third] }
    }

    /// `d·H·d`: what moving the vertex by `d` sweeps over.
    #[inline]
    pub(super) fn at(&self, d: Vec3) -> f32 {
        let [a, b, _] = self.rows;
        let x = a.x * d.x + a.y * d.y + a.z * d.z;
        let y = a.y * d.x + a.w * d.y + b.x * d.z;
        let z = a.z * d.x + b.x * d.y + b.y * d.z;
        d.x * x + d.y * y + d.z * z
    }
}

/// Sums of four vertices side by side, or of one in all lanes.
pub(super) struct FourSums {
    h: [Vec4; 6],
    g: [Vec4; 3],
    position: [Vec4; 3],
}

impl FourSums {
    #[inline]
    pub(super) fn of(four: [&Sums; 4]) -> Self {
        let [xx, xy, xz, yy] = transposed(four.map(|sums| sums.rows[0]));
        let [yz, zz, gx, gy] = transposed(four.map(|sums| sums.rows[1]));
        let [gz, x, y, z] = transposed(four.map(|sums| sums.rows[2]));
        Self { h: [xx, xy, xz, yy, yz, zz], g: [gx, gy, gz], position: [x, y, z] }
    }

    #[inline]
    pub(super) fn splat(sums: &Sums) -> Self {
        let [a, b, c] = sums.rows;
        let h = [a.x, a.y, a.z, a.w, b.x, b.y].map(Vec4::splat);
        let (g, position) = ([b.z, b.w, c.x], [c.y, c.z, c.w]);
        Self { h, g: g.map(Vec4::splat), position: position.map(Vec4::splat) }
    }

    /// Takes a face off the sums.
    #[inline]
    pub(super) fn subtract(&mut self, n: [Vec4; 3]) {
        let [x, y, z] = n;
        for (sum, term) in self.h.iter_mut().zip([x * x, x * y, x * z, y * y, y * z, z * z]) {
            *sum -= term;
        }
        for (sum, term) in self.g.iter_mut().zip(n) {
            *sum -= term;
        }
    }
}

/// Weight of the middle of the edge, relative to the trace of `H`: decides where the surface is
/// flat or straight. From the prototype of the design.
pub(super) const MIDDLE_WEIGHT: f32 = 1e-3;

/// The new vertex lies no further from the middle of its edge than this many lengths of it,
/// squared. Chosen by hand.
pub(super) const REACH_SQ: f32 = 4.0;

/// The best places for four edges, relative to the end removed, and what they cost: infinite where
/// there is none.
///
/// `own` are the sums of the removed end without the faces that it shares with the kept one;
/// `others` are those of the kept ends, and `unit` scales lengths.
#[inline]
pub(super) fn best_places(
    own: &FourSums,
    others: &FourSums,
    unit: f32,
    from: Vec3,
) -> ([Vec4; 3], Vec4) {
    let e: [Vec4; 3] = std::array::from_fn(|axis| (others.position[axis] - from[axis]) * unit);
    // The planes of the faces around the kept end; those shared contain the edge, and add nothing.
    let c = times(&others.h, e);
    let (k, d) = (dot(c, e), dot(others.g, e));
    let h: [Vec4; 6] = std::array::from_fn(|i| own.h[i] + others.h[i]);
    let g: [Vec4; 3] = std::array::from_fn(|i| own.g[i] + others.g[i]);
    let trace = h[0] + h[3] + h[5];
    let weight = trace * MIDDLE_WEIGHT;
    // Scaled to a trace of about one: a determinant is a cube.
    let scale = trace.max(Vec4::splat(f32::MIN_POSITIVE)).recip();
    let a = [h[0] + weight, h[1], h[2], h[3] + weight, h[4], h[5] + weight].map(|a| a * scale);
    let b: [Vec4; 3] = std::array::from_fn(|i| (c[i] + e[i] * (weight * 0.5)) * scale);
    // The inverse up to its factor, which is the determinant.
    let adjoint = [
        a[3] * a[5] - a[4] * a[4],
        a[2] * a[4] - a[1] * a[5],
        a[1] * a[4] - a[2] * a[3],
        a[0] * a[5] - a[2] * a[2],
        a[1] * a[2] - a[0] * a[4],
        a[0] * a[3] - a[1] * a[1],
    ];
    let determinant = a[0] * adjoint[0] + a[1] * adjoint[1] + a[2] * adjoint[2];
    let factor = determinant.recip();
    let free = times(&adjoint, b).map(|x| x * factor);
    // On from the free minimum to the plane g·x = d that keeps the volume.
    let along = times(&adjoint, g);
    let slope = dot(g, along);
    let is_closed = slope.cmpgt(Vec4::splat(f32::MIN_POSITIVE));
    let step = Vec4::select(is_closed, (d - dot(g, free)) / slope, Vec4::ZERO);
    let x: [Vec4; 3] = std::array::from_fn(|i| free[i] + step * along[i]);
    let hx = times(&h, x);
    let rest: [Vec4; 3] = std::array::from_fn(|i| hx[i] - c[i] - c[i]);
    let cost = (dot(x, rest) + k).max(Vec4::ZERO);
    let from_middle: [Vec4; 3] = std::array::from_fn(|i| x[i] - e[i] * 0.5);
    let is_near = dot(from_middle, from_middle).cmple(dot(e, e) * REACH_SQ);
    (x, Vec4::select(is_near, cost, Vec4::INFINITY))
}

#[inline]
fn times(h: &[Vec4; 6], [x, y, z]: [Vec4; 3]) -> [Vec4; 3] {
    [h[0] * x + h[1] * y + h[2] * z, h[1] * x + h[3] * y + h[4] * z, h[2] * x + h[4] * y + h[5] * z]
}

#[inline]
fn dot(a: [Vec4; 3], b: [Vec4; 3]) -> Vec4 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Four rows of four as columns.
#[inline]
pub(super) fn transposed(rows: [Vec4; 4]) -> [Vec4; 4] {
    let columns = Mat4::from_cols(rows[0], rows[1], rows[2], rows[3]).transpose();
    [columns.x_axis, columns.y_axis, columns.z_axis, columns.w_axis]
}
