//! The writing side: columns packed into blocks, and the blocks behind a header.

use std::io::{self, Write};

use super::{
    Base, Channels, Deviation, Header, Split,
    block::{BATCH_SPLITS_MAX, HEAD_BYTES, Head, RAW_BYTES_MAX, deflate},
    columns::{Writer, index_code},
    header::HEADER_BYTES,
};

/// A block that lacks its deviation only.
#[derive(Clone, Debug)]
pub struct Packed {
    /// Vertices it adds.
    pub vertices: u32,
    /// Faces it adds.
    pub faces: u32,
    raw_length: u32,
    payload: Vec<u8>,
}

impl Packed {
    fn new(vertices: usize, faces: u32, columns: &Writer) -> Self {
        let payload = deflate(&columns.0);
        Self { vertices: vertices as u32, faces, raw_length: columns.0.len() as u32, payload }
    }

    /// Bytes of the block.
    #[must_use]
    pub fn size_bytes(&self) -> u64 {
        (HEAD_BYTES + self.payload.len()) as u64
    }
}

/// Packs the base; `None` when it is more than a block may hold.
#[must_use]
pub fn pack_base(base: &Base, bits: u32, channels: Channels) -> Option<Packed> {
    let mut columns = Writer::default();
    let before = |position: Option<&[u32; 3]>| position.copied().unwrap_or_default();
    let positions = base.positions.iter().enumerate();
    let steps = positions.map(|(index, position)| {
        let before = before(index.checked_sub(1).map(|index| &base.positions[index]));
        std::array::from_fn(|axis| position[axis] as i32 - before[axis] as i32)
    });
    columns.coordinates(bits, &steps);
    let colors = base.colors.iter().enumerate().map(|(index, color)| {
        let before = index.checked_sub(1).map_or([0; 4], |index| base.colors[index]);
        std::array::from_fn(|channel| color[channel].wrapping_sub(before[channel]))
    });
    columns.channels(channels, &colors);
    let mut before = 0;
    let corners = base.faces.as_flattened().iter();
    columns.numbers(
        corners.map(|vertex| index_code(*vertex, std::mem::replace(&mut before, *vertex))),
    );
    let fits = columns.0.len() <= RAW_BYTES_MAX as usize;
    fits.then(|| Packed::new(base.positions.len(), base.faces.len() as u32, &columns))
}

/// Packs splits, of which there are at most [`BATCH_SPLITS_MAX`], by increasing parents.
#[must_use]
pub fn pack_batch(splits: &[Split], bits: u32, channels: Channels) -> Packed {
    assert!((1..=BATCH_SPLITS_MAX as usize).contains(&splits.len()), "a batch is bounded");
    debug_assert!(splits.is_sorted_by(|one, two| one.parent < two.parent), "one split a parent");
    let mut columns = Writer::default();
    let mut next = 0;
    columns.numbers(splits.iter().map(|split| {
        let gap = split.parent - next;
        next = split.parent + 1;
        gap
    }));
    columns.numbers(splits.iter().map(|split| split.kind.number() + 3 * split.taken));
    columns.numbers(splits.iter().map(|split| split.first));
    columns.coordinates(bits, &splits.iter().map(|split| split.step));
    columns.coordinates(bits, &splits.iter().map(|split| split.rest));
    columns.channels(channels, &splits.iter().map(|split| split.color_step));
    columns.channels(channels, &splits.iter().map(|split| split.color_rest));
    let faces = splits.iter().map(|split| split.kind.faces()).sum();
    Packed::new(splits.len(), faces, &columns)
}

/// Writes a progressive mesh; the header's length and counts follow from the blocks, of which the
/// first is the base. Returns the length.
///
/// # Errors
/// When the output does not take it.
pub fn write(
    output: &mut dyn Write,
    header: &Header,
    blocks: &[(Packed, Deviation)],
) -> io::Result<u64> {
    let sum = |count: fn(&Packed) -> u32| blocks.iter().map(|(packed, _)| count(packed)).sum();
    let size_bytes: u64 = blocks.iter().map(|(packed, _)| packed.size_bytes()).sum();
    let base = &blocks.first().expect("a progressive mesh has a base").0;
    let header = Header {
        length: HEADER_BYTES as u64 + size_bytes,
        vertices: sum(|packed| packed.vertices),
        faces: sum(|packed| packed.faces),
        base_vertices: base.vertices,
        base_faces: base.faces,
        batches: blocks.len() as u32 - 1,
        ..header.clone()
    };
    let bytes = header.encode();
    debug_assert_eq!(Header::decode(bytes).as_ref(), Ok(&header), "what is written is read");
    output.write_all(&bytes)?;
    for (packed, deviation) in blocks {
        let head = Head {
            length: packed.payload.len() as u32,
            raw_length: packed.raw_length,
            splits: packed.vertices,
            faces: packed.faces,
            deviation: *deviation,
            payload_checksum: crc32fast::hash(&packed.payload),
        };
        output.write_all(&head.encode())?;
        output.write_all(&packed.payload)?;
    }
    output.flush()?;
    Ok(header.length)
}
