//! Decimation through the command: exact counts, topology kept, the same bytes however it is done.

use std::collections::HashMap;

use meshmill::formats::Format;

use crate::{
    command::{Dice, Folder, Surface},
    meshes::{self, Whole, assert_as_wide},
};

fn read(folder: &Folder, name: &str) -> Whole {
    meshes::read_file(&folder.path(name))
}

/// Edges by the number of their faces: (one, two, more), and those with two faces that run the
/// same way.
fn edges(whole: &Whole) -> (usize, usize, usize, usize) {
    let mut edges = HashMap::<[u64; 2], (usize, i64)>::new();
    for face in whole.triangles() {
        for k in 0..3 {
            let (a, b) = (face[k], face[(k + 1) % 3]);
            let edge = edges.entry([a.min(b), a.max(b)]).or_default();
            edge.0 += 1;
            edge.1 += if a < b { 1 } else { -1 };
        }
    }
    let count = |test: &dyn Fn(&(usize, i64)) -> bool| edges.values().filter(|e| test(e)).count();
    (
        count(&|edge| edge.0 == 1),
        count(&|edge| edge.0 == 2),
        count(&|edge| edge.0 > 2),
        count(&|edge| edge.0 == 2 && edge.1 != 0),
    )
}

/// Metrics, and what the command is told.
const METRICS: [&str; 2] = ["--metric quadric", "--metric volume"];

#[test]
fn a_closed_surface_stays_closed_and_meets_the_count() {
    let folder = Folder::new();
    folder.done("generate sphere --triangles 20k -o in.ply");
    let targets = METRICS.iter().flat_map(|metric| [5000, 501, 40].map(|count| (metric, count)));
    for (metric, target) in targets {
        folder.done(&format!("simplify in.ply -o out.ply --force -t {target} {metric}"));
        let whole = read(&folder, "out.ply");
        // A closed surface has an even number of triangles.
        assert_eq!(whole.triangles().len(), target / 2 * 2);
        let (open, inner, more, twisted) = edges(&whole);
        assert_eq!((open, more, twisted), (0, 0, 0), "{inner} edges with two faces");
        let euler = whole.positions.len() + whole.triangles().len();
        assert_eq!(euler - inner, 2, "it is still one sphere");
    }
}

/// What a closed surface encloses.
fn volume(whole: &Whole) -> f64 {
    let corner = |v: u64| whole.positions[v as usize].map(f64::from);
    let parts = whole.triangles().into_iter().map(|face| {
        let [[a, b, c], [d, e, f], [g, h, i]] = face.map(corner);
        (a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)) / 6.0
    });
    parts.sum()
}

#[test]
fn the_metric_of_volumes_keeps_the_volume() {
    let folder = Folder::new();
    for (kind, triangles) in [("sphere", "20k"), ("gyroid", "400k")] {
        folder.done(&format!("generate {kind} --triangles {triangles} -o in.ply --force"));
        let before = volume(&read(&folder, "in.ply"));
        folder.done("simplify in.ply -o out.ply --force --ratio 5% --metric volume");
        let after = volume(&read(&folder, "out.ply"));
        assert!((after - before).abs() < 1e-4 * before.abs(), "{kind}: {before} {after}");
    }
}

#[test]
fn a_boundary_stays_where_it_is_and_any_count_is_met() {
    let folder = Folder::new();
    let surface = Surface::hills(120);
    folder.write("in.ply", surface.bytes(Format::Ply));
    let targets = METRICS.iter().flat_map(|metric| [4001, 4000, 333].map(|count| (metric, count)));
    for (metric, target) in targets {
        folder.done(&format!("simplify in.ply -o out.ply --force -t {target} {metric}"));
        let whole = read(&folder, "out.ply");
        assert_eq!(whole.triangles().len(), target);
        let (open, _, more, twisted) = edges(&whole);
        assert!(open > 3 && more == 0 && twisted == 0, "{open} {more} {twisted}");
        assert_as_wide(&surface.vertices, &whole.positions);
    }
}

