//! Velocity and acceleration from positions by a local quadratic fit, for even and uneven sampling.
//!
//! ```text
//! x(t) ~ a0 + a1 (t - t_i) + a2 (t - t_i)^2   least squares over |t - t_i| <= window / 2
//! velocity = a1, acceleration = 2 a2
//! ```
//! The window never crosses a gap or a reset, and is extended if it contains fewer than five samples.
//! For even sampling the fit passes half of the power at 0.86 / window Hz for the
//! acceleration and 0.58 / window Hz for the velocity. At the ends of an unbroken part the window
//! is one-sided and the noise several times larger.

use std::ops::Range;

use super::Recording;

/// Fewest samples in a window: two more than the coefficients.
const FEWEST: usize = 5;

/// Time, s, over which the speed of a motion is taken that changes within some hundredths of a second.
#[must_use]
pub fn velocity_window(recording: &Recording) -> f64 {
    (FEWEST as f64 * recording.quality.median_interval).max(0.02)
}

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
    /// The readings in N without the inertia of a known mass in kg: `force - mass * acceleration`, with
    /// [`Recording::acceleration`].
    #[must_use]
    pub(crate) fn force_without_inertia(&self, mass: f64) -> Vec<f64> {
        if mass == 0.0 {
            return self.force.clone();
        }
        let acceleration = self.acceleration();
        self.force.iter().zip(acceleration).map(|(force, a)| force - mass * a).collect()
    }
}

/// Fit at one sample.
#[derive(Default, Clone, Copy)]
struct Fit {
    slope: f64,
    curvature: f64,
}

/// Fits over `window` seconds, or the fewest samples.
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

/// The samples within `half` of sample `k`, at least [`FEWEST`] if the part has them; both ends only
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
