//! `meshmill compare` as scripts and people use it, and its distances beside those of `parry3d`.

use std::{fs, path::Path};

use assert_cmd::Command;
use meshmill::{
    progress::Monitor,
    soup::{Point, Source, Triangle},
    stages::inspect::deviation::{Target, distances, survey},
    storage::{Budget, RecordWriter, Workspace},
};
use parry3d::{math::Vector, query::PointQuery as _, shape::TriMesh};
use serde_json::{Value, json};

/// Two triangles that make a square of side 2 at a height `z`.
fn square(z: f64) -> String {
    format!("v 0 0 {z}\nv 2 0 {z}\nv 2 2 {z}\nv 0 2 {z}\nf 1 2 3\nf 1 3 4\n")
}

fn meshmill(folder: &Path) -> Command {
    let mut command = Command::cargo_bin("meshmill").unwrap();
    command.current_dir(folder).env("TMPDIR", folder).arg("compare");
    command
}

/// A folder with `a.obj` at the height 0 and `b.obj` at the height 1.
fn squares() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.obj"), square(0.0)).unwrap();
    fs::write(folder.path().join("b.obj"), square(1.0)).unwrap();
    folder
}

/// So few that a test is quick.
const FEW: [&str; 2] = ["--samples", "2k"];

fn json_of(command: &mut Command) -> Value {
    let output = command.args(["--json", "-q"]).assert().code(0).get_output().clone();
    assert!(output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn stderr_of(command: &mut Command, code: i32) -> String {
    let output = command.arg("-q").assert().code(code).stdout("").get_output().clone();
    String::from_utf8(output.stderr).unwrap()
}

#[test]
fn compare_tells_a_script_how_far_two_meshes_are_apart() {
    let folder = squares();
    let report = json_of(meshmill(folder.path()).args(["a.obj", "b.obj"]).args(FEW));
    for way in ["a_to_b", "b_to_a"] {
        let deviation = &report[way];
        for name in ["max", "rms", "mean", "p50", "p95", "p99"] {
            assert_eq!(deviation[name], 1.0, "{way} {name}");
            let relative = deviation["relative"][name].as_f64().unwrap();
            assert!((relative * 8_f64.sqrt() - 1.0).abs() < 1e-15, "{way} {name}");
        }
        let confidence = &deviation["confidence"];
        assert_eq!((&confidence["level"], &confidence["rms_error"]), (&json!(0.95), &json!(0.0)));
        let unseen = confidence["unseen_share"].as_f64().unwrap();
        assert!((unseen - 3.0 / 2000.0).abs() < 1e-5, "{unseen}");
    }
    assert_eq!(
        (&report["a_to_b"]["max_at"][2], &report["b_to_a"]["max_at"][2]),
        (&json!(0.0), &json!(1.0))
    );
    assert_eq!((&report["diagonal"], &report["max"]), (&json!(8_f64.sqrt()), &json!(1.0)));
    assert_eq!((&report["a"]["triangles"], &report["a"]["area"]), (&json!(2), &json!(4.0)));
    assert_eq!((&report["b"]["path"], &report["boxes_meet"]), (&json!("b.obj"), &json!(false)));
    assert_eq!(report["samples"], json!({ "count": 2000, "seed": 0, "corners": 12 }));
    for mesh in ["a", "b"] {
        let topology = &report["topology"][mesh];
        let edges = ["edges", "boundary_edges", "components"].map(|name| &topology[name]);
        assert_eq!(edges, [&json!(5), &json!(4), &json!(1)], "{mesh}");
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2, "nothing is left behind");
}

#[test]
fn compare_takes_one_mesh_from_standard_input_and_not_two() {
    let folder = squares();
    let mut expected = json_of(meshmill(folder.path()).args(["a.obj", "b.obj"]).args(FEW));
    let piped =
        json_of(meshmill(folder.path()).args(["a.obj", "-"]).args(FEW).write_stdin(square(1.0)));
    expected["b"]["path"] = json!("-");
    assert_eq!(piped, expected);
    let error = stderr_of(meshmill(folder.path()).args(["-", "-"]), 2);
    assert!(error.contains("only one"), "{error}");
    meshmill(folder.path()).arg("a.obj").assert().code(2);
}

/// Lines, with one space where there are several.
fn rows(text: &str) -> Vec<String> {
    text.lines().map(|line| line.split_whitespace().collect::<Vec<_>>().join(" ")).collect()
}

#[test]
fn compare_tells_a_person_in_a_table_and_warns_of_meshes_apart() {
    let folder = squares();
    let assert = meshmill(folder.path()).args(["a.obj", "b.obj", "-q"]).assert().code(0);
    let text = String::from_utf8(assert.get_output().stdout.clone()).unwrap();
    assert!(text.contains("WARNING: the boxes around A and B do not meet"), "{text}");
    assert!(
        rows(&text).contains(&"rms 1.0000e0 35.3553 % 1.0000e0 35.3553 %".to_owned()),
        "{text}"
    );
    let assert = meshmill(folder.path()).args(["a.obj", "b.obj", "--json"]).assert().code(0);
    assert!(String::from_utf8_lossy(&assert.get_output().stderr).contains("WARNING"));
    fs::write(folder.path().join("b.obj"), square(0.0)).unwrap();
    let assert = meshmill(folder.path()).args(["a.obj", "b.obj", "-q"]).assert().code(0);
    let text = String::from_utf8(assert.get_output().stdout.clone()).unwrap();
    assert!(!text.contains("WARNING"), "{text}");
    assert!(rows(&text).contains(&"max 0 0.0000 % 0 0.0000 %".to_owned()), "{text}");
}

#[test]
fn compare_says_which_mesh_cannot_be_compared() {
    let folder = squares();
    let points = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    let flat = format!("{points}f 1 1 2\nf 2 3 2\n");
    let bad = square(1.0).replace("v 2 2 1", "v 2 nan 1");
    for (text, said) in [
        ("", "is empty"),
        (points, "has no faces (3 vertices)"),
        (&flat, "none of 2 faces has an area"),
        (&bad, "not a finite number"),
    ] {
        fs::write(folder.path().join("c.obj"), text).unwrap();
        for pair in [["a.obj", "c.obj"], ["c.obj", "a.obj"]] {
            let error = stderr_of(meshmill(folder.path()).args(pair), 3);
            assert!(error.starts_with("meshmill: c.obj") && error.contains(said), "{error}");
        }
    }
    let skip = ["a.obj", "c.obj", "--on-defect", "skip"];
    let error = stderr_of(meshmill(folder.path()).args(skip), 3);
    assert!(error.contains("c.obj") && error.contains("of 0 faces"), "{error}");
    let one = bad + "v 0 0 1\nv 2 0 1\nv 2 2 1\nf 5 6 7\n";
    fs::write(folder.path().join("c.obj"), one).unwrap();
    let report = json_of(meshmill(folder.path()).args(skip));
    assert_eq!(report["b"]["triangles"], 1);
    assert!(!report["b"]["defects"].as_object().unwrap().is_empty(), "{report}");
}

#[test]
fn compare_sees_millimetres_far_from_the_origin() {
    let folder = tempfile::tempdir().unwrap();
    let square = |low: [f64; 3]| {
        let [x, y, z] = low;
        let corners = [[x, y], [x + 2.0, y], [x + 2.0, y + 2.0], [x, y + 2.0]];
        let lines = corners.map(|[x, y]| format!("v {x} {y} {z}\n"));
        lines.concat() + "f 1 2 3\nf 1 3 4\n"
    };
    fs::write(folder.path().join("a.obj"), square([500_000.0, 5_400_000.0, 100.0])).unwrap();
    // In another cell of what origins are chosen from.
    fs::write(folder.path().join("b.obj"), square([499_999.0, 5_399_999.0, 100.001])).unwrap();
    let report = json_of(meshmill(folder.path()).args(["a.obj", "b.obj"]).args(FEW));
    let deviation = &report["a_to_b"];
    let p50 = deviation["p50"].as_f64().unwrap();
    assert!((0.0009..2.0).contains(&p50), "{report}");
    // The corner of a that is farthest from b.
    let max = deviation["max"].as_f64().unwrap();
    assert!((max - 2_f64.sqrt()).abs() < 1e-5, "{max}");
    assert_eq!(deviation["max_at"], json!([500_002.0, 5_400_002.0, 100.0]));
}

#[test]
fn compare_gives_the_same_for_any_memory_and_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    for (name, triangles) in [("a.ply", "20k"), ("b.stl", "3k")] {
        let arguments = ["generate", "gyroid", "--triangles", triangles, "-o", name, "-q"];
        Command::cargo_bin("meshmill")
            .unwrap()
            .current_dir(folder.path())
            .args(arguments)
            .assert()
            .code(0);
    }
    let report = |arguments: &str| {
        let mut command = meshmill(folder.path());
        json_of(command.args(["a.ply", "b.stl", "--samples", "20k"]).args(arguments.split(' ')))
    };
    let expected = report("--memory 1GiB -j 1");
    assert!(expected["a_to_b"]["max"].as_f64().unwrap() > 0.0);
    for arguments in ["--memory 1GiB -j 3", "--memory 3MiB -j 2", "--memory 4MiB -j 1"] {
        assert_eq!(report(arguments), expected, "{arguments}");
    }
    assert_ne!(report("--seed 1")["a_to_b"]["rms"], expected["a_to_b"]["rms"]);
}

#[test]
fn distances_are_those_of_parry() {
    let mut state = 1_u32;
    let mut number = move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / 16_777_216.0
    };
    let mut corner = |low: [f32; 3], size: f32| low.map(|c| c + size * number());
    let mut triangles = Vec::new();
    for _ in 0..500 {
        let low = corner([-1.0; 3], 2.0);
        triangles.push([corner(low, 0.2), corner(low, 0.2), corner(low, 0.2)]);
    }
    let points: Vec<[f32; 3]> = (0..2000).map(|_| corner([-2.0; 3], 4.0)).collect();
    let vertices = triangles.iter().flatten().map(|at| Vector::from_array(*at)).collect();
    let indices = (0..500).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    let oracle = TriMesh::new(vertices, indices).unwrap();

    let folder = tempfile::tempdir().unwrap();
    let workspace = Workspace::create(folder.path()).unwrap();
    let mut writer = RecordWriter::create(&workspace, "soup", None).unwrap();
    writer.extend(&triangles.iter().map(|t| Triangle(t.map(Point))).collect::<Vec<_>>()).unwrap();
    let source = Source::stored(writer.finish().unwrap());
    let (budget, monitor) = (Budget::new(1 << 24), Monitor::silent());
    let surface = survey(&source, [0.0; 3], &budget, &monitor).unwrap();
    let target = Target::new(&surface, &budget);
    let wanted: Vec<_> = points.iter().map(|point| point.map(f64::from)).collect();
    let found = distances(&wanted, &target, 0.0, &budget, &monitor).unwrap();
    for (point, found) in points.iter().zip(found) {
        let expected = oracle.distance_to_local_point(Vector::from_array(*point), false);
        assert!((found - f64::from(expected)).abs() < 1e-5, "{point:?}: {found} {expected}");
    }
}
