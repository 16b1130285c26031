//! OBJ through the front door.

use super::Writer;
use crate::{
    error::{Fault, InputFault},
    formats::{
        Batch, Content, DefectKind, Format, MeshWriter, Precision, ReadOptions, WriteOptions,
        probe::{FAIL, SKIP, Seen, read as read_bytes},
    },
};

const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

fn read(text: &str, options: &ReadOptions) -> Result<Seen, InputFault> {
    read_bytes(text.as_bytes(), Format::Obj, options)
}

fn faces(lines: &str) -> Vec<Vec<u64>> {
    read(&format!("{SQUARE}{lines}"), &FAIL).unwrap().faces()
}

#[test]
fn what_is_written_comes_back() {
    let positions: Vec<[f32; 3]> =
        (0..40_000_u32).map(|n| [n as f32 * 0.1, 1.0 / (n as f32 + 3.0), -1e-20]).collect();
    let colors = (0..40_000_u32).map(|n| [n as u8, (n >> 3) as u8, 255 - n as u8, 255]).collect();
    let vertices = Batch { positions, colors, ..Batch::default() };
    let mut triangles = Batch { content: Content::Faces, ..Batch::default() };
    for first in 0..39_998 {
        triangles.faces.push(&[first, first + 1, first + 2]);
    }
    for colors in [false, true] {
        let options = WriteOptions { precision: Precision::Single, origin: [0.0; 3], colors };
        let mut bytes = Vec::new();
        let mut writer = Writer::new(&mut bytes, &options).unwrap();
        writer.write_batch(&vertices).unwrap();
        writer.write_batch(&triangles).unwrap();
        writer.finish().unwrap();
        let seen = read_bytes(&bytes, Format::Obj, &FAIL).unwrap();
        assert_eq!(seen.positions(), vertices.positions);
        assert_eq!(seen.colors(), if colors { vertices.colors.clone() } else { Vec::new() });
        assert!(seen.faces().iter().map(Vec::as_slice).eq(triangles.faces.iter()));
    }
}

#[test]
fn doubles_far_from_zero_come_back_bit_by_bit() {
    let first = read("v 500000.123456 5400000.5 -0.1\nv 500001.7 5400100.25 3\n", &FAIL).unwrap();
    assert!(first.declared.double);
    let options =
        WriteOptions { precision: Precision::Double, origin: first.origin.get(), colors: false };
    let mut bytes = Vec::new();
    let mut writer = Writer::new(&mut bytes, &options).unwrap();
    writer.write_batch(&first.batches[0]).unwrap();
    writer.finish().unwrap();
    let again = read_bytes(&bytes, Format::Obj, &FAIL).unwrap();
    assert_eq!((again.positions(), again.origin), (first.positions(), first.origin));
}

#[test]
fn corners_are_read_in_all_their_spellings() {
    let square = vec![vec![0, 1, 2, 3]];
    for line in [
        "f 1 2 3 4",
        "f 1/1 2/1 3/1 4/1",
        "f 1//9 2//9 3//9 4//9\r\n",
        "  f\t1/2/3 2/2/3\t3/2/3 4/-1/-1 \n",
        "f -4 -3 -2 -1",
        "f 1 2 3 4 # all of it",
        "f 1 2 \\\n3 \\\r\n 4\n",
        "fo 1 2 3 4 \n",
    ] {
        assert_eq!(faces(line), square, "{line}");
    }
    assert_eq!(faces("f 1 2 3\nf 1 2 3 4\nf 4 2 1\n").len(), 3);
}

#[test]
fn line_ends_and_blanks_do_not_matter() {
    let text = format!("# a\n\n{SQUARE}g a b\ns off\no\nf 1 2 3\n   f 3 4 1");
    let expected = read(&text, &FAIL).unwrap();
    assert_eq!((expected.positions().len(), expected.faces().len()), (4, 2));
    let mark = format!("\u{feff}{text}");
    let variants = [
        text.replace('\n', "\r\n"),
        text.replace('\n', "\r"),
        mark,
        text.replace(' ', " \t "),
        text.replace(" 0\n", " \\\n 0 # zero\n"),
    ];
    for text in variants {
        assert_eq!(read(&text, &FAIL).unwrap(), expected, "{text}");
    }
}

