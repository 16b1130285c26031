//! Which format some first bytes are. Names are for `Format::from_path`.

use super::{Format, soup, stl};

/// Bytes that are looked at; a title comment of an OBJ file is hardly longer.
pub(super) const HEAD_BYTES: usize = 1 << 16;

/// Statements an OBJ file begins with.
const OBJ_STATEMENTS: [&[u8]; 12] =
    [b"v", b"vt", b"vn", b"vp", b"f", b"g", b"o", b"s", b"l", b"p", b"mtllib", b"usemtl"];

/// The format of an input that begins with `head` (all of it, when it is shorter than
/// [`HEAD_BYTES`]) and has `size_bytes` bytes if that is known.
pub(super) fn detect(head: &[u8], size_bytes: Option<u64>) -> Option<Format> {
    let text = || obj_begins(head).then_some(Format::Obj);
    signature(head, size_bytes)
        .or_else(|| if is_text(head) { text() } else { binary_stl(head).then_some(Format::Stl) })
}

/// The format that certain bytes at certain places leave no doubt about.
pub(super) fn signature(head: &[u8], size_bytes: Option<u64>) -> Option<Format> {
    if head.starts_with(&soup::MAGIC) {
        return Some(Format::Soup);
    }
    if stl::has_binary_size(head, size_bytes) {
        return Some(Format::Stl);
    }
    let mut words = head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(head).trim_ascii_start();
    let line = memchr::memchr2(b'\n', b'\r', words).unwrap_or(words.len());
    let end = words[..line].iter().position(u8::is_ascii_whitespace).unwrap_or(line);
    (words, _) = words.split_at(end);
    if words == b"ply" {
        return Some(Format::Ply);
    }
    if words.eq_ignore_ascii_case(b"solid") {
        return Some(Format::Stl);
    }
    let off = words.strip_suffix(b"OFF").is_some_and(|before| {
        [&b""[..], b"ST", b"C", b"N", b"4", b"n", b"CN", b"STC", b"STN", b"STCN", b"4n"]
            .contains(&before)
    });
    (off && is_text(head)).then_some(Format::Off)
}

fn is_text(head: &[u8]) -> bool {
    !head.iter().any(|&byte| stl::is_no_text(byte))
}

/// Whether the first line that is neither empty nor a comment is an OBJ statement.
fn obj_begins(head: &[u8]) -> bool {
    let head = head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(head);
    head.split(|&byte| byte == b'\n' || byte == b'\r')
        .map(<[u8]>::trim_ascii)
        .find(|line| !line.is_empty() && line[0] != b'#')
        .is_some_and(|line| {
            let end = line.iter().position(u8::is_ascii_whitespace).unwrap_or(line.len());
            OBJ_STATEMENTS.contains(&&line[..end])
        })
}

/// Whether the first record can be one of a binary STL: nothing in such a file says so, but
/// normals have length 1 or 0 and coordinates are numbers.
fn binary_stl(head: &[u8]) -> bool {
    let Some(record) = head.get(stl::FIRST_TRIANGLE) else { return false };
    let (numbers, _) = record.as_chunks::<4>();
    let mut numbers = numbers.iter().map(|&bytes| f32::from_le_bytes(bytes));
    let length_sq: f32 = numbers.by_ref().take(3).map(|n| n * n).sum();
    (length_sq == 0.0 || (length_sq - 1.0).abs() < 0.1)
        && numbers.take(9).all(|n| n == 0.0 || n.is_normal())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_formats_are_known_by_their_first_words() {
        let cases: [(&[u8], Option<Format>); 12] = [
            (b"ply\nformat ascii 1.0\n", Some(Format::Ply)),
            (b"plywood", None),
            (b"OFF\n3 1 0\n", Some(Format::Off)),
            (b"COFF 3 1 0\n", Some(Format::Off)),
            (b"TAKEOFF\n", None),
            (b"\n  SOLID a\nfacet", Some(Format::Stl)),
            (b"solid", Some(Format::Stl)),
            (b"# a comment\r\rv 1 2 3", Some(Format::Obj)),
            (b"\xef\xbb\xbfmtllib a.mtl\n", Some(Format::Obj)),
            (b"# only a comment\n", None),
            (b"hello world", None),
            (b"\x89MMSOUP\n", Some(Format::Soup)),
        ];
        for (head, format) in cases {
            assert_eq!(detect(head, None), format, "{:?}", String::from_utf8_lossy(head));
        }
    }

    #[test]
    fn binary_stl_is_known_by_its_size_or_its_first_triangle() {
        let mut bytes = vec![0; 84 + 50];
        bytes[..5].copy_from_slice(b"ply a");
        bytes[80] = 1;
        assert_eq!(detect(&bytes, Some(134)), Some(Format::Stl));
        bytes[..5].copy_from_slice(b"a ply");
        assert_eq!(detect(&bytes, None), Some(Format::Stl));
        bytes[84..88].copy_from_slice(&7_f32.to_le_bytes());
        assert_eq!(detect(&bytes, None), None);
    }
}
