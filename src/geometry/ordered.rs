//! Numbers as integers of the same order, which can be packed into keys and cut into digits.

/// Bits of `value` that compare as unsigned integers the way the numbers compare: -0 before 0,
/// NaN at the ends.
#[must_use]
#[inline]
pub fn ordered_f32(value: f32) -> u32 {
    let bits = value.to_bits();
    // Negative numbers have all bits turned round, positive ones the sign only.
    bits ^ ((bits.cast_signed() >> 31).cast_unsigned() | 1 << 31)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn ordered_bits_compare_as_the_numbers_do(a: f32, b: f32) {
            prop_assert_eq!(ordered_f32(a).cmp(&ordered_f32(b)), a.total_cmp(&b));
        }
    }
}
