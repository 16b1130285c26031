//! The lines of an OBJ file, one statement each, into batches. Works on slices of whole lines and
//! never reads.

use super::{
    colors::Colors,
    faces::{Corners, Greatest},
};
use crate::{
    error::{Fault, Position},
    formats::{
        BATCH_RECORDS, Batch, Content, DefectKind, Findings, OnDefect, Origin,
        cursor::{Cursor, shorten},
    },
};

/// Statements nobody knows are named as dropped, as long as they look like statements and there
/// are not more kinds than this; chosen by hand: a file that is no OBJ soon exceeds it.
const UNKNOWN_MAX: usize = 16;
/// Bytes of the longest word that looks like a statement; chosen by hand.
const STATEMENT_BYTES_MAX: usize = 24;

/// What is known between two lines.
pub(super) struct Parser {
    pub(super) on_defect: OnDefect,
    pub(super) origin: Origin,
    pub(super) colors: Colors,
    /// `v` lines so far.
    pub(super) vertices: u64,
    /// `f` lines so far, the ones left out included.
    pub(super) faces: u64,
    pub(super) greatest: Greatest,
    pub(super) findings: Findings,
    corners: Corners,
    /// Defects of the slice under way, whose lines are not known yet.
    noted: Vec<Noted>,
    /// Kinds of attributes already named in `findings`.
    named: u8,
    unknown: usize,
}

/// Defects of one kind in one slice.
struct Noted {
    kind: DefectKind,
    count: u64,
    /// First occurrence.
    offset: usize,
    record: u64,
}

/// Things that are named as dropped: a bit, so that naming them again costs nothing.
#[derive(Clone, Copy)]
enum Dropped {
    TextureCoordinates = 1,
    Normals = 2,
    Materials = 4,
    Lines = 8,
    Points = 16,
    FreeForm = 32,
    Weights = 64,
    Colors = 128,
}

/// Why [`Parser::parse_lines`] stopped; the cursor stands where it goes on.
#[derive(Debug, PartialEq)]
pub(super) enum Stop {
    /// All lines of the slice are done.
    EndOfLines,
    /// The batch is full, or the next record is of another kind.
    BatchDone,
    /// At the start of a line that continues in the next one.
    Continued,
    /// At something wrong.
    Bad { fault: Fault, record: Option<u64> },
}

impl Parser {
    pub(super) fn new(on_defect: OnDefect, origin: Origin) -> Self {
        Self {
            on_defect,
            origin,
            colors: Colors::Undecided(Vec::new()),
            vertices: 0,
            faces: 0,
            greatest: Greatest::default(),
            findings: Findings::default(),
            corners: Corners::default(),
            noted: Vec::new(),
            named: 0,
            unknown: 0,
        }
    }

    /// Parses lines until there are no more or something comes between. The caller then calls
    /// [`Self::settle`].
    pub(super) fn parse_lines(&mut self, cursor: &mut Cursor<'_>, batch: &mut Batch) -> Stop {
        loop {
            let start = *cursor;
            cursor.skip_blanks();
            let Some(first) = cursor.peek() else { return Stop::EndOfLines };
            let blank_at = |at| matches!(cursor.rest().get(at), Some(b' ' | b'\t'));
            // "fo" is how the first versions of the format spelt "f".
            let old_face = first == b'f' && cursor.rest().get(1) == Some(&b'o') && blank_at(2);
            let blank_follows = blank_at(1) || old_face;
            let parsed = match first {
                b'\n' | b'\r' | b'#' => {
                    cursor.skip_line();
                    continue;
                }
                b'v' if blank_follows => {
                    if !prepare(batch, Content::Vertices) {
                        *cursor = start;
                        return Stop::BatchDone;
                    }
                    cursor.advance(2);
                    self.read_vertex(cursor, batch)
                }
                b'f' if blank_follows => {
                    if !prepare(batch, Content::Faces) {
                        *cursor = start;
                        return Stop::BatchDone;
                    }
                    cursor.advance(2 + usize::from(old_face));
                    self.read_face(cursor, batch, start.offset())
                }
                _ => self.read_other(cursor),
            };
            if let Err(stop) = parsed {
                if is_continued(start.rest()) {
                    *cursor = start;
                    return Stop::Continued;
                }
                return stop;
            }
            if cursor.peek() == Some(b'\n') {
                cursor.advance(1);
            } else {
                cursor.skip_line();
            }
            if batch.count() >= BATCH_RECORDS {
                return Stop::BatchDone;
            }
        }
    }

