//! Writing meshes: binary little-endian PLY and binary STL, in large pieces.

use crate::Result;
use crate::mesh::Mesh;
use std::fs::File;
use std::io::Write;
use std::path::Path;

/// Bytes handed to the system at a time.
const PIECE_BYTES: usize = 1 << 20;

/// Writes an indexed mesh as binary little-endian PLY.
///
/// # Errors
/// Names the file and what the system says.
pub fn write_ply(path: &Path, mesh: &Mesh) -> Result<File> {
    named(path, || {
        let mut file = File::create(path)?;
        file.write_all(
            format!(
                "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\n\
                 property float y\nproperty float z\nelement face {}\n\
                 property list uchar int vertex_indices\nend_header\n",
                mesh.positions.len(),
                mesh.triangles.len()
            )
            .as_bytes(),
        )?;
        file.write_all(bytemuck::cast_slice(&mesh.positions))?;
        write_records(&mut file, mesh.triangles.iter(), |triangle, piece| {
            piece.push(3);
            piece.extend_from_slice(bytemuck::bytes_of(triangle));
        })?;
        Ok(file)
    })
}

/// Writes triangles as binary STL with normals of zero, in the order given.
///
/// # Errors
/// Names the file and what the system says.
pub fn write_stl(
    path: &Path,
    triangles: impl ExactSizeIterator<Item = [[f32; 3]; 3]>,
) -> Result<File> {
    named(path, || {
        let count = u32::try_from(triangles.len())?;
        let mut header = [b' '; 84];
        header[80..].copy_from_slice(&count.to_le_bytes());
        let mut file = File::create(path)?;
        file.write_all(&header)?;
        write_records(&mut file, triangles, |triangle, piece| {
            let mut record = [0; 50];
            record[12..48].copy_from_slice(bytemuck::bytes_of(&triangle));
            piece.extend_from_slice(&record);
        })?;
        Ok(file)
    })
}

fn write_records<T>(
    file: &mut File,
    records: impl Iterator<Item = T>,
    encode: impl Fn(T, &mut Vec<u8>),
) -> Result<()> {
    let mut piece = Vec::with_capacity(PIECE_BYTES + 64);
    for record in records {
        encode(record, &mut piece);
        if piece.len() >= PIECE_BYTES {
            file.write_all(&piece)?;
            piece.clear();
        }
    }
    Ok(file.write_all(&piece)?)
}

fn named<T>(path: &Path, write: impl FnOnce() -> Result<T>) -> Result<T> {
    write().map_err(|error| format!("{}: {error}", path.display()).into())
}
