//! Soup to indexed mesh: equal positions become one vertex.
//!
//! Vertices are numbered in the order in which the triangles first use them, and a vertex keeps
//! the attributes of its first use; −0 equals +0. In memory by a hash map when that fits the
//! budget, otherwise by three external sorts, with the same result.

use hashbrown::HashTable;
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

use crate::{
    error::Result,
    external::{Keyed, sort},
    formats::Findings,
    geometry::ordered_f32,
    progress::{Monitor, StageId},
    soup::{Column, IndexedMesh, Scratch, Source, Triangles, Vertex},
    storage::{Record, RecordFile, RecordWriter, Workspace},
};

/// What welding did.
pub struct Outcome<V> {
    /// The mesh, triangles in the order of the source.
    pub mesh: IndexedMesh<V>,
    /// What the pass over the source found.
    pub findings: Findings,
}

/// Bytes that welding a triangle takes in memory at most: three indices, and if no two triangles
/// touch, three vertices with their places in a hash table that is half full.
const MEMORY_BYTES_PER_TRIANGLE: u64 = 12 + 3 * (16 + 12);
/// Least memory of the external sorts.
const SORT_BYTES_MIN: u64 = 4 << 20;

/// Welds the triangles of `source`.
///
/// # Errors
/// What reading the source fails with, a full disk, cancellation.
pub fn reindex<V: Vertex>(
    source: &Source<V>,
    workspace: &Workspace,
    monitor: &Monitor,
) -> Result<Outcome<V>> {
    let needed = source.records().map(|count| count.saturating_mul(MEMORY_BYTES_PER_TRIANGLE));
    match needed.and_then(|bytes| workspace.budget().reserve(bytes)) {
        Some(_room) => in_memory(source, monitor),
        None => on_disk(source, workspace, monitor),
    }
}

/// Position with −0 as +0, to compare bit by bit.
fn position_bits<V: Vertex>(vertex: &V) -> [u32; 3] {
    vertex.position().map(|coordinate| (coordinate + 0.0).to_bits())
}

