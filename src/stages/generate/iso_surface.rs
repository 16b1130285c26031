//! The zero level of a field, delivered as soup or as an indexed mesh, or only counted.
//!
//! Nothing is kept but the cells of two slabs that the surface passes through: memory grows with
//! the square root of the number of triangles.

use rayon::iter::{IntoParallelIterator, ParallelIterator};

use super::{
    Layout, Outcome,
    delivery::{Delivery, Sink},
    field::{BRICK, Field},
    numbering::{CellsFound, NumberedSlab, connect_slab},
    sweep::{Rows, scan_slab, sweep, tile_cells},
    tetrahedra::{CASES, OWN_EDGES, own_crossed},
    tile::{Cell, Scratch, Visitor, scan},
};
use crate::{
    Result,
    formats::{Content, Counts},
    geometry::Bounds,
    progress::{Meter, Monitor, StageId},
};

/// Counts the vertices and triangles of `field` in `tiles`, each given as (y, z).
pub(super) fn count_tiles(
    field: &Field,
    tiles: &[(usize, usize)],
    meter: &Meter<'_>,
) -> Result<Counts> {
    (0..tiles.len())
        .into_par_iter()
        .map_init(Scratch::default, |scratch, tile| {
            let mut counter = Counter::default();
            scan(field, tiles[tile], scratch, &mut counter);
            meter.add(tile_cells(field))?;
            Ok(counter.0)
        })
        .try_reduce(Counts::default, |a, b| {
            Ok(Counts { vertices: a.vertices + b.vertices, triangles: a.triangles + b.triangles })
        })
}

/// Counts all vertices and triangles of `field`.
pub(super) fn count(field: &Field, monitor: &Monitor<'_>) -> Result<Counts> {
    let meter = monitor.meter(StageId::Generate, Some(grid_cells(field)));
    let mut counts = Counts::default();
    for tile_z in 0..slabs(field) {
        let tiles: Vec<_> = (0..field.cells() / BRICK[1]).map(|tile_y| (tile_y, tile_z)).collect();
        let slab = count_tiles(field, &tiles, &meter)?;
        counts.vertices += slab.vertices;
        counts.triangles += slab.triangles;
    }
    meter.finish();
    Ok(counts)
}

/// Delivers the surface of `field`.
pub(super) fn generate(
    field: &Field,
    layout: Layout,
    monitor: &Monitor<'_>,
    sink: &mut Sink<'_>,
) -> Result<Outcome> {
    match layout {
        Layout::Soup => {
            let (triangles, bounds) = deliver_points::<Soup>(field, Content::Soup, monitor, sink)?;
            Ok(Outcome { counts: Counts { vertices: 0, triangles }, bounds })
        }
        Layout::Indexed => {
            let (vertices, bounds) =
                deliver_points::<Vertices>(field, Content::Vertices, monitor, sink)?;
            let triangles = deliver_faces(field, monitor, sink)?;
            Ok(Outcome { counts: Counts { vertices, triangles }, bounds })
        }
    }
}

fn grid_cells(field: &Field) -> u64 {
    (field.cells() as u64).pow(3)
}

fn slabs(field: &Field) -> usize {
    field.cells() / BRICK[2]
}

/// One sweep that delivers what visitors of type `V` collect.
fn deliver_points<V: Visitor + Into<Rows<[f32; 3]>> + Default + Send>(
    field: &Field,
    content: Content,
    monitor: &Monitor<'_>,
    sink: &mut Sink<'_>,
) -> Result<(u64, Bounds)> {
    let meter = monitor.meter(StageId::Generate, Some(grid_cells(field)));
    let mut delivery = Delivery::new(content, sink);
    let mut bounds = Bounds::default();
    let make = |slab| {
        let tiles = scan_slab::<V>(field, slab, &meter)?;
        Ok(tiles.into_par_iter().map(|tile| with_bounds(tile.into())).collect::<Vec<_>>())
    };
    sweep(slabs(field), make, |tiles| {
        bounds = tiles.iter().fold(bounds, |bounds, (_, tile)| bounds.union(tile));
        for layer in 0..BRICK[2] {
            for (points, _) in &tiles {
                delivery.positions(points.layer(layer))?;
            }
        }
        Ok(())
    })?;
    let delivered = delivery.finish()?;
    meter.finish();
    Ok((delivered, bounds))
}

