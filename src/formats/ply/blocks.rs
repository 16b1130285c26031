//! Short cuts for binary elements: vertices of fixed length, and triangles among the faces, many
//! records at a time. Measured on one thread: see the commit that added it.

use std::ops::Range;

use super::{
    super::{Batch, OnDefect, fault::Result},
    intake::Intake,
    layout::{Layout, Step},
    records::channel_from,
    scalar::{ByteOrder, Column, Scalar},
    values::Binary,
};
use crate::error::Position;

/// A record of vertices without lists.
pub(super) struct VertexBlocks {
    stride: usize,
    /// Scalar, byte offset and axis of each coordinate.
    axes: Vec<(Scalar, usize, usize)>,
    /// The same for colours and their channel.
    channels: Vec<(Scalar, usize, usize)>,
    /// Positions are the first 12 bytes of the record as we keep them.
    is_plain: bool,
}

impl VertexBlocks {
    /// `None` when records have no fixed length.
    pub(super) fn new(layout: &Layout, order: ByteOrder) -> Option<Self> {
        let (mut stride, mut axes, mut channels) = (0, Vec::new(), Vec::new());
        for step in &layout.steps {
            let bytes = match *step {
                Step::Axis(scalar, axis) => {
                    axes.push((scalar, stride, axis));
                    scalar.size_bytes()
                }
                Step::Channel(scalar, channel) => {
                    channels.push((scalar, stride, channel));
                    scalar.size_bytes()
                }
                Step::Skip { bytes, .. } => bytes as usize,
                Step::SkipList { .. } | Step::Corners { .. } => return None,
            };
            stride += bytes;
        }
        let plain = [0, 1, 2].map(|axis| (Scalar::F32, 4 * axis, axis));
        let is_plain = axes == plain && order == ByteOrder::Little;
        Some(Self { stride, axes, channels, is_plain })
    }

    /// Reads the vertices `records`.
    pub(super) fn read(
        &self,
        body: &mut Binary,
        records: Range<u64>,
        intake: &mut Intake,
        batch: &mut Batch,
    ) -> Result<()> {
        let mut record = records.start;
        while record < records.end {
            let block = body.source.require(self.stride, body.inside)?;
            let here = (block.len() / self.stride).min((records.end - record) as usize);
            let block = &block[..here * self.stride];
            let first = batch.positions.len();
            self.positions(block, body.order, intake, &mut batch.positions);
            self.colors(block, body.order, &mut batch.colors);
            let at = body.source.consumed();
            let place = |index: usize| {
                Position::byte(at + (index * self.stride) as u64).in_record(record + index as u64)
            };
            check_finite(&mut batch.positions[first..], place, intake)?;
            body.source.consume(here * self.stride);
            record += here as u64;
        }
        Ok(())
    }

    fn positions(
        &self,
        block: &[u8],
        order: ByteOrder,
        intake: &mut Intake,
        positions: &mut Vec<[f32; 3]>,
    ) {
        if intake.is_placed {
            let mut wide = vec![[0.0; 3]; block.len() / self.stride];
            for &(scalar, offset, axis) in &self.axes {
                let column = Column { stride: self.stride, offset };
                scalar.for_each_f64(order, block, column, |index, value| wide[index][axis] = value);
            }
            positions.extend(wide.iter().map(|&position| intake.origin.place(position)));
        } else if self.is_plain {
            positions.extend(block.chunks_exact(self.stride).map(|record| {
                let bytes = record.first_chunk::<12>().expect("a record has its coordinates");
                let (axes, _) = bytes.as_chunks::<4>();
                [0, 1, 2].map(|axis| f32::from_le_bytes(axes[axis]))
            }));
        } else {
            let first = positions.len();
            positions.resize(first + block.len() / self.stride, [0.0; 3]);
            let new = &mut positions[first..];
            for &(scalar, offset, axis) in &self.axes {
                let column = Column { stride: self.stride, offset };
                scalar.for_each_f64(order, block, column, |index, value| {
                    new[index][axis] = value as f32;
                });
            }
        }
    }

    fn colors(&self, block: &[u8], order: ByteOrder, colors: &mut Vec<[u8; 4]>) {
        if self.channels.is_empty() {
            return;
        }
        let first = colors.len();
        colors.resize(first + block.len() / self.stride, [u8::MAX; 4]);
        let new = &mut colors[first..];
        for &(scalar, offset, channel) in &self.channels {
            let column = Column { stride: self.stride, offset };
            scalar.for_each_f64(order, block, column, |index, value| {
                new[index][channel] = channel_from(scalar, value);
            });
        }
    }
}

/// Marks and counts what is not finite among `positions`.
fn check_finite(
    positions: &mut [[f32; 3]],
    place: impl Fn(usize) -> Position,
    intake: &mut Intake,
) -> Result<()> {
    // Without an early end, so that it is done many numbers at a time.
    if positions.as_flattened().iter().fold(true, |all, c| all & c.is_finite()) {
        return Ok(());
    }
    for (index, position) in positions.iter_mut().enumerate() {
        if !position.iter().all(|c| c.is_finite()) {
            *position = [f32::NAN; 3];
            intake.bad_vertex(|| place(index))?;
        }
    }
    Ok(())
}

/// A record of faces whose only list is the indices, as long as that list has three.
pub(super) struct TriangleBlocks {
    stride: usize,
    count_at: usize,
    count: Scalar,
    item: Scalar,
}

