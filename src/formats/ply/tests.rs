//! The PLY reader and writer against the rules of the format.

use std::fmt::Write;

use super::{
    super::{
        Batch, Content, Counts, DefectKind, FormatError, MeshReader, MeshWriter, OnDefect, Origin,
        Precision, ReadOptions, Source, WriteOptions, source::tests::trickle,
    },
    Reader, Writer,
};
use crate::error::{Fault, InputFault};

/// All a file holds.
#[derive(Debug, Default, PartialEq)]
struct Mesh {
    positions: Vec<[f64; 3]>,
    colors: Vec<[u8; 4]>,
    faces: Vec<Vec<u64>>,
}

fn options(on_defect: OnDefect) -> ReadOptions {
    ReadOptions { on_defect, origin: Origin::undecided(), size_bytes: None }
}

fn read_all(mut reader: Reader) -> Result<(Mesh, Reader), FormatError> {
    let (mut mesh, mut batch) = (Mesh::default(), Batch::default());
    while reader.read_batch(&mut batch)? {
        assert!(batch.count() > 0);
        let origin = reader.origin().get();
        let absolute = |p: &[f32; 3]| [0, 1, 2].map(|axis| f64::from(p[axis]) + origin[axis]);
        mesh.positions.extend(batch.positions.iter().map(absolute));
        mesh.colors.extend_from_slice(&batch.colors);
        mesh.faces.extend(batch.faces.iter().map(<[u64]>::to_vec));
    }
    Ok((mesh, reader))
}

fn read_with(bytes: &[u8], options: &ReadOptions) -> Result<(Mesh, Reader), FormatError> {
    read_all(Reader::open(trickle(bytes, usize::MAX), options)?)
}

fn read(bytes: &[u8]) -> Mesh {
    read_with(bytes, &options(OnDefect::Fail)).unwrap().0
}

fn fault(bytes: &[u8]) -> InputFault {
    match read_with(bytes, &options(OnDefect::Fail)).map(|(mesh, _)| mesh).unwrap_err() {
        FormatError::Input(fault) => fault,
        error => panic!("{error:?}"),
    }
}

/// Two triangles and a quad between them.
///
/// ```text
///   3---2---5
///   | \ |   |
///   0---1---4
/// ```
const FACES: [&[i32]; 3] = [&[0, 1, 3], &[1, 4, 5, 2], &[1, 2, 3]];
const PLANE: [[f32; 3]; 6] =
    [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.], [2., 0., 0.], [2., 1., 0.]];

const HEADER: &str = "ply\nformat ENCODING 1.0\ncomment a plane\nelement vertex 6\n\
    property float x\nproperty float y\nproperty float z\nelement face 3\n\
    property list uchar int vertex_indices\nend_header\n";

fn header(encoding: &str) -> Vec<u8> {
    HEADER.replace("ENCODING", encoding).into_bytes()
}

fn ascii() -> Vec<u8> {
    let mut text = String::from_utf8(header("ascii")).unwrap();
    for [x, y, z] in PLANE {
        writeln!(text, "{x} {y} {z}").unwrap();
    }
    for face in FACES {
        let words: Vec<_> = face.iter().map(i32::to_string).collect();
        writeln!(text, "{} {}", face.len(), words.join(" ")).unwrap();
    }
    text.into_bytes()
}

fn binary(encoding: &str) -> Vec<u8> {
    let is_big = encoding == "binary_big_endian";
    let mut bytes = header(encoding);
    for c in PLANE.as_flattened() {
        bytes.extend(if is_big { c.to_be_bytes() } else { c.to_le_bytes() });
    }
    for face in FACES {
        bytes.push(face.len() as u8);
        for c in face {
            bytes.extend(if is_big { c.to_be_bytes() } else { c.to_le_bytes() });
        }
    }
    bytes
}

fn every_encoding() -> [Vec<u8>; 3] {
    [ascii(), binary("binary_little_endian"), binary("binary_big_endian")]
}

