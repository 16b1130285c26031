//! Our readers and writers beside independent crates, on real meshes: the same vertices and the
//! same faces, bit for bit where the source is binary.

use std::{
    fs,
    path::{Path, PathBuf},
};

use meshmill::formats::{Batch, Content, Counts, Format, Precision, WriteOptions};

use crate::meshes::{self, Whole};
use crates::Oracle;

mod crates;

/// Real meshes, and the awkward folder's plain ones.
fn readable_files() -> Vec<PathBuf> {
    let mut paths = Vec::new();
    for (name, prefix) in [("real", ""), ("torture", "ok.")] {
        let Some(folder) = meshes::folder(name) else { return Vec::new() };
        let files = meshes::files_in(&folder);
        let chosen = files.into_iter().filter(|file| file.starts_with(prefix));
        paths.extend(chosen.map(|file| folder.join(file)));
    }
    paths
}

fn oracle(format: Format, bytes: &[u8]) -> Option<Oracle> {
    match format {
        Format::Stl => Some(crates::stl(bytes)),
        Format::Obj => Some(crates::obj(bytes)),
        Format::Ply => Some(crates::ply(bytes)),
        _ => None,
    }
}

#[test]
fn real_meshes_have_the_vertices_and_triangles_that_are_listed() {
    let Some(folder) = meshes::folder("real") else { return };
    let list = fs::read_to_string(folder.with_file_name("MESHES.md")).unwrap();
    let mut listed = 0;
    for file in meshes::files_in(&folder) {
        let start = format!("| {file} |");
        let line = list.lines().find(|line| line.starts_with(&start)).expect(&file);
        let column =
            |i: usize| -> usize { line.split('|').nth(i).unwrap().trim().parse().unwrap() };
        let whole = meshes::read_file(&folder.join(&file));
        if whole.declared.indexed {
            let found = [whole.positions.len(), whole.triangles().len()];
            assert_eq!(found, [column(4), column(5)], "{file}");
        } else {
            // The list's vertices are those after welding.
            assert_eq!(whole.positions.len() / 3, column(5), "{file}");
        }
        listed += 1;
    }
    assert!(listed >= 40, "{listed} files");
}

#[test]
fn real_meshes_are_the_same_to_other_readers() {
    for path in readable_files() {
        let bytes = fs::read(&path).unwrap();
        let Some(oracle) = oracle(Format::from_path(&path).unwrap(), &bytes) else { continue };
        assert_same(&path, &meshes::read_file(&path), &oracle);
    }
}

#[test]
fn what_we_write_is_the_same_to_other_readers_and_to_ours() {
    for path in readable_files() {
        let whole = meshes::read_file(&path);
        let indexed = [Format::Ply, Format::Obj];
        for &format in if whole.declared.indexed { &indexed[..] } else { &[] } {
            let bytes = written(format, &whole);
            let expected = Oracle {
                vertices: Some(whole.absolute()),
                polygons: corners(&whole, &whole.triangles()),
                is_text: format == Format::Obj,
            };
            check_written(&path, format, &bytes, &expected);
        }
        let triangles = whole.triangles();
        let polygons = if whole.declared.indexed {
            corners(&whole, &triangles)
        } else {
            whole.absolute().chunks(3).map(<[_]>::to_vec).collect()
        };
        let expected = Oracle { vertices: None, polygons, is_text: false };
        check_written(&path, Format::Stl, &written(Format::Stl, &whole), &expected);
    }
}

/// Reads what was written with the other crate and with our own reader.
fn check_written(path: &Path, format: Format, bytes: &[u8], expected: &Oracle) {
    let theirs = oracle(format, bytes).unwrap();
    assert_eq!(theirs.polygons.len(), expected.polygons.len(), "{path:?} as {format:?}");
    for (face, (theirs, ours)) in theirs.polygons.iter().zip(&expected.polygons).enumerate() {
        assert_eq!(bits(theirs), bits(ours), "{path:?} as {format:?}, face {face}");
    }
    if let Some(vertices) = &theirs.vertices {
        assert_eq!(bits(vertices), bits(expected.vertices.as_ref().unwrap()), "{path:?}");
    }
    let options = meshes::options(meshmill::formats::OnDefect::Fail, Some(bytes.len() as u64));
    let input = Box::new(std::io::Cursor::new(bytes.to_vec()));
    let back = meshes::read(input, Some(format), &options).unwrap();
    assert_same(path, &back, expected);
}

