//! Lines and words over a [`Source`], for the text formats: whole lines or whole words in one
//! slice however the input arrives, and the line number of any place in it.

use super::{
    cursor::{Cursor, is_white, shorten},
    fault::{FormatError, Result},
    source::Source,
};
use crate::error::{Fault, Position};

/// Longest line that is read at once. Chosen by hand: a polygon of a million corners fits, and a
/// file without line ends does not fill the memory.
const LINE_BYTES_MAX: usize = 16 << 20;

/// Longest word. Chosen by hand: no number needs a hundredth of it.
const WORD_BYTES_MAX: usize = 64 << 10;

/// What [`Text::skip_line`] passed over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Skipped {
    /// Blanks at most.
    Nothing,
    /// One word or more.
    Words,
}

/// A text read once, front to back. Lines end in LF, CRLF or CR.
pub struct Text {
    source: Source,
    /// 1-based line of the next unread byte.
    line: u64,
    /// The last consumed byte was a CR: an LF that follows belongs to the same line end.
    after_cr: bool,
    /// The next word begins at `word_at` of the block or later, and words are whole up to
    /// `words_end`; only the word-wise methods move them.
    word_at: usize,
    words_end: usize,
}

impl Text {
    /// The text that begins with the next byte of `source`, in line `line`.
    #[must_use]
    pub fn new(source: Source, line: u64) -> Self {
        Self { source, line, after_cr: false, word_at: 0, words_end: 0 }
    }

    /// The source at the first byte that was not consumed.
    pub fn source(&mut self) -> &mut Source {
        self.settle();
        &mut self.source
    }

    /// Bytes consumed so far.
    #[must_use]
    pub fn consumed(&self) -> u64 {
        self.source.consumed() + self.word_at as u64
    }

    /// As many whole lines as are at hand, at least one; the last byte is a line end (a CRLF may
    /// be cut in two: its LF then begins the next slice and is an empty line there that does not
    /// count) or the end of the input. Empty when all is consumed.
    ///
    /// # Errors
    /// When the input cannot be read, or a line is longer than the limit.
    pub fn whole_lines(&mut self) -> Result<&[u8]> {
        self.settle();
        let mut bytes_min = 1;
        loop {
            let block = self.source.block(bytes_min)?;
            let length = block.len();
            if let Some(last) = memchr::memrchr2(b'\n', b'\r', block) {
                return Ok(&self.source.buffered()[..=last]);
            }
            if length < bytes_min {
                return Ok(self.source.buffered());
            }
            if length > LINE_BYTES_MAX {
                let found = shorten(self.source.buffered());
                let fault = Fault::Syntax { expected: "a line of at most 16 MiB", found };
                return Err(FormatError::input(self.place(0), fault));
            }
            bytes_min = more_than(length);
        }
    }

    /// Moves past the first `bytes` of the slice from [`Self::whole_lines`].
    pub fn consume(&mut self, bytes: usize) {
        let passed = &self.source.buffered()[..bytes];
        self.line += line_ends(passed, self.after_cr);
        if let Some(&last) = passed.last() {
            self.after_cr = last == b'\r';
        }
        self.source.consume(bytes);
    }

    /// The next line without its end, and its place; `None` when all is consumed.
    ///
    /// # Errors
    /// As [`Self::whole_lines`].
    pub fn next_line(&mut self) -> Result<Option<(&[u8], Position)>> {
        if self.after_cr && self.source.peek(1)? == b"\n" {
            self.consume(1);
        }
        let lines = self.whole_lines()?;
        if lines.is_empty() {
            return Ok(None);
        }
        let length = memchr::memchr2(b'\n', b'\r', lines).unwrap_or(lines.len());
        let with_end = (length + 1).min(lines.len());
        let at = self.place(0);
        // Consumed bytes stay where they are until the next read.
        self.consume(with_end);
        Ok(Some((self.source.passed(with_end, length), at)))
    }

    /// The place of the byte `offset` bytes into the slice at hand.
    #[must_use]
    pub fn place(&self, offset: usize) -> Position {
        let before = &self.source.buffered()[..offset];
        Position {
            line: Some(self.line + line_ends(before, self.after_cr)),
            record: None,
            byte: Some(self.source.consumed() + offset as u64),
        }
    }

    /// The place of the next word, or of the end of the input.
    #[must_use]
    pub fn word_place(&self) -> Position {
        self.place(self.word_at)
    }

