//! The files in testdata/ come out the same, byte for byte, and mean the same mesh in every format.

use std::{fs, path::Path};

use assert_cmd::Command;

fn testdata(name: &str) -> String {
    format!("{}/testdata/{name}", env!("CARGO_MANIFEST_DIR"))
}

/// Runs meshmill and returns what it wrote to standard output.
fn output(words: &[&str]) -> Vec<u8> {
    let done = Command::cargo_bin("meshmill").unwrap().args(words).arg("-q").assert().success();
    done.get_output().stdout.clone()
}

fn assert_golden(name: &str, words: &[&str]) {
    let format = Path::new(name).extension().unwrap().to_str().unwrap();
    let made = output(&[words, &["-o", "-", "--output-format", format]].concat());
    assert!(made == fs::read(testdata(name)).unwrap(), "{name} is not what {words:?} makes");
}

#[test]
fn generated_surfaces_are_the_same_in_every_format_as_ever() {
    for name in ["sphere.ply", "sphere.obj"] {
        assert_golden(name, &["generate", "sphere", "--triangles", "200"]);
    }
    assert_golden("hills.ply", &["generate", "height-field", "--triangles", "200"]);
    assert_golden("sphere.stl", &["soup", &testdata("sphere.ply")]);
}

#[test]
fn clustering_gives_the_bytes_it_gave() {
    assert_golden("sphere-cells-4.ply", &["simplify", &testdata("sphere.ply"), "--cells", "4"]);
}

#[test]
fn every_format_of_the_sphere_is_the_same_soup() {
    let soup = |name| output(&["soup", &testdata(name), "-o", "-", "--output-format", "soup"]);
    let ply = soup("sphere.ply");
    for name in ["sphere.stl", "sphere.obj", "sphere.soup"] {
        assert!(soup(name) == ply, "{name}");
    }
}
