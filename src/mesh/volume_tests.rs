//! The metric of volumes beside a slow one that follows the definition, face by face in double
//! precision.

use glam::{DMat3, DVec3, Vec3};

use super::{
    ByVolume, Mesh, Patch, State,
    metric::{Candidate, Metric},
    surface::NONE,
    unit_of,
};
use crate::soup::{Point, Triangle};

/// A sheet of `side`² squares over the plane, with hills and unevenly spaced.
fn sheet(side: u32, offset: Vec3, scale: f32) -> Patch<ByVolume> {
    let height = |x: f32, y: f32| 0.7 * (0.5 * x).sin() + 0.4 * (0.4 * y + 0.1 * x).cos();
    let unit = unit_of(&[Triangle([[0.0; 3], [scale, 0.0, 0.0], [0.0; 3]].map(Point))]);
    let mut patch = Patch { unit, ..Patch::default() };
    for (i, j) in (0..=side).flat_map(|i| (0..=side).map(move |j| (i, j))) {
        let uneven = |k: u32, l: u32| k as f32 + 0.3 * ((k * 7 + l * 3) % 5) as f32 / 5.0;
        let (x, y) = (uneven(i, j), uneven(j, i));
        patch.positions.push(Vec3::new(x, y, height(x, y)) * scale + offset);
    }
    for (i, j) in (0..side).flat_map(|i| (0..side).map(move |j| (i, j))) {
        let at = |i: u32, j: u32| i * (side + 1) + j;
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        patch.faces.extend([[a, b, c], [a, c, d]]);
    }
    patch
}

/// What the definition says of one edge, with the origin at the end that is removed.
struct Oracle {
    /// Normals and distances of the faces around either end.
    planes: Vec<(DVec3, f64)>,
    /// Boundary edges at either end, in the sense of their faces.
    edges: Vec<(DVec3, DVec3)>,
    /// The other end.
    e: DVec3,
}

impl Oracle {
    fn new(mesh: &Mesh<ByVolume>, faces: &[[u32; 3]], removed: u32, kept: u32) -> Self {
        let at = |v: u32| mesh.position(v).as_dvec3() - mesh.position(removed).as_dvec3();
        let touches = |corners: &[u32]| corners.contains(&removed) || corners.contains(&kept);
        let around = faces.iter().filter(|face| touches(*face));
        let plane = |face: &[u32; 3]| {
            let [a, b, c] = face.map(at);
            let n = (b - a).cross(c - a);
            (n, n.dot(a))
        };
        let planes = around.clone().map(plane).collect();
        let sides = |face: &[u32; 3]| {
            let [a, b, c] = *face;
            [[a, b], [b, c], [c, a]]
        };
        let all: Vec<[u32; 2]> = faces.iter().flat_map(sides).collect();
        let is_open = |[a, b]: &[u32; 2]| !all.contains(&[*b, *a]);
        let open = around.flat_map(sides).filter(|side| touches(side) && is_open(side));
        let edges = open.map(|[a, b]| (at(a), at(b))).collect();
        Self { planes, edges, e: at(kept) }
    }

    /// The cost of a place.
    fn cost(&self, x: DVec3) -> f64 {
        let volumes: f64 = self.planes.iter().map(|(n, d)| (n.dot(x) - d).powi(2)).sum();
        let areas: f64 =
            self.edges.iter().map(|(s, t)| (*s - x).cross(*t - x).length_squared()).sum();
        volumes + 9.0 * self.e.length_squared() * areas
    }

    /// What is least at the best place.
    fn wish(&self, x: DVec3) -> f64 {
        let trace: f64 = self.planes.iter().map(|(n, _)| n.length_squared()).sum();
        let length_sq = self.e.length_squared();
        let lengths: f64 = self.edges.iter().map(|(s, t)| s.distance_squared(*t)).sum();
        let all: DVec3 = self.edges.iter().map(|(s, t)| (*s - x).cross(*t - x)).sum();
        let trace = trace + 9.0 * length_sq * 2.0 * lengths;
        let stay = 1e-3 * trace * (x - self.e * 0.5).length_squared();
        self.cost(x) + 900.0 * length_sq * all.length_squared() + stay
    }

    /// The best place that keeps the volume: the wish is quadratic, so that its second differences
    /// are exact.
    fn best(&self) -> DVec3 {
        let axes = [DVec3::X, DVec3::Y, DVec3::Z];
        let (zero, w) = (self.wish(DVec3::ZERO), |x: DVec3| self.wish(x));
        let second = |a: DVec3, b: DVec3| w(a + b) - w(a) - w(b) + zero;
        let column = |a: DVec3| DVec3::from_array(axes.map(|b| second(a, b)));
        let h = DMat3::from_cols(column(DVec3::X), column(DVec3::Y), column(DVec3::Z));
        let slope = DVec3::from_array(axes.map(|a| (w(a) - w(-a)) / 2.0));
        let (g, d) = self.planes.iter().fold((DVec3::ZERO, 0.0), |s, p| (s.0 + p.0, s.1 + p.1));
        let inverse = h.inverse();
        let free = inverse * -slope;
        free + inverse * g * ((d - g.dot(free)) / g.dot(inverse * g))
    }
}