fn with_bounds(points: Rows<[f32; 3]>) -> (Rows<[f32; 3]>, Bounds) {
    let mut bounds = Bounds::default();
    for point in &points.items {
        bounds.add(*point);
    }
    (points, bounds)
}

/// One sweep that delivers the faces. It runs a slab behind, since a cell's vertices belong to
/// itself and to its neighbours beyond: also those in the next slab.
fn deliver_faces(field: &Field, monitor: &Monitor<'_>, sink: &mut Sink<'_>) -> Result<u64> {
    let meter = monitor.meter(StageId::Generate, Some(grid_cells(field)));
    let mut delivery = Delivery::new(Content::Faces, sink);
    let mut waiting: Option<NumberedSlab> = None;
    let mut vertices = 0;
    let mut deliver_slab = |slab: &NumberedSlab, above: &NumberedSlab| -> Result<()> {
        let tiles = connect_slab(slab, above);
        for layer in 0..BRICK[2] {
            for corners in &tiles {
                delivery.corners(corners.layer(layer))?;
            }
        }
        Ok(())
    };
    sweep(
        slabs(field),
        |slab| scan_slab::<CellsFound>(field, slab, &meter),
        |tiles| {
            let slab = NumberedSlab::new(tiles, &mut vertices);
            if let Some(below) = waiting.take() {
                deliver_slab(&below, &slab)?;
            }
            waiting = Some(slab);
            Ok(())
        },
    )?;
    // The last slab ends in empty cells: nothing above it is asked for.
    if let Some(last) = waiting {
        deliver_slab(&last, &NumberedSlab::empty(field.cells()))?;
    }
    let delivered = delivery.finish()?;
    meter.finish();
    Ok(delivered)
}

#[derive(Default)]
struct Counter(Counts);

impl Visitor for Counter {
    fn cell(&mut self, cell: &Cell<'_>) {
        self.0.vertices += u64::from(own_crossed(cell.inside).count_ones());
        self.0.triangles += CASES.corners(cell.inside).len() as u64 / 3;
    }

    fn end_row(&mut self) {}
}

/// Three positions for each triangle.
#[derive(Default)]
struct Soup(Rows<[f32; 3]>);

impl Visitor for Soup {
    fn cell(&mut self, cell: &Cell<'_>) {
        let mut points = [[0.0; 3]; 32];
        let mut crossed = CASES.crossed(cell.inside);
        while crossed != 0 {
            let edge = crossed.trailing_zeros() as usize;
            crossed &= crossed - 1;
            points[edge] = cell.crossing(edge);
        }
        let corners = CASES.corners(cell.inside);
        self.0.items.extend(corners.iter().map(|&edge| points[usize::from(edge % 32)]));
    }

    fn end_row(&mut self) {
        self.0.end_row();
    }
}

impl From<Soup> for Rows<[f32; 3]> {
    fn from(soup: Soup) -> Self {
        soup.0
    }
}

/// The position of each vertex a cell owns.
#[derive(Default)]
struct Vertices(Rows<[f32; 3]>);

impl Visitor for Vertices {
    fn cell(&mut self, cell: &Cell<'_>) {
        let crossed = own_crossed(cell.inside);
        for edge in (0..OWN_EDGES).filter(|edge| crossed >> edge & 1 == 1) {
            self.0.items.push(cell.crossing(edge));
        }
    }

    fn end_row(&mut self) {
        self.0.end_row();
    }
}

impl From<Vertices> for Rows<[f32; 3]> {
    fn from(vertices: Vertices) -> Self {
        vertices.0
    }
}
