//! Errors of one model on common samples.

use trocar_model::Trocar;

use crate::margin::by_stroke;
use crate::validate::{Phase, Phases, Sums, phases_of};
use trocar_identify::Identification;
use trocar_recording::Recording;
use trocar_simulate::replay::{forces, replay};
use trocar_simulate::segment::{reversal_threshold, strokes, travel};

use super::Scores;

/// Fewest scored samples of a reversal.
const FEWEST: usize = 5;
/// Most residuals for the autocorrelation; longer series are decimated.
const MOST_RESIDUALS: usize = 20_000;

/// One recording with its scored samples.
struct Ground<'a> {
    recording: &'a Recording,
    scored: Vec<usize>,
    /// Ranges of `scored` after each reversal.
    reversals: Vec<std::ops::Range<usize>>,
    phases: Vec<Phase>,
}

/// The samples on which all models are scored.
pub(super) struct Grounds<'a> {
    training: Vec<Ground<'a>>,
    validation: Vec<Ground<'a>>,
}

/// Errors before they are summarized.
pub(super) struct Raw {
    training: Vec<f64>,
    validation: Vec<Vec<f64>>,
}

impl<'a> Ground<'a> {
    fn new(ems: &Identification, recording: &'a Recording, reversal_travel: f64) -> Self {
        let run = replay(&Trocar::of_seal(ems.stages), recording, ems.model.offset);
        let known: Vec<usize> = run.known.iter().cloned().flatten().collect();
        let scored = if known.is_empty() { (0..recording.len()).collect() } else { known };
        let reversed = strokes(recording, reversal_threshold(recording))
            .into_iter()
            .filter(|p| p.starts_at_reversal);
        let reversals = reversed
            .map(|stroke| {
                let end = (stroke.start..stroke.end)
                    .find(|i| travel(recording, &stroke, *i) > reversal_travel);
                let from = scored.partition_point(|i| *i < stroke.start);
                from..scored.partition_point(|i| *i < end.unwrap_or(stroke.end))
            })
            .filter(|range| range.len() >= FEWEST)
            .collect();
        let phases = phases_of(recording, &run, &scored);
        Self { recording, scored, reversals, phases }
    }

    fn errors(&self, model: &Trocar, offset: f64) -> Vec<f64> {
        let forces = forces(model, self.recording, offset);
        self.scored.iter().map(|i| self.recording.force[*i] - offset - forces[*i]).collect()
    }

    fn readings(&self) -> impl Iterator<Item = f64> + '_ {
        self.scored.iter().map(|i| self.recording.force[*i])
    }

    /// Of the `errors` after each reversal.
    fn at_reversals(&self, errors: &[f64]) -> impl Iterator<Item = Sums> {
        let own = self.reversals.iter().map(|range| &errors[range.clone()]);
        own.map(|errors| Sums::of(errors.iter().map(|e| (*e, 0.0))))
    }
}

impl<'a> Grounds<'a> {
    pub(super) fn new(
        ems: &Identification,
        training: &'a [Recording],
        validation: &'a [Recording],
        reversal_travel: f64,
    ) -> Self {
        let [training, validation] = [training, validation]
            .map(|all| all.iter().map(|r| Ground::new(ems, r, reversal_travel)).collect());
        Self { training, validation }
    }

    pub(super) fn training_samples(&self) -> usize {
        self.training.iter().map(|g| g.scored.len()).sum()
    }

    pub(super) fn raw(&self, model: &Trocar, offset: f64) -> Raw {
        Raw {
            training: self.training.iter().flat_map(|g| g.errors(model, offset)).collect(),
            validation: self.validation.iter().map(|g| g.errors(model, offset)).collect(),
        }
    }

    /// n / (1 + 2 Σρ_k) of the residuals of `reference`, with the autocorrelation summed up to its
    /// first zero.
    pub(super) fn effective_samples(&self, reference: &Raw) -> f64 {
        let every = reference.training.len().div_ceil(MOST_RESIDUALS).max(1);
        let thinned: Vec<f64> = reference.training.iter().step_by(every).copied().collect();
        let n = thinned.len() as f64;
        let power: f64 = thinned.iter().map(|e| e * e).sum();
        let positive: f64 = (1..thinned.len() / 4)
            .map(|lag| {
                thinned.iter().zip(&thinned[lag..]).map(|(a, b)| a * b).sum::<f64>()
                    / power.max(1e-300)
            })
            .take_while(|rho| *rho > 0.0)
            .sum();
        n / (1.0 + 2.0 * positive)
    }

    pub(super) fn scores(&self, raw: &Raw, parameters: usize, effective: f64) -> Scores {
        let n = raw.training.len().max(1) as f64;
        let mean_square = raw.training.iter().map(|e| e * e).sum::<f64>() / n;
        let validation = self.validation.iter().zip(&raw.validation);
        let own: Vec<Sums> = validation
            .clone()
            .map(|(g, errors)| Sums::of(errors.iter().copied().zip(g.readings())))
            .collect();
        let all = own.iter().fold(Sums::default(), |a, b| a.plus(*b));
        let reversals: Vec<Sums> =
            validation.flat_map(|(g, errors)| g.at_reversals(errors)).collect();
        let with_reversals = |error: f64| if reversals.is_empty() { f64::NAN } else { error };
        // The offset and the residual variance are also estimated.
        let estimated = (parameters + 2) as f64;
        let deviance = effective * mean_square.max(1e-300).ln();
        Scores {
            train_rms_n: mean_square.sqrt(),
            validate_rms_n: all.rms(),
            fit_percent: all.fit_percent(),
            aic: deviance + 2.0 * estimated,
            bic: deviance + estimated * effective.max(1.0).ln(),
            reversal_rms_n: with_reversals(
                reversals.iter().fold(Sums::default(), |a, b| a.plus(*b)).rms(),
            ),
            worst_reversal_n: with_reversals(reversals.iter().map(Sums::rms).fold(0.0, f64::max)),
            by_phase: self.by_phase(raw),
            by_recording_n: own.iter().map(Sums::rms).collect(),
        }
    }

    /// Mean squared error of each stroke of the validation, N².
    pub(super) fn by_stroke(&self, raw: &Raw) -> Vec<f64> {
        let errors = self.validation.iter().zip(&raw.validation);
        errors.flat_map(|(g, errors)| by_stroke(g.recording, &g.scored, errors)).collect()
    }

    fn by_phase(&self, raw: &Raw) -> Phases {
        let errors = self.validation.iter().zip(&raw.validation);
        Phases::of(
            errors.flat_map(|(g, errors)| g.phases.iter().copied().zip(errors.iter().copied())),
        )
    }
}
