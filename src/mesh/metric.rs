//! What a decimation goes by: the interface between the collapses and their metrics.
//!
//! Metrics are chosen at compile time: each has its own copy of the sweeps. Whether a collapse is
//! legal is no matter of theirs.

use glam::Vec3;
use zerocopy::{FromBytes, Immutable, IntoBytes};

use super::{Mesh, Patch, ring::Wing};
use crate::soup::VertexQuadric;

/// A collapse of an edge: one end is removed, the other kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// The end that is kept.
    pub kept: u32,
    /// What it costs, in the metric's own unit; not negative.
    pub cost: f32,
    /// Where the kept end will lie.
    pub to: Vec3,
}

/// What the vertices of a mesh remember, and pass on when they are collapsed.
pub trait Memory: Sized + Send + Sync + 'static {
    /// What a vertex carries from one mesh to the next; made of numbers of four bytes.
    type Carried: Copy + Default + Send + Sync + FromBytes + IntoBytes + Immutable;
    /// What a vertex holds while its mesh is decimated.
    type Held: Copy + Default + Send + Sync;

    /// Whether kept vertices move, so that the faces around them must be looked at, too.
    const MOVES_KEPT: bool;
    /// Whether a kept vertex gets the mean colour of what it stands for, not its own.
    const AVERAGES_COLORS: bool = true;

    /// Fills in what the vertices of a surface carry as it was scanned.
    fn scan(patch: &mut Patch<Self>);
    /// What a vertex holds of what it carried, and what its neighbours see of that.
    fn hold(carried: &Self::Carried) -> (Self::Held, f32);
    /// Takes over the last vertices, which have been removed in another mesh, with the faces near them.
    fn hang(_: &mut Mesh<Self>, hung: &[[u32; 3]]) {
        debug_assert!(hung.is_empty(), "what is removed is forgotten");
    }
    /// What a vertex carries on.
    fn carry(mesh: &Mesh<Self>, vertex: u32) -> Self::Carried;
    /// Adds what the same vertex carries from another patch.
    fn join(sum: &mut Self::Carried, other: &Self::Carried);
    /// Takes note that a vertex is on a boundary.
    fn add_boundary(mesh: &mut Mesh<Self>, vertex: u32);
    /// Passes on what a vertex holds, after it has been collapsed and is in no ring.
    fn collapsed(mesh: &mut Mesh<Self>, removed: u32, best: &Candidate);
}

/// A metric: which collapse of a vertex is the cheapest, and where what is left lies best.
pub trait Metric: Memory {
    /// The threshold of costs rises by this factor from sweep to sweep.
    const STEP: f32;
    /// The first threshold of a block is above the costs of one in so many of its vertices.
    const FIRST_SHARE: usize;

    /// What a vertex carries that stands for a piece of the surface as it was scanned.
    fn pass_on(quadric: &VertexQuadric) -> Self::Carried;
    /// Computes what [`Self::cheapest`] of a vertex will look at.
    fn prepare(mesh: &mut Mesh<Self>, vertex: u32);
    /// Computes what [`Self::cheapest`] of any of these vertices will look at, which ascend and are
    /// all that are left; on all threads, where it is worth it.
    fn prepare_all(mesh: &mut Mesh<Self>, vertices: &[u32]) {
        for vertex in vertices {
            Self::prepare(mesh, *vertex);
        }
    }
    /// The cheapest collapse that removes `vertex`, legal or not, except into some neighbours.
    fn cheapest(mesh: &Mesh<Self>, vertex: u32, ring: &[Wing], except: &[u32])
    -> Option<Candidate>;
    /// Moves the vertices to their final places.
    fn place(mesh: &mut Mesh<Self>);
}
