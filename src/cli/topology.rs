//! How a surface hangs together, as lines for a person.

use meshmill::pipeline::TopologyReport;

use super::figures;

/// Names and values, in the order in which they are shown.
pub(super) fn lines(report: &TopologyReport) -> [(&'static str, String); 13] {
    let count = figures::count;
    let euler = report.euler_characteristic;
    let sign = if euler < 0 { "-" } else { "" };
    [
        ("faces", count(report.faces)),
        ("vertices", count(report.vertices)),
        ("edges", count(report.edges)),
        ("Euler characteristic", format!("{sign}{}", count(euler.unsigned_abs()))),
        ("components", count(report.components)),
        ("boundary edges", count(report.boundary_edges)),
        ("boundary vertices", count(report.boundary_vertices)),
        ("non-manifold edges", count(report.non_manifold_edges)),
        ("non-manifold vertices", count(report.non_manifold_vertices)),
        ("flipped: inconsistent edges", count(report.inconsistent_edges)),
        ("duplicate faces", count(report.duplicate_faces)),
        ("degenerate faces", count(report.degenerate_faces)),
        ("slivers", format!("{} ({:.3} %)", count(report.slivers), report.sliver_share * 100.0)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_readable_and_signed() {
        let report = TopologyReport {
            triangles: 2_000_002,
            faces: 2_000_001,
            vertices: 990_000,
            edges: 3_000_000,
            euler_characteristic: -9_999,
            components: 3,
            boundary_edges: 0,
            boundary_vertices: 0,
            non_manifold_edges: 1,
            non_manifold_vertices: 2,
            inconsistent_edges: 4,
            duplicate_faces: 5,
            degenerate_faces: 6,
            slivers: 24_688,
            sliver_share: 0.012_344,
        };
        let lines = lines(&report);
        let value = |name| lines.iter().find(|line| line.0 == name).map(|line| line.1.as_str());
        assert_eq!(value("Euler characteristic"), Some("-9,999"));
        assert_eq!(
            (value("faces"), value("slivers")),
            (Some("2,000,001"), Some("24,688 (1.234 %)"))
        );
        assert_eq!(value("flipped: inconsistent edges"), Some("4"));
    }
}
