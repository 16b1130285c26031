//! Joining neighbours as soon as there are enough of them, so that strips do not pile up.
//!
//! What is joined with what follows from the number of a slab alone.

use rayon::prelude::*;

use super::{Config, piece::Piece};
use crate::{error::Result, storage::Budget};

/// Pieces that are joined to one.
pub(super) const FAMILY: usize = 4;

/// Pieces that wait for their neighbours, by level, in the order of the stream.
#[derive(Default)]
pub(super) struct Tree {
    levels: Vec<Vec<Piece>>,
}

impl Tree {
    /// Adds the pieces of slabs that follow on those before, and joins what is complete.
    pub(super) fn add(
        &mut self,
        pieces: Vec<Piece>,
        config: &Config,
        budget: &Budget,
    ) -> Result<()> {
        let (mut level, mut new) = (0, pieces);
        while !new.is_empty() {
            if self.levels.len() == level {
                self.levels.push(Vec::new());
            }
            self.levels[level].append(&mut new);
            let mut families = Vec::new();
            let complete = self.levels[level].len() / FAMILY * FAMILY;
            let mut pieces = self.levels[level].drain(..complete).peekable();
            while pieces.peek().is_some() {
                families.push(pieces.by_ref().take(FAMILY).collect::<Vec<Piece>>());
            }
            drop(pieces);
            let join = |family| Piece::join(family, config, budget);
            new = families.into_par_iter().map(join).collect::<Result<_>>()?;
            level += 1;
        }
        Ok(())
    }

    /// Pieces that were made in this order.
    pub(super) fn of_pieces(pieces: Vec<Piece>) -> Self {
        let mut tree = Self::default();
        for piece in pieces {
            let level = piece.name.0 as usize;
            tree.levels.resize_with(tree.levels.len().max(level + 1), Vec::new);
            tree.levels[level].push(piece);
        }
        tree
    }

    /// All of them.
    pub(super) fn pieces(&self) -> impl Iterator<Item = &Piece> {
        self.levels.iter().flatten()
    }

    /// Faces that can still change.
    pub(super) fn open_faces(&self) -> u64 {
        self.pieces().map(Piece::open_faces).sum()
    }

    /// Joins all that is left. The stream has ended.
    pub(super) fn finish(self, config: &Config, budget: &Budget) -> Result<Piece> {
        // The higher the level, the earlier in the stream.
        let mut pieces: Vec<Piece> = self.levels.into_iter().rev().flatten().collect();
        match pieces.pop() {
            Some(only) if pieces.is_empty() => Ok(only),
            Some(last) => {
                pieces.push(last);
                Piece::join(pieces, config, budget)
            }
            None => Ok(Piece::nothing()),
        }
    }
}
