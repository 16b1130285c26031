//! The judge: how far two meshes are apart, and how each hangs together. The same
//! measure for the product and all peers, and no code in common with any of them
//! but the table that tells equal positions.

use clap::Parser;
use meshmill_peers::bvh::Bvh;
use meshmill_peers::deviation::{self, Deviation};
use meshmill_peers::mesh::{Mesh, Origin};
use meshmill_peers::primitive::{Primitive, Segment, Triangle};
use meshmill_peers::topology::{self, Topology};
use meshmill_peers::{Result, input};
use serde_json::{Value, json};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

/// Measures the deviation of two meshes, both ways, by samples spread over each.
#[derive(Parser)]
struct Arguments {
    /// The original: PLY, binary STL or OBJ
    a: PathBuf,
    /// What was made of it
    b: PathBuf,
    /// Samples each way
    #[arg(long, default_value_t = 1_000_000)]
    samples: u64,
    /// Which samples
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Also measure between the boundary lines alone
    #[arg(long)]
    boundary: bool,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// A mesh made ready for questions.
struct Subject {
    topology: Topology,
    surface: Option<Bvh<Triangle>>,
    boundary: Option<Bvh<Segment>>,
}

/// The deviations of one pair of surfaces or boundaries; nothing where either is empty.
struct Pair {
    a_to_b: Option<Deviation>,
    b_to_a: Option<Deviation>,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("judge: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> Result<()> {
    let started = Instant::now();
    let mesh = input::read(&arguments.a, Origin::Auto)?;
    let origin = mesh.origin;
    let a = examine(mesh, arguments);
    let b = examine(input::read(&arguments.b, Origin::At(origin))?, arguments);
    let diagonal = a.surface.as_ref().map_or(0.0, Bvh::diagonal);
    let surface = compare(a.surface.as_ref(), b.surface.as_ref(), arguments);
    let boundary =
        arguments.boundary.then(|| compare(a.boundary.as_ref(), b.boundary.as_ref(), arguments));
    let mut report = json!({
        "a": topology_json(&a.topology),
        "b": topology_json(&b.topology),
        "diagonal": diagonal,
        "samples": arguments.samples,
        "seed": arguments.seed,
        "surface": pair_json(&surface, origin, diagonal),
    });
    if let Some(boundary) = boundary {
        report["boundary"] = pair_json(&boundary, origin, diagonal);
    }
    report["seconds"] = json!(started.elapsed().as_secs_f64());
    if arguments.json {
        println!("{report}");
    } else {
        print_text(&report);
    }
    Ok(())
}

fn examine(mesh: Mesh, arguments: &Arguments) -> Subject {
    let (topology, boundary) = topology::examine(&mesh);
    let triangles: Vec<Triangle> =
        mesh.triangles.iter().map(|&t| Triangle(mesh.corners(t))).collect();
    drop(mesh);
    let boundary = if arguments.boundary { Bvh::new(&boundary) } else { None };
    Subject { topology, surface: Bvh::new(&triangles), boundary }
}

fn compare<P: Primitive>(a: Option<&Bvh<P>>, b: Option<&Bvh<P>>, with: &Arguments) -> Pair {
    let (Some(a), Some(b)) = (a, b) else {
        return Pair { a_to_b: None, b_to_a: None };
    };
    Pair {
        a_to_b: deviation::measure(a, b, with.samples, with.seed),
        b_to_a: deviation::measure(b, a, with.samples, with.seed),
    }
}

fn topology_json(topology: &Topology) -> Value {
    json!({
        "triangles": topology.triangles,
        "vertices": topology.vertices,
        "boundary_edges": topology.boundary_edges,
        "non_manifold_edges": topology.non_manifold_edges,
        "components": topology.components,
        "degenerate_triangles": topology.degenerate_triangles,
    })
}

fn pair_json(pair: &Pair, origin: [f64; 3], diagonal: f64) -> Value {
    let symmetric = pair.a_to_b.zip(pair.b_to_a).map(|(there, back)| there.symmetric(back));
    let one = |deviation: Option<Deviation>| {
        deviation.map(|d| {
            let max_at: Vec<f64> = d.max_at.iter().zip(origin).map(|(x, o)| x + o).collect();
            json!({
                "rms": d.rms,
                "mean": d.mean,
                "max": d.max,
                "max_at": max_at,
                "rms_relative": d.rms / diagonal,
                "mean_relative": d.mean / diagonal,
                "max_relative": d.max / diagonal,
            })
        })
    };
    json!({
        "a_to_b": one(pair.a_to_b),
        "b_to_a": one(pair.b_to_a),
        "symmetric": one(symmetric),
    })
}

fn print_text(report: &Value) {
    println!("{:<22}{:>14}{:>14}", "", "A", "B");
    if let Some(counts) = report["a"].as_object() {
        for (name, count) in counts {
            let (name_shown, other) = (name.replace('_', " "), &report["b"][name]);
            // As strings: a JSON value takes no notice of a width.
            println!("{name_shown:<22}{:>14}{:>14}", count.to_string(), other.to_string());
        }
    }
    println!("diagonal of A: {:.6e}", report["diagonal"].as_f64().unwrap_or(0.0));
    for part in ["surface", "boundary"] {
        if report[part].is_null() {
            continue;
        }
        println!("\n{part:<11}{:>11}{:>11}{:>11}   relative to the diagonal", "rms", "mean", "max");
        for way in ["a_to_b", "b_to_a", "symmetric"] {
            print!("{way:<11}");
            for name in ["rms", "mean", "max", "rms_relative", "mean_relative", "max_relative"] {
                match report[part][way][name].as_f64() {
                    Some(figure) => print!("{figure:>11.3e}"),
                    None => print!("{:>11}", "-"),
                }
            }
            println!();
        }
    }
}
