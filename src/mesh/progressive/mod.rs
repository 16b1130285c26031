//! Progressive meshes `[Hop96]`: collapses recorded while a mesh is decimated, turned round into
//! vertex splits, and splits applied (docs/FORMATS.md).

mod growing;
mod half_edges;
mod record;
mod round;
#[cfg(test)]
mod tests;
mod turn;
mod walk;

pub use growing::Growing;
pub use half_edges::{FAN_FACES_MAX, HalfEdges};
pub use record::{RECORD_FACE_BYTES, Recording, record};
pub use turn::{Turned, turn_round};
