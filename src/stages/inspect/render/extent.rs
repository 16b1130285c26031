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
struct Reach {
    /// By rotation.
    min: Vec<Vec3A>,
    max: Vec<Vec3A>,
}

impl Reach {
    fn none(rotations: usize) -> Self {
        Self { min: vec![Vec3A::INFINITY; rotations], max: vec![Vec3A::NEG_INFINITY; rotations] }
    }

    /// Adds positions. Coordinates that are not numbers are ignored.
    fn add(&mut self, rotations: &[Mat3A], positions: &(impl Iterator<Item = [f32; 3]> + Clone)) {
        for (index, rotation) in rotations.iter().enumerate() {
            let (mut min, mut max) = (self.min[index], self.max[index]);
            for position in positions.clone() {
                // Of a number and none, these instructions take the second.
                let at = *rotation * Vec3A::from_array(position);
                (min, max) = (at.min(min), at.max(max));
            }
            (self.min[index], self.max[index]) = (min, max);
        }
    }

    fn join(&mut self, other: &Self) {
        for index in 0..self.min.len() {
            self.min[index] = self.min[index].min(other.min[index]);
            self.max[index] = self.max[index].max(other.max[index]);
        }
    }
}

/// Vertices between two looks at the flag that stops a job.
const VERTICES_PER_STEP: usize = 1 << 15;

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
    let join = |reach: &Reach| all.lock().unwrap_or_else(PoisonError::into_inner).join(reach);
    if tables.len() == source.parts.len() {
        let vertices = tables.iter().map(|table| table.len() as u64).sum();
        let meter = monitor.meter(StageId::Import, Some(vertices));
        for table in tables {
            let mut reach = Reach::none(rotations.len());
            add_vertices(table, &rotations, &meter, &mut reach)?;
            join(&reach);
        }
        meter.finish();
    } else {
        for_each_batch(source, StageId::Import, (budget, monitor), |taken| {
            let mut reach = Reach::none(rotations.len());
            for triangles in taken.triangles.chunks(TRIANGLES_PER_CHUNK) {
                let corners = triangles.iter().flat_map(|triangle| &triangle.0);
                reach.add(&rotations, &corners.map(V::position));
            }
            join(&reach);
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
        reach.add(rotations, &vertices.iter().map(V::position));
        meter.add(vertices.len() as u64)?;
    }
    Ok(())
}
