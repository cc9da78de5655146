//! Slow changes of a seal's force, which make repeated strokes differ as on a real rig.

use super::config::Fluctuation;
use super::noise::{Noise, Source};

/// A reversal begins a new stroke after this much travel back, m, so that tremor does not.
const STROKE_HYSTERESIS: f64 = 0.002;
/// Knots of the ripple per correlation length; it is linear between knots.
const KNOTS_PER_LENGTH: f64 = 10.0;

/// Factor on the seal force at `time`, s after the first sample: linear from 1 to its final value,
/// then constant.
pub(super) fn drift(config: &Fluctuation, time: f64) -> f64 {
    1.0 + config.drift_fraction * (time / config.drift_time_s).clamp(0.0, 1.0)
}

/// Factor on the seal force as a function of the travelled distance.
///
/// The factor is 1 + level + ripple. Each stroke draws a new level, which replaces the last one
/// gradually over the travel, so the force never jumps. The ripple is a Gaussian process over the
/// travelled distance, low-pass filtered twice. It depends on the distance and not on the position,
/// because a rod returns rotated and wetted differently. So it averages out over strokes and is not
/// a systematic error of all of them.
#[derive(Debug)]
pub(super) struct SealLevel {
    config: Fluctuation,
    level_noise: Noise,
    ripple_noise: Noise,
    level: f64,
    target: f64,
    turning_point: f64,
    direction: f64,
    filter: [f64; 2],
    knots: (f64, f64),
    along: f64,
}

impl SealLevel {
    pub(super) fn new(config: &Fluctuation, position: f64, seed: u64) -> Self {
        let mut level_noise = Noise::new(seed, Source::StrokeLevel);
        let level = config.stroke_fraction * level_noise.normal();
        let mut ripple = Self {
            config: config.clone(),
            level_noise,
            ripple_noise: Noise::new(seed, Source::Ripple),
            level,
            target: level,
            turning_point: position,
            direction: 0.0,
            filter: [0.0; 2],
            knots: (0.0, 0.0),
            along: 0.0,
        };
        // Ten correlation lengths bring the filter into its stationary distribution.
        for _ in 0..(10.0 * KNOTS_PER_LENGTH) as usize {
            ripple.next_knot();
        }
        ripple
    }

    /// Advances by `displacement` to `position` and returns the factor there.
    pub(super) fn advance(&mut self, displacement: f64, position: f64) -> f64 {
        self.watch_strokes(position);
        let travel = displacement.abs();
        // First order in the travel of one step, which is a few micrometres compared with
        // millimetres.
        self.level += (self.target - self.level) * (travel / self.config.stroke_travel_m).min(1.0);
        self.along += travel * KNOTS_PER_LENGTH / self.config.ripple_length_m;
        while self.along >= 1.0 {
            self.along -= 1.0;
            self.next_knot();
        }
        let (last, next) = self.knots;
        let ripple = self.config.ripple_fraction * (last + (next - last) * self.along);
        1.0 + self.level + ripple
    }

    fn watch_strokes(&mut self, position: f64) {
        let beyond = (position - self.turning_point) * self.direction;
        if beyond >= 0.0 && self.direction != 0.0 {
            self.turning_point = position;
        } else if (position - self.turning_point).abs() > STROKE_HYSTERESIS {
            self.direction = (position - self.turning_point).signum();
            self.turning_point = position;
            self.target = self.config.stroke_fraction * self.level_noise.normal();
        }
    }

    fn next_knot(&mut self) {
        let a = libm::exp(-2.0 / KNOTS_PER_LENGTH);
        self.filter[0] = a * self.filter[0] + (1.0 - a) * self.ripple_noise.normal();
        self.filter[1] = a * self.filter[1] + (1.0 - a) * self.filter[0];
        // Variance of two equal first-order filters in series driven by unit white noise:
        // (1−a)⁴ (1+a²) / (1−a²)³.
        let squared = a * a;
        let variance = libm::pow(1.0 - a, 4.0) * (1.0 + squared) / libm::pow(1.0 - squared, 3.0);
        self.knots = (self.knots.1, self.filter[1] / libm::sqrt(variance));
    }
}
