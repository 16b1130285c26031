//! The indexed triangle mesh all tools here work on.

use crate::Result;

/// A triangle mesh in memory. Every index is below `positions.len()`.
#[derive(Debug, Default, Clone)]
pub struct Mesh {
    /// Vertex positions, relative to `origin`.
    pub positions: Vec<[f32; 3]>,
    /// Three vertex indices a triangle.
    pub triangles: Vec<[u32; 3]>,
    /// What was subtracted from the coordinates of the file.
    pub origin: [f64; 3],
}

/// The point that becomes zero when a mesh is read. Coordinates in the millions
/// (surveys) do not fit `f32`; ordinary ones must not be touched at all.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Origin {
    /// Near the first vertex of a file with wide coordinates, else zero.
    Auto,
    /// The same as of another mesh, so that the two can be compared.
    At([f64; 3]),
}

/// Automatic origins are multiples of this, so that any mesh nearer to zero keeps
/// its coordinates bit for bit. Chosen by hand: at 1024 an `f32` still resolves 6e-5.
const ORIGIN_STEP: f64 = 1024.0;

impl Origin {
    /// Returns the origin for a file that starts with the vertex `first`.
    #[must_use]
    pub fn resolve(self, first: Option<&[f64; 3]>) -> [f64; 3] {
        match self {
            Self::At(origin) => origin,
            Self::Auto => first.map_or([0.0; 3], |point| {
                // Adding zero turns the -0 of small negative coordinates into 0.
                point.map(|x| (x / ORIGIN_STEP).trunc() * ORIGIN_STEP + 0.0)
            }),
        }
    }
}

impl Mesh {
    /// Builds a mesh from wide coordinates.
    #[must_use]
    pub fn from_wide(points: &[[f64; 3]], triangles: Vec<[u32; 3]>, origin: Origin) -> Self {
        let origin = origin.resolve(points.first());
        let positions = points.iter().map(|p| narrow(*p, origin)).collect();
        Self { positions, triangles, origin }
    }

    /// Builds a mesh from `f32` coordinates, which are left alone unless the origin
    /// was given by another mesh and is not zero.
    #[must_use]
    pub fn from_narrow(
        mut positions: Vec<[f32; 3]>,
        triangles: Vec<[u32; 3]>,
        origin: Origin,
    ) -> Self {
        let origin = origin.resolve(None);
        if origin != [0.0; 3] {
            for p in &mut positions {
                *p = narrow(p.map(f64::from), origin);
            }
        }
        Self { positions, triangles, origin }
    }

    /// Returns the mesh if every index is in range and every coordinate finite.
    ///
    /// # Errors
    /// Names the first offending triangle or vertex.
    pub fn checked(self) -> Result<Self> {
        let count = self.positions.len();
        if u32::try_from(count).is_err() {
            return Err(format!("{count} vertices do not fit 32-bit indices").into());
        }
        let bad = |t: &[u32; 3]| t.iter().any(|&v| v as usize >= count);
        if let Some(i) = self.triangles.iter().position(bad) {
            return Err(format!("triangle {i} uses a vertex beyond {count}").into());
        }
        let wild = |p: &[f32; 3]| !p.iter().all(|x| x.is_finite());
        if let Some(i) = self.positions.iter().position(wild) {
            return Err(format!("vertex {i} is not finite").into());
        }
        Ok(self)
    }

    /// Returns the corner positions of a triangle.
    #[must_use]
    pub fn corners(&self, triangle: [u32; 3]) -> [[f32; 3]; 3] {
        triangle.map(|v| self.positions[v as usize])
    }
}

fn narrow(point: [f64; 3], origin: [f64; 3]) -> [f32; 3] {
    std::array::from_fn(|k| (point[k] - origin[k]) as f32)
}
