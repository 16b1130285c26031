//! The reader: element after element, batch after batch.

use std::ops::Range;

use super::{
    super::{
        BATCH_RECORDS, Batch, Content, Declared, Format, MeshReader, Origin, ReadOptions,
        fault::{FormatError, Result},
        findings::{DefectKind, Findings},
        source::Source,
        text::Text,
    },
    blocks::{TriangleBlocks, VertexBlocks},
    header::{self, Encoding},
    intake::{Intake, Strip},
    layout::{self, Layout, Role},
    records,
    scalar::ByteOrder,
    values::{Ascii, Binary, Values},
};
use crate::error::Fault;

/// Corners in a batch, about; n-gons end it before [`BATCH_RECORDS`] faces do.
const BATCH_CORNERS: usize = 4 * BATCH_RECORDS;

/// A PLY file under way.
pub struct Reader {
    body: Body,
    /// The elements still to read, the current one last.
    layouts: Vec<Layout>,
    /// Record of the current element that comes next.
    record: u64,
    declared: Declared,
    intake: Intake,
    is_drained: bool,
}

enum Body {
    Binary(Binary),
    Ascii(Ascii),
}

impl Reader {
    /// Reads the header.
    ///
    /// # Errors
    /// When the header breaks the format's rules, or promises more than the input can hold.
    pub fn open(mut source: Source, options: &ReadOptions) -> Result<Self> {
        let header = header::read(&mut source)?;
        let mut findings = Findings::default();
        let mut layouts = layout::layouts(&header, &mut findings)?;
        check_counts(&layouts, header.encoding, options.size_bytes, &source)?;
        let declared = declare(&layouts);
        let origin = if declared.double || options.origin.is_decided() {
            options.origin
        } else {
            Origin::ZERO
        };
        let intake = Intake {
            on_defect: options.on_defect,
            findings,
            origin,
            is_placed: declared.double || origin.get() != [0.0; 3],
            vertices: declared.vertices.unwrap_or_default(),
            corners: Vec::new(),
            strip: Strip::default(),
        };
        let (size_bytes, inside) = (options.size_bytes, "the data");
        let body = match header.encoding {
            Encoding::Binary(order) => {
                Body::Binary(Binary { source, order, size_bytes, inside, record_at: 0 })
            }
            Encoding::Ascii => {
                let text = Text::new(source, header.body_line);
                Body::Ascii(Ascii { text, size_bytes, inside })
            }
        };
        layouts.reverse();
        Ok(Self { body, layouts, record: 0, declared, intake, is_drained: false })
    }

    /// Reads up to a batch of records of the current element; how many are done with.
    fn read_records(&mut self, layout: &Layout, batch: &mut Batch) -> Result<u64> {
        let records = self.record..layout.count;
        match &mut self.body {
            Body::Binary(body) => {
                body.inside = layout.inside;
                read_binary(body, layout, records, &mut self.intake, batch)
            }
            Body::Ascii(body) => {
                body.inside = layout.inside;
                read_values(body, layout, records, &mut self.intake, batch)
            }
        }
    }

    fn drain(&mut self) -> Result<()> {
        let (at, bytes) = match &mut self.body {
            Body::Binary(body) => body.drain()?,
            Body::Ascii(body) => body.drain()?,
        };
        self.intake.findings.add(DefectKind::TrailingBytes, bytes, at);
        self.is_drained = true;
        Ok(())
    }
}

impl MeshReader for Reader {
    fn format(&self) -> Format {
        Format::Ply
    }

    fn declared(&self) -> &Declared {
        &self.declared
    }

    fn read_batch(&mut self, batch: &mut Batch) -> Result<bool> {
        while let Some(layout) = self.layouts.pop() {
            batch.reset(match layout.role {
                Role::Vertices => Content::Vertices,
                _ => Content::Faces,
            });
            // A batch of nothing but bad faces is empty: go on.
            while self.record < layout.count && batch.count() == 0 {
                self.record += self.read_records(&layout, batch)?;
            }
            if self.record < layout.count {
                self.layouts.push(layout);
            } else {
                self.record = 0;
            }
            if batch.count() > 0 {
                return Ok(true);
            }
        }
        if !self.is_drained {
            self.drain()?;
        }
        Ok(false)
    }

    fn findings(&self) -> &Findings {
        &self.intake.findings
    }

    fn origin(&self) -> Origin {
        self.intake.origin
    }

    fn bytes_read(&self) -> u64 {
        match &self.body {
            Body::Binary(body) => body.source.consumed(),
            Body::Ascii(body) => body.text.consumed(),
        }
    }
}

