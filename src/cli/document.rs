//! `meshmill document`: a page that shows a mesh; its flags and what they mean.

use std::{
    path::{Path, PathBuf},
    process::ExitCode,
};

use clap::{Args, ValueEnum};
use meshmill::{
    Error, Result,
    formats::Format,
    pipeline::{self, DataPlacement, DocumentReport, Job},
    stages::convert::export::Target,
    storage::{Overwrite, Workspace},
    viewer::Page,
};

use super::{
    args::{Convert, Inputs, Output, Run},
    commands::{Session, in_session, print, run_job},
    job::{self, Host},
    outcome,
    progressive::{self, Fineness},
};

/// Any mesh as a page to look at it: there at once, finer while it loads, turned with the mouse.
///
/// The page is one HTML file that needs nothing else, not even a network: send it, or open it from
/// the disk in any browser with WebGL2 (Chrome, Edge, Firefox and Safari since 2023). It holds the
/// viewer and the mesh, in base64: about five bytes a triangle. A mesh of more than --triangles is
/// simplified first, out of core; IN may also be a .pm that `progressive` has written.
///
/// With --external the mesh stays in a file beside the page, OUT.pm, for a web server: browsers do
/// not let pages from the disk read other files. Any static server will do; where a connection
/// breaks, the rest is asked for with a Range.
#[derive(Debug, Args)]
pub(super) struct Document {
    #[command(flatten)]
    inputs: Inputs,

    /// Page to write; `-` is standard output
    #[arg(short = 'o', long = "output", value_name = "OUT")]
    output: PathBuf,

    /// Replace OUT if it exists, and OUT.pm with --external
    #[arg(long)]
    force: bool,

    #[command(flatten)]
    fineness: Fineness,

    /// Title of the page [default: the name of IN]
    #[arg(long, value_name = "TEXT")]
    title: Option<String>,

    /// Text below the mesh [default: the title]; an empty one leaves the line out
    #[arg(long, value_name = "TEXT")]
    caption: Option<String>,

    /// The axis of the model that points up, with a minus where it points down: many scans have
    /// theirs along y
    #[arg(long, value_enum, default_value_t = Up::Y, allow_hyphen_values = true, hide_possible_values = true, value_name = "x|y|z|-x|-y|-z")]
    up: Up,

    /// Keep the mesh beside the page, as OUT.pm, for a web server
    #[arg(long)]
    external: bool,

    /// Say what would be done and what it needs, and do nothing
    #[arg(long)]
    dry_run: bool,

