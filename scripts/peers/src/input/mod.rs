//! Reading meshes: binary STL, PLY of any encoding, OBJ. Reads in large blocks, as
//! a good user of a peer would; repairs nothing, and cares about triangles only.

mod block;
mod obj;
mod ply;
mod ply_header;
pub mod stl;

use crate::Result;
use crate::mesh::{Mesh, Origin};
use std::fs::File;
use std::path::Path;

/// Reads a mesh, whose format the extension of its name tells.
///
/// # Errors
/// Names the file and what is wrong with it.
pub fn read(path: &Path, origin: Origin) -> Result<Mesh> {
    let read = || -> Result<Mesh> {
        let file = File::open(path)?;
        match extension(path).as_str() {
            "ply" => ply::read(file, origin)?.checked(),
            "stl" => {
                let positions = stl::read_corners(file)?;
                let triangles = (0..u32::try_from(positions.len() / 3)?)
                    .map(|t| [3 * t, 3 * t + 1, 3 * t + 2])
                    .collect();
                Mesh::from_narrow(positions, triangles, origin).checked()
            }
            "obj" => obj::read(file, origin)?.checked(),
            other => Err(format!("the extension {other:?} is none of ply, stl, obj").into()),
        }
    };
    read().map_err(|error| format!("{}: {error}", path.display()).into())
}

/// Returns the extension of a file name in lower case, empty if there is none.
#[must_use]
pub fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default()
}
