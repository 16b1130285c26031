//! The viewer as one ES module, put together from files that browsers can load one by one, too.
//!
//! Comments, blanks, imports and exports are left out, and names that are long and frequent are
//! shortened: every document carries it. The sources keep to a few rules for it: an import is one
//! line, there are no regular expressions that hold quotes or slashes, no template holds another
//! one, every arrow function with one parameter has it in parentheses, and no loop lacks its step.

/// The decoder, each file after those it imports. It runs in a worker that is made of its text.
const DECODER: &[&str] = &[
    include_str!("bytes.js"),
    include_str!("half_edges.js"),
    include_str!("decode.js"),
    include_str!("worker.js"),
];

/// What runs in the page, each file after those it imports.
const ELEMENT: &[&str] = &[
    include_str!("start_from_text.js"),
    include_str!("mesh.js"),
    include_str!("controller.js"),
    include_str!("camera.js"),
    include_str!("drawing.js"),
    include_str!("gestures.js"),
    include_str!("look.js"),
    include_str!("progressive-mesh.js"),
];

/// Names of ours that are long and frequent: shorter in the module, the first ones most. None of
/// them is a browser's, known to those who use the element, or spelt in a string where it is used.
const NAMES: &str = "\
    index count begin offset header places half vertex parents camera columns distance event \
    splits Fault PAGE_ENTRIES parts before controller corner elapsed batch part normals place \
    error colors shading degree verticesArrived origin moved axis applied arrived kind stride \
    first shown invalidate movedCount batches facesMax column changed trianglesMin copies head \
    differences drawing isEmpty budget chunks expect goal parent worker channels diagonal isAtRest \
    matrices uniforms meanMs normalsFit normalsKnown turn ProgressiveMesh found twin bits pages \
    pointers state program FAN_FACES_MAX neighbourA neighbourB added areShown baseVertices \
    ceilingUntil facesArrived hasLines isClosed isStale isWhole missing multiply nextText settling \
    share skipFinished start what BATCH_SPLITS_MAX answer attribute reader codes facesBefore \
    orthonormal other startWorker SETTLING_FRAMES ceiling LoadController arriving change \
    computeNormals firstHalfEdges isDark isMoving others previous readSplits right RAW_BYTES_MAX \
    checkedDegree connectSplits fail high stop sums order";

/// The module: it defines the element `progressive-mesh`.
#[must_use]
pub fn module() -> String {
    // The worker does not see what stands around its text.
    let math = "let $=Math;";
    format!("let decoder=()=>{{{math}{}}};{math}\n{}\n", joined(DECODER), joined(ELEMENT))
}

/// Files without what loads one from another.
fn joined(files: &[&str]) -> String {
    let lines = files.iter().flat_map(|file| file.lines());
    let own = lines.filter(|line| !line.starts_with("import "));
    let plain: Vec<&str> = own.map(|line| line.strip_prefix("export ").unwrap_or(line)).collect();
    compact(&plain.join("\n"), Language::Script)
}

/// What a text is written in.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Language {
    Script,
    /// GLSL, whose names are its own.
    Shader,
}

/// Leaves out comments and the blanks between tokens, and shortens names. A line ends where
/// JavaScript may need its end to end a statement.
fn compact(text: &str, language: Language) -> String {
    let mut short = String::with_capacity(text.len());
    let mut rest = text;
    let mut gap = Gap::None;
    while let Some(first) = rest.chars().next() {
        let (piece, after) = rest.split_at(piece_length(rest, first));
        rest = after;
        if piece.starts_with("//") || piece.starts_with("/*") {
            gap = gap.max(Gap::Blank);
        } else if first.is_whitespace() {
            gap = gap.max(if first == '\n' { Gap::Line } else { Gap::Blank });
        } else {
            // Nothing comes between the last of a list or block and its end.
            let is_end = matches!(first, '}' | ']' | ')') && language == Language::Script;
            if is_end && short.ends_with([',', ';']) {
                short.pop();
            }
            short.extend(gap.needed(short.chars().next_back(), first));
            gap = Gap::None;
            if first == '=' && rest.starts_with('>') {
                without_parentheses(&mut short);
            }
            match piece {
                "0" if rest.starts_with('.') => {}
                _ if first == '`' => short.push_str(&compact_template(piece)),
                _ if language == Language::Shader => short.push_str(piece),
                _ => short.push_str(&short_name(piece).unwrap_or_else(|| piece.to_owned())),
            }
        }
    }
    short
}

/// One parameter of an arrow function needs none.
fn without_parentheses(short: &mut String) {
    let Some(start) = short.rfind('(').filter(|_| short.ends_with(')')) else { return };
    let (before, name) = (&short[..start], &short[start + 1..short.len() - 1]);
    if !name.is_empty() && name.chars().all(is_word) && !before.ends_with(is_word) {
        short.pop();
        short.remove(start);
    }
}

