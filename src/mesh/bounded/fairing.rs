//! Fairing oracles: of the collapses that a tolerance allows, which comes first `[CKS98 §7]`.
//!
//! All they look at is the ring of a vertex and, for dihedral angles, the faces around that. Lengths
//! are relative to the vertex and in units of about an edge.

use std::f32::consts::{PI, SQRT_2};

use glam::Vec3;

use super::super::{
    Mesh, Quadric, State,
    by_quadric::{boundary_quadric, face_quadric},
    surface::NONE,
};
use super::hanging::ByDeviation;

/// What makes a collapse come before another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fairing {
    /// Little deviation from the mesh as it is: leaves the fewest triangles.
    Error,
    /// Round triangles, of order 1: for further processing.
    Shape(Shape),
    /// Flat edges, of order 2: to look at.
    Smooth(Smooth),
}

/// Roundness: longest edge over the radius of the inner circle, 3.46 at best.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shape {
    /// Rounder than before is always allowed, less round only up to this.
    pub roundness_max: f32,
}

/// Sums of dihedral angles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Smooth {
    /// No collapse makes a dihedral angle larger than this, in radians, unless the largest becomes
    /// smaller.
    pub angle_max: f32,
}

impl Default for Shape {
    /// Chosen by hand: a triangle five times as long as it is high.
    fn default() -> Self {
        Self { roundness_max: 20.0 }
    }
}

impl Default for Smooth {
    /// The default of the paper.
    fn default() -> Self {
        Self { angle_max: PI / 2.0 }
    }
}

/// A possible collapse of a vertex.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ranked {
    /// Not negative.
    pub(super) cost: f32,
    pub(super) kept: u32,
    /// Of the kept vertex around the one to be removed, below [`PLACES_MAX`].
    pub(super) place: u32,
}

/// Neighbours a vertex may be collapsed into, at most. Chosen by hand, for the bits of a number; the
/// mean is six.
const PLACES_MAX: usize = 32;

/// Weight of the length of the collapsed edge, in radians: decides where all is flat, so that short
/// edges go first there. Chosen by hand.
const LENGTH_WEIGHT: f32 = 1e-3;

/// What is around a vertex, in order.
#[derive(Default)]
pub(super) struct Surroundings {
    /// Its neighbours, counter-clockwise: the first is once more after the last if that is closed.
    pub(super) rim: Vec<u32>,
    pub(super) is_closed: bool,
    /// Places of the neighbours.
    corners: Vec<Vec3>,
    quadric: Quadric,
    /// Largest roundness of the faces.
    roundness: f32,
    /// Normals of the faces beyond the edges from each neighbour to the next; zero where there is
    /// none.
    beyond: Vec<Vec3>,
}

impl Surroundings {
    /// Looks at what is around `vertex`, as far as `fairing` wants to know.
    pub(super) fn fill(&mut self, mesh: &Mesh<ByDeviation>, vertex: u32, fairing: Fairing) {
        self.order(mesh, vertex);
        let center = mesh.position(vertex);
        self.corners.clear();
        self.corners
            .extend(self.rim.iter().map(|other| (mesh.position(*other) - center) * mesh.unit));
        match fairing {
            Fairing::Error => self.sum_quadric(),
            Fairing::Shape(_) => {
                let faces = (0..self.faces()).map(|face| self.face(face));
                self.roundness =
                    faces.map(|[a, b]| roundness(Vec3::ZERO, a, b)).fold(0.0, f32::max);
            }
            Fairing::Smooth(_) => self.look_beyond(mesh, center),
        }
    }

    /// Puts the neighbours in order.
    fn order(&mut self, mesh: &Mesh<ByDeviation>, vertex: u32) {
        let ring = mesh.rings.of(vertex);
        self.rim.clear();
        self.is_closed = mesh.states[vertex as usize] == State::INNER;
        let begins = |next: u32| !ring.iter().any(|other| other.prev == next);
        let open = if self.is_closed { None } else { ring.iter().find(|wing| begins(wing.next)) };
        let Some(mut wing) = open.or(ring.first()) else { return };
        for _ in 0..ring.len() {
            self.rim.push(wing.next);
            let Some(next) = ring.iter().find(|other| other.next == wing.prev) else {
                self.rim.push(wing.prev);
                break;
            };
            wing = next;
        }
    }

