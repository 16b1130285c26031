//! Drawn cases with known answers, and small soups looked at by brute force.

use std::collections::{BTreeMap, BTreeSet};

use proptest::prelude::*;

use super::*;
use crate::{
    error::Error,
    progress::{Cancel, Event},
    soup::{Point, SweepAxis, SweepKey},
};

type Corners = [[f32; 3]; 3];

/// Topology of triangles in any order, in slabs of at least so many.
fn topology_of(triangles: &[Corners], axis: SweepAxis, new_triangles_min: usize) -> Outcome {
    let config = Config { axis, triangles: None, new_triangles_min, memory_bytes: 1 << 30 };
    run(triangles, &config, &Monitor::silent()).unwrap()
}

fn run(triangles: &[Corners], config: &Config, monitor: &Monitor) -> Result<Outcome> {
    let mut triangles: Vec<_> = triangles.iter().map(|t| Triangle(t.map(Point))).collect();
    triangles.sort_by_key(|triangle| SweepKey::of(triangle, config.axis));
    topology(config, monitor, |sink| triangles.chunks(7).try_for_each(sink))
}

/// The same along all axes and in slabs of all sizes.
fn topology_in_every_way(triangles: &[Corners]) -> Outcome {
    let whole = topology_of(triangles, SweepAxis::X, 1 << 20);
    for axis in SweepAxis::ALL {
        for new_triangles_min in [1, 2, 5, 1 << 20] {
            let outcome = topology_of(triangles, axis, new_triangles_min);
            assert_eq!(Outcome { front_max: 0, ..outcome }, whole, "{axis:?} {new_triangles_min}");
        }
    }
    whole
}

/// Counts with sets and maps, one definition after the other.
fn brute_force(triangles: &[Corners]) -> Outcome {
    let bits = |corner: [f32; 3]| corner.map(|coordinate| (coordinate + 0.0).to_bits());
    let all = triangles.iter().map(|corners| corners.map(bits));
    let faces: Vec<_> = all.filter(|[a, b, c]| a != b && b != c && c != a).collect();
    let vertices: BTreeSet<_> = faces.iter().flatten().copied().collect();
    // Of each edge the faces, and which way round they run along it.
    let mut edges: BTreeMap<_, Vec<(usize, bool)>> = BTreeMap::new();
    for (index, [a, b, c]) in faces.iter().enumerate() {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            edges.entry((from.min(to), from.max(to))).or_default().push((index, from < to));
        }
    }
    let is_inconsistent = |faces: &[(usize, bool)]| faces.len() == 2 && faces[0].1 == faces[1].1;
    let boundary = edges.iter().filter(|(_, faces)| faces.len() == 1);
    let boundary_vertices: BTreeSet<_> = boundary.flat_map(|((a, b), _)| [a, b]).collect();
    let is_fan = |vertex: &[u32; 3]| {
        let around: Vec<usize> = (0..faces.len()).filter(|f| faces[*f].contains(vertex)).collect();
        let at: Vec<_> = edges.iter().filter(|((a, b), _)| *a == vertex || *b == vertex).collect();
        let links = at.iter().filter(|(_, faces)| faces.len() == 2);
        let links: Vec<_> = links.map(|(_, faces)| (faces[0].0, faces[1].0)).collect();
        at.iter().all(|(_, faces)| faces.len() <= 2) && sets(&around, &links) == 1
    };
    let mut by_vertices: BTreeMap<_, u64> = BTreeMap::new();
    for mut face in faces.clone() {
        face.sort_unstable();
        *by_vertices.entry(face).or_default() += 1;
    }
    let links = faces.iter().flat_map(|[a, b, c]| [(*a, *b), (*b, *c)]);
    let components =
        sets(&vertices.iter().copied().collect::<Vec<_>>(), &links.collect::<Vec<_>>());
    let flat = triangles.iter().filter(|corners| crate::geometry::has_no_area(corners));
    Outcome {
        triangles: triangles.len() as u64,
        faces: faces.len() as u64,
        vertices: vertices.len() as u64,
        edges: edges.len() as u64,
        boundary_edges: edges.values().filter(|faces| faces.len() == 1).count() as u64,
        non_manifold_edges: edges.values().filter(|faces| faces.len() > 2).count() as u64,
        inconsistent_edges: edges.values().filter(|faces| is_inconsistent(faces)).count() as u64,
        boundary_vertices: boundary_vertices.len() as u64,
        non_manifold_vertices: vertices.iter().filter(|vertex| !is_fan(vertex)).count() as u64,
        components: components as u64,
        degenerate: flat.count() as u64,
        duplicate_faces: by_vertices.values().map(|count| count - 1).sum(),
        slivers: triangles.iter().filter(|corners| is_sliver(corners)).count() as u64,
        front_max: 0,
    }
}

