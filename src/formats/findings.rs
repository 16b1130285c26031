//! What a reader noticed on its way: defects, with the place of the first of each kind, and
//! attributes that are not carried.

use serde::{Deserialize, Serialize};

use crate::error::Position;

/// A kind of defect that does not end the read by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[non_exhaustive]
pub enum DefectKind {
    /// A vertex or soup triangle with a coordinate that is no finite number.
    NotFinite,
    /// A face that refers to a vertex that does not exist.
    IndexOutOfRange,
    /// A face with fewer than three corners: it has no area and is never carried.
    TooFewCorners,
    /// A triangle without area (two equal corners, or all on a line): carried, or dropped where
    /// a stage has no use for it.
    Degenerate,
    /// Bytes after the end of the data.
    TrailingBytes,
    /// A count in the header that is 0 or all ones, with data behind it: the data counts.
    CountUnset,
}

impl DefectKind {
    /// Name in reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::NotFinite => "not_finite",
            Self::IndexOutOfRange => "index_out_of_range",
            Self::TooFewCorners => "too_few_corners",
            Self::Degenerate => "degenerate",
            Self::TrailingBytes => "trailing_bytes",
            Self::CountUnset => "count_unset",
        }
    }
}

/// How often a defect occurs, and where first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Defect {
    /// Kind.
    pub kind: DefectKind,
    /// Occurrences (bytes, for [`DefectKind::TrailingBytes`]).
    pub count: u64,
    /// First occurrence.
    pub first: Position,
}

/// All a reader noticed. Complete once the reader has returned `false`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Findings {
    /// One entry per kind, in order of first occurrence.
    pub defects: Vec<Defect>,
    /// Attributes of the input that are not carried ("normals", "texture coordinates", "quality").
    pub dropped: Vec<String>,
}

impl Findings {
    /// Counts `count` more defects of `kind`.
    pub fn add(&mut self, kind: DefectKind, count: u64, at: Position) {
        if count == 0 {
            return;
        }
        match self.defects.iter_mut().find(|defect| defect.kind == kind) {
            Some(defect) => defect.count += count,
            None => self.defects.push(Defect { kind, count, first: at }),
        }
    }

    /// Counts one more defect of `kind`; its place is worked out only when it is the first.
    pub fn add_one(&mut self, kind: DefectKind, at: impl FnOnce() -> Position) {
        let is_first = self.count(kind) == 0;
        self.add(kind, 1, if is_first { at() } else { Position::default() });
    }

    /// Names an attribute as not carried, once.
    pub fn drop_attribute(&mut self, name: &str) {
        if !self.dropped.iter().any(|known| known == name) {
            self.dropped.push(name.to_owned());
        }
    }

    /// Occurrences of `kind`.
    #[must_use]
    pub fn count(&self, kind: DefectKind) -> u64 {
        self.defects.iter().find(|defect| defect.kind == kind).map_or(0, |defect| defect.count)
    }

    /// Adds what another input of the same mesh brought.
    pub fn merge(&mut self, other: &Self) {
        for defect in &other.defects {
            self.add(defect.kind, defect.count, defect.first);
        }
        for name in &other.dropped {
            self.drop_attribute(name);
        }
    }
}
