//! PLY, ASCII and binary of either byte order, with any layout its header can describe.
//!
//! `header` reads what the file says of itself, `layout` decides what each element means to us,
//! `records` reads any element value by value from either encoding (`values`), and `blocks` has
//! the short cuts for binary elements of fixed layout. Attributes other than position and vertex
//! colour are skipped and named.

mod blocks;
mod header;
mod intake;
mod layout;
mod reader;
mod records;
mod scalar;
#[cfg(test)]
mod tests;
mod values;
mod write;

pub use reader::Reader;
pub use write::Writer;
