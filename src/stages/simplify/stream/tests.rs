//! The stream against what must hold of it, on surfaces small enough to look at all of.

use std::collections::HashMap;

use glam::DVec3;

use super::*;
use crate::soup::{Point, SweepKey, Vertex as _};

/// A soup in the order of a sweep along x.
type Soup = Vec<Triangle<Point>>;

fn sorted(mut soup: Soup) -> Soup {
    soup.sort_by_key(|triangle| SweepKey::of(triangle, SweepAxis::X));
    soup
}

/// A torus around the y axis, of `rings` times `steps` squares cut in two, with bumps: closed.
fn torus(rings: u32, steps: u32) -> Soup {
    bumpy_torus(rings, steps, 0.05)
}

fn bumpy_torus(rings: u32, steps: u32, bumps: f32) -> Soup {
    let corner = |ring: u32, step: u32| {
        let angle = |at: u32, of: u32| (at % of) as f32 / of as f32 * std::f32::consts::TAU;
        let (around, along) = (angle(ring, rings), angle(step, steps));
        let radius = 1.0 + bumps * (7.0 * around).sin() * (5.0 * along).cos();
        let out = 3.0 + radius * along.cos();
        Point([out * around.cos(), radius * along.sin(), out * around.sin()])
    };
    let squares = (0..rings).flat_map(|ring| (0..steps).map(move |step| (ring, step)));
    sorted(
        squares
            .flat_map(|(r, s)| {
                square(corner(r, s), corner(r + 1, s), corner(r + 1, s + 1), corner(r, s + 1))
            })
            .collect(),
    )
}

/// Hills over a square, `length` times `width` squares cut in two: its outline is boundary.
fn hills(length: u32, width: u32) -> Soup {
    let corner = |x: u32, y: u32| {
        let (x, y) = (x as f32 / width as f32, y as f32 / width as f32);
        Point([x, y, height(x, y)])
    };
    let squares = (0..length).flat_map(|x| (0..width).map(move |y| (x, y)));
    sorted(
        squares
            .flat_map(|(x, y)| {
                square(corner(x, y), corner(x + 1, y), corner(x + 1, y + 1), corner(x, y + 1))
            })
            .collect(),
    )
}

fn height(x: f32, y: f32) -> f32 {
    0.1 * (9.0 * x + 1.0).sin() * (7.0 * y).cos() + 0.02 * (25.0 * x * y).sin()
}

fn square(a: Point, b: Point, c: Point, d: Point) -> [Triangle<Point>; 2] {
    [Triangle([a, b, c]), Triangle([c, d, a])]
}

fn config(window_triangles: usize, ratio: f64) -> Config {
    Config {
        axis: SweepAxis::X,
        target: Target::Ratio(ratio),
        choices: 8,
        seed: 1,
        window_triangles,
        window_triangles_max: window_triangles,
        budget_bytes: 1 << 30,
    }
}

/// Runs the stream on a soup that comes in batches of `batch` triangles.
fn run(soup: &Soup, config: &Config, batch: usize) -> Result<(Soup, Outcome)> {
    let mut written = Soup::new();
    let mut out = |triangles: &[Triangle<Point>]| {
        written.extend_from_slice(triangles);
        Ok(())
    };
    let workspace = Workspace::for_test();
    let outcome = decimate(config, &workspace, &Monitor::silent(), &mut out, |sink| {
        soup.chunks(batch).try_for_each(sink)
    })?;
    assert_eq!(written.len() as u64, outcome.triangles_written);
    assert_eq!(soup.len() as u64, outcome.triangles_read);
    Ok((written, outcome))
}

/// Edges of a soup welded by exact position, by their faces: with one, with more than two or two
/// the same way round, and all.
fn edges(soup: &Soup) -> [usize; 3] {
    let mut edges = HashMap::<[[u32; 3]; 2], (i32, i32)>::new();
    for triangle in soup {
        let corners = triangle.0.map(|corner| corner.0.map(|c| (c + 0.0).to_bits()));
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            let edge = edges.entry([a.min(b), a.max(b)]).or_default();
            edge.0 += 1;
            edge.1 += if a < b { 1 } else { -1 };
        }
    }
    let open = edges.values().filter(|edge| edge.0 == 1).count();
    let wrong = edges.values().filter(|edge| edge.0 > 2 || (edge.0 == 2 && edge.1 != 0)).count();
    [open, wrong, edges.len()]
}

fn vertices(soup: &Soup) -> usize {
    let mut corners: Vec<[u32; 3]> =
        soup.iter().flat_map(|t| t.0).map(|corner| corner.0.map(|c| (c + 0.0).to_bits())).collect();
    corners.sort_unstable();
    corners.dedup();
    corners.len()
}

