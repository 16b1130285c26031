//! Reads OBJ: brings lines to the parser, joins continued ones, and looks at the end whether all
//! faces have their vertices.

use super::statements::{Parser, Stop};
use crate::{
    error::{Fault, Position},
    formats::{
        Batch, Content, Declared, Findings, Format, FormatError, MeshReader, OnDefect, Origin,
        ReadOptions, Source,
        cursor::Cursor,
        fault::Result,
        text::{Text, skip_byte_order_mark},
    },
};

/// Longest line after joining; as long as a line that needs none.
const JOINED_BYTES_MAX: usize = 16 << 20;

/// Reads OBJ.
///
/// Under [`OnDefect::Skip`] faces with positive indices out of range are passed on: whether their
/// vertices are still to come is known at the end only. Whoever resolves them counts them.
pub(in crate::formats) struct Reader {
    text: Text,
    parser: Parser,
    declared: Declared,
    /// A continued line in one piece, and its place; until the batch takes it.
    joined: Option<(Vec<u8>, Position)>,
    /// The first batch, read ahead to learn about colours and the origin.
    first: Option<Batch>,
}

impl Reader {
    /// Reads the first batch.
    pub(in crate::formats) fn open(mut source: Source, options: &ReadOptions) -> Result<Self> {
        skip_byte_order_mark(&mut source)?;
        let declared = Declared {
            indexed: true,
            vertices: None,
            faces: None,
            colors: false,
            double: false,
            vertices_first: false,
            bounds: None,
        };
        let mut reader = Self {
            text: Text::new(source, 1),
            parser: Parser::new(options.on_defect, options.origin),
            declared,
            joined: None,
            first: None,
        };
        let mut first = Batch::default();
        let any = reader.fill(&mut first)?;
        reader.parser.colors.decide(&mut first);
        reader.declared.colors = reader.parser.colors.are_carried();
        // Near zero nothing is kept beyond single precision, so there is nothing to write as double.
        reader.declared.double = reader.parser.origin.get() != [0.0; 3];
        reader.first = any.then_some(first);
        Ok(reader)
    }

    fn fill(&mut self, batch: &mut Batch) -> Result<bool> {
        batch.reset(Content::Vertices);
        loop {
            if self.take_joined(batch)? {
                return Ok(true);
            }
            let lines = self.text.whole_lines()?;
            if lines.is_empty() {
                break;
            }
            let mut cursor = Cursor::new(lines, 0);
            let stop = self.parser.parse_lines(&mut cursor, batch);
            let offset = cursor.offset();
            self.parser.settle(|offset| self.text.place(offset));
            if let Stop::Bad { fault, record } = stop {
                let at = Position { record, ..self.text.place(offset) };
                return Err(FormatError::input(at, fault));
            }
            self.text.consume(offset);
            match stop {
                Stop::BatchDone => return Ok(true),
                Stop::Continued => self.join()?,
                _ => {}
            }
        }
        self.check_indices()?;
        Ok(batch.count() > 0)
    }

    /// Parses the joined line, if there is one; `true` when that ends the batch.
    fn take_joined(&mut self, batch: &mut Batch) -> Result<bool> {
        let Some((line, at)) = &self.joined else { return Ok(false) };
        let mut cursor = Cursor::new(line, 0);
        let stop = self.parser.parse_lines(&mut cursor, batch);
        self.parser.settle(|_| *at);
        if let Stop::Bad { fault, record } = stop {
            return Err(FormatError::input(Position { record, ..*at }, fault));
        }
        debug_assert_ne!(stop, Stop::Continued, "a joined line has no backslash at its end");
        if cursor.offset() > 0 {
            self.joined = None;
        }
        Ok(stop == Stop::BatchDone)
    }

    /// Makes one line of those that end in backslashes and the one after them.
    fn join(&mut self) -> Result<()> {
        let (mut joined, mut place) = (Vec::new(), None);
        loop {
            let Some((line, at)) = self.text.next_line()? else {
                return Err(self.text.source().truncated("a continued line"));
            };
            let at = *place.get_or_insert(at);
            let Some(part) = line.strip_suffix(b"\\") else {
                joined.extend_from_slice(line);
                self.joined = Some((joined, at));
                return Ok(());
            };
            joined.extend_from_slice(part);
            joined.push(b' ');
            if joined.len() > JOINED_BYTES_MAX {
                let found = "a longer one".to_owned();
                let fault = Fault::Syntax { expected: "a line of at most 16 MiB", found };
                return Err(FormatError::input(at, fault));
            }
        }
    }

    fn check_indices(&self) -> Result<()> {
        let (greatest, vertices) = (&self.parser.greatest, self.parser.vertices);
        if self.parser.on_defect == OnDefect::Fail && greatest.index as u64 > vertices {
            let fault = Fault::IndexOutOfRange { index: greatest.index, vertices };
            return Err(FormatError::input(greatest.at, fault));
        }
        Ok(())
    }
}

impl MeshReader for Reader {
    fn format(&self) -> Format {
        Format::Obj
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
        &self.parser.findings
    }

    fn origin(&self) -> Origin {
        self.parser.origin
    }

    fn bytes_read(&self) -> u64 {
        self.text.consumed()
    }
}
