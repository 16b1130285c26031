//! Counts, bounds, order and triangles without area: one pass over a source, in constant memory.
//!
//! It says nothing of what needs more than a pass, such as boundaries or components.

use crate::{
    error::{Position, Result},
    formats::{DefectKind, Findings},
    geometry::{self, Bounds, MAXIMA_PER_PART, has_no_area},
    progress::{Monitor, StageId},
    soup::{Minima, OrderMeter, Scratch, Source, Triangle, Vertex},
};

/// What info needs to know.
#[derive(Clone, Copy, Debug)]
pub struct Config {
    /// Maxima remembered per axis, at least [`MAXIMA_MIN`] and 16 bytes each: they decide how
    /// exact [`Outcome::displacement_max`] is.
    pub maxima_max: usize,
}

/// Least value of [`Config::maxima_max`].
pub const MAXIMA_MIN: usize = MAXIMA_PER_PART;
/// A good value of [`Config::maxima_max`]: 3 MiB for the three axes.
pub const MAXIMA_DEFAULT: usize = geometry::MAXIMA_DEFAULT;

/// What the triangles are like.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Triangles, polygons taken apart.
    pub triangles: u64,
    /// Box around all triangles, relative to the origin of the source.
    pub bounds: Bounds,
    /// Along each axis, how many triangles the worst one comes too late to be in the order of
    /// the triangles' minimum coordinates: its index minus that of the first triangle with a
    /// greater minimum. A window of so many triangles puts them all in order.
    ///
    /// 0 exactly where the triangles are in order. Otherwise never too small; exact as long as no
    /// more than [`Config::maxima_max`] triangles had the greatest minimum of all up to them, and
    /// beyond that too large by at most `1 / (maxima_max / MAXIMA_MIN)` of itself, see
    /// [`MAXIMA_MIN`].
    pub displacement_max: [u64; 3],
    /// What the pass found, with triangles that have no area.
    pub findings: Findings,
}

/// Triangles worked on together: their keys stay in the first level of the cache.
const TRIANGLES_PER_CHUNK: usize = 1024;

/// Measures the triangles of `source`.
///
/// # Errors
/// What reading the source fails with, or cancellation.
pub fn info<V: Vertex>(source: &Source<V>, config: &Config, monitor: &Monitor) -> Result<Outcome> {
    assert!(config.maxima_max >= MAXIMA_MIN, "{config:?}");
    let meter = monitor.meter(StageId::Info, source.amount());
    let pass = source.pass();
    let mut measured = Measured {
        triangles: 0,
        bounds: Bounds::default(),
        order: OrderMeter::new(config.maxima_max),
        minima: Minima::default(),
        degenerate: Findings::default(),
    };
    let mut scratch = Scratch::default();
    while let Some(taken) = pass.next(&mut scratch)? {
        // A triangle has the place of its face unless faces before it were split or dropped.
        let is_one_each = taken.triangles.len() as u64 == taken.records;
        let mut record = is_one_each.then_some(taken.first_record);
        for triangles in taken.triangles.chunks(TRIANGLES_PER_CHUNK) {
            measured.add(triangles, record);
            record = record.map(|record| record + triangles.len() as u64);
        }
        meter.add(taken.records)?;
    }
    meter.finish();
    let mut findings = pass.finish();
    findings.merge(&measured.degenerate);
    Ok(Outcome {
        triangles: measured.triangles,
        bounds: measured.bounds,
        displacement_max: measured.order.displacement_max(),
        findings,
    })
}

/// What was learnt so far.
struct Measured {
    triangles: u64,
    bounds: Bounds,
    order: OrderMeter,
    /// Of a chunk.
    minima: Minima,
    degenerate: Findings,
}

