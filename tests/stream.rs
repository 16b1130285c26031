//! Decimation in a single pass through the command: pipes, promises of order, and rasters.

use std::{env, fs, path::Path};

use meshmill::formats::Format;
use serde_json::Value;

use crate::{
    command::{Dice, Folder, Surface},
    meshes,
};

/// `simplify` of a soup on standard input to one on standard output; returns it and the report.
fn piped(folder: &Folder, options: &str, input: &[u8]) -> (Vec<u8>, Value) {
    let line = format!(
        "simplify - --input-format soup -o - --output-format soup --report r.json {options}"
    );
    let ran = folder.run_with(&line, input);
    assert_eq!(ran.code, Some(0), "{options}: {}", ran.stderr);
    (ran.stdout, serde_json::from_slice(&folder.read("r.json")).unwrap())
}

#[test]
fn a_pipe_touches_no_disk_and_gives_the_same_bytes_on_any_threads() {
    let folder = Folder::new();
    fs::create_dir(folder.path("t")).unwrap();
    let input = folder.done("generate gyroid --triangles 400k -o - --output-format soup");
    let options = "--assume-sorted z --ratio 5% --memory 24MiB --temp-dir t";
    let (expected, report) = piped(&folder, &format!("{options} -j 1"), &input);
    assert_eq!(report["temporary_bytes_peak"], 0, "nothing is set aside");
    assert!(fs::read_dir(folder.path("t")).unwrap().next().is_none());
    let stream = &report["stream"];
    let read = report["input"]["triangles"].as_u64().unwrap();
    let wanted = (read as f64 * 0.05).round() as u64;
    assert_eq!(stream["written"].as_u64().unwrap(), wanted / 2 * 2);
    assert!(stream["window_max"].as_u64() <= stream["window_triangles"].as_u64());
    assert!(stream["window_triangles"].as_u64().unwrap() < read / 3, "{stream}");
    assert!(stream["rounds"].as_u64().unwrap() > 3, "{stream}");
    for threads in [2, 3] {
        let (again, _) = piped(&folder, &format!("{options} -j {threads}"), &input);
        assert!(again == expected, "{threads} threads");
    }
    let (other, _) = piped(&folder, &format!("{options} --seed 5"), &input);
    assert!(other != expected, "another seed");
    // Welded back it is closed.
    folder.write("out.soup", &expected);
    folder.done("weld out.soup -o out.ply");
    let whole = meshes::read_file(&folder.path("out.ply"));
    let mut edges = std::collections::HashMap::<(u64, u64), i32>::new();
    for face in whole.triangles() {
        for k in 0..3 {
            let (a, b) = (face[k], face[(k + 1) % 3]);
            *edges.entry((a.min(b), a.max(b))).or_default() += 1;
        }
    }
    assert!(edges.values().all(|faces| *faces == 2), "every edge has two faces");
}

#[test]
fn a_stream_that_is_not_sorted_as_it_says_is_3_and_leaves_nothing() {
    let folder = Folder::new();
    folder.done("generate sphere --triangles 300k -o in.stl");
    let mut soup = folder.read("in.stl");
    Dice(3).shuffle(soup[84..].as_chunks_mut::<50>().0);
    folder.write("in.stl", &soup);
    let line = "simplify in.stl --assume-sorted z --ratio 5% -o out.soup --memory 16MiB";
    let said = folder.fails(line, 3);
    assert!(said.contains("triangle ") && said.contains("triangles late"), "{said}");
    // Sorted, whoever does it, it is the same mesh.
    let rest = "--ratio 5% --memory 64MiB --report r.json -o";
    folder.done(&format!("simplify in.stl --selection multiple-choice {rest} sorted.stl"));
    let report: Value = serde_json::from_slice(&folder.read("r.json")).unwrap();
    let axis = report["stream"]["axis"].as_str().unwrap().to_owned();
    folder.done(&format!("sort in.stl --axis {axis} -o sorted.soup"));
    folder.done(&format!("simplify sorted.soup --assume-sorted {axis} {rest} promised.stl"));
    assert!(folder.read("sorted.stl")[84..] == folder.read("promised.stl")[84..]);
}

