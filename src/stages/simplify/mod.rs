//! Fewer triangles: clustering, and decimation by edge collapses.

pub mod cluster;
pub mod decimate;
pub mod stream;
