//! Colours behind the coordinates of a `v` line: not in the format's specification, but written by
//! most scanners' software.

use crate::formats::Batch;

/// Whether a mesh has vertex colours, and in which range. The first batch of vertices decides, for
/// the whole mesh: a single `1 0 0` may be pure red or nearly black.
#[derive(Debug)]
pub(super) enum Colors {
    /// Colours of the first batch so far, parallel to its vertices.
    Undecided(Vec<Option<[f64; 3]>>),
    /// The first batch had none.
    Absent,
    /// The first batch had some. `scale` makes 0–255 of them: 255 where no value of the first
    /// batch exceeds 1, else 1.
    Carried { scale: f64 },
}

/// What a vertex without colour gets in a mesh that has them.
const WHITE: [u8; 4] = [255; 4];

impl Colors {
    /// Takes the colour of the vertex just added to `batch`; `false` when it cannot be carried.
    pub(super) fn take(&mut self, color: Option<[f64; 3]>, batch: &mut Batch) -> bool {
        match self {
            Self::Undecided(seen) => seen.push(color),
            Self::Absent => return color.is_none(),
            Self::Carried { scale } => {
                batch.colors.push(color.map_or(WHITE, |color| to_rgba(color, *scale)));
            }
        }
        true
    }

    /// Decides by what was seen, and gives the first batch its colours.
    pub(super) fn decide(&mut self, batch: &mut Batch) {
        let Self::Undecided(seen) = self else { return };
        let mut values = seen.iter().flatten().flatten().peekable();
        if values.peek().is_none() {
            *self = Self::Absent;
            return;
        }
        let scale = if values.any(|&value| value > 1.0) { 1.0 } else { 255.0 };
        let colors = seen.iter().map(|color| color.map_or(WHITE, |color| to_rgba(color, scale)));
        batch.colors.extend(colors);
        *self = Self::Carried { scale };
    }

    /// Whether vertices get colours.
    pub(super) fn are_carried(&self) -> bool {
        matches!(self, Self::Carried { .. })
    }
}

/// Values out of range become the nearest in range.
fn to_rgba(color: [f64; 3], scale: f64) -> [u8; 4] {
    let [red, green, blue] = color.map(|value| (value * scale).round() as u8);
    [red, green, blue, 255]
}
