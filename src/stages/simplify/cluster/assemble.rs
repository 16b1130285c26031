//! From tables in memory to an indexed mesh: cells in id order, one vertex each.

use glam::DVec3;
use rayon::prelude::*;

use super::{
    Config, Outcome, Quadrics,
    sums::{SUMS, TotalSums, WEIGHT, to_quadric, to_surface},
    table::{CellTable, Overflow, add, widen},
    triples::{rotate, sort_and_dedup},
    used::Used,
};
use crate::{
    error::Result,
    geometry::{CellId, Quadric},
    progress::{Monitor, StageId},
    soup::{ATTRIBUTES_MAX, Column, IndexedMesh, Triangles, Vertex, VertexQuadric},
};

/// A cell of one table.
#[derive(Clone, Copy)]
struct Entry {
    id: CellId,
    table: u32,
    index: u32,
}

/// Cells per parallel task.
const CHUNK: usize = 1 << 12;

/// Makes the mesh of `tables`.
pub(super) fn in_memory<V: Vertex>(
    mut tables: Vec<CellTable<V>>,
    config: &Config,
    monitor: &Monitor,
) -> Result<Outcome<V>> {
    let entries = sorted_entries(&tables);
    tables.iter_mut().for_each(CellTable::drop_index);
    let meter = monitor.meter(StageId::Assemble, Some(entries.len() as u64));
    let mut overflow: Vec<Overflow> =
        tables.iter_mut().flat_map(|table| std::mem::take(&mut table.overflow)).collect();
    overflow.sort_unstable_by_key(|entry| entry.id);
    let (mut triangles, cells) = number_triangles(&entries, &mut tables);
    let mut used = Used::none(cells);
    triangles.iter().flatten().for_each(|rank| used.mark(u64::from(*rank)));
    used.number();
    let chunks = cell_chunks(&entries);
    let placed = chunks.into_par_iter().map(|chunk| {
        let mut placed = Representatives::default();
        let cells = entries[chunk.range].chunk_by(|a, b| a.id == b.id);
        for (cell, group) in (chunk.first_cell..).zip(cells) {
            if used.contains(cell) {
                let (sums, attributes) = total(group, &tables, &overflow);
                placed.push(representative(group[0].id, &sums, attributes, config));
            }
        }
        meter.add(0)?;
        Ok(placed)
    });
    let placed = placed.collect::<Result<Vec<Representatives<V>>>>()?;
    meter.add(entries.len() as u64)?;
    drop((tables, entries));
    let (vertices, quadrics): (Vec<_>, Vec<_>) =
        placed.into_iter().map(|chunk| (chunk.vertices, chunk.quadrics)).unzip();
    let (vertices, quadrics) = (vertices.concat(), quadrics.concat());
    meter.finish();
    let number = |rank: u32| used.number_of(u64::from(rank)) as u32;
    triangles.par_iter_mut().for_each(|triangle| *triangle = triangle.map(number));
    let mesh =
        IndexedMesh { vertices: Column::Memory(vertices), triangles: Triangles::Memory(triangles) };
    let quadrics = (config.quadrics == Quadrics::PassOn).then_some(Column::Memory(quadrics));
    Ok(Outcome { mesh, quadrics, cells, spills: 0 })
}

/// Vertices, and their quadrics where those are passed on.
pub(super) struct Representatives<V> {
    pub(super) vertices: Vec<V>,
    pub(super) quadrics: Vec<VertexQuadric>,
}

impl<V> Default for Representatives<V> {
    fn default() -> Self {
        Self { vertices: Vec::new(), quadrics: Vec::new() }
    }
}

impl<V> Representatives<V> {
    pub(super) fn push(&mut self, (vertex, quadric): (V, Option<VertexQuadric>)) {
        self.vertices.push(vertex);
        self.quadrics.extend(quadric);
    }
}

/// The vertex that stands for a cell, and its quadric if that is passed on.
pub(super) fn representative<V: Vertex>(
    id: CellId,
    sums: &TotalSums,
    attributes: [i64; ATTRIBUTES_MAX],
    config: &Config,
) -> (V, Option<VertexQuadric>) {
    let (quadric, mean) = to_quadric(sums, config.boundary_weight);
    let local = quadric.minimise(mean, config.placement);
    let vertex = V::mean(config.grid.to_model(id, local), attributes, sums[WEIGHT]);
    let passed_on = (config.quadrics == Quadrics::PassOn)
        .then(|| seen_from(local, &to_surface(sums), config.grid.cell_size()));
    (vertex, passed_on)
}