fn is_sliver(corners: &Corners) -> bool {
    let [a, b, c] = corners.map(|corner| glam::DVec3::from_array(corner.map(f64::from)));
    let area = (b - a).cross(c - a).length() / 2.0;
    let edges_sq = (b - a).length_squared() + (c - b).length_squared() + (a - c).length_squared();
    area > 0.0 && 4.0 * 3.0_f64.sqrt() * area < SLIVER_QUALITY * edges_sq
}

/// Sets that links make of items.
fn sets<T: PartialEq + Copy>(items: &[T], links: &[(T, T)]) -> usize {
    let mut left = items.to_vec();
    let mut count = 0;
    while let Some(first) = left.pop() {
        count += 1;
        let mut reached = vec![first];
        while let Some(at) = reached.pop() {
            let is_linked = |to: &T| links.contains(&(at, *to)) || links.contains(&(*to, at));
            let (now, later): (Vec<T>, Vec<T>) = left.iter().partition(|to| is_linked(to));
            reached.extend(now);
            left = later;
        }
    }
    count
}

/// Twelve triangles of a cube with its least corner here, facing outwards.
fn cube(at: [f32; 3]) -> Vec<Corners> {
    let corner = |i: usize| [0, 1, 2].map(|axis| at[axis] + (i >> axis & 1) as f32);
    let sides =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    sides
        .iter()
        .flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]].map(|t| t.map(|i| corner(*i))))
        .collect()
}

/// A strip of squares around a ring of so many, twisted so many times by half a turn.
fn ring(squares: usize, half_turns: f32) -> Vec<Corners> {
    use std::f32::consts::{PI, TAU};
    let corner = |at: usize, side: f32| {
        // Once around, an odd number of half turns leads to the other side of the strip.
        let is_turned = at == squares && half_turns % 2.0 != 0.0;
        let (at, side) = (at % squares, if is_turned { -side } else { side });
        let part = at as f32 / squares as f32;
        let (turn, around) = (part * half_turns * PI, part * TAU);
        let radius = 3.0 + side * turn.cos();
        [radius * around.cos(), radius * around.sin(), side * turn.sin()]
    };
    let square = |i: usize| {
        let [a, b, c, d] =
            [corner(i, -1.0), corner(i, 1.0), corner(i + 1, 1.0), corner(i + 1, -1.0)];
        [[a, b, c], [a, c, d]]
    };
    (0..squares).flat_map(square).collect()
}

/// A torus of so many squares each way.
fn torus(around: u16, across: u16) -> Vec<Corners> {
    use std::f32::consts::TAU;
    let corner = |i: u16, j: u16| {
        let [u, v] =
            [f32::from(i % around) / f32::from(around), f32::from(j % across) / f32::from(across)];
        let radius = 3.0 + (v * TAU).cos();
        [radius * (u * TAU).cos(), radius * (u * TAU).sin(), (v * TAU).sin()]
    };
    let square = |k: u16| {
        let (i, j) = (k / across, k % across);
        let [a, b, c, d] = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
        [[a, b, c], [a, c, d]]
    };
    (0..around * across).flat_map(square).collect()
}

#[test]
fn a_cube_is_a_closed_surface() {
    let outcome = topology_in_every_way(&cube([0.0; 3]));
    let expected = Outcome {
        triangles: 12,
        faces: 12,
        vertices: 8,
        edges: 18,
        components: 1,
        ..Outcome::default()
    };
    assert_eq!(outcome, expected);
    assert_eq!(outcome.euler_characteristic(), 2);
}

#[test]
fn an_open_grid_has_a_boundary() {
    // 4 × 3 squares, each cut in two.
    let corner = |x: u8, y: u8| [f32::from(x), f32::from(y), 0.0];
    let square = |i: u8| {
        let (x, y) = (i / 3, i % 3);
        let [a, b, c, d] = [corner(x, y), corner(x + 1, y), corner(x + 1, y + 1), corner(x, y + 1)];
        [[a, b, c], [a, c, d]]
    };
    let grid: Vec<Corners> = (0..12).flat_map(square).collect();
    let outcome = topology_in_every_way(&grid);
    assert_eq!((outcome.vertices, outcome.edges, outcome.faces), (20, 4 * 4 + 3 * 5 + 12, 24));
    assert_eq!((outcome.boundary_edges, outcome.boundary_vertices), (14, 14));
    assert_eq!((outcome.euler_characteristic(), outcome.non_manifold_vertices), (1, 0));
}

