//! The door of this folder: from some bytes to a reader, and from a format to a writer.

use std::io::{self, BufRead, Read as _, Write};

use super::{
    Compression, Counts, Format, FormatError, MeshReader, MeshWriter, ReadOptions, Source,
    WriteOptions, compression, detect, fault::Result, glb, obj, off, ply, soup, stl,
    text::skip_byte_order_mark,
};
use crate::error::{Fault, Position};

/// Opens an input: looks through compression, finds out the format unless it is given, and reads
/// the header. `options.size_bytes` is the size of the input as it stands, compressed or not.
///
/// # Errors
/// [`FormatError::Input`]: an empty input, one of no known format or of another than `format`,
/// or a header that breaks its rules.
pub fn open(
    format: Option<Format>,
    mut input: Box<dyn BufRead + Send>,
    options: &ReadOptions,
) -> Result<Box<dyn MeshReader>> {
    let mut magic = Vec::new();
    let magic_bytes = compression::MAGIC_BYTES as u64;
    input
        .by_ref()
        .take(magic_bytes)
        .read_to_end(&mut magic)
        .map_err(|error| FormatError::read(error, 0))?;
    let compression = Compression::of_content(&magic);
    let input = compression
        .decode(Box::new(io::Cursor::new(magic).chain(input)))
        .map_err(|error| FormatError::read(error, 0))?;
    let mut options = *options;
    if compression != Compression::None {
        options.size_bytes = None;
    }
    let mut source = Source::new(input);
    let format = decide(format, &mut source, options.size_bytes)?;
    let reader: Box<dyn MeshReader> = match format {
        Format::Stl => stl::open(source, &options)?,
        Format::Obj => Box::new(obj::Reader::open(source, &options)?),
        Format::Soup => Box::new(soup::Reader::open(source, &options)?),
        Format::Ply => Box::new(ply::Reader::open(source, &options)?),
        Format::Off => Box::new(off::Reader::open(source, &options)?),
        Format::Progressive | Format::Glb => {
            return Err(at_start(Fault::Unsupported("reading this format as a mesh")));
        }
    };
    check_counts(reader.as_ref())?;
    Ok(reader)
}

/// No disk holds more vertices or faces: 17.6 million million. What is reckoned from a count in bytes
/// fits 64 bits up to here.
const COUNT_MAX: u64 = 1 << 44;

/// Refuses counts that no input can keep; of a stream nothing else shows that before its end.
fn check_counts(reader: &dyn MeshReader) -> Result<()> {
    let declared = reader.declared();
    let counts = [("the vertex count", declared.vertices), ("the face count", declared.faces)];
    for (what, count) in counts {
        if let Some(count) = count.filter(|count| *count > COUNT_MAX) {
            return Err(at_start(Fault::CountImpossible { what, count, limit: COUNT_MAX }));
        }
    }
    Ok(())
}

/// Begins an output. `counts` are needed by formats whose header has them; where one can be
/// mended afterwards, [`MeshWriter::finish`] says so.
///
/// # Errors
/// [`FormatError::Limit`] before anything is written when the format cannot count so many;
/// [`FormatError::Io`].
pub fn create(
    format: Format,
    output: Box<dyn Write + Send>,
    counts: Option<Counts>,
    options: &WriteOptions,
) -> Result<Box<dyn MeshWriter>> {
    let triangles = counts.map(|counts| counts.triangles);
    Ok(match format {
        Format::Stl => Box::new(stl::Writer::new(output, triangles, options)?),
        Format::Obj => Box::new(obj::Writer::new(output, options)?),
        Format::Soup => Box::new(soup::Writer::new(output, triangles, None, options)?),
        Format::Ply => Box::new(ply::Writer::new(output, counts.unwrap_or_default(), options)?),
        Format::Glb => Box::new(glb::Writer::new(output, counts.unwrap_or_default(), options)?),
        Format::Off | Format::Progressive => {
            return Err(at_start(Fault::Unsupported("writing this format")));
        }
    })
}

/// The format of the source: the one asked for, unless the content is plainly another.
fn decide(asked: Option<Format>, source: &mut Source, size_bytes: Option<u64>) -> Result<Format> {
    let head = source.peek(detect::HEAD_BYTES)?;
    if head.is_empty() {
        return Err(at_start(Fault::Empty));
    }
    let found = match asked {
        None => detect::detect(head, size_bytes),
        Some(_) => detect::signature(head, size_bytes),
    };
    if asked == Some(Format::Obj) && found.is_none() && head.contains(&0) {
        skip_byte_order_mark(source)?;
        let (expected, found) = (name(Format::Obj), "binary data".to_owned());
        return Err(at_start(Fault::Syntax { expected, found }));
    }
    match (asked, found) {
        (Some(asked), Some(found)) if asked != found => {
            Err(at_start(Fault::Syntax { expected: name(asked), found: name(found).to_owned() }))
        }
        (Some(format), _) | (None, Some(format)) => Ok(format),
        (None, None) => {
            let found =
                super::cursor::shorten(head.split(|&byte| byte == b'\n').next().unwrap_or(head));
            // Says so if it is text in an encoding we do not read.
            skip_byte_order_mark(source)?;
            let expected = "the beginning of an STL, PLY, OBJ, OFF or soup file";
            Err(at_start(Fault::Syntax { expected, found }))
        }
    }
}

