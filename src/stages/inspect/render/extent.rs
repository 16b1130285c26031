//! How far a mesh reaches along the directions of each view: one pass over a soup, and none over
//! the faces of an indexed mesh, whose vertices are at hand.

use std::sync::{Mutex, PoisonError};

use glam::{DMat3, DVec3, Mat3A, Vec3A};

use super::{
    camera::Extent,
    scene::{Config, for_each_batch},
};
use crate::{
    error::Result,
    progress::{Meter, Monitor, StageId},
    soup::{Part, Source, Vertex},
    storage::Budget,
};

/// Least and greatest coordinates along the directions of each rotation.
#[derive(Clone)]
struct Reach {
    /// By rotation.
    min: Vec<Vec3A>,
    max: Vec<Vec3A>,
}

impl Reach {
    fn none(rotations: usize) -> Self {
        Self { min: vec![Vec3A::INFINITY; rotations], max: vec![Vec3A::NEG_INFINITY; rotations] }
    }

    /// Adds positions that lie near each other. Coordinates that are not numbers are ignored.
    fn add(&mut self, rotations: &[Mat3A], positions: &(impl Iterator<Item = [f32; 3]> + Clone)) {
        let none = (Vec3A::INFINITY, Vec3A::NEG_INFINITY);
        let surroundings = within(none, positions.clone().map(Vec3A::from_array));
        for (index, rotation) in rotations.iter().enumerate() {
            let known = (self.min[index], self.max[index]);
            if !holds(known, *rotation, surroundings) {
                let turned = positions.clone().map(|at| *rotation * Vec3A::from_array(at));
                (self.min[index], self.max[index]) = within(known, turned);
            }
        }
    }

    fn join(&mut self, other: &Self) {
        for index in 0..self.min.len() {
            self.min[index] = self.min[index].min(other.min[index]);
            self.max[index] = self.max[index].max(other.max[index]);
        }
    }
}

/// The least box around another and some positions.
fn within(known: (Vec3A, Vec3A), positions: impl Iterator<Item = Vec3A>) -> (Vec3A, Vec3A) {
    // Of a number and none, these instructions take the second.
    positions.fold(known, |(min, max), at| (at.min(min), at.max(max)))
}

/// Whether all that lies in a box is certain to lie between `min` and `max` when it has been turned,
/// however that is rounded. Most of a mesh is far from where it ends.
fn holds((min, max): (Vec3A, Vec3A), rotation: Mat3A, (low, high): (Vec3A, Vec3A)) -> bool {
    let (middle, half) = ((low + high) / 2.0, (high - low) / 2.0);
    let reach = rotation.abs() * half + (middle.abs() + half).max_element() * ROUNDING;
    let middle = rotation * middle;
    (middle - reach).cmpge(min).all() && (middle + reach).cmple(max).all()
}

/// More than turning a point can be off by, relative to its distance from the origin.
const ROUNDING: f32 = 1e-5;

/// Vertices between two looks at the flag that stops a job.
const VERTICES_PER_STEP: usize = 1 << 15;
/// Vertices that lie near each other, mostly.
const VERTICES_TOGETHER: usize = 1 << 10;

/// How far a mesh reaches in each view.
#[derive(Clone, Debug)]
pub struct Extents {
    rotations: Vec<DMat3>,
    /// By rotation.
    extents: Vec<Extent>,
}

impl Extents {
    /// Measures all triangles in the views of `config`; of an indexed mesh all vertices, used or
    /// not. `None` when there is nothing.
    ///
    /// # Errors
    /// What reading the source fails with, cancellation.
    pub fn measure<V: Vertex>(
        source: &Source<V>,
        config: &Config,
        budget: &Budget,
        monitor: &Monitor,
    ) -> Result<Option<Self>> {
        let rotations: Vec<_> = config.views.iter().map(|view| view.rotation(config.up)).collect();
        let reach = reach(source, &rotations, budget, monitor)?;
        let extents = reach.min.iter().zip(&reach.max);
        let extents = extents.map(|(min, max)| Extent { min: min.as_dvec3(), max: max.as_dvec3() });
        let is_empty = reach.min.iter().any(|min| !min.is_finite());
        Ok((!is_empty).then(|| Self { rotations, extents: extents.collect() }))
    }

    /// What both reach to; the other was measured in the same views, and lies `shift` from where its
    /// positions say.
    #[must_use]
    pub fn union(mut self, other: &Self, shift: DVec3) -> Self {
        assert_eq!(self.rotations, other.rotations, "extents of different views");
        for (index, extent) in self.extents.iter_mut().enumerate() {
            let (other, shift) = (&other.extents[index], self.rotations[index] * shift);
            extent.min = extent.min.min(other.min + shift);
            extent.max = extent.max.max(other.max + shift);
        }
        self
    }

    pub(super) fn by_view(&self) -> impl Iterator<Item = (&DMat3, &Extent)> {
        self.rotations.iter().zip(&self.extents)
    }
}

fn reach<V: Vertex>(
    source: &Source<V>,
    rotations: &[DMat3],
    budget: &Budget,
    monitor: &Monitor,
) -> Result<Reach> {
    let rotations: Vec<Mat3A> =
        rotations.iter().map(|rotation| Mat3A::from(rotation.as_mat3())).collect();
    let mut tables = Vec::new();
    for part in &source.parts {
        if let Part::Indexed { vertices, .. } = part {
            tables.push(vertices.as_slice());
        }
    }
    let all = Mutex::new(Reach::none(rotations.len()));
    let all_known = || all.lock().unwrap_or_else(PoisonError::into_inner);
    if tables.len() == source.parts.len() {
        let vertices = tables.iter().map(|table| table.len() as u64).sum();
        let meter = monitor.meter(StageId::Import, Some(vertices));
        for table in tables {
            add_vertices(table, &rotations, &meter, &mut all_known())?;
        }
        meter.finish();
    } else {
        for_each_batch(source, StageId::Import, (budget, monitor), |taken| {
            let mut reach = all_known().clone();
            for triangles in taken.triangles.chunks(TRIANGLES_PER_CHUNK) {
                let corners = triangles.iter().flat_map(|triangle| &triangle.0);
                reach.add(&rotations, &corners.map(V::position));
            }
            all_known().join(&reach);
            Ok(())
        })?;
    }
    Ok(all.into_inner().unwrap_or_else(PoisonError::into_inner))
}

/// Triangles that stay in the cache from one view to the next.
const TRIANGLES_PER_CHUNK: usize = 512;

fn add_vertices<V: Vertex>(
    table: &[V],
    rotations: &[Mat3A],
    meter: &Meter,
    reach: &mut Reach,
) -> Result<()> {
    for vertices in table.chunks(VERTICES_PER_STEP) {
        for vertices in vertices.chunks(VERTICES_TOGETHER) {
            reach.add(rotations, &vertices.iter().map(V::position));
        }
        meter.add(vertices.len() as u64)?;
    }
    Ok(())
}
