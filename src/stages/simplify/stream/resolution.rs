//! The resolution level of what is in core, and how far to decimate before anything is written
//! `[WK03 §4.1]`.

/// Counts of a stream under way, and the share of it that is wanted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Resolution {
    /// Share of the triangles to keep: p.
    pub(super) ratio: f64,
    /// Triangles read: `N_in`.
    pub(super) read: u64,
    /// Triangles written: `N_out`.
    pub(super) written: u64,
}

/// What to do with a full window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Step {
    /// DECIMATE to so many faces in core.
    pub(super) decimate_to: usize,
    /// Then WRITE until so many are left.
    pub(super) write_to: usize,
}

impl Resolution {
    /// How many faces in core stand for what was read and not yet written at a resolution level of
    /// exactly p. The level of the paper, R = `N_current` / (`N_in` − `N_out` / p), is p where
    /// `N_current` is this: p `N_in` − `N_out`.
    pub(super) fn in_core_wanted(&self) -> usize {
        let wanted = (self.read as f64 * self.ratio).floor() as u64;
        wanted.saturating_sub(self.written) as usize
    }

    /// What makes room in a window that holds `faces` of at most `faces_max`: half of it.
    ///
    /// While p is not reached with half a window, as in the paper's initialisation, that half is
    /// all decimation: what is not yet coarse enough is not written. Later, decimation goes to
    /// the level p, and writing to half a window: in the long run (1 − p) / 4 of a window in
    /// collapses and p / 2 in triangles written, as in the paper's main loop. The paper counts
    /// both in advance; steering by the level makes up for what could not be collapsed.
    pub(super) fn step(&self, faces: usize) -> Step {
        let half = faces / 2;
        let decimate_to = self.in_core_wanted().clamp(half, faces);
        Step { decimate_to, write_to: half }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs READ, DECIMATE and WRITE on counts alone: per round, collapses and triangles written.
    fn rounds(ratio: f64, faces_max: usize, rounds: usize) -> Vec<(usize, usize)> {
        let (mut level, mut faces) = (Resolution { ratio, read: 0, written: 0 }, 0);
        let round = |_| {
            level.read += (faces_max - faces) as u64;
            let step = level.step(faces_max);
            let done = ((faces_max - step.decimate_to) / 2, step.decimate_to - step.write_to);
            level.written += done.1 as u64;
            faces = step.write_to;
            done
        };
        (0..rounds).map(round).collect()
    }

    #[test]
    fn nothing_is_written_until_half_a_window_is_coarse_enough() {
        // p = 1/4: the paper reads half a window and three times another, decimating each time.
        let done = rounds(0.25, 1000, 8);
        assert_eq!(done[..3], [(250, 0); 3]);
        // Then READ(N/2), DECIMATE((1 − p) N/4), WRITE(p/2 N), for ever.
        assert_eq!(done[3..], [(187, 125); 5]);
    }

    #[test]
    fn the_main_loop_has_the_proportion_of_the_paper_for_any_ratio() {
        for ratio in [0.9, 0.5, 0.3, 0.1, 0.013] {
            let n = 100_000;
            let done = rounds(ratio, n, 300);
            let (collapses, written) = done[done.len() - 1];
            assert!((collapses as f64 - (1.0 - ratio) * n as f64 / 4.0).abs() < 2.0);
            assert!((written as f64 - ratio / 2.0 * n as f64).abs() < 2.0);
        }
    }

    #[test]
    fn collapses_that_were_illegal_are_made_up_for() {
        let level = Resolution { ratio: 0.25, read: 10_000, written: 2000 };
        // 500 faces in core have the level p, whatever there are.
        assert_eq!(level.step(1000), Step { decimate_to: 500, write_to: 500 });
        assert_eq!(level.step(900), Step { decimate_to: 500, write_to: 450 });
        assert_eq!(level.step(400), Step { decimate_to: 400, write_to: 200 });
        let over = Resolution { written: 3000, ..level };
        assert_eq!(over.in_core_wanted(), 0);
    }
}
