//! OFF, ASCII: the plain one and its variants with normals, colours and texture coordinates.
//!
//! How many numbers a vertex has is decided by the keyword and by the first vertex's line.
//! Colours of faces are not carried.

use super::{
    BATCH_RECORDS, Batch, Content, Declared, Format, MeshReader, OnDefect, Origin, ReadOptions,
    Source,
    cursor::Cursor,
    fault::{FormatError, Result},
    findings::{DefectKind, Findings},
    text::{Skipped, Text, skip_byte_order_mark},
};
use crate::error::Fault;

/// Corners of a face that is carried. Chosen by hand, so that one face does not fill the memory.
const CORNERS_MAX: i64 = 1 << 20;

/// Most numbers of a vertex: position, normal, colour, texture coordinates.
const COLUMNS_MAX: usize = 3 + 3 + 4 + 2;

const THE_HEADER: &str = "the header";

/// An OFF file under way.
pub struct Reader {
    text: Text,
    on_defect: OnDefect,
    columns: Columns,
    /// As declared.
    vertices: u64,
    faces: u64,
    /// Records read.
    vertex: u64,
    face: u64,
    corners: Vec<u64>,
    declared: Declared,
    findings: Findings,
    origin: Origin,
}

/// The letters before OFF: what a vertex has besides its position.
#[derive(Clone, Copy, Debug, Default)]
struct Keyword {
    normals: usize,
    colors: usize,
    textures: usize,
}

/// What the numbers of a vertex are.
#[derive(Clone, Copy, Debug)]
struct Columns {
    count: usize,
    /// The colour's columns; 3, 4, or none.
    color_at: usize,
    colors: usize,
    /// 255 for colours that are shares of 1, else 1.
    color_scale: f64,
    /// Every vertex and face has a line of its own.
    is_lined: bool,
}

impl Reader {
    /// Reads the keyword and the counts.
    ///
    /// # Errors
    /// When they break the format's rules, or promise more than the input can hold.
    pub fn open(mut source: Source, options: &ReadOptions) -> Result<Self> {
        skip_byte_order_mark(&mut source)?;
        if source.is_at_end()? {
            return Err(FormatError::input(source.position(), Fault::Empty));
        }
        let mut text = Text::new(source, 1);
        let keyword = read_keyword(&mut text)?;
        let vertices = read_count(&mut text)?;
        let faces = read_count(&mut text)?;
        // The number of edges is left out by some writers, and wrong in many files.
        if !text.is_line_end()? {
            read_count(&mut text)?;
        }
        check_counts(&text, [vertices, faces], options.size_bytes)?;
        let mut findings = Findings::default();
        skip_comments(&mut text)?;
        let lines = text.whole_lines()?;
        let line = &lines[..memchr::memchr2(b'\n', b'\r', lines).unwrap_or(lines.len())];
        let columns = Columns::new(line, keyword, &mut findings);
        // Text has no type: what needs an origin needs more than single precision.
        let mut origin = options.origin;
        let mut first = Cursor::new(line, 0);
        if let (Some(x), Some(y), Some(z)) = (first.f64(), first.f64(), first.f64()) {
            let _ = origin.place([x, y, z]);
        }
        let declared = Declared {
            indexed: true,
            vertices: Some(vertices),
            faces: Some(faces),
            colors: columns.colors > 0,
            double: origin.get() != [0.0; 3],
            vertices_first: true,
            bounds: None,
        };
        let (on_defect, origin) = (options.on_defect, options.origin);
        let (vertex, face, corners) = (0, 0, Vec::new());
        Ok(Self {
            text,
            on_defect,
            columns,
            vertices,
            faces,
            vertex,
            face,
            corners,
            declared,
            findings,
            origin,
        })
    }

    fn read_vertex(&mut self, batch: &mut Batch) -> Result<()> {
        let mut values = [0.0; COLUMNS_MAX];
        for value in &mut values[..self.columns.count] {
            *value = number(&mut self.text)?;
        }
        self.expect_line_end()?;
        let mut placed = self.origin.place([values[0], values[1], values[2]]);
        if !placed.iter().all(|c| c.is_finite()) {
            let at = || self.text.word_place().in_record(self.vertex);
            if self.on_defect == OnDefect::Fail {
                return Err(FormatError::input(at(), Fault::NotFinite));
            }
            self.findings.add_one(DefectKind::NotFinite, at);
            placed = [f32::NAN; 3];
        }
        batch.positions.push(placed);
        if self.columns.colors > 0 {
            let mut color = [u8::MAX; 4];
            let shares = &values[self.columns.color_at..][..self.columns.colors];
            for (channel, share) in color.iter_mut().zip(shares) {
                // The cast saturates.
                *channel = (share * self.columns.color_scale).round() as u8;
            }
            batch.colors.push(color);
        }
        self.vertex += 1;
        Ok(())
    }

