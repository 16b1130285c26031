//! What must happen to each file of the torture folder, by the rules of its format.
//!
//! The rows were written with the files in one window and the formats' definitions in the other,
//! not from what the readers do. Where a rule leaves a choice, a comment says which was made.

use meshmill::formats::DefectKind::{
    self, CountUnset, IndexOutOfRange as BadIndex, NotFinite as BadNumber, TooFewCorners,
    TrailingBytes,
};

use super::outcome::{Expected, FaultKind, Place};
use Expected::{Fault, Mesh, NoFaces, Soup};
use FaultKind::{
    CountImpossible, Empty, IndexOutOfRange, NotFinite, Syntax, Truncated, Unsupported,
};

/// One file.
pub(super) struct Row {
    pub(super) file: &'static str,
    /// What happens when a defect ends the read.
    pub(super) fail: Expected,
    /// What happens when defects are skipped, where that differs.
    pub(super) skip: Option<Expected>,
    /// What a read that succeeds must have noticed; nothing else.
    pub(super) defects: &'static [(DefectKind, u64)],
}

impl Row {
    const fn skipping(self, skip: Expected) -> Self {
        Self { skip: Some(skip), ..self }
    }

    const fn noticing(self, defects: &'static [(DefectKind, u64)]) -> Self {
        Self { defects, ..self }
    }

    const fn colored(mut self, first: [u8; 4]) -> Self {
        if let Mesh { color, .. } | NoFaces { color, .. } = &mut self.fail {
            *color = Some(first);
        }
        self
    }
}

const fn row(file: &'static str, fail: Expected) -> Row {
    Row { file, fail, skip: None, defects: &[] }
}

const fn soup(triangles: u64) -> Expected {
    Soup { triangles }
}

const fn mesh(vertices: u64, faces: u64, triangles: u64) -> Expected {
    Mesh { vertices, faces, triangles, color: None }
}

/// The sphere most files were made from.
const fn sphere() -> Expected {
    mesh(258, 512, 512)
}

/// The reader succeeds; a job that needs faces then fails with `Fault::NoFaces`.
const fn no_faces(vertices: u64) -> Expected {
    NoFaces { vertices, color: None }
}

const fn fault(kind: FaultKind, place: Place) -> Expected {
    Fault { kind, place }
}

const ANYWHERE: Place = Place { line: None, record: None, bytes: None };

const fn line(line: u64) -> Place {
    Place { line: Some(line), ..ANYWHERE }
}

/// Within these bytes, both ends included: a rule says which record is wrong, not whether its
/// first or its offending byte is named.
const fn bytes(first: u64, last: u64) -> Place {
    Place { bytes: Some((first, last)), ..ANYWHERE }
}

const fn record(record: u64, first_byte: u64, last_byte: u64) -> Place {
    Place { record: Some(record), ..bytes(first_byte, last_byte) }
}

/// Every file, by format.
pub(super) fn rows() -> impl Iterator<Item = &'static Row> {
    STL.iter().chain(PLY).chain(OBJ).chain(OFF)
}

