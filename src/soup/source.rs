//! Where a stage gets its triangles from: the users' inputs as they are, or files of ours.
//!
//! A source can be read in several passes and by several threads at once. It is how stages avoid
//! the intermediate soup file when the vertex table fits in memory: one pass less over the disk.

use std::{
    collections::VecDeque,
    path::Path,
    sync::{Mutex, PoisonError},
};

use super::{Input, Pass, StoredFaces, Triangle, Vertex, VertexTable, faces::FaceScanner, pass};
use crate::{
    error::Result,
    formats::{Batch, Content, Faces, Findings, MeshReader},
    progress::Amount,
    storage::RecordFile,
};

/// All triangles of a job's inputs, in input order.
pub struct Source<V> {
    /// One part per input.
    pub parts: Vec<Part<V>>,
    /// Findings in inputs that were read to their end before this source was made.
    pub findings: Findings,
}

/// The triangles of one input.
pub enum Part<V> {
    /// A user's soup, read anew in each pass.
    Soup(LiveReader),
    /// A soup of ours.
    Stored(RecordFile<Triangle<V>>),
    /// An indexed mesh, dereferenced as it is read.
    Indexed {
        /// Its vertices.
        vertices: VertexTable<V>,
        /// Its faces.
        faces: FaceList,
        /// Some vertices are NaN: faces that refer to them are dropped.
        has_bad_vertices: bool,
    },
}

/// The faces of an indexed mesh.
pub enum FaceList {
    /// Read from the user's input in each pass, past its vertices.
    Input(LiveReader),
    /// Set aside.
    Stored(StoredFaces),
}

/// A user's input that may already be open, with a batch read ahead.
pub struct LiveReader {
    /// For later passes.
    pub input: Input,
    /// For the first pass.
    open: Mutex<Option<ReadAhead>>,
    /// Records (faces or triangles), when the header says.
    pub records: Option<u64>,
}

/// A reader, and batches of faces or soup it has already returned.
pub(super) struct ReadAhead {
    pub(super) reader: Box<dyn MeshReader>,
    pub(super) batches: VecDeque<Batch>,
}

impl LiveReader {
    /// An input to be opened when a pass begins.
    #[must_use]
    pub fn closed(input: Input, records: Option<u64>) -> Self {
        Self { input, open: Mutex::new(None), records }
    }

    /// An input with its reader.
    #[must_use]
    pub fn opened(
        input: Input,
        reader: Box<dyn MeshReader>,
        ahead: Option<Batch>,
        records: Option<u64>,
    ) -> Self {
        let batches = ahead.into_iter().collect();
        Self { input, open: Mutex::new(Some(ReadAhead { reader, batches })), records }
    }

    /// The reader for one pass and the batches read ahead.
    pub(super) fn take(&self) -> Result<ReadAhead> {
        let open = self.open.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(open) = open {
            return Ok(open);
        }
        Ok(ReadAhead { reader: self.input.open()?.reader, batches: VecDeque::new() })
    }

    /// Gives back what [`Self::take`] gave, for the next pass.
    pub(super) fn put_back(&self, open: ReadAhead) {
        *self.open.lock().unwrap_or_else(PoisonError::into_inner) = Some(open);
    }
}

impl ReadAhead {
    /// The next batch of faces or soup; vertices on the way are passed over.
    pub(super) fn read(&mut self, path: &Path, batch: &mut Batch) -> Result<bool> {
        if let Some(ahead) = self.batches.pop_front() {
            *batch = ahead;
            return Ok(true);
        }
        while self.reader.read_batch(batch).map_err(|error| error.in_file(path))? {
            if batch.content != Content::Vertices {
                return Ok(true);
            }
        }
        Ok(false)
    }
}

impl FaceList {
    /// Shows the first faces, at least `faces_min` if there are so many; they are not used up.
    ///
    /// # Errors
    /// What reading and parsing can fail with.
    pub fn look_ahead(&self, faces_min: u64, mut look: impl FnMut(&Faces)) -> Result<()> {
        let mut seen = 0;
        let mut batch = Batch::default();
        let mut scan = self.scan()?;
        let mut batches = VecDeque::new();
        while seen < faces_min && scan.read(&mut batch)? {
            seen += batch.faces.count() as u64;
            look(&batch.faces);
            batches.push_back(std::mem::take(&mut batch));
        }
        if let (Self::Input(live), ScanFrom::Input(mut open, _)) = (self, scan.0) {
            batches.append(&mut open.batches);
            open.batches = batches;
            live.put_back(open);
        }
        Ok(())
    }

