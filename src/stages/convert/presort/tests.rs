//! Both ways against an in-core oracle, on streams of every kind of order.

use zerocopy::IntoBytes as _;

use super::*;
use crate::{
    Error,
    progress::{Cancel, Event},
    soup::{ColoredPoint, Point, SweepKey},
    storage::RecordWriter,
};

/// Numbers that look random and are the same each time.
fn noise(index: u64) -> u64 {
    let mixed = (index + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    (mixed ^ mixed >> 31).wrapping_mul(0xBF58_476D_1CE4_E5B9) >> 33
}

/// A colour that follows the position.
fn vertex<V: Vertex>(position: [f32; 3]) -> V {
    let [x, y, z] = position.map(f32::to_bits);
    V::new(
        position,
        noise(u64::from(x ^ y.rotate_left(9) ^ z)).to_le_bytes()[..4].try_into().unwrap(),
    )
}

/// Row after row of squares; seen from above:
///
/// ```text
///   x
///   2 +---+---+---+
///     |\  |\  |\  |     all triangles of a row have the same least x, and those on
///     | \ | \ | \ |     both sides of a vertex share it; the vertices along a row
///   1 +---+---+---+     are in no order along y
///     |\  |\  |\  |
///     | \ | \ | \ |
///   0 +---+---+---+ y
/// ```
fn height_field<V: Vertex>(rows: u64, columns: u64) -> Vec<Triangle<V>> {
    let corner = |x: u64, y: u64| {
        vertex([x as f32 - 3.0, (y * 7 % columns) as f32, (noise(x * 1000 + y) % 5) as f32])
    };
    let square = |index: u64| {
        let (x, y) = (index / columns, index % columns);
        let [a, b, c, d] = [corner(x, y), corner(x, y + 1), corner(x + 1, y + 1), corner(x + 1, y)];
        [Triangle([a, b, c]), Triangle([c, d, a])]
    };
    (0..rows * columns).flat_map(square).collect()
}

/// Each triangle moves back by fewer than `distance` places, now and then.
fn disturbed<V: Vertex>(mut triangles: Vec<Triangle<V>>, distance: usize) -> Vec<Triangle<V>> {
    for start in (0..triangles.len()).step_by(2 * distance) {
        let end = triangles.len().min(start + noise(start as u64) as usize % distance + 1);
        triangles[start..end].rotate_left(1);
    }
    triangles
}

fn shuffled<V: Vertex>(mut triangles: Vec<Triangle<V>>) -> Vec<Triangle<V>> {
    for last in (1..triangles.len()).rev() {
        triangles.swap(last, noise(last as u64) as usize % (last + 1));
    }
    triangles
}

fn source<V: Vertex>(triangles: &[Triangle<V>], workspace: &Workspace) -> Source<V> {
    let mut writer = RecordWriter::create(workspace, "soup", None).unwrap();
    writer.extend(triangles).unwrap();
    Source::stored(writer.finish().unwrap())
}

fn sorted<V: Vertex>(
    triangles: &[Triangle<V>],
    config: &Config,
    threads: usize,
) -> Result<(Vec<u8>, Outcome)> {
    let workspace = Workspace::for_test();
    let source = source(triangles, &workspace);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        let mut bytes = Vec::new();
        let outcome = presort(&source, config, &workspace, &Monitor::silent(), |batch| {
            bytes.extend_from_slice(batch.as_bytes());
            Ok(())
        })?;
        assert_eq!(outcome.triangles, triangles.len() as u64);
        Ok((bytes, outcome))
    })
}

/// Sorts in every way and checks each against the standard library.
fn sorts_in_every_way<V: Vertex>(triangles: &[Triangle<V>], axis: SweepAxis) {
    let mut expected = triangles.to_vec();
    expected.sort_by_key(|triangle| SweepKey::of(triangle, axis));
    let workspace = Workspace::for_test();
    let (order, _) =
        measure_order(&source(triangles, &workspace), &workspace, &Monitor::silent(), |_| false)
            .unwrap();
    let displacement_max = order.displacement_max[axis.index()];
    for (threads, memory_bytes) in [(1, 1 << 30), (2, 1 << 30), (1, 1 << 20), (2, 1 << 16)] {
        for method in [Method::Sort, Method::Absorb { displacement_max }] {
            let config = Config { axis, method, memory_bytes, steps: None };
            let (bytes, _) = sorted(triangles, &config, threads).unwrap();
            assert!(bytes == expected.as_bytes(), "{config:?}, {threads} threads");
        }
    }
}

#[test]
fn a_height_field_whose_rows_tie_is_put_in_order() {
    for axis in SweepAxis::ALL {
        sorts_in_every_way(&height_field::<Point>(300, 200), axis);
    }
}

#[test]
fn what_is_late_or_in_no_order_is_put_in_the_same_order() {
    let field = height_field::<Point>(400, 130);
    sorts_in_every_way(&disturbed(field.clone(), 100), SweepAxis::X);
    sorts_in_every_way(&disturbed(field.clone(), 40_000), SweepAxis::X);
    sorts_in_every_way(&shuffled(field.clone()), SweepAxis::X);
    sorts_in_every_way(&field.into_iter().rev().collect::<Vec<_>>(), SweepAxis::X);
}

