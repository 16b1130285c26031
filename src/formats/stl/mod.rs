//! STL: binary and ASCII in, binary out. A soup: every triangle brings its three positions.
//!
//! A binary file is an 80-byte header that says nothing, a `u32` count, and 50 bytes a triangle:
//! a normal (recomputed, so never read), three corners, and two attribute bytes.

mod ascii;
mod binary;
mod open;
#[cfg(test)]
mod tests;
mod writer;

pub(super) use open::{has_binary_size, is_no_text, open};
pub use writer::Writer;

/// Bytes before the first triangle of a binary file: the header and the count.
const HEADER_BYTES: usize = 84;
/// Where the count is.
const COUNT_BYTES: std::ops::Range<usize> = 80..84;
/// Bytes of a triangle.
const TRIANGLE_BYTES: usize = 50;
/// Where the first triangle is.
pub(super) const FIRST_TRIANGLE: std::ops::Range<usize> =
    HEADER_BYTES..HEADER_BYTES + TRIANGLE_BYTES;
/// The most triangles a binary file can count.
const TRIANGLES_MAX: u64 = u32::MAX as u64;
