//! A recording turned round: the base, and splits in batches, as they are stored.

use rayon::prelude::*;

use super::{
    Growing, Recording,
    growing::guess,
    record::{Collapse, Colors},
    walk::walk,
};
use crate::{
    formats::progressive::{BATCH_SPLITS_MAX, Base, Deviation, Header, Split},
    progress::{Cancelled, Meter},
};

/// Splits that one thread works out one after the other.
const PIECE: usize = 1 << 8;

/// The ends of a recording; between them are its batches.
pub struct Turned {
    /// The coarsest mesh.
    pub base: Base,
    /// The finest mesh.
    pub finest: Growing,
}

/// Turns a recording round. `look` sees the mesh before the first batch of splits and after each,
/// `take` gets the batches.
///
/// # Errors
/// Cancellation; the meter counts splits.
pub fn turn_round(
    recording: Recording,
    header: &Header,
    meter: &Meter,
    look: &mut dyn FnMut(&Growing),
    take: &mut dyn FnMut(Vec<Split>),
) -> Result<Turned, Cancelled> {
    let vertices = recording.positions.len();
    let faces = recording.faces.len() + 2 * recording.collapses.len();
    let mut turn = Turn { numbers: vec![u32::MAX; vertices], recording };
    let base = turn.base();
    let mut growing = Growing::of_base(&base, header);
    growing.make_room(vertices, faces);
    look(&growing);
    let mut end = turn.recording.collapses.len();
    let rounds = std::mem::take(&mut turn.recording.rounds);
    for round in (0..rounds.len()).rev() {
        let start = round.checked_sub(1).map_or(0, |before| rounds[before]);
        let mut order: Vec<(u32, u32)> = (start..end)
            .map(|index| (turn.number(turn.recording.collapses[index].kept), index as u32))
            .collect();
        order.par_sort_unstable();
        for part in order.chunks(BATCH_SPLITS_MAX as usize) {
            let splits = turn.batch(part, &mut growing);
            meter.add(splits.len() as u64)?;
            take(splits);
            look(&growing);
        }
        end = start;
    }
    Ok(Turned { base, finest: growing })
}

struct Turn {
    /// By vertex of the mesh that was decimated, its number here.
    numbers: Vec<u32>,
    recording: Recording,
}

impl Turn {
    fn number(&self, vertex: u32) -> u32 {
        self.numbers[vertex as usize]
    }

    /// What was left, its faces beside each other and its vertices in the order of the faces.
    fn base(&mut self) -> Base {
        let mut base = Base { deviation: Deviation::default(), ..Base::default() };
        for face in walk(&self.recording.faces) {
            let corners = face.map(|vertex| {
                let number = &mut self.numbers[vertex as usize];
                if *number == u32::MAX {
                    *number = base.positions.len() as u32;
                    base.positions.push(self.recording.positions[vertex as usize]);
                    base.colors.extend(self.recording.last_colors.get(vertex as usize));
                }
                *number
            });
            base.faces.push(corners);
        }
        base
    }

    /// The splits that undo some collapses, given behind the numbers of their parents, and does them.
    fn batch(&mut self, part: &[(u32, u32)], growing: &mut Growing) -> Vec<Split> {
        // They leave each other alone: what one needs is the same before the others and after them.
        let found = part.par_iter().with_min_len(PIECE).map_init(Vec::new, |walked, &one| {
            let split = self.split(one, growing, walked);
            split.expect("a collapse that was done can be undone")
        });
        let splits: Vec<Split> = found.collect();
        for (split, &(_, index)) in splits.iter().zip(part) {
            let removed = self.recording.collapses[index as usize].removed;
            self.numbers[removed as usize] = growing.positions().len() as u32;
            growing.split(split).expect("what was found in a fan is there");
        }
        splits
    }

    /// The split that undoes a collapse, given behind the number of its parent.
    fn split(
        &self,
        (parent, index): (u32, u32),
        growing: &Growing,
        walked: &mut Vec<u32>,
    ) -> Option<Split> {
        let Collapse { removed, apexes, places: [before, after], .. } =
            self.recording.collapses[index as usize];
        debug_assert_eq!(growing.positions()[parent as usize], after, "as it was left");
        let number = |apex: Option<u32>| apex.map(|apex| self.number(apex));
        let (kind, first, taken) = growing.sector(parent, apexes.map(number), walked)?;
        let difference = |from: [u32; 3], to: [u32; 3]| {
            std::array::from_fn(|axis| to[axis].wrapping_sub(from[axis]) as i32)
        };
        let new = self.recording.positions[removed as usize];
        let mut split = Split {
            parent,
            kind,
            first,
            taken,
            step: difference(after, before),
            rest: difference(guess(after, before), new),
            ..Split::default()
        };
        if let Some(colors) = self.recording.colors.get(index as usize) {
            add_colors(&mut split, colors);
        }
        Some(split)
    }
}

fn add_colors(split: &mut Split, [before, after, removed]: &Colors) {
    let difference =
        |from: &[u8; 4], to: &[u8; 4]| std::array::from_fn(|c| to[c].wrapping_sub(from[c]));
    split.color_step = difference(after, before);
    split.color_rest = difference(after, removed);
}
