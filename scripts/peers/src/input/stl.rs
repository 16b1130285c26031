//! Binary STL. Text STL is not read: nothing large comes in it.

use super::block::BlockReader;
use crate::Result;
use std::fs::File;

/// Bytes before the first record: 80 of comment, then the triangle count.
const HEADER_BYTES: usize = 84;
/// Bytes of a record: a normal, three corners, two bytes of attributes.
const RECORD_BYTES: usize = 50;

/// Reads the corners of all triangles, three in a row for each.
///
/// # Errors
/// A file shorter than its count is an error; a longer one is not.
pub fn read_corners(file: File) -> Result<Vec<[f32; 3]>> {
    let file_bytes = file.metadata()?.len();
    let mut reader = BlockReader::new(file);
    let header = reader.need(HEADER_BYTES)?;
    let count = u32::from_le_bytes([header[80], header[81], header[82], header[83]]) as usize;
    reader.consume(HEADER_BYTES);
    if file_bytes < (HEADER_BYTES + RECORD_BYTES * count) as u64 {
        let fault = "cut short, or not binary STL";
        return Err(format!("{count} triangles do not fit {file_bytes} bytes: {fault}").into());
    }

    let mut corners = Vec::with_capacity(3 * count);
    let mut left = count;
    while left > 0 {
        let block = reader.need(RECORD_BYTES)?;
        let records = (block.len() / RECORD_BYTES).min(left);
        for record in block[..records * RECORD_BYTES].chunks_exact(RECORD_BYTES) {
            let triangle: [[f32; 3]; 3] = bytemuck::pod_read_unaligned(&record[12..48]);
            corners.extend_from_slice(&triangle);
        }
        reader.consume(records * RECORD_BYTES);
        left -= records;
    }
    Ok(corners)
}
