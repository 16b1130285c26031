//! Pure mathematics on `glam`: no files, no state.

mod bounds;
mod grid;
mod polygon;
mod quadric;
mod sample;

pub use bounds::Bounds;
pub use grid::{CELLS_PER_AXIS_MAX, CellId, Grid};
pub use polygon::triangulate;
pub use quadric::{Placement, Quadric};
pub use sample::{Sample, Sampler};
