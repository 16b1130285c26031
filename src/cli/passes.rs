//! The passes of a job as its events tell them: those under way, and the time each stage took.
//!
//! It reads no clock: the time of an event comes with it.

use std::{collections::VecDeque, time::Duration};

use meshmill::progress::{Amount, StageId};

/// Time and records of one stage, all of its passes added up.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct StageTime {
    /// Name of the stage.
    pub(crate) name: &'static str,
    /// Seconds from the start to the end of its passes.
    pub(crate) seconds: f64,
    /// Records its passes visited.
    pub(crate) records: u64,
}

/// A pass under way, or at its end.
#[derive(Clone, Debug)]
pub(super) struct Pass {
    /// Tells passes of one stage apart.
    pub(super) serial: u64,
    pub(super) stage: StageId,
    pub(super) total: Option<u64>,
    /// Of the whole pass, on disk.
    pub(super) bytes: Option<u64>,
    /// Never decreases.
    pub(super) done: u64,
    /// On the display's clock, as all times here.
    pub(super) started_at: Duration,
    /// When the display last said something of it.
    pub(super) shown_at: Duration,
    /// Records that were done at times since about half of what is done now.
    pub(super) marks: VecDeque<(Duration, u64)>,
}

/// Between two marks. Chosen by hand: a day of them is a megabyte or two.
const MARK_INTERVAL: Duration = Duration::from_millis(500);

/// Figures of a pass at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Figures {
    /// Since its start.
    pub(super) elapsed: Duration,
    /// Records per second since its start; 0 when no time has passed.
    pub(super) per_second: f64,
    /// Bytes per second, on disk; `None` when nobody knows them.
    pub(super) bytes_per_second: Option<f64>,
    /// Time to its end at the rate of the last half of what is done, since a pass may wait before
    /// its first record; `None` when the total or the rate is not known.
    pub(super) left: Option<Duration>,
}

impl Pass {
    /// Its figures at time `now`.
    pub(super) fn figures(&self, now: Duration) -> Figures {
        let elapsed = now.saturating_sub(self.started_at);
        let seconds = elapsed.as_secs_f64();
        let per_second = if seconds > 0.0 { self.done as f64 / seconds } else { 0.0 };
        let (since, before) = self.marks.front().copied().unwrap_or((self.started_at, 0));
        let lately = now.saturating_sub(since).as_secs_f64();
        let lately_per_second = (self.done - before) as f64 / lately;
        let left =
            self.total.map(|total| total.saturating_sub(self.done) as f64 / lately_per_second);
        // Division by a rate of 0 is no duration.
        let left = left.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
        let record_bytes = self.bytes.zip(self.total.filter(|total| *total > 0));
        let record_bytes = record_bytes.map(|(bytes, total)| bytes as f64 / total as f64);
        let bytes_per_second = record_bytes.map(|bytes| bytes * per_second);
        Figures { elapsed, per_second, bytes_per_second, left }
    }

    /// `done` records are visited at time `now`.
    fn reach(&mut self, done: u64, now: Duration) {
        // Threads that share a meter report in any order.
        self.done = self.done.max(done);
        if self.marks.back().is_none_or(|(at, _)| now.saturating_sub(*at) >= MARK_INTERVAL) {
            self.marks.push_back((now, self.done));
        }
        let half = self.done / 2;
        while self.marks.get(1).is_some_and(|(_, done)| *done <= half) {
            self.marks.pop_front();
        }
    }
}

/// How far the whole job is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Overall {
    /// Of the time that was expected, 0 to 1.
    pub(super) share: f64,
    /// Time to the end of the job.
    pub(super) left: Duration,
}

/// A stage the job is expected to do.
#[derive(Clone, Copy, Debug)]
struct Expected {
    stage: StageId,
    seconds: f64,
    /// How much of it is done, 0 to 1; never decreases.
    share: f64,
}

/// The rate of a job is its own from this share on; before, it is the one that was expected.
const SHARE_TELLING: f64 = 0.05;

