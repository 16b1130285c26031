//! The first 128 bytes.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use super::block::HEAD_BYTES;
use crate::{error::Fault, formats::cursor::shorten};

/// First eight bytes of a progressive mesh.
pub(super) const MAGIC: [u8; 8] = *b"\x89MMPROG\n";
/// The only version there is.
const VERSION: u32 = 1;

const COLORS: u32 = 1;
const ALPHA: u32 = 2;

/// Most vertices of a finest mesh, and most faces: half-edges are numbered by 32 bits.
pub const VERTICES_MAX: u32 = (1 << 31) - 1;
/// As [`VERTICES_MAX`].
pub const FACES_MAX: u32 = (1 << 30) - 1;

/// Bytes before the base.
pub const HEADER_BYTES: usize = size_of::<RawHeader>();

/// What is stored of colours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Channels {
    /// Nothing.
    #[default]
    None,
    /// Red, green and blue; all is opaque.
    Rgb,
    /// Alpha, too.
    Rgba,
}

impl Channels {
    /// How many there are.
    #[must_use]
    pub fn count(self) -> usize {
        match self {
            Self::None => 0,
            Self::Rgb => 3,
            Self::Rgba => 4,
        }
    }
}

/// What a header says.
#[derive(Clone, Debug, PartialEq)]
pub struct Header {
    /// Colours.
    pub channels: Channels,
    /// Bytes of the whole file.
    pub length: u64,
    /// Vertices of the finest mesh.
    pub vertices: u32,
    /// Faces of the finest mesh.
    pub faces: u32,
    /// Vertices of the coarsest mesh, at most `vertices`.
    pub base_vertices: u32,
    /// Faces of the coarsest mesh, at most `faces`.
    pub base_faces: u32,
    /// Batches after it.
    pub batches: u32,
    /// Bits of a coordinate, 4 to 24.
    pub bits: u32,
    /// Where coordinates of 0 lie, model units; finite.
    pub origin: [f64; 3],
    /// What a coordinate grows by from one to the next, model units; finite and positive.
    pub step: f64,
}

#[derive(Clone, Copy, FromBytes, IntoBytes, Immutable, KnownLayout)]
#[repr(C)]
struct RawHeader {
    magic: [u8; 8],
    version: u32,
    flags: u32,
    length: u64,
    vertices: u32,
    faces: u32,
    base_vertices: u32,
    base_faces: u32,
    batches: u32,
    bits: u32,
    origin: [f64; 3],
    step: f64,
    reserved: [u8; 44],
    /// CRC-32 of all bytes before it.
    checksum: u32,
}

impl Header {
    /// A header of positions on such a grid; counts and length are for [`super::write`] to fill in.
    #[must_use]
    pub fn of_grid(channels: Channels, bits: u32, origin: [f64; 3], step: f64) -> Self {
        let (length, vertices, faces) = (0, 0, 0);
        let (base_vertices, base_faces, batches) = (0, 0, 0);
        Self {
            channels,
            length,
            vertices,
            faces,
            base_vertices,
            base_faces,
            batches,
            bits,
            origin,
            step,
        }
    }

    pub(super) fn encode(&self) -> [u8; HEADER_BYTES] {
        let mut raw = RawHeader {
            magic: MAGIC,
            version: VERSION,
            flags: match self.channels {
                Channels::None => 0,
                Channels::Rgb => COLORS,
                Channels::Rgba => COLORS | ALPHA,
            },
            length: self.length,
            vertices: self.vertices,
            faces: self.faces,
            base_vertices: self.base_vertices,
            base_faces: self.base_faces,
            batches: self.batches,
            bits: self.bits,
            origin: self.origin,
            step: self.step,
            reserved: [0; 44],
            checksum: 0,
        };
        raw.checksum = raw.own_checksum();
        zerocopy::transmute!(raw)
    }

    pub(super) fn decode(bytes: [u8; HEADER_BYTES]) -> Result<Self, Fault> {
        let raw: RawHeader = zerocopy::transmute!(bytes);
        if raw.magic != MAGIC {
            let expected = "the first bytes of a progressive mesh";
            return Err(Fault::Syntax { expected, found: shorten(&raw.magic) });
        }
        if raw.version != VERSION {
            return Err(Fault::Unsupported("this version of progressive meshes"));
        }
        if raw.checksum != raw.own_checksum() {
            return Err(Fault::Corrupt("the checksum of the header"));
        }
        let channels = match raw.flags {
            0 => Channels::None,
            COLORS => Channels::Rgb,
            flags if flags == COLORS | ALPHA => Channels::Rgba,
            _ => return Err(Fault::Unsupported("a flag of the header")),
        };
        let at_most = |what, count: u64, limit: u64| {
            if count <= limit { Ok(()) } else { Err(Fault::CountImpossible { what, count, limit }) }
        };
        at_most("the vertex count", raw.vertices.into(), VERTICES_MAX.into())?;
        at_most("the face count", raw.faces.into(), FACES_MAX.into())?;
        at_most("the vertex count of the base", raw.base_vertices.into(), raw.vertices.into())?;
        at_most("the face count of the base", raw.base_faces.into(), raw.faces.into())?;
        // Each batch adds a vertex, and takes its head.
        let added = raw.vertices - raw.base_vertices;
        at_most("the number of batches", raw.batches.into(), added.into())?;
        let heads = raw.length.saturating_sub(HEADER_BYTES as u64) / HEAD_BYTES as u64;
        at_most("the number of blocks", u64::from(raw.batches) + 1, heads)?;
        at_most("the bits of a coordinate", raw.bits.into(), 24)?;
        if raw.bits < 4 {
            return Err(Fault::Unsupported("a coordinate of fewer than 4 bits"));
        }
        let is_finite = raw.origin.iter().chain([&raw.step]).all(|number| number.is_finite());
        if !is_finite || raw.step <= 0.0 {
            return Err(Fault::NotFinite);
        }
        Ok(Self {
            channels,
            length: raw.length,
            vertices: raw.vertices,
            faces: raw.faces,
            base_vertices: raw.base_vertices,
            base_faces: raw.base_faces,
            batches: raw.batches,
            bits: raw.bits,
            origin: raw.origin,
            step: raw.step,
        })
    }
}

impl RawHeader {
    fn own_checksum(&self) -> u32 {
        crc32fast::hash(&self.as_bytes()[..HEADER_BYTES - size_of::<u32>()])
    }
}