#[test]
fn the_bytes_are_the_same_for_any_order_threads_and_memory() {
    let folder = Folder::new();
    // Three slabs.
    folder.done("generate gyroid --triangles 700k -o in.ply");
    folder.done("soup in.ply -o in.stl");
    for metric in METRICS.iter().rev() {
        let options = format!("--ratio 5% --force {metric}");
        folder.done(&format!("simplify in.ply -o one.ply {options} -j 1 --memory 1GiB"));
        let expected = folder.read("one.ply");
        for (name, means) in [
            ("in.ply", "-j 2 --memory 1GiB"),
            ("in.ply", "-j 3 --memory 160MiB"),
            ("in.stl", "-j 2 --memory 128MiB"),
        ] {
            folder.done(&format!("simplify {name} -o two.ply {options} {means}"));
            assert!(folder.read("two.ply") == expected, "{name} {metric} {means}");
        }
        let (open, _, more, twisted) = edges(&read(&folder, "two.ply"));
        assert_eq!((open, more, twisted), (0, 0, 0), "no seam between slabs: {metric}");
    }
    let expected = folder.read("one.ply");
    let mut stl = folder.read("in.stl");
    Dice(7).shuffle(stl[84..].as_chunks_mut::<50>().0);
    folder.write("shuffled.stl", stl);
    folder.done("simplify shuffled.stl -o two.ply --force --ratio 5% -j 2 --memory 128MiB");
    assert!(folder.read("two.ply") == expected, "shuffled");
    let (open, _, more, twisted) = edges(&read(&folder, "two.ply"));
    assert_eq!((open, more, twisted), (0, 0, 0), "no seam between slabs");
}

#[test]
fn many_threads_keep_within_the_memory() {
    let folder = Folder::new();
    folder.done("generate gyroid --triangles 2M -o in.soup");
    let (budget, beside) = (96 << 20, 64 << 20);
    for method in ["stream", "hybrid", "cluster"] {
        let line = format!("simplify in.soup -o {method}.ply --method {method} --ratio 1%");
        let report = folder.report(&format!("{line} --memory 96MiB -j 16"));
        let peak = report["peak_memory_bytes"].as_u64().unwrap();
        assert!(peak < budget + beside, "{method}: {peak}");
    }
}

#[test]
fn a_sort_leaves_memory_for_the_slabs_of_one_thread() {
    let folder = Folder::new();
    folder.done("generate gyroid --triangles 2M -o in.stl");
    folder.scatter("in.stl", "in.stl");
    let line = "simplify in.stl -o out.ply --ratio 10% --memory 112MiB -j 1";
    let report = folder.report(line);
    assert_eq!(report["method"], "stream");
    assert_eq!(report["decimate"]["sorted_on_disk"], true);
}

#[test]
fn colours_travel_with_their_vertices() {
    let folder = Folder::new();
    let mut surface = Surface::hills(80);
    let color = |[x, y, _]: &[f32; 3]| [(x * 255.0) as u8, (y * 255.0) as u8, 128, 255];
    surface.colors = surface.vertices.iter().map(color).collect();
    folder.write("in.ply", surface.bytes(Format::Ply));
    for metric in METRICS {
        folder.done(&format!("simplify in.ply -o out.ply --force --ratio 20% {metric}"));
        assert_colors_are_near(&surface, &read(&folder, "out.ply"));
    }
}

fn assert_colors_are_near(surface: &Surface, whole: &Whole) {
    assert_eq!(whole.colors.len(), whole.positions.len());
    // Each colour lies near that of the nearest original vertex.
    let mut far = 0;
    for (position, color) in whole.positions.iter().zip(&whole.colors) {
        let distance = |other: &[f32; 3]| (0..3).map(|k| (other[k] - position[k]).powi(2)).sum();
        let nearest = (0..surface.vertices.len())
            .min_by(|a, b| {
                let (a, b): (f32, f32) =
                    (distance(&surface.vertices[*a]), distance(&surface.vertices[*b]));
                a.total_cmp(&b)
            })
            .unwrap();
        let original = surface.colors[nearest];
        far += usize::from((0..3).any(|k| original[k].abs_diff(color[k]) > 48));
    }
    assert!(far * 20 < whole.positions.len(), "{far} of {}", whole.positions.len());
}

