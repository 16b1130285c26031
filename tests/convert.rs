//! Soups and indexed meshes through the command, in every way that a mesh can be converted.

use std::collections::HashMap;

use meshmill::formats::{Format, Precision};

use crate::{
    command::{Folder, Surface},
    meshes::{self, Whole},
};

fn read(folder: &Folder, name: &str) -> Whole {
    meshes::read_file(&folder.path(name))
}

/// The triangles of a soup file, bit by bit.
fn soup(folder: &Folder, name: &str) -> Vec<[[u32; 3]; 3]> {
    let positions = read(folder, name).positions;
    positions.chunks_exact(3).map(|t| [t[0], t[1], t[2]].map(|p| p.map(f32::to_bits))).collect()
}

fn bits(triangles: &[[[f32; 3]; 3]]) -> Vec<[[u32; 3]; 3]> {
    triangles.iter().map(|triangle| triangle.map(|corner| corner.map(f32::to_bits))).collect()
}

/// The stages a run went through.
fn stages(report: &serde_json::Value) -> Vec<&str> {
    let stages = report["stages"].as_array().unwrap();
    stages.iter().map(|stage| stage["name"].as_str().unwrap()).collect()
}

/// More vertices than 0.9 MiB of table hold.
fn large() -> Surface {
    Surface::hills(300)
}

#[test]
fn corners_are_looked_up_in_memory_through_a_map_and_by_a_join() {
    let folder = Folder::new();
    let (local, scattered) = (large(), large().shuffled());
    for (name, surface) in [("local", &local), ("scattered", &scattered)] {
        folder.write(&format!("{name}.ply"), surface.bytes(Format::Ply));
        let expected = bits(&surface.corners());
        for memory in ["1GiB", "1MiB"] {
            let line = format!("soup {name}.ply -o out.soup --force --memory {memory}");
            let report = folder.report(&line);
            let is_joined = name == "scattered" && memory == "1MiB";
            assert_eq!(stages(&report).contains(&"dereference"), is_joined, "{name} {memory}");
            assert_eq!(soup(&folder, "out.soup"), expected, "{name} {memory}");
        }
    }
}

/// An ASCII PLY of `surface` with every third pair of triangles as a quad, some vertices NaN and
/// some corners out of range; and the triangles that are left of it.
fn damaged(surface: &Surface) -> (String, Vec<[[f32; 3]; 3]>) {
    let count = surface.vertices.len();
    let is_bad = |vertex: u64| vertex % 1013 == 5;
    let (mut faces, mut kept) = (Vec::new(), Vec::new());
    for (index, pair) in surface.triangles.chunks_exact(2).enumerate() {
        let [[a, b, c], [_, _, d]] = [pair[0], pair[1]];
        let polygons: Vec<Vec<u64>> = match index % 3 {
            0 => vec![vec![a, b, c, d]],
            _ if index % 100 == 7 => vec![vec![a, b, count as u64 + 3], vec![a, c, d]],
            _ => pair.iter().map(|triangle| triangle.to_vec()).collect(),
        };
        for polygon in polygons {
            faces.push(
                polygon.iter().fold(polygon.len().to_string(), |line, i| format!("{line} {i}")),
            );
            if polygon.iter().all(|&i| i < count as u64) {
                kept.push(polygon);
            }
        }
    }
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {count}\nproperty float x\nproperty float y\n\
        property float z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
        faces.len()
    );
    let mut positions = surface.vertices.clone();
    for (index, position) in (0..).zip(&mut positions) {
        if is_bad(index) {
            *position = [f32::NAN; 3];
        }
        let [x, y, z] = position;
        let row = if is_bad(index) { "0 nan 0".into() } else { format!("{x} {y} {z}") };
        text.extend([row.as_str(), "\n"]);
    }
    text += &faces.join("\n");
    text += "\n";
    let whole = Surface { vertices: positions, ..Surface::default() };
    let corners = kept.iter().flat_map(|polygon| triangulated(&whole, polygon));
    let finite = |t: &[[f32; 3]; 3]| t.iter().flatten().all(|c| c.is_finite());
    (text, corners.filter(finite).collect())
}

