//! The layers of `src/`: a file names its own folder and strictly lower layers, a stage names no
//! other stage, and the command line sees the public API only.
//!
//! Links in comments are free to point anywhere: they do not make code depend on code.

use super::{SourceFile, Views, expect_none, rust_files, views::leading_word};

/// Folders and files of `src/` from the bottom up. Those of one layer do not name each other.
const LAYERS: &[&[&str]] = &[
    &["geometry", "progress"],
    &["error"],
    &["formats", "storage", "viewer"],
    &["soup", "external"],
    &["mesh"],
    &["stages"],
    &["pipeline"],
];

/// Folders of `stages/` that hold several stages. Anything else in `stages/` is a stage itself.
const ROOMS: &[&str] = &["convert", "simplify", "inspect"];

/// A module path from the crate's root: `[stages, simplify, cluster]`.
type ModulePath = Vec<String>;

/// Everything a file of `src/` names above itself.
fn layer_faults(path: &str, code: &str) -> Vec<String> {
    let own = module_path(path);
    let fault = |what: String| format!("{path}: {what}");
    let Some(first) = own.first() else { return Vec::new() };
    if first == "cli" || first == "main" {
        return command_line_faults(&own, code).into_iter().map(fault).collect();
    }
    let Some(own_rank) = rank(first) else {
        return vec![fault(format!("`{first}` is in no layer of tests/tidy/layers.rs"))];
    };
    let mut faults = Vec::new();
    for named in named_paths(&own, code) {
        let written = named.join("::");
        match named.first() {
            Some(top) if top == first => {
                if first == "stages" && !named.starts_with(&own) && stage(&named) != stage(&own) {
                    faults.push(fault(format!("a stage names `{written}`")));
                }
            }
            Some(top) => match rank(top) {
                None => faults.push(fault(format!("names `{written}`, which is in no layer"))),
                Some(rank) if rank >= own_rank => faults.push(fault(format!(
                    "`{first}` (layer {own_rank}) names `{written}` (layer {rank})"
                ))),
                Some(_) => {}
            },
            None => faults.push(fault("names the whole crate".to_owned())),
        }
    }
    faults
}

/// The binary has no module but `cli`: all else it can only name as `meshmill::`.
fn command_line_faults(own: &[String], code: &str) -> Vec<String> {
    let outside = |named: &ModulePath| !matches!(named.first(), Some(top) if top == "cli");
    let mut faults: Vec<String> = named_paths(own, code)
        .into_iter()
        .filter(outside)
        .map(|named| format!("names `crate::{}`, not the public API", named.join("::")))
        .collect();
    if code.contains("#[path") {
        faults.push("takes a module from another place".to_owned());
    }
    faults
}

/// Layer of a folder or file of `src/`. Items of `lib.rs` itself are re-exports of `error`.
fn rank(top: &str) -> Option<usize> {
    let top = if top.starts_with(char::is_uppercase) { "error" } else { top };
    LAYERS.iter().position(|layer| layer.contains(&top))
}

/// The part of a path inside `stages` that says which stage it is in.
fn stage(path: &[String]) -> &[String] {
    let depth = if path.get(1).is_some_and(|room| ROOMS.contains(&room.as_str())) { 3 } else { 2 };
    &path[..path.len().min(depth)]
}

/// `src/stages/simplify/cluster/mod.rs` → `[stages, simplify, cluster]`; `src/lib.rs` → `[]`.
fn module_path(path: &str) -> ModulePath {
    let inside = path.trim_start_matches("src/").trim_end_matches(".rs");
    let mut parts: ModulePath = inside.split('/').map(str::to_owned).collect();
    if parts.last().is_some_and(|last| last == "mod" || last == "lib") {
        parts.pop();
    }
    parts
}

/// Every path in `code` that starts with `crate`, `super` or `self`, from the crate's root.
/// Groups are taken apart; `super` is seen from the inline module it stands in.
fn named_paths(own: &[String], code: &str) -> Vec<ModulePath> {
    let mut named = Vec::new();
    // For every open brace the inline module it opens, if it does.
    let mut blocks: Vec<Option<String>> = Vec::new();
    let (mut before, mut last) = ("", "");
    let mut rest = code;
    while let Some(c) = rest.chars().next() {
        let word = leading_word(rest);
        if word.is_empty() {
            match c {
                '{' => blocks.push((before == "mod").then(|| last.to_owned())),
                '}' => drop(blocks.pop()),
                _ => {}
            }
            if !c.is_whitespace() {
                (before, last) = ("", if c == ':' { ":" } else { "" });
            }
            rest = &rest[c.len_utf8()..];
            continue;
        }
        let starts_path = ["crate", "super", "self"].contains(&word) && last != ":";
        if starts_path && rest[word.len()..].starts_with("::") {
            let from = || own.iter().chain(blocks.iter().flatten()).cloned().collect();
            let mut leaves = Vec::new();
            rest = path_tree(rest, &mut Vec::new(), &mut leaves);
            named.extend(leaves.into_iter().map(|leaf| resolve(from(), &leaf)));
            (before, last) = ("", "");
        } else {
            (before, last) = (last, word);
            rest = &rest[word.len()..];
        }
    }
    named
}

