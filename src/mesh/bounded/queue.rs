//! The order of collapses: the fairest first, block by block, each vertex with one entry in the
//! queue `[CKS98 §7]`.

use std::{cmp::Reverse, collections::BinaryHeap};

use crate::geometry::Bounds;

use super::super::{
    Mesh,
    metric::Candidate,
    ring::Wing,
    surface::{NONE, UNKNOWN},
};
use super::{
    Fairing, Limits,
    attributes::Attributes,
    fairing::{Ranked, Surroundings},
    fan::Fan,
    hanging::{ByDeviation, Point},
};

/// What collapses must keep to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bound {
    /// No removed vertex is farther than this from the mesh, in model units.
    pub tolerance: f64,
    /// Which of the allowed collapses comes first.
    pub fairing: Fairing,
    /// What becomes of the costs around a collapse.
    pub update: Update,
    /// What is measured.
    pub sides: Sides,
    /// What else is kept to.
    pub limits: Limits,
    /// The mesh is not brought below this number of faces.
    pub faces: usize,
}

/// Of a [`Fairing`] that looks beyond a ring: what becomes of the costs of the vertices there when
/// a neighbour of theirs is collapsed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Update {
    /// All collapses of such a vertex are looked at again.
    All,
    /// The one that was the best is taken to be so still, and looked at again `[CKS98 §7]`.
    Best,
}

/// What is kept within the tolerance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sides {
    /// Removed vertices, of the mesh as it becomes. At each collapse the middles of the edges that go,
    /// too: that holds from one step to the next only, and keeps faces where no vertex is from being
    /// cut off.
    One,
    /// At each collapse the middles of the edges that come, of the mesh as it was, as well: that keeps
    /// faces from spanning what is hollow.
    Both,
}

/// Rounding in the distances is far below this share of the tolerance.
const TOLERANCE_MARGIN: f64 = 1e-6;

/// Vertices of a block. On an iso-surface of 1 M triangles, one block of all is 2.5 times slower than
/// blocks of 8192, and leaves a percent more triangles; blocks of 2048 are as good, and a little
/// faster.
const BLOCK_VERTICES: usize = 1 << 12;

/// Times all blocks are gone through at most.
const PASSES_MAX: usize = 16;

/// Reused from vertex to vertex.
#[derive(Default)]
struct Scratch {
    around: Surroundings,
    ranked: Vec<Ranked>,
    ring: Vec<Wing>,
    /// The faces that a collapse would make.
    fan: Fan,
    /// The faces as they are.
    before: Fan,
    points: Vec<Point>,
    attributes: Attributes,
}

/// The vertices of a block by what the best collapse of each costs.
struct Queue {
    heap: BinaryHeap<Reverse<(u32, u32)>>,
    start: u32,
    end: u32,
}

/// Collapses edges until no allowed collapse is left, or few enough faces are.
pub fn decimate_bounded(mesh: &mut Mesh<ByDeviation>, bound: &Bound) {
    mesh.costs.fill(UNKNOWN);
    mesh.forget_refusals();
    let attributes = Attributes::of(mesh, bound.limits);
    let mut scratch = Scratch { attributes, ..Scratch::default() };
    for _ in 0..PASSES_MAX {
        let before = mesh.faces_left;
        let mut start = 0;
        while start < mesh.states.len() && mesh.faces_left > bound.faces {
            let end = (start + BLOCK_VERTICES).min(mesh.states.len());
            empty_block(mesh, bound, (start as u32, end as u32), &mut scratch);
            start = end;
        }
        if mesh.faces_left == before || mesh.faces_left <= bound.faces {
            break;
        }
    }
}

/// The tolerance is raised from this part of an edge on; doubled while so many times the wanted
/// faces are left, and in small steps then.
const FIRST_TOLERANCE: f64 = 1.0 / 4096.0;
const FAR_FACTOR: usize = 4;
const STEPS: [f64; 2] = [2.0, 1.19];

/// Raises the tolerance until as few faces as wanted are left, or that of `bound` is reached, or
/// nothing depends on it any more `[CKS98 §6]`. Returns the tolerance that holds.
pub fn decimate_to_count(mesh: &mut Mesh<ByDeviation>, bound: &Bound) -> f64 {
    let extent = mesh.extent();
    let mut tolerance = (FIRST_TOLERANCE / f64::from(mesh.unit)).min(bound.tolerance);
    if mesh.faces_left <= bound.faces {
        return 0.0;
    }
    loop {
        decimate_bounded(mesh, &Bound { tolerance, ..*bound });
        if mesh.faces_left <= bound.faces || tolerance >= bound.tolerance || tolerance > extent {
            return tolerance;
        }
        let is_near = mesh.faces_left <= bound.faces.saturating_mul(FAR_FACTOR);
        tolerance = (tolerance * STEPS[usize::from(is_near)]).min(bound.tolerance);
    }
}

