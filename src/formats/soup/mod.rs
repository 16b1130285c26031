//! Our own triangle soup, drawn in docs/FORMATS.md: a header, plain triangles, and a trailer when
//! the header could not say how many.

mod header;
mod reader;
#[cfg(test)]
mod tests;
mod writer;

pub(super) use reader::Reader;
pub use writer::Writer;

/// First bytes of a soup.
pub(super) use header::MAGIC;
