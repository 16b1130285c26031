//! Numbers as people type them: counts, ratios, sizes.

use std::str::FromStr;

use meshmill::pipeline::MaxError;

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

/// How far a result may be from its input: a length, 0 or above, or a share of the diagonal.
pub(super) fn max_error(text: &str) -> Result<MaxError, String> {
    let (digits, is_share) = match text.trim().strip_suffix('%') {
        Some(digits) => (digits, true),
        None => (text.trim(), false),
    };
    let value = digits.trim().parse::<f64>().ok();
    let value = value.filter(|value| *value >= 0.0 && value.is_finite());
    let error =
        |value| if is_share { MaxError::Share(0.01 * value) } else { MaxError::Length(value) };
    value.map(error).ok_or_else(|| {
        "an error bound is 0 or above, in model units or as a share of the diagonal: 0.2 or 0.05%"
            .to_owned()
    })
}

/// Longest edge over inner radius of a triangle.
pub(super) fn roundness(text: &str) -> Result<f32, String> {
    let value = text.parse::<f32>().ok().filter(|value| *value >= 3.0);
    value.ok_or_else(|| "longest edge over inner radius is 3.46 at least".to_owned())
}

/// A distance between colours.
pub(super) fn color_error(text: &str) -> Result<f32, String> {
    let value = text.parse::<f32>().ok().filter(|value| *value >= 0.0 && value.is_finite());
    value.ok_or_else(|| "a distance between colours is 0 or above".to_owned())
}

/// An angle in degrees.
pub(super) fn angle(text: &str) -> Result<f32, String> {
    let value = text.parse::<f32>().ok().filter(|value| (0.0..=180.0).contains(value));
    value.ok_or_else(|| "an angle lies between 0 and 180 degrees".to_owned())
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
    fn an_error_bound_is_a_length_or_a_share() {
        assert_eq!(max_error("0.2"), Ok(MaxError::Length(0.2)));
        assert_eq!(max_error("0"), Ok(MaxError::Length(0.0)));
        assert_eq!(max_error("50 %"), Ok(MaxError::Share(0.5)));
        for wrong in ["", "-1", "NaN", "inf", "-0.1%", "1mm", "%"] {
            assert!(max_error(wrong).is_err(), "{wrong}");
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
