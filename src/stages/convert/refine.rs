//! A progressive mesh read as far as is wanted, or as far as it goes.

use std::io::Read;

use crate::{
    error::{Error, Position, Result},
    formats::{
        FormatError,
        progressive::{Deviation, Header, Reader, Split},
    },
    mesh::progressive::Growing,
    progress::{Monitor, StageId},
    soup::{Column, IndexedMesh, InputPath, Triangles, Vertex},
    storage::{Budget, Reservation},
};

/// How far to refine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Detail {
    /// To the end.
    All,
    /// To this many triangles, or one fewer.
    Triangles(u64),
    /// To this share of the triangles of the finest mesh, above 0, at most 1.
    Ratio(f64),
    /// Until the largest distance from the finest mesh that is stated is at most this, model units.
    Length(f64),
    /// The same, as a share of the diagonal of the coarsest mesh's bounding box.
    Share(f64),
}

/// A mesh refined.
pub struct Outcome {
    /// The mesh.
    pub mesh: Growing,
    /// What the header says.
    pub header: Header,
    /// Batches that were used, the last one perhaps in part.
    pub batches: u32,
    /// The stream ended before what was wanted.
    pub is_cut: bool,
    /// It is as fine as was wanted.
    pub is_met: bool,
    /// How far the finest mesh is from it, at most: as is stated of its last whole block.
    pub deviation: Deviation,
    _room: Reservation,
}

/// What [`Error::Resource`] names when the mesh does not fit.
pub const REFINED: &str = "the refined mesh";

/// Bytes of memory of a face: arrays that grow are at worst half empty; then the mesh is written.
const FACE_BYTES: u64 = 2 * Growing::FACE_BYTES;

/// Reads a progressive mesh up to a detail.
///
/// # Errors
/// [`Error::Input`] when it is not what it says as far as it is read, or cut in the base,
/// [`Error::Resource`] when the mesh does not fit the budget, cancellation.
pub fn refine(
    input: impl Read + Send + 'static,
    path: &InputPath,
    detail: Detail,
    budget: &Budget,
    monitor: &Monitor,
) -> Result<Outcome> {
    let in_file = |error: FormatError| error.in_file(path.as_path());
    let mut reader = Reader::open(input).map_err(in_file)?;
    let header = reader.header().clone();
    let detail = match detail {
        Detail::Ratio(ratio) => {
            Detail::Triangles((f64::from(header.faces) * ratio).round().max(1.0) as u64)
        }
        detail => detail,
    };
    let faces_wanted = match detail {
        Detail::Triangles(count) => count.min(header.faces.into()),
        _ => header.faces.into(),
    };
    let faces_known = match detail {
        // How many that takes shows on the way.
        Detail::Length(_) | Detail::Share(_) => header.base_faces.into(),
        _ => faces_wanted.max(header.base_faces.into()),
    };
    let mut room = reserve(budget, faces_known)?;
    let meter = monitor.meter(StageId::Refine, Some(faces_wanted.max(header.base_faces.into())));
    let base = reader.read_base().map_err(in_file)?;
    let mut mesh = Growing::of_base(&base, &header);
    meter.add(base.faces.len() as u64)?;
    let enough = enough(detail, &mesh, header.step);
    let (mut deviation, mut batches) = (base.deviation, 0);
    while (mesh.faces().len() as u64) < faces_wanted && f64::from(deviation.max) > enough {
        let Some(batch) = reader.next_batch().map_err(in_file)? else { break };
        if matches!(detail, Detail::Length(_) | Detail::Share(_)) {
            room.absorb(reserve(budget, batch.faces.into())?);
        }
        let left = faces_wanted - mesh.faces().len() as u64;
        let is_whole = left >= u64::from(batch.faces);
        let used = if is_whole { Vec::new() } else { spread(&batch.splits, left) };
        let before = mesh.faces().len();
        for (index, split) in batch.splits.iter().enumerate() {
            if is_whole || used[index] {
                let at = Position::byte(batch.at).in_record(index as u64);
                let done = mesh.split(split);
                done.map_err(|fault| in_file(FormatError::input(at, fault)))?;
            }
        }
        meter.add((mesh.faces().len() - before) as u64)?;
        batches += 1;
        if !is_whole {
            break;
        }
        deviation = batch.deviation;
    }
    if mesh.faces().len() as u64 == u64::from(header.faces) {
        // Nothing may follow.
        reader.next_batch().map_err(in_file)?;
    }
    meter.finish();
    let triangles = mesh.faces().len() as u64;
    let is_met = match detail {
        Detail::All | Detail::Ratio(_) => triangles == u64::from(header.faces),
        // Beyond the finest mesh and below the coarsest there is nothing.
        Detail::Triangles(count) => triangles == count || triangles + 1 == count,
        Detail::Length(_) | Detail::Share(_) => f64::from(deviation.max) <= enough,
    };
    let is_cut = reader.is_cut();
    Ok(Outcome { mesh, header, batches, is_cut, is_met, deviation, _room: room })
}

