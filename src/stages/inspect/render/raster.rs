//! Triangles onto the samples of a frame.
//!
//! Corners are rounded to a fine grid, and all that decides whether a triangle covers a sample is
//! computed in integers: triangles that share an edge leave no sample between them, and none is
//! covered by both. Most triangles of a large mesh lie between samples; they cost a few
//! instructions.

use glam::Vec3A;

use super::{
    camera::{Projection, STEPS_PER_SAMPLE},
    frame::{Frame, Seen, key, may_be_seen, show},
    light,
};
use crate::soup::{Triangle, Vertex};

/// How the triangles of a pass are drawn.
#[derive(Clone, Copy, Debug)]
pub(super) struct Style {
    /// Half the width of edges in steps, where they are drawn.
    pub(super) edge: Option<f32>,
}

/// Added to a number of at most 2²² it leaves the number, rounded, in the bits of the sum.
const ROUNDING: f32 = 12_582_912.0;

/// A position on the grid that corners are rounded to.
#[inline]
fn steps(coordinate: f32) -> i32 {
    (coordinate + ROUNDING).to_bits() as i32 - ROUNDING.to_bits() as i32
}

/// The first sample whose middle is not before `least`, in samples from the middle of the area.
#[inline]
fn first_sample(least: f32) -> i32 {
    (steps(least) + (STEPS_PER_SAMPLE / 2 - 1)) >> STEPS_PER_SAMPLE.trailing_zeros()
}

/// The last sample whose middle is not behind `most`.
#[inline]
fn last_sample(most: f32) -> i32 {
    (steps(most) - STEPS_PER_SAMPLE / 2) >> STEPS_PER_SAMPLE.trailing_zeros()
}

/// Triangles worked on together: their corners stay in the first level of the cache, and the samples
/// they might cover are fetched side by side.
const CHUNK: usize = 128;

/// Draws triangles.
pub(super) fn draw<V: Vertex>(
    triangles: &[Triangle<V>],
    projection: &Projection,
    style: Style,
    frame: &Frame,
) {
    let mut candidates = [Candidate::default(); CHUNK];
    let mut kept = [0; CHUNK];
    for triangles in triangles.chunks(CHUNK) {
        let count = find_candidates(triangles, projection, &mut candidates);
        let count = drop_hidden(&candidates[..count], frame, &mut kept);
        for index in &kept[..count] {
            let candidate = &candidates[usize::from(*index)];
            fill(&triangles[candidate.index as usize], candidate, style, frame);
        }
    }
}

/// A triangle that may cover samples.
#[derive(Clone, Copy, Default)]
struct Candidate {
    corners: [Vec3A; 3],
    /// Least depth.
    nearest: f32,
    /// The samples it may cover, counted from the middle of the area; both ends are in it.
    columns: [i32; 2],
    rows: [i32; 2],
    /// The first of them, in the whole frame.
    first: [u32; 2],
    /// Index in its chunk.
    index: u32,
}

impl Candidate {
    /// Whether its first sample is on different sides of two edges. Of large ones the answer means
    /// nothing: products may not fit.
    #[inline]
    fn is_beside(&self) -> bool {
        let middle = |samples: i32| samples * STEPS_PER_SAMPLE + STEPS_PER_SAMPLE / 2;
        let (x, y) = (middle(self.columns[0]), middle(self.rows[0]));
        let [a, b, c] = self.corners.map(|at| [steps(at.x) - x, steps(at.y) - y]);
        let side = |p: [i32; 2], q: [i32; 2]| {
            p[0].wrapping_mul(q[1]).wrapping_sub(p[1].wrapping_mul(q[0]))
        };
        let [a, b, c] = [side(a, b), side(b, c), side(c, a)];
        (a | b | c < 0) & (a.max(b).max(c) > 0)
    }

    /// Whether it may cover one sample only.
    #[inline]
    fn is_small(&self) -> bool {
        self.columns[0] == self.columns[1] && self.rows[0] == self.rows[1]
    }
}

