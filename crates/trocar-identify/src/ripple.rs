//! The error of the readings that is correlated along the travel: friction varies on the way.
//!
//! ```text
//! ε_i = n_i + ρ(s_i)·F_i     n_i ~ N(0, a/n)     cov(ρ(s), ρ(s')) = b·exp(−|s − s'|/L)
//! ```
//! for a step of n samples at the travel s_i. a, b and L maximise the likelihood of the residuals of
//! a fit (Kalman filter). The variance of the score follows, also from so few strokes that leaving
//! one of them out says little:
//!
//! ```text
//! B = X̃'W·V·WX̃ + τ²·X̃'WZ·Z'WX̃      V = cov(ε)      X̃ = X − Z·P⁻¹·Z'WX
//! ```
//! with the derivatives X, and Z and P of likelihood.rs.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::likelihood::{self, Fitted, Row, Trial};
use super::training::{Ripple, Training};

/// Values of b over the variance of a reading relative to its force, and of L, that are compared.
const RATIOS: usize = 17;
const RATIO_RANGE: [f64; 2] = [1e-4, 10.0];
const LENGTHS: usize = 10;
/// Least L in mean steps, and largest one as a part of the travel.
const SHORTEST: f64 = 4.0;
const LONGEST: f64 = 0.1;

impl Ripple {
    /// From the residuals of a fit; `None` where its model does not run or nothing moves.
    pub(super) fn of<T: Trial>(training: &Training, fitted: &Fitted<T>) -> Option<Self> {
        let rows = likelihood::rows(training, &fitted.best)?;
        let residuals = fitted.residuals(training, &rows);
        let squares: f64 = rows.iter().map(|row| row.force * row.force).sum();
        let travel: f64 = rows.iter().map(|row| row.displacement.abs()).sum();
        let lengths = [SHORTEST * travel / rows.len() as f64, LONGEST * travel];
        if !(squares > 0.0 && 0.0 < lengths[0] && lengths[0] < lengths[1]) {
            return None;
        }
        let at = |[low, high]: [f64; 2], k: usize, count: usize| {
            low * (high / low).powf(k as f64 / (count - 1) as f64)
        };
        let tried = |k: usize| {
            let ratio = at(RATIO_RANGE, k / LENGTHS, RATIOS) * rows.len() as f64 / squares;
            let length = at(lengths, k % LENGTHS, LENGTHS);
            let (criterion, white) = filtered(&rows, &residuals, [ratio, length]);
            (criterion, Self { white, variance: ratio * white, length })
        };
        let all: Vec<(f64, Self)> = (0..RATIOS * LENGTHS).into_par_iter().map(tried).collect();
        all.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, found)| found)
    }

    /// B at a trial; `None` where its model does not run.
    pub(super) fn score_variance<T: Trial>(
        &self,
        training: &Training,
        trial: &T,
    ) -> Option<DMatrix<f64>> {
        let rows = likelihood::rows(training, trial)?;
        let p = trial.free().len();
        let mut sum = DMatrix::zeros(p, p);
        let mut rippled = DVector::zeros(p);
        let mut from = 0;
        for strokes in training.cluster_strokes() {
            let count = rows[from..].iter().take_while(|r| strokes.contains(&r.stroke)).count();
            let own = &rows[from..from + count];
            from += count;
            // WX̃ of the strokes of a cluster, step by step.
            let moved = training.scattered(own, strokes.start, &mut sum);
            for (row, mut moved) in own.iter().zip(moved) {
                sum.ger(self.white / row.samples(), &moved, &moved, 1.0);
                moved *= row.force;
                rippled *= (-row.displacement.abs() / self.length).exp();
                sum.ger(self.variance, &moved, &rippled, 1.0);
                sum.ger(self.variance, &rippled, &moved, 1.0);
                sum.ger(self.variance, &moved, &moved, 1.0);
                rippled += moved;
            }
        }
        Some(sum)
    }
}

/// −2 log L of residuals less constants, and a, with b/a and L.
fn filtered(rows: &[Row], residuals: &[f64], [ratio, length]: [f64; 2]) -> (f64, f64) {
    let (mut mean, mut variance) = (0.0, ratio);
    let (mut squares, mut logs) = (0.0, 0.0);
    let mut run = None;
    for (row, residual) in rows.iter().zip(residuals) {
        if run != Some(row.run) {
            (mean, variance, run) = (0.0, ratio, Some(row.run));
        }
        let fade = (-row.displacement.abs() / length).exp();
        mean *= fade;
        variance = fade * fade * variance + ratio * (1.0 - fade * fade);
        let of_reading = row.force * row.force * variance + 1.0 / row.samples();
        let off = residual - row.force * mean;
        squares += off * off / of_reading;
        logs += of_reading.ln();
        let gain = row.force * variance / of_reading;
        mean += gain * off;
        variance -= gain * row.force * variance;
    }
    let n = rows.len() as f64;
    let white = (squares / n).max(f64::MIN_POSITIVE);
    (n * white.ln() + logs, white)
}
