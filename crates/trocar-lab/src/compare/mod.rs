//! Every friction model that EMS names, fitted to the same recordings and scored on the same
//! others.
//!
//! ```text
//! training recordings -> identify (EMS)  -> classical models, from the same segmentation and start of known state
//! held-out recordings -> free-run simulation of each -> errors over all, by phase, at reversals
//! ```
//! Equal for all models are: the recordings (an unmodelled mass found by the identification is
//! subtracted from them), the sensor offset as one additional parameter, the scored samples (those
//! whose state is known to the EMS element) and the start (at rest with the first reading). The
//! times are measured. They are the only numbers that differ between two runs.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use rayon::prelude::*;
use serde::Serialize;
use trocar_model::Trocar;

use crate::margin::Margin;
use crate::validate::{Phases, force_error};
use crate::workflow::MovingMass;
use trocar_identify::classical::{ClassicalData, ClassicalFit, Kind, RelatedFits};
use trocar_identify::{
    Candidate, EmsRefit, Identification, IdentifyError, IdentifyOptions, Parameter, Progress,
    Warning, identify, refit,
};
use trocar_recording::{Recording, RecordingError};
use trocar_runtime::model_file::{ErrorSource, ForceError};
use trocar_simulate::replay::forces;

pub use claim::{ReversalMatch, reversal_match};
pub use split::{Divided, split};
pub use summary::{Outcome, Summary};

mod choices;
mod claim;
mod score;
mod split;
mod summary;

/// A model to compare.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Choice {
    /// The EMS element as identified: the likelihood fit with the optional model terms that the
    /// data support.
    Ems,
    /// The EMS element refitted by the criterion of the classical models.
    EmsOutputError,
    /// A classical model.
    Classical(Kind),
}

impl Choice {
    /// All: EMS in both forms and the classical models, banks with their usual numbers of elements.
    pub fn all() -> Vec<Self> {
        let own = [Self::Ems, Self::EmsOutputError].into_iter();
        own.chain(Kind::compared().map(Self::Classical)).collect()
    }
}

impl Choice {
    /// Name of the family, as on the command line and in the JSON.
    pub fn family(self) -> &'static str {
        match self {
            Self::Ems => "ems",
            Self::EmsOutputError => "ems-output-error",
            Self::Classical(kind) => kind.family(),
        }
    }

    /// Name as a file name, with the number of elements where it can be chosen: `lugre`, `gms-4`.
    pub fn file_stem(self) -> String {
        match self {
            Self::Ems | Self::EmsOutputError => self.family().to_owned(),
            Self::Classical(kind) => kind.to_string().replace(':', "-"),
        }
    }

    /// Whether the number of elements of the family can be chosen.
    pub fn is_bank(self) -> bool {
        matches!(self, Self::Classical(kind) if kind.is_bank())
    }

    /// Name of the family in texts.
    pub fn title(self) -> &'static str {
        match self {
            Self::Ems => "EMS",
            Self::EmsOutputError => "EMS, output error",
            Self::Classical(kind) => kind.title(),
        }
    }

    /// Title of the panel in which a figure shows the family.
    pub fn panel(self) -> &'static str {
        match self {
            Self::Ems | Self::EmsOutputError => "Extended Maxwell-Slip",
            Self::Classical(kind) => kind.panel(),
        }
    }

    /// Number of elements; 1 for models without that choice.
    pub fn elements(self) -> usize {
        match self {
            Self::Ems | Self::EmsOutputError => 1,
            Self::Classical(kind) => kind.elements(),
        }
    }
}

/// Options of a comparison.
#[derive(Debug, Clone)]
pub struct CompareOptions {
    /// The models. The EMS element is identified in any case, since the others take their scales
    /// from it.
    pub models: Vec<Choice>,
    /// How the EMS element is identified.
    pub identify: IdentifyOptions,
    /// Whether to measure times. Without them equal input gives equal bytes.
    pub timing: bool,
}

