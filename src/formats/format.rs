//! The formats we know, and how a file shows which one it is.

use std::path::Path;

/// A mesh file format.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Format {
    /// STL, binary or ASCII.
    Stl,
    /// PLY, ASCII or binary of either byte order.
    Ply,
    /// Wavefront OBJ.
    Obj,
    /// Object File Format; read only.
    Off,
    /// Our own triangle soup, docs/FORMATS.md.
    Soup,
    /// Our own progressive mesh, docs/FORMATS.md; it has readers and writers of its own.
    Progressive,
    /// glTF, binary; write only, of meshes that fit in memory.
    Glb,
}

impl Format {
    /// All of them.
    pub const ALL: [Self; 7] =
        [Self::Stl, Self::Ply, Self::Obj, Self::Off, Self::Soup, Self::Progressive, Self::Glb];

    /// Whether files of ours in this format have vertices, and faces that refer to them.
    #[must_use]
    pub fn is_indexed(self) -> bool {
        matches!(self, Self::Ply | Self::Obj | Self::Progressive | Self::Glb)
    }

    /// Name in messages and on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Stl => "stl",
            Self::Ply => "ply",
            Self::Obj => "obj",
            Self::Off => "off",
            Self::Soup => "soup",
            Self::Progressive => "pm",
            Self::Glb => "glb",
        }
    }

    /// The format a file name promises; `.gz` and `.zst` are looked through.
    #[must_use]
    pub fn from_path(path: &Path) -> Option<Self> {
        let mut path = path;
        let mut extension = path.extension()?.to_ascii_lowercase();
        if extension == "gz" || extension == "zst" {
            path = Path::new(path.file_stem()?);
            extension = path.extension()?.to_ascii_lowercase();
        }
        Self::ALL.into_iter().find(|format| extension.to_str() == Some(format.name()))
    }
}
