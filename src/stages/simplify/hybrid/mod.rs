//! Edge collapses on a mesh that clustering has made small `[GS02]`: what the clusters stand for is
//! passed on, so that the collapses are measured against the surface as it was.
//!
//! Where the triangles come from, and how many times the wanted ones they are, is decided elsewhere.

use crate::{
    error::{Error, Result},
    mesh::{self, Mesh},
    progress::{Monitor, StageId},
    soup::{Column, IndexedMesh, Vertex, VertexQuadric},
    storage::Workspace,
};

/// What decimation after clustering needs to know.
#[derive(Clone, Copy, Debug)]
pub struct Config {
    /// Triangles wanted.
    pub triangles_target: u64,
}

/// A clustered mesh.
pub struct Clustered<V> {
    /// Vertices and triangles.
    pub mesh: IndexedMesh<V>,
    /// What the vertices stand for, where the metric remembers it.
    pub quadrics: Option<Column<VertexQuadric>>,
}

/// What decimation did.
pub struct Outcome<V> {
    /// The result.
    pub mesh: IndexedMesh<V>,
    /// Triangles that clustering had left.
    pub triangles_clustered: u64,
    /// Vertices left alone because their faces are no fan: where two sheets of the surface pass
    /// through one cell.
    pub complex_vertices: u64,
}

/// What [`Error::Resource`] names when the mesh does not fit, here or by the plan.
pub const CLUSTERED: &str = "the mesh that clustering leaves";

/// Decimates a clustered mesh to exactly the wanted number of triangles, as far as there are so
/// many, and moves its vertices to their best places.
///
/// Memory: [`mesh::face_bytes`] for each triangle of the clustered mesh. No temporary disk.
///
/// # Errors
/// [`Error::Resource`] when the mesh does not fit the budget, what reading it can fail with,
/// cancellation.
pub fn decimate<V: Vertex, M: mesh::Metric>(
    clustered: Clustered<V>,
    config: &Config,
    workspace: &Workspace,
    monitor: &Monitor,
) -> Result<Outcome<V>> {
    let triangles = clustered.mesh.counts().triangles;
    let needed_bytes = triangles * mesh::face_bytes::<V, M>();
    let Some(_room) = workspace.budget().reserve(needed_bytes) else {
        let available_bytes = workspace.budget().available_bytes();
        return Err(Error::Resource { what: CLUSTERED, needed_bytes, available_bytes });
    };
    let surplus = triangles.saturating_sub(config.triangles_target);
    // Where only pairs of triangles can go, one more does.
    let meter = monitor.meter(StageId::Finish, Some(surplus + 1));
    let Clustered { mesh: IndexedMesh { vertices, triangles: faces }, quadrics } = clustered;
    let vertices = vertices.into_memory()?;
    let quadrics = quadrics.map(Column::into_memory).transpose()?;
    let mut mesh = Mesh::<M>::of_indexed(vertices, faces.into_memory()?, quadrics);
    let complex_vertices = mesh.complex_vertices() as u64;
    monitor.check(StageId::Finish)?;
    let target = usize::try_from(config.triangles_target).unwrap_or(usize::MAX);
    mesh::finish_metered(&mut mesh, target, &meter)?;
    M::place(&mut mesh);
    meter.finish();
    let mesh = mesh.into_patch().into_indexed();
    Ok(Outcome { mesh, triangles_clustered: triangles, complex_vertices })
}
