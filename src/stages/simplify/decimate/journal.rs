//! Pieces in the journal of their workspace: what is left of slabs is written down at checkpoints,
//! and a run that goes on passes over the slabs it is of.
//!
//! Where a slab is cut follows from the stream alone. So the stream is passed by again, and what is
//! already there is not decimated again.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use zerocopy::{FromBytes, Immutable, IntoBytes};

use super::{
    piece::{Extent, Piece},
    tree::{FAMILY, LEVELS},
};
use crate::{
    error::Result,
    mesh::{Metric, Patch},
    soup::SweepPlace,
    storage::{Due, RecordFile, RecordWriter, Reservation, Workspace},
};

/// What the pieces are called.
const STEP: &str = "slabs";

/// The end of the stream.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) struct StreamEnd {
    pub(super) slabs: u64,
    pub(super) triangles: u64,
}

/// What is noted of all pieces: each is a file of its own.
#[derive(Serialize, Deserialize)]
struct Figures<P> {
    pieces: Vec<P>,
    /// Once all slabs are cut and done.
    end: Option<StreamEnd>,
}

/// What is noted of a piece.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct PieceFigures {
    level: u32,
    index: u64,
    triangles: u64,
    degenerate: u64,
    split: u64,
    /// Bits of [`Extent::until`], in hexadecimal digits.
    until: Option<String>,
    /// Bits of [`Patch::unit`].
    unit: u32,
    counts: Counts,
}

/// Lengths of what is in the file of a piece, in this order.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Counts {
    positions: usize,
    carried: usize,
    colors: usize,
    faces: usize,
    shared: usize,
    joined: usize,
    costs: usize,
    normals: usize,
    settled: usize,
    hung: usize,
    front: usize,
}

/// Pieces that are in files.
#[derive(Default)]
pub(super) struct Saved {
    /// By level and index; none is part of another one.
    pieces: BTreeMap<(u32, u64), (PieceFigures, RecordFile<u32>)>,
    pub(super) end: Option<StreamEnd>,
}

impl Saved {
    /// What a run before this one has left.
    pub(super) fn recall(workspace: &Workspace) -> Result<Self> {
        let mut saved = Self::default();
        let Some(recalled) = workspace.recall::<Figures<PieceFigures>>(STEP) else {
            return Ok(saved);
        };
        for (figures, file) in recalled.figures.pieces.into_iter().zip(&recalled.files) {
            let file = RecordFile::adopt(workspace, file)?;
            saved.pieces.insert((figures.level, figures.index), (figures, file));
        }
        saved.end = recalled.figures.end;
        Ok(saved)
    }

    /// Whether a slab is in one of the pieces.
    pub(super) fn holds(&self, slab: u64) -> bool {
        let piece = |level| (level, slab / (FAMILY as u64).pow(level));
        (0..=LEVELS).any(|level| self.pieces.contains_key(&piece(level)))
    }

    /// Reads all pieces; `room` finds the memory for so many bytes.
    pub(super) fn load<M: Metric>(
        &self,
        mut room: impl FnMut(u64) -> Result<Reservation>,
    ) -> Result<Vec<Piece<M>>> {
        let mut load = |(figures, file): &(PieceFigures, RecordFile<u32>)| {
            let room = room(file.size_bytes())?;
            Ok(figures.piece(&file.read_all()?, room))
        };
        self.pieces.values().map(&mut load).collect()
    }

    /// Writes those of `pieces` that are not in a file, and notes all that are.
    pub(super) fn save<'p, M: Metric>(
        &mut self,
        due: &Due,
        pieces: impl Iterator<Item = &'p Piece<M>>,
        workspace: &Workspace,
    ) -> Result<()> {
        for piece in pieces {
            let (level, index) = (piece.extent.level, piece.extent.index);
            if self.pieces.contains_key(&(level, index)) {
                continue;
            }
            let file = write(piece, workspace)?;
            // What it was joined of has gone into it.
            self.pieces
                .retain(|(l, i), _| *l >= level || i / (FAMILY as u64).pow(level - l) != index);
            self.pieces.insert((level, index), (PieceFigures::of(piece), file));
        }
        let figures = self.pieces.values().map(|(figures, _)| figures).collect();
        let files = self.pieces.values().map(|(_, file)| file.kept()).collect();
        workspace.checkpoint(due, STEP, &Figures { pieces: figures, end: self.end }, files)
    }
}

