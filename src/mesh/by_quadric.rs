//! Half-edge collapses by error quadrics `[GH97]`: each vertex remembers the planes of all that
//! was collapsed into it, stays where it is, and is moved once, at the end `[WK03 §4.4]`.

use glam::Vec3;

use super::{
    Mesh, Patch, Quadric, State,
    classify::is_end,
    metric::{Candidate, Memory, Metric},
    place::place,
    ring::Wing,
    surface::NONE,
    volume::transposed,
};
use crate::soup::VertexQuadric;

/// The metric of error quadrics: costs are areas times squared distances.
#[derive(Clone, Copy, Debug)]
pub struct ByQuadric;

/// Weight of staying near, relative to the area of a face: decides where all is flat, and is lost
/// beside any curvature. Chosen by hand.
const POINT_WEIGHT: f32 = 1e-6;

/// Weight of the plane that stands on a boundary edge, relative to the edge's squared length:
/// the boundary should not move more than the surface. Chosen by hand.
const BOUNDARY_WEIGHT: f32 = 4.0;

/// The quadric of a face at each of its corners; `None` for one without area.
#[inline]
pub(super) fn face_quadric([a, b, c]: [Vec3; 3]) -> Option<Quadric> {
    let n = (b - a).cross(c - a);
    let length = n.length();
    (length > 0.0).then(|| {
        let mut quadric = Quadric::of_plane(n, 2.0 * length);
        quadric.add_point(POINT_WEIGHT * length);
        quadric
    })
}

/// The quadric of the plane that stands on a boundary edge from `p` to `end`, at both of them;
/// `n` is a normal of the face at the edge.
#[inline]
pub(super) fn boundary_quadric(p: Vec3, end: Vec3, n: Vec3) -> Option<Quadric> {
    let edge = end - p;
    let upright = edge.cross(n);
    let length = upright.length();
    // The upright normal has the length |edge| |n|; scaled to |edge|, squared.
    let scale = length * length / (edge.length_squared() * BOUNDARY_WEIGHT);
    (length > 0.0).then(|| Quadric::of_plane(upright, scale))
}

impl Memory for ByQuadric {
    type Carried = Quadric;
    /// Its value at the vertex is kept beside the position.
    type Held = Quadric;

    const MOVES_KEPT: bool = false;

    fn scan(patch: &mut Patch<Self>) {
        patch.carried = vec![Quadric::default(); patch.positions.len()];
        for corners in &patch.faces {
            let face = corners.map(|v| patch.positions[v as usize]);
            if let Some(quadric) = face_quadric(face) {
                for v in corners {
                    patch.carried[*v as usize].add_matrix(&quadric);
                }
            }
        }
    }

    fn hold(carried: &Quadric) -> (Quadric, f32) {
        (*carried, carried.at_vertex())
    }

    fn carry(mesh: &Mesh<Self>, vertex: u32) -> Quadric {
        mesh.quadric(vertex)
    }

    fn join(sum: &mut Quadric, other: &Quadric) {
        sum.add(other);
    }

    /// Adds the planes that stand on the boundary edges at `vertex`.
    fn add_boundary(mesh: &mut Mesh<Self>, vertex: u32) {
        let p = mesh.position(vertex);
        let ring = mesh.rings.of(vertex);
        let mut sum = Quadric::default();
        for wing in ring {
            let (u, w) = (mesh.position(wing.next), mesh.position(wing.prev));
            let n = (u - p).cross(w - p);
            for (other, end) in [(wing.next, u), (wing.prev, w)] {
                if !is_end(ring, other) {
                    continue;
                }
                if let Some(quadric) = boundary_quadric(p, end, n) {
                    sum.add(&quadric);
                }
            }
        }
        mesh.held[vertex as usize].add_matrix(&sum);
    }

    #[inline]
    fn collapsed(mesh: &mut Mesh<Self>, removed: u32, best: &Candidate) {
        let step = best.to - mesh.position(removed);
        let moved = mesh.quadric(removed).moved(step);
        mesh.held[best.kept as usize].add_matrix(&moved);
        mesh.spots[best.kept as usize].0.w += moved.at_vertex();
    }
}

impl Metric for ByQuadric {
    /// On an iso-surface of 1 M triangles, a step of 1.6 is 15 % slower and less than 1 % better,
    /// one of 10 a little faster and 7 % worse.
    const STEP: f32 = 2.5;
    const FIRST_SHARE: usize = 4;

    fn pass_on(passed_on: &VertexQuadric) -> Quadric {
        let mut quadric = Quadric::of_parts(passed_on.a, passed_on.b);
        let [xx, _, _, yy, _, zz] = passed_on.a;
        // The trace is the sum of the areas, of which each face has added twice this weight.
        quadric.add_point(2.0 * POINT_WEIGHT * (xx + yy + zz));
        quadric
    }

    #[inline]
    fn prepare(_: &mut Mesh<Self>, _: u32) {}

    #[inline]
    fn cheapest(
        mesh: &Mesh<Self>,
        vertex: u32,
        ring: &[Wing],
        except: &[u32],
    ) -> Option<Candidate> {
        let is_inner = mesh.states[vertex as usize] == State::INNER;
        let (kept, cost) = if is_inner && except.is_empty() {
            mesh.cheapest_inside(vertex, ring)
        } else {
            mesh.cheapest_of(vertex, ring, except)
        };
        let found = |kept| Candidate { kept, cost: cost.max(0.0), to: mesh.position(kept) };
        (kept != NONE).then(|| found(kept))
    }

    fn place(mesh: &mut Mesh<Self>) {
        place(mesh);
    }
}

impl Mesh<ByQuadric> {
    #[inline]
    pub(super) fn quadric(&self, vertex: u32) -> Quadric {
        self.held[vertex as usize].with_value(self.spots[vertex as usize].error())
    }

    /// The neighbour that costs least to collapse into, except some, and its cost.
    #[inline]
    fn cheapest_of(&self, vertex: u32, ring: &[Wing], except: &[u32]) -> (u32, f32) {
        let quadric = self.quadric(vertex);
        let from = self.position(vertex);
        let mut best = (NONE, f32::INFINITY);
        let mut consider = |other: u32| {
            let target = &self.spots[other as usize];
            let cost = quadric.at(target.position() - from) + target.error();
            if cost < best.1 && !except.contains(&other) {
                best = (other, cost);
            }
        };
        if self.states[vertex as usize] == State::INNER {
            for wing in ring {
                consider(wing.next);
            }
        } else {
            // Along the boundary only.
            for wing in ring {
                for other in [wing.next, wing.prev] {
                    if is_end(ring, other) {
                        consider(other);
                    }
                }
            }
        }
        best
    }

    /// As [`Self::cheapest_of`] a vertex inside the surface, four neighbours at a time.
    #[inline]
    fn cheapest_inside(&self, vertex: u32, ring: &[Wing]) -> (u32, f32) {
        let quadric = self.quadric(vertex);
        let from = self.position(vertex);
        let mut best = (NONE, f32::INFINITY);
        for four in ring.chunks(4) {
            // The last neighbour stands in for those that are missing.
            let others: [u32; 4] = std::array::from_fn(|i| four[i.min(four.len() - 1)].next);
            let spots = others.map(|other| self.spots[other as usize].0);
            let [x, y, z, error] = transposed(spots);
            let (x, y, z) = (x - from.x, y - from.y, z - from.z);
            let costs = (quadric.at_four(x, y, z) + error).to_array();
            for (other, cost) in others.into_iter().zip(costs) {
                if cost < best.1 {
                    best = (other, cost);
                }
            }
        }
        best
    }
}
