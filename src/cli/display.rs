//! What a person or program sees of a running job, on standard error.
//!
//! A [`Display`] is the job's observer. Worker threads call it; news that comes while another
//! thread is showing something is dropped, since newer news will come, so no thread waits to say
//! how far it is. Only the start and the end of a pass are never dropped.

use std::{
    io::{self, IsTerminal as _, Write as _},
    sync::{Mutex, MutexGuard, PoisonError, TryLockError},
    time::{Duration, Instant, SystemTime},
};

use indicatif::ProgressDrawTarget;
use meshmill::progress::{Amount, Event, Observer, StageId};

use super::{
    bars::Bars,
    lines::{self, JsonKind, Moment},
    passes::{Overall, Pass, Passes, StageTime},
};

/// How progress is shown, `--progress`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Style {
    /// Bars on a terminal, lines elsewhere.
    #[default]
    Auto,
    /// Bars; lines where standard error is no terminal.
    Bar,
    /// A line when a stage has finished, and now and then before.
    Lines,
    /// One JSON object a line.
    Json,
    /// Nothing.
    None,
}

/// How much is shown to a person.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Volume {
    /// Errors only, `-q`. JSON, which is for programs, is written nevertheless.
    Quiet,
    /// Progress and messages.
    Normal,
}

/// Shows a job while it runs, and remembers what its stages took.
pub(crate) struct Display {
    /// Time since the display was made.
    clock: Box<dyn Fn() -> Duration + Send + Sync>,
    /// The time of day it was made, for time stamps.
    unix_seconds: u64,
    state: Mutex<State>,
}

struct State {
    passes: Passes,
    surface: Surface,
}

/// Takes a line, without its line feed.
type Sink = Box<dyn FnMut(&str) + Send>;

/// Where and how events are shown.
enum Surface {
    Bars(Bars),
    Lines(Sink),
    Json(Sink),
    Nothing,
}

/// Between two redraws of a bar. Chosen by hand: faster cannot be read.
const BAR_INTERVAL: Duration = Duration::from_millis(100);
/// Between two lines about one pass. Chosen by hand: an hour is two screens of log.
const LINE_INTERVAL: Duration = Duration::from_secs(30);
/// Between two JSON objects about one pass. Chosen by hand: what a display made of them needs.
const JSON_INTERVAL: Duration = Duration::from_millis(500);

impl Display {
    /// A display on standard error.
    pub(crate) fn new(style: Style, volume: Volume) -> Self {
        let surface = match (style, volume) {
            (Style::Json, _) => Surface::Json(Box::new(write_line)),
            (Style::None, _) | (_, Volume::Quiet) => Surface::Nothing,
            (Style::Auto | Style::Bar, _) if io::stderr().is_terminal() => {
                Surface::Bars(Bars::new(ProgressDrawTarget::stderr()))
            }
            (Style::Auto | Style::Bar | Style::Lines, _) => Surface::Lines(Box::new(write_line)),
        };
        let started = Instant::now();
        let unix = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        Self::with_clock(surface, Box::new(move || started.elapsed()), unix.as_secs())
    }

    fn with_clock(
        surface: Surface,
        clock: Box<dyn Fn() -> Duration + Send + Sync>,
        unix_seconds: u64,
    ) -> Self {
        let state = Mutex::new(State { passes: Passes::default(), surface });
        Self { clock, unix_seconds, state }
    }

    /// So many seconds are expected of the stages of the job.
    pub(crate) fn expect(&self, seconds: &[(StageId, f64)]) {
        self.lock().passes.expect(seconds);
    }

    /// Says something to the person, above the bars.
    pub(crate) fn say(&self, text: &str) {
        match &mut self.lock().surface {
            Surface::Bars(bars) => ignore_closed(bars.print(text)),
            Surface::Lines(sink) => sink(text),
            Surface::Json(sink) => sink(&lines::json_message(text)),
            Surface::Nothing => {}
        }
    }

    /// Time and records of every stage, for the report; in order of first start.
    pub(crate) fn stages(&self) -> Vec<StageTime> {
        self.lock().passes.stages()
    }

    /// Removes the bars that are left at the end of a job, so that what came of it stands alone.
    pub(crate) fn close(&self) {
        if let Surface::Bars(bars) = &mut self.lock().surface {
            bars.clear();
        }
    }

