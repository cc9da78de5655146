//! Velocity and acceleration from positions by a local quadratic fit, for even and uneven sampling.
//!
//! ```text
//! x(t) ~ a0 + a1 (t - t_i) + a2 (t - t_i)^2   least squares over |t - t_i| <= window / 2
//! velocity = a1, acceleration = 2 a2
//! ```
//! The window never crosses a gap or a reset, and is extended if it contains fewer than five
//! samples. For even sampling the fit passes half of the power at 0.86 / window Hz for the
//! acceleration and 0.58 / window Hz for the velocity. At the ends of an unbroken part the window
//! is one-sided and the noise several times larger.

use std::collections::VecDeque;
use std::iter::successors;
use std::ops::Range;

use rayon::prelude::*;

use super::Recording;

/// Fewest samples in a window: two more than the coefficients.
const FEWEST: usize = 5;

/// Windows tried for the acceleration: from five samples, each longer than the last by this factor.
const WINDOW_STEP: f64 = std::f64::consts::SQRT_2;

/// Longest window tried, in s: forces on an instrument change faster.
const LONGEST_WINDOW: f64 = 0.5;

/// Width of the wider window, with which an acceleration is distinguished from noise, in windows.
const WIDER: f64 = 4.0;

/// Mean square, in noise variances, above which the two windows differ by more than noise.
const ABOVE_NOISE: f64 = 3.0;

/// Most noise that the inertia which is subtracted adds to a single force, in units of its own
/// noise: with this much it grows by an eighth, and what swings is still the force.
const ADDED: f64 = 0.5;

/// Windows whose accelerations are in memory at once: each is as long as the recording.
const AT_A_TIME: usize = 4;

/// Velocity in m/s at every sample, from the positions over `window` seconds.
#[must_use]
pub fn local_velocity(recording: &Recording, window: f64) -> Vec<f64> {
    local_fit(recording, window, |fit| fit.slope)
}

/// Acceleration in m/s^2 at every sample, from the positions over `window` seconds.
#[must_use]
pub fn local_acceleration(recording: &Recording, window: f64) -> Vec<f64> {
    local_fit(recording, window, |fit| 2.0 * fit.curvature)
}

impl Recording {
    /// Acceleration in m/s^2 at every sample, as it acts on a mass.
    ///
    /// The local fit over the window of least error where it differs by more than noise
    /// from the fit over a window four times as wide, and the latter elsewhere. With `d` the
    /// difference, `<d^2>` its mean square over the wider window and V the noise variance of the
    /// narrower fit,
    ///
    /// ```text
    /// a = a_wide + d max(0, 1 - (3 V / <d^2>)^2)
    /// ```
    /// Without this, noise in the accelerations would bias a mass fitted to them towards zero
    /// (errors in variables). Pulses blurred by the window are scaled by the ratio found with a
    /// window of a third of its length (regression calibration).
    #[must_use]
    pub fn acceleration(&self) -> Vec<f64> {
        let window = self.acceleration_window();
        let (narrow, mut best) = rayon::join(
            || local_acceleration(self, window),
            || local_acceleration(self, WIDER * window),
        );
        let noise = ABOVE_NOISE * self.acceleration_variance(self.samples_in(window));
        let around = (self.samples_in(WIDER * window) / 2.0) as usize;
        refine(&mut best, &narrow, around, noise);
        let factor = self.left_by_blur(&best, window);
        best.iter_mut().for_each(|a| *a *= factor);
        best
    }