fn write<M: Metric>(piece: &Piece<M>, workspace: &Workspace) -> Result<RecordFile<u32>> {
    let mut writer = RecordWriter::create(workspace, "piece", None)?;
    let Piece { extent, patch, costs, .. } = piece;
    writer.extend(words(&patch.positions))?;
    writer.extend(words(&patch.carried))?;
    writer.extend(words(&patch.colors))?;
    writer.extend(words(&patch.faces))?;
    writer.extend(words(&patch.shared))?;
    writer.extend(words(&patch.joined))?;
    writer.extend(words(costs))?;
    writer.extend(words(&patch.normals))?;
    writer.extend(words(&patch.settled))?;
    writer.extend(words(&patch.hung))?;
    writer.extend(words(&extent.front))?;
    writer.finish()
}

/// Things made of numbers of four bytes, as those.
fn words<T: IntoBytes + Immutable>(things: &[T]) -> &[u32] {
    // What has no size may lie anywhere.
    if size_of_val(things) == 0 {
        return &[];
    }
    <[u32]>::ref_from_bytes(things.as_bytes()).expect("made of numbers of four bytes")
}

/// Takes the next `count` things off the front.
fn take<T: FromBytes>(words: &mut &[u32], count: usize) -> Vec<T> {
    let one = |things: &mut &[u32]| {
        let (thing, later) = things.split_at(size_of::<T>() / size_of::<u32>());
        *things = later;
        T::read_from_bytes(thing.as_bytes()).expect("made of numbers of four bytes")
    };
    (0..count).map(|_| one(words)).collect()
}

impl PieceFigures {
    fn of<M: Metric>(piece: &Piece<M>) -> Self {
        let Piece { extent, patch, costs, .. } = piece;
        Self {
            level: extent.level,
            index: extent.index,
            triangles: extent.triangles,
            degenerate: extent.degenerate,
            split: extent.split,
            until: extent.until.map(|until| format!("{:x}", until.bits())),
            unit: patch.unit.to_bits(),
            counts: Counts {
                positions: patch.positions.len(),
                carried: patch.carried.len(),
                colors: patch.colors.len(),
                faces: patch.faces.len(),
                shared: patch.shared.len(),
                joined: patch.joined.len(),
                costs: costs.len(),
                normals: patch.normals.len(),
                settled: patch.settled.len(),
                hung: patch.hung.len(),
                front: extent.front.len(),
            },
        }
    }

    fn piece<M: Metric>(&self, mut words: &[u32], room: Reservation) -> Piece<M> {
        let (words, counts) = (&mut words, &self.counts);
        let mut patch = Patch {
            positions: take::<[f32; 3]>(words, counts.positions)
                .into_iter()
                .map(Into::into)
                .collect(),
            carried: take(words, counts.carried),
            colors: take(words, counts.colors),
            faces: take(words, counts.faces),
            shared: take(words, counts.shared),
            joined: take(words, counts.joined),
            unit: f32::from_bits(self.unit),
            ..Patch::default()
        };
        let costs = take(words, counts.costs);
        let normals = take::<[f32; 3]>(words, counts.normals);
        patch.normals = normals.into_iter().map(Into::into).collect();
        patch.settled = take(words, counts.settled);
        patch.hung = take(words, counts.hung);
        let front = take(words, counts.front);
        let until = self.until.as_ref().and_then(|digits| u128::from_str_radix(digits, 16).ok());
        let extent = Extent {
            level: self.level,
            index: self.index,
            triangles: self.triangles,
            degenerate: self.degenerate,
            split: self.split,
            front,
            until: until.map(SweepPlace::of_bits),
        };
        Piece { extent, patch, costs, room }
    }
}
