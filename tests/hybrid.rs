//! Clustering followed by edge collapse through the command, and the choice of a method by memory.

use std::{collections::HashMap, fmt::Write as _, fs};

use meshmill::formats::Format;

use crate::{
    command::{Dice, Folder, Surface},
    meshes::{self, Whole, assert_as_wide},
};

fn read(folder: &Folder, name: &str) -> Whole {
    meshes::read_file(&folder.path(name))
}

/// Edges that do not have the same number of faces on both sides.
fn open_edges(whole: &Whole) -> usize {
    let mut sides = HashMap::<[u64; 2], i64>::new();
    for face in whole.triangles() {
        for k in 0..3 {
            let (a, b) = (face[k], face[(k + 1) % 3]);
            *sides.entry([a.min(b), a.max(b)]).or_default() += if a < b { 1 } else { -1 };
        }
    }
    sides.values().filter(|sum| **sum != 0).count()
}

#[test]
fn the_count_is_exact_and_a_closed_surface_stays_closed() {
    let folder = Folder::new();
    folder.done("generate gyroid --triangles 200k -o in.ply");
    for metric in ["quadric", "volume"] {
        for target in [4000, 2001] {
            let options = format!("-t {target} --metric {metric} --force");
            let report =
                folder.report(&format!("simplify in.ply -o out.ply --method hybrid {options}"));
            let whole = read(&folder, "out.ply");
            assert_eq!(whole.triangles().len(), target / 2 * 2, "{report}");
            assert_eq!(open_edges(&whole), 0, "{metric} {target}");
            assert_eq!(report["reached_target"], true);
            assert_eq!(
                (&report["method"], &report["hybrid"]["metric"]),
                (&"hybrid".into(), &metric.into())
            );
            assert!(report["method_reason"].is_null(), "it was asked for");
            let clustered = report["hybrid"]["triangles_clustered"].as_u64().unwrap() as usize;
            assert!((3 * target..6 * target).contains(&clustered), "{clustered} for {target}");
        }
    }
}

/// Root of the mean squared height of the result's vertices and centres over the hills.
fn height_error(whole: &Whole) -> f64 {
    let position = |v: u64| whole.positions[v as usize].map(f64::from);
    let height = |[x, y, z]: [f64; 3]| z - hill(x, y);
    let mut sum = 0.0;
    for face in whole.triangles() {
        let corners = face.map(position);
        let centre = std::array::from_fn(|k| corners.iter().map(|c| c[k]).sum::<f64>() / 3.0);
        sum += height(centre).powi(2);
    }
    (sum / whole.triangles().len() as f64).sqrt()
}

/// A plain with one hill.
fn hill(x: f64, y: f64) -> f64 {
    0.2 * (-40.0 * ((x - 0.4).powi(2) + (y - 0.6).powi(2))).exp()
}

fn plain_with_a_hill(side: u64) -> Surface {
    let mut surface = Surface::hills(side);
    for vertex in &mut surface.vertices {
        vertex[2] = hill(vertex[0].into(), vertex[1].into()) as f32;
    }
    surface
}

#[test]
fn it_is_nearer_to_the_surface_than_clustering_and_keeps_the_outline() {
    let folder = Folder::new();
    let surface = plain_with_a_hill(300);
    folder.write("in.ply", surface.bytes(Format::Ply));
    folder.done("simplify in.ply -o cluster.ply --method cluster -t 3000");
    let cluster = read(&folder, "cluster.ply");
    let target = cluster.triangles().len();
    for metric in ["quadric", "volume"] {
        let options = format!("--metric {metric} -t {target} --force");
        folder.done(&format!("simplify in.ply -o out.ply --method hybrid {options}"));
        let whole = read(&folder, "out.ply");
        assert_eq!(whole.triangles().len(), target);
        let (ours, theirs) = (height_error(&whole), height_error(&cluster));
        assert!(ours * 1.5 < theirs, "{metric}: {ours} {theirs}");
        assert_as_wide(&surface.vertices, &whole.positions);
    }
}

