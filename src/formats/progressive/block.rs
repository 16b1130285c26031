//! The head of a block, and its payload packed and unpacked.

use std::io::{Read as _, Write as _};

use flate2::{Compression, read::DeflateDecoder, write::DeflateEncoder};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::error::Fault;

/// Most splits of a batch.
pub const BATCH_SPLITS_MAX: u32 = 1 << 16;
/// Most bytes of a payload unpacked.
pub(super) const RAW_BYTES_MAX: u32 = 1 << 26;
/// DEFLATE makes no more than so many bytes of one: 258 of two bits.
const INFLATION_MAX: u64 = 1032;
/// Bytes of a block before its payload.
pub(super) const HEAD_BYTES: usize = size_of::<RawHead>();

/// How far the finest mesh is from another one, in model units.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Deviation {
    /// Root mean square over its surface.
    pub rms: f32,
    /// The largest that was seen.
    pub max: f32,
}

/// What the head of a block says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Head {
    /// Bytes of the payload.
    pub(super) length: u32,
    /// Bytes of the payload unpacked.
    pub(super) raw_length: u32,
    /// Vertices it adds.
    pub(super) splits: u32,
    /// Faces it adds.
    pub(super) faces: u32,
    pub(super) deviation: Deviation,
    /// CRC-32 of the payload as it lies there.
    pub(super) payload_checksum: u32,
}

#[derive(Clone, Copy, FromBytes, IntoBytes, Immutable, KnownLayout)]
#[repr(C)]
struct RawHead {
    length: u32,
    raw_length: u32,
    splits: u32,
    faces: u32,
    rms: f32,
    max: f32,
    payload_checksum: u32,
    /// CRC-32 of all bytes before it.
    checksum: u32,
}

impl Head {
    pub(super) fn encode(&self) -> [u8; HEAD_BYTES] {
        let mut raw = RawHead {
            length: self.length,
            raw_length: self.raw_length,
            splits: self.splits,
            faces: self.faces,
            rms: self.deviation.rms,
            max: self.deviation.max,
            payload_checksum: self.payload_checksum,
            checksum: 0,
        };
        raw.checksum = raw.own_checksum();
        zerocopy::transmute!(raw)
    }

    pub(super) fn decode(bytes: [u8; HEAD_BYTES]) -> Result<Self, Fault> {
        let raw: RawHead = zerocopy::transmute!(bytes);
        if raw.checksum != raw.own_checksum() {
            return Err(Fault::Corrupt("the checksum of the block's head"));
        }
        let limit = u64::from(RAW_BYTES_MAX).min(u64::from(raw.length) * INFLATION_MAX);
        if u64::from(raw.raw_length) > limit {
            let (what, count) = ("the unpacked length of a block", raw.raw_length.into());
            return Err(Fault::CountImpossible { what, count, limit });
        }
        let is_distance = |distance: f32| distance.is_finite() && distance >= 0.0;
        if !is_distance(raw.rms) || !is_distance(raw.max) {
            return Err(Fault::NotFinite);
        }
        Ok(Self {
            length: raw.length,
            raw_length: raw.raw_length,
            splits: raw.splits,
            faces: raw.faces,
            deviation: Deviation { rms: raw.rms, max: raw.max },
            payload_checksum: raw.payload_checksum,
        })
    }

    /// The columns that a payload was packed from.
    pub(super) fn unpack(&self, payload: &[u8]) -> Result<Vec<u8>, Fault> {
        if crc32fast::hash(payload) != self.payload_checksum {
            return Err(Fault::Corrupt("the checksum of the block"));
        }
        let mut raw = Vec::with_capacity(self.raw_length as usize);
        // One more, to see whether there is more than the head says.
        let unpacked =
            DeflateDecoder::new(payload).take(u64::from(self.raw_length) + 1).read_to_end(&mut raw);
        unpacked.map_err(|error| Fault::Compression(error.to_string()))?;
        if raw.len() != self.raw_length as usize {
            return Err(Fault::Corrupt("the unpacked length of the block"));
        }
        Ok(raw)
    }
}

impl RawHead {
    fn own_checksum(&self) -> u32 {
        crc32fast::hash(&self.as_bytes()[..HEAD_BYTES - size_of::<u32>()])
    }
}

/// A payload of these columns.
pub(super) fn deflate(raw: &[u8]) -> Vec<u8> {
    let mut encoder = DeflateEncoder::new(Vec::new(), Compression::best());
    let packed = encoder.write_all(raw).and_then(|()| encoder.finish());
    packed.expect("memory takes what is written")
}
