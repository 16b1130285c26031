//! The output under way: a format writer over a compressor over a file or standard output.

use std::{
    io::{self, Write},
    path::{Path, PathBuf},
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use super::{Config, Target};
use crate::{
    error::{IoContext as _, Result},
    formats::{self, Batch, Compression, Counts, Encoder, Format, MeshWriter},
    storage::{OutputFile, Overwrite, Workspace, open_input},
};

/// An output that takes batches.
pub(super) struct Output {
    writer: Box<dyn MeshWriter>,
    pipe: SharedPipe,
    /// What errors name.
    path: PathBuf,
    /// The file in the workspace that stands in for an output whose header cannot be mended.
    staged: Option<PathBuf>,
}

/// What the format writer writes to; kept here to be finished.
#[derive(Clone)]
struct SharedPipe(Arc<Mutex<Option<Pipe>>>);

enum Pipe {
    File(Encoder<OutputFile>),
    Stdout(Encoder<io::Stdout>),
}

impl Output {
    /// Begins the output. Without `counts`, a format that begins with its count is written with a
    /// wrong one and mended at the end; where that cannot be done (a stream, compression), the
    /// whole output is made in the workspace first.
    pub(super) fn create(
        config: &Config,
        counts: Option<Counts>,
        workspace: &Workspace,
    ) -> Result<Self> {
        let stage = counts.is_none() && config.format != Format::Soup && !config.is_seekable();
        let path = config.target.path().to_owned();
        let staged = stage.then(|| workspace.path().join("staged-output"));
        let pipe = match &staged {
            Some(staged) => Pipe::file(staged, Overwrite::Replace, Compression::None)?,
            None => Pipe::open(config)?,
        };
        let pipe = SharedPipe(Arc::new(Mutex::new(Some(pipe))));
        let writer = formats::create(config.format, Box::new(pipe.clone()), counts, &config.write)
            .map_err(|error| error.in_file(&path))?;
        Ok(Self { writer, pipe, path, staged })
    }

    /// Appends a batch.
    pub(super) fn write(&mut self, batch: &Batch) -> Result<()> {
        self.writer.write_batch(batch).map_err(|error| error.in_file(&self.path))
    }

    /// Ends the stream and gives the output its name. Returns its size, 0 for a stream.
    pub(super) fn finish(mut self, config: &Config) -> Result<u64> {
        let header = self.writer.finish().map_err(|error| error.in_file(&self.path))?;
        drop(self.writer);
        let pipe = self.pipe.lock().take().expect("finished once");
        let Some(staged) = &self.staged else { return pipe.finish(header, &self.path) };
        pipe.finish(header, staged)?;
        let mut file = open_input(staged)?;
        let mut pipe = Pipe::open(config)?;
        io::copy(&mut file, &mut pipe).at("write", &self.path)?;
        std::fs::remove_file(staged).at("remove", staged)?;
        pipe.finish(None, &self.path)
    }
}

impl Pipe {
    fn open(config: &Config) -> Result<Self> {
        match &config.target {
            Target::File(path, overwrite) => Self::file(path, *overwrite, config.compression),
            Target::Stdout => {
                let encoder = Encoder::new(config.compression, io::stdout());
                Ok(Self::Stdout(encoder.at("write", Path::new("-"))?))
            }
        }
    }

    fn file(path: &Path, overwrite: Overwrite, compression: Compression) -> Result<Self> {
        let file = OutputFile::create(path, overwrite)?;
        Ok(Self::File(Encoder::new(compression, file).at("write", path)?))
    }

    fn finish(self, header: Option<Vec<u8>>, path: &Path) -> Result<u64> {
        match self {
            Self::File(encoder) => {
                let mut file = encoder.finish().at("write", path)?;
                header.map_or(Ok(()), |header| file.patch(&header))?;
                file.finish()
            }
            Self::Stdout(encoder) => {
                debug_assert!(header.is_none(), "staged instead");
                encoder.finish().at("write", path)?;
                Ok(0)
            }
        }
    }
}

impl Write for Pipe {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::File(encoder) => encoder.write(bytes),
            Self::Stdout(encoder) => encoder.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::File(encoder) => encoder.flush(),
            Self::Stdout(encoder) => encoder.flush(),
        }
    }
}

impl SharedPipe {
    fn lock(&self) -> MutexGuard<'_, Option<Pipe>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Write for SharedPipe {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.lock().as_mut().expect("not finished yet").write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.lock().as_mut().expect("not finished yet").flush()
    }
}
