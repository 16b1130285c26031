//! How real and made meshes hang together, through the command and beside an oracle.

use std::collections::HashMap;

use meshmill::{formats::Format, geometry};
use serde_json::{Value, json};

use crate::{
    command::{Folder, Surface},
    meshes,
};

/// The counts of a mesh that `line` names, with its flags, but for those that follow from others.
fn counted(folder: &Folder, line: &str) -> Value {
    let stdout = folder.done(&format!("info --topology --json -q {line}"));
    let mut report: Value = serde_json::from_slice(&stdout).unwrap();
    let mut topology = report["topology"].take();
    let facts = topology.as_object_mut().unwrap();
    facts.remove("triangles_per_vertex");
    let share = facts.remove("sliver_share").unwrap().as_f64().unwrap();
    let [slivers, all] = ["slivers", "triangles"].map(|name| facts[name].as_f64().unwrap());
    assert!((share - slivers / all).abs() < 1e-12, "{share}");
    topology
}

/// Disjoint sets, as trees of parents.
struct Sets(Vec<usize>);

impl Sets {
    fn find(&mut self, mut at: usize) -> usize {
        while self.0[at] != at {
            self.0[at] = self.0[self.0[at]];
            at = self.0[at];
        }
        at
    }

    fn unite(&mut self, a: usize, b: usize) {
        let (a, b) = (self.find(a), self.find(b));
        self.0[a] = b;
    }

    fn count(&mut self) -> usize {
        (0..self.0.len()).filter(|at| self.find(*at) == *at).count()
    }
}

/// Counts a mesh in memory: edges by sorting them, fans by joining the corners that meet at edges.
fn oracle(triangles: &[[[f32; 3]; 3]]) -> Value {
    let mut numbers = HashMap::new();
    let mut vertex = |corner: [f32; 3]| {
        let new = numbers.len();
        *numbers.entry(corner.map(|coordinate| (coordinate + 0.0).to_bits())).or_insert(new)
    };
    let is_face = |[a, b, c]: &&[[f32; 3]; 3]| a != b && b != c && c != a;
    let faces: Vec<[usize; 3]> =
        triangles.iter().filter(is_face).map(|corners| corners.map(&mut vertex)).collect();
    let vertices = numbers.len();
    // The lesser end, the greater one, the face, and the corners of the face at both ends.
    let mut sides: Vec<[usize; 5]> = Vec::new();
    let (mut fans, mut components) =
        (Sets((0..3 * faces.len()).collect()), Sets((0..vertices).collect()));
    for (index, face) in faces.iter().enumerate() {
        for side in 0..3 {
            let (from, to) = (side, (side + 1) % 3);
            components.unite(face[from], face[to]);
            let runs_up = usize::from(face[from] < face[to]);
            let (low, high) = if runs_up == 1 { (from, to) } else { (to, from) };
            sides.push([face[low], face[high], runs_up, 3 * index + low, 3 * index + high]);
        }
    }
    sides.sort_unstable();
    let edges: Vec<&[[usize; 5]]> = sides.chunk_by(|a, b| a[..2] == b[..2]).collect();
    let of_faces = |least: usize, most: usize| {
        edges.iter().filter(move |edge| (least..=most).contains(&edge.len()))
    };
    for edge in of_faces(2, 2) {
        fans.unite(edge[0][3], edge[1][3]);
        fans.unite(edge[0][4], edge[1][4]);
    }
    let mut fans_of = vec![0; vertices];
    for corner in 0..3 * faces.len() {
        fans_of[faces[corner / 3][corner % 3]] += usize::from(fans.find(corner) == corner);
    }
    of_faces(3, usize::MAX).flat_map(|edge| [edge[0][0], edge[0][1]]).for_each(|v| fans_of[v] = 2);
    let mut ends: Vec<usize> = of_faces(1, 1).flat_map(|e| [e[0][0], e[0][1]]).collect();
    ends.sort_unstable();
    ends.dedup();
    let mut sorted: Vec<[usize; 3]> = faces.clone();
    for face in &mut sorted {
        face.sort_unstable();
    }
    sorted.sort_unstable();
    let flat = triangles.iter().filter(|corners| geometry::has_no_area(corners)).count();
    let thin = triangles.iter().filter(|corners| geometry::is_worse_than(corners, 0.1)).count();
    json!({
        "triangles": triangles.len(),
        "faces": faces.len(),
        "vertices": vertices,
        "edges": edges.len(),
        "euler_characteristic": vertices as i64 - edges.len() as i64 + faces.len() as i64,
        "components": components.count(),
        "boundary_edges": of_faces(1, 1).count(),
        "boundary_vertices": ends.len(),
        "non_manifold_edges": of_faces(3, usize::MAX).count(),
        "non_manifold_vertices": fans_of.iter().filter(|fans| **fans > 1).count(),
        "inconsistent_edges": of_faces(2, 2).filter(|edge| edge[0][2] == edge[1][2]).count(),
        "duplicate_faces": sorted.windows(2).filter(|two| two[0] == two[1]).count(),
        "degenerate_faces": flat,
        "slivers": thin - flat,
    })
}

