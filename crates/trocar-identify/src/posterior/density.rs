//! The density of the free parameters of one structure, in coordinates in which it is nearly
//! standard normal.
//!
//! ```text
//! ln π_w(θ) = −C(θ)/(2σ²) + const                      working posterior: likelihood.rs, with the priors of prior.rs in C
//! θ_w = θ̂ + L_w·z      L_w·L_w' = V_w = σ²·H⁻¹         z from π_w: standard normal to second order
//! θ   = θ̂ + L_a·z      L_a·L_a' = V_a                  the draw that is reported
//! ```
//! Residuals are correlated, so that V_w is too narrow whatever σ² is: it counts neighbouring
//! samples as independent. The draws therefore get the covariance V_a of the jackknife over
//! clusters of strokes, as the intervals have (spread.rs, numbers.rs), by an affine map of the draws
//! of π_w: the open-faced sandwich of SHABY. What the data say nothing about keeps the width of its
//! prior, since there V_a and V_w are both that of the prior.
//!
//! ```text
//! V_a = D·(ν·(V_J + V_w·Λ·V_w) + ν_0·V_w)/(ν + ν_0)·D     V_J jackknife over ν + 1 clusters, Λ precisions of the priors
//! ```
//! The jackknife of few clusters is uncertain itself; it is moderated by V_w as the variances of
//! optional terms are (SMYTH). D widens by the factors of numbers.rs and of Student's t, and so that
//! no parameter is narrower than under π_w. Points that leave the range of a parameter, in θ or θ_w,
//! have no density. Where the density is a curved ridge, both maps follow it (joins.rs).

use std::fmt;

use nalgebra::{DMatrix, DVector};
use trocar_model::ParameterId;

use super::super::candidate::EmsTrial;
use super::super::estimate::{MANY_DEGREES, t_quantile};
use super::super::joins::Joins;
use super::super::likelihood::{self, Fitted, Free, MODEL_DEGREES, Trial};
use super::super::prior::{Kind, Prior};
use super::super::spread::{self, Spread};
use super::super::training::Training;
use super::joins::FollowedJoin;

/// The density of one structure that draws were taken from, for other samplers: of d coordinates
/// z, nearly standard normal.
#[derive(Clone)]
pub struct Density {
    pub(super) training: Training,
    best: EmsTrial,
    pub(super) free: Vec<Free>,
    pub(super) mode: DVector<f64>,
    /// L_w and L_a.
    pub(super) working: DMatrix<f64>,
    pub(super) adjusted: DMatrix<f64>,
    /// Number of joins: the first coordinates.
    pub(super) knots: usize,
    joins: Vec<FollowedJoin>,
    /// C(θ̂).
    least: f64,
    /// ½·ln|V_w|.
    pub(super) log_volume: f64,
}

impl fmt::Debug for Density {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.debug_struct("Density").field("dimension", &self.dimension()).finish_non_exhaustive()
    }
}

impl Density {
    /// About the maximum `fitted`; `None` where its information is not positive definite.
    pub(super) fn new(
        training: &Training,
        fitted: &Fitted<EmsTrial>,
        joins: &Joins,
    ) -> Option<Self> {
        let free = fitted.best.free();
        let covariance = inverse(&fitted.sums().0)? * training.variance;
        let adjusted = adjusted(fitted, &covariance, &free, training.variance);
        let (knots, others): (Vec<usize>, Vec<usize>) =
            (0..free.len()).partition(|j| free[*j].kind == Some(Kind::Join));
        let order = [knots.as_slice(), others.as_slice()].concat();
        let [working, adjusted] = [factor(&covariance, &order)?, factor(&adjusted, &order)?];
        let log_volume = order.iter().enumerate().map(|(k, row)| working[(*row, k)].ln()).sum();
        Some(Self {
            training: training.clone(),
            best: fitted.best.clone(),
            mode: DVector::from_iterator(free.len(), free.iter().map(|f| f.value)),
            knots: knots.len(),
            joins: FollowedJoin::all(&fitted.best, &free, joins),
            free,
            working,
            adjusted,
            least: fitted.cost(),
            log_volume,
        })
    }

    /// Number d of coordinates.
    #[must_use]
    pub fn dimension(&self) -> usize {
        self.free.len()
    }

    /// ln π_w less its value at the maximum; −∞ outside the ranges and where there is no model.
    pub(super) fn log(&self, z: &DVector<f64>) -> f64 {
        let working = self.working_values(z);
        let drawn = self.drawn(z);
        if !(self.is_within(&working) && self.is_within(&drawn))
            || self.trial(&drawn).model().is_none()
        {
            return f64::NEG_INFINITY;
        }
        let cost = likelihood::cost(&self.training, &self.trial(&working));
        let of_knots = z.rows(0, self.knots).norm_squared();
        -0.5 * ((cost - self.least) / self.training.variance + of_knots)
    }

    /// ln π_w at the first [`Density::dimension`] numbers of `z`, less its value at 0; −∞ where there
    /// is no model, or too few numbers.
    #[must_use]
    pub fn log_density(&self, z: &[f64]) -> f64 {
        match z.get(..self.dimension()) {
            Some(z) => self.log(&DVector::from_column_slice(z)),
            None => f64::NEG_INFINITY,
        }
    }

