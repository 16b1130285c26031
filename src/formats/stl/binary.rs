//! Reads binary STL.

use zerocopy::IntoBytes as _;

use super::{COUNT_BYTES, HEADER_BYTES, TRIANGLE_BYTES};
use crate::{
    error::Position,
    formats::{
        BATCH_RECORDS, Batch, Declared, DefectKind, Findings, Format, MeshReader, OnDefect, Origin,
        ReadOptions, Source,
        fault::Result,
        triangles::{Layout, shift_all},
    },
};

pub(super) const LAYOUT: Layout =
    Layout { header_bytes: HEADER_BYTES, triangle_bytes: TRIANGLE_BYTES };

/// What `count` says when a writer never came back to set it; 0 does as well.
const COUNT_ALL_ONES: u64 = u32::MAX as u64;

/// Reads binary STL.
pub(super) struct Reader {
    source: Source,
    on_defect: OnDefect,
    /// Zero, unless another file of the mesh has decided: the numbers have single precision.
    origin: Origin,
    declared: Declared,
    findings: Findings,
    /// Triangles of the input; `None`: up to its end.
    count: Option<u64>,
    /// Triangles consumed, the ones left out included.
    taken: u64,
}

impl Reader {
    /// Reads the header.
    pub(super) fn open(mut source: Source, options: &ReadOptions) -> Result<Self> {
        let header = source.require(HEADER_BYTES, "the header")?;
        let written = header[COUNT_BYTES].iter().rev().fold(0, |n, &byte| n << 8 | u64::from(byte));
        let triangle_follows = header.len() >= HEADER_BYTES + TRIANGLE_BYTES
            || source.peek(HEADER_BYTES + TRIANGLE_BYTES)?.len() == HEADER_BYTES + TRIANGLE_BYTES;
        source.consume(HEADER_BYTES);
        let size_is_right = options.size_bytes == Some(LAYOUT.file_bytes(written));
        let unset = written == 0 && triangle_follows || written == COUNT_ALL_ONES;
        let mut findings = Findings::default();
        let count = if unset && !size_is_right {
            let at = Position::byte(COUNT_BYTES.start as u64);
            findings.add(DefectKind::CountUnset, 1, at);
            None
        } else {
            if let Some(size_bytes) = options.size_bytes {
                LAYOUT.check_count(written, size_bytes)?;
            }
            Some(written)
        };
        let declared = Declared {
            indexed: false,
            vertices: None,
            faces: count,
            colors: false,
            double: false,
            vertices_first: false,
            bounds: None,
        };
        let origin = if options.origin.is_decided() { options.origin } else { Origin::ZERO };
        let on_defect = options.on_defect;
        Ok(Self { source, on_defect, origin, declared, findings, count, taken: 0 })
    }

    /// Looks at what is left when no whole triangle is, or none is wanted.
    fn finish(&mut self) -> Result<()> {
        let at = self.source.position();
        let rest_bytes = self.source.drain()?;
        let data_bytes = self.taken * TRIANGLE_BYTES as u64 + rest_bytes;
        match self.count {
            Some(count) if self.taken == count => {
                self.findings.add(DefectKind::TrailingBytes, rest_bytes, at);
            }
            Some(count) => return Err(LAYOUT.ended_early(count, data_bytes)),
            None if rest_bytes > 0 => return Err(LAYOUT.ended_early(self.taken + 1, data_bytes)),
            None => {}
        }
        Ok(())
    }
}

impl MeshReader for Reader {
    fn format(&self) -> Format {
        Format::Stl
    }

    fn declared(&self) -> &Declared {
        &self.declared
    }

    fn read_batch(&mut self, batch: &mut Batch) -> Result<bool> {
        Layout::make_room(batch, false);
        let mut filled = 0;
        while filled < BATCH_RECORDS {
            let left = self.count.map_or(u64::MAX, |count| count - self.taken);
            let wanted = left.min((BATCH_RECORDS - filled) as u64);
            let Some(bytes) = LAYOUT.next_piece(&mut self.source, wanted)? else {
                self.finish()?;
                break;
            };
            let (records, _) = bytes.as_chunks::<TRIANGLE_BYTES>();
            let range = filled..filled + records.len();
            let positions = &mut batch.positions[3 * range.start..3 * range.end];
            let attributes = decode(records, positions);
            shift_all(positions, self.origin.get().map(|coordinate| 0.0 - coordinate));
            let (triangles, length) = (records.len() as u64, bytes.len());
            self.source.consume(length);
            if attributes != 0 {
                self.findings.drop_attribute("face colours (attribute bytes)");
            }
            let first = self.taken;
            filled = LAYOUT.sift(batch, range, first, self.on_defect, &mut self.findings)?;
            self.taken += triangles;
        }
        batch.positions.truncate(3 * filled);
        Ok(filled > 0)
    }

    fn findings(&self) -> &Findings {
        &self.findings
    }

    fn origin(&self) -> Origin {
        self.origin
    }

    fn bytes_read(&self) -> u64 {
        self.source.consumed()
    }
}

/// Copies the corners of each record; answers all attribute bytes, or-ed together.
fn decode(records: &[[u8; TRIANGLE_BYTES]], positions: &mut [[f32; 3]]) -> u16 {
    let (triangles, _) = positions.as_chunks_mut::<3>();
    let mut attributes = 0;
    for (record, triangle) in records.iter().zip(triangles) {
        // After the normal: nine coordinates, then the attribute.
        triangle.as_mut_bytes().copy_from_slice(&record[12..48]);
        attributes |= u16::from_le_bytes([record[48], record[49]]);
    }
    attributes
}
