//! Fewer triangles: clustering, decimation by edge collapses to a count or within an error, and the one
//! after the other.

pub mod bounded;
pub mod cluster;
pub mod decimate;
pub mod hybrid;
pub mod progressive;
pub mod stream;
