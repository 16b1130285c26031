//! Holds the house style where a machine can: layers, lengths, names, words, citations and links.
//!
//! It reads the repository as text and knows Rust only as far as it must: comments and literals
//! from code (`views`), paths and blocks (`layers`, `shape`). Each rule is a function on strings
//! that a unit test here can make fail, and one test that applies it to every file.

use std::{
    fs,
    path::{Path, PathBuf},
};

use views::Views;

mod documents;
mod layers;
mod shape;
mod views;
mod words;

/// Folders that hold Rust of ours.
const SOURCE_FOLDERS: &[&str] = &["src", "tests", "examples", "benches", "scripts", "fuzz"];

/// Folders whose contents are made, not written.
const MADE_FOLDERS: &[&str] = &["target", "corpus", "artifacts", "coverage", "node_modules"];

/// A Rust file of the repository.
struct SourceFile {
    /// From the repository's root, with `/`.
    path: String,
    text: String,
    views: Views,
}

/// The repository's root.
fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Every Rust file of ours, in a fixed order.
fn rust_files() -> Vec<SourceFile> {
    let mut paths = Vec::new();
    for folder in SOURCE_FOLDERS {
        collect(&root().join(folder), "rs", &mut paths);
    }
    let read = |path: PathBuf| {
        let text = fs::read_to_string(&path).unwrap();
        let views = Views::of(&text);
        SourceFile { path: relative(&path), text, views }
    };
    paths.into_iter().map(read).collect()
}

/// Every JavaScript file of ours: the viewer, and its tests.
fn script_files() -> Vec<(String, String)> {
    let mut paths = Vec::new();
    for folder in ["src/viewer", "tests/browser"] {
        collect(&root().join(folder), "js", &mut paths);
    }
    let read = |path: PathBuf| (relative(&path), fs::read_to_string(&path).unwrap());
    paths.into_iter().map(read).collect()
}

/// Adds the files below `folder` that end in `.extension`; a missing folder has none.
fn collect(folder: &Path, extension: &str, found: &mut Vec<PathBuf>) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    for path in paths {
        let name = path.file_name().unwrap().to_str().unwrap();
        if path.is_dir() {
            if !MADE_FOLDERS.contains(&name) {
                collect(&path, extension, found);
            }
        } else if path.extension().is_some_and(|found| found == extension) {
            found.push(path);
        }
    }
}

/// A path from the repository's root, with `/`.
fn relative(path: &Path) -> String {
    path.strip_prefix(root()).unwrap().to_str().unwrap().to_owned()
}

/// Fails the test with one fault a line.
fn expect_none(faults: &[String]) {
    assert!(faults.is_empty(), "\n{}\n", faults.join("\n"));
}

#[test]
fn the_walk_finds_this_file_and_the_library() {
    let paths: Vec<String> = rust_files().into_iter().map(|file| file.path).collect();
    for path in ["src/lib.rs", "tests/tidy.rs", "tests/tidy/views.rs"] {
        assert!(paths.iter().any(|found| found == path), "{path} is not among {paths:?}");
    }
}
