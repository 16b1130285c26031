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

/// Bits per axis of [`spread_wide`].
pub const WIDE_BITS: u32 = 21;

/// Puts two zeros between each two of the lowest [`WIDE_BITS`] bits.
#[inline]
#[must_use]
pub const fn spread_wide(n: u64) -> u64 {
    let n = n & 0x1F_FFFF;
    let n = (n | n << 32) & 0x001F_0000_0000_FFFF;
    let n = (n | n << 16) & 0x001F_0000_FF00_00FF;
    let n = (n | n << 8) & 0x100F_00F0_0F00_F00F;
    let n = (n | n << 4) & 0x10C3_0C30_C30C_30C3;
    (n | n << 2) & 0x1249_2492_4924_9249
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_bits_are_spread_as_few_are() {
        for n in (0..1 << WIDE_BITS).step_by(997).chain([(1 << WIDE_BITS) - 1]) {
            let expected = (0..WIDE_BITS).map(|bit| (n >> bit & 1) << (3 * bit)).sum::<u64>();
            assert_eq!(spread_wide(n), expected, "{n}");
        }
    }

    #[test]
    fn bits_are_spread() {
        for n in 0..1024 {
            let expected = (0..10).map(|bit| (n >> bit & 1) << (3 * bit)).sum::<u32>();
            assert_eq!(spread(n), expected, "{n}");
        }
    }
}
