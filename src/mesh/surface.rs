//! The mesh: vertices, faces, and for each vertex the list of its corners.

use glam::{Vec3, Vec4};
use rayon::prelude::*;
use zerocopy::{FromBytes, Immutable, IntoBytes};

use super::{
    Patch,
    classify::{classify, is_end},
    collapse::apexes,
    metric::{Candidate, Memory},
    ring::{Rings, Wing},
};
use crate::soup::Vertex;

/// No corner, no vertex.
pub(super) const NONE: u32 = u32::MAX;

/// What a vertex is to the decimation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct State(u8);

impl State {
    /// Inside the surface: its faces are one closed fan.
    pub const INNER: Self = Self(0);
    /// On a true boundary: its faces are one open fan, and none is missing.
    pub const BOUNDARY: Self = Self(1);
    /// Its faces are no fan: never removed.
    pub const COMPLEX: Self = Self(2);
    /// Other faces of it are not here, as at an interface: neither removed nor moved. Combines
    /// with any of the others.
    pub const FROZEN: Self = Self(4);
    /// Not final: faces of it may still be read. Neither removed nor the target of a collapse.
    pub(super) const OPEN: Self = Self(8);
    /// Of a frozen vertex: it is listed among those that may have a face to write.
    pub(super) const LISTED: Self = Self(16);
    /// Of a frozen vertex: its faces that are not here are finished.
    pub const SETTLED: Self = Self(32);

    /// Whether all of `other` holds.
    #[inline]
    #[must_use]
    pub fn has(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// The same, with faces elsewhere.
    pub(super) fn frozen(self) -> Self {
        self.with(Self::FROZEN)
    }

    pub(super) fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    pub(super) fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// Whether a collapse may remove the vertex.
    #[inline]
    pub(super) fn is_removable(self) -> bool {
        self.0 & (Self::COMPLEX.0 | Self::FROZEN.0 | Self::OPEN.0) == 0
    }
}

/// What of a vertex its neighbours look at: position, and what the metric shows them.
///
/// By quadrics that is the value of the vertex's own at its place.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spot(pub(super) Vec4);

impl Spot {
    #[inline]
    pub(super) fn position(self) -> Vec3 {
        self.0.truncate()
    }

    #[inline]
    pub(super) fn error(self) -> f32 {
        self.0.w
    }
}

/// Marks a cost that must be computed.
pub(super) const UNKNOWN: f32 = -1.0;

/// Mean colour of what a vertex stands for, weighted by area.
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct Color {
    /// Sum of the colours, times their weights.
    pub rgba: [f32; 4],
    /// Sum of the weights.
    pub weight: f32,
}

impl Color {
    /// The mean, RGBA.
    #[must_use]
    pub fn mean(&self) -> [u8; 4] {
        let weight = if self.weight > 0.0 { self.weight } else { 1.0 };
        self.rgba.map(|sum| (sum / weight).round().clamp(0.0, 255.0) as u8)
    }

    pub(super) fn add(&mut self, other: &Self) {
        for (sum, term) in self.rgba.iter_mut().zip(other.rgba) {
            *sum += term;
        }
        self.weight += other.weight;
    }
}

/// Bytes of memory a face takes, about, while a mesh is made of a patch: with half a vertex, since
/// a surface has twice as many faces as vertices.
#[must_use]
pub fn face_bytes<V: Vertex, M: Memory>() -> u64 {
    let color = if V::COLORED { size_of::<Color>() } else { 0 };
    let patch = size_of::<Vec3>() + size_of::<M::Carried>() + 2 * size_of::<[u32; 3]>();
    let mesh = size_of::<Spot>() + size_of::<M::Held>() + size_of::<State>() + size_of::<f32>();
    ((patch + color + mesh + Rings::VERTEX_BYTES) / 2) as u64
}

/// Which threads make a mesh. The result is the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Threads {
    /// The one that asks: the others have meshes of their own to work on.
    This,
    /// All of the pool.
    All,
}

impl Threads {
    /// Makes two values of each number below `count`.
    fn map<A: Send, B: Send>(
        self,
        count: usize,
        make: impl Fn(usize) -> (A, B) + Sync + Send,
    ) -> (Vec<A>, Vec<B>) {
        if self == Self::This {
            return (0..count).map(make).unzip();
        }
        let (mut first, mut second) = (Vec::new(), Vec::new());
        (0..count).into_par_iter().map(make).unzip_into_vecs(&mut first, &mut second);
        (first, second)
    }
}

