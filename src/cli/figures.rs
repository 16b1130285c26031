//! Numbers as people read them: counts, rates, spans of time and time stamps.

use std::time::Duration;

use meshmill::pipeline::{BoundedReport, CompareReport, DefectReport, SortReport};

use super::passes::Figures;

/// `1234567` → `1,234,567`.
pub(super) fn count(value: u64) -> String {
    let digits = value.to_string();
    let mut text = String::with_capacity(digits.len() * 4 / 3);
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// What is wrong with an input: `defect: not finite: 12, first at record 7`.
pub(super) fn defect(defect: &DefectReport) -> String {
    let place = if defect.first.is_empty() {
        String::new()
    } else {
        format!(", first at {}", defect.first)
    };
    format!("defect: {}: {}{place}", defect.kind.replace('_', " "), count(defect.count))
}

/// What came of a sort: `late by up to 54,909 triangles along z: put in order in passing`.
pub(super) fn order(sort: &SortReport) -> String {
    let axis = sort.axis;
    let way = if sort.on_disk { "sorted on disk" } else { "sorted in memory" };
    match sort.displacement_max {
        None => format!("{way} along {axis}"),
        Some(0) if !sort.on_disk => {
            format!("in order along {axis} already, or nearly: no sort on disk")
        }
        Some(late) if !sort.on_disk => {
            let late = count(late);
            format!("up to {late} triangles late along {axis}: put in order in passing")
        }
        Some(late) => format!("up to {} triangles late along {axis}: {way}", count(late)),
    }
}

/// How far a result is from its input: `away from the input: at most 1.2747e-3 (0.0368 % of the
/// diagonal), rms 3.5596e-5 (1.03e-3 %)`, the greater of both ways.
pub(super) fn deviation(report: &CompareReport) -> String {
    let rms = report.a_to_b.rms.max(report.b_to_a.rms);
    let [max_share, rms_share] = [report.max, rms].map(|length| share(length / report.diagonal));
    let [max, rms] = [report.max, rms].map(length);
    format!(
        "away from the input: at most {max} ({max_share} of the diagonal), rms {rms} ({rms_share})"
    )
}

/// What holds of a result under an error bound.
pub(super) fn bound(report: &BoundedReport) -> String {
    let share = report.max_error_share.map(|of| format!(" ({} of the diagonal)", share(of)));
    let max_error = length(report.max_error);
    format!("every vertex of the input lies within {max_error}{}", share.unwrap_or_default())
}

/// A length in five digits.
pub(super) fn length(value: f64) -> String {
    if value == 0.0 { "0".to_owned() } else { format!("{value:.4e}") }
}

/// A share in per cent.
pub(super) fn share(value: f64) -> String {
    if value == 0.0 || (1e-4..1e3).contains(&value) {
        return format!("{:.4} %", 100.0 * value);
    }
    format!("{:.2e} %", 100.0 * value)
}

/// Why a wanted count was not met.
pub(super) fn shortfall(stopped_by: Option<&str>) -> &'static str {
    match stopped_by {
        Some("topology") => {
            "the wanted count was not met: no collapse is left that keeps the surface what it is"
        }
        Some("error") => "the wanted count was not met: the error bound came first",
        Some("parity") => "one triangle fewer than asked for: here two go at a time",
        Some("window") => {
            "the wanted count was not met: triangles had to leave the window before they were \
             coarse enough; more --memory makes it larger"
        }
        _ => "the wanted count was not met within 25 %: no grid comes nearer",
    }
}

/// Why a result is finer than it might be.
pub(super) fn left_alone(vertices: u64) -> String {
    format!(
        "{} vertices were left as they are: their faces are no single fan, as where more than two \
         meet at an edge; --method cluster takes those, too",
        count(vertices)
    )
}

/// Records per second in three digits: `38.6 M/s`; with bytes where they are known: `38.6 M/s  1.93 GB/s`.
pub(super) fn rates(figures: &Figures) -> String {
    let records = rate(figures.per_second);
    let bytes = figures.bytes_per_second.map(|bytes| rate(bytes).replace("/s", "B/s"));
    bytes.map_or(records.clone(), |bytes| format!("{records}  {bytes}"))
}

/// Records per second in three digits: `38.6 M/s`.
fn rate(per_second: f64) -> String {
    let text = short(per_second);
    if text.contains(' ') { format!("{text}/s") } else { format!("{text} /s") }
}

