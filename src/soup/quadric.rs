//! What a vertex of a clustered mesh stands for, passed on to what decimates the mesh further
//! `[GS02]`.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::storage::Record;

/// E(v + d) = dᵀ A d + 2 b·d for a vertex at v, in model units: squared distances to the planes of
/// the faces that the vertex stands for, each weighted by the face's area; less the value at v.
///
/// Normals have length one, so that the trace of A is the sum of the areas.
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable, KnownLayout)]
#[repr(C)]
pub struct VertexQuadric {
    /// A: xx, xy, xz, yy, yz, zz.
    pub a: [f32; 6],
    /// b.
    pub b: [f32; 3],
}

impl Record for VertexQuadric {
    const KIND: [u8; 4] = *b"VQUA";
}