    /// Faces around the vertex.
    fn faces(&self) -> usize {
        if self.is_closed { self.rim.len() } else { self.rim.len().saturating_sub(1) }
    }

    /// The two other corners of a face.
    #[inline]
    fn face(&self, face: usize) -> [Vec3; 2] {
        let next = if face + 1 == self.corners.len() { 0 } else { face + 1 };
        [self.corners[face], self.corners[next]]
    }

    fn sum_quadric(&mut self) {
        self.quadric = Quadric::default();
        for face in 0..self.faces() {
            let [a, b] = self.face(face);
            if let Some(quadric) = face_quadric([Vec3::ZERO, a, b]) {
                self.quadric.add(&quadric);
            }
        }
        let faces = self.faces();
        if self.is_closed || faces == 0 {
            return;
        }
        for (face, end) in [(0, self.corners[0]), (faces - 1, self.corners[faces])] {
            let [a, b] = self.face(face);
            if let Some(quadric) = boundary_quadric(Vec3::ZERO, end, a.cross(b)) {
                self.quadric.add(&quadric);
            }
        }
    }

    fn look_beyond(&mut self, mesh: &Mesh<ByDeviation>, center: Vec3) {
        self.beyond.clear();
        for face in 0..self.faces() {
            let [a, b] = self.face(face);
            let next = if face + 1 == self.rim.len() { 0 } else { face + 1 };
            let other = mesh.across(self.rim[face], self.rim[next]);
            let normal = if other == NONE {
                Vec3::ZERO
            } else {
                let c = (mesh.position(other) - center) * mesh.unit;
                (a - b).cross(c - b).normalize_or_zero()
            };
            self.beyond.push(normal);
        }
    }

    /// The places of neighbours the vertex may be collapsed into: along the boundary only.
    fn places(&self, refused: u32) -> impl Iterator<Item = u32> {
        let count = self.rim.len();
        let (is_closed, last) = (self.is_closed, count.saturating_sub(1));
        let is_possible = move |place: &usize| is_closed || *place == 0 || *place == last;
        let places = (0..count.min(PLACES_MAX)).filter(is_possible);
        places.map(|place| place as u32).filter(move |place| refused & 1 << place == 0)
    }

    /// The best collapse except those refused.
    pub(super) fn best(&self, fairing: Fairing, refused: u32) -> Option<Ranked> {
        let ranked = self.places(refused).filter_map(|place| self.at(fairing, place));
        ranked.reduce(|best, next| if next.cost < best.cost { next } else { best })
    }

    /// All collapses except those refused, the best first.
    pub(super) fn rank_all(&self, fairing: Fairing, refused: u32, ranked: &mut Vec<Ranked>) {
        ranked.clear();
        ranked.extend(self.places(refused).filter_map(|place| self.at(fairing, place)));
        ranked.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    }

    /// The collapse into the neighbour at a place, unless the fairing forbids it.
    pub(super) fn at(&self, fairing: Fairing, place: u32) -> Option<Ranked> {
        let kept = *self.rim.get(place as usize)?;
        let cost = match fairing {
            Fairing::Error => Some(self.quadric.at(self.corners[place as usize]).max(0.0)),
            Fairing::Shape(shape) => self.shape_cost(shape, place as usize),
            Fairing::Smooth(smooth) => self.smooth_cost(smooth, place as usize),
        };
        cost.map(|cost| Ranked { cost, kept, place })
    }