/// One model: its fit and its scores.
#[derive(Debug, Clone)]
pub struct Entry {
    /// The choice.
    pub choice: Choice,
    /// Name of the family.
    pub name: &'static str,
    /// Number of elements.
    pub elements: usize,
    /// Number of estimated parameters, without the sensor offset that all models have.
    pub parameters: usize,
    /// The model.
    pub trocar: Trocar,
    /// Sensor offset F_0, N.
    pub offset: f64,
    /// The parameters with intervals.
    pub estimates: Vec<Parameter>,
    /// Errors.
    pub scores: Scores,
    /// Mean squared error of each stroke of the validation, N².
    pub by_stroke: Vec<f64>,
    /// Error of the model's force by phase: over training and validation, the larger of both.
    pub force_error: ForceError,
    /// Time of one step over the motion of the validation, ns; `None` without timing.
    pub ns_per_sample: Option<f64>,
    /// Time of the fit, s; `None` without timing.
    pub fit_s: Option<f64>,
    /// Warnings about the fit.
    pub warnings: Vec<Warning>,
}

impl Entry {
    /// Name in texts, with the number of elements if the family has several.
    pub fn title(&self) -> String {
        let title = self.choice.title();
        if self.choice.is_bank() { format!("{title} {}", self.elements) } else { title.to_owned() }
    }
}

/// Relative difference below which two errors count as equal.
const NO_ODDS: f64 = 0.01;

/// Standard errors from which a difference is clear.
const CLEAR: f64 = 2.0;

/// The best model of one family, least error first: the fewest elements whose validation error
/// equals the least one within 1 %.
pub fn best_of<'a>(family: &[&'a Entry]) -> &'a Entry {
    let least = family[0].scores.validate_rms_n;
    let as_good =
        family.iter().filter(|entry| entry.scores.validate_rms_n <= (1.0 + NO_ODDS) * least);
    as_good.min_by_key(|entry| entry.elements).unwrap_or(&family[0])
}

/// Errors of one model.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Scores {
    /// Root mean square error, N, over the training recordings.
    pub train_rms_n: f64,
    /// The same over the validation recordings.
    pub validate_rms_n: f64,
    /// 100·(1 − rms/sd of the readings), %, on the validation recordings.
    pub fit_percent: f64,
    /// Akaike's criterion on the training recordings, with the effective number of samples.
    pub aic: f64,
    /// Bayesian (Schwarz) criterion, likewise.
    pub bic: f64,
    /// Root mean square error, N, within the deformation after each reversal of the validation; NaN
    /// without a reversal (null in JSON).
    pub reversal_rms_n: f64,
    /// The same for the worst single reversal, N; NaN without one.
    pub worst_reversal_n: f64,
    /// Error on the validation recordings by phase; the EMS element defines the phases.
    pub by_phase: Phases,
    /// Root mean square error, N, of each validation recording.
    pub by_recording_n: Vec<f64>,
}

/// The comparison.
#[derive(Debug, Clone)]
pub struct Comparison {
    /// One entry per model, least validation error first.
    pub entries: Vec<Entry>,
    /// The EMS identification.
    pub ems: Identification,
    /// The training recordings as fitted.
    pub training: Vec<Recording>,
    /// The validation recordings as scored.
    pub validation: Vec<Recording>,
    /// Number of scored samples of the training recordings.
    pub samples: usize,
    /// Equivalent number of independent samples, from the autocorrelation of the residuals of the
    /// EMS element as identified.
    pub effective_samples: f64,
    /// Travel after a reversal over which its error is evaluated, m.
    pub reversal_travel: f64,
}

impl Comparison {
    /// The EMS element that is the reference for the banks: the one fitted by the same criterion,
    /// if it was compared.
    pub fn ems_entry(&self) -> Option<&Entry> {
        [Choice::EmsOutputError, Choice::Ems]
            .into_iter()
            .find_map(|choice| self.entries.iter().find(|entry| entry.choice == choice))
    }

    /// The entries by family, each family at the position of its best model.
    pub fn families(&self) -> Vec<Vec<&Entry>> {
        let mut families: Vec<Vec<&Entry>> = Vec::new();
        for entry in &self.entries {
            match families.iter_mut().find(|own| own[0].name == entry.name) {
                Some(own) => own.push(entry),
                None => families.push(vec![entry]),
            }
        }
        families
    }

