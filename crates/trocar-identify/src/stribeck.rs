//! Tests whether the steady-state curve requires a Stribeck term (EMS (11)) and whether the
//! measured speeds determine it.
//!
//! For a fixed Stribeck velocity v_s the curve is linear in F_0, F_c, F_s − F_c and β; v_s itself
//! is found on a grid. Under the straight line v_s has no meaning, so the largest F statistic over
//! the grid has no tabulated distribution. Its p value comes from a seeded simulation of strokes
//! scattered about the line. The term is accepted when the test requires it, the curve rises
//! towards rest (F_s > F_c), and at least a tenth of the rise remains at the slowest speed
//! measured. A narrower rise would be an extrapolation; it is reported but not used.

use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::candidate::GAUSSIAN;
use super::estimate::{Estimate, LinearFit, f_p_value};
use super::random::normal;
use super::steady::{
    LackOfFit, SteadyFit, StribeckFit, StrokeMean, direction_line, sign, weighted,
};
use trocar_simulate::segment::Direction;

/// Significance level of the lack-of-fit test.
const LEVEL: f64 = 0.01;
/// Simulated data sets under the straight line.
const SIMULATIONS: usize = 499;
/// Least fraction of the rise that must remain at the slowest speed: exp(−(v_min/v_s)²) ≥ 0.1.
const LEAST_PART_SEEN: f64 = 0.1;
/// Number of grid points of the Stribeck velocity.
const GRID: usize = 40;

/// Tests the straight line in `fit` and, if required, replaces it by a Stribeck curve.
pub(super) fn test(fit: &mut SteadyFit, seed: u64) {
    if !fit.viscous_damping_n_s_m.determined || !fit.coulomb_force_n.determined {
        return;
    }
    let means = &fit.means.clone();
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
    let p_value = profile.p_value(&forces, best.fit.degrees, seed);
    let bump = best.fit.coefficients[2];
    let at_slowest = bump * (-(slowest / best.stribeck_velocity).powf(GAUSSIAN)).exp();
    let verdict = match () {
        () if p_value >= LEVEL => "the straight line suffices".to_owned(),
        () if bump <= 0.0 => {
            "the force falls towards low speed: not a Stribeck curve, the line is kept".to_owned()
        }
        () if at_slowest < LEAST_PART_SEEN * bump => format!(
            "the force rises below {:.0} mm/s, but such a narrow bump lies outside the speeds measured: the line is kept, \
             record slower strokes to determine it",
            1e3 * slowest
        ),
        () => {
            accept(fit, &best, &profile.weights);
            "Stribeck curve accepted; F_s is its continuation below the slowest speed measured"
                .to_owned()
        }
    };
    fit.lack_of_fit = Some(LackOfFit {
        p_value,
        stribeck_velocity_m_s: best.stribeck_velocity,
        excess_at_slowest_n: at_slowest,
        verdict,
    });
}

/// Adopts the curve. The error of v_s is correlated with the other parameters, so the covariance is
/// that of all five.
fn accept(fit: &mut SteadyFit, best: &Candidate, weights: &DVector<f64>) {
    let means = &fit.means;
    let vs = best.stribeck_velocity;
    let rise = best.fit.coefficients[2];
    let bump = |v: f64| sign(v) * (-(v.abs() / vs).powf(GAUSSIAN)).exp();
    let by_vs = |v: f64| rise * bump(v) * GAUSSIAN * (v.abs() / vs).powf(GAUSSIAN) / vs;
    let column = |v: f64, j: usize| [1.0, sign(v), bump(v), v, by_vs(v)][j];
    let design = DMatrix::from_fn(means.len(), 5, |i, j| column(means[i].velocity_m_s, j));
    let forces = DVector::from_iterator(means.len(), means.iter().map(|m| m.force_n));
    let flat = "the measured speeds do not distinguish the bump from the line";
    let joint = LinearFit::new(&design, &forces, weights);
    let estimate = |terms: &[(usize, f64)], unit| match &joint {
        Some(joint) => {
            let value = terms.iter().map(|(j, a)| a * best.fit.coefficients[*j]).sum::<f64>();
            let half = joint.combination(terms, unit).half_width();
            Estimate::from_bounds(value, value - half, value + half, unit)
        }
        None => Estimate::undetermined(
            terms.iter().map(|(j, a)| a * best.fit.coefficients[*j]).sum(),
            unit,
            flat,
        ),
    };
    let [low, high] = best.velocity_interval;
    let half = joint.as_ref().map_or(0.0, |j| j.estimate(4, "m/s").half_width());
    fit.offset_n = estimate(&[(0, 1.0)], "N");
    fit.coulomb_force_n = estimate(&[(1, 1.0)], "N");
    fit.viscous_damping_n_s_m = estimate(&[(3, 1.0)], "N s/m");
    fit.stribeck = Some(StribeckFit {
        static_force_n: estimate(&[(1, 1.0), (2, 1.0)], "N")
            .with_note("continued from the slowest speed measured to rest"),
        stribeck_velocity_m_s: Estimate::from_bounds(
            vs,
            low.min(vs - half).max(0.0),
            high.max(vs + half),
            "m/s",
        ),
        stribeck_exponent: GAUSSIAN,
    });
    let without_bump: Vec<StrokeMean> = means
        .iter()
        .map(|m| StrokeMean { force_n: m.force_n - rise * bump(m.velocity_m_s), ..m.clone() })
        .collect();
    fit.insertion = direction_line(&without_bump, Direction::Insertion);
    fit.withdrawal = direction_line(&without_bump, Direction::Withdrawal);
}