    /// What is rounder than before comes first, the more the sooner; the rest by its roundness.
    fn shape_cost(&self, shape: Shape, place: usize) -> Option<f32> {
        let corner = self.corners[place];
        let faces = self.left(place).map(|face| self.face(face));
        let after = faces.map(|[a, b]| roundness(corner, a, b)).fold(0.0, f32::max);
        if after < self.roundness {
            return Some(1.0 / (1.0 + self.roundness - after));
        }
        (after <= shape.roundness_max).then_some(1.0 + after)
    }

    /// The faces that are left when the vertex is collapsed into a neighbour, from one beside that on.
    #[inline]
    fn left(&self, place: usize) -> impl Iterator<Item = usize> {
        let (faces, is_closed) = (self.faces(), self.is_closed);
        let left = if is_closed { faces.saturating_sub(2) } else { faces - 1 };
        (1..=left).map(move |step| match (is_closed, place) {
            (true, _) if place + step < faces => place + step,
            (true, _) => place + step - faces,
            (false, 0) => step,
            (false, _) => faces - 1 - step,
        })
    }

    fn smooth_cost(&self, smooth: Smooth, place: usize) -> Option<f32> {
        let (corner, faces) = (self.corners[place], self.faces());
        let (mut sum, mut largest) = (0.0_f32, 0.0_f32);
        let mut add = |one: Vec3, two: Vec3| {
            let angle = angle(one, two);
            sum += angle;
            largest = largest.max(angle);
        };
        // Beside the kept neighbour a face meets the one beyond the face that goes.
        let mut last = self.beyond[place.min(faces - 1)];
        for face in self.left(place) {
            let [a, b] = self.face(face);
            let normal = (a - corner).cross(b - corner).normalize_or_zero();
            add(last, normal);
            add(normal, self.beyond[face]);
            last = normal;
        }
        if self.is_closed {
            add(last, self.beyond[if place == 0 { faces - 1 } else { place - 1 }]);
        }
        if largest > smooth.angle_max && largest >= self.largest_angle() {
            return None;
        }
        Some(sum + LENGTH_WEIGHT * corner.length())
    }

    /// Of the dihedral angles at and around the faces as they are.
    fn largest_angle(&self) -> f32 {
        let normal = |face: usize| {
            let [a, b] = self.face(face);
            a.cross(b).normalize_or_zero()
        };
        let faces = self.faces();
        let mut largest = 0.0_f32;
        let mut last = if self.is_closed { normal(faces - 1) } else { Vec3::ZERO };
        for face in 0..faces {
            let normal = normal(face);
            largest = largest.max(angle(last, normal)).max(angle(normal, self.beyond[face]));
            last = normal;
        }
        largest
    }
}

/// Longest edge over the radius of the inner circle.
#[inline]
fn roundness(a: Vec3, b: Vec3, c: Vec3) -> f32 {
    let (ab, bc, ca) = (b - a, c - b, a - c);
    let [x, y, z] = [ab.length(), bc.length(), ca.length()];
    // The radius is twice the area over the length around.
    let area = ab.cross(bc).length();
    if area > 0.0 { x.max(y).max(z) * (x + y + z) / area } else { f32::INFINITY }
}

/// The angle between two directions of length one, to 10⁻⁴; none if one of them is zero.
#[inline]
fn angle(one: Vec3, two: Vec3) -> f32 {
    if one == Vec3::ZERO || two == Vec3::ZERO {
        return 0.0;
    }
    let is_sharp = one.dot(two) >= 0.0;
    let chord = if is_sharp { one - two } else { one + two };
    let chord_sq = chord.length_squared();
    // Abramowitz and Stegun, 4.4.45: arccos x = √(1 − x) (a₀ + a₁x + a₂x² + a₃x³), and 1 − x is half
    // the square of the chord, which is precise where the angle is small.
    let x = 1.0 - 0.5 * chord_sq;
    let series = 1.570_728_8 + x * (-0.212_114_4 + x * (0.074_261 - 0.018_729_3 * x));
    let angle = chord_sq.sqrt() / SQRT_2 * series;
    if is_sharp { angle } else { PI - angle }
}
