//! Whether the positions were read later than the forces.
//!
//! A seal answers motion, never the other way round: a force that turns before the position does shows that the position
//! comes late (averaging, a slow line). How late is the delay at which a linear model of rate-independent friction,
//!
//! ```text
//! F = Σ_k a_k·z_k(x) + b·v + m·dv/dt + F_0(x) + level(x)·z_K(x)      z_k play operators of widths w_k (Maxwell-Slip)
//! ```
//! with F_0 and level straight between knots, is off least. It is linear in all its numbers, so every delay has one least
//! square. A force that comes *late* is not looked for: it may be the seal's own (damping, relaxation).

use nalgebra::{Cholesky, DMatrix, DVector};
use rayon::prelude::*;
use serde::Serialize;

use crate::recording::{Recording, local_acceleration, local_velocity};

/// Longest delay tried, s, and step between delays, s, or the sampling interval if that is longer.
const LONGEST: f64 = 0.12;
const STEP: f64 = 0.01;
/// Step between the delays tried with a full model, s.
const SETTLE_STEP: f64 = 0.02;
/// Least part by which the error falls with the delay: less may be friction that the linear model does not know.
const LEAST_GAIN: f64 = 0.02;
/// Delays whose error is within this part of the least are as good: the shortest is taken.
const AS_GOOD: f64 = 0.01;
/// Play operators, and their narrowest and widest half width as parts of the stroke.
const PLAYS: usize = 10;
const WIDTHS: [f64; 2] = [5e-4, 0.1];
/// The play whose level may vary along the way.
const LEVELLED: usize = 3;
/// Knots along the way.
const KNOTS: usize = 24;
/// Numbers of the model.
const NUMBERS: usize = PLAYS + 2 + 2 * KNOTS;
/// Most samples of one recording looked at.
const MOST_SAMPLES: usize = 10_000;
/// Window of velocity and acceleration, s.
const WINDOW: f64 = 0.05;

/// A delay of the position readings.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PositionLag {
    /// Time, s, by which the positions were read late.
    pub lag_s: f64,
    /// Least root mean square error, N, of the linear model, at the delay that it finds best.
    pub rms_n: f64,
    /// The same without a delay.
    pub rms_without_n: f64,
}

/// The delay of the positions in `recordings`, all from one bench; `None` when none shows.
pub fn position_lag(recordings: &[Recording]) -> Option<PositionLag> {
    let interval = recordings.iter().map(|r| r.quality.median_interval).fold(STEP, f64::max);
    let error = |k: usize| Some((k as f64 * interval, rms(recordings, k as f64 * interval)?));
    let (without, first) = (error(0)?, error(1)?);
    if first.1 >= without.1 {
        return None;
    }
    let tried: Vec<(f64, f64)> = (2..=(LONGEST / interval) as usize).map_while(error).collect();
    let all = || [without, first].into_iter().chain(tried.iter().copied());
    let least = all().map(|(_, rms)| rms).fold(f64::INFINITY, f64::min);
    let (lag_s, rms_n) = all().find(|(_, rms)| *rms <= (1.0 + AS_GOOD) * least)?;
    (rms_n < (1.0 - LEAST_GAIN) * without.1).then_some(PositionLag { lag_s, rms_n, rms_without_n: without.1 })
}

/// The delay with which a full model errs least, `found` without any: `error` gives its error (N) for a delay (s),
/// and the number of samples, those that are common to all delays ([`is_common`]).
pub(super) fn settle(found: PositionLag, error: impl Fn(f64) -> Option<(f64, usize)> + Sync) -> PositionLag {
    let delays: Vec<f64> = (0..=(LONGEST / SETTLE_STEP).round() as usize).map(|k| k as f64 * SETTLE_STEP).collect();
    let found_at: Vec<Option<(f64, usize)>> = delays.par_iter().map(|delay| error(*delay)).collect();
    // A model that never slides is scored on next to nothing.
    let most = found_at.iter().flatten().map(|(_, samples)| *samples).max().unwrap_or(0);
    let errors: Vec<f64> = found_at
        .iter()
        .map(|found| found.filter(|(_, samples)| 10 * samples >= 9 * most).map_or(f64::INFINITY, |(rms, _)| rms))
        .collect();
    let least = errors.iter().copied().fold(f64::INFINITY, f64::min);
    let first = errors.iter().position(|error| error.is_finite() && *error <= (1.0 + AS_GOOD) * least);
    PositionLag { lag_s: first.map_or(found.lag_s, |k| delays[k]), ..found }
}