/// A triangle mesh that edges can be collapsed in. All arrays are by vertex; of vertices that had been
/// removed before the mesh was made, which are the last ones, there is no ring, state or cost.
pub struct Mesh<M: Memory> {
    pub(super) spots: Vec<Spot>,
    pub(super) rings: Rings,
    pub(super) held: Vec<M::Held>,
    pub(super) states: Vec<State>,
    /// Cost of the best collapse that removes the vertex, as far as it is known: never too large
    /// while its ring is as it was. [`UNKNOWN`] when it must be looked for, infinite when there is
    /// none.
    pub(super) costs: Vec<f32>,
    /// Empty without colours.
    pub(super) colors: Vec<Color>,
    /// As [`Patch::normals`].
    pub(super) normals: Vec<Vec3>,
    /// Faces that are left.
    pub(super) faces_left: usize,
    /// As [`Patch::unit`].
    pub(super) unit: f32,
    /// Vertices that were added where sheets touch.
    pub(super) split: usize,
}

impl<M: Memory> Mesh<M> {
    /// A mesh of nothing, to be added to.
    pub(super) fn empty() -> Self {
        Self {
            spots: Vec::new(),
            rings: Rings::default(),
            held: Vec::new(),
            states: Vec::new(),
            costs: Vec::new(),
            colors: Vec::new(),
            normals: Vec::new(),
            faces_left: 0,
            unit: 1.0,
            split: 0,
        }
    }

    /// Adds a vertex without faces.
    #[inline]
    pub(super) fn add_vertex(&mut self, position: Vec3, state: State) {
        self.spots.push(Spot(position.extend(0.0)));
        self.rings.add_vertex();
        self.held.push(M::Held::default());
        self.states.push(state);
        self.costs.push(UNKNOWN);
    }

    /// Makes a mesh of a surface as it was scanned. Vertices at which several sheets touch become
    /// one for each.
    #[must_use]
    pub fn of_original(patch: Patch<M>) -> Self {
        let make = |mut patch: Patch<M>| {
            M::scan(&mut patch);
            Self::of_decimated(patch, Threads::This)
        };
        let mut mesh = make(patch);
        if mesh.has_complex() {
            let mut patch = mesh.into_patch();
            let split = patch.split();
            mesh = Self { split, ..make(patch) };
        }
        mesh.add_boundaries(0..mesh.states.len() as u32);
        mesh
    }

    /// Makes a mesh of patches that were joined, as [`Self::of_original`] does of one.
    #[must_use]
    pub fn of_joined(patch: Patch<M>, threads: Threads) -> Self {
        let mesh = Self::of_decimated(patch, threads);
        if !mesh.has_complex() {
            return mesh;
        }
        let mut patch = mesh.into_patch();
        let split = patch.split();
        Self { split, ..Self::of_decimated(patch, threads) }
    }

    /// Whether a vertex whose faces are all here is no fan.
    fn has_complex(&self) -> bool {
        self.states.contains(&State::COMPLEX)
    }

    /// Vertices that were added when the mesh was made, where sheets touch.
    #[must_use]
    pub fn split_vertices(&self) -> usize {
        self.split
    }

    /// Tells the metric which of these vertices are on a boundary.
    fn add_boundaries(&mut self, vertices: impl Iterator<Item = u32>) {
        for vertex in vertices {
            if self.states[vertex as usize] == State::BOUNDARY {
                M::add_boundary(self, vertex);
            }
        }
    }

    /// Makes a mesh of patches that have been decimated: they say what is remembered.
    #[must_use]
    pub fn of_decimated(patch: Patch<M>, threads: Threads) -> Self {
        let Patch {
            positions,
            carried,
            colors,
            normals,
            shared,
            joined,
            settled,
            faces,
            hung,
            unit,
        } = patch;
        let vertices = positions.len() - hung.len();
        let (rings, refused) = Rings::of_faces(vertices, &faces, threads);
        let faces_left = faces.len() - refused;
        drop(faces);
        let (spots, held) = threads.map(positions.len(), |index| {
            let (held, shown) = M::hold(&carried[index]);
            (Spot(positions[index].extend(shown)), held)
        });
        drop(carried);
        let (mut states, costs) = threads.map(vertices, |index| {
            let state = match rings.of(index as u32) {
                [] => State::default(),
                ring => classify(ring),
            };
            (state, UNKNOWN)
        });
        for vertex in shared {
            states[vertex as usize] = states[vertex as usize].frozen();
        }
        for vertex in settled {
            states[vertex as usize] = states[vertex as usize].frozen().with(State::SETTLED);
        }
        let mut mesh =
            Self { spots, rings, held, states, costs, colors, normals, faces_left, unit, split: 0 };
        mesh.add_boundaries(joined.into_iter());
        M::hang(&mut mesh, &hung);
        mesh
    }

    #[inline]
    pub(super) fn position(&self, vertex: u32) -> Vec3 {
        self.spots[vertex as usize].position()
    }

    /// Moves a vertex, and nothing else.
    pub(super) fn move_to(&mut self, vertex: u32, position: Vec3) {
        let spot = &mut self.spots[vertex as usize];
        *spot = Spot(position.extend(spot.error()));
    }

