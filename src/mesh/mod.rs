//! Meshes in core, made to be decimated: no files, progress only of what takes long. Threads have a
//! mesh each, but where there is one for all of them: in `progressive`, and at the end of a stream.
//!
//! A [`Mesh`] tolerates whatever a soup welds to. What cannot be decimated safely, such as edges
//! with three faces, is left alone `[CKS98 §5]`; the algorithms need not know.
//! What a collapse costs is the matter of a [`Metric`].

mod bounded;
mod by_quadric;
mod by_volume;
mod choice;
mod classify;
mod collapse;
mod curve;
mod finish;
mod indexed;
mod metric;
mod patch;
mod patch_words;
mod pieces;
mod place;
mod position_index;
pub mod progressive;
mod quadric;
mod release;
mod ring;
mod split;
mod surface;
mod sweep;
mod volume;
mod volume_boundary;
#[cfg(test)]
mod volume_tests;
mod weld;
mod window;

pub use bounded::{
    Bound, ByDeviation, Fairing, Limits, Settled, Shape, Sides, Smooth, Update, decimate_bounded,
    decimate_to_count,
};
pub use by_quadric::ByQuadric;
pub use by_volume::ByVolume;
pub use choice::{Choice, Decimated};
pub use finish::{Finished, approach, finish, finish_metered};
pub use metric::{Memory, Metric};
pub use patch::{Patch, unit_of};
pub use patch_words::{PatchFigures, as_words, take_words};
pub use position_index::PositionIndex;
pub use quadric::Quadric;
pub use release::{Released, release, release_all};
pub use surface::{Color, Mesh, State, Threads, face_bytes};
pub use sweep::{Limit, sweep_blocks, sweep_blocks_while};
pub use weld::{Welded, weld};
pub use window::{Figures, Window};
