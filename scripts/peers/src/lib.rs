//! What the peers and the judge share. These are measuring tools: everything is
//! held in memory, and nothing here is part of the product or uses its code, so
//! that a mistake in one cannot hide the same mistake in the other.

/// A result whose error is a sentence with a place in it, for a person to read.
pub type Result<T> = std::result::Result<T, Box<dyn std::error::Error + Send + Sync>>;

// What comes in and goes out.
pub mod input;
pub mod mesh;
pub mod output;

// What a mesh is like: how it hangs together, and where it lies.
pub mod bvh;
pub mod primitive;
pub mod topology;

// How far two meshes are apart, by random samples.
pub mod deviation;
pub mod random;
