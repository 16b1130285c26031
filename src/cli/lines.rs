//! Progress as plain lines, for people who read a log, and as JSON, for programs.

use std::time::Duration;

use serde::Serialize;

use super::{
    figures::{count, per_cent, rate, span, time_stamp},
    passes::{Figures, Pass},
};

/// `cluster     123,456,789 records  3.2 s  38.6 M/s`.
pub(super) fn finished(pass: &Pass, now: Duration) -> String {
    let figures = pass.figures(now);
    let (records, time) = (count(pass.done), span(figures.elapsed));
    format!(
        "{:<NAME_WIDTH$} {records:>15} records  {time}  {}",
        pass.stage.name(),
        rate(figures.per_second)
    )
}

/// `2026-03-01T23:59:05Z  cluster  42 %  38.6 M/s  ETA 3.2 s`, or with the count when the total is
/// not known.
pub(super) fn advanced(pass: &Pass, now: Duration, unix_seconds: u64) -> String {
    let figures = pass.figures(now);
    let done = match pass.total {
        Some(total) => format!("{} %", per_cent(pass.done, total)),
        None => format!("{} records", count(pass.done)),
    };
    let (time, rate, eta) = (time_stamp(unix_seconds), rate(figures.per_second), eta(&figures));
    format!("{time}  {}  {done}  {rate}{eta}", pass.stage)
}

/// `  ETA 3.2 s`, to follow other figures; empty when nobody knows.
pub(super) fn eta(figures: &Figures) -> String {
    figures.left.map(|left| format!("  ETA {}", span(left))).unwrap_or_default()
}

/// Columns of a stage's name.
pub(super) const NAME_WIDTH: usize = 11;

/// Kind of a [`JsonEvent`].
#[derive(Clone, Copy, Debug, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum JsonKind {
    /// A pass begins.
    Started,
    /// A pass is under way.
    Advanced,
    /// A pass has ended.
    Finished,
}

/// One line of `--progress json`. The names are a contract.
#[derive(Serialize)]
struct JsonEvent {
    event: JsonKind,
    stage: &'static str,
    done: u64,
    total: Option<u64>,
    seconds: f64,
    rate: f64,
    eta_seconds: Option<f64>,
}

/// A message to a person, as a line of `--progress json`.
#[derive(Serialize)]
struct JsonMessage<'a> {
    event: &'static str,
    text: &'a str,
}

/// One event as JSON; numbers have milliseconds, and tenths of a record per second.
pub(super) fn json_event(event: JsonKind, pass: &Pass, now: Duration) -> String {
    let figures = pass.figures(now);
    let milliseconds = |span: Duration| (span.as_secs_f64() * 1e3).round() / 1e3;
    to_json(&JsonEvent {
        event,
        stage: pass.stage.name(),
        done: pass.done,
        total: pass.total,
        seconds: milliseconds(figures.elapsed),
        rate: (figures.per_second * 10.0).round() / 10.0,
        eta_seconds: figures.left.map(milliseconds),
    })
}

/// A message as JSON.
pub(super) fn json_message(text: &str) -> String {
    to_json(&JsonMessage { event: "message", text })
}

/// Serialising plain fields to a string cannot fail.
fn to_json(value: &impl Serialize) -> String {
    serde_json::to_string(value).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use meshmill::progress::StageId;

    use super::*;
    use crate::cli::passes::Passes;

    const START: Duration = Duration::from_secs(100);

    /// A cluster pass with `done` records, and the time `seconds` after its start.
    fn pass(done: u64, total: Option<u64>, seconds: f64) -> (Pass, Duration) {
        let now = START + Duration::from_secs_f64(seconds);
        let mut passes = Passes::default();
        passes.start(StageId::Cluster, total, START);
        (passes.advance(StageId::Cluster, done, now, Duration::ZERO).unwrap().clone(), now)
    }

    #[test]
    fn a_finished_stage_leaves_one_line() {
        let (pass, now) = pass(123_456_789, Some(123_456_789), 3.2);
        assert_eq!(finished(&pass, now), "cluster         123,456,789 records  3.2 s  38.6 M/s");
    }

    #[test]
    fn a_line_under_way_says_when_how_far_how_fast_and_how_long_still() {
        let (known, now) = pass(42_900, Some(100_000), 30.0);
        let line = "2026-01-01T00:00:30Z  cluster  42 %  1.43 k/s  ETA 40 s";
        assert_eq!(advanced(&known, now, 1_767_225_630), line);
        let (unknown, now) = pass(42_900, None, 30.0);
        let line = "2026-01-01T00:00:30Z  cluster  42,900 records  1.43 k/s";
        assert_eq!(advanced(&unknown, now, 1_767_225_630), line);
    }

    #[test]
    fn json_has_every_field_in_every_event() {
        let (known, now) = pass(250, Some(1000), 2.0);
        let line = r#"{"event":"advanced","stage":"cluster","done":250,"total":1000,"seconds":2.0,"rate":125.0,"eta_seconds":6.0}"#;
        assert_eq!(json_event(JsonKind::Advanced, &known, now), line);
        let (unknown, _) = pass(0, None, 0.0);
        let line = r#"{"event":"started","stage":"cluster","done":0,"total":null,"seconds":0.0,"rate":0.0,"eta_seconds":null}"#;
        assert_eq!(json_event(JsonKind::Started, &unknown, START), line);
    }

    #[test]
    fn a_message_is_escaped() {
        assert_eq!(json_message("a \"b\"\n"), r#"{"event":"message","text":"a \"b\"\n"}"#);
    }
}