/// The triangles the product cuts a polygon into.
fn triangulated(surface: &Surface, polygon: &[u64]) -> Vec<[[f32; 3]; 3]> {
    let positions: Vec<_> = polygon.iter().map(|i| surface.vertices[*i as usize]).collect();
    let mut triangles = Vec::new();
    meshmill::geometry::triangulate(&positions, &mut triangles);
    triangles.iter().map(|t| t.map(|corner| positions[corner as usize])).collect()
}

#[test]
fn polygons_and_bad_records_come_out_the_same_in_all_three_ways() {
    let folder = Folder::new();
    let mut scattered = large();
    // Pairs stay together: they become quads.
    let mut pairs: Vec<_> = scattered.triangles.chunks_exact(2).map(<[_]>::to_vec).collect();
    crate::command::Dice(3).shuffle(&mut pairs);
    scattered.triangles = pairs.concat();
    for (name, surface) in [("local", large()), ("scattered", scattered)] {
        let (text, expected) = damaged(&surface);
        folder.write(&format!("{name}.ply"), text);
        let mut defects = Vec::new();
        for memory in ["1GiB", "1MiB"] {
            let line = format!("soup {name}.ply -o out.soup --force --memory {memory}");
            let said = folder.run(&line);
            assert_eq!(said.code, Some(3), "{}", said.stderr);
            let report = folder.report(&format!("{line} --on-defect skip"));
            let is_joined = name == "scattered" && memory == "1MiB";
            assert_eq!(stages(&report).contains(&"dereference"), is_joined, "{name} {memory}");
            assert_eq!(soup(&folder, "out.soup"), bits(&expected), "{name} {memory}");
            let counts = report["defects"].as_array().unwrap().iter();
            let counts: Vec<_> = counts.map(|d| (d["kind"].clone(), d["count"].clone())).collect();
            assert!(counts.len() >= 2, "{counts:?}");
            defects.push(counts);
        }
        assert_eq!(defects[0], defects[1], "{name}");
    }
}

/// A mesh whose zeros have both signs, in no order.
fn with_zeros() -> Surface {
    let mut surface = Surface::hills(130).shuffled();
    for (index, position) in surface.vertices.iter_mut().enumerate() {
        if index % 7 == 0 {
            position[2] = if index % 2 == 0 { 0.0 } else { -0.0 };
        }
    }
    // The same place twice, with either sign.
    let at = surface.vertices[0];
    surface.vertices.push([at[0], at[1], -at[2]]);
    let last = surface.vertices.len() as u64 - 1;
    surface.triangles.extend([[last, 1, 200], [0, 3, 300]]);
    surface
}

#[test]
fn welding_numbers_by_first_use_in_memory_and_on_disk() {
    let folder = Folder::new();
    for surface in [with_zeros(), with_zeros().colored()] {
        folder.write("in.soup", surface.bytes(Format::Soup));
        folder.done("weld in.soup -o memory.ply --force --memory 1GiB");
        let report = folder.report("weld in.soup -o disk.ply --force --memory 1MiB");
        assert!(report["temporary_bytes_peak"].as_u64().unwrap() > 0, "{report}");
        assert!(folder.read("memory.ply") == folder.read("disk.ply"), "other bytes");
        let (mut numbers, mut vertices, mut triangles) = (HashMap::new(), Vec::new(), Vec::new());
        for triangle in &surface.triangles {
            triangles.push(triangle.map(|index| {
                let position = surface.vertices[index as usize];
                *numbers.entry(position.map(|c| (c + 0.0).to_bits())).or_insert_with(|| {
                    vertices.push((position, surface.colors.get(index as usize).copied()));
                    vertices.len() as u64 - 1
                })
            }));
        }
        let whole = read(&folder, "memory.ply");
        assert_eq!(whole.triangles(), triangles);
        let positions: Vec<_> = vertices.iter().map(|v| v.0.map(f32::to_bits)).collect();
        let ours: Vec<_> = whole.positions.iter().map(|p| p.map(f32::to_bits)).collect();
        assert_eq!(ours, positions);
        assert_eq!(whole.colors, vertices.iter().filter_map(|v| v.1).collect::<Vec<_>>());
    }
}

