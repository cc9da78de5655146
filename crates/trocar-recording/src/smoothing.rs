//! The motion between the counts of an encoder.
//!
//! ```text
//! y_i = x(t_i) + ε_i        d³x/dt³ = w(t)        ε_i ~ N(0, r²)        w ~ white noise of intensity q(t)
//! r = step/√12        q_i = Σ E[(a_i − a_(i−1))² | y]/(t_i − t_(i−1)) over n samples, divided by n + 1
//! ```
//! Given q, a Kalman filter and its smoother (RAUCH) give the expected position, velocity and
//! acceleration a at every sample, and their variances. √q is its most likely value given these states
//! and the prior of a scale (JEFFREYS), by expectation maximisation (SHUMWAY): large where the instrument
//! turns or is pushed, tiny where it slides at constant speed, so neither is blurred for the other.
//! Readings as such would bias what depends on the velocity from one sample to the next: the viscous damping,
//! and where a seal whose friction falls with speed begins to stick. Scatter beyond the rounding stays:
//! it may be that of the clock (ZILLEN: milliseconds in which the instrument moves 10 µm), and then the
//! readings are the positions at which the force was read.

use std::borrow::Cow;
use std::ops::Range;

use nalgebra::{Matrix3, RowVector3, Vector3};
use rayon::prelude::*;

use super::motion::local_acceleration;
use super::{Quality, Recording, cancel};

/// Step of the positions, m, from which it matters: 0.2 % of the smallest half widths in use.
pub const COARSE: f64 = 2e-5;

/// Samples, and time in s, over which the readings tell the position where q is what the first round
/// begins with, the longer of both; and rounds. q grows faster than it falls: from ten samples, what is
/// sampled at 5 kHz or more would keep so much of it that accelerations are noise.
const BEGIN: f64 = 10.0;
const BEGIN_TIME: f64 = 0.01;
const ROUNDS: usize = 20;
/// Samples on either side over which q is averaged.
const AROUND: usize = 3;
/// Variances of a motion of which nothing is known: of the velocity, m²/s², and of the acceleration, m²/s⁴.
const SPEED: f64 = 10.0;
const ACCELERATION: f64 = 1e4;
/// Samples smoothed at a time, and on either side of them those that these need: states of all samples
/// take four times the memory of time, position and force.
const AT_A_TIME: usize = 4096;
const BESIDE: usize = 512;

/// Position, velocity and acceleration, and their covariance.
type State = (Vector3<f64>, Matrix3<f64>);

impl Recording {
    /// Step of the positions, m; 0 where it does not matter.
    #[must_use]
    pub fn coarse_step(&self) -> f64 {
        Some(self.quality.position_resolution).filter(|step| *step >= COARSE).unwrap_or(0.0)
    }

    /// Scatter of the positions, m. Of expected positions 0 unless it exceeds a count: below that it is
    /// the rounding, and some of the motion.
    #[must_use]
    pub fn position_noise(&self) -> f64 {
        let Quality { position_noise, position_resolution, .. } = self.quality;
        let is_smoothed = self.expected_acceleration.is_some();
        if is_smoothed && position_noise < position_resolution { 0.0 } else { position_noise }
    }

    /// The recording with the expected positions and accelerations; itself where the readings are not
    /// rounded, or are smoothed. Its quality stays that of the readings.
    #[must_use]
    pub fn smoothed(&self) -> Cow<'_, Self> {
        match self.is_smooth() {
            true => Cow::Borrowed(self),
            false => Cow::Owned(self.as_expected(rounding(&self.quality))),
        }
    }

    /// Whether [`Recording::smoothed`] is the recording itself.
    #[must_use]
    pub fn is_smooth(&self) -> bool {
        rounding(&self.quality) == 0.0 || self.expected_acceleration.is_some()
    }

    /// The same of a recording that is not needed any more.
    #[must_use]
    pub fn into_smoothed(self) -> Self {
        if self.is_smooth() { self } else { self.as_expected(rounding(&self.quality)) }
    }

    /// Acceleration in m/s² at every sample, as it acts on a mass: the mean of the expected one, which is
    /// too smooth where the instrument is pushed, and that of the parabola over five of the expected
    /// positions, which is too rough; of positions without scatter, the parabola alone. Scatter of more than a count is
    /// taken out here: it would bias a mass that is fitted to the accelerations towards zero (errors in
    /// variables).
    #[must_use]
    pub fn acceleration(&self) -> Vec<f64> {
        let mut smooth = self.smoothed();
        let scatter = smooth.position_noise();
        if scatter > 0.0 {
            smooth = Cow::Owned(smooth.as_expected(scatter));
        }
        let mut mean = local_acceleration(&smooth, 0.0);
        let expected = smooth.expected_acceleration.iter().flatten();
        let both = mean.iter_mut().zip(expected).filter(|(_, expected)| expected.is_finite());
        both.for_each(|(mean, expected)| *mean = 0.5 * (*mean + expected));
        mean
    }

    /// With the expected positions and accelerations, given readings that err by `error`, m rms.
    fn as_expected(&self, error: f64) -> Self {
        let (position, acceleration) = self.expected(error);
        Self { position, expected_acceleration: Some(acceleration), ..self.clone() }
    }

    /// The expected positions, m, and accelerations, m/s², given readings that err by `error`, m rms.
    fn expected(&self, error: f64) -> (Vec<f64>, Vec<f64>) {
        let pieces: Vec<(Range<usize>, Range<usize>)> = self.unbroken().flat_map(pieces).collect();
        let smooth = |(piece, with): &(Range<usize>, Range<usize>)| {
            cancel::check();
            let states = expected(&self.time[with.clone()], &self.position[with.clone()], error);
            let own =
                states.iter().skip(piece.start - with.start).zip(&self.position[piece.clone()]);
            // An interval whose fifth power is no number shows nothing beside its reading.
            let place = |((mean, _), reading): (&State, &f64)| {
                (if mean[0].is_finite() { mean[0] } else { *reading }, mean[2])
            };
            own.map(place).collect::<Vec<_>>()
        };
        pieces.par_iter().flat_map_iter(smooth).unzip()
    }
}

