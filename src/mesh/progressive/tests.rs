//! Recordings turned round come back face for face, and half-edges stay what they are of the faces.

use super::{Growing, HalfEdges, Turned, record, turn_round};
use crate::{
    formats::progressive::{Channels, Header, Kind, Split},
    mesh::{ByQuadric, ByVolume, Mesh, Metric},
    progress::{Monitor, StageId},
    soup::{ColoredPoint, Vertex as _},
};

type Face = [u32; 3];

/// A header of so many bits.
fn header(bits: u32) -> Header {
    Header::of_grid(Channels::Rgba, bits, [0.0; 3], 1.0)
}

/// A surface on whole numbers, with colours that tell vertices apart.
struct Surface {
    vertices: Vec<ColoredPoint>,
    faces: Vec<Face>,
}

impl Surface {
    fn of(positions: impl Iterator<Item = [f32; 3]>, faces: Vec<Face>) -> Self {
        let vertex = |(index, position): (usize, [f32; 3])| {
            let color = [index as u8, (index >> 8) as u8, 7, 200];
            ColoredPoint { position: position.map(f32::round), color }
        };
        Self { vertices: positions.enumerate().map(vertex).collect(), faces }
    }

    /// A square of hills: one boundary.
    fn hills(side: u32) -> Self {
        let position = |i: u32| {
            let (x, y) = ((i % side) as f32, (i / side) as f32);
            [40.0 * x, 40.0 * y, 500.0 + 90.0 * ((0.7 * x).sin() + (0.5 * y).cos())]
        };
        let quads = (0..side * side).filter(|i| i % side < side - 1 && i / side < side - 1);
        let faces = quads.flat_map(|i| [[i, i + 1, i + side], [i + 1, i + side + 1, i + side]]);
        Self::of((0..side * side).map(position), faces.collect())
    }

    /// A torus: no boundary.
    fn torus(side: u32) -> Self {
        let position = |i: u32| {
            let turn = |n: u32| n as f32 / side as f32 * std::f32::consts::TAU;
            let (u, v) = (turn(i % side), turn(i / side));
            let radius = 500.0 + 200.0 * v.cos();
            [800.0 + radius * u.cos(), 800.0 + radius * u.sin(), 300.0 + 200.0 * v.sin()]
        };
        let at = |x: u32, y: u32| x % side + y % side * side;
        let quads = (0..side * side).map(|i| (i % side, i / side));
        let faces = quads.flat_map(|(x, y)| {
            let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)];
            [[a, b, c], [b, d, c]]
        });
        Self::of((0..side * side).map(position), faces.collect())
    }

    /// Several in one, each moved along the first axis.
    fn joined(parts: Vec<Self>) -> Self {
        let mut whole = Self { vertices: Vec::new(), faces: Vec::new() };
        for (number, part) in parts.into_iter().enumerate() {
            let first = whole.vertices.len() as u32;
            whole.vertices.extend(part.vertices.into_iter().map(|mut vertex| {
                vertex.position[0] += 1600.0 * number as f32;
                vertex
            }));
            whole.faces.extend(part.faces.into_iter().map(|face| face.map(|v| v + first)));
        }
        whole
    }

    /// Faces by what their corners are, turned so that the least comes first, in order.
    fn told(&self) -> Vec<[([u32; 3], [u8; 4]); 3]> {
        let corner = |v: u32| {
            let vertex = self.vertices[v as usize];
            (vertex.position.map(|c| c as u32), vertex.color())
        };
        told(self.faces.iter().map(|face| face.map(corner)))
    }
}

fn told<T: Ord + Copy>(faces: impl Iterator<Item = [T; 3]>) -> Vec<[T; 3]> {
    let turned = |face: [T; 3]| {
        let [a, b, c] = face;
        *[[a, b, c], [b, c, a], [c, a, b]].iter().min().unwrap()
    };
    let mut faces: Vec<[T; 3]> = faces.map(turned).collect();
    faces.sort_unstable();
    faces
}

fn told_of(mesh: &Growing) -> Vec<[([u32; 3], [u8; 4]); 3]> {
    let corner = |v: u32| (mesh.positions()[v as usize], mesh.colors()[v as usize]);
    told(mesh.faces().iter().map(|face| face.map(corner)))
}

/// What a surface becomes, and its batches.
fn turned<M: Metric>(surface: &Surface, faces: usize) -> (Turned, Vec<Vec<Split>>) {
    let monitor = Monitor::silent();
    let meter = monitor.meter(StageId::Record, None);
    let mesh = Mesh::<M>::of_scanned(&surface.vertices, surface.faces.clone());
    let recording = record(mesh, 14, faces, &meter).unwrap();
    let mut batches = Vec::new();
    let take = &mut |splits| batches.push(splits);
    let turned = turn_round(recording, &header(14), &meter, &mut |_| {}, take).unwrap();
    (turned, batches)
}