fn plane() -> Mesh {
    Mesh {
        positions: PLANE.iter().map(|p| p.map(f64::from)).collect(),
        colors: Vec::new(),
        faces: FACES.iter().map(|f| f.iter().map(|&c| c as u64).collect()).collect(),
    }
}

#[test]
fn every_encoding_is_the_same_mesh_however_the_bytes_arrive() {
    for bytes in every_encoding() {
        for step in [1, 7, 64, usize::MAX] {
            let open = Reader::open(trickle(&bytes, step), &options(OnDefect::Fail));
            let (mesh, reader) = read_all(open.unwrap()).unwrap();
            assert_eq!(mesh, plane(), "{step} bytes a read");
            assert!(reader.findings().defects.is_empty());
            assert_eq!(reader.bytes_read(), bytes.len() as u64);
        }
    }
}

#[test]
fn every_prefix_fails_cleanly() {
    for bytes in every_encoding() {
        // The last line end of a text says nothing.
        let is_text = bytes.ends_with(b"\n");
        for length in 0..bytes.len() - usize::from(is_text) {
            for size_bytes in [None, Some(length as u64)] {
                let options = ReadOptions { size_bytes, ..options(OnDefect::Skip) };
                let result = read_with(&bytes[..length], &options).map(|(mesh, _)| mesh);
                let error = result.expect_err("a prefix is no mesh");
                let FormatError::Input(fault) = error else { panic!("{error:?}") };
                let said = fault.fault;
                let is_right = matches!(
                    said,
                    Fault::Truncated { .. } | Fault::CountImpossible { .. } | Fault::Empty
                );
                assert!(is_right, "{length}: {said:?}");
                if said != Fault::Empty && size_bytes.is_none() {
                    assert_eq!(fault.at.byte, Some(length as u64), "{said:?}");
                }
            }
        }
    }
}

#[test]
fn what_is_written_is_read_again() {
    let origin = [1024.0, -2048.0, 0.5];
    for precision in [Precision::Single, Precision::Double] {
        for colors in [false, true] {
            let options = WriteOptions { precision, origin, colors };
            let counts = Counts { vertices: 6, triangles: 2 };
            let mut bytes = Vec::new();
            let mut writer = Writer::new(&mut bytes, counts, &options).unwrap();
            let positions = PLANE.to_vec();
            let color = (0..6).map(|shade| [shade, 20, 30, 40]).collect();
            let colors = if colors { color } else { Vec::new() };
            let mut batch = Batch { positions, colors: colors.clone(), ..Batch::default() };
            writer.write_batch(&batch).unwrap();
            batch.reset(Content::Faces);
            batch.faces.push(&[0, 1, 3]);
            batch.faces.push(&[1, 2, 3]);
            writer.write_batch(&batch).unwrap();
            assert_eq!(writer.finish().unwrap(), None);
            drop(writer);
            let mesh = read(&bytes);
            let moved = |p: &[f32; 3]| [0, 1, 2].map(|axis| f64::from(p[axis]) + origin[axis]);
            assert_eq!(mesh.positions, PLANE.iter().map(moved).collect::<Vec<_>>());
            assert_eq!(mesh.faces, [[0, 1, 3], [1, 2, 3]]);
            assert_eq!(mesh.colors, colors);
        }
    }
}

#[test]
fn zero_keeps_its_sign() {
    for precision in [Precision::Single, Precision::Double] {
        let options = WriteOptions { precision, origin: [0.0; 3], colors: false };
        let counts = Counts { vertices: 1, triangles: 0 };
        let mut bytes = Vec::new();
        let mut writer = Writer::new(&mut bytes, counts, &options).unwrap();
        writer
            .write_batch(&Batch { positions: vec![[-0.0, 0.0, 1.0]], ..Batch::default() })
            .unwrap();
        writer.finish().unwrap();
        drop(writer);
        let each = if precision == Precision::Single { 4 } else { 8 };
        let body = &bytes[bytes.len() - 3 * each..];
        let signs: Vec<u8> = body.chunks(each).map(|number| number[each - 1] >> 7).collect();
        assert_eq!(signs, [1, 0, 0], "{precision:?}");
    }
}

