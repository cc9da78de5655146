//! Does the steady curve ask for a Stribeck bump (EMS (11)), and do the speeds measured pin it?
//!
//! For a fixed Stribeck velocity v_s the curve is linear in F_0, F_c, F_s − F_c and β; v_s itself is found on a
//! grid. Under the straight line v_s has no meaning, so the largest F statistic over the grid follows no tabled law:
//! its p value comes from a seeded simulation of passes scattered about the line. A bump is accepted when the test
//! asks for it, it rises (F_s > F_c) and at least a tenth of it is left at the slowest speed measured; a narrower one
//! would be an extrapolation, and is reported but not used.

use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::estimate::{Estimate, LinearFit, f_p_value};
use super::random::normal;
use super::steady::{LackOfFit, PassMean, SteadyFit, StribeckFit, weighted};

/// Level of the lack-of-fit test.
const LEVEL: f64 = 0.01;
/// Simulated data sets under the straight line.
const SIMULATIONS: usize = 499;
/// Least part of the bump that must be left at the slowest speed: exp(−(v_min/v_s)²) ≥ 0.1.
const LEAST_PART_SEEN: f64 = 0.1;
/// The Gaussian of EMS (11).
const EXPONENT: f64 = 2.0;
/// Grid of Stribeck velocities.
const GRID: usize = 40;

/// Tests the straight line in `fit` and, if called for, replaces it by a Stribeck curve.
pub(super) fn test(fit: &mut SteadyFit, means: &[PassMean], seed: u64) {
    let [slowest, fastest] = fit.speed_range_m_s;
    let (Some(line), scatter) = weighted(means, &[|_| 1.0, sign, |v| v]) else { return };
    if line.degrees < 4.0 {
        return;
    }
    let weights = DVector::from_iterator(
        means.len(),
        means.iter().map(|m| 1.0 / (scatter * scatter + m.standard_error_n.powi(2))),
    );
    let profile = Profile::new(means, weights, slowest, fastest);
    let forces = DVector::from_iterator(means.len(), means.iter().map(|m| m.force_n));
    let Some(best) = profile.best(&forces) else { return };
    let p_value = profile.p_value(&line, &best, seed);
    let bump = best.fit.coefficients[2];
    let at_slowest = bump * (-(slowest / best.stribeck_velocity).powf(EXPONENT)).exp();
    let verdict = match () {
        () if p_value >= LEVEL => "the straight line suffices".to_owned(),
        () if bump <= 0.0 => "the force bends down towards low speed: not a Stribeck curve, the line is kept".to_owned(),
        () if at_slowest < LEAST_PART_SEEN * bump => format!(
            "the force rises below {:.0} mm/s, but such a narrow bump lies outside the speeds measured: the line is kept, \
             record slower strokes to pin it",
            1e3 * slowest
        ),
        () => {
            accept(fit, &best);
            "Stribeck curve accepted; F_s is its continuation below the slowest speed measured".to_owned()
        }
    };
    fit.lack_of_fit = Some(LackOfFit {
        p_value,
        stribeck_velocity_m_s: best.stribeck_velocity,
        excess_at_slowest_n: at_slowest,
        verdict,
    });
}

fn accept(fit: &mut SteadyFit, best: &Candidate) {
    let [low, high] = best.velocity_interval;
    let note = "continued from the slowest speed measured to rest";
    fit.offset_n = best.fit.estimate(0, "N");
    fit.coulomb_force_n = best.fit.estimate(1, "N");
    fit.viscous_damping_n_s_m = best.fit.estimate(3, "N s/m");
    fit.stribeck = Some(StribeckFit {
        static_force_n: best.fit.combination(&[(1, 1.0), (2, 1.0)], "N").with_note(note),
        stribeck_velocity_m_s: Estimate::from_bounds(best.stribeck_velocity, low, high, "m/s"),
        stribeck_exponent: EXPONENT,
    });
}

fn sign(v: f64) -> f64 {
    v.signum()
}

struct Candidate {
    stribeck_velocity: f64,
    fit: LinearFit,
    /// Grid velocities whose fit is not significantly worse (profile interval, 95 %).
    velocity_interval: [f64; 2],
}

/// Designs over the grid of Stribeck velocities, at fixed weights.
struct Profile {
    line: DMatrix<f64>,
    curves: Vec<(f64, DMatrix<f64>)>,
    weights: DVector<f64>,
}

impl Profile {
    fn new(means: &[PassMean], weights: DVector<f64>, slowest: f64, fastest: f64) -> Self {
        let v: Vec<f64> = means.iter().map(|m| m.velocity_m_s).collect();
        let line = DMatrix::from_fn(v.len(), 3, |i, j| [1.0, sign(v[i]), v[i]][j]);
        let (from, to) = (0.25 * slowest, 0.7 * fastest);
        let curves = (0..GRID).map(|k| {
            let vs = from * (to / from).powf(k as f64 / (GRID - 1) as f64);
            let bump = |v: f64| sign(v) * (-(v.abs() / vs).powf(EXPONENT)).exp();
            (vs, DMatrix::from_fn(v.len(), 4, |i, j| [1.0, sign(v[i]), bump(v[i]), v[i]][j]))
        });
        Self { line, curves: curves.collect(), weights }
    }

    fn best(&self, forces: &DVector<f64>) -> Option<Candidate> {
        let fits: Vec<(f64, LinearFit)> = self
            .curves
            .iter()
            .filter_map(|(vs, design)| Some((*vs, LinearFit::new(design, forces, &self.weights)?)))
            .collect();
        let least = fits.iter().map(|(_, f)| f.weighted_rss).fold(f64::INFINITY, f64::min);
        let not_worse = |f: &LinearFit| {
            f_p_value((f.weighted_rss - least) / (least / (f.degrees - 1.0)), 1.0, f.degrees - 1.0) > 0.05
        };
        let close = fits.iter().filter(|(_, f)| not_worse(f)).map(|(v, _)| *v);
        let (low, high) = close.fold((f64::INFINITY, 0.0f64), |(l, h), v| (l.min(v), h.max(v)));
        let (stribeck_velocity, fit) = fits.into_iter().find(|(_, f)| f.weighted_rss <= least)?;
        Some(Candidate { stribeck_velocity, fit, velocity_interval: [low, high] })
    }

    fn gain(&self, forces: &DVector<f64>) -> Option<f64> {
        let line = LinearFit::new(&self.line, forces, &self.weights)?;
        let best = self.best(forces)?;
        Some((line.weighted_rss - best.fit.weighted_rss) / best.fit.weighted_rss)
    }

    /// p value of the observed gain among data simulated under the line; a clear non-finding is not simulated.
    fn p_value(&self, line: &LinearFit, best: &Candidate, seed: u64) -> f64 {
        let observed = (line.weighted_rss - best.fit.weighted_rss) / best.fit.weighted_rss;
        let pointwise = f_p_value(observed * best.fit.degrees, 1.0, best.fit.degrees);
        if pointwise > 0.05 {
            // The largest statistic over the grid is less significant still.
            return pointwise;
        }
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let trend = &self.line * &line.coefficients;
        let beyond = (0..SIMULATIONS).filter(|_| {
            let scattered = DVector::from_fn(trend.len(), |i, _| trend[i] + normal(&mut rng) / self.weights[i].sqrt());
            self.gain(&scattered).is_some_and(|g| g >= observed)
        });
        (beyond.count() + 1) as f64 / (SIMULATIONS + 1) as f64
    }
}