    /// Starts a sequential read of all faces.
    ///
    /// # Errors
    /// What opening the input or the file can fail with.
    pub fn scan(&self) -> Result<FaceScan<'_>> {
        Ok(match self {
            Self::Input(live) => FaceScan(ScanFrom::Input(live.take()?, live.input.path.as_path())),
            Self::Stored(faces) => FaceScan(ScanFrom::Stored(faces.scan()?)),
        })
    }
}

/// A sequential read of a [`FaceList`].
pub struct FaceScan<'a>(ScanFrom<'a>);

enum ScanFrom<'a> {
    Input(ReadAhead, &'a Path),
    Stored(FaceScanner),
}

impl FaceScan<'_> {
    /// Replaces the faces of `batch` by the next ones; `false` after the last.
    ///
    /// # Errors
    /// What reading and parsing can fail with.
    pub fn read(&mut self, batch: &mut Batch) -> Result<bool> {
        match &mut self.0 {
            ScanFrom::Input(open, path) => open.read(path, batch),
            ScanFrom::Stored(scanner) => {
                batch.reset(Content::Faces);
                scanner.read(&mut batch.faces)
            }
        }
    }

    /// What the reader found, complete after the last face.
    #[must_use]
    pub fn findings(&self) -> Findings {
        match &self.0 {
            ScanFrom::Input(open, _) => open.reader.findings().clone(),
            ScanFrom::Stored(_) => Findings::default(),
        }
    }
}

impl<V: Vertex> Source<V> {
    /// A source over soup files of ours.
    #[must_use]
    pub fn stored(file: RecordFile<Triangle<V>>) -> Self {
        Self { parts: vec![Part::Stored(file)], findings: Findings::default() }
    }

    /// Faces or triangles in all parts, when every part knows.
    #[must_use]
    pub fn records(&self) -> Option<u64> {
        self.parts.iter().map(Part::records).sum()
    }

    /// Triangles in all parts, when that is exact: of polygons it shows only once they are read.
    #[must_use]
    pub fn triangles(&self) -> Option<u64> {
        let is_soup = |part: &Part<V>| matches!(part, Part::Soup(_) | Part::Stored(_));
        self.records().filter(|_| self.parts.iter().all(is_soup))
    }

    /// What a pass has before it.
    #[must_use]
    pub fn amount(&self) -> Amount {
        Amount { records: self.records(), bytes: self.parts.iter().map(Part::bytes).sum() }
    }

    /// Parts that are soups of ours.
    #[must_use]
    pub fn parts_stored(&self) -> usize {
        self.parts.iter().filter(|part| matches!(part, Part::Stored(_))).count()
    }

    /// Starts a pass over all triangles.
    #[must_use]
    pub fn pass(&self) -> Pass<'_, V> {
        pass::start(self)
    }
}

impl<V: Vertex> Part<V> {
    /// Faces or triangles, when known.
    #[must_use]
    pub fn records(&self) -> Option<u64> {
        match self {
            Self::Soup(reader) | Self::Indexed { faces: FaceList::Input(reader), .. } => {
                reader.records
            }
            Self::Stored(file) => Some(file.count()),
            Self::Indexed { faces: FaceList::Stored(faces), .. } => Some(faces.count()),
        }
    }

    /// Bytes on disk that a pass reads, when known; vertices that are at hand are not among them.
    fn bytes(&self) -> Option<u64> {
        match self {
            Self::Soup(reader) | Self::Indexed { faces: FaceList::Input(reader), .. } => {
                reader.input.size_bytes()
            }
            Self::Stored(file) => Some(file.size_bytes()),
            Self::Indexed { faces: FaceList::Stored(faces), .. } => Some(faces.size_bytes()),
        }
    }
}
