//! The shape of files: how long they and their functions are, how they open, what they are called.

use super::{Views, expect_none, rust_files, script_files, views::leading_word};

/// A file that outgrows this has a seam in it that wants a name.
const FILE_LINES_MAX: usize = 500;

/// A function fits a screen.
const FUNCTION_LINES_MAX: usize = 70;

/// If a thing has no home, its name is wrong.
const HOMELESS_NAMES: &[&str] = &["util", "utils", "helper", "helpers", "common", "misc"];

/// A function as text.
#[derive(Debug, PartialEq)]
struct Function<'a> {
    name: &'a str,
    /// 1-based.
    first_line: usize,
    /// From the line of `fn` to that of the closing brace.
    lines: usize,
}

/// Every function in `code`, declarations of traits and nested ones included.
fn functions(code: &str) -> Vec<Function<'_>> {
    let mut found = Vec::new();
    let mut start = 0;
    while let Some(offset) = code[start..].find("fn ") {
        let keyword = start + offset;
        start = keyword + 3;
        let name = leading_word(&code[start..]);
        let ends_a_word = code[..keyword].ends_with(|c: char| c.is_alphanumeric() || c == '_');
        if ends_a_word || name.is_empty() {
            continue;
        }
        found.push(Function {
            name,
            first_line: 1 + code[..keyword].matches('\n').count(),
            lines: 1 + code[keyword..keyword + function_length(&code[keyword..])]
                .matches('\n')
                .count(),
        });
    }
    found
}

/// Bytes of the function `code` begins with: to the end of its body, or to the semicolon of a
/// function without one.
fn function_length(code: &str) -> usize {
    let mut depth = 0_i32;
    let mut in_body = false;
    for (index, c) in code.char_indices() {
        match c {
            '{' | '(' | '[' => depth += 1,
            '}' | ')' | ']' => depth -= 1,
            _ => {}
        }
        in_body |= c == '{' && depth == 1;
        if depth == 0 && (c == ';' || (c == '}' && in_body)) {
            return index;
        }
    }
    code.len()
}

/// Names without a home: of the file, of its folders, and of modules and functions in it.
fn homeless_names(path: &str, code: &str) -> Vec<String> {
    let parts = path.trim_end_matches(".rs").split('/').map(str::to_owned);
    let declared = ["mod ", "fn "]
        .into_iter()
        .flat_map(|keyword| code.split(keyword).skip(1).map(|rest| leading_word(rest).to_owned()));
    parts.chain(declared).filter(|name| HOMELESS_NAMES.contains(&name.as_str())).collect()
}

#[test]
fn a_file_has_at_most_500_lines() {
    let faults: Vec<String> = rust_files()
        .iter()
        .map(|file| (&file.path, file.text.lines().count()))
        .filter(|(_, lines)| *lines > FILE_LINES_MAX)
        .map(|(path, lines)| format!("{path}: {lines} lines"))
        .collect();
    expect_none(&faults);
}

#[test]
fn a_function_has_at_most_70_lines() {
    let mut faults = Vec::new();
    for file in rust_files() {
        for function in functions(&file.views.code) {
            let Function { name, first_line, lines } = function;
            if lines > FUNCTION_LINES_MAX {
                faults.push(format!("{}:{first_line}: `{name}` has {lines} lines", file.path));
            }
        }
    }
    expect_none(&faults);
}

#[test]
fn a_file_opens_with_what_it_is_for() {
    let faults: Vec<String> = rust_files()
        .iter()
        .filter(|file| !file.text.starts_with("//! "))
        .map(|file| format!("{}: does not begin with `//! `", file.path))
        .collect();
    expect_none(&faults);
}

#[test]
fn scripts_keep_to_the_same_length_and_say_what_they_are_for() {
    let files = script_files();
    assert!(files.iter().any(|(path, _)| path == "src/viewer/decode.js"), "the walk finds them");
    let faults: Vec<String> = files
        .iter()
        .filter(|(_, text)| text.lines().count() > FILE_LINES_MAX || !text.starts_with("// "))
        .map(|(path, _)| format!("{path}: too long, or does not begin with `// `"))
        .collect();
    expect_none(&faults);
}

#[test]
fn nothing_is_called_helpers() {
    let mut faults = Vec::new();
    for file in rust_files() {
        for name in homeless_names(&file.path, &file.views.code) {
            faults.push(format!("{}: `{name}` says nothing", file.path));
        }
    }
    expect_none(&faults);
}

#[test]
fn functions_are_measured_from_fn_to_the_closing_brace() {
    let text = "trait A {\n    fn a(\n        b: [u8; 4],\n    ) -> [u8; 2];\n}\n\
                fn c() {}\nconst fn d<F: Fn(u8)>(\n    f: F,\n) where\n    F: Send,\n{\n    \
                if x { \"}\" }\n    fn e() {\n    }\n}\ntype G = fn(u8);\n";
    let code = Views::of(text).code;
    let measured: Vec<_> =
        functions(&code).iter().map(|f| (f.name, f.first_line, f.lines)).collect();
    assert_eq!(measured, [("a", 2, 3), ("c", 6, 1), ("d", 7, 9), ("e", 13, 2)]);
}

#[test]
fn homeless_names_are_found_in_paths_and_code() {
    assert_eq!(homeless_names("src/utils/x.rs", ""), ["utils"]);
    assert_eq!(homeless_names("src/helper.rs", "mod common {\n fn misc() {} }").len(), 3);
    let fine = homeless_names("src/commons.rs", "fn common_edges() {}");
    assert!(fine.is_empty(), "{fine:?}");
}