    fn read_face(&mut self, batch: &mut Batch) -> Result<()> {
        let count = integer(&mut self.text, "the number of corners", "the faces")?;
        if !(0..=CORNERS_MAX).contains(&count) {
            let fault = match u64::try_from(count) {
                Ok(_) => Fault::Unsupported("a face of more than a million corners"),
                Err(_) => {
                    Fault::Syntax { expected: "a number of corners", found: count.to_string() }
                }
            };
            let at = self.text.word_place().in_record(self.face);
            return Err(FormatError::input(at, fault));
        }
        self.corners.clear();
        for _ in 0..count {
            // Negative indices wrap to the top of the range, which no vertex reaches.
            self.corners.push(integer(&mut self.text, "an index", "the faces")? as u64);
        }
        if self.columns.is_lined && self.text.skip_line()? == Skipped::Words {
            self.findings.drop_attribute("face colours");
        }
        let record = self.face;
        self.face += 1;
        // Of the face's line: counting lines is too much to do for each face.
        let at = || self.text.word_place().in_record(record);
        if count < 3 {
            self.findings.add_one(DefectKind::TooFewCorners, at);
            return Ok(());
        }
        let bad = self.corners.iter().find(|&&index| index >= self.vertices);
        match (bad, self.on_defect) {
            (None, _) => batch.faces.push(&self.corners),
            (Some(&index), OnDefect::Fail) => {
                let (index, vertices) = (index as i64, self.vertices);
                return Err(FormatError::input(at(), Fault::IndexOutOfRange { index, vertices }));
            }
            (Some(_), OnDefect::Skip) => self.findings.add_one(DefectKind::IndexOutOfRange, at),
        }
        Ok(())
    }

    /// A line with other columns than the first one's would shift all that follow.
    fn expect_line_end(&mut self) -> Result<()> {
        if self.columns.is_lined && !self.text.is_line_end()? {
            return Err(self.text.word_fault("the end of the vertex's line", "the vertices"));
        }
        Ok(())
    }
}

impl MeshReader for Reader {
    fn format(&self) -> Format {
        Format::Off
    }

    fn declared(&self) -> &Declared {
        &self.declared
    }

    fn read_batch(&mut self, batch: &mut Batch) -> Result<bool> {
        batch.reset(Content::Vertices);
        while self.vertex < self.vertices && batch.positions.len() < BATCH_RECORDS {
            self.read_vertex(batch)?;
        }
        if batch.count() > 0 {
            return Ok(true);
        }
        batch.reset(Content::Faces);
        while self.face < self.faces && batch.faces.corners.len() < 3 * BATCH_RECORDS {
            self.read_face(batch)?;
        }
        if batch.count() > 0 {
            return Ok(true);
        }
        skip_comments(&mut self.text)?;
        let at = self.text.word_place();
        let bytes = self.text.source().drain()?;
        self.findings.add(DefectKind::TrailingBytes, bytes, at);
        Ok(false)
    }

    fn findings(&self) -> &Findings {
        &self.findings
    }

    fn origin(&self) -> Origin {
        self.origin
    }

    fn bytes_read(&self) -> u64 {
        self.text.consumed()
    }
}

impl Columns {
    /// The columns of a file whose first vertex has the line `line`.
    fn new(line: &[u8], keyword: Keyword, findings: &mut Findings) -> Self {
        let line = &line[..memchr::memchr(b'#', line).unwrap_or(line.len())];
        let words: Vec<_> = line.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty()).collect();
        let others = 3 + 3 * keyword.normals + 2 * keyword.textures;
        let is_lined = (3..=COLUMNS_MAX).contains(&words.len());
        let count = if is_lined { words.len() } else { others + 4 * keyword.colors };
        let (color_at, colors) = (3 + 3 * keyword.normals, count.saturating_sub(others));
        let colors = if keyword.colors == 1 && matches!(colors, 3 | 4) { colors } else { 0 };
        let color_words = words.get(color_at..color_at + colors).unwrap_or_default();
        let is_share = color_words.iter().any(|word| word.contains(&b'.'));
        if keyword.normals > 0 {
            findings.drop_attribute("normals");
        }
        if keyword.textures > 0 {
            findings.drop_attribute("texture coordinates");
        }
        if count > others + colors {
            findings.drop_attribute("vertex values without a name");
        }
        let color_scale = if is_share { 255.0 } else { 1.0 };
        Self { count, color_at, colors, color_scale, is_lined }
    }
}

