//! The bound, by brute force; slabs beside one mesh; the oracles beside each other.

use glam::DVec3;
use proptest::prelude::*;

use super::*;
use crate::{
    geometry::distance_sq_to_triangle,
    mesh::{Fairing, Limits, Shape, Sides, Smooth, Update},
    soup::{ColoredPoint, Column, Point, SweepKey, Triangles, Vertex as _},
    storage::Budget,
};

type Soup = Vec<Triangle<Point>>;

/// A strip of squares cut in two, `length` times `width` of them, each of side 1 / `width`.
fn strip(length: u32, width: u32, height: impl Fn(f32, f32) -> f32) -> Soup {
    let corner = |x: u32, y: u32| {
        let (x, y) = (x as f32 / width as f32, y as f32 / width as f32);
        Point([x, y, height(x, y)])
    };
    let squares = (0..length).flat_map(|x| (0..width).map(move |y| (x, y)));
    let cut = |(x, y)| {
        let [a, b, c, d] = [corner(x, y), corner(x + 1, y), corner(x + 1, y + 1), corner(x, y + 1)];
        [Triangle([a, b, c]), Triangle([c, d, a])]
    };
    sorted(squares.flat_map(cut).collect())
}

fn sorted(mut soup: Soup) -> Soup {
    soup.sort_by_key(|triangle| SweepKey::of(triangle, SweepAxis::X));
    soup
}

fn hills(x: f32, y: f32) -> f32 {
    0.1 * (9.0 * x + 1.0).sin() * (7.0 * y).cos() + 0.02 * (25.0 * x).sin() * (23.0 * y).cos()
}

fn bound(tolerance: f64) -> Bound {
    let (fairing, update, sides) = (Fairing::Error, Update::Best, Sides::One);
    let limits = Limits::default();
    Bound { tolerance, fairing, update, sides, limits, faces: 0 }
}

fn config(soup: &Soup, bound: Bound, slab_triangles_min: u64) -> Config {
    Config {
        axis: SweepAxis::X,
        triangles: Some(soup.len() as u64),
        triangles_exact: None,
        bound,
        is_counted: bound.faces > 0,
        slab_triangles_min,
    }
}

/// The faces of a result, and what was noticed.
struct Done {
    faces: Vec<[DVec3; 3]>,
    tolerance: f64,
    slabs: u64,
    figures: Figures,
}

fn run(soup: &Soup, config: &Config) -> Done {
    run_in(soup, config, &Workspace::for_test()).unwrap()
}

fn run_in(soup: &Soup, config: &Config, workspace: &Workspace) -> Result<Done> {
    let monitor = Monitor::silent();
    let outcome = decimate::<Point>(config, workspace, &monitor, |sink| {
        soup.chunks(1000).try_for_each(sink)
    })?;
    let Outcome { mesh, tolerance, slabs, figures } = outcome;
    let (Column::Memory(vertices), Triangles::Memory(faces)) = (mesh.vertices, mesh.triangles)
    else {
        panic!("a decimated mesh is in memory")
    };
    let corner = |v: u32| DVec3::from_array(vertices[v as usize].position().map(f64::from));
    let faces = faces.iter().map(|face| face.map(corner)).collect();
    Ok(Done { faces, tolerance, slabs, figures })
}

/// The greatest distance of a corner of the soup from the faces.
fn farthest(soup: &Soup, faces: &[[DVec3; 3]]) -> f64 {
    let mut points: Vec<[u32; 3]> =
        soup.iter().flat_map(|t| t.0).map(|p| p.0.map(|c| (c + 0.0).to_bits())).collect();
    points.sort_unstable();
    points.dedup();
    let distance_sq = |bits: &[u32; 3]| {
        let point = DVec3::from_array(bits.map(|b| f64::from(f32::from_bits(b))));
        let to = |face: &[DVec3; 3]| distance_sq_to_triangle(face.map(|corner| corner - point));
        faces.iter().map(to).fold(f64::INFINITY, f64::min)
    };
    points.par_iter().map(distance_sq).reduce(|| 0.0, f64::max).sqrt()
}

const FAIRINGS: [Fairing; 3] = [
    Fairing::Error,
    Fairing::Shape(Shape { roundness_max: 20.0 }),
    Fairing::Smooth(Smooth { angle_max: std::f32::consts::FRAC_PI_2 }),
];

