//! Reads our own soup.

use zerocopy::IntoBytes as _;

use super::header::{HEADER_BYTES, Header, MAGIC, Trailer};
use crate::{
    error::{Fault, Position},
    formats::{
        BATCH_RECORDS, Batch, Declared, DefectKind, Findings, Format, FormatError, MeshReader,
        OnDefect, Origin, ReadOptions, Source,
        cursor::shorten,
        fault::Result,
        triangles::{Layout, shift_all},
    },
};

/// Reads a soup.
pub(in crate::formats) struct Reader {
    source: Source,
    layout: Layout,
    /// The header's, unless another file of the mesh has decided.
    origin: Origin,
    on_defect: OnDefect,
    declared: Declared,
    findings: Findings,
    /// To be added to positions: what the header's origin is away from ours.
    shift: [f64; 3],
    /// Triangles consumed, the ones left out included.
    taken: u64,
    /// Of the triangles consumed; kept only for a trailer.
    checksum: crc32fast::Hasher,
    /// The end was reached and found to be right.
    ended: bool,
}

impl Reader {
    /// Reads the header.
    pub(in crate::formats) fn open(mut source: Source, options: &ReadOptions) -> Result<Self> {
        let magic = source.peek(MAGIC.len())?;
        if !MAGIC.starts_with(magic) {
            let (expected, found) = ("the first bytes of a soup", shorten(magic));
            return Err(FormatError::input(Position::byte(0), Fault::Syntax { expected, found }));
        }
        let mut bytes = [0; HEADER_BYTES];
        source.read_exact(&mut bytes, "the header")?;
        let header =
            Header::decode(bytes).map_err(|fault| FormatError::input(Position::byte(0), fault))?;
        let layout = Layout { header_bytes: HEADER_BYTES, triangle_bytes: header.triangle_bytes() };
        if let (Some(count), Some(size_bytes)) = (header.count, options.size_bytes) {
            layout.check_count(count, size_bytes)?;
        }
        let decided = options.origin.is_decided();
        let origin = if decided { options.origin } else { Origin::at(header.origin) };
        let kept = origin.get();
        let declared = Declared {
            indexed: false,
            vertices: None,
            faces: header.count,
            colors: header.colors,
            double: header.double,
            vertices_first: false,
            bounds: header.bounds,
        };
        Ok(Self {
            source,
            layout,
            origin,
            on_defect: options.on_defect,
            declared,
            findings: Findings::default(),
            shift: std::array::from_fn(|axis| header.origin[axis] - kept[axis]),
            taken: 0,
            checksum: crc32fast::Hasher::new(),
            ended: false,
        })
    }

    /// Copies triangles that are at hand into the batch, from triangle `start` on, at most
    /// `wanted`; answers how many.
    fn take_piece(&mut self, batch: &mut Batch, start: usize, wanted: u64) -> Result<usize> {
        let triangle_bytes = self.layout.triangle_bytes;
        let bytes = if self.declared.faces.is_some() {
            self.layout.next_piece(&mut self.source, wanted)?.unwrap_or_default()
        } else {
            // One record is held back: it may be the trailer.
            let block = self.source.block(2 * triangle_bytes)?;
            let records = (block.len() / triangle_bytes).saturating_sub(1).min(wanted as usize);
            let bytes = &block[..records * triangle_bytes];
            self.checksum.update(bytes);
            bytes
        };
        let (length, triangles) = (bytes.len(), bytes.len() / triangle_bytes);
        let corners = 3 * start..3 * (start + triangles);
        let positions = &mut batch.positions[corners.clone()];
        if self.declared.colors {
            decode_colored(bytes, positions, &mut batch.colors[corners]);
        } else {
            positions.as_mut_bytes().copy_from_slice(bytes);
        }
        shift_all(positions, self.shift);
        self.source.consume(length);
        Ok(triangles)
    }

    /// Looks at what is left when no triangle is, or none is wanted.
    fn finish(&mut self) -> Result<()> {
        let at = self.source.position();
        let Some(count) = self.declared.faces else {
            return self.check_trailer(at);
        };
        let rest_bytes = self.source.drain()?;
        if self.taken == count {
            self.findings.add(DefectKind::TrailingBytes, rest_bytes, at);
            return Ok(());
        }
        let data_bytes = self.taken * self.layout.triangle_bytes as u64 + rest_bytes;
        Err(self.layout.ended_early(count, data_bytes))
    }

    fn check_trailer(&mut self, at: Position) -> Result<()> {
        let rest = self.source.buffered();
        let whole = rest.len() == self.layout.triangle_bytes;
        let Some(trailer) = Trailer::decode(rest).filter(|_| whole) else {
            let end = self.source.consumed() + rest.len() as u64;
            let fault = Fault::Truncated { inside: "the triangles" };
            return Err(FormatError::input(Position::byte(end).in_record(self.taken), fault));
        };
        if trailer.count != self.taken || trailer.checksum != self.checksum.clone().finalize() {
            return Err(FormatError::input(at, Fault::Corrupt("the trailer")));
        }
        self.source.drain()?;
        Ok(())
    }
}

impl MeshReader for Reader {
    fn format(&self) -> Format {
        Format::Soup
    }

    fn declared(&self) -> &Declared {
        &self.declared
    }

    fn read_batch(&mut self, batch: &mut Batch) -> Result<bool> {
        Layout::make_room(batch, self.declared.colors);
        let mut filled = 0;
        while !self.ended && filled < BATCH_RECORDS {
            let left = self.declared.faces.map_or(u64::MAX, |count| count - self.taken);
            let wanted = left.min((BATCH_RECORDS - filled) as u64);
            let taken = self.take_piece(batch, filled, wanted)?;
            if taken == 0 {
                self.finish()?;
                self.ended = true;
                break;
            }
            let (range, first) = (filled..filled + taken, self.taken);
            filled = self.layout.sift(batch, range, first, self.on_defect, &mut self.findings)?;
            self.taken += taken as u64;
        }
        batch.positions.truncate(3 * filled);
        batch.colors.truncate(3 * filled);
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

/// Takes corners of 16 bytes apart.
fn decode_colored(bytes: &[u8], positions: &mut [[f32; 3]], colors: &mut [[u8; 4]]) {
    let (corners, _) = bytes.as_chunks::<16>();
    for (corner, (position, color)) in corners.iter().zip(positions.iter_mut().zip(colors)) {
        position.as_mut_bytes().copy_from_slice(&corner[..12]);
        color.copy_from_slice(&corner[12..]);
    }
}
