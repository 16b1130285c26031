//! STL through the front door.

use super::{HEADER_BYTES, TRIANGLE_BYTES, Writer};
use crate::{
    error::{Fault, Position},
    formats::{
        DefectKind, Format, FormatError, MeshWriter, Origin, Precision, ReadOptions, WriteOptions,
        probe::{FAIL, SKIP, fault, read, soup},
    },
};

const PLAIN: WriteOptions =
    WriteOptions { precision: Precision::Single, origin: [0.0; 3], colors: false };

fn binary(triangles: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut writer = Writer::new(&mut bytes, Some(triangles as u64), &PLAIN).unwrap();
    writer.write_batch(&soup(triangles)).unwrap();
    assert_eq!(writer.finish().unwrap(), None);
    bytes
}

fn sized(bytes: &[u8]) -> ReadOptions {
    ReadOptions { size_bytes: Some(bytes.len() as u64), ..FAIL }
}

fn set_count(bytes: &mut [u8], count: u32) {
    bytes[80..84].copy_from_slice(&count.to_le_bytes());
}

/// One facet whose corners have `x` as their first coordinate.
fn facet(x: &str) -> String {
    let vertex = |y| format!("vertex {x} {y} 0\n");
    let loop_ = [vertex("0"), vertex("1"), vertex("2.5")].concat();
    format!("facet normal 0 0 nan\nouter loop\n{loop_}endloop\nendfacet\n")
}

#[test]
fn a_binary_soup_comes_back_with_or_without_its_size() {
    for triangles in [0, 1, 3, 40_000] {
        let bytes = binary(triangles);
        assert_eq!(bytes.len(), HEADER_BYTES + triangles * TRIANGLE_BYTES);
        for options in [FAIL, sized(&bytes)] {
            let seen = read(&bytes, Format::Stl, &options).unwrap();
            assert_eq!(seen.positions(), soup(triangles).positions);
            assert_eq!(seen.declared.faces, Some(triangles as u64));
            assert_eq!(seen.findings.defects, []);
        }
    }
}

#[test]
fn every_prefix_of_a_binary_file_fails() {
    let bytes = binary(3);
    for end in 0..bytes.len() {
        let prefix = &bytes[..end];
        read(prefix, Format::Stl, &FAIL).unwrap_err();
        read(prefix, Format::Stl, &sized(prefix)).unwrap_err();
    }
}

#[test]
fn a_cut_record_is_truncation_and_a_missing_one_a_wrong_count() {
    let bytes = binary(3);
    for options in [FAIL, sized(&bytes[..200])] {
        let cut = read(&bytes[..200], Format::Stl, &options).unwrap_err();
        assert_eq!(cut.at, Position::byte(200).in_record(2));
        assert!(matches!(cut.fault, Fault::Truncated { .. }));
    }
    for options in [FAIL, sized(&bytes[..184])] {
        let short = read(&bytes[..184], Format::Stl, &options).unwrap_err();
        assert!(matches!(short.fault, Fault::CountImpossible { count: 3, limit: 2, .. }));
    }
}

#[test]
fn a_count_that_was_never_set_is_a_defect_and_the_data_counts() {
    for count in [0, u32::MAX] {
        let mut bytes = binary(3);
        set_count(&mut bytes, count);
        for options in [FAIL, sized(&bytes)] {
            let seen = read(&bytes, Format::Stl, &options).unwrap();
            assert_eq!(seen.positions(), soup(3).positions);
            assert_eq!(seen.findings.count(DefectKind::CountUnset), 1);
            assert_eq!(seen.declared.faces, None);
        }
        bytes.truncate(200);
        assert!(matches!(fault(&bytes, Format::Stl), Fault::Truncated { .. }));
    }
}

#[test]
fn bytes_after_the_last_triangle_are_counted() {
    let mut bytes = binary(2);
    bytes.extend([7; 20]);
    let seen = read(&bytes, Format::Stl, &sized(&bytes)).unwrap();
    assert_eq!(seen.findings.count(DefectKind::TrailingBytes), 20);
    let mut none = binary(0);
    none.push(0);
    let seen = read(&none, Format::Stl, &FAIL).unwrap();
    assert_eq!(seen.findings.count(DefectKind::TrailingBytes), 1);
}