    /// A cursor at the next word, wherever line ends are, and only whole words behind it; at its
    /// end when there are no more. Hand it back with [`Self::set_cursor`].
    ///
    /// # Errors
    /// When the input cannot be read, or a word is longer than the limit.
    #[expect(
        clippy::inline_always,
        reason = "a cursor returned through memory was 40 % of the time of reading ASCII PLY: it is \
                  stored in halves and loaded whole, which the processor must wait for"
    )]
    #[inline(always)]
    pub fn cursor(&mut self) -> Result<Cursor<'_>> {
        self.skip_white();
        while self.word_at == self.words_end && self.gather_words()? {
            self.skip_white();
        }
        Ok(Cursor::new(&self.source.buffered()[..self.words_end], self.word_at))
    }

    #[inline]
    fn skip_white(&mut self) {
        let words = &self.source.buffered()[self.word_at..self.words_end];
        self.word_at += words.iter().position(|&byte| !is_white(byte)).unwrap_or(words.len());
    }

    /// Moves to byte `offset` of the slice of [`Self::cursor`].
    #[inline]
    pub fn set_cursor(&mut self, offset: usize) {
        debug_assert!(self.word_at <= offset && offset <= self.words_end, "{offset}");
        self.word_at = offset;
    }

    /// Moves to the end of the line the next word would stand in; whether there was a word.
    ///
    /// # Errors
    /// As [`Self::cursor`].
    pub fn skip_line(&mut self) -> Result<Skipped> {
        let mut skipped = Skipped::Nothing;
        loop {
            let rest = &self.source.buffered()[self.word_at..self.words_end];
            let end = memchr::memchr2(b'\n', b'\r', rest);
            let line = &rest[..end.unwrap_or(rest.len())];
            if !line.iter().copied().all(is_white) {
                skipped = Skipped::Words;
            }
            self.word_at += line.len();
            if end.is_some() || !self.gather_words()? {
                return Ok(skipped);
            }
        }
    }

    /// Whether no word follows in the line of the last one; a comment begun by `#` is none.
    ///
    /// # Errors
    /// As [`Self::cursor`].
    pub fn is_line_end(&mut self) -> Result<bool> {
        loop {
            let mut cursor = Cursor::new(&self.source.buffered()[..self.words_end], self.word_at);
            cursor.skip_blanks();
            self.word_at = cursor.offset();
            match cursor.peek() {
                Some(byte) => return Ok(matches!(byte, b'\n' | b'\r' | b'#')),
                None if self.gather_words()? => {}
                None => return Ok(true),
            }
        }
    }

    /// The fault of finding what stands at the next word instead of `expected`, or of the end of
    /// the input inside `inside`.
    #[cold]
    pub fn word_fault(&mut self, expected: &'static str, inside: &'static str) -> FormatError {
        match self.cursor() {
            Ok(cursor) if cursor.peek().is_none() => self.source.truncated(inside),
            Ok(cursor) => {
                let fault = cursor.fault(expected);
                FormatError::input(self.word_place(), fault)
            }
            Err(error) => error,
        }
    }

    /// Brings more whole words; `false` when there are none.
    #[cold]
    fn gather_words(&mut self) -> Result<bool> {
        self.settle();
        let mut bytes_min = 1;
        loop {
            let block = self.source.block(bytes_min)?;
            let length = block.len();
            if let Some(last) = block.iter().rposition(|&byte| is_white(byte)) {
                self.words_end = last + 1;
                return Ok(true);
            }
            if length < bytes_min {
                self.words_end = length;
                return Ok(length > 0);
            }
            if length > WORD_BYTES_MAX {
                let found = shorten(self.source.buffered());
                let fault = Fault::Syntax { expected: "a word of at most 64 KiB", found };
                return Err(FormatError::input(self.place(0), fault));
            }
            bytes_min = more_than(length);
        }
    }

    /// Consumes the words that were passed.
    fn settle(&mut self) {
        let passed = std::mem::take(&mut self.word_at);
        self.words_end = 0;
        self.consume(passed);
    }
}

/// The next size to ask for when `length` bytes do not hold a line: grows by a factor, so that a
/// long line is not searched again for every few bytes that arrive.
fn more_than(length: usize) -> usize {
    length + length / 4 + 1
}

