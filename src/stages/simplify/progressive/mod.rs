//! A mesh that fits in memory made progressive `[Hop96]`: quantised, decimated with every collapse
//! recorded, and the recording turned round into blocks.
//!
//! Reading one again is `stages/convert/refine.rs`; the bytes are those of docs/FORMATS.md.

mod deviation;
mod quantize;

use std::sync::mpsc;

use deviation::Course;
use quantize::Quantized;

use crate::{
    error::{Error, Result},
    formats::progressive::{
        Channels, Deviation, FACES_MAX, Header, Packed, Split, VERTICES_MAX, pack_base, pack_batch,
    },
    mesh::{
        self, Mesh, Metric,
        progressive::{Growing, RECORD_FACE_BYTES, Recording, Turned, record, turn_round},
    },
    progress::{Meter, Monitor, StageId},
    soup::{IndexedMesh, Vertex},
    storage::Workspace,
};

/// How to make a mesh progressive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Bits of a coordinate, 4 to 24: steps along the longest side. More are finer and take more.
    pub bits: u32,
    /// Triangles of the base, about; it has more where no collapse is left.
    pub base_triangles: u64,
}

/// A progressive mesh, ready to be written.
pub struct Outcome {
    /// The header, but for what follows from the blocks.
    pub header: Header,
    /// The base and the batches.
    pub blocks: Vec<(Packed, Deviation)>,
    /// Triangles of the finest mesh.
    pub triangles: u64,
    /// Its vertices.
    pub vertices: u64,
    /// Triangles left out because two of their corners were one vertex.
    pub degenerate: u64,
    /// Vertices that were added because several sheets of the surface touched in one.
    pub split_vertices: u64,
    /// Vertices left alone because their faces are no fan.
    pub complex_vertices: u64,
}

/// What [`Error::Resource`] names when the mesh does not fit, here or by the plan.
pub const PROGRESSIVE: &str = "the progressive mesh";

/// Bytes of memory that so many triangles need.
#[must_use]
pub fn memory_bytes<V: Vertex, M: Metric>(triangles: u64) -> u64 {
    let mesh = size_of::<[u32; 3]>() as u64 + size_of::<V>() as u64 / 2;
    // The mesh is gone before the recording is turned round.
    let recorded = mesh::face_bytes::<V, M>();
    let turned = Growing::FACE_BYTES + Course::FACE_BYTES + SPLIT_FACE_BYTES;
    triangles * (mesh + RECORD_FACE_BYTES + recorded.max(turned))
}

/// Bytes of a split and of what it becomes, for each of its two faces.
const SPLIT_FACE_BYTES: u64 = 40;

/// Makes a mesh progressive whose positions are relative to `origin`.
///
/// Memory: [`memory_bytes`]. No temporary disk.
///
/// # Errors
/// [`Error::Resource`] when the mesh does not fit the budget, [`Error::Request`] when the format
/// cannot hold it, what reading it can fail with, cancellation.
pub fn encode<V: Vertex, M: Metric>(
    mesh: IndexedMesh<V>,
    origin: [f64; 3],
    config: &Config,
    workspace: &Workspace,
    monitor: &Monitor,
) -> Result<Outcome> {
    let counts = mesh.counts();
    let needed_bytes = memory_bytes::<V, M>(counts.triangles);
    let Some(_room) = workspace.budget().reserve(needed_bytes) else {
        let available_bytes = workspace.budget().available_bytes();
        return Err(Error::Resource { what: PROGRESSIVE, needed_bytes, available_bytes });
    };
    if counts.triangles > FACES_MAX.into() || counts.vertices > VERTICES_MAX.into() {
        let text = format!("a progressive mesh cannot have {} triangles", counts.triangles);
        return Err(Error::Request(text));
    }
    let Quantized { vertices, faces, degenerate, min, step } =
        quantize::quantize(mesh, config.bits)?;
    let triangles = faces.len() as u64;
    if triangles == 0 {
        return Err(Error::Request("no triangle is left to be made progressive".to_owned()));
    }
    let mut course = Course::of(&vertices, &faces);
    let origin = std::array::from_fn(|axis| origin[axis] + min[axis]);
    let header = Header::of_grid(channels(&vertices), config.bits, origin, step);
    let meter = monitor.meter(StageId::Record, Some(triangles));
    let mesh = Mesh::<M>::of_scanned(&vertices, faces);
    drop(vertices);
    monitor.check(StageId::Record)?;
    let base_triangles = usize::try_from(config.base_triangles).unwrap_or(usize::MAX);
    let recording = record(mesh, config.bits, base_triangles, &meter)?;
    meter.finish();
    let (split_vertices, complex_vertices) = (recording.split_vertices, recording.complex_vertices);
    let meter = monitor.meter(StageId::Encode, None);
    let (Turned { base, finest }, batches) =
        turn_and_pack(recording, &header, &mut course, &meter)?;
    let vertices = finest.positions().len() as u64;
    debug_assert_eq!(finest.faces().len() as u64, triangles, "no face is lost");
    drop(finest);
    let Some(base) = pack_base(&base, header.bits, header.channels) else {
        let text = format!(
            "{} triangles cannot be collapsed, more than the base of a progressive mesh holds",
            base.faces.len()
        );
        return Err(Error::Request(text));
    };
    meter.finish();
    Ok(Outcome {
        blocks: course.finish(std::iter::once(base).chain(batches), step),
        header,
        triangles,
        vertices,
        degenerate,
        split_vertices: split_vertices as u64,
        complex_vertices: complex_vertices as u64,
    })
}

/// What must be stored of the colours of vertices.
fn channels<V: Vertex>(vertices: &[V]) -> Channels {
    if !V::COLORED {
        Channels::None
    } else if vertices.iter().all(|vertex| vertex.color()[3] == u8::MAX) {
        Channels::Rgb
    } else {
        Channels::Rgba
    }
}

/// Turns a recording round, and packs its batches meanwhile.
fn turn_and_pack(
    recording: Recording,
    header: &Header,
    course: &mut Course,
    meter: &Meter,
) -> Result<(Turned, Vec<Packed>)> {
    let (bits, channels) = (header.bits, header.channels);
    let (sender, packed) = mpsc::channel();
    let turned = rayon::in_place_scope(|scope| {
        let mut taken = 0;
        let mut take = |splits: Vec<Split>| {
            let (number, sender) = (taken, sender.clone());
            taken += 1;
            scope.spawn(move |_| {
                // Nobody listens once the turning was cancelled.
                let _ = sender.send((number, pack_batch(&splits, bits, channels)));
            });
        };
        turn_round(recording, header, meter, &mut |mesh| course.look(mesh), &mut take)
    })?;
    drop(sender);
    let mut packed: Vec<(usize, Packed)> = packed.into_iter().collect();
    packed.sort_unstable_by_key(|(number, _)| *number);
    Ok((turned, packed.into_iter().map(|(_, batch)| batch).collect()))
}