fn hash(bits: [u32; 3]) -> u64 {
    let low = u64::from(bits[0]) << 32 | u64::from(bits[1]);
    let mixed = (low ^ u64::from(bits[2]).rotate_left(17)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    (mixed ^ mixed >> 29).wrapping_mul(0xBF58_476D_1CE4_E5B9)
}

fn in_memory<V: Vertex>(source: &Source<V>, monitor: &Monitor) -> Result<Outcome<V>> {
    let meter = monitor.meter(StageId::Weld, source.amount());
    let pass = source.pass();
    let (mut vertices, mut triangles): (Vec<V>, Vec<[u32; 3]>) = Default::default();
    let mut numbers: HashTable<u32> = HashTable::new();
    let mut scratch = Scratch::default();
    while let Some(taken) = pass.next(&mut scratch)? {
        for triangle in taken.triangles {
            triangles.push(triangle.0.map(|vertex| {
                let bits = position_bits(&vertex);
                let same = |number: &u32| position_bits(&vertices[*number as usize]) == bits;
                if let Some(number) = numbers.find(hash(bits), same) {
                    return *number;
                }
                let number = vertices.len() as u32;
                vertices.push(vertex);
                let rehash = |number: &u32| hash(position_bits(&vertices[*number as usize]));
                numbers.insert_unique(hash(bits), number, rehash);
                number
            }));
        }
        meter.add(taken.records)?;
    }
    meter.finish();
    let mesh =
        IndexedMesh { vertices: Column::Memory(vertices), triangles: Triangles::Memory(triangles) };
    Ok(Outcome { mesh, findings: pass.finish() })
}

/// A corner with its position, sorted by position; ties keep the order of the corners.
#[derive(Clone, Copy, FromBytes, IntoBytes, Immutable, KnownLayout)]
#[repr(C)]
struct Use {
    corner: [u32; 2],
    position: [f32; 3],
    color: [u8; 4],
}

impl Record for Use {
    const KIND: [u8; 4] = *b"USE ";
}

impl Keyed for Use {
    type Key = u128;

    fn key(&self) -> u128 {
        let bits = self.position.map(|coordinate| u128::from(ordered_f32(coordinate + 0.0)));
        bits[0] << 64 | bits[1] << 32 | bits[2]
    }
}

/// A corner with the first corner that has its position, sorted by that.
#[derive(Clone, Copy, FromBytes, IntoBytes, Immutable, KnownLayout)]
#[repr(C)]
struct Link {
    first: u64,
    corner: u64,
    position: [f32; 3],
    color: [u8; 4],
}

impl Record for Link {
    const KIND: [u8; 4] = *b"LINK";
}

impl Keyed for Link {
    type Key = u128;

    fn key(&self) -> u128 {
        u128::from(self.first) << 64 | u128::from(self.corner)
    }
}

/// A corner with the number of its vertex, sorted by corner.
#[derive(Clone, Copy, FromBytes, IntoBytes, Immutable, KnownLayout)]
#[repr(C)]
struct Numbered {
    corner: u64,
    vertex: u64,
}

impl Record for Numbered {
    const KIND: [u8; 4] = *b"NUMB";
}

impl Keyed for Numbered {
    type Key = u64;

    fn key(&self) -> u64 {
        self.corner
    }
}

/// What welding on disk is called in the journal of its workspace: what the pass over the source
/// found, the three sorts, and the vertices.
const FOUND: &str = "weld: found";
const USES: &str = "weld: corners by position";
const LINKS: &str = "weld: corners by first use";
const NUMBERED: &str = "weld: vertices by corner";
const VERTICES: &str = "weld: vertices";

fn on_disk<V: Vertex>(
    source: &Source<V>,
    workspace: &Workspace,
    monitor: &Monitor,
) -> Result<Outcome<V>> {
    // Two sorters are open at a time.
    let memory = workspace.budget().reserve_share(1.0, SORT_BYTES_MIN);
    let config = |step| sort::Config {
        stage: StageId::Weld,
        memory_bytes: memory.bytes() / 2,
        engine: sort::Engine::Auto,
        step: Some(step),
    };
    let room = (workspace, monitor);
    let noted = recall_vertices::<V>(workspace)?;
    let mut findings = None;
    let (vertices, mut numbered) = if let Some(vertices) = noted {
        (vertices, sort::Sorter::<Numbered>::noted(&config(NUMBERED), workspace, monitor)?)
    } else {
        let mut links = sort::Sorter::<Link>::noted(&config(LINKS), workspace, monitor)?;
        if !links.is_filled() {
            let mut uses = sort::Sorter::<Use>::noted(&config(USES), workspace, monitor)?;
            findings = Some(push_uses(source, &mut uses, room)?);
            uses.end_input()?;
            push_links::<V>(uses, &mut links)?;
            links.end_input()?;
        }
        workspace.forget(USES)?;
        let numbered = sort::Sorter::<Numbered>::noted(&config(NUMBERED), workspace, monitor)?;
        number(links, numbered, workspace)?
    };
    numbered.end_input()?;
    workspace.forget(LINKS)?;
    let mut triangles = RecordWriter::<[u64; 3]>::create(workspace, "triangles", None)?;
    let mut corners = Vec::new();
    numbered.finish_into(|batch| {
        corners.extend(batch.iter().map(|numbered| numbered.vertex));
        let whole = corners.len() / 3 * 3;
        for triangle in corners[..whole].chunks_exact(3) {
            triangles.push(&[triangle[0], triangle[1], triangle[2]])?;
        }
        corners.drain(..whole);
        Ok(())
    })?;
    let mesh = IndexedMesh {
        vertices: Column::File(vertices),
        triangles: Triangles::File(triangles.finish()?),
    };
    let noted = || Some(workspace.recall::<Findings>(FOUND)?.figures);
    let findings = findings.or_else(noted).unwrap_or_default();
    Ok(Outcome { mesh, findings })
}

/// The vertices, if a run before this one has numbered all corners.
fn recall_vertices<V: Vertex>(workspace: &Workspace) -> Result<Option<RecordFile<V>>> {
    let recalled = workspace.recall::<()>(VERTICES).filter(|_| workspace.is_noted(NUMBERED));
    recalled.map(|recalled| RecordFile::adopt(workspace, &recalled.files[0])).transpose()
}

/// From corners by position to corners that know the first one with theirs.
fn push_links<V: Vertex>(
    uses: sort::Sorter<'_, Use>,
    links: &mut sort::Sorter<'_, Link>,
) -> Result<()> {
    let mut group: Option<([u32; 3], u64)> = None;
    let mut batch_links = Vec::new();
    uses.finish_into(|batch| {
        batch_links.clear();
        for used in batch {
            let corner = u64::from(used.corner[0]) << 32 | u64::from(used.corner[1]);
            let bits = position_bits(&V::new(used.position, used.color));
            let first = match group {
                Some((known, first)) if known == bits => first,
                _ => corner,
            };
            group = Some((bits, first));
            let (position, color) = (used.position, used.color);
            batch_links.push(Link { first, corner, position, color });
        }
        links.push(&batch_links)
    })
}

/// Numbers the vertices, and with them the corners.
fn number<'a, V: Vertex>(
    links: sort::Sorter<'_, Link>,
    mut numbered: sort::Sorter<'a, Numbered>,
    workspace: &Workspace,
) -> Result<(RecordFile<V>, sort::Sorter<'a, Numbered>)> {
    let mut vertices = RecordWriter::<V>::create(workspace, "vertices", None)?;
    let mut batch_numbered = Vec::new();
    links.finish_into(|batch| {
        batch_numbered.clear();
        for link in batch {
            if link.first == link.corner {
                vertices.push(&V::new(link.position, link.color))?;
            }
            let vertex = vertices.count() - 1;
            batch_numbered.push(Numbered { corner: link.corner, vertex });
        }
        numbered.push(&batch_numbered)
    })?;
    let vertices = vertices.finish()?;
    numbered.end_input()?;
    workspace.note(VERTICES, &(), vec![vertices.kept()])?;
    Ok((vertices, numbered))
}

/// Passes every corner of the source to the first sort.
fn push_uses<V: Vertex>(
    source: &Source<V>,
    uses: &mut sort::Sorter<'_, Use>,
    (workspace, monitor): (&Workspace, &Monitor),
) -> Result<Findings> {
    let recalled = workspace.recall::<Findings>(FOUND).filter(|_| uses.is_filled());
    if let Some(recalled) = recalled {
        return Ok(recalled.figures);
    }
    let meter = monitor.meter(StageId::Weld, source.amount());
    let pass = source.pass();
    let (mut scratch, mut batch, mut corner) = (Scratch::default(), Vec::new(), 0_u64);
    while let Some(taken) = pass.next(&mut scratch)? {
        batch.clear();
        for vertex in taken.triangles.iter().flat_map(|triangle| triangle.0) {
            let halves = [(corner >> 32) as u32, corner as u32];
            let (position, color) = (vertex.position(), vertex.color());
            batch.push(Use { corner: halves, position, color });
            corner += 1;
        }
        uses.push(&batch)?;
        meter.add(taken.records)?;
    }
    meter.finish();
    let findings = pass.finish();
    workspace.note(FOUND, &findings, Vec::new())?;
    Ok(findings)
}