/// A binary STL is 84 bytes and 50 a triangle; an ASCII one is words between white space, so line
/// ends of any kind are alike. Its colours are not vertex colours.
const STL: &[Row] = &[
    row("PyMesh__cube.stl", soup(12)),
    // 84 bytes of header with a count of 0, and one byte that is no triangle.
    row("PyMesh__empty.stl", no_faces(0)).noticing(&[(TrailingBytes, 1)]),
    row("ascii.stl", soup(512)),
    // "0,98": a number has a point in every locale.
    row("ascii_comma_decimal.stl", fault(Syntax, Place { record: Some(0), ..line(5) })),
    row("ascii_cr_only.stl", soup(512)),
    row("ascii_crlf_upper.stl", soup(512)),
    // 846 whole lines, and a first letter of "endloop".
    row("ascii_truncated.stl", fault(Truncated, Place { record: Some(120), ..line(847) })),
    row("ascii_two_solids.stl", soup(30)),
    row("assimp__3DSMaxExport.STL", soup(2000)),
    row("assimp__Spider_ascii.stl", soup(1368)),
    row("assimp__Spider_binary.stl", soup(1368)),
    row("assimp__sphereWithHole.stl", soup(285)),
    row("assimp__triangle.stl", soup(1)),
    row("assimp__triangle_with_empty_solid.stl", soup(1)),
    row("assimp__triangle_with_two_solids.stl", soup(2)),
    row("attr_colour.stl", soup(512)),
    // Writers that stream do not know the count: all ones or 0 stand for "until the end".
    row("count_ffffffff.stl", soup(512)).noticing(&[(CountUnset, 1)]),
    // The place is where the data stop, not the count's: that is where to look for the rest.
    row("count_too_big.stl", fault(CountImpossible, record(512, 25684, 25684))),
    row("count_zero_with_data.stl", soup(512)).noticing(&[(CountUnset, 1)]),
    row("degenerate_tris.stl", soup(512)),
    row("draco__test_sphere.stl", soup(224)),
    row("draco__test_sphere_ascii.stl", soup(224)),
    row("duplicate_faces.stl", soup(612)),
    row("empty.stl", fault(Empty, ANYWHERE)),
    row("far_from_origin_utm.stl", soup(512)),
    row("half_flipped.stl", soup(512)),
    row("header_only_79B.stl", fault(Truncated, bytes(0, 79))),
    // Within single precision, if not by much.
    row("huge_1e30.stl", soup(512)),
    row("jittered_soup_unweldable.stl", soup(512)),
    row("nan_inf.stl", fault(NotFinite, record(5, 334, 383)))
        .skipping(soup(510))
        .noticing(&[(BadNumber, 2)]),
    row("negative_zero.stl", soup(512)),
    row("ok.stl", soup(512)),
    // "solid", "facet" and all, but 84 + 50 · 512 bytes with zeros in the header.
    row("solid_header_binary.stl", soup(512)),
    row("tiny_1e-30.stl", soup(512)),
    // Triangles are complete; what follows them is no part of the mesh.
    row("trailing_garbage.stl", soup(512)).noticing(&[(TrailingBytes, 20)]),
    // 511 triangles and a part of one. Skipping never hides that an input was cut. Known by its
    // size before anything is read, but it is the same fault as without.
    row("truncated_mid_record.stl", fault(Truncated, record(511, 25634, 25661))),
];

/// The header is lines of words and says what follows. ASCII data are numbers between white
/// space. A binary body begins behind the line end after `end_header`, whatever its bytes are.
const PLY: &[Row] = &[
    row("PyMesh__empty.ply", no_faces(0)),
    // One line per element is custom; the numbers, in order, say all the same.
    row("ascii_all_on_one_line.ply", mesh(3, 1, 1)),
    // Line 3 is a comment without the word "comment", a well-known exporter's slip. It stands
    // before any element, so nothing can depend on it; it is named among what is dropped.
    row("assimp__Wuson.ply", mesh(11184, 3732, 3732)),
    // Cut inside the third property, line 7: there is no end_header.
    row(
        "assimp__crash-30d6d0f7c529b3b66b4131700b7a4580cd7082df.ply",
        fault(Truncated, bytes(118, 159)),
    ),
    row("assimp__cube.ply", mesh(8, 6, 12)),
    row("assimp__cube_binary.ply", mesh(8, 12, 12)),
    // Only the last header line ends in CR LF.
    row("assimp__cube_binary_header_with_RN_newline.ply", mesh(8, 12, 12)),
    // The first coordinate's first byte is a line feed, and belongs to the coordinate.
    row("assimp__cube_binary_starts_with_nl.ply", mesh(8, 6, 12)),
    row("assimp__cube_uv.ply", mesh(24, 6, 12)),
    row("assimp__empty.ply", fault(Empty, ANYWHERE)),
    row("assimp__float-color.ply", mesh(3, 1, 1)).colored([0, 0, 255, 255]),
    // A list is announced for each vertex and missing: where its count should be stands the next
    // vertex's 7.941797.
    row("assimp__issue623.ply", fault(Syntax, line(15))),
    row("assimp__points.ply", no_faces(4)).colored([255, 255, 255, 255]),
    // "diffuse_red" and so on are the names of the first scanners' files for the same thing.
    row("assimp__pond.0.ply", no_faces(70051)).colored([0x39, 0x3b, 0x13, 255]),
    row("be_double_ushortcount_uint.ply", sphere()),
    row("big_endian.ply", sphere()),
    row("bomb_counts.ply", fault(CountImpossible, line(3))),
    row("comment_mentions_end_header.ply", sphere()),
    row("concave_prism_quads_ngon.ply", mesh(10, 7, 16)),
    row("crlf_header_binary.ply", sphere()),
    // Header lines end in CR alone, so that end_header is followed by exactly one byte; in the
    // second file another CR comes next and is data.
    row("draco__Box.ply", mesh(24, 8, 12)).colored([0xfa, 0xfa, 0xfa, 255]),
    row("draco__delim_test.ply", mesh(24, 8, 12)).colored([0xfa, 0xfa, 0xfa, 255]),
    row("draco__cube_att.ply", mesh(24, 12, 12)),
    row("draco__cube_quads.ply", mesh(8, 6, 12)),
    row("draco__float_inf_point_cloud.ply", fault(NotFinite, Place { record: Some(0), ..line(8) }))
        .skipping(no_faces(16))
        .noticing(&[(BadNumber, 3)]),
    row("draco__int_point_cloud.ply", no_faces(16)),
    row("draco__test_extra_whitespace.ply", mesh(3, 1, 1)).colored([209, 0, 122, 255]),
    row("draco__test_generic.ply", mesh(114, 224, 224)).colored([209, 0, 122, 255]),
    row("draco__test_more_datatypes.ply", mesh(3, 1, 1)).colored([209, 0, 122, 255]),
    row("draco__test_pos_color.ply", mesh(114, 224, 224)).colored([209, 0, 122, 255]),
    row("draco__test_pos_color_ascii.ply", mesh(114, 224, 224)).colored([209, 0, 122, 255]),
    // These colours are the faces'.
    row("extra_list_before_indices.ply", sphere()),
    row("face_with_0_1_2_verts.ply", mesh(3, 1, 1)).noticing(&[(TooFewCorners, 3)]),
    row("faces_before_vertices.ply", sphere()),
    row("index_negative.ply", fault(IndexOutOfRange(-1), record(7, 3360, 3372)))
        .skipping(mesh(258, 511, 511))
        .noticing(&[(BadIndex, 1)]),
    row("index_out_of_range.ply", fault(IndexOutOfRange(263), record(7, 3360, 3372)))
        .skipping(mesh(258, 511, 511))
        .noticing(&[(BadIndex, 1)]),
    row("int_count_short_index.ply", sphere()),
    // 512 faces, and a first list of 4,294,967,280 corners, in 4 bytes.
    row("list_count_bomb.ply", fault(CountImpossible, ANYWHERE)),
    row("nan_vertex.ply", fault(NotFinite, record(3, 209, 220)))
        .skipping(sphere())
        .noticing(&[(BadNumber, 1)]),
    row("ok.ply", sphere()),
    row("reordered_mixed_props_colour_normal.ply", sphere()).colored([0xfe, 0x7f, 0x7f, 255]),
    // Face 473 is cut.
    row("truncated_faces.ply", fault(Truncated, bytes(9418, 9425))),
    // 83 whole vertices of 258.
    row("truncated_vertices.ply", fault(CountImpossible, line(3))),
    row("user_element_between.ply", mesh(3, 1, 1)),
];

