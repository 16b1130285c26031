//! Tells binary from ASCII STL, which the first word does not: many binary files begin with
//! "solid" as well.

use super::{HEADER_BYTES, ascii, binary};
use crate::formats::{MeshReader, ReadOptions, Source, fault::Result, text::skip_byte_order_mark};

/// Bytes that are looked at: the header, and some facets of an ASCII file.
const HEAD_BYTES: usize = 4096;

/// Opens STL of either kind.
///
/// # Errors
/// A header or first facets that are not STL.
pub(in crate::formats) fn open(
    mut source: Source,
    options: &ReadOptions,
) -> Result<Box<dyn MeshReader>> {
    if is_utf16(source.peek(HEAD_BYTES)?) {
        skip_byte_order_mark(&mut source)?;
    }
    if is_binary(source.peek(HEAD_BYTES)?, options.size_bytes) {
        Ok(Box::new(binary::Reader::open(source, options)?))
    } else {
        Ok(Box::new(ascii::Reader::open(source, options)?))
    }
}

/// Whether `head` is "solid" in UTF-16, for whose sake the binary reader would find a strange count.
fn is_utf16(head: &[u8]) -> bool {
    let head = &head[..head.len().min(12)];
    let letters: Vec<u8> = head.iter().copied().filter(u8::is_ascii_alphabetic).collect();
    letters.eq_ignore_ascii_case(b"solid")
        && head[..4].iter().any(|&byte| byte == 0 || byte == 0xff)
}

/// Whether an STL file that begins with `head` is binary. Its size decides when it is what the
/// count at its place says; else characters that no text has.
fn is_binary(head: &[u8], size_bytes: Option<u64>) -> bool {
    has_binary_size(head, size_bytes) || head.iter().any(|&byte| is_no_text(byte))
}

/// Whether the file has exactly the size that its count, read as binary STL, asks for.
pub(in crate::formats) fn has_binary_size(head: &[u8], size_bytes: Option<u64>) -> bool {
    let count = head.get(super::COUNT_BYTES).and_then(|bytes| bytes.try_into().ok());
    let count = count.map(|bytes| u64::from(u32::from_le_bytes(bytes)));
    head.len() >= HEADER_BYTES
        && count.is_some_and(|count| size_bytes == Some(binary::LAYOUT.file_bytes(count)))
}

/// Control characters other than white space and the end mark of DOS. Bytes beyond ASCII may be
/// letters of a name.
pub(in crate::formats) fn is_no_text(byte: u8) -> bool {
    byte < b' ' && !matches!(byte, b'\t'..=b'\r' | 0x1a) || byte == 0x7f
}
