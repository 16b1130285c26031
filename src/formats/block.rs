//! Output gathered into blocks of a size that disks and pipes like, with room handed out for a
//! loop to fill in place.

use std::io::Write;

use super::{FormatError, fault::Result};

/// Gathers bytes in front of a [`Write`]. Nothing is written on drop: [`Self::finish`] must be
/// called.
pub(super) struct BlockWriter<W> {
    output: W,
    block: Box<[u8]>,
    /// Bytes of `block` that wait; always ≤ its length.
    filled: usize,
}

impl<W> BlockWriter<W> {
    /// Bytes a write has at most. 256 KiB–1 MiB is the fastest piece size here, and twice this
    /// stays in the second-level cache.
    pub(super) const BLOCK_BYTES: usize = 1 << 18;
}

impl<W: Write> BlockWriter<W> {
    pub(super) fn new(output: W) -> Self {
        Self { output, block: vec![0; Self::BLOCK_BYTES].into_boxed_slice(), filled: 0 }
    }

    /// The next `length` bytes of the output, to be filled in by the caller; what they hold
    /// before that means nothing. At most [`Self::BLOCK_BYTES`].
    pub(super) fn reserve(&mut self, length: usize) -> Result<&mut [u8]> {
        if self.block.len() - self.filled < length {
            self.write_block()?;
        }
        let start = self.filled;
        self.filled += length;
        Ok(&mut self.block[start..self.filled])
    }

    /// Takes back the last `length` bytes that [`Self::reserve`] handed out and nobody needed.
    pub(super) fn give_back(&mut self, length: usize) {
        self.filled -= length;
    }

    /// Appends `bytes`, any number.
    pub(super) fn extend(&mut self, bytes: &[u8]) -> Result<()> {
        for piece in bytes.chunks(Self::BLOCK_BYTES) {
            self.reserve(piece.len())?.copy_from_slice(piece);
        }
        Ok(())
    }

    /// Writes what waits and flushes.
    pub(super) fn finish(&mut self) -> Result<()> {
        self.write_block()?;
        self.output.flush().map_err(FormatError::write)
    }

    fn write_block(&mut self) -> Result<()> {
        let filled = std::mem::take(&mut self.filled);
        self.output.write_all(&self.block[..filled]).map_err(FormatError::write)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_come_out_in_order_whatever_their_pieces() {
        let expected: Vec<u8> = (0..600_000_u32).map(|index| (index % 251) as u8).collect();
        let mut written = Vec::new();
        let mut output = BlockWriter::new(&mut written);
        output.extend(&expected[..10]).unwrap();
        output.reserve(30).unwrap()[..20].copy_from_slice(&expected[10..30]);
        output.give_back(10);
        output.extend(&expected[30..]).unwrap();
        output.finish().unwrap();
        assert_eq!(written, expected);
    }
}