    /// Acceleration in m/s^2 for a known mass in kg, whose inertia is to be subtracted from a force.
    /// The subtraction may add `noise`, N rms.
    ///
    /// `signal`, which is [`Recording::acceleration`], loses small pulses, as where a seal begins to
    /// slide. They are at the same place in every stroke and would bias the force that is left. Here
    /// windows become shorter as long as the noise variance of the fit is below the mean square of the
    /// acceleration, and its force below `noise`; shorter ones count where they differ by more than
    /// noise.
    #[must_use]
    pub fn acceleration_of(&self, signal: &[f64], mass: f64, noise: f64) -> Vec<f64> {
        let square = signal.iter().map(|a| a * a).sum::<f64>() / signal.len().max(1) as f64;
        let harmless = square.min((noise / mass).powi(2));
        let longest = LONGEST_WINDOW.min(self.duration() / 4.0);
        let mut value = local_acceleration(self, longest);
        let mut samples = self.samples_in(longest);
        let wider = successors(Some(longest), |window| Some(window / WINDOW_STEP));
        let wider = wider.take_while(|window| self.samples_in(*window) > FEWEST as f64);
        let windows: Vec<f64> = wider.map(|window| window / WINDOW_STEP).collect();
        for (window, narrow) in self.accelerations(&windows) {
            let around = (samples / 2.0) as usize;
            samples = self.samples_in(window);
            let variance = self.acceleration_variance(samples);
            let threshold = if variance > harmless { ABOVE_NOISE * variance } else { 0.0 };
            refine(&mut value, &narrow, around, threshold);
        }
        value
    }

    /// The readings in N without the inertia of a known mass in kg: `force - mass * acceleration`. The
    /// acceleration is that of the positions between the counts of the encoder.
    #[must_use]
    pub(crate) fn force_without_inertia(&self, mass: f64) -> Vec<f64> {
        if mass == 0.0 {
            return self.force.clone();
        }
        let error = ADDED * self.quality.force_noise;
        let positions = self.between_counts();
        let acceleration = positions.acceleration_of(&positions.acceleration(), mass, error);
        self.force.iter().zip(acceleration).map(|(force, a)| force - mass * a).collect()
    }

    /// Ratio of a pulse of the true acceleration to that over `window`. Blur grows with the square
    /// of the samples in the window, and a second window determines its amount.
    fn left_by_blur(&self, acceleration: &[f64], window: f64) -> f64 {
        let third = window / 3.0;
        let other =
            if self.samples_in(third) < self.samples_in(window) { third } else { 2.0 * window };
        let [n, m] = [window, other].map(|w| self.samples_in(w).powi(2));
        let other = local_acceleration(self, other);
        let of_pulses = match m < n {
            true => pulse_ratio(acceleration, &other),
            false => pulse_ratio(&other, acceleration),
        };
        1.0 + (of_pulses.clamp(0.8, 1.25) - 1.0) * n / (n - m).abs()
    }

    /// The acceleration over each of `windows`, in order; a few at a time, since each is as long as the
    /// recording.
    fn accelerations<'a>(
        &'a self,
        windows: &'a [f64],
    ) -> impl Iterator<Item = (f64, Vec<f64>)> + 'a {
        windows.chunks(AT_A_TIME).flat_map(|some| {
            let some = some.par_iter().map(|window| (*window, local_acceleration(self, *window)));
            some.collect::<Vec<_>>()
        })
    }

    /// Number of samples in a fit over `window` seconds.
    fn samples_in(&self, window: f64) -> f64 {
        // A window of whole intervals includes the samples at its ends, regardless of rounding.
        let on_each_side = (0.5 * window / self.quality.median_interval + 1e-6).floor();
        (2.0 * on_each_side + 1.0).max(FEWEST as f64)
    }

    /// Variance, (m/s^2)^2, of the acceleration of a fit to `samples` positions.
    fn acceleration_variance(&self, samples: f64) -> f64 {
        let interval = self.quality.median_interval;
        // Rounding to a step has the standard deviation of the step over the square root of twelve.
        let noise =
            self.quality.position_noise.max(self.quality.position_resolution / 12_f64.sqrt());
        let squared = samples * samples;
        720.0 * (noise / (interval * interval)).powi(2)
            / (samples * (squared - 1.0) * (squared - 4.0))
    }

    /// The window in s with the least error of the acceleration, averaged over the recording.
    ///
    /// n positions with standard deviation s, taken every h seconds, give the acceleration with
    /// variance `V(n) = 720 s^2 / (h^4 n (n^2 - 1) (n^2 - 4))`, and a bias b that grows with the
    /// square of the window. The bias is estimated from the difference to the fit over half the
    /// window, m samples: its mean square is `b^2 (1 - (m / n)^2)^2 + V(m) - V(n)`, since the
    /// longer fit is the efficient one.
    fn acceleration_window(&self) -> f64 {
        let interval = self.quality.median_interval;
        let shortest = (FEWEST - 1) as f64 * interval;
        let longest = LONGEST_WINDOW.min(self.duration() / 4.0);
        let all = successors(Some(shortest), |window| Some(window * WINDOW_STEP));
        let windows: Vec<f64> = all.take_while(|window| *window <= longest).collect();
        // Half the window was tried two steps ago, except for the first two.
        let halves: Vec<f64> = windows.iter().take(2).map(|window| window / 2.0).collect();
        let mut earlier: VecDeque<Vec<f64>> = self.accelerations(&halves).map(|(_, a)| a).collect();
        let mut best = (f64::INFINITY, shortest);
        for (window, long) in self.accelerations(&windows) {
            let (n, m) = (self.samples_in(window), self.samples_in(window / 2.0));
            let variance = self.acceleration_variance(n);
            let by_noise = self.acceleration_variance(m) - variance;
            let short = earlier.pop_front().expect("each window leaves one for a later one");
            let excess = (mean_square_difference(&long, &short) - by_noise).max(0.0);
            earlier.push_back(long);
            let bias = if m < n { excess / (1.0 - (m / n).powi(2)).powi(2) } else { 0.0 };
            if variance + bias < best.0 {
                best = (variance + bias, window);
            }
        }
        best.1
    }
}

