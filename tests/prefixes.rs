//! Inputs that end early: every prefix of a small file of every format, with both policies, is a
//! fault, except where the format does not say where a file ends.

use std::io::{BufReader, Cursor, Write as _};

use meshmill::{
    error::{Fault, InputFault},
    formats::{
        Batch, Compression, Content, Counts, Encoder, Format, OnDefect, Precision, WriteOptions,
    },
};

use crate::meshes::{self, Whole};

const ASCII_PLY: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\n\
    property float y\nproperty float z\nelement face 2\nproperty list uchar int vertex_indices\n\
    end_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n4 0 1 2 3\n";
const ASCII_STL: &str = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n\
    vertex 0 1 0\nendloop\nendfacet\nendsolid a\n";
const OFF: &str = "OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n4 0 1 2 3\n";

/// A complete file and the first length at which it says all it has to say.
struct Sample {
    format: Format,
    bytes: Vec<u8>,
    enough: usize,
}

fn samples() -> Vec<Sample> {
    let whole = |format, bytes: Vec<u8>| Sample { format, enough: bytes.len(), bytes };
    let text = |format, text: &str, enough| Sample { format, bytes: text.into(), enough };
    vec![
        whole(Format::Ply, written(Format::Ply, true)),
        whole(Format::Stl, written(Format::Stl, true)),
        whole(Format::Soup, written(Format::Soup, true)),
        // The count is not known when the header is written: a trailer ends the file.
        whole(Format::Soup, written(Format::Soup, false)),
        // Without the last line end, or the name behind "endsolid", nothing is missing.
        text(Format::Ply, ASCII_PLY, ASCII_PLY.len() - 1),
        text(Format::Off, OFF, OFF.len() - 1),
        text(Format::Stl, ASCII_STL, ASCII_STL.len() - 3),
    ]
}

/// Two triangles.
fn written(format: Format, is_count_known: bool) -> Vec<u8> {
    let positions = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.5]];
    let mut faces = Batch { content: Content::Faces, ..Batch::default() };
    faces.faces.push(&[0, 1, 2]);
    faces.faces.push(&[0, 2, 3]);
    let batches = if matches!(format, Format::Ply) {
        vec![Batch { positions, ..Batch::default() }, faces]
    } else {
        let corners = faces.faces.corners.iter().map(|&index| positions[index as usize]);
        let positions = corners.collect();
        vec![Batch { content: Content::Soup, positions, ..Batch::default() }]
    };
    let options = WriteOptions { precision: Precision::Single, origin: [0.0; 3], colors: false };
    let counts = is_count_known.then_some(Counts { vertices: 4, triangles: 2 });
    meshes::write(format, counts, &options, &batches)
}

fn read(
    format: Format,
    bytes: &[u8],
    on_defect: OnDefect,
    size_bytes: Option<u64>,
) -> Result<Whole, InputFault> {
    let input = Box::new(BufReader::with_capacity(5, Cursor::new(bytes.to_vec())));
    meshes::read(input, Some(format), &meshes::options(on_defect, size_bytes))
}

#[test]
fn every_prefix_of_every_format_fails_and_skipping_changes_nothing() {
    for Sample { format, bytes, enough } in samples() {
        for end in 0..=bytes.len() {
            let prefix = &bytes[..end];
            for size_bytes in [None, Some(end as u64)] {
                let fail = read(format, prefix, OnDefect::Fail, size_bytes);
                let skip = read(format, prefix, OnDefect::Skip, size_bytes);
                assert_eq!(format!("{fail:?}"), format!("{skip:?}"), "{format:?} {end}");
                assert_eq!(fail.is_ok(), end >= enough, "{format:?} {end}: {fail:?}");
                if let Err(InputFault { fault, .. }) = fail {
                    let is_about_the_end = matches!(
                        fault,
                        Fault::Empty
                            | Fault::Truncated { .. }
                            | Fault::CountImpossible { .. }
                            | Fault::Syntax { .. }
                    );
                    assert!(is_about_the_end, "{format:?} {end}: {fault:?}");
                }
            }
        }
    }
}

#[test]
fn every_prefix_of_an_obj_gives_no_more_than_the_whole() {
    let text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0 \nf 1 2 \\\n3\nf 1//1 2//2 3//3 4//4\n";
    for end in 1..=text.len() {
        for on_defect in [OnDefect::Fail, OnDefect::Skip] {
            let prefix = &text.as_bytes()[..end];
            // OBJ does not say where it ends: a line may, wherever it is still a statement.
            if let Ok(whole) = read(Format::Obj, prefix, on_defect, None) {
                assert!(whole.positions.len() <= 4 && whole.faces.len() <= 2, "{end}");
            }
        }
    }
}

#[test]
fn every_prefix_of_a_compressed_file_fails_and_skipping_changes_nothing() {
    for compression in [Compression::Gzip, Compression::Zstd] {
        for Sample { format, bytes, .. } in samples() {
            let mut encoder = Encoder::new(compression, Vec::new()).unwrap();
            encoder.write_all(&bytes).unwrap();
            let compressed = encoder.finish().unwrap();
            for end in 0..=compressed.len() {
                for on_defect in [OnDefect::Fail, OnDefect::Skip] {
                    let outcome = read(format, &compressed[..end], on_defect, Some(end as u64));
                    let is_whole = end == compressed.len();
                    assert_eq!(outcome.is_ok(), is_whole, "{compression:?} {format:?} {end}");
                }
            }
        }
    }
}
