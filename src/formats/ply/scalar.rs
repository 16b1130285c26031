//! The number types of PLY, under both naming schemes, and how they are stored.

/// Type of one number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    /// Not in the original description; written by some for more than 2^31 vertices.
    I64,
    /// As [`Self::I64`].
    U64,
    F32,
    F64,
}

/// Byte order of a binary body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ByteOrder {
    Little,
    Big,
}

impl Scalar {
    /// The type a header names so.
    pub(super) fn from_name(name: &[u8]) -> Option<Self> {
        Some(match name {
            b"char" | b"int8" => Self::I8,
            b"uchar" | b"uint8" => Self::U8,
            b"short" | b"int16" => Self::I16,
            b"ushort" | b"uint16" => Self::U16,
            b"int" | b"int32" => Self::I32,
            b"uint" | b"uint32" => Self::U32,
            b"int64" => Self::I64,
            b"uint64" => Self::U64,
            b"float" | b"float32" => Self::F32,
            b"double" | b"float64" => Self::F64,
            _ => return None,
        })
    }

    /// Bytes of one number in a binary body.
    pub(super) fn size_bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    pub(super) fn is_integer(self) -> bool {
        !matches!(self, Self::F32 | Self::F64)
    }

    /// Whether some values of the type have no `f32`.
    pub(super) fn is_wider_than_single(self) -> bool {
        matches!(self, Self::I32 | Self::U32 | Self::I64 | Self::U64 | Self::F64)
    }

    /// The number at the start of `bytes`.
    #[inline]
    pub(super) fn decode_f64(self, order: ByteOrder, bytes: &[u8]) -> f64 {
        let mut value = 0.0;
        let size = self.size_bytes();
        self.for_each_f64(order, &bytes[..size], Column { stride: size, offset: 0 }, |_, v| {
            value = v;
        });
        value
    }

    /// The whole number at the start of `bytes`; floats are cut.
    #[inline]
    pub(super) fn decode_i64(self, order: ByteOrder, bytes: &[u8]) -> i64 {
        let mut value = 0;
        self.for_each_i64(order, &bytes[..self.size_bytes()], |v| value = v);
        value
    }

    /// Calls `put(index, number)` for the number at the same place of each record of `block`.
    #[inline]
    pub(super) fn for_each_f64(
        self,
        order: ByteOrder,
        block: &[u8],
        column: Column,
        mut put: impl FnMut(usize, f64),
    ) {
        let Column { stride, offset } = column;
        // One loop per type and order, so that nothing is decided per record.
        macro_rules! each {
            ($number:ty, $convert:expr) => {
                for (index, record) in block.chunks_exact(stride).enumerate() {
                    let bytes =
                        *record[offset..].first_chunk().expect("a field lies in its record");
                    let number = match order {
                        ByteOrder::Little => <$number>::from_le_bytes(bytes),
                        ByteOrder::Big => <$number>::from_be_bytes(bytes),
                    };
                    put(index, $convert(number));
                }
            };
        }
        match self {
            Self::I8 => each!(i8, f64::from),
            Self::U8 => each!(u8, f64::from),
            Self::I16 => each!(i16, f64::from),
            Self::U16 => each!(u16, f64::from),
            Self::I32 => each!(i32, f64::from),
            Self::U32 => each!(u32, f64::from),
            Self::I64 => each!(i64, |number| number as f64),
            Self::U64 => each!(u64, |number| number as f64),
            Self::F32 => each!(f32, f64::from),
            Self::F64 => each!(f64, f64::from),
        }
    }

    /// Calls `put` with each of the numbers stored one after the other in `block`.
    #[inline]
    pub(super) fn for_each_i64(self, order: ByteOrder, block: &[u8], mut put: impl FnMut(i64)) {
        macro_rules! each {
            ($number:ty, $convert:expr) => {
                for &bytes in block.as_chunks().0 {
                    put($convert(match order {
                        ByteOrder::Little => <$number>::from_le_bytes(bytes),
                        ByteOrder::Big => <$number>::from_be_bytes(bytes),
                    }));
                }
            };
        }
        match self {
            Self::I8 => each!(i8, i64::from),
            Self::U8 => each!(u8, i64::from),
            Self::I16 => each!(i16, i64::from),
            Self::U16 => each!(u16, i64::from),
            Self::I32 => each!(i32, i64::from),
            Self::U32 => each!(u32, i64::from),
            Self::I64 => each!(i64, i64::from),
            // Indices beyond 2^63 become negative, which is out of range as well.
            Self::U64 => each!(u64, |number| number as i64),
            Self::F32 => each!(f32, |number| number as i64),
            Self::F64 => each!(f64, |number| number as i64),
        }
    }
}

/// Where one field stands in records of equal length.
#[derive(Clone, Copy, Debug)]
pub(super) struct Column {
    /// Bytes from one record to the next, never 0.
    pub(super) stride: usize,
    /// Bytes from the start of the record; the field ends within `stride`.
    pub(super) offset: usize,
}
