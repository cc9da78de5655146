//! Random numbers of the bench: one ChaCha stream per source, so that disabling one source leaves
//! the others unchanged.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Use of a stream of random numbers; the discriminant is the ChaCha stream number.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Source {
    ForceSensor = 1,
    Encoder = 2,
    DriveSpeed = 3,
    StrokeLevel = 4,
    Ripple = 5,
    Movement = 6,
    Tremor = 7,
    RandomSeal = 8,
    SpeedOrder = 9,
    TurningPoint = 10,
    ToSlave = 11,
    ToMaster = 12,
    RemoteSensor = 13,
    Draws = 14,
    CompensatorDraws = 15,
}

/// One reproducible stream of uniform and normal numbers.
#[derive(Debug, Clone)]
pub(crate) struct Noise {
    generator: ChaCha8Rng,
    spare: Option<f64>,
}

impl Noise {
    pub(crate) fn new(seed: u64, source: Source) -> Self {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        generator.set_stream(source as u64);
        Self { generator, spare: None }
    }

    /// Uniform in [0, 1).
    pub(crate) fn unit(&mut self) -> f64 {
        // The 53 upper bits fill the mantissa: every result is exact on every machine.
        (self.generator.next_u64() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// Uniform in [low, high).
    pub(crate) fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Log-uniform in [low, high), both positive.
    pub(crate) fn log_uniform(&mut self, low: f64, high: f64) -> f64 {
        low * libm::pow(high / low, self.unit())
    }

    /// +1 or -1 with equal probability.
    pub(crate) fn sign(&mut self) -> f64 {
        if self.unit() < 0.5 { -1.0 } else { 1.0 }
    }

    /// Puts `values` in random order, each permutation with equal probability (Fisher-Yates).
    pub(crate) fn shuffle<T>(&mut self, values: &mut [T]) {
        for last in (1..values.len()).rev() {
            let other = (self.unit() * (last + 1) as f64) as usize;
            values.swap(last, other);
        }
    }

    /// Normal with mean 0 and standard deviation 1 (Box-Muller; `libm`, so the same bits on every
    /// machine).
    pub(crate) fn normal(&mut self) -> f64 {
        if let Some(spare) = self.spare.take() {
            return spare;
        }
        let radius = libm::sqrt(-2.0 * libm::log(1.0 - self.unit()));
        let (sine, cosine) = libm::sincos(core::f64::consts::TAU * self.unit());
        self.spare = Some(radius * sine);
        radius * cosine
    }
}
