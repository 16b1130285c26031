//! Keys that records are ordered by: unsigned integers, because those can be cut into digits.
//!
//! A key that ties gets the record index in its low bits where it is made, not here.

use std::fmt::Debug;

use crate::storage::Record;

/// An unsigned integer that records are sorted by.
pub trait SortKey: Copy + Ord + Debug + Send + Sync + 'static {
    /// The largest key.
    const MAX: Self;

    /// The next larger key, `None` after [`Self::MAX`].
    fn successor(self) -> Option<Self>;

    /// Bits needed to write `self - first`; `first` is at most `self`.
    fn bits_above(self, first: Self) -> u32;

    /// `(self - first) >> shift`; `first` is at most `self` and the result fits in 32 bits.
    fn digit_above(self, first: Self, shift: u32) -> usize;

    /// As text, for the journal.
    fn to_hex(self) -> String;

    /// What [`Self::to_hex`] made; `None` of anything else.
    fn from_hex(text: &str) -> Option<Self>;
}

macro_rules! sort_key {
    ($($integer:ty),*) => {$(
        impl SortKey for $integer {
            const MAX: Self = <$integer>::MAX;

            #[inline]
            fn successor(self) -> Option<Self> {
                self.checked_add(1)
            }

            #[inline]
            fn bits_above(self, first: Self) -> u32 {
                <$integer>::BITS - (self - first).leading_zeros()
            }

            #[inline]
            fn digit_above(self, first: Self, shift: u32) -> usize {
                ((self - first) >> shift) as usize
            }

            fn to_hex(self) -> String {
                format!("{self:x}")
            }

            fn from_hex(text: &str) -> Option<Self> {
                <$integer>::from_str_radix(text, 16).ok()
            }
        }
    )*};
}

sort_key!(u32, u64, u128);

/// A record that knows its key. Sorting is stable: equal keys keep the order of the input.
pub trait Keyed: Record {
    /// Type of the key; pairs are packed into a `u128`, the more significant half first.
    type Key: SortKey;

    /// The key. Must be cheap, it is asked for many times.
    fn key(&self) -> Self::Key;
}

impl Keyed for u64 {
    type Key = Self;

    fn key(&self) -> Self {
        *self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_above_a_first_key_are_its_leading_bits() {
        assert_eq!(1000_u64.bits_above(1000), 0);
        assert_eq!(1255_u64.bits_above(1000), 8);
        assert_eq!(1255_u64.digit_above(1000, 4), 15);
        assert_eq!(u128::MAX.bits_above(0), 128);
        assert_eq!(u32::MAX.successor(), None);
    }
}
