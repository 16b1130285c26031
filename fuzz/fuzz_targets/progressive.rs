//! Any bytes, read as a progressive mesh; also with all checksums made right, and as the columns of a
//! batch behind a good base, which chance does not find.
#![no_main]

use std::io::Cursor;

use libfuzzer_sys::fuzz_target;
use meshmill::{
    Error,
    formats::progressive::Reader,
    mesh::progressive::{Growing, HalfEdges},
    progress::Monitor,
    soup::InputPath,
    stages::convert::refine::{Detail, refine},
    storage::Budget,
};

/// Bytes of the header, and of the head of a block (docs/FORMATS.md).
const HEADER_BYTES: usize = 128;
const HEAD_BYTES: usize = 32;
/// Larger bases take long, and say nothing new.
const BASE_FACES_MAX: u32 = 100_000;

fuzz_target!(|bytes: &[u8]| {
    check(bytes);
    check(&mended(bytes));
    if let [splits @ 1..=16, faces, columns @ ..] = bytes {
        check(&batch_behind_base(*splits, *faces, columns));
    }
});

/// What is read is a mesh, or refused as an input.
fn check(bytes: &[u8]) {
    let Ok(reader) = Reader::open(Cursor::new(bytes.to_vec())) else { return };
    let header = reader.header();
    if header.base_faces > BASE_FACES_MAX || header.base_vertices > BASE_FACES_MAX {
        return;
    }
    let half = Detail::Triangles(u64::from(header.base_faces.midpoint(header.faces)));
    for detail in [Detail::All, half, Detail::Share(0.01)] {
        let input = Cursor::new(bytes.to_vec());
        // As much as any count in a header asks for.
        let budget = Budget::new(1 << 40);
        match refine(input, &InputPath::Stdin, detail, &budget, &Monitor::silent()) {
            Ok(outcome) => check_mesh(&outcome.mesh),
            Err(Error::Input { .. }) => {}
            Err(error) => panic!("memory can be read: {error}"),
        }
    }
}

fn check_mesh(mesh: &Growing) {
    let vertices = mesh.positions().len();
    for [a, b, c] in mesh.faces() {
        assert!([a, b, c].iter().all(|vertex| (**vertex as usize) < vertices));
        assert!(a != b && b != c && c != a, "a face has three corners");
    }
    assert!(mesh.colors().is_empty() || mesh.colors().len() == vertices);
    let fresh = HalfEdges::of_faces(vertices, mesh.faces());
    assert!(mesh.half_edges().is_as(&fresh), "half-edges follow from the faces");
}

fn put(bytes: &mut [u8], at: usize, number: u32) {
    bytes[at..at + 4].copy_from_slice(&number.to_le_bytes());
}

fn get(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

/// The same with the first bytes and all checksums made right.
fn mended(bytes: &[u8]) -> Vec<u8> {
    let mut mended = bytes.to_vec();
    if mended.len() < HEADER_BYTES {
        return mended;
    }
    mended[..12].copy_from_slice(b"\x89MMPROG\n\x01\0\0\0");
    let length = mended.len() as u64;
    mended[16..24].copy_from_slice(&length.to_le_bytes());
    let checksum = crc32fast::hash(&mended[..HEADER_BYTES - 4]);
    put(&mut mended, HEADER_BYTES - 4, checksum);
    let mut at = HEADER_BYTES;
    while at + HEAD_BYTES <= mended.len() {
        let start = at + HEAD_BYTES;
        let end = start.saturating_add(get(&mended, at) as usize).min(mended.len());
        let checksum = crc32fast::hash(&mended[start..end]);
        put(&mut mended, at + 24, checksum);
        let checksum = crc32fast::hash(&mended[at..at + HEAD_BYTES - 4]);
        put(&mut mended, at + HEAD_BYTES - 4, checksum);
        at = end.max(start);
    }
    mended
}

/// A file of a small base with a boundary, and one batch of these columns.
fn batch_behind_base(splits: u8, faces: u8, columns: &[u8]) -> Vec<u8> {
    // 6---7---8
    // | \ | \ |
    // 3---4---5
    // | \ | \ |
    // 0---1---2
    let mut base: Vec<u8> = vec![0; 9 * 3];
    for corner in [[0, 1, 3], [1, 4, 3], [1, 2, 4], [2, 5, 4], [3, 4, 6], [4, 7, 6], [4, 5, 7], [5, 8, 7]]
        .as_flattened()
        .iter()
        .scan(0_i32, |before, corner| Some(corner - std::mem::replace(before, *corner)))
    {
        base.push(((corner << 1) ^ (corner >> 31)) as u8);
    }
    let mut file = vec![0; HEADER_BYTES];
    let (splits, faces) = (u32::from(splits), u32::from(faces));
    for (at, number) in
        [(24, 9 + splits), (28, 8 + faces), (32, 9), (36, 8), (40, 1), (44, 8)]
    {
        put(&mut file, at, number);
    }
    file[72..80].copy_from_slice(&1.0_f64.to_le_bytes());
    for (raw, vertices, faces) in [(&base[..], 9, 8), (columns, splits, faces)] {
        let raw = &raw[..raw.len().min(u16::MAX.into())];
        let length = raw.len() as u16;
        let mut head = [0; HEAD_BYTES];
        for (at, number) in
            [(0, u32::from(length) + 5), (4, length.into()), (8, vertices), (12, faces)]
        {
            put(&mut head, at, number);
        }
        file.extend(head);
        // A stored block of DEFLATE.
        file.push(1);
        file.extend(length.to_le_bytes());
        file.extend((!length).to_le_bytes());
        file.extend(raw);
    }
    mended(&file)
}
