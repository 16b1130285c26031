//! The measure against a search through all triangles, and what must not change it.

use glam::DVec3;
use proptest::prelude::*;

use super::*;
use crate::{
    geometry::distance_sq_to_triangle,
    progress::{Cancel, Event, StageId},
    soup::{Point, Source, Triangle},
    storage::{RecordWriter, Workspace},
};

type Corners = [[f32; 3]; 3];

const SAMPLES: Config = Config { samples: 3000, seed: 7 };

/// Memory that nothing has to wait for, in bytes.
const PLENTY: u64 = 1 << 30;

/// A soup of our own, with the folder it lies in.
struct Soup {
    source: Source<Point>,
    _workspace: Workspace,
    _folder: tempfile::TempDir,
}

fn soup(triangles: &[Corners]) -> Soup {
    let folder = tempfile::tempdir().unwrap();
    let workspace = Workspace::create(folder.path()).unwrap();
    let mut writer = RecordWriter::create(&workspace, "soup", None).unwrap();
    let triangles: Vec<_> = triangles.iter().map(|t| Triangle(t.map(Point))).collect();
    writer.extend(&triangles).unwrap();
    let source = Source::stored(writer.finish().unwrap());
    Soup { source, _workspace: workspace, _folder: folder }
}

/// The deviation of one soup from another around an origin of its own.
fn measure(from: &[Corners], to: (&[Corners], [f64; 3]), memory_bytes: u64) -> Outcome {
    let (from, target) = (soup(from), soup(to.0));
    let (budget, monitor) = (Budget::new(memory_bytes), Monitor::silent());
    let from = survey(&from.source, [0.0; 3], &budget, &monitor).unwrap();
    let to = survey(&target.source, to.1, &budget, &monitor).unwrap();
    deviation(&from, &Target::new(&to, &budget), &SAMPLES, &budget, &monitor).unwrap()
}

/// The same from a search through all triangles.
fn searched(points: &[[f64; 3]], triangles: &[Corners]) -> Vec<f64> {
    let corner = |at: [f32; 3]| DVec3::from_array(at.map(f64::from));
    let distance = |point: &[f64; 3]| {
        let point = DVec3::from_array(*point);
        let to = |t: &Corners| distance_sq_to_triangle(t.map(|at| corner(at) - point));
        triangles.iter().map(to).fold(f64::INFINITY, f64::min).sqrt()
    };
    points.iter().map(distance).collect()
}

/// A waved square of `2 · side²` triangles, `low` at its least corner.
fn waves(side: u16, low: f32) -> Vec<Corners> {
    let at = |x: u16, y: u16| {
        let [x, y] = [x, y].map(|c| f32::from(c) / f32::from(side));
        [low + x, low + y, low + 0.1 * (9.0 * x).sin() * (7.0 * y).cos()]
    };
    let square = |x, y| {
        let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
        [[a, b, c], [a, c, d]]
    };
    (0..side).flat_map(|y| (0..side).flat_map(move |x| square(x, y))).collect()
}

fn coordinate() -> impl Strategy<Value = f32> {
    // Often the same, so that triangles touch, lose their area, and lie in one plane.
    prop_oneof![Just(0.0_f32), Just(1.0), -2.0_f32..2.0, -50.0_f32..50.0]
}

