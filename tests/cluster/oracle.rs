//! Clustering once more, in double precision and by hash map: slow, short, and written from the
//! formulas alone.

use std::collections::{BTreeSet, HashMap};

use crate::command::Surface;

type Point = [f64; 3];
type Corners = [[f32; 3]; 3];

/// What clustering should make of some triangles.
pub(super) struct Oracle {
    pub(super) cell_size: f64,
    min: Point,
    /// Of cells with triangles, in the order of z, then y, then x.
    pub(super) vertices: Vec<Representative>,
    /// As indices of `vertices`, the smallest first, in order.
    pub(super) triangles: Vec<[u64; 3]>,
}

pub(super) struct Representative {
    pub(super) cell: [u32; 3],
    pub(super) position: Point,
    pub(super) color: [f64; 4],
}

/// E(x) = xᵀ A x − 2 bᵀ x.
#[derive(Clone, Default)]
struct Cell {
    a: [Point; 3],
    b: Point,
    /// Σ of edge normals, and Σ of their offsets.
    edges: (Point, f64),
    weight: f64,
    /// Σ weight · corner.
    mean: Point,
    color: [f64; 4],
}

/// Share of edges against faces.
const BOUNDARY_WEIGHT: f64 = 0.5;
/// Share of "stay near the mean".
const MEAN_WEIGHT: f64 = 1e-3;
/// Areas and lengths are cut to this, in cells.
const MOST: f64 = 4.0;

impl Oracle {
    pub(super) fn new(triangles: &[Corners], cells: u32) -> Self {
        let colored: Vec<_> = triangles.iter().map(|corners| (*corners, [[255; 4]; 3])).collect();
        Self::of(&colored, cells)
    }

    pub(super) fn with_colors(surface: &Surface, cells: u32) -> Self {
        let color = |index: &u64| surface.colors[*index as usize];
        let colors = surface.triangles.iter().map(|t| [color(&t[0]), color(&t[1]), color(&t[2])]);
        let colored: Vec<_> = surface.corners().into_iter().zip(colors).collect();
        Self::of(&colored, cells)
    }

    fn of(triangles: &[(Corners, [[u8; 4]; 3])], cells: u32) -> Self {
        let points = || triangles.iter().flat_map(|(corners, _)| corners);
        let bound = |axis: usize, pick: fn(f32, f32) -> f32| {
            f64::from(points().map(|point| point[axis]).reduce(pick).unwrap())
        };
        let min: Point = std::array::from_fn(|axis| bound(axis, f32::min));
        let longest = (0..3).map(|axis| bound(axis, f32::max) - min[axis]).fold(0.0, f64::max);
        let cell_size = longest / f64::from(cells);
        let per_unit = 1.0 / cell_size;
        let mut table: HashMap<[u32; 3], Cell> = HashMap::new();
        let mut kept = BTreeSet::new();
        for (corners, colors) in triangles {
            let grid = corners.map(|p| -> Point {
                std::array::from_fn(|axis| (f64::from(p[axis]) - min[axis]) * per_unit)
            });
            let ids = grid.map(|p| p.map(|c| (c as u32).min(cells - 1)));
            for corner in 0..3 {
                let cell = table.entry(ids[corner]).or_default();
                add_corner(cell, &grid, corner, ids[corner]);
                let weight = area(&grid);
                for (sum, channel) in cell.color.iter_mut().zip(colors[corner]) {
                    *sum += weight * f64::from(channel);
                }
            }
            let [a, b, c] = ids.map(|[x, y, z]| [z, y, x]);
            if a != b && b != c && c != a {
                kept.insert([[a, b, c], [b, c, a], [c, a, b]].into_iter().min().unwrap());
            }
        }
        let used: BTreeSet<[u32; 3]> = kept.iter().flatten().copied().collect();
        let number: HashMap<_, _> = used.iter().zip(0_u64..).map(|(id, n)| (*id, n)).collect();
        let place = |id: &[u32; 3]| {
            let cell = [id[2], id[1], id[0]];
            let sums = &table[&cell];
            let local = sums.minimum();
            let position = std::array::from_fn(|axis| {
                min[axis] + (f64::from(cell[axis]) + 0.5 + local[axis]) * cell_size
            });
            Representative { cell, position, color: sums.color.map(|sum| sum / sums.weight) }
        };
        Self {
            cell_size,
            min,
            vertices: used.iter().map(place).collect(),
            triangles: kept.iter().map(|t| t.map(|id| number[&id])).collect(),
        }
    }

