//! Numbers as people type them: counts, ratios, sizes.

use std::str::FromStr;

/// A count with an optional decimal multiple: `500k`, `2M`, `1.5G`, `100000`.
pub(super) fn count(text: &str) -> Result<u64, String> {
    let (digits, factor) = match text.trim().as_bytes().last().map(u8::to_ascii_lowercase) {
        Some(b'k') => (&text.trim()[..text.trim().len() - 1], 1e3),
        Some(b'm') => (&text.trim()[..text.trim().len() - 1], 1e6),
        Some(b'g') => (&text.trim()[..text.trim().len() - 1], 1e9),
        _ => (text.trim(), 1.0),
    };
    let value = if factor == 1.0 {
        digits.replace('_', "").parse::<u64>().ok()
    } else {
        let value = digits.parse::<f64>().ok().map(|value| value * factor);
        value.filter(|value| (0.0..1e18).contains(value)).map(|value| value.round() as u64)
    };
    match value {
        Some(0) => Err("a count is at least 1".to_owned()),
        Some(value) => Ok(value),
        None => Err("a count is a whole number, perhaps with k, M or G: 500k, 2M".to_owned()),
    }
}

/// A share of the triangles, above 0 and at most 1: `0.01`, `1%`.
pub(super) fn ratio(text: &str) -> Result<f64, String> {
    let (digits, factor) = match text.trim().strip_suffix('%') {
        Some(digits) => (digits, 0.01),
        None => (text.trim(), 1.0),
    };
    let value = digits.trim().parse::<f64>().ok().map(|value| value * factor);
    value.filter(|value| *value > 0.0 && *value <= 1.0).ok_or_else(|| {
        "a ratio is the share of triangles that is kept, above 0 and at most 1: 0.01 or 1%".into()
    })
}

/// A size in bytes: `4GiB`, `512MiB`, `2GB`, `1000000`.
pub(super) fn bytes(text: &str) -> Result<u64, String> {
    let size = bytesize::ByteSize::from_str(text);
    size.map(|size| size.0).map_err(|_| "a size is a number with a unit: 4GiB, 512MiB, 2GB".into())
}

/// A length above zero.
pub(super) fn length(text: &str) -> Result<f64, String> {
    let value = text.parse::<f64>().ok().filter(|value| *value > 0.0 && value.is_finite());
    value.ok_or_else(|| "a length is a number above 0, in model units".to_owned())
}

/// A share between 0 and 1.
pub(super) fn share(text: &str) -> Result<f64, String> {
    let value = text.parse::<f64>().ok().filter(|value| (0.0..=1.0).contains(value));
    value.ok_or_else(|| "a share lies between 0 and 1".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_take_decimal_multiples() {
        assert_eq!(count("500k"), Ok(500_000));
        assert_eq!(count("2M"), Ok(2_000_000));
        assert_eq!(count("1.5G"), Ok(1_500_000_000));
        assert_eq!(count("12345"), Ok(12_345));
        for wrong in ["", "k", "-1", "0", "1.5", "10x", "1e400k"] {
            assert!(count(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_ratio_is_a_share_or_a_percentage() {
        assert_eq!(ratio("1%"), Ok(0.01));
        assert_eq!(ratio("0.25"), Ok(0.25));
        for wrong in ["0", "101%", "1.1", "-1%", "NaN", "%"] {
            assert!(ratio(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn sizes_take_binary_and_decimal_units() {
        assert_eq!(bytes("4GiB"), Ok(4 << 30));
        assert_eq!(bytes("2GB"), Ok(2_000_000_000));
        assert_eq!(bytes("256 MiB"), Ok(256 << 20));
        assert!(bytes("much").is_err());
    }
}
