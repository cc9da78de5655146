//! Elliptical slice sampling (ESLICE) with a Student reference (GESS): a Markov chain without a
//! step size, for densities that are close to a normal one.
//!
//! ```text
//! s ~ (ν + q(z))/χ²(ν + d)        q(z) = |S⁻¹(z − m)|²             reference: t with ν degrees, location m, scale S
//! w ~ N(0, s·S·S')                z' = m + (z − m)·cos φ + w·sin φ     a draw of the reference's own
//! accept z' if ln π(z') − ln t(z') > ln π(z) − ln t(z) + ln u, else shrink the bracket of φ towards 0
//! ```
//! Where π is the reference itself, the first φ is accepted. A kink or a bound of π costs some more
//! evaluations and needs no derivative. The step always ends: at φ = 0 the chain stays where it is.

use std::f64::consts::TAU;

use nalgebra::{DMatrix, DVector};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::super::random::normal;

/// ν: heavier tails than normal, and close to it in many dimensions.
const DEGREES: usize = 20;
/// Width of the bracket of φ below which a step has found no other point.
const CLOSED: f64 = 1e-9;

/// Location and scale of the reference.
#[derive(Clone)]
pub(super) struct Reference {
    pub(super) location: DVector<f64>,
    /// S, lower triangular.
    pub(super) scale: DMatrix<f64>,
}

impl Reference {
    /// Location 0 and unit scale.
    pub(super) fn standard(dimension: usize) -> Self {
        Self { location: DVector::zeros(dimension), scale: DMatrix::identity(dimension, dimension) }
    }

    /// Mean of `draws`, and their covariance shrunk towards 1 by as many draws as there are
    /// dimensions.
    pub(super) fn of(draws: &[DVector<f64>]) -> Option<Self> {
        let (first, n) = (draws.first()?, draws.len() as f64);
        let d = first.len();
        let location = draws.iter().fold(DVector::zeros(d), |a, b| a + b) / n;
        let mut sum = DMatrix::identity(d, d) * d as f64;
        for draw in draws {
            let off = draw - &location;
            sum += &off * off.transpose();
        }
        let scale = (sum / (n + d as f64)).cholesky()?.unpack();
        Some(Self { location, scale })
    }

    /// q(z).
    fn square(&self, z: &DVector<f64>) -> f64 {
        let off = z - &self.location;
        self.scale.solve_lower_triangular(&off).map_or(f64::INFINITY, |x| x.norm_squared())
    }

    /// ln t(z), less a constant.
    fn log_density(&self, z: &DVector<f64>) -> f64 {
        let (nu, d) = (DEGREES as f64, z.len() as f64);
        -0.5 * (nu + d) * (self.square(z) / nu).ln_1p()
    }

    /// A draw of w.
    fn ellipse(&self, z: &DVector<f64>, rng: &mut ChaCha8Rng) -> DVector<f64> {
        let d = z.len();
        let chi2: f64 = (0..DEGREES + d).map(|_| normal(rng).powi(2)).sum();
        let spread = ((DEGREES as f64 + self.square(z)) / chi2).sqrt();
        let unit = DVector::from_fn(d, |_, _| normal(rng));
        &self.scale * unit * spread
    }
}

/// A Markov chain.
pub(super) struct Chain {
    pub(super) at: DVector<f64>,
    /// ln π there.
    log_density: f64,
    rng: ChaCha8Rng,
    /// Evaluations of ln π.
    pub(super) evaluations: usize,
    /// Steps that found no other point.
    pub(super) stuck: usize,
}

impl Chain {
    /// A chain that begins at `start`, or nearer to 0 where π(start) is 0; `None` where π(0) is.
    pub(super) fn new(
        log: &impl Fn(&DVector<f64>) -> f64,
        mut start: DVector<f64>,
        rng: ChaCha8Rng,
    ) -> Option<Self> {
        const HALVINGS: usize = 40;
        for k in 0..=HALVINGS {
            if k == HALVINGS {
                start.fill(0.0);
            }
            let (log_density, evaluations) = (log(&start), k + 1);
            if log_density.is_finite() {
                return Some(Self { at: start, log_density, rng, evaluations, stuck: 0 });
            }
            start *= 0.5;
        }
        None
    }

    /// One step.
    pub(super) fn step(&mut self, log: &impl Fn(&DVector<f64>) -> f64, reference: &Reference) {
        let w = reference.ellipse(&self.at, &mut self.rng);
        let off = &self.at - &reference.location;
        let level = self.log_density - reference.log_density(&self.at)
            + (1.0 - self.rng.random::<f64>()).ln();
        let mut angle = TAU * self.rng.random::<f64>();
        let (mut low, mut high) = (angle - TAU, angle);
        while high - low > CLOSED {
            let z = &reference.location + &off * angle.cos() + &w * angle.sin();
            let log_density = log(&z);
            self.evaluations += 1;
            if log_density - reference.log_density(&z) > level {
                (self.at, self.log_density) = (z, log_density);
                return;
            }
            if angle < 0.0 {
                low = angle;
            } else {
                high = angle;
            }
            angle = low + (high - low) * self.rng.random::<f64>();
        }
        self.stuck += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    fn chain(log: &impl Fn(&DVector<f64>) -> f64, d: usize) -> (Vec<DVector<f64>>, usize) {
        let start = DVector::zeros(d);
        let mut chain =
            Chain::new(log, start, ChaCha8Rng::seed_from_u64(1)).expect("a density at 0");
        let reference = Reference::standard(d);
        let mut draws = Vec::new();
        for _ in 0..20_000 {
            chain.step(log, &reference);
            draws.push(chain.at.clone());
        }
        assert_eq!(chain.stuck, 0);
        (draws, chain.evaluations)
    }

    fn mean(draws: &[DVector<f64>], of: impl Fn(&DVector<f64>) -> f64) -> f64 {
        draws.iter().map(of).sum::<f64>() / draws.len() as f64
    }

    #[test]
    fn a_truncated_normal_has_the_moments_of_the_half_normal() {
        let log =
            |z: &DVector<f64>| if z[0] < 0.0 { f64::NEG_INFINITY } else { -0.5 * z.norm_squared() };
        let (draws, _) = chain(&log, 3);
        // sqrt(2/π), and 1 beside it.
        assert!((mean(&draws, |z| z[0]) - 0.797_88).abs() < 0.02);
        assert!((mean(&draws, |z| z[1] * z[1]) - 1.0).abs() < 0.04);
    }

    #[test]
    fn heavy_tails_and_a_shifted_mean_are_reached() {
        // Student's t with 5 degrees: variance 5/3; a normal 2 standard deviations away.
        let log = |z: &DVector<f64>| {
            -3.0 * (z[0] * z[0] / 5.0).ln_1p() - 0.5 * ((z[1] - 2.0) / 0.5).powi(2)
        };
        let (draws, evaluations) = chain(&log, 2);
        assert!((mean(&draws, |z| z[0] * z[0]) - 5.0 / 3.0).abs() < 0.15);
        assert!((mean(&draws, |z| z[1]) - 2.0).abs() < 0.02);
        assert!(evaluations < 100_000, "{evaluations}");
    }
}
