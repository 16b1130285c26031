//! A picture of a mesh of any size, in the memory of the picture.
//!
//! Triangles are drawn as they stream by; none is kept. Light comes at the end, once for each
//! sample of the picture.

mod camera;
mod drawing;
mod extent;
mod font;
mod frame;
mod heat;
mod layout;
mod light;
mod occlusion;
mod picture;
mod raster;
mod scene;
mod shade;
mod sheet;
#[cfg(test)]
mod tests;

pub use camera::{Area, Projection, Up, View};
pub use drawing::{Drawing, Paint, Visible};
pub use extent::Extents;
pub use heat::{HeatMap, number};
pub use picture::{Color, Picture, Text};
pub use scene::{
    Config, Edges, Outcome, SAMPLES_MAX, SIDE_SAMPLES_MAX, Scene, Size, draw, memory_bytes, render,
};
pub use shade::BACKGROUND;
pub use sheet::{Panel, sheet_bytes, side_by_side};
