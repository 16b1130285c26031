//! The header: elements with counts and properties, as written. It decides nothing about meaning.

use super::{
    super::{
        cursor::{Cursor, shorten},
        fault::{FormatError, Result},
        source::Source,
        text::skip_byte_order_mark,
    },
    scalar::{ByteOrder, Scalar},
};
use crate::error::{Fault, Position};

/// Longest header read. Chosen by hand: ten thousand properties with comments fit.
const HEADER_BYTES_MAX: usize = 1 << 20;

/// How the body is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    Binary(ByteOrder),
}

/// One `element` line and the properties behind it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: u64,
    pub(super) properties: Vec<Property>,
    /// Place of the `element` line.
    pub(super) at: Position,
}

/// One `property` line.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) shape: Shape,
}

/// Whether a property is one number or a counted list of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shape {
    One(Scalar),
    List { count: Scalar, item: Scalar },
}

/// Everything up to and with `end_header`.
#[derive(Clone, Debug)]
pub(super) struct Header {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<Element>,
    /// Lines before the first element that begin with no keyword of the format; some writers
    /// break a comment in two.
    pub(super) unknown_lines: Vec<String>,
    /// Place of the last line.
    pub(super) end: Position,
    /// Line of the first byte of the body.
    pub(super) body_line: u64,
}

/// Reads the header and leaves `source` at the first byte of the body.
pub(super) fn read(source: &mut Source) -> Result<Header> {
    skip_byte_order_mark(source)?;
    if source.is_at_end()? {
        return Err(FormatError::input(source.position(), Fault::Empty));
    }
    let line_end = line_end(source)?;
    let start = source.consumed();
    let mut parser = Parser { encoding: None, elements: Vec::new(), unknown_lines: Vec::new() };
    let mut line = 1;
    loop {
        let at = Position { line: Some(line), record: None, byte: Some(source.consumed()) };
        if source.consumed() - start > HEADER_BYTES_MAX as u64 {
            return Err(FormatError::input(at, Fault::Unsupported("a header of more than 1 MiB")));
        }
        let (length, with_end) = line_length(source, line_end)?;
        let words = &source.buffered()[..length];
        let is_last = parser.line(words, at)?;
        source.consume(with_end);
        line += 1;
        if is_last {
            let Some(encoding) = parser.encoding else {
                return Err(expected("a format line in the header", b"end_header", at));
            };
            let Parser { elements, unknown_lines, .. } = parser;
            return Ok(Header { encoding, elements, unknown_lines, end: at, body_line: line });
        }
    }
}

/// The byte that ends header lines: LF, or CR when the first line ends in a CR alone. It must be
/// one and the same, as the body may begin with a byte that looks like the other.
fn line_end(source: &mut Source) -> Result<u8> {
    let at = Position { line: Some(1), ..source.position() };
    let head = source.peek(64)?;
    let magic = head.starts_with(b"ply") && !head.get(3).is_some_and(u8::is_ascii_alphanumeric);
    if !magic && !b"ply".starts_with(head) {
        let found = &head[..memchr::memchr2(b'\n', b'\r', head).unwrap_or(head.len())];
        return Err(expected("ply", found, at));
    }
    Ok(match memchr::memchr2(b'\n', b'\r', head) {
        Some(at) if head[at] == b'\r' && head.get(at + 1) != Some(&b'\n') => b'\r',
        _ => b'\n',
    })
}

/// Bytes of the next line, without and with its end.
fn line_length(source: &mut Source, line_end: u8) -> Result<(usize, usize)> {
    let mut bytes_min = 1;
    loop {
        let block = source.block(bytes_min)?;
        let length = block.len();
        if let Some(at) = memchr::memchr(line_end, block) {
            return Ok((at, at + 1));
        }
        if length < bytes_min {
            // A body without a byte may follow directly.
            let is_last = Cursor::new(block, 0).word() == Some(b"end_header");
            return if is_last {
                Ok((length, length))
            } else {
                Err(source.truncated("the header"))
            };
        }
        if length > HEADER_BYTES_MAX {
            let fault = Fault::Unsupported("a header of more than 1 MiB");
            return Err(FormatError::input(source.position(), fault));
        }
        bytes_min = length + length / 4 + 1;
    }
}

struct Parser {
    encoding: Option<Encoding>,
    elements: Vec<Element>,
    unknown_lines: Vec<String>,
}

impl Parser {
    /// Takes one line; `true` for the last one.
    fn line(&mut self, line: &[u8], at: Position) -> Result<bool> {
        let mut words = Cursor::new(line.trim_ascii_end(), 0);
        match words.word() {
            None | Some(b"ply" | b"comment" | b"obj_info") => {}
            Some(b"format") => self.format(&mut words, at)?,
            Some(b"element") => self.element(&mut words, at)?,
            Some(b"property") => self.property(&mut words, at)?,
            Some(b"end_header") => return Ok(true),
            // Before the elements nothing can depend on such a line. Later it may be a damaged
            // property, without which every number behind it would be read as another.
            Some(_) if self.elements.is_empty() => {
                self.unknown_lines.push(shorten(line.trim_ascii()));
            }
            Some(word) => return Err(expected("a keyword of the header", word, at)),
        }
        Ok(false)
    }

    fn format(&mut self, words: &mut Cursor<'_>, at: Position) -> Result<()> {
        let name = words.word().unwrap_or_default();
        self.encoding = Some(match name {
            b"ascii" => Encoding::Ascii,
            b"binary_little_endian" => Encoding::Binary(ByteOrder::Little),
            b"binary_big_endian" => Encoding::Binary(ByteOrder::Big),
            _ => {
                let wanted = "ascii, binary_little_endian or binary_big_endian";
                return Err(expected(wanted, name, at));
            }
        });
        match words.word() {
            Some(b"1.0") | None => Ok(()),
            Some(version) => Err(expected("version 1.0", version, at)),
        }
    }

    fn element(&mut self, words: &mut Cursor<'_>, at: Position) -> Result<()> {
        let name = words.word().ok_or_else(|| expected("the name of an element", b"", at))?;
        let text = words.word().unwrap_or_default();
        let count = std::str::from_utf8(text).ok().and_then(|text| text.parse().ok());
        let count = count.ok_or_else(|| expected("the count of an element", text, at))?;
        let name = String::from_utf8_lossy(name).into_owned();
        self.elements.push(Element { name, count, properties: Vec::new(), at });
        Ok(())
    }

    fn property(&mut self, words: &mut Cursor<'_>, at: Position) -> Result<()> {
        let shape = match words.word().unwrap_or_default() {
            b"list" => {
                let count = scalar(words.word().unwrap_or_default(), at)?;
                let item = scalar(words.word().unwrap_or_default(), at)?;
                if !count.is_integer() {
                    return Err(expected("a list count of an integer type", b"a float type", at));
                }
                Shape::List { count, item }
            }
            name => Shape::One(scalar(name, at)?),
        };
        let name = words.word().ok_or_else(|| expected("the name of a property", b"", at))?;
        let name = String::from_utf8_lossy(name).into_owned();
        let element = self.elements.last_mut();
        let element = element.ok_or_else(|| expected("an element line first", b"property", at))?;
        element.properties.push(Property { name, shape });
        Ok(())
    }
}

fn scalar(name: &[u8], at: Position) -> Result<Scalar> {
    Scalar::from_name(name)
        .ok_or_else(|| expected("a type such as uchar, int32 or float", name, at))
}

/// The fault of finding `found` instead.
pub(super) fn expected(expected: &'static str, found: &[u8], at: Position) -> FormatError {
    FormatError::input(at, Fault::Syntax { expected, found: shorten(found) })
}
