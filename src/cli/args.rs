//! What was typed. What it means is in `job.rs`.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use meshmill::{formats::Format, pipeline::MaxError};

use super::{
    bound::Keep,
    display::Style,
    document::Document,
    progressive::Progressive,
    refine::Refine,
    render::{ComparePicture, Render},
    values,
};

/// Simplifies and converts triangle meshes far larger than memory.
///
/// Inputs are STL, PLY, OBJ, OFF or meshmill's own soup, plain or compressed with gzip or zstd;
/// several inputs are one mesh. `-` is standard input or output.
#[derive(Debug, Parser)]
#[command(name = "meshmill", version, max_term_width = 100, after_help = EXAMPLES)]
pub(super) struct Cli {
    #[command(subcommand)]
    pub(super) command: Command,
}

const EXAMPLES: &str = "\
Examples:
  meshmill simplify scan.ply -o small.ply --ratio 1% --memory 4GiB
  meshmill simplify scan.stl -o small.ply -t 500k
  meshmill simplify scan.ply -o close.ply --max-error 0.05%
  meshmill generate gyroid --triangles 1G -o - --output-format soup |
    meshmill simplify - --input-format soup --assume-sorted z --ratio 1% -o small.stl
  meshmill progressive scan.ply -o scan.pm
  meshmill refine scan.pm -o scan.glb -t 100k
  meshmill soup scan.ply -o scan.stl
  meshmill sort scan.stl -o sorted.soup --memory 4GiB
  meshmill weld scan.stl -o scan.ply
  meshmill info scan.ply --json
  meshmill compare scan.ply small.ply --memory 1GiB
  meshmill render scan.ply -o scan.png --view iso
  meshmill document scan.ply -o scan.html
  meshmill generate gyroid --triangles 10M -o test.ply

Exit codes: 0 done, 1 failed while working, 2 misuse, 3 the input is not what it says,
4 stopped short of the target (with --strict), 130/143 interrupted.";

#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// Fewer triangles: to a count, a ratio, an error or a cell size
    Simplify(Simplify),
    /// Any mesh to a progressive one (.pm): coarse at first, refined while it loads
    Progressive(Progressive),
    /// A progressive mesh (.pm), whole or cut, to a mesh of any count or error
    Refine(Refine),
    /// Indexed mesh to triangle soup (.stl or .soup), triangle order kept
    Soup(Convert),
    /// Any mesh to triangle soup (.stl or .soup) sorted along an axis
    Sort(Sort),
    /// Soup to indexed mesh (.ply or .obj): equal positions become one vertex
    Weld(Convert),
    /// Counts, bounds, order and defects, in one pass; with --topology edges and components, too
    Info(Info),
    /// How far two meshes are from each other, both ways
    Compare(Compare),
    /// A picture of any mesh, drawn as it streams by
    Render(Render),
    /// Any mesh as a page to look at it: an HTML file that works offline
    Document(Document),
    /// A synthetic surface of any size, streamed
    Generate(Generate),
}

#[derive(Debug, Args)]
pub(super) struct Simplify {
    #[command(flatten)]
    pub(super) convert: Convert,

    #[command(flatten)]
    pub(super) goal: Goal,

    /// How; see each below
    #[arg(long, value_enum, default_value_t = Method::Auto)]
    pub(super) method: Method,

    /// Edge collapses: what decides which edges go, and where their ends meet; see each below
    #[arg(long, value_enum, default_value_t = Metric::Quadric)]
    pub(super) metric: Metric,

    #[command(flatten)]
    pub(super) choosing: Choosing,

    #[command(flatten)]
    pub(super) keep: Keep,

    /// Clustering: weight of edges against faces in placing a vertex, 0 to 1; 0 lets boundaries
    /// shrink
    #[arg(long, value_name = "W", value_parser = values::share, default_value = "0.5")]
    pub(super) boundary_weight: f64,

    /// Clustering: where a vertex may lie
    #[arg(long, value_enum, default_value_t = Placement::Constrained)]
    pub(super) placement: Placement,

    /// Measure how far the result is from the input, both ways, as `compare` does, and say it in
    /// the report; reads both some eight times more
    #[arg(long)]
    pub(super) measure: bool,

