//! Reads ASCII STL, word by word: line ends mean nothing to it but for the names of solids.

use crate::{
    error::{Fault, Position},
    formats::{
        BATCH_RECORDS, Batch, Content, Declared, DefectKind, Findings, Format, FormatError,
        MeshReader, OnDefect, Origin, ReadOptions, Source,
        cursor::Cursor,
        fault::Result,
        text::{Text, skip_byte_order_mark},
    },
};

/// Reads ASCII STL.
pub(super) struct Reader {
    text: Text,
    on_defect: OnDefect,
    origin: Origin,
    declared: Declared,
    findings: Findings,
    state: State,
    /// Corners of the facet under way, as far as they were read.
    corners: [[f64; 3]; 3],
    /// Facets finished, the ones left out included.
    facets: u64,
    /// The first batch, read ahead to learn the origin.
    first: Option<Batch>,
}

/// What the next word means.
#[derive(Clone, Copy, Debug)]
enum State {
    /// The very first word.
    Start,
    /// A word of the name of a solid, which ends with line `line` or where facets begin.
    Name {
        line: u64,
        /// The word before was "facet": with "normal" it begins one, else it was a name.
        facet_seen: bool,
        /// The word "solid" stood in the line of an "endsolid", and may belong to that one's name.
        optional: bool,
    },
    /// Word `step` of a facet; in place of the first, the end of the solid may come.
    Facet { step: usize },
    /// A word of the name after "endsolid" in line `line`, or the next solid. A facet may not
    /// follow; `facet_seen` as above.
    EndName { line: u64, facet_seen: bool },
}

/// A word of a facet.
#[derive(Clone, Copy)]
enum Word {
    /// A keyword in any case.
    Key(&'static str),
    /// A component of the normal, which is computed anew.
    Ignored,
    /// A coordinate: corner and axis.
    Coordinate(usize, usize),
}

/// A facet, word by word.
const FACET: [Word; 21] = {
    use Word::{Coordinate as At, Ignored, Key};
    [
        Key("facet"),
        Key("normal"),
        Ignored,
        Ignored,
        Ignored,
        Key("outer"),
        Key("loop"),
        Key("vertex"),
        At(0, 0),
        At(0, 1),
        At(0, 2),
        Key("vertex"),
        At(1, 0),
        At(1, 1),
        At(1, 2),
        Key("vertex"),
        At(2, 0),
        At(2, 1),
        At(2, 2),
        Key("endloop"),
        Key("endfacet"),
    ]
};

impl Reader {
    /// Reads the first batch.
    pub(super) fn open(mut source: Source, options: &ReadOptions) -> Result<Self> {
        skip_byte_order_mark(&mut source)?;
        let declared = Declared {
            indexed: false,
            vertices: None,
            faces: None,
            colors: false,
            double: false,
            vertices_first: false,
            bounds: None,
        };
        let mut reader = Self {
            text: Text::new(source, 1),
            on_defect: options.on_defect,
            origin: options.origin,
            declared,
            findings: Findings::default(),
            state: State::Start,
            corners: [[0.0; 3]; 3],
            facets: 0,
            first: None,
        };
        let mut first = Batch::default();
        if reader.fill(&mut first)? {
            reader.first = Some(first);
        }
        // Near zero nothing is kept beyond single precision, so there is nothing to write as double.
        reader.declared.double = reader.origin.get() != [0.0; 3];
        Ok(reader)
    }

    fn fill(&mut self, batch: &mut Batch) -> Result<bool> {
        batch.reset(Content::Soup);
        while batch.positions.len() < 3 * BATCH_RECORDS {
            let mut cursor = self.text.cursor()?;
            if cursor.rest().is_empty() {
                self.check_end()?;
                break;
            }
            let stop = match &mut self.state {
                State::Facet { step } => read_facet_words(&mut cursor, step, &mut self.corners),
                _ => Stop::Word,
            };
            let offset = cursor.offset();
            self.text.set_cursor(offset);
            match stop {
                Stop::OutOfWords => {}
                Stop::Facet => self.take_facet(batch)?,
                Stop::Word => self.read_word()?,
                Stop::Bad(expected) => return Err(self.bad_word(expected)?),
            }
        }
        Ok(batch.count() > 0)
    }

    /// Appends the facet that was just finished, or applies the policy to it.
    fn take_facet(&mut self, batch: &mut Batch) -> Result<()> {
        let corners = self.corners.map(|corner| self.origin.place(corner));
        let record = self.facets;
        self.facets += 1;
        if corners.as_flattened().iter().all(|coordinate| coordinate.is_finite()) {
            batch.positions.extend_from_slice(&corners);
            return Ok(());
        }
        // Consumes what was passed, so that lines are counted once.
        self.text.source();
        let at = self.text.word_place().in_record(record);
        if self.on_defect == OnDefect::Fail {
            return Err(FormatError::input(at, Fault::NotFinite));
        }
        self.findings.add(DefectKind::NotFinite, 1, at);
        Ok(())
    }