impl Measured {
    /// Adds triangles; `record` is the record of the first one, if it is known.
    fn add<V: Vertex>(&mut self, triangles: &[Triangle<V>], record: Option<u64>) {
        self.triangles += triangles.len() as u64;
        self.minima.fill(triangles, &mut self.bounds);
        self.order.add(&self.minima);
        let is_degenerate = |one: &Triangle<V>| has_no_area(&one.0.map(|v| v.position()));
        let mut degenerate = triangles.iter().enumerate().filter(|(_, one)| is_degenerate(one));
        if let Some((index, _)) = degenerate.next() {
            let place = |record| Position::default().in_record(record + index as u64);
            let at = record.map_or(Position::default(), place);
            self.degenerate.add(DefectKind::Degenerate, 1 + degenerate.count() as u64, at);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        progress::{Cancel, Event},
        soup::Point,
        storage::{RecordWriter, Workspace},
    };

    const CONFIG: Config = Config { maxima_max: MAXIMA_DEFAULT };

    fn measure(triangles: &[[[f32; 3]; 3]], monitor: &Monitor) -> Result<Outcome> {
        let folder = tempfile::tempdir().unwrap();
        let workspace = Workspace::create(folder.path()).unwrap();
        let mut writer = RecordWriter::create(&workspace, "soup", None).unwrap();
        let triangles: Vec<_> = triangles.iter().map(|t| Triangle(t.map(Point))).collect();
        writer.extend(&triangles).unwrap();
        info(&Source::stored(writer.finish().unwrap()), &CONFIG, monitor)
    }

    /// ```text
    ///   y
    ///   1 +---+---+---+
    ///     |0 /|2 /|4 /     the lower triangle of each square comes before
    ///     | / | / | /      the upper one of the same square
    ///   0 +/ 1+/ 3+/ 5
    ///     0   1   2   3 x
    /// ```
    fn strip(squares: u16) -> Vec<[[f32; 3]; 3]> {
        let square = |index| {
            let (x, y) = (f32::from(index), f32::from(index) + 1.0);
            let lower = [[x, 0.0, 0.0], [y, 0.0, 0.0], [y, 1.0, 0.0]];
            [lower, [[x, 0.0, 0.0], [y, 1.0, 0.0], [x, 1.0, 0.0]]]
        };
        (0..squares).flat_map(square).collect()
    }

    #[test]
    fn a_strip_in_order_is_sorted_along_every_axis() {
        let outcome = measure(&strip(3000), &Monitor::silent()).unwrap();
        assert_eq!(outcome.triangles, 6000);
        assert_eq!((outcome.bounds.min, outcome.bounds.max), ([0.0; 3], [3000.0, 1.0, 0.0]));
        assert_eq!((outcome.displacement_max, outcome.bounds.longest_axis()), ([0; 3], 0));
        assert_eq!(outcome.findings, Findings::default());
    }

    #[test]
    fn a_triangle_that_comes_too_late_is_measured_along_its_axis_only() {
        let mut triangles = strip(3000);
        let early = triangles.remove(10);
        triangles.insert(5000, early);
        let outcome = measure(&triangles, &Monitor::silent()).unwrap();
        // Of square 5 there is the upper triangle at 10; that of square 6 at 11 is the first of
        // those that come too early.
        assert_eq!(outcome.displacement_max, [5000 - 11, 0, 0]);
    }

    #[test]
    fn triangles_without_area_are_counted_and_the_first_is_placed() {
        let mut triangles = strip(1500);
        triangles[1030] = [[7.0; 3], [7.0; 3], [8.0; 3]];
        triangles[2000] = [[0.1, 0.2, 0.3]; 3];
        triangles[2999] = [[1.0, 1.0, 1.0], [2.0, 2.0, 2.0], [4.0, 4.0, 4.0]];
        let outcome = measure(&triangles, &Monitor::silent()).unwrap();
        let at = Position::default().in_record(1030);
        let mut expected = Findings::default();
        expected.add(DefectKind::Degenerate, 3, at);
        assert_eq!(outcome.findings, expected);
    }

    #[test]
    fn nothing_has_no_bounds_and_is_in_order() {
        let outcome = measure(&[], &Monitor::silent()).unwrap();
        assert!(outcome.bounds.is_empty());
        assert_eq!((outcome.triangles, outcome.displacement_max), (0, [0; 3]));
    }

    #[test]
    fn a_pass_can_be_cancelled() {
        let monitor = Monitor { observer: &|_: &Event| (), cancel: Cancel::default() };
        monitor.cancel.raise();
        let error = measure(&strip(10), &monitor).unwrap_err();
        assert!(matches!(error, crate::Error::Cancelled(by) if by.0 == StageId::Info));
    }
}