#[test]
fn what_is_no_manifold_is_left_alone_and_counted() {
    // Three squares of two triangles that share one edge, and a fine sheet beside them.
    let folder = Folder::new();
    let mut surface = Surface::hills(30);
    let first = surface.vertices.len() as u64;
    surface.vertices.extend([[0.0, 0.0, 9.0], [0.0, 1.0, 9.0]]);
    for (k, [x, z]) in [[1.0, 9.0], [-1.0, 9.0], [0.0, 10.0]].into_iter().enumerate() {
        surface.vertices.extend([[x, 0.0, z], [x, 1.0, z]]);
        let (p, q) = (first + 2 + 2 * k as u64, first + 3 + 2 * k as u64);
        surface.triangles.extend([[first, p, first + 1], [first + 1, p, q]]);
    }
    folder.write("in.ply", surface.bytes(Format::Ply));
    for metric in METRICS {
        let options = format!("--force -t 200 --report out.json {metric}");
        folder.done(&format!("simplify in.ply -o out.ply {options}"));
        let whole = read(&folder, "out.ply");
        assert_eq!(whole.triangles().len(), 200);
        assert_eq!(edges(&whole).2, 1, "the edge with three faces is still there");
        let report: serde_json::Value = serde_json::from_slice(&folder.read("out.json")).unwrap();
        assert_eq!(report["decimate"]["complex_vertices"], 2);
        assert_eq!(report["decimate"]["metric"], metric.split_once(' ').unwrap().1);
    }
    // Told where it decides what the result is.
    for (count, is_told) in [(200, false), (16, true)] {
        let ran = folder.run(&format!("simplify in.ply -o out.ply --force -t {count}"));
        assert_eq!(ran.stderr.contains("2 vertices were left as they are"), is_told, "{count}");
    }
}

#[test]
fn sheets_that_touch_are_taken_apart_and_both_decimated() {
    let folder = Folder::new();
    let mut surface = Surface::hills(30);
    let count = surface.vertices.len();
    let touching = count / 2 + 15;
    let above = |(k, [x, y, z]): (usize, [f32; 3])| [x, y, if k == touching { z } else { z + 5.0 }];
    let sheet: Vec<[f32; 3]> = surface.vertices.iter().copied().enumerate().map(above).collect();
    surface.vertices.extend(sheet);
    let triangles = surface.triangles.clone();
    surface.triangles.extend(triangles.iter().map(|face| face.map(|v| v + count as u64)));
    folder.write("in.stl", surface.bytes(Format::Stl));
    for metric in METRICS {
        folder
            .done(&format!("simplify in.stl -o out.ply --force -t 300 --report out.json {metric}"));
        let report: serde_json::Value = serde_json::from_slice(&folder.read("out.json")).unwrap();
        let decimate = &report["decimate"];
        assert_eq!(
            (decimate["split_vertices"].as_u64(), decimate["complex_vertices"].as_u64()),
            (Some(1), Some(0))
        );
        assert_eq!(read(&folder, "out.ply").triangles().len(), 300);
    }
}

#[test]
fn a_target_that_topology_forbids_is_said_and_strict_is_4() {
    let folder = Folder::new();
    // Nothing of a tetrahedron can go.
    let positions = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let triangles = vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]];
    let surface = Surface { vertices: positions, triangles, ..Surface::hills(2) };
    folder.write("in.ply", surface.bytes(Format::Ply));
    folder.done("simplify in.ply -o out.ply -t 2 --report out.json");
    assert_eq!(read(&folder, "out.ply").triangles().len(), 4);
    let report: serde_json::Value = serde_json::from_slice(&folder.read("out.json")).unwrap();
    assert_eq!(report["stopped_by"], "topology");
    assert_eq!(report["reached_target"], false);
    let code = folder.run("simplify in.ply -o strict.ply -t 2 --strict").code;
    assert_eq!(code, Some(4));
}
