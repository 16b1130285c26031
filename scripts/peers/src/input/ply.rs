//! PLY: any encoding and layout value by value, and the usual little-endian layouts
//! (`float` coordinates, `uchar`-counted lists of 32-bit indices) block by block.

use super::block::BlockReader;
use super::obj::fan;
use super::ply_header::{self, Element, Encoding, Scalar};
use crate::Result;
use crate::mesh::{Mesh, Origin};
use std::fs::File;
use std::io::Read;

/// Reads the vertices and faces; polygons become fans.
///
/// # Errors
/// Names the element that is missing or cut short.
pub fn read(file: File, origin: Origin) -> Result<Mesh> {
    let file_bytes = file.metadata()?.len();
    let mut reader = BlockReader::new(file);
    let header = ply_header::read(&mut reader)?;
    // A record has a byte at least: memory is never taken for what cannot be there.
    if let Some(element) = header.elements.iter().find(|e| e.count as u64 > file_bytes) {
        return Err(format!("{} {:?} in {file_bytes} bytes", element.count, element.name).into());
    }
    let mut values = Values::new(reader, header.encoding)?;
    let mut points = Points::Narrow(Vec::new());
    let mut triangles = Vec::new();
    for element in &header.elements {
        match element.name.as_str() {
            "vertex" => points = read_points(&mut values, element)?,
            "face" => triangles = read_triangles(&mut values, element)?,
            _ => skip(&mut values, element)?,
        }
    }
    Ok(match points {
        Points::Narrow(points) => Mesh::from_narrow(points, triangles, origin),
        Points::Wide(points) => Mesh::from_wide(&points, triangles, origin),
    })
}

enum Points {
    Narrow(Vec<[f32; 3]>),
    Wide(Vec<[f64; 3]>),
}

fn read_points<R: Read>(values: &mut Values<R>, element: &Element) -> Result<Points> {
    let place = |name| element.position(&[name]).ok_or(format!("vertices have no {name}"));
    let places = [place("x")?, place("y")?, place("z")?];
    let float = places.iter().all(|&p| element.properties[p].item == Scalar::F32);
    if let (Values::LittleEndian(reader), true, Some(record_bytes)) =
        (&mut *values, float, element.record_bytes())
    {
        let offset = |place| element.properties[..place].iter().map(|p| p.item.size_bytes()).sum();
        let points = read_float_points(reader, element.count, record_bytes, places.map(offset))?;
        return Ok(Points::Narrow(points));
    }
    let mut points = Vec::new();
    let mut record = Vec::new();
    for _ in 0..element.count {
        values.record(element, &mut record)?;
        points.push(places.map(|p| record[p].first().copied().unwrap_or(f64::NAN)));
    }
    Ok(Points::Wide(points))
}

fn read_float_points<R: Read>(
    reader: &mut BlockReader<R>,
    count: usize,
    record_bytes: usize,
    offsets: [usize; 3],
) -> Result<Vec<[f32; 3]>> {
    if record_bytes == 12 && offsets == [0, 4, 8] {
        let mut points = vec![[0.0; 3]; count];
        reader.read_exact(bytemuck::cast_slice_mut(&mut points))?;
        return Ok(points);
    }
    let mut points = Vec::with_capacity(count);
    while points.len() < count {
        let block = reader.need(record_bytes)?;
        let records = (block.len() / record_bytes).min(count - points.len());
        let bytes = records * record_bytes;
        points.extend(block[..bytes].chunks_exact(record_bytes).map(|record| {
            offsets.map(|at| bytemuck::pod_read_unaligned::<f32>(&record[at..at + 4]))
        }));
        reader.consume(bytes);
    }
    Ok(points)
}

fn read_triangles<R: Read>(values: &mut Values<R>, element: &Element) -> Result<Vec<[u32; 3]>> {
    let place = element
        .position(&["vertex_indices", "vertex_index"])
        .ok_or("faces have no vertex indices")?;
    let list = &element.properties[place];
    let usual = element.properties.len() == 1
        && list.length == Some(Scalar::U8)
        && matches!(list.item, Scalar::I32 | Scalar::U32);
    if let (Values::LittleEndian(reader), true) = (&mut *values, usual) {
        return read_usual_triangles(reader, element.count);
    }
    let mut triangles = Vec::new();
    let mut record = Vec::new();
    let mut polygon = Vec::new();
    for _ in 0..element.count {
        values.record(element, &mut record)?;
        polygon.clear();
        // A negative index becomes one that is too large, which the range check finds.
        polygon.extend(record[place].iter().map(|&v| if v < 0.0 { u32::MAX } else { v as u32 }));
        triangles.extend(fan(&polygon));
    }
    Ok(triangles)
}

