//! An estimated parameter with its 95 % interval, and the linear least squares used for
//! most of them.

use nalgebra::{DMatrix, DVector};
use serde::Serialize;
use statrs::distribution::{ContinuousCDF, FisherSnedecor, StudentsT};

/// Degrees of freedom with which Student's t is normal.
pub(super) const MANY_DEGREES: f64 = 1e6;

/// An estimated parameter: value, 95 % interval, unit, and whether the data determine it.
///
/// Invariant: `low <= value <= high`. A parameter that the data do not determine has an infinite
/// interval, and `note` states why. In JSON an infinite bound is `null`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Estimate {
    /// Best value, in `unit`.
    pub value: f64,
    /// 95 % interval, low and high end, in `unit`.
    pub ci95: [f64; 2],
    /// Unit, spelled as in the parameter's name (`N`, `N s/m`, `m`).
    pub unit: &'static str,
    /// Whether the data determine the parameter.
    pub determined: bool,
    /// Standard error, to first order, in `unit`; `None` where the interval does not come from one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub standard_error: Option<f64>,
    /// Why it is not determined, or under which condition the value holds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
}

impl Estimate {
    /// Estimate with a symmetric interval from a standard error and Student's t with `degrees` of
    /// freedom.
    ///
    /// Without a degree of freedom, or with a standard error that is not finite, the interval is
    /// infinite.
    pub(crate) fn from_standard_error(
        value: f64,
        standard_error: f64,
        degrees: f64,
        unit: &'static str,
    ) -> Self {
        let half = t_quantile(degrees) * standard_error;
        if !half.is_finite() {
            return Self::undetermined(value, unit, "too few independent data for an interval");
        }
        let (low, high) = (value - half, value + half);
        Self { standard_error: Some(standard_error), ..Self::from_bounds(value, low, high, unit) }
    }

    /// Estimate with given bounds, widened if necessary to contain the value.
    pub fn from_bounds(value: f64, low: f64, high: f64, unit: &'static str) -> Self {
        let ci95 = [low.min(value), high.max(value)];
        Self { value, ci95, unit, determined: true, standard_error: None, note: None }
    }

    /// A value that the data do not determine: infinite interval, and the reason.
    pub fn undetermined(value: f64, unit: &'static str, why: impl Into<String>) -> Self {
        let ci95 = [f64::NEG_INFINITY, f64::INFINITY];
        Self { value, ci95, unit, determined: false, standard_error: None, note: Some(why.into()) }
    }

    /// A value that was given, not identified.
    pub(crate) fn given(value: f64, unit: &'static str) -> Self {
        Self::from_bounds(value, value, value, unit).with_note("given, not identified")
    }

    /// The same estimate with a remark.
    pub(crate) fn with_note(mut self, note: impl Into<String>) -> Self {
        self.note = Some(note.into());
        self
    }

    /// The same estimate with a further independent error, 95 % of which is within `half`.
    pub(super) fn with_further(&self, half: f64) -> Self {
        if half == 0.0 || !self.determined {
            return self.clone();
        }
        let value = self.value;
        let [low, high] = self.ci95.map(|end| (end - value).hypot(half));
        let (ci95, own) = ([value - low, value + high], half / t_quantile(MANY_DEGREES));
        Self { ci95, standard_error: self.standard_error.map(|e| e.hypot(own)), ..self.clone() }
    }

    /// Whether the interval contains `value`.
    pub fn covers(&self, value: f64) -> bool {
        self.ci95[0] <= value && value <= self.ci95[1]
    }

    /// Half the width of the interval, in `unit`.
    pub fn half_width(&self) -> f64 {
        0.5 * (self.ci95[1] - self.ci95[0])
    }
}

/// Two-sided 95 % quantile of Student's t; infinite without a degree of freedom.
pub fn t_quantile(degrees: f64) -> f64 {
    match StudentsT::new(0.0, 1.0, degrees) {
        Ok(t) if degrees > 0.0 => t.inverse_cdf(0.975),
        _ => f64::INFINITY,
    }
}

/// Two-sided p value of a t statistic; 1 without a degree of freedom.
pub(crate) fn t_p_value(statistic: f64, degrees: f64) -> f64 {
    match StudentsT::new(0.0, 1.0, degrees) {
        Ok(t) if degrees > 0.0 && statistic.is_finite() => 2.0 * t.cdf(-statistic.abs()),
        _ => 1.0,
    }
}

/// Upper-tail p value of an F statistic; 1 where it is not defined.
pub(crate) fn f_p_value(statistic: f64, numerator: f64, denominator: f64) -> f64 {
    match FisherSnedecor::new(numerator, denominator) {
        Ok(f) if statistic.is_finite() && statistic > 0.0 => f.sf(statistic),
        _ => 1.0,
    }
}

/// Weighted linear least squares: coefficients, their covariance and the weighted residual sum of
/// squares.
#[derive(Debug, Clone)]
pub(crate) struct LinearFit {
    pub coefficients: DVector<f64>,
    /// (XᵀWX)⁻¹ times the weighted residual variance.
    pub covariance: DMatrix<f64>,
    pub residuals: DVector<f64>,
    pub weighted_rss: f64,
    pub degrees: f64,
}