/// All passes of a job.
#[derive(Debug, Default)]
pub(super) struct Passes {
    expected: Vec<Expected>,
    /// When the first pass began.
    started_at: Option<Duration>,
    under_way: Vec<Pass>,
    /// In order of first start.
    stages: Vec<StageTime>,
    started: u64,
}

impl Passes {
    /// So many seconds are expected of the stages to come.
    pub(super) fn expect(&mut self, seconds: &[(StageId, f64)]) {
        let expected = seconds.iter();
        self.expected =
            expected.map(|&(stage, seconds)| Expected { stage, seconds, share: 0.0 }).collect();
    }

    /// How far the job is; `None` when nobody knows how much there is to do.
    pub(super) fn overall(&self, now: Duration) -> Option<Overall> {
        let all: f64 = self.expected.iter().map(|expected| expected.seconds).sum();
        let done: f64 = self.expected.iter().map(|e| e.seconds * e.share).sum();
        let share = done / all;
        let elapsed = now.saturating_sub(self.started_at?).as_secs_f64();
        let speed = if share < SHARE_TELLING { 1.0 } else { done / elapsed };
        let left = Duration::try_from_secs_f64((all - done) / speed).ok()?;
        (all > 0.0).then_some(Overall { share, left })
    }

    /// Notes how far a stage is.
    fn reach(&mut self, stage: StageId, share: f64) {
        let expected = self.expected.iter_mut().filter(|expected| expected.stage == stage);
        expected.for_each(|expected| expected.share = expected.share.max(share.min(1.0)));
    }

    /// A pass begins.
    pub(super) fn start(&mut self, stage: StageId, amount: Amount, now: Duration) -> &Pass {
        let name = stage.name();
        if !self.stages.iter().any(|known| known.name == name) {
            self.stages.push(StageTime { name, seconds: 0.0, records: 0 });
        }
        self.started += 1;
        self.started_at.get_or_insert(now);
        self.under_way.push(Pass {
            serial: self.started,
            stage,
            total: amount.records,
            bytes: amount.bytes,
            done: 0,
            started_at: now,
            shown_at: now,
            marks: VecDeque::from([(now, 0)]),
        });
        &self.under_way[self.under_way.len() - 1]
    }

    /// `done` records are visited. Returns the pass when it was last shown `interval` or longer
    /// ago, and takes it as shown now.
    pub(super) fn advance(
        &mut self,
        stage: StageId,
        done: u64,
        now: Duration,
        interval: Duration,
    ) -> Option<&Pass> {
        let index = self.find(stage)?;
        let pass = &mut self.under_way[index];
        pass.reach(done, now);
        let share = pass.total.map_or(0.0, |total| pass.done as f64 / total.max(1) as f64);
        self.reach(stage, share);
        let pass = &mut self.under_way[index];
        if now.saturating_sub(pass.shown_at) < interval {
            return None;
        }
        pass.shown_at = now;
        Some(pass)
    }

    /// A pass ends. Returns it as it was at its end.
    pub(super) fn finish(&mut self, stage: StageId, done: u64, now: Duration) -> Option<Pass> {
        let index = self.find(stage)?;
        let mut pass = self.under_way.remove(index);
        self.reach(stage, 1.0);
        pass.done = done;
        let seconds = pass.figures(now).elapsed.as_secs_f64();
        if let Some(time) = self.stages.iter_mut().find(|time| time.name == stage.name()) {
            time.seconds += seconds;
            time.records += done;
        }
        Some(pass)
    }

    /// What every finished pass took, by stage.
    pub(super) fn stages(&self) -> Vec<StageTime> {
        self.stages.clone()
    }