#[test]
fn a_header_with_wrong_counts_is_replaced_by_one_of_the_same_length() {
    let options = WriteOptions { precision: Precision::Single, origin: [0.0; 3], colors: false };
    let mut bytes = Vec::new();
    let guess = Counts { vertices: u64::from(u32::MAX), triangles: u64::MAX };
    let mut writer = Writer::new(&mut bytes, guess, &options).unwrap();
    let positions = PLANE.to_vec();
    writer.write_batch(&Batch { positions, ..Batch::default() }).unwrap();
    let patch = writer.finish().unwrap().unwrap();
    drop(writer);
    assert!(bytes[..patch.len()].ends_with(b"end_header\n"));
    bytes[..patch.len()].copy_from_slice(&patch);
    assert_eq!(read(&bytes).positions.len(), 6);

    let too_many = Counts { vertices: 1 << 32, triangles: 1 };
    let mut nothing = Vec::new();
    let error = Writer::new(&mut nothing, too_many, &options).map(|_| ()).unwrap_err();
    assert!(matches!(error, FormatError::Limit { count: 0x1_0000_0000, .. }));
    assert!(nothing.is_empty());
}

/// One triangle in the ascii layout given by `vertex` and `face` properties.
fn triangle(vertex: &str, face: &str, body: &str) -> Vec<u8> {
    format!(
        "ply\nformat ascii 1.0\nelement vertex 3\n{vertex}element face 1\n{face}end_header\n{body}"
    )
    .into_bytes()
}

const XYZ: &str = "property float x\nproperty float y\nproperty float z\n";
const INDICES: &str = "property list uchar int vertex_indices\n";

#[test]
fn properties_come_in_any_order_and_type_and_others_are_named() {
    let vertex = "property uchar red\nproperty int64 z\nproperty float nx\nproperty double y\n\
        property uint8 green\nproperty list int8 float weights\nproperty short x\n\
        property uchar blue\n";
    let face = "property list uchar float texcoord\nproperty float quality\n\
        property list uint16 uint64 vertex_index\nproperty int flags\n";
    let body = "1 30 .5 20 2 2 9 9 10 3\n4 31 .5 21 5 0 11 6\n7 32 .5 22 8 1 9 12 9\n\
        6 0 0 0 0 0 0 1.5 3 2 1 0 7\n";
    let bytes = triangle(vertex, face, body);
    let (mesh, reader) = read_with(&bytes, &options(OnDefect::Fail)).unwrap();
    assert_eq!(mesh.positions, [[10., 20., 30.], [11., 21., 31.], [12., 22., 32.]]);
    assert_eq!(mesh.colors, [[1, 2, 3, 255], [4, 5, 6, 255], [7, 8, 9, 255]]);
    assert_eq!(mesh.faces, [[2, 1, 0]]);
    let dropped =
        ["normals", "vertex weights", "texture coordinates", "face quality", "face flags"];
    assert_eq!(reader.findings().dropped, dropped);
    assert!(reader.declared().double && reader.declared().colors);
}

#[test]
fn colours_may_be_shares_of_one_and_have_other_names() {
    let colors = "property float diffuse_red\nproperty float diffuse_green\n\
        property float diffuse_blue\n";
    let body = "0 0 0 0 .5 1\n1 0 0 2 -1 nan\n0 1 0 0 0 0\n3 0 1 2\n";
    let mesh = read(&triangle(&format!("{XYZ}{colors}"), INDICES, body));
    assert_eq!(mesh.colors, [[0, 128, 255, 255], [255, 0, 0, 255], [0, 0, 0, 255]]);
}