    /// By how much the first entry predicts the validation better than `entry`; `None` for too few
    /// strokes.
    pub fn margin(&self, entry: &Entry) -> Option<Margin> {
        Margin::of(&self.entries.first()?.by_stroke, &entry.by_stroke)
    }

    /// Which model has the least error, and by how much. Empty without a second family.
    pub fn verdict(&self) -> String {
        let families = self.families();
        let [first, second, ..] = &families[..] else { return String::new() };
        let second = best_of(second);
        let [first_name, second_name] = [first[0], second]
            .map(|entry| format!("{} ({:.3} N)", entry.title(), entry.scores.validate_rms_n));
        match self.margin(second) {
            None => format!(
                "least error: {first_name}, next {second_name}; too few strokes for a standard error"
            ),
            Some(Margin { strokes, standard_errors }) if standard_errors < CLEAR => format!(
                "no clear winner: {first_name} and {second_name} differ by {standard_errors:.1} standard errors over \
                 {strokes} strokes"
            ),
            Some(Margin { strokes, standard_errors }) => format!(
                "least error: {first_name}; next {second_name}, {standard_errors:.1} standard errors behind over \
                 {strokes} strokes"
            ),
        }
    }
}

/// Why no comparison is possible.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CompareError {
    /// No model can be identified from the training recordings.
    #[error(transparent)]
    Identify(#[from] IdentifyError),
    /// A recording cannot be used.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// Two recordings are the same: it would have double weight, or be no independent validation.
    #[error(
        "{first} and {second} hold the same bytes: a recording is either fitted or scored on, and once only"
    )]
    Twice {
        /// Name of the first.
        first: String,
        /// Name of the second.
        second: String,
    },
    /// No validation recordings.
    #[error("no recording to validate on")]
    NoValidation,
    /// A model could not be fitted.
    #[error("{model}: {why}")]
    NoFit {
        /// The model.
        model: String,
        /// What went wrong.
        why: String,
    },
}

/// Part of the work that the identification of the EMS element is, beside all other models.
const EMS_PART: f64 = 0.4;

/// Fits all models to `training` and scores them on `validation`.
///
/// # Errors
/// [`CompareError`]; a doubtful fit is not an error but part of the result.
pub fn compare(
    training: &[Recording],
    validation: &[Recording],
    options: &CompareOptions,
    progress: Progress,
) -> Result<Comparison, CompareError> {
    if validation.is_empty() {
        return Err(CompareError::NoValidation);
    }
    let clock = Instant::now();
    // Only the seal is compared, without a position profile.
    let alone = IdentifyOptions { along: false, ..options.identify.clone() };
    let ems = identify(training, &alone, &|stage, part| progress(stage, EMS_PART * part))?;
    let ems_s = clock.elapsed().as_secs_f64();
    let (training, validation) = (corrected(training, &ems)?, corrected(validation, &ems)?);
    let models = fit_models(options, &training, (&ems, ems_s), progress)?;
    let reversal_travel = reversal_travel(&ems, &training);
    let grounds = score::Grounds::new(&ems, &training, &validation, reversal_travel);
    let raw: Vec<score::Raw> =
        models.par_iter().map(|m| grounds.raw(&m.trocar, m.offset)).collect();
    // From the same model for any selection of models, so that the criteria do not depend on the
    // selection.
    let reference = grounds.raw(&Trocar::of_seal(ems.stages), ems.model.offset);
    let effective_samples = grounds.effective_samples(&reference);
    let force_errors: Vec<ForceError> =
        models.par_iter().map(|m| m.force_error([&training, &validation])).collect();
    let times: Vec<Option<f64>> = models
        .iter()
        .map(|m| options.timing.then(|| nanoseconds_per_step(&m.trocar, &validation[0])))
        .collect();
    let all = models.into_iter().zip(&raw).zip(force_errors).zip(times);
    let mut entries: Vec<Entry> = all
        .map(|(((fitted, raw), force_error), ns)| {
            let scores = grounds.scores(raw, fitted.parameters, effective_samples);
            let entry = fitted.into_entry(scores, grounds.by_stroke(raw), force_error);
            Entry { ns_per_sample: ns, fit_s: entry.fit_s.filter(|_| options.timing), ..entry }
        })
        .collect();
    entries.sort_by(|a, b| a.scores.validate_rms_n.total_cmp(&b.scores.validate_rms_n));
    let samples = grounds.training_samples();
    Ok(Comparison {
        entries,
        ems,
        training,
        validation,
        samples,
        effective_samples,
        reversal_travel,
    })
}

