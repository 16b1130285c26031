//! Numbers and words inside a slice of text. A cursor never reads: it stands on whole words that
//! [`super::text::Text`] has brought together.

use crate::error::Fault;

/// Characters of a bad word that are shown in a fault.
const FOUND_CHARS_MAX: usize = 40;

/// A place in a slice of text. Every parsing method leaves it behind what was parsed, or where it
/// was (blanks apart) when it answers `None`; [`Self::fault`] then says what stands there.
#[derive(Clone, Copy, Debug)]
pub struct Cursor<'a> {
    text: &'a [u8],
    at: usize,
}

impl<'a> Cursor<'a> {
    /// A cursor at byte `at` of `text`.
    #[must_use]
    pub fn new(text: &'a [u8], at: usize) -> Self {
        assert!(at <= text.len(), "a cursor stands inside its text");
        Self { text, at }
    }

    /// Bytes from the start of the slice.
    #[must_use]
    pub fn offset(&self) -> usize {
        self.at
    }

    /// What is left of the slice.
    #[must_use]
    pub fn rest(&self) -> &'a [u8] {
        &self.text[self.at..]
    }

    /// The next byte.
    #[inline]
    #[must_use]
    pub fn peek(&self) -> Option<u8> {
        self.text.get(self.at).copied()
    }

    /// Moves on by `bytes`, at most to the end.
    #[inline]
    pub fn advance(&mut self, bytes: usize) {
        self.at = (self.at + bytes).min(self.text.len());
    }

    /// Skips blanks and tabs, but no line end.
    #[inline]
    pub fn skip_blanks(&mut self) {
        while let Some(b' ' | b'\t' | 0x0b | 0x0c) = self.peek() {
            self.at += 1;
        }
    }

    /// Skips blanks, tabs and line ends.
    #[inline]
    pub fn skip_white(&mut self) {
        while self.peek().is_some_and(is_white) {
            self.at += 1;
        }
    }

    /// Skips to behind the next line end (LF, CRLF or CR), or to the end of the slice.
    #[inline]
    pub fn skip_line(&mut self) {
        match memchr::memchr2(b'\n', b'\r', self.rest()) {
            Some(offset) => {
                self.at += offset + 1;
                if self.text[self.at - 1] == b'\r' && self.peek() == Some(b'\n') {
                    self.at += 1;
                }
            }
            None => self.at = self.text.len(),
        }
    }

    /// Whether the line has nothing more, after blanks.
    #[inline]
    pub fn is_line_end(&mut self) -> bool {
        self.skip_blanks();
        matches!(self.peek(), None | Some(b'\n' | b'\r'))
    }

    /// The next word of this line; `None` at its end.
    #[inline]
    pub fn word(&mut self) -> Option<&'a [u8]> {
        self.skip_blanks();
        let word = self.here();
        self.at += word.len();
        (!word.is_empty()).then_some(word)
    }

    /// A number of this line in double precision. NaN and infinities in any usual spelling are
    /// numbers: the caller looks whether they are finite.
    #[inline]
    pub fn f64(&mut self) -> Option<f64> {
        self.skip_blanks();
        match fast_float2::parse_partial::<f64, _>(self.rest()) {
            Ok((value, bytes)) if self.ends_word(self.at + bytes) => {
                self.at += bytes;
                Some(value)
            }
            _ => self.odd_spelling(),
        }
    }

    /// As [`Self::f64`], rounded once to single precision.
    #[inline]
    pub fn f32(&mut self) -> Option<f32> {
        self.skip_blanks();
        match fast_float2::parse_partial::<f32, _>(self.rest()) {
            Ok((value, bytes)) if self.ends_word(self.at + bytes) => {
                self.at += bytes;
                Some(value)
            }
            _ => self.odd_spelling().map(|value| value as f32),
        }
    }

    /// A whole number of this line; `3.0` is one too, as some writers put it.
    #[inline]
    pub fn integer(&mut self) -> Option<i64> {
        self.skip_blanks();
        let start = self.at;
        let value = self.integer_prefix();
        if value.is_some() && self.ends_word(self.at) {
            return value;
        }
        self.at = start;
        self.integral_float()
    }

    /// A whole number that something other than white space may follow (as in `7/2/9`).
    #[inline]
    pub fn integer_prefix(&mut self) -> Option<i64> {
        let rest = self.rest();
        let signed = matches!(rest.first(), Some(b'+' | b'-'));
        let mut bytes = usize::from(signed);
        let mut value = 0_i64;
        while let Some(digit) =
            rest.get(bytes).map(|byte| byte.wrapping_sub(b'0')).filter(|d| *d < 10)
        {
            // 18 digits cannot overflow; after that each step is looked at.
            value = if bytes < 18 {
                value * 10 + i64::from(digit)
            } else {
                value.checked_mul(10)?.checked_add(i64::from(digit))?
            };
            bytes += 1;
        }
        if bytes == usize::from(signed) {
            return None;
        }
        self.at += bytes;
        Some(if rest[0] == b'-' { -value } else { value })
    }

    /// The fault of finding what stands here instead of `expected`. At the end of the slice that
    /// is truncation inside `expected`.
    #[must_use]
    pub fn fault(&self, expected: &'static str) -> Fault {
        match self.peek() {
            None => Fault::Truncated { inside: expected },
            Some(b'\n' | b'\r') => Fault::Syntax { expected, found: "the end of the line".into() },
            Some(_) => Fault::Syntax { expected, found: shorten(self.here()) },
        }
    }

    /// The word at the cursor.
    #[inline]
    fn here(&self) -> &'a [u8] {
        let rest = self.rest();
        &rest[..rest.iter().position(|&byte| is_white(byte)).unwrap_or(rest.len())]
    }

    #[inline]
    fn ends_word(&self, at: usize) -> bool {
        self.text.get(at).is_none_or(|&byte| is_white(byte))
    }

    /// Spellings of C libraries: `1.#INF`, `-1.#IND00`, `1.#QNAN`, `-nan(ind)`.
    #[cold]
    fn odd_spelling(&mut self) -> Option<f64> {
        let word = self.here();
        let bare = word.strip_prefix(b"-").or(word.strip_prefix(b"+")).unwrap_or(word);
        let lower = bare.to_ascii_lowercase();
        let odd = lower.starts_with(b"1.#") || lower.starts_with(b"nan(");
        if odd {
            self.at += word.len();
        }
        odd.then_some(f64::NAN)
    }

    #[cold]
    fn integral_float(&mut self) -> Option<i64> {
        // Beyond 2^53 a float no longer tells one whole number from the next.
        let start = self.at;
        let value = self.f64().filter(|value| value.fract() == 0.0 && value.abs() < 9e15);
        if value.is_none() {
            self.at = start;
        }
        value.map(|value| value as i64)
    }
}

