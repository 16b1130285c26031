//! Faces set aside until all vertices are known (OBJ, faces before vertices, standard input).

use crate::{
    error::Result,
    formats::Faces,
    storage::{RecordFile, RecordScanner, RecordWriter, Workspace},
};

/// Marks the last corner of a face; vertex indices stay below it.
const LAST_CORNER: u64 = 1 << 63;

/// Writes faces as one `u64` per corner, the last of each face marked.
pub struct FaceWriter {
    corners: RecordWriter<u64>,
    faces: u64,
    buffer: Vec<u64>,
}

/// Finished faces, in the order they were written.
#[derive(Clone, Debug)]
pub struct StoredFaces {
    corners: RecordFile<u64>,
    faces: u64,
}

/// A sequential read of [`StoredFaces`].
pub struct FaceScanner {
    corners: RecordScanner<u64>,
    /// Corners of a face that a batch cut in two.
    cut: Vec<u64>,
}

impl FaceWriter {
    /// Starts a file of faces.
    ///
    /// # Errors
    /// [`crate::Error::Io`] when the workspace does not take it.
    pub fn create(workspace: &Workspace) -> Result<Self> {
        let corners = RecordWriter::create(workspace, "faces", None)?;
        Ok(Self { corners, faces: 0, buffer: Vec::new() })
    }

    /// Appends faces.
    ///
    /// # Errors
    /// As [`Self::create`].
    pub fn write(&mut self, faces: &Faces) -> Result<()> {
        self.buffer.clear();
        for face in faces.iter() {
            self.buffer.extend_from_slice(face);
            if let Some(last) = self.buffer.last_mut() {
                *last |= LAST_CORNER;
            }
        }
        self.faces += faces.count() as u64;
        self.corners.extend(&self.buffer)
    }

    /// Completes the file.
    ///
    /// # Errors
    /// As [`Self::create`].
    pub fn finish(self) -> Result<StoredFaces> {
        Ok(StoredFaces { corners: self.corners.finish()?, faces: self.faces })
    }
}

impl StoredFaces {
    /// Number of faces.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.faces
    }

    /// Bytes on disk.
    #[must_use]
    pub fn size_bytes(&self) -> u64 {
        self.corners.size_bytes()
    }

    /// The file they are in.
    #[must_use]
    pub fn file(&self) -> &RecordFile<u64> {
        &self.corners
    }

    /// So many faces that were written to a file, see [`Self::file`].
    #[must_use]
    pub fn of_file(corners: RecordFile<u64>, faces: u64) -> Self {
        Self { corners, faces }
    }

    /// Starts reading from the first face.
    ///
    /// # Errors
    /// As [`RecordFile::scan`].
    pub fn scan(&self) -> Result<FaceScanner> {
        Ok(FaceScanner { corners: self.corners.scan()?, cut: Vec::new() })
    }
}

impl FaceScanner {
    /// Replaces `faces` by the next faces; `false` after the last.
    ///
    /// # Errors
    /// As [`RecordScanner::next_batch`].
    pub fn read(&mut self, faces: &mut Faces) -> Result<bool> {
        faces.clear();
        let Some(batch) = self.corners.next_batch()? else {
            debug_assert!(self.cut.is_empty(), "the last corner ends a face");
            return Ok(false);
        };
        for &corner in batch {
            self.cut.push(corner & !LAST_CORNER);
            if corner & LAST_CORNER != 0 {
                faces.push(&self.cut);
                self.cut.clear();
            }
        }
        Ok(true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_come_back_across_batch_boundaries() {
        let workspace = Workspace::for_test();
        let mut writer = FaceWriter::create(&workspace).unwrap();
        let mut faces = Faces::default();
        for face in 0..40_000 {
            faces.push(&(face..face + 3 + face % 3).collect::<Vec<u64>>());
        }
        writer.write(&faces).unwrap();
        let stored = writer.finish().unwrap();
        assert_eq!(stored.count(), 40_000);
        let (mut scanner, mut batch, mut back) =
            (stored.scan().unwrap(), Faces::default(), Faces::default());
        while scanner.read(&mut batch).unwrap() {
            batch.iter().for_each(|face| back.push(face));
        }
        assert!(back.iter().eq(faces.iter()));
    }
}
