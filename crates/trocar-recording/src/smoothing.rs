//! The motion between the counts of an encoder.
//!
//! ```text
//! y_i = x(t_i) + ε_i        d³x/dt³ = w(t)        ε_i ~ N(0, r²)        w ~ white noise of intensity q(t)
//! r = step/√12        q_i = mean over a few samples of E[(a_i − a_(i−1))² | y]/(t_i − t_(i−1))
//! ```
//! Given q, a Kalman filter and its smoother (RAUCH) give the expected position, velocity and
//! acceleration a at every sample, and their variances. q is their own maximum likelihood estimate
//! (expectation maximisation, SHUMWAY), in a few rounds: large where the instrument turns or is
//! pushed, tiny where it slides at constant speed, so neither is blurred for the other. Readings as
//! such would bias what depends on the velocity from one sample to the next: the viscous damping,
//! and where a seal whose friction falls with speed begins to stick. Scatter beyond the rounding stays:
//! it may be that of the clock (ZILLEN: milliseconds in which the instrument moves 10 µm), and then the
//! readings are the positions at which the force was read.

use std::borrow::Cow;
use std::ops::Range;

use nalgebra::{Matrix3, RowVector3, Vector3};
use rayon::prelude::*;

use super::Recording;

/// Samples over which the readings tell the position where q is what the first round begins with, and
/// rounds: with twice as many samples, or with six or twenty rounds, positions err by at most a tenth more.
const BEGIN: f64 = 10.0;
const ROUNDS: usize = 10;
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
    /// The recording with the expected positions, and their error as noise; itself where the readings
    /// are not rounded, or are smoothed.
    #[must_use]
    pub fn smoothed(&self) -> Cow<'_, Self> {
        let quality = &self.quality;
        let error = quality.position_resolution / 12_f64.sqrt();
        if error == 0.0 || quality.smoothed {
            return Cow::Borrowed(self);
        }
        let pieces: Vec<(Range<usize>, Range<usize>)> = self.unbroken().flat_map(pieces).collect();
        let smooth = |(piece, with): (Range<usize>, Range<usize>)| {
            let states = expected(&self.time[with.clone()], &self.position[with.clone()], error);
            let own = states.iter().skip(piece.start - with.start).zip(&self.position[piece]);
            // An interval whose fifth power is no number shows nothing beside its reading.
            let place = |(state, reading): (&State, &f64)| match state.0[0] {
                place if place.is_finite() => (place, state.1[(0, 0)]),
                _ => (*reading, error * error),
            };
            own.map(place).collect()
        };
        let pieces: Vec<Vec<(f64, f64)>> = pieces.into_par_iter().map(smooth).collect();
        let mut out = self.clone();
        out.position = pieces.iter().flatten().map(|own| own.0).collect();
        let variance: f64 = pieces.iter().flatten().map(|own| own.1).sum();
        let beyond = (quality.position_noise.powi(2) - error.powi(2)).max(0.0);
        out.quality.position_noise = (variance / self.len().max(1) as f64 + beyond).sqrt();
        out.quality.smoothed = true;
        Cow::Owned(out)
    }
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
    let mut intensity = vec![error.powi(2) / (BEGIN * interval).powi(5); count];
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

/// Means over a few values on either side of each.
fn averaged(values: &[f64]) -> Vec<f64> {
    let around = |k: usize| &values[k.saturating_sub(AROUND)..(k + AROUND + 1).min(values.len())];
    (0..values.len()).map(|k| around(k).iter().sum::<f64>() / around(k).len() as f64).collect()
}
