//! meshmill simplifies, sorts and converts triangle meshes far larger than memory.
//!
//! The modules below are listed in the order data flows; docs/ARCHITECTURE.md is the tour.

// What everything speaks: failure and progress.
pub mod error;
pub mod progress;

// Pure mathematics.
pub mod geometry;

// Bytes: the users' files and our own.
pub mod formats;
pub mod storage;

// What others look at our results with.
pub mod viewer;

// Records with a meaning, and the three out-of-core primitives over them.
pub mod external;
pub mod soup;

// Meshes in core, made to be decimated.
pub mod mesh;

// The steps of a job, each with a `Config`, an `Outcome` and one verb.
pub mod stages;

// Stages in their order, from a job to a finished output.
pub mod pipeline;

pub use error::{Error, Result};

const _: () = assert!(usize::BITS == 64 && cfg!(target_endian = "little"), "64-bit little-endian");