/// Adds the difference of `narrow` to `best` where its mean square, over up to `around` values on
/// either side of each, is above `noise`.
fn refine(best: &mut [f64], narrow: &[f64], around: usize, noise: f64) {
    let d: Vec<f64> = narrow.iter().zip(&*best).map(|(narrow, best)| narrow - best).collect();
    for ((best, d), energy) in best.iter_mut().zip(&d).zip(mean_squares(&d, around)) {
        if energy > noise {
            *best += d * (1.0 - (noise / energy).powi(2));
        }
    }
}

/// Mean square change of the acceleration with another window.
fn mean_square_difference(long: &[f64], short: &[f64]) -> f64 {
    long.iter().zip(short).map(|(a, b)| (a - b) * (a - b)).sum::<f64>() / long.len() as f64
}

/// Mean square of `values` over up to `around` values on either side of each.
fn mean_squares(values: &[f64], around: usize) -> Vec<f64> {
    let mut sums = vec![0.0];
    sums.extend(values.iter().scan(0.0, |sum, v| {
        *sum += v * v;
        Some(*sum)
    }));
    (0..values.len())
        .map(|k| {
            let (from, to) = (k.saturating_sub(around), (k + around + 1).min(values.len()));
            (sums[to] - sums[from]) / (to - from) as f64
        })
        .collect()
}

/// Ratio of a sharper acceleration to a smooth one, where the latter is large.
fn pulse_ratio(smooth: &[f64], sharp: &[f64]) -> f64 {
    let mut sorted: Vec<f64> = smooth.iter().map(|a| a.abs()).collect();
    sorted.sort_by(f64::total_cmp);
    let large = 0.3 * sorted[(0.99 * (sorted.len() - 1) as f64) as usize];
    let pulses = smooth.iter().zip(sharp).filter(|(a, _)| a.abs() > large);
    let (both, square) =
        pulses.fold((0.0, 0.0), |(both, square), (a, b)| (both + a * b, square + a * a));
    if square > 0.0 { both / square } else { 1.0 }
}

/// Fit at one sample.
#[derive(Default, Clone, Copy)]
struct Fit {
    slope: f64,
    curvature: f64,
}

fn local_fit(recording: &Recording, window: f64, take: impl Fn(Fit) -> f64) -> Vec<f64> {
    let mut out = Vec::with_capacity(recording.len());
    for part in recording.unbroken() {
        let (time, position) = (&recording.time[part.clone()], &recording.position[part]);
        fit_part(time, position, window / 2.0, |fit| out.push(take(fit)));
    }
    out
}

