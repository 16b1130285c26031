//! Progress as bars on a terminal: one for each pass under way, gone when it ends.

use std::{borrow::Cow, io, time::Duration};

use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::{
    figures::{rates, short},
    lines::{NAME_WIDTH, eta, whole},
    passes::{Overall, Pass},
};

/// With a total: how full it is.
const BAR: &str = "{prefix} {elapsed:>4} [{bar:16}] {wide_msg}";
/// Without one: that it moves.
const SPINNER: &str = "{prefix} {elapsed:>4} {spinner} {wide_msg}";

/// The line of the whole job.
const WHOLE: &str = "{wide_msg}";

/// The clock in a bar goes on between two events.
const TICK: Duration = Duration::from_millis(250);

/// The bars of all passes under way.
pub(super) struct Bars {
    area: MultiProgress,
    /// By serial number of the pass.
    under_way: Vec<(u64, ProgressBar)>,
    /// The line of the whole job, once there is something to say.
    whole: Option<ProgressBar>,
}

impl Bars {
    /// Bars on `target`.
    pub(super) fn new(target: ProgressDrawTarget) -> Self {
        Self { area: MultiProgress::with_draw_target(target), under_way: Vec::new(), whole: None }
    }

    /// Draws the bar of a new pass.
    pub(super) fn start(&mut self, pass: &Pass) {
        let bar = match pass.total {
            Some(total) => ProgressBar::new(total).with_style(style(BAR).progress_chars("=> ")),
            None => ProgressBar::no_length().with_style(style(SPINNER)),
        };
        let bar = match &self.whole {
            Some(whole) => self.area.insert_before(whole, bar),
            None => self.area.add(bar),
        };
        bar.set_prefix(format!("{:<NAME_WIDTH$}", pass.stage.name()));
        bar.enable_steady_tick(TICK);
        self.under_way.push((pass.serial, bar));
    }

    /// Draws how far a pass is.
    pub(super) fn advance(&mut self, pass: &Pass, now: Duration, overall: Option<Overall>) {
        if let Some((_, bar)) = self.under_way.iter().find(|(serial, _)| *serial == pass.serial) {
            bar.set_message(message(pass, now));
            bar.set_position(pass.done);
        }
        if let Some(overall) = overall {
            let bar = self.whole.get_or_insert_with(|| {
                // Below all others, those to come included.
                let bar = self.area.add(ProgressBar::no_length().with_style(style(WHOLE)));
                bar.enable_steady_tick(TICK);
                bar
            });
            bar.set_message(whole(overall));
        }
    }

    /// Removes the bar of a pass and prints `line` above those that are left.
    pub(super) fn finish(&mut self, pass: &Pass, line: &str) -> io::Result<()> {
        if let Some(index) = self.under_way.iter().position(|(serial, _)| *serial == pass.serial) {
            let (_, bar) = self.under_way.swap_remove(index);
            bar.finish_and_clear();
            self.area.remove(&bar);
        }
        self.print(line)
    }

    /// Prints a line above the bars.
    pub(super) fn print(&self, line: &str) -> io::Result<()> {
        self.area.println(line)
    }

    /// Removes the bars of passes that did not come to their end.
    pub(super) fn clear(&mut self) {
        for bar in self.under_way.drain(..).map(|(_, bar)| bar).chain(self.whole.take()) {
            bar.finish_and_clear();
        }
    }
}

/// What stands right of the bar: `38.6 M/s  ETA 3.2 s  12.3 M / 99.9 M`, which fits 80 columns with a
/// rate in bytes. The counts come last: they are what a narrower terminal cuts off.
fn message(pass: &Pass, now: Duration) -> Cow<'static, str> {
    let figures = pass.figures(now);
    let total = pass.total.map(|total| format!(" / {}", short(total as f64))).unwrap_or_default();
    let (rates, eta) = (rates(&figures), eta(figures.left));
    format!("{rates}{eta}  {}{total}", short(pass.done as f64)).into()
}

/// The style of a template; a test holds that both are understood.
fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar())
}

#[cfg(test)]
mod tests {
    use meshmill::progress::StageId;

    use super::*;
    use crate::cli::passes::Passes;

    #[test]
    fn the_templates_are_understood() {
        for template in [BAR, SPINNER, WHOLE] {
            ProgressStyle::with_template(template).unwrap();
        }
    }

    #[test]
    fn a_bar_says_how_much_how_fast_and_how_long_still() {
        let mut passes = Passes::default();
        passes.start(StageId::Sort, Some(100_000).into(), Duration::ZERO);
        let now = Duration::from_secs(5);
        let pass = passes.advance(StageId::Sort, 20_000, now, Duration::ZERO).unwrap();
        assert_eq!(message(pass, now), "4.00 k/s  ETA 20 s  20.0 k / 100 k");
        passes.start(StageId::Import, None.into(), Duration::ZERO);
        let pass = passes.advance(StageId::Import, 20_000, now, Duration::ZERO).unwrap();
        assert_eq!(message(pass, now), "4.00 k/s  20.0 k");
    }

    #[test]
    fn bars_come_and_go_with_their_passes() {
        let mut bars = Bars::new(ProgressDrawTarget::hidden());
        let mut passes = Passes::default();
        for stage in [StageId::Sort, StageId::Cluster] {
            bars.start(passes.start(stage, Some(10).into(), Duration::ZERO));
        }
        let pass = passes.finish(StageId::Sort, 10, Duration::from_secs(1)).unwrap();
        let overall = Overall { share: 0.5, left: Duration::from_secs(1) };
        bars.advance(&pass, Duration::from_secs(1), Some(overall));
        bars.finish(&pass, "done").unwrap();
        assert_eq!(bars.under_way.len(), 1);
        bars.clear();
        assert!(bars.under_way.is_empty());
    }
}
