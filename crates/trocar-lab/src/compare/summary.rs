//! Results of a comparison: `compare.json` and the models.
//!
//! The files contain names and hashes but no folders, and no times unless timing was requested:
//! equal input gives equal bytes.

use std::collections::BTreeMap;

use serde::Serialize;

use trocar_model::Trocar;

use crate::margin::Margin;
use crate::summary::{PROGRAM, by_name, intervals, json_text, origin_of};
use crate::validate::{Phases, validate};
use crate::workflow::MovingMass;
use trocar_identify::{Estimate, Identification, Warning};
use trocar_recording::Recording;
use trocar_recording::loads::Load;
use trocar_runtime::model_file::{ModelFile, Origin};

use super::{Choice, Comparison, Entry, ReversalMatch, reversal_match};

/// Families of banks to which the claim of EMS section II-C applies.
const BANKS: [&str; 2] = ["maxwell-slip", "gms"];

/// A comparison and its inputs.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// The result.
    pub comparison: Comparison,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Whether the validation recordings are the last thirds of the training recordings
    /// ([`split`](super::split)), because no others were given.
    pub held_out: bool,
    /// Mass that was subtracted from the readings.
    pub moving_mass: MovingMass,
}

/// `compare.json`.
#[derive(Debug, Clone, Serialize)]
pub struct Summary<'a> {
    /// Program and version.
    pub program: &'static str,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Whether the validation recordings are the last thirds of the training recordings.
    pub held_out: bool,
    /// Number of scored samples of the training recordings.
    pub samples: usize,
    /// Equivalent number of independent samples.
    pub effective_samples: f64,
    /// Travel after a reversal over which its error is evaluated, m.
    pub reversal_travel_m: f64,
    /// Mass that was subtracted from the readings.
    pub moving_mass: MovingMass,
    /// Unmodelled mass found in the readings, also subtracted from them, kg.
    pub unmodelled_mass_kg: f64,
    /// Which model has the least error, and by how much; empty for a single family.
    pub verdict: String,
    /// One entry per model, least validation error first.
    pub(crate) models: Vec<ModelSummary<'a>>,
    /// The claim of section II-C of the paper for each family of banks that was compared.
    pub(crate) reversal_claim: Vec<ClaimSummary>,
    /// All recordings.
    pub(crate) recordings: Vec<RecordingSummary<'a>>,
}

/// One model in the summary.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct ModelSummary<'a> {
    /// Name of the family.
    pub name: &'static str,
    /// Number of elements.
    pub elements: usize,
    /// Number of estimated parameters, without the sensor offset that all models have.
    pub parameters: usize,
    /// Root mean square error, N, on the training recordings.
    pub train_rms_n: f64,
    /// The same on the validation recordings.
    pub validate_rms_n: f64,
    /// 100·(1 − rms/sd of the readings), %, on the validation recordings.
    pub fit_percent: f64,
    /// Akaike's criterion on the training recordings.
    pub aic: f64,
    /// Bayesian (Schwarz) criterion, likewise.
    pub bic: f64,
    /// Root mean square error, N, after the reversals of the validation.
    pub reversal_rms_n: f64,
    /// The same for the worst single reversal, N.
    pub worst_reversal_n: f64,
    /// By how much the first model predicts the strokes of the validation better; `None` for too
    /// few strokes.
    pub behind_best: Option<Margin>,
    /// Error on the validation recordings by phase.
    pub by_phase: &'a Phases,
    /// Error of each validation recording.
    pub by_recording: Vec<RecordingError<'a>>,
    /// Time of one step, ns; `None` without timing.
    pub ns_per_sample: Option<f64>,
    /// Time of the fit, s; `None` without timing.
    pub fit_s: Option<f64>,
    /// Sensor offset F_0, N.
    pub offset_n: f64,
    /// Parameters by name with unit.
    pub estimates: BTreeMap<String, &'a Estimate>,
    /// Warnings about the fit, beginning with their subject.
    pub warnings: Vec<String>,
}

/// Error of a model on one recording.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(crate) struct RecordingError<'a> {
    /// File name without its folder.
    pub name: &'a str,
    /// Root mean square error, N.
    pub rms_n: f64,
}

/// The test of the claim for one family.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct ClaimSummary {
    /// The numbers.
    #[serde(flatten)]
    pub result: ReversalMatch,
    /// The result in words.
    pub sentence: String,
}

/// A recording in the summary.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct RecordingSummary<'a> {
    /// File name without its folder.
    pub name: &'a str,
    /// SHA-256 of the file's bytes.
    pub sha256: &'a str,
    /// `training` or `validation`.
    pub used_for: &'static str,
    /// Samples.
    pub samples: usize,
    /// Time from the first to the last sample, s.
    pub duration_s: f64,
    /// Data losses and doubts.
    pub warnings: Vec<String>,
}

