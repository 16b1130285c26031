//! `meshmill render`: a picture of a mesh; its flags and what they mean.

use std::{
    path::{Path, PathBuf},
    process::ExitCode,
};

use clap::{Args, ValueEnum};
use meshmill::{
    Error, Result,
    pipeline::{self, Colors, RenderReport},
    stages::{
        convert::export::Target,
        inspect::render::{self as stage, Edges, Size},
    },
    storage::Overwrite,
};

use super::{
    args::{Inputs, Machine},
    commands::{Session, in_session, print},
    figures,
    job::{self, Host},
    outcome,
};

/// A picture of any mesh, drawn as it streams by.
///
/// No triangle is kept: a billion of them are drawn in the memory of the picture, 39 bytes a pixel
/// with the default --samples, and of the vertices of an indexed mesh. Soups are read twice, first
/// to see how large they are. The same mesh gives the same picture, whatever order its triangles
/// come in.
///
/// Fronts of surfaces are grey, backs are blue: what is blue on a closed surface lies behind a hole
/// or has its triangles the wrong way round. Vertex colours are shown where there are any.
#[derive(Debug, Args)]
pub(super) struct Render {
    #[command(flatten)]
    inputs: Inputs,

    /// Picture to write, as PNG; `-` is standard output
    #[arg(short = 'o', long = "output", value_name = "OUT")]
    output: PathBuf,

    /// Replace OUT if it exists
    #[arg(long)]
    force: bool,

    /// From where; several, with commas between, share the picture in one scale
    #[arg(long, value_enum, value_delimiter = ',', default_value = "iso")]
    view: Vec<View>,

    /// The axis of the model that points up: many scans have theirs along y
    #[arg(long, value_enum, default_value_t = Up::Z)]
    up: Up,

    /// Width and height of the picture in pixels
    #[arg(long, value_name = "WxH", value_parser = size, default_value = "1600x1200")]
    size: Size,

    /// Samples along each side of a pixel, 1 to 4: more are smoother, and take their square in
    /// memory
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=stage::SAMPLES_MAX as i64), default_value = "2")]
    samples: u8,

    /// Draw the edges of triangles, too: for meshes with triangles larger than a few pixels
    #[arg(long)]
    wireframe: bool,

    /// Show plain surfaces even where vertices have colours
    #[arg(long)]
    no_color: bool,

    #[command(flatten)]
    machine: Machine,
}

/// The picture of a comparison.
#[derive(Debug, Args)]
pub(super) struct ComparePicture {
    /// Draw A, B, and the distances from A to B as colours on A, side by side, as PNG
    #[arg(long, value_name = "FILE.png")]
    picture: Option<PathBuf>,

    /// Replace the picture if it exists
    #[arg(long, requires = "picture")]
    force: bool,

    /// From where the meshes are seen; one view
    #[arg(long, value_enum, default_value_t = View::Iso, requires = "picture")]
    view: View,

