//! The header of a PLY file: which elements follow, and how they are laid out.

use super::block::BlockReader;
use crate::Result;
use std::io::Read;

/// How the values after the header are encoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    Text,
    LittleEndian,
    BigEndian,
}

/// The type of one number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    /// Returns the bytes a number of this type takes.
    pub fn size_bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    fn from_name(name: &str) -> Result<Self> {
        Ok(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return Err(format!("the type {name:?} is unknown").into()),
        })
    }
}

/// One property of an element.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Property {
    pub name: String,
    /// The type of the length, if the property is a list.
    pub length: Option<Scalar>,
    pub item: Scalar,
}

/// One kind of record, all of which stand together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Element {
    pub name: String,
    pub count: usize,
    pub properties: Vec<Property>,
}

impl Element {
    /// Returns the bytes of a binary record, if all records have the same.
    pub fn record_bytes(&self) -> Option<usize> {
        self.properties.iter().map(|p| p.length.is_none().then(|| p.item.size_bytes())).sum()
    }

    /// Returns where a property stands in the record.
    pub fn position(&self, names: &[&str]) -> Option<usize> {
        self.properties.iter().position(|p| names.contains(&p.name.as_str()))
    }
}

/// What a PLY file says about itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Header {
    pub encoding: Encoding,
    pub elements: Vec<Element>,
}

/// Reads the header and leaves the reader at the first byte after it.
///
/// # Errors
/// Names the line that cannot be understood.
pub fn read<R: Read>(reader: &mut BlockReader<R>) -> Result<Header> {
    if next_line(reader)? != "ply" {
        return Err("this is not a PLY file".into());
    }
    let mut encoding = None;
    let mut elements: Vec<Element> = Vec::new();
    loop {
        let line = next_line(reader)?;
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        match words[..] {
            ["format", name, _] => encoding = Some(encoding_from_name(name)?),
            ["element", name, count] => elements.push(Element {
                name: name.into(),
                count: count.parse()?,
                properties: Vec::new(),
            }),
            ["property", ref rest @ ..] => {
                let element = elements.last_mut().ok_or("a property precedes all elements")?;
                element.properties.push(property(rest)?);
            }
            ["end_header"] => break,
            ["comment" | "obj_info", ..] | [] => {}
            _ => return Err(format!("the header line {line:?} is not understood").into()),
        }
    }
    Ok(Header { encoding: encoding.ok_or("the header has no format line")?, elements })
}

fn next_line<R: Read>(reader: &mut BlockReader<R>) -> Result<String> {
    let mut wanted = 1;
    let length = loop {
        let bytes = reader.need(wanted)?;
        match bytes.iter().position(|&b| b == b'\n') {
            Some(length) => break length,
            None => wanted = bytes.len() + 1,
        }
    };
    let line = String::from_utf8_lossy(&reader.need(length)?[..length]).trim_end().to_owned();
    reader.consume(length + 1);
    Ok(line)
}

fn encoding_from_name(name: &str) -> Result<Encoding> {
    match name {
        "ascii" => Ok(Encoding::Text),
        "binary_little_endian" => Ok(Encoding::LittleEndian),
        "binary_big_endian" => Ok(Encoding::BigEndian),
        _ => Err(format!("the format {name:?} is unknown").into()),
    }
}

fn property(words: &[&str]) -> Result<Property> {
    let (length, item, name) = match words {
        ["list", length, item, name] => (Some(Scalar::from_name(length)?), item, name),
        [item, name] => (None, item, name),
        _ => return Err(format!("the property {words:?} is not understood").into()),
    };
    Ok(Property { name: (*name).into(), length, item: Scalar::from_name(item)? })
}
