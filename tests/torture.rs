//! The awkward files, each with what must happen to it.

use std::{
    collections::BTreeSet,
    fmt::Write as _,
    fs,
    io::{BufRead, BufReader, Cursor, Write as _},
    path::{Path, PathBuf},
};

use meshmill::{
    error::{Fault, InputFault},
    formats::{Compression, Encoder, Format, OnDefect},
};

use crate::meshes::{self, Whole};
use outcome::{Expected, defects};
use table::Row;

mod outcome;
mod table;

/// The folder, or `None` where it is absent.
fn folder() -> Option<PathBuf> {
    meshes::folder("torture")
}

fn format(file: &str) -> Option<Format> {
    Format::from_path(Path::new(file))
}

#[test]
fn every_file_has_a_row_and_every_row_a_file() {
    let Some(folder) = folder() else { return };
    let files: BTreeSet<String> = meshes::files_in(&folder).into_iter().collect();
    let rows: Vec<String> = table::rows().map(|row| row.file.to_owned()).collect();
    let named: BTreeSet<String> = rows.iter().cloned().collect();
    assert_eq!(rows.len(), named.len(), "a file has one row");
    let missing: Vec<_> = files.difference(&named).collect();
    let surplus: Vec<_> = named.difference(&files).collect();
    assert!(missing.is_empty() && surplus.is_empty(), "no row: {missing:?}, no file: {surplus:?}");
}

#[test]
fn every_file_does_what_the_rules_of_its_format_say() {
    check_rows(|_, bytes| (plain(bytes), Some(bytes.len() as u64)), |expected| expected);
}

#[test]
fn every_file_does_the_same_when_it_comes_in_small_pieces_of_unknown_total() {
    let pieces = |_: &Row, bytes: &[u8]| {
        let input: Box<dyn BufRead + Send> =
            Box::new(BufReader::with_capacity(7, Cursor::new(bytes.to_vec())));
        (input, None)
    };
    check_rows(pieces, Expected::without_size);
}

#[test]
fn every_file_does_the_same_when_it_is_compressed() {
    let compressed = |_: &Row, bytes: &[u8]| {
        let mut encoder = Encoder::new(Compression::Zstd, Vec::new()).unwrap();
        encoder.write_all(bytes).unwrap();
        let compressed = encoder.finish().unwrap();
        (plain(&compressed), Some(compressed.len() as u64))
    };
    check_rows(compressed, Expected::without_size);
}

/// Files with the same 512 triangles in the same order, in other words.
const SPHERES: &[&str] = &[
    "ok.ply",
    "be_double_ushortcount_uint.ply",
    "big_endian.ply",
    "comment_mentions_end_header.ply",
    "crlf_header_binary.ply",
    "extra_list_before_indices.ply",
    "faces_before_vertices.ply",
    "int_count_short_index.ply",
    "reordered_mixed_props_colour_normal.ply",
    "ok.obj",
    "crlf.obj",
    "exponents_tabs.obj",
    "forward_reference.obj",
    "interleaved_v_f.obj",
    "negative.obj",
    "trailing_comment_no_eol.obj",
    "v_with_w_and_rgb.obj",
    "vslashslashn.obj",
    "vtvn.obj",
    "ascii.stl",
    "ascii_cr_only.stl",
    "ascii_crlf_upper.stl",
    "attr_colour.stl",
    "count_ffffffff.stl",
    "count_zero_with_data.stl",
    "solid_header_binary.stl",
    "trailing_garbage.stl",
];

#[test]
fn one_sphere_is_the_same_triangles_in_every_format_and_spelling() {
    let Some(folder) = folder() else { return };
    let plain = meshes::read_file(&folder.join("ok.stl")).absolute();
    for file in SPHERES {
        let whole = meshes::read_file(&folder.join(file));
        let positions = whole.absolute();
        let corners = if whole.declared.indexed {
            let corners = whole.triangles().into_flattened().into_iter();
            corners.map(|index| positions[index as usize]).collect()
        } else {
            positions
        };
        assert!(corners == plain, "{file}");
    }
}

#[test]
fn every_prefix_of_every_file_is_read_or_refused_and_never_gives_more() {
    let Some(folder) = folder() else { return };
    for row in table::rows() {
        let bytes = fs::read(folder.join(row.file)).unwrap();
        for on_defect in [OnDefect::Fail, OnDefect::Skip] {
            let whole = read(row.file, plain(&bytes), on_defect, None);
            // About a hundred cuts a file, odd ones too.
            for end in (0..bytes.len()).step_by(1 + bytes.len() / 100) {
                let cut = read(row.file, plain(&bytes[..end]), on_defect, None);
                if let (Ok(cut), Ok(whole)) = (&cut, &whole) {
                    let more = cut.positions.len() > whole.positions.len()
                        || cut.faces.len() > whole.faces.len();
                    assert!(!more, "{} {on_defect:?} {end}", row.file);
                }
            }
        }
    }
}

fn plain(bytes: &[u8]) -> Box<dyn BufRead + Send> {
    Box::new(Cursor::new(bytes.to_vec()))
}

fn read(
    file: &str,
    input: Box<dyn BufRead + Send>,
    on_defect: OnDefect,
    size_bytes: Option<u64>,
) -> Result<Whole, InputFault> {
    let mut whole = meshes::read(input, format(file), &meshes::options(on_defect, size_bytes))?;
    if on_defect == OnDefect::Skip && format(file) == Some(Format::Obj) {
        whole.resolve();
    }
    Ok(whole)
}

/// Reads every file as `supply` gives it, with both policies; the outcome must be what `adapt`
/// makes of the row's.
fn check_rows(
    supply: impl Fn(&Row, &[u8]) -> (Box<dyn BufRead + Send>, Option<u64>),
    adapt: impl Fn(Expected) -> Expected,
) {
    let Some(folder) = folder() else { return };
    let mut disagreements = String::new();
    for row in table::rows() {
        let bytes = fs::read(folder.join(row.file)).unwrap();
        for on_defect in [OnDefect::Fail, OnDefect::Skip] {
            let (input, size_bytes) = supply(row, &bytes);
            let found = read(row.file, input, on_defect, size_bytes);
            if let Err(text) = check(row, on_defect, &found, &adapt) {
                writeln!(disagreements, "{} {on_defect:?}: {text}", row.file).unwrap();
            }
        }
    }
    assert!(disagreements.is_empty(), "\n{disagreements}");
}

fn check(
    row: &Row,
    on_defect: OnDefect,
    found: &Result<Whole, InputFault>,
    adapt: impl Fn(Expected) -> Expected,
) -> Result<(), String> {
    let expected = match on_defect {
        OnDefect::Fail => row.fail,
        OnDefect::Skip => row.skip.unwrap_or(row.fail),
    };
    adapt(expected).compare(found)?;
    match found {
        Ok(whole) if defects(whole) != row.defects => {
            Err(format!("{:?} expected, but {:?}", row.defects, whole.findings))
        }
        Err(InputFault { at, fault }) if at.line.is_none() && at.byte.is_none() => {
            Err(format!("a place expected for {fault:?}"))
        }
        Err(InputFault { fault: Fault::Compression(text), .. }) => Err(text.clone()),
        _ => Ok(()),
    }
}
