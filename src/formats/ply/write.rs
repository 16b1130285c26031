//! The writer: binary little-endian, one vertex element, then triangles.

use std::io::Write;

use super::super::{
    Batch, Content, Counts, MeshWriter, Precision, WriteOptions,
    fault::{FormatError, Result},
};

/// Bytes handed to the output at once; see storage/writer.rs for the measurement.
const WRITE_BYTES: usize = 256 << 10;

/// Digits of the largest `u64`; the counts of a header share the room for two of them.
const COUNT_DIGITS: usize = 20;

/// Most vertices that indices of type `int` and `uint` can refer to.
const INT_VERTICES_MAX: u64 = (1 << 31) - 1;
const UINT_VERTICES_MAX: u64 = (1 << 32) - 1;

const COLORS: &str =
    "property uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar alpha\n";

/// A PLY file being written.
pub struct Writer<W> {
    out: W,
    buffer: Vec<u8>,
    options: WriteOptions,
    promised: Counts,
    written: Counts,
    /// Largest index plus one.
    referred: u64,
}

impl<W: Write + Send> Writer<W> {
    /// Writes the header for `counts`, which may turn out wrong: see [`MeshWriter::finish`].
    ///
    /// # Errors
    /// [`FormatError::Limit`] before anything is written when there are too many vertices.
    pub fn new(out: W, counts: Counts, options: &WriteOptions) -> Result<Self> {
        check_limit(counts)?;
        let mut buffer = Vec::with_capacity(WRITE_BYTES + (WRITE_BYTES >> 2));
        buffer.extend_from_slice(&header(counts, options));
        let (options, promised, written) = (*options, counts, Counts::default());
        Ok(Self { out, buffer, options, promised, written, referred: 0 })
    }

    fn vertices(&mut self, batch: &Batch) -> Result<()> {
        assert!(self.written.triangles == 0, "vertices come before faces");
        let shift = self.options.shift();
        let colors = self.options.colors.then_some(&batch.colors);
        for (index, position) in batch.positions.iter().enumerate() {
            match self.options.precision {
                Precision::Double => {
                    for axis in 0..3 {
                        let value = f64::from(position[axis]) + shift[axis];
                        self.buffer.extend_from_slice(&value.to_le_bytes());
                    }
                }
                Precision::Single => {
                    let mut bytes = [0; 12];
                    for axis in 0..3 {
                        let value = (f64::from(position[axis]) + shift[axis]) as f32;
                        bytes[4 * axis..4 * axis + 4].copy_from_slice(&value.to_le_bytes());
                    }
                    self.buffer.extend_from_slice(&bytes);
                }
            }
            if let Some(colors) = colors {
                // Where only some inputs have colours, the rest is white.
                self.buffer.extend_from_slice(colors.get(index).unwrap_or(&[u8::MAX; 4]));
            }
            self.flush_above(WRITE_BYTES)?;
        }
        self.written.vertices += batch.positions.len() as u64;
        Ok(())
    }

    fn faces(&mut self, batch: &Batch) -> Result<()> {
        assert!(batch.faces.ends.is_empty(), "only triangles are written");
        let (triangles, _) = batch.faces.corners.as_chunks::<3>();
        for triangle in triangles {
            let mut bytes = [3; 13];
            for (corner, &index) in triangle.iter().enumerate() {
                self.referred = self.referred.max(index + 1);
                let at = 1 + 4 * corner;
                bytes[at..at + 4].copy_from_slice(&(index as u32).to_le_bytes());
            }
            self.buffer.extend_from_slice(&bytes);
            self.flush_above(WRITE_BYTES)?;
        }
        self.written.triangles += triangles.len() as u64;
        Ok(())
    }

    #[inline]
    fn flush_above(&mut self, bytes: usize) -> Result<()> {
        if self.buffer.len() > bytes {
            self.out.write_all(&self.buffer).map_err(FormatError::write)?;
            self.buffer.clear();
        }
        Ok(())
    }
}

impl<W: Write + Send> MeshWriter for Writer<W> {
    fn write_batch(&mut self, batch: &Batch) -> Result<()> {
        match batch.content {
            Content::Vertices => self.vertices(batch),
            Content::Faces => self.faces(batch),
            Content::Soup => panic!("PLY is an indexed format"),
        }
    }

    fn finish(&mut self) -> Result<Option<Vec<u8>>> {
        self.flush_above(0)?;
        self.out.flush().map_err(FormatError::write)?;
        check_limit(self.written)?;
        assert!(self.referred <= self.written.vertices, "faces refer to written vertices");
        let is_as_promised = self.written == self.promised;
        Ok((!is_as_promised).then(|| header(self.written, &self.options)))
    }
}

fn check_limit(counts: Counts) -> Result<()> {
    if counts.vertices > UINT_VERTICES_MAX {
        let (limit, count) = (UINT_VERTICES_MAX, counts.vertices);
        return Err(FormatError::Limit { format: "PLY", what: "vertices", limit, count });
    }
    Ok(())
}

/// The header; as long for any counts, by a comment that takes up the room.
fn header(counts: Counts, options: &WriteOptions) -> Vec<u8> {
    let Counts { vertices, triangles } = counts;
    let coordinate = match options.precision {
        Precision::Single => "float",
        Precision::Double => "double",
    };
    let index = if vertices > INT_VERTICES_MAX { "uint" } else { "int" };
    let colors = if options.colors { COLORS } else { "" };
    let (vertices, triangles) = (vertices.to_string(), triangles.to_string());
    let used = vertices.len() + triangles.len() + index.len();
    let room = " ".repeat(2 * COUNT_DIGITS + "uint".len() - used);
    format!(
        "ply\nformat binary_little_endian 1.0\ncomment written by meshmill{room}\n\
         element vertex {vertices}\nproperty {coordinate} x\nproperty {coordinate} y\n\
         property {coordinate} z\n{colors}element face {triangles}\n\
         property list uchar {index} vertex_indices\nend_header\n"
    )
    .into_bytes()
}
