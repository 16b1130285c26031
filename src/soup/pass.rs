//! One pass over a [`Source`], shared by the threads that work on it.
//!
//! Reading is serial, under a lock, and only as much as must be: parsing a batch. Resolving
//! indices happens outside the lock, on the thread that will use the triangles.

use std::sync::{Mutex, PoisonError};

use zerocopy::{FromBytes as _, IntoBytes as _};

use super::{
    FaceList, Part, Source, Triangle, Vertex, VertexTable, faces::FaceScanner, source::ReadAhead,
};
use crate::{
    error::{Position, Result},
    formats::{Batch, Content, DefectKind, Faces, Findings},
    geometry,
    storage::RecordScanner,
};

/// A pass under way. Ask with [`Self::next`] from any number of threads.
pub struct Pass<'a, V> {
    source: &'a Source<V>,
    cursor: Mutex<Cursor<V>>,
    /// What resolving found.
    findings: Mutex<Findings>,
}

/// Where the pass is. Behind the lock.
struct Cursor<V> {
    /// Index of the part being read.
    part: usize,
    open: Option<OpenPart<V>>,
    /// Records delivered so far, over all parts.
    delivered: u64,
    /// The first so many are not handed out.
    passed_over: u64,
    /// Findings of readers that have come to their end.
    findings: Findings,
}

enum OpenPart<V> {
    Reader(ReadAhead),
    Soup(RecordScanner<Triangle<V>>),
    Faces(FaceScanner),
}

/// Memory a thread reuses from batch to batch.
pub struct Scratch<V> {
    raw: Batch,
    triangles: Vec<Triangle<V>>,
    diagonals: Vec<[u32; 3]>,
}

impl<V> Default for Scratch<V> {
    fn default() -> Self {
        Self { raw: Batch::default(), triangles: Vec::new(), diagonals: Vec::new() }
    }
}

impl<V> Scratch<V> {
    /// Leaves out the first `records` of what was read.
    fn drop_front(&mut self, records: usize) {
        self.triangles.drain(..records.min(self.triangles.len()));
        self.raw.drop_front(records);
    }
}

/// A batch of triangles and where it comes from.
pub struct Taken<'s, V> {
    /// Index of the first record (face or soup triangle) of the batch, over all parts.
    pub first_record: u64,
    /// Records read for this batch.
    pub records: u64,
    /// The triangles, in order.
    pub triangles: &'s [Triangle<V>],
}

/// What the lock hands out.
struct Claim {
    part: usize,
    first_record: u64,
    records: u64,
    /// The triangles are already in the scratch.
    resolved: bool,
}

pub(super) fn start<V: Vertex>(source: &Source<V>) -> Pass<'_, V> {
    let findings = source.findings.clone();
    let cursor = Cursor { part: 0, open: None, delivered: 0, passed_over: 0, findings };
    Pass { source, cursor: Mutex::new(cursor), findings: Mutex::default() }
}