    /// The pass of `stage` that began last: events do not say which of several they mean.
    fn find(&self, stage: StageId) -> Option<usize> {
        self.under_way.iter().rposition(|pass| pass.stage == stage)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    #[test]
    fn rate_and_time_left_come_from_the_whole_pass() {
        let mut passes = Passes::default();
        passes.start(StageId::Sort, Some(1000).into(), 10 * SECOND);
        let pass = passes.advance(StageId::Sort, 250, 15 * SECOND, SECOND).unwrap();
        let figures = pass.figures(15 * SECOND);
        assert_eq!(figures.elapsed, 5 * SECOND);
        assert_eq!(figures.per_second, 50.0);
        assert_eq!(figures.left, Some(15 * SECOND));
    }

    #[test]
    fn a_wait_before_the_first_records_is_no_slowness() {
        let mut passes = Passes::default();
        passes.start(StageId::Decimate, Some(1000).into(), SECOND);
        for (second, done) in [(101, 100), (102, 200), (103, 300), (104, 400)] {
            passes.advance(StageId::Decimate, done, second * SECOND, SECOND);
        }
        let figures = passes.under_way[0].figures(104 * SECOND);
        assert_eq!(figures.left, Some(6 * SECOND));
        assert_eq!(figures.per_second, 400.0 / 103.0);
    }

    #[test]
    fn without_a_total_or_progress_nobody_knows_the_end() {
        let mut passes = Passes::default();
        let pass = passes.start(StageId::Import, None.into(), SECOND);
        assert_eq!(pass.figures(2 * SECOND).left, None);
        let pass = passes.start(StageId::Sort, Some(10).into(), SECOND);
        assert_eq!(pass.figures(SECOND).left, None);
        assert_eq!(pass.figures(2 * SECOND).left, None);
    }

    #[test]
    fn a_pass_is_shown_once_an_interval() {
        let mut passes = Passes::default();
        passes.start(StageId::Sort, None.into(), Duration::ZERO);
        let mut shown = Vec::new();
        for tenth in 1..=100 {
            let now = Duration::from_millis(tenth * 100);
            if passes.advance(StageId::Sort, tenth, now, 3 * SECOND).is_some() {
                shown.push(tenth);
            }
        }
        assert_eq!(shown, [30, 60, 90]);
    }

    #[test]
    fn records_never_go_back() {
        let mut passes = Passes::default();
        passes.start(StageId::Sort, None.into(), Duration::ZERO);
        passes.advance(StageId::Sort, 500, SECOND, SECOND);
        let pass = passes.advance(StageId::Sort, 400, 2 * SECOND, SECOND).unwrap();
        assert_eq!(pass.done, 500);
    }

    #[test]
    fn passes_of_a_stage_add_up_in_order_of_first_start() {
        let mut passes = Passes::default();
        for (stage, start, end) in
            [(StageId::Import, 0, 1), (StageId::Cluster, 1, 4), (StageId::Import, 4, 6)]
        {
            passes.start(stage, None.into(), start * SECOND);
            passes.finish(stage, 100, end * SECOND).unwrap();
        }
        let time = |name, seconds, records| StageTime { name, seconds, records };
        assert_eq!(passes.stages(), [time("import", 3.0, 200), time("cluster", 3.0, 100)]);
    }

    #[test]
    fn the_whole_job_goes_by_what_was_expected_and_then_by_what_it_does() {
        let mut passes = Passes::default();
        assert_eq!(passes.overall(SECOND), None);
        passes.expect(&[(StageId::Import, 10.0), (StageId::Decimate, 90.0)]);
        passes.start(StageId::Import, Some(100).into(), SECOND);
        let overall = |share, left| Some(Overall { share, left: left * SECOND });
        assert_eq!(passes.overall(2 * SECOND), overall(0.0, 100));
        passes.finish(StageId::Import, 100, 21 * SECOND).unwrap();
        assert_eq!(passes.overall(21 * SECOND), overall(0.1, 180));
        passes.start(StageId::Decimate, Some(90).into(), 21 * SECOND);
        passes.advance(StageId::Decimate, 45, 111 * SECOND, SECOND);
        assert_eq!(passes.overall(111 * SECOND), overall(0.55, 90));
    }

    #[test]
    fn an_end_without_a_beginning_is_ignored() {
        let mut passes = Passes::default();
        assert!(passes.finish(StageId::Sort, 1, SECOND).is_none());
        assert!(passes.advance(StageId::Sort, 1, SECOND, SECOND).is_none());
    }
}
