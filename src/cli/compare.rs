//! `meshmill compare`: how far two meshes are from each other, as a table for a person or as JSON
//! for a script.

use std::process::ExitCode;

use meshmill::pipeline::{self, CompareReport, ComparedReport, DefectInfo, DeviationReport};

use super::{
    args::Compare,
    commands::{in_session, print},
    figures,
    info::{coordinate, json},
    job::{self, Host},
    outcome, topology,
};

/// `meshmill compare`.
pub(super) fn compare(args: &Compare, host: &Host) -> ExitCode {
    in_session(&args.machine, |session| {
        let report = pipeline::compare(&job::compare(args, host)?, &session.monitor())?;
        // The bars go before the result comes: both may be on one terminal.
        session.display.close();
        if args.json && !report.boxes_meet {
            session.display.say(APART);
        }
        print(&if args.json { json(&report)? } else { table(&report) })?;
        Ok(outcome::DONE)
    })
}

/// Said where the numbers are right and say nothing of the shape.
const APART: &str = "WARNING: the boxes around A and B do not meet: are they in the same place and in the same units?";

/// Width of the names on the left.
const NAME_WIDTH: usize = 7;
/// Width of a column of numbers.
const COLUMN_WIDTH: usize = 13;
/// The same of topology: a count with a share beside it is wider.
const NAMES_WIDTH: usize = 28;
const COUNTS_WIDTH: usize = 26;

fn table(report: &CompareReport) -> String {
    let mut text = String::new();
    let mut line = |name: &str, value: &str| {
        text.extend([format!("{name:NAME_WIDTH$}{value}").trim_end(), "\n"]);
    };
    line("A", &mesh(&report.a));
    line("B", &mesh(&report.b));
    if !report.boxes_meet {
        line("", APART);
    }
    line("", "");
    let heads = ["A to B", "of diagonal", "B to A", "of diagonal"];
    line("", &heads.map(|head| format!("{head:>COLUMN_WIDTH$}")).concat());
    let (to, back) = (&report.a_to_b, &report.b_to_a);
    for (name, of) in ROWS {
        let cells = [to, back].map(|deviation| {
            let length = of(deviation);
            let relative = figures::share(length / report.diagonal);
            format!("{:>COLUMN_WIDTH$}{relative:>COLUMN_WIDTH$}", figures::length(length))
        });
        line(name, &cells.concat());
    }
    line("", "");
    for (name, deviation) in [("A to B", to), ("B to A", back)] {
        let [x, y, z] = deviation.max_at.map(coordinate);
        line("", &format!("{name}: the maximum is at {x} {y} {z}"));
    }
    line("", &format!("Diagonal of A: {}", coordinate(report.diagonal)));
    for sentence in confidence(report) {
        line("", &sentence);
    }
    line("", "");
    let topology = &report.topology;
    let heads = [("topology", "A".to_owned())].into_iter().chain(topology::lines(&topology.a));
    let others = ["B".to_owned()].into_iter().chain(topology::lines(&topology.b).map(|of| of.1));
    for ((name, a), b) in heads.zip(others) {
        line("", &format!("{name:NAMES_WIDTH$}{a:>COUNTS_WIDTH$}{b:>COUNTS_WIDTH$}"));
    }
    text
}

/// A row of the table.
type Row = (&'static str, fn(&DeviationReport) -> f64);

const ROWS: [Row; 6] = [
    ("max", |deviation| deviation.max),
    ("rms", |deviation| deviation.rms),
    ("mean", |deviation| deviation.mean),
    ("50 %", |deviation| deviation.p50),
    ("95 %", |deviation| deviation.p95),
    ("99 %", |deviation| deviation.p99),
];

fn mesh(mesh: &ComparedReport) -> String {
    let count = format!("{}: {} triangles", mesh.path, figures::count(mesh.triangles));
    let defect = |(kind, defect): (&&str, &DefectInfo)| {
        format!("{}: {}", kind.replace('_', " "), figures::count(defect.count))
    };
    [count].into_iter().chain(mesh.defects.iter().map(defect)).collect::<Vec<_>>().join(", ")
}

/// How sure the numbers are, in words.
fn confidence(report: &CompareReport) -> [String; 3] {
    let count = figures::count(report.samples.count);
    let error = |of: fn(&DeviationReport) -> (f64, f64)| {
        let shares = [&report.a_to_b, &report.b_to_a].map(of).map(|(error, value)| {
            let share = if value > 0.0 { 100.0 * error / value } else { 0.0 };
            format!("{share:.2}")
        });
        format!("{} % (A to B) and {} % (B to A)", shares[0], shares[1])
    };
    let rms = error(|deviation| (deviation.confidence.rms_error, deviation.rms));
    let unseen = 100.0 * report.a_to_b.confidence.unseen_share;
    [
        format!(
            "{count} samples by area on each mesh, seed {}; max: and every vertex.",
            report.samples.seed
        ),
        format!("With 95 % confidence: the rms is right to within {rms},"),
        format!("and at most {unseen:.2} % of the area is farther away than the maximum.")
            .replace("0.00 %", &format!("{unseen:.0e} %")),
    ]
}
