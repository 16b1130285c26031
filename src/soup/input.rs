//! A user's input: opened, and opened again for a second pass.

use std::{
    fmt,
    io::{self, BufRead, BufReader},
    path::{Path, PathBuf},
};

use crate::{
    error::Result,
    formats::{
        self, Batch, Declared, Findings, Format, FormatError, MeshReader, OnDefect, Origin,
        ReadOptions,
    },
    storage::{IO_BLOCK_BYTES, open_input},
};

/// Where an input comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum InputPath {
    /// A file, which can be read again.
    File(PathBuf),
    /// Standard input, which cannot.
    Stdin,
}

impl InputPath {
    /// The path errors name.
    #[must_use]
    pub fn as_path(&self) -> &Path {
        match self {
            Self::File(path) => path,
            Self::Stdin => Path::new("-"),
        }
    }
}

impl fmt::Display for InputPath {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.as_path().display().fmt(f)
    }
}

/// One input of a job.
#[derive(Clone, Debug)]
pub struct Input {
    /// Where it is.
    pub path: InputPath,
    /// Its format; recognised by name or content when `None`.
    pub format: Option<Format>,
    /// Policy for bad records.
    pub on_defect: OnDefect,
    /// Origin of the mesh; what an earlier input decided holds for all.
    pub origin: Origin,
}

/// An input with its reader.
pub struct OpenInput {
    /// The input.
    pub input: Input,
    /// Its parser, before the first batch.
    pub reader: Box<dyn MeshReader>,
    /// Bytes on disk, for progress and plans; `None` for standard input.
    pub size_bytes: Option<u64>,
}

impl Input {
    /// Opens the input and reads its header.
    ///
    /// # Errors
    /// [`crate::Error::Io`] when it cannot be opened, [`crate::Error::Input`] when its header is
    /// not of its format.
    pub fn open(&self) -> Result<OpenInput> {
        let (stream, size_bytes): (Box<dyn BufRead + Send>, _) = match &self.path {
            InputPath::Stdin => {
                (Box::new(BufReader::with_capacity(IO_BLOCK_BYTES, io::stdin())), None)
            }
            InputPath::File(path) => {
                let file = open_input(path)?;
                // Pipes and devices have no size that means anything.
                let size = file.metadata().ok().filter(std::fs::Metadata::is_file);
                let size = size.map(|metadata| metadata.len());
                (Box::new(BufReader::with_capacity(IO_BLOCK_BYTES, file)), size)
            }
        };
        let options = ReadOptions { on_defect: self.on_defect, origin: self.origin, size_bytes };
        let format = self.format.or_else(|| Format::from_path(self.path.as_path()));
        let reader = formats::open(format, stream, &options)
            .map_err(|error| error.in_file(self.path.as_path()))?;
        Ok(OpenInput { input: self.clone(), reader, size_bytes })
    }

    /// Bytes on disk; `None` of what is no file.
    #[must_use]
    pub fn size_bytes(&self) -> Option<u64> {
        let InputPath::File(path) = &self.path else { return None };
        path.metadata().ok().filter(std::fs::Metadata::is_file).map(|metadata| metadata.len())
    }

    /// Whether [`Self::open`] can be called again.
    #[must_use]
    pub fn is_repeatable(&self) -> bool {
        Self::is_repeatable_path(&self.path)
    }

    /// Whether an input that is there can be read again.
    #[must_use]
    pub fn is_repeatable_path(path: &InputPath) -> bool {
        matches!(path, InputPath::File(path) if path.is_file())
    }
}

impl OpenInput {
    /// An input that cannot be read again, all of which a run before this one has set aside.
    #[must_use]
    pub fn set_aside(input: Input, declared: Declared) -> Self {
        let reader = Box::new(SetAside { declared, findings: Findings::default() });
        Self { input, reader, size_bytes: None }
    }
}

/// Says what the input said, and has nothing more to read.
struct SetAside {
    declared: Declared,
    findings: Findings,
}

impl MeshReader for SetAside {
    fn format(&self) -> Format {
        Format::Soup
    }

    fn declared(&self) -> &Declared {
        &self.declared
    }

    fn read_batch(&mut self, _: &mut Batch) -> Result<bool, FormatError> {
        Ok(false)
    }

    fn findings(&self) -> &Findings {
        &self.findings
    }

    fn origin(&self) -> Origin {
        Origin::undecided()
    }

    fn bytes_read(&self) -> u64 {
        0
    }
}
