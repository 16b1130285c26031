//! The files in testdata/progressive, which the viewer is tested with, too: a good one of each kind,
//! and one for each thing that can be wrong.

use std::fs;

use assert_cmd::Command;
use meshmill::{
    formats::{
        Format,
        progressive::{
            Base, Channels, Deviation, Header, Kind, Split, pack_base, pack_batch, write,
        },
    },
    stages::convert::refine::Detail,
};

use super::refined;
use crate::command::{Folder, Surface};

fn testdata(name: &str) -> String {
    format!("{}/testdata/progressive/{name}", env!("CARGO_MANIFEST_DIR"))
}

/// What the command makes of hills, with colours or without.
fn made(surface: &Surface) -> Vec<u8> {
    let folder = Folder::new();
    folder.write("in.ply", surface.bytes(Format::Ply));
    folder.done("progressive in.ply -o - --output-format pm --base 40 -q")
}

/// An octahedron with one split after it, given.
fn octahedron_with(split: Split) -> Vec<u8> {
    let positions = vec![[8, 8, 15], [15, 8, 8], [8, 15, 8], [0, 8, 8], [8, 0, 8], [8, 8, 0]];
    let sides = [[1, 2], [2, 3], [3, 4], [4, 1]];
    let faces = sides.iter().flat_map(|&[a, b]| [[0, a, b], [5, b, a]]).collect();
    let base = Base { positions, faces, ..Base::default() };
    let header = Header::of_grid(Channels::None, 4, [0.0; 3], 1.0);
    let base = pack_base(&base, 4, Channels::None).unwrap();
    let batch = pack_batch(&[split], 4, Channels::None);
    let blocks = [(base, Deviation { rms: 1.0, max: 2.0 }), (batch, Deviation::default())];
    let mut bytes = Vec::new();
    write(&mut bytes, &header, &blocks).unwrap();
    bytes
}

/// Overwrites bytes of a header, and mends its checksum.
fn with_header(mut bytes: Vec<u8>, at: usize, new: &[u8]) -> Vec<u8> {
    bytes[at..at + new.len()].copy_from_slice(new);
    let checksum = crc32fast::hash(&bytes[..124]);
    bytes[124..128].copy_from_slice(&checksum.to_le_bytes());
    bytes
}

/// Name, bytes and, of what is not whole, what is said of it.
fn all() -> Vec<(&'static str, Vec<u8>, Option<&'static str>)> {
    let hills = made(&Surface::hills(12));
    let colored = made(&Surface::hills(8).colored());
    let split = Split { parent: 0, first: 1, taken: 2, step: [0, 0, 1], ..Split::default() };
    let payload = 128 + 32;
    let damaged = |at: usize| {
        let mut bytes = hills.clone();
        bytes[at] ^= 0x10;
        bytes
    };
    let length = u32::from_le_bytes(hills[128..132].try_into().unwrap()) as usize;
    let base_end = payload + length;
    vec![
        ("hills.pm", hills.clone(), None),
        ("hills-colored.pm", colored, None),
        ("octahedron.pm", octahedron_with(split), None),
        ("cut-in-batch.pm", hills[..hills.len() - 100].to_vec(), None),
        ("cut-in-header.pm", hills[..100].to_vec(), Some("ends inside the header")),
        ("cut-in-base.pm", hills[..base_end - 9].to_vec(), Some("ends inside the base")),
        ("bad-magic.pm", damaged(3), Some("the first bytes of a progressive mesh")),
        ("future-version.pm", with_header(hills.clone(), 8, &[2]), Some("this version")),
        ("bad-header.pm", damaged(50), Some("the checksum of the header")),
        ("bad-base.pm", damaged(payload + 40), Some("the checksum of the block")),
        ("bad-batch.pm", damaged(hills.len() - 40), Some("the checksum of the block")),
        ("bad-head.pm", damaged(base_end + 9), Some("the checksum of the block's head")),
        (
            "counts-that-lie.pm",
            with_header(hills.clone(), 24, &1_000_000_u32.to_le_bytes()),
            Some("the counts in the header"),
        ),
        (
            "parent-out-of-range.pm",
            octahedron_with(Split { parent: 6, ..split }),
            Some("index 6 is out of range"),
        ),
        (
            "sector-out-of-range.pm",
            octahedron_with(Split { taken: 4, ..split }),
            Some("the faces that a split takes"),
        ),
        (
            "sector-beyond.pm",
            octahedron_with(Split { first: 4, ..split }),
            Some("the first face of a split"),
        ),
        (
            "end-of-a-closed-fan.pm",
            octahedron_with(Split { first: 0, kind: Kind::First, ..split }),
            Some("the ends of a closed fan"),
        ),
    ]
}

#[test]
fn they_are_what_they_were() {
    for (name, bytes, _) in all() {
        assert!(fs::read(testdata(name)).is_ok_and(|found| found == bytes), "{name} changed");
    }
}

#[test]
fn each_is_a_mesh_or_an_error_with_a_place() {
    let folder = Folder::new();
    for (name, _, fault) in all() {
        let line = format!("refine {} -o a.ply --force", testdata(name));
        let Some(fault) = fault else {
            folder.done(&line);
            continue;
        };
        let folder = Folder::new();
        let said = folder.fails(&line, 3);
        assert!(said.contains(fault) && said.contains("byte"), "{name}: {said}");
        assert!(said.contains(name), "{name}: {said}");
    }
}

#[test]
fn no_damaged_byte_is_more_than_an_error() {
    let bytes = made(&Surface::hills(6).colored());
    let whole = refined(&bytes, Detail::All).unwrap();
    for at in 0..bytes.len() {
        for bit in [0, 3, 7] {
            let mut damaged = bytes.clone();
            damaged[at] ^= 1 << bit;
            assert!(refined(&damaged, Detail::All).is_err(), "{at}: every byte is checked");
        }
    }
    assert_eq!(whole.mesh.faces().len(), 72);
}

#[test]
#[ignore = "writes testdata/progressive anew: for changes of the format"]
fn they_are_written_anew() {
    fs::create_dir_all(testdata("")).unwrap();
    for (name, bytes, _) in all() {
        fs::write(testdata(name), bytes).unwrap();
    }
}

#[test]
fn help_names_both_commands() {
    let help = Command::cargo_bin("meshmill").unwrap().arg("--help").assert().success();
    let text = String::from_utf8(help.get_output().stdout.clone()).unwrap();
    assert!(text.contains("progressive") && text.contains("refine"), "{text}");
}