#[test]
fn a_header_may_be_untidy() {
    let text = "ply \r\nformat \t ascii  1.0\r\ncomment end_header is not here\r\n\
        obj_info element face 9\r\nmade by hand\r\n\telement vertex   3 \r\n property float32 x\r\n\
        property float y\r\nproperty float z\r\nelement edge 1\r\nproperty int vertex1\r\n\
        property int vertex2\r\nelement face 1\r\nproperty list uint8 int32 vertex_index\r\n\
        end_header\r\n0 0 0 1 0 0 0 1 0 0 1 3 0 1 2 \n \n";
    for text in [text.to_owned(), text.replace("\r\n", "\r"), text.replace("\r\n", "\n")] {
        let (mesh, reader) = read_with(text.as_bytes(), &options(OnDefect::Fail)).unwrap();
        assert_eq!((mesh.positions.len(), mesh.faces), (3, vec![vec![0, 1, 2]]));
        assert_eq!(reader.findings().dropped, ["header line \"made by hand\"", "element edge"]);
        assert!(reader.findings().defects.is_empty());
    }
}

#[test]
fn a_binary_body_may_begin_with_what_looks_like_a_line_end() {
    // The first coordinate's first byte is 0x0a or 0x0d.
    for first in [0x0a, 0x0d] {
        for line_end in ["\n", "\r\n", "\r"] {
            let plain = binary("binary_little_endian");
            let header_bytes = header("binary_little_endian");
            let text = String::from_utf8(header_bytes.clone()).unwrap().replace('\n', line_end);
            let mut bytes = text.into_bytes();
            bytes.push(first);
            bytes.extend_from_slice(&plain[header_bytes.len() + 1..]);
            let mesh = read(&bytes);
            assert_eq!(mesh.positions[0][0], f64::from(f32::from_bits(u32::from(first))));
            assert_eq!(mesh.faces, plane().faces);
        }
    }
}

#[test]
fn faces_may_come_before_vertices() {
    let text = "ply\nformat ascii 1.0\nelement face 1\nproperty list uchar int vertex_index\n\
        element vertex 3\nproperty float x\nproperty float y\nproperty float z\nend_header\n\
        3 2 1 0\n0 0 0\n1 0 0\n0 1 0\n";
    let mut reader = Reader::open(Source::new(text.as_bytes()), &options(OnDefect::Fail)).unwrap();
    assert!(!reader.declared().vertices_first);
    let mut batch = Batch::default();
    assert!(reader.read_batch(&mut batch).unwrap());
    assert_eq!((batch.content, batch.count()), (Content::Faces, 1));
    assert!(reader.read_batch(&mut batch).unwrap());
    assert_eq!((batch.content, batch.count()), (Content::Vertices, 3));
    assert!(!reader.read_batch(&mut batch).unwrap());
}

#[test]
fn strips_turn_every_other_triangle_and_restart() {
    let text = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\n\
        property float z\nelement tristrips 1\nproperty list int int vertex_indices\nend_header\n\
        0 0 0 1 0 0 0 1 0 1 1 0 2 2 0\n11 0 1 2 3 4 -1 1 3 4 4 0\n";
    let (mesh, reader) = read_with(text.as_bytes(), &options(OnDefect::Fail)).unwrap();
    assert_eq!(mesh.faces, [[0, 1, 2], [2, 1, 3], [2, 3, 4], [1, 3, 4]]);
    assert_eq!(reader.declared().faces, None);
    assert_eq!(reader.findings().count(DefectKind::Degenerate), 2);
    let bad = text.replace("-1", "9");
    assert_eq!(fault(bad.as_bytes()).fault, Fault::IndexOutOfRange { index: 9, vertices: 5 });
}