#[test]
fn no_vertex_is_farther_away_than_the_tolerance() {
    let soup = strip(120, 40, hills);
    for tolerance in [1e-4, 1e-3, 1e-2, 0.1] {
        let mut before = usize::MAX;
        for fairing in FAIRINGS {
            let bound = Bound { fairing, ..bound(tolerance) };
            for slab in [1 << 20, 1500] {
                let done = run(&soup, &config(&soup, bound, slab));
                let far = farthest(&soup, &done.faces);
                assert!(far <= tolerance, "{far} of {tolerance} by {fairing:?}, slabs of {slab}");
                // A tolerance is there to be used.
                let is_used = far > 0.5 * tolerance || !(1e-3..=1e-2).contains(&tolerance);
                assert!(is_used, "{far} of {tolerance} by {fairing:?}");
                before = before.min(done.faces.len());
            }
        }
        assert!(before < soup.len(), "{tolerance} takes something away");
    }
}

#[test]
fn slabs_leave_as_little_as_one_mesh() {
    let soup = strip(800, 100, hills);
    for tolerance in [3e-4, 3e-3] {
        let one = run(&soup, &config(&soup, bound(tolerance), 1 << 30));
        let many = run(&soup, &config(&soup, bound(tolerance), 4096));
        assert!(one.slabs == 1 && many.slabs > 16, "{} slabs are joined twice", many.slabs);
        let (one, many) = (one.faces.len() as f64, many.faces.len() as f64);
        assert!(many < 1.04 * one, "within {tolerance}: {many} and {one} as one mesh");
    }
}

#[test]
fn threads_and_memory_change_nothing() {
    let soup = strip(400, 100, hills);
    let config = config(&soup, bound(1e-3), 4096);
    let results = [(1, 64), (2, 3), (3, 64)].map(|(threads, mebibytes)| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let workspace = Workspace::for_test().with_budget(Budget::new(mebibytes << 20));
        pool.install(|| run_in(&soup, &config, &workspace).unwrap().faces)
    });
    assert!(results[1..].iter().all(|other| *other == results[0]));
}

#[test]
fn what_is_flat_goes_at_a_tolerance_of_nothing() {
    let flat = strip(60, 20, |_, _| 0.25);
    for slab in [1 << 20, 200] {
        let done = run(&flat, &config(&flat, bound(0.0), slab));
        // A rectangle.
        assert_eq!((done.faces.len(), farthest(&flat, &done.faces)), (2, 0.0));
    }
    let curved = strip(60, 20, |x, y| x * x + y * y);
    let done = run(&curved, &config(&curved, bound(0.0), 1 << 20));
    assert_eq!((done.faces.len(), farthest(&curved, &done.faces)), (curved.len(), 0.0));
}

#[test]
fn a_tolerance_larger_than_the_mesh_keeps_the_surface_a_surface() {
    let soup = strip(60, 20, hills);
    let done = run(&soup, &config(&soup, bound(1e9), 300));
    assert!((1..=4).contains(&done.faces.len()), "{}", done.faces.len());
}

#[test]
fn a_count_is_met_by_as_small_a_tolerance_as_it_takes() {
    let soup = strip(120, 40, hills);
    let counted = |faces, tolerance| {
        let bound = Bound { faces, ..bound(tolerance) };
        run(&soup, &config(&soup, bound, 1500))
    };
    let done = counted(1000, f64::INFINITY);
    assert!((999..=1000).contains(&done.faces.len()), "{}", done.faces.len());
    assert!(farthest(&soup, &done.faces) <= done.tolerance);
    // The same tolerance, and no more, comes as far without the count.
    let bounded = run(&soup, &config(&soup, bound(done.tolerance), 1 << 20));
    assert!(bounded.faces.len() <= 1050, "{}", bounded.faces.len());
    let less = run(&soup, &config(&soup, bound(done.tolerance / 1.5), 1 << 20));
    assert!(less.faces.len() > 1000, "{}", less.faces.len());
    // The bound comes first.
    let short = counted(100, done.tolerance);
    assert!(short.faces.len() > 100 && farthest(&soup, &short.faces) <= done.tolerance);
}