impl LinearFit {
    /// `None` when the columns are not independent or there are fewer rows than columns.
    pub(crate) fn new(
        design: &DMatrix<f64>,
        data: &DVector<f64>,
        weights: &DVector<f64>,
    ) -> Option<Self> {
        let (rows, columns) = design.shape();
        if rows < columns {
            return None;
        }
        let root = weights.map(f64::sqrt);
        let weighted = DMatrix::from_fn(rows, columns, |i, j| root[i] * design[(i, j)]);
        // Scale columns to unit length: independence is then judged regardless of units.
        let scale: Vec<f64> =
            (0..columns).map(|j| weighted.column(j).norm().max(f64::MIN_POSITIVE)).collect();
        let scaled = DMatrix::from_fn(rows, columns, |i, j| weighted[(i, j)] / scale[j]);
        let qr = scaled.qr();
        let r = qr.r();
        if (0..columns).any(|j| r[(j, j)].abs() < 1e-9) {
            return None;
        }
        let rhs = qr.q().transpose() * data.component_mul(&root);
        let inverse = r.try_inverse()?;
        let coefficients = DVector::from_iterator(
            columns,
            (&inverse * rhs).iter().zip(&scale).map(|(y, s)| y / s),
        );
        let residuals = data - design * &coefficients;
        let weighted_rss =
            residuals.iter().zip(weights.iter()).map(|(e, w)| w * e * e).sum::<f64>();
        let degrees = (rows - columns) as f64;
        let variance = if degrees > 0.0 { weighted_rss / degrees } else { f64::INFINITY };
        let normal = &inverse * inverse.transpose();
        let covariance = DMatrix::from_fn(columns, columns, |i, j| {
            variance * normal[(i, j)] / (scale[i] * scale[j])
        });
        Some(Self { coefficients, covariance, residuals, weighted_rss, degrees })
    }

    /// Coefficient `j` with its 95 % interval.
    pub(crate) fn estimate(&self, j: usize, unit: &'static str) -> Estimate {
        self.combination(&[(j, 1.0)], unit)
    }

    /// A linear combination of coefficients with its 95 % interval.
    pub(crate) fn combination(&self, terms: &[(usize, f64)], unit: &'static str) -> Estimate {
        let value = terms.iter().map(|(j, a)| a * self.coefficients[*j]).sum();
        let mut variance = 0.0;
        for (j, a) in terms {
            for (k, b) in terms {
                variance += a * b * self.covariance[(*j, *k)];
            }
        }
        Estimate::from_standard_error(value, variance.max(0.0).sqrt(), self.degrees, unit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// NIST StRD, data set Norris: certified coefficients and standard deviations of a straight
    /// line.
    #[test]
    fn straight_line_agrees_with_the_certified_values_of_nist_norris() {
        // (y, x)
        let data = [
            (0.1, 0.2),
            (338.8, 337.4),
            (118.1, 118.2),
            (888.0, 884.6),
            (9.2, 10.1),
            (228.1, 226.5),
            (668.5, 666.3),
            (998.5, 996.3),
            (449.1, 448.6),
            (778.9, 777.0),
            (559.2, 558.2),
            (0.3, 0.4),
            (0.1, 0.6),
            (778.1, 775.5),
            (668.8, 666.9),
            (339.3, 338.0),
            (448.9, 447.5),
            (10.8, 11.6),
            (557.7, 556.0),
            (228.3, 228.1),
            (998.0, 995.8),
            (888.8, 887.6),
            (119.6, 120.2),
            (0.3, 0.3),
            (0.6, 0.3),
            (557.6, 556.8),
            (339.3, 339.1),
            (888.0, 887.2),
            (998.5, 999.0),
            (778.9, 779.0),
            (10.2, 11.1),
            (117.6, 118.3),
            (228.9, 229.2),
            (668.4, 669.1),
            (449.2, 448.9),
            (0.2, 0.5),
        ];
        let y = DVector::from_iterator(36, data.iter().map(|d| d.0));
        let fit = LinearFit::new(
            &DMatrix::from_fn(36, 2, |i, j| if j == 0 { 1.0 } else { data[i].1 }),
            &y,
            &DVector::from_element(36, 1.0),
        )
        .expect("two independent columns");
        assert!(
            (fit.coefficients[0] - -0.262323073774029).abs() < 1e-10,
            "{}",
            fit.coefficients[0]
        );
        assert!((fit.coefficients[1] - 1.00211681802045).abs() < 1e-12, "{}", fit.coefficients[1]);
        assert!((fit.covariance[(0, 0)].sqrt() - 0.232818234301152).abs() < 1e-10);
        assert!((fit.covariance[(1, 1)].sqrt() - 0.429796848199937e-3).abs() < 1e-12);
    }

    #[test]
    fn dependent_columns_are_refused() {
        let design = DMatrix::from_fn(5, 2, |i, j| (i as f64 + 1.0) * (j as f64 + 1.0));
        assert!(
            LinearFit::new(&design, &DVector::from_element(5, 1.0), &DVector::from_element(5, 1.0))
                .is_none()
        );
    }

    #[test]
    fn quantiles_agree_with_printed_tables() {
        assert!((t_quantile(33.0) - 2.0345).abs() < 1e-4);
        assert!((t_p_value(2.0345, 33.0) - 0.05).abs() < 1e-5);
        assert!((f_p_value(4.1393, 1.0, 33.0) - 0.05).abs() < 1e-4);
        assert!(t_quantile(0.0).is_infinite());
    }
}