impl<V: Vertex> Pass<'_, V> {
    /// The next triangles, `None` when all have been handed out.
    ///
    /// # Errors
    /// What reading and parsing can fail with.
    pub fn next<'s>(&self, scratch: &'s mut Scratch<V>) -> Result<Option<Taken<'s, V>>> {
        let Some(claim) = self.claim(scratch)? else { return Ok(None) };
        let Claim { first_record, records, .. } = claim;
        if claim.resolved {
            let triangles = &scratch.triangles;
            return Ok(Some(Taken { first_record, records, triangles }));
        }
        let triangles = match &self.source.parts[claim.part] {
            Part::Indexed { vertices, has_bad_vertices, .. } => {
                self.resolve(vertices, first_record, scratch)?;
                if *has_bad_vertices {
                    self.drop_bad(first_record, &mut scratch.triangles);
                }
                &scratch.triangles
            }
            _ => soup_triangles(&scratch.raw, &mut scratch.triangles),
        };
        Ok(Some(Taken { first_record, records, triangles }))
    }

    /// Passes over the first `records`, of which `findings` are known: those that resolving found.
    /// Only before anything has been handed out.
    ///
    /// # Errors
    /// What reading and parsing can fail with.
    pub fn skip(&self, records: u64, findings: &Findings) -> Result<()> {
        let mut cursor = self.cursor.lock().unwrap_or_else(PoisonError::into_inner);
        cursor.passed_over = records;
        drop(cursor);
        self.findings.lock().unwrap_or_else(PoisonError::into_inner).merge(findings);
        Ok(())
    }

    /// Records handed out so far, and what resolving them found, once all who asked for some are
    /// done with them.
    #[must_use]
    pub fn position(&self) -> (u64, Findings) {
        let cursor = self.cursor.lock().unwrap_or_else(PoisonError::into_inner);
        let findings = self.findings.lock().unwrap_or_else(PoisonError::into_inner);
        (cursor.delivered, findings.clone())
    }

    /// All findings of this pass; complete when [`Self::next`] has returned `None`.
    #[must_use]
    pub fn finish(self) -> Findings {
        let cursor = self.cursor.into_inner().unwrap_or_else(PoisonError::into_inner);
        let mut findings = cursor.findings;
        findings.merge(&self.findings.into_inner().unwrap_or_else(PoisonError::into_inner));
        findings
    }

    /// Reads the next batch into `scratch`.
    fn claim(&self, scratch: &mut Scratch<V>) -> Result<Option<Claim>> {
        let mut cursor = self.cursor.lock().unwrap_or_else(PoisonError::into_inner);
        let cursor = &mut *cursor;
        while let Some(part) = self.source.parts.get(cursor.part) {
            let open = match &mut cursor.open {
                Some(open) => open,
                none => none.insert(open_part(part)?),
            };
            if read(open, part, scratch)? {
                let resolved = matches!(open, OpenPart::Soup(_));
                let records = if resolved { scratch.triangles.len() } else { scratch.raw.count() };
                let mut records = records as u64;
                let again = cursor.passed_over.saturating_sub(cursor.delivered).min(records);
                cursor.delivered += records;
                if again == records {
                    continue;
                }
                if again > 0 {
                    scratch.drop_front(again as usize);
                    records -= again;
                }
                let first_record = cursor.delivered - records;
                return Ok(Some(Claim { part: cursor.part, first_record, records, resolved }));
            }
            if let Some(OpenPart::Reader(open)) = cursor.open.take() {
                cursor.findings.merge(open.reader.findings());
            }
            cursor.part += 1;
        }
        Ok(None)
    }

    /// Turns the faces in the scratch into triangles.
    fn resolve(
        &self,
        vertices: &VertexTable<V>,
        first_record: u64,
        scratch: &mut Scratch<V>,
    ) -> Result<()> {
        let Scratch { raw, triangles, diagonals } = scratch;
        vertices.note_corners(&raw.faces.corners)?;
        let table = vertices.as_slice();
        triangles.clear();
        let dropped = if raw.faces.ends.is_empty() {
            gather(table, &raw.faces.corners, triangles)
        } else {
            gather_polygons(table, &raw.faces, triangles, diagonals)
        };
        let first = first_record + dropped.first as u64;
        self.count(DefectKind::IndexOutOfRange, dropped.count, first);
        Ok(())
    }

    /// Drops triangles with a vertex that is not finite.
    fn drop_bad(&self, first_record: u64, triangles: &mut Vec<Triangle<V>>) {
        let before = triangles.len();
        triangles.retain(|triangle| {
            triangle.0.iter().all(|v| v.position().iter().all(|c| c.is_finite()))
        });
        self.count(DefectKind::NotFinite, (before - triangles.len()) as u64, first_record);
    }

    fn count(&self, kind: DefectKind, count: u64, first_record: u64) {
        if count > 0 {
            let at = Position::default().in_record(first_record);
            let mut findings = self.findings.lock().unwrap_or_else(PoisonError::into_inner);
            findings.add(kind, count, at);
        }
    }
}

fn open_part<V: Vertex>(part: &Part<V>) -> Result<OpenPart<V>> {
    Ok(match part {
        Part::Soup(reader) | Part::Indexed { faces: FaceList::Input(reader), .. } => {
            OpenPart::Reader(reader.take()?)
        }
        Part::Stored(file) => OpenPart::Soup(file.scan()?),
        Part::Indexed { faces: FaceList::Stored(faces), .. } => OpenPart::Faces(faces.scan()?),
    })
}