/// Reads `OFF` with the letters before it; they may be missing altogether.
fn read_keyword(text: &mut Text) -> Result<Keyword> {
    skip_comments(text)?;
    let mut cursor = text.cursor()?;
    let (mut keyword, mut number) = (Keyword::default(), cursor);
    if number.integer().is_some() {
        return Ok(keyword);
    }
    let letters = cursor.word().and_then(|word| word.strip_suffix(b"OFF"));
    let offset = cursor.offset();
    let Some(mut letters) = letters else { return Err(text.word_fault("OFF", THE_HEADER)) };
    while !letters.is_empty() {
        let (count, rest) = match letters {
            [b'S', b'T', rest @ ..] => (&mut keyword.textures, rest),
            [b'C', rest @ ..] => (&mut keyword.colors, rest),
            [b'N', rest @ ..] => (&mut keyword.normals, rest),
            [b'4' | b'n', ..] => {
                let fault = Fault::Unsupported("OFF of other than three dimensions");
                return Err(FormatError::input(text.word_place(), fault));
            }
            _ => return Err(text.word_fault("OFF", THE_HEADER)),
        };
        if *count == 1 {
            return Err(text.word_fault("each letter once before OFF", THE_HEADER));
        }
        (*count, letters) = (1, rest);
    }
    text.set_cursor(offset);
    skip_comments(text)?;
    if text.cursor()?.word() == Some(b"BINARY") {
        return Err(FormatError::input(text.word_place(), Fault::Unsupported("binary OFF")));
    }
    Ok(keyword)
}

/// Refuses counts that the rest of the input cannot hold.
fn check_counts(text: &Text, [vertices, faces]: [u64; 2], size_bytes: Option<u64>) -> Result<()> {
    let Some(size) = size_bytes else { return Ok(()) };
    // Three digits with what divides them, one digit; the last line may have no end.
    let mut left = (size + 1).saturating_sub(text.consumed());
    let parts = [("the number of vertices", vertices, 6), ("the number of faces", faces, 2)];
    for (what, count, each) in parts {
        if count > left / each {
            let fault = Fault::CountImpossible { what, count, limit: left / each };
            return Err(FormatError::input(text.word_place(), fault));
        }
        left -= count * each;
    }
    Ok(())
}

fn read_count(text: &mut Text) -> Result<u64> {
    let count = integer(text, "a count", THE_HEADER)?;
    u64::try_from(count).map_err(|_| {
        let fault = Fault::Syntax { expected: "a count", found: count.to_string() };
        FormatError::input(text.word_place(), fault)
    })
}

/// Moves to the next word that is not in a comment.
#[inline]
fn skip_comments(text: &mut Text) -> Result<()> {
    while text.cursor()?.peek() == Some(b'#') {
        text.skip_line()?;
    }
    Ok(())
}

#[inline]
fn number(text: &mut Text) -> Result<f64> {
    skip_comments(text)?;
    let mut cursor = text.cursor()?;
    let Some(value) = cursor.f64() else { return Err(text.word_fault("a number", "the vertices")) };
    let offset = cursor.offset();
    text.set_cursor(offset);
    Ok(value)
}

#[inline]
fn integer(text: &mut Text, expected: &'static str, inside: &'static str) -> Result<i64> {
    skip_comments(text)?;
    let mut cursor = text.cursor()?;
    let Some(value) = cursor.integer() else { return Err(text.word_fault(expected, inside)) };
    let offset = cursor.offset();
    text.set_cursor(offset);
    Ok(value)
}

#[cfg(test)]
mod tests {
    use super::{super::source::tests::trickle, *};
    use crate::error::Position;

    type Mesh = (Vec<[f32; 3]>, Vec<[u8; 4]>, Vec<Vec<u64>>);

    fn read_stepwise(text: &str, step: usize, on_defect: OnDefect) -> Result<(Mesh, Findings)> {
        let size_bytes = step.is_multiple_of(2).then_some(text.len() as u64);
        let options = ReadOptions { on_defect, origin: Origin::undecided(), size_bytes };
        let mut reader = Reader::open(trickle(text.as_bytes(), step), &options)?;
        let (mut mesh, mut batch) = (Mesh::default(), Batch::default());
        while reader.read_batch(&mut batch)? {
            mesh.0.extend_from_slice(&batch.positions);
            mesh.1.extend_from_slice(&batch.colors);
            mesh.2.extend(batch.faces.iter().map(<[u64]>::to_vec));
        }
        Ok((mesh, reader.findings))
    }

    fn read(text: &str) -> (Mesh, Findings) {
        let all = [1, 2, 7, 1000].map(|step| read_stepwise(text, step, OnDefect::Fail).unwrap());
        assert!(all.iter().all(|each| *each == all[0]), "{all:?}");
        all.into_iter().next().unwrap()
    }

