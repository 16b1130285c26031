//! What a mesh is like, told and not changed.

pub mod deviation;
pub mod info;
pub mod render;
pub mod topology;
