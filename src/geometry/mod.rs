//! Pure mathematics on `glam`: no files, no state.

mod bounds;
mod box_tree;
mod closest_point;
mod grid;
mod lateness;
mod morton;
mod ordered;
mod point_tree;
mod polygon;
mod quadric;
mod sample;
mod shape;
mod triangle_tree;

pub use bounds::{Bounds, reach_sq};
pub use box_tree::FANOUT;
pub use closest_point::distance_sq_to_triangle;
pub use grid::{CELLS_PER_AXIS_MAX, CellId, Grid, Located};
pub use lateness::{Lateness, MAXIMA_DEFAULT, MAXIMA_PER_PART};
pub use morton::{WIDE_BITS, spread, spread_wide};
pub use ordered::ordered_f32;
pub use point_tree::{Found, PointTree};
pub use polygon::triangulate;
pub use quadric::{Placement, Quadric};
pub use sample::{Sample, Sampler};
pub use shape::{has_no_area, is_worse_than};
pub use triangle_tree::TriangleTree;