#[test]
fn a_closed_surface_stays_closed_in_windows_of_any_size() {
    let soup = torus(160, 60);
    for (window, ratio) in [
        (1500, 0.1),
        (1500, 0.5),
        (4000, 0.02),
        (4000, 0.1),
        (4000, 0.9),
        (12_000, 0.1),
        (50_000, 0.1),
    ] {
        let (written, outcome) = run(&soup, &config(window, ratio), 700).unwrap();
        assert_eq!(outcome.triangles_target, (soup.len() as f64 * ratio).round() as u64);
        let wanted = outcome.triangles_target / 2 * 2;
        assert_eq!(written.len() as u64, wanted, "{window} {ratio}: {outcome:?}");
        let [open, wrong, edges] = edges(&written);
        assert_eq!((open, wrong), (0, 0), "{window} {ratio}: P_bc is torn");
        assert_eq!(vertices(&written) + written.len() - edges, 0, "it is still one torus");
        assert!(outcome.window_max <= window as u64, "{window} {ratio}: {outcome:?}");
        if window <= 4000 {
            let early = outcome.triangles_target as f64 - 0.5 * (1.0 + ratio) * window as f64;
            assert!(outcome.written_early as f64 >= early.max(0.0) - 10.0, "{outcome:?}");
            assert!(outcome.rounds >= 5 && outcome.front_max > 0, "{outcome:?}");
        }
        assert_eq!(outcome.written_forced, 0, "{window} {ratio}: {outcome:?}");
    }
}

#[test]
fn what_is_written_grows_from_what_was_written() {
    let soup = torus(300, 40);
    let (_, outcome) = run(&soup, &config(4000, 0.2), 4096).unwrap();
    assert!(outcome.written_early > 2000, "{outcome:?}");
    assert!(outcome.written_inside < outcome.written_early / 50, "{outcome:?}");
}

#[test]
fn the_window_is_filled_to_the_brim_and_emptied_by_half() {
    let soup = hills(400, 50);
    let (_, outcome) = run(&soup, &config(4000, 0.1), 333).unwrap();
    assert_eq!(outcome.window_max, 4000);
    // 40,000 triangles, half a window at a time, the first time a whole one.
    assert_eq!(outcome.rounds, 40_000 / 2000 - 2);
}

#[test]
fn batches_and_seeds_and_counts_are_what_they_are() {
    let soup = torus(100, 40);
    let expected = run(&soup, &config(2000, 0.1), 8000).unwrap().0;
    for batch in [1, 77, 2000] {
        assert!(run(&soup, &config(2000, 0.1), batch).unwrap().0 == expected, "{batch}");
    }
    let other = Config { seed: 2, ..config(2000, 0.1) };
    assert!(run(&soup, &other, 8000).unwrap().0 != expected, "another seed, other candidates");
    let target = Target::Count { triangles: 800, of: 8000 };
    let counted = run(&soup, &Config { target, ..config(2000, 0.1) }, 8000).unwrap().0;
    assert!(counted == expected, "a tenth is 800");
}

#[test]
fn a_boundary_is_final_decimated_and_written_while_the_stream_runs() {
    // Long and narrow: all of its outline is boundary. To hold it to the end, as without
    // finalization, a window needs 4,000 triangles for it alone.
    let soup = hills(2000, 8);
    for ratio in [0.25, 0.05] {
        let (written, outcome) = run(&soup, &config(1500, ratio), 512).unwrap();
        assert_eq!(written.len() as u64, outcome.triangles_target, "any count of an open surface");
        assert_eq!(edges(&written)[1], 0);
        assert_eq!(vertices(&written) + written.len() - edges(&written)[2], 1, "still a disc");
        assert!(outcome.front_max < 100, "{outcome:?}");
        assert!(outcome.boundary_vertices > 4000, "{outcome:?}");
        assert!(outcome.written_early as f64 > 0.8 * written.len() as f64 - 750.0, "{outcome:?}");
        // The outline is where it was.
        let extent = |axis: usize| {
            written.iter().flat_map(|t| t.0).fold((f32::MAX, f32::MIN), |(low, high), corner| {
                (low.min(corner.position()[axis]), high.max(corner.position()[axis]))
            })
        };
        // A square is an eighth wide, and corners are worn by chance.
        let near = |a: f32, b: f32| (a - b).abs() < 0.25;
        assert!(near(extent(0).0, 0.0) && near(extent(0).1, 250.0), "{:?}", extent(0));
        assert!(near(extent(1).0, 0.0) && near(extent(1).1, 1.0), "{:?}", extent(1));
        // And it has been decimated like the rest.
        let open = edges(&written)[0] as f64;
        assert!(open < 4016.0 * ratio * 3.0 + 60.0, "{open} of 4016 boundary edges");
    }
}