#[test]
fn the_bytes_are_the_same_for_any_order_threads_and_memory() {
    let folder = Folder::new();
    folder.done("generate gyroid --triangles 300k -o in.ply");
    folder.done("soup in.ply -o in.stl");
    let mut stl = folder.read("in.stl");
    Dice(7).shuffle(stl[84..].as_chunks_mut::<50>().0);
    folder.write("shuffled.stl", stl);
    let options = "--method hybrid --ratio 10% --force";
    // Indexed meshes are sampled otherwise than soups, so that another grid is taken.
    let run = |name: &str, means: &str| {
        folder.done(&format!("simplify {name} -o out.ply {options} {means}"));
        folder.read("out.ply")
    };
    let (indexed, soup) = (run("in.ply", "-j 1"), run("in.stl", "-j 1 --memory 1GiB"));
    for (name, means) in [
        ("in.ply", "-j 2 --memory 1GiB"),
        ("in.stl", "-j 2 --memory 64MiB"),
        ("in.ply", "-j 8 --memory 21MiB"),
        ("shuffled.stl", "-j 8 --memory 21MiB"),
    ] {
        let expected = if name == "in.ply" { &indexed } else { &soup };
        assert!(run(name, means) == *expected, "{name} {means}");
    }
}

#[test]
fn colours_travel_with_their_vertices() {
    let folder = Folder::new();
    let mut surface = plain_with_a_hill(80);
    let color = |[x, y, _]: &[f32; 3]| [(x * 255.0) as u8, (y * 255.0) as u8, 128, 255];
    surface.colors = surface.vertices.iter().map(color).collect();
    folder.write("in.ply", surface.bytes(Format::Ply));
    for metric in ["quadric", "volume"] {
        let options = format!("--method hybrid --ratio 10% --metric {metric} --force");
        folder.done(&format!("simplify in.ply -o out.ply {options}"));
        let whole = read(&folder, "out.ply");
        assert_eq!(whole.colors.len(), whole.positions.len());
        let is_far = |(position, found): (&[f32; 3], &[u8; 4])| {
            let wanted = color(position);
            (0..4).any(|k| wanted[k].abs_diff(found[k]) > 32)
        };
        let far = whole.positions.iter().zip(&whole.colors).filter(|pair| is_far(*pair)).count();
        assert!(far * 20 < whole.positions.len(), "{far} of {}", whole.positions.len());
    }
}

#[test]
fn a_pipe_is_set_aside_and_gives_the_same_bytes() {
    let folder = Folder::new();
    folder.done("generate gyroid --triangles 50k -o in.soup");
    let options = "--method hybrid --ratio 5% --force";
    folder.done(&format!("simplify in.soup -o one.ply {options}"));
    let line = format!("simplify - --input-format soup -o two.ply {options}");
    let input = folder.read("in.soup");
    let plan = folder.run_with(&format!("{line} --dry-run"), &input);
    let plan = String::from_utf8(plan.stdout).unwrap();
    assert!(plan.contains("set standard input aside"), "{plan}");
    assert!(plan.contains("method     hybrid\n"), "{plan}");
    assert_eq!(folder.run_with(&line, &input).code, Some(0));
    assert!(folder.read("two.ply") == folder.read("one.ply"));
}

#[test]
fn auto_takes_slabs_while_they_fit_and_says_why_not() {
    let folder = Folder::new();
    folder.done("generate gyroid --triangles 300k -o in.ply");
    folder.done("soup in.ply -o in.stl");
    let auto =
        |means: &str| folder.report(&format!("simplify in.ply -o out.ply --force -t 3000 {means}"));
    let roomy = auto("--memory 1GiB");
    assert_eq!(roomy["method"], "stream");
    let reason = roomy["method_reason"].as_str().unwrap();
    assert!(reason.starts_with("slabs of ") && reason.ends_with(" of 1.0 GiB"), "{reason}");
    let tight = auto("--memory 16MiB -j 1");
    assert_eq!((&tight["method"], &tight["reached_target"]), (&"hybrid".into(), &true.into()));
    let reason = tight["method_reason"].as_str().unwrap();
    assert!(reason.ends_with("there are 16.0 MiB: clustering first"), "{reason}");
    let expected = folder.read("out.ply");
    // The choice does not hang on threads, and the plan and the person are told.
    assert_eq!(auto("--memory 16MiB -j 3")["method"], "hybrid");
    assert!(folder.read("out.ply") == expected);
    folder.done("simplify in.ply -o asked.ply -t 3000 --method hybrid");
    assert!(folder.read("asked.ply") == expected);
    let line = "simplify in.stl -o out.ply --force -t 3000 --memory 16MiB";
    let plan = String::from_utf8(folder.done(&format!("{line} --dry-run"))).unwrap();
    assert!(plan.contains(&format!("method     hybrid: {reason}")), "{plan}");
    let said = folder.run(line).stderr;
    assert!(said.contains(&format!("method: hybrid: {reason}")), "{said}");
}