/// What is kept is what the faces alone would tell.
fn assert_consistent(mesh: &Growing) {
    let fresh = HalfEdges::of_faces(mesh.positions().len(), mesh.faces());
    assert!(mesh.half_edges().is_as(&fresh));
}

/// Vertices less edges plus faces.
fn euler(mesh: &Growing) -> i64 {
    let mut edges: Vec<[u32; 2]> = Vec::new();
    let mut used = vec![0; mesh.positions().len()];
    for &[a, b, c] in mesh.faces() {
        edges.extend([[a, b], [b, c], [c, a]].map(|[u, v]| [u.min(v), u.max(v)]));
        for vertex in [a, b, c] {
            used[vertex as usize] = 1;
        }
    }
    edges.sort_unstable();
    edges.dedup();
    used.iter().sum::<i64>() - edges.len() as i64 + mesh.faces().len() as i64
}

fn assert_comes_back<M: Metric>(surface: &Surface, faces: usize) -> (Turned, Vec<Vec<Split>>) {
    let (turned, batches) = turned::<M>(surface, faces);
    assert_eq!(told_of(&turned.finest), surface.told());
    let mut mesh = Growing::of_base(&turned.base, &header(14));
    let expected = euler(&turned.finest);
    assert_eq!(euler(&mesh), expected);
    for splits in &batches {
        assert!(splits.is_sorted_by(|one, two| one.parent < two.parent));
        // Every third one, in order: any part of a batch gives a mesh.
        let mut part = mesh.clone();
        splits.iter().step_by(3).for_each(|split| part.split(split).unwrap());
        assert_consistent(&part);
        assert_eq!(euler(&part), expected);
        for split in splits {
            mesh.split(split).unwrap();
        }
        assert_consistent(&mesh);
        assert_eq!(euler(&mesh), expected);
    }
    assert_eq!(told_of(&mesh), surface.told());
    (turned, batches)
}

#[test]
fn surfaces_come_back_face_for_face_by_either_metric() {
    for surface in [Surface::hills(24), Surface::torus(20)] {
        for faces in [0, 100, 801] {
            let (turned, _) = assert_comes_back::<ByVolume>(&surface, faces);
            assert!(turned.base.faces.len() <= faces.max(60), "{}", turned.base.faces.len());
            assert_comes_back::<ByQuadric>(&surface, faces);
        }
    }
}

#[test]
fn pieces_and_what_is_no_surface_come_back() {
    let mut surface = Surface::joined(vec![
        Surface::torus(9),
        Surface::hills(7),
        Surface::hills(2),
        Surface::torus(6),
    ]);
    // A fin on the second piece makes edges of three faces, a flap one of two that go the same way,
    // and two triangles touch others in one vertex only.
    let first = 81;
    let top = surface.vertices.len() as u32;
    surface.vertices.push(ColoredPoint { position: [1700.0, 77.0, 1500.0], color: [9; 4] });
    surface.vertices.push(ColoredPoint { position: [1800.0, 78.0, 1400.0], color: [8; 4] });
    surface.faces.extend([
        [first + 8, first + 9, top],
        [first + 9, first + 10, top],
        [first, first + 1, top + 1],
        [first + 30, top, top + 1],
    ]);
    for faces in [0, 200] {
        assert_comes_back::<ByVolume>(&surface, faces);
        assert_comes_back::<ByQuadric>(&surface, faces);
    }
}

#[test]
fn the_last_faces_of_a_piece_stay() {
    // 2---3
    // | \ |
    // 0---1
    let surface = Surface::hills(2);
    let (turned, _) = assert_comes_back::<ByVolume>(&surface, 0);
    assert_eq!(turned.base.faces.len(), 1);
    let lone =
        Surface::of([[0.0; 3], [5.0, 0.0, 0.0], [0.0, 5.0, 0.0]].into_iter(), vec![[0, 1, 2]]);
    assert_eq!(assert_comes_back::<ByVolume>(&lone, 0).1.len(), 0);
}

#[test]
fn splits_that_do_not_fit_their_fans_are_refused_and_change_nothing() {
    let (turned, _) = turned::<ByVolume>(&Surface::hills(9), 40);
    let mesh = turned.finest;
    for parent in 0..mesh.positions().len() as u32 + 2 {
        for kind in [Kind::Between, Kind::First, Kind::Last] {
            for (first, taken) in (0..8).flat_map(|first| (0..8).map(move |taken| (first, taken))) {
                let mut changed = mesh.clone();
                let split = Split { parent, kind, first, taken, ..Split::default() };
                if changed.split(&split).is_err() {
                    assert_eq!(told_of(&changed), told_of(&mesh));
                }
                assert_consistent(&changed);
            }
        }
    }
}