    /// The axis of the model that points up in the picture
    #[arg(long, value_enum, default_value_t = Up::Z, requires = "picture")]
    up: Up,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum View {
    /// Along y, to the right x (with z up)
    Front,
    /// From where x points
    Right,
    /// Against y
    Back,
    /// Along x
    Left,
    /// From above, the front towards the lower edge
    Top,
    /// From below
    Bottom,
    /// From the front, the right and above
    Iso,
    /// From behind, the left and above
    IsoBack,
    /// All of these in one picture
    All,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Up {
    /// The first coordinate
    X,
    /// The second coordinate
    Y,
    /// The third coordinate
    Z,
}

/// `meshmill render`.
pub(super) fn render(args: &Render, host: &Host) -> ExitCode {
    in_session(&args.machine, |session| {
        let report = pipeline::render(&job(args, host)?, &session.monitor())?;
        tell(args, &report, session)?;
        Ok(outcome::DONE)
    })
}

fn tell(args: &Render, report: &RenderReport, session: &Session) -> Result<()> {
    for defect in &report.defects {
        session.display.say(&figures::defect(defect));
    }
    let Size { width, height } = args.size;
    let triangles = figures::count(report.triangles);
    let line = format!("{}: {width}x{height}, {triangles} triangles", args.output.display());
    if args.output == Path::new("-") || args.machine.quiet {
        session.display.say(&line);
        return Ok(());
    }
    print(&format!("{line}\n"))
}

/// What to draw.
fn job(args: &Render, host: &Host) -> Result<pipeline::Render> {
    let target = target(args, host)?;
    let folder = match &target {
        Target::File(path, _) => path.parent().filter(|folder| *folder != Path::new("")),
        Target::Stdout => None,
    };
    Ok(pipeline::Render {
        inputs: job::input_paths(&args.inputs),
        input_format: args.inputs.input_format,
        on_defect: job::on_defect(args.inputs.on_defect),
        config: stage::Config {
            views: views(&args.view),
            up: args.up.meaning(),
            size: args.size,
            samples: usize::from(args.samples),
            edges: if args.wireframe { Edges::Drawn } else { Edges::Hidden },
        },
        colors: if args.no_color { Colors::Ignored } else { Colors::Shown },
        memory_bytes: job::memory_bytes(&args.machine, host),
        threads: job::threads(&args.machine, host),
        temp_dir: job::temp_dir(&args.machine, folder, host),
        target,
    })
}

fn target(args: &Render, host: &Host) -> Result<Target> {
    let path = &args.output;
    if path == Path::new("-") {
        if host.stdout_is_terminal {
            let text = "a picture is not written to a terminal; redirect standard output";
            return Err(Error::Request(text.to_owned()));
        }
        return Ok(Target::Stdout);
    }
    file(path, if args.force { Overwrite::Replace } else { Overwrite::Refuse })
}

/// A file for a picture.
fn file(path: &Path, overwrite: Overwrite) -> Result<Target> {
    let other = path.extension().filter(|extension| !extension.eq_ignore_ascii_case("png"));
    if let Some(extension) = other {
        let text = format!("pictures are written as png, not as {}", extension.display());
        return Err(Error::Request(text));
    }
    Ok(Target::File(path.to_owned(), overwrite))
}

impl ComparePicture {
    /// What is wanted, if a picture is.
    pub(super) fn meaning(&self) -> Result<Option<pipeline::ComparePicture>> {
        let Some(path) = &self.picture else { return Ok(None) };
        if path == Path::new("-") {
            let text = "the picture of a comparison is a file: its numbers go to standard output";
            return Err(Error::Request(text.to_owned()));
        }
        let &[view] = views(&[self.view]).as_slice() else {
            return Err(Error::Request("a comparison is seen from one side".to_owned()));
        };
        let target = file(path, if self.force { Overwrite::Replace } else { Overwrite::Refuse })?;
        Ok(Some(pipeline::ComparePicture { target, view, up: self.up.meaning() }))
    }
}

impl Up {
    fn meaning(self) -> stage::Up {
        match self {
            Self::X => stage::Up::X,
            Self::Y => stage::Up::Y,
            Self::Z => stage::Up::Z,
        }
    }
}

/// The views in the order they were asked for, all of them where that was asked.
fn views(views: &[View]) -> Vec<stage::View> {
    let mut wanted = Vec::new();
    for view in views {
        match view {
            View::Front => wanted.push(stage::View::Front),
            View::Right => wanted.push(stage::View::Right),
            View::Back => wanted.push(stage::View::Back),
            View::Left => wanted.push(stage::View::Left),
            View::Top => wanted.push(stage::View::Top),
            View::Bottom => wanted.push(stage::View::Bottom),
            View::Iso => wanted.push(stage::View::Iso),
            View::IsoBack => wanted.push(stage::View::IsoBack),
            View::All => wanted.extend(stage::View::ALL),
        }
    }
    wanted
}

/// Least and greatest pixels along a side. What memory and samples allow besides is found later.
const SIDE_MIN: usize = 16;
const SIDE_MAX: usize = stage::SIDE_SAMPLES_MAX;

/// Pixels: `1600x1200`.
fn size(text: &str) -> Result<Size, String> {
    let sides = text.split_once(['x', 'X']);
    let side = |text: &str| text.trim().parse().ok().filter(|n| (SIDE_MIN..=SIDE_MAX).contains(n));
    let size =
        sides.and_then(|(width, height)| Some(Size { width: side(width)?, height: side(height)? }));
    size.ok_or_else(|| {
        format!("a size is its width and height in pixels, {SIDE_MIN} to {SIDE_MAX}: 1600x1200")
    })
}

#[cfg(test)]
mod tests {
    use clap::Parser as _;

    use super::*;
    use crate::cli::args::{Cli, Command};

    fn job_of(line: &str) -> Result<pipeline::Render> {
        let words = ["meshmill", "render"].into_iter().chain(line.split(' '));
        let host = Host {
            memory_bytes_available: 8 << 30,
            threads: 6,
            temp_dir: None,
            stdout_is_terminal: true,
        };
        match Cli::try_parse_from(words).unwrap().command {
            Command::Render(args) => job(&args, &host),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_picture_is_plain_unless_asked_otherwise() {
        let job = job_of("a.ply -o out/a.png").unwrap();
        assert_eq!(job.target, Target::File("out/a.png".into(), Overwrite::Refuse));
        assert_eq!((job.memory_bytes, job.threads), (4 << 30, 6));
        assert_eq!(job.temp_dir, Path::new("out"));
        let stage::Config { views, up, size, samples, edges } = job.config;
        assert_eq!((views, up), (vec![stage::View::Iso], stage::Up::Z));
        assert_eq!((size, samples), (Size { width: 1600, height: 1200 }, 2));
        assert_eq!((edges, job.colors), (Edges::Hidden, Colors::Shown));
    }

    #[test]
    fn every_flag_is_understood() {
        let line = "a.ply -o b.PNG --force --view front,iso-back --up y --size 640X480 --samples 4 \
                    --wireframe --no-color";
        let job = job_of(line).unwrap();
        assert_eq!(job.target, Target::File("b.PNG".into(), Overwrite::Replace));
        let stage::Config { views, up, size, samples, edges } = job.config;
        assert_eq!(views, [stage::View::Front, stage::View::IsoBack]);
        assert_eq!((up, samples, edges), (stage::Up::Y, 4, Edges::Drawn));
        assert_eq!((size, job.colors), (Size { width: 640, height: 480 }, Colors::Ignored));
        assert_eq!(job_of("a.ply -o b.png --view all").unwrap().config.views, stage::View::ALL);
    }

    #[test]
    fn a_picture_is_a_png_and_not_for_terminals() {
        assert!(job_of("a.ply -o -").is_err());
        assert!(job_of("a.ply -o a.gif").is_err());
        assert!(job_of("a.ply -o picture").is_ok());
    }

    #[test]
    fn a_comparison_has_a_picture_from_one_side_if_it_is_asked_for() {
        let picture = |line: &str| {
            let words = ["meshmill", "compare"].into_iter().chain(line.split(' '));
            match Cli::try_parse_from(words).unwrap().command {
                Command::Compare(args) => args.picture.meaning(),
                other => panic!("{other:?}"),
            }
        };
        assert!(picture("a.ply b.ply").unwrap().is_none());
        let wanted = picture("a.ply b.ply --picture c.png --view top --up y").unwrap().unwrap();
        assert_eq!(wanted.target, Target::File("c.png".into(), Overwrite::Refuse));
        assert_eq!((wanted.view, wanted.up), (stage::View::Top, stage::Up::Y));
        for wrong in ["--picture -", "--picture c.gif", "--picture c.png --view all"] {
            assert!(picture(&format!("a.ply b.ply {wrong}")).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_size_is_two_numbers_within_reason() {
        assert_eq!(size("16x16384"), Ok(Size { width: 16, height: 16384 }));
        for wrong in ["", "100", "x", "100x", "15x100", "100x16385", "-5x100", "1e3x100"] {
            assert!(size(wrong).is_err(), "{wrong}");
        }
    }
}
