//! The reading side: a stream taken apart block by block, everything checked that can be checked
//! without the mesh.

use std::io::Read;

use super::{
    Base, Channels, Deviation, Header, Kind, Split, SplitBatch,
    block::{BATCH_SPLITS_MAX, HEAD_BYTES, Head},
    columns::{self, index_of_code},
    header::{HEADER_BYTES, MAGIC},
};
use crate::{
    error::{Fault, Position},
    formats::{FormatError, Source, cursor::shorten, fault::Result},
};

/// Reads a progressive mesh from any stream, cut or whole.
pub struct Reader {
    source: Source,
    header: Header,
    /// Blocks that were read, the base included.
    blocks: u32,
    /// Vertices of the mesh they make.
    vertices: u32,
    /// Its faces.
    faces: u32,
    /// Of the last block.
    deviation: Deviation,
    is_cut: bool,
}

/// Bytes of a payload that are asked for at a time: what a head promises need not come.
const PIECE_BYTES: usize = 1 << 20;

impl Reader {
    /// Reads the header.
    ///
    /// # Errors
    /// [`FormatError::Input`] when it is not one of a progressive mesh that we can read.
    pub fn open(input: impl Read + Send + 'static) -> Result<Self> {
        let mut source = Source::new(input);
        let magic = source.peek(MAGIC.len())?;
        if magic.is_empty() {
            return Err(FormatError::input(Position::byte(0), Fault::Empty));
        }
        if !MAGIC.starts_with(magic) {
            let (expected, found) = ("the first bytes of a progressive mesh", shorten(magic));
            return Err(FormatError::input(Position::byte(0), Fault::Syntax { expected, found }));
        }
        let mut bytes = [0; HEADER_BYTES];
        source.read_exact(&mut bytes, "the header")?;
        let header =
            Header::decode(bytes).map_err(|fault| FormatError::input(Position::byte(0), fault))?;
        let deviation = Deviation { rms: f32::INFINITY, max: f32::INFINITY };
        let (blocks, vertices, faces) = (0, 0, 0);
        Ok(Self { source, header, blocks, vertices, faces, deviation, is_cut: false })
    }

    /// What the header says.
    #[must_use]
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Batches that were read.
    #[must_use]
    pub fn batches_read(&self) -> u32 {
        self.blocks.saturating_sub(1)
    }

    /// Whether the stream ended before the last batch did.
    #[must_use]
    pub fn is_cut(&self) -> bool {
        self.is_cut
    }

    /// Bytes consumed.
    #[must_use]
    pub fn bytes_read(&self) -> u64 {
        self.source.consumed()
    }

    /// Reads the base; once, and first.
    ///
    /// # Errors
    /// [`FormatError::Input`] when it is incomplete or not what the header says.
    pub fn read_base(&mut self) -> Result<Base> {
        assert_eq!(self.blocks, 0, "the base is read once");
        let at = Position::byte(self.source.consumed());
        let Some((head, payload)) = self.read_block()? else {
            return Err(self.source.truncated("the base"));
        };
        let base = self.base(&head, &payload).map_err(|fault| FormatError::input(at, fault))?;
        self.add(&head).map_err(|fault| FormatError::input(at, fault))?;
        Ok(base)
    }

    /// Reads the next batch; `None` after the last one that is whole.
    ///
    /// # Errors
    /// [`FormatError::Input`] when it is not what it says, or the file is longer than it says.
    pub fn next_batch(&mut self) -> Result<Option<SplitBatch>> {
        assert!(self.blocks > 0, "the base comes first");
        let at = self.source.consumed();
        let place = Position::byte(at);
        if self.is_cut || self.batches_read() == self.header.batches {
            if !self.is_cut && !self.source.is_at_end()? {
                let fault = Fault::Corrupt("the length in the header");
                return Err(FormatError::input(place, fault));
            }
            return Ok(None);
        }
        let Some((head, payload)) = self.read_block()? else {
            self.is_cut = true;
            return Ok(None);
        };
        let splits =
            self.splits(&head, &payload).map_err(|fault| FormatError::input(place, fault))?;
        self.add(&head).map_err(|fault| FormatError::input(place, fault))?;
        Ok(Some(SplitBatch { at, splits, faces: head.faces, deviation: head.deviation }))
    }

    /// Head and payload of the next block; `None` when it is not all there.
    fn read_block(&mut self) -> Result<Option<(Head, Vec<u8>)>> {
        let place = self.source.position();
        let mut bytes = [0; HEAD_BYTES];
        let here = self.source.peek(HEAD_BYTES)?;
        if here.len() < HEAD_BYTES {
            return Ok(None);
        }
        bytes.copy_from_slice(here);
        let head = Head::decode(bytes).map_err(|fault| FormatError::input(place, fault))?;
        let end = self.source.consumed() + HEAD_BYTES as u64 + u64::from(head.length);
        if end > self.header.length {
            let fault = Fault::Corrupt("the length in the header");
            return Err(FormatError::input(place, fault));
        }
        self.source.consume(HEAD_BYTES);
        let mut payload = Vec::new();
        while payload.len() < head.length as usize {
            let left = head.length as usize - payload.len();
            let piece = self.source.peek(left.min(PIECE_BYTES))?;
            if piece.is_empty() {
                return Ok(None);
            }
            payload.extend_from_slice(piece);
            let bytes = piece.len();
            self.source.consume(bytes);
        }
        Ok(Some((head, payload)))
    }

