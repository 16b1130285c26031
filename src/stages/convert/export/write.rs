//! Sources and meshes as batches in the order of the output.
//!
//! One thread takes triangles from the source, another writes them; the order is kept.

use std::sync::mpsc;

use super::{Config, Outcome, output::Output};
use crate::{
    error::{Error, Result},
    formats::{self, Batch, Content, Counts, Findings},
    progress::{Monitor, StageId},
    soup::{Column, IndexedMesh, Scratch, Source, Triangle, Triangles, Vertex},
    storage::Workspace,
};

/// Batches in flight between the two threads.
const QUEUE_BATCHES: usize = 2;
/// Pages of a vertex file that may be resident while a mesh becomes a soup.
const RESIDENT_BYTES_MAX: u64 = 8 << 20;

fn nothing_left(config: &Config) -> Error {
    Error::NothingLeft { path: config.target.path().to_owned() }
}

/// Writes an indexed mesh in any format.
///
/// # Errors
/// [`Error::NothingLeft`] and, when the format cannot count the mesh, [`Error::FormatLimit`] before
/// anything is written; [`Error::Io`], cancellation.
pub fn export_mesh<V: Vertex>(
    mesh: &IndexedMesh<V>,
    config: &Config,
    workspace: &Workspace,
    monitor: &Monitor,
) -> Result<Outcome> {
    let counts = mesh.counts();
    if counts.triangles == 0 {
        return Err(nothing_left(config));
    }
    let indexed = config.format.is_indexed();
    let records = counts.triangles + if indexed { counts.vertices } else { 0 };
    let meter = monitor.meter(StageId::Export, Some(records));
    let written = if indexed { counts } else { Counts { vertices: 0, ..counts } };
    let mut output = Output::create(config, Some(written), workspace)?;
    let mut send = |batch: &Batch| -> Result<()> {
        meter.add(batch.count() as u64)?;
        output.write(batch)
    };
    if indexed {
        send_vertices(&mesh.vertices, &mut send)?;
        send_faces(&mesh.triangles, &mut send)?;
    } else {
        send_soup(mesh, &mut send)?;
    }
    let size_bytes = output.finish(config)?;
    meter.finish();
    Ok(Outcome { counts: written, size_bytes, findings: Findings::default() })
}

/// Writes the triangles of a source as a soup, in order.
///
/// # Errors
/// What reading the source fails with, [`Error::NothingLeft`], [`Error::FormatLimit`],
/// [`Error::Io`], cancellation.
pub fn export_soup<V: Vertex>(
    source: &Source<V>,
    config: &Config,
    workspace: &Workspace,
    monitor: &Monitor,
) -> Result<Outcome> {
    let meter = monitor.meter(StageId::Export, source.amount());
    // Polygons may make it more and defects less: only a header that can be mended may begin with
    // it. A format that cannot count so many refuses at once.
    let expected = source.records().filter(|_| config.is_seekable());
    let expected = expected.map(|triangles| Counts { vertices: 0, triangles });
    let mut output = Output::create(config, expected, workspace)?;
    let pass = source.pass();
    let (full_sender, full) = mpsc::sync_channel::<Batch>(QUEUE_BATCHES);
    let (empty_sender, empty) = mpsc::channel::<Batch>();
    let mut triangles = 0;
    std::thread::scope(|scope| -> Result<()> {
        let (pass, meter) = (&pass, &meter);
        let producer = scope.spawn(move || -> Result<()> {
            let mut scratch = Scratch::default();
            while let Some(taken) = pass.next(&mut scratch)? {
                let mut batch = empty.try_recv().unwrap_or_default();
                soup_batch(taken.triangles, &mut batch);
                meter.add(taken.records)?;
                if full_sender.send(batch).is_err() {
                    // The writer has failed, and says why.
                    break;
                }
            }
            Ok(())
        });
        let write = || -> Result<()> {
            for batch in full {
                triangles += batch.count() as u64;
                output.write(&batch)?;
                // The producer may have ended.
                let _ = empty_sender.send(batch);
            }
            Ok(())
        };
        let written = write();
        let produced = producer.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        written.and(produced)
    })?;
    if triangles == 0 {
        return Err(nothing_left(config));
    }
    let size_bytes = output.finish(config)?;
    meter.finish();
    Ok(Outcome { counts: Counts { vertices: 0, triangles }, size_bytes, findings: pass.finish() })
}

