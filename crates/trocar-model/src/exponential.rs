//! exp(-x) for x >= 0 in plain arithmetic: the same bits everywhere, and short enough for the inner loop.
//!
//! A general exponential spends most of its time on cases that a decay cannot meet.

/// ln 2 in two parts; the first has zeros at its end, so that its product with a small integer is exact.
const LN_2_HIGH: f64 = f64::from_bits(0x3fe6_2e42_fee0_0000);
const LN_2_LOW: f64 = f64::from_bits(0x3dea_39ef_3579_3c76);

/// 1.5·2^52: adding and subtracting it rounds to the nearest integer.
const ROUNDER: f64 = 6_755_399_441_055_744.0;

/// Beyond this the result is below 1e-304; it counts as zero.
const LAST: f64 = 700.0;

/// 1/k!
const TAYLOR: [f64; 14] = [
    1.0,
    1.0,
    1.0 / 2.0,
    1.0 / 6.0,
    1.0 / 24.0,
    1.0 / 120.0,
    1.0 / 720.0,
    1.0 / 5_040.0,
    1.0 / 40_320.0,
    1.0 / 362_880.0,
    1.0 / 3_628_800.0,
    1.0 / 39_916_800.0,
    1.0 / 479_001_600.0,
    1.0 / 6_227_020_800.0,
];

/// exp(-x) for x >= 0, to two units in the last place; 0 above 700 and for NaN.
#[inline]
pub(crate) fn decay(x: f64) -> f64 {
    if x.is_nan() || x > LAST {
        return 0.0;
    }
    let shifted = -x * core::f64::consts::LOG2_E + ROUNDER;
    let n = shifted - ROUNDER;
    let r = (-x - n * LN_2_HIGH) - n * LN_2_LOW;
    // |r| <= ln(2)/2, where the series to degree 13 is good to 4e-18.
    let pair = |k: usize| TAYLOR[k] + TAYLOR[k + 1] * r;
    let (r2, r4) = (r * r, r * r * (r * r));
    let low = pair(0) + pair(2) * r2;
    let mid = pair(4) + pair(6) * r2;
    let high = (pair(8) + pair(10) * r2) + pair(12) * r4;
    let series = low + (mid + high * r4) * r4;
    // The low bits of `shifted` hold n as an integer; 2^n is built from them.
    series * f64::from_bits(shifted.to_bits().wrapping_add(1023) << 52)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_library() {
        for k in 0..70_000 {
            let x = f64::from(k) * 0.01 + 1e-7 * f64::from(k % 7);
            let truth = libm::exp(-x);
            assert!((decay(x) - truth).abs() <= 4.5e-16 * truth || x > LAST, "{x}");
        }
    }

    #[test]
    fn ends_are_clean() {
        assert_eq!(decay(0.0), 1.0);
        assert_eq!(decay(f64::INFINITY), 0.0);
        assert_eq!(decay(f64::NAN), 0.0);
        assert!((decay(1e-12) - (1.0 - 1e-12)).abs() < 1e-16);
    }
}