/// Finds the triangles whose box has a sample in it; returns how many. Whether a small one has is
/// chance: there is no branch for it.
#[inline]
fn find_candidates<V: Vertex>(
    triangles: &[Triangle<V>],
    projection: &Projection,
    candidates: &mut [Candidate; CHUNK],
) -> usize {
    let area = projection.area;
    let middle = area.middle();
    let (left, right) = (area.left as i32 - middle[0], (area.left + area.width) as i32 - middle[0]);
    let (top, bottom) = (area.top as i32 - middle[1], (area.top + area.height) as i32 - middle[1]);
    let mut count = 0;
    for (index, triangle) in triangles.iter().enumerate() {
        let corners = triangle.0.map(|vertex| projection.project(vertex.position()));
        let [a, b, c] = corners;
        let (min, max) = (a.min(b).min(c), a.max(b).max(c));
        let columns = [first_sample(min.x).max(left), last_sample(max.x).min(right - 1)];
        let rows = [first_sample(min.y).max(top), last_sample(max.y).min(bottom - 1)];
        // Of no use, and not used, where there is no sample.
        let first = [(rows[0] + middle[1]) as u32, (columns[0] + middle[0]) as u32];
        let (nearest, index) = (min.z, index as u32);
        candidates[count] = Candidate { corners, nearest, columns, rows, first, index };
        let spans = (columns[1] - columns[0]) | (rows[1] - rows[0]);
        count += usize::from(spans >= 0);
    }
    count
}

/// Lists the candidates that are not small and beside their sample, or behind what is seen there
/// already; returns how many. Samples are far from each other, and mostly not in the cache: nothing
/// here waits for one, and there is no branch, as either is chance.
#[inline]
fn drop_hidden(candidates: &[Candidate], frame: &Frame, kept: &mut [u8; CHUNK]) -> usize {
    let mut count = 0;
    for (index, candidate) in candidates.iter().enumerate() {
        let [row, column] = candidate.first.map(|at| at as usize);
        let may_be_seen = may_be_seen(frame.at(row, column), key(candidate.nearest));
        kept[count] = index as u8;
        count += usize::from(may_be_seen & !candidate.is_beside() | !candidate.is_small());
    }
    count
}

/// A directed edge as a function of the sample: not negative where the sample is on its inner side.
#[derive(Clone, Copy)]
struct Edge {
    /// At the sample in question.
    value: i64,
    per_column: i64,
    per_row: i64,
}

impl Edge {
    /// The edge from `from` to `to`, at a sample. Of the samples exactly on it, it has those that
    /// the same edge in the other direction has not.
    #[inline]
    fn new(from: [i32; 2], to: [i32; 2], sample: [i32; 2]) -> Self {
        let [dx, dy] = [0, 1].map(|axis| i64::from(to[axis] - from[axis]));
        let at = [0, 1].map(|axis| {
            i64::from(sample[axis] * STEPS_PER_SAMPLE + STEPS_PER_SAMPLE / 2 - from[axis])
        });
        let owns = dy > 0 || dy == 0 && dx > 0;
        Self {
            value: dx * at[1] - dy * at[0] - i64::from(!owns),
            per_column: -dy * i64::from(STEPS_PER_SAMPLE),
            per_row: dx * i64::from(STEPS_PER_SAMPLE),
        }
    }

    /// Narrows a range of columns, counted from where the edge is, to those on its inner side.
    fn narrow(&self, range: &mut [i64; 2]) {
        match self.per_column {
            step @ 1.. => range[0] = range[0].max((-self.value + step - 1).div_euclid(step)),
            0 if self.value < 0 => range[1] = range[0] - 1,
            0 => {}
            step => range[1] = range[1].min(self.value.div_euclid(-step)),
        }
    }
}

/// Windows wider than this are narrowed row by row to what the triangle covers: a sliver across the
/// picture takes as long as it is long. Chosen by hand: three divisions cost about as much.
const COLUMNS_TESTED_MAX: i32 = 16;