/// Takes the memory of so many faces.
fn reserve(budget: &Budget, faces: u64) -> Result<Reservation> {
    let (needed_bytes, available_bytes) = (faces * FACE_BYTES, budget.available_bytes());
    let refused = Error::Resource { what: REFINED, needed_bytes, available_bytes };
    budget.reserve(needed_bytes).ok_or(refused)
}

/// The largest distance that is near enough; below 0 where only the count decides.
fn enough(detail: Detail, base: &Growing, step: f64) -> f64 {
    match detail {
        Detail::All | Detail::Triangles(_) | Detail::Ratio(_) => -1.0,
        Detail::Length(length) => length,
        Detail::Share(share) => {
            let (mut min, mut max) = ([u32::MAX; 3], [0; 3]);
            for position in base.positions() {
                for axis in 0..3 {
                    min[axis] = min[axis].min(position[axis]);
                    max[axis] = max[axis].max(position[axis]);
                }
            }
            let side = |axis: usize| f64::from(max[axis].saturating_sub(min[axis])) * step;
            share * (0..3).map(|axis| side(axis).powi(2)).sum::<f64>().sqrt()
        }
    }
}

/// Which splits of a batch to do for so many faces, or one fewer where all add two: evenly spread,
/// since neighbours are next to each other.
fn spread(splits: &[Split], faces: u64) -> Vec<bool> {
    let all: u64 = splits.iter().map(|split| u64::from(split.kind.faces())).sum();
    let (mut passed, mut taken) = (0, 0);
    let take = |split: &Split| {
        let own = u64::from(split.kind.faces());
        passed += own;
        let is_taken = taken + own <= passed * faces / all;
        taken += if is_taken { own } else { 0 };
        is_taken
    };
    let mut used: Vec<bool> = splits.iter().map(take).collect();
    if taken < faces {
        // One is missing: a split of one face more, or one of two instead of one of one.
        let place = |faces: u32, is_used: bool| {
            let mut all = splits.iter().zip(&used);
            all.position(|(split, used)| split.kind.faces() == faces && *used == is_used)
        };
        match (place(1, false), place(1, true), place(2, false)) {
            (Some(one), ..) => used[one] = true,
            (None, Some(one), Some(two)) => (used[one], used[two]) = (false, true),
            _ => {}
        }
    }
    used
}

impl Outcome {
    /// The mesh with positions relative to the header's origin.
    #[must_use]
    pub fn indexed<V: Vertex>(&self) -> IndexedMesh<V> {
        let step = self.header.step;
        let vertex = |(index, position): (usize, &[u32; 3])| {
            let color = self.mesh.colors().get(index).copied().unwrap_or([u8::MAX; 4]);
            V::new(position.map(|c| (f64::from(c) * step) as f32), color)
        };
        let vertices = self.mesh.positions().iter().enumerate().map(vertex).collect();
        let triangles = Triangles::Memory(self.mesh.faces().to_vec());
        IndexedMesh { vertices: Column::Memory(vertices), triangles }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::progressive::Kind;

    #[test]
    fn a_part_of_a_batch_is_spread_over_it_and_meets_the_count() {
        let mixed = |index: u32| if index % 5 == 3 { Kind::First } else { Kind::Between };
        for kind in [mixed, |_| Kind::Between, |_| Kind::Last] {
            let splits: Vec<Split> = (0..100)
                .map(|index| Split { parent: index, kind: kind(index), ..Split::default() })
                .collect();
            let all: u32 = splits.iter().map(|split| split.kind.faces()).sum();
            for wanted in 0..all {
                let used = spread(&splits, wanted.into());
                let chosen = splits.iter().zip(&used).filter(|(_, used)| **used);
                let faces: u32 = chosen.map(|(split, _)| split.kind.faces()).sum();
                let only_pairs = splits.iter().all(|split| split.kind == Kind::Between);
                assert_eq!(faces, if only_pairs { wanted / 2 * 2 } else { wanted });
                let half = used[..50].iter().filter(|used| **used).count();
                let rest = used[50..].iter().filter(|used| **used).count();
                assert!(half.abs_diff(rest) <= 5, "{wanted}: {half} and {rest}");
            }
        }
    }
}