#[test]
fn a_shuffled_soup_with_duplicates_and_colours_gives_the_same_bytes() {
    let mut field = height_field::<ColoredPoint>(120, 90);
    let again: Vec<_> = field.iter().step_by(3).copied().collect();
    field.extend(again);
    let config = |axis| Config { axis, method: Method::Sort, memory_bytes: 1 << 18, steps: None };
    for axis in SweepAxis::ALL {
        let (expected, _) = sorted(&field, &config(axis), 2).unwrap();
        let (found, _) = sorted(&shuffled(field.clone()), &config(axis), 2).unwrap();
        assert!(found == expected, "{axis:?}");
        sorts_in_every_way(&shuffled(field.clone()), axis);
    }
}

#[test]
fn a_wall_of_one_coordinate_is_put_in_order() {
    let wall = |index: u64| {
        let corner = |n| vertex::<Point>([1.0, (noise(n) % 50) as f32, (noise(n + 9) % 60) as f32]);
        Triangle([corner(index), corner(2 * index), corner(3 * index)])
    };
    sorts_in_every_way(&(0..100_000).map(wall).collect::<Vec<_>>(), SweepAxis::X);
    sorts_in_every_way(&vec![wall(5); 100_000], SweepAxis::X);
    sorts_in_every_way::<Point>(&[], SweepAxis::X);
}

#[test]
fn what_is_sorted_comes_out_as_it_went_in_and_hardly_waits() {
    let field = shuffled(height_field::<Point>(600, 300));
    let config =
        Config { axis: SweepAxis::X, method: Method::Sort, memory_bytes: 1 << 30, steps: None };
    let (bytes, _) = sorted(&field, &config, 2).unwrap();
    let triangles: Vec<Triangle<Point>> = bytes
        .chunks_exact(36)
        .map(|one| zerocopy::FromBytes::read_from_bytes(one).unwrap())
        .collect();
    let method = Method::Absorb { displacement_max: 0 };
    let (again, outcome) = sorted(&triangles, &Config { method, ..config }, 2).unwrap();
    assert!(again == bytes);
    assert_eq!(outcome.displacement_max, Some(0));
    let ties = 600;
    let window = window::triangles_max(0) + ties;
    assert!(outcome.held_max <= window, "{outcome:?}");
}

#[test]
fn a_window_holds_no_more_than_its_bytes_and_what_ties() {
    for distance in [10, 50_000, 150_000] {
        let field = disturbed(height_field::<Point>(2000, 100), distance);
        let workspace = Workspace::for_test();
        let (order, chosen) =
            measure_order(&source(&field, &workspace), &workspace, &Monitor::silent(), |t| {
                t.0[0].0[0] < 0.5
            })
            .unwrap();
        let expected: Vec<_> = field.iter().filter(|t| t.0[0].0[0] < 0.5).copied().collect();
        assert!(!chosen.is_empty() && chosen == expected);
        let method = Method::Absorb { displacement_max: order.displacement_max[0] };
        let config = Config { axis: SweepAxis::X, method, memory_bytes: 1 << 30, steps: None };
        let (_, outcome) = sorted(&field, &config, 2).unwrap();
        assert_eq!(outcome.displacement_max, Some(order.displacement_max[0]));
        assert!(
            outcome.held_max <= window::triangles_max(order.displacement_max[0]) + 200,
            "{outcome:?}"
        );
    }
}

#[test]
fn a_triangle_later_than_promised_is_an_error_with_its_place() {
    let mut field = height_field::<Point>(2000, 100);
    let late = field.remove(1000);
    field.insert(300_000, late);
    let method = Method::Absorb { displacement_max: 100 };
    let config = Config { axis: SweepAxis::X, method, memory_bytes: 1 << 30, steps: None };
    for threads in [1, 2] {
        let error = sorted(&field, &config, threads).unwrap_err();
        let Error::NotSorted { axis, triangle, late_by, late_by_max } = error else {
            panic!("{error}");
        };
        // Of row 5 there are 199 triangles; those of row 6 begin at 1199.
        assert_eq!((axis, triangle, late_by, late_by_max), ("x", 300_000, 300_000 - 1199, 100));
    }
}

#[test]
fn a_sort_can_be_cancelled_and_its_sink_can_fail() {
    let field = height_field::<Point>(100, 100);
    let workspace = Workspace::for_test();
    let source = source(&field, &workspace);
    for method in [Method::Sort, Method::Absorb { displacement_max: 0 }] {
        let config = Config { axis: SweepAxis::X, method, memory_bytes: 1 << 20, steps: None };
        let monitor = Monitor { observer: &|_: &Event| (), cancel: Cancel::default() };
        monitor.cancel.raise();
        let error = presort(&source, &config, &workspace, &monitor, |_| Ok(())).unwrap_err();
        assert!(matches!(error, Error::Cancelled(by) if by.0 == StageId::Sort));
        let fail = |_: &[Triangle<Point>]| Err(Error::Request("enough".to_owned()));
        let error = presort(&source, &config, &workspace, &Monitor::silent(), fail).unwrap_err();
        assert_eq!(error.to_string(), "enough");
    }
}

#[test]
fn a_thread_that_panics_ends_the_pass() {
    let field = height_field::<Point>(2000, 100);
    let workspace = Workspace::for_test();
    let source = source(&field, &workspace);
    let panics = |triangle: &Triangle<Point>| {
        assert!(triangle.0[0].0[0] < 900.0, "in the middle of the stream");
        false
    };
    let pass = || measure_order(&source, &workspace, &Monitor::silent(), panics).map(drop);
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let ended = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| pool.install(pass)));
        assert!(ended.is_err(), "{threads} threads");
    }
}