/// Reads a batch of faces or triangles; vertices on the way are passed over.
fn read<V: Vertex>(
    open: &mut OpenPart<V>,
    part: &Part<V>,
    scratch: &mut Scratch<V>,
) -> Result<bool> {
    match open {
        OpenPart::Soup(scanner) => {
            let Some(batch) = scanner.next_batch()? else { return Ok(false) };
            scratch.triangles.clear();
            scratch.triangles.extend_from_slice(batch);
            Ok(true)
        }
        OpenPart::Faces(scanner) => {
            scratch.raw.reset(Content::Faces);
            scanner.read(&mut scratch.raw.faces)
        }
        OpenPart::Reader(open) => {
            let (Part::Soup(live) | Part::Indexed { faces: FaceList::Input(live), .. }) = part
            else {
                unreachable!("only these parts have readers");
            };
            open.read(live.input.path.as_path(), &mut scratch.raw)
        }
    }
}

/// Faces of a batch that refer to vertices that do not exist.
#[derive(Default)]
struct Dropped {
    count: u64,
    /// Index of the first one in its batch; 0 without one.
    first: usize,
}

impl Dropped {
    fn add(&mut self, face: usize) {
        if self.count == 0 {
            self.first = face;
        }
        self.count += 1;
    }
}

/// Appends the triangles of `corners`; returns those that refer to vertices that do not exist.
fn gather<V: Vertex>(table: &[V], corners: &[u64], out: &mut Vec<Triangle<V>>) -> Dropped {
    out.reserve(corners.len() / 3);
    let mut dropped = Dropped::default();
    for (index, face) in corners.chunks_exact(3).enumerate() {
        let [a, b, c] = [face[0], face[1], face[2]].map(|index| table.get(index as usize));
        if let (Some(a), Some(b), Some(c)) = (a, b, c) {
            out.push(Triangle([*a, *b, *c]));
        } else {
            dropped.add(index);
        }
    }
    dropped
}

/// As [`gather`], for faces of any size: each is triangulated where it lies.
fn gather_polygons<V: Vertex>(
    table: &[V],
    faces: &Faces,
    out: &mut Vec<Triangle<V>>,
    diagonals: &mut Vec<[u32; 3]>,
) -> Dropped {
    let mut dropped = Dropped::default();
    let (mut polygon, mut positions) = (Vec::new(), Vec::new());
    for (index, face) in faces.iter().enumerate() {
        polygon.clear();
        polygon.extend(face.iter().filter_map(|index| table.get(*index as usize)).copied());
        if polygon.len() < face.len() {
            dropped.add(index);
            continue;
        }
        triangulate(&polygon, &mut positions, diagonals, out);
    }
    dropped
}

/// Appends the triangles of one polygon.
pub(crate) fn triangulate<V: Vertex>(
    polygon: &[V],
    positions: &mut Vec<[f32; 3]>,
    diagonals: &mut Vec<[u32; 3]>,
    out: &mut Vec<Triangle<V>>,
) {
    if let [a, b, c] = polygon {
        out.push(Triangle([*a, *b, *c]));
        return;
    }
    positions.clear();
    positions.extend(polygon.iter().map(Vertex::position));
    diagonals.clear();
    geometry::triangulate(positions, diagonals);
    out.extend(diagonals.iter().map(|t| Triangle(t.map(|corner| polygon[corner as usize]))));
}

/// The triangles of a soup batch: the batch itself where the payload is only a position.
fn soup_triangles<'s, V: Vertex>(
    raw: &'s Batch,
    out: &'s mut Vec<Triangle<V>>,
) -> &'s [Triangle<V>] {
    if size_of::<V>() == size_of::<[f32; 3]>() {
        let whole = <[Triangle<V>]>::ref_from_bytes(raw.positions.as_slice().as_bytes());
        return whole.expect("three positions a triangle, both made of f32");
    }
    out.clear();
    let white = [[255; 4]; 3];
    for (index, corners) in raw.positions.chunks_exact(3).enumerate() {
        let colors = raw.colors.get(3 * index..3 * index + 3).unwrap_or(&white);
        out.push(Triangle(std::array::from_fn(|i| V::new(corners[i], colors[i]))));
    }
    out
}
