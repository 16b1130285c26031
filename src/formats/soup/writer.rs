//! Writes our own soup: a copy from the batch into the output, and a trailer if need be.

use std::io::Write;

use zerocopy::IntoBytes as _;

use super::header::{Header, TRAILER_BYTES, Trailer};
use crate::formats::{
    Batch, Content, MeshWriter, Precision, WriteOptions, block::BlockWriter, fault::Result,
};

/// Writes a soup.
pub struct Writer<W> {
    output: BlockWriter<W>,
    header: Header,
    written: u64,
    /// Of the triangles so far; kept only for a trailer.
    checksum: crc32fast::Hasher,
}

impl<W: Write + Send> Writer<W> {
    /// Writes the header. Without a `count` the stream will end with a trailer. `bounds` are in
    /// model units, the origin included.
    ///
    /// # Errors
    /// [`crate::formats::FormatError::Io`].
    pub fn new(
        output: W,
        count: Option<u64>,
        bounds: Option<[[f64; 3]; 2]>,
        options: &WriteOptions,
    ) -> Result<Self> {
        let header = Header {
            colors: options.colors,
            double: options.precision == Precision::Double,
            count,
            origin: options.origin,
            bounds,
        };
        let mut output = BlockWriter::new(output);
        output.extend(&header.encode())?;
        Ok(Self { output, header, written: 0, checksum: crc32fast::Hasher::new() })
    }

    /// Copies whole pieces of the batch into the output.
    fn write_plain(&mut self, positions: &[[f32; 3]]) -> Result<()> {
        let bytes = positions.as_bytes();
        if self.header.count.is_none() {
            self.checksum.update(bytes);
        }
        self.output.extend(bytes)
    }

    /// Each position with its colour; white where the batch has none.
    fn write_colored(&mut self, positions: &[[f32; 3]], colors: &[[u8; 4]]) -> Result<()> {
        let corners_max = BlockWriter::<W>::BLOCK_BYTES / 16;
        for start in (0..positions.len()).step_by(corners_max) {
            let end = positions.len().min(start + corners_max);
            let bytes = self.output.reserve((end - start) * 16)?;
            let (corners, _) = bytes.as_chunks_mut::<16>();
            for (corner, position) in corners.iter_mut().zip(&positions[start..end]) {
                corner[..12].copy_from_slice(position.as_bytes());
                corner[12..].fill(255);
            }
            if !colors.is_empty() {
                for (corner, color) in corners.iter_mut().zip(&colors[start..end]) {
                    corner[12..].copy_from_slice(color);
                }
            }
            if self.header.count.is_none() {
                self.checksum.update(bytes);
            }
        }
        Ok(())
    }
}

impl<W: Write + Send> MeshWriter for Writer<W> {
    fn write_batch(&mut self, batch: &Batch) -> Result<()> {
        assert_eq!(batch.content, Content::Soup, "a soup holds triangles only");
        assert!(batch.positions.len().is_multiple_of(3), "a triangle has three corners");
        self.written += batch.count() as u64;
        if self.header.colors {
            self.write_colored(&batch.positions, &batch.colors)
        } else {
            self.write_plain(&batch.positions)
        }
    }

    fn finish(&mut self) -> Result<Option<Vec<u8>>> {
        let mut patch = None;
        match self.header.count {
            None => {
                let trailer = Trailer::new(self.written, self.checksum.clone().finalize());
                self.output.extend(trailer.as_bytes())?;
                let zeros = [0; 48];
                self.output.extend(&zeros[..self.header.triangle_bytes() - TRAILER_BYTES])?;
            }
            Some(count) if count != self.written => {
                let header = Header { count: Some(self.written), ..self.header.clone() };
                patch = Some(header.encode().to_vec());
            }
            Some(_) => {}
        }
        self.output.finish()?;
        Ok(patch)
    }
}