    /// Ends a slice: `place` tells the places of offsets in it.
    pub(super) fn settle(&mut self, place: impl Fn(usize) -> Position) {
        for noted in self.noted.drain(..) {
            let at = place(noted.offset).in_record(noted.record);
            self.findings.add(noted.kind, noted.count, at);
        }
        if let Some(offset) = self.greatest.offset.take() {
            self.greatest.at = place(offset).in_record(self.greatest.face);
        }
    }

    /// Reads a vertex behind its `v`.
    #[inline]
    fn read_vertex(&mut self, cursor: &mut Cursor<'_>, batch: &mut Batch) -> Result<(), Stop> {
        let record = Some(self.vertices);
        let mut position = [0.0; 3];
        for coordinate in &mut position {
            let Some(number) = cursor.f64() else {
                return Err(Stop::Bad { fault: cursor.fault("a coordinate"), record });
            };
            *coordinate = number;
        }
        let color = if cursor.is_line_end() { None } else { self.read_extras(cursor)? };
        let mut placed = self.origin.place(position);
        if !placed.iter().all(|coordinate| coordinate.is_finite()) {
            if self.on_defect == OnDefect::Fail {
                return Err(Stop::Bad { fault: Fault::NotFinite, record });
            }
            self.note(DefectKind::NotFinite, cursor.offset(), self.vertices);
            placed = [f32::NAN; 3];
        }
        batch.positions.push(placed);
        if !self.colors.take(color, batch) {
            self.name(Dropped::Colors);
        }
        self.vertices += 1;
        Ok(())
    }

    /// What follows the coordinates: a weight, a colour, or both in this order.
    #[cold]
    fn read_extras(&mut self, cursor: &mut Cursor<'_>) -> Result<Option<[f64; 3]>, Stop> {
        let record = Some(self.vertices);
        let mut extras = [0.0; 4];
        let mut count = 0;
        while !cursor.is_line_end() && cursor.peek() != Some(b'#') {
            let before = *cursor;
            let expected = "a weight or a colour";
            match cursor.f64() {
                Some(number) if count < extras.len() => extras[count] = number,
                Some(_) => {
                    return Err(Stop::Bad { fault: before.fault("the end of the line"), record });
                }
                None => return Err(Stop::Bad { fault: cursor.fault(expected), record }),
            }
            count += 1;
        }
        // The weight belongs to rational curves and surfaces, it does not divide the coordinates.
        let [first, second, third, fourth] = extras;
        if matches!(count, 1 | 4) && first != 1.0 {
            self.name(Dropped::Weights);
        }
        match count {
            0 | 1 => Ok(None),
            3 => Ok(Some([first, second, third])),
            4 => Ok(Some([second, third, fourth])),
            _ => Err(Stop::Bad { fault: cursor.fault("a colour of three numbers"), record }),
        }
    }

    /// Reads a face behind its `f`, in the line that starts at `line`.
    #[inline]
    fn read_face(
        &mut self,
        cursor: &mut Cursor<'_>,
        batch: &mut Batch,
        line: usize,
    ) -> Result<(), Stop> {
        let record = Some(self.faces);
        let bad = |fault| Err(Stop::Bad { fault, record });
        if self.corners.read(cursor, self.vertices).is_none() {
            return bad(cursor.fault("a vertex index"));
        }
        let corners = &self.corners;
        if let Some(index) = corners.impossible {
            if self.on_defect == OnDefect::Fail {
                return bad(Fault::IndexOutOfRange { index, vertices: self.vertices });
            }
            self.note(DefectKind::IndexOutOfRange, line, self.faces);
        } else if corners.indices.len() < 3 {
            if cursor.peek().is_none() {
                return bad(Fault::Truncated { inside: "a face" });
            }
            self.note(DefectKind::TooFewCorners, line, self.faces);
        } else {
            batch.faces.push(&corners.indices);
            if corners.greatest > self.greatest.index {
                let (index, face) = (corners.greatest, self.faces);
                self.greatest = Greatest { index, face, offset: Some(line), ..self.greatest };
            }
        }
        self.faces += 1;
        Ok(())
    }