/// A quadric of a cell of this size relative to a point in it, in model units: weights are areas,
/// and there is one more length in b than in A.
fn seen_from(local: DVec3, quadric: &Quadric, cell_size: f64) -> VertexQuadric {
    let area = cell_size * cell_size;
    let [x, y, z] = [quadric.a.x_axis, quadric.a.y_axis, quadric.a.z_axis].map(|axis| axis * area);
    let b = (quadric.a * local - quadric.b) * area * cell_size;
    VertexQuadric {
        a: [x.x, x.y, x.z, y.y, y.z, z.z].map(|entry| entry as f32),
        b: b.to_array().map(|entry| entry as f32),
    }
}

/// The cells of all tables by id; equal ids are neighbours.
fn sorted_entries<V: Vertex>(tables: &[CellTable<V>]) -> Vec<Entry> {
    let mut entries = Vec::with_capacity(tables.iter().map(|table| table.ids.len()).sum());
    for (table, cells) in (0..).zip(tables) {
        entries.extend((0..).zip(&cells.ids).map(|(index, id)| Entry { id: *id, table, index }));
    }
    entries.par_sort_unstable_by_key(|entry| (entry.id, entry.table));
    entries
}

/// The triangles of all tables in terms of the cells' ranks, sorted, without duplicates; and the
/// number of cells.
fn number_triangles<V: Vertex>(
    entries: &[Entry],
    tables: &mut [CellTable<V>],
) -> (Vec<[u32; 3]>, u64) {
    let mut ranks: Vec<Vec<u32>> = tables.iter().map(|table| vec![0; table.sums.len()]).collect();
    let mut cells = 0;
    for group in entries.chunk_by(|a, b| a.id == b.id) {
        for entry in group {
            ranks[entry.table as usize][entry.index as usize] = cells;
        }
        cells += 1;
    }
    let mut all = Vec::new();
    for (table, ranks) in tables.iter_mut().zip(&ranks) {
        let triangles = std::mem::take(&mut table.triangles);
        let ranked = triangles.iter().map(|t| rotate(t.map(|cell| ranks[cell as usize])));
        all.extend(ranked);
    }
    (sort_and_dedup(all, cells as usize), u64::from(cells))
}

/// Entries of whole cells, for one task.
struct CellChunk {
    range: std::ops::Range<usize>,
    /// Rank of the first cell.
    first_cell: u64,
}

/// Cuts the entries into chunks that do not split a cell.
fn cell_chunks(entries: &[Entry]) -> Vec<CellChunk> {
    let (mut chunks, mut start, mut end, mut cell, mut first_cell) = (Vec::new(), 0, 0, 0, 0);
    for group in entries.chunk_by(|a, b| a.id == b.id) {
        end += group.len();
        cell += 1;
        if end - start >= CHUNK {
            chunks.push(CellChunk { range: start..end, first_cell });
            (start, first_cell) = (end, cell);
        }
    }
    chunks.push(CellChunk { range: start..end, first_cell });
    chunks
}

