//! Progressive meshes through the command and the library: what is refined again is what was made
//! progressive, at any count, from whole files and from cut ones.

use std::io::Cursor;

use meshmill::{
    Error, Result,
    error::Fault,
    formats::Format,
    progress::Monitor,
    soup::InputPath,
    stages::convert::refine::{self, Detail},
    storage::Budget,
};

use crate::{
    command::{Folder, Surface},
    meshes::{self, Whole},
};

mod files;

type Corner = ([i64; 3], Vec<u8>);

/// A mesh in memory, refined as far as it goes.
pub(crate) fn refined(bytes: &[u8], detail: Detail) -> Result<refine::Outcome> {
    let input = Cursor::new(bytes.to_vec());
    let budget = Budget::new(1 << 30);
    refine::refine(input, &InputPath::Stdin, detail, &budget, &Monitor::silent())
}

/// Faces by what their corners are, on whole steps from the least coordinates, turned so that the
/// least corner comes first, in order. Faces with two corners at one place are left out.
fn told(whole: &Whole, least: [f32; 3], step: f64) -> Vec<[Corner; 3]> {
    let steps = |position: [f32; 3]| {
        std::array::from_fn(|axis| {
            ((f64::from(position[axis]) - f64::from(least[axis])) / step).round() as i64
        })
    };
    let corner = |v: u64| {
        let color = whole.colors.get(v as usize).map(|color| color.to_vec());
        (steps(whole.positions[v as usize]), color.unwrap_or_default())
    };
    let same = |a: u64, b: u64| whole.positions[a as usize] == whole.positions[b as usize];
    let triangles = whole.triangles().into_iter();
    let faces = triangles.filter(|&[a, b, c]| !(same(a, b) || same(b, c) || same(c, a)));
    let mut told: Vec<_> = faces
        .map(|face| {
            let mut face = face.map(corner);
            let first = (0..3).min_by_key(|place| face[*place].clone()).unwrap();
            face.rotate_left(first);
            face
        })
        .collect();
    told.sort();
    told
}

/// The least coordinates of what has a face of three corners.
fn least(whole: &Whole) -> [f32; 3] {
    let same = |a: u64, b: u64| whole.positions[a as usize] == whole.positions[b as usize];
    let triangles = whole.triangles().into_iter();
    let faces = triangles.filter(|&[a, b, c]| !(same(a, b) || same(b, c) || same(c, a)));
    faces.flatten().fold([f32::INFINITY; 3], |least, v| {
        std::array::from_fn(|axis| least[axis].min(whole.positions[v as usize][axis]))
    })
}

/// Makes a mesh progressive and refines it again; both must be the same on whole steps.
fn assert_comes_back(folder: &Folder, input: &str, flags: &str) -> serde_json::Value {
    let report = folder.report(&format!("progressive {input} -o a.pm --force -q {flags}"));
    folder.done("refine a.pm -o a.ply --force -q");
    let step = report["progressive"]["step"].as_f64().unwrap();
    let input = input.split(' ').next().unwrap();
    let [before, after] = [input, "a.ply"].map(|name| meshes::read_file(&folder.path(name)));
    let expected = told(&before, least(&before), step);
    assert!(told(&after, least(&before), step) == expected, "{input} {flags}");
    assert_eq!(report["output"]["triangles"].as_u64().unwrap(), expected.len() as u64);
    report
}

#[test]
fn what_is_refined_to_the_end_is_the_input_on_whole_steps() {
    let folder = Folder::new();
    folder.done("generate sphere --triangles 4k -o sphere.ply");
    folder.write("hills.ply", Surface::hills(40).bytes(Format::Ply));
    folder.write("colored.ply", Surface::hills(30).colored().bytes(Format::Ply));
    folder.write("confetti.ply", Surface::confetti(60).bytes(Format::Ply));
    for (input, bits) in [("sphere", 14), ("hills", 10), ("colored", 16), ("confetti", 20)] {
        for metric in ["quadric", "volume"] {
            let flags = format!("--bits {bits} --metric {metric} --base 60");
            let report = assert_comes_back(&folder, &format!("{input}.ply"), &flags);
            assert_eq!(report["progressive"]["bits"], bits);
        }
    }
    assert!(folder.read("a.pm").len() < folder.read("confetti.ply").len());
}