/// Writes triangles as `produce` sends them, as a soup; a thread of its own does the writing.
/// `expected` is how many there will be, about.
///
/// # Errors
/// What `produce` fails with, [`Error::NothingLeft`], [`Error::FormatLimit`], [`Error::Io`].
pub fn export_triangles<V: Vertex, T>(
    expected: Option<u64>,
    config: &Config,
    workspace: &Workspace,
    produce: impl FnOnce(&mut dyn FnMut(&[Triangle<V>]) -> Result<()>) -> Result<T>,
) -> Result<(T, Outcome)> {
    // As for `export_soup`: only a header that can be mended may begin with a guess.
    let expected = expected.filter(|_| config.is_seekable());
    let expected = expected.map(|triangles| Counts { vertices: 0, triangles });
    let mut output = Output::create(config, expected, workspace)?;
    let (full_sender, full) = mpsc::sync_channel::<Batch>(QUEUE_BATCHES);
    let (empty_sender, empty) = mpsc::channel::<Batch>();
    let mut triangles = 0;
    let (produced, output) = std::thread::scope(|scope| {
        let writer = scope.spawn(move || -> Result<Output> {
            for batch in full {
                output.write(&batch)?;
                // The producer may have ended.
                let _ = empty_sender.send(batch);
            }
            Ok(output)
        });
        let produced = produce(&mut |soup| {
            let mut batch = empty.try_recv().unwrap_or_default();
            soup_batch(soup, &mut batch);
            triangles += soup.len() as u64;
            // A writer that has failed says why when it is joined.
            full_sender.send(batch).map_err(|_| nothing_left(config))
        });
        drop(full_sender);
        let written = writer.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        written.and_then(|output| Ok((produced?, output)))
    })?;
    if triangles == 0 {
        return Err(nothing_left(config));
    }
    let size_bytes = output.finish(config)?;
    let counts = Counts { vertices: 0, triangles };
    Ok((produced, Outcome { counts, size_bytes, findings: Findings::default() }))
}

/// Writes batches as `produce` sends them, for results that are not made of a source.
/// `counts`, when known, are for the header.
///
/// # Errors
/// What `produce` fails with, [`Error::FormatLimit`], [`Error::Io`].
pub fn export_batches<T>(
    counts: Option<Counts>,
    config: &Config,
    workspace: &Workspace,
    produce: impl FnOnce(&mut dyn FnMut(&Batch) -> Result<()>) -> Result<T>,
) -> Result<(T, u64)> {
    let mut output = Output::create(config, counts, workspace)?;
    let produced = produce(&mut |batch| output.write(batch))?;
    Ok((produced, output.finish(config)?))
}

fn soup_batch<V: Vertex>(triangles: &[Triangle<V>], batch: &mut Batch) {
    batch.reset(Content::Soup);
    let corners = || triangles.iter().flat_map(|triangle| triangle.0);
    batch.positions.extend(corners().map(|vertex| vertex.position()));
    if V::COLORED {
        batch.colors.extend(corners().map(|vertex| vertex.color()));
    }
}

fn send_vertices<V: Vertex>(
    vertices: &Column<V>,
    send: &mut impl FnMut(&Batch) -> Result<()>,
) -> Result<()> {
    let (mut scan, mut batch) = (vertices.scan()?, Batch::default());
    while let Some(vertices) = scan.next_batch()? {
        batch.reset(Content::Vertices);
        batch.positions.extend(vertices.iter().map(Vertex::position));
        if V::COLORED {
            batch.colors.extend(vertices.iter().map(Vertex::color));
        }
        send(&batch)?;
    }
    Ok(())
}

fn send_faces(triangles: &Triangles, send: &mut impl FnMut(&Batch) -> Result<()>) -> Result<()> {
    let mut batch = Batch::default();
    for_each_batch(triangles, |corners| {
        batch.reset(Content::Faces);
        batch.faces.corners.extend(corners.iter().flatten());
        send(&batch)
    })
}

fn send_soup<V: Vertex>(
    mesh: &IndexedMesh<V>,
    send: &mut impl FnMut(&Batch) -> Result<()>,
) -> Result<()> {
    let mapped = match &mesh.vertices {
        Column::Memory(_) => None,
        Column::File(file) => Some(file.map()?),
    };
    let vertices: &[V] = match (&mesh.vertices, &mapped) {
        (Column::Memory(vertices), _) => vertices,
        (_, Some(mapped)) => mapped.as_slice(),
        (Column::File(_), None) => unreachable!("a file was mapped above"),
    };
    let (mut batch, mut soup) = (Batch::default(), Vec::new());
    for_each_batch(&mesh.triangles, |corners| {
        soup.clear();
        soup.extend(corners.iter().map(|t| Triangle(t.map(|index| vertices[index as usize]))));
        if let Some(mapped) = &mapped {
            // Triangles are sorted by their first vertex: neighbours share pages, mostly.
            mapped.touched(corners.len() as u64 * 4096, RESIDENT_BYTES_MAX)?;
        }
        soup_batch(&soup, &mut batch);
        send(&batch)
    })
}

/// Visits triangles in batches, widened.
fn for_each_batch(
    triangles: &Triangles,
    mut visit: impl FnMut(&[[u64; 3]]) -> Result<()>,
) -> Result<()> {
    match triangles {
        Triangles::Memory(triangles) => {
            let mut wide = Vec::new();
            for chunk in triangles.chunks(formats::BATCH_RECORDS) {
                wide.clear();
                wide.extend(chunk.iter().map(|triangle| triangle.map(u64::from)));
                visit(&wide)?;
            }
        }
        Triangles::File(file) => {
            let mut scanner = file.scan()?;
            while let Some(batch) = scanner.next_batch()? {
                visit(batch)?;
            }
        }
    }
    Ok(())
}
