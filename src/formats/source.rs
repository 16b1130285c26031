//! The bytes under every reader: one buffer, a count of what was consumed, and faults at the byte
//! where the input ends. It knows nothing of records or lines.

use std::io::{ErrorKind, Read};

use super::fault::{FormatError, Result};
use crate::error::{Fault, Position};

/// Bytes asked of the input in one read; measured: from 256 KiB on reading is as fast as mapping.
const BLOCK_BYTES: usize = 256 << 10;

/// An input read once, front to back.
///
/// It has a buffer of its own, so that a record which spans two reads of the input is one slice
/// here; an inner `BufReader` is passed by, as its `read` does for large requests.
pub struct Source {
    inner: Box<dyn Read + Send>,
    buffer: Vec<u8>,
    /// The unread bytes are `buffer[start..end]`; always `start <= end <= buffer.len()`.
    start: usize,
    end: usize,
    consumed: u64,
    ended: bool,
}

impl Source {
    /// A source at the first byte of `inner`.
    pub fn new(inner: impl Read + Send + 'static) -> Self {
        let inner = Box::new(inner);
        Self { inner, buffer: Vec::new(), start: 0, end: 0, consumed: 0, ended: false }
    }

    /// Bytes consumed so far.
    #[must_use]
    pub fn consumed(&self) -> u64 {
        self.consumed
    }

    /// The place of the next byte.
    #[must_use]
    pub fn position(&self) -> Position {
        Position::byte(self.consumed)
    }

    /// The bytes at hand, without reading.
    #[must_use]
    pub fn buffered(&self) -> &[u8] {
        &self.buffer[self.start..self.end]
    }

    /// Whether no byte will come after the [`Self::buffered`] ones. May be `false` although the
    /// input has ended, as long as nobody asked for more.
    #[must_use]
    pub fn is_all_buffered(&self) -> bool {
        self.ended
    }

    /// The next bytes, all that are at hand: at least `bytes_min`, or fewer when the input ends
    /// before. Nothing is consumed. The buffer grows to `bytes_min`: the caller bounds it.
    ///
    /// # Errors
    /// When the input cannot be read.
    pub fn block(&mut self, bytes_min: usize) -> Result<&[u8]> {
        if self.end - self.start < bytes_min && !self.ended {
            self.refill(bytes_min)?;
        }
        Ok(&self.buffer[self.start..self.end])
    }

    /// As [`Self::block`], but fewer than `bytes_min` bytes are a fault.
    ///
    /// # Errors
    /// [`Fault::Truncated`] at the byte where the input ends.
    pub fn require(&mut self, bytes_min: usize, inside: &'static str) -> Result<&[u8]> {
        if self.block(bytes_min)?.len() < bytes_min {
            return Err(self.truncated(inside));
        }
        Ok(&self.buffer[self.start..self.end])
    }

    /// Up to `bytes_max` of the next bytes, fewer only when the input ends before.
    ///
    /// # Errors
    /// When the input cannot be read.
    pub fn peek(&mut self, bytes_max: usize) -> Result<&[u8]> {
        let block = self.block(bytes_max)?;
        Ok(&block[..block.len().min(bytes_max)])
    }

    /// Moves past the first `bytes` of the block.
    pub fn consume(&mut self, bytes: usize) {
        assert!(bytes <= self.end - self.start, "only what was seen can be consumed");
        self.start += bytes;
        self.consumed += bytes as u64;
    }

    /// The first `length` of the last `bytes` consumed; valid until the next read.
    pub(super) fn passed(&self, bytes: usize, length: usize) -> &[u8] {
        &self.buffer[self.start - bytes..][..length]
    }

    /// Fills `out` and consumes as much.
    ///
    /// # Errors
    /// [`Fault::Truncated`] at the byte where the input ends.
    pub fn read_exact(&mut self, out: &mut [u8], inside: &'static str) -> Result<()> {
        let mut filled = 0;
        while filled < out.len() {
            let block = self.require(1, inside)?;
            let bytes = block.len().min(out.len() - filled);
            out[filled..filled + bytes].copy_from_slice(&block[..bytes]);
            self.consume(bytes);
            filled += bytes;
        }
        Ok(())
    }