/// Collapses the vertices of a block.
fn empty_block(
    mesh: &mut Mesh<ByDeviation>,
    bound: &Bound,
    (start, end): (u32, u32),
    scratch: &mut Scratch,
) {
    let mut queue = Queue { heap: BinaryHeap::new(), start, end };
    for vertex in start..end {
        if mesh.costs[vertex as usize] != f32::INFINITY && mesh.is_removable(vertex) {
            queue.rank(mesh, bound, vertex, scratch);
        }
    }
    while let Some(Reverse((bits, vertex))) = queue.heap.pop() {
        let cost = f32::from_bits(bits);
        if mesh.costs[vertex as usize] != cost || mesh.rings.count(vertex) == 0 {
            continue;
        }
        if let Some(kept) = queue.choose(mesh, bound, vertex, scratch) {
            mesh.collapse_hanging(vertex, kept, scratch);
            if mesh.faces_left <= bound.faces {
                return;
            }
            queue.update(mesh, bound, kept, scratch);
        }
    }
}

impl Queue {
    /// Puts a vertex into the queue by its best collapse, if it is in the block.
    fn rank(
        &mut self,
        mesh: &mut Mesh<ByDeviation>,
        bound: &Bound,
        vertex: u32,
        scratch: &mut Scratch,
    ) {
        if !(self.start..self.end).contains(&vertex) {
            mesh.costs[vertex as usize] = UNKNOWN;
            return;
        }
        scratch.around.fill(mesh, vertex, bound.fairing);
        let refused = mesh.held[vertex as usize].pair[0];
        let best = scratch.around.best(bound.fairing, refused);
        self.push(mesh, vertex, best);
    }

    fn push(&mut self, mesh: &mut Mesh<ByDeviation>, vertex: u32, best: Option<Ranked>) {
        let cost = best.map_or(f32::INFINITY, |best| best.cost);
        mesh.costs[vertex as usize] = cost;
        if let Some(best) = best {
            mesh.held[vertex as usize].pair[1] = best.place;
            self.heap.push(Reverse((cost.to_bits(), vertex)));
        }
    }

    /// Finds the cheapest allowed collapse of a vertex, as long as none of another vertex is cheaper;
    /// else puts the vertex back.
    fn choose(
        &mut self,
        mesh: &mut Mesh<ByDeviation>,
        bound: &Bound,
        vertex: u32,
        scratch: &mut Scratch,
    ) -> Option<u32> {
        scratch.around.fill(mesh, vertex, bound.fairing);
        let refused = mesh.held[vertex as usize].pair[0];
        scratch.around.rank_all(bound.fairing, refused, &mut scratch.ranked);
        scratch.ring.clear();
        scratch.ring.extend_from_slice(mesh.rings.of(vertex));
        let mut is_listed = false;
        for index in 0..scratch.ranked.len() {
            let ranked = scratch.ranked[index];
            let next = self.heap.peek().map_or(u32::MAX, |Reverse((bits, _))| *bits);
            if ranked.cost.to_bits() > next {
                self.push(mesh, vertex, Some(ranked));
                return None;
            }
            if mesh.is_allowed(bound, vertex, ranked.kept, scratch, &mut is_listed) {
                return Some(ranked.kept);
            }
            mesh.held[vertex as usize].pair[0] |= 1 << ranked.place;
        }
        mesh.costs[vertex as usize] = f32::INFINITY;
        None
    }

    /// Ranks the vertices around a collapse anew. `scratch` has the rim of the one that is gone.
    fn update(
        &mut self,
        mesh: &mut Mesh<ByDeviation>,
        bound: &Bound,
        kept: u32,
        scratch: &mut Scratch,
    ) {
        let rim = std::mem::take(&mut scratch.around.rim);
        for &vertex in &rim {
            mesh.held[vertex as usize].pair[0] = 0;
            if mesh.is_removable(vertex) {
                self.rank(mesh, bound, vertex, scratch);
            }
        }
        if matches!(bound.fairing, Fairing::Smooth(_)) {
            let outer = mesh.beyond(kept, &rim);
            for vertex in outer {
                self.rank_again(mesh, bound, vertex, scratch);
            }
        }
        scratch.around.rim = rim;
    }