/// Bytes of the comment, literal, word or single character at the beginning.
fn piece_length(text: &str, first: char) -> usize {
    match first {
        _ if text.starts_with("//") => text.find('\n').unwrap_or(text.len()),
        _ if text.starts_with("/*") => text.find("*/").map_or(text.len(), |end| end + 2),
        '\'' | '"' | '`' => quoted_length(text, first),
        _ if is_word(first) => text.find(|c| !is_word(c)).unwrap_or(text.len()),
        _ => first.len_utf8(),
    }
}

/// A template: shaders and the code in it are compacted, style sheets lose their blanks, and lines
/// of anything else their indent.
fn compact_template(text: &str) -> String {
    if let Some((version, shader)) = text.split_once('\n')
        && version.starts_with("`#version")
    {
        return format!(
            "{version}\n{}",
            compact(shader.trim_end_matches('`'), Language::Shader) + "`"
        );
    }
    if text.contains(";\n") {
        return squeezed(text);
    }
    let mut parts = text.split("${");
    let mut short = unindented(parts.next().unwrap_or_default());
    for part in parts {
        let (code, after) = part.split_once('}').unwrap_or((part, ""));
        short.extend(["${", &compact(code, Language::Script), "}", &unindented(after)]);
    }
    short
}

/// A style sheet without the blanks beside its punctuation.
fn squeezed(text: &str) -> String {
    let mut short = String::with_capacity(text.len());
    for c in text.chars() {
        let is_behind = short.ends_with(|before| "`{};:, >".contains(before));
        if c.is_whitespace() && is_behind {
            continue;
        }
        if "{}>".contains(c) && short.ends_with(' ') {
            short.pop();
        }
        if c == '}' && short.ends_with(';') {
            short.pop();
        }
        short.push(if c.is_whitespace() { ' ' } else { c });
    }
    short
}

fn unindented(text: &str) -> String {
    text.split('\n')
        .enumerate()
        .map(|(index, line)| match index {
            0 => line.to_owned(),
            _ => format!("\n{}", line.trim_start()),
        })
        .collect()
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_' || c == '$' || c == '#'
}

/// What a name is called in the module, if it is one of [`NAMES`].
fn short_name(name: &str) -> Option<String> {
    match name {
        "const" => return Some("let".to_owned()),
        "true" => return Some("!0".to_owned()),
        "false" => return Some("!1".to_owned()),
        "Math" => return Some("$".to_owned()),
        _ => {}
    }
    let index = NAMES.split_whitespace().position(|long| long == name)?;
    let letters = b"abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789";
    let digit = |place: usize| char::from(letters[place]);
    Some(match index.checked_sub(letters.len()) {
        None => format!("${}", digit(index)),
        Some(rest) => format!("$_{}", digit(rest)),
    })
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
    const MODULE_BYTES_MAX: usize = 40_000;

    fn script(text: &str) -> String {
        compact(text, Language::Script)
    }

    #[test]
    fn comments_and_blanks_go_and_statements_stay_apart() {
        let text = "// a\nconst a = 'b // c'; /* d */\nlet e = a - -1\nlet f\n  = `g\n   h`;\n";
        assert_eq!(script(text), "let a='b // c';let e=a- -1\nlet f=`g\nh`;");
    }

    #[test]
    fn the_last_of_a_list_needs_no_comma() {
        assert_eq!(script("f([\n  1,\n  '2,',\n]);\nif (a) { b(); }"), "f([1,'2,']);if(a){b()}");
    }

    #[test]
    fn numbers_and_arrow_functions_are_short() {
        assert_eq!(script("(a) => 0.5 + 10.5"), "a=>.5+10.5");
        assert_eq!(script("async (a) => f(b) => true"), "async(a)=>f(b)=>!0");
    }

    #[test]
    fn names_are_short_but_not_in_texts_and_shaders() {
        assert_eq!(
            script("vertices.x(index, 'index', `index ${index}`)").matches("index").count(),
            2
        );
        let shader = "`#version 300 es\nconst float index = 0.50;\nvoid main() {\n  x = index;\n}`";
        let short = "`#version 300 es\nconst float index=.50;void main(){x=index;}`";
        assert_eq!(script(shader), short);
        let mut names: Vec<String> = NAMES.split_whitespace().filter_map(short_name).collect();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), NAMES.split_whitespace().count());
    }

    #[test]
    fn style_sheets_keep_the_blanks_that_mean_something() {
        let sheet = "`\n.a .b, c { x: 1px 2px;\n  y: z(1, 2); }\n@media (q: r) { * { s: t } }`";
        assert_eq!(script(sheet), "`.a .b,c{x:1px 2px;y:z(1,2)}@media (q:r){*{s:t}}`");
    }

    #[test]
    fn the_module_can_stand_in_a_page() {
        let module = module();
        for end in ["</script", "<script", "<!--"] {
            assert!(!module.contains(end), "{end} would end the script, or keep it from ending");
        }
        assert!(!module.contains("import{"), "nothing to load");
        assert!(module.len() < MODULE_BYTES_MAX, "{} bytes", module.len());
    }
}