/// Reads faces of which each is a `uchar` length and as many 32-bit indices.
fn read_usual_triangles<R: Read>(
    reader: &mut BlockReader<R>,
    count: usize,
) -> Result<Vec<[u32; 3]>> {
    const TRIANGLE_BYTES: usize = 13;
    let mut triangles = Vec::with_capacity(count);
    let mut left = count;
    while left > 0 {
        // A run of triangles first, as nearly always all faces are.
        let block = reader.peek(TRIANGLE_BYTES)?;
        let records = (block.len() / TRIANGLE_BYTES).min(left);
        let before = triangles.len();
        triangles.extend(
            block[..records * TRIANGLE_BYTES]
                .chunks_exact(TRIANGLE_BYTES)
                .take_while(|record| record[0] == 3)
                .map(|record| bytemuck::pod_read_unaligned::<[u32; 3]>(&record[1..])),
        );
        let run = triangles.len() - before;
        reader.consume(run * TRIANGLE_BYTES);
        left -= run;
        if run < records || records == 0 {
            let corners = usize::from(reader.need(1)?[0]);
            let size_bytes = 1 + 4 * corners;
            let polygon: Vec<u32> = reader.need(size_bytes)?[1..size_bytes]
                .chunks_exact(4)
                .map(bytemuck::pod_read_unaligned)
                .collect();
            triangles.extend(fan(&polygon));
            reader.consume(size_bytes);
            left -= 1;
        }
    }
    Ok(triangles)
}

fn skip<R: Read>(values: &mut Values<R>, element: &Element) -> Result<()> {
    let mut record = Vec::new();
    (0..element.count).try_for_each(|_| values.record(element, &mut record))
}

/// The numbers after the header, one after the other.
enum Values<R> {
    LittleEndian(BlockReader<R>),
    BigEndian(BlockReader<R>),
    Text { text: Vec<u8>, at: usize },
}

impl<R: Read> Values<R> {
    fn new(mut reader: BlockReader<R>, encoding: Encoding) -> Result<Self> {
        Ok(match encoding {
            Encoding::LittleEndian => Self::LittleEndian(reader),
            Encoding::BigEndian => Self::BigEndian(reader),
            Encoding::Text => {
                let mut text = Vec::new();
                loop {
                    let block = reader.peek(1)?;
                    if block.is_empty() {
                        break Self::Text { text, at: 0 };
                    }
                    text.extend_from_slice(block);
                    let read = block.len();
                    reader.consume(read);
                }
            }
        })
    }

    /// Reads one record; a property that is no list is one of length one.
    fn record(&mut self, element: &Element, record: &mut Vec<Vec<f64>>) -> Result<()> {
        record.resize(element.properties.len(), Vec::new());
        for (property, values) in element.properties.iter().zip(record) {
            let mut left = match property.length {
                Some(kind) => self.next(kind)?,
                None => 1.0,
            };
            values.clear();
            while left >= 1.0 {
                values.push(self.next(property.item)?);
                left -= 1.0;
            }
        }
        Ok(())
    }

    fn next(&mut self, kind: Scalar) -> Result<f64> {
        let size_bytes = kind.size_bytes();
        let mut bytes = [0; 8];
        match self {
            Self::LittleEndian(reader) | Self::BigEndian(reader) => {
                bytes[..size_bytes].copy_from_slice(&reader.need(size_bytes)?[..size_bytes]);
                reader.consume(size_bytes);
            }
            Self::Text { text, at } => return next_word(text, at),
        }
        if matches!(self, Self::BigEndian(_)) {
            bytes[..size_bytes].reverse();
        }
        let [a, b, c, d, ..] = bytes;
        Ok(match kind {
            Scalar::I8 => i8::from_le_bytes([a]).into(),
            Scalar::U8 => a.into(),
            Scalar::I16 => i16::from_le_bytes([a, b]).into(),
            Scalar::U16 => u16::from_le_bytes([a, b]).into(),
            Scalar::I32 => i32::from_le_bytes([a, b, c, d]).into(),
            Scalar::U32 => u32::from_le_bytes([a, b, c, d]).into(),
            Scalar::F32 => f32::from_le_bytes([a, b, c, d]).into(),
            Scalar::F64 => f64::from_le_bytes(bytes),
        })
    }
}

fn next_word(text: &[u8], at: &mut usize) -> Result<f64> {
    let rest = &text[*at..];
    let blank = rest.iter().take_while(|b| b.is_ascii_whitespace()).count();
    let length = rest[blank..].iter().take_while(|b| !b.is_ascii_whitespace()).count();
    let word = std::str::from_utf8(&rest[blank..blank + length])?;
    *at += blank + length;
    word.parse().map_err(|_| format!("{word:?} is not a number").into())
}
