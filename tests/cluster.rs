//! Clustering through the command: beside an oracle in memory, and the same bytes however it is
//! done.

use meshmill::formats::Format;

use crate::{
    command::{Folder, Surface},
    meshes::{self, Whole},
};
use oracle::Oracle;

mod oracle;
mod targets;

fn read(folder: &Folder, name: &str) -> Whole {
    meshes::read_file(&folder.path(name))
}

/// Compares what the command makes of `surface` with the oracle.
fn check_against_oracle(surface: &Surface, cells: u32) {
    let folder = Folder::new();
    folder.write("in.ply", surface.bytes(Format::Ply));
    folder.done(&format!("simplify in.ply -o out.ply --cells {cells}"));
    let oracle = Oracle::new(&surface.corners(), cells);
    let whole = read(&folder, "out.ply");
    assert_eq!(whole.triangles(), oracle.triangles, "{cells} cells");
    assert_eq!(whole.positions.len(), oracle.vertices.len());
    for (ours, theirs) in whole.positions.iter().zip(&oracle.vertices) {
        for axis in 0..3 {
            let apart = (f64::from(ours[axis]) - theirs.position[axis]).abs() / oracle.cell_size;
            assert!(apart < 1e-3, "{ours:?} {:?}: {apart} of a cell", theirs.position);
        }
    }
}

#[test]
fn clusters_are_those_of_an_oracle_in_memory() {
    check_against_oracle(&Surface::hills(120), 30);
    check_against_oracle(&Surface::hills(40), 97);
    check_against_oracle(&Surface::confetti(4000), 9);
    check_against_oracle(&Surface::confetti(3000), 60);
    // Twice the same triangles: duplicates go, and the places stay.
    let mut twice = Surface::hills(50);
    twice.triangles.extend(twice.triangles.clone().iter().map(|[a, b, c]| [*b, *c, *a]));
    check_against_oracle(&twice, 20);
}

#[test]
fn representatives_lie_in_their_cells() {
    let folder = Folder::new();
    for (surface, cells) in [(Surface::hills(90), 25), (Surface::confetti(4000), 11)] {
        folder.write("in.stl", surface.bytes(Format::Stl));
        let oracle = Oracle::new(&surface.corners(), cells);
        for placement in ["constrained", "clamped"] {
            let line = "simplify in.stl -o out.ply --force --placement";
            folder.done(&format!("{line} {placement} --cells {cells}"));
            let whole = read(&folder, "out.ply");
            assert_eq!(whole.positions.len(), oracle.vertices.len());
            for (ours, theirs) in whole.positions.iter().zip(&oracle.vertices) {
                let outside = oracle.outside(theirs.cell, ours.map(f64::from));
                assert!(outside < 1e-5, "{placement}: {ours:?} {:?}: {outside}", theirs.cell);
            }
        }
    }
}

#[test]
fn colours_are_means_by_area() {
    let surface = Surface::hills(60).colored();
    let folder = Folder::new();
    folder.write("in.ply", surface.bytes(Format::Ply));
    folder.done("simplify in.ply -o out.ply --cells 15");
    let oracle = Oracle::with_colors(&surface, 15);
    let whole = read(&folder, "out.ply");
    assert_eq!(whole.colors.len(), oracle.vertices.len());
    for (ours, theirs) in whole.colors.iter().zip(&oracle.vertices) {
        for channel in 0..4 {
            let apart = (f64::from(ours[channel]) - theirs.color[channel]).abs();
            assert!(apart < 0.6, "{ours:?} {:?}", theirs.color);
        }
    }
}

