//! How a command ends: its exit code, the words for an error, and the hint that goes with it.

use std::{error::Error as _, io, process::ExitCode};

use meshmill::{Error, error::Fault};

use super::display::Display;

/// Done.
pub(super) const DONE: u8 = 0;
/// Failed while working.
pub(super) const FAILED: u8 = 1;
/// Misuse.
pub(super) const MISUSE: u8 = 2;
/// The input is not what it says.
pub(super) const BAD_INPUT: u8 = 3;
/// Stopped short of the target, with `--strict`.
pub(super) const SHORT_OF_TARGET: u8 = 4;

/// Says why a command failed, and ends it.
pub(super) fn fail(error: &Error, signal: Option<i32>, display: &Display) -> ExitCode {
    display.close();
    let (error, kept) = match error {
        Error::Unfinished { error, workspace, size_bytes } => {
            (&**error, Some((workspace, bytesize::ByteSize(*size_bytes))))
        }
        error => (error, None),
    };
    let code = match (error, signal) {
        (Error::Cancelled(_), Some(signal)) => 128 + signal as u8,
        _ => code(error),
    };
    if !is_closed_pipe(error) {
        complain(&text(error));
    }
    if let Some((workspace, size)) = kept {
        let path = workspace.display();
        complain(&format!(
            "what is done is kept in {path} ({size}): the same command with --resume goes on from it"
        ));
    }
    ExitCode::from(code)
}

fn code(error: &Error) -> u8 {
    match error {
        Error::Input { .. } | Error::NothingLeft { .. } | Error::NotSorted { .. } => BAD_INPUT,
        Error::Io { source, verb: "read", .. } if source.kind() == io::ErrorKind::IsADirectory => {
            BAD_INPUT
        }
        Error::Request(_) => MISUSE,
        _ => FAILED,
    }
}

/// The error, its causes, and what to do next.
fn text(error: &Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(next) = cause {
        text = format!("{text}: {next}");
        cause = next.source();
    }
    match hint(error) {
        Some(hint) => format!("{text}\n  {hint}"),
        None => text,
    }
}

fn hint(error: &Error) -> Option<&'static str> {
    Some(match error {
        Error::Input { fault: Fault::NotFinite | Fault::IndexOutOfRange { .. }, .. } => {
            "leave single bad triangles out with --on-defect skip"
        }
        Error::Io { source, .. } if source.kind() == io::ErrorKind::StorageFull => {
            "name a folder with more room: --temp-dir for temporary files, -o for the output"
        }
        Error::Io { verb, .. } if verb.starts_with("create a temporary folder") => {
            "name a folder that can be written to with --temp-dir"
        }
        Error::Request(text) if text.ends_with(" exists") => "replace it with --force",
        Error::Resource { what, .. } if what.contains("temporary") => {
            "name a folder on a larger disk with --temp-dir, or allow more --memory"
        }
        Error::Resource { what, .. } if what.contains("job") => "allow more --memory",
        Error::Resource { what, .. } if what.contains("slab") => {
            "allow more --memory, or simplify with --method hybrid, which needs little for few triangles"
        }
        Error::Resource { what, .. } if what.contains("clustering leaves") => {
            "allow more --memory, or ask for fewer triangles; --method cluster always fits"
        }
        Error::Resource { what, .. } if what.contains("edge collapse") => {
            "allow more --memory, or ask for fewer triangles; --method cluster always fits"
        }
        Error::Resource { what, .. } if what.contains("picture") => {
            "allow more --memory, or ask for a smaller --size or fewer --samples"
        }
        Error::Resource { what, .. } if what.contains("progressive mesh") => {
            "allow more --memory, or fewer --triangles"
        }
        Error::Resource { what, .. } if what.contains("refined mesh") => {
            "allow more --memory, or ask for fewer triangles"
        }
        Error::Resource { what, .. } if what.contains("window") => "allow more --memory",
        Error::NotSorted { .. } => {
            "allow more --memory, so that more can wait, or sort it: meshmill sort --axis"
        }
        Error::FormatLimit { .. } => "choose a format without that limit: ply or soup",
        _ => return None,
    })
}

/// Whoever read our output has closed it: no news to anybody.
fn is_closed_pipe(error: &Error) -> bool {
    matches!(error, Error::Io { source, .. } if source.kind() == io::ErrorKind::BrokenPipe)
}

/// One line on standard error.
#[expect(clippy::print_stderr, reason = "this is where errors reach the person")]
fn complain(text: &str) {
    eprintln!("meshmill: {text}");
}
