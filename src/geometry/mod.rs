//! Pure mathematics on `glam`: no files, no state.

mod bounds;

pub use bounds::Bounds;