/// Every way to cluster `surface`: with room and without, on one to three threads, in order and
/// shuffled, as indices and as soup.
fn check_same_bytes(surface: &Surface, cells: u32) {
    let folder = Folder::new();
    folder.write("in.ply", surface.bytes(Format::Ply));
    folder.write("in.soup", surface.bytes(Format::Soup));
    folder.write("shuffled.soup", surface.clone().shuffled().bytes(Format::Soup));
    folder.write("shuffled.ply", surface.clone().shuffled().bytes(Format::Ply));
    let mut expected: Option<Vec<u8>> = None;
    for input in ["in.ply", "in.soup", "shuffled.ply", "shuffled.soup"] {
        for (memory, threads) in [("1GiB", 1), ("1GiB", 3), ("1MiB", 1), ("1MiB", 2), ("1MiB", 3)] {
            let line = format!(
                "simplify {input} -o out.ply --force --cells {cells} --memory {memory} -j {threads}"
            );
            let spills = folder.report(&line)["cluster"]["spills"].as_u64().unwrap();
            assert_eq!(spills > 0, memory == "1MiB", "{line}: {spills} spills");
            let bytes = folder.read("out.ply");
            let same = *expected.get_or_insert_with(|| bytes.clone()) == bytes;
            assert!(same, "{line}: other bytes");
        }
    }
}

#[test]
fn the_same_bytes_come_out_for_any_memory_threads_and_order() {
    check_same_bytes(&Surface::hills(170), 140);
    check_same_bytes(&Surface::confetti(16_000), 100);
}

#[test]
fn the_same_bytes_come_out_with_colours_too() {
    check_same_bytes(&Surface::hills(150).colored(), 130);
}

/// Sums beyond 32 bits: many triangles in two cells, spilled or not.
#[test]
fn many_triangles_in_few_cells_spill_nothing_and_lose_nothing() {
    let folder = Folder::new();
    let surface = Surface::hills(150);
    folder.write("in.soup", surface.bytes(Format::Soup));
    folder.write("shuffled.soup", surface.shuffled().bytes(Format::Soup));
    for cells in [2, 3] {
        let line = format!("simplify in.soup -o out.ply --force --cells {cells}");
        let report = folder.report(&format!("{line} -j 1"));
        assert_eq!(report["cluster"]["spills"], 0);
        let expected = folder.read("out.ply");
        for input in ["in.soup", "shuffled.soup"] {
            let line = format!("simplify {input} -o out.ply --force --cells {cells}");
            folder.done(&format!("{line} --memory 1MiB -j 3"));
            assert_eq!(folder.read("out.ply"), expected, "{line}");
        }
    }
}

#[test]
fn cells_that_swallow_everything_are_an_error_that_says_so() {
    let folder = Folder::new();
    folder.write("in.stl", Surface::hills(20).bytes(Format::Stl));
    for goal in ["--cells 1", "--cell-size 1000"] {
        let said = folder.fails(&format!("simplify in.stl -o out.ply {goal}"), 2);
        assert!(said.contains("leave none of 800 triangles"), "{said}");
    }
    // All in one point.
    let point =
        Surface { vertices: vec![[0.5; 3]], triangles: vec![[0; 3]; 5], ..Surface::default() };
    folder.write("point.stl", point.bytes(Format::Stl));
    folder.fails("simplify point.stl -o out.ply --cells 100", 2);
}

#[test]
fn the_finest_cells_keep_every_triangle() {
    let folder = Folder::new();
    for scale in [1.0, 0.3, 1e-3, 7.7e5] {
        let mut surface = Surface::hills(30);
        surface.vertices.iter_mut().flatten().for_each(|coordinate| *coordinate *= scale);
        folder.write("in.stl", surface.bytes(Format::Stl));
        let report = folder.report("simplify in.stl -o out.ply --force --cells 2097152");
        assert_eq!(report["output"]["triangles"], 1800, "scale {scale}");
        assert_eq!(report["cluster"]["cells"][0], 2_097_152, "scale {scale}");
    }
    let said = folder.fails("simplify in.stl -o out2.ply --cells 2097153", 2);
    assert!(said.contains("2097152"), "{said}");
    folder.fails("simplify in.stl -o out2.ply --cell-size 0.0001", 2);
}
