//! The structures that the data leave open, and their weights.
//!
//! ```text
//! structures: the element with the terms chosen; without each of them; with each that was only suspected
//! ln Z_k = −C_k/(2σ²) + ½·ln|V_w| − ½·ln|V_0| + ln(posterior mass in range) − ln(prior mass in range)      weight ∝ Z_k
//! ```
//! Z_k is the marginal likelihood by Laplace's method (KASSRAFTERY), V_0 the covariance of the
//! priors. All structures are compared at the same σ², scatter and drift.

use super::super::candidate::EmsTrial;
use super::super::element::ElementFit;
use super::super::joins::Joins;
use super::super::likelihood::{self, Fitted, Stop, Trial};
use super::super::spread::variance;
use super::super::terms::{SUSPECTED, Term, TermTrial};
use super::super::training::Training;
use super::density::Density;

/// Structures with less weight are left out.
const NEGLIGIBLE: f64 = 0.02;
/// Most suspected terms that are tried.
const MOST_SUSPECTED: usize = 3;

const FIRST: Stop = Stop { iterations: 6, fall: 1e-3, promise: 10.0 * 1e-3 };
const LAST: Stop = Stop { iterations: 60, fall: 1e-6, promise: 10.0 * 1e-6 };

/// One structure at its maximum.
pub(super) struct Structure {
    pub(super) training: Training,
    pub(super) fitted: Fitted<EmsTrial>,
    pub(super) joins: Joins,
    pub(super) weight: f64,
}

impl Structure {
    /// The fit continued with the priors; `None` where no model runs.
    fn fit(training: &Training, from: &EmsTrial) -> Option<Self> {
        let mut training = training.clone();
        if training.prior.is_empty() {
            training.prior = likelihood::weak_priors_of(&from.free());
        }
        let fitted = likelihood::fit(&training, from, LAST)?;
        let (fitted, joins) = Joins::searched(&training, fitted, LAST);
        Some(Self { training, fitted, joins, weight: 0.0 })
    }

    /// Its optional terms, joined by `+`; `base` without any.
    pub(super) fn name(&self) -> String {
        let layout = &self.fitted.best.layout;
        let own: Vec<&str> =
            Term::ALL.into_iter().filter(|t| t.is_in(layout)).map(Term::name).collect();
        if own.is_empty() { "base".to_owned() } else { own.join("+") }
    }

    /// The density about its maximum.
    pub(super) fn density(&self) -> Option<Density> {
        Density::new(&self.training, &self.fitted, &self.joins)
    }

    /// ln Z.
    fn log_evidence(&self) -> Option<f64> {
        let density = self.density()?;
        let deviations = self.training.prior.iter().chain([]).map(|p| p.deviation);
        let of_drift = self.training.scale.expected.iter().copied();
        let volume_of_priors: f64 = deviations.chain(of_drift).map(f64::ln).sum();
        let [of_prior, of_posterior] = density.log_masses();
        Some(
            -0.5 * self.fitted.cost() / self.training.variance + density.log_volume
                - volume_of_priors
                + of_posterior
                - of_prior,
        )
    }
}

/// The structures with their weights, the heaviest first; empty where the fit has no density.
pub(super) fn weighted(found: &ElementFit, speeds: [f64; 2]) -> Vec<Structure> {
    let mut training = found.training.clone();
    let sigma2 = variance(&found.fitted);
    // τ² stays what it is.
    training.scale.lambda *= sigma2 / training.variance.max(f64::MIN_POSITIVE);
    training.variance = sigma2;
    let best = &found.fitted.best;
    let smaller = found.trials.iter().filter(|t| t.kept).filter_map(|t| t.term.left_out_of(best));
    let mut suspected: Vec<&TermTrial> = found
        .trials
        .iter()
        .filter(|t| {
            let is_open = t.why_not.is_none() || !t.shift.is_empty();
            !t.kept && t.p_value < SUSPECTED && is_open
        })
        .collect();
    suspected.sort_by(|a, b| a.p_value.total_cmp(&b.p_value));
    let larger = suspected
        .into_iter()
        .take(MOST_SUSPECTED)
        .filter_map(|t| with_term(&training, best, t.term, speeds));
    let trials = std::iter::once(best.clone()).chain(smaller).chain(larger);
    let mut all: Vec<(f64, Structure)> = trials
        .filter_map(|trial| Structure::fit(&training, &trial))
        .filter_map(|structure| Some((structure.log_evidence()?, structure)))
        .collect();
    let most = all.iter().map(|(z, _)| *z).fold(f64::NEG_INFINITY, f64::max);
    let weigh = |all: &mut Vec<(f64, Structure)>| {
        let total: f64 = all.iter().map(|(z, _)| (z - most).exp()).sum();
        all.iter_mut().for_each(|(z, s)| s.weight = (*z - most).exp() / total);
    };
    weigh(&mut all);
    all.retain(|(_, s)| s.weight >= NEGLIGIBLE);
    weigh(&mut all);
    all.sort_by(|a, b| b.1.weight.total_cmp(&a.1.weight));
    all.into_iter().map(|(_, structure)| structure).collect()
}

/// The best start with one more term.
fn with_term(
    training: &Training,
    best: &EmsTrial,
    term: Term,
    speeds: [f64; 2],
) -> Option<EmsTrial> {
    let fit = |start: EmsTrial| likelihood::fit(training, &start, FIRST);
    let fits = term.variants(best, speeds).into_iter().filter_map(fit);
    fits.min_by(|a, b| a.cost().total_cmp(&b.cost())).map(|fitted| fitted.best)
}
