//! Pure mathematics on `glam`: no files, no state.

mod bounds;
mod polygon;

pub use bounds::Bounds;
pub use polygon::triangulate;
