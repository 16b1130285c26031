//! A page that shows a mesh: a progressive mesh put into an HTML file with its viewer, or beside it.

use std::{
    fs::File,
    io::{self, BufWriter, Read, Take, Write},
    path::{Path, PathBuf},
};

use crate::{
    error::{Error, Fault, IoContext as _, Position, Result},
    formats::{FormatError, progressive::Reader},
    progress::{Meter, Monitor, StageId},
    stages::convert::export::Target,
    storage::{OutputFile, Overwrite, open_input},
    viewer::{self, Data, Page},
};

/// What to show, and where the page goes.
#[derive(Clone, Debug)]
pub struct Document {
    /// The progressive mesh.
    pub input: PathBuf,
    /// The page.
    pub target: Target,
    /// What it says.
    pub page: Page,
    /// Where the mesh will be.
    pub placement: DataPlacement,
}

/// Where the bytes of the mesh are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DataPlacement {
    /// In the page: one file that can be sent, four thirds of the bytes.
    Inside,
    /// In a `.pm` file beside the page, for a server.
    Beside,
}

/// What was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DocumentReport {
    /// Bytes of the page; 0 on standard output.
    pub page_bytes: u64,
    /// Bytes of the mesh.
    pub mesh_bytes: u64,
}

/// Writes the page of a progressive mesh and, if it is to lie beside the page, the mesh.
///
/// # Errors
/// [`Error::Input`] when the input is no progressive mesh, [`Error::Request`] when a name is taken
/// or is none for a page, [`Error::Io`], cancellation. Nothing is left under the page's name then.
pub fn document(document: &Document, monitor: &Monitor) -> Result<DocumentReport> {
    check_document(document)?;
    let Document { input, target, page, placement } = document;
    let mesh_bytes = check_mesh(input)?;
    let meter = monitor.meter(StageId::Document, Some(mesh_bytes));
    let file = open_input(input)?.take(mesh_bytes);
    let mut source = Source { file, path: input, meter, failure: None };
    let page_bytes = match placement {
        DataPlacement::Inside => write_file(target, &mut source, |source, out| {
            viewer::write(out, page, Data::Inside(source))
        })?,
        DataPlacement::Beside => {
            let name = write_beside(target, &mut source)?;
            write_file(target, &mut source, |_, out| viewer::write(out, page, Data::Beside(&name)))?
        }
    };
    source.meter.finish();
    Ok(DocumentReport { page_bytes, mesh_bytes })
}

/// Refuses a page that cannot be written, before any work is done for it.
///
/// # Errors
/// [`Error::Request`] when its name is taken or is none for a page, [`Error::Io`].
pub fn check_document(document: &Document) -> Result<()> {
    let Document { input, target, placement, .. } = document;
    if let Target::File(path, _) = target
        && is_same(path, input)
    {
        let text = format!("{} is the mesh and cannot be the page", path.display());
        return Err(Error::Request(text));
    }
    if *placement == DataPlacement::Beside {
        let (Target::File(_, overwrite), beside) = (target, path_beside(target)?) else {
            return Ok(());
        };
        if !is_same(&beside, input) {
            Target::File(beside, *overwrite).check()?;
        }
    }
    target.check()
}

/// Whether two names lead to one file.
fn is_same(a: &Path, b: &Path) -> bool {
    let place = |path: &Path| path.canonicalize().ok();
    place(a).is_some_and(|at| place(b) == Some(at))
}

/// Where the mesh beside a page is written.
///
/// # Errors
/// [`Error::Request`] when the page is not a file, or its name ends in `.pm` itself.
pub fn path_beside(target: &Target) -> Result<PathBuf> {
    let Target::File(path, _) = target else {
        let text = "a mesh cannot lie beside standard output; name a file".to_owned();
        return Err(Error::Request(text));
    };
    let beside = path.with_extension("pm");
    if beside == *path {
        let text = format!("{} is a page and cannot be called as the mesh is", path.display());
        return Err(Error::Request(text));
    }
    Ok(beside)
}

/// Copies the mesh to its place beside the page, unless it is there; returns its name.
fn write_beside(target: &Target, source: &mut Source<'_>) -> Result<String> {
    let path = path_beside(target)?;
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    if is_same(&path, source.path) {
        return Ok(name);
    }
    let overwrite = match target {
        Target::File(_, overwrite) => *overwrite,
        Target::Stdout => Overwrite::Refuse,
    };
    write_file(&Target::File(path, overwrite), source, |source, out| {
        io::copy(source, out).map(drop)
    })?;
    Ok(name)
}

/// Lets `write` fill a target; returns its size, 0 for a stream. A failure of the source is
/// reported as such.
fn write_file(
    target: &Target,
    source: &mut Source<'_>,
    write: impl FnOnce(&mut Source<'_>, &mut dyn Write) -> io::Result<()>,
) -> Result<u64> {
    let path = target.path();
    let (written, file) = match target {
        Target::File(path, overwrite) => {
            let mut file = BufWriter::new(OutputFile::create(path, *overwrite)?);
            let written = write(source, &mut file).and_then(|()| file.flush());
            (written, Some(file))
        }
        Target::Stdout => {
            let mut stdout = io::stdout().lock();
            (write(source, &mut stdout).and_then(|()| stdout.flush()), None)
        }
    };
    if let Some(failure) = source.failure.take() {
        return Err(failure);
    }
    written.at("write", path)?;
    let Some(file) = file else { return Ok(0) };
    let file = file.into_inner().map_err(io::IntoInnerError::into_error).at("write", path)?;
    file.finish()
}

/// The mesh on its way: counts its bytes, and keeps what went wrong with it, since those who copy
/// know only that something did.
struct Source<'a> {
    file: Take<File>,
    path: &'a Path,
    meter: Meter<'a>,
    failure: Option<Error>,
}

impl Source<'_> {
    fn read_metered(&mut self, buffer: &mut [u8]) -> Result<usize> {
        let read = self.file.read(buffer).at("read", self.path)?;
        if read == 0 && !buffer.is_empty() && self.file.limit() > 0 {
            let at = Position::byte(self.meter.done());
            let fault = Fault::Truncated { inside: "a progressive mesh" };
            return Err(Error::Input { path: self.path.to_owned(), at, fault });
        }
        self.meter.add(read as u64)?;
        Ok(read)
    }
}

impl Read for Source<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.read_metered(buffer).map_err(|failure| {
            let text = failure.to_string();
            self.failure = Some(failure);
            io::Error::other(text)
        })
    }
}

/// Refuses what is no whole progressive mesh, with every checksum in it; returns its size in bytes.
fn check_mesh(path: &Path) -> Result<u64> {
    let in_file = |error: FormatError| error.in_file(path);
    let mut reader = Reader::open(open_input(path)?).map_err(in_file)?;
    reader.read_base().map_err(in_file)?;
    while reader.next_batch().map_err(in_file)?.is_some() {}
    let read_bytes = reader.bytes_read();
    if reader.is_cut() {
        let (at, fault) = (Position::byte(read_bytes), Fault::Truncated { inside: "a batch" });
        return Err(in_file(FormatError::input(at, fault)));
    }
    Ok(read_bytes)
}
