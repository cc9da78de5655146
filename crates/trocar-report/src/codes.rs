//! Numbers as text in a page.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::{Serialize, Serializer};

/// Largest code of a value; the next code marks a gap.
const LARGEST_CODE: f64 = 65_534.0;

/// Values as 16-bit codes between `low` and `high`, in base64: a third of the size of decimal
/// numbers, and finer than a pixel at any zoom that the number of points allows.
#[derive(Serialize)]
pub(super) struct Codes {
    low: f64,
    high: f64,
    codes: String,
}

impl Codes {
    pub(super) fn new(values: impl Iterator<Item = f64> + Clone) -> Self {
        let finite = values.clone().filter(|value| value.is_finite());
        let (low, high) = finite
            .fold((f64::MAX, f64::MIN), |(low, high), value| (low.min(value), high.max(value)));
        let (low, high) = if low > high { (0.0, 0.0) } else { (low, high) };
        let step = if high > low { LARGEST_CODE / (high - low) } else { 0.0 };
        let codes = values.map(|value| match value.is_finite() {
            true => ((value - low) * step).round() as u16,
            false => u16::MAX,
        });
        let bytes: Vec<u8> = codes.flat_map(u16::to_le_bytes).collect();
        Self { low, high, codes: STANDARD.encode(bytes) }
    }
}

/// Serialises a column of numbers as [`Codes`].
pub(super) fn codes<S: Serializer>(values: &[f64], serializer: S) -> Result<S::Ok, S::Error> {
    Codes::new(values.iter().copied()).serialize(serializer)
}

/// 64-bit numbers, little endian, base64: exact, including infinite ones.
pub(super) fn encoded(row: &[f64]) -> String {
    let bytes: Vec<u8> = row.iter().flat_map(|number| number.to_le_bytes()).collect();
    STANDARD.encode(bytes)
}

/// Serialises a model's numbers as [`encoded`].
pub(super) fn numbers<S: Serializer>(row: &[f64], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(&encoded(row))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_return_the_values_and_the_gaps() {
        let values = [-3.25, 0.0, f64::NAN, 7.5, f64::INFINITY];
        let codes = Codes::new(values.iter().copied());
        let bytes = STANDARD.decode(&codes.codes).expect("base64");
        for (pair, value) in bytes.chunks(2).zip(values) {
            let code = u16::from_le_bytes([pair[0], pair[1]]);
            if value.is_finite() {
                let read = codes.low + f64::from(code) / LARGEST_CODE * (codes.high - codes.low);
                assert!((read - value).abs() < 1e-4, "{value} came back as {read}");
            } else {
                assert_eq!(code, u16::MAX);
            }
        }
    }
}