#[test]
fn what_contradicts_itself_is_refused() {
    let folder = Folder::new();
    folder.write("in.ply", Surface::hills(20).bytes(Format::Ply));
    for line in [
        "simplify in.ply -o out.ply --cells 8 --assume-sorted x",
        "simplify in.ply -o out.ply --ratio 5% --method cluster --selection multiple-choice",
        "simplify in.ply -o out.ply --cells 8 --method stream --assume-sorted x",
        "simplify in.ply -o out.ply --ratio 5% --assume-sorted longest",
        "simplify in.ply -o out.ply --ratio 5% --assume-sorted x --metric volume",
        "simplify in.ply -o out.ply --ratio 5% --selection multiple-choice --choices 0",
    ] {
        folder.fails(line, 2);
    }
    // A pipe does not say how many triangles will come.
    let soup = folder.done("generate sphere --triangles 2k -o - --output-format soup");
    let line = "simplify - --input-format soup --assume-sorted z -t 100 -o out.stl";
    let ran = folder.run_with(line, &soup);
    assert_eq!(ran.code, Some(2), "{}", ran.stderr);
    assert!(ran.stderr.contains("--ratio"), "{}", ran.stderr);
}

#[test]
fn a_pipe_through_slabs_gives_what_the_file_gives() {
    let folder = Folder::new();
    // Two slabs; the longest side is z.
    let soup = folder.done("generate gyroid --triangles 400k -o - --output-format soup");
    folder.write("in.soup", &soup);
    folder.done("simplify in.soup -o file.ply --ratio 5% --memory 256MiB");
    let line = "simplify - --input-format soup --assume-sorted z --selection threshold -o pipe.ply \
                --ratio 5% --memory 256MiB --temp-dir . --report report.json";
    let ran = folder.run_with(line, &soup);
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    assert!(folder.read("pipe.ply") == folder.read("file.ply"));
    let report: serde_json::Value = serde_json::from_slice(&folder.read("report.json")).unwrap();
    assert_eq!(report["temporary_bytes_peak"], 0, "nothing went to the disk");
    // Along x the same stream comes in no order.
    let ran = folder.run_with(&line.replace("sorted z", "sorted x").replace("pipe", "late"), &soup);
    assert_eq!(ran.code, Some(3), "{}", ran.stderr);
    assert!(ran.stderr.contains("late"), "{}", ran.stderr);
}

#[test]
fn the_plan_says_what_will_be_done_in_one_pass() {
    let folder = Folder::new();
    folder.done("generate sphere --triangles 2k -o in.soup");
    let line = "simplify in.soup --assume-sorted z --ratio 10% --dry-run -o";
    let plan = String::from_utf8(folder.done(&format!("{line} out.soup"))).unwrap();
    assert!(plan.contains("window of") && plan.contains("nearly sorted along z"), "{plan}");
    assert!(!plan.contains("import") && plan.contains("temporary  0 B"), "{plan}");
    let plan = String::from_utf8(folder.done(&format!("{line} out.ply"))).unwrap();
    assert!(plan.contains("number the vertices"), "{plan}");
}

#[test]
fn counts_are_exact_and_colours_come_along() {
    let folder = Folder::new();
    folder.write("in.ply", Surface::hills(100).colored().bytes(Format::Ply));
    for (goal, count) in [("-t 1501", 1501), ("--ratio 7%", 1400), ("-t 20000", 20_000)] {
        let line = format!("simplify in.ply --selection multiple-choice {goal} -o out.ply --force");
        let report = folder.report(&line);
        assert_eq!(report["output"]["triangles"], count);
        assert_eq!(
            (&report["stopped_by"], &report["reached_target"]),
            (&"target".into(), &true.into())
        );
        let whole = meshes::read_file(&folder.path("out.ply"));
        assert_eq!(whole.colors.len(), whole.positions.len());
    }
    // A closed surface loses two at a time.
    folder.done("generate sphere --triangles 5k -o closed.ply");
    let line = "simplify closed.ply --selection multiple-choice -t 501 -o closed.stl";
    let report = folder.report(line);
    assert_eq!(report["output"]["triangles"], 500);
    assert_eq!(report["stopped_by"], "parity");
}

/// Side of a raster of the Shuttle Radar Topography Mission.
const RASTER_SIDE: usize = 1201;

