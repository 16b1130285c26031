//! `meshmill info`: what a mesh is like, as a table for a person or as JSON for a script.

use std::process::ExitCode;

use meshmill::{
    Error, Result,
    pipeline::{self, BoundsReport, InfoReport, OrderReport},
};
use serde::Serialize;

use super::{
    args::Info,
    commands::{in_session, print},
    figures,
    job::{self, Host},
    outcome, topology,
};

/// `meshmill info`.
pub(super) fn info(args: &Info, host: &Host) -> ExitCode {
    in_session(&args.machine, |session| {
        let report = pipeline::info(job::info(args, host), &session.monitor())?;
        // The bars go before the result comes: both may be on one terminal.
        session.display.close();
        print(&if args.json { json(&report)? } else { table(&report) })?;
        Ok(outcome::DONE)
    })
}

/// A report as JSON.
pub(super) fn json(report: &impl Serialize) -> Result<String> {
    let text = serde_json::to_string_pretty(report).map_err(std::io::Error::from);
    let written = text.map(|text| text + "\n");
    written.map_err(|source| Error::Io { verb: "write", path: "-".into(), source })
}

/// Width of the names on the left.
const NAME_WIDTH: usize = 13;

/// One fact a line, its name on the left.
fn table(report: &InfoReport) -> String {
    let mut text = String::new();
    let mut row = |name: &str, value: &str| {
        text.extend([&format!("{name:NAME_WIDTH$}"), value, "\n"]);
    };
    row("format", &report.format);
    row("triangles", &figures::count(report.triangles));
    match report.vertices {
        Some(vertices) => row("vertices", &figures::count(vertices)),
        None => row("vertices", "not shared: a soup"),
    }
    if let Some(ratio) = report.topology.triangles_per_vertex {
        row("", &format!("{ratio:.3} triangles per vertex: {}", reading_of(ratio)));
    }
    row("attributes", &report.attributes.join(", "));
    if !report.dropped.is_empty() {
        row("not carried", &report.dropped.join(", "));
    }
    if let Some(bounds) = &report.bounds {
        bounds_rows(bounds, &mut row);
        row("order", &order(&report.order));
    }
    for (index, (name, value)) in
        report.topology.counted.iter().flat_map(topology::lines).enumerate()
    {
        row(if index == 0 { "topology" } else { "" }, &format!("{name}: {value}"));
    }
    if report.defects.is_empty() {
        row("defects", "none");
    }
    for (index, (kind, defect)) in report.defects.iter().enumerate() {
        let (kind, count) = (kind.replace('_', " "), figures::count(defect.count));
        let first = defect.first.as_ref().map(|first| format!(", first at {first}"));
        let name = if index == 0 { "defects" } else { "" };
        row(name, &format!("{kind}: {count}{}", first.unwrap_or_default()));
    }
    text
}

fn bounds_rows(bounds: &BoundsReport, row: &mut impl FnMut(&str, &str)) {
    let size: [f64; 3] = std::array::from_fn(|axis| bounds.max[axis] - bounds.min[axis]);
    let rows = [("min", bounds.min), ("max", bounds.max), ("size", size)];
    let rows = rows.map(|(name, values)| (name, values.map(coordinate)));
    let width = rows.iter().flat_map(|(_, texts)| texts).map(String::len).max().unwrap_or(0);
    for (index, (name, texts)) in rows.iter().enumerate() {
        let [x, y, z] = texts;
        let line = format!("{name:4}  {x:>width$}  {y:>width$}  {z:>width$}");
        row(if index == 0 { "bounds" } else { "" }, &line);
    }
}

/// A coordinate in as many digits as single precision has: the ones behind are not known.
pub(super) fn coordinate(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    let magnitude = value.abs().log10().floor() as i32;
    if !(-5..=9).contains(&magnitude) {
        let text = format!("{value:.6e}");
        let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
        return format!("{}e{exponent}", shortened(mantissa));
    }
    // Far from zero, positions are relative to an origin and finer than these digits would be.
    let decimals = (6 - magnitude).clamp(3, 9) as usize;
    shortened(&format!("{value:.decimals$}")).to_owned()
}

/// Decimals without the zeros at their end.
fn shortened(decimals: &str) -> &str {
    decimals.trim_end_matches('0').trim_end_matches('.')
}

/// What a number of triangles per vertex is like; nothing of it is proved.
fn reading_of(ratio: f64) -> &'static str {
    match ratio {
        ..0.34 => "no vertex is shared, weld would make them so",
        ..1.9 => "boundaries, small separate parts, or vertices not shared or not used",
        ..2.1 => "as on a closed surface, or a large one with a short boundary",
        _ => "many handles, or edges with more than two triangles",
    }
}

fn order(order: &OrderReport) -> String {
    let axis = order.axis;
    if order.sorted {
        return format!("sorted along {axis}, the longest side");
    }
    let count = figures::count(order.displacement_max);
    let late = format!("not sorted along {axis}, the longest side: up to {count} triangles late");
    let others = ["x", "y", "z"].iter().zip(order.displacement_max_xyz);
    match others.filter(|(_, late)| *late == 0).map(|(axis, _)| *axis).next() {
        Some(other) => format!("{late}; sorted along {other}"),
        None => late,
    }
}

