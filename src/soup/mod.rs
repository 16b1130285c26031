//! The record types of soups and indexed meshes, and where a stage gets its triangles from.

mod vertex;

pub use vertex::{ColoredPoint, Point, Triangle, Vertex};
