//! Wavefront OBJ, the polygonal part: vertices with or without colours, and faces. Texture
//! coordinates, normals, materials, points, lines and free-form geometry are named as dropped.

mod colors;
mod faces;
mod reader;
mod statements;
#[cfg(test)]
mod tests;
mod writer;

pub(super) use reader::Reader;
pub use writer::Writer;
