//! The vertices that have been removed, each hung at a face near it: a list at one corner of the
//! face, that runs through the vertices themselves, so that it takes no memory of its own.

use glam::Vec3;

use super::super::{
    Color, Mesh, Patch, State,
    metric::{Candidate, Memory},
    ring::Wing,
    surface::NONE,
};
use crate::geometry::distance_sq_to_triangle;

/// A mesh whose removed vertices hang at its faces.
#[derive(Clone, Copy, Debug)]
pub struct ByDeviation;

/// What a vertex holds.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Held {
    /// While it is there: the first vertex of its list. Later: the next one of the list it is in.
    pub(super) link: u32,
    /// While it is there: which collapses of it have been refused, by their places around it, and
    /// the place of the best. Later: the two other corners of the face it hangs at.
    pub(super) pair: [u32; 2],
}

impl Default for Held {
    fn default() -> Self {
        Self { link: NONE, pair: [0; 2] }
    }
}

/// Loose points that a face is looked for among all; they are rare. Chosen by hand.
const LOOSE_MAX: usize = 64;

/// A removed vertex that looks for a face.
#[derive(Clone, Copy, Debug)]
pub(super) struct Point {
    pub(super) vertex: u32,
    pub(super) position: Vec3,
}

impl Memory for ByDeviation {
    type Carried = ();
    type Held = Held;

    const MOVES_KEPT: bool = false;
    /// A bound on colours could not hold where they change later.
    const AVERAGES_COLORS: bool = false;

    fn scan(patch: &mut Patch<Self>) {
        patch.carried = vec![(); patch.positions.len()];
    }

    fn hold((): &()) -> (Held, f32) {
        (Held::default(), 0.0)
    }

    fn hang(mesh: &mut Mesh<Self>, hung: &[[u32; 3]]) {
        let first = mesh.states.len() as u32;
        for ([at, next, prev], vertex) in hung.iter().zip(first..) {
            mesh.hang_at(vertex, *at, [*next, *prev]);
        }
    }

    fn carry(_: &Mesh<Self>, _: u32) {}

    fn join((): &mut (), (): &()) {}

    fn add_boundary(_: &mut Mesh<Self>, _: u32) {}

    fn collapsed(_: &mut Mesh<Self>, _: u32, _: &Candidate) {}
}

impl Mesh<ByDeviation> {
    /// Hangs a removed vertex at the face over `at` and `others`.
    #[inline]
    pub(super) fn hang_at(&mut self, vertex: u32, at: u32, others: [u32; 2]) {
        let link = std::mem::replace(&mut self.held[at as usize].link, vertex);
        self.held[vertex as usize] = Held { link, pair: others };
    }

    /// Lists the vertices that hang at the faces around `vertex`, whose ring and rim are given.
    pub(super) fn list_hung(&self, vertex: u32, rim: &[u32], points: &mut Vec<Point>) {
        points.clear();
        let mut at = self.held[vertex as usize].link;
        while at != NONE {
            points.push(Point { vertex: at, position: self.position(at) });
            at = self.held[at as usize].link;
        }
        for other in rim {
            let mut at = self.held[*other as usize].link;
            while at != NONE {
                let held = self.held[at as usize];
                if held.pair.contains(&vertex) {
                    points.push(Point { vertex: at, position: self.position(at) });
                }
                at = held.link;
            }
        }
    }

    /// Takes the vertices that hang at the faces around `vertex` out of their lists.
    pub(super) fn take_down(&mut self, vertex: u32, rim: &[u32]) {
        self.held[vertex as usize].link = NONE;
        for other in rim {
            // The list without them, in its order.
            let mut last = *other;
            let mut at = self.held[last as usize].link;
            while at != NONE {
                let held = self.held[at as usize];
                if !held.pair.contains(&vertex) {
                    self.held[last as usize].link = at;
                    last = at;
                }
                at = held.link;
            }
            self.held[last as usize].link = NONE;
        }
    }

    /// Whether a face of the ring of `at` has these other corners.
    pub(super) fn has_face(&self, at: u32, others: [u32; 2]) -> bool {
        self.rings.of(at).contains(&Wing { next: others[0], prev: others[1] })
    }

    /// Adds points that no face has for a corner, each hung at the nearest face; returns those that
    /// none is near enough to. For a handful of them.
    #[must_use]
    pub fn hang_loose(&mut self, points: &[Vec3], tolerance: f64) -> Vec<Vec3> {
        let mut far = Vec::new();
        for (number, &point) in points.iter().enumerate() {
            let near = if number < LOOSE_MAX { self.nearest_face(point, tolerance) } else { None };
            let Some([at, next, prev]) = near else {
                far.push(point);
                continue;
            };
            let vertex = self.spots.len() as u32;
            self.add_vertex(point, State::default());
            if !self.colors.is_empty() {
                self.colors.push(Color::default());
            }
            if !self.normals.is_empty() {
                self.normals.push(Vec3::ZERO);
            }
            self.hang_at(vertex, at, [next, prev]);
        }
        far
    }

    /// The face nearest to a point, within a tolerance.
    fn nearest_face(&self, point: Vec3, tolerance: f64) -> Option<[u32; 3]> {
        let (mut best, mut least) = (None, tolerance * tolerance);
        for at in 0..self.states.len() as u32 {
            for wing in self.rings.of(at).iter().filter(|wing| at < wing.next && at < wing.prev) {
                let face = [at, wing.next, wing.prev];
                let corners = face.map(|v| self.position(v).as_dvec3() - point.as_dvec3());
                let distance_sq = distance_sq_to_triangle(corners);
                if distance_sq <= least {
                    (best, least) = (Some(face), distance_sq);
                }
            }
        }
        best
    }

    /// All removed vertices with the faces they hang at.
    pub(super) fn hung(&self) -> Vec<(u32, [u32; 3])> {
        let mut all = Vec::new();
        for at in 0..self.states.len() as u32 {
            if self.rings.count(at) == 0 {
                continue;
            }
            let mut vertex = self.held[at as usize].link;
            while vertex != NONE {
                let held = self.held[vertex as usize];
                debug_assert!(self.has_face(at, held.pair), "it hangs at a face that is there");
                all.push((vertex, [at, held.pair[0], held.pair[1]]));
                vertex = held.link;
            }
        }
        all
    }
}