    /// How far a position lies outside a cell, in cells.
    pub(super) fn outside(&self, cell: [u32; 3], position: Point) -> f64 {
        let beyond = |axis: usize| {
            let at = (position[axis] - self.min[axis]) / self.cell_size - f64::from(cell[axis]);
            (at - 1.0).max(-at)
        };
        (0..3).map(beyond).fold(0.0, f64::max)
    }
}

fn minus(a: Point, b: Point) -> Point {
    std::array::from_fn(|axis| a[axis] - b[axis])
}

fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Point, b: Point) -> Point {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn area(corners: &[Point; 3]) -> f64 {
    let normal = cross(minus(corners[1], corners[0]), minus(corners[2], corners[0]));
    (0.5 * dot(normal, normal).sqrt()).min(MOST)
}

/// Adds the plane of the triangle, and the planes through its edges at this corner.
fn add_corner(cell: &mut Cell, corners: &[Point; 3], corner: usize, id: [u32; 3]) {
    let local = corners.map(|p| std::array::from_fn(|i| p[i] - f64::from(id[i]) - 0.5));
    let [at, next, last] = [0, 1, 2].map(|step| local[(corner + step) % 3]);
    let normal = cross(minus(next, at), minus(last, at));
    let length = dot(normal, normal).sqrt();
    let n = if length > 0.0 { normal.map(|c| c / length) } else { [0.0; 3] };
    let weight = area(corners);
    add_plane(&mut cell.a, &mut cell.b, n, dot(n, at), weight * (1.0 - BOUNDARY_WEIGHT));
    for edge in [minus(next, at), minus(at, last)] {
        let length = dot(edge, edge).sqrt();
        let m = cross(edge.map(|c| c * (MOST / length).min(1.0)), n);
        cell.edges.0 = std::array::from_fn(|i| cell.edges.0[i] + m[i]);
        cell.edges.1 += dot(m, at);
    }
    cell.weight += weight;
    cell.mean = std::array::from_fn(|i| cell.mean[i] + weight * at[i]);
}

/// Adds weight · (n·x − d)².
fn add_plane(a: &mut [Point; 3], b: &mut Point, n: Point, d: f64, weight: f64) {
    for row in 0..3 {
        for column in 0..3 {
            a[row][column] += weight * n[row] * n[column];
        }
        b[row] += weight * d * n[row];
    }
}

impl Cell {
    /// The least E in the cell: each axis is free or at one of its two ends, and of these 27
    /// points the best that lies in the cell is the minimum, as E is convex.
    fn minimum(&self) -> Point {
        let (mut a, mut b) = (self.a, self.b);
        add_plane(&mut a, &mut b, self.edges.0, self.edges.1, BOUNDARY_WEIGHT);
        let trace = a[0][0] + a[1][1] + a[2][2];
        for axis in 0..3 {
            a[axis][axis] += trace * MEAN_WEIGHT;
            b[axis] += trace * MEAN_WEIGHT * self.mean[axis] / self.weight;
        }
        let error =
            |x: &Point| (0..3).map(|row| x[row] * (dot(a[row], *x) - 2.0 * b[row])).sum::<f64>();
        let places = (0..27).map(|code: usize| {
            let fixed =
                [code % 3, code / 3 % 3, code / 9].map(|end| [None, Some(-0.5), Some(0.5)][end]);
            solve(&a, &b, fixed)
        });
        let inside = |x: &Point| x.iter().all(|c| c.abs() <= 0.5 + 1e-12);
        places.filter(inside).min_by(|x, y| error(x).total_cmp(&error(y))).unwrap()
    }
}

/// A x = b for the axes that are not fixed, by elimination.
fn solve(a: &[Point; 3], b: &Point, fixed: [Option<f64>; 3]) -> Point {
    let mut rows: [[f64; 4]; 3] = std::array::from_fn(|row| match fixed[row] {
        Some(value) => std::array::from_fn(|column| match column {
            3 => value,
            column => f64::from(u8::from(column == row)),
        }),
        None => [a[row][0], a[row][1], a[row][2], b[row]],
    });
    for pivot in 0..3 {
        let best =
            (pivot..3).max_by(|x, y| rows[*x][pivot].abs().total_cmp(&rows[*y][pivot].abs()));
        rows.swap(pivot, best.unwrap());
        for row in 0..3 {
            if row != pivot {
                let factor = rows[row][pivot] / rows[pivot][pivot];
                let upper = rows[pivot];
                rows[row].iter_mut().zip(upper).for_each(|(value, above)| *value -= factor * above);
            }
        }
    }
    std::array::from_fn(|row| rows[row][3] / rows[row][row])
}
