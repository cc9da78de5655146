//! Replicates of a fit, and the intervals derived from them.

use statrs::statistics::{Data, Distribution, OrderStatistics};

use super::estimate::Estimate;

/// Replicates of a fit, and the method by which they give an interval.
pub(crate) enum Replicates<T> {
    /// Clusters left out one at a time: variance, Student's t.
    Jackknife(Vec<T>),
    /// Clusters resampled: percentiles.
    Bootstrap(Vec<T>),
}

impl<T> Replicates<T> {
    /// A parameter of the best fit with its 95 % interval.
    pub(crate) fn estimate(
        &self,
        best: &T,
        unit: &'static str,
        of: &dyn Fn(&T) -> f64,
    ) -> Estimate {
        let value = of(best);
        let (Self::Jackknife(all) | Self::Bootstrap(all)) = self;
        if all.iter().all(|c| of(c) == value) {
            return Estimate::undetermined(value, unit, "the readings do not depend on it");
        }
        match self {
            Self::Jackknife(left_out) => {
                let g = left_out.len() as f64;
                let values: Vec<f64> = left_out.iter().map(of).collect();
                let mean = values.iter().sum::<f64>() / g.max(1.0);
                let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
                let error = ((g - 1.0) / g * squares).sqrt();
                Estimate::from_standard_error(value, error, g - 1.0, unit)
            }
            Self::Bootstrap(resampled) if resampled.len() >= 20 => {
                let mut values = Data::new(resampled.iter().map(of).collect::<Vec<f64>>());
                let own = Estimate::from_bounds(
                    value,
                    values.quantile(0.025),
                    values.quantile(0.975),
                    unit,
                );
                Estimate { standard_error: values.std_dev(), ..own }
            }
            Self::Bootstrap(_) => {
                Estimate::undetermined(value, unit, "too few resamples for an interval")
            }
        }
    }
}
