//! How a mesh hangs together: the triangles put in the order of a sweep, and counted as they pass.
//! The report is part of the JSON of `compare` and `info`; its names are a contract.

use serde::Serialize;

use super::{
    Detail, Info,
    info::{in_room, reading},
    streaming::sort_config,
};
use crate::{
    error::{Error, Result},
    geometry::Bounds,
    progress::Monitor,
    soup::{Point, Source, SweepAxis, Vertex},
    stages::{
        convert::{
            import::{self, Need},
            presort,
        },
        inspect::topology as stage,
    },
    storage::Workspace,
};

/// How a surface hangs together, after corners at one position have been made one vertex. What each
/// count means is said at [`crate::stages::inspect::topology::Outcome`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TopologyReport {
    /// All triangles.
    pub triangles: u64,
    /// Triangles with three distinct corners; the counts below are of these.
    pub faces: u64,
    /// Distinct positions of faces.
    pub vertices: u64,
    /// Pairs of vertices that are neighbours in a face.
    pub edges: u64,
    /// Vertices − edges + faces.
    pub euler_characteristic: i64,
    /// Sets of faces that are connected through common vertices.
    pub components: u64,
    /// Edges with one face.
    pub boundary_edges: u64,
    /// Vertices at their ends.
    pub boundary_vertices: u64,
    /// Edges with three faces or more.
    pub non_manifold_edges: u64,
    /// Vertices whose faces are not one fan.
    pub non_manifold_vertices: u64,
    /// Edges whose two faces run along them in the same direction: one of them is flipped.
    pub inconsistent_edges: u64,
    /// Faces with the three vertices of another one, the first of each set apart.
    pub duplicate_faces: u64,
    /// Triangles without area.
    pub degenerate_faces: u64,
    /// Triangles that have an area, but a quality 4√3·area / Σ edge² below
    /// [`crate::stages::inspect::topology::SLIVER_QUALITY`].
    pub slivers: u64,
    /// Their share of all triangles; 0 without any.
    pub sliver_share: f64,
}

/// Counts what the inputs, one mesh, are made of. They are read twice, or set aside if that cannot
/// be; memory within the budget; temporary files where the triangles are far from sorted and do not
/// fit in it.
///
/// # Errors
/// As [`info`](super::info()), and [`Error::Resource`] when the front of the sweep fits the memory
/// along no axis.
pub fn topology(info: Info, monitor: &Monitor) -> Result<TopologyReport> {
    let info = Info { detail: Detail::Topology, ..info };
    in_room(reading(info), monitor, |run, inputs| {
        // Colours have no say in it.
        let import::Outcome { source, survey } = run.import::<Point>(inputs, Need::Order)?;
        let order = run.order_of(&source, &survey)?;
        count(&source, &survey.bounds, order, run.workspace, run.monitor)
    })
}

/// Share of the budget in which the triangles are put in order; the slabs have the rest.
const ORDER_SHARE: u64 = 2;

/// What the triangles of a source are made of, which can be read again and lie in a box.
pub(super) fn count<V: Vertex>(
    source: &Source<V>,
    bounds: &Bounds,
    order: presort::Order,
    workspace: &Workspace,
    monitor: &Monitor,
) -> Result<TopologyReport> {
    Count { source, order, workspace, monitor }.along_any(bounds)
}

/// A count under way.
struct Count<'a, V> {
    source: &'a Source<V>,
    order: presort::Order,
    workspace: &'a Workspace,
    monitor: &'a Monitor<'a>,
}

impl<V: Vertex> Count<'_, V> {
    fn along_any(&self, bounds: &Bounds) -> Result<TopologyReport> {
        let size = bounds.size();
        let mut axes = SweepAxis::ALL;
        axes.sort_by(|a, b| size[b.index()].total_cmp(&size[a.index()]));
        let [longest, others @ ..] = axes;
        let mut counted = self.along(longest);
        for axis in others {
            let is_too_large =
                matches!(counted, Err(Error::Resource { what, .. }) if what == stage::FRONT);
            if !is_too_large {
                break;
            }
            // Across the longest side the front is the smallest, but for odd shapes.
            counted = self.along(axis);
        }
        Ok(TopologyReport::of(&counted?))
    }

    fn along(&self, axis: SweepAxis) -> Result<stage::Outcome> {
        let budget = self.workspace.budget();
        let displacement_max = Some(self.order.displacement_max[axis.index()]);
        let order_bytes = budget.available_bytes() / ORDER_SHARE;
        let sort = sort_config::<V>(axis, displacement_max, order_bytes);
        let _order_room = budget.reserve(sort.memory_bytes);
        let slab_room = budget.reserve_share(1.0, stage::MEMORY_BYTES_MIN);
        let config = stage::Config {
            axis,
            triangles: Some(self.order.triangles),
            new_triangles_min: stage::NEW_TRIANGLES_MIN,
            memory_bytes: slab_room.bytes(),
        };
        stage::topology(&config, self.monitor, |sink| {
            presort::presort(self.source, &sort, self.workspace, self.monitor, sink).map(|_| ())
        })
    }
}

impl TopologyReport {
    fn of(outcome: &stage::Outcome) -> Self {
        let triangles = outcome.triangles;
        Self {
            triangles,
            faces: outcome.faces,
            vertices: outcome.vertices,
            edges: outcome.edges,
            euler_characteristic: outcome.euler_characteristic(),
            components: outcome.components,
            boundary_edges: outcome.boundary_edges,
            boundary_vertices: outcome.boundary_vertices,
            non_manifold_edges: outcome.non_manifold_edges,
            non_manifold_vertices: outcome.non_manifold_vertices,
            inconsistent_edges: outcome.inconsistent_edges,
            duplicate_faces: outcome.duplicate_faces,
            degenerate_faces: outcome.degenerate,
            slivers: outcome.slivers,
            sliver_share: outcome.slivers as f64 / triangles.max(1) as f64,
        }
    }
}
