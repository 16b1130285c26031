//! `meshmill document`: a page that shows a mesh; its flags and what they mean.

use std::{
    path::{Path, PathBuf},
    process::ExitCode,
};

use clap::{Args, ValueEnum};
use meshmill::{
    Error, Result,
    pipeline::{self, DataPlacement, DocumentReport},
    stages::convert::export::Target,
    storage::Overwrite,
    viewer::Page,
};

use super::{
    args::Machine,
    commands::{in_session, print},
    job::Host,
    outcome,
};

/// A page that shows a progressive mesh: at once, finer while it loads, and turned with the mouse.
///
/// The page is one HTML file that needs nothing else, not even a network: send it, or open it from
/// the disk in any browser with WebGL2 (Chrome, Edge, Firefox and Safari since 2023). It holds the
/// viewer, some 40 kB, and the mesh in base64, four thirds of its bytes.
///
/// With --external the mesh stays in a file beside the page, OUT.pm, for a web server: browsers do
/// not let pages from the disk read other files. Any static server will do; where a connection
/// breaks, the rest is asked for with a Range.
#[derive(Debug, Args)]
pub(super) struct Document {
    /// Progressive mesh to show
    #[arg(value_name = "IN")]
    input: PathBuf,

    /// Page to write; `-` is standard output
    #[arg(short = 'o', long = "output", value_name = "OUT")]
    output: PathBuf,

    /// Replace OUT if it exists
    #[arg(long)]
    force: bool,

    /// Title of the page [default: the name of IN]
    #[arg(long, value_name = "TEXT")]
    title: Option<String>,

    /// Text below the mesh [default: the title]; an empty one leaves the line out
    #[arg(long, value_name = "TEXT")]
    caption: Option<String>,

    /// The axis of the model that points up: many scans have theirs along y
    #[arg(long, value_enum, default_value_t = Up::Y)]
    up: Up,

    /// Keep the mesh beside the page, as OUT.pm, for a web server
    #[arg(long)]
    external: bool,

    #[command(flatten)]
    machine: Machine,
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

/// `meshmill document`.
pub(super) fn document(args: &Document, host: &Host) -> ExitCode {
    in_session(&args.machine, |session| {
        let document = meaning(args, host)?;
        let report = pipeline::document(&document, &session.monitor())?;
        let line = text(&document, report)?;
        if document.target == Target::Stdout || args.machine.quiet {
            session.display.say(&line);
        } else {
            print(&format!("{line}\n"))?;
        }
        Ok(outcome::DONE)
    })
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
    let name = args.input.file_stem().unwrap_or_default().to_string_lossy();
    let title = args.title.clone().unwrap_or_else(|| name.into_owned());
    let up = match args.up {
        Up::X => "x",
        Up::Y => "y",
        Up::Z => "z",
    };
    let caption = args.caption.clone().unwrap_or_else(|| title.clone());
    Ok(pipeline::Document {
        input: args.input.clone(),
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
        let line = "meshmill document a.pm -o - --title T --caption C --up z";
        let told = document(line);
        assert_eq!(words(&told.page), ("T".to_owned(), "C".to_owned(), Some("z")));
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
