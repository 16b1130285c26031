//! The record types of soups and indexed meshes, and where a stage gets its triangles from.

mod faces;
mod input;
mod mesh;
mod pass;
mod source;
mod table;
mod vertex;

pub use faces::{FaceScanner, FaceWriter, StoredFaces};
pub use input::{Input, InputPath, OpenInput};
pub use mesh::{Column, ColumnScan, IndexedMesh, Triangles};
pub(crate) use pass::triangulate;
pub use pass::{Pass, Scratch, Taken};
pub use source::{FaceList, FaceScan, LiveReader, Part, Source};
pub use table::{VertexTable, page_changes};
pub use vertex::{ATTRIBUTES_MAX, ColoredPoint, Point, Triangle, Vertex};
