//! What is left of the slabs of a stream, in files: pieces, of which each few neighbours become one of
//! the next level, and the journal that names them.
//!
//! Where a slab is cut follows from the stream alone. So a run that goes on passes the stream by again,
//! and what is already there is not worked on again.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize, de::DeserializeOwned};

use super::{Budget, Due, RecordFile, Reservation, Workspace};
use crate::error::{Error, Result};

/// The end of the stream.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct StreamEnd {
    /// Slabs it was cut into.
    pub slabs: u64,
    /// Triangles of it.
    pub triangles: u64,
}

/// Which piece: its level, 0 for a slab, and where it stands among those of its level.
pub type PieceName = (u32, u64);

/// How pieces are called in the journal, and become others.
#[derive(Clone, Copy, Debug)]
pub struct Lineage {
    /// What they are called.
    pub step: &'static str,
    /// How many become one.
    pub family: u64,
}

/// Pieces that are in files. `F` is what is noted of each.
pub struct SlabFiles<F> {
    lineage: Lineage,
    /// None is part of another one.
    pieces: BTreeMap<PieceName, (F, RecordFile<u32>)>,
    /// Once all slabs are cut and done.
    pub end: Option<StreamEnd>,
}

/// What is noted of all pieces: each is a file of its own.
#[derive(Serialize, Deserialize)]
struct Noted<P> {
    pieces: Vec<P>,
    end: Option<StreamEnd>,
}

impl<F: Serialize + DeserializeOwned> SlabFiles<F> {
    /// What a run before this one has left.
    ///
    /// # Errors
    /// [`Error::Damaged`] when a file is not as it was noted.
    pub fn recall(lineage: Lineage, workspace: &Workspace) -> Result<Self> {
        let mut found = Self { lineage, pieces: BTreeMap::new(), end: None };
        let Some(recalled) = workspace.recall::<Noted<(PieceName, F)>>(lineage.step) else {
            return Ok(found);
        };
        for ((name, figures), file) in recalled.figures.pieces.into_iter().zip(&recalled.files) {
            found.pieces.insert(name, (figures, RecordFile::adopt(workspace, file)?));
        }
        found.end = recalled.figures.end;
        Ok(found)
    }

    /// Whether a slab is in one of the pieces.
    #[must_use]
    pub fn holds(&self, slab: u64) -> bool {
        let highest = self.pieces.keys().map(|(level, _)| *level).max();
        let name = |level| (level, slab / self.lineage.family.pow(level));
        highest.is_some_and(|highest| (0..=highest).any(|l| self.pieces.contains_key(&name(l))))
    }

    /// Reads all of them, by level, in the order of the stream: `piece` makes one of what was noted of
    /// it and its file, in memory of the budget.
    ///
    /// # Errors
    /// [`Error::Resource`], naming `what`, when a file does not fit the budget;
    /// [`Error::Damaged`] when it is not as it was written.
    pub fn load<P>(
        &self,
        what: &'static str,
        budget: &Budget,
        piece: impl Fn(PieceName, &F, &[u32], Reservation) -> P,
    ) -> Result<Vec<P>> {
        let load = |(name, (figures, file)): (&PieceName, &(F, RecordFile<u32>))| {
            let (needed_bytes, available_bytes) = (file.size_bytes(), budget.available_bytes());
            let refused = Error::Resource { what, needed_bytes, available_bytes };
            let room = budget.reserve(needed_bytes).ok_or(refused)?;
            Ok(piece(*name, figures, &file.read_all()?, room))
        };
        self.pieces.iter().map(load).collect()
    }

    /// Has those of `pieces` written that are not in a file, and notes all that are.
    ///
    /// # Errors
    /// Those of `write`; a full disk.
    pub fn save<'p, P: 'p>(
        &mut self,
        due: &Due,
        pieces: impl Iterator<Item = (PieceName, &'p P)>,
        workspace: &Workspace,
        write: impl Fn(&P) -> Result<(F, RecordFile<u32>)>,
    ) -> Result<()> {
        for (name, piece) in pieces {
            if self.pieces.contains_key(&name) {
                continue;
            }
            let written = write(piece)?;
            let (level, index) = name;
            let is_part =
                |(l, i): &PieceName| *l < level && i / self.lineage.family.pow(level - l) == index;
            // What it was joined of has gone into it.
            self.pieces.retain(|name, _| !is_part(name));
            self.pieces.insert(name, written);
        }
        let noted = self.pieces.iter().map(|(name, (figures, _))| (name, figures)).collect();
        let files = self.pieces.values().map(|(_, file)| file.kept()).collect();
        let noted: Noted<(&PieceName, &F)> = Noted { pieces: noted, end: self.end };
        workspace.checkpoint(due, self.lineage.step, &noted, files)
    }
}
