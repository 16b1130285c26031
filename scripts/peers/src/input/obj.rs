//! Wavefront OBJ: the positions and the faces, as fans. Continued lines, curves and
//! everything else are skipped.

use crate::Result;
use crate::mesh::{Mesh, Origin};
use std::io::Read;

/// Reads a mesh from text.
///
/// # Errors
/// Names the line that cannot be understood.
pub fn read(mut input: impl Read, origin: Origin) -> Result<Mesh> {
    let mut bytes = Vec::new();
    input.read_to_end(&mut bytes)?;
    let mut points: Vec<[f64; 3]> = Vec::new();
    let mut triangles = Vec::new();
    let mut polygon = Vec::new();
    for (number, line) in bytes.split(|&b| b == b'\n').enumerate() {
        // Names and comments may be in any encoding; the lines of interest are plain.
        let Ok(line) = std::str::from_utf8(line) else {
            continue;
        };
        let mut words = line.split_ascii_whitespace();
        let understood = match words.next() {
            Some("v") => point(words).map(|p| points.push(p)),
            Some("f") => {
                polygon.clear();
                words
                    .try_for_each(|word| corner(word, points.len()).map(|v| polygon.push(v)))
                    .map(|()| triangles.extend(fan(&polygon)))
            }
            _ => Some(()),
        };
        understood.ok_or_else(|| format!("line {}: {line:?} is not understood", number + 1))?;
    }
    Ok(Mesh::from_wide(&points, triangles, origin))
}

/// Cuts a polygon into triangles around its first corner.
pub fn fan(polygon: &[u32]) -> impl Iterator<Item = [u32; 3]> + '_ {
    polygon.windows(2).skip(1).map(|pair| [polygon[0], pair[0], pair[1]])
}

fn point<'a>(mut words: impl Iterator<Item = &'a str>) -> Option<[f64; 3]> {
    let mut next = || words.next()?.parse().ok();
    Some([next()?, next()?, next()?])
}

/// Parses the vertex of `v/vt/vn`: counted from 1, or backwards from the last one.
fn corner(word: &str, vertex_count: usize) -> Option<u32> {
    let number: i64 = word.split('/').next()?.parse().ok()?;
    let index = match number {
        0 => return None,
        1.. => number - 1,
        _ => number + i64::try_from(vertex_count).ok()?,
    };
    u32::try_from(index).ok()
}
