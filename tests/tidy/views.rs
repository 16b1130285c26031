//! Two views of a Rust file: its code without comments and literals, and its comments alone.
//!
//! Both keep every line where it is. What does not belong to a view is blank in it.

/// The views of one file.
pub(super) struct Views {
    pub(super) code: String,
    pub(super) comments: String,
}

/// What a piece of text is.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Code,
    Comment,
    Literal,
}

impl Views {
    /// Takes a file apart.
    pub(super) fn of(text: &str) -> Self {
        let chars: Vec<char> = text.chars().collect();
        let mut views = Self { code: String::new(), comments: String::new() };
        let mut start = 0;
        while start < chars.len() {
            let (kind, length) = first_piece(&chars[start..]);
            for &c in &chars[start..start + length] {
                let shown = |in_view: bool| if in_view || c == '\n' { c } else { ' ' };
                views.code.push(shown(kind == Kind::Code));
                views.comments.push(shown(kind == Kind::Comment));
            }
            start += length;
        }
        views
    }
}

/// The leading identifier, keyword or number; empty when there is none.
pub(super) fn leading_word(text: &str) -> &str {
    let end = text.find(|c| !is_word(c)).unwrap_or(text.len());
    &text[..end]
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// Kind and length of the piece `chars` begins with. A word is one piece, so that the `r` of a
/// raw string is looked for at the start of a word only.
fn first_piece(chars: &[char]) -> (Kind, usize) {
    match chars {
        ['/', '/', ..] => {
            let end = chars.iter().position(|c| *c == '\n');
            (Kind::Comment, end.unwrap_or(chars.len()))
        }
        ['/', '*', ..] => (Kind::Comment, block_comment_length(chars)),
        ['"', ..] | ['\'', '\\', ..] => (Kind::Literal, quoted_length(chars)),
        ['\'', _, '\'', ..] => (Kind::Literal, 3),
        [first, ..] if is_word(*first) => {
            let end = chars.iter().position(|c| !is_word(*c)).unwrap_or(chars.len());
            match (&chars[..end], raw_length(&chars[end..])) {
                (['r'] | ['b' | 'c', 'r'], Some(length)) => (Kind::Literal, end + length),
                _ => (Kind::Code, end),
            }
        }
        _ => (Kind::Code, 1),
    }
}

/// Length of a quoted literal with its quotes.
fn quoted_length(chars: &[char]) -> usize {
    let mut escaped = false;
    for (index, c) in chars.iter().enumerate().skip(1) {
        if escaped {
            escaped = false;
        } else if *c == '\\' {
            escaped = true;
        } else if *c == chars[0] {
            return index + 1;
        }
    }
    chars.len()
}

/// Length of `"…"`, `#"…"#` and so on; `None` when it is no raw string (`r#type`).
fn raw_length(chars: &[char]) -> Option<usize> {
    let hashes = chars.iter().take_while(|c| **c == '#').count();
    if chars.get(hashes) != Some(&'"') {
        return None;
    }
    let mut close = vec!['#'; hashes + 1];
    close[0] = '"';
    let body = hashes + 1;
    let end = chars[body..].windows(close.len()).position(|window| window == close);
    Some(end.map_or(chars.len(), |end| body + end + close.len()))
}

/// Length of a block comment and those nested in it.
fn block_comment_length(chars: &[char]) -> usize {
    let mut depth = 0;
    let mut index = 0;
    while index < chars.len() {
        index += match chars[index..] {
            ['/', '*', ..] => {
                depth += 1;
                2
            }
            ['*', '/', ..] => {
                depth -= 1;
                2
            }
            _ => 1,
        };
        if depth == 0 {
            return index;
        }
    }
    chars.len()
}

#[test]
fn comments_and_literals_are_not_code() {
    let text = "let a = \"x // y\"; // say \"z\"\nlet b = 'c'; /* d /* e */ f */ g::<'h>();\n";
    let views = Views::of(text);
    let words = |view: &str| view.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
    assert_eq!(words(&views.code), ["let", "a", "=", ";", "let", "b", "=", ";", "g::<'h>();"]);
    let comments = ["//", "say", "\"z\"", "/*", "d", "/*", "e", "*/", "f", "*/"];
    assert_eq!(words(&views.comments), comments);
}

#[test]
fn lines_stay_where_they_are() {
    let text = "a\n\"b\n\\\"c\"\n/*\n*/ d";
    let views = Views::of(text);
    assert_eq!(views.code.lines().count(), 5);
    assert_eq!(views.code.lines().last(), Some("   d"));
}

#[test]
fn raw_strings_and_escaped_quotes_end_where_they_end() {
    let text = r##"f(r#"a " b"#, '\'', b"\\", br"\", r#type, b'x')"##;
    let code = Views::of(text).code;
    let code: String = code.split_whitespace().collect();
    assert_eq!(code, "f(,,b,,r#type,b)");
}
