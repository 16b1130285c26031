//! Words that do not belong into finished code.

use super::{expect_none, rust_files};

/// The only files that may reach past the type system: memory maps, and a call of the C library.
const UNSAFE_FILES: &[&str] = &["src/storage/heap.rs", "src/storage/mapped.rs"];

/// Macros that stand for code that is not there yet, or not meant to stay.
const UNFINISHED_MACROS: &[&str] = &["todo!", "unimplemented!", "dbg!"];

/// Notes of work left undone: docs/SHORTCOMINGS.md is the place for them.
const UNFINISHED_NOTES: &[&str] = &["TODO", "FIXME", "XXX"];

/// Lines (1-based) of `text` that contain `word` as a word of its own.
fn lines_with(text: &str, word: &str) -> Vec<usize> {
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    let stands_alone = |line: &str| {
        line.match_indices(word).any(|(start, _)| {
            let after = &line[start + word.len()..];
            !line[..start].ends_with(is_word) && !after.starts_with(is_word)
        })
    };
    let lines = text.lines().enumerate();
    lines.filter(|(_, line)| stands_alone(line)).map(|(index, _)| index + 1).collect()
}

/// Lines on which a lint is switched off in silence.
fn silenced_lints(code: &str) -> Vec<usize> {
    let silences = |line: &str| {
        let line: String = line.chars().filter(|c| !c.is_whitespace()).collect();
        line.contains("[allow(") || line.contains(",allow(") || line.starts_with("allow(")
    };
    code.lines()
        .enumerate()
        .filter(|(_, line)| silences(line))
        .map(|(index, _)| index + 1)
        .collect()
}

#[test]
fn nothing_is_left_to_be_done() {
    let mut faults = Vec::new();
    for file in rust_files() {
        for word in UNFINISHED_MACROS {
            for line in lines_with(&file.views.code, word) {
                faults.push(format!("{}:{line}: {word}", file.path));
            }
        }
        for word in UNFINISHED_NOTES {
            for line in lines_with(&file.views.comments, word) {
                faults.push(format!("{}:{line}: {word}", file.path));
            }
        }
    }
    expect_none(&faults);
}

#[test]
fn a_lint_is_expected_and_never_allowed() {
    let mut faults = Vec::new();
    for file in rust_files() {
        for line in silenced_lints(&file.views.code) {
            faults.push(format!("{}:{line}: use #[expect(lint, reason = \"…\")]", file.path));
        }
    }
    expect_none(&faults);
}

#[test]
fn unsafe_lives_in_few_files() {
    let mut faults = Vec::new();
    for file in rust_files().iter().filter(|file| !UNSAFE_FILES.contains(&file.path.as_str())) {
        for line in lines_with(&file.views.code, "unsafe") {
            faults
                .push(format!("{}:{line}: unsafe belongs into one of {UNSAFE_FILES:?}", file.path));
        }
    }
    expect_none(&faults);
}

#[test]
fn words_are_found_where_they_stand_alone() {
    assert_eq!(lines_with("a\n  todo!()\nmy_todo!()", "todo!"), [2]);
    assert_eq!(lines_with("unsafe { }\nunsafe_code", "unsafe"), [1]);
}

#[test]
fn a_silenced_lint_is_found_in_any_attribute() {
    let code = "#[allow(x)]\n#![ allow(y)]\n#[cfg_attr(test, allow(z))]\nbudget.allow(1)";
    assert_eq!(silenced_lints(code), [1, 2, 3]);
}