#[test]
fn a_front_that_does_not_fit_is_an_error_with_the_size_needed() {
    // A tube along x of two rings: no vertex of its far end is final before all is read.
    let angle = |k: u32| k as f32 / 5000.0 * std::f32::consts::TAU;
    let corner = |k: u32, x: f32| Point([x, angle(k % 5000).cos(), angle(k % 5000).sin()]);
    let tube = |k| square(corner(k, 0.0), corner(k + 1, 0.0), corner(k + 1, 1.0), corner(k, 1.0));
    let soup = sorted((0..5000).flat_map(tube).collect());
    let error = run(&soup, &config(1000, 0.5), 512).unwrap_err();
    let Error::Resource { what, needed_bytes, .. } = error else { panic!("{error}") };
    assert!(what.contains("front"), "{what}");
    assert!(needed_bytes > window_bytes::<Point>(1000), "{needed_bytes}");
    // With room to grow it does as much as it must.
    let larger = Config { window_triangles_max: 1 << 20, ..config(1000, 0.5) };
    let (written, outcome) = run(&soup, &larger, 512).unwrap();
    assert_eq!(edges(&written)[1], 0);
    assert!(outcome.window_triangles >= 2000 && outcome.window_triangles <= 32_000, "{outcome:?}");
}

#[test]
fn what_cannot_be_decimated_passes_through_and_is_said() {
    // Tetrahedra: none can lose anything. The window is emptied all the same.
    let tetrahedron = |k: u32| {
        let at = |[x, y, z]: [f32; 3]| Point([x + 2.0 * k as f32, y, z]);
        let [a, b, c, d] = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(at);
        [Triangle([a, c, b]), Triangle([a, b, d]), Triangle([b, c, d]), Triangle([a, d, c])]
    };
    let soup = sorted((0..2000).flat_map(tetrahedron).collect());
    let (written, outcome) = run(&soup, &config(1000, 0.1), 512).unwrap();
    assert_eq!((written.len(), outcome.triangles_target), (8000, 800));
    assert!(outcome.is_stuck && outcome.written_forced > 0, "{outcome:?}");
}

#[test]
fn degenerate_and_complex_input_is_counted_and_kept_whole() {
    let mut soup = hills(60, 30);
    // A fin on an inner edge makes it an edge of three faces; and triangles that are none.
    let fin = Triangle([soup[1500].0[0], soup[1500].0[1], Point([0.8, 0.5, 3.0])]);
    soup.push(fin);
    soup.push(Triangle([Point([0.5; 3]), Point([0.5; 3]), Point([0.7; 3])]));
    let soup = sorted(soup);
    let (written, outcome) = run(&soup, &config(1000, 0.2), 100).unwrap();
    assert_eq!((outcome.degenerate, outcome.complex_vertices), (1, 2));
    assert_eq!(written.len() as u64, outcome.triangles_target);
    assert_eq!(edges(&written)[1], 1, "the edge with three faces is still there");
}

#[test]
fn nothing_is_left_of_nothing_and_little_of_little() {
    let (written, outcome) = run(&Soup::new(), &config(1000, 0.5), 10).unwrap();
    assert_eq!((written.len(), outcome.triangles_written), (0, 0));
    let (written, _) = run(&hills(1, 1), &config(1000, 1.0), 1).unwrap();
    assert_eq!(written.len(), 2);
    let (written, _) = run(&torus(40, 20), &config(1000, 1.0), 64).unwrap();
    assert_eq!((written.len(), edges(&written)[..2] == [0, 0]), (1600, true));
}

/// Root of the mean squared distance of a result from a torus without bumps: of the corners, the
/// middles of edges and the centres of its faces.
fn torus_error(faces: impl Iterator<Item = [DVec3; 3]>) -> f64 {
    let distance = |p: DVec3| (DVec3::new(p.x, 0.0, p.z).length() - 3.0).hypot(p.y) - 1.0;
    let (mut sum, mut count) = (0.0, 0.0);
    for [a, b, c] in faces {
        let area = (b - a).cross(c - a).length();
        for p in [a, b, c, (a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0, (a + b + c) / 3.0] {
            sum += area * distance(p).powi(2);
            count += area;
        }
    }
    f64::sqrt(sum / count)
}

#[test]
fn with_an_unlimited_window_it_is_multiple_choice_in_core() {
    let soup = bumpy_torus(80, 40, 0.0);
    let target = soup.len() / 8;
    let expected = oracle::decimated(&soup, target, 8);
    let (written, _) = run(&soup, &config(1 << 16, 0.125), 1000).unwrap();
    assert_eq!(written.len(), expected.len());
    let positions = |t: &Triangle<Point>| t.0.map(|c| DVec3::from_array(c.0.map(f64::from)));
    let ours = torus_error(written.iter().map(positions));
    let theirs = torus_error(expected.into_iter());
    assert!(ours < 1.05 * theirs, "{ours} {theirs}");
}
