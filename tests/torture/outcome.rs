//! What can happen to an input, and whether it did.

use meshmill::{
    error::{Fault, InputFault, Position},
    formats::DefectKind,
};

use crate::meshes::Whole;

/// What must happen to a file.
#[derive(Clone, Copy, Debug)]
pub(super) enum Expected {
    /// Triangles with their own positions.
    Soup { triangles: u64 },
    /// Vertices and faces; the colour is the first vertex's, `None` where there are none.
    Mesh { vertices: u64, faces: u64, triangles: u64, color: Option<[u8; 4]> },
    /// A complete input without a face. The reader succeeds; the job does not.
    NoFaces { vertices: u64, color: Option<[u8; 4]> },
    /// A broken rule, whichever.
    AnyFault,
    /// A broken rule.
    Fault { kind: FaultKind, place: Place },
}

/// A [`Fault`] without the values that the table leaves open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum FaultKind {
    Truncated,
    Empty,
    Syntax,
    /// With the index as the file has it.
    IndexOutOfRange(i64),
    NotFinite,
    CountImpossible,
    Unsupported,
    Other,
}

/// What is known of a place; the bytes are the first and the last that are right.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    pub(super) line: Option<u64>,
    pub(super) record: Option<u64>,
    pub(super) bytes: Option<(u64, u64)>,
}

impl FaultKind {
    fn of(fault: &Fault) -> Self {
        match fault {
            Fault::Truncated { .. } => Self::Truncated,
            Fault::Empty => Self::Empty,
            Fault::Syntax { .. } => Self::Syntax,
            Fault::IndexOutOfRange { index, .. } => Self::IndexOutOfRange(*index),
            Fault::NotFinite => Self::NotFinite,
            Fault::CountImpossible { .. } => Self::CountImpossible,
            Fault::Unsupported(_) => Self::Unsupported,
            _ => Self::Other,
        }
    }
}

impl Place {
    fn holds(&self, at: Position) -> bool {
        self.line.is_none_or(|line| at.line == Some(line))
            && self.record.is_none_or(|record| at.record == Some(record))
            && self.bytes.is_none_or(|(first, last)| {
                at.byte.is_some_and(|byte| (first..=last).contains(&byte))
            })
    }
}

impl Expected {
    /// The same expectation where the size of the input is not known beforehand: a count that
    /// lies shows where the data stop making sense.
    pub(super) fn without_size(self) -> Self {
        match self {
            Self::Fault { kind: FaultKind::CountImpossible, .. } => Self::AnyFault,
            _ => self,
        }
    }

    /// Whether this is what happened; if not, what did.
    pub(super) fn compare(&self, found: &Result<Whole, InputFault>) -> Result<(), String> {
        let is_met = match (self, found) {
            (Self::Fault { kind, place }, Err(fault)) => {
                *kind == FaultKind::of(&fault.fault) && place.holds(fault.at)
            }
            (Self::AnyFault, Err(_)) => true,
            (Self::Soup { triangles }, Ok(whole)) => {
                !whole.declared.indexed
                    && whole.positions.len() as u64 == 3 * triangles
                    && first_color(whole).is_none()
            }
            (Self::Mesh { vertices, faces, triangles, color }, Ok(whole)) => {
                whole.declared.indexed
                    && counts(whole) == [*vertices, *faces, *triangles]
                    && first_color(whole) == *color
            }
            (Self::NoFaces { vertices, color }, Ok(whole)) => {
                counts(whole) == [*vertices, 0, 0] && first_color(whole) == *color
            }
            _ => false,
        };
        if is_met { Ok(()) } else { Err(format!("{self:?} expected, but {}", describe(found))) }
    }
}

fn counts(whole: &Whole) -> [u64; 3] {
    let counts = [whole.positions.len(), whole.faces.len(), whole.triangles().len()];
    counts.map(|count| count as u64)
}

/// The first colour, if the header's word and the data agree that there are colours.
fn first_color(whole: &Whole) -> Option<[u8; 4]> {
    assert!(whole.positions.is_empty() || whole.declared.colors != whole.colors.is_empty());
    whole.colors.first().copied()
}

/// Kinds and counts of the defects that were noticed, in order of kind.
pub(super) fn defects(whole: &Whole) -> Vec<(DefectKind, u64)> {
    let pairs = whole.findings.defects.iter().map(|defect| (defect.kind, defect.count));
    let mut pairs: Vec<_> = pairs.collect();
    pairs.sort();
    pairs
}

fn describe(found: &Result<Whole, InputFault>) -> String {
    match found {
        Err(InputFault { at, fault }) => format!("at {at}: {fault}"),
        Ok(whole) => format!(
            "vertices, faces, triangles {:?}, first colour {:?}, {:?}",
            counts(whole),
            first_color(whole),
            whole.findings,
        ),
    }
}