/// A soup of the squares of a raster whose corners are known, row after row.
fn raster_soup(path: &Path) -> Vec<u8> {
    let bytes = fs::read(path).unwrap();
    let heights: Vec<i16> =
        bytes.as_chunks::<2>().0.iter().map(|two| i16::from_le_bytes(*two)).collect();
    let corner = |row: usize, column: usize| {
        let height = heights[row * RASTER_SIDE + column];
        let position = [column as f32 * 65.0, row as f32 * 92.6, f32::from(height)];
        (height > -32_767).then_some(position)
    };
    let mut surface = Surface::default();
    for row in 0..RASTER_SIDE - 1 {
        for column in 0..RASTER_SIDE - 1 {
            let [a, b] = [corner(row, column), corner(row, column + 1)];
            let [c, d] = [corner(row + 1, column + 1), corner(row + 1, column)];
            for triangle in [[a, b, c], [a, c, d]] {
                if let [Some(a), Some(b), Some(c)] = triangle {
                    let first = surface.vertices.len() as u64;
                    surface.vertices.extend([a, b, c]);
                    surface.triangles.push([first, first + 1, first + 2]);
                }
            }
        }
    }
    surface.bytes(Format::Stl)
}

#[test]
fn rasters_whose_outline_and_voids_are_boundary_pass_through_a_small_window() {
    let Some(shared) = env::var_os("MESHMILL_SHARED") else {
        eprintln!("skipped: MESHMILL_SHARED does not say where the rasters are");
        return;
    };
    let folder = Folder::new();
    let mut seen = 0;
    for name in ["N49W124", "S36E149"] {
        let path = Path::new(&shared).join(format!("meshes/dem/{name}.i16le.raw"));
        if !path.exists() {
            eprintln!("skipped: there is no {}", path.display());
            continue;
        }
        folder.write("in.stl", raster_soup(&path));
        let line =
            "simplify in.stl --assume-sorted y --ratio 1% -o out.soup --force --memory 16MiB";
        let report = folder.report(line);
        let (stream, triangles) =
            (&report["stream"], report["input"]["triangles"].as_u64().unwrap());
        let wanted = (triangles as f64 * 0.01).round() as u64;
        assert_eq!(stream["written"].as_u64(), Some(wanted), "{stream}");
        let boundary = stream["boundary_vertices"].as_u64().unwrap();
        assert!(boundary >= 4 * 1200, "{stream}");
        // The front is two rows of the raster and what sticks to them.
        assert!(stream["front_max"].as_u64().unwrap() < 4 * 2400, "{stream}");
        assert_eq!(stream["written_forced"], 0, "{stream}");
        assert!(stream["window_triangles"].as_u64().unwrap() < triangles / 20, "{stream}");
        seen += 1;
    }
    eprintln!("{seen} rasters");
}

/// Hills of so many quads a side, an OBJ in the order of x.
fn quads(side: usize) -> String {
    let row = side + 1;
    let vertices = (0..row * row).map(|i| {
        let (x, y) = ((i / row) as f64, (i % row) as f64);
        format!("v {x} {y} {}\n", 3.0 * (x / 7.0).sin() * (y / 9.0).cos())
    });
    let corners = (0..side * side).map(|i| i / side * row + i % side + 1);
    let faces = corners.map(|a| format!("f {a} {} {} {}\n", a + row, a + row + 1, a + 1));
    vertices.chain(faces).collect()
}

#[test]
fn quads_count_as_two_triangles_in_every_way_through() {
    let folder = Folder::new();
    fs::write(folder.path("in.obj"), quads(100)).unwrap();
    // With a header that counts its faces, and a vertex 0 that none of them has.
    let listed = quads(100).replace("v ", "").replace("f ", "4 ");
    fs::write(folder.path("in.off"), format!("OFF\n10202 10000 0\n0 0 0\n{listed}")).unwrap();
    for input in ["in.obj", "in.off"] {
        for means in [
            "-t 2000",
            "--ratio 10%",
            "-t 2000 --assume-sorted x",
            "-t 2000 --assume-sorted x --selection multiple-choice",
            "--ratio 10% --assume-sorted x --selection multiple-choice",
        ] {
            let report = folder.report(&format!("simplify {input} -o out.stl --force {means}"));
            let counts = (&report["input"]["triangles"], &report["output"]["triangles"]);
            assert_eq!(counts, (&20_000.into(), &2000.into()), "{input} {means}");
        }
        folder.done(&format!(
            "simplify {input} -o out.stl --force --max-error 0.1 --assume-sorted x"
        ));
    }
}