#[test]
fn a_binary_file_that_begins_with_solid_is_binary() {
    let mut bytes = binary(3);
    bytes[..39].copy_from_slice(b"solid by a CAD\nfacet normal 0 0 0 outer");
    for options in [FAIL, sized(&bytes)] {
        assert_eq!(read(&bytes, Format::Stl, &options).unwrap().positions(), soup(3).positions);
    }
}

#[test]
fn attribute_bytes_are_named_as_dropped() {
    let mut bytes = binary(3);
    bytes[84 + 98] = 1;
    let seen = read(&bytes, Format::Stl, &FAIL).unwrap();
    assert_eq!(seen.findings.dropped, ["face colours (attribute bytes)"]);
}

#[test]
fn triangles_that_are_not_finite_fail_or_are_left_out() {
    let mut bytes = binary(3);
    bytes[84 + 50 + 12..][..4].copy_from_slice(&f32::NAN.to_le_bytes());
    let bad = read(&bytes, Format::Stl, &FAIL).unwrap_err();
    assert_eq!((bad.at, bad.fault), (Position::byte(134).in_record(1), Fault::NotFinite));
    let seen = read(&bytes, Format::Stl, &SKIP).unwrap();
    assert_eq!(seen.findings.count(DefectKind::NotFinite), 1);
    assert_eq!(seen.positions().len(), 6);
}

#[test]
fn a_binary_file_follows_the_origin_of_the_file_before_it() {
    let options = ReadOptions { origin: Origin::at([1024.0, 0.0, -2048.0]), ..FAIL };
    let seen = read(&binary(1), Format::Stl, &options).unwrap();
    assert_eq!(seen.positions()[1], [1.0 - 1024.0, 0.25, -1.5 + 2048.0]);
    assert_eq!(read(&binary(1), Format::Stl, &FAIL).unwrap().origin, Origin::ZERO);
}

#[test]
fn ascii_is_read_in_any_layout() {
    let plain = format!("solid a b c\n{}{}endsolid a b c\n", facet("1"), facet("-2e1"));
    let expected = read(plain.as_bytes(), Format::Stl, &FAIL).unwrap();
    let second = [[-20.0, 0.0, 0.0], [-20.0, 1.0, 0.0], [-20.0, 2.5, 0.0]];
    assert_eq!(expected.positions()[3..], second);
    let two = format!(
        "solid\n{}endsolid\nsolid b\nendsolid b\nsolid solid c\n{}endsolid solid c",
        facet("1"),
        facet("-2e1")
    );
    let variants = [
        plain.to_uppercase(),
        plain.replace('\n', "\r\n"),
        plain.replace('\n', "\r"),
        plain.replace('\n', "\n\n \t"),
        plain.replace('\n', " "),
        plain.replace("a b c", "the facet of a solid"),
        plain.replace("a b c", "\u{e4}").replace("endsolid \u{e4}", "endsolid"),
        two.replace('\n', " "),
        two,
    ];
    for text in variants {
        let seen = read(text.as_bytes(), Format::Stl, &FAIL);
        let seen = seen.unwrap_or_else(|fault| panic!("{fault:?}\n{text}"));
        assert_eq!(seen.positions(), expected.positions(), "{text}");
        assert_eq!(seen.findings.defects, []);
    }
}

#[test]
fn every_prefix_of_an_ascii_file_fails_unless_it_ends_a_solid() {
    let first = format!("solid a\n{}endsolid a\n", facet("1"));
    let text = format!("{first}solid b\n{}endsolid", facet("2"));
    let complete = first.len() - 3..=first.len();
    for end in 0..text.len() {
        let outcome = read(&text.as_bytes()[..end], Format::Stl, &FAIL);
        let blank_after = text[..end].trim_end().len() == first.trim_end().len() - 2;
        assert_eq!(outcome.is_ok(), complete.contains(&end) || blank_after, "{:?}", &text[..end]);
    }
}