/// The cheapest collapse by the oracle, of those that the metric looks at.
fn expected(mesh: &Mesh<ByVolume>, faces: &[[u32; 3]], vertex: u32) -> Candidate {
    let (state, own) = (|v: u32| mesh.states[v as usize], mesh.states[vertex as usize]);
    let mut best = Candidate { kept: NONE, cost: f32::INFINITY, to: Vec3::ZERO };
    let mut others: Vec<u32> =
        mesh.rings.of(vertex).iter().flat_map(|wing| [wing.next, wing.prev]).collect();
    others.sort_unstable();
    others.dedup();
    for other in others {
        let oracle = Oracle::new(mesh, faces, vertex, other);
        let is_along = oracle.edges.iter().any(|(s, t)| {
            (*s == DVec3::ZERO && *t == oracle.e) || (*t == DVec3::ZERO && *s == oracle.e)
        });
        let is_looked_at = match (own, state(other)) {
            (State::INNER, State::INNER) => other > vertex,
            (State::INNER, _) => true,
            _ => is_along,
        };
        if !is_looked_at {
            continue;
        }
        let stays = state(other) != State::BOUNDARY && state(other) != State::INNER;
        let half = stays || (own == State::INNER && state(other) == State::BOUNDARY);
        let x = if half { oracle.e } else { oracle.best() };
        // The boundary of the other end does not move then.
        let cost = if half && own == State::INNER {
            Oracle { edges: Vec::new(), ..oracle }.cost(x)
        } else {
            oracle.cost(x)
        };
        if (cost as f32) < best.cost {
            let to = (mesh.position(vertex).as_dvec3() + x).as_vec3();
            best = Candidate { kept: other, cost: cost as f32, to };
        }
    }
    best
}

fn assert_follows_the_definition(patch: Patch<ByVolume>, shared: &[u32]) {
    let patch = Patch { shared: shared.to_vec(), ..patch };
    let faces = patch.faces.clone();
    let mut mesh = Mesh::of_original(patch);
    let unit = mesh.unit;
    let (mut same, mut looked) = (0, 0);
    for vertex in 0..mesh.spots.len() as u32 {
        if !mesh.is_removable(vertex) {
            continue;
        }
        ByVolume::prepare(&mut mesh, vertex);
        let found = ByVolume::cheapest(&mesh, vertex, mesh.rings.of(vertex), &[]);
        let best = expected(&mesh, &faces, vertex);
        assert_eq!(found.is_some(), best.kept != NONE, "{vertex}");
        let Some(found) = found else { continue };
        looked += 1;
        let cost = f64::from(best.cost) * f64::from(unit).powi(6);
        let close = (f64::from(found.cost) - cost).abs() <= 1e-3 * cost + 1e-6;
        assert!(close, "{vertex}: {found:?} {best:?} {cost}");
        if found.kept == best.kept {
            same += 1;
            let away = found.to.distance(best.to) * unit;
            assert!(away < 1e-2, "{vertex}: {found:?} {best:?}");
        }
    }
    assert!(looked > 20 && same * 20 >= looked * 19, "{same} of {looked}");
}

#[test]
fn costs_and_places_follow_the_definition() {
    assert_follows_the_definition(sheet(12, Vec3::ZERO, 1.0), &[]);
}

#[test]
fn neither_size_nor_place_nor_frozen_neighbours_matter() {
    assert_follows_the_definition(sheet(12, Vec3::ZERO, 1e-5), &[]);
    assert_follows_the_definition(sheet(12, Vec3::ZERO, 1e5), &[]);
    assert_follows_the_definition(sheet(12, Vec3::new(-16.0, 8.0, 4.0), 1.0), &[]);
    assert_follows_the_definition(sheet(12, Vec3::ZERO, 1.0), &[0, 1, 2, 30, 44, 45, 100]);
}

#[test]
fn a_frozen_neighbour_is_collapsed_into_where_it_is() {
    let mut patch = sheet(6, Vec3::ZERO, 1.0);
    patch.shared = (0..49).filter(|vertex| *vertex != 24).collect();
    let mut mesh = Mesh::of_original(patch);
    ByVolume::prepare(&mut mesh, 24);
    let found = ByVolume::cheapest(&mesh, 24, mesh.rings.of(24), &[]).unwrap();
    assert_eq!(found.to, mesh.position(found.kept));
}

#[test]
fn a_straight_boundary_stays_straight_and_a_corner_stays() {
    // A flat square: collapses along its sides cost nothing.
    let mut patch = sheet(6, Vec3::ZERO, 1.0);
    for (index, position) in patch.positions.iter_mut().enumerate() {
        *position = Vec3::new((index / 7) as f32, (index % 7) as f32, 0.0);
    }
    let mut mesh = Mesh::of_original(patch);
    let mut costs = |vertex| {
        ByVolume::prepare(&mut mesh, vertex);
        let found = ByVolume::cheapest(&mesh, vertex, mesh.rings.of(vertex), &[]).unwrap();
        (found, mesh.position(vertex))
    };
    let (side, p) = costs(3);
    assert!(side.cost < 1e-6 && side.to.x == p.x && side.to.z == p.z, "{side:?}");
    // At a corner the new vertex takes the corner's place.
    let (corner, p) = costs(0);
    assert!(corner.cost < 1e-3 && corner.to.distance(p) < 1e-2, "{corner:?}");
}
