//! Slabs against one mesh in core, on surfaces whose height is known at every point.

use glam::DVec3;

use super::*;
use crate::{
    geometry::{Bounds, Sampler},
    soup::{Column, Point, SweepKey, Triangles, Vertex as _},
    storage::Budget,
};

type Soup = Vec<Triangle<Point>>;

/// A strip of squares cut in two, `length` times `width` of them, each of side 1 / `width`.
fn strip(length: u32, width: u32, height: fn(f32, f32) -> f32) -> Soup {
    let corner = |x: u32, y: u32| {
        let (x, y) = (x as f32 / width as f32, y as f32 / width as f32);
        Point([x, y, height(x, y)])
    };
    let squares = (0..length).flat_map(|x| (0..width).map(move |y| (x, y)));
    let cut = |(x, y)| {
        let [a, b, c, d] = [corner(x, y), corner(x + 1, y), corner(x + 1, y + 1), corner(x, y + 1)];
        [Triangle([a, b, c]), Triangle([c, d, a])]
    };
    let mut soup: Soup = squares.flat_map(cut).collect();
    soup.sort_by_key(|triangle| SweepKey::of(triangle, SweepAxis::X));
    soup
}

fn hills(x: f32, y: f32) -> f32 {
    0.1 * (9.0 * x + 1.0).sin() * (7.0 * y).cos() + 0.02 * (25.0 * x).sin() * (23.0 * y).cos()
}

fn config(soup: &Soup, ratio: f64, slab_triangles_min: u64) -> Config {
    Config {
        axis: SweepAxis::X,
        triangles: Some(soup.len() as u64),
        triangles_exact: Some(soup.len() as u64),
        wanted: Wanted::Ratio(ratio),
        metric: Metric::Quadric,
        slab_triangles_min,
        threshold: None,
    }
}

/// With the threshold that a sample of the soup gives.
fn with_threshold(soup: &Soup, config: Config) -> Config {
    let (mut bounds, mut sampler) = (Bounds::default(), Sampler::default());
    soup.iter().flat_map(|triangle| &triangle.0).for_each(|point| bounds.add(point.0));
    sampler.look(soup.iter().flat_map(|triangle| &triangle.0).map(|point| point.0));
    let sample = Sampler::finish(vec![sampler], soup.len() as u64 / 2);
    let blobs = Blobs::choose(&sample, &bounds).expect("large enough");
    let chosen: Soup = soup.iter().filter(|triangle| blobs.takes(triangle)).copied().collect();
    let threshold = threshold(&config, &blobs, chosen);
    Config { threshold, ..config }
}

fn run(soup: &Soup, config: &Config) -> Result<(Vec<[DVec3; 3]>, u64)> {
    let workspace = Workspace::for_test();
    let monitor = Monitor::silent();
    let outcome = decimate::<Point>(config, &workspace, &monitor, |sink| {
        soup.chunks(1000).try_for_each(sink)
    })?;
    let (Column::Memory(vertices), Triangles::Memory(faces)) =
        (outcome.mesh.vertices, outcome.mesh.triangles)
    else {
        panic!("a decimated mesh is in memory")
    };
    let corner = |v: u32| DVec3::from_array(vertices[v as usize].position().map(f64::from));
    Ok((faces.iter().map(|face| face.map(corner)).collect(), outcome.slabs))
}

/// The same, as one mesh.
fn in_core(soup: &Soup, ratio: f64) -> Vec<[DVec3; 3]> {
    let mut welded = mesh::weld::<_, ByQuadric>(soup);
    welded.patch.unit = mesh::unit_of(soup);
    let mut mesh = Mesh::of_original(welded.into_patch());
    mesh::finish(&mut mesh, (soup.len() as f64 * ratio).round() as usize);
    <ByQuadric as mesh::Metric>::place(&mut mesh);
    let patch = mesh.into_patch();
    let corner = |v: u32| patch.positions[v as usize].as_dvec3();
    patch.faces.iter().map(|face| face.map(corner)).collect()
}

