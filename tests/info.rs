//! The wiring of `meshmill info`: inputs in, a table or JSON out, and the exit code.

use std::{fs, path::Path};

use assert_cmd::Command;
use serde_json::{Value, json};

/// Two triangles that share an edge, the second one too early along x; a vertex is not used.
const OBJ: &str = "v 10 0 0\nv 11 0 0\nv 10 1 0\nv 0 0 0\nv 0 0 9\nf 1 2 3\nf 1 3 4\n";

fn meshmill(folder: &Path) -> Command {
    let mut command = Command::cargo_bin("meshmill").unwrap();
    command.current_dir(folder).env("TMPDIR", folder).arg("info");
    command
}

fn json_of(command: &mut Command) -> Value {
    let output = command.arg("--json").assert().code(0).get_output().stdout.clone();
    serde_json::from_slice(&output).unwrap()
}

#[test]
fn info_tells_a_script_what_a_mesh_is_like() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.obj"), OBJ).unwrap();
    let expected = json!({
        "format": "obj",
        "triangles": 2,
        "vertices": 5,
        "bounds": { "min": [0.0, 0.0, 0.0], "max": [11.0, 1.0, 0.0] },
        "attributes": ["position"],
        "dropped": [],
        "order": {
            "axis": "x",
            "sorted": false,
            "displacement_max": 1,
            "displacement_max_xyz": [1, 0, 0],
        },
        "topology": { "triangles_per_vertex": 0.4 },
        "defects": {},
    });
    assert_eq!(json_of(meshmill(folder.path()).arg("a.obj")), expected);
    let piped = json_of(meshmill(folder.path()).arg("-").write_stdin(OBJ));
    assert_eq!(piped, expected);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left behind");
}

#[test]
fn info_tells_a_person_on_standard_output_only() {
    let folder = tempfile::tempdir().unwrap();
    let assert = meshmill(folder.path()).args(["-", "-q"]).write_stdin(OBJ).assert().code(0);
    let output = assert.get_output();
    assert!(String::from_utf8_lossy(&output.stdout).contains("triangles    2\n"));
    assert!(output.stderr.is_empty());
}

#[test]
fn info_of_a_bad_input_ends_with_3_and_skips_on_request() {
    let folder = tempfile::tempdir().unwrap();
    let bad = OBJ.replace("f 1 3 4", "f 1 3 44");
    meshmill(folder.path()).arg("-").write_stdin(bad.as_str()).assert().code(3).stdout("");
    let skip = ["-", "--on-defect", "skip"];
    let report = json_of(meshmill(folder.path()).args(skip).write_stdin(bad));
    assert_eq!((&report["triangles"], &report["vertices"]), (&json!(1), &json!(5)));
    let defect = json!({ "count": 1, "first": "record 1" });
    assert_eq!(report["defects"], json!({ "index_out_of_range": defect }));
    meshmill(folder.path()).arg("-").write_stdin("").assert().code(3).stdout("");
}

#[test]
fn info_counts_a_triangle_that_its_header_counts_and_its_reader_leaves_out() {
    let folder = tempfile::tempdir().unwrap();
    let numbers = |x: f32| [0.0, 0.0, 1.0, x, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let mut stl = [[0; 80].as_slice(), &3_u32.to_le_bytes()].concat();
    for x in [0.0, f32::NAN, -1.0] {
        stl.extend(numbers(x).iter().flat_map(|number| number.to_le_bytes()));
        stl.extend([0; 2]);
    }
    fs::write(folder.path().join("a.stl"), stl).unwrap();
    let report = json_of(meshmill(folder.path()).args(["a.stl", "--on-defect", "skip"]));
    assert_eq!((&report["triangles"], &report["vertices"]), (&json!(2), &json!(null)));
    let defect = json!({ "count": 1, "first": "record 1, byte 134" });
    assert_eq!(report["defects"], json!({ "not_finite": defect }));
    meshmill(folder.path()).arg("a.stl").assert().code(3);
}
