//! Decimation under an error bound through the command: the bound as an independent comparison
//! sees it, what ends it, and what is refused.

use std::fs;

use meshmill::formats::Format;
use serde_json::Value;

use crate::{
    command::{Folder, Surface},
    meshes,
};

/// The greatest distance of a vertex of `a` from `b`, as `compare` finds it. That looks at points
/// inside the triangles as well, at least at one: another one where that one is the farthest.
fn farthest_vertex(folder: &Folder, a: &str, b: &str) -> f64 {
    let mut least = f64::INFINITY;
    for seed in 0..20 {
        let line = format!("compare {a} {b} --samples 1 --seed {seed} --json -q --on-defect skip");
        let found: Value = serde_json::from_slice(&folder.done(&line)).unwrap();
        let found = &found["a_to_b"];
        least = least.min(found["max"].as_f64().unwrap());
        if found["max"] != found["p50"] {
            break;
        }
    }
    least
}

fn max_error(report: &Value) -> f64 {
    report["bounded"]["max_error"].as_f64().unwrap()
}

fn triangles(report: &Value) -> u64 {
    report["output"]["triangles"].as_u64().unwrap()
}

#[test]
fn every_vertex_lies_within_the_bound_by_any_fairing() {
    let folder = Folder::new();
    folder.done("generate gyroid --triangles 300k -o in.ply");
    for fairing in ["error", "shape", "smooth"] {
        for share in ["0.02%", "0.2%"] {
            let line = format!(
                "simplify in.ply -o out.ply --max-error {share} --fairing {fairing} --force"
            );
            let report = folder.report(&line);
            let (far, bound) = (farthest_vertex(&folder, "in.ply", "out.ply"), max_error(&report));
            assert!(far <= bound && far > 0.9 * bound, "{far} of {bound}: {line}");
            assert!(report["bounded"]["slabs"].as_u64().unwrap() > 1, "{report}");
            assert_eq!(
                (&report["method"], &report["stopped_by"]),
                (&"bounded".into(), &"error".into())
            );
            assert!(report["reached_target"].is_null(), "no count was asked for");
        }
    }
}

#[test]
fn a_length_and_a_share_mean_the_same_and_a_bound_far_from_zero_holds() {
    let folder = Folder::new();
    let mut surface = Surface::hills(60);
    folder.write("near.ply", surface.bytes(Format::Ply));
    surface.vertices.iter_mut().for_each(|vertex| vertex[0] += 4096.0);
    folder.write("far.ply", surface.bytes(Format::Ply));
    for name in ["near", "far"] {
        let by_share =
            folder.report(&format!("simplify {name}.ply -o a.ply --max-error 0.5% --force"));
        let length = max_error(&by_share);
        let line = format!("simplify {name}.ply -o b.ply --max-error {length} --force");
        assert_eq!(triangles(&folder.report(&line)), triangles(&by_share));
        assert_eq!(folder.read("a.ply"), folder.read("b.ply"));
        let input = format!("{name}.ply");
        assert!(farthest_vertex(&folder, &input, "a.ply") <= length);
    }
}

#[test]
fn whichever_comes_first_ends_it() {
    let folder = Folder::new();
    folder.write("in.ply", Surface::hills(60).bytes(Format::Ply));
    let both = |count: u64| {
        folder.report(&format!("simplify in.ply -o out.ply --max-error 0.5% -t {count} --force"))
    };
    let by_count = both(3000);
    assert_eq!(
        (&by_count["stopped_by"], &by_count["reached_target"]),
        (&"target".into(), &true.into())
    );
    assert!((2999..=3000).contains(&triangles(&by_count)));
    let by_error = both(3);
    assert_eq!(
        (&by_error["stopped_by"], &by_error["reached_target"]),
        (&"error".into(), &false.into())
    );
    assert!(max_error(&by_count) < max_error(&by_error));
    let line = "simplify in.ply -o out.ply --max-error 0.5% -t 3 --force --strict";
    assert_eq!(folder.run(line).code, Some(4));
    // A count alone takes as much error as it needs, and says how much.
    let alone = folder.report("simplify in.ply -o out.ply --method bounded -t 500 --force");
    assert!((499..=500).contains(&triangles(&alone)));
    assert!(farthest_vertex(&folder, "in.ply", "out.ply") <= max_error(&alone));
}