#[test]
fn a_strip_with_half_a_turn_has_one_side() {
    let plain = topology_in_every_way(&ring(24, 2.0));
    assert_eq!((plain.euler_characteristic(), plain.boundary_edges), (0, 48));
    assert_eq!(plain.inconsistent_edges, 0);
    let moebius = topology_in_every_way(&ring(24, 1.0));
    assert_eq!((moebius.euler_characteristic(), moebius.boundary_edges), (0, 48));
    assert_eq!((moebius.inconsistent_edges, moebius.non_manifold_vertices), (1, 0));
}

#[test]
fn a_torus_has_a_hole() {
    let outcome = topology_in_every_way(&torus(20, 9));
    assert_eq!((outcome.euler_characteristic(), outcome.components), (0, 1));
    assert_eq!((outcome.boundary_edges, outcome.inconsistent_edges), (0, 0));
    // Two of them, one inside the other's hole: apart but at the same places of the sweep.
    let beside = torus(20, 9).into_iter().map(|t| t.map(|c| c.map(|x| x * 0.25)));
    let both: Vec<_> = torus(20, 9).into_iter().chain(beside).collect();
    assert_eq!(topology_in_every_way(&both).components, 2);
}

#[test]
fn cubes_that_touch_are_one_component_with_something_not_manifold() {
    let at_vertex = [cube([0.0; 3]), cube([1.0; 3])].concat();
    let outcome = topology_in_every_way(&at_vertex);
    assert_eq!((outcome.components, outcome.vertices, outcome.edges), (1, 15, 36));
    assert_eq!((outcome.non_manifold_vertices, outcome.non_manifold_edges), (1, 0));
    let at_edge = [cube([0.0; 3]), cube([1.0, 1.0, 0.0])].concat();
    let outcome = topology_in_every_way(&at_edge);
    assert_eq!((outcome.components, outcome.vertices, outcome.edges), (1, 14, 35));
    assert_eq!((outcome.non_manifold_vertices, outcome.non_manifold_edges), (2, 1));
    let apart = [cube([0.0; 3]), cube([2.0, 0.0, 0.0])].concat();
    let outcome = topology_in_every_way(&apart);
    assert_eq!((outcome.components, outcome.euler_characteristic()), (2, 4));
}

#[test]
fn a_face_turned_over_a_second_time_or_without_area_is_told() {
    let mut turned = cube([0.0; 3]);
    turned[5].swap(0, 1);
    let outcome = topology_in_every_way(&turned);
    assert_eq!((outcome.inconsistent_edges, outcome.non_manifold_vertices), (3, 0));
    let mut twice = cube([0.0; 3]);
    let [a, b, c] = twice[5];
    twice.extend([[b, c, a], [a, c, b]]);
    let outcome = topology_in_every_way(&twice);
    assert_eq!((outcome.duplicate_faces, outcome.non_manifold_edges), (2, 3));
    // A split side has a vertex in its middle, and beside it a triangle that has no area.
    let middle = [0, 1, 2].map(|axis| f32::midpoint(a[axis], b[axis]));
    let mut flat = cube([0.0; 3]);
    flat[5] = [a, middle, c];
    flat.extend([[middle, b, c], [a, b, middle], [a, a, c], [[-0.0; 3], [0.0; 3], [9.0; 3]]]);
    let outcome = topology_in_every_way(&flat);
    assert_eq!((outcome.triangles, outcome.faces, outcome.degenerate), (16, 14, 3));
    assert_eq!((outcome.euler_characteristic(), outcome.boundary_edges), (2, 0));
    let outcome = topology_in_every_way(&[[[0.0; 3], [1.0, 0.01, 0.0], [2.0, 0.0, 0.0]]]);
    assert_eq!((outcome.slivers, outcome.degenerate), (1, 0));
}

#[test]
fn a_vertex_of_very_many_faces_and_nothing_at_all_are_looked_at() {
    let wheel = |i: u32| {
        let rim = |i: u32| {
            let turn = (i % 500) as f32 / 500.0 * std::f32::consts::TAU;
            [turn.cos(), turn.sin(), 0.0]
        };
        [[0.0; 3], rim(i), rim(i + 1)]
    };
    let outcome = topology_in_every_way(&(0..500).map(wheel).collect::<Vec<_>>());
    assert_eq!(
        (outcome.vertices, outcome.boundary_edges, outcome.non_manifold_vertices),
        (501, 500, 0)
    );
    assert_eq!(topology_in_every_way(&[]), Outcome::default());
}