/// `recordings` at the expected positions, without the loads beside the seal and the delay that `ems` found.
fn corrected(
    recordings: &[Recording],
    ems: &Identification,
) -> Result<Vec<Recording>, RecordingError> {
    let Candidate { loads, offset, .. } = &ems.model;
    let recordings = recordings.to_vec();
    ems.without_delay(MovingMass::default().subtracted_from_all(recordings, loads, *offset)?)
}

/// All models that `options` name; `ems_s` is the time that `ems` took, s.
fn fit_models(
    options: &CompareOptions,
    training: &[Recording],
    (ems, ems_s): (&Identification, f64),
    progress: Progress,
) -> Result<Vec<Fitted>, CompareError> {
    let data = ClassicalData::new(training, ems, &options.identify);
    let fits = fit_all(&options.models, &data, progress)?;
    progress("scoring", 0.97);
    let mut models: Vec<Fitted> = fits.into_iter().map(Fitted::from).collect();
    if options.models.contains(&Choice::Ems) {
        models.push(Fitted::of_ems(ems, ems_s));
    }
    if options.models.contains(&Choice::EmsOutputError) {
        let clock = Instant::now();
        let fit = refit(&data, ems, options.identify.degrees)
            .map_err(|why| CompareError::NoFit { model: "ems-output-error".to_owned(), why })?;
        models.push(Fitted::of_refit(fit, clock.elapsed().as_secs_f64()));
    }
    Ok(models)
}

/// Three half widths: the deformation of 2c and the beginning of sliding. If the deformation is not
/// resolved, a tenth of the longest stroke.
fn reversal_travel(ems: &Identification, training: &[Recording]) -> f64 {
    let longest = training.iter().map(|r| r.quality.stroke).fold(0.0, f64::max);
    if ems.deformation.is_ok() { 3.0 * ems.model.half_width } else { 0.1 * longest }
}

/// A fit with its computing time, before scoring.
struct Fitted {
    choice: Choice,
    parameters: usize,
    trocar: Trocar,
    offset: f64,
    estimates: Vec<Parameter>,
    warnings: Vec<Warning>,
    fit_s: f64,
}

impl Fitted {
    fn from((fit, fit_s): (ClassicalFit, f64)) -> Self {
        Self {
            choice: Choice::Classical(fit.kind),
            parameters: fit.kind.parameters(),
            trocar: Trocar::of_seal(fit.model),
            offset: fit.offset,
            estimates: fit.parameters,
            warnings: fit.warnings,
            fit_s,
        }
    }

    fn of_ems(ems: &Identification, fit_s: f64) -> Self {
        Self {
            choice: Choice::Ems,
            parameters: ems.free_parameters,
            trocar: Trocar::of_seal(ems.stages),
            offset: ems.model.offset,
            estimates: ems.parameters.clone(),
            warnings: ems.warnings.clone(),
            fit_s,
        }
    }

    fn of_refit(fit: EmsRefit, fit_s: f64) -> Self {
        Self {
            choice: Choice::EmsOutputError,
            parameters: fit.free_parameters,
            trocar: Trocar::of_seal(fit.stages),
            offset: fit.model.offset,
            estimates: fit.parameters,
            warnings: fit.warnings,
            fit_s,
        }
    }