/// Reads `a::b::{c, d::e}` into its leaves, each after `prefix`, and returns what follows it.
fn path_tree<'a>(
    text: &'a str,
    prefix: &mut Vec<&'a str>,
    leaves: &mut Vec<ModulePath>,
) -> &'a str {
    let depth = prefix.len();
    let mut rest = text;
    loop {
        rest = rest.trim_start();
        if let Some(group) = rest.strip_prefix('{') {
            rest = group;
            loop {
                rest = path_tree(rest, prefix, leaves);
                // Past `as name` and `*`.
                let end = rest.find([',', '}']).unwrap_or(rest.len());
                let more = rest[end..].starts_with(',');
                rest = rest.get(end + 1..).unwrap_or("");
                if !more {
                    break;
                }
            }
            break;
        }
        let word = leading_word(rest);
        rest = &rest[word.len()..];
        if !word.is_empty() {
            prefix.push(word);
        }
        match rest.strip_prefix("::") {
            Some(next) if !word.is_empty() => rest = next,
            _ => {
                // An empty word is a glob, turbofish, or the end of a group.
                if prefix.len() > depth || !word.is_empty() || rest.starts_with('*') {
                    leaves.push(prefix.iter().map(|&part| part.to_owned()).collect());
                }
                break;
            }
        }
    }
    prefix.truncate(depth);
    rest
}

/// Where a path leads, seen from module `from`.
fn resolve(from: ModulePath, path: &[String]) -> ModulePath {
    let mut at = from;
    for part in path {
        match part.as_str() {
            "crate" => at.clear(),
            "super" => drop(at.pop()),
            "self" => {}
            name => at.push(name.to_owned()),
        }
    }
    at
}

#[test]
fn a_file_names_its_own_folder_and_lower_layers() {
    let in_library = |file: &SourceFile| file.path.starts_with("src/");
    let faults: Vec<String> = rust_files()
        .iter()
        .filter(|file| in_library(file))
        .flat_map(|file| layer_faults(&file.path, &file.views.code))
        .collect();
    expect_none(&faults);
}

#[test]
fn main_has_no_module_but_the_command_line() {
    let files = rust_files();
    let main = files.iter().find(|file| file.path == "src/main.rs").unwrap();
    let declared: Vec<&str> = main
        .views
        .code
        .lines()
        .filter_map(|line| line.trim().strip_prefix("mod ")?.strip_suffix(';'))
        .collect();
    assert!(declared.iter().all(|name| *name == "cli"), "{declared:?}");
}

/// The checker on a small file.
fn faults(path: &str, text: &str) -> usize {
    layer_faults(path, &Views::of(text).code).len()
}

#[test]
fn a_name_from_a_higher_or_equal_layer_is_a_fault() {
    assert_eq!(faults("src/geometry/grid.rs", "use crate::error::Result;"), 1);
    assert_eq!(faults("src/geometry/grid.rs", "fn f() -> crate::Result<()> {}"), 1);
    assert_eq!(faults("src/storage/record.rs", "use crate::formats::Batch;"), 1);
    assert_eq!(faults("src/external/sort.rs", "use crate::{error::Result, soup::Point};"), 1);
    assert_eq!(faults("src/soup/mesh.rs", "use super::super::external;"), 1);
    assert_eq!(faults("src/soup/mesh.rs", "use super::{Point, super::external::{sort, join}};"), 2);
    assert_eq!(faults("src/oddments.rs", ""), 1);
    assert_eq!(faults("src/soup/mesh.rs", "use crate::*;"), 1);
}

#[test]
fn lower_layers_the_own_folder_and_comments_are_free() {
    let text = "//! [`crate::pipeline`]\nuse super::Point;\nuse crate::{\n    error::{Error, Result},\n\
                \n    soup::{Vertex as V, *},\n};\nfn f() { crate::storage::g::<u8>() }";
    assert_eq!(faults("src/soup/mesh.rs", text), 0);
    assert_eq!(faults("src/error.rs", "use crate::progress::Cancelled;"), 0);
}

#[test]
fn super_inside_an_inline_module_is_the_file() {
    let text = "mod tests { use super::*; use super::super::progress::Meter; fn f() {} }\n";
    assert_eq!(faults("src/error.rs", text), 0);
    assert_eq!(faults("src/progress.rs", "mod tests { use super::super::error::Error; }"), 1);
    assert_eq!(faults("src/soup/mesh.rs", "mod tests { use super::super::super::stages; }"), 1);
}

#[test]
fn a_stage_names_no_other_stage() {
    let cluster = "src/stages/simplify/cluster/sums.rs";
    assert_eq!(faults(cluster, "use super::table::T; use crate::stages::simplify::cluster::U;"), 0);
    assert_eq!(faults(cluster, "use crate::stages::convert::import;"), 1);
    assert_eq!(faults(cluster, "use super::super::hybrid::Config;"), 1);
    assert_eq!(faults("src/stages/generate/field.rs", "use super::{Config, noise::Noise};"), 0);
    assert_eq!(faults("src/stages/generate/field.rs", "use super::super::inspect::info;"), 1);
    assert_eq!(faults("src/stages/simplify/mod.rs", "pub use self::cluster::Config;"), 0);
}

#[test]
fn the_command_line_sees_the_public_api_only() {
    assert_eq!(
        faults("src/cli/args.rs", "use meshmill::Error; use super::job; use crate::cli::x;"),
        0
    );
    assert_eq!(faults("src/cli/args.rs", "use crate::storage::Budget;"), 1);
    assert_eq!(faults("src/main.rs", "#[path = \"lib.rs\"] mod library;"), 1);
}
