//! The page of a document: a template with the viewer in it, and the mesh in it or beside it.

use std::io::{self, Read, Write};

use super::{base64, module};

const TEMPLATE: &str = include_str!("page.html");

/// Bytes of the mesh in one element of the page: what has loaded of the page is shown element by
/// element. A multiple of three, so that no letters are spent on padding.
const PIECE_BYTES: usize = 48 << 10;

/// What a page says beside the mesh.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Page {
    /// In the head of the window.
    pub title: String,
    /// Below the mesh, always in view; may be empty.
    pub caption: String,
    /// The axis of the model that points up: `x`, `y`, `z`, or `-x` and so on where it points down;
    /// `None`: `y`.
    pub up: Option<&'static str>,
}

/// Where the mesh is.
pub enum Data<'a> {
    /// In the page, all that is left of a reader.
    Inside(&'a mut dyn Read),
    /// In a file that is loaded from this address, relative to the page's.
    Beside(&'a str),
}

/// Writes a page.
///
/// # Errors
/// Those of the output, and of the input if the mesh is to be in the page.
pub fn write(out: &mut dyn Write, page: &Page, data: Data<'_>) -> io::Result<()> {
    let mut rest = TEMPLATE;
    let mut attributes = vec![format!("caption=\"{}\"", escaped(&page.caption))];
    attributes.extend(page.up.map(|up| format!("up=\"{up}\"")));
    let inside = match data {
        Data::Inside(input) => Some(input),
        Data::Beside(address) => {
            attributes.push(format!("src=\"{}\"", escaped(&percent_encoded(address))));
            None
        }
    };
    let places = [
        ("{{title}}", escaped(&page.title)),
        ("{{module}}", module()),
        ("{{attributes}}", attributes.join(" ")),
        ("{{data}}", String::new()),
    ];
    for (place, text) in places {
        let (before, after) = rest.split_once(place).unwrap_or((rest, ""));
        out.write_all(before.as_bytes())?;
        out.write_all(text.as_bytes())?;
        rest = after;
    }
    if let Some(input) = inside {
        write_pieces(out, input)?;
    }
    out.write_all(rest.as_bytes())
}

fn write_pieces(out: &mut dyn Write, input: &mut dyn Read) -> io::Result<()> {
    loop {
        let mut piece = Vec::with_capacity(PIECE_BYTES);
        input.take(PIECE_BYTES as u64).read_to_end(&mut piece)?;
        if piece.is_empty() {
            return Ok(());
        }
        out.write_all(b"<script type=\"application/octet-stream;base64\">")?;
        base64::write(out, &piece)?;
        out.write_all(b"</script>\n")?;
    }
}

/// Text as it may stand in HTML and in attributes.
fn escaped(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            '\'' => safe.push_str("&#39;"),
            _ => safe.push(c),
        }
    }
    safe
}

/// The name of a file as an address: it may hold anything, a colon or question mark, too.
fn percent_encoded(name: &str) -> String {
    let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-._~".contains(&byte);
    let encode = |byte: u8| match byte {
        byte if is_plain(byte) => char::from(byte).to_string(),
        byte => format!("%{byte:02X}"),
    };
    name.bytes().map(encode).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(page: &Page, data: Data<'_>) -> String {
        let mut out = Vec::new();
        write(&mut out, page, data).unwrap();
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn nothing_in_a_title_becomes_markup() {
        let caption = "\"><script>alert('{{data}} & more')</script>".to_owned();
        let page = Page { title: "</title><b>".to_owned(), caption, up: Some("z") };
        let text = written(&page, Data::Beside("a b:?\"#ü.pm"));
        assert!(text.contains("<title>&lt;/title&gt;&lt;b&gt;</title>"));
        assert!(
            text.contains("caption=\"&quot;&gt;&lt;script&gt;alert(&#39;{{data}} &amp; more&#39;")
        );
        assert!(text.contains("up=\"z\" src=\"a%20b%3A%3F%22%23%C3%BC.pm\">"));
        assert_eq!(text.matches("<script").count(), 1);
    }

    #[test]
    fn every_byte_is_in_the_page_in_pieces() {
        let bytes: Vec<u8> = (0..PIECE_BYTES + 5).map(|index| index as u8).collect();
        let text = written(&Page::default(), Data::Inside(&mut bytes.as_slice()));
        let pieces: Vec<&str> = text
            .split("base64\">")
            .skip(1)
            .filter_map(|rest| Some(rest.split_once('<')?.0))
            .collect();
        assert_eq!(pieces.len(), 2);
        assert_eq!(pieces[0].len(), PIECE_BYTES / 3 * 4);
        assert_eq!(pieces[1], "AAECAwQ=");
        assert!(text.ends_with("</progressive-mesh>\n</html>\n"));
        assert!(!text.contains("{{"));
    }
}