    /// The value of a parameter at `z`, SI; NaN for what the structure does not have, or with too
    /// few numbers.
    #[must_use]
    pub fn parameter(&self, z: &[f64], id: ParameterId) -> f64 {
        z.get(..self.dimension()).map_or(f64::NAN, |z| self.at(z).candidate.value(id))
    }

    /// The same under π_w, before the draws get the covariance of the jackknife.
    #[must_use]
    pub fn working_parameter(&self, z: &[f64], id: ParameterId) -> f64 {
        let working = |z| self.working_values(&DVector::from_column_slice(z));
        z.get(..self.dimension()).map_or(f64::NAN, |z| self.trial(&working(z)).candidate.value(id))
    }

    /// The trial at z.
    pub(super) fn at(&self, z: &[f64]) -> EmsTrial {
        self.trial(&self.drawn(&DVector::from_column_slice(z)))
    }

    /// θ_w with the joins at their estimates.
    fn working_values(&self, z: &DVector<f64>) -> DVector<f64> {
        let mut held = z.clone();
        held.rows_mut(0, self.knots).fill(0.0);
        &self.mode + &self.working * held
    }

    /// θ.
    fn drawn(&self, z: &DVector<f64>) -> DVector<f64> {
        let mut values = &self.mode + &self.adjusted * z;
        self.joins.iter().for_each(|join| join.follow(&self.adjusted, &mut values));
        values
    }

    fn is_within(&self, values: &DVector<f64>) -> bool {
        self.free.iter().zip(values.iter()).all(|(f, v)| (f.low..=f.high).contains(v))
    }

    fn trial(&self, values: &DVector<f64>) -> EmsTrial {
        self.best.with_any(values.as_slice())
    }

    /// ln of the probability of the ranges under the priors and under the normal approximation.
    pub(super) fn log_masses(&self) -> [f64; 2] {
        let of_posterior = |j: usize| {
            let own = Prior::new(self.mode[j], self.working.row(j).norm());
            own.mass_within(self.free[j].range()).ln()
        };
        let of_prior = |(f, prior): (&Free, &Prior)| prior.mass_within(f.range()).ln();
        [
            self.free.iter().zip(&self.training.prior).map(of_prior).sum(),
            (0..self.free.len()).map(of_posterior).sum(),
        ]
    }
}

/// V_a.
fn adjusted(
    fitted: &Fitted<EmsTrial>,
    working: &DMatrix<f64>,
    free: &[Free],
    variance: f64,
) -> DMatrix<f64> {
    let (jackknife, clusters) = Spread::new(fitted).jackknifed();
    let precisions = DMatrix::from_diagonal(&DVector::from_vec(fitted.prior_precisions()));
    let of_priors = working * precisions * working / variance;
    let degrees = (clusters as f64 - 1.0).max(0.0);
    let moderated =
        ((jackknife + of_priors) * degrees + working * MODEL_DEGREES) / (degrees + MODEL_DEGREES);
    let of_t = t_quantile(degrees + MODEL_DEGREES) / t_quantile(MANY_DEGREES);
    let widening = |j: usize| {
        let least = (working[(j, j)] / moderated[(j, j)]).sqrt().max(1.0);
        least.max(of_t * free[j].kind.map_or(1.0, widening))
    };
    let d = DMatrix::from_diagonal(&DVector::from_fn(free.len(), |j, _| widening(j)));
    &d * moderated * &d
}

/// Factor on the standard deviation of a free parameter, as on its interval.
fn widening(kind: Kind) -> f64 {
    match kind {
        Kind::SlidingForce | Kind::Offset => spread::LEVEL,
        Kind::Damping => spread::SLOPE,
        Kind::Join | Kind::JoinForce | Kind::Bend => spread::SHAPE,
        Kind::HalfWidth => spread::WIDTH,
        Kind::UnmodelledMass => spread::MASS,
        _ => 1.0,
    }
}

/// L with L·L' = `covariance`, whose rows may have very different units: triangular where its rows
/// are in `order`.
fn factor(covariance: &DMatrix<f64>, order: &[usize]) -> Option<DMatrix<f64>> {
    let p = covariance.nrows();
    let scale: Vec<f64> = (0..p).map(|j| covariance[(j, j)].sqrt()).collect();
    let correlation = DMatrix::from_fn(p, p, |i, j| {
        let [i, j] = [order[i], order[j]];
        covariance[(i, j)] / (scale[i] * scale[j])
    });
    let lower = correlation.cholesky()?.unpack();
    let mut factor = DMatrix::zeros(p, p);
    for (k, row) in order.iter().enumerate() {
        factor.row_mut(*row).copy_from(&(lower.row(k) * scale[*row]));
    }
    Some(factor)
}

/// Inverse of a positive definite matrix.
fn inverse(matrix: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let p = matrix.nrows();
    let scale: Vec<f64> = (0..p).map(|j| matrix[(j, j)].sqrt()).collect();
    let unit = DMatrix::from_fn(p, p, |i, j| matrix[(i, j)] / (scale[i] * scale[j]));
    let inverse = unit.cholesky()?.inverse();
    Some(DMatrix::from_fn(p, p, |i, j| inverse[(i, j)] / (scale[i] * scale[j])))
}