/// A count in three digits: `38.6 M`.
pub(super) fn short(count: f64) -> String {
    let (mut scaled, mut unit) = (count, "");
    for larger in ["k", "M", "G", "T"] {
        // What would round to four digits gets the next unit.
        if scaled < 999.5 {
            break;
        }
        scaled /= 1000.0;
        unit = larger;
    }
    // Each bound is where rounding reaches the next number of digits.
    let decimals = match (unit, scaled) {
        ("", _) => 0,
        (_, ..9.995) => 2,
        (_, ..99.95) => 1,
        _ => 0,
    };
    let space = if unit.is_empty() { "" } else { " " };
    format!("{scaled:.decimals$}{space}{unit}")
}

/// `3.2 s`, `48 s`, `12 min 05 s`, `3 h 07 min`.
pub(super) fn span(span: Duration) -> String {
    let seconds = span.as_secs_f64();
    if seconds < 9.95 {
        return format!("{seconds:.1} s");
    }
    let whole = seconds.round() as u64;
    match whole {
        0..60 => format!("{whole} s"),
        60..3600 => format!("{} min {:02} s", whole / 60, whole % 60),
        _ => format!("{} h {:02} min", whole / 3600, whole % 3600 / 60),
    }
}

/// Share of `done` in `total`, whole per cent rounded down: 100 % means all.
pub(super) fn per_cent(done: u64, total: u64) -> u64 {
    if total == 0 { 100 } else { (u128::from(done) * 100 / u128::from(total)) as u64 }
}

/// Seconds since 1970 as `2026-03-01T23:59:05Z`.
pub(super) fn time_stamp(unix_seconds: u64) -> String {
    let (days, second) = (unix_seconds / 86_400, unix_seconds % 86_400);
    let (year, month, day) = date(days);
    let (hour, minute, second) = (second / 3600, second / 60 % 60, second % 60);
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z")
}

/// Year, month and day of the Gregorian calendar, `days` after 1 January 1970.
fn date(days: u64) -> (u64, usize, u64) {
    let is_leap = |year: u64| {
        year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400))
    };
    let (mut year, mut left) = (1970, days);
    loop {
        let length = if is_leap(year) { 366 } else { 365 };
        if left < length {
            break;
        }
        left -= length;
        year += 1;
    }
    let february = if is_leap(year) { 29 } else { 28 };
    let lengths = [31, february, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
    let mut month = 0;
    while left >= lengths[month] {
        left -= lengths[month];
        month += 1;
    }
    (year, month + 1, left + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_grouped_by_thousands() {
        let texts = [0, 999, 1000, 1_234_567, u64::MAX].map(count);
        assert_eq!(texts, ["0", "999", "1,000", "1,234,567", "18,446,744,073,709,551,615"]);
    }

    #[test]
    fn rates_have_three_digits_and_a_unit() {
        let texts = [0.0, 12.4, 999.4, 999.6, 38.6e6, 9.996e6, 99.96e3, 168.4e6, 2.5e9].map(rate);
        let expected = [
            "0 /s", "12 /s", "999 /s", "1.00 k/s", "38.6 M/s", "10.0 M/s", "100 k/s", "168 M/s",
            "2.50 G/s",
        ];
        assert_eq!(texts, expected);
    }

    #[test]
    fn spans_lose_what_does_not_matter() {
        let spans = [0.0, 3.24, 9.96, 59.4, 59.6, 725.0, 3599.7, 11_220.0];
        let texts = spans.map(|seconds| span(Duration::from_secs_f64(seconds)));
        let expected = [
            "0.0 s",
            "3.2 s",
            "10 s",
            "59 s",
            "1 min 00 s",
            "12 min 05 s",
            "1 h 00 min",
            "3 h 07 min",
        ];
        assert_eq!(texts, expected);
    }

    #[test]
    fn a_hundred_per_cent_means_all() {
        assert_eq!([per_cent(999, 1000), per_cent(1000, 1000), per_cent(0, 0)], [99, 100, 100]);
        assert_eq!(per_cent(u64::MAX / 2, u64::MAX), 49);
    }

    #[test]
    fn time_stamps_know_leap_years() {
        assert_eq!(time_stamp(0), "1970-01-01T00:00:00Z");
        assert_eq!(time_stamp(951_782_400), "2000-02-29T00:00:00Z");
        assert_eq!(time_stamp(1_709_251_199), "2024-02-29T23:59:59Z");
        assert_eq!(time_stamp(1_767_225_600), "2026-01-01T00:00:00Z");
    }
}