/// A tetrahedron far away from everything but itself, beside a strip; and a triangle whose corners
/// are two points, one of them like no other.
#[test]
fn a_vertex_of_no_face_is_near_something_or_kept() {
    let mut soup = strip(60, 20, hills);
    let near = Point([1.5, 0.5, hills(1.5, 0.5) + 0.004]);
    let far = Point([1.0, 0.5, 7.0]);
    let known = soup[0].0[0];
    soup.extend([Triangle([known, known, near]), Triangle([known, far, far])]);
    let soup = sorted(soup);
    let done = run(&soup, &config(&soup, bound(0.01), 1 << 20));
    assert!(farthest(&soup, &done.faces) <= 0.01);
    assert_eq!((done.figures.degenerate, done.figures.loose_vertices), (2, 1));
}

#[test]
fn nothing_and_one_triangle_stay() {
    let nothing = run(&Vec::new(), &config(&Vec::new(), bound(1.0), 10));
    assert!(nothing.faces.is_empty());
    let one = strip(1, 1, hills)[..1].to_vec();
    assert_eq!(run(&one, &config(&one, bound(1e9), 10)).faces.len(), 1);
}

#[test]
fn what_does_not_fit_is_refused_with_what_it_needs() {
    let soup = strip(400, 100, hills);
    for (bound, slab) in [(bound(1e-3), 1 << 20), (Bound { faces: 5, ..bound(1.0) }, 4096)] {
        let workspace = Workspace::for_test().with_budget(Budget::new(2 << 20));
        let refused = run_in(&soup, &config(&soup, bound, slab), &workspace);
        let is_refused =
            matches!(refused, Err(Error::Resource { needed_bytes, .. }) if needed_bytes > 2 << 20);
        assert!(is_refused, "it cannot fit");
    }
}

#[test]
fn round_triangles_and_flat_edges_are_what_the_oracles_are_for() {
    let soup = strip(200, 60, hills);
    let faces = FAIRINGS
        .map(|fairing| run(&soup, &config(&soup, Bound { fairing, ..bound(2e-3) }, 1 << 20)).faces);
    let [by_error, by_shape, by_angle] = [0, 1, 2].map(|i| mean_roundness(&faces[i]));
    assert!(
        by_shape < 0.9 * by_error && by_shape < 0.9 * by_angle,
        "{by_shape} {by_error} {by_angle}"
    );
    assert!(faces[2].len() < faces[1].len(), "elongated triangles are fewer");
}

/// Longest edge over inner radius, 3.46 at best.
fn mean_roundness(faces: &[[DVec3; 3]]) -> f64 {
    let roundness = |[a, b, c]: &[DVec3; 3]| {
        let edges = [a.distance(*b), b.distance(*c), c.distance(*a)];
        let around: f64 = edges.iter().sum();
        edges[0].max(edges[1]).max(edges[2]) * around / (*b - *a).cross(*c - *a).length()
    };
    faces.iter().map(roundness).sum::<f64>() / faces.len() as f64
}

/// Blue on one side of a wave, yellow on the other.
fn painted(soup: &Soup) -> Vec<Triangle<ColoredPoint>> {
    let paint = |point: &Point| {
        let [x, y, _] = point.0;
        let share = ((y - 0.5 - 0.2 * (7.0 * x).sin()) * 20.0).clamp(0.0, 1.0);
        let mix = |low: f32, high: f32| (low + share * (high - low)).round() as u8;
        ColoredPoint { position: point.0, color: [mix(20.0, 250.0), mix(40.0, 220.0), 90, 255] }
    };
    soup.iter().map(|triangle| Triangle(triangle.0.map(|point| paint(&point)))).collect()
}

