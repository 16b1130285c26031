//! What the tests of readers share: whole inputs read through the front door, byte by byte and in
//! one piece.

use std::io::{BufReader, Cursor};

use super::{
    Batch, Content, Declared, Findings, Format, FormatError, OnDefect, Origin, ReadOptions,
    fault::Result, open,
};
use crate::error::{Fault, InputFault};

/// All that a reader gave.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Seen {
    pub(super) batches: Vec<Batch>,
    pub(super) declared: Declared,
    pub(super) findings: Findings,
    pub(super) origin: Origin,
}

pub(super) const FAIL: ReadOptions =
    ReadOptions { on_defect: OnDefect::Fail, origin: Origin::undecided(), size_bytes: None };
pub(super) const SKIP: ReadOptions = ReadOptions { on_defect: OnDefect::Skip, ..FAIL };

/// Reads `bytes` that arrive `capacity` at a time.
pub(super) fn read_in_pieces(
    bytes: &[u8],
    format: Option<Format>,
    options: &ReadOptions,
    capacity: usize,
) -> Result<Seen> {
    let input = BufReader::with_capacity(capacity, Trickle(Cursor::new(bytes.to_vec()), capacity));
    let mut reader = open(format, Box::new(input), options)?;
    let mut batches = Vec::new();
    let mut batch = Batch::default();
    while reader.read_batch(&mut batch)? {
        assert!(batch.count() > 0, "a batch has records");
        assert!(batch.colors.is_empty() || batch.colors.len() == batch.positions.len());
        batches.push(batch.clone());
    }
    assert!(!reader.read_batch(&mut batch)?, "an input ends once");
    Ok(Seen {
        batches,
        declared: reader.declared().clone(),
        findings: reader.findings().clone(),
        origin: reader.origin(),
    })
}

/// Reads `bytes` in pieces of several sizes, with the same outcome each time.
pub(super) fn read(
    bytes: &[u8],
    format: Format,
    options: &ReadOptions,
) -> Result<Seen, InputFault> {
    let read = |capacity| {
        read_in_pieces(bytes, Some(format), options, capacity).map_err(|error| match error {
            FormatError::Input(fault) => fault,
            error => panic!("{error:?}"),
        })
    };
    let whole = read(1 << 20);
    for capacity in [1, 7] {
        // By its text: NaN marks are equal there.
        assert_eq!(format!("{:?}", read(capacity)), format!("{whole:?}"), "{capacity} at a time");
    }
    whole
}

/// The fault of an input.
pub(super) fn fault(bytes: &[u8], format: Format) -> Fault {
    read(bytes, format, &FAIL).unwrap_err().fault
}

impl Seen {
    /// Positions of all vertices or corners.
    pub(super) fn positions(&self) -> Vec<[f32; 3]> {
        self.batches.iter().flat_map(|batch| batch.positions.clone()).collect()
    }

    /// Colours of all vertices or corners.
    pub(super) fn colors(&self) -> Vec<[u8; 4]> {
        self.batches.iter().flat_map(|batch| batch.colors.clone()).collect()
    }

    /// All faces.
    pub(super) fn faces(&self) -> Vec<Vec<u64>> {
        let faces = self.batches.iter().flat_map(|batch| batch.faces.iter());
        faces.map(<[u64]>::to_vec).collect()
    }
}

/// Some triangles in one batch, all different.
pub(super) fn soup(triangles: usize) -> Batch {
    let corner = |index: usize| [index as f32, (index * index % 1000) as f32 * 0.25, -1.5];
    Batch {
        content: Content::Soup,
        positions: (0..3 * triangles).map(corner).collect(),
        ..Batch::default()
    }
}

/// Gives at most so many bytes a read, also to those who pass the buffer by.
struct Trickle(Cursor<Vec<u8>>, usize);

impl std::io::Read for Trickle {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let length = out.len().min(self.1);
        self.0.read(&mut out[..length])
    }
}
