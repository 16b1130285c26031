//! Indexed mesh to soup, where the vertex table is not in memory `[LS01 Appendix]`.
//!
//! Three ways, decided by measurement: a table in memory is looked into as faces are read, and
//! needs no stage; a table on disk whose indices are local is looked into through a map; one with
//! scattered indices is joined block by block. Triangle order is kept in all of them.

use crate::{
    error::{Position, Result},
    external::join,
    formats::{Batch, DefectKind, Faces, Findings},
    progress::{Monitor, StageId},
    soup::{FaceList, Part, Source, Triangle, Vertex, VertexTable, page_changes, triangulate},
    storage::{RecordFile, RecordScanner, RecordWriter, Workspace},
};

/// Faces looked at to decide whether indices are local.
const FACES_LOOKED_AT: u64 = 1 << 18;
/// Indices are local when at most one corner in this many lies on another page than the one
/// before. A page fault costs about as much as passing 30 corners through a join (measured: 0.5
/// µs against 60 ns a corner, on two passes of which the map saves one).
const CORNERS_PER_PAGE_MIN: u64 = 8;
/// Least memory of a join.
const JOIN_BYTES_MIN: u64 = 4 << 20;

/// Replaces parts whose vertex table is on disk and whose indices are scattered by soups.
///
/// # Errors
/// What reading the faces fails with, a full disk, cancellation.
pub fn dereference<V: Vertex>(
    source: Source<V>,
    workspace: &Workspace,
    monitor: &Monitor,
) -> Result<Source<V>> {
    let Source { parts, mut findings } = source;
    let mut resolved = Vec::with_capacity(parts.len());
    for part in parts {
        let on_disk = matches!(&part, Part::Indexed { vertices: VertexTable::File { .. }, .. });
        let part = if on_disk { resolve(part, &mut findings, workspace, monitor)? } else { part };
        resolved.push(part);
    }
    Ok(Source { parts: resolved, findings })
}

/// Resolves one part, or leaves it when its indices are local.
fn resolve<V: Vertex>(
    part: Part<V>,
    findings: &mut Findings,
    workspace: &Workspace,
    monitor: &Monitor,
) -> Result<Part<V>> {
    let Part::Indexed { vertices: VertexTable::File { records, .. }, faces, has_bad_vertices } =
        &part
    else {
        unreachable!("only parts with a table on disk are resolved");
    };
    if is_local::<V>(faces)? {
        return Ok(part);
    }
    let memory = workspace.budget().reserve_share(1.0, JOIN_BYTES_MIN);
    let config = join::Config { stage: StageId::Dereference, memory_bytes: memory.bytes() };
    let mut join = join::Join::<V>::new(records.file(), &config, workspace, monitor)?;
    let mut sizes = Sizes { faces: 0, polygons: None };
    push_faces(faces, records.file().count(), &mut join, &mut sizes, (findings, workspace))?;
    let mut soup = Soup {
        writer: RecordWriter::create(workspace, "soup", None)?,
        sizes: sizes.polygons.map(RecordWriter::finish).transpose()?,
        only_finite: *has_bad_vertices,
        dropped: 0,
    };
    drop(part);
    soup.fill(join)?;
    findings.add(DefectKind::NotFinite, soup.dropped, Position::default());
    Ok(Part::Stored(soup.writer.finish()?))
}

/// Whether consecutive corners mostly lie on the same pages of the vertex file.
fn is_local<V: Vertex>(faces: &FaceList) -> Result<bool> {
    let (mut corners, mut pages) = (0, 0);
    faces.look_ahead(FACES_LOOKED_AT, |faces| {
        corners += faces.corners.len() as u64;
        pages += page_changes::<V>(&faces.corners);
    })?;
    Ok(corners >= pages * CORNERS_PER_PAGE_MIN)
}

/// Corners of each face, written down from the first polygon on.
struct Sizes {
    faces: u64,
    polygons: Option<RecordWriter<u64>>,
}

