//! Compressed streams, recognised by their first bytes on the way in and chosen by file name on
//! the way out. Knows nothing of meshes.

use std::{
    ffi::OsStr,
    io::{self, BufRead, BufReader, Write},
    path::Path,
};

use flate2::{bufread::MultiGzDecoder, write::GzEncoder};

/// How a stream is compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Compression {
    /// Not at all.
    None,
    /// gzip, one or more members.
    Gzip,
    /// Zstandard, one or more frames.
    Zstd,
}

/// First bytes of a gzip member: magic and the only method there is, deflate.
const GZIP_MAGIC: [u8; 3] = [0x1f, 0x8b, 8];
/// First bytes of a Zstandard frame.
const ZSTD_MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];
/// Magic of a skippable Zstandard frame without its first byte, of which the upper half is 5;
/// parallel compressors put one at the start.
const ZSTD_SKIPPABLE_TAIL: [u8; 3] = [0x2a, 0x4d, 0x18];
/// Bytes [`Compression::of_content`] needs to see.
pub(super) const MAGIC_BYTES: usize = 4;
/// Decompressed bytes per refill; a block of the parsers.
const BLOCK_BYTES: usize = 1 << 18;
/// gzip's own default.
const GZIP_LEVEL: u32 = 6;
/// zstd's own default.
const ZSTD_LEVEL: i32 = 3;
/// Threads beside the caller's. Fixed: the frames depend on whether there are any, though not on
/// how many.
const ZSTD_WORKERS: u32 = 2;

impl Compression {
    /// The compression a file name promises (`.gz`, `.zst`).
    #[must_use]
    pub fn from_path(path: &Path) -> Self {
        match path.extension().map(OsStr::to_ascii_lowercase).as_deref().and_then(OsStr::to_str) {
            Some("gz") => Self::Gzip,
            Some("zst") => Self::Zstd,
            _ => Self::None,
        }
    }

    /// The compression the first [`MAGIC_BYTES`] bytes of a stream show.
    pub(super) fn of_content(head: &[u8]) -> Self {
        if head.starts_with(&GZIP_MAGIC) {
            Self::Gzip
        } else if head.starts_with(&ZSTD_MAGIC)
            || head.len() >= 4 && head[0] >> 4 == 5 && head[1..4] == ZSTD_SKIPPABLE_TAIL
        {
            Self::Zstd
        } else {
            Self::None
        }
    }

    /// Looks through the compression of `input`. A stream that ends early gives an error of kind
    /// [`io::ErrorKind::UnexpectedEof`], damage one without an operating system's error number:
    /// [`super::FormatError::read`] makes faults of both.
    pub(super) fn decode(
        self,
        input: Box<dyn BufRead + Send>,
    ) -> io::Result<Box<dyn BufRead + Send>> {
        Ok(match self {
            Self::None => input,
            Self::Gzip => {
                Box::new(BufReader::with_capacity(BLOCK_BYTES, MultiGzDecoder::new(input)))
            }
            Self::Zstd => Box::new(BufReader::with_capacity(
                BLOCK_BYTES,
                zstd::stream::read::Decoder::with_buffer(input)?,
            )),
        })
    }
}

/// Compresses what is written to it. [`Self::finish`] must be called: a dropped encoder leaves a
/// truncated stream.
pub struct Encoder<W: Write>(Inner<W>);

enum Inner<W: Write> {
    None(W),
    Gzip(GzEncoder<W>),
    Zstd(zstd::stream::write::Encoder<'static, W>),
}

impl<W: Write> Encoder<W> {
    /// An encoder in front of `output`.
    ///
    /// # Errors
    /// When zstd finds no memory for its tables.
    pub fn new(compression: Compression, output: W) -> io::Result<Self> {
        Ok(Self(match compression {
            Compression::None => Inner::None(output),
            Compression::Gzip => {
                Inner::Gzip(GzEncoder::new(output, flate2::Compression::new(GZIP_LEVEL)))
            }
            Compression::Zstd => {
                let mut encoder = zstd::stream::write::Encoder::new(output, ZSTD_LEVEL)?;
                encoder.include_checksum(true)?;
                encoder.multithread(ZSTD_WORKERS)?;
                Inner::Zstd(encoder)
            }
        }))
    }

    /// Ends the stream, flushes and gives the output back.
    ///
    /// # Errors
    /// When the output does not take the rest.
    pub fn finish(self) -> io::Result<W> {
        let mut output = match self.0 {
            Inner::None(output) => output,
            Inner::Gzip(encoder) => encoder.finish()?,
            Inner::Zstd(encoder) => encoder.finish()?,
        };
        output.flush()?;
        Ok(output)
    }

    fn writer(&mut self) -> &mut dyn Write {
        match &mut self.0 {
            Inner::None(output) => output,
            Inner::Gzip(encoder) => encoder,
            Inner::Zstd(encoder) => encoder,
        }
    }
}

impl<W: Write> Write for Encoder<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.writer().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.writer().flush()
    }
}

#[cfg(test)]
mod tests {
    use std::io::Read as _;

    use super::*;

    fn compress(compression: Compression, bytes: &[u8]) -> Vec<u8> {
        let mut encoder = Encoder::new(compression, Vec::new()).unwrap();
        encoder.write_all(bytes).unwrap();
        encoder.finish().unwrap()
    }

    fn decompress(bytes: &[u8]) -> io::Result<Vec<u8>> {
        let compression = Compression::of_content(bytes);
        let mut decoded = Vec::new();
        let input = io::Cursor::new(bytes.to_vec());
        compression.decode(Box::new(input))?.read_to_end(&mut decoded)?;
        Ok(decoded)
    }

    #[test]
    fn what_was_compressed_comes_back_also_from_several_members() {
        for compression in [Compression::None, Compression::Gzip, Compression::Zstd] {
            let mut bytes = compress(compression, b"solid one ");
            bytes.extend(compress(compression, b"and two"));
            assert_eq!(Compression::of_content(&bytes), compression);
            assert_eq!(decompress(&bytes).unwrap(), b"solid one and two");
        }
    }

    #[test]
    fn every_prefix_of_a_compressed_stream_is_truncated() {
        let text: Vec<u8> = (0..4000_u32).flat_map(u32::to_le_bytes).collect();
        for compression in [Compression::Gzip, Compression::Zstd] {
            let bytes = compress(compression, &text);
            for end in MAGIC_BYTES..bytes.len() {
                let error = decompress(&bytes[..end]).unwrap_err();
                assert_eq!(error.kind(), io::ErrorKind::UnexpectedEof, "{compression:?} {end}");
            }
        }
    }

    #[test]
    fn damage_is_an_error_without_an_os_error_number() {
        let text: Vec<u8> = (0..4000_u32).flat_map(u32::to_le_bytes).collect();
        for compression in [Compression::Gzip, Compression::Zstd] {
            let mut bytes = compress(compression, &text);
            let last = bytes.len() - 1;
            bytes[last - 1] ^= 0x55;
            let error = decompress(&bytes).unwrap_err();
            assert!(error.raw_os_error().is_none(), "{error:?}");
            assert_ne!(error.kind(), io::ErrorKind::UnexpectedEof, "{compression:?}");
        }
    }

    #[test]
    fn the_name_decides_how_an_output_is_compressed() {
        let of = |name: &str| Compression::from_path(Path::new(name));
        assert_eq!(of("a.stl.GZ"), Compression::Gzip);
        assert_eq!(of("a.ply.zst"), Compression::Zstd);
        assert_eq!(of("gz"), Compression::None);
    }
}
