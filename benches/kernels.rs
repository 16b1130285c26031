//! The inner loops that decide how fast meshmill is, each on its own: `cargo bench`, and
//! `scripts/bench.sh compare OLD NEW` for two commits side by side.

use std::{hint::black_box, io::Cursor, path::Path, time::Duration};

use criterion::{BatchSize, Criterion, Throughput};
use glam::{DVec3, Vec3};
use meshmill::{
    external::{
        Keyed,
        sort::{Config as SortConfig, Engine, Sorter},
    },
    formats::{self, Batch, Content, Format, OnDefect, Origin, ReadOptions},
    geometry::{Bounds, Grid, Placement, Quadric},
    mesh::{ByQuadric, ByVolume, Limit, Mesh, Metric, sweep_blocks, unit_of, weld},
    progress::{Monitor, StageId},
    soup::{Point, Source, Triangle},
    stages::{
        generate::{self, Kind, Layout, NOISE_DEFAULT},
        simplify::cluster::{self, Quadrics},
    },
    storage::{Budget, Record, RecordWriter, Workspace},
};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

/// About a slab.
const TRIANGLES: u64 = 1 << 18;

/// A gyroid in the order it is made in, and as files in memory.
struct Surface {
    triangles: Vec<Triangle<Point>>,
    bounds: Bounds,
    ply: Vec<u8>,
    stl: Vec<u8>,
}

impl Surface {
    fn new() -> Self {
        let config = |layout| generate::Config {
            kind: Kind::Gyroid,
            triangles: TRIANGLES,
            noise: NOISE_DEFAULT,
            seed: 1,
            layout,
        };
        let (mut triangles, mut vertices) = (Vec::new(), Vec::new());
        let (mut stl, mut faces) = (vec![0; 84], Vec::<u8>::new());
        let monitor = Monitor::silent();
        let soup = generate::generate(&config(Layout::Soup), &monitor, &mut |batch| {
            for corners in batch.positions.as_chunks().0 {
                let [a, b, c] = *corners;
                triangles.push(Triangle([Point(a), Point(b), Point(c)]));
                stl.extend([0; 12]);
                stl.extend_from_slice(corners.as_bytes());
                stl.extend([0; 2]);
            }
            Ok(())
        });
        let mesh = generate::generate(&config(Layout::Indexed), &monitor, &mut |batch| {
            vertices.extend_from_slice(batch.positions.as_bytes());
            for face in batch.faces.iter() {
                faces.push(3);
                faces.extend(face.iter().flat_map(|v| (*v as u32).to_le_bytes()));
            }
            Ok(())
        });
        let (soup, mesh) = (soup.expect("no limit is met"), mesh.expect("no limit is met"));
        stl[80..84].copy_from_slice(&(soup.counts.triangles as u32).to_le_bytes());
        let mut ply = format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\n\
             property float y\nproperty float z\nelement face {}\n\
             property list uchar uint vertex_indices\nend_header\n",
            mesh.counts.vertices, mesh.counts.triangles
        )
        .into_bytes();
        ply.extend(vertices);
        ply.extend(faces);
        Self { triangles, bounds: soup.bounds, ply, stl }
    }
}

/// What it costs to know and to minimise an error.
fn quadrics(c: &mut Criterion) {
    let mut group = c.benchmark_group("quadric");
    group.throughput(Throughput::Elements(1));
    let mut quadric = Quadric::default();
    for n in [DVec3::X, DVec3::new(0.6, 0.8, 0.0), DVec3::new(0.0, 0.6, 0.8)] {
        quadric.add_plane(0.3, n, 0.1);
    }
    group.bench_function("evaluate", |b| {
        b.iter(|| black_box(&quadric).evaluate(black_box(DVec3::new(0.1, 0.2, 0.3))));
    });
    group.bench_function("minimise in the cell", |b| {
        b.iter(|| black_box(quadric).minimise(black_box(DVec3::ZERO), Placement::Constrained));
    });
    group.finish();
}

/// From triangles to a mesh, and to a tenth of it.
fn meshes(c: &mut Criterion, surface: &Surface) {
    let mut group = c.benchmark_group("mesh");
    group.throughput(Throughput::Elements(surface.triangles.len() as u64));
    group.bench_function("weld", |b| {
        b.iter(|| weld::<Point, ByQuadric>(black_box(&surface.triangles)).degenerate);
    });
    let unit = unit_of(&surface.triangles);
    let limit = Limit { cost: f32::INFINITY, share: 0.1, faces: 0 };
    group.bench_function("collapse to a tenth by quadrics", |b| {
        b.iter_batched(|| mesh::<ByQuadric>(surface, unit), sweep(&limit), BatchSize::LargeInput);
    });
    group.bench_function("collapse to a tenth by volumes", |b| {
        b.iter_batched(|| mesh::<ByVolume>(surface, unit), sweep(&limit), BatchSize::LargeInput);
    });
    group.finish();
}