    /// Reads one word outside of facets: names, and what begins and ends solids.
    fn read_word(&mut self) -> Result<()> {
        // Consumes what was passed, so that lines are counted once and not from the block's start.
        self.text.source();
        let here = self.text.word_place().line.unwrap_or_default();
        let mut cursor = self.text.cursor()?;
        let keyword = Keyword::of(cursor.word().unwrap_or_default());
        let behind = cursor.offset();
        let name = State::Name { line: here, facet_seen: false, optional: false };
        let next = match (self.state, keyword) {
            (State::Start, Keyword::Solid) => name,
            (State::Start, _) => return Err(self.bad_word("\"solid\"")?),
            (State::Facet { .. }, Keyword::EndSolid) => {
                State::EndName { line: here, facet_seen: false }
            }
            (State::Facet { .. }, _) => return Err(self.bad_word("\"facet\" or \"endsolid\"")?),
            (State::Name { line, optional, .. }, _) if line != here => {
                let another = optional && keyword == Keyword::Solid;
                self.state = if another { name } else { State::Facet { step: 0 } };
                if another {
                    self.text.set_cursor(behind);
                }
                return Ok(());
            }
            (State::Name { .. }, Keyword::EndSolid) => {
                State::EndName { line: here, facet_seen: false }
            }
            (State::Name { facet_seen: true, .. }, Keyword::Normal) => State::Facet { step: 2 },
            (State::Name { line, optional, .. }, _) => {
                State::Name { line, facet_seen: keyword == Keyword::Facet, optional }
            }
            (State::EndName { line, .. }, Keyword::Solid) => {
                State::Name { line: here, facet_seen: false, optional: line == here }
            }
            (State::EndName { line, facet_seen }, _)
                if line != here || facet_seen && keyword == Keyword::Normal =>
            {
                return Err(self.bad_word("\"solid\"")?);
            }
            (State::EndName { line, .. }, _) => {
                State::EndName { line, facet_seen: keyword == Keyword::Facet }
            }
        };
        self.state = next;
        self.text.set_cursor(behind);
        Ok(())
    }

    /// The input has no more words.
    fn check_end(&mut self) -> Result<()> {
        match self.state {
            State::EndName { .. } | State::Name { optional: true, .. } => Ok(()),
            _ => Err(self.placed(self.text.word_place(), Fault::Truncated { inside: "a solid" })),
        }
    }

    /// The fault of the next word, where `expected` should stand. A word that touches the end of
    /// the input may have been cut.
    fn bad_word(&mut self, expected: &'static str) -> Result<FormatError> {
        let at = self.text.word_place();
        let mut cursor = self.text.cursor()?;
        let fault = cursor.fault(expected);
        let length = cursor.word().map_or(0, <[u8]>::len);
        let cut = self.text.source().peek(length + 1)?.len() == length;
        Ok(self.placed(at, if cut { Fault::Truncated { inside: "a solid" } } else { fault }))
    }

    fn placed(&self, at: Position, fault: Fault) -> FormatError {
        FormatError::input(at.in_record(self.facets), fault)
    }
}

/// Words that mean something outside of facets.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Keyword {
    Solid,
    Facet,
    Normal,
    EndSolid,
    /// Part of a name.
    None,
}

impl Keyword {
    fn of(word: &[u8]) -> Self {
        let keywords = [
            ("solid", Self::Solid),
            ("facet", Self::Facet),
            ("normal", Self::Normal),
            ("endsolid", Self::EndSolid),
        ];
        let found = keywords.iter().find(|(key, _)| word.eq_ignore_ascii_case(key.as_bytes()));
        found.map_or(Self::None, |&(_, keyword)| keyword)
    }
}

/// Why [`read_facet_words`] stopped.
enum Stop {
    /// Behind a facet.
    Facet,
    /// At a word that does not begin a facet.
    Word,
    /// At the end of the words at hand.
    OutOfWords,
    /// At a word that should be something else.
    Bad(&'static str),
}

/// Reads words of a facet from number `step` on, and moves `step`.
fn read_facet_words(
    cursor: &mut Cursor<'_>,
    step: &mut usize,
    corners: &mut [[f64; 3]; 3],
) -> Stop {
    loop {
        cursor.skip_white();
        if cursor.rest().is_empty() {
            return Stop::OutOfWords;
        }
        match FACET[*step] {
            Word::Key(key) => {
                let before = *cursor;
                if !cursor.word().is_some_and(|word| word.eq_ignore_ascii_case(key.as_bytes())) {
                    *cursor = before;
                    return if *step == 0 { Stop::Word } else { Stop::Bad(key) };
                }
            }
            Word::Ignored => {
                cursor.word();
            }
            Word::Coordinate(corner, axis) => match cursor.f64() {
                Some(coordinate) => corners[corner][axis] = coordinate,
                None => return Stop::Bad("a coordinate"),
            },
        }
        *step += 1;
        if *step == FACET.len() {
            *step = 0;
            return Stop::Facet;
        }
    }
}

impl MeshReader for Reader {
    fn format(&self) -> Format {
        Format::Stl
    }

    fn declared(&self) -> &Declared {
        &self.declared
    }

    fn read_batch(&mut self, batch: &mut Batch) -> Result<bool> {
        match self.first.take() {
            Some(first) => {
                *batch = first;
                Ok(true)
            }
            None => self.fill(batch),
        }
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