    /// A thread that panicked here left nothing half done that matters more than showing the rest.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Observer for Display {
    fn on(&self, event: &Event) {
        let now = (self.clock)();
        match *event {
            Event::Started { stage, total, bytes } => {
                let State { passes, surface } = &mut *self.lock();
                let amount = Amount { records: total, bytes };
                surface.started(passes.start(stage, amount, now), now);
            }
            Event::Advanced { stage, done } => {
                let mut state = match self.state.try_lock() {
                    Ok(state) => state,
                    Err(TryLockError::Poisoned(poisoned)) => poisoned.into_inner(),
                    Err(TryLockError::WouldBlock) => return,
                };
                let State { passes, surface } = &mut *state;
                if let Some(pass) = passes.advance(stage, done, now, surface.interval()).cloned() {
                    let at = Moment { now, unix_seconds: self.unix_seconds + now.as_secs() };
                    surface.advanced(&pass, at, passes.overall(now));
                }
            }
            Event::Finished { stage, done } => {
                let State { passes, surface } = &mut *self.lock();
                if let Some(pass) = passes.finish(stage, done, now) {
                    surface.finished(&pass, now);
                }
            }
            _ => {}
        }
    }
}

impl Surface {
    /// Time between two notices about one pass.
    fn interval(&self) -> Duration {
        match self {
            Self::Bars(_) => BAR_INTERVAL,
            Self::Lines(_) => LINE_INTERVAL,
            Self::Json(_) => JSON_INTERVAL,
            Self::Nothing => Duration::MAX,
        }
    }

    fn started(&mut self, pass: &Pass, now: Duration) {
        match self {
            Self::Bars(bars) => bars.start(pass),
            Self::Json(sink) => sink(&lines::json_event(JsonKind::Started, pass, now, None)),
            Self::Lines(_) | Self::Nothing => {}
        }
    }

    fn advanced(&mut self, pass: &Pass, at: Moment, overall: Option<Overall>) {
        match self {
            Self::Bars(bars) => bars.advance(pass, at.now, overall),
            Self::Lines(sink) => sink(&lines::advanced(pass, at, overall)),
            Self::Json(sink) => {
                sink(&lines::json_event(JsonKind::Advanced, pass, at.now, overall));
            }
            Self::Nothing => {}
        }
    }

    fn finished(&mut self, pass: &Pass, now: Duration) {
        match self {
            Self::Bars(bars) => ignore_closed(bars.finish(pass, &lines::finished(pass, now))),
            Self::Lines(sink) => sink(&lines::finished(pass, now)),
            Self::Json(sink) => sink(&lines::json_event(JsonKind::Finished, pass, now, None)),
            Self::Nothing => {}
        }
    }
}

/// Writes one line to standard error, in one call so that lines of threads do not mix.
fn write_line(line: &str) {
    ignore_closed(io::stderr().lock().write_all(format!("{line}\n").as_bytes()));
}

/// A job goes on when nobody is there to see it.
fn ignore_closed(result: io::Result<()>) {
    drop(result);
}