/// Line ends in `text`: LF, CRLF and CR count one each. The LF of a CRLF cut in two by
/// `after_cr` was counted with its CR.
fn line_ends(text: &[u8], after_cr: bool) -> u64 {
    let line_feeds = memchr::memchr_iter(b'\n', text).count();
    let returns = memchr::memchr_iter(b'\r', text);
    let alone = returns.filter(|&at| text.get(at + 1) != Some(&b'\n')).count();
    let counted = usize::from(after_cr && text.first() == Some(&b'\n'));
    (line_feeds + alone - counted) as u64
}

/// Skips the byte order mark of UTF-8 text.
///
/// # Errors
/// [`Fault::Unsupported`] when the first bytes are UTF-16 text.
pub fn skip_byte_order_mark(source: &mut Source) -> Result<()> {
    let head = source.peek(4)?;
    let utf16 = head.starts_with(b"\xff\xfe")
        || head.starts_with(b"\xfe\xff")
        || matches!(head, &[0, a, 0, b] | &[a, 0, b, 0] if a != 0 && b != 0);
    if utf16 {
        return Err(FormatError::input(Position::byte(0), Fault::Unsupported("UTF-16 text")));
    }
    if head.starts_with(b"\xef\xbb\xbf") {
        source.consume(3);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::{super::source::tests::trickle, *};

    const MIXED: &[u8] = b"one\r\ntwo\nthree\r\rfive\r\n\nseven";

    #[test]
    fn lines_end_in_lf_crlf_or_cr_however_the_bytes_arrive() {
        for step in [1, 2, 3, 7, 1000] {
            let mut text = Text::new(trickle(MIXED, step), 1);
            let mut lines = Vec::new();
            while let Some((line, at)) = text.next_line().unwrap() {
                lines.push((String::from_utf8(line.to_vec()).unwrap(), at.line.unwrap()));
            }
            let expected = ["one", "two", "three", "", "five", "", "seven"];
            let numbered: Vec<_> = (1..).zip(expected).map(|(n, s)| (s.to_owned(), n)).collect();
            assert_eq!(lines, numbered, "{step} bytes a read");
        }
    }

    #[test]
    fn whole_lines_are_never_cut() {
        for step in [1, 2, 3, 7, 1000] {
            let mut text = Text::new(trickle(MIXED, step), 1);
            let mut all = Vec::new();
            loop {
                let lines = text.whole_lines().unwrap();
                let length = lines.len();
                if length == 0 {
                    break;
                }
                all.extend_from_slice(lines);
                assert!(lines.ends_with(b"\n") || lines.ends_with(b"\r") || lines == b"seven");
                text.consume(length);
            }
            assert_eq!(all, MIXED);
            assert_eq!(text.place(0).line, Some(7));
        }
    }

    #[test]
    fn words_know_their_line_however_the_bytes_arrive() {
        for step in [1, 2, 3, 7, 1000] {
            let mut text = Text::new(trickle(MIXED, step), 1);
            let mut words = Vec::new();
            loop {
                let mut cursor = text.cursor().unwrap();
                let Some(word) = cursor.word() else { break };
                let (word, offset) = (String::from_utf8(word.to_vec()).unwrap(), cursor.offset());
                words.push((word, text.word_place().line.unwrap()));
                text.set_cursor(offset);
            }
            let expected = [("one", 1), ("two", 2), ("three", 3), ("five", 5), ("seven", 7)];
            assert_eq!(words, expected.map(|(word, line)| (word.to_owned(), line)));
            assert_eq!(text.consumed(), MIXED.len() as u64);
        }
    }

    #[test]
    fn an_endless_line_is_a_fault_and_does_not_fill_memory() {
        let endless = || Source::new(std::io::repeat(b'x'));
        for error in [
            Text::new(endless(), 1).whole_lines().map(<[u8]>::len).unwrap_err(),
            Text::new(endless(), 1).cursor().map(|cursor| cursor.offset()).unwrap_err(),
        ] {
            let FormatError::Input(fault) = error else { panic!("{error:?}") };
            assert!(matches!(fault.fault, Fault::Syntax { .. }));
            assert_eq!(fault.at.line, Some(1));
        }
    }

    #[test]
    fn utf_16_is_refused_and_a_mark_of_utf_8_skipped() {
        for bytes in [&b"\xff\xfeo\0"[..], b"\xfe\xff\0o", b"o\0f\0", b"\0o\0f"] {
            assert!(skip_byte_order_mark(&mut trickle(bytes, 1)).is_err());
        }
        let mut source = trickle(b"\xef\xbb\xbfv", 1);
        skip_byte_order_mark(&mut source).unwrap();
        assert_eq!(source.peek(9).unwrap(), b"v");
    }
}
