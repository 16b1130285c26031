//! Fewer triangles: clustering, decimation by edge collapses, and the one after the other.

pub mod cluster;
pub mod decimate;
pub mod hybrid;
pub mod stream;