#[test]
fn real_meshes_hang_together_as_an_oracle_says() {
    let Some(source) = meshes::folder("real") else { return };
    let folder = Folder::new();
    for file in meshes::files_in(&source) {
        let whole = meshes::read_file(&source.join(&file));
        let corners: Vec<[[f32; 3]; 3]> = if whole.declared.indexed {
            let position = |index: u64| whole.positions[index as usize];
            whole.triangles().iter().map(|triangle| triangle.map(position)).collect()
        } else {
            whole.positions.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect()
        };
        let path = source.join(&file);
        assert_eq!(counted(&folder, path.to_str().unwrap()), oracle(&corners), "{file}");
    }
}

#[test]
fn order_format_memory_and_threads_change_no_count() {
    let folder = Folder::new();
    for (name, surface) in [("hills", Surface::hills(150)), ("confetti", Surface::confetti(9000))] {
        let expected = oracle(&surface.corners());
        let shuffled = surface.clone().shuffled();
        folder.write("a.ply", surface.bytes(Format::Ply));
        folder.write("b.ply", shuffled.colored().bytes(Format::Ply));
        folder.write("c.stl", surface.clone().shuffled().bytes(Format::Stl));
        for line in ["a.ply -j 1", "a.ply -j 3", "b.ply --memory 9MiB", "c.stl --memory 9MiB -j 2"]
        {
            assert_eq!(counted(&folder, line), expected, "{name} {line}");
        }
        let line = "info --topology --json -q -";
        for format in [Format::Stl, Format::Ply] {
            let ran = folder.run_with(line, &surface.bytes(format));
            let report: Value = serde_json::from_slice(&ran.stdout).unwrap();
            assert_eq!(report["topology"]["edges"], expected["edges"], "{name} {format:?}");
        }
        let mut half = surface.clone();
        let others = half.triangles.split_off(half.triangles.len() / 3);
        folder.write("half.stl", half.bytes(Format::Stl));
        half.triangles = others;
        folder.write("others.ply", half.bytes(Format::Ply));
        assert_eq!(counted(&folder, "half.stl others.ply"), expected, "{name}");
    }
}

#[test]
fn a_front_too_large_along_the_longest_side_is_swept_along_another() {
    // Needles along x, one beside the other along y: each of them is as long as the mesh.
    let count = 40_000;
    let corner = |side: u64, y: u64| [10.0 * side as f32, y as f32 * 1e-4, 0.0];
    let vertices = (0..=count).flat_map(|y| [corner(0, y), corner(1, y)]).collect();
    let needles = |y: u64| {
        let [a, b, c, d] = [2 * y, 2 * y + 1, 2 * y + 3, 2 * y + 2];
        [[a, b, c], [a, c, d]]
    };
    let triangles = (0..count).flat_map(needles).collect();
    let surface = Surface { vertices, colors: Vec::new(), triangles };
    let folder = Folder::new();
    folder.write("needles.stl", surface.shuffled().bytes(Format::Stl));
    let expected = counted(&folder, "needles.stl --memory 1GiB");
    assert_eq!((&expected["faces"], &expected["components"]), (&json!(2 * count), &json!(1)));
    assert_eq!(
        (&expected["slivers"], &expected["boundary_edges"]),
        (&json!(2 * count), &json!(2 * count + 2))
    );
    let found = counted(&folder, "needles.stl --memory 8MiB");
    assert_eq!(found, expected);
}

#[test]
fn a_front_too_large_along_every_side_is_said_to_be() {
    // Triangles from one corner of a cube to all over the opposite sides: none ends before all have
    // begun, whichever way they are swept.
    let mut surface = Surface::confetti(60_000);
    for corners in surface.vertices.chunks_exact_mut(3) {
        corners[0] = corners[0].map(|x| x * 0.01);
        corners[1] = corners[1].map(|x| 1.0 + x * 0.01);
    }
    let folder = Folder::new();
    folder.write("all.stl", surface.bytes(Format::Stl));
    let text = folder.fails("info --topology all.stl --memory 8MiB -q", 1);
    assert!(text.contains("the front of the sweep needs"), "{text}");
    assert_eq!(counted(&folder, "all.stl")["components"], json!(60_000));
}
