//! Columns of numbers, coordinates and channels, on their way into a payload and out of it.

use super::Channels;
use crate::error::Fault;

/// Bytes of a number at most: a `u32` in groups of seven bits.
const NUMBER_BYTES_MAX: usize = 5;

/// Columns under way into a payload.
#[derive(Default)]
pub(super) struct Writer(pub(super) Vec<u8>);

/// Columns taken out of a payload, one after the other.
pub(super) struct Reader<'a>(pub(super) &'a [u8]);

/// 0, −1, 1, −2 → 0, 1, 2, 3.
pub(super) fn zigzag(value: i32) -> u32 {
    ((value << 1) ^ (value >> 31)) as u32
}

fn unzigzag(code: u32) -> i32 {
    (code >> 1) as i32 ^ -((code & 1) as i32)
}

/// A difference modulo 2^bits as the number that is nearest to 0.
pub(super) fn wrapped(difference: i32, bits: u32) -> i32 {
    (difference << (32 - bits)) >> (32 - bits)
}

impl Writer {
    pub(super) fn numbers(&mut self, numbers: impl Iterator<Item = u32>) {
        for mut number in numbers {
            while number >= 0x80 {
                self.0.push(number as u8 | 0x80);
                number >>= 7;
            }
            self.0.push(number as u8);
        }
    }

    /// `differences` may be any: they are taken modulo 2^bits.
    pub(super) fn coordinates(
        &mut self,
        bits: u32,
        differences: &(impl Iterator<Item = [i32; 3]> + Clone),
    ) {
        for axis in 0..3 {
            for byte in 0..bits.div_ceil(8) {
                let codes = differences.clone().map(|d| zigzag(wrapped(d[axis], bits)));
                self.0.extend(codes.map(|code| (code >> (8 * byte)) as u8));
            }
        }
    }

    pub(super) fn channels(
        &mut self,
        channels: Channels,
        differences: &(impl Iterator<Item = [u8; 4]> + Clone),
    ) {
        for channel in 0..channels.count() {
            self.0.extend(differences.clone().map(|difference| difference[channel]));
        }
    }
}

impl<'a> Reader<'a> {
    /// As many numbers as there are places for them.
    pub(super) fn numbers(&mut self, numbers: &mut [u32]) -> Result<(), Fault> {
        let short = Fault::Corrupt("the length of a column of numbers");
        for number in numbers {
            let mut value = 0_u64;
            let mut bytes = 0;
            loop {
                let (&byte, rest) = self.0.split_first().ok_or_else(|| short.clone())?;
                self.0 = rest;
                value |= u64::from(byte & 0x7f) << (7 * bytes);
                bytes += 1;
                if byte < 0x80 {
                    break;
                }
                if bytes == NUMBER_BYTES_MAX {
                    return Err(short);
                }
            }
            *number = u32::try_from(value).map_err(|_| short.clone())?;
        }
        Ok(())
    }

    /// Signed differences.
    pub(super) fn coordinates(&mut self, bits: u32, count: usize) -> Result<Vec<[i32; 3]>, Fault> {
        let mut codes = vec![[0_u32; 3]; count];
        for axis in 0..3 {
            for byte in 0..bits.div_ceil(8) {
                for (code, value) in codes.iter_mut().zip(self.bytes(count)?) {
                    code[axis] |= u32::from(*value) << (8 * byte);
                }
            }
        }
        if codes.as_flattened().iter().any(|code| code >> bits != 0) {
            return Err(Fault::Corrupt("the range of a coordinate"));
        }
        Ok(codes.into_iter().map(|codes| codes.map(unzigzag)).collect())
    }

    /// Differences of colours; without channels none.
    pub(super) fn channels(
        &mut self,
        channels: Channels,
        count: usize,
    ) -> Result<Vec<[u8; 4]>, Fault> {
        let mut colors = vec![[0; 4]; if channels == Channels::None { 0 } else { count }];
        for channel in 0..channels.count() {
            for (color, value) in colors.iter_mut().zip(self.bytes(count)?) {
                color[channel] = *value;
            }
        }
        Ok(colors)
    }

    /// Nothing is left.
    pub(super) fn finish(&self) -> Result<(), Fault> {
        if self.0.is_empty() { Ok(()) } else { Err(Fault::Corrupt("the length of the columns")) }
    }

    fn bytes(&mut self, count: usize) -> Result<&'a [u8], Fault> {
        let short = Fault::Corrupt("the length of a column of bytes");
        let (column, rest) = self.0.split_at_checked(count).ok_or(short)?;
        self.0 = rest;
        Ok(column)
    }
}

/// Zigzag code of the difference of two indices, and back.
pub(super) fn index_code(index: u32, before: u32) -> u32 {
    zigzag((index as i32).wrapping_sub(before as i32))
}

/// The index `code` away from the one before.
pub(super) fn index_of_code(code: u32, before: u32) -> u32 {
    before.wrapping_add(unzigzag(code) as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_differences_have_small_codes() {
        assert_eq!(
            [0, -1, 1, -2, i32::MIN, i32::MAX].map(zigzag),
            [0, 1, 2, 3, u32::MAX, u32::MAX - 1]
        );
        assert!([0, -1, 1, -77, i32::MIN].iter().all(|value| unzigzag(zigzag(*value)) == *value));
        assert_eq!(wrapped(16383 - 1, 14), -2);
        assert_eq!(wrapped(-8192, 14), wrapped(8192, 14));
    }

    #[test]
    fn columns_come_back_and_end_where_they_should() {
        let numbers = [0, 127, 128, 300_000, u32::MAX];
        let steps = [[0, -1, 8191], [-8192, 5, 6]];
        let colors = [[1, 2, 3, 0], [255, 0, 7, 0]];
        let mut writer = Writer::default();
        writer.numbers(numbers.into_iter());
        writer.coordinates(14, &steps.into_iter());
        writer.channels(Channels::Rgb, &colors.into_iter());
        let bytes = writer.0;
        assert_eq!(bytes.len(), 1 + 1 + 2 + 3 + 5 + 2 * 6 + 2 * 3);
        let read = |bytes: &[u8]| {
            let mut reader = Reader(bytes);
            let mut found = [0; 5];
            reader.numbers(&mut found)?;
            let found = (found, reader.coordinates(14, 2)?, reader.channels(Channels::Rgb, 2)?);
            reader.finish().map(|()| found)
        };
        assert_eq!(read(&bytes), Ok((numbers, steps.to_vec(), colors.to_vec())));
        for end in 0..bytes.len() {
            read(&bytes[..end]).unwrap_err();
        }
        read(&[&bytes[..], &[0]].concat()).unwrap_err();
    }

    #[test]
    fn numbers_of_more_than_32_bits_are_refused() {
        for bytes in [&[0x80_u8; 9][..], &[0xff, 0xff, 0xff, 0xff, 0x1f], &[0x80; 5], &[0x80]] {
            Reader(bytes).numbers(&mut [0]).unwrap_err();
        }
    }
}
