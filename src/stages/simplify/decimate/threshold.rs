//! The cost up to which slabs are decimated, from a sample of the surface.
//!
//! One threshold for all slabs leaves triangles where the detail is, as a greedy decimation of the
//! whole mesh would. The sample, cut out in blobs, is decimated step by step; what is left in the
//! middle of each blob tells what a threshold leaves of the whole.

use rayon::prelude::*;

use super::{Blobs, Config, rest::at_rank};
use crate::{
    mesh::{self, Limit, Mesh},
    soup::{SweepKey, Triangle, Vertex},
};

/// What slabs are decimated to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Threshold {
    /// Collapses that cost less are done.
    pub cost: f32,
    /// What costs are in units of, see [`mesh::Patch::unit`].
    pub unit: f32,
    /// Share of the triangles it leaves, about, interfaces apart.
    pub share: f64,
}

impl Threshold {
    /// What is known of it before there is a sample.
    pub(super) fn expected(ratio: f64) -> Self {
        Self { cost: f32::INFINITY, unit: 1.0, share: ratio.max(SHARE_MIN) * KEEP }
    }
}

/// Slabs leave so many times the wanted triangles: the sample is a sample, and the last ones are to
/// go in the order of their costs. On a CT scan to 1 % the error is 7 % larger at 1.15 than by share,
/// and 2 % at 1.4, for 2 to 4 % of the time.
const KEEP: f64 = 1.3;
/// The least share that blobs can tell of: below it, their borders reach into their cores.
const SHARE_MIN: f64 = 0.01;
/// A vertex is in the core of a blob when it is so far from its border, as a share of the edges
/// along a square of as many triangles.
const BORDER_SHARE: f64 = 0.25;
/// Vertices in the cores of all blobs, at least, for their number to say something.
const CORE_VERTICES_MIN: usize = 4000;
/// The threshold rises, from step to step, above the costs of this share of the vertices.
const STEP_SHARE: f64 = 0.2;
/// And at least by this factor.
const STEP_FACTOR: f32 = 1.25;
/// Of each so many vertices one is asked for its cost.
const COST_STEP: usize = 16;

/// Looks for the threshold that leaves what `config` wants; `None` when the sample does not tell.
#[must_use]
pub fn threshold<V: Vertex>(
    config: &Config,
    blobs: &Blobs,
    sample: Vec<Triangle<V>>,
) -> Option<Threshold> {
    let ratio = config.ratio()?.max(SHARE_MIN);
    if blobs.is_crowded() || sample.is_empty() {
        return None;
    }
    let mut cut_out = blobs.sort(sample);
    cut_out.par_iter_mut().for_each(|triangles| {
        triangles.sort_by_cached_key(|triangle| SweepKey::of(triangle, config.axis));
    });
    let unit = mesh::unit_of(cut_out.first()?);
    let cost = match config.metric {
        super::Metric::Quadric => cost_at::<V, mesh::ByQuadric>(cut_out, (ratio, unit)),
        super::Metric::Volume => cost_at::<V, mesh::ByVolume>(cut_out, (ratio, unit)),
    };
    Some(Threshold { cost: cost?, unit, share: ratio * KEEP })
}

/// A piece of the surface, cut out, and those of its vertices that cannot tell.
struct Blob<M: mesh::Metric> {
    mesh: Mesh<M>,
    core: Vec<u32>,
}

impl<M: mesh::Metric> Blob<M> {
    fn core_left(&self) -> usize {
        self.core.iter().filter(|vertex| !self.mesh.is_gone(**vertex)).count()
    }
}

/// The cost at which [`KEEP`] times this share of the vertices is left in the cores.
fn cost_at<V: Vertex, M: mesh::Metric>(
    cut_out: Vec<Vec<Triangle<V>>>,
    (ratio, unit): (f64, f32),
) -> Option<f32> {
    let make = |triangles: Vec<Triangle<V>>| {
        let edges = (triangles.len() as f64 / 2.0).sqrt() * BORDER_SHARE;
        let mut patch = mesh::weld::<V, M>(&triangles).into_patch();
        drop(triangles);
        patch.unit = unit;
        let mut mesh = Mesh::of_original(patch);
        let core = mesh.far_from_boundary(edges as usize);
        mesh.freeze_boundary();
        Blob { mesh, core }
    };
    let mut blobs: Vec<Blob<M>> = cut_out.into_par_iter().map(make).collect();
    let count = |blobs: &[Blob<M>]| blobs.iter().map(Blob::core_left).sum::<usize>();
    let all = count(&blobs);
    if all < CORE_VERTICES_MIN {
        return None;
    }
    let wanted = all as f64 * ratio * KEEP;
    let (mut before, mut cost) = ((all as f64, 0.0_f32), 0.0_f32);
    loop {
        let costs = blobs.par_iter_mut().flat_map_iter(|blob| blob.mesh.sample_costs(COST_STEP));
        let mut costs: Vec<f32> = costs.collect();
        let next = at_rank(&mut costs, STEP_SHARE).filter(|cost| cost.is_finite())?;
        cost = next.max(cost * STEP_FACTOR).max(f32::MIN_POSITIVE);
        let limit = Limit { cost, share: 0.0, faces: 0 };
        blobs.par_iter_mut().for_each(|blob| mesh::sweep_blocks(&mut blob.mesh, &limit));
        let left = count(&blobs) as f64;
        if left <= wanted {
            return Some(between(before, (left.max(0.5), cost), wanted));
        }
        before = (left, cost);
    }
}

/// The cost between two at which so many vertices are left, by a straight line through the
/// logarithms.
fn between(before: (f64, f32), after: (f64, f32), wanted: f64) -> f32 {
    if before.1 <= 0.0 || before.0 <= after.0 {
        return after.1;
    }
    let part = (before.0 / wanted).ln() / (before.0 / after.0).ln();
    (f64::from(before.1).ln() * (1.0 - part) + f64::from(after.1).ln() * part).exp() as f32
}
