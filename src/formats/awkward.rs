//! The awkward PLY and OFF files of the shared folder, each judged by the rules of its format.
//! They are not part of the repository: `MESHMILL_SHARED` names the folder above `meshes/`.

use std::path::PathBuf;

use super::{
    DefectKind, Format,
    fault::Result,
    probe::{FAIL, SKIP, Seen, read_in_pieces},
};
use crate::{error::Fault, formats::FormatError, formats::ReadOptions};

fn folder() -> Option<PathBuf> {
    let shared = std::env::var_os("MESHMILL_SHARED");
    if shared.is_none() {
        eprintln!("skipped: MESHMILL_SHARED is not set, so the awkward files are not there");
    }
    shared.map(|shared| PathBuf::from(shared).join("meshes/torture"))
}

/// Reads the file with its size known and unknown, in large and in small pieces.
fn read(path: &std::path::Path, options: ReadOptions) -> [Result<Seen>; 2] {
    let bytes = std::fs::read(path).unwrap();
    let format = Format::from_path(path);
    let sized = ReadOptions { size_bytes: Some(bytes.len() as u64), ..options };
    [read_in_pieces(&bytes, format, &sized, 1 << 16), read_in_pieces(&bytes, format, &options, 13)]
}

fn counts(seen: &Seen) -> (usize, usize) {
    let vertices = seen.batches.iter().map(|batch| batch.positions.len()).sum();
    (vertices, seen.batches.iter().map(|batch| batch.faces.count()).sum())
}

#[test]
fn well_formed_files_have_the_counts_of_their_headers() {
    let Some(folder) = folder() else { return };
    let files = [
        ("PyMesh__empty.ply", 0, 0),
        ("PyMesh__empty.off", 0, 0),
        ("ascii_all_on_one_line.ply", 3, 1),
        ("assimp__Cube.off", 8, 6),
        ("assimp__Wuson.ply", 11184, 3732),
        ("assimp__cube.ply", 8, 6),
        ("assimp__cube_binary.ply", 8, 12),
        ("assimp__cube_binary_header_with_RN_newline.ply", 8, 12),
        ("assimp__cube_binary_starts_with_nl.ply", 8, 6),
        ("assimp__cube_uv.ply", 24, 6),
        ("assimp__float-color.ply", 3, 1),
        ("assimp__points.ply", 4, 0),
        ("assimp__pond.0.ply", 70051, 0),
        ("be_double_ushortcount_uint.ply", 258, 512),
        ("big_endian.ply", 258, 512),
        ("comment_mentions_end_header.ply", 258, 512),
        ("concave_prism_quads_ngon.ply", 10, 7),
        ("crlf_header_binary.ply", 258, 512),
        ("draco__Box.ply", 24, 8),
        ("draco__cube_att.ply", 24, 12),
        ("draco__cube_quads.ply", 8, 6),
        ("draco__delim_test.ply", 24, 8),
        ("draco__int_point_cloud.ply", 16, 0),
        ("draco__test_extra_whitespace.ply", 3, 1),
        ("draco__test_generic.ply", 114, 224),
        ("draco__test_more_datatypes.ply", 3, 1),
        ("draco__test_pos_color.ply", 114, 224),
        ("draco__test_pos_color_ascii.ply", 114, 224),
        ("extra_list_before_indices.ply", 258, 512),
        ("faces_before_vertices.ply", 258, 512),
        ("int_count_short_index.ply", 258, 512),
        ("ok.ply", 258, 512),
        ("reordered_mixed_props_colour_normal.ply", 258, 512),
        ("user_element_between.ply", 3, 1),
    ];
    for (name, vertices, faces) in files {
        for seen in read(&folder.join(name), FAIL) {
            let seen = seen.unwrap_or_else(|error| panic!("{name}: {error:?}"));
            assert_eq!(counts(&seen), (vertices, faces), "{name}");
            assert!(seen.findings.defects.is_empty(), "{name}: {:?}", seen.findings);
        }
    }
}

#[test]
fn the_same_sphere_is_the_same_in_every_layout() {
    let Some(folder) = folder() else { return };
    let sphere = |name: &str| {
        let [seen, _] = read(&folder.join(name), FAIL);
        let seen = seen.unwrap_or_else(|error| panic!("{name}: {error:?}"));
        let of = |seen: &Seen| -> (Vec<[f32; 3]>, Vec<u64>) {
            let positions = seen.batches.iter().flat_map(|batch| batch.positions.clone());
            let corners = seen.batches.iter().flat_map(|batch| batch.faces.corners.clone());
            (positions.collect(), corners.collect())
        };
        of(&seen)
    };
    let plain = sphere("ok.ply");
    for name in [
        "be_double_ushortcount_uint.ply",
        "big_endian.ply",
        "comment_mentions_end_header.ply",
        "crlf_header_binary.ply",
        "extra_list_before_indices.ply",
        "faces_before_vertices.ply",
        "int_count_short_index.ply",
        "reordered_mixed_props_colour_normal.ply",
    ] {
        assert!(sphere(name) == plain, "{name}");
    }
}

#[test]
fn bad_records_are_found_and_can_be_skipped() {
    let Some(folder) = folder() else { return };
    let files = [
        ("draco__float_inf_point_cloud.ply", DefectKind::NotFinite, 3, true),
        ("face_with_0_1_2_verts.ply", DefectKind::TooFewCorners, 3, false),
        ("index_negative.ply", DefectKind::IndexOutOfRange, 1, true),
        ("index_out_of_range.ply", DefectKind::IndexOutOfRange, 1, true),
        ("nan_vertex.ply", DefectKind::NotFinite, 1, true),
    ];
    for (name, kind, count, is_fatal) in files {
        let path = folder.join(name);
        for seen in read(&path, SKIP) {
            assert_eq!(seen.unwrap().findings.count(kind), count, "{name}");
        }
        for seen in read(&path, FAIL) {
            assert_eq!(seen.is_err(), is_fatal, "{name}");
        }
    }
}

#[test]
fn files_that_lie_or_end_early_are_faults() {
    let Some(folder) = folder() else { return };
    let files = [
        "assimp__OutOfMemory.off",
        "assimp__crash-30d6d0f7c529b3b66b4131700b7a4580cd7082df.ply",
        "assimp__empty.off",
        "assimp__empty.ply",
        "assimp__invalid.off",
        "assimp__issue623.ply",
        "bomb_counts.ply",
        "list_count_bomb.ply",
        "truncated_faces.ply",
        "truncated_vertices.ply",
    ];
    for name in files {
        for seen in read(&folder.join(name), SKIP) {
            let error = seen.expect_err(name);
            let FormatError::Input(found) = error else { panic!("{name}: {error:?}") };
            let has_place = found.at.line.is_some() || found.at.byte.is_some();
            assert!(has_place || found.fault == Fault::Empty, "{name}: {found:?}");
        }
    }
}
