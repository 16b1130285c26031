//! Pieces in the journal of their workspace: what is left of slabs is written down at checkpoints,
//! and a run that goes on passes over the slabs it is of.

use serde::{Deserialize, Serialize};

use super::{
    Figures,
    piece::{Border, Piece},
    tree::FAMILY,
};
use crate::{
    error::Result,
    mesh::{Patch, PatchFigures, as_words, take_words},
    soup::SweepPlace,
    storage::{
        Due, Lineage, PieceName, RecordFile, RecordWriter, Reservation, SlabFiles, Workspace,
    },
};

/// What the pieces are called.
const LINEAGE: Lineage = Lineage { step: "slabs", family: FAMILY as u64 };

/// What is noted of a piece. Its file has the patches, what is open before what is finished, and the
/// front.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct PieceFigures {
    figures: Figures,
    /// Bits of [`Piece::tolerance`].
    tolerance: u64,
    /// Bits of [`Border::until`], in hexadecimal digits.
    until: Option<String>,
    open: PatchFigures,
    finished: Vec<PatchFigures>,
    front: usize,
}

/// Pieces that are in files.
pub(super) type Saved = SlabFiles<PieceFigures>;

/// What a run before this one has left.
pub(super) fn recall(workspace: &Workspace) -> Result<Saved> {
    Saved::recall(LINEAGE, workspace)
}

/// Writes those of `pieces` that are not in a file, and notes all that are.
pub(super) fn save<'p>(
    saved: &mut Saved,
    due: &Due,
    pieces: impl Iterator<Item = &'p Piece>,
    workspace: &Workspace,
) -> Result<()> {
    let named = pieces.map(|piece| (piece.name, piece));
    saved.save(due, named, workspace, |piece| write(piece, workspace))
}

fn write(piece: &Piece, workspace: &Workspace) -> Result<(PieceFigures, RecordFile<u32>)> {
    let mut writer = RecordWriter::create(workspace, "piece", None)?;
    for patch in std::iter::once(&piece.open).chain(&piece.finished) {
        patch.write_words(|words| writer.extend(words))?;
    }
    writer.extend(as_words(&piece.border.front))?;
    Ok((PieceFigures::of(piece), writer.finish()?))
}

impl PieceFigures {
    fn of(piece: &Piece) -> Self {
        Self {
            figures: piece.figures,
            tolerance: piece.tolerance.to_bits(),
            until: piece.border.until.map(SweepPlace::to_digits),
            open: piece.open.figures(),
            finished: piece.finished.iter().map(Patch::figures).collect(),
            front: piece.border.front.len(),
        }
    }

    pub(super) fn piece(&self, name: PieceName, mut words: &[u32], room: Reservation) -> Piece {
        let open = Patch::of_words(&mut words, &self.open);
        let finished = self.finished.iter().map(|f| Patch::of_words(&mut words, f)).collect();
        let border = Border {
            front: take_words(&mut words, self.front),
            until: self.until.as_deref().and_then(SweepPlace::of_digits),
        };
        let (figures, tolerance) = (self.figures, f64::from_bits(self.tolerance));
        Piece { name, border, open, finished, figures, tolerance, room }
    }
}
