//! The record types of soups and indexed meshes, and where a stage gets its triangles from.

mod faces;
mod in_order;
mod input;
mod mesh;
mod minima;
mod pass;
mod quadric;
mod slabs;
mod source;
mod sweep;
mod table;
mod vertex;

pub use faces::{FaceScanner, FaceWriter, StoredFaces};
pub use in_order::for_each_in_order;
pub use input::{Input, InputPath, OpenInput};
pub use mesh::{Column, ColumnScan, IndexedMesh, Triangles};
pub use minima::{Minima, OrderMeter};
pub(crate) use pass::triangulate;
pub use pass::{Pass, Scratch, Taken};
pub use quadric::VertexQuadric;
pub use slabs::{Cutter, Slab};
pub use source::{FaceList, FaceScan, LiveReader, Part, Source};
pub use sweep::{SweepAxis, SweepKey, SweepPlace, smallest_corner, tie_break};
pub use table::{VertexTable, page_changes};
pub use vertex::{ATTRIBUTES_MAX, ColoredPoint, Point, Triangle, Vertex};
