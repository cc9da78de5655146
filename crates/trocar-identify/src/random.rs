//! Seeded random numbers of the identification.

use rand::{Rng, RngExt};

/// A standard normal number (polar method of Marsaglia).
pub(super) fn normal(rng: &mut impl Rng) -> f64 {
    loop {
        let (a, b) = (2.0 * rng.random::<f64>() - 1.0, 2.0 * rng.random::<f64>() - 1.0);
        let s: f64 = a * a + b * b;
        if s > 0.0 && s < 1.0 {
            return a * (-2.0 * s.ln() / s).sqrt();
        }
    }
}