#[test]
fn threads_and_memory_change_nothing() {
    let folder = Folder::new();
    folder.done("generate gyroid --triangles 400k -o in.ply");
    let results: Vec<Vec<u8>> = ["-j 1 --memory 40MiB", "-j 2", "-j 5 --memory 200MiB"]
        .iter()
        .map(|options| {
            folder.done(&format!("simplify in.ply -o out.ply --max-error 0.1% --force {options}"));
            folder.read("out.ply")
        })
        .collect();
    assert!(results[1] == results[0] && results[2] == results[0]);
}

#[test]
fn what_makes_no_sense_is_refused_in_words() {
    let folder = Folder::new();
    folder.write("in.ply", Surface::hills(6).bytes(Format::Ply));
    for (flags, words) in [
        ("--max-error -1", "0 or above"),
        ("--max-error=-1", "0 or above"),
        ("--max-error NaN", "0 or above"),
        ("--max-error 1mm", "0 or above"),
        ("--max-error 1% --cells 5", "cannot be used with"),
        ("--max-error 1% --method cluster", "--method bounded"),
        ("--max-error 1% --selection multiple-choice", "keeps to no error bound"),
        ("--max-error 1% --assume-sorted x", "in model units"),
        ("--max-error 1 --max-color-error 5", "no input has vertex colours"),
        ("--max-error 1 --max-color-error=-5", "0 or above"),
        ("--max-error 1 --max-normal-deviation 200", "between 0 and 180"),
        ("-t 5 --max-normal-deviation 20", "go with an error bound"),
        ("--max-error 1 --fairing round", "possible values: error, shape, smooth"),
        ("--method bounded", "required"),
    ] {
        let ran = folder.run(&format!("simplify in.ply -o out.ply {flags}"));
        let is_said = ran.code == Some(2) && ran.stderr.contains(words);
        // A number that begins like a flag is taken for one.
        assert!(is_said || (flags.ends_with(" -1") && ran.code == Some(2)), "{flags}: {ran:?}");
        assert_eq!(folder.names(), ["in.ply"]);
    }
    let plan = folder.done("simplify in.ply -o out.ply --max-error 0 --dry-run");
    assert!(String::from_utf8(plan).unwrap().contains("bounded: there is an error bound"));
}

#[test]
fn a_stream_that_is_promised_to_be_sorted_keeps_a_length() {
    let folder = Folder::new();
    folder.done("generate height-field --triangles 100k -o in.soup");
    folder.done("sort in.soup -o sorted.soup --axis x");
    let line = "simplify sorted.soup -o out.ply --assume-sorted x --max-error 0.01";
    let report = folder.report(line);
    assert!(triangles(&report) < 50_000);
    assert!(farthest_vertex(&folder, "in.soup", "out.ply") <= 0.01);
}

/// Some of them dirty, as all of them are found.
#[test]
fn real_meshes_keep_the_bound() {
    let Some(real) = meshes::folder("real") else { return };
    let folder = Folder::new();
    for name in [
        "dragon_vrip_res3.ply",
        "abominevole.off",
        "truck.obj",
        "teapot.obj",
        "fandisk.obj",
        "os_plane_holes.obj",
        "trumpet.obj",
    ] {
        let kind = name.rsplit('.').next().unwrap();
        let input = format!("in.{kind}");
        fs::copy(real.join(name), folder.path(&input)).unwrap();
        for share in ["0.01%", "0.1%", "1%"] {
            let line = format!("simplify {input} -o out.ply --max-error {share} --force");
            let report = folder.report(&line);
            let (far, bound) = (farthest_vertex(&folder, &input, "out.ply"), max_error(&report));
            assert!(far <= bound, "{name} within {share}: {far} of {bound}");
        }
        folder.done(&format!("simplify {input} -o out.ply --max-error 0 --force"));
        fs::remove_file(folder.path(&input)).unwrap();
    }
}
