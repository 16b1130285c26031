//! The peer: what a competent user of meshoptimizer would write to simplify a file.
//! Reads everything into memory, welds loose triangles, simplifies, keeps the used
//! vertices, writes. Prints one line of JSON with the seconds of each step.

use clap::{Args, Parser, ValueEnum};
use meshmill_peers::mesh::{Mesh, Origin};
use meshmill_peers::{Result, input, output};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

/// Simplifies a mesh in memory with meshoptimizer.
#[derive(Parser)]
struct Arguments {
    /// A PLY or binary STL file
    input: PathBuf,
    /// The PLY file to write
    output: PathBuf,
    /// Vertex clustering (sloppy), edge collapse (simplify), or that with vertices moved to where
    /// the error is least (update)
    #[arg(long)]
    method: Method,
    #[command(flatten)]
    target: Target,
    /// Wait until the output is on the disk
    #[arg(long)]
    sync: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum Method {
    Sloppy,
    Simplify,
    Update,
}

#[derive(Args)]
#[group(required = true, multiple = false)]
struct Target {
    /// The fraction of triangles to keep
    #[arg(long)]
    target_ratio: Option<f64>,
    /// The number of triangles to keep
    #[arg(long)]
    target_faces: Option<usize>,
    /// As few triangles as the peer's own estimate of the error, in model units, allows
    #[arg(long)]
    target_error: Option<f32>,
}

impl Target {
    fn triangles(&self, of: usize) -> usize {
        let asked = match (self.target_ratio, self.target_faces) {
            (Some(ratio), _) => (of as f64 * ratio) as usize,
            (None, Some(faces)) => faces,
            (None, None) => 0,
        };
        asked.min(of)
    }

    /// The error allowed, and how it is meant. With a count to meet there is no limit to it, so that
    /// the count is what binds.
    fn error(&self) -> (f32, meshopt::SimplifyOptions) {
        match self.target_error {
            Some(error) => (error, meshopt::SimplifyOptions::ErrorAbsolute),
            None => (f32::MAX, meshopt::SimplifyOptions::None),
        }
    }
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("peer-meshopt: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> Result<()> {
    let mut clock = Clock(Instant::now());
    let (mesh, read_s, weld_s) = if input::extension(&arguments.input) == "stl" {
        let corners = read_stl(&arguments.input)?;
        let read_s = clock.lap();
        (weld(&corners), read_s, clock.lap())
    } else {
        let mesh = input::read(&arguments.input, Origin::At([0.0; 3]))?;
        (mesh, clock.lap(), 0.0)
    };
    let in_triangles = mesh.triangles.len();
    let target = arguments.target.triangles(in_triangles);
    let simplified = simplify(&mesh, arguments.method, target, arguments.target.error())?;
    let simplify_s = clock.lap();
    let file = output::write_ply(&arguments.output, &simplified)?;
    if arguments.sync {
        file.sync_all()?;
    }
    let write_s = clock.lap();
    let report = serde_json::json!({
        "read_s": read_s,
        "weld_s": weld_s,
        "simplify_s": simplify_s,
        "write_s": write_s,
        "in_triangles": in_triangles,
        "out_triangles": simplified.triangles.len(),
    });
    println!("{report}");
    Ok(())
}

fn read_stl(path: &Path) -> Result<Vec<[f32; 3]>> {
    let corners = File::open(path).map_err(Into::into).and_then(input::stl::read_corners);
    corners.map_err(|error| format!("{}: {error}", path.display()).into())
}

fn weld(corners: &[[f32; 3]]) -> Mesh {
    let (vertex_count, remap) = meshopt::generate_vertex_remap(corners, None);
    let positions = meshopt::remap_vertex_buffer(corners, vertex_count, &remap);
    // Without indices to map, the table is the index buffer.
    let triangles = bytemuck::cast_slice(&remap).to_vec();
    Mesh { positions, triangles, origin: [0.0; 3] }
}

fn simplify(
    mesh: &Mesh,
    method: Method,
    target: usize,
    (error, options): (f32, meshopt::SimplifyOptions),
) -> Result<Mesh> {
    let indices: &[u32] = bytemuck::cast_slice(&mesh.triangles);
    let vertices = meshopt::VertexDataAdapter::new(bytemuck::cast_slice(&mesh.positions), 12, 0)?;
    let mut indices = match method {
        Method::Sloppy => meshopt::simplify_sloppy(indices, &vertices, 3 * target, error, None),
        Method::Simplify => meshopt::simplify(indices, &vertices, 3 * target, error, options, None),
        Method::Update => return Ok(update(mesh, 3 * target, error, options)),
    };
    let positions = meshopt::optimize_vertex_fetch(&mut indices, &mesh.positions);
    let triangles = bytemuck::cast_slice(&indices).to_vec();
    Ok(Mesh { positions, triangles, origin: mesh.origin })
}

/// Collapses edges and moves the vertices that are left.
fn update(
    mesh: &Mesh,
    index_count: usize,
    error: f32,
    options: meshopt::SimplifyOptions,
) -> Mesh {
    let mut indices: Vec<u32> = bytemuck::cast_slice(&mesh.triangles).to_vec();
    let mut positions = mesh.positions.clone();
    let count = meshopt::simplify_with_update(
        &mut indices,
        &mut positions,
        &mut [],
        &[],
        0,
        None,
        index_count,
        error,
        options,
        None,
    );
    indices.truncate(count);
    let positions = meshopt::optimize_vertex_fetch(&mut indices, &positions);
    Mesh { positions, triangles: bytemuck::cast_slice(&indices).to_vec(), origin: mesh.origin }
}

/// Measures the seconds between laps.
struct Clock(Instant);

impl Clock {
    fn lap(&mut self) -> f64 {
        let now = Instant::now();
        let seconds = (now - self.0).as_secs_f64();
        self.0 = now;
        seconds
    }
}