    #[command(flatten)]
    run: Run,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Up {
    /// The first coordinate
    X,
    /// The second coordinate
    Y,
    /// The third coordinate
    Z,
    /// Against the first
    #[value(name = "-x")]
    MinusX,
    /// Against the second
    #[value(name = "-y")]
    MinusY,
    /// Against the third
    #[value(name = "-z")]
    MinusZ,
}

/// `meshmill document`.
pub(super) fn document(args: &Document, host: &Host) -> ExitCode {
    in_session(&args.run.machine, |session| {
        let document = meaning(args, host)?;
        pipeline::check_document(&document)?;
        if is_progressive(&args.inputs) {
            if args.dry_run || args.run.report.is_some() {
                let text =
                    "a progressive mesh is put into its page as it is: there is no plan or report";
                return Err(Error::Request(text.to_owned()));
            }
            write(&document, args, session)?;
            return Ok(outcome::DONE);
        }
        let temp_dir = temp_dir(args, host);
        let workspace = Workspace::create(&temp_dir)?;
        let input = match document.placement {
            DataPlacement::Inside => workspace.path().join("page.pm"),
            DataPlacement::Beside => pipeline::path_beside(&document.target)?,
        };
        let document = pipeline::Document { input, ..document };
        let shown = convert(args, &args.output, &temp_dir);
        let made = convert(args, &document.input, &temp_dir);
        let job = progressive::meaning(&made, &args.fineness, host)?;
        // What it would go on from belongs to a mesh that is gone with the run.
        let job = Job { keeping: None, ..job };
        if run_job(job, &shown, session)?.is_some() {
            write(&document, args, session)?;
        }
        Ok(outcome::DONE)
    })
}

/// Whether the input is what a page holds already.
fn is_progressive(inputs: &Inputs) -> bool {
    let named = |path: &PathBuf| Format::from_path(path) == Some(Format::Progressive);
    inputs.paths.len() == 1 && inputs.input_format.is_none() && inputs.paths.iter().all(named)
}

/// Folder for the mesh on its way into the page.
fn temp_dir(args: &Document, host: &Host) -> PathBuf {
    let folder = args.output.parent().filter(|folder| *folder != Path::new(""));
    job::temp_dir(&args.run.machine, folder, host)
}

/// What `progressive` would have been told.
fn convert(args: &Document, output: &Path, temp_dir: &Path) -> Convert {
    let mut run = args.run.clone();
    run.machine.temp_dir = Some(temp_dir.to_owned());
    let format = Some(Format::Progressive);
    Convert {
        inputs: args.inputs.clone(),
        output: Output { path: output.to_owned(), format, force: args.force },
        dry_run: args.dry_run,
        resume: false,
        keep_temp: false,
        checkpoint_seconds: 0,
        run,
    }
}

/// Writes the page and says so.
fn write(document: &pipeline::Document, args: &Document, session: &Session) -> Result<()> {
    let report = pipeline::document(document, &session.monitor())?;
    let line = text(document, report)?;
    if document.target == Target::Stdout || args.run.machine.quiet {
        session.display.say(&line);
        return Ok(());
    }
    print(&format!("{line}\n"))
}

fn text(document: &pipeline::Document, report: DocumentReport) -> Result<String> {
    let page = document.target.path().display();
    let [page_bytes, mesh_bytes] = [report.page_bytes, report.mesh_bytes].map(bytesize::ByteSize);
    Ok(match document.placement {
        DataPlacement::Inside => format!("{page}: {page_bytes}, {mesh_bytes} of mesh"),
        DataPlacement::Beside => {
            let mesh = pipeline::path_beside(&document.target)?;
            format!("{page}: {page_bytes}, and {}: {mesh_bytes}", mesh.display())
        }
    })
}

/// What to write.
fn meaning(args: &Document, host: &Host) -> Result<pipeline::Document> {
    let input = args.inputs.paths.first().cloned().unwrap_or_default();
    let name = input.file_stem().unwrap_or_default().to_string_lossy();
    let name = if input == Path::new("-") { "mesh".into() } else { name };
    let title = args.title.clone().unwrap_or_else(|| name.clone().into_owned());
    let up = match args.up {
        Up::X => "x",
        Up::Y => "y",
        Up::Z => "z",
        Up::MinusX => "-x",
        Up::MinusY => "-y",
        Up::MinusZ => "-z",
    };
    let caption = args.caption.clone().unwrap_or_else(|| title.clone());
    Ok(pipeline::Document {
        input,
        target: target(args, host)?,
        page: Page { title, caption, up: Some(up) },
        placement: if args.external { DataPlacement::Beside } else { DataPlacement::Inside },
    })
}

fn target(args: &Document, host: &Host) -> Result<Target> {
    let path = &args.output;
    if path != Path::new("-") {
        let overwrite = if args.force { Overwrite::Replace } else { Overwrite::Refuse };
        return Ok(Target::File(path.clone(), overwrite));
    }
    if host.stdout_is_terminal {
        let text = "a page is not written to a terminal; redirect standard output";
        return Err(Error::Request(text.to_owned()));
    }
    Ok(Target::Stdout)
}

#[cfg(test)]
mod tests {
    use clap::Parser as _;

    use super::*;
    use crate::cli::args::{Cli, Command};

    fn document(line: &str) -> pipeline::Document {
        let host = Host {
            memory_bytes_available: 1 << 30,
            threads: 2,
            temp_dir: None,
            stdout_is_terminal: false,
        };
        match Cli::try_parse_from(line.split(' ')).expect("the line parses").command {
            Command::Document(args) => meaning(&args, &host).unwrap(),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_page_is_called_as_its_mesh_unless_it_is_told_otherwise() {
        let plain = document("meshmill document scans/igea.pm -o out/igea.html");
        let words = |page: &Page| (page.title.clone(), page.caption.clone(), page.up);
        assert_eq!(words(&plain.page), ("igea".to_owned(), "igea".to_owned(), Some("y")));
        assert_eq!(plain.placement, DataPlacement::Inside);
        let target = Target::File("out/igea.html".into(), Overwrite::Refuse);
        assert_eq!(plain.target, target);
        let line = "meshmill document a.pm -o - --title T --caption C --up -z";
        let told = document(line);
        assert_eq!(words(&told.page), ("T".to_owned(), "C".to_owned(), Some("-z")));
        assert_eq!(told.target, Target::Stdout);
    }

    #[test]
    fn a_mesh_beside_the_page_is_called_as_the_page() {
        let document = document("meshmill document a.pm -o b.html --external --force");
        assert_eq!(document.placement, DataPlacement::Beside);
        assert_eq!(pipeline::path_beside(&document.target).unwrap(), Path::new("b.pm"));
        assert!(pipeline::path_beside(&Target::Stdout).is_err());
    }
}