#[test]
fn real_scans_come_back_and_take_few_bytes() {
    let Some(real) = meshes::folder("real") else { return };
    let folder = Folder::new();
    for name in ["igea_268k.ply", "dragon_vrip_res3.ply", "horse_97k.ply", "beetle.off"] {
        let bytes = std::fs::read(real.join(name)).unwrap();
        folder.write(name, bytes);
        let report = assert_comes_back(&folder, name, "");
        let bytes = report["progressive"]["bytes_per_triangle"].as_f64().unwrap();
        assert!(bytes < 8.0, "{name}: {bytes} bytes a triangle");
    }
}

#[test]
fn any_count_is_met_and_counts_out_of_reach_are_said_to_be() {
    let folder = Folder::new();
    folder.write("hills.ply", Surface::hills(12).bytes(Format::Ply));
    let base = folder.report("progressive hills.ply -o a.pm --base 40");
    let base = base["progressive"]["base_triangles"].as_u64().unwrap();
    let bytes = folder.read("a.pm");
    for count in base..=288 {
        let outcome = refined(&bytes, Detail::Triangles(count)).unwrap();
        let triangles = outcome.mesh.faces().len() as u64;
        assert!(triangles == count || triangles + 1 == count, "{triangles} for {count}");
        assert!(outcome.is_met && !outcome.is_cut);
    }
    assert!(!refined(&bytes, Detail::Triangles(base - 2)).unwrap().is_met);
    let beyond = refined(&bytes, Detail::Triangles(10_000)).unwrap();
    assert_eq!((beyond.mesh.faces().len(), beyond.is_met), (288, false));
    let half = folder.report("refine a.pm -o half.obj --ratio 50%");
    assert!(matches!(half["output"]["triangles"].as_u64(), Some(143 | 144)), "{half}");
    let said = folder.run("refine a.pm -o few.stl -t 4").stderr;
    assert!(said.contains("nothing nearer"), "{said}");
}

#[test]
fn an_error_is_kept_to_with_fewer_triangles_the_larger_it_is() {
    let folder = Folder::new();
    folder.write("hills.ply", Surface::hills(60).bytes(Format::Ply));
    folder.done("progressive hills.ply -o a.pm --base 40 -q");
    let bytes = folder.read("a.pm");
    let mut before = u64::MAX;
    for error in [0.0, 1e-4, 1e-3, 1e-2, 1.0] {
        let outcome = refined(&bytes, Detail::Length(error)).unwrap();
        assert!(f64::from(outcome.deviation.max) <= error && outcome.is_met);
        let triangles = outcome.mesh.faces().len() as u64;
        assert!(triangles <= before, "{error}: {triangles} after {before}");
        before = triangles;
    }
    assert!(before <= 40);
    let near = folder.report("refine a.pm -o near.ply --max-error 1%");
    let far = folder.report("refine a.pm -o far.ply --max-error 0.05");
    let triangles = |report: &serde_json::Value| report["output"]["triangles"].as_u64().unwrap();
    assert!(triangles(&near) > triangles(&far), "{near} {far}");
}

/// Vertices that have a face, less edges, plus faces; every edge has at most two faces.
fn euler(faces: &[[u32; 3]]) -> i64 {
    let mut edges: Vec<[u32; 2]> = Vec::new();
    let mut vertices: Vec<u32> = faces.as_flattened().to_vec();
    for &[a, b, c] in faces {
        edges.extend([[a, b], [b, c], [c, a]]);
    }
    edges.sort_unstable();
    assert!(edges.is_sorted_by(|one, two| one < two), "two faces go the same way along an edge");
    let mut undirected: Vec<[u32; 2]> = edges.iter().map(|&[a, b]| [a.min(b), a.max(b)]).collect();
    undirected.sort_unstable();
    undirected.dedup();
    vertices.sort_unstable();
    vertices.dedup();
    vertices.len() as i64 - undirected.len() as i64 + faces.len() as i64
}

#[test]
fn every_prefix_is_a_fault_in_the_base_and_a_mesh_after_it() {
    let folder = Folder::new();
    folder.done("generate sphere --triangles 300 -o a.ply");
    let report = folder.report("progressive a.ply -o a.pm --base 60");
    let base_bytes = report["progressive"]["base_bytes"].as_u64().unwrap() as usize;
    let bytes = folder.read("a.pm");
    let mut faces_before = 0;
    for end in 0..=bytes.len() {
        match refined(&bytes[..end], Detail::All) {
            Err(Error::Input { fault, .. }) => {
                assert!(end < base_bytes, "{end}: {fault}");
                let is_about_the_end = matches!(fault, Fault::Truncated { .. } | Fault::Empty);
                assert!(is_about_the_end, "{end}: {fault}");
            }
            Err(error) => panic!("{end}: {error}"),
            Ok(outcome) => {
                let faces = outcome.mesh.faces();
                assert!(end >= base_bytes && faces.len() >= faces_before, "{end}");
                assert_eq!((euler(faces), outcome.is_cut), (2, end < bytes.len()), "{end}");
                faces_before = faces.len();
            }
        }
    }
}

