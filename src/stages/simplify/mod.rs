//! Fewer triangles: clustering.

pub mod cluster;
