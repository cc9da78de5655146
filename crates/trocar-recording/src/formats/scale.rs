//! Integers and bytes that represent other quantities: timestamps, durations, decimals, half
//! floats.

/// Meaning of one unit of an integer, or of some bytes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Scale {
    /// The integer itself.
    One,
    /// The integer itself, as unsigned 64 bits.
    Unsigned,
    /// A fraction with this denominator.
    Part(f64),
    /// Bytes that are a whole number in big endian: a fraction with this denominator.
    #[cfg(feature = "parquet")]
    Decimal(f64),
    /// Two bytes that are a float of 16 bits in little endian.
    #[cfg(feature = "parquet")]
    Half,
    /// A timestamp: in fractions of a second, counted from an origin.
    Since {
        /// The timestamp that becomes 0.
        origin: i64,
        /// Units per second.
        per_second: f64,
    },
}

impl Scale {
    /// The number that `raw` represents. The origin is subtracted before digits are lost:
    /// nanoseconds since 1970 need more than the 53 bits of an f64.
    pub(super) fn number(self, raw: i64) -> f64 {
        match self {
            Self::One => raw as f64,
            Self::Unsigned => raw as u64 as f64,
            Self::Part(parts) => raw as f64 / parts,
            #[cfg(feature = "parquet")]
            Self::Decimal(parts) => raw as f64 / parts,
            #[cfg(feature = "parquet")]
            Self::Half => raw as f64,
            Self::Since { origin, per_second } => raw.saturating_sub(origin) as f64 / per_second,
        }
    }
    /// The number that `bytes` represent.
    #[cfg(feature = "parquet")]
    pub(super) fn number_of(self, bytes: &[u8]) -> f64 {
        match (self, bytes) {
            (Self::Half, &[low, high]) => half(u16::from_le_bytes([low, high])),
            (Self::Decimal(parts), [first, rest @ ..]) => {
                let whole = match rest.len() {
                    ..16 => rest
                        .iter()
                        .fold(i128::from(first.cast_signed()), |n, b| n << 8 | i128::from(*b))
                        as f64,
                    _ => rest
                        .iter()
                        .fold(f64::from(first.cast_signed()), |n, b| 256.0 * n + f64::from(*b)),
                };
                whole / parts
            }
            _ => f64::NAN,
        }
    }
}

/// A float of 16 bits: a sign, 5 bits of exponent, 10 of fraction.
#[cfg(feature = "parquet")]
fn half(bits: u16) -> f64 {
    let (exponent, fraction) = (i32::from(bits >> 10 & 31), f64::from(bits & 1023));
    let size = match exponent {
        0 => fraction * 2_f64.powi(-24),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        _ => (1024.0 + fraction) * 2_f64.powi(exponent - 25),
    };
    if bits >> 15 == 1 { -size } else { size }
}

#[cfg(all(test, feature = "parquet"))]
mod tests {
    use super::*;

    #[test]
    fn half_floats_are_those_of_ieee_754() {
        for (bits, number) in [
            (0x3c00, 1.0),
            (0xc000, -2.0),
            (0x7bff, 65_504.0),
            (0x0001, 5.960_464_477_539_063e-8),
            (0x0400, 6.103_515_625e-5),
            (0xfc00, f64::NEG_INFINITY),
            (0x3555, 0.333_251_953_125),
        ] {
            assert_eq!(half(bits), number, "{bits:#x}");
        }
        assert!(half(0x7e00).is_nan());
    }

    #[test]
    fn decimals_of_any_length_keep_their_sign() {
        let hundredths = Scale::Decimal(100.0);
        for length in [1, 2, 9, 16, 17, 32] {
            let mut bytes = vec![0; length];
            bytes[length - 1] = 100;
            assert_eq!(hundredths.number_of(&bytes), 1.0, "{length}");
            bytes.fill(0xff);
            assert_eq!(hundredths.number_of(&bytes), -0.01, "{length}");
        }
        assert!(hundredths.number_of(&[]).is_nan());
    }
}
