//! Whole numbers that stand for something else: moments, durations, decimals.

/// What one unit of a whole number is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Scale {
    /// Itself.
    One,
    /// Itself, all 64 bits of it.
    Unsigned,
    /// One part of so many.
    Part(f64),
    /// A moment: a part of a second, counted from a moment that becomes 0.
    Since {
        /// The moment that becomes 0.
        origin: i64,
        /// Parts of a second.
        per_second: f64,
    },
}

impl Scale {
    /// The number that `raw` stands for. Moments are subtracted before they lose digits: nanoseconds since 1970 take more than
    /// the 53 bits of an f64.
    pub(super) fn number(self, raw: i64) -> f64 {
        match self {
            Self::One => raw as f64,
            Self::Unsigned => raw as u64 as f64,
            Self::Part(parts) => raw as f64 / parts,
            Self::Since { origin, per_second } => raw.saturating_sub(origin) as f64 / per_second,
        }
    }
}