/// The next records of a binary body, by the short cuts where they apply; how many are done.
fn read_binary(
    body: &mut Binary,
    layout: &Layout,
    records: Range<u64>,
    intake: &mut Intake,
    batch: &mut Batch,
) -> Result<u64> {
    match layout.role {
        Role::Vertices => {
            let Some(blocks) = VertexBlocks::new(layout, body.order) else {
                return read_values(body, layout, records, intake, batch);
            };
            let records = at_most(records, BATCH_RECORDS);
            let count = records.end - records.start;
            blocks.read(body, records, intake, batch).map(|()| count)
        }
        Role::Faces => read_faces(body, layout, records, intake, batch),
        Role::Other if layout.is_fixed() => {
            let order = Encoding::Binary(ByteOrder::Little);
            let count = records.end - records.start;
            let bytes = count.saturating_mul(layout.record_bytes_min(order));
            body.source.skip(bytes, body.inside).map(|()| count)
        }
        Role::Strips | Role::Other => read_values(body, layout, records, intake, batch),
    }
}

/// The next faces of a binary body: triangles by the block, others number by number.
fn read_faces(
    body: &mut Binary,
    layout: &Layout,
    records: Range<u64>,
    intake: &mut Intake,
    batch: &mut Batch,
) -> Result<u64> {
    let blocks = TriangleBlocks::new(layout);
    let all = at_most(records, BATCH_RECORDS);
    let mut record = all.start;
    while record < all.end && batch.faces.corners.len() < BATCH_CORNERS {
        let mut done = 0;
        if let Some(blocks) = &blocks {
            done = blocks.read(body, record..all.end, intake, batch)?;
        }
        if done == 0 {
            records::face(body, &layout.steps, record, intake, batch)?;
            done = 1;
        }
        record += done;
    }
    Ok(record - all.start)
}

/// The next records number by number; how many are done.
fn read_values<V: Values>(
    values: &mut V,
    layout: &Layout,
    records: Range<u64>,
    intake: &mut Intake,
    batch: &mut Batch,
) -> Result<u64> {
    let steps = &layout.steps;
    if steps.is_empty() {
        return Ok(records.end - records.start);
    }
    let all = at_most(records, BATCH_RECORDS);
    match layout.role {
        Role::Vertices => {
            let count = all.end - all.start;
            records::vertices(values, steps, all, intake, batch).map(|()| count)
        }
        Role::Faces => {
            let mut record = all.start;
            while record < all.end && batch.faces.corners.len() < BATCH_CORNERS {
                records::face(values, steps, record, intake, batch)?;
                record += 1;
            }
            Ok(record - all.start)
        }
        Role::Strips => {
            let mut record = all.start;
            while record < all.end && batch.faces.count() < BATCH_RECORDS {
                if records::strip(values, steps, BATCH_RECORDS, intake, batch)? {
                    record += 1;
                }
            }
            Ok(record - all.start)
        }
        Role::Other => {
            let count = all.end - all.start;
            all.into_iter().try_for_each(|_| records::skip_record(values, steps)).map(|()| count)
        }
    }
}

/// The first `count` of `records`, or all.
fn at_most(records: Range<u64>, count: usize) -> Range<u64> {
    records.start..records.end.min(records.start + count as u64)
}

/// Refuses counts that the rest of the input cannot hold.
fn check_counts(
    layouts: &[Layout],
    encoding: Encoding,
    size_bytes: Option<u64>,
    source: &Source,
) -> Result<()> {
    let Some(size) = size_bytes else { return Ok(()) };
    // The last number of a text may end with the input.
    let slack = u64::from(encoding == Encoding::Ascii);
    let mut left = size.saturating_sub(source.consumed()) + slack;
    for layout in layouts {
        let each = layout.record_bytes_min(encoding);
        if each == 0 {
            continue;
        }
        if layout.count > left / each {
            let what = match layout.role {
                Role::Vertices => "the number of vertices",
                Role::Faces => "the number of faces",
                Role::Strips => "the number of triangle strips",
                Role::Other => "the length of an element",
            };
            let fault = Fault::CountImpossible { what, count: layout.count, limit: left / each };
            return Err(FormatError::input(layout.at, fault));
        }
        left -= layout.count * each;
    }
    Ok(())
}

fn declare(layouts: &[Layout]) -> Declared {
    let of = |role: Role| layouts.iter().position(|layout| layout.role == role);
    let vertices = of(Role::Vertices).map(|index| &layouts[index]);
    let count_of = |role| of(role).map_or(0, |index| layouts[index].count);
    // How many triangles strips make is not known before they are read.
    let faces = (count_of(Role::Strips) == 0).then(|| count_of(Role::Faces));
    let first_face =
        layouts.iter().position(|l| matches!(l.role, Role::Faces | Role::Strips) && l.count > 0);
    Declared {
        indexed: true,
        vertices: vertices.map(|layout| layout.count),
        faces,
        colors: vertices.is_some_and(Layout::has_colors),
        double: vertices.is_some_and(Layout::is_wider_than_single),
        vertices_first: first_face.is_none_or(|face| of(Role::Vertices) < Some(face)),
        bounds: None,
    }
}