struct Candidate {
    stribeck_velocity: f64,
    fit: LinearFit,
    /// Grid velocities whose fit is not significantly worse (profile interval, 95 %).
    velocity_interval: [f64; 2],
}

/// The grid of Stribeck velocities at fixed weights.
///
/// The improvement by a bump over the line is the square of the data's component along the part of
/// the bump orthogonal to the line. A simulated data set thus costs one dot product for each grid
/// velocity.
struct Profile {
    /// Stribeck velocities and designs.
    curves: Vec<(f64, DMatrix<f64>)>,
    /// Orthonormal basis of the weighted line.
    line: DMatrix<f64>,
    /// Unit vectors of the weighted bumps, orthogonal to the line.
    bumps: Vec<DVector<f64>>,
    weights: DVector<f64>,
}

impl Profile {
    fn new(means: &[StrokeMean], weights: DVector<f64>, slowest: f64, fastest: f64) -> Self {
        let v: Vec<f64> = means.iter().map(|m| m.velocity_m_s).collect();
        let root = weights.map(f64::sqrt);
        let line =
            DMatrix::from_fn(v.len(), 3, |i, j| root[i] * [1.0, sign(v[i]), v[i]][j]).qr().q();
        let (from, to) = (0.25 * slowest, 0.7 * fastest);
        let mut curves = Vec::new();
        let mut bumps = Vec::new();
        for k in 0..GRID {
            let vs = from * (to / from).powf(k as f64 / (GRID - 1) as f64);
            let bump = |v: f64| sign(v) * (-(v.abs() / vs).powf(GAUSSIAN)).exp();
            let weighted = DVector::from_fn(v.len(), |i, _| root[i] * bump(v[i]));
            let own = &weighted - &line * (line.transpose() * &weighted);
            // A bump that the line can represent, or that has decayed at every speed, is no
            // candidate.
            if own.norm() > 1e-6 * weighted.norm() && weighted.norm() > 1e-6 * root.norm() {
                curves.push((
                    vs,
                    DMatrix::from_fn(v.len(), 4, |i, j| [1.0, sign(v[i]), bump(v[i]), v[i]][j]),
                ));
                bumps.push(own.normalize());
            }
        }
        Self { curves, line, bumps, weights }
    }

    /// Decrease of the squared error by each bump relative to the line, and the line's own squared
    /// error, of weighted data.
    fn gains<'a>(&'a self, weighted: &'a DVector<f64>) -> (impl Iterator<Item = f64> + 'a, f64) {
        let left = weighted.norm_squared() - (self.line.transpose() * weighted).norm_squared();
        (self.bumps.iter().map(|b| b.dot(weighted).powi(2)), left)
    }

    fn best(&self, forces: &DVector<f64>) -> Option<Candidate> {
        let weighted = forces.component_mul(&self.weights.map(f64::sqrt));
        let (gains, line_rss) = self.gains(&weighted);
        let gains: Vec<f64> = gains.collect();
        let best = (0..gains.len()).max_by(|a, b| gains[*a].total_cmp(&gains[*b]))?;
        let fit = LinearFit::new(&self.curves[best].1, forces, &self.weights)?;
        let least = line_rss - gains[best];
        let degrees = fit.degrees - 1.0;
        let not_worse =
            |gain: f64| f_p_value((gains[best] - gain) / (least / degrees), 1.0, degrees) > 0.05;
        let close =
            self.curves.iter().zip(&gains).filter(|(_, g)| not_worse(**g)).map(|((v, _), _)| *v);
        let (low, high) = close.fold((f64::INFINITY, 0.0f64), |(l, h), v| (l.min(v), h.max(v)));
        Some(Candidate {
            stribeck_velocity: self.curves[best].0,
            fit,
            velocity_interval: [low, high],
        })
    }

    /// Largest decrease relative to the squared error that remains.
    fn statistic(&self, weighted: &DVector<f64>) -> f64 {
        let (gains, left) = self.gains(weighted);
        let gain = gains.fold(0.0, f64::max);
        gain / (left - gain).max(f64::MIN_POSITIVE)
    }

    /// p value of the observed decrease among data simulated under the line; a clearly
    /// insignificant one is not simulated.
    fn p_value(&self, forces: &DVector<f64>, degrees: f64, seed: u64) -> f64 {
        let observed = self.statistic(&forces.component_mul(&self.weights.map(f64::sqrt)));
        let pointwise = f_p_value(observed * degrees, 1.0, degrees);
        if pointwise > 0.05 {
            // The largest statistic over the grid is even less significant.
            return pointwise;
        }
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        // Only the scatter about the line matters: the line itself is projected out.
        let beyond = (0..SIMULATIONS).filter(|_| {
            let scattered = DVector::from_fn(forces.len(), |_, _| normal(&mut rng));
            self.statistic(&scattered) >= observed
        });
        (beyond.count() + 1) as f64 / (SIMULATIONS + 1) as f64
    }
}
