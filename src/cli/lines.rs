//! Progress as plain lines, for people who read a log, and as JSON, for programs.

use std::time::Duration;

use serde::Serialize;

use super::{
    figures::{count, per_cent, rates, span, time_stamp},
    passes::{Overall, Pass},
};

/// `cluster     123,456,789 records  3.2 s  38.6 M/s`.
pub(super) fn finished(pass: &Pass, now: Duration) -> String {
    let figures = pass.figures(now);
    let (records, time) = (count(pass.done), span(figures.elapsed));
    let name = pass.stage.name();
    format!("{name:<NAME_WIDTH$} {records:>15} records  {time}  {}", rates(&figures))
}

/// `2026-03-01T23:59:05Z  cluster  42 %  38.6 M/s  ETA 3.2 s`, or with the count when the total is
/// not known.
pub(super) fn advanced(pass: &Pass, at: Moment, overall: Option<Overall>) -> String {
    let figures = pass.figures(at.now);
    let done = match pass.total {
        Some(total) => format!("{} %", per_cent(pass.done, total)),
        None => format!("{} records", count(pass.done)),
    };
    let (time, rates, eta) = (time_stamp(at.unix_seconds), rates(&figures), eta(figures.left));
    let overall = overall.map(|overall| format!("  {}", whole(overall))).unwrap_or_default();
    format!("{time}  {}  {done}  {rates}{eta}{overall}", pass.stage)
}

/// `all 42 %  ETA 12 min 05 s`: how far the whole job is.
pub(super) fn whole(overall: Overall) -> String {
    format!("all {:.0} %{}", overall.share * 100.0, eta(Some(overall.left)))
}

/// When something is said.
#[derive(Clone, Copy, Debug)]
pub(super) struct Moment {
    /// On the display's clock.
    pub(super) now: Duration,
    /// Of the day.
    pub(super) unix_seconds: u64,
}

/// `  ETA 3.2 s`, to follow other figures; empty when nobody knows.
pub(super) fn eta(left: Option<Duration>) -> String {
    left.map(|left| format!("  ETA {}", span(left))).unwrap_or_default()
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
    bytes_per_second: Option<f64>,
    eta_seconds: Option<f64>,
    /// Share of the whole job that is done, and time to its end.
    overall: Option<f64>,
    overall_eta_seconds: Option<f64>,
}

/// A message to a person, as a line of `--progress json`.
#[derive(Serialize)]
struct JsonMessage<'a> {
    event: &'static str,
    text: &'a str,
}

/// One event as JSON; numbers have milliseconds, and tenths of a record per second.
pub(super) fn json_event(
    event: JsonKind,
    pass: &Pass,
    now: Duration,
    overall: Option<Overall>,
) -> String {
    let figures = pass.figures(now);
    let milliseconds = |span: Duration| (span.as_secs_f64() * 1e3).round() / 1e3;
    to_json(&JsonEvent {
        event,
        stage: pass.stage.name(),
        done: pass.done,
        total: pass.total,
        seconds: milliseconds(figures.elapsed),
        rate: (figures.per_second * 10.0).round() / 10.0,
        bytes_per_second: figures.bytes_per_second.map(f64::round),
        eta_seconds: figures.left.map(milliseconds),
        overall: overall.map(|overall| (overall.share * 1e4).round() / 1e4),
        overall_eta_seconds: overall.map(|overall| milliseconds(overall.left)),
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
        passes.start(StageId::Cluster, total.into(), START);
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
        let at = |now| Moment { now, unix_seconds: 1_767_225_630 };
        assert_eq!(advanced(&known, at(now), None), line);
        let overall = Overall { share: 0.421, left: 725 * Duration::from_secs(1) };
        let line = format!("{line}  all 42 %  ETA 12 min 05 s");
        assert_eq!(advanced(&known, at(now), Some(overall)), line);
        let (unknown, now) = pass(42_900, None, 30.0);
        let line = "2026-01-01T00:00:30Z  cluster  42,900 records  1.43 k/s";
        assert_eq!(advanced(&unknown, at(now), None), line);
    }

    #[test]
    fn json_has_every_field_in_every_event() {
        let (known, now) = pass(250, Some(1000), 2.0);
        let overall = Some(Overall { share: 0.25, left: Duration::from_secs(9) });
        let line = r#"{"event":"advanced","stage":"cluster","done":250,"total":1000,"seconds":2.0,"rate":125.0,"bytes_per_second":null,"eta_seconds":6.0,"overall":0.25,"overall_eta_seconds":9.0}"#;
        assert_eq!(json_event(JsonKind::Advanced, &known, now, overall), line);
        let (unknown, _) = pass(0, None, 0.0);
        let line = r#"{"event":"started","stage":"cluster","done":0,"total":null,"seconds":0.0,"rate":0.0,"bytes_per_second":null,"eta_seconds":null,"overall":null,"overall_eta_seconds":null}"#;
        assert_eq!(json_event(JsonKind::Started, &unknown, START, None), line);
    }

    #[test]
    fn a_message_is_escaped() {
        assert_eq!(json_message("a \"b\"\n"), r#"{"event":"message","text":"a \"b\"\n"}"#);
    }
}
