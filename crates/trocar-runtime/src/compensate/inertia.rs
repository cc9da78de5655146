//! Inertia and weight of the moving mass, from past positions only.
//!
//! ```text
//! x(t) ~ a0 + a1·(t − t_now) + a2·(t − t_now)²   least squares over the last 30 ms, or 8 samples       a = 2·a2
//! ```
//! This is the acceleration at the middle of the window: a delay of 15 ms, which is negligible for
//! hand motion (below 5 Hz). The variance is 720·s²/(h⁴·n⁵) for n positions every h seconds with
//! standard deviation s: 0.01 m/s² for a 4 µm encoder at 1 kHz.

use super::saved::StateRow;

/// Length of the window, s.
const WINDOW: f64 = 0.03;
/// Most positions stored.
const MOST: usize = 128;
/// Fewest positions for an acceleration.
const FEWEST: usize = 8;

/// Inertia and weight of the mass between sensor and seal.
#[derive(Debug, Clone)]
pub(super) struct Inertia {
    mass: f64,
    gravity: f64,
    /// Time, s, and position, m; a ring buffer.
    past: [(f64, f64); MOST],
    next: usize,
    count: usize,
    acceleration: f64,
}

impl Inertia {
    pub(super) fn new(mass: f64, gravity: f64) -> Self {
        Self { mass, gravity, past: [(0.0, 0.0); MOST], next: 0, count: 0, acceleration: 0.0 }
    }

    pub(super) fn mass(&self) -> f64 {
        self.mass
    }

    /// m·g, N.
    pub(super) fn weight(&self) -> f64 {
        self.mass * self.gravity
    }

    pub(super) fn gravity(&self) -> f64 {
        self.gravity
    }

    /// m·(a + g), N.
    pub(super) fn force(&self) -> f64 {
        self.mass * (self.acceleration + self.gravity)
    }

    pub(super) fn restart(&mut self, time: f64, position: f64) {
        (self.next, self.count, self.acceleration) = (0, 0, 0.0);
        self.push(time, position);
    }

    pub(super) fn advance(&mut self, time: f64, position: f64) {
        if self.mass > 0.0 {
            self.push(time, position);
            self.acceleration = self.fit(time, position).unwrap_or(0.0);
        }
    }

    /// Writes or reads all that changes.
    pub(super) fn exchange(&mut self, row: &mut StateRow) {
        for (time, position) in &mut self.past {
            row.number(time);
            row.number(position);
        }
        row.count(&mut self.next, MOST as u64 - 1);
        row.count(&mut self.count, MOST as u64);
        row.number(&mut self.acceleration);
    }

    fn push(&mut self, time: f64, position: f64) {
        self.past[self.next] = (time, position);
        self.next = (self.next + 1) % MOST;
        self.count = (self.count + 1).min(MOST);
    }

    /// Quadratic fit about the newest sample, with time in units of the window.
    fn fit(&self, now: f64, here: f64) -> Option<f64> {
        if self.count < FEWEST {
            return None;
        }
        let window = WINDOW.max(now - self.past[(self.next + MOST - FEWEST) % MOST].0);
        let (mut n, mut t1, mut t2, mut t3, mut t4) = (0.0, 0.0, 0.0, 0.0, 0.0);
        let (mut x0, mut x1, mut x2) = (0.0, 0.0, 0.0);
        for (time, position) in &self.past[..self.count] {
            let t = (time - now) / window;
            if t < -1.0 {
                continue;
            }
            let x = position - here;
            let tt = t * t;
            (n, t1, t2, t3, t4) = (n + 1.0, t1 + t, t2 + tt, t3 + t * tt, t4 + tt * tt);
            (x0, x1, x2) = (x0 + x, x1 + x * t, x2 + x * tt);
        }
        // Cramer's rule for a2.
        let minor = n * t2 - t1 * t1;
        let whole = n * (t2 * t4 - t3 * t3) - t1 * (t1 * t4 - t2 * t3) + t2 * (t1 * t3 - t2 * t2);
        let curvature = (x2 * minor - x1 * (n * t3 - t1 * t2) + x0 * (t1 * t3 - t2 * t2)) / whole;
        Some(2.0 * curvature / (window * window)).filter(|a| a.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A constant acceleration is recovered to within rounding, whatever the sampling.
    #[test]
    fn a_constant_acceleration_is_found() {
        let mut inertia = Inertia::new(0.5, -9.81);
        let (mut time, position) = (0.0, |t: f64| 0.1 + 0.03 * t + 0.5 * 1.7 * t * t);
        inertia.restart(time, position(time));
        for k in 0..200 {
            time += 1e-3 * (1.0 + 0.3 * f64::from(k % 3));
            inertia.advance(time, position(time));
        }
        assert!((inertia.force() - 0.5 * (1.7 - 9.81)).abs() < 1e-6, "{}", inertia.force());
    }

    /// Slow sampling lengthens the window.
    #[test]
    fn slow_sampling_is_enough() {
        let mut inertia = Inertia::new(0.5, 0.0);
        inertia.restart(0.0, 0.0);
        for k in 1..40 {
            let time = 0.01 * f64::from(k);
            inertia.advance(time, 0.5 * 3.0 * time * time);
        }
        assert!((inertia.force() - 1.5).abs() < 1e-6, "{}", inertia.force());
    }
}
