//! A finished indexed mesh, in memory or in files, as simplification and welding leave it.

use super::Vertex;
use crate::{
    error::Result,
    formats::Counts,
    storage::{Record, RecordFile, RecordScanner},
};

/// Records in memory or in a finished file.
pub enum Column<R> {
    /// In memory.
    Memory(Vec<R>),
    /// On disk.
    File(RecordFile<R>),
}

/// A sequential read of a [`Column`].
pub enum ColumnScan<'a, R> {
    /// Chunks of a slice.
    Memory(std::slice::Chunks<'a, R>),
    /// Blocks of a file.
    File(RecordScanner<R>),
}

/// Records per batch from memory; about the batch size of a file of points.
const BATCH_RECORDS: usize = 1 << 14;

impl<R: Record> Column<R> {
    /// Number of records.
    #[must_use]
    pub fn count(&self) -> u64 {
        match self {
            Self::Memory(records) => records.len() as u64,
            Self::File(file) => file.count(),
        }
    }

    /// Starts a sequential read.
    ///
    /// # Errors
    /// As [`RecordFile::scan`].
    pub fn scan(&self) -> Result<ColumnScan<'_, R>> {
        Ok(match self {
            Self::Memory(records) => ColumnScan::Memory(records.chunks(BATCH_RECORDS)),
            Self::File(file) => ColumnScan::File(file.scan()?),
        })
    }

    /// All records; the memory is the caller's to reserve.
    ///
    /// # Errors
    /// As [`RecordFile::scan`].
    pub fn into_memory(self) -> Result<Vec<R>> {
        if let Self::Memory(records) = self {
            return Ok(records);
        }
        let mut records = Vec::with_capacity(self.count() as usize);
        let mut scan = self.scan()?;
        while let Some(batch) = scan.next_batch()? {
            records.extend_from_slice(batch);
        }
        Ok(records)
    }
}

impl<R: Record> ColumnScan<'_, R> {
    /// The next records, `None` after the last.
    ///
    /// # Errors
    /// As [`RecordScanner::next_batch`].
    pub fn next_batch(&mut self) -> Result<Option<&[R]>> {
        match self {
            Self::Memory(chunks) => Ok(chunks.next()),
            Self::File(scanner) => scanner.next_batch(),
        }
    }
}

/// Triangles as vertex indices: narrow while they are in memory, wide on disk.
pub enum Triangles {
    /// In memory; there are fewer than 2³² vertices.
    Memory(Vec<[u32; 3]>),
    /// On disk.
    File(RecordFile<[u64; 3]>),
}

impl Triangles {
    /// All of them, as they are in memory: there are fewer than 2³² vertices. The memory is the
    /// caller's to reserve.
    ///
    /// # Errors
    /// As [`RecordFile::scan`].
    pub fn into_memory(self) -> Result<Vec<[u32; 3]>> {
        match self {
            Self::Memory(faces) => Ok(faces),
            Self::File(file) => {
                let mut faces = Vec::with_capacity(file.count() as usize);
                let mut scan = file.scan()?;
                while let Some(batch) = scan.next_batch()? {
                    faces.extend(batch.iter().map(|face| face.map(|v| v as u32)));
                }
                Ok(faces)
            }
        }
    }
}

/// Vertices, and triangles that refer to them; every vertex is referred to.
pub struct IndexedMesh<V> {
    /// Vertices, by index.
    pub vertices: Column<V>,
    /// Triangles.
    pub triangles: Triangles,
}

impl<V: Vertex> IndexedMesh<V> {
    /// How many there are of both.
    #[must_use]
    pub fn counts(&self) -> Counts {
        let triangles = match &self.triangles {
            Triangles::Memory(triangles) => triangles.len() as u64,
            Triangles::File(file) => file.count(),
        };
        Counts { vertices: self.vertices.count(), triangles }
    }

    /// Bytes it takes in memory; files take none.
    #[must_use]
    pub fn memory_bytes(&self) -> u64 {
        let vertices = match &self.vertices {
            Column::Memory(vertices) => size_of_val(vertices.as_slice()),
            Column::File(_) => 0,
        };
        let triangles = match &self.triangles {
            Triangles::Memory(triangles) => size_of_val(triangles.as_slice()),
            Triangles::File(_) => 0,
        };
        (vertices + triangles) as u64
    }
}