/// Standard deviation of the rounding to counts, m.
fn rounding(quality: &Quality) -> f64 {
    quality.position_resolution / 12_f64.sqrt()
}

/// An unbroken part in pieces, each with those samples beside it that are smoothed with it.
fn pieces(part: Range<usize>) -> impl Iterator<Item = (Range<usize>, Range<usize>)> {
    part.clone().step_by(AT_A_TIME).map(move |start| {
        let end = (start + AT_A_TIME).min(part.end);
        let with = start.saturating_sub(BESIDE).max(part.start)..(end + BESIDE).min(part.end);
        (start..end, with)
    })
}

/// The expected states given all readings.
fn expected(time: &[f64], position: &[f64], error: f64) -> Vec<State> {
    let count = time.len();
    let interval = (time[count - 1] - time[0]) / (count - 1).max(1) as f64;
    let begin = (BEGIN * interval).max(BEGIN_TIME);
    let mut intensity = vec![error.powi(2) / begin.powi(5); count];
    let mut states = Vec::new();
    for _ in 0..ROUNDS {
        let filtered = filtered(time, position, error, &intensity);
        let jerk;
        (states, jerk) = smoothed(time, filtered, &intensity);
        intensity = averaged(&jerk);
    }
    states
}

/// The motion over `duration`, s, at constant acceleration.
fn transition(duration: f64) -> Matrix3<f64> {
    let h = duration;
    Matrix3::new(1.0, h, 0.5 * h * h, 0.0, 1.0, h, 0.0, 0.0, 1.0)
}

/// The state after `duration`, s, from that before.
fn predicted((mean, variance): &State, duration: f64, intensity: f64) -> State {
    let (h, over) = (duration, transition(duration));
    let by = |power: i32, part: f64| intensity * h.powi(power) / part;
    let [x, xv, xa] = [by(5, 20.0), by(4, 8.0), by(3, 6.0)];
    let [v, va, a] = [by(3, 3.0), by(2, 2.0), by(1, 1.0)];
    let added = Matrix3::new(x, xv, xa, xv, v, va, xa, va, a);
    (over * mean, over * variance * over.transpose() + added)
}

/// The states given the readings up to each.
fn filtered(time: &[f64], position: &[f64], error: f64, intensity: &[f64]) -> Vec<State> {
    let mut states: Vec<State> = Vec::with_capacity(time.len());
    for k in 0..time.len() {
        let (mut mean, mut variance) = match states.last() {
            Some(last) => predicted(last, time[k] - time[k - 1], intensity[k]),
            None => {
                let unknown = Vector3::new((100.0 * error).powi(2), SPEED, ACCELERATION);
                (Vector3::new(position[0], 0.0, 0.0), Matrix3::from_diagonal(&unknown))
            }
        };
        let row: RowVector3<f64> = variance.row(0).into_owned();
        let gain = row.transpose() / (row[0] + error * error);
        mean += gain * (position[k] - mean[0]);
        variance -= gain * row;
        states.push((mean, 0.5 * (variance + variance.transpose())));
    }
    states
}

/// The states given all readings, from those given the readings up to each, and E[(Δa)²]/Δt before each.
fn smoothed(time: &[f64], mut states: Vec<State>, intensity: &[f64]) -> (Vec<State>, Vec<f64>) {
    let mut jerk = vec![0.0; time.len()];
    for k in (1..time.len()).rev() {
        let (duration, after) = (time[k] - time[k - 1], states[k]);
        let (mean, variance) = predicted(&states[k - 1], duration, intensity[k]);
        let Some(inverse) = variance.try_inverse() else { continue };
        let own = states[k - 1];
        let gain = own.1 * transition(duration).transpose() * inverse;
        let both = gain * after.1;
        let before = (
            own.0 + gain * (after.0 - mean),
            own.1 + gain * (after.1 - variance) * gain.transpose(),
        );
        let change = after.0[2] - before.0[2];
        let variance = after.1[(2, 2)] + before.1[(2, 2)] - 2.0 * both[(2, 2)];
        jerk[k] = (change * change + variance.max(0.0)) / duration;
        states[k - 1] = before;
    }
    if let [first, second, ..] = &mut jerk[..] {
        *first = *second;
    }
    (states, jerk)
}

/// The most likely squares of the scale of the jerk, from a few values on either side of each.
fn averaged(values: &[f64]) -> Vec<f64> {
    let around = |k: usize| &values[k.saturating_sub(AROUND)..(k + AROUND + 1).min(values.len())];
    (0..values.len())
        .map(|k| around(k).iter().sum::<f64>() / (around(k).len() + 1) as f64)
        .collect()
}