#[cfg(test)]
mod tests {
    use std::sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    };

    use meshmill::progress::{Cancel, Monitor, StageId};

    use super::*;

    /// A display whose clock stands until it is set, and the lines it has shown.
    struct Watched {
        display: Display,
        milliseconds: Arc<AtomicU64>,
        shown: Arc<Mutex<Vec<String>>>,
    }

    impl Watched {
        fn new(surface: fn(Sink) -> Surface) -> Self {
            let milliseconds = Arc::new(AtomicU64::new(0));
            let shown = Arc::new(Mutex::new(Vec::new()));
            let (time, lines) = (Arc::clone(&milliseconds), Arc::clone(&shown));
            let sink = move |line: &str| lines.lock().unwrap().push(line.to_owned());
            let clock = move || Duration::from_millis(time.load(Ordering::Relaxed));
            let surface = surface(Box::new(sink));
            let display = Display::with_clock(surface, Box::new(clock), 1_767_225_600);
            Self { display, milliseconds, shown }
        }

        fn at(&self, milliseconds: u64, event: &Event) {
            self.milliseconds.store(milliseconds, Ordering::Relaxed);
            self.display.on(event);
        }

        fn shown(&self) -> Vec<String> {
            self.shown.lock().unwrap().clone()
        }
    }

    const START: Event =
        Event::Started { stage: StageId::Cluster, total: Some(1_000_000), bytes: None };
    const END: Event = Event::Finished { stage: StageId::Cluster, done: 1_000_000 };

    fn advanced(done: u64) -> Event {
        Event::Advanced { stage: StageId::Cluster, done }
    }

    #[test]
    fn lines_come_every_half_minute_and_at_the_end() {
        let watched = Watched::new(Surface::Lines);
        watched.at(0, &START);
        for second in 1..100 {
            watched.at(second * 1000, &advanced(second * 10_000));
        }
        watched.at(100_000, &END);
        let expected = [
            "2026-01-01T00:00:30Z  cluster  30 %  10.0 k/s  ETA 1 min 10 s",
            "2026-01-01T00:01:00Z  cluster  60 %  10.0 k/s  ETA 40 s",
            "2026-01-01T00:01:30Z  cluster  90 %  10.0 k/s  ETA 10 s",
            "cluster           1,000,000 records  1 min 40 s  10.0 k/s",
        ];
        assert_eq!(watched.shown(), expected);
    }

    #[test]
    fn a_short_pass_is_one_line() {
        let watched = Watched::new(Surface::Lines);
        watched.at(0, &START);
        watched.at(100, &advanced(500_000));
        watched.at(500, &END);
        assert_eq!(watched.shown(), ["cluster           1,000,000 records  0.5 s  2.00 M/s"]);
    }

    #[test]
    fn json_comes_twice_a_second_and_at_both_ends() {
        let watched = Watched::new(Surface::Json);
        watched.at(0, &START);
        for step in 1..200 {
            watched.at(step * 10, &advanced(step * 5000));
        }
        watched.at(2000, &END);
        let events: Vec<serde_json::Value> =
            watched.shown().iter().map(|line| serde_json::from_str(line).unwrap()).collect();
        let kinds: Vec<_> = events.iter().map(|event| event["event"].as_str().unwrap()).collect();
        assert_eq!(kinds, ["started", "advanced", "advanced", "advanced", "finished"]);
        assert_eq!(events[1]["done"], 250_000);
        assert_eq!(events[1]["eta_seconds"], 1.5);
        assert_eq!(events[4]["rate"], 500_000.0);
    }

    #[test]
    fn nothing_is_shown_and_all_is_remembered() {
        let watched = Watched::new(|_| Surface::Nothing);
        watched.at(0, &START);
        watched.display.say("hello");
        watched.at(2500, &END);
        let time = StageTime { name: "cluster", seconds: 2.5, records: 1_000_000 };
        assert_eq!(watched.display.stages(), [time]);
        assert!(watched.shown().is_empty());
    }

    #[test]
    fn messages_go_where_progress_goes() {
        for (surface, line) in [
            (Surface::Lines as fn(Sink) -> Surface, "a hint"),
            (Surface::Json, r#"{"event":"message","text":"a hint"}"#),
        ] {
            let watched = Watched::new(surface);
            watched.display.say("a hint");
            assert_eq!(watched.shown(), [line]);
        }
    }

    #[test]
    fn threads_that_report_at_once_lose_no_record_at_the_end() {
        let watched = Watched::new(Surface::Json);
        let monitor = Monitor { observer: &watched.display, cancel: Cancel::default() };
        let meter = monitor.meter(StageId::Sort, Some(8_000_000));
        std::thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| (0..1000).for_each(|_| meter.add(1000).unwrap()));
            }
        });
        meter.finish();
        assert_eq!(watched.display.stages()[0].records, 8_000_000);
        assert!(watched.shown().last().unwrap().contains(r#""done":8000000"#));
    }

    #[test]
    fn an_advance_never_waits_for_another_thread() {
        let watched = Watched::new(Surface::Json);
        watched.at(0, &START);
        let held = watched.display.state.lock().unwrap();
        watched.at(5000, &advanced(1));
        drop(held);
        assert_eq!(watched.shown().len(), 1);
    }

    #[test]
    fn quiet_silences_people_and_not_programs() {
        let surface = |style, volume| Display::new(style, volume).lock().surface.interval();
        assert_eq!(surface(Style::Lines, Volume::Quiet), Duration::MAX);
        assert_eq!(surface(Style::None, Volume::Normal), Duration::MAX);
        assert_eq!(surface(Style::Json, Volume::Quiet), JSON_INTERVAL);
        assert_eq!(surface(Style::Lines, Volume::Normal), LINE_INTERVAL);
    }

    #[test]
    fn bars_that_are_left_are_removed() {
        let bars = Bars::new(ProgressDrawTarget::hidden());
        let display = Display::with_clock(Surface::Bars(bars), Box::new(|| Duration::ZERO), 0);
        display.on(&START);
        display.on(&advanced(1));
        display.close();
        display.on(&END);
        assert_eq!(display.stages()[0].records, 1_000_000);
    }
}
