//! The bytes around the triangles: the header and the trailer of docs/FORMATS.md.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::error::Fault;

/// First eight bytes of a soup.
pub(crate) const MAGIC: [u8; 8] = *b"\x89MMSOUP\n";
/// First eight bytes of a trailer.
const TRAILER_MAGIC: [u8; 8] = *b"\x89MMSEND\n";
/// The only version there is.
const VERSION: u32 = 1;
/// The count of a stream that ends with a trailer.
const COUNT_UNKNOWN: u64 = u64::MAX;

const COLORS: u32 = 1;
const BOUNDS: u32 = 2;
const DOUBLE: u32 = 4;

/// Bytes before the first triangle.
pub(super) const HEADER_BYTES: usize = size_of::<RawHeader>();
/// Bytes of the part of a trailer that is not zeros.
pub(super) const TRAILER_BYTES: usize = size_of::<Trailer>();

/// What a header says.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Header {
    pub(super) colors: bool,
    pub(super) double: bool,
    /// `None`: a trailer follows the last triangle.
    pub(super) count: Option<u64>,
    pub(super) origin: [f64; 3],
    pub(super) bounds: Option<[[f64; 3]; 2]>,
}

#[derive(Clone, Copy, FromBytes, IntoBytes, Immutable, KnownLayout)]
#[repr(C)]
struct RawHeader {
    magic: [u8; 8],
    version: u32,
    flags: u32,
    count: u64,
    origin: [f64; 3],
    bounds: [[f64; 3]; 2],
    reserved: [u8; 28],
    /// CRC-32 of all bytes before it.
    checksum: u32,
}

/// What stands behind the last triangle of a stream without a count, before zeros.
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout)]
#[repr(C)]
pub(super) struct Trailer {
    magic: [u8; 8],
    pub(super) count: u64,
    /// CRC-32 of all triangle bytes.
    pub(super) checksum: u32,
    reserved: u32,
}

impl Header {
    /// Bytes of a triangle, and of the trailer.
    pub(super) fn triangle_bytes(&self) -> usize {
        if self.colors { 48 } else { 36 }
    }

    pub(super) fn encode(&self) -> [u8; HEADER_BYTES] {
        let flag = |set: bool, flag: u32| if set { flag } else { 0 };
        let mut raw = RawHeader {
            magic: MAGIC,
            version: VERSION,
            flags: flag(self.colors, COLORS)
                | flag(self.bounds.is_some(), BOUNDS)
                | flag(self.double, DOUBLE),
            count: self.count.unwrap_or(COUNT_UNKNOWN),
            origin: self.origin,
            bounds: self.bounds.unwrap_or_default(),
            reserved: [0; 28],
            checksum: 0,
        };
        raw.checksum = raw.own_checksum();
        zerocopy::transmute!(raw)
    }

    /// # Errors
    /// The fault of a header that is not one of ours, or damaged.
    pub(super) fn decode(bytes: [u8; HEADER_BYTES]) -> Result<Self, Fault> {
        let raw: RawHeader = zerocopy::transmute!(bytes);
        if raw.magic != MAGIC {
            return Err(Fault::Corrupt("the start of the soup header"));
        }
        if raw.checksum != raw.own_checksum() {
            return Err(Fault::Corrupt("the checksum of the soup header"));
        }
        if raw.version != VERSION || raw.flags & !(COLORS | BOUNDS | DOUBLE) != 0 {
            return Err(Fault::Unsupported("this version of the soup format"));
        }
        if !raw.origin.iter().chain(raw.bounds.as_flattened()).all(|number| number.is_finite()) {
            return Err(Fault::NotFinite);
        }
        Ok(Self {
            colors: raw.flags & COLORS != 0,
            double: raw.flags & DOUBLE != 0,
            count: (raw.count != COUNT_UNKNOWN).then_some(raw.count),
            origin: raw.origin,
            bounds: (raw.flags & BOUNDS != 0).then_some(raw.bounds),
        })
    }
}

impl RawHeader {
    fn own_checksum(&self) -> u32 {
        crc32fast::hash(&self.as_bytes()[..HEADER_BYTES - size_of::<u32>()])
    }
}

impl Trailer {
    pub(super) fn new(count: u64, checksum: u32) -> Self {
        Self { magic: TRAILER_MAGIC, count, checksum, reserved: 0 }
    }

    /// The trailer in a record, if it is one.
    pub(super) fn decode(record: &[u8]) -> Option<Self> {
        let (trailer, zeros) = Self::read_from_prefix(record).ok()?;
        let valid = trailer.magic == TRAILER_MAGIC
            && trailer.reserved == 0
            && zeros.iter().all(|&byte| byte == 0);
        valid.then_some(trailer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header() -> Header {
        Header {
            colors: true,
            double: true,
            count: Some(7),
            origin: [1.0, 2.0, 3.0],
            bounds: Some([[-1.0; 3], [4.0; 3]]),
        }
    }

    #[test]
    fn a_header_says_the_same_after_a_round_trip() {
        let unknown = Header { count: None, bounds: None, ..header() };
        for header in [header(), unknown] {
            assert_eq!(Header::decode(header.encode()).unwrap(), header);
        }
    }

    #[test]
    fn no_flipped_bit_of_a_header_passes() {
        let bytes = header().encode();
        for bit in 0..HEADER_BYTES * 8 {
            let mut damaged = bytes;
            damaged[bit / 8] ^= 1 << (bit % 8);
            Header::decode(damaged).unwrap_err();
        }
    }

    #[test]
    fn a_trailer_is_told_from_a_triangle() {
        let mut record = [0; 36];
        record[..TRAILER_BYTES].copy_from_slice(Trailer::new(9, 5).as_bytes());
        assert_eq!(Trailer::decode(&record), Some(Trailer::new(9, 5)));
        record[35] = 1;
        assert_eq!(Trailer::decode(&record), None);
        assert_eq!(Trailer::decode(&[0; 36]), None);
    }
}