impl Comparison {
    /// The test of the claim of EMS section II-C for each compared family of banks.
    pub fn claims(&self) -> Vec<ReversalMatch> {
        BANKS.iter().filter_map(|family| reversal_match(self, family)).collect()
    }
}

impl Outcome {
    /// Limits of the scores due to an unknown state: validation recordings in which the seal never
    /// slides all round.
    pub fn unknown_states(&self) -> Vec<String> {
        let Identification { stages, model, .. } = &self.comparison.ems;
        let scores = validate(&Trocar::of_seal(*stages), &self.comparison.validation, model.offset);
        scores
            .recordings
            .iter()
            .flat_map(|r| r.warnings.iter().map(|w| format!("{}: {w}", r.path)).collect::<Vec<_>>())
            .collect()
    }

    /// Every model as a file, by its path in the results folder: `models/lugre.json`,
    /// `models/gms-4.json`.
    pub fn model_files(&self) -> Vec<(String, ModelFile)> {
        self.comparison.entries.iter().map(|entry| self.model_file(entry)).collect()
    }

    fn model_file(&self, entry: &Entry) -> (String, ModelFile) {
        let Comparison { training, ems, .. } = &self.comparison;
        let origin = Origin::identified(self.seed, training.iter().map(origin_of));
        let mut model = ModelFile::new(*entry.trocar.seal(), origin);
        if entry.choice == Choice::Ems {
            model.origin.note = ems.deformation_note();
        }
        model.sensor = Some(self.moving_mass.sensor(entry.offset, &ems.model.loads));
        model.intervals = intervals(&entry.estimates);
        model.force_error = Some(entry.force_error);
        (format!("models/{}.json", entry.choice.file_stem()), model)
    }

    /// The contents of `compare.json`.
    pub fn summary(&self) -> Summary<'_> {
        let Self { comparison, .. } = self;
        let claims = comparison.claims().into_iter();
        let training = comparison.training.iter().map(|own| recording(own, "training"));
        let validation = comparison.validation.iter().map(|own| recording(own, "validation"));
        Summary {
            program: PROGRAM,
            seed: self.seed,
            held_out: self.held_out,
            samples: comparison.samples,
            effective_samples: comparison.effective_samples,
            reversal_travel_m: comparison.reversal_travel,
            moving_mass: self.moving_mass,
            unmodelled_mass_kg: comparison.ems.model.loads[Load::Mass],
            verdict: comparison.verdict(),
            models: comparison.entries.iter().map(|entry| model(entry, comparison)).collect(),
            reversal_claim: claims
                .map(|result| ClaimSummary { sentence: result.sentence(), result })
                .collect(),
            recordings: training.chain(validation).collect(),
        }
    }
}

impl Summary<'_> {
    /// The text of `compare.json`: equal results give equal text. An infinite or undefined number
    /// is `null`.
    pub fn to_json(&self) -> String {
        json_text(self)
    }
}

fn model<'a>(entry: &'a Entry, comparison: &'a Comparison) -> ModelSummary<'a> {
    let scores = &entry.scores;
    let errors = comparison.validation.iter().zip(&scores.by_recording_n);
    ModelSummary {
        name: entry.name,
        elements: entry.elements,
        parameters: entry.parameters,
        train_rms_n: scores.train_rms_n,
        validate_rms_n: scores.validate_rms_n,
        fit_percent: scores.fit_percent,
        aic: scores.aic,
        bic: scores.bic,
        reversal_rms_n: scores.reversal_rms_n,
        worst_reversal_n: scores.worst_reversal_n,
        behind_best: comparison.margin(entry),
        by_phase: &scores.by_phase,
        by_recording: errors
            .map(|(r, rms_n)| RecordingError { name: &r.name, rms_n: *rms_n })
            .collect(),
        ns_per_sample: entry.ns_per_sample,
        fit_s: entry.fit_s,
        offset_n: entry.offset,
        estimates: by_name(&entry.estimates),
        warnings: entry
            .warnings
            .iter()
            .map(|Warning { subject, message, .. }| format!("{subject}: {message}"))
            .collect(),
    }
}

fn recording<'a>(recording: &'a Recording, used_for: &'static str) -> RecordingSummary<'a> {
    RecordingSummary {
        name: &recording.name,
        sha256: &recording.sha256,
        used_for,
        samples: recording.len(),
        duration_s: recording.duration(),
        warnings: recording.quality.warnings.iter().map(ToString::to_string).collect(),
    }
}
