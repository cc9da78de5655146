//! Integers that represent other quantities: timestamps, durations, decimals.

/// Meaning of one unit of an integer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Scale {
    /// The integer itself.
    One,
    /// The integer itself, as unsigned 64 bits.
    Unsigned,
    /// A fraction with this denominator.
    Part(f64),
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
            Self::Since { origin, per_second } => raw.saturating_sub(origin) as f64 / per_second,
        }
    }
}
