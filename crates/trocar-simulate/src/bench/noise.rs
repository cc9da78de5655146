//! Random numbers of the bench: one ChaCha stream per source, so that disabling one source leaves
//! the others unchanged.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Use of a stream of random numbers; the discriminant is the ChaCha stream number.
#[derive(Debug, Clone, Copy)]
pub enum Source {
    /// Noise of the force sensor.
    ForceSensor = 1,
    /// Noise of the encoder.
    Encoder = 2,
    /// Fluctuation of the drive's speed.
    DriveSpeed = 3,
    /// Friction level of each stroke.
    StrokeLevel = 4,
    /// Ripple of the drive.
    Ripple = 5,
    /// Movements of a hand.
    Movement = 6,
    /// Tremor of a hand.
    Tremor = 7,
    /// A random seal.
    RandomSeal = 8,
    /// Order of speeds.
    SpeedOrder = 9,
    /// Turning points of strokes.
    TurningPoint = 10,
    /// Jitter and loss of the channel to the follower.
    ToFollower = 11,
    /// The same to the leader.
    ToLeader = 12,
    /// Noise of the sensor of a teleoperated instrument.
    RemoteSensor = 13,
    /// Draws of the trocar.
    Draws = 14,
    /// Draws of the model in the compensator.
    CompensatorDraws = 15,
    /// Noise of the torque sensor.
    TorqueSensor = 16,
}

/// One reproducible stream of uniform and normal numbers.
#[derive(Debug, Clone)]
pub struct Noise {
    generator: ChaCha8Rng,
    spare: Option<f64>,
}

impl Noise {
    /// The stream of `source` with a seed.
    pub fn new(seed: u64, source: Source) -> Self {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        generator.set_stream(source as u64);
        Self { generator, spare: None }
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
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
    pub fn normal(&mut self) -> f64 {
        if let Some(spare) = self.spare.take() {
            return spare;
        }
        let radius = libm::sqrt(-2.0 * libm::log(1.0 - self.unit()));
        let (sine, cosine) = libm::sincos(core::f64::consts::TAU * self.unit());
        self.spare = Some(radius * sine);
        radius * cosine
    }
}
