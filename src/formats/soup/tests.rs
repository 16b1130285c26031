//! Our own soup through the front door.

use super::Writer;
use crate::{
    error::Fault,
    formats::{
        Batch, DefectKind, Format, MeshWriter, Origin, Precision, ReadOptions, WriteOptions,
        probe::{FAIL, SKIP, fault, read, soup},
    },
};

const PLAIN: WriteOptions =
    WriteOptions { precision: Precision::Single, origin: [0.0; 3], colors: false };
const COLORED: WriteOptions = WriteOptions { colors: true, ..PLAIN };

fn colored(triangles: usize) -> Batch {
    let mut batch = soup(triangles);
    batch.colors = (0..3 * triangles).map(|corner| (corner as u32).to_be_bytes()).collect();
    batch
}

fn write(batch: &Batch, count: Option<u64>, options: &WriteOptions) -> Vec<u8> {
    let mut bytes = Vec::new();
    let bounds = Some([[-1.0; 3], [1e9, 2.0, 3.0]]);
    let mut writer = Writer::new(&mut bytes, count, bounds, options).unwrap();
    writer.write_batch(batch).unwrap();
    assert_eq!(writer.finish().unwrap(), None);
    bytes
}

#[test]
fn a_soup_comes_back_with_its_colours_counted_or_not() {
    for triangles in [0, 1, 2, 40_000] {
        let batch = colored(triangles);
        for options in [PLAIN, COLORED] {
            for count in [None, Some(triangles as u64)] {
                let bytes = write(&batch, count, &options);
                let seen = read(&bytes, Format::Soup, &FAIL).unwrap();
                assert_eq!(seen.positions(), batch.positions);
                let colors = if options.colors { batch.colors.clone() } else { Vec::new() };
                assert_eq!(seen.colors(), colors);
                assert_eq!(seen.declared.faces, count);
                assert_eq!(seen.declared.bounds, Some([[-1.0; 3], [1e9, 2.0, 3.0]]));
                assert_eq!(seen.findings.defects, []);
            }
        }
    }
}

#[test]
fn every_prefix_fails_also_without_a_count() {
    for options in [PLAIN, COLORED] {
        for count in [None, Some(3)] {
            let bytes = write(&colored(3), count, &options);
            for end in 0..bytes.len() {
                let prefix = &bytes[..end];
                read(prefix, Format::Soup, &FAIL).unwrap_err();
                let size_bytes = Some(end as u64);
                read(prefix, Format::Soup, &ReadOptions { size_bytes, ..FAIL }).unwrap_err();
            }
        }
    }
}

#[test]
fn a_flipped_bit_in_a_stream_with_a_trailer_is_noticed() {
    let bytes = write(&soup(3), None, &PLAIN);
    for bit in 0..bytes.len() * 8 {
        let mut damaged = bytes.clone();
        damaged[bit / 8] ^= 1 << (bit % 8);
        read(&damaged, Format::Soup, &SKIP).unwrap_err();
    }
}

#[test]
fn a_trailer_must_count_right_and_be_the_end() {
    let bytes = write(&soup(3), None, &PLAIN);
    let mut missing = bytes.clone();
    missing.drain(128..164);
    assert_eq!(fault(&missing, Format::Soup), Fault::Corrupt("the trailer"));
    let mut longer = bytes;
    longer.push(0);
    assert!(matches!(fault(&longer, Format::Soup), Fault::Truncated { .. }));
}

#[test]
fn bytes_after_a_known_count_are_counted() {
    let mut bytes = write(&soup(2), Some(2), &PLAIN);
    bytes.extend([1; 36]);
    let seen = read(&bytes, Format::Soup, &FAIL).unwrap();
    assert_eq!(seen.findings.count(DefectKind::TrailingBytes), 36);
}

#[test]
fn a_wrong_count_is_mended_by_the_header_that_finish_returns() {
    let mut bytes = Vec::new();
    let mut writer = Writer::new(&mut bytes, Some(9), None, &PLAIN).unwrap();
    writer.write_batch(&soup(2)).unwrap();
    let header = writer.finish().unwrap().unwrap();
    assert!(matches!(fault(&bytes, Format::Soup), Fault::CountImpossible { count: 9, .. }));
    bytes[..header.len()].copy_from_slice(&header);
    assert_eq!(read(&bytes, Format::Soup, &FAIL).unwrap().positions(), soup(2).positions);
}

#[test]
fn the_origin_travels_and_gives_way_to_that_of_an_earlier_file() {
    let options =
        WriteOptions { origin: [4096.0, 0.0, -1.0], precision: Precision::Double, ..PLAIN };
    let bytes = write(&soup(1), Some(1), &options);
    let seen = read(&bytes, Format::Soup, &FAIL).unwrap();
    assert_eq!(seen.origin, Origin::at([4096.0, 0.0, -1.0]));
    assert!(seen.declared.double);
    let earlier = ReadOptions { origin: Origin::at([4095.0, 0.0, 0.0]), ..FAIL };
    let seen = read(&bytes, Format::Soup, &earlier).unwrap();
    assert_eq!(seen.positions()[0], [1.0, 0.0, -2.5]);
    assert_eq!(seen.origin, earlier.origin);
}

#[test]
fn triangles_that_are_not_finite_fail_or_are_left_out() {
    let mut batch = colored(3);
    batch.positions[4][2] = f32::NEG_INFINITY;
    for count in [None, Some(3)] {
        let bytes = write(&batch, count, &COLORED);
        assert_eq!(fault(&bytes, Format::Soup), Fault::NotFinite);
        let seen = read(&bytes, Format::Soup, &SKIP).unwrap();
        assert_eq!(seen.colors(), [&batch.colors[..3], &batch.colors[6..]].concat());
        assert_eq!(seen.findings.count(DefectKind::NotFinite), 1);
    }
}
