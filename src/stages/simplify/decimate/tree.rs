//! Joining neighbours while the stream runs, so that interfaces do not pile up.
//!
//! The slabs are the leaves of a tree: each few neighbours become one piece, each few of those
//! again one. Where a piece belongs follows from its number, so that it does not matter when, and
//! by which thread, it is made.

use std::collections::BTreeMap;

use super::piece::Piece;
use crate::mesh::Metric;

/// Pieces that are joined to one.
pub(super) const FAMILY: usize = 4;

/// Levels above the slabs: a piece of the last one is of so many slabs that its interfaces matter
/// no more, and there is work left for all threads at the end.
pub(super) const LEVELS: u32 = 2;

/// Neighbours are joined when they have so many times the faces that are to be left of them: each
/// join costs the making of a mesh. Chosen by hand: to a tenth, slabs with short interfaces are
/// left as they are.
const WORTH: f64 = 1.3;

/// Pieces that wait for their neighbours, or have nothing to wait for.
pub(super) struct Tree<M: Metric> {
    waiting: BTreeMap<(u32, u64), Vec<Piece<M>>>,
    /// Neighbours that are complete, and worth joining.
    ready: Vec<Vec<Piece<M>>>,
    /// Pieces that stay as they are.
    rest: Vec<Piece<M>>,
}

impl<M: Metric> Default for Tree<M> {
    fn default() -> Self {
        Self { waiting: BTreeMap::new(), ready: Vec::new(), rest: Vec::new() }
    }
}

impl<M: Metric> Tree<M> {
    /// Adds a piece. `faces_after` says how many faces joining some neighbours would leave.
    pub(super) fn add(&mut self, piece: Piece<M>, faces_after: impl Fn(&[Piece<M>]) -> u64) {
        let level = piece.extent.level;
        if level == LEVELS {
            self.rest.push(piece);
            return;
        }
        let parent = (level, piece.extent.index / FAMILY as u64);
        let family = self.waiting.entry(parent).or_default();
        family.push(piece);
        if family.len() < FAMILY {
            return;
        }
        let mut family = self.waiting.remove(&parent).unwrap_or_default();
        family.sort_unstable_by_key(|piece| piece.extent.index);
        if is_worth_joining(faces_of(&family), faces_after(&family)) {
            self.ready.push(family);
        } else {
            self.rest.append(&mut family);
        }
    }

    /// Neighbours that are complete, if `admit` finds memory for them.
    pub(super) fn take_ready<R>(
        &mut self,
        admit: impl Fn(&[Piece<M>]) -> Option<R>,
    ) -> Option<(Vec<Piece<M>>, R)> {
        let found = self.ready.iter().enumerate();
        let (at, room) =
            found.map(|(at, family)| (at, admit(family))).find(|(_, room)| room.is_some())?;
        Some((self.ready.swap_remove(at), room?))
    }

    /// All pieces, in no order.
    pub(super) fn pieces(&self) -> impl Iterator<Item = &Piece<M>> {
        let families = self.waiting.values().chain(&self.ready);
        families.flatten().chain(&self.rest)
    }

    /// All pieces, in the order of the stream.
    pub(super) fn into_pieces(self) -> Vec<Piece<M>> {
        let Self { waiting, ready, mut rest } = self;
        rest.extend(waiting.into_values().flatten());
        rest.extend(ready.into_iter().flatten());
        let first_slab =
            |piece: &Piece<M>| piece.extent.index * (FAMILY as u64).pow(piece.extent.level);
        rest.sort_unstable_by_key(first_slab);
        rest
    }
}

fn is_worth_joining(faces: u64, faces_after: u64) -> bool {
    faces as f64 > WORTH * faces_after as f64
}

/// Faces that all pieces of so many slabs leave, where `left` says what they would be at a level
/// that joins so many slabs to one piece.
pub(super) fn faces_left(slabs: u64, left: impl Fn(u32, u64) -> u64) -> u64 {
    let mut faces = left(0, 1);
    for level in 1..=LEVELS {
        let joined = (FAMILY as u64).pow(level);
        let after = left(level, joined);
        if joined > slabs || !is_worth_joining(faces, after) {
            break;
        }
        faces = after;
    }
    faces
}

/// Faces of some pieces.
pub(super) fn faces_of<M: Metric>(pieces: &[Piece<M>]) -> u64 {
    pieces.iter().map(Piece::faces).sum()
}