#[test]
fn what_is_wrong_in_ascii_is_placed_by_its_line() {
    let solid = |facets: &str| format!("solid\n{facets}endsolid\n");
    let good = facet("1");
    let cases = [
        (solid(&facet("0,5")), 4, "a coordinate"),
        (solid(&good.replace("endfacet", "endfact")), 8, "endfacet"),
        (solid(&good.replace("endloop", "vertex 1 2 3\nendloop")), 7, "endloop"),
        (solid(&format!("{good}fazet\n")), 9, "\"facet\" or \"endsolid\""),
        (format!("{}{good}", solid(&good)), 10, "\"solid\""),
        (good.clone(), 1, "\"solid\""),
    ];
    for (text, line, wanted) in cases {
        let bad = read(text.as_bytes(), Format::Stl, &FAIL).unwrap_err();
        assert!(
            matches!(bad.fault, Fault::Syntax { expected, .. } if expected == wanted),
            "{bad:?}"
        );
        assert_eq!(bad.at.line, Some(line), "{text}");
    }
    let text = solid(&format!("{good}{}{good}", facet("inf")));
    let bad = read(text.as_bytes(), Format::Stl, &FAIL).unwrap_err();
    assert_eq!((bad.fault, bad.at.record), (Fault::NotFinite, Some(1)));
    let seen = read(text.as_bytes(), Format::Stl, &SKIP).unwrap();
    assert_eq!((seen.positions().len(), seen.findings.count(DefectKind::NotFinite)), (6, 1));
}

#[test]
fn ascii_far_from_zero_keeps_its_digits() {
    let text = format!("solid\n{}endsolid", facet("5400000.125"));
    let seen = read(text.as_bytes(), Format::Stl, &FAIL).unwrap();
    assert!(seen.declared.double);
    let x = f64::from(seen.positions()[0][0]) + seen.origin.get()[0];
    assert_eq!(x, 5_400_000.125);
}

#[test]
fn text_in_utf_16_is_refused_by_name() {
    let bytes: Vec<u8> = "solid a".encode_utf16().flat_map(u16::to_le_bytes).collect();
    assert_eq!(fault(&bytes, Format::Stl), Fault::Unsupported("UTF-16 text"));
    let marked = [&b"\xff\xfe"[..], &bytes].concat();
    assert_eq!(fault(&marked, Format::Stl), Fault::Unsupported("UTF-16 text"));
}

#[test]
fn normals_have_length_one_or_zero() {
    let mut batch = soup(3);
    batch.positions = vec![
        [0.0, 0.0, 0.0],
        [1e30, 0.0, 0.0],
        [0.0, 1e30, 0.0],
        [0.0, 0.0, 0.0],
        [0.0, 1e-30, 0.0],
        [0.0, 0.0, 1e-30],
        [1.0, 1.0, 1.0],
        [2.0, 2.0, 2.0],
        [3.0, 3.0, 3.0],
    ];
    let mut bytes = Vec::new();
    let mut writer =
        Writer::new(&mut bytes, None, &WriteOptions { origin: [1.0; 3], ..PLAIN }).unwrap();
    writer.write_batch(&batch).unwrap();
    let header = writer.finish().unwrap().unwrap();
    bytes[..HEADER_BYTES].copy_from_slice(&header);
    assert_eq!(header[80..], [3, 0, 0, 0]);
    let number = |at: usize| f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    let normal = |triangle: usize| [0, 4, 8].map(|at| number(84 + 50 * triangle + at));
    assert_eq!([normal(0), normal(1), normal(2)], [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0; 3]]);
    let seen = read(&bytes, Format::Stl, &FAIL).unwrap();
    assert_eq!(seen.positions()[6..], [[2.0; 3], [3.0; 3], [4.0; 3]]);
}

#[test]
fn more_triangles_than_stl_can_count_are_refused_before_a_byte_is_written() {
    let mut bytes = Vec::new();
    let count = 1 << 32;
    let error = Writer::new(&mut bytes, Some(count), &PLAIN).err().unwrap();
    assert!(matches!(error, FormatError::Limit { limit: 0xffff_ffff, count: 0x1_0000_0000, .. }));
    assert!(bytes.is_empty());
}