/// Whether sample `i` of a stretch that ends at `last` (s), the delay `lag` taken out, is there for every delay tried.
pub(super) fn is_common(time: f64, last: f64, lag: f64) -> bool {
    time <= last - (LONGEST - lag)
}

/// Root mean square error, N, over all recordings, each with numbers of its own.
fn rms(recordings: &[Recording], lag: f64) -> Option<f64> {
    let (mut squares, mut samples) = (0.0, 0.0);
    for recording in recordings {
        let sums = Sums::of(&recording.with_position_lag(lag).ok()?, lag);
        squares += sums.least_squares()?;
        samples += sums.samples;
    }
    Some((squares / samples).sqrt())
}

/// Normal equations of the linear model.
struct Sums {
    matrix: DMatrix<f64>,
    vector: DVector<f64>,
    power: f64,
    samples: f64,
}

impl Sums {
    /// Of a recording whose delay `lag`, s, is taken out.
    fn of(recording: &Recording, lag: f64) -> Self {
        let (x, f) = (&recording.position, &recording.force);
        let (velocity, acceleration) = (local_velocity(recording, WINDOW), local_acceleration(recording, WINDOW));
        let size = |values: &[f64]| values.iter().fold(0.0_f64, |most, v| most.max(v.abs())).max(f64::MIN_POSITIVE);
        let (top, steepest) = (size(&velocity), size(&acceleration));
        let (low, high) = x.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
        let stroke = (high - low).max(f64::MIN_POSITIVE);
        let ratio = (WIDTHS[1] / WIDTHS[0]).powf(1.0 / (PLAYS - 1) as f64);
        let widths: [f64; PLAYS] = std::array::from_fn(|k| stroke * WIDTHS[0] * ratio.powi(k as i32));
        let mean = f.iter().sum::<f64>() / f.len() as f64;
        let stride = f.len().div_ceil(MOST_SAMPLES);
        let mut sums = Self {
            matrix: DMatrix::zeros(NUMBERS, NUMBERS),
            vector: DVector::zeros(NUMBERS),
            power: 0.0,
            samples: 0.0,
        };
        for range in recording.unbroken() {
            let last = recording.time[range.end - 1];
            let (mut plays, mut has_slid) = ([0.0; PLAYS], false);
            for i in range.start + 1..range.end {
                for (z, w) in plays.iter_mut().zip(&widths) {
                    *z = (*z + (x[i] - x[i - 1]) / w).clamp(-1.0, 1.0);
                }
                has_slid |= plays[PLAYS - 1].abs() >= 1.0;
                if has_slid && i % stride == 0 && is_common(recording.time[i], last, lag) {
                    let rates = [velocity[i] / top, acceleration[i] / steepest];
                    sums.add(&plays, rates, (x[i] - low) / stroke, f[i] - mean);
                }
            }
        }
        sums
    }

    fn add(&mut self, plays: &[f64; PLAYS], rates: [f64; 2], along: f64, force: f64) {
        let along = along * (KNOTS - 1) as f64;
        let knot = (along as usize).min(KNOTS - 2);
        let part = along - knot as f64;
        let own = plays.iter().chain(&rates).copied().enumerate();
        let hats = [(knot, 1.0 - part), (knot + 1, part)];
        let offsets = hats.map(|(k, hat)| (PLAYS + 2 + k, hat));
        let levels = hats.map(|(k, hat)| (PLAYS + 2 + KNOTS + k, hat * plays[LEVELLED]));
        let mut row = [(0, 0.0); PLAYS + 6];
        row.iter_mut().zip(own.chain(offsets).chain(levels)).for_each(|(slot, entry)| *slot = entry);
        for (i, a) in row {
            row.iter().for_each(|(j, b)| self.matrix[(i, *j)] += a * b);
            self.vector[i] += a * force;
        }
        self.power += force * force;
        self.samples += 1.0;
    }

    /// Least sum of squares, N²; `None` without samples.
    fn least_squares(&self) -> Option<f64> {
        // Decides only what the samples leave open.
        let ridge = DMatrix::from_diagonal_element(NUMBERS, NUMBERS, 1e-5 * self.samples);
        let found = Cholesky::new(&self.matrix + ridge)?.solve(&self.vector);
        Some((self.power - 2.0 * self.vector.dot(&found) + found.dot(&(&self.matrix * &found))).max(0.0))
    }
}