/// Sums of one cell over all tables.
fn total<V: Vertex>(
    group: &[Entry],
    tables: &[CellTable<V>],
    overflow: &[Overflow],
) -> (TotalSums, [i64; ATTRIBUTES_MAX]) {
    let (mut sums, mut attributes) = ([0; SUMS], [0; ATTRIBUTES_MAX]);
    for entry in group {
        let (table, index) = (&tables[entry.table as usize], entry.index as usize);
        add(&mut sums, &table.sums[index].map(i64::from));
        add(&mut attributes, &widen(table.attributes[index].as_ref()));
    }
    let first = overflow.partition_point(|moved| moved.id < group[0].id);
    for moved in overflow[first..].iter().take_while(|moved| moved.id == group[0].id) {
        add(&mut sums, &moved.sums);
        add(&mut attributes, &moved.attributes);
    }
    (sums, attributes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        geometry::{Bounds, Grid, Placement},
        progress::{Cancel, Monitor},
        soup::{Point, Triangle},
        stages::simplify::cluster::{merge, spill},
        storage::Workspace,
    };

    /// Hills over a square of 9 by 9 vertices, in cells of about four.
    fn hills() -> (Vec<Triangle<Point>>, Config) {
        let side = 9;
        let position = |i: u32| {
            let (x, y) = ((i % side) as f32, (i / side) as f32);
            [x, y, (0.9 * x).sin() + (0.7 * y).cos()]
        };
        let quads = (0..side * side).filter(|i| i % side < side - 1 && i / side < side - 1);
        let faces = quads.flat_map(|i| [[i, i + 1, i + side], [i + 1, i + side + 1, i + side]]);
        let triangles: Vec<Triangle<Point>> =
            faces.map(|face| Triangle(face.map(|v| Point(position(v))))).collect();
        let mut bounds = Bounds::default();
        (0..side * side).for_each(|v| bounds.add(position(v)));
        let grid = Grid::with_cells(&bounds, 4).unwrap();
        let config = Config {
            grid,
            boundary_weight: 0.5,
            placement: Placement::Constrained,
            assembly_bytes: 1 << 20,
            quadrics: Quadrics::PassOn,
        };
        (triangles, config)
    }

    #[test]
    fn what_is_passed_on_is_the_same_from_runs_on_disk() {
        let (triangles, config) = hills();
        let table = |triangles: &[Triangle<Point>]| {
            let mut table = CellTable::new();
            table.add(&config.grid, triangles, 0);
            table
        };
        let (workspace, monitor) = (Workspace::for_test(), Monitor::silent());
        let runs = triangles
            .chunks(17)
            .zip(0..)
            .map(|(part, serial)| spill::spill(&mut table(part), serial, &workspace));
        let runs = runs.collect::<Result<Vec<_>>>().unwrap();
        let merged = merge::on_disk::<Point>(runs, &config, &workspace, &monitor).unwrap();
        let whole = in_memory(vec![table(&triangles)], &config, &monitor).unwrap();
        assert!(merged.spills > 1 && whole.mesh.counts() == merged.mesh.counts());
        let all = |column: Column<Point>| {
            let mut scan = column.scan().unwrap();
            let mut bits = Vec::new();
            while let Some(batch) = scan.next_batch().unwrap() {
                bits.extend(batch.iter().map(|point| point.0.map(f32::to_bits)));
            }
            bits
        };
        assert_eq!(all(merged.mesh.vertices), all(whole.mesh.vertices));
        let all = |column: Option<Column<VertexQuadric>>| {
            let (column, mut quadrics) = (column.unwrap(), Vec::new());
            let mut scan = column.scan().unwrap();
            while let Some(batch) = scan.next_batch().unwrap() {
                quadrics.extend(batch.iter().map(|quadric| (quadric.a, quadric.b)));
            }
            quadrics
        };
        assert_eq!(all(merged.quadrics), all(whole.quadrics));
    }

    #[test]
    fn what_is_passed_on_are_the_planes_of_the_faces_in_each_cell() {
        let (triangles, config) = hills();
        let grid = config.grid;
        let mut table = CellTable::new();
        table.add(&grid, &triangles, 0);
        let monitor = Monitor { observer: &(), cancel: Cancel::default() };
        let outcome = in_memory(vec![table], &config, &monitor).unwrap();
        let Column::Memory(vertices) = outcome.mesh.vertices else { panic!("in memory") };
        let Some(Column::Memory(quadrics)) = outcome.quadrics else { panic!("passed on") };
        assert_eq!(vertices.len(), quadrics.len());
        let cell = |corner: &Point| CellId::new(grid.cell_of(grid.to_grid(corner.0)));
        let cells = triangles.iter().map(|triangle| triangle.0.map(|corner| cell(&corner)));
        let mut cells: Vec<CellId> =
            cells.filter(|[a, b, c]| a != b && b != c && c != a).flatten().collect();
        cells.sort_unstable();
        cells.dedup();
        assert_eq!(vertices.len(), cells.len());
        for ((vertex, quadric), own) in vertices.iter().zip(quadrics).zip(cells) {
            let from = DVec3::from_array(vertex.0.map(f64::from));
            let (mut a, mut b) = (glam::DMat3::ZERO, DVec3::ZERO);
            for triangle in &triangles {
                let corners = triangle.0.map(|c| DVec3::from_array(c.0.map(f64::from)));
                let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
                let (n, area) = (normal.normalize(), normal.length() / 2.0);
                let here = triangle.0.iter().filter(|corner| cell(corner) == own).count() as f64;
                a += glam::DMat3::from_cols(n * n.x, n * n.y, n * n.z) * (area * here);
                b += n * n.dot(from - corners[0]) * (area * here);
            }
            let expected = [a.x_axis.x, a.x_axis.y, a.x_axis.z, a.y_axis.y, a.y_axis.z, a.z_axis.z];
            for (found, expected) in quadric.a.iter().zip(expected) {
                assert!((f64::from(*found) - expected).abs() < 1e-4, "{found} {expected}");
            }
            for (found, expected) in quadric.b.iter().zip(b.to_array()) {
                assert!((f64::from(*found) - expected).abs() < 1e-4, "{found} {expected}");
            }
        }
    }
}
