//! `meshmill sort`: one order, whatever the input's order, the memory and the threads.

use meshmill::formats::Format;

use crate::{
    command::{Folder, Surface},
    meshes,
};

/// More triangles than 1 MiB sorts in memory, and longest along x.
fn long() -> Surface {
    let mut surface = Surface::hills(220);
    surface.vertices.iter_mut().for_each(|vertex| vertex[0] *= 3.0);
    surface
}

/// What `info` says of the order of a mesh.
fn order(folder: &Folder, name: &str) -> serde_json::Value {
    let json = folder.done(&format!("info {name} --json"));
    serde_json::from_slice::<serde_json::Value>(&json).unwrap()["order"].clone()
}

#[test]
fn any_order_memory_and_number_of_threads_gives_the_same_bytes() {
    let folder = Folder::new();
    folder.write("in.ply", long().bytes(Format::Ply));
    folder.write("shuffled.ply", long().shuffled().bytes(Format::Ply));
    folder.write("shuffled.stl", long().shuffled().bytes(Format::Stl));
    folder.write("in.soup", long().bytes(Format::Soup));
    for (axis, name) in [("longest", "x"), ("z", "z"), ("y", "y")] {
        let flags = format!("--axis {axis} --force");
        folder.done(&format!("sort in.ply -o expected.stl {flags}"));
        assert_eq!(order(&folder, "expected.stl")["displacement_max_xyz"][name_index(name)], 0);
        let expected = folder.read("expected.stl");
        for input in ["in.ply", "shuffled.ply", "shuffled.stl", "in.soup", "expected.stl"] {
            for running in
                ["--memory 1MiB -j 1", "--memory 1MiB -j 2", "--memory 64MiB", "--memory 1GiB -j 2"]
            {
                let report = folder.report(&format!("sort {input} -o out.stl {flags} {running}"));
                assert!(folder.read("out.stl") == expected, "{axis}, {input}, {running}");
                assert_eq!(report["sort"]["axis"], name, "{input}");
                let is_scattered = input.starts_with("shuffled") && running.contains("1MiB");
                assert!(report["sort"]["on_disk"] == true || !is_scattered, "{report}");
                let is_in_memory = running.contains("64MiB") || running.contains("1GiB");
                assert!(report["sort"]["on_disk"] == false || !is_in_memory, "{report}");
            }
        }
    }
}

fn name_index(axis: &str) -> usize {
    ["x", "y", "z"].iter().position(|name| *name == axis).unwrap()
}

#[test]
fn what_is_sorted_is_said_to_be_and_comes_out_as_it_went_in() {
    let folder = Folder::new();
    folder.write("in.ply", long().shuffled().colored().bytes(Format::Ply));
    for output in ["a.soup", "a.stl"] {
        folder.done(&format!("sort in.ply -o {output}"));
        let order = order(&folder, output);
        assert_eq!((&order["axis"], &order["sorted"]), (&"x".into(), &true.into()), "{order}");
        assert_eq!(order["displacement_max"], 0);
        let again = output.replace('a', "b");
        let report = folder.report(&format!("sort {output} -o {again} --memory 8MiB"));
        assert!(folder.read(&again) == folder.read(output), "{output}");
        assert_eq!(
            (&report["sort"]["on_disk"], &report["sort"]["displacement_max"]),
            (&false.into(), &0.into())
        );
        assert_eq!(report["temporary_bytes_peak"], 0);
    }
}

#[test]
fn colours_stay_with_their_corners() {
    let folder = Folder::new();
    let surface = long().colored();
    folder.write("in.ply", surface.clone().shuffled().bytes(Format::Ply));
    folder.done("sort in.ply -o out.soup --memory 1MiB");
    folder.done("sort in.ply -o large.soup");
    assert!(folder.read("out.soup") == folder.read("large.soup"));
    let corners = |surface: &Surface| -> Vec<[([u32; 3], [u8; 4]); 3]> {
        let corner =
            |i: u64| (surface.vertices[i as usize].map(f32::to_bits), surface.colors[i as usize]);
        surface.triangles.iter().map(|triangle| triangle.map(corner)).collect()
    };
    let whole = meshes::read_file(&folder.path("out.soup"));
    let count = whole.positions.len() as u64 / 3;
    let sorted = Surface {
        vertices: whole.positions,
        colors: whole.colors,
        triangles: (0..count).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
    };
    let (mut found, mut expected) = (corners(&sorted), corners(&surface));
    let least = found
        .iter()
        .map(|t| t.map(|(p, _)| f32::from_bits(p[0])).into_iter().fold(f32::MAX, f32::min));
    assert!(least.is_sorted());
    found.sort_unstable();
    expected.sort_unstable();
    assert!(found == expected);
}