    /// Counts a block, after all else of it was found to be right.
    fn add(&mut self, head: &Head) -> Result<(), Fault> {
        self.blocks += 1;
        self.vertices += head.splits;
        self.faces += head.faces;
        let is_last = self.batches_read() == self.header.batches;
        let (vertices, faces) = (self.header.vertices, self.header.faces);
        if is_last && (self.vertices, self.faces) != (vertices, faces) {
            return Err(Fault::Corrupt("the counts in the header"));
        }
        if is_last && self.source.consumed() != self.header.length {
            return Err(Fault::Corrupt("the length in the header"));
        }
        let Deviation { rms, max } = head.deviation;
        if rms > self.deviation.rms || max > self.deviation.max {
            return Err(Fault::Corrupt("the order of the distances"));
        }
        self.deviation = head.deviation;
        Ok(())
    }

    fn base(&self, head: &Head, payload: &[u8]) -> Result<Base, Fault> {
        let Header { base_vertices, base_faces, bits, channels, .. } = self.header;
        if (head.splits, head.faces) != (base_vertices, base_faces) {
            return Err(Fault::Corrupt("the counts of the base"));
        }
        let per_vertex = coordinate_bytes(bits) + channels.count() as u64;
        let least = u64::from(base_vertices) * per_vertex + 3 * u64::from(base_faces);
        check_least(head, least)?;
        let raw = head.unpack(payload)?;
        let (mut columns, vertices) = (columns::Reader(&raw), base_vertices as usize);
        let steps = columns.coordinates(bits, vertices)?;
        let color_steps = columns.channels(channels, vertices)?;
        let mut codes = vec![0; 3 * base_faces as usize];
        columns.numbers(&mut codes)?;
        columns.finish()?;
        let mask = (1 << bits) - 1;
        let mut position = [0_u32; 3];
        let next = |step: [i32; 3]| {
            for axis in 0..3 {
                position[axis] = position[axis].wrapping_add(step[axis] as u32) & mask;
            }
            position
        };
        let positions = steps.into_iter().map(next).collect();
        let mut color = [0_u8; 4];
        let next = |step: [u8; 4]| {
            color = std::array::from_fn(|channel| color[channel].wrapping_add(step[channel]));
            if channels == Channels::Rgba { color } else { [color[0], color[1], color[2], 255] }
        };
        let colors = color_steps.into_iter().map(next).collect();
        let faces = faces(&codes, base_vertices)?;
        Ok(Base { positions, colors, faces, deviation: head.deviation })
    }

    fn splits(&self, head: &Head, payload: &[u8]) -> Result<Vec<Split>, Fault> {
        let Header { bits, channels, .. } = self.header;
        let left = self.header.vertices - self.vertices;
        let limit = BATCH_SPLITS_MAX.min(left).into();
        if head.splits == 0 || u64::from(head.splits) > limit {
            let (what, count) = ("the number of splits", head.splits.into());
            return Err(Fault::CountImpossible { what, count, limit });
        }
        let limit = (self.header.faces - self.faces).into();
        if u64::from(head.faces) > limit {
            let (what, count) = ("the number of new faces", head.faces.into());
            return Err(Fault::CountImpossible { what, count, limit });
        }
        let per_split = 3 + 2 * (coordinate_bytes(bits) + channels.count() as u64);
        check_least(head, u64::from(head.splits) * per_split)?;
        let raw = head.unpack(payload)?;
        let (mut columns, count) = (columns::Reader(&raw), head.splits as usize);
        let mut numbers = vec![0; 3 * count];
        columns.numbers(&mut numbers)?;
        let steps = columns.coordinates(bits, count)?;
        let rests = columns.coordinates(bits, count)?;
        let color_steps = columns.channels(channels, count)?;
        let color_rests = columns.channels(channels, count)?;
        columns.finish()?;
        let mut splits = Vec::with_capacity(count);
        let (mut next, mut faces) = (0_u64, 0);
        for index in 0..count {
            let parent = next + u64::from(numbers[index]);
            if parent >= self.vertices.into() {
                let (index, vertices) = (parent as i64, self.vertices.into());
                return Err(Fault::IndexOutOfRange { index, vertices });
            }
            next = parent + 1;
            let kind = Kind::of_number(numbers[count + index]);
            faces += kind.faces();
            splits.push(Split {
                parent: parent as u32,
                kind,
                first: numbers[2 * count + index],
                taken: numbers[count + index] / 3,
                step: steps[index],
                rest: rests[index],
                color_step: color_steps.get(index).copied().unwrap_or_default(),
                color_rest: color_rests.get(index).copied().unwrap_or_default(),
            });
        }
        if faces == head.faces {
            Ok(splits)
        } else {
            Err(Fault::Corrupt("the number of new faces"))
        }
    }
}

fn coordinate_bytes(bits: u32) -> u64 {
    3 * u64::from(bits.div_ceil(8))
}

/// Refuses a block too short for what it says it holds, before room is made for that.
fn check_least(head: &Head, least: u64) -> Result<(), Fault> {
    if u64::from(head.raw_length) >= least {
        return Ok(());
    }
    Err(Fault::Corrupt("the unpacked length of the block"))
}

/// Faces of a base, from the codes of their corners.
fn faces(codes: &[u32], vertices: u32) -> Result<Vec<[u32; 3]>, Fault> {
    let mut before = 0;
    let mut faces = Vec::with_capacity(codes.len() / 3);
    for code in codes.as_chunks::<3>().0 {
        let face = code.map(|code| {
            before = index_of_code(code, before);
            before
        });
        if let Some(vertex) = face.iter().find(|vertex| **vertex >= vertices) {
            let (index, vertices) = (i64::from(*vertex), vertices.into());
            return Err(Fault::IndexOutOfRange { index, vertices });
        }
        let [a, b, c] = face;
        if a == b || b == c || c == a {
            return Err(Fault::Corrupt("a face with two equal corners"));
        }
        faces.push(face);
    }
    Ok(faces)
}
