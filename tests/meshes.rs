//! Whole meshes in memory, read and written through the library's front doors, and the folder of
//! real and awkward files they come from.

use std::{
    env, fs,
    io::{self, BufRead, BufReader, Cursor, Write as _},
    path::{Path, PathBuf},
    sync::{Arc, Mutex},
};

use meshmill::{
    error::{InputFault, Position},
    formats::{
        self, Batch, Content, Counts, Declared, DefectKind, Findings, Format, FormatError,
        OnDefect, Origin, ReadOptions, WriteOptions,
    },
    geometry::triangulate,
};

/// The folder `meshes/NAME` of real and awkward files, or `None`, said aloud, where it is absent.
pub(crate) fn folder(name: &str) -> Option<PathBuf> {
    let path = env::var_os("MESHMILL_SHARED").map(|root| Path::new(&root).join("meshes"));
    if path.is_none() {
        let note = "skipped: set MESHMILL_SHARED to the folder that contains meshes/";
        writeln!(io::stderr(), "{note} ({name} is needed)").unwrap();
    }
    path.map(|path| path.join(name))
}

/// The names of the files in a folder, in order.
pub(crate) fn files_in(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap_or_else(|error| panic!("{folder:?}: {error}"));
    let name = |entry: io::Result<fs::DirEntry>| entry.unwrap().file_name().into_string().unwrap();
    let mut names: Vec<String> = entries.map(name).collect();
    names.sort();
    names
}

/// All that a reader gave.
#[derive(Clone, Debug)]
pub(crate) struct Whole {
    pub(crate) declared: Declared,
    pub(crate) findings: Findings,
    pub(crate) origin: Origin,
    /// Of vertices, or three per soup triangle.
    pub(crate) positions: Vec<[f32; 3]>,
    pub(crate) colors: Vec<[u8; 4]>,
    pub(crate) faces: Vec<Vec<u64>>,
}

/// How to read a file of this many bytes.
pub(crate) fn options(on_defect: OnDefect, size_bytes: Option<u64>) -> ReadOptions {
    ReadOptions { on_defect, origin: Origin::undecided(), size_bytes }
}

/// Reads a file as the command does: by the format its name promises, its size known.
pub(crate) fn read_file(path: &Path) -> Whole {
    let bytes = fs::read(path).unwrap();
    let options = options(OnDefect::Fail, Some(bytes.len() as u64));
    let input = Box::new(BufReader::new(Cursor::new(bytes)));
    read(input, Format::from_path(path), &options).unwrap_or_else(|fault| panic!("{fault:?}"))
}

/// Reads an input to its end.
pub(crate) fn read(
    input: Box<dyn BufRead + Send>,
    format: Option<Format>,
    options: &ReadOptions,
) -> Result<Whole, InputFault> {
    read_batches(input, format, options).map_err(|error| match error {
        FormatError::Input(fault) => fault,
        error => panic!("memory can be read: {error:?}"),
    })
}

fn read_batches(
    input: Box<dyn BufRead + Send>,
    format: Option<Format>,
    options: &ReadOptions,
) -> Result<Whole, FormatError> {
    let mut reader = formats::open(format, input, options)?;
    let (mut positions, mut colors, mut faces) = (Vec::new(), Vec::new(), Vec::new());
    let mut batch = Batch::default();
    while reader.read_batch(&mut batch)? {
        assert!(batch.count() > 0, "a batch has records");
        assert_eq!(batch.content == Content::Soup, !reader.declared().indexed);
        positions.extend_from_slice(&batch.positions);
        colors.extend_from_slice(&batch.colors);
        faces.extend(batch.faces.iter().map(<[u64]>::to_vec));
        assert!(colors.is_empty() || colors.len() == positions.len());
    }
    let (declared, findings) = (reader.declared().clone(), reader.findings().clone());
    Ok(Whole { declared, findings, origin: reader.origin(), positions, colors, faces })
}

impl Whole {
    /// Leaves out faces that refer to vertices that did not come, and counts them: what the reader
    /// of a format with forward references leaves to whoever resolves them.
    pub(crate) fn resolve(&mut self) {
        let (vertices, faces) = (self.positions.len() as u64, self.faces.len());
        self.faces.retain(|face| face.iter().all(|&index| index < vertices));
        let left_out = (faces - self.faces.len()) as u64;
        self.findings.add(DefectKind::IndexOutOfRange, left_out, Position::default());
    }

    /// The triangles that the faces fall into, as indices of vertices.
    pub(crate) fn triangles(&self) -> Vec<[u64; 3]> {
        let (mut polygon, mut split) = (Vec::new(), Vec::new());
        let mut triangles = Vec::new();
        for face in &self.faces {
            polygon.clear();
            polygon.extend(face.iter().map(|&index| self.positions[index as usize]));
            triangulate(&polygon, &mut split);
            let indices = |triangle: &[u32; 3]| triangle.map(|corner| face[corner as usize]);
            triangles.extend(split.iter().map(indices));
        }
        triangles
    }

    /// The positions in model units, as far as single precision has them.
    pub(crate) fn absolute(&self) -> Vec<[f32; 3]> {
        let origin = self.origin.get();
        let absolute = |position: &[f32; 3]| {
            // Nothing is added to what is absolute already: -0 + 0 would lose its sign.
            std::array::from_fn(|axis| match origin[axis] {
                0.0 => position[axis],
                origin => (f64::from(position[axis]) + origin) as f32,
            })
        };
        self.positions.iter().map(absolute).collect()
    }
}

/// Writes batches to memory, and mends the header where the writer asks for it.
pub(crate) fn write(
    format: Format,
    counts: Option<Counts>,
    options: &WriteOptions,
    batches: &[Batch],
) -> Vec<u8> {
    let output = Shared::default();
    let mut writer = formats::create(format, Box::new(output.clone()), counts, options).unwrap();
    for batch in batches {
        writer.write_batch(batch).unwrap();
    }
    let header = writer.finish().unwrap();
    let mut bytes = std::mem::take(&mut *output.0.lock().unwrap());
    if let Some(header) = header {
        bytes[..header.len()].copy_from_slice(&header);
    }
    bytes
}

/// An output that can be looked at after it was given away.
#[derive(Clone, Default)]
struct Shared(Arc<Mutex<Vec<u8>>>);

impl io::Write for Shared {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().unwrap().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Checks that two meshes reach as far as each other along the first two axes, to a fiftieth.
pub(crate) fn assert_as_wide(before: &[[f32; 3]], after: &[[f32; 3]]) {
    for axis in 0..2 {
        let extent = |positions: &[[f32; 3]]| {
            positions
                .iter()
                .fold((f32::MAX, f32::MIN), |(low, high), p| (low.min(p[axis]), high.max(p[axis])))
        };
        let (before, after) = (extent(before), extent(after));
        let size = before.1 - before.0;
        assert!((before.0 - after.0).abs() < 0.02 * size, "{before:?} {after:?}");
        assert!((before.1 - after.1).abs() < 0.02 * size, "{before:?} {after:?}");
    }
}