impl TriangleBlocks {
    /// `None` when there are other lists, or index types that are not worth a short cut.
    pub(super) fn new(layout: &Layout) -> Option<Self> {
        let (mut stride, mut found) = (0, None);
        for step in &layout.steps {
            stride += match *step {
                Step::Corners { count, item } if found.is_none() => {
                    found = Some((stride, count, item));
                    count.size_bytes() + 3 * item.size_bytes()
                }
                Step::Skip { bytes, .. } => bytes as usize,
                _ => return None,
            };
        }
        let (count_at, count, item) = found?;
        (item.size_bytes() == 4).then_some(Self { stride, count_at, count, item })
    }

    /// Reads triangles from what is at hand, until `records` are done or another face comes;
    /// answers how many. 0 means that the next face must be read number by number.
    pub(super) fn read(
        &self,
        body: &mut Binary,
        records: Range<u64>,
        intake: &mut Intake,
        batch: &mut Batch,
    ) -> Result<u64> {
        let block = body.source.block(self.stride)?;
        let room = (block.len() / self.stride).min((records.end - records.start) as usize);
        let run = self.leading_triangles(&block[..room * self.stride], body.order);
        let first = batch.faces.corners.len();
        batch.faces.corners.resize(first + 3 * run, 0);
        let (out, _) = batch.faces.corners[first..].as_chunks_mut::<3>();
        let max = self.decode(&block[..run * self.stride], body.order, out);
        if max >= intake.vertices {
            let at = body.source.consumed();
            let place = |index: usize| {
                Position::byte(at + (index * self.stride) as u64)
                    .in_record(records.start + index as u64)
            };
            drop_out_of_range(&mut batch.faces.corners, first, place, intake)?;
        }
        if !batch.faces.ends.is_empty() {
            let added = first + 3..=batch.faces.corners.len();
            batch.faces.ends.extend(added.step_by(3).map(|end| end as u64));
        }
        body.source.consume(run * self.stride);
        Ok(run as u64)
    }

    /// How many records at the start of `block` have three corners.
    fn leading_triangles(&self, block: &[u8], order: ByteOrder) -> usize {
        let records = block.len() / self.stride;
        let count_bytes = self.count.size_bytes();
        if count_bytes == 1 {
            let counts = block.iter().skip(self.count_at).step_by(self.stride);
            return counts.take_while(|&&count| count == 3).count().min(records);
        }
        let mut counts = block
            .chunks_exact(self.stride)
            .map(|record| self.count.decode_i64(order, &record[self.count_at..][..count_bytes]));
        counts.position(|count| count != 3).unwrap_or(records)
    }

    /// Chooses the loop, one for each byte order and sign.
    fn decode(&self, block: &[u8], order: ByteOrder, out: &mut [[u64; 3]]) -> u64 {
        match (order, self.item) {
            (ByteOrder::Little, Scalar::I32) => {
                self.triangles(block, out, |b| i64::from(i32::from_le_bytes(b)) as u64)
            }
            (ByteOrder::Little, _) => {
                self.triangles(block, out, |b| u64::from(u32::from_le_bytes(b)))
            }
            (ByteOrder::Big, Scalar::I32) => {
                self.triangles(block, out, |b| i64::from(i32::from_be_bytes(b)) as u64)
            }
            (ByteOrder::Big, _) => self.triangles(block, out, |b| u64::from(u32::from_be_bytes(b))),
        }
    }

    /// Decodes the triangles of `block` into `out`; answers their largest index.
    #[inline]
    fn triangles(&self, block: &[u8], out: &mut [[u64; 3]], index: impl Fn([u8; 4]) -> u64) -> u64 {
        let mut max = 0;
        let mut decode = |corners: &[u8; 12], out: &mut [u64; 3]| {
            let (corners, _) = corners.as_chunks::<4>();
            *out = [0, 1, 2].map(|corner| index(corners[corner]));
            max = out.iter().fold(max, |max, &index| max.max(index));
        };
        let offset = self.count_at + self.count.size_bytes();
        if self.stride == 13 && offset == 1 {
            // The layout nearly every file has, `list uchar int` alone: a constant stride.
            for ([_, corners @ ..], out) in block.as_chunks::<13>().0.iter().zip(out) {
                decode(corners, out);
            }
            return max;
        }
        for (record, out) in block.chunks_exact(self.stride).zip(out) {
            decode(record[offset..].first_chunk().expect("a record has its corners"), out);
        }
        max
    }
}

/// Removes the triangles behind `first` that have an index out of range.
fn drop_out_of_range(
    corners: &mut Vec<u64>,
    first: usize,
    place: impl Fn(usize) -> Position,
    intake: &mut Intake,
) -> Result<()> {
    let mut kept = first;
    for index in 0..(corners.len() - first) / 3 {
        let start = first + 3 * index;
        let bad = corners[start..start + 3].iter().find(|&&c| c >= intake.vertices).copied();
        if let Some(bad) = bad {
            intake.bad_index(bad, || place(index))?;
            debug_assert!(intake.on_defect == OnDefect::Skip, "otherwise it was an error");
        } else {
            corners.copy_within(start..start + 3, kept);
            kept += 3;
        }
    }
    corners.truncate(kept);
    Ok(())
}