/// A statement a line; `v` has three coordinates, with nothing, a weight or a colour behind them;
/// indices count from 1, or from the last vertex backwards; what is not geometry is skipped.
const OBJ: &[Row] = &[
    row("PyMesh__empty.obj", fault(Empty, ANYWHERE)),
    // Vertices of two coordinates.
    row("PyMesh__polygon.obj", fault(Syntax, line(1))),
    row("PyMesh__quad_s1.obj", fault(Syntax, line(1))),
    row("PyMesh__square_2D.obj", fault(Syntax, line(5))),
    row("PyMesh__star.obj", mesh(32, 1, 30)),
    row("assimp__box.obj", mesh(8, 6, 12)),
    row("assimp__box_UTF16BE.obj", fault(Unsupported, bytes(0, 0))),
    // One face goes round 1 2 3 4 for 936 corners: a poor polygon, but no rule forbids it.
    row("assimp__box_longline.obj", mesh(8, 6, 934 + 10)),
    row("assimp__box_mat_with_spaces.obj", mesh(8, 6, 12)),
    row("assimp__box_without_lineending.obj", mesh(8, 6, 12)),
    row("assimp__concave_polygon.obj", mesh(64, 1, 64)),
    row("assimp__cube_mtllib_after_g.obj", mesh(8, 12, 12)),
    row("assimp__cube_with_vertexcolors.obj", mesh(8, 12, 12)).colored([124, 110, 120, 255]),
    row("assimp__cube_with_vertexcolors_uni.obj", mesh(8, 12, 12)).colored([0, 0, 0, 255]),
    row("assimp__empty.obj", fault(Empty, ANYWHERE)),
    // Faces 4 12 2 1 and 0 7 8 5 of eight vertices; the -1 between them is the eighth. The first
    // comes first in the file, but is wrong at its end only: a twelfth vertex might have followed.
    row("assimp__malformed.obj", fault(IndexOutOfRange(0), line(28)))
        .skipping(mesh(8, 4, 8))
        .noticing(&[(BadIndex, 2)]),
    // An "f" of no corners.
    row("assimp__malformed2.obj", mesh(8, 5, 10)).noticing(&[(TooFewCorners, 1)]),
    row("assimp__multiple_spaces.obj", mesh(4, 1, 1)),
    // "+2." and "2.E1" are numbers, "3.1+e2" is none.
    row("assimp__number_formats.obj", fault(Syntax, line(11))),
    // Colours are customary, not defined; for vertices without one among others with one, white.
    row("assimp__only_a_part_of_vertexcolors.obj", mesh(5, 3, 3)).colored([255, 255, 255, 255]),
    row("assimp__point_cloud.obj", no_faces(3)),
    row("assimp__regr01.obj", mesh(2108, 2710, 2710)),
    row("assimp__regr_3429812.obj", mesh(4, 3, 4)),
    row("assimp__spider.obj", mesh(762, 1368, 1368)),
    row("assimp__testline.obj", no_faces(8)),
    row("assimp__testmixed.obj", mesh(8, 6, 12)),
    row("assimp__testpoints.obj", no_faces(8)),
    row("bowtie_vertex.obj", mesh(5, 2, 2)),
    row("crlf.obj", sphere()),
    row("draco__cube_att.obj", mesh(8, 12, 12)),
    row("draco__cube_att_partial.obj", mesh(8, 12, 12)),
    row("draco__cube_quads.obj", mesh(8, 6, 12)),
    row("draco__deg_faces.obj", mesh(6, 4, 4)),
    row("draco__degenerate_mesh.obj", mesh(3, 1, 1)),
    row("draco__empty_name.obj", mesh(3, 1, 1)),
    row("draco__eof_test.obj", mesh(3, 1, 1)),
    row("draco__extra_vertex.obj", mesh(10, 3, 3)),
    row("draco__inf_nan.obj", fault(NotFinite, line(1)))
        .skipping(mesh(3, 1, 1))
        .noticing(&[(BadNumber, 3)]),
    row("draco__mat_test.obj", mesh(3576, 1300, 1300)),
    row("draco__multiple_isolated_triangles.obj", mesh(15, 5, 5)),
    row("draco__non_manifold_wrap.obj", mesh(10, 12, 12)),
    row("draco__octagon.obj", mesh(8, 1, 6)),
    row("draco__octagon_preserved.obj", mesh(8, 1, 6)),
    row("draco__test_lines.obj", no_faces(484)),
    row("draco__test_nm.obj", mesh(114, 170, 170)),
    // Its faces name normals that are not there; nobody reads normals.
    row("draco__test_wrong_attribute_mapping.obj", mesh(3, 1, 1)),
    row("draco__triangle_with_degenerate_tex_coords.obj", mesh(3, 1, 1)),
    row("exponents_tabs.obj", sphere()),
    // Every face comes before every vertex.
    row("forward_reference.obj", sphere()),
    row("index_zero.obj", fault(IndexOutOfRange(0), line(259)))
        .skipping(sphere())
        .noticing(&[(BadIndex, 1)]),
    row("interleaved_v_f.obj", mesh(1536, 512, 512)),
    // One more face, in three lines.
    row("line_continuation.obj", mesh(258, 513, 513)),
    row("mobius.obj", mesh(48, 48, 48)),
    row("nan.obj", fault(NotFinite, line(1)))
        .skipping(mesh(259, 512, 512))
        .noticing(&[(BadNumber, 1)]),
    row("negative.obj", sphere()),
    row("nonmanifold_edge_5fan.obj", mesh(7, 5, 5)),
    row("ok.obj", sphere()),
    row("oob.obj", fault(IndexOutOfRange(267), line(771)))
        .skipping(sphere())
        .noticing(&[(BadIndex, 1)]),
    row("trailing_comment_no_eol.obj", sphere()),
    // x y z and a colour; the name promises a weight, the file has none.
    row("v_with_w_and_rgb.obj", sphere()).colored([128, 64, 255, 255]),
    row("vslashslashn.obj", sphere()),
    row("vtvn.obj", sphere()),
];

/// The word OFF, three counts, then that many vertices and faces.
const OFF: &[Row] = &[
    row("PyMesh__empty.off", no_faces(0)),
    row("assimp__Cube.off", mesh(8, 6, 12)),
    row("assimp__OutOfMemory.off", fault(CountImpossible, line(2))),
    row("assimp__empty.off", fault(Empty, ANYWHERE)),
    // "3 4": the third count, of edges, is left out by many, and nobody uses it. Then three
    // vertices follow, and four faces do not.
    row("assimp__invalid.off", fault(Truncated, bytes(34, 53))),
];