    /// Samples on each surface for --measure
    #[arg(long, value_name = "N", value_parser = values::count, default_value = "1M", requires = "measure")]
    pub(super) samples: u64,

    /// Exit with 4 when the wanted count is not met
    #[arg(long)]
    pub(super) strict: bool,
}

/// How far to simplify: one of them, or an error bound together with a count or a ratio.
#[derive(Debug, Args)]
#[group(required = true, multiple = true)]
pub(super) struct Goal {
    /// Share of the triangles to keep: 0.01 or 1%
    #[arg(long, value_name = "R", value_parser = values::ratio, conflicts_with_all = ["target_faces", "cells", "cell_size"])]
    pub(super) ratio: Option<f64>,

    /// Triangles to keep: 500k, 2M; clustering meets them within 25 %
    #[arg(short, long, value_name = "N", value_parser = values::count, conflicts_with_all = ["cells", "cell_size"])]
    pub(super) target_faces: Option<u64>,

    /// Cubic cells, N along the longest side of the bounding box
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=2_097_152), conflicts_with = "cell_size")]
    pub(super) cells: Option<u32>,

    /// Cubic cells with this edge, in model units
    #[arg(long, value_name = "L", value_parser = values::length)]
    pub(super) cell_size: Option<f64>,

    /// As few triangles as leave every vertex of the input within this of the result: 0.2 in model
    /// units, or 0.05% of the diagonal of the bounding box. With -t or --ratio: whichever comes first
    #[arg(long, value_name = "E", value_parser = values::max_error, conflicts_with_all = ["cells", "cell_size"])]
    pub(super) max_error: Option<MaxError>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Method {
    /// Bounded with --max-error, clustering where the goal is in cells; otherwise stream if --memory holds what that
    /// needs, else hybrid
    Auto,
    /// Edge collapses: exact counts, the best fidelity, topology kept
    Stream,
    /// Vertex clustering: fastest, in the least memory, counts within 25 %
    Cluster,
    /// Clustering to a few times the goal, then edge collapses: exact counts in memory for a few
    /// times the result
    Hybrid,
    /// Edge collapses within an error: what --max-error means. With -t or --ratio alone the error is
    /// raised until the count is met, with all of the mesh in memory
    Bounded,
}

/// How decimation chooses edges.
#[derive(Debug, Args)]
pub(super) struct Choosing {
    /// Decimation: how the edges to collapse are chosen; see each below
    #[arg(long, value_enum)]
    pub(super) selection: Option<Selection>,