#[test]
fn a_front_that_does_not_fit_is_an_error_and_one_that_just_does_is_not() {
    // A sheet along z, cut along x: all of it is in the front for a sweep along x.
    let corner = |x: u16, z: u16| [f32::from(x), 0.0, f32::from(z)];
    let slice = |z: u16| {
        let [a, b, c, d] = [corner(0, z), corner(1, z), corner(1, z + 1), corner(0, z + 1)];
        [[a, b, c], [a, c, d]]
    };
    let sheet: Vec<Corners> = (0..4000).flat_map(slice).collect();
    let of = |axis, memory_bytes| {
        let config = Config { axis, triangles: None, new_triangles_min: 10, memory_bytes };
        run(&sheet, &config, &Monitor::silent())
    };
    let error = of(SweepAxis::X, 100_000).unwrap_err();
    assert!(matches!(error, Error::Resource { what: FRONT, .. }), "{error}");
    let expected = of(SweepAxis::X, 1 << 30).unwrap();
    let small = of(SweepAxis::Z, 100_000).unwrap();
    assert!(small.front_max < 10 && expected.front_max > 1000);
    assert_eq!(Outcome { front_max: 0, ..small }, Outcome { front_max: 0, ..expected });
    let tight = of(SweepAxis::X, 2_400_000).unwrap();
    assert_eq!(Outcome { front_max: 0, ..tight }, Outcome { front_max: 0, ..expected });
}

#[test]
fn threads_do_not_change_what_is_counted() {
    let torus = torus(120, 70);
    let expected = topology_of(&torus, SweepAxis::X, 1 << 20);
    for threads in [1, 2, 5] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        for new_triangles_min in [20, 300] {
            let outcome = pool.install(|| topology_of(&torus, SweepAxis::Y, new_triangles_min));
            assert_eq!(Outcome { front_max: 0, ..outcome }, expected);
        }
    }
}

#[test]
fn it_can_be_cancelled_and_its_feed_can_fail() {
    let axis = SweepAxis::X;
    let config = Config { axis, triangles: None, new_triangles_min: 4, memory_bytes: 1 << 20 };
    let monitor = Monitor { observer: &|_: &Event| (), cancel: Cancel::default() };
    monitor.cancel.raise();
    let error = run(&torus(20, 9), &config, &monitor).unwrap_err();
    assert!(matches!(error, Error::Cancelled(by) if by.0 == StageId::Topology));
    let fail = |_: &mut dyn FnMut(&[Triangle<Point>]) -> Result<()>| {
        Err(Error::Request("enough".to_owned()))
    };
    let error = topology(&config, &Monitor::silent(), fail).unwrap_err();
    assert_eq!(error.to_string(), "enough");
}

proptest! {
    /// Corners from few places make everything that is not manifold.
    #[test]
    fn small_soups_are_what_brute_force_says(
        triangles in prop::collection::vec(prop::array::uniform3(prop::array::uniform3(-1_i8..=1)), 0..40),
        grid in 1_i8..=3,
    ) {
        let number = |x: i8| if x == 0 { -0.0 } else { f32::from(x) };
        let corner = |[x, y, z]: [i8; 3]| [x, y % grid, z % grid.min(2)].map(number);
        let triangles: Vec<Corners> = triangles.iter().map(|t| t.map(corner)).collect();
        let expected = brute_force(&triangles);
        prop_assert_eq!(topology_in_every_way(&triangles), expected);
    }

    /// A surface with some faces missing, turned over, doubled or moved.
    #[test]
    fn damaged_surfaces_are_what_brute_force_says(
        damage in prop::collection::vec((0_usize..252, 0_u8..4), 0..30),
        order in any::<u64>(),
    ) {
        let mut triangles = torus(14, 9);
        for (index, kind) in damage {
            let index = index % triangles.len();
            match kind {
                0 => drop(triangles.remove(index)),
                1 => triangles[index].swap(0, 1),
                2 => triangles.push(triangles[index]),
                _ => triangles[index][2] = triangles[index * 7 % triangles.len()][0],
            }
        }
        let expected = brute_force(&triangles);
        let count = triangles.len();
        for i in 0..count {
            triangles.swap(i, (order as usize ^ (i * 0x9E37)) % count);
        }
        prop_assert_eq!(topology_in_every_way(&triangles), expected);
    }
}
