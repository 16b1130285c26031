//! The viewer as one ES module, put together from files that browsers can load one by one, too.
//!
//! Comments, blanks, imports and exports are left out, and nothing else: names stay, so that errors can
//! be read. The sources keep to a few rules for it: an import is one line, there are no regular
//! expressions that hold quotes or slashes, and no template holds another one.

/// The decoder, each file after those it imports. It runs in a worker that is made of its text.
const DECODER: &[&str] = &[
    include_str!("bytes.js"),
    include_str!("half_edges.js"),
    include_str!("decode.js"),
    include_str!("worker.js"),
];

/// What runs in the page, each file after those it imports.
const ELEMENT: &[&str] = &[
    include_str!("start.js"),
    include_str!("mesh.js"),
    include_str!("controller.js"),
    include_str!("camera.js"),
    include_str!("drawing.js"),
    include_str!("gestures.js"),
    include_str!("look.js"),
    include_str!("progressive-mesh.js"),
];

/// The module: it defines the element `progressive-mesh`.
#[must_use]
pub fn module() -> String {
    format!("const decoder=()=>{{{}}};\n{}\n", joined(DECODER), joined(ELEMENT))
}

/// Files without what loads one from another.
fn joined(files: &[&str]) -> String {
    let lines = files.iter().flat_map(|file| file.lines());
    let own = lines.filter(|line| !line.starts_with("import "));
    let plain: Vec<&str> = own.map(|line| line.strip_prefix("export ").unwrap_or(line)).collect();
    compact(&plain.join("\n"))
}

/// Leaves out comments and the blanks between tokens. A line ends where JavaScript may need its end
/// to end a statement.
fn compact(text: &str) -> String {
    let mut short = String::with_capacity(text.len());
    let mut rest = text;
    let mut gap = Gap::None;
    while let Some(first) = rest.chars().next() {
        let length = match first {
            _ if rest.starts_with("//") => rest.find('\n').unwrap_or(rest.len()),
            _ if rest.starts_with("/*") => rest.find("*/").map_or(rest.len(), |end| end + 2),
            '\'' | '"' | '`' => quoted_length(rest, first),
            _ => first.len_utf8(),
        };
        let (piece, after) = rest.split_at(length);
        rest = after;
        if piece.starts_with("//") || piece.starts_with("/*") {
            gap = gap.max(Gap::Blank);
        } else if first.is_whitespace() {
            gap = gap.max(if first == '\n' { Gap::Line } else { Gap::Blank });
        } else {
            // Nothing comes between the last of a list or block and its end.
            if matches!(first, '}' | ']' | ')') && short.ends_with([',', ';']) {
                short.pop();
            }
            short.extend(gap.needed(short.chars().next_back(), first));
            gap = Gap::None;
            // What stands in templates has indented lines, but none that needs its indent.
            let mut lines = piece.split('\n');
            short.extend(lines.next());
            lines.for_each(|line| short.extend(["\n", line.trim_start()]));
        }
    }
    short
}

/// What stood between two tokens.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Gap {
    None,
    Blank,
    Line,
}

impl Gap {
    /// What has to stay of it.
    fn needed(self, before: Option<char>, after: char) -> Option<char> {
        let before = before?;
        let is_word = |c: char| c.is_alphanumeric() || c == '_' || c == '$' || c == '#';
        let is_sign = |c: char| c == '+' || c == '-';
        let ends = is_word(before) || ")]}'\"`".contains(before);
        let begins = is_word(after) || "([{'\"`+-!".contains(after);
        match self {
            Self::None => None,
            Self::Line if ends && begins => Some('\n'),
            _ if is_word(before) && is_word(after) => Some(' '),
            _ if is_sign(before) && is_sign(after) => Some(' '),
            _ => None,
        }
    }
}

/// Bytes of a string or template, its quotes included.
fn quoted_length(text: &str, quote: char) -> usize {
    let mut is_escaped = false;
    for (index, c) in text.char_indices().skip(1) {
        match c {
            _ if is_escaped => is_escaped = false,
            '\\' => is_escaped = true,
            _ if c == quote => return index + c.len_utf8(),
            _ => {}
        }
    }
    text.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a reader downloads with every document.
    const MODULE_BYTES_MAX: usize = 49_000;

    #[test]
    fn comments_and_blanks_go_and_statements_stay_apart() {
        let text =
            "// a\nexport const a = 'b // c'; /* d */\nlet e = a - -1\nlet f\n  = `g\n   h`;\n";
        assert_eq!(compact(text), "export const a='b // c';let e=a- -1\nlet f=`g\nh`;");
    }

    #[test]
    fn the_last_of_a_list_needs_no_comma() {
        assert_eq!(compact("f([\n  1,\n  '2,',\n]);\nif (a) { b(); }"), "f([1,'2,']);if(a){b()}");
    }

    #[test]
    fn the_module_can_stand_in_a_page() {
        let module = module();
        for end in ["</script", "<script", "<!--"] {
            assert!(!module.contains(end), "{end} would end the script, or keep it from ending");
        }
        assert!(!module.contains("import "), "nothing to load");
        assert!(module.len() < MODULE_BYTES_MAX, "{} bytes", module.len());
    }
}
