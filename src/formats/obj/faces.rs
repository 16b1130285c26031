//! `f` lines: corners in all their spellings, and indices that count from either end.

use crate::{
    error::Position,
    formats::cursor::{Cursor, is_white},
};

/// The greatest index of the input, with the face that has it: faces may come before their
/// vertices, so only the end of the input tells whether it is out of range.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Greatest {
    /// 1-based, as written; 0 as long as there is none.
    pub(super) index: i64,
    /// Face that has it.
    pub(super) face: u64,
    /// Its line in the slice under way; `None` once that is known as `at`.
    pub(super) offset: Option<usize>,
    /// Place of the face, when `offset` is `None`.
    pub(super) at: Position,
}

/// Digits that cannot overflow.
const INDEX_DIGITS_MAX: usize = 18;

/// The corners of one face.
#[derive(Debug, Default)]
pub(super) struct Corners {
    /// 0-based.
    pub(super) indices: Vec<u64>,
    /// Greatest positive index as written.
    pub(super) greatest: i64,
    /// An index that can never be valid: 0, or before the first vertex.
    pub(super) impossible: Option<i64>,
}

impl Corners {
    /// Reads corners up to the end of the line or a comment; `None` at a word that is no corner.
    #[inline]
    pub(super) fn read(&mut self, cursor: &mut Cursor<'_>, vertices: u64) -> Option<()> {
        self.indices.clear();
        self.greatest = 0;
        self.impossible = None;
        if let Some((corners, bytes)) = plain_triangle(cursor.rest()) {
            cursor.advance(bytes);
            self.greatest = corners.into_iter().fold(0, i64::max);
            self.indices.extend(corners.map(|index| index as u64 - 1));
            return Some(());
        }
        while !cursor.is_line_end() && cursor.peek() != Some(b'#') {
            let index = read_corner(cursor)?;
            if index > 0 {
                self.greatest = self.greatest.max(index);
                self.indices.push(index as u64 - 1);
            } else {
                match vertices.checked_sub(index.unsigned_abs()) {
                    Some(resolved) if index != 0 => self.indices.push(resolved),
                    _ => self.impossible = self.impossible.or(Some(index)),
                }
            }
        }
        Some(())
    }
}

/// The short cut for what nearly every line of a large file is: three positive indices, one blank
/// between them, a line end. Answers the bytes before that.
#[inline]
fn plain_triangle(text: &[u8]) -> Option<([i64; 3], usize)> {
    let mut corners = [0; 3];
    let mut at = 0;
    for (number, corner) in corners.iter_mut().enumerate() {
        let mut index = 0;
        let start = at;
        while let Some(digit) = text.get(at).map(|byte| byte.wrapping_sub(b'0'))
            && digit < 10
        {
            if at - start == INDEX_DIGITS_MAX {
                return None;
            }
            index = index * 10 + i64::from(digit);
            at += 1;
        }
        let wanted = if number < 2 { b' ' } else { b'\n' };
        if index == 0 || text.get(at) != Some(&wanted) {
            return None;
        }
        *corner = index;
        at += usize::from(number < 2);
    }
    Some((corners, at))
}

/// The vertex index of a corner: `7`, `7/2`, `7//9` or `7/2/9`.
#[inline]
fn read_corner(cursor: &mut Cursor<'_>) -> Option<i64> {
    let before = *cursor;
    let index = cursor.integer_prefix()?;
    if cursor.peek() == Some(b'/') {
        let rest = cursor.rest();
        let more = |byte: &u8| matches!(byte, b'/' | b'-' | b'+' | b'0'..=b'9');
        cursor.advance(rest.iter().position(|byte| !more(byte)).unwrap_or(rest.len()));
    }
    if cursor.peek().is_none_or(is_white) {
        return Some(index);
    }
    *cursor = before;
    None
}