/// Root mean square of the distance from the known height, straight up, over the triangles whose
/// middle has its first coordinate in `among`.
fn deviation(
    faces: &[[DVec3; 3]],
    height: fn(f32, f32) -> f32,
    among: impl Fn(f64) -> bool,
) -> f64 {
    const STEPS: u32 = 6;
    let (mut sum, mut weights) = (0.0, 0.0);
    for [a, b, c] in faces.iter().filter(|[a, b, c]| among((a.x + b.x + c.x) / 3.0)) {
        let area = (*b - *a).cross(*c - *a).length() / f64::from(STEPS * STEPS);
        for (i, j) in (0..STEPS).flat_map(|i| (0..STEPS - i).map(move |j| (i, j))) {
            let [u, v] = [i, j].map(|k| (f64::from(k) + 0.33) / f64::from(STEPS));
            let p = *a + (*b - *a) * u + (*c - *a) * v;
            sum += area * (p.z - f64::from(height(p.x as f32, p.y as f32))).powi(2);
            weights += area;
        }
    }
    (sum / weights).sqrt()
}

/// First coordinates of the places where slabs end.
fn seams(soup: &Soup, config: &Config) -> Vec<f64> {
    let mut seams = Vec::new();
    let mut cutter = Cutter::new(config.axis, config.slab_triangles_min as usize);
    let mut start = |slab: Slab<Point>| -> Result<()> {
        let last = slab.triangles.last().map_or(0.0, |triangle| triangle.0[0].0[0]);
        seams.push(f64::from(last));
        Ok(())
    };
    cutter.push(soup, &mut start).unwrap();
    seams
}

#[test]
fn slabs_are_as_near_as_one_mesh_and_seams_as_near_as_the_rest() {
    let soup = strip(1600, 100, hills);
    for ratio in [0.1, 0.01] {
        let config = config(&soup, ratio, 4096);
        let (faces, slabs) = run(&soup, &config).unwrap();
        assert_eq!(faces.len(), (soup.len() as f64 * ratio).round() as usize);
        assert!(slabs > 16, "{slabs} slabs are joined twice");
        let (found, expected) =
            [&faces, &in_core(&soup, ratio)].map(|f| deviation(f, hills, |_| true)).into();
        assert!(found < 1.05 * expected, "to {ratio}: {found} and {expected} as one mesh");
        let seams = seams(&soup, &config);
        let is_near = |x: f64| seams.iter().any(|seam| (seam - x).abs() < 0.03);
        let at_seams = deviation(&faces, hills, is_near);
        let elsewhere = deviation(&faces, hills, |x| !is_near(x));
        assert!(
            at_seams < 1.1 * elsewhere,
            "to {ratio}: {at_seams} at seams, {elsewhere} elsewhere"
        );
    }
}

/// Three quarters of it are flat.
fn plain_before_hills(x: f32, y: f32) -> f32 {
    if x < 3.0 { 0.0 } else { hills(x, y) * (x - 3.0).min(1.0) }
}

fn hills_before_plain(x: f32, y: f32) -> f32 {
    plain_before_hills(4.0 - x, y)
}

#[test]
fn triangles_are_left_where_the_detail_is() {
    for height in [plain_before_hills, hills_before_plain] {
        let soup = strip(1000, 250, height);
        for ratio in [0.1, 0.01] {
            let unaware = config(&soup, ratio, 16_384);
            let aware = with_threshold(&soup, unaware);
            assert!(aware.threshold.is_some());
            let error = |faces: &[[DVec3; 3]]| deviation(faces, height, |_| true);
            let [by_share, by_cost] = [unaware, aware].map(|c| error(&run(&soup, &c).unwrap().0));
            let expected = error(&in_core(&soup, ratio));
            assert!(by_cost < 1.05 * expected, "to {ratio}: {by_cost}, {expected} as one mesh");
            // What the threshold is for.
            assert!(by_share > 1.15 * expected, "to {ratio}: {by_share}, {expected} as one mesh");
        }
    }
}

#[test]
fn threads_and_memory_change_nothing() {
    let soup = strip(400, 200, hills);
    let config = config(&soup, 0.02, 4096);
    let results = [1, 2, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| run(&soup, &config).unwrap())
    });
    assert!(results[0].1 > 4 && results[1..].iter().all(|other| *other == results[0]));
}

#[test]
fn what_does_not_fit_is_refused_with_what_it_needs() {
    let soup = strip(400, 200, hills);
    let config = config(&soup, 0.5, 4096);
    let workspace = Workspace::for_test().with_budget(Budget::new(4 << 20));
    let feed = |sink: &mut dyn FnMut(&[Triangle<Point>]) -> Result<()>| {
        soup.chunks(1000).try_for_each(sink)
    };
    let refused = decimate::<Point>(
        &Config { triangles: None, ..config },
        &workspace,
        &Monitor::silent(),
        feed,
    );
    assert!(matches!(refused, Err(Error::Resource { needed_bytes, .. }) if needed_bytes > 4 << 20));
}