    /// Ranks a vertex whose faces are as they were, but not those beside them.
    fn rank_again(
        &mut self,
        mesh: &mut Mesh<ByDeviation>,
        bound: &Bound,
        vertex: u32,
        scratch: &mut Scratch,
    ) {
        let cost = mesh.costs[vertex as usize];
        let is_queued = cost != UNKNOWN && cost != f32::INFINITY;
        if !is_queued || !(self.start..self.end).contains(&vertex) || !mesh.is_removable(vertex) {
            return;
        }
        match bound.update {
            Update::All => self.rank(mesh, bound, vertex, scratch),
            Update::Best => {
                scratch.around.fill(mesh, vertex, bound.fairing);
                let place = mesh.held[vertex as usize].pair[1];
                let best = scratch.around.at(bound.fairing, place);
                match best {
                    Some(best) => self.push(mesh, vertex, Some(best)),
                    None => self.rank(mesh, bound, vertex, scratch),
                }
            }
        }
    }
}

impl Mesh<ByDeviation> {
    /// A length that nothing on the mesh is longer than.
    fn extent(&self) -> f64 {
        let mut bounds = Bounds::default();
        self.spots.iter().for_each(|spot| bounds.add(spot.position().to_array()));
        bounds.size().length()
    }

    fn forget_refusals(&mut self) {
        for vertex in 0..self.states.len() {
            if self.rings.count(vertex as u32) > 0 {
                self.held[vertex].pair = [0; 2];
            }
        }
    }

    /// Whether a collapse keeps the surface what it is, and near everything it has to be near.
    fn is_allowed(
        &self,
        bound: &Bound,
        vertex: u32,
        kept: u32,
        scratch: &mut Scratch,
        is_listed: &mut bool,
    ) -> bool {
        let best = Candidate { kept, cost: 0.0, to: self.position(kept) };
        let Scratch { around, ring, fan, before, points, attributes, .. } = scratch;
        if !self.is_legal(vertex, &best, ring) {
            return false;
        }
        let tolerance = bound.tolerance * (1.0 - TOLERANCE_MARGIN);
        let tolerance_sq = tolerance * tolerance;
        fan.fill(self, kept, ring);
        if !around.is_closed {
            fan.extend(self, vertex, kept);
        }
        // The vertex itself is the likeliest to be left behind, and then what lies between it and its
        // neighbours.
        let from = self.position(vertex);
        let own = Point { vertex, position: from };
        if !fan.takes(&own, tolerance_sq, attributes)
            || !fan.are_within(self, from, &around.rim, tolerance_sq)
        {
            return false;
        }
        if !*is_listed {
            self.list_hung(vertex, &around.rim, points);
            before.fill(self, vertex, ring);
            *is_listed = true;
        }
        if bound.sides == Sides::Both
            && !before.are_within(self, best.to, &around.rim, tolerance_sq)
        {
            return false;
        }
        let far = points.iter().position(|point| !fan.takes(point, tolerance_sq, attributes));
        if let Some(far) = far {
            // What has been so once is the first to be asked next time.
            points.swap(0, far);
        }
        far.is_none()
    }

    /// Collapses a vertex and hangs it, and what hung around it, at the nearest of the faces that
    /// come of it. `scratch` is as the last question left it.
    fn collapse_hanging(&mut self, vertex: u32, kept: u32, scratch: &mut Scratch) {
        let Scratch { around, ring, fan, points, attributes, .. } = scratch;
        self.take_down(vertex, &around.rim);
        let best = Candidate { kept, cost: 0.0, to: self.position(kept) };
        self.collapse(vertex, &best, ring);
        points.push(Point { vertex, position: self.position(vertex) });
        for point in points.iter() {
            if let Some(others) = fan.nearest(point, attributes) {
                self.hang_at(point.vertex, kept, others);
            }
        }
    }

    /// The vertices beyond the edges of a rim, all around `kept`.
    fn beyond(&self, kept: u32, rim: &[u32]) -> Vec<u32> {
        let mut found = Vec::new();
        for wing in self.rings.of(kept) {
            if rim.contains(&wing.next) && rim.contains(&wing.prev) {
                let other = self.across(wing.next, wing.prev);
                if other != NONE && !rim.contains(&other) && !found.contains(&other) {
                    found.push(other);
                }
            }
        }
        found
    }

    /// The third corner of the face that runs along the edge from `to` to `from`; [`NONE`] at a
    /// boundary.
    #[inline]
    pub(super) fn across(&self, from: u32, to: u32) -> u32 {
        let beside = self.rings.of(from).iter().find(|wing| wing.prev == to);
        beside.map_or(NONE, |wing| wing.next)
    }
}