#[cfg(test)]
mod tests {
    use meshmill::pipeline::{DefectInfo, TopologyFacts, TopologyReport};

    use super::*;

    fn report() -> InfoReport {
        let bounds = BoundsReport { min: [-1.5, 0.0, 500_000.25], max: [2.0, 0.1, 500_100.5] };
        let defect = DefectInfo { count: 1200, first: Some("record 7".to_owned()) };
        let trailing = DefectInfo { count: 2, first: None };
        InfoReport {
            format: "ply".to_owned(),
            triangles: 2_000_000,
            vertices: Some(1_000_100),
            bounds: Some(bounds),
            attributes: vec!["position", "color"],
            dropped: vec!["normals".to_owned(), "quality".to_owned()],
            order: OrderReport {
                axis: "z",
                sorted: false,
                displacement_max: 1234,
                displacement_max_xyz: [0, 5, 1234],
            },
            topology: TopologyFacts { triangles_per_vertex: Some(1.9998), counted: None },
            defects: [("degenerate", defect), ("trailing_bytes", trailing)].into(),
        }
    }

    #[test]
    fn the_table_has_a_line_for_each_fact() {
        let expected = "\
format       ply
triangles    2,000,000
vertices     1,000,100
             2.000 triangles per vertex: as on a closed surface, or a large one with a short boundary
attributes   position, color
not carried  normals, quality
bounds       min        -1.5          0  500000.25
             max           2        0.1   500100.5
             size        3.5        0.1     100.25
order        not sorted along z, the longest side: up to 1,234 triangles late; sorted along x
defects      degenerate: 1,200, first at record 7
             trailing bytes: 2
";
        assert_eq!(table(&report()), expected);
    }

    #[test]
    fn a_soup_without_defects_is_short() {
        let order = OrderReport { sorted: true, ..report().order };
        let topology = TopologyFacts { triangles_per_vertex: None, counted: None };
        let (dropped, defects) = (Vec::new(), [].into());
        let soup = InfoReport { vertices: None, order, topology, dropped, defects, ..report() };
        let text = table(&soup);
        assert!(text.contains("not shared: a soup\nattributes"), "{text}");
        assert!(text.contains("sorted along z, the longest side\ndefects      none\n"), "{text}");
    }

    #[test]
    fn what_was_counted_is_in_the_table_and_beside_what_is_suggested() {
        let counted = TopologyReport {
            triangles: 4,
            faces: 4,
            vertices: 4,
            edges: 6,
            euler_characteristic: 2,
            components: 1,
            boundary_edges: 0,
            boundary_vertices: 0,
            non_manifold_edges: 0,
            non_manifold_vertices: 0,
            inconsistent_edges: 0,
            duplicate_faces: 0,
            degenerate_faces: 0,
            slivers: 1,
            sliver_share: 0.25,
        };
        let topology = TopologyFacts { counted: Some(counted), ..report().topology };
        let report = InfoReport { topology, ..report() };
        let text = table(&report);
        assert!(text.contains("\ntopology     faces: 4\n             vertices: 4\n"), "{text}");
        let value: serde_json::Value = serde_json::from_str(&json(&report).unwrap()).unwrap();
        let topology = &value["topology"];
        assert_eq!(topology["triangles_per_vertex"], 1.9998);
        assert_eq!(
            (&topology["euler_characteristic"], &topology["components"]),
            (&2.into(), &1.into())
        );
        assert_eq!(topology["sliver_share"], 0.25);
    }

    #[test]
    fn names_in_json_are_those_of_the_contract() {
        let value: serde_json::Value = serde_json::from_str(&json(&report()).unwrap()).unwrap();
        assert_eq!(value["format"], "ply");
        assert_eq!(
            (&value["triangles"], &value["vertices"]),
            (&2_000_000.into(), &1_000_100.into())
        );
        assert_eq!(
            (&value["bounds"]["min"][0], &value["bounds"]["max"][1]),
            (&(-1.5).into(), &0.1.into())
        );
        assert_eq!(
            (&value["attributes"][1], &value["dropped"][0]),
            (&"color".into(), &"normals".into())
        );
        assert_eq!(
            (&value["order"]["axis"], &value["order"]["sorted"]),
            (&"z".into(), &false.into())
        );
        assert_eq!(value["order"]["displacement_max"], 1234);
        assert_eq!(value["defects"]["degenerate"]["count"], 1200);
        assert_eq!(value["defects"]["degenerate"]["first"], "record 7");
        assert!(value["defects"]["trailing_bytes"]["first"].is_null());
    }

    #[test]
    fn coordinates_show_the_digits_that_are_known() {
        let values = [0.0, 0.1_f32.into(), -1.5, 1e-30, 2.5e12, 4_567_890.125, 1e-5, 123_456.789];
        let texts = values.map(coordinate);
        let expected =
            ["0", "0.1", "-1.5", "1e-30", "2.5e12", "4567890.125", "0.00001", "123456.789"];
        assert_eq!(texts, expected);
    }
}