    /// Reads any other statement, none of which has a triangle in it.
    fn read_other(&mut self, cursor: &mut Cursor<'_>) -> Result<(), Stop> {
        let line = *cursor;
        let dropped = match cursor.word().unwrap_or_default() {
            b"vt" => Some(Dropped::TextureCoordinates),
            b"vn" => Some(Dropped::Normals),
            b"usemtl" => Some(Dropped::Materials),
            b"l" => Some(Dropped::Lines),
            b"p" => Some(Dropped::Points),
            b"g" | b"o" | b"s" | b"mg" | b"mtllib" => None,
            b"vp" | b"cstype" | b"deg" | b"bmat" | b"step" | b"curv" | b"curv2" | b"surf"
            | b"parm" | b"trim" | b"hole" | b"scrv" | b"sp" | b"end" | b"con" => {
                Some(Dropped::FreeForm)
            }
            b"v" => {
                let (fault, record) = (cursor.fault("a coordinate"), Some(self.vertices));
                return Err(Stop::Bad { fault, record });
            }
            b"f" => {
                if cursor.peek().is_none() {
                    let (fault, record) = (Fault::Truncated { inside: "a face" }, Some(self.faces));
                    return Err(Stop::Bad { fault, record });
                }
                self.note(DefectKind::TooFewCorners, line.offset(), self.faces);
                self.faces += 1;
                None
            }
            word => return self.read_unknown(word, line),
        };
        if is_continued(line.rest()) {
            return Err(Stop::Continued);
        }
        if let Some(dropped) = dropped {
            self.name(dropped);
        }
        Ok(())
    }

    #[cold]
    fn read_unknown(&mut self, word: &[u8], line: Cursor<'_>) -> Result<(), Stop> {
        let looks_right = word.iter().all(|byte| byte.is_ascii_alphabetic() || *byte == b'_')
            && word.len() <= STATEMENT_BYTES_MAX;
        if is_continued(line.rest()) {
            return Err(Stop::Continued);
        }
        let name = format!("statement {:?}", shorten(word));
        let known = self.findings.dropped.contains(&name);
        if !looks_right || !known && self.unknown >= UNKNOWN_MAX {
            return Err(Stop::Bad { fault: line.fault("an OBJ statement"), record: None });
        }
        self.unknown += usize::from(!known);
        self.findings.drop_attribute(&name);
        Ok(())
    }

    fn name(&mut self, dropped: Dropped) {
        if self.named & dropped as u8 != 0 {
            return;
        }
        self.named |= dropped as u8;
        self.findings.drop_attribute(match dropped {
            Dropped::TextureCoordinates => "texture coordinates",
            Dropped::Normals => "normals",
            Dropped::Materials => "materials",
            Dropped::Lines => "line elements",
            Dropped::Points => "point elements",
            Dropped::FreeForm => "free-form curves and surfaces",
            Dropped::Weights => "vertex weights",
            Dropped::Colors => "vertex colours (the first vertices have none)",
        });
    }

    #[cold]
    fn note(&mut self, kind: DefectKind, offset: usize, record: u64) {
        match self.noted.iter_mut().find(|noted| noted.kind == kind) {
            Some(noted) => noted.count += 1,
            None => self.noted.push(Noted { kind, count: 1, offset, record }),
        }
    }
}

/// Makes `batch` one of `content`; `false` when it has records of another kind.
#[inline]
fn prepare(batch: &mut Batch, content: Content) -> bool {
    if batch.content != content {
        if batch.count() > 0 {
            return false;
        }
        batch.content = content;
    }
    true
}

/// Whether the line at the start of `text` ends in a backslash. Comments are not asked: a path in
/// one may end so, and must not swallow a line.
fn is_continued(text: &[u8]) -> bool {
    let length = memchr::memchr2(b'\n', b'\r', text).unwrap_or(text.len());
    text[..length].last() == Some(&b'\\')
}