#[test]
fn a_bad_index_is_a_fault_or_is_left_out() {
    for (bytes, count_at) in [(binary("binary_little_endian"), 0), (ascii(), 1)] {
        for bad in [6_i32, -1] {
            let mut bytes = bytes.clone();
            if count_at == 0 {
                let at = bytes.len() - 4;
                bytes[at..].copy_from_slice(&bad.to_le_bytes());
            } else {
                bytes.truncate(bytes.len() - 2);
                bytes.extend(bad.to_string().bytes());
            }
            let found = fault(&bytes);
            assert_eq!(found.fault, Fault::IndexOutOfRange { index: i64::from(bad), vertices: 6 });
            assert_eq!(found.at.record, Some(2));
            let (mesh, reader) = read_with(&bytes, &options(OnDefect::Skip)).unwrap();
            assert_eq!(mesh.faces, plane().faces[..2]);
            assert_eq!(reader.findings().count(DefectKind::IndexOutOfRange), 1);
        }
    }
}

#[test]
fn a_vertex_that_is_not_finite_is_a_fault_or_becomes_nan() {
    let mut bytes = binary("binary_little_endian");
    let at = header("binary_little_endian").len() + 2 * 12 + 4;
    bytes[at..at + 4].copy_from_slice(&f32::INFINITY.to_le_bytes());
    let text = String::from_utf8(ascii()).unwrap().replace("1 1 0\n0 1", "1 inf 0\n0 1");
    for bytes in [bytes, text.into_bytes()] {
        let found = fault(&bytes);
        assert_eq!((found.fault, found.at.record), (Fault::NotFinite, Some(2)));
        let (mesh, reader) = read_with(&bytes, &options(OnDefect::Skip)).unwrap();
        assert!(mesh.positions[2].iter().all(|c| c.is_nan()));
        assert_eq!(mesh.positions.len(), 6);
        assert_eq!(reader.findings().count(DefectKind::NotFinite), 1);
    }
}

#[test]
fn faces_of_fewer_than_three_corners_are_counted() {
    let text = format!(
        "ply\nformat ascii 1.0\nelement vertex 3\n{XYZ}element face 4\n{INDICES}end_header\n\
         0 0 0\n1 0 0\n0 1 0\n0\n1 0\n2 0 1\n3 0 1 2\n"
    );
    let (mesh, reader) = read_with(text.as_bytes(), &options(OnDefect::Fail)).unwrap();
    assert_eq!(mesh.faces, [[0, 1, 2]]);
    assert_eq!(reader.findings().count(DefectKind::TooFewCorners), 3);
}

#[test]
fn trailing_bytes_are_counted() {
    for mut bytes in every_encoding() {
        bytes.extend_from_slice(b"rest");
        let (mesh, reader) = read_with(&bytes, &options(OnDefect::Fail)).unwrap();
        assert_eq!(mesh, plane());
        assert_eq!(reader.findings().count(DefectKind::TrailingBytes), 4);
    }
}

#[test]
fn counts_that_lie_are_found_before_memory_is_taken() {
    let text = String::from_utf8(header("binary_little_endian")).unwrap();
    let many =
        text.replace("vertex 6", "vertex 4000000000").replace("face 3", "face 9000000000000");
    let long = text.replace("uchar int", "uint int");
    let mut long = long.into_bytes();
    long.extend_from_slice(&[0; 72]);
    long.extend_from_slice(&4_000_000_000_u32.to_le_bytes());
    long.extend_from_slice(&[0; 30]);
    let mut many = many.into_bytes();
    many.extend_from_slice(&[0; 1000]);
    // The count of vertices is in the fourth line; the list's is in the body.
    for (bytes, line) in [(&many, Some(4)), (&long, None)] {
        let size_bytes = Some(bytes.len() as u64);
        let known = ReadOptions { size_bytes, ..options(OnDefect::Fail) };
        let error = read_with(bytes, &known).map(|(mesh, _)| mesh).unwrap_err();
        let FormatError::Input(found) = error else { panic!("{error:?}") };
        assert!(matches!(found.fault, Fault::CountImpossible { .. }), "{found:?}");
        assert_eq!(found.at.line, line);
    }
    assert_eq!(fault(&many).fault, Fault::Truncated { inside: "the vertices" });
    assert!(matches!(fault(&long).fault, Fault::Unsupported(_)));
}