#[test]
fn faces_may_come_first_and_between() {
    let seen = read("f 1 2 3\nv 0 0 0\nv 1 0 0\nf 2 3 4\nv 0 1 0\nv 0 0 1\nf -1 -2 -3\n", &FAIL);
    let seen = seen.unwrap();
    assert_eq!(seen.faces(), [[0, 1, 2], [1, 2, 3], [3, 2, 1]]);
    let kinds: Vec<_> = seen.batches.iter().map(|batch| batch.content).collect();
    let (v, f) = (Content::Vertices, Content::Faces);
    assert_eq!(kinds, [f, v, f, v, f]);
}

#[test]
fn an_index_out_of_range_is_known_with_its_face_and_line() {
    let late = format!("{SQUARE}f 1 2 3\nf 1 2 9\nf 1 2 5\n");
    let zero = format!("{SQUARE}f 1 2 3\nf 0 1 2\n");
    let before = format!("{SQUARE}f 1 2 3\nf -1 -2 -5\nv 0 0 0\n");
    for (text, wrong) in [(late, 9), (zero, 0), (before, -5)] {
        let bad = read(&text, &FAIL).unwrap_err();
        assert_eq!(bad.fault, Fault::IndexOutOfRange { index: wrong, vertices: 4 });
        assert_eq!((bad.at.line, bad.at.record), (Some(6), Some(1)), "{text}");
        let seen = read(&text, &SKIP).unwrap();
        // What is known to be wrong at once is left out; the rest is for the end to tell.
        assert_eq!(seen.faces().len() as u64, if wrong == 9 { 3 } else { 1 });
        assert_eq!(seen.findings.count(DefectKind::IndexOutOfRange), u64::from(wrong != 9));
    }
    let largest = format!("{SQUARE}f 1 2 9223372036854775807\n");
    assert!(matches!(read(&largest, &FAIL).unwrap_err().fault, Fault::IndexOutOfRange { .. }));
    let joined = format!("{SQUARE}f 1 2 \\\n 9\n");
    assert_eq!(read(&joined, &FAIL).unwrap_err().at.line, Some(5));
}

#[test]
fn what_is_malformed_is_placed_by_its_line() {
    for (line, wanted) in [
        ("v 0 0", "a coordinate"),
        ("v", "a coordinate"),
        ("v 1 2 3.1+e2", "a coordinate"),
        ("v 1 2 x", "a coordinate"),
        ("v 1 2 3 4 5", "a colour of three numbers"),
        ("v 1 2 3 4 5 6 7 8", "the end of the line"),
        ("v 1 2 3 red", "a weight or a colour"),
        ("f 1 2 x", "a vertex index"),
        ("f 1 2 3.0", "a vertex index"),
        ("f 1 2 3,4", "a vertex index"),
        ("f 1/a 2 3", "a vertex index"),
        ("f 1 2 99999999999999999999", "a vertex index"),
        ("1 2 3", "an OBJ statement"),
    ] {
        let bad = read(&format!("{SQUARE}{line}\n"), &FAIL).unwrap_err();
        let right = matches!(&bad.fault, Fault::Syntax { expected, .. } if *expected == wanted);
        assert!(right && bad.at.line == Some(5), "{line}: {bad:?}");
    }
    for cut in ["v 0 0", "v", "f", "f 1 2", "f 1 2 \\", "f 1 2 3 \\\n"] {
        let bad = read(&format!("{SQUARE}{cut}"), &FAIL).unwrap_err();
        assert!(matches!(bad.fault, Fault::Truncated { .. }), "{cut:?}: {bad:?}");
    }
}