#[test]
fn a_stream_is_sorted_along_a_named_axis_without_being_set_aside() {
    let folder = Folder::new();
    let bytes = long().shuffled().bytes(Format::Soup);
    folder.write("in.soup", &bytes);
    folder.done("sort in.soup -o expected.soup");
    for (axis, aside) in [("x", false), ("longest", true)] {
        let line =
            format!("sort - --input-format soup --axis {axis} -o {axis}.soup --memory 64MiB");
        let plan = folder.run_with(&format!("{line} --dry-run"), &bytes);
        let plan = String::from_utf8(plan.stdout).unwrap();
        assert_eq!(plan.contains("aside"), aside, "{plan}");
        let ran = folder.run_with(&format!("{line} --report report.json"), &bytes);
        assert_eq!(ran.code, Some(0), "{}", ran.stderr);
        assert!(folder.read(&format!("{axis}.soup")) == folder.read("expected.soup"), "{axis}");
        let report: serde_json::Value =
            serde_json::from_slice(&folder.read("report.json")).unwrap();
        assert_eq!(report["temporary_bytes_peak"].as_u64().unwrap() > 0, aside, "{report}");
    }
    // An indexed mesh tells its bounds with its vertices, before its faces.
    let ply = long().bytes(Format::Ply);
    let ran = folder.run_with("sort - --input-format ply -o ply.soup", &ply);
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    assert!(folder.read("ply.soup") == folder.read("expected.soup"));
}

#[test]
fn a_plan_says_whether_the_disk_is_needed() {
    let folder = Folder::new();
    folder.write("in.stl", long().bytes(Format::Stl));
    for (flags, words) in [
        ("--memory 1GiB", "along its longest side in memory"),
        ("--memory 1MiB", "not sorted on disk"),
        ("--memory 1MiB --axis y", "sort along y, on disk"),
    ] {
        let plan = folder.done(&format!("sort in.stl -o out.stl --dry-run {flags}"));
        let plan = String::from_utf8(plan).unwrap();
        assert!(plan.contains(words), "{flags}: {plan}");
    }
    assert_eq!(folder.names(), ["in.stl"]);
}

#[test]
fn what_cannot_be_sorted_is_refused() {
    let folder = Folder::new();
    folder.write("in.stl", long().bytes(Format::Stl));
    for (line, word) in [
        ("sort in.stl -o out.ply", "indexed"),
        ("sort in.stl -o out.obj", "indexed"),
        ("sort in.stl -o out.off", "not written"),
        ("sort in.stl -o in.stl --force", "is an input"),
        ("sort in.stl -o out.stl --axis w", "longest"),
    ] {
        let said = folder.fails(line, 2);
        assert!(said.contains(word), "{line}: {said}");
    }
    folder.write("bad.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 nan\nf 1 2 3\nf 2 3 4\n");
    folder.fails("sort bad.obj -o out.stl", 3);
    let report = folder.report("sort bad.obj -o out.stl --on-defect skip");
    assert_eq!(report["output"]["triangles"], 1);
    assert!(!report["defects"].as_array().unwrap().is_empty());
}

#[test]
fn a_scan_is_sorted_in_little_memory() {
    let Some(real) = meshes::folder("real") else { return };
    let folder = Folder::new();
    let mesh = real.join("igea_268k.ply");
    let mesh = mesh.display();
    let small = folder.report(&format!("sort {mesh} -o small.stl --memory 2MiB"));
    assert!(small["peak_memory_bytes"].as_u64().unwrap() < 66 << 20, "{small}");
    folder.done(&format!("sort {mesh} -o large.stl --memory 1GiB -j 1"));
    assert!(folder.read("small.stl") == folder.read("large.stl"));
    assert_eq!(order(&folder, "small.stl")["sorted"], true);
}
