//! The worst order there is: the triangles of a mesh in random order, and with
//! `--indexed` the vertices too. For measuring what order is worth.

use clap::Parser;
use meshmill_peers::mesh::{Mesh, Origin};
use meshmill_peers::random::Random;
use meshmill_peers::{Result, input, output};
use std::path::PathBuf;
use std::process::ExitCode;

/// Writes a mesh in random order.
#[derive(Parser)]
struct Arguments {
    /// PLY, binary STL or OBJ
    input: PathBuf,
    /// The binary STL file to write, PLY with --indexed
    output: PathBuf,
    /// Which order
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Keep the mesh indexed, with its vertices in random order too
    #[arg(long)]
    indexed: bool,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("shuffle: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> Result<()> {
    let wanted = if arguments.indexed { "ply" } else { "stl" };
    if input::extension(&arguments.output) != wanted {
        return Err(format!("the output must be a .{wanted} file").into());
    }
    let mesh = input::read(&arguments.input, Origin::At([0.0; 3]))?;
    let triangle_count = u32::try_from(mesh.triangles.len())?;
    let order = Random::new(arguments.seed, 0).permutation(triangle_count);
    let triangles = order.iter().map(|&t| mesh.triangles[t as usize]);
    if arguments.indexed {
        let triangles = triangles.collect();
        output::write_ply(
            &arguments.output,
            &with_shuffled_vertices(&mesh, triangles, arguments.seed)?,
        )?;
    } else {
        output::write_stl(&arguments.output, triangles.map(|t| mesh.corners(t)))?;
    }
    Ok(())
}

fn with_shuffled_vertices(mesh: &Mesh, mut triangles: Vec<[u32; 3]>, seed: u64) -> Result<Mesh> {
    let vertex_count = u32::try_from(mesh.positions.len())?;
    let old_to_new = Random::new(seed, 1).permutation(vertex_count);
    let mut positions = vec![[0.0; 3]; mesh.positions.len()];
    for (&new, &position) in old_to_new.iter().zip(&mesh.positions) {
        positions[new as usize] = position;
    }
    for corner in triangles.as_flattened_mut() {
        *corner = old_to_new[*corner as usize];
    }
    Ok(Mesh { positions, triangles, origin: mesh.origin })
}