#[test]
fn soup_to_mesh_to_soup_is_the_identity() {
    let folder = Folder::new();
    let mut surface = Surface::hills(60).shuffled().colored();
    // Welding keeps the sign of a zero's first use: leave them out here.
    surface.vertices.iter_mut().flatten().for_each(|coordinate| *coordinate += 0.5);
    folder.write("a.soup", surface.bytes(Format::Soup));
    for memory in ["1GiB", "1MiB"] {
        folder.done(&format!("weld a.soup -o b.ply --force --memory {memory}"));
        folder.done(&format!("soup b.ply -o c.soup --force --memory {memory}"));
        folder.done(&format!("weld c.soup -o d.ply --force --memory {memory}"));
        assert!(folder.read("b.ply") == folder.read("d.ply"));
        assert_eq!(soup(&folder, "c.soup"), bits(&surface.corners()));
        assert_eq!(read(&folder, "a.soup").colors, read(&folder, "c.soup").colors);
    }
}

#[test]
fn several_inputs_are_one_mesh_in_their_order() {
    let folder = Folder::new();
    let [first, mut second] = [Surface::hills(9), Surface::hills(12)];
    second.vertices.iter_mut().for_each(|position| position[0] += 1.0);
    folder.write("a.ply", first.bytes(Format::Ply));
    folder.write("b.stl", second.bytes(Format::Stl));
    folder.write("c.obj", first.bytes(Format::Obj));
    folder.done("soup a.ply b.stl c.obj -o out.soup");
    let expected = [first.corners(), second.corners(), first.corners()].concat();
    assert_eq!(soup(&folder, "out.soup"), bits(&expected));
    folder.done("simplify a.ply b.stl c.obj -o three.ply --cells 8");
    folder.done("simplify out.soup -o one.ply --cells 8");
    assert!(folder.read("three.ply") == folder.read("one.ply"), "other bytes");
    folder.done("weld a.ply b.stl c.obj -o welded.ply");
    assert_eq!(read(&folder, "welded.ply").triangles().len(), expected.len());
}

/// UTM: metres, half a million east and five million north.
const FAR: [f64; 3] = [499_712.0, 5_399_552.0, 1024.0];

#[test]
fn coordinates_far_away_keep_what_single_precision_has_of_their_offset() {
    let folder = Folder::new();
    let mut surface = Surface::hills(30);
    surface.vertices.iter_mut().flatten().for_each(|coordinate| *coordinate *= 500.0);
    for format in [Format::Ply, Format::Obj] {
        let name = format!("in.{}", format.name());
        folder.write(&name, surface.written(format, Precision::Double, FAR));
        let input = read(&folder, &name);
        assert_ne!(input.origin.get(), [0.0; 3]);
        folder.done(&format!("soup {name} -o out.soup --force"));
        folder.done("weld out.soup -o welded.ply --force");
        folder.done(&format!("simplify {name} -o out.ply --force --cells 2097152"));
        for output in ["out.soup", "welded.ply", "out.ply"] {
            check_far(&read(&folder, output), &surface, output);
        }
        for output in ["welded.ply", "out.ply"] {
            let header = folder.read(output);
            let header = String::from_utf8_lossy(&header[..200]).into_owned();
            assert!(header.contains("property double x"), "{output}: {header}");
        }
    }
}

