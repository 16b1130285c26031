//! The state that all record loops share: the policy for bad records and what came of it, the
//! origin, and the strip under way.

use super::super::{
    Batch, OnDefect, Origin,
    fault::{FormatError, Result},
    findings::{DefectKind, Findings},
};
use crate::error::{Fault, Position};

/// Stands for an index that is out of range in a strip.
const NO_VERTEX: u64 = u64::MAX;

/// See the module.
pub(super) struct Intake {
    pub(super) on_defect: OnDefect,
    pub(super) findings: Findings,
    pub(super) origin: Origin,
    /// Positions go through the origin; otherwise they are stored as they come.
    pub(super) is_placed: bool,
    /// Vertices that indices may refer to.
    pub(super) vertices: u64,
    /// Indices of one face, reused.
    pub(super) corners: Vec<u64>,
    pub(super) strip: Strip,
}

/// A triangle strip that continues in the next batch.
#[derive(Default)]
pub(super) struct Strip {
    /// Indices of the list still to come.
    pub(super) left: u64,
    /// The last two vertices, the older one first.
    window: [u64; 2],
    /// Vertices since the last restart.
    seen: u64,
}

impl Intake {
    /// Stores a position relative to the origin; one that is not finite becomes NaN.
    #[inline]
    pub(super) fn place(&mut self, position: [f64; 3]) -> Option<[f32; 3]> {
        let placed =
            if self.is_placed { self.origin.place(position) } else { position.map(|c| c as f32) };
        placed.iter().all(|c| c.is_finite()).then_some(placed)
    }

    /// Counts a vertex that is not finite.
    #[cold]
    pub(super) fn bad_vertex(&mut self, at: impl FnOnce() -> Position) -> Result<()> {
        if self.on_defect == OnDefect::Fail {
            return Err(FormatError::input(at(), Fault::NotFinite));
        }
        self.findings.add_one(DefectKind::NotFinite, at);
        Ok(())
    }

    /// Counts a face with an index that is out of range.
    #[cold]
    pub(super) fn bad_index(&mut self, index: u64, at: impl FnOnce() -> Position) -> Result<()> {
        if self.on_defect == OnDefect::Fail {
            // Signed indices were widened with their sign.
            let fault = Fault::IndexOutOfRange { index: index as i64, vertices: self.vertices };
            return Err(FormatError::input(at(), fault));
        }
        self.findings.add_one(DefectKind::IndexOutOfRange, at);
        Ok(())
    }

    /// Takes the next index of a strip: each one after the second makes a triangle with the two
    /// before it, every other one turned over so that all face the same way; -1 starts anew.
    pub(super) fn strip_index(
        &mut self,
        index: u64,
        at: impl Fn() -> Position,
        batch: &mut Batch,
    ) -> Result<()> {
        let is_restart =
            index == u64::MAX || (index == u64::from(u32::MAX) && index >= self.vertices);
        if is_restart {
            self.strip.seen = 0;
            return Ok(());
        }
        let mut c = index;
        if index >= self.vertices {
            self.bad_index(index, &at)?;
            c = NO_VERTEX;
        }
        let [a, b] = self.strip.window;
        self.strip.window = [b, c];
        self.strip.seen += 1;
        if self.strip.seen < 3 || [a, b, c].contains(&NO_VERTEX) {
            return Ok(());
        }
        if a == b || b == c || c == a {
            // Strips are stitched with these: they were never part of the surface.
            self.findings.add_one(DefectKind::Degenerate, at);
            return Ok(());
        }
        let triangle = if self.strip.seen % 2 == 1 { [a, b, c] } else { [b, a, c] };
        batch.faces.push(&triangle);
        Ok(())
    }

    /// Begins a strip of `indices`.
    pub(super) fn begin_strip(&mut self, indices: u64) {
        self.strip = Strip { left: indices, ..Strip::default() };
    }
}
