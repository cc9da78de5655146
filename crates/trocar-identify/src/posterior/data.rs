//! What a density is made of, for implementations of other authors: the steps of the recordings as
//! the likelihood has them, its variances, the priors, and the map from z to the parameters.

use nalgebra::DMatrix;
use serde::Serialize;

use super::super::likelihood::Column;
use super::super::prior::{Kind, Prior};
use super::super::training::Run;
use super::density::Density;

/// A density in numbers; the equations are those of `likelihood.rs` and `density.rs`.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct DensityData {
    /// σ², N².
    variance_n2: f64,
    /// λ = σ²/τ², N²; `None` where all strokes have the same friction scale.
    lambda_n2: Option<f64>,
    /// Number of joins: coordinates z that the likelihood does not depend on.
    joins: usize,
    parameters: Vec<ParameterData>,
    /// θ_w = θ̂ + L_w·z and θ = θ̂ + L_a·z, row by row.
    working: Vec<Vec<f64>>,
    adjusted: Vec<Vec<f64>>,
    /// φ_k of each stroke: the drift of its friction scale is Σ_k d_k·φ_k.
    drift: Vec<Vec<f64>>,
    /// Cluster of each stroke.
    clusters: Vec<usize>,
    runs: Vec<RunData>,
}

/// One free parameter in its unit, SI; a length along a branch relative to the half width.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct ParameterData {
    /// What it is; none for an amplitude of the drift.
    kind: Option<Kind>,
    maximum: f64,
    /// Its range; none without a bound.
    low: Option<f64>,
    high: Option<f64>,
    prior_mean: f64,
    prior_standard_deviation: f64,
}

/// The steps of an unbroken recording, column by column.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct RunData {
    displacement_m: Vec<f64>,
    duration_s: Vec<f64>,
    force_n: Vec<f64>,
    /// Samples that count as independent.
    weight: Vec<f64>,
    /// Where in the step the reading is.
    centre: Vec<f64>,
    stroke: Vec<usize>,
    /// w: how far the friction scale of the stroke has replaced that of the one before.
    blend: Vec<f64>,
}

impl Density {
    /// The density in numbers; `None` of a seal that sticks and slips: at which readings its runs begin and
    /// end, these numbers do not say.
    #[must_use]
    pub fn data(&self) -> Option<impl Serialize + use<>> {
        if self.training.runs.iter().any(|run| run.after.is_some()) {
            return None;
        }
        let scale = &self.training.scale;
        let finite = |value: f64| value.is_finite().then_some(value);
        let parameter = |j: usize| {
            let free = &self.free[j];
            let Prior { mean, deviation } = match free.column {
                Column::Drift(k) => Prior::about_zero(scale.expected[k]),
                _ => self.training.prior[j],
            };
            ParameterData {
                kind: free.kind,
                maximum: self.mode[j],
                low: finite(free.low),
                high: finite(free.high),
                prior_mean: mean,
                prior_standard_deviation: deviation,
            }
        };
        Some(DensityData {
            variance_n2: self.training.variance,
            lambda_n2: scale.is_free.then_some(scale.lambda),
            joins: self.knots,
            parameters: (0..self.free.len()).map(parameter).collect(),
            working: rows(&self.working),
            adjusted: rows(&self.adjusted),
            drift: scale.basis.clone(),
            clusters: self.training.strokes.iter().map(|stroke| stroke.cluster).collect(),
            runs: self.training.runs.iter().map(RunData::of).collect(),
        })
    }
}

impl RunData {
    fn of(run: &Run) -> Self {
        let steps = &run.steps;
        Self {
            displacement_m: steps.iter().map(|step| step.displacement).collect(),
            duration_s: steps.iter().map(|step| step.duration).collect(),
            force_n: steps.iter().map(|step| step.force).collect(),
            weight: steps.iter().map(|step| step.weight).collect(),
            centre: steps.iter().map(|step| step.centre).collect(),
            stroke: steps.iter().map(|step| step.stroke).collect(),
            blend: steps.iter().map(|step| step.blend).collect(),
        }
    }
}

fn rows(matrix: &DMatrix<f64>) -> Vec<Vec<f64>> {
    matrix.row_iter().map(|row| row.iter().copied().collect()).collect()
}
