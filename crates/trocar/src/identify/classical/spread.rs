//! Intervals of the classical models' parameters, and whether the data pin them at all.

use nalgebra::{DMatrix, DVector};

use crate::identify::estimate::{Estimate, t_quantile};
use crate::identify::output_error::{Fitted, Trial};

/// Width of the weak prior on a number, in steps of its difference quotient: four orders of magnitude of a logarithm,
/// ten times the sliding force.
const PRIOR_WIDTH: f64 = 1e5;
/// A number known no better than within this factor either way counts as not pinned.
const WORST_FACTOR: f64 = 10.0;
/// So does one whose interval is this many times wider than itself and than its scale.
const WORST_RATIO: f64 = 10.0;

/// How a fit scatters, to first order.
pub(super) struct Spread {
    /// With one cluster left out each.
    departures: Vec<DVector<f64>>,
    /// As if all samples were independent.
    covariance: DMatrix<f64>,
    /// Degrees of freedom of Student's t.
    degrees: f64,
    /// Ratio of the clusters' variance to that of independent samples, in the median over the free numbers.
    inflation: f64,
}

/// A number that follows from the free ones: value, gradient, and what its interval is measured by.
pub(super) struct Dependent {
    pub(super) value: f64,
    pub(super) gradient: DVector<f64>,
    pub(super) scale: f64,
    /// Whether value and gradient are those of the logarithm.
    pub(super) log: bool,
}

impl Spread {
    pub(super) fn new<T: Trial>(found: &Fitted<T>) -> Self {
        let free = found.best.free();
        let widths: Vec<f64> = free.iter().map(|f| PRIOR_WIDTH * f.step).collect();
        let (departures, covariance) = found.departures(&widths);
        let degrees = found.effective_clusters() - 1.0;
        let mut spread = Self { departures, covariance, degrees, inflation: 1.0 };
        let unit = |j: usize| DVector::from_fn(free.len(), |i, _| f64::from(i == j));
        let ratio = |j: usize| spread.jackknife(&unit(j)) / spread.covariance[(j, j)];
        let mut ratios: Vec<f64> = (0..free.len()).filter(|j| !found.held[*j]).map(ratio).collect();
        ratios.sort_by(f64::total_cmp);
        spread.inflation = ratios.get(ratios.len() / 2).copied().unwrap_or(1.0).max(1.0);
        spread
    }

    /// Variance by the jackknife over clusters.
    fn jackknife(&self, gradient: &DVector<f64>) -> f64 {
        let g = self.departures.len() as f64;
        let values: Vec<f64> = self.departures.iter().map(|d| gradient.dot(d)).collect();
        let mean = values.iter().sum::<f64>() / g.max(1.0);
        (g - 1.0) / g * values.iter().map(|v| (v - mean).powi(2)).sum::<f64>()
    }

    /// The number with its interval, or without one where the data do not pin it.
    pub(super) fn estimate(&self, number: &Dependent, unit: &'static str) -> Estimate {
        let Dependent { value, ref gradient, scale, log } = *number;
        let plain = |u: f64| if log { u.exp() } else { u };
        // A direction that no cluster tells anything about scatters over none of them; the covariance sees it.
        let as_independent = self.inflation * gradient.dot(&(&self.covariance * gradient));
        let worst = t_quantile(1e6) * as_independent.max(0.0).sqrt();
        let limit = if log { WORST_FACTOR.ln() } else { WORST_RATIO * value.abs().max(scale) };
        let own = Estimate::from_standard_error(value, self.jackknife(gradient).sqrt(), self.degrees, unit);
        if !own.pinned {
            return Estimate { value: plain(value), ..own };
        }
        let half = own.half_width().max(worst);
        if half > limit {
            let why = match log {
                true => format!("known no better than within a factor of {:.0}", half.min(50.0).exp()),
                false => format!("known no better than within ±{half:.2e} {unit}"),
            };
            return Estimate::not_pinned(plain(value), unit, why);
        }
        Estimate { value: plain(value), ci95: own.ci95.map(plain), ..own }
    }
}
