//! exp(-x) for x >= 0, ln and powers in plain arithmetic: the same bits everywhere, and short
//! enough for the inner loop.
//!
//! General functions spend most of their time on cases and last digits that friction does not need.

/// ln 2 in two parts; the first has zeros at its end, so that its product with a small integer is
/// exact.
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
    decay_inlined(x)
}

/// The same within a loop that is to become vectors.
#[inline(always)]
pub(crate) fn decay_inlined(x: f64) -> f64 {
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

/// Below this x the mean of exp(-x) is taken from its series.
const SHORT: f64 = 1.0 / 64.0;

/// exp(-x), and its mean over 0 to x, (1 - exp(-x))/x, for x >= 0.
#[inline(always)]
pub(crate) fn decay_and_mean(x: f64) -> (f64, f64) {
    if x < SHORT {
        // The series to x^5 is good to the last bit.
        let high = 1.0 / 24.0 - x * (1.0 / 120.0 - x * (1.0 / 720.0));
        let mean = 1.0 - x * (0.5 - x * (1.0 / 6.0 - x * high));
        (1.0 - x * mean, mean)
    } else {
        let left = decay(x);
        (left, (1.0 - left) / x)
    }
}

/// atanh(s)/s in powers of s²: 1/(2k + 1).
const INVERSE_ODD: [f64; 12] = [
    1.0,
    1.0 / 3.0,
    1.0 / 5.0,
    1.0 / 7.0,
    1.0 / 9.0,
    1.0 / 11.0,
    1.0 / 13.0,
    1.0 / 15.0,
    1.0 / 17.0,
    1.0 / 19.0,
    1.0 / 21.0,
    1.0 / 23.0,
];

/// ln x for normal x > 0, to 5e-16 of max(1, |ln x|).
#[inline]
pub(crate) fn logarithm(x: f64) -> f64 {
    /// Bits of the mantissa of √½: what lies above counts to the next power of two.
    const ROOT: u64 = 0x3fe6_a09e_667f_3bcd;
    let bits = x.to_bits();
    let exponent = (bits.wrapping_sub(ROOT) as i64) >> 52;
    let m = f64::from_bits(bits.wrapping_sub((exponent << 52) as u64));
    let n = exponent as f64;
    // m in [√½, √2)
    (n * LN_2_LOW + twice_atanh((m - 1.0) / (m + 1.0))) + n * LN_2_HIGH
}

/// 2·atanh(s) for |s| <= 0.1716, where the series to s^23 is good to 4e-18.
#[inline]
fn twice_atanh(s: f64) -> f64 {
    let q = s * s;
    let pair = |k: usize| INVERSE_ODD[k] + INVERSE_ODD[k + 1] * q;
    let (q2, q4) = (q * q, q * q * (q * q));
    let low = pair(0) + pair(2) * q2;
    let mid = pair(4) + pair(6) * q2;
    let high = pair(8) + pair(10) * q2;
    2.0 * s * (low + (mid + high * q4) * q4)
}

/// ln(1 + x) for normal 1 + x > 0, to 1e-15 of itself.
#[inline]
pub(crate) fn logarithm_of_one_plus(x: f64) -> f64 {
    // Where 1 + x would lose digits of x, the series takes x itself.
    if x.abs() < 0.25 { twice_atanh(x / (2.0 + x)) } else { logarithm(1.0 + x) }
}

/// x^p for x >= 0, to about 6e-16·max(2, |p·ln x|) of itself; 0 below 1e-304, infinite above 1e304.
#[inline]
pub(crate) fn power(x: f64, p: f64) -> f64 {
    if x < f64::MIN_POSITIVE {
        return if p < 0.0 { f64::INFINITY } else { 0.0 };
    }
    if x > f64::MAX {
        return if p < 0.0 { 0.0 } else { x };
    }
    let exponent = p * logarithm(x);
    if exponent < 0.0 { decay(-exponent) } else { 1.0 / decay(exponent) }
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
    fn powers_agree_with_the_library() {
        for k in 1..40_000 {
            let x = libm::exp(f64::from(k % 400) * 0.1 - 20.0) * (1.0 + 1e-5 * f64::from(k));
            let p = 1e-3 * f64::from(k);
            let truth = libm::pow(x, p);
            let exponent = (p * libm::log(x)).abs();
            let error = (power(x, p) - truth).abs();
            assert!(
                exponent > LAST || error <= 6e-16 * exponent.max(2.0) * truth,
                "{x}^{p}: {error}"
            );
        }
        for k in -999..4000 {
            let x = f64::from(k) * 1e-3 + 1e-9;
            let truth = libm::log1p(x);
            assert!((logarithm_of_one_plus(x) - truth).abs() <= 1e-15 * truth.abs(), "ln(1 + {x})");
        }
        assert_eq!((power(1.0, 3.7), power(0.0, 0.5)), (1.0, 0.0));
        assert_eq!(power(f64::MAX, 2.0), f64::INFINITY);
    }

    #[test]
    fn means_agree_with_the_library() {
        for k in -60..30 {
            let x = libm::exp(0.5 * f64::from(k));
            let (left, mean) = decay_and_mean(x);
            let truth = -libm::expm1(-x) / x;
            assert!((mean - truth).abs() <= 2e-14 * truth, "{x}: {mean}, expected {truth}");
            assert!((left - libm::exp(-x)).abs() <= 3e-16, "{x}");
        }
        assert_eq!((decay_and_mean(0.0), decay_and_mean(f64::INFINITY)), ((1.0, 1.0), (0.0, 0.0)));
    }

    #[test]
    fn ends_are_clean() {
        assert_eq!(decay(0.0), 1.0);
        assert_eq!(decay(f64::INFINITY), 0.0);
        assert_eq!(decay(f64::NAN), 0.0);
        assert!((decay(1e-12) - (1.0 - 1e-12)).abs() < 1e-16);
    }
}
