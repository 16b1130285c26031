//! Pieces in the journal of their workspace: what is left of slabs is written down at checkpoints,
//! and a run that goes on passes over the slabs it is of.

use serde::{Deserialize, Serialize};

use super::{
    piece::{Extent, Piece},
    tree::FAMILY,
};
use crate::{
    error::Result,
    mesh::{Metric, Patch, PatchFigures, as_words, take_words},
    soup::SweepPlace,
    storage::{
        Due, Lineage, PieceName, RecordFile, RecordWriter, Reservation, SlabFiles, Workspace,
    },
};

/// What the pieces are called.
const LINEAGE: Lineage = Lineage { step: "slabs", family: FAMILY as u64 };

/// What is noted of a piece. Its file has the patch, the costs and the front.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct PieceFigures {
    triangles: u64,
    degenerate: u64,
    split: u64,
    /// Bits of [`Extent::until`], in hexadecimal digits.
    until: Option<String>,
    patch: PatchFigures,
    costs: usize,
    front: usize,
}

/// Pieces that are in files.
pub(super) type Saved = SlabFiles<PieceFigures>;

/// What a run before this one has left.
pub(super) fn recall(workspace: &Workspace) -> Result<Saved> {
    Saved::recall(LINEAGE, workspace)
}

/// Writes those of `pieces` that are not in a file, and notes all that are.
pub(super) fn save<'p, M: Metric>(
    saved: &mut Saved,
    due: &Due,
    pieces: impl Iterator<Item = &'p Piece<M>>,
    workspace: &Workspace,
) -> Result<()> {
    let named = pieces.map(|piece| ((piece.extent.level, piece.extent.index), piece));
    saved.save(due, named, workspace, |piece| write(piece, workspace))
}

fn write<M: Metric>(
    piece: &Piece<M>,
    workspace: &Workspace,
) -> Result<(PieceFigures, RecordFile<u32>)> {
    let mut writer = RecordWriter::create(workspace, "piece", None)?;
    piece.patch.write_words(|words| writer.extend(words))?;
    writer.extend(as_words(&piece.costs))?;
    writer.extend(as_words(&piece.extent.front))?;
    Ok((PieceFigures::of(piece), writer.finish()?))
}

impl PieceFigures {
    fn of<M: Metric>(piece: &Piece<M>) -> Self {
        let Piece { extent, patch, costs, .. } = piece;
        Self {
            triangles: extent.triangles,
            degenerate: extent.degenerate,
            split: extent.split,
            until: extent.until.map(SweepPlace::to_digits),
            patch: patch.figures(),
            costs: costs.len(),
            front: extent.front.len(),
        }
    }

    pub(super) fn piece<M: Metric>(
        &self,
        (level, index): PieceName,
        mut words: &[u32],
        room: Reservation,
    ) -> Piece<M> {
        let patch = Patch::of_words(&mut words, &self.patch);
        let costs = take_words(&mut words, self.costs);
        let extent = Extent {
            level,
            index,
            triangles: self.triangles,
            degenerate: self.degenerate,
            split: self.split,
            front: take_words(&mut words, self.front),
            until: self.until.as_deref().and_then(SweepPlace::of_digits),
        };
        Piece { extent, patch, costs, room }
    }
}
