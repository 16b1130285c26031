//! The documents: citations have an entry, links lead somewhere, nothing is out of reach, and the
//! tour stays short enough to be read.

use std::{collections::BTreeSet, fs, path::PathBuf};

use super::{collect, expect_none, relative, root, rust_files};

/// The tour of the code is read in one sitting.
const ARCHITECTURE_LINES_MAX: usize = 250;

/// Where a reader starts: every document is linked from one of these.
const STARTS: &[&str] = &["README.md", "docs/ARCHITECTURE.md"];

/// Path from the root, and text, of README.md and everything in docs/.
fn documents() -> Vec<(String, String)> {
    let mut paths = vec![root().join("README.md")];
    collect(&root().join("docs"), "md", &mut paths);
    let read = |path: PathBuf| (relative(&path), fs::read_to_string(&path).unwrap());
    paths.into_iter().map(read).collect()
}

/// Keys of papers cited in `text`: `[LS01]`, `[WK03 §4.3]`, `[LT98, LT99]`.
fn cited_keys(text: &str) -> Vec<&str> {
    let brackets = text.split('[').skip(1).filter_map(|rest| Some(rest.split_once(']')?.0));
    brackets
        .filter(|inside| inside.split([' ', ',']).next().is_some_and(is_key))
        .flat_map(|inside| inside.split([' ', ',', ';']).filter(|word| is_key(word)))
        .collect()
}

/// Up to five letters, the first a capital, and the year: `Lin00`, `CKS98`.
fn is_key(word: &str) -> bool {
    let letters = word.trim_end_matches(|c: char| c.is_ascii_digit());
    word.len() == letters.len() + 2
        && (2..=5).contains(&letters.len())
        && letters.starts_with(|c: char| c.is_ascii_uppercase())
        && letters.chars().all(|c| c.is_ascii_alphabetic())
}

/// Keys that have an entry of their own: a heading `## [KEY] …`.
fn entries(papers: &str) -> BTreeSet<&str> {
    let headings =
        papers.lines().filter_map(|line| line.trim_start_matches('#').strip_prefix(" ["));
    headings.filter_map(|rest| Some(rest.split_once(']')?.0)).collect()
}

/// Files a document links to, from the root; links into the web and to headings left out.
fn linked_files(path: &str, text: &str) -> Vec<String> {
    let folder = path.rsplit_once('/').map_or("", |(folder, _)| folder);
    let targets = text.split("](").skip(1).filter_map(|rest| Some(rest.split_once(')')?.0));
    targets
        .filter_map(|target| target.split('#').next())
        .filter(|target| !target.is_empty() && !target.contains(':'))
        .map(|target| {
            let mut parts: Vec<&str> = folder.split('/').filter(|part| !part.is_empty()).collect();
            for part in target.split('/') {
                match part {
                    ".." => drop(parts.pop()),
                    "." | "" => {}
                    name => parts.push(name),
                }
            }
            parts.join("/")
        })
        .collect()
}

#[test]
fn every_cited_paper_has_an_entry() {
    let papers = fs::read_to_string(root().join("docs/PAPERS.md")).unwrap();
    let entries = entries(&papers);
    let mut faults = Vec::new();
    let sources = rust_files().into_iter().map(|file| (file.path, file.views.comments));
    for (path, text) in sources.filter(|(path, _)| path.starts_with("src/")).chain(documents()) {
        for key in cited_keys(&text) {
            if !entries.contains(key) {
                faults.push(format!("{path}: [{key}] has no heading in docs/PAPERS.md"));
            }
        }
    }
    expect_none(&faults);
}

#[test]
fn the_tour_can_be_read_in_one_sitting() {
    let tour = fs::read_to_string(root().join("docs/ARCHITECTURE.md")).unwrap();
    let lines = tour.lines().count();
    assert!(lines <= ARCHITECTURE_LINES_MAX, "docs/ARCHITECTURE.md has {lines} lines");
}

#[test]
fn every_document_is_linked_from_where_a_reader_starts() {
    let documents = documents();
    let linked: BTreeSet<String> = documents
        .iter()
        .filter(|(path, _)| STARTS.contains(&path.as_str()))
        .flat_map(|(path, text)| linked_files(path, text))
        .collect();
    let faults: Vec<String> = documents
        .iter()
        .filter(|(path, _)| !STARTS[..1].contains(&path.as_str()) && !linked.contains(path))
        .map(|(path, _)| format!("{path}: linked from none of {STARTS:?}"))
        .collect();
    expect_none(&faults);
}

#[test]
fn every_link_leads_to_a_file() {
    let mut faults = Vec::new();
    for (path, text) in documents() {
        for target in linked_files(&path, &text) {
            if !root().join(&target).exists() {
                faults.push(format!("{path}: there is no {target}"));
            }
        }
    }
    expect_none(&faults);
}

#[test]
fn nothing_in_the_documents_is_left_to_be_written() {
    let unfinished = ["TODO", "FIXME", "TBD"];
    let faults: Vec<String> = documents()
        .iter()
        .filter(|(_, text)| unfinished.iter().any(|word| text.contains(word)))
        .map(|(path, _)| format!("{path}: contains one of {unfinished:?}"))
        .collect();
    expect_none(&faults);
}

#[test]
fn citations_are_told_from_other_brackets() {
    let text =
        "[LS01 §3.2, Appendix] [`LS02`](x) [LT98, LT99] [u8; 16] [Lin00] [ABC] [MAX10]x[A0001]";
    assert_eq!(cited_keys(text), ["LS01", "LT98", "LT99", "Lin00", "MAX10"]);
    let papers = "# Papers\n## [LS01] Lindstrom\ntext [WK03]\n### [Lin00]\n";
    assert_eq!(entries(papers).into_iter().collect::<Vec<_>>(), ["LS01", "Lin00"]);
}

#[test]
fn links_are_resolved_from_their_document() {
    let text = "[a](FORMATS.md#soup) [b](../README.md) [c](https://example.org) [d](#here)";
    assert_eq!(linked_files("docs/X.md", text), ["docs/FORMATS.md", "README.md"]);
    assert_eq!(linked_files("README.md", "[a](./docs/X.md)"), ["docs/X.md"]);
}