    /// Consumes `bytes` without looking at them.
    ///
    /// # Errors
    /// [`Fault::Truncated`] at the byte where the input ends.
    pub fn skip(&mut self, bytes: u64, inside: &'static str) -> Result<()> {
        let mut left = bytes;
        while left > 0 {
            let here = (self.require(1, inside)?.len() as u64).min(left);
            self.consume(here as usize);
            left -= here;
        }
        Ok(())
    }

    /// Whether every byte was consumed.
    ///
    /// # Errors
    /// When the input cannot be read.
    pub fn is_at_end(&mut self) -> Result<bool> {
        Ok(self.block(1)?.is_empty())
    }

    /// Consumes what is left and counts it.
    ///
    /// # Errors
    /// When the input cannot be read.
    pub fn drain(&mut self) -> Result<u64> {
        let before = self.consumed;
        loop {
            match self.block(1)?.len() {
                0 => return Ok(self.consumed - before),
                bytes => self.consume(bytes),
            }
        }
    }

    /// The fault of an input that ends after the buffered bytes.
    #[must_use]
    pub fn truncated(&self, inside: &'static str) -> FormatError {
        let end = self.consumed + self.buffered().len() as u64;
        FormatError::input(Position::byte(end), Fault::Truncated { inside })
    }

    /// Moves the unread bytes to the front and reads until there are `bytes_min` of them.
    #[cold]
    fn refill(&mut self, bytes_min: usize) -> Result<()> {
        self.buffer.copy_within(self.start..self.end, 0);
        self.end -= self.start;
        self.start = 0;
        if self.buffer.len() < bytes_min.max(BLOCK_BYTES) {
            self.buffer.resize(bytes_min.next_power_of_two().max(BLOCK_BYTES), 0);
        }
        while self.end < bytes_min && !self.ended {
            match self.inner.read(&mut self.buffer[self.end..]) {
                Ok(0) => self.ended = true,
                Ok(bytes) => self.end += bytes,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => {
                    return Err(FormatError::read(error, self.consumed + self.end as u64));
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Gives `step` bytes a read, however many are asked for.
    pub(in crate::formats) struct Trickle {
        pub(in crate::formats) bytes: Vec<u8>,
        pub(in crate::formats) at: usize,
        pub(in crate::formats) step: usize,
    }

    impl Read for Trickle {
        fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
            let bytes = self.step.min(out.len()).min(self.bytes.len() - self.at);
            out[..bytes].copy_from_slice(&self.bytes[self.at..self.at + bytes]);
            self.at += bytes;
            Ok(bytes)
        }
    }

    /// A source over `bytes` that arrive `step` at a time.
    pub(in crate::formats) fn trickle(bytes: &[u8], step: usize) -> Source {
        Source::new(Trickle { bytes: bytes.to_vec(), at: 0, step })
    }

    #[test]
    fn a_record_that_spans_many_reads_is_one_slice() {
        let bytes: Vec<u8> = (0..=255).collect();
        for step in [1, 7, 1000] {
            let mut source = trickle(&bytes, step);
            source.skip(3, "the head").unwrap();
            assert_eq!(source.require(100, "the record").unwrap()[..100], bytes[3..103]);
            source.consume(100);
            let mut out = [0; 50];
            source.read_exact(&mut out, "the tail").unwrap();
            assert_eq!(out, bytes[103..153]);
            assert_eq!(source.drain().unwrap(), 103);
            assert_eq!(source.consumed(), 256);
        }
    }

    #[test]
    fn truncation_is_placed_where_the_input_ends() {
        for step in [1, 7, 1000] {
            let mut source = trickle(&[0; 20], step);
            source.consume(0);
            source.skip(4, "the head").unwrap();
            let error = source.require(17, "a record").unwrap_err();
            let FormatError::Input(fault) = error else { panic!("{error:?}") };
            assert_eq!(fault.at, Position::byte(20));
            assert_eq!(fault.fault, Fault::Truncated { inside: "a record" });
            assert_eq!(source.peek(100).unwrap().len(), 16);
        }
    }
}
