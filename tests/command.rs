//! The command, run in a folder of its own, and small surfaces to feed it.

use std::{
    fs,
    io::Write as _,
    path::PathBuf,
    process::{Command, Output, Stdio},
    thread,
};

use meshmill::formats::{Batch, Content, Counts, Format, Precision, WriteOptions};
use tempfile::TempDir;

use crate::meshes;

/// A new folder, which goes with all its contents.
pub(crate) struct Folder(TempDir);

/// How a command ended.
#[derive(Debug)]
pub(crate) struct Ran {
    pub(crate) code: Option<i32>,
    pub(crate) stdout: Vec<u8>,
    pub(crate) stderr: String,
}

impl Folder {
    pub(crate) fn new() -> Self {
        Self(TempDir::with_prefix("meshmill-test-").unwrap())
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        fs::write(self.path(name), bytes).unwrap();
    }

    pub(crate) fn read(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    /// The names of everything in the folder, in order.
    pub(crate) fn names(&self) -> Vec<String> {
        meshes::files_in(self.0.path())
    }

    /// Writes the triangles of a binary STL in no order.
    pub(crate) fn scatter(&self, from: &str, to: &str) {
        let bytes = self.read(from);
        let (head, triangles) = bytes.split_at(84);
        let mut triangles = triangles.as_chunks::<50>().0.to_vec();
        Dice(5).shuffle(&mut triangles);
        self.write(to, [head, triangles.as_flattened()].concat());
    }

    /// The command, not yet started: the words of `line` are its arguments.
    pub(crate) fn command(&self, line: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_meshmill"));
        command.args(line.split_whitespace()).current_dir(self.0.path());
        command.env_remove("TMPDIR").stdin(Stdio::null());
        command
    }

    /// Runs the command to its end.
    pub(crate) fn run(&self, line: &str) -> Ran {
        self.command(line).output().unwrap().into()
    }

    /// Runs the command with `input` on its standard input.
    pub(crate) fn run_with(&self, line: &str, input: &[u8]) -> Ran {
        let mut command = self.command(line);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let mut stdin = child.stdin.take().unwrap();
        thread::scope(|scope| {
            // A command that has seen enough closes its end.
            scope.spawn(move || drop(stdin.write_all(input)));
            child.wait_with_output().unwrap().into()
        })
    }

    /// Runs the command, which must succeed, and returns what it wrote to standard output.
    pub(crate) fn done(&self, line: &str) -> Vec<u8> {
        let ran = self.run(line);
        assert_eq!(ran.code, Some(0), "{line}: {}", ran.stderr);
        ran.stdout
    }

    /// Runs the command, which must succeed, and returns its report.
    pub(crate) fn report(&self, line: &str) -> serde_json::Value {
        self.done(&format!("{line} --report report.json"));
        serde_json::from_slice(&self.read("report.json")).unwrap()
    }

    /// Runs the command, which must fail with `code` and leave nothing; returns what it said.
    pub(crate) fn fails(&self, line: &str, code: i32) -> String {
        let before = self.names();
        let ran = self.run(line);
        assert_eq!(ran.code, Some(code), "{line}: {}", ran.stderr);
        let is_said = ran.stderr.lines().any(|line| line.starts_with("meshmill: "));
        assert!(is_said || code == 2, "{line}: {}", ran.stderr);
        assert!(!ran.stderr.contains("panicked"), "{line}: {}", ran.stderr);
        assert_eq!(self.names(), before, "{line}: nothing is left");
        ran.stderr
    }
}

impl From<Output> for Ran {
    fn from(output: Output) -> Self {
        let stderr = String::from_utf8(output.stderr).unwrap();
        Self { code: output.status.code(), stdout: output.stdout, stderr }
    }
}

/// A small mesh.
#[derive(Clone, Debug, Default)]
pub(crate) struct Surface {
    pub(crate) vertices: Vec<[f32; 3]>,
    /// Empty, or one a vertex.
    pub(crate) colors: Vec<[u8; 4]>,
    pub(crate) triangles: Vec<[u64; 3]>,
}

/// Numbers without a pattern, the same in every run (Knuth's MMIX generator).
pub(crate) struct Dice(pub(crate) u64);

impl Dice {
    /// A number below `count`.
    pub(crate) fn below(&mut self, count: usize) -> usize {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % count
    }