/// Fills the samples of a triangle.
fn fill<V: Vertex>(triangle: &Triangle<V>, candidate: &Candidate, style: Style, frame: &Frame) {
    let on_grid = candidate.corners.map(|corner| [steps(corner.x), steps(corner.y)]);
    let [a, b, c] = on_grid;
    let doubled = |p: [i32; 2], q: [i32; 2]| {
        let [p, q] = [p, q].map(|p| [0, 1].map(|axis| i64::from(p[axis] - a[axis])));
        p[0] * q[1] - p[1] * q[0]
    };
    let area = doubled(b, c);
    if area == 0 {
        return;
    }
    // Inside is where all edges say so if the corners go round in the one direction.
    let order = if area > 0 { [0, 1, 2] } else { [0, 2, 1] };
    let [a, b, c] = order.map(|index| on_grid[index]);
    let first = [candidate.columns[0], candidate.rows[0]];
    let mut edges = [Edge::new(b, c, first), Edge::new(c, a, first), Edge::new(a, b, first)];
    let is_outside = edges.iter().fold(0, |all, edge| all | edge.value) < 0;
    if is_outside && candidate.is_small() {
        return;
    }
    let mut surface = Surface::new(triangle, candidate.corners, order, area.unsigned_abs());
    let near_edge = style.edge.map(|half_width| {
        let length = |edge: &Edge| (edge.per_column as f32).hypot(edge.per_row as f32);
        edges.map(|e| (length(&e) * half_width / STEPS_PER_SAMPLE as f32) as i64)
    });
    let width = candidate.columns[1] - candidate.columns[0] + 1;
    let height = candidate.rows[1] - candidate.rows[0] + 1;
    let [first_row, first_column] = candidate.first.map(|at| at as usize);
    for row in first_row..first_row + height as usize {
        let mut range = [0, i64::from(width) - 1];
        if width > COLUMNS_TESTED_MAX {
            for edge in &edges {
                edge.narrow(&mut range);
            }
        }
        if range[0] <= range[1] {
            let samples = Samples { frame, row, first_column };
            fill_row(&edges, range, near_edge, &mut surface, &samples);
        }
        for edge in &mut edges {
            edge.value += edge.per_row;
        }
    }
}

/// A row of samples, from a column on.
struct Samples<'a> {
    frame: &'a Frame,
    row: usize,
    first_column: usize,
}

/// Fills what the edges leave of a range of columns.
#[inline]
fn fill_row<V: Vertex>(
    edges: &[Edge; 3],
    range: [i64; 2],
    near_edge: Option<[i64; 3]>,
    surface: &mut Surface<V>,
    samples: &Samples,
) {
    let mut values = edges.map(|edge| edge.value + edge.per_column * range[0]);
    for column in range[0]..=range[1] {
        if values[0] | values[1] | values[2] >= 0 {
            let sample = samples.frame.at(samples.row, samples.first_column + column as usize);
            let key = key(surface.depth(values));
            if may_be_seen(sample, key) {
                let is_edge = near_edge.is_some_and(|widths| {
                    values.iter().zip(widths).any(|(value, width)| *value < width)
                });
                let seen = surface.seen(values);
                show(sample, key, if is_edge { seen.on_edge() } else { seen });
            }
        }
        for (value, edge) in values.iter_mut().zip(edges) {
            *value += edge.per_column;
        }
    }
}

/// What a triangle looks like at its samples.
struct Surface<'a, V> {
    triangle: &'a Triangle<V>,
    corners: [Vec3A; 3],
    /// The corners in the order of the edges opposite to them.
    order: [usize; 3],
    per_area: f32,
    /// Least and greatest depth.
    depths: [f32; 2],
    /// The same all over the triangle, if it has no colours.
    plain: Option<Seen>,
}

impl<'a, V: Vertex> Surface<'a, V> {
    #[inline]
    fn new(triangle: &'a Triangle<V>, corners: [Vec3A; 3], order: [usize; 3], area: u64) -> Self {
        let [a, b, c] = corners.map(|corner| corner.z);
        let depths = [a.min(b).min(c), a.max(b).max(c)];
        Self { triangle, corners, order, per_area: (area as f32).recip(), depths, plain: None }
    }

    /// The share of the second and third corner at a sample.
    #[inline]
    fn shares(&self, values: [i64; 3]) -> [f32; 2] {
        [values[1] as f32 * self.per_area, values[2] as f32 * self.per_area]
    }

    #[inline]
    fn depth(&self, values: [i64; 3]) -> f32 {
        let [a, b, c] = self.order.map(|index| self.corners[index].z);
        let [to_b, to_c] = self.shares(values);
        let depth = a + (b - a) * to_b + (c - a) * to_c;
        // Of slivers, rounding could make anything.
        depth.max(self.depths[0]).min(self.depths[1])
    }

    #[inline]
    fn seen(&mut self, values: [i64; 3]) -> Seen {
        if let Some(seen) = self.plain {
            return seen;
        }
        let [a, b, c] = self.corners;
        let normal = (b - a).cross(c - a);
        if !V::COLORED {
            return *self.plain.insert(Seen::plain(normal));
        }
        let color = |index: usize| {
            let [red, green, blue, _] = self.triangle.0[index].color().map(f32::from);
            Vec3A::new(red, green, blue)
        };
        let [a, b, c] = self.order.map(color);
        let [to_b, to_c] = self.shares(values);
        let color = a + (b - a) * to_b + (c - a) * to_c;
        Seen::colored(normal, color.clamp(Vec3A::ZERO, Vec3A::splat(255.0)), light::of_normal)
    }
}
