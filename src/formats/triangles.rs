//! Triangles of a fixed number of bytes behind a header, as binary STL and our own soup have
//! them: their places, what their count can be, and what happens to bad ones.

use std::ops::Range;

use super::{
    BATCH_RECORDS, Batch, Content, DefectKind, Findings, FormatError, OnDefect, Source,
    fault::Result,
};
use crate::error::{Fault, Position};

/// Where the triangles of a file are.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layout {
    pub(super) header_bytes: usize,
    pub(super) triangle_bytes: usize,
}

/// Bits of infinity; a number with greater ones, the sign apart, is NaN.
const INFINITY_BITS: u32 = f32::INFINITY.to_bits();

impl Layout {
    /// The place of a triangle.
    pub(super) fn place(self, triangle: u64) -> Position {
        let offset = triangle.saturating_mul(self.triangle_bytes as u64);
        Position::byte(offset.saturating_add(self.header_bytes as u64)).in_record(triangle)
    }

    /// The bytes of a file of `count` triangles.
    pub(super) fn file_bytes(self, count: u64) -> u64 {
        self.place(count).byte.unwrap_or(u64::MAX)
    }

    /// Finds out early that a file of `size_bytes` bytes cannot hold `count` triangles.
    ///
    /// # Errors
    /// As [`Self::ended_early`].
    pub(super) fn check_count(self, count: u64, size_bytes: u64) -> Result<()> {
        if self.file_bytes(count) <= size_bytes {
            return Ok(());
        }
        let data_bytes = size_bytes.saturating_sub(self.header_bytes as u64);
        Err(self.ended_early(count, data_bytes))
    }

    /// The fault of an input with `data_bytes` bytes of triangles where the header says `count`:
    /// one that ends inside a triangle is truncated, one that ends between two was counted wrongly.
    pub(super) fn ended_early(self, count: u64, data_bytes: u64) -> FormatError {
        let limit = data_bytes / self.triangle_bytes as u64;
        if data_bytes.is_multiple_of(self.triangle_bytes as u64) {
            let fault = Fault::CountImpossible { what: "the triangle count", count, limit };
            return FormatError::input(self.place(limit), fault);
        }
        let end = Position::byte(self.header_bytes as u64 + data_bytes).in_record(limit);
        FormatError::input(end, Fault::Truncated { inside: "a triangle" })
    }

    /// Makes room for a full batch of triangles, to be filled from the front and truncated. What
    /// the batch holds is left as it is: setting it to zero first would cost as much as filling it.
    pub(super) fn make_room(batch: &mut Batch, colors: bool) {
        batch.content = Content::Soup;
        batch.positions.resize(3 * BATCH_RECORDS, [0.0; 3]);
        batch.colors.resize(if colors { 3 * BATCH_RECORDS } else { 0 }, [0; 4]);
        batch.faces.clear();
    }

    /// The next whole triangles of `source`, at most `triangles_max`, one at least; `None` when
    /// there is none, though perhaps a part of one.
    pub(super) fn next_piece(
        self,
        source: &mut Source,
        triangles_max: u64,
    ) -> Result<Option<&[u8]>> {
        let block = source.block(self.triangle_bytes)?;
        let triangles = ((block.len() / self.triangle_bytes) as u64).min(triangles_max);
        Ok((triangles > 0).then(|| &block[..triangles as usize * self.triangle_bytes]))
    }

    /// Applies the policy to the triangles in `range` of `batch`, of which the first is number
    /// `first` in the file; answers where the ones that stay end.
    ///
    /// # Errors
    /// [`Fault::NotFinite`] at the first bad triangle under [`OnDefect::Fail`].
    pub(super) fn sift(
        self,
        batch: &mut Batch,
        range: Range<usize>,
        first: u64,
        on_defect: OnDefect,
        findings: &mut Findings,
    ) -> Result<usize> {
        if are_finite(batch.positions[3 * range.start..3 * range.end].as_flattened()) {
            return Ok(range.end);
        }
        let mut kept = range.start;
        for triangle in range.clone() {
            let corners = 3 * triangle..3 * triangle + 3;
            if are_finite(batch.positions[corners.clone()].as_flattened()) {
                if !batch.colors.is_empty() {
                    batch.colors.copy_within(corners.clone(), 3 * kept);
                }
                batch.positions.copy_within(corners, 3 * kept);
                kept += 1;
                continue;
            }
            let at = self.place(first + (triangle - range.start) as u64);
            if on_defect == OnDefect::Fail {
                return Err(FormatError::input(at, Fault::NotFinite));
            }
            findings.add(DefectKind::NotFinite, 1, at);
        }
        Ok(kept)
    }
}

/// Moves each position by `shift`, rounding once.
pub(super) fn shift_all(positions: &mut [[f32; 3]], shift: [f64; 3]) {
    if shift == [0.0; 3] {
        return;
    }
    for position in positions {
        *position = std::array::from_fn(|axis| (f64::from(position[axis]) + shift[axis]) as f32);
    }
}

/// Whether no number is NaN or infinite. Without a branch per number, so that it is vectorised.
fn are_finite(numbers: &[f32]) -> bool {
    let greatest = numbers.iter().fold(0, |greatest, number| greatest.max(number.abs().to_bits()));
    greatest < INFINITY_BITS
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAYOUT: Layout = Layout { header_bytes: 100, triangle_bytes: 10 };

    #[test]
    fn an_early_end_is_told_from_a_wrong_count() {
        LAYOUT.check_count(5, 150).unwrap();
        LAYOUT.check_count(5, 170).unwrap();
        let fault = |size_bytes| match LAYOUT.check_count(5, size_bytes).unwrap_err() {
            FormatError::Input(fault) => fault,
            other => panic!("{other:?}"),
        };
        assert!(matches!(fault(140).fault, Fault::CountImpossible { count: 5, limit: 4, .. }));
        assert_eq!(fault(145).fault, Fault::Truncated { inside: "a triangle" });
        assert_eq!(fault(145).at, Position::byte(145).in_record(4));
        assert!(LAYOUT.check_count(u64::MAX, u64::MAX - 1).is_err());
    }

    #[test]
    fn bad_triangles_are_left_out_with_their_colours_and_counted() {
        let mut batch =
            Batch { content: Content::Soup, positions: vec![[0.0; 3]; 12], ..Batch::default() };
        batch.positions[4][1] = f32::NAN;
        batch.positions[6][0] = f32::INFINITY;
        batch.colors = (0..12).map(|corner| [corner; 4]).collect();
        let mut findings = Findings::default();
        let error = LAYOUT.sift(&mut batch, 0..4, 7, OnDefect::Fail, &mut findings).unwrap_err();
        assert!(matches!(error, FormatError::Input(fault) if fault.at.record == Some(8)));
        let kept = LAYOUT.sift(&mut batch, 0..4, 7, OnDefect::Skip, &mut findings).unwrap();
        assert_eq!(findings.count(DefectKind::NotFinite), 2);
        assert_eq!(kept, 2);
        let left: Vec<u8> = batch.colors[..6].iter().map(|color| color[0]).collect();
        assert_eq!(left, [0, 1, 2, 9, 10, 11]);
    }
}