    /// The greater of those over the recordings of training and of validation.
    fn force_error(&self, [training, validation]: [&[Recording]; 2]) -> ForceError {
        let [own, held_out] =
            [(training, ErrorSource::Identification), (validation, ErrorSource::Validation)]
                .map(|(all, source)| force_error(&self.trocar, all, self.offset, source));
        own.worse(&held_out, ErrorSource::Validation)
    }

    fn into_entry(self, scores: Scores, by_stroke: Vec<f64>, force_error: ForceError) -> Entry {
        let stages = self.trocar.seal().stages();
        let elements =
            stages.map_or_else(|| self.choice.elements(), |stages| stages.elements().len());
        Entry {
            choice: self.choice,
            name: self.choice.family(),
            elements,
            parameters: self.parameters,
            trocar: self.trocar,
            offset: self.offset,
            estimates: self.estimates,
            scores,
            by_stroke,
            force_error,
            ns_per_sample: None,
            fit_s: Some(self.fit_s),
            warnings: self.warnings,
        }
    }
}

/// Fits all classical models. Those of one family are fitted in the order of their size, since each
/// starts from the smaller one, and GMS is fitted after Maxwell-Slip.
fn fit_all(
    models: &[Choice],
    data: &ClassicalData,
    progress: Progress,
) -> Result<Vec<(ClassicalFit, f64)>, CompareError> {
    let mut kinds: Vec<Kind> = models
        .iter()
        .filter_map(|choice| match choice {
            Choice::Classical(kind) => Some(*kind),
            Choice::Ems | Choice::EmsOutputError => None,
        })
        .collect();
    kinds.sort_by_key(|kind| (chain(*kind), *kind));
    kinds.dedup();
    let total: usize = kinds.iter().map(work).sum();
    let done = AtomicUsize::new(0);
    let mut families: Vec<&[Kind]> = kinds.chunk_by(|a, b| chain(*a) == chain(*b)).collect();
    families.reverse();
    let fits = families.par_iter().map(|family| {
        fit_family(family, data, |kind| {
            let part = done.fetch_add(work(kind), Ordering::Relaxed) + work(kind);
            progress(
                &format!("fitted {kind}"),
                EMS_PART + (0.97 - EMS_PART) * part as f64 / total as f64,
            );
        })
    });
    let fits: Result<Vec<Vec<_>>, CompareError> = fits.collect();
    Ok(fits?.into_iter().flatten().collect())
}

/// The cost of a fit: it grows with the square of the number of parameters.
fn work(kind: &Kind) -> usize {
    kind.parameters().pow(2)
}

/// The fits of models that begin from each other, with the seconds that each took; calls `fitted`
/// after each.
fn fit_family(
    family: &[Kind],
    data: &ClassicalData,
    fitted: impl Fn(&Kind),
) -> Result<Vec<(ClassicalFit, f64)>, CompareError> {
    let mut fits: Vec<(ClassicalFit, f64)> = Vec::new();
    for kind in family {
        let clock = Instant::now();
        let [smaller, special] = [kind.smaller(), kind.special()]
            .map(|wanted| fits.iter().map(|(fit, _)| fit).find(|fit| Some(fit.kind) == wanted));
        let kin = RelatedFits { smaller, special, most: None };
        let fit = trocar_identify::classical::fit(*kind, data, kin)
            .map_err(|why| CompareError::NoFit { model: kind.to_string(), why })?;
        fits.push((fit, clock.elapsed().as_secs_f64()));
        fitted(kind);
    }
    Ok(fits)
}

/// Families that are fitted one after another, since one starts from the other.
fn chain(kind: Kind) -> &'static str {
    kind.special().unwrap_or(kind).family()
}

/// Median time of a step, ns, along a recording.
fn nanoseconds_per_step(trocar: &Trocar, recording: &Recording) -> f64 {
    const REPETITIONS: usize = 7;
    let mut times: Vec<f64> = (0..REPETITIONS)
        .map(|_| {
            let clock = Instant::now();
            std::hint::black_box(forces(trocar, std::hint::black_box(recording), 0.0));
            clock.elapsed().as_secs_f64() * 1e9 / recording.len() as f64
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[REPETITIONS / 2]
}
