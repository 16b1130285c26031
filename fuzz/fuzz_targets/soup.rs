//! Any bytes, read as our own soup; also with the checksum of the header made right, which chance
//! does not find.
#![no_main]

use libfuzzer_sys::fuzz_target;
use meshmill::formats::Format;

/// Bytes of the header before its checksum (docs/FORMATS.md).
const CHECKED_BYTES: usize = 124;

fuzz_target!(|bytes: &[u8]| {
    meshmill_fuzz::check(Some(Format::Soup), bytes);
    if bytes.len() >= CHECKED_BYTES + 4 {
        let mut mended = bytes.to_vec();
        mended[..12].copy_from_slice(b"\x89MMSOUP\n\x01\0\0\0");
        // Two flags and the reserved bytes leave little to find: keep what can be valid.
        mended[12] &= 7;
        mended[13..16].fill(0);
        mended[96..CHECKED_BYTES].fill(0);
        let checksum = crc32fast::hash(&mended[..CHECKED_BYTES]);
        mended[CHECKED_BYTES..CHECKED_BYTES + 4].copy_from_slice(&checksum.to_le_bytes());
        meshmill_fuzz::check(Some(Format::Soup), &mended);
    }
});
