//! How near clustering comes to a wanted count.

use std::{
    fmt::Write as _,
    io::{self, Write as _},
    path::Path,
};

use meshmill::formats::Format;

use crate::{
    command::{Folder, Surface},
    meshes,
};

/// Meshes of a few ten thousand triangles of every kind: scans, volumes, machine parts, terrain.
const REAL: &[&str] = &["bunny70k_meshlab.ply", "42400-IDGH.stl", "casting.off", "cow.obj"];
const RATIOS: &[&str] = &["50%", "10%", "1%"];

/// Simplifies `input` by every ratio; prints what came out, and returns what missed its count.
fn misses(folder: &Folder, input: &Path) -> Vec<String> {
    let name = input.file_name().unwrap().to_string_lossy();
    let (mut row, mut misses) = (format!("{name:>24}"), Vec::new());
    for ratio in RATIOS {
        let line = format!(
            "simplify {} -o out.ply --force --method cluster --ratio {ratio}",
            input.display()
        );
        let report = folder.report(&line);
        let number = |part: &str| report[part]["triangles"].as_u64().unwrap() as f64;
        let share: f64 = ratio.trim_end_matches('%').parse().unwrap();
        let wanted = (number("input") * share / 100.0).round();
        let factor = number("output") / wanted;
        let attempts = &report["cluster"]["attempts"];
        write!(row, "  {ratio:>3} {factor:4.2} in {attempts}").unwrap();
        let is_met = (0.8..=1.25).contains(&factor);
        assert_eq!(report["reached_target"], is_met, "{name} {ratio}");
        assert_eq!(report["stopped_by"], if is_met { "target" } else { "resolution" });
        if !is_met {
            misses.push(format!("{name} {ratio}: {factor:.2}"));
        }
    }
    io::stderr().write_all(format!("{row}\n").as_bytes()).unwrap();
    misses
}

#[test]
fn counts_are_met_within_a_quarter_on_generated_surfaces() {
    let folder = Folder::new();
    let mut missed = Vec::new();
    for kind in ["gyroid", "sphere", "height-field"] {
        let name = format!("{kind}.stl");
        folder.done(&format!("generate {kind} --triangles 60k -o {name}"));
        missed.extend(misses(&folder, &folder.path(&name)));
    }
    assert!(missed.is_empty(), "{missed:?}");
}

#[test]
fn counts_are_met_within_a_quarter_on_real_meshes() {
    let Some(real) = meshes::folder("real") else { return };
    let folder = Folder::new();
    let missed: Vec<_> = REAL.iter().flat_map(|name| misses(&folder, &real.join(name))).collect();
    assert!(missed.is_empty(), "{missed:?}");
}

#[test]
fn a_count_that_no_grid_meets_is_said_and_strict_fails() {
    // Half of the triangles in one speck: either it is one cell, or nothing is simplified.
    let folder = Folder::new();
    let mut surface = Surface::hills(10);
    surface.vertices.iter_mut().flatten().for_each(|coordinate| *coordinate *= 1e-7);
    let first = surface.vertices.len() as u64;
    surface.vertices.extend(Surface::hills(10).vertices);
    let far = surface.triangles.clone().into_iter().map(|triangle| triangle.map(|i| i + first));
    surface.triangles.extend(far);
    folder.write("in.stl", surface.bytes(Format::Stl));
    let line = "simplify in.stl -o out.ply --force --method cluster -t 300";
    assert_eq!(folder.report(line)["reached_target"], false);
    let ran = folder.run(&format!("{line} --strict"));
    assert_eq!(ran.code, Some(4), "{}", ran.stderr);
    assert!(ran.stderr.contains("not met within 25 %"), "{}", ran.stderr);
}