/// White space of the text formats.
#[inline]
#[must_use]
pub fn is_white(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t'..=b'\r')
}

/// A word as a fault shows it.
#[must_use]
pub fn shorten(word: &[u8]) -> String {
    let text = String::from_utf8_lossy(&word[..word.len().min(4 * FOUND_CHARS_MAX)]);
    let mut short: String = text.chars().take(FOUND_CHARS_MAX).collect();
    if short.len() < word.len() {
        short.push('…');
    }
    short
}

#[cfg(test)]
mod tests {
    use super::*;

    fn number(text: &str) -> Option<f64> {
        Cursor::new(text.as_bytes(), 0).f64()
    }

    #[test]
    fn numbers_come_in_many_spellings() {
        let spellings =
            [("1", 1.0), ("+1.5", 1.5), ("-.5", -0.5), ("1.", 1.0), (" \t2e3\n", 2000.0)];
        for (text, value) in spellings {
            assert_eq!(number(text), Some(value), "{text}");
        }
        for text in ["1E-2", "1e+0"] {
            assert!(number(text).is_some(), "{text}");
        }
        for text in ["nan", "-NaN", "inf", "-Infinity", "1.#INF", "-1.#IND00", "-nan(ind)", "1e999"]
        {
            assert!(number(text).is_some_and(|value| !value.is_finite()), "{text}");
        }
        for text in ["1,5", "", "x", "1.5f", "--1", "0x10", "1 ,".get(1..).unwrap()] {
            assert_eq!(number(text), None, "{text}");
        }
    }

    #[test]
    fn single_precision_is_rounded_once() {
        // Halfway between two floats but for the last digit: by way of f64 it would round down.
        let text = b"1.00000005960464477540";
        assert_eq!(Cursor::new(text, 0).f32(), Some(1.000_000_1));
    }

    #[test]
    fn whole_numbers_are_exact_or_refused() {
        let mut cursor = Cursor::new(b" 42 -7 +3 255.0 9223372036854775807 x", 0);
        let expected = [42, -7, 3, 255, i64::MAX].map(Some);
        assert_eq!(std::array::from_fn(|_| cursor.integer()), expected);
        assert_eq!(cursor.integer(), None);
        assert_eq!(
            cursor.fault("an index"),
            Fault::Syntax { expected: "an index", found: "x".into() }
        );
        for bad in ["9223372036854775808", "1.5", "-", "1/2", "3,"] {
            assert_eq!(Cursor::new(bad.as_bytes(), 0).integer(), None, "{bad}");
        }
        let mut corner = Cursor::new(b"7/2", 0);
        assert_eq!((corner.integer_prefix(), corner.peek()), (Some(7), Some(b'/')));
    }

    #[test]
    fn a_line_ends_the_words_but_not_the_text() {
        let mut cursor = Cursor::new(b"a b\r\nc\rd", 0);
        assert_eq!(
            (cursor.word(), cursor.word(), cursor.word()),
            (Some(&b"a"[..]), Some(&b"b"[..]), None)
        );
        cursor.skip_line();
        assert_eq!(cursor.word(), Some(&b"c"[..]));
        cursor.skip_line();
        assert_eq!(cursor.word(), Some(&b"d"[..]));
        assert!(cursor.is_line_end());
    }
}
