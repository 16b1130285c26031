//! Any bytes, read as the manifest of a workspace; also as the JSON of one whose first line is made
//! right, which chance does not find.
#![no_main]

use libfuzzer_sys::fuzz_target;
use meshmill::storage::Manifest;

fuzz_target!(|bytes: &[u8]| {
    check(bytes);
    let checksum = crc32fast::hash(bytes);
    // The first line of an empty one says the version.
    let empty = Manifest::default().to_bytes();
    let line = empty.split(|byte| *byte == b'\n').next().unwrap_or_default();
    let words: Vec<&[u8]> = line.split(|byte| *byte == b' ').collect();
    let mut mended = [words[0], b" ", words[1]].concat();
    mended.extend(format!(" {} {checksum:08x}\n", bytes.len()).into_bytes());
    mended.extend(bytes);
    check(&mended);
});

/// What is read is what would be written, and names no file outside of its folder.
fn check(bytes: &[u8]) {
    let Ok(manifest) = Manifest::from_bytes(bytes) else { return };
    assert_eq!(Manifest::from_bytes(&manifest.to_bytes()), Ok(manifest.clone()));
    assert!(manifest.differences(&manifest.job).is_empty());
    for file in manifest.files() {
        assert!(!file.name.contains('/'), "{}", file.name);
    }
}