    /// Multiple choice: candidates for each decision; more are slower and more faithful
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024), default_value = "8")]
    pub(super) choices: u32,

    /// Multiple choice: which random candidates; the same seed gives the same bytes
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(super) seed: u64,

    /// The input is sorted along this axis, or nearly, as most programs write surfaces and `sort`
    /// does: read it once, without the disk, on a pipe too, with --ratio. By multiple choice in any
    /// memory; by threshold (say so) if the result fits. A triangle too late ends the run with exit
    /// code 3
    #[arg(long, value_enum, value_name = "AXIS")]
    pub(super) assume_sorted: Option<SortedAxis>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Selection {
    /// Every edge below an error that rises, the same for all of the mesh: the default; on all
    /// threads, faster and more faithful
    Threshold,
    /// The best of a few random ones: one pass, in a window of --memory that triangles come into
    /// and leave
    MultipleChoice,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum SortedAxis {
    /// The first coordinate
    X,
    /// The second coordinate
    Y,
    /// The third coordinate
    Z,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Metric {
    /// Distances from the planes of the original faces: the fastest, and it keeps edges sharp
    Quadric,
    /// The volume each collapse sweeps over, which it keeps: closer to smooth and scanned surfaces,
    /// at less than the speed
    Volume,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Placement {
    /// At the least error inside its cell
    Constrained,
    /// At the least error anywhere, moved to the nearest point of its cell
    Clamped,
    /// At the least error anywhere
    Free,
}

#[derive(Debug, Args)]
pub(super) struct Convert {
    #[command(flatten)]
    pub(super) inputs: Inputs,

    #[command(flatten)]
    pub(super) output: Output,

    /// Say what would be done and what it needs, and do nothing
    #[arg(long)]
    pub(super) dry_run: bool,

    /// Go on where a run of the same command died: from what it left in --temp-dir
    #[arg(long)]
    pub(super) resume: bool,

    /// Leave the temporary files when done
    #[arg(long)]
    pub(super) keep_temp: bool,

    /// Keep what is done at most so often, to go on from with --resume
    #[arg(long, value_name = "SECONDS", default_value = "60", hide = true)]
    pub(super) checkpoint_seconds: u32,

    #[command(flatten)]
    pub(super) run: Run,
}

/// Any mesh to triangle soup (.stl or .soup) sorted along an axis.
///
/// A sorted soup can be worked on as a stream: once it has swept past a vertex, no later triangle
/// uses that vertex, so a program needs to hold only the front of the sweep. Triangles are ordered
/// by their smallest vertex: by its coordinate along the axis, then by the two others. The same
/// triangles give the same file, whatever order they came in.
///
/// What fits in --memory is sorted there. Of larger inputs, those that are nearly in order (as most
/// programs write them, see `meshmill info`) are put in order in passing; only the others are sorted
/// on disk, in --temp-dir. --dry-run says what that could take.
#[derive(Debug, Args)]
pub(super) struct Sort {
    #[command(flatten)]
    pub(super) convert: Convert,

    /// The axis to sort along: the longest side of the bounding box, or one by name. For standard
    /// input name one: the longest side is known only at its end, so it would be set aside on disk
    #[arg(long, value_enum, default_value_t = Axis::Longest)]
    pub(super) axis: Axis,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Axis {
    /// That of the longest side of the bounding box
    Longest,
    /// The first coordinate
    X,
    /// The second coordinate
    Y,
    /// The third coordinate
    Z,
}

#[derive(Clone, Debug, Args)]
pub(super) struct Inputs {
    /// Meshes to read; `-` is standard input
    #[arg(required = true, value_name = "IN")]
    pub(super) paths: Vec<PathBuf>,

    /// Format of the inputs, instead of recognising it
    #[arg(long, value_name = "FORMAT", value_parser = input_format)]
    pub(super) input_format: Option<Format>,

    /// A bad vertex or face: stop, or leave it out and count it; truncated files always stop
    #[arg(long, value_enum, default_value_t = OnDefect::Fail)]
    pub(super) on_defect: OnDefect,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum OnDefect {
    /// Stop with exit code 3
    Fail,
    /// Leave it out, count it and say so
    Skip,
}

#[derive(Debug, Args)]
pub(super) struct Output {
    /// File to write; `-` is standard output; .gz and .zst compress
    #[arg(short = 'o', long = "output", value_name = "OUT")]
    pub(super) path: PathBuf,

    /// Format of the output, instead of by its name
    #[arg(long = "output-format", value_name = "FORMAT", value_parser = output_format)]
    pub(super) format: Option<Format>,

    /// Replace OUT if it exists
    #[arg(long)]
    pub(super) force: bool,
}

/// What every command that writes a mesh takes.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Running")]
pub(super) struct Run {
    #[command(flatten)]
    pub(super) machine: Machine,

    /// Write what was done as JSON
    #[arg(long, value_name = "FILE")]
    pub(super) report: Option<PathBuf>,

    /// Say more: the plan before the work
    #[arg(short, long, conflicts_with = "quiet")]
    pub(super) verbose: bool,
}

/// What every command that works takes: its share of the machine, and how it shows itself.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Running")]
pub(super) struct Machine {
    /// Memory to keep to [default: half of what is available]
    #[arg(long, value_name = "SIZE", value_parser = values::bytes)]
    pub(super) memory: Option<u64>,

    /// Threads [default: all]
    #[arg(short = 'j', long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(super) threads: Option<u16>,

    /// Folder for temporary files [default: $TMPDIR, or the output's folder, or /var/tmp where
    /// there is no output]
    #[arg(long, value_name = "DIR")]
    pub(super) temp_dir: Option<PathBuf>,

    /// How progress is shown, on standard error
    #[arg(long, value_enum, default_value_t = Style::Auto)]
    pub(super) progress: Style,

    /// Errors only
    #[arg(short, long)]
    pub(super) quiet: bool,
}

#[derive(Debug, Args)]
pub(super) struct Info {
    #[command(flatten)]
    pub(super) inputs: Inputs,

    /// Count boundary and non-manifold edges, components and more: two passes, and a sort where the
    /// triangles are in no order
    #[arg(long)]
    pub(super) topology: bool,

    /// Write JSON
    #[arg(long)]
    pub(super) json: bool,

    #[command(flatten)]
    pub(super) machine: Machine,
}

/// How far two meshes are from each other, both ways: maximum, root mean square, mean, and what
/// half, 95 % and 99 % of the area stay within, in model units and as shares of the diagonal of A.
///
/// Points are spread evenly over the area of each mesh, and for each the nearest point of the other
/// one is found. Where one mesh is the result of simplifying the other, A to B shows what was lost,
/// and B to A what was added. The maximum is over all vertices, too; everything else over the points
/// by area alone, so that it does not depend on how finely a part is cut into triangles.
///
/// Meshes may be far larger than --memory: the points wait in it, the triangles pass by, once for
/// as many points as fit. The numbers are the same for any --memory and number of threads. With
/// less memory there are more passes: each million points takes about 100 MiB.
///
/// Meshes whose boxes do not meet are measured, too, and a warning says so: they lie in different
/// places or are in different units.
#[derive(Debug, Args)]
pub(super) struct Compare {
    /// The mesh that lengths are relative to, mostly the original; `-` is standard input
    #[arg(value_name = "A")]
    pub(super) a: PathBuf,

    /// The mesh to compare with it; `-` is standard input, for one of the two
    #[arg(value_name = "B")]
    pub(super) b: PathBuf,

    /// Points on each mesh: 100k, 10M. The root mean square of a million is right to within a
    /// fraction of a per cent; the result says how far
    #[arg(long, value_name = "N", value_parser = values::count, default_value = "1M")]
    pub(super) samples: u64,

    /// Which points; the same seed gives the same numbers
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(super) seed: u64,

    /// Write JSON
    #[arg(long)]
    pub(super) json: bool,

    #[command(flatten)]
    pub(super) picture: ComparePicture,

    /// Format of both inputs, instead of recognising it
    #[arg(long, value_name = "FORMAT", value_parser = input_format)]
    pub(super) input_format: Option<Format>,

    /// A bad vertex or face: stop, or leave it out and count it; truncated files always stop
    #[arg(long, value_enum, default_value_t = OnDefect::Fail)]
    pub(super) on_defect: OnDefect,

    #[command(flatten)]
    pub(super) machine: Machine,
}

#[derive(Debug, Args)]
pub(super) struct Generate {
    /// The surface
    #[arg(value_enum)]
    pub(super) kind: Kind,

    /// Triangles wanted: 10M; closed surfaces come within a few per cent
    #[arg(long, value_name = "N", value_parser = values::count)]
    pub(super) triangles: u64,

    /// Height of the noise, 0 to 0.3, relative to the size of a feature
    #[arg(long, default_value_t = meshmill::stages::generate::NOISE_DEFAULT)]
    pub(super) noise: f64,

    /// Which noise
    #[arg(long, default_value_t = 0)]
    pub(super) seed: u64,

    #[command(flatten)]
    pub(super) output: Output,

    #[command(flatten)]
    pub(super) run: Run,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Kind {
    /// A ball of gyroid: closed, of high genus
    Gyroid,
    /// A sphere: closed
    Sphere,
    /// A square of hills: with a boundary
    HeightField,
}

fn input_format(text: &str) -> Result<Format, String> {
    let formats = [Format::Stl, Format::Ply, Format::Obj, Format::Off, Format::Soup];
    named_format(text, &formats)
}

fn output_format(text: &str) -> Result<Format, String> {
    named_format(
        text,
        &[Format::Stl, Format::Ply, Format::Obj, Format::Soup, Format::Progressive, Format::Glb],
    )
}

fn named_format(text: &str, formats: &[Format]) -> Result<Format, String> {
    let names: Vec<&str> = formats.iter().map(|format| format.name()).collect();
    let found = formats.iter().find(|format| format.name().eq_ignore_ascii_case(text));
    found.copied().ok_or_else(|| format!("one of {}", names.join(", ")))
}
