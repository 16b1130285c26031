//! Morton codes: points that are near each other in space are mostly so along a curve.

/// Puts two zeros between each two of the lowest ten bits.
#[inline]
#[must_use]
pub const fn spread(n: u32) -> u32 {
    let n = n & 0x3FF;
    let n = (n | n << 16) & 0x0300_00FF;
    let n = (n | n << 8) & 0x0300_F00F;
    let n = (n | n << 4) & 0x030C_30C3;
    (n | n << 2) & 0x0924_9249
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_spread() {
        for n in 0..1024 {
            let expected = (0..10).map(|bit| (n >> bit & 1) << (3 * bit)).sum::<u32>();
            assert_eq!(spread(n), expected, "{n}");
        }
    }
}