impl Sizes {
    fn push(&mut self, faces: &Faces, workspace: &Workspace) -> Result<()> {
        if self.polygons.is_none() && !faces.ends.is_empty() {
            let mut writer = RecordWriter::create(workspace, "face-sizes", None)?;
            (0..self.faces).try_for_each(|_| writer.push(&3))?;
            self.polygons = Some(writer);
        }
        self.faces += faces.count() as u64;
        match &mut self.polygons {
            Some(writer) => faces.iter().try_for_each(|face| writer.push(&(face.len() as u64))),
            None => Ok(()),
        }
    }
}

/// Passes the corners of all faces to the join. Faces that refer to vertices that do not exist
/// are left out and counted.
fn push_faces<V: Vertex>(
    faces: &FaceList,
    vertices: u64,
    join: &mut join::Join<'_, V>,
    sizes: &mut Sizes,
    (findings, workspace): (&mut Findings, &Workspace),
) -> Result<()> {
    let mut scan = faces.scan()?;
    let (mut batch, mut kept, mut record) = (Batch::default(), Faces::default(), 0);
    while scan.read(&mut batch)? {
        let mut good = &batch.faces;
        if good.corners.iter().any(|corner| *corner >= vertices) {
            kept.clear();
            for face in good.iter().filter(|face| face.iter().all(|corner| *corner < vertices)) {
                kept.push(face);
            }
            let at = Position::default().in_record(record);
            let dropped = (good.count() - kept.count()) as u64;
            findings.add(DefectKind::IndexOutOfRange, dropped, at);
            good = &kept;
        }
        record += batch.faces.count() as u64;
        sizes.push(good, workspace)?;
        join.push(&good.corners)?;
    }
    findings.merge(&scan.findings());
    Ok(())
}

/// A soup being made of joined corners.
struct Soup<V: Vertex> {
    writer: RecordWriter<Triangle<V>>,
    sizes: Option<RecordFile<u64>>,
    /// Triangles with a vertex that is not finite are dropped and counted.
    only_finite: bool,
    dropped: u64,
}

impl<V: Vertex> Soup<V> {
    fn fill(&mut self, join: join::Join<'_, V>) -> Result<()> {
        let mut sizes = self.sizes.as_ref().map(FaceSizes::new).transpose()?;
        // Corners of a face that a batch cut in two.
        let (mut corners, mut triangles) = (Vec::new(), Vec::new());
        let (mut positions, mut diagonals) = (Vec::new(), Vec::new());
        join.finish_into(|batch| {
            corners.extend_from_slice(batch);
            triangles.clear();
            let mut start = 0;
            match &mut sizes {
                None => {
                    let whole = corners.chunks_exact(3);
                    triangles.extend(whole.map(|face| Triangle([face[0], face[1], face[2]])));
                    start = corners.len() / 3 * 3;
                }
                Some(sizes) => {
                    while let Some(end) = sizes.end_within(start, corners.len())? {
                        let face = &corners[start..end];
                        triangulate(face, &mut positions, &mut diagonals, &mut triangles);
                        start = end;
                    }
                }
            }
            corners.drain(..start);
            self.write(&mut triangles)
        })
    }

    fn write(&mut self, triangles: &mut Vec<Triangle<V>>) -> Result<()> {
        if self.only_finite {
            let before = triangles.len();
            let finite = |vertex: &V| vertex.position().iter().all(|c| c.is_finite());
            triangles.retain(|triangle| triangle.0.iter().all(finite));
            self.dropped += (before - triangles.len()) as u64;
        }
        self.writer.extend(triangles)
    }
}

/// The sizes of faces, one after the other.
struct FaceSizes {
    scanner: RecordScanner<u64>,
    /// Sizes read and not yet used, last first.
    ahead: Vec<u64>,
}

impl FaceSizes {
    fn new(file: &RecordFile<u64>) -> Result<Self> {
        Ok(Self { scanner: file.scan()?, ahead: Vec::new() })
    }

    /// End of the face that starts at `start`, if it lies within `length`.
    fn end_within(&mut self, start: usize, length: usize) -> Result<Option<usize>> {
        if self.ahead.is_empty()
            && let Some(batch) = self.scanner.next_batch()?
        {
            self.ahead.extend(batch.iter().rev());
        }
        let Some(size) = self.ahead.last() else { return Ok(None) };
        let end = start + *size as usize;
        if end > length {
            return Ok(None);
        }
        self.ahead.pop();
        Ok(Some(end))
    }
}
