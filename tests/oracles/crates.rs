//! What independent crates read from the same bytes. They hold whole files in memory and are
//! several times slower than our readers, and were written by other people.

use std::{
    collections::HashMap,
    io::{BufReader, Cursor},
    path::Path,
};

use ply_rs_bw::{
    parser::Parser,
    ply::{DefaultElement, Encoding, Property},
};

/// A mesh as another reader sees it.
pub(super) struct Oracle {
    /// Vertices; where the crate does not tell them, those of the faces' corners.
    pub(super) vertices: Option<Vec<[f32; 3]>>,
    /// Each face's corners, by position.
    pub(super) polygons: Vec<Vec<[f32; 3]>>,
    /// Whether numbers went through text.
    pub(super) is_text: bool,
}

/// What `stl_io` reads.
pub(super) fn stl(bytes: &[u8]) -> Oracle {
    let mut input = Cursor::new(bytes);
    let triangles = stl_io::create_stl_reader(&mut input).unwrap();
    let corners = |triangle: stl_io::Triangle| triangle.vertices.map(|vertex| vertex.0).to_vec();
    let polygons = triangles.map(|triangle| corners(triangle.unwrap())).collect();
    Oracle { vertices: None, polygons, is_text: bytes.starts_with(b"solid") }
}

/// What `tobj` reads. It keeps only vertices that a face uses, once per group.
pub(super) fn obj(bytes: &[u8]) -> Oracle {
    let options = tobj::LoadOptions {
        ignore_points: true,
        ignore_lines: true,
        ..tobj::LoadOptions::default()
    };
    let no_materials = |_: &Path| Ok((Vec::new(), HashMap::default()));
    let (models, _) = tobj::load_obj_buf(&mut Cursor::new(bytes), &options, no_materials).unwrap();
    let mut polygons = Vec::new();
    for model in models {
        let (positions, _) = model.mesh.positions.as_chunks::<3>();
        let mut corners = model.mesh.indices.iter().map(|&index| positions[index as usize]);
        let triangles = vec![3; model.mesh.indices.len() / 3];
        let arities = &model.mesh.face_arities;
        for &arity in if arities.is_empty() { &triangles } else { arities } {
            polygons.push(corners.by_ref().take(arity as usize).collect());
        }
    }
    Oracle { vertices: None, polygons, is_text: true }
}

/// What `ply-rs-bw` reads.
pub(super) fn ply(bytes: &[u8]) -> Oracle {
    let mut input = BufReader::new(Cursor::new(bytes));
    let ply = Parser::<DefaultElement>::new().read_ply(&mut input).unwrap();
    let position = |vertex: &DefaultElement| ["x", "y", "z"].map(|name| scalar(&vertex[name]));
    let vertices: Vec<[f32; 3]> = ply.payload["vertex"].iter().map(position).collect();
    let indices = match (ply.payload.get("face"), ply.payload.get("tristrips")) {
        (Some(faces), _) => faces.iter().map(face_indices).collect(),
        (None, Some(strips)) => {
            strips.iter().flat_map(|strip| unrolled(&face_indices(strip))).collect()
        }
        (None, None) => Vec::new(),
    };
    let corners = |face: &Vec<i64>| face.iter().map(|&index| vertices[index as usize]).collect();
    let polygons = indices.iter().map(corners).collect();
    let is_text = matches!(ply.header.encoding, Encoding::Ascii);
    Oracle { vertices: Some(vertices), polygons, is_text }
}

fn scalar(property: &Property) -> f32 {
    match *property {
        Property::Float(value) => value,
        Property::Double(value) => value as f32,
        Property::Int(value) => value as f32,
        ref other => panic!("a coordinate is {other:?}"),
    }
}

fn face_indices(face: &DefaultElement) -> Vec<i64> {
    let list = face.get("vertex_indices").or_else(|| face.get("vertex_index")).unwrap();
    match list {
        Property::ListInt(list) => list.iter().map(|&index| i64::from(index)).collect(),
        Property::ListUInt(list) => list.iter().map(|&index| i64::from(index)).collect(),
        other => panic!("a face is {other:?}"),
    }
}

/// The triangles of strips that a -1 ends, every second one turned back; those that only lead
/// from one place to another, with two equal corners, are none.
fn unrolled(strips: &[i64]) -> Vec<Vec<i64>> {
    let triangles = strips.split(|&index| index < 0).flat_map(|strip| {
        strip.windows(3).enumerate().map(|(number, corners)| match (number % 2, corners) {
            (0, &[a, b, c]) => [a, b, c],
            (_, &[a, b, c]) => [b, a, c],
            _ => unreachable!("windows of three"),
        })
    });
    let triangles = triangles.filter(|[a, b, c]| a != b && b != c && c != a);
    triangles.map(|corners| corners.to_vec()).collect()
}