#[test]
fn auto_looks_again_where_headers_do_not_say_how_many_triangles_there_are() {
    let folder = Folder::new();
    folder.done("generate gyroid --triangles 300k -o in.obj");
    let line = "simplify in.obj -o out.ply -t 3000 --force --memory 16MiB";
    let plan = String::from_utf8(folder.done(&format!("{line} --dry-run"))).unwrap();
    assert!(plan.contains("method     stream or hybrid: clustering first if slabs"), "{plan}");
    let report = folder.report(line);
    assert_eq!((&report["method"], &report["reached_target"]), (&"hybrid".into(), &true.into()));
    assert!(report["method_reason"].as_str().unwrap().contains("clustering first"));
    assert_eq!(folder.report(&line.replace("16MiB", "1GiB"))["method"], "stream");
}

#[test]
fn what_cannot_be_is_refused_with_what_it_needs() {
    let folder = Folder::new();
    folder.done("generate sphere --triangles 100k -o in.ply");
    let said = folder.fails("simplify in.ply -o out.ply --ratio 90% --memory 2MiB", 1);
    assert!(said.contains("edge collapse to so many triangles needs"), "{said}");
    assert!(said.contains("2097152 are available") && said.contains("--method cluster"), "{said}");
    let said =
        folder.fails("simplify in.ply -o out.ply --ratio 90% --memory 2MiB --method hybrid", 1);
    assert!(said.contains("the mesh that clustering leaves needs"), "{said}");
    for flags in
        ["--cells 50", "--ratio 1% --selection multiple-choice", "--ratio 1% --assume-sorted z"]
    {
        folder.fails(&format!("simplify in.ply -o out.ply --method hybrid {flags}"), 2);
    }
    assert!(!fs::exists(folder.path("out.ply")).unwrap());
}

#[test]
fn a_goal_near_the_input_is_met_too() {
    let folder = Folder::new();
    folder.write("in.ply", plain_with_a_hill(60).bytes(Format::Ply));
    let report = folder.report("simplify in.ply -o out.ply --method hybrid --ratio 80%");
    assert_eq!(report["reached_target"], true, "{report}");
    let wanted = (f64::from(60 * 60 * 2) * 0.8).round() as usize;
    assert_eq!(read(&folder, "out.ply").triangles().len(), wanted);
}

/// All squares of a lattice of cubes, as an OBJ: no edge inside it has fewer than four faces.
fn lattice(side: usize) -> String {
    let range = || 0..=side;
    let vertices = range().flat_map(|z| range().flat_map(move |y| range().map(move |x| [x, y, z])));
    let mut text = String::new();
    vertices.clone().for_each(|[x, y, z]| writeln!(text, "v {x} {y} {z}").unwrap());
    let steps = [1, side + 1, (side + 1) * (side + 1)];
    for (index, corner) in vertices.enumerate() {
        for [u, w] in [[0, 1], [1, 2], [2, 0]] {
            if corner[u] < side && corner[w] < side {
                let (a, b, d) = (index + 1, index + 1 + steps[u], index + 1 + steps[w]);
                writeln!(text, "f {a} {b} {} {d}", b + steps[w]).unwrap();
            }
        }
    }
    text
}

#[test]
fn auto_clusters_first_where_slabs_get_stuck() {
    let folder = Folder::new();
    fs::write(folder.path("in.obj"), lattice(12)).unwrap();
    let asked = folder.report("simplify in.obj -o asked.ply -t 1000 --method stream");
    assert_eq!((&asked["stopped_by"], &asked["method_reason"]), (&"topology".into(), &().into()));
    let auto = folder.report("simplify in.obj -o out.ply -t 1000");
    assert_eq!(auto["method"], "hybrid");
    let reason = auto["method_reason"].as_str().unwrap();
    let left = asked["output"]["triangles"].as_u64().unwrap();
    assert!(reason.starts_with(&format!("slabs were left with {left} triangles")), "{reason}");
    assert!(auto["output"]["triangles"].as_u64().unwrap() < left, "{auto}");
    folder.done("simplify in.obj -o hybrid.ply -t 1000 --method hybrid");
    assert!(folder.read("out.ply") == folder.read("hybrid.ply"));
    // From a pipe there is no second time.
    let line = "simplify - --input-format obj -o piped.ply -t 1000 --report piped.json";
    assert_eq!(folder.run_with(line, &folder.read("in.obj")).code, Some(0));
    assert!(folder.read("piped.ply") == folder.read("asked.ply"));
}