    /// A number in 0..1.
    pub(crate) fn share(&mut self) -> f32 {
        self.below(1 << 24) as f32 / (1 << 24) as f32
    }

    /// Puts `items` in no order.
    pub(crate) fn shuffle<T>(&mut self, items: &mut [T]) {
        for last in (1..items.len()).rev() {
            items.swap(last, self.below(last + 1));
        }
    }
}

impl Surface {
    /// A square of hills with `side`² quads, each cut in two; with a boundary.
    pub(crate) fn hills(side: u64) -> Self {
        let step = |i: u64| i as f32 / side as f32;
        let vertex = |i: u64| {
            let (x, y) = (step(i % (side + 1)), step(i / (side + 1)));
            [x, y, 0.1 * (9.0 * x + 1.0).sin() * (7.0 * y).cos() + 0.02 * (40.0 * x * y).sin()]
        };
        let vertices = (0..(side + 1) * (side + 1)).map(vertex).collect();
        let quad = |i: u64| {
            let a = i / side * (side + 1) + i % side;
            [[a, a + 1, a + side + 2], [a, a + side + 2, a + side + 1]]
        };
        Self { vertices, colors: Vec::new(), triangles: (0..side * side).flat_map(quad).collect() }
    }

    /// Triangles of all sizes and directions in a unit cube, none connected.
    pub(crate) fn confetti(count: u64) -> Self {
        let mut dice = Dice(count);
        let mut vertices = Vec::new();
        for _ in 0..count {
            let centre: [f32; 3] = std::array::from_fn(|_| dice.share());
            let size = 0.3 * dice.share() * dice.share();
            let mut corner = || centre.map(|c| c + size * (dice.share() - 0.5));
            vertices.extend([corner(), corner(), corner()]);
        }
        Self {
            vertices,
            colors: Vec::new(),
            triangles: (0..count).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
        }
    }

    /// The same with a colour for each vertex, of its own.
    pub(crate) fn colored(mut self) -> Self {
        let mut dice = Dice(7);
        let color = |_: &_| std::array::from_fn(|_| dice.below(256) as u8);
        self.colors = self.vertices.iter().map(color).collect();
        self
    }

    /// The same triangles in no order.
    pub(crate) fn shuffled(mut self) -> Self {
        Dice(1).shuffle(&mut self.triangles);
        self
    }

    /// The triangles by position.
    pub(crate) fn corners(&self) -> Vec<[[f32; 3]; 3]> {
        let position = |index: u64| self.vertices[index as usize];
        self.triangles.iter().map(|triangle| triangle.map(position)).collect()
    }

    /// The mesh as a file.
    pub(crate) fn bytes(&self, format: Format) -> Vec<u8> {
        self.written(format, Precision::Single, [0.0; 3])
    }

    /// The mesh as a file, around `origin`.
    pub(crate) fn written(
        &self,
        format: Format,
        precision: Precision,
        origin: [f64; 3],
    ) -> Vec<u8> {
        let options = WriteOptions { precision, origin, colors: !self.colors.is_empty() };
        let mut counts = Counts { vertices: 0, triangles: self.triangles.len() as u64 };
        let mut batches = Vec::new();
        if matches!(format, Format::Ply | Format::Obj) {
            counts.vertices = self.vertices.len() as u64;
            let (positions, colors) = (self.vertices.clone(), self.colors.clone());
            batches.push(Batch { positions, colors, ..Batch::default() });
            let mut faces = Batch { content: Content::Faces, ..Batch::default() };
            self.triangles.iter().for_each(|triangle| faces.faces.push(triangle));
            batches.push(faces);
        } else {
            let corners = || self.triangles.iter().flatten().map(|index| *index as usize);
            let positions = corners().map(|index| self.vertices[index]).collect();
            let colors = corners().filter_map(|index| self.colors.get(index).copied()).collect();
            batches.push(Batch { content: Content::Soup, positions, colors, ..Batch::default() });
        }
        meshes::write(format, Some(counts), &options, &batches)
    }
}
