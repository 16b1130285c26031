//! The wiring of `meshmill render`: a mesh in, a picture out, and the exit code.

use std::{fs, path::Path};

use assert_cmd::Command;

/// A square of two triangles, facing up.
const OBJ: &str = "v 0 0 0\nv 4 0 0\nv 4 3 0\nv 0 3 0\nf 1 2 3\nf 1 3 4\n";

fn meshmill(folder: &Path, line: &str) -> Command {
    let mut command = Command::cargo_bin("meshmill").unwrap();
    command.current_dir(folder).env("TMPDIR", folder).args(line.split(' '));
    command
}

/// Width, height and pixels.
fn decoded(png: &[u8]) -> (u32, u32, Vec<u8>) {
    let mut reader = png::Decoder::new(std::io::Cursor::new(png)).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    (info.width, info.height, pixels)
}

fn with_square() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.obj"), OBJ).unwrap();
    folder
}

#[test]
fn render_writes_a_picture_of_the_asked_size() {
    let folder = with_square();
    let line = "render a.obj -o a.png --view top --size 80x60 -q";
    meshmill(folder.path(), line).assert().code(0).stdout("").stderr("");
    let (width, height, pixels) = decoded(&fs::read(folder.path().join("a.png")).unwrap());
    assert_eq!((width, height), (80, 60));
    assert_eq!(pixels[..3], [244, 245, 247], "the corner is background");
    assert_ne!(pixels[3 * (30 * 80 + 40)..][..3], pixels[..3], "the middle is not");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2, "nothing else is left behind");
}

#[test]
fn render_gives_the_same_bytes_from_a_pipe_a_soup_and_any_threads() {
    let folder = with_square();
    let sphere = "generate sphere --triangles 20k -o s.stl -q";
    meshmill(folder.path(), sphere).assert().code(0);
    let render = "render s.stl -o a.png --view all --size 200x150 -j 1";
    meshmill(folder.path(), render).assert().code(0);
    let expected = fs::read(folder.path().join("a.png")).unwrap();
    let piped = "render - --input-format stl -o - --view all --size 200x150 -j 3";
    let stl = fs::read(folder.path().join("s.stl")).unwrap();
    let output = meshmill(folder.path(), piped).write_stdin(stl).assert().code(0);
    assert_eq!(output.get_output().stdout, expected);
    meshmill(folder.path(), "weld s.stl -o s.ply -q").assert().code(0);
    let indexed = "render s.ply -o - --view all --size 200x150";
    let output = meshmill(folder.path(), indexed).assert().code(0);
    assert_eq!(output.get_output().stdout, expected);
}

#[test]
fn render_refuses_what_it_cannot_do_and_leaves_nothing_behind() {
    let folder = with_square();
    let at = folder.path();
    let code = |line: &str| meshmill(at, line).assert().get_output().status.code();
    assert_eq!(code("render a.obj -o a.jpg"), Some(2));
    assert_eq!(code("render a.obj -o a.png --size 80"), Some(2));
    assert_eq!(code("render a.obj -o a.png --size 9000x100"), Some(2), "of 18000 samples");
    assert_eq!(code("render a.obj -o a.png --view below"), Some(2));
    assert_eq!(code("render a.obj -o a.obj --force"), Some(2), "pictures are no obj");
    assert_eq!(code("render a.obj -o no/a.png"), Some(1));
    let small = "render a.obj -o a.png --memory 8MiB";
    let output = meshmill(at, small).assert().code(1);
    let text = String::from_utf8_lossy(&output.get_output().stderr).into_owned();
    assert!(text.contains("the picture needs ") && text.contains("--size"), "{text}");
    fs::write(at.join("points.obj"), "v 0 0 0\nv 1 1 1\n").unwrap();
    assert_eq!(code("render points.obj -o a.png"), Some(3));
    assert_eq!(fs::read_dir(at).unwrap().count(), 2, "no picture, not even a part of one");
    assert_eq!(code("render a.obj -o a.png --size 16x16"), Some(0));
    assert_eq!(code("render a.obj -o a.png --size 16x16"), Some(2), "it exists");
    assert_eq!(code("render a.obj -o a.png --size 16x16 --force"), Some(0));
}

#[test]
fn render_shows_defects_that_are_skipped() {
    let folder = with_square();
    let bad = OBJ.replace("f 1 3 4", "f 1 3 44");
    let line = "render - --input-format obj -o a.png --size 32x32";
    meshmill(folder.path(), line).write_stdin(bad.as_str()).assert().code(3);
    let skip = format!("{line} --on-defect skip");
    let output = meshmill(folder.path(), &skip).write_stdin(bad).assert().code(0);
    let text = String::from_utf8_lossy(&output.get_output().stderr).into_owned();
    assert!(text.contains("index out of range: 1"), "{text}");
}

#[test]
fn compare_draws_both_meshes_and_the_distances_between_them() {
    let folder = with_square();
    // The same square, tilted: the corner (4, 3) is one higher, the others stay.
    fs::write(folder.path().join("b.obj"), OBJ.replace("v 4 3 0", "v 4 3 1")).unwrap();
    let line = "compare a.obj b.obj --samples 2k -q --picture c.png --view top";
    let plain = meshmill(folder.path(), "compare a.obj b.obj --samples 2k -q").assert().code(0);
    let pictured = meshmill(folder.path(), line).assert().code(0);
    assert_eq!(plain.get_output().stdout, pictured.get_output().stdout);
    let (width, height, pixels) = decoded(&fs::read(folder.path().join("c.png")).unwrap());
    assert_eq!(width, 3 * 800);
    // The third panel is pale in one corner of the square and dark in the opposite one.
    let at = |x: u32, y: u32| {
        let pixel = ((height / 2 - 400 + y) * width + 1600 + x) as usize * 3;
        pixels[pixel..pixel + 3].iter().map(|number| u32::from(*number)).sum::<u32>()
    };
    assert!(at(100, 600) > at(700, 180) + 150, "{} {}", at(100, 600), at(700, 180));
    meshmill(folder.path(), line).assert().code(2);
    meshmill(folder.path(), &format!("{line} --force")).assert().code(0);
    let small = format!("{line} --force --memory 32MiB");
    let output = meshmill(folder.path(), &small).assert().code(1);
    assert!(String::from_utf8_lossy(&output.get_output().stderr).contains("the picture"));
}
