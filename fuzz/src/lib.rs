//! What must hold for any bytes at all: readers end, take memory in proportion, keep their word,
//! and do not depend on how the bytes arrive.

use std::io::{BufRead, BufReader, Cursor};

use meshmill::{
    error::InputFault,
    formats::{
        self, Batch, Content, Declared, DefectKind, Findings, Format, FormatError, OnDefect,
        Origin, ReadOptions,
    },
};

/// Bytes a reader gets at a time on its second try: any small number that divides nothing.
const PIECE_BYTES: usize = 7;

/// First bytes of gzip and Zstandard streams, and bytes 1 to 3 of Zstandard's skippable frames.
const COMPRESSED: [&[u8]; 2] = [b"\x1f\x8b", b"\x28\xb5\x2f\xfd"];
const SKIPPABLE_TAIL: [u8; 3] = *b"\x2a\x4d\x18";

type Outcome = Result<Seen, InputFault>;

/// All that a reader gave; numbers as bits, so that NaN equals itself.
#[derive(Debug, PartialEq)]
struct Seen {
    positions: Vec<[u32; 3]>,
    colors: Vec<[u8; 4]>,
    corners: Vec<u64>,
    faces: u64,
    declared: Declared,
    findings: Findings,
}

/// Reads `bytes` in several ways and panics where a promise is broken.
pub fn check(format: Option<Format>, bytes: &[u8]) {
    let fail = read(format, whole(bytes), OnDefect::Fail, None);
    assert_same(bytes, &fail, &read(format, pieces(bytes), OnDefect::Fail, None));

    let skip = read(format, whole(bytes), OnDefect::Skip, None);
    assert_same(bytes, &skip, &read(format, pieces(bytes), OnDefect::Skip, None));
    if fail.is_ok() {
        assert_eq!(fail, skip, "there is nothing to skip");
    }

    let size_bytes = Some(bytes.len() as u64);
    let sized = read(format, whole(bytes), OnDefect::Fail, size_bytes);
    // With the size known, binary STL is told from text by it, and lies are found earlier.
    if let (Ok(seen), Ok(sized)) = (&fail, &sized)
        && seen.declared.indexed
    {
        assert_eq!(seen, sized, "with the size known");
    }
}

/// The same mesh or fault. How far a damaged compressed stream is read before the damage shows
/// depends on the pieces it comes in, so that only the failure itself is the same.
fn assert_same(bytes: &[u8], whole: &Outcome, pieces: &Outcome) {
    let is_compressed = COMPRESSED.iter().any(|magic| bytes.get(..magic.len()) == Some(*magic))
        || bytes.get(1..4) == Some(&SKIPPABLE_TAIL[..]);
    if !(is_compressed && whole.is_err() && pieces.is_err()) {
        assert_eq!(whole, pieces, "in pieces");
    }
}

fn whole(bytes: &[u8]) -> Box<dyn BufRead + Send> {
    Box::new(Cursor::new(bytes.to_vec()))
}

fn pieces(bytes: &[u8]) -> Box<dyn BufRead + Send> {
    Box::new(BufReader::with_capacity(PIECE_BYTES, Cursor::new(bytes.to_vec())))
}

fn read(
    format: Option<Format>,
    input: Box<dyn BufRead + Send>,
    on_defect: OnDefect,
    size_bytes: Option<u64>,
) -> Outcome {
    let options = ReadOptions { on_defect, origin: Origin::undecided(), size_bytes };
    read_batches(format, input, &options).map_err(|error| {
        let FormatError::Input(fault) = error else { panic!("memory can be read: {error:?}") };
        assert!(fault.at.line.is_some() || fault.at.byte.is_some(), "a place: {fault:?}");
        fault
    })
}

fn read_batches(
    format: Option<Format>,
    input: Box<dyn BufRead + Send>,
    options: &ReadOptions,
) -> Result<Seen, FormatError> {
    let mut reader = formats::open(format, input, options)?;
    let declared = reader.declared().clone();
    let (mut positions, mut colors, mut corners, mut faces) = (vec![], vec![], vec![], 0);
    let mut batch = Batch::default();
    while reader.read_batch(&mut batch)? {
        check_batch(&batch, &declared, options.on_defect);
        positions.extend(batch.positions.iter().map(|position| position.map(f32::to_bits)));
        colors.extend_from_slice(&batch.colors);
        corners.extend_from_slice(&batch.faces.corners);
        faces += batch.faces.count() as u64;
        // A strip makes up to three corners of a byte; nothing makes more.
        let carried = (positions.len() + corners.len()) as u64;
        assert!(carried <= 3 * reader.bytes_read() + 16, "more than the input can say");
    }
    assert!(!reader.read_batch(&mut batch)?, "an input ends once");
    assert_eq!(*reader.declared(), declared, "the header does not change");
    let findings = reader.findings().clone();
    let seen = Seen { positions, colors, corners, faces, declared, findings };
    check_whole(&seen, options.on_defect);
    Ok(seen)
}

fn check_batch(batch: &Batch, declared: &Declared, on_defect: OnDefect) {
    assert!(batch.count() > 0, "a batch has records");
    assert!(batch.count() <= 2 * formats::BATCH_RECORDS, "a batch is bounded");
    assert_eq!(batch.content == Content::Soup, !declared.indexed);
    assert!(batch.content != Content::Soup || batch.positions.len().is_multiple_of(3));
    assert!(batch.content == Content::Faces || batch.faces.count() == 0);
    assert!(batch.content != Content::Faces || batch.positions.is_empty());
    let colors = if declared.colors { batch.positions.len() } else { 0 };
    assert_eq!(batch.colors.len(), colors, "colours are parallel to positions");
    for position in &batch.positions {
        let is_finite = position.iter().all(|coordinate| coordinate.is_finite());
        let is_marked = position.iter().all(|coordinate| coordinate.is_nan());
        let may_be_marked = on_defect == OnDefect::Skip && batch.content == Content::Vertices;
        assert!(is_finite || may_be_marked && is_marked, "{position:?}");
    }
    assert!(batch.faces.iter().all(|face| face.len() >= 3), "a face has an inside");
}

fn check_whole(seen: &Seen, on_defect: OnDefect) {
    let vertices = seen.positions.len() as u64;
    let count = |kind| seen.findings.count(kind);
    if let Some(declared) = seen.declared.vertices {
        assert_eq!(vertices, declared);
    }
    // OBJ passes forward references on when it skips, as only the end tells where they lead.
    if on_defect == OnDefect::Fail || seen.declared.vertices.is_some() {
        assert!(seen.corners.iter().all(|&index| !seen.declared.indexed || index < vertices));
    }
    if let Some(declared) = seen.declared.faces {
        let left_out = count(DefectKind::IndexOutOfRange) + count(DefectKind::TooFewCorners);
        let carried = if seen.declared.indexed {
            seen.faces + left_out
        } else {
            vertices / 3 + count(DefectKind::NotFinite)
        };
        assert_eq!(carried, declared);
    }
    if on_defect == OnDefect::Fail {
        assert_eq!(count(DefectKind::NotFinite) + count(DefectKind::IndexOutOfRange), 0);
    }
}