#[test]
fn a_cut_file_gives_what_is_there_and_says_so() {
    let folder = Folder::new();
    folder.write("hills.ply", Surface::hills(40).bytes(Format::Ply));
    folder.done("progressive hills.ply -o a.pm -q");
    let bytes = folder.read("a.pm");
    let cut = &bytes[..bytes.len() * 2 / 3];
    let ran = folder.run_with("refine - -o cut.ply --report cut.json", cut);
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    assert!(ran.stderr.contains("is cut") && ran.stderr.contains("batches"), "{}", ran.stderr);
    let report: serde_json::Value = serde_json::from_slice(&folder.read("cut.json")).unwrap();
    assert_eq!(report["refine"]["is_cut"], true);
    let triangles = meshes::read_file(&folder.path("cut.ply")).triangles().len();
    assert!((500..3200).contains(&triangles), "{triangles}");
    // What is wanted is there.
    let whole = folder.run_with("refine - -o few.ply -t 600", cut);
    assert!(whole.code == Some(0) && !whole.stderr.contains("is cut"), "{}", whole.stderr);
    let triangles = meshes::read_file(&folder.path("few.ply")).triangles().len();
    assert!(triangles == 600 || triangles == 599, "{triangles}");
}

#[test]
fn the_same_bytes_come_from_any_number_of_threads_and_from_a_pipe() {
    let folder = Folder::new();
    folder.done("generate gyroid --triangles 60k -o in.stl");
    let line = "progressive in.stl -o - --output-format pm -q";
    let one = folder.done(&format!("{line} -j 1"));
    assert!(folder.done(&format!("{line} -j 3")) == one);
    let input = folder.read("in.stl");
    let piped = folder.run_with("progressive - --input-format stl -o - --output-format pm", &input);
    assert_eq!(piped.code, Some(0), "{}", piped.stderr);
    assert!(piped.stdout == one, "a stream is read as a file is");
}

#[test]
fn a_mesh_of_more_is_simplified_first_in_the_same_job() {
    let folder = Folder::new();
    folder.done("generate gyroid --triangles 100k -o in.ply");
    let report = folder.report("progressive in.ply -o a.pm --triangles 20000");
    let triangles = report["output"]["triangles"].as_u64().unwrap();
    assert!(triangles == 20_000 || triangles == 19_999, "{triangles}");
    assert_eq!(report["method"], "stream");
    let whole = folder.report("refine a.pm -o a.glb");
    assert_eq!(whole["output"]["triangles"].as_u64().unwrap(), triangles);
    assert!(folder.read("a.glb").starts_with(b"glTF"));
}

#[test]
fn what_cannot_be_is_refused_before_any_work() {
    let folder = Folder::new();
    folder.done("generate sphere --triangles 60k -o in.ply");
    let said = folder.fails("progressive in.ply -o a.pm --memory 4MiB", 1);
    assert!(said.contains("progressive mesh") && said.contains("--memory"), "{said}");
    for (line, why) in [
        ("progressive in.ply -o a.ply", "pm is what progressive writes"),
        ("simplify in.ply -o a.pm -t 500", "pm is what progressive writes"),
        ("simplify in.ply -o a.glb -t 500", "glb is written by refine"),
        ("progressive in.ply -o a.pm.gz", "compressed already"),
        ("refine in.ply -o a.off", "does not write off"),
        ("progressive in.ply -o a.pm --bits 3", "4..=24"),
    ] {
        let said = folder.fails(line, 2);
        assert!(said.contains(why), "{line}: {said}");
    }
    let said = folder.fails("refine in.ply -o a.stl", 3);
    assert!(said.contains("progressive mesh"), "{said}");
    folder.done("progressive in.ply -o a.pm -q");
    let said = folder.fails("refine a.pm -o a.ply --force --memory 1MiB", 1);
    assert!(said.contains("the refined mesh"), "{said}");
    let plan = String::from_utf8(folder.done("progressive in.ply -o b.pm --dry-run")).unwrap();
    assert!(plan.contains("record") && plan.contains("encode"), "{plan}");
}