/// Every vertex lies within 0.1 mm of one of the surface's, in the same triangles.
fn check_far(whole: &Whole, surface: &Surface, name: &str) {
    let origin = whole.origin.get();
    let absolute = |p: [f32; 3]| -> [f64; 3] {
        std::array::from_fn(|axis| f64::from(p[axis]) + origin[axis] - FAR[axis])
    };
    let triangles: Vec<[[f32; 3]; 3]> = if whole.declared.indexed {
        let position = |index: u64| whole.positions[index as usize];
        whole.triangles().iter().map(|t| t.map(position)).collect()
    } else {
        whole.positions.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect()
    };
    // Clustering orders triangles anew: compare the sorted centres.
    let centre = |t: [[f64; 3]; 3]| -> [f64; 3] {
        std::array::from_fn(|axis| (t[0][axis] + t[1][axis] + t[2][axis]) / 3.0)
    };
    let by_place = |a: &[f64; 3], b: &[f64; 3]| {
        let coarse = |c: &[f64; 3]| c.map(|c| (c * 10.0).round() as i64);
        coarse(a).cmp(&coarse(b))
    };
    let mut ours: Vec<_> = triangles.iter().map(|t| centre(t.map(absolute))).collect();
    let mut theirs: Vec<_> =
        surface.corners().iter().map(|t| centre(t.map(|p| p.map(f64::from)))).collect();
    ours.sort_by(by_place);
    theirs.sort_by(by_place);
    assert_eq!(ours.len(), theirs.len(), "{name}");
    for (ours, theirs) in ours.iter().zip(&theirs) {
        let apart = (0..3).map(|axis| (ours[axis] - theirs[axis]).abs()).fold(0.0, f64::max);
        assert!(apart < 1e-3, "{name}: {ours:?} {theirs:?}");
    }
}

#[test]
fn compression_works_on_both_sides() {
    let folder = Folder::new();
    let surface = Surface::hills(40);
    folder.write("in.stl", surface.bytes(Format::Stl));
    folder.done("simplify in.stl -o plain.ply --cells 20");
    for suffix in ["gz", "zst"] {
        folder.done(&format!("weld in.stl -o mesh.ply.{suffix}"));
        folder.done(&format!("soup mesh.ply.{suffix} -o soup.stl.{suffix}"));
        folder.done(&format!("simplify soup.stl.{suffix} -o out.ply.{suffix} --cells 20"));
        folder.done(&format!("soup soup.stl.{suffix} -o back.stl --force"));
        assert_eq!(soup(&folder, "back.stl"), bits(&surface.corners()), "{suffix}");
        let (ours, plain) =
            (read(&folder, &format!("out.ply.{suffix}")), read(&folder, "plain.ply"));
        assert_eq!((ours.positions, ours.faces), (plain.positions, plain.faces), "{suffix}");
        assert!(folder.read(&format!("soup.stl.{suffix}")).len() < 84 + 50 * 3200);
    }
}

#[test]
fn meshes_flow_through_pipes() {
    let folder = Folder::new();
    let generated = folder.done("generate sphere --triangles 3000 -o - --output-format soup");
    folder.done("generate sphere --triangles 3000 -o sphere.soup");
    for (job, format) in [
        ("simplify", "--cells 20 --output-format ply"),
        ("soup", "--output-format stl"),
        ("weld", "--output-format obj"),
    ] {
        let piped =
            folder.run_with(&format!("{job} - --input-format soup -o - {format}"), &generated);
        assert_eq!(piped.code, Some(0), "{}", piped.stderr);
        let direct = folder.done(&format!("{job} sphere.soup -o - {format}"));
        assert!(piped.stdout == direct, "{job}: other bytes");
        let out = format!("out.{}", format.rsplit(' ').next().unwrap());
        folder.done(&format!(
            "{job} sphere.soup -o {out} {}",
            format.split("--output").next().unwrap()
        ));
        assert!(folder.read(&out) == direct, "{job}: a file has other bytes");
    }
    // Recognised by its content, and only once readable, needed twice for a count.
    let piped = folder.run_with("simplify - -o few.ply -t 300", &generated);
    assert_eq!(piped.code, Some(0), "{}", piped.stderr);
    folder.done("simplify sphere.soup -o same.ply -t 300");
    assert!(folder.read("few.ply") == folder.read("same.ply"));
}