    /// Whether the vertex is there and may be removed.
    #[inline]
    pub(super) fn is_removable(&self, vertex: u32) -> bool {
        self.states[vertex as usize].is_removable() && self.rings.count(vertex) > 0
    }

    /// Faces that are left.
    #[must_use]
    pub fn faces_left(&self) -> usize {
        self.faces_left
    }

    /// Vertices that cannot be removed because their faces are no fan.
    #[must_use]
    pub fn complex_vertices(&self) -> usize {
        let complex = |vertex: &u32| self.states[*vertex as usize].has(State::COMPLEX);
        let left = (0..self.states.len() as u32).filter(|vertex| self.rings.count(*vertex) > 0);
        left.filter(complex).count()
    }

    /// Vertices that are more than so many edges away from what looks like a boundary.
    #[must_use]
    pub fn far_from_boundary(&self, edges: usize) -> Vec<u32> {
        let mut is_near: Vec<bool> = self.states.iter().map(|s| *s != State::INNER).collect();
        let near = is_near.iter().zip(0..).filter(|(is_near, _)| **is_near);
        let mut border: Vec<u32> = near.map(|(_, vertex)| vertex).collect();
        for _ in 0..edges {
            let mut next = Vec::new();
            for wing in border.iter().flat_map(|vertex| self.rings.of(*vertex)) {
                for vertex in [wing.next, wing.prev] {
                    if !std::mem::replace(&mut is_near[vertex as usize], true) {
                        next.push(vertex);
                    }
                }
            }
            border = next;
        }
        (0..self.states.len() as u32).filter(|vertex| !is_near[*vertex as usize]).collect()
    }

    /// Whether a vertex has been collapsed into another one.
    #[must_use]
    pub fn is_gone(&self, vertex: u32) -> bool {
        self.rings.count(vertex) == 0
    }

    /// Leaves alone what looks like a boundary: there the mesh was cut out of a larger one.
    pub fn freeze_boundary(&mut self) {
        for state in self.states.iter_mut().filter(|state| **state != State::INNER) {
            *state = state.frozen();
        }
    }

    /// Collapses `removed`, whose ring is given, into a neighbour, and returns the faces that are
    /// gone.
    #[inline]
    pub(super) fn collapse(&mut self, removed: u32, best: &Candidate, ring: &[Wing]) -> usize {
        let kept = best.kept;
        let is_open = self.states[removed as usize] == State::BOUNDARY;
        // Each neighbour is the next of one face; only the end of an open fan is not.
        let end = ring.iter().map(|wing| wing.prev).filter(|prev| is_open && is_end(ring, *prev));
        for other in ring.iter().map(|wing| wing.next).chain(end) {
            self.costs[other as usize] = UNKNOWN;
            if other != kept {
                self.rings.rename(other, removed, kept);
            }
        }
        for apex in apexes(ring, kept) {
            if apex != NONE {
                self.rings.drop_folded(apex);
            }
        }
        let gone = self.rings.unite(removed, kept, ring);
        M::collapsed(self, removed, best);
        if M::AVERAGES_COLORS && !self.colors.is_empty() {
            let color = self.colors[removed as usize];
            self.colors[kept as usize].add(&color);
        }
        self.faces_left -= gone;
        gone
    }

    /// Takes what is left out of the mesh: vertices in their order, faces in that of their first
    /// vertices.
    #[must_use]
    pub fn into_patch(self) -> Patch<M> {
        let vertices = 0..self.spots.len() as u32;
        let left = vertices.filter(|vertex| self.rings.count(*vertex) > 0).count();
        // Patches of many slabs wait at a time: no room to spare.
        let mut patch = Patch {
            positions: Vec::with_capacity(left),
            carried: Vec::with_capacity(left),
            colors: Vec::with_capacity(if self.colors.is_empty() { 0 } else { left }),
            faces: Vec::with_capacity(self.faces_left),
            unit: self.unit,
            ..Patch::default()
        };
        let mut old_to_new = vec![NONE; self.spots.len()];
        for vertex in 0..self.spots.len() as u32 {
            if self.rings.count(vertex) == 0 {
                continue;
            }
            let new = patch.positions.len() as u32;
            old_to_new[vertex as usize] = new;
            patch.positions.push(self.position(vertex));
            patch.carried.push(M::carry(&self, vertex));
            patch.colors.extend(self.colors.get(vertex as usize));
            patch.normals.extend(self.normals.get(vertex as usize));
            if self.states[vertex as usize].has(State::FROZEN) {
                patch.shared.push(new);
            }
        }
        for vertex in 0..self.spots.len() as u32 {
            let first = |wing: &&Wing| vertex < wing.next && vertex < wing.prev;
            for wing in self.rings.of(vertex).iter().filter(first) {
                let face = [vertex, wing.next, wing.prev];
                patch.faces.push(face.map(|v| old_to_new[v as usize]));
            }
        }
        debug_assert_eq!(patch.faces.len(), self.faces_left, "every face is counted once");
        patch
    }
}