fn triangles() -> impl Strategy<Value = Vec<Corners>> {
    proptest::collection::vec(
        proptest::array::uniform3(proptest::array::uniform3(coordinate())),
        1..40,
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn distances_are_those_of_a_search_through_all(
        triangles in triangles(),
        points in proptest::collection::vec(
            proptest::array::uniform3(coordinate().prop_map(f64::from)), 1..80),
    ) {
        let soup = soup(&triangles);
        let (budget, monitor) = (Budget::new(PLENTY), Monitor::silent());
        let surface = survey(&soup.source, [0.0; 3], &budget, &monitor).unwrap();
        let target = Target::new(&surface, &budget);
        let found = distances(&points, &target, 0.0, &budget, &monitor).unwrap();
        for (found, searched) in found.iter().zip(searched(&points, &triangles)) {
            // Touching triangles tell the same zero with different rounding.
            prop_assert!((found - searched).abs() <= 1e-12, "{found} {searched}");
        }
        // What is near enough is not too far, and what is not is exact.
        let rough = distances(&points, &target, 1.0, &budget, &monitor).unwrap();
        for (rough, exact) in rough.iter().zip(&found) {
            let is_near = *rough <= 1.0 && *rough >= exact - 1e-12;
            prop_assert!(rough == exact || is_near, "{rough} {exact}");
        }
    }

    #[test]
    fn a_deviation_is_that_of_its_samples_and_vertices(
        (from, to) in (triangles(), triangles())
    ) {
        let area = |t: &Corners| {
            let [a, b, c] = t.map(|at| DVec3::from_array(at.map(f64::from)));
            (b - a).cross(c - a).length() > 0.0
        };
        prop_assume!(from.iter().any(area));
        let outcome = measure(&from, (&to, [0.0; 3]), PLENTY);
        let vertices: Vec<_> = from.iter().flatten().map(|at| at.map(f64::from)).collect();
        let at_vertices = searched(&vertices, &to).into_iter().fold(0.0, f64::max);
        prop_assert!((outcome.max - at_vertices.max(outcome.statistics.max)).abs() <= 1e-12);
        prop_assert!((outcome.max - searched(&[outcome.max_at], &to)[0]).abs() <= 1e-12);
    }
}

#[test]
fn points_of_a_surface_are_on_it() {
    let outcome = measure(&waves(20, 0.0), (&waves(20, 0.0), [0.0; 3]), PLENTY);
    assert!(outcome.max < 1e-15, "{outcome:?}");
    assert_eq!(outcome.statistics.count, 3000);
}

/// ```text
///   z  near: a square of 1       far: the same, 3 higher and 100 to the side
///   3                            #####
///   0  #####
///      0   1                   100   101 x
/// ```
#[test]
fn the_nearest_point_is_found_however_far_away() {
    let square = |x: f32, z: f32| {
        [
            [[x, 0.0, z], [x + 1.0, 0.0, z], [x + 1.0, 1.0, z]],
            [[x, 0.0, z], [x + 1.0, 1.0, z], [x, 1.0, z]],
        ]
    };
    let outcome = measure(&square(0.0, 0.0), (&square(100.0, 3.0), [0.0; 3]), PLENTY);
    let expected = (100.0_f64 * 100.0 + 9.0).sqrt();
    assert_eq!(outcome.max, expected);
    // Both corners at x = 0 are as far: the one with less y.
    assert_eq!(outcome.max_at, [0.0; 3]);
    let mean = (99.5_f64 * 99.5 + 9.0).sqrt();
    assert!((outcome.statistics.mean - mean).abs() < 1e-3, "{outcome:?}");
}

#[test]
fn the_result_is_the_same_for_any_memory_and_number_of_threads() {
    let (from, to) = (waves(60, 0.0), waves(23, 0.01));
    let expected = measure(&from, (&to, [0.0; 3]), PLENTY);
    for (threads, memory_bytes) in
        [(1, PLENTY), (2, PLENTY), (3, 1 << 20), (2, 1 << 16), (1, 1 << 15)]
    {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let found = pool.install(|| measure(&from, (&to, [0.0; 3]), memory_bytes));
        assert_eq!(found, expected, "{threads} threads, {memory_bytes} bytes");
    }
}

#[test]
fn samples_cover_triangles_by_their_area() {
    // Two squares in the plane z = 0, one of 9 times the area, and the target below both: only
    // what is above the larger one is 2 away.
    let square = |low: f32, size: f32, z: f32| {
        let high = low + size;
        [
            [[low, 0.0, z], [high, 0.0, z], [high, size, z]],
            [[low, 0.0, z], [high, size, z], [low, size, z]],
        ]
    };
    let from = [square(0.0, 1.0, 0.0), square(10.0, 3.0, 0.0)].concat();
    let to = [square(0.0, 1.0, 1.0), square(10.0, 3.0, 2.0)].concat();
    let outcome = measure(&from, (&to, [0.0; 3]), PLENTY);
    let statistics = outcome.statistics;
    assert!((statistics.mean - 1.9).abs() < 1e-3, "{outcome:?}");
    assert_eq!([statistics.p50, statistics.p99, outcome.max], [2.0; 3]);
}

#[test]
fn meshes_around_different_origins_are_compared_where_they_are() {
    let far = 500_000.0 / 1024.0_f64;
    let origin = [far.trunc() * 1024.0, 5_400_576.0, 0.0];
    let expected = measure(&waves(30, 0.0), (&waves(20, 0.25), [0.0; 3]), PLENTY);
    // `from` stays at zero: what lies around `origin` is as far from it as that is long.
    let moved = measure(&waves(30, 0.0), (&waves(20, 0.25), origin), PLENTY);
    let length = DVec3::from_array(origin).length();
    assert!((moved.max - length).abs() < 2.0 && (moved.statistics.mean - length).abs() < 2.0);
    assert!(moved.max_at.iter().all(|c| (-0.1..1.1).contains(c)), "{:?}", moved.max_at);
    // Both around it: the same to the last bits but for where the maximum is.
    let (from, to) = (soup(&waves(30, 0.0)), soup(&waves(20, 0.25)));
    let (budget, monitor) = (Budget::new(PLENTY), Monitor::silent());
    let from = survey(&from.source, origin, &budget, &monitor).unwrap();
    let to = survey(&to.source, origin, &budget, &monitor).unwrap();
    let both = deviation(&from, &Target::new(&to, &budget), &SAMPLES, &budget, &monitor).unwrap();
    assert_eq!((both.max, both.statistics), (expected.max, expected.statistics));
    let there = std::array::from_fn(|axis| expected.max_at[axis] + origin[axis]);
    assert_eq!(both.max_at, there);
}

#[test]
fn more_samples_than_memory_holds_are_refused() {
    let soup = soup(&waves(3, 0.0));
    let (budget, monitor) = (Budget::new(1 << 20), Monitor::silent());
    let surface = survey(&soup.source, [0.0; 3], &budget, &monitor).unwrap();
    let config = Config { samples: 1 << 20, seed: 0 };
    let target = Target::new(&surface, &budget);
    let error = deviation(&surface, &target, &config, &budget, &monitor).unwrap_err();
    assert!(matches!(error, Error::Resource { needed_bytes: 8_388_608, .. }), "{error}");
}

#[test]
fn each_pass_can_be_cancelled() {
    let (from, to) = (soup(&waves(10, 0.0)), soup(&waves(10, 0.1)));
    for stage in [StageId::Survey, StageId::Sample, StageId::Compare] {
        let cancel = Cancel::default();
        let raise = cancel.clone();
        let observer = move |event: &Event| {
            if matches!(event, Event::Started { stage: started, .. } if *started == stage) {
                raise.raise();
            }
        };
        let monitor = Monitor { observer: &observer, cancel };
        let budget = Budget::new(PLENTY);
        let measure = || -> Result<Outcome> {
            let from = survey(&from.source, [0.0; 3], &budget, &monitor)?;
            let to = survey(&to.source, [0.0; 3], &budget, &monitor)?;
            deviation(&from, &Target::new(&to, &budget), &SAMPLES, &budget, &monitor)
        };
        let error = measure().unwrap_err();
        assert!(matches!(error, Error::Cancelled(by) if by.0 == stage), "{stage}: {error}");
    }
}