    fn fault(text: &str) -> (Position, Fault) {
        match read_stepwise(text, 1000, OnDefect::Fail).unwrap_err() {
            FormatError::Input(fault) => (fault.at, fault.fault),
            error => panic!("{error:?}"),
        }
    }

    /// A triangle and a quad.
    const OK: &str = "OFF\n5 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n2 0 0\n4 0 1 2 3\n3 1 4 2\n";

    #[test]
    fn the_header_has_many_shapes() {
        let (mesh, findings) = read(OK);
        assert_eq!((mesh.0.len(), &mesh.2), (5, &vec![vec![0, 1, 2, 3], vec![1, 4, 2]]));
        assert_eq!(findings, Findings::default());
        let shapes =
            ["OFF 5 2 0\n", "OFF # five\r\n\r\n# two\r\n5 2\r\n\r\n", "5 2 7\n", "OFF\r5 2 0\r"];
        for shape in shapes {
            assert_eq!(read(&OK.replace("OFF\n5 2 0\n", shape)).0, mesh, "{shape:?}");
        }
        assert_eq!(read(&OK.replace('\n', " ")).0, mesh);
        assert_eq!(read(&OK.replace('\n', " # remark\n")).0, mesh);
    }

    #[test]
    fn colours_of_vertices_are_carried_and_others_named() {
        let text = "CNOFF\n3 1 0\n0 0 0 0 0 1 1 .5 0 1\n1 0 0 0 0 1 0 0 1 1\n\
            0 1 0 0 0 1 1 1 1 0.0\n3 0 1 2 255 0 0 # red\n";
        let (mesh, findings) = read(text);
        assert_eq!(mesh.1, [[255, 128, 0, 255], [0, 0, 255, 255], [255, 255, 255, 0]]);
        assert_eq!(findings.dropped, ["normals", "face colours"]);
        let text = "COFF\n3 1 0\n0 0 0 1 2 3\n1 0 0 4 5 6\n0 1 0 7 8 300\n3 0 1 2\n";
        assert_eq!(read(text).0.1, [[1, 2, 3, 255], [4, 5, 6, 255], [7, 8, 255, 255]]);
        let (mesh, findings) = read(&text.replace("COFF", "OFF"));
        assert!(mesh.1.is_empty());
        assert_eq!(findings.dropped, ["vertex values without a name"]);
    }

    #[test]
    fn every_prefix_fails_cleanly() {
        for length in 0..OK.len() - 1 {
            for step in [1, 2] {
                let result = read_stepwise(&OK[..length], step, OnDefect::Skip);
                let error = result.expect_err("a prefix is no mesh");
                let FormatError::Input(found) = error else { panic!("{error:?}") };
                let is_right = match found.fault {
                    Fault::Truncated { .. } | Fault::CountImpossible { .. } | Fault::Empty => true,
                    Fault::Syntax { .. } => length < 3,
                    _ => false,
                };
                assert!(is_right, "{length}: {found:?}");
            }
        }
    }

    #[test]
    fn what_contradicts_the_header_is_a_fault_with_its_line() {
        let (at, said) = fault(&OK.replace("5 2 0", "353535235358 6 0"));
        assert!(matches!(said, Fault::CountImpossible { count: 353_535_235_358, .. }));
        assert_eq!(at.line, Some(2));
        let (at, said) = fault(&OK.replace("1 4 2", "1 5 2"));
        assert_eq!(said, Fault::IndexOutOfRange { index: 5, vertices: 5 });
        assert_eq!((at.line, at.record), (Some(9), Some(1)));
        assert_eq!(fault(&OK.replace("1 1 0", "1 1")).0.line, Some(6));
        assert_eq!(fault(&OK.replace("1 1 0", "1 nan 0")).1, Fault::NotFinite);
        assert!(matches!(fault("OFF BINARY\n").1, Fault::Unsupported(_)));
        assert!(matches!(fault("4OFF\n").1, Fault::Unsupported(_)));
        let trailing = format!("{OK}# fine\n\n3 0 1 2\n");
        assert_eq!(read(&trailing).1.count(DefectKind::TrailingBytes), 8);
    }

    #[test]
    fn bad_records_can_be_skipped() {
        let text = OK.replace("1 4 2", "1 -4 2").replace("1 1 0", "1 inf 0").replace("4 0", "2 0");
        let (mesh, findings) = read_stepwise(&text, 7, OnDefect::Skip).unwrap();
        assert!(mesh.0[2].iter().all(|c| c.is_nan()) && mesh.2.is_empty());
        let kinds = [DefectKind::NotFinite, DefectKind::TooFewCorners, DefectKind::IndexOutOfRange];
        assert_eq!(kinds.map(|kind| findings.count(kind)), [1; 3]);
    }
}