fn name(format: Format) -> &'static str {
    match format {
        Format::Stl => "STL data",
        Format::Ply => "PLY data",
        Format::Obj => "OBJ data",
        Format::Off => "OFF data",
        Format::Soup => "soup data",
        Format::Progressive => "a progressive mesh",
        Format::Glb => "glTF data",
    }
}

fn at_start(fault: Fault) -> FormatError {
    FormatError::input(Position::byte(0), fault)
}

#[cfg(test)]
mod tests {
    use std::{
        io::Cursor,
        sync::{Arc, Mutex},
    };

    use super::*;
    use crate::formats::{
        Batch, Content, Encoder, Precision,
        probe::{FAIL, Seen, fault, read_in_pieces, soup},
    };

    /// An output that can be looked at after it was given away.
    #[derive(Clone, Default)]
    struct Shared(Arc<Mutex<Vec<u8>>>);

    impl Write for Shared {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.lock().unwrap().write(bytes)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    fn written(format: Format, batches: &[Batch]) -> Vec<u8> {
        let options =
            WriteOptions { precision: Precision::Single, origin: [0.0; 3], colors: false };
        let output = Shared::default();
        let triangles = batches.iter().map(|batch| batch.count() as u64).next_back().unwrap();
        let vertices = batches[0].positions.len() as u64;
        let counts = Some(Counts { vertices, triangles });
        let mut writer = create(format, Box::new(output.clone()), counts, &options).unwrap();
        for batch in batches {
            writer.write_batch(batch).unwrap();
        }
        assert_eq!(writer.finish().unwrap(), None);
        output.0.lock().unwrap().clone()
    }

    fn samples() -> Vec<(Format, Vec<u8>)> {
        let vertices = Batch { content: Content::Vertices, ..soup(1) };
        let mut faces = Batch { content: Content::Faces, ..Batch::default() };
        faces.faces.push(&[0, 1, 2]);
        let indexed = [vertices, faces];
        vec![
            (Format::Stl, written(Format::Stl, &[soup(1)])),
            (Format::Soup, written(Format::Soup, &[soup(1)])),
            (Format::Obj, written(Format::Obj, &indexed)),
        ]
    }

    fn compressed(compression: Compression, bytes: &[u8]) -> Vec<u8> {
        let mut encoder = Encoder::new(compression, Vec::new()).unwrap();
        encoder.write_all(bytes).unwrap();
        encoder.finish().unwrap()
    }

    #[test]
    fn every_format_is_recognised_also_through_compression() {
        for (format, bytes) in samples() {
            let expected = read_in_pieces(&bytes, Some(format), &FAIL, 1 << 16).unwrap();
            for compression in [Compression::None, Compression::Gzip, Compression::Zstd] {
                let bytes = compressed(compression, &bytes);
                let options = ReadOptions { size_bytes: Some(bytes.len() as u64), ..FAIL };
                for capacity in [1, 7, 1 << 16] {
                    let seen: Seen = read_in_pieces(&bytes, None, &options, capacity).unwrap();
                    assert_eq!(seen, expected, "{format:?} {compression:?} {capacity}");
                }
            }
        }
    }

    #[test]
    fn a_cut_or_damaged_compressed_input_is_a_fault() {
        let (format, bytes) = (Format::Stl, written(Format::Stl, &[soup(9)]));
        for compression in [Compression::Gzip, Compression::Zstd] {
            let bytes = compressed(compression, &bytes);
            for end in 0..bytes.len() {
                let cut = read_in_pieces(&bytes[..end], Some(format), &FAIL, 7);
                assert!(matches!(cut, Err(FormatError::Input(_))), "{compression:?} {end}");
            }
            let mut damaged = bytes;
            let last = damaged.len() - 1;
            damaged[last - 1] ^= 1;
            for capacity in [1, 7, 1 << 16] {
                let read = read_in_pieces(&damaged, Some(format), &FAIL, capacity);
                let Err(FormatError::Input(bad)) = read else { panic!("{read:?}") };
                assert!(matches!(bad.fault, Fault::Compression(_)), "{compression:?} {bad:?}");
            }
        }
    }

    #[test]
    fn a_format_that_the_content_contradicts_is_a_fault() {
        for (format, bytes) in samples() {
            for asked in [Format::Obj, Format::Soup, Format::Stl] {
                if asked != format {
                    let fault = fault(&bytes, asked);
                    assert!(
                        matches!(fault, Fault::Syntax { .. }),
                        "{format:?} {asked:?} {fault:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn nothing_and_nonsense_are_told_apart() {
        assert_eq!(fault(b"", Format::Obj), Fault::Empty);
        let error = |bytes: &'static [u8]| match open(None, Box::new(Cursor::new(bytes)), &FAIL) {
            Err(FormatError::Input(fault)) => fault.fault,
            other => panic!("{:?}", other.err()),
        };
        assert_eq!(error(b""), Fault::Empty);
        assert!(matches!(error(b"<html>\n"), Fault::Syntax { found, .. } if found == "<html>"));
        assert_eq!(error(b"\xff\xfev\0 \0"), Fault::Unsupported("UTF-16 text"));
    }
}