/// Sums over the sliding window. Once per window length their origin is moved to the present sample
/// and they are recomputed. Rounding errors thus do not accumulate, and the cost per sample does
/// not depend on the window.
fn fit_part(time: &[f64], position: &[f64], half: f64, mut emit: impl FnMut(Fit)) {
    if time.len() < 3 {
        time.iter().for_each(|_| emit(Fit::default()));
        return;
    }
    let mut inside = 0..0;
    let mut sums = Sums::at(time, position, 0, 0..0);
    for k in 0..time.len() {
        let next = window_around(time, k, half, &inside);
        if k >= sums.until {
            sums = Sums::at(time, position, k, next.clone());
        } else {
            (inside.end..next.end).for_each(|j| sums.add(time[j], position[j], 1.0));
            (inside.start..next.start).for_each(|j| sums.add(time[j], position[j], -1.0));
        }
        inside = next;
        emit(sums.fit(time[k]));
    }
}

/// The samples within `half` of sample `k`, at least five if the part has them; both ends only
/// advance.
fn window_around(time: &[f64], k: usize, half: f64, before: &Range<usize>) -> Range<usize> {
    let fewest = FEWEST.min(time.len());
    let mut start = before.start;
    let mut end = before.end.max(k + 1);
    while time[k] - time[start] > half {
        start += 1;
    }
    while end < time.len() && time[end] - time[k] <= half {
        end += 1;
    }
    if end - start < fewest {
        start = k.saturating_sub(fewest / 2).min(time.len() - fewest).clamp(before.start, start);
        end = end.max(start + fewest).min(time.len());
    }
    start..end
}

/// Moments of the samples in the window about an origin in time and position.
struct Sums {
    origin: (f64, f64),
    /// Inverse of the time unit that keeps the powers near one.
    per_unit: f64,
    /// Sums of powers 0 to 4 of time.
    powers: [f64; 5],
    /// Sums of position times powers 0 to 2 of time.
    products: [f64; 3],
    /// Sample at which the origin must be moved.
    until: usize,
}

impl Sums {
    fn at(time: &[f64], position: &[f64], k: usize, inside: Range<usize>) -> Self {
        let span = if inside.is_empty() { 1.0 } else { time[inside.end - 1] - time[inside.start] };
        let mut sums = Self {
            origin: (time[k], position[k]),
            per_unit: 1.0 / span,
            powers: [0.0; 5],
            products: [0.0; 3],
            until: k + inside.len(),
        };
        inside.for_each(|j| sums.add(time[j], position[j], 1.0));
        sums
    }

    fn add(&mut self, time: f64, position: f64, weight: f64) {
        let t = (time - self.origin.0) * self.per_unit;
        let x = weight * (position - self.origin.1);
        let mut power = weight;
        for sum in &mut self.powers {
            *sum += power;
            power *= t;
        }
        self.products[0] += x;
        self.products[1] += x * t;
        self.products[2] += x * t * t;
    }

    /// Slope and curvature at `time`, by orthogonal polynomials: 1, t - mean, and the quadratic
    /// orthogonal to both.
    fn fit(&self, time: f64) -> Fit {
        let per_sample = 1.0 / self.powers[0];
        let [_, mean, s2, s3, s4] = self.powers.map(|sum| sum * per_sample);
        let [c0, p1, p2] = self.products.map(|sum| sum * per_sample);
        // Central moments of time, and of position with time.
        let m2 = s2 - mean * mean;
        let m3 = s3 - mean * (3.0 * s2 - 2.0 * mean * mean);
        let m4 = s4 - mean * (4.0 * s3 - mean * (6.0 * s2 - 3.0 * mean * mean));
        let c1 = p1 - mean * c0;
        let c2 = p2 - mean * (2.0 * p1 - mean * c0) - m2 * c0;
        let per_m2 = 1.0 / m2;
        let skew = m3 * per_m2;
        let curvature = (c2 - skew * c1) / (m4 - m2 * m2 - skew * m3);
        let t = (time - self.origin.0) * self.per_unit - mean;
        let slope = c1 * per_m2 + curvature * (2.0 * t - skew);
        Fit { slope: slope * self.per_unit, curvature: curvature * self.per_unit * self.per_unit }
    }
}