fn mesh<M: Metric>(surface: &Surface, unit: f32) -> Mesh<M> {
    let mut patch = weld::<Point, M>(&surface.triangles).into_patch();
    patch.unit = unit;
    Mesh::of_original(patch)
}

fn sweep<M: Metric>(limit: &Limit) -> impl Fn(Mesh<M>) -> Mesh<M> {
    move |mut mesh| {
        sweep_blocks(&mut mesh, limit);
        mesh
    }
}

/// Summing quadrics by cell, on one thread.
fn cells(c: &mut Criterion, surface: &Surface) {
    let workspace = workspace();
    let mut writer = RecordWriter::create(&workspace, "soup", None).expect("there is a disk");
    writer.extend(&surface.triangles).expect("there is a disk");
    let source = Source::stored(writer.finish().expect("there is a disk"));
    let grid = Grid::with_cells(&surface.bounds, 128).expect("a surface has an extent");
    let config = cluster::Config {
        grid,
        boundary_weight: cluster::BOUNDARY_WEIGHT,
        placement: Placement::Constrained,
        assembly_bytes: 1 << 30,
        quadrics: Quadrics::Drop,
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread starts");
    let mut group = c.benchmark_group("cluster");
    group.throughput(Throughput::Elements(surface.triangles.len() as u64));
    group.bench_function("sum by cell", |b| {
        let sum = || cluster::accumulate(&source, &config, &workspace, &Monitor::silent());
        b.iter(|| pool.install(sum).map(|sums| sums.triangles));
    });
    group.finish();
}

/// A triangle and its place.
#[derive(Clone, Copy, FromBytes, IntoBytes, Immutable, KnownLayout)]
#[repr(transparent)]
struct Item([u64; 5]);

impl Record for Item {
    const KIND: [u8; 4] = *b"BENK";
}

impl Keyed for Item {
    type Key = u64;

    fn key(&self) -> u64 {
        self.0[0]
    }
}

/// Sorting what fits in memory, as each bucket of what does not.
fn sorting(c: &mut Criterion) {
    let workspace = workspace();
    // Multiples of an odd number: no two are equal, and they come in no order.
    let place = |i: u64| i.wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let items: Vec<Item> = (0..TRIANGLES).map(|i| Item([place(i), i, 0, 0, 0])).collect();
    let (stage, memory_bytes) = (StageId::Sort, 4 * TRIANGLES * size_of::<Item>() as u64);
    let config = SortConfig { stage, memory_bytes, engine: Engine::Auto, step: None };
    let mut group = c.benchmark_group("sort");
    group.throughput(Throughput::Elements(TRIANGLES));
    group.bench_function("a bucket", |b| {
        b.iter(|| {
            let monitor = Monitor::silent();
            let mut sorter = Sorter::<Item>::new(&config, &workspace, &monitor);
            sorter.push(&items)?;
            sorter.finish_into(|sorted| {
                black_box(sorted);
                Ok(())
            })
        });
    });
    group.finish();
}

/// From bytes to positions and corners.
fn scans(c: &mut Criterion, surface: &Surface) {
    let mut group = c.benchmark_group("scan");
    group.throughput(Throughput::Elements(surface.triangles.len() as u64));
    for (name, format, bytes) in
        [("ply", Format::Ply, &surface.ply), ("stl", Format::Stl, &surface.stl)]
    {
        let options = ReadOptions {
            on_defect: OnDefect::Fail,
            origin: Origin::undecided(),
            size_bytes: Some(bytes.len() as u64),
        };
        let bytes: &'static [u8] = bytes.clone().leak();
        group.bench_function(name, |b| {
            let mut batch = Batch::default();
            b.iter(|| {
                let mut reader =
                    formats::open(Some(format), Box::new(Cursor::new(bytes)), &options)?;
                let mut records = 0;
                while reader.read_batch(&mut batch)? {
                    records += if batch.content == Content::Vertices { 0 } else { batch.count() };
                }
                Ok::<usize, formats::FormatError>(records)
            });
        });
    }
    group.finish();
}

fn workspace() -> Workspace {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let workspace = Workspace::create(folder).expect("there is a folder for it");
    workspace.with_budget(Budget::new(1 << 30))
}

fn kernels(c: &mut Criterion) {
    let surface = Surface::new();
    assert!(surface.triangles.iter().flat_map(|t| t.0).all(|p| Vec3::from_array(p.0).is_finite()));
    quadrics(c);
    meshes(c, &surface);
    cells(c, &surface);
    sorting(c);
    scans(c, &surface);
}

fn main() {
    let mut criterion = Criterion::default()
        .sample_size(20)
        .warm_up_time(Duration::from_secs(1))
        .measurement_time(Duration::from_secs(4))
        .configure_from_args();
    kernels(&mut criterion);
    criterion.final_summary();
}