/// Vertices and faces agree: to the bit, or through text as [`is_near`] says.
fn assert_same(path: &Path, whole: &Whole, oracle: &Oracle) {
    let positions = whole.absolute();
    let agree = |vertex: usize, theirs: &[f32; 3]| {
        (0..3).all(|axis| {
            let (ours, theirs) = (positions[vertex][axis], theirs[axis]);
            ours.to_bits() == theirs.to_bits()
                || oracle.is_text && is_near(ours, theirs, whole.positions[vertex][axis])
        })
    };
    if let Some(vertices) = &oracle.vertices {
        assert_eq!(positions.len(), vertices.len(), "{path:?}: vertices");
        for (vertex, theirs) in vertices.iter().enumerate() {
            assert!(agree(vertex, theirs), "{path:?}: {:?} {theirs:?}", positions[vertex]);
        }
    }
    let corners = |face: &Vec<u64>| face.iter().map(|&index| index as usize).collect();
    let polygons: Vec<Vec<usize>> = if whole.declared.indexed {
        whole.faces.iter().map(corners).collect()
    } else {
        (0..positions.len() / 3).map(|face| (3 * face..3 * face + 3).collect()).collect()
    };
    assert_eq!(polygons.len(), oracle.polygons.len(), "{path:?}: faces");
    for (face, (ours, theirs)) in polygons.iter().zip(&oracle.polygons).enumerate() {
        assert_eq!(ours.len(), theirs.len(), "{path:?}: face {face}");
        let same = ours.iter().zip(theirs).all(|(&vertex, theirs)| agree(vertex, theirs));
        assert!(same, "{path:?}: face {face}: {theirs:?}");
    }
}

/// Whether two numbers from the same text are next to each other or, where ours is stored
/// relative to an origin, as close as what is stored can tell.
fn is_near(ours: f32, theirs: f32, stored: f32) -> bool {
    places_apart(ours, theirs) <= 1 || (ours - theirs).abs() <= stored.abs() * f32::EPSILON
}

/// How many single-precision numbers lie between two of them; -0 and 0 are next to each other.
fn places_apart(a: f32, b: f32) -> u64 {
    let ordered = |value: f32| {
        let magnitude = i64::from(value.to_bits() & !(1 << 31));
        if value.is_sign_negative() { -1 - magnitude } else { magnitude }
    };
    ordered(a).abs_diff(ordered(b))
}

fn bits(positions: &[[f32; 3]]) -> Vec<[u32; 3]> {
    positions.iter().map(|position| position.map(f32::to_bits)).collect()
}

/// The corners of triangles by position, in model units.
fn corners(whole: &Whole, triangles: &[[u64; 3]]) -> Vec<Vec<[f32; 3]>> {
    let positions = whole.absolute();
    let corners = |triangle: &[u64; 3]| triangle.map(|index| positions[index as usize]).to_vec();
    triangles.iter().map(corners).collect()
}

/// The mesh in another format, its polygons as triangles.
fn written(format: Format, whole: &Whole) -> Vec<u8> {
    let triangles = whole.triangles();
    let mut batches = Vec::new();
    let mut counts = Counts::default();
    if format == Format::Stl {
        let relative = |&index: &u64| whole.positions[index as usize];
        let positions = if whole.declared.indexed {
            triangles.iter().flatten().map(relative).collect()
        } else {
            whole.positions.clone()
        };
        counts.triangles = positions.len() as u64 / 3;
        batches.push(Batch { content: Content::Soup, positions, ..Batch::default() });
    } else {
        counts.vertices = whole.positions.len() as u64;
        counts.triangles = triangles.len() as u64;
        let (positions, colors) = (whole.positions.clone(), whole.colors.clone());
        batches.push(Batch { positions, colors, ..Batch::default() });
        let mut faces = Batch { content: Content::Faces, ..Batch::default() };
        for triangle in &triangles {
            faces.faces.push(triangle);
        }
        batches.push(faces);
    }
    let options = WriteOptions {
        precision: Precision::Single,
        origin: whole.origin.get(),
        colors: !whole.colors.is_empty(),
    };
    meshes::write(format, Some(counts), &options, &batches)
}
