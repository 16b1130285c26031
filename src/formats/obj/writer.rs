//! Writes OBJ: `v` and `f` lines, numbers as short as they are exact.

use std::io::Write;

use crate::formats::{
    Batch, Content, MeshWriter, Precision, WriteOptions, block::BlockWriter, fault::Result,
};

/// Bytes of the longest `v` line: three doubles of 24 and three colours of 6 characters, blanks.
const VERTEX_LINE_BYTES_MAX: usize = 128;
/// Bytes of an index with its blank.
const CORNER_BYTES_MAX: usize = 21;

/// Writes an indexed mesh as OBJ.
pub struct Writer<W> {
    output: BlockWriter<W>,
    options: WriteOptions,
    /// Text of each colour value.
    shades: Vec<String>,
}

impl<W: Write + Send> Writer<W> {
    /// Writes the first line.
    ///
    /// # Errors
    /// [`crate::formats::FormatError::Io`].
    pub fn new(output: W, options: &WriteOptions) -> Result<Self> {
        let mut output = BlockWriter::new(output);
        output.extend(b"# written by meshmill\n")?;
        Ok(Self { output, options: *options, shades: (0..=u8::MAX).map(shade).collect() })
    }

    fn write_vertex(&mut self, position: [f32; 3], color: Option<[u8; 4]>) -> Result<()> {
        let mut line = Line { bytes: self.output.reserve(VERTEX_LINE_BYTES_MAX)?, filled: 0 };
        let mut numbers = zmij::Buffer::new();
        line.push(b"v");
        for (coordinate, shift) in position.into_iter().zip(self.options.shift()) {
            line.push(b" ");
            let exact = f64::from(coordinate) + shift;
            let text = match self.options.precision {
                Precision::Double => numbers.format_finite(exact),
                Precision::Single => numbers.format_finite(exact as f32),
            };
            line.push(text.strip_suffix(".0").unwrap_or(text).as_bytes());
        }
        if let Some([red, green, blue, _]) = color {
            for value in [red, green, blue] {
                line.push(b" ");
                line.push(self.shades[usize::from(value)].as_bytes());
            }
        }
        line.push(b"\n");
        let unused = VERTEX_LINE_BYTES_MAX - line.filled;
        self.output.give_back(unused);
        Ok(())
    }

    /// In pieces: a polygon has any number of corners.
    fn write_face(&mut self, corners: &[u64]) -> Result<()> {
        let mut numbers = itoa::Buffer::new();
        for (number, piece) in corners.chunks(1024).enumerate() {
            let length = 2 + piece.len() * CORNER_BYTES_MAX;
            let mut line = Line { bytes: self.output.reserve(length)?, filled: 0 };
            if number == 0 {
                line.push(b"f");
            }
            for corner in piece {
                line.push(b" ");
                line.push(numbers.format(corner + 1).as_bytes());
            }
            let unused = length - line.filled;
            self.output.give_back(unused);
        }
        self.output.extend(b"\n")
    }
}

impl<W: Write + Send> MeshWriter for Writer<W> {
    fn write_batch(&mut self, batch: &Batch) -> Result<()> {
        assert_ne!(batch.content, Content::Soup, "OBJ holds vertices and faces");
        for (index, &position) in batch.positions.iter().enumerate() {
            let color = batch.colors.get(index).copied().unwrap_or([255; 4]);
            self.write_vertex(position, self.options.colors.then_some(color))?;
        }
        for corners in batch.faces.iter() {
            self.write_face(corners)?;
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<Option<Vec<u8>>> {
        self.output.finish()?;
        Ok(None)
    }
}

/// A line being filled in.
struct Line<'a> {
    bytes: &'a mut [u8],
    filled: usize,
}

impl Line<'_> {
    #[inline]
    fn push(&mut self, text: &[u8]) {
        self.bytes[self.filled..self.filled + text.len()].copy_from_slice(text);
        self.filled += text.len();
    }
}

/// A colour value as a number of 0–1 with four digits, rounded up: readers that round it to 8 bits
/// and readers that cut it off find the same value again.
fn shade(value: u8) -> String {
    let text = format!("{:.4}", (f64::from(value) / 255.0 * 1e4).ceil() / 1e4);
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text_of(batches: &[Batch], options: &WriteOptions) -> String {
        let mut bytes = Vec::new();
        let mut writer = Writer::new(&mut bytes, options).unwrap();
        for batch in batches {
            writer.write_batch(batch).unwrap();
        }
        assert_eq!(writer.finish().unwrap(), None);
        String::from_utf8(bytes).unwrap()
    }

    const PLAIN: WriteOptions =
        WriteOptions { precision: Precision::Single, origin: [0.0; 3], colors: false };

    #[test]
    fn numbers_are_short_and_indices_start_at_one() {
        let positions = vec![[1.0, -0.1, 1e30], [0.0, 2.5e-9, -3.0], [f32::MAX, -0.0, 7.0]];
        let vertices = Batch { positions, ..Batch::default() };
        let mut faces = Batch { content: Content::Faces, ..Batch::default() };
        faces.faces.push(&[0, 1, 2]);
        faces.faces.push(&[2, 1, 0, 1]);
        let text = text_of(&[vertices, faces], &PLAIN);
        let expected = "# written by meshmill\nv 1 -0.1 1e+30\nv 0 2.5e-9 -3\nv 3.4028235e+38 -0 7\n\
                        f 1 2 3\nf 3 2 1 2\n";
        assert_eq!(text, expected);
    }

    #[test]
    fn the_origin_comes_back_with_all_its_digits() {
        let options =
            WriteOptions { precision: Precision::Double, origin: [5e6, 0.0, -1e9], ..PLAIN };
        let vertices = Batch { positions: vec![[0.125, 0.1, 0.25]], ..Batch::default() };
        let text = text_of(&[vertices], &options);
        assert!(text.ends_with("v 5000000.125 0.10000000149011612 -999999999.75\n"), "{text}");
    }

    #[test]
    fn colours_survive_rounding_and_cutting_off() {
        for value in 0..=u8::MAX {
            let number: f64 = shade(value).parse().unwrap();
            assert_eq!((number * 255.0).round() as u8, value);
            assert_eq!((number * 255.0) as u8, value);
            assert!(number <= 1.0);
        }
        let options = WriteOptions { colors: true, ..PLAIN };
        let vertices = Batch {
            positions: vec![[0.0; 3]; 2],
            colors: vec![[255, 0, 51, 255], [1, 2, 3, 4]],
            ..Batch::default()
        };
        let text = text_of(&[vertices], &options);
        assert!(text.ends_with("v 0 0 0 1 0 0.2\nv 0 0 0 0.004 0.0079 0.0118\n"), "{text}");
    }

    #[test]
    fn a_face_of_any_number_of_corners_is_one_line() {
        let corners: Vec<u64> = (0..50_000).collect();
        let mut faces = Batch { content: Content::Faces, ..Batch::default() };
        faces.faces.push(&corners);
        let text = text_of(&[faces], &PLAIN);
        let line = text.lines().nth(1).unwrap();
        let read: Vec<u64> = line[2..].split(' ').map(|word| word.parse().unwrap()).collect();
        assert!(read.iter().zip(&corners).all(|(read, corner)| *read == corner + 1));
        assert_eq!(read.len(), corners.len());
    }
}