#[test]
fn vertices_that_are_not_finite_fail_or_stay_as_nan() {
    let text = "v nan 0 0\nv 1 2 3\nv 0 -inf 0\nv 0 0 1e60\nf 1 2 3\n";
    let bad = read(text, &FAIL).unwrap_err();
    assert_eq!((bad.fault, bad.at.line, bad.at.record), (Fault::NotFinite, Some(1), Some(0)));
    let seen = read(text, &SKIP).unwrap();
    assert_eq!(seen.findings.count(DefectKind::NotFinite), 3);
    let marked: Vec<bool> =
        seen.positions().iter().map(|position| position.iter().all(|c| c.is_nan())).collect();
    assert_eq!(marked, [true, false, true, true]);
}

#[test]
fn colours_come_in_two_ranges_and_with_or_without_a_weight() {
    let small = read("v 0 0 0 1 0.5 0\nv 0 0 0\nv 0 0 0 2 1 0 1\n", &FAIL).unwrap();
    assert!(small.declared.colors);
    assert_eq!(small.colors(), [[255, 128, 0, 255], [255; 4], [255, 0, 255, 255]]);
    assert_eq!(small.findings.dropped, ["vertex weights"]);
    let large = read("v 0 0 0 1 0 0\nv 0 0 0 200 300 -1\n", &FAIL).unwrap();
    assert_eq!(large.colors(), [[1, 0, 0, 255], [200, 255, 0, 255]]);
    let late = read("v 0 0 0\nf 1 1 1\nv 0 0 0 1 1 1\nv 0 0 0 1\n", &FAIL).unwrap();
    assert!(!late.declared.colors && late.colors().is_empty());
    assert_eq!(late.findings.dropped, ["vertex colours (the first vertices have none)"]);
}

#[test]
fn what_is_not_carried_is_named() {
    let text = format!(
        "mtllib a b.mtl\n{SQUARE}vt 0 0\nvn 0 0 1 \\\n 7\nvp 1\nusemtl x\ng a \\\nv 1\ns 1\n\
         l 1 2\np 1\nhello_there 1\nf 1/1/1 2 3\n# ends so: C:\\\nf 1 2 3\n"
    );
    let seen = read(&text, &FAIL).unwrap();
    let names = [
        "texture coordinates",
        "normals",
        "free-form curves and surfaces",
        "materials",
        "line elements",
        "point elements",
        "statement \"hello_there\"",
    ];
    assert_eq!(seen.findings.dropped, names);
    assert_eq!((seen.positions().len(), seen.faces().len()), (4, 2));
}

#[test]
fn a_face_without_area_by_its_corner_count_is_a_defect_and_left_out() {
    let seen = read(&format!("{SQUARE}f 1 2\nf\nf 1 2 3\n"), &FAIL).unwrap();
    assert_eq!(seen.findings.count(DefectKind::TooFewCorners), 2);
    assert_eq!(seen.findings.defects[0].first.line, Some(5));
    assert_eq!(seen.faces(), [[0, 1, 2]]);
}

#[test]
fn every_prefix_ends_well_or_with_a_fault() {
    let text = format!("# c\r\n{SQUARE}vt 1 2\r\nf 1/1 2/1 \\\n 3/1\nf -1 -2 -3 -4\r\n");
    for end in 0..=text.len() {
        for options in [FAIL, SKIP] {
            // Both are right: OBJ does not say where it ends. `read` compares piece sizes.
            let _ = read(&text[..end], &options);
        }
    }
}

#[test]
fn text_in_utf_16_is_refused_by_name() {
    let bytes: Vec<u8> = SQUARE.encode_utf16().flat_map(u16::to_be_bytes).collect();
    let bad = read_bytes(&bytes, Format::Obj, &FAIL).unwrap_err();
    assert_eq!(bad.fault, Fault::Unsupported("UTF-16 text"));
}
