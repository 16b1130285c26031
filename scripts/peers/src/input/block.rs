//! Sequential reading in large blocks, with whole records always contiguous.

use std::io::{self, Read};

/// Bytes asked of the system at a time. Chosen by hand: enough to hide the calls, and
/// still in the second-level cache when it is decoded.
const BLOCK_BYTES: usize = 1 << 20;

/// A reader that shows what it has read before it is consumed.
pub struct BlockReader<R> {
    inner: R,
    buffer: Vec<u8>,
    /// Unconsumed bytes are `buffer[start..end]`.
    start: usize,
    end: usize,
}

impl<R: Read> BlockReader<R> {
    /// Wraps a reader that has no buffer of its own.
    pub fn new(inner: R) -> Self {
        Self { inner, buffer: vec![0; BLOCK_BYTES], start: 0, end: 0 }
    }

    /// Returns what is at hand, which is at least `wanted` bytes unless the input
    /// ends before.
    ///
    /// # Errors
    /// Passes on what the system says.
    pub fn peek(&mut self, wanted: usize) -> io::Result<&[u8]> {
        if self.end - self.start < wanted {
            self.buffer.copy_within(self.start..self.end, 0);
            self.end -= self.start;
            self.start = 0;
            if self.buffer.len() < wanted {
                self.buffer.resize(wanted, 0);
            }
            while self.end < wanted {
                match self.inner.read(&mut self.buffer[self.end..])? {
                    0 => break,
                    more => self.end += more,
                }
            }
        }
        Ok(&self.buffer[self.start..self.end])
    }

    /// Returns at least `wanted` bytes.
    ///
    /// # Errors
    /// An input that ends before is an error.
    pub fn need(&mut self, wanted: usize) -> io::Result<&[u8]> {
        self.peek(wanted)?;
        if self.end - self.start < wanted {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        Ok(&self.buffer[self.start..self.end])
    }

    /// Drops the first `count` bytes of those at hand.
    pub fn consume(&mut self, count: usize) {
        self.start += count;
        debug_assert!(self.start <= self.end);
    }

    /// Fills `target`, going around the buffer once that is empty.
    ///
    /// # Errors
    /// An input that ends before is an error.
    pub fn read_exact(&mut self, target: &mut [u8]) -> io::Result<()> {
        let at_hand = target.len().min(self.end - self.start);
        let (head, tail) = target.split_at_mut(at_hand);
        head.copy_from_slice(&self.buffer[self.start..self.start + at_hand]);
        self.start += at_hand;
        self.inner.read_exact(tail)
    }
}