/// Of the vertices of a soup, the greatest distance in colour, channel by channel, from the nearest
/// of the places that are within a tolerance.
fn off_color(soup: &[Triangle<ColoredPoint>], mesh: &IndexedMesh<ColoredPoint>, near: f64) -> f64 {
    let (Column::Memory(vertices), Triangles::Memory(faces)) = (&mesh.vertices, &mesh.triangles)
    else {
        panic!("a decimated mesh is in memory")
    };
    let at = |v: &ColoredPoint| DVec3::from_array(v.position.map(f64::from));
    let paint = |v: &ColoredPoint| DVec3::new(v.color[0].into(), v.color[1].into(), 0.0);
    let off = |point: &ColoredPoint| {
        let off_face = |face: &[u32; 3]| {
            let corners = face.map(|v| vertices[v as usize]);
            let [a, b, c] = corners.map(|corner| at(&corner) - at(point));
            if distance_sq_to_triangle([a, b, c]).sqrt() > near {
                return f64::INFINITY;
            }
            // Above, or nearly: the surface is a height field with long slopes.
            let area = |u: DVec3, v: DVec3| u.truncate().perp_dot(v.truncate());
            let all = area(b - a, c - a);
            let [u, v, w] = [area(b, c) / all, area(c, a) / all, area(a, b) / all];
            if u.min(v).min(w) < -0.05 {
                return f64::INFINITY;
            }
            let [one, two, three] = corners.map(|corner| paint(&corner));
            (u * one + v * two + w * three).distance(paint(point))
        };
        faces.iter().map(off_face).fold(f64::INFINITY, f64::min)
    };
    let points: Vec<ColoredPoint> = soup.iter().flat_map(|triangle| triangle.0).collect();
    points.par_iter().map(off).filter(|off| off.is_finite()).reduce(|| 0.0, f64::max)
}

#[test]
fn colours_are_bounds_as_well() {
    let soup = painted(&strip(160, 60, |x, y| 0.02 * (3.0 * x).sin() * (3.0 * y).cos()));
    let done = |color: Option<f32>, slab: u64| {
        let bound = Bound { limits: Limits { color, normal: None }, ..bound(2e-3) };
        let config = Config { triangles: None, ..config(&Vec::new(), bound, slab) };
        let (workspace, monitor) = (Workspace::for_test(), Monitor::silent());
        let feed = |sink: &mut dyn FnMut(&[Triangle<ColoredPoint>]) -> Result<()>| sink(&soup);
        decimate(&config, &workspace, &monitor, feed).unwrap().mesh
    };
    for slab in [1 << 20, 2000] {
        let [blind, wide, narrow] = [None, Some(20.0), Some(5.0)].map(|limit| done(limit, slab));
        let [off_blind, off_wide, off_narrow] =
            [&blind, &wide, &narrow].map(|mesh| off_color(&soup, mesh, 2e-3));
        // A unit of ΔE is some units of a channel.
        assert!(off_blind > 150.0, "{off_blind} if nobody looks");
        assert!(off_wide < 90.0 && off_narrow < 30.0, "{off_wide} and {off_narrow}");
        let counts = [&blind, &wide, &narrow].map(|mesh| mesh.counts().triangles);
        assert!(counts[0] < counts[1] && counts[1] < counts[2], "{counts:?}");
    }
}

#[test]
fn normals_are_bounds_as_well() {
    // Low and steep: within the tolerance it is flat.
    let soup = strip(160, 40, |x, _| 0.004 * (20.0 * x).sin());
    let count = |normal: Option<f32>, slab: u64| {
        let bound = Bound { limits: Limits { color: None, normal }, ..bound(0.01) };
        run(&soup, &config(&soup, bound, slab)).faces.len()
    };
    for slab in [1 << 20, 2000] {
        let counts = [None, Some(0.05), Some(0.015)].map(|normal| count(normal, slab));
        assert!(counts[0] < 20 && 5 * counts[0] < counts[1], "{counts:?}");
        assert!(2 * counts[1] < counts[2], "{counts:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn rough_surfaces_keep_the_bound(
        heights in proptest::collection::vec(-1.0_f32..1.0, 221),
        share in 0.001_f64..1.0,
        slab in 20_u64..400,
        which in 0_usize..3,
        both in any::<bool>(),
    ) {
        let soup = strip(16, 12, |x, y| {
            let (i, j) = ((x * 12.0).round() as usize, (y * 12.0).round() as usize);
            0.3 * heights[i * 13 + j]
        });
        let sides = if both { Sides::Both } else { Sides::One };
        let bound = Bound { fairing: FAIRINGS[which], sides, ..bound(0.3 * share) };
        let done = run(&soup, &config(&soup, bound, slab));
        let far = farthest(&soup, &done.faces);
        prop_assert!(far <= bound.tolerance, "{} of {}", far, bound.tolerance);
    }
}
