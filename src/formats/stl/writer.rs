//! Writes binary STL. Normals are computed; colours have no place in STL.

use std::io::Write;

use zerocopy::IntoBytes as _;

use super::{COUNT_BYTES, HEADER_BYTES, TRIANGLE_BYTES, TRIANGLES_MAX};
use crate::formats::{
    Batch, Content, FormatError, MeshWriter, WriteOptions, block::BlockWriter, fault::Result,
};

/// Must not begin with "solid": that is how readers know ASCII files.
const TITLE: &[u8] = b"binary STL written by meshmill";

/// Writes a soup as binary STL.
pub struct Writer<W> {
    output: BlockWriter<W>,
    origin: [f64; 3],
    /// Count in the header already written.
    announced: u64,
    written: u64,
}

impl<W: Write + Send> Writer<W> {
    /// Writes the header. Without a `count` it says 0, and [`MeshWriter::finish`] returns the one
    /// to be written over it.
    ///
    /// # Errors
    /// [`FormatError::Limit`] when `count` is more than STL can hold, before anything is written;
    /// [`FormatError::Io`].
    pub fn new(output: W, count: Option<u64>, options: &WriteOptions) -> Result<Self> {
        let announced = count.unwrap_or(0);
        check_limit(announced)?;
        let mut output = BlockWriter::new(output);
        output.extend(&header(announced))?;
        Ok(Self { output, origin: options.origin, announced, written: 0 })
    }
}

impl<W: Write + Send> MeshWriter for Writer<W> {
    fn write_batch(&mut self, batch: &Batch) -> Result<()> {
        assert_eq!(batch.content, Content::Soup, "STL holds triangles only");
        let (corners, rest) = batch.positions.as_chunks::<3>();
        assert!(rest.is_empty(), "a triangle has three corners");
        self.written += corners.len() as u64;
        let origin = self.origin;
        for piece in corners.chunks(BlockWriter::<W>::BLOCK_BYTES / TRIANGLE_BYTES) {
            let bytes = self.output.reserve(piece.len() * TRIANGLE_BYTES)?;
            if origin == [0.0; 3] {
                encode(piece, bytes, |position| position);
            } else {
                encode(piece, bytes, |position| {
                    std::array::from_fn(|axis| (f64::from(position[axis]) + origin[axis]) as f32)
                });
            }
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<Option<Vec<u8>>> {
        check_limit(self.written)?;
        self.output.finish()?;
        Ok((self.written != self.announced).then(|| header(self.written).to_vec()))
    }
}

fn check_limit(count: u64) -> Result<()> {
    if count > TRIANGLES_MAX {
        let (format, what, limit) = ("STL", "triangles", TRIANGLES_MAX);
        return Err(FormatError::Limit { format, what, limit, count });
    }
    Ok(())
}

fn header(count: u64) -> [u8; HEADER_BYTES] {
    let mut header = [0; HEADER_BYTES];
    header[..TITLE.len()].copy_from_slice(TITLE);
    header[COUNT_BYTES].copy_from_slice(&(count as u32).to_le_bytes());
    header
}

/// Fills `bytes`, 50 for each triangle; `absolute` adds the origin.
fn encode(triangles: &[[[f32; 3]; 3]], bytes: &mut [u8], absolute: impl Fn([f32; 3]) -> [f32; 3]) {
    let (records, _) = bytes.as_chunks_mut::<TRIANGLE_BYTES>();
    for (corners, record) in triangles.iter().zip(records) {
        let [a, b, c] = corners.map(&absolute);
        let numbers = [normal(corners), a, b, c];
        record[..48].copy_from_slice(numbers.as_bytes());
        record[48..].fill(0);
    }
}

/// Unit normal, zero for a triangle without area. In `f64`: the product of two edges leaves the
/// range of `f32` long before the edges do.
fn normal([a, b, c]: &[[f32; 3]; 3]) -> [f32; 3] {
    let edge = |to: &[f32; 3]| -> [f64; 3] {
        std::array::from_fn(|axis| f64::from(to[axis]) - f64::from(a[axis]))
    };
    let (u, v) = (edge(b), edge(c));
    let n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    let length_sq = n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
    let scale = if length_sq > 0.0 { length_sq.sqrt().recip() } else { 0.0 };
    n.map(|component| (component * scale) as f32)
}
