//! The body of either encoding as a sequence of numbers.

use super::{
    super::{
        cursor::Cursor,
        fault::{FormatError, Result},
        source::Source,
        text::Text,
    },
    scalar::{ByteOrder, Scalar},
};
use crate::error::{Fault, Position};

/// Longest list that is read without a look at the size of the input; chosen by hand.
const LIST_SHORT: u64 = 1 << 12;

/// Numbers one after the other; what they mean is the caller's.
pub(super) trait Values {
    /// Remembers that a record begins here.
    fn begin_record(&mut self);

    /// Place of the record under way.
    fn place(&self) -> Position;

    /// One number.
    fn number(&mut self, scalar: Scalar) -> Result<f64>;

    /// The count of a list of `item`s; at most what the rest of the input can hold, if known.
    fn list_count(&mut self, scalar: Scalar, item: Scalar) -> Result<u64>;

    /// Appends `count` whole numbers; negative ones wrap to the top of the range.
    fn indices(&mut self, scalar: Scalar, count: usize, out: &mut Vec<u64>) -> Result<()>;

    /// Passes over numbers: `bytes` in a binary body, `words` in text.
    fn skip(&mut self, bytes: u64, words: u64) -> Result<()>;

    /// Consumes the rest: where it begins, and how many bytes mean something.
    fn drain(&mut self) -> Result<(Position, u64)>;
}

/// A binary body.
pub(super) struct Binary {
    pub(super) source: Source,
    pub(super) order: ByteOrder,
    pub(super) size_bytes: Option<u64>,
    /// The part of the input under way.
    pub(super) inside: &'static str,
    pub(super) record_at: u64,
}

/// An ASCII body.
pub(super) struct Ascii {
    pub(super) text: Text,
    pub(super) size_bytes: Option<u64>,
    /// The part of the input under way.
    pub(super) inside: &'static str,
}

impl Values for Binary {
    #[inline]
    fn begin_record(&mut self) {
        self.record_at = self.source.consumed();
    }

    fn place(&self) -> Position {
        Position::byte(self.record_at)
    }

    #[inline]
    fn number(&mut self, scalar: Scalar) -> Result<f64> {
        let size = scalar.size_bytes();
        let value = scalar.decode_f64(self.order, self.source.require(size, self.inside)?);
        self.source.consume(size);
        Ok(value)
    }

    #[inline]
    fn list_count(&mut self, scalar: Scalar, item: Scalar) -> Result<u64> {
        let size = scalar.size_bytes();
        let count = scalar.decode_i64(self.order, self.source.require(size, self.inside)?);
        self.source.consume(size);
        let left = self.size_bytes.map(|size| size.saturating_sub(self.source.consumed()));
        let limit = left.map_or(u64::MAX, |left| left / item.size_bytes() as u64);
        check_count(count, limit, || self.place())
    }

    #[inline]
    fn indices(&mut self, scalar: Scalar, count: usize, out: &mut Vec<u64>) -> Result<()> {
        let size = scalar.size_bytes();
        let mut left = count;
        while left > 0 {
            let block = self.source.require(size, self.inside)?;
            let here = left.min(block.len() / size);
            scalar.for_each_i64(self.order, &block[..here * size], |index| out.push(index as u64));
            self.source.consume(here * size);
            left -= here;
        }
        Ok(())
    }

    #[inline]
    fn skip(&mut self, bytes: u64, _words: u64) -> Result<()> {
        self.source.skip(bytes, self.inside)
    }

    fn drain(&mut self) -> Result<(Position, u64)> {
        let at = self.source.position();
        Ok((at, self.source.drain()?))
    }
}

impl Ascii {
    /// Parses one word with `parse`.
    #[inline]
    fn word<T>(
        &mut self,
        expected: &'static str,
        parse: impl FnOnce(&mut Cursor<'_>) -> Option<T>,
    ) -> Result<T> {
        let mut cursor = self.text.cursor()?;
        let Some(value) = parse(&mut cursor) else {
            return Err(self.text.word_fault(expected, self.inside));
        };
        let offset = cursor.offset();
        self.text.set_cursor(offset);
        Ok(value)
    }
}

#[expect(
    clippy::redundant_closure_for_method_calls,
    reason = "the bare methods are not general over the lifetime of the cursor"
)]
impl Values for Ascii {
    #[inline]
    fn begin_record(&mut self) {}

    /// The line is the one of the last number read.
    fn place(&self) -> Position {
        self.text.word_place()
    }

    #[inline]
    fn number(&mut self, scalar: Scalar) -> Result<f64> {
        match scalar {
            Scalar::F32 => self.word("a number", |cursor| cursor.f32()).map(f64::from),
            _ => self.word("a number", |cursor| cursor.f64()),
        }
    }

    #[inline]
    fn list_count(&mut self, _scalar: Scalar, _item: Scalar) -> Result<u64> {
        let count = self.word("the count of a list", |cursor| cursor.integer())?;
        let left = self.size_bytes.map(|size| size.saturating_sub(self.text.consumed()));
        // A blank and a digit each.
        check_count(count, left.map_or(u64::MAX, |left| left / 2), || self.place())
    }

    #[inline]
    fn indices(&mut self, _scalar: Scalar, count: usize, out: &mut Vec<u64>) -> Result<()> {
        let mut left = count;
        while left > 0 {
            // As many as are at hand, then one that brings more text or is a fault.
            let mut cursor = self.text.cursor()?;
            while left > 0 {
                let Some(index) = cursor.integer() else { break };
                out.push(index as u64);
                cursor.skip_white();
                left -= 1;
            }
            let offset = cursor.offset();
            self.text.set_cursor(offset);
            if left > 0 {
                out.push(self.word("an index", |cursor| cursor.integer())? as u64);
                left -= 1;
            }
        }
        Ok(())
    }

    #[inline]
    fn skip(&mut self, _bytes: u64, words: u64) -> Result<()> {
        for _ in 0..words {
            self.word("a value", |cursor| cursor.word().map(|_| ()))?;
        }
        Ok(())
    }

    fn drain(&mut self) -> Result<(Position, u64)> {
        // The place of the next word, past white space.
        self.text.cursor()?;
        let at = self.text.word_place();
        Ok((at, self.text.source().drain()?))
    }
}

/// Refuses counts that cannot be true. Short lists are left to be found truncated: that is what
/// is wrong with the last record of a torn file.
#[inline]
fn check_count(count: i64, limit: u64, at: impl FnOnce() -> Position) -> Result<u64> {
    match u64::try_from(count) {
        Ok(count) if count <= limit.max(LIST_SHORT) => Ok(count),
        Ok(count) => {
            let fault = Fault::CountImpossible { what: "the length of a list", count, limit };
            Err(FormatError::input(at(), fault))
        }
        Err(_) => {
            let found = count.to_string();
            let fault = Fault::Syntax { expected: "the count of a list", found };
            Err(FormatError::input(at(), fault))
        }
    }
}