#[test]
fn broken_headers_are_faults_with_a_line() {
    let cases = [
        ("solid x\n", 1),
        ("ply\nformat ascii 2.0\n", 2),
        ("ply\nformat utf8 1.0\n", 2),
        ("ply\nformat ascii 1.0\nelement vertex -3\n", 3),
        ("ply\nformat ascii 1.0\nelement vertex 3\nproperty real x\n", 4),
        ("ply\nformat ascii 1.0\nproperty float x\n", 3),
        ("ply\nformat ascii 1.0\nelement vertex 3\npropertx float x\n", 4),
        ("ply\nformat ascii 1.0\nelement face 0\nend_header\n", 4),
        ("ply\nelement vertex 3\nend_header\n", 3),
        ("ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nend_header\n", 3),
    ];
    for (text, line) in cases {
        let found = fault(text.as_bytes());
        assert!(matches!(found.fault, Fault::Syntax { .. }), "{found:?}");
        assert_eq!(found.at.line, Some(line), "{text}");
    }
    assert_eq!(fault(b"").fault, Fault::Empty);
    assert_eq!(fault(b"\xff\xfep\0").fault, Fault::Unsupported("UTF-16 text"));
    let comma = triangle(XYZ, INDICES, "0,5 0 0\n");
    assert_eq!(fault(&comma).at.line, Some(10));
}

#[test]
fn far_coordinates_keep_their_precision() {
    let xyz = XYZ.replace("float", "double");
    let body = "500000.125 5400000.25 100.5\n500001.125 5400000.25 100.5\n\
        500000.125 5400001.25 100.5\n3 0 1 2\n";
    let mesh = read(&triangle(&xyz, INDICES, body));
    assert_eq!(mesh.positions[2], [500_000.125, 5_400_001.25, 100.5]);
    let body = "1 2 3 1 2 3 1 2 3 3 0 1 2";
    let known = ReadOptions { origin: Origin::at([1024.0; 3]), ..options(OnDefect::Fail) };
    let (mesh, reader) = read_with(&triangle(XYZ, INDICES, body), &known).unwrap();
    assert_eq!((mesh.positions[0], reader.origin().get()), ([1.0, 2.0, 3.0], [1024.0; 3]));
}

#[test]
fn meshes_larger_than_a_batch_come_in_order() {
    let (vertices, triangles) = (100_000_u32, 150_001_u64);
    let options = WriteOptions { precision: Precision::Single, origin: [0.0; 3], colors: false };
    let mut bytes = Vec::new();
    let counts = Counts { vertices: u64::from(vertices), triangles };
    let mut writer = Writer::new(&mut bytes, counts, &options).unwrap();
    let positions = (0..vertices).map(|v| [v as f32, 0.0, 1.0]).collect();
    writer.write_batch(&Batch { positions, ..Batch::default() }).unwrap();
    let mut batch = Batch::default();
    batch.reset(Content::Faces);
    let face = |t: u64| [t % 99_998, t % 99_998 + 1, t % 99_998 + 2];
    (0..triangles).for_each(|t| batch.faces.push(&face(t)));
    writer.write_batch(&batch).unwrap();
    writer.finish().unwrap();
    drop(writer);
    for step in [1000, 4099, usize::MAX] {
        let open = Reader::open(trickle(&bytes, step), &self::options(OnDefect::Fail));
        let (mesh, _) = read_all(open.unwrap()).unwrap();
        assert!((0..vertices).all(|v| mesh.positions[v as usize] == [f64::from(v), 0.0, 1.0]));
        assert_eq!(mesh.faces.len() as u64, triangles);
        assert!((0..triangles).all(|t| mesh.faces[t as usize] == face(t)));
    }
}
