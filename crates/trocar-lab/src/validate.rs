//! Validation on recordings not used for identification: free-run simulation against readings (EMS
//! section IV-C).
//!
//! ```text
//! rms = √(mean (F_measured − F_0 − F_model)²)        fit = 100·(1 − rms / sd(F_measured)) %
//! ```
//! The model moves along the expected positions ([`Recording::smoothed`]).
//! Only samples with a known state are scored: before the seal has slid once, its deflection is
//! unknown. The set of these samples depends on the model, so two models may be scored on slightly
//! different samples of one recording. The figure over all samples is reported as well. Slow
//! strokes take most of the time, so the error is also given by speed and by phase. At 1 kHz
//! residuals are never white; they are decimated to their correlation time before the Ljung-Box
//! test.

use std::iter::successors;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use statrs::distribution::{ChiSquared, ContinuousCDF};
use trocar_model::Trocar;

use trocar_identify::{Candidate, Identification};
use trocar_recording::{OPPOSED, Quality, Recording, local_velocity, range};
use trocar_runtime::model_file::{ErrorSource, ForceError, ModelFile};
use trocar_simulate::profile::Departure;
use trocar_simulate::replay::{Replay, replay};
use trocar_simulate::scatter::StrokeScatter;
use trocar_simulate::segment::{reversal_threshold, strokes};

/// Speed below which the instrument counts as held, m/s.
const HOLD_SPEED: f64 = 1e-3;
/// Width of the speed groups, m/s.
const SPEED_STEP: f64 = 5e-3;
/// Fraction of the scored samples above which a phase counts as present. In a recording of full
/// strokes less than 1 % is slow, at the reversals, which does not represent a rest.
const SEEN: f64 = 0.01;
/// Ratio of the validation error to the identification error, and to the sensor noise, above which
/// the model does not describe a recording. On the virtual bench a single pair of strokes reaches
/// 1.7 times the identification error, because the friction varies from stroke to stroke; friction
/// that is 10 % lower gives 6.6 times. An error within 3 times the noise is small, however small
/// the identification error.
const FAR: f64 = 3.0;
/// Fit, %, below which a model explains little of a recording: its error is more than half of the
/// readings' standard deviation.
const LEAST_FIT: f64 = 50.0;
/// Ratio of the mean error to the rms above which the mean counts as its cause: with 0.9 it is 80 %
/// of the squared error.
const MOSTLY_BIAS: f64 = 0.9;
/// Lags of the Ljung-Box test.
const LAGS: usize = 10;

/// Error over a group of samples.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PhaseError {
    /// Root mean square error, N; 0 without samples.
    pub rms_n: f64,
    /// Samples.
    pub samples: usize,
    /// Fraction of all squared error, 0 to 1.
    pub share_of_squares: f64,
}

/// Error by phase of the motion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Phases {
    /// The seal deforms; without samples for a classical model.
    pub deformation: PhaseError,
    /// The instrument slides; without samples for a classical model.
    pub sliding: PhaseError,
    /// The instrument moves, for a classical model, which does not distinguish deforming from
    /// sliding.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moving: Option<PhaseError>,
    /// The instrument is held (slower than 1 mm/s).
    pub hold: PhaseError,
    /// The part of `deformation` after a partial reversal: the deflection has reversed since the
    /// seal last slid. `None` without such samples.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub partial: Option<PhaseError>,
    /// The same part of `hold`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub partial_hold: Option<PhaseError>,
}

/// Error of the strokes around one speed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SpeedPart {
    /// Speed, m/s, rounded to 5 mm/s.
    pub speed_m_s: f64,
    /// Root mean square error, N.
    pub rms_n: f64,
    /// Samples.
    pub samples: usize,
}

/// Whiteness of the residuals.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Whiteness {
    /// Time, s, over which the residuals' autocorrelation falls below 1/e.
    pub correlation_time_s: f64,
    /// p value of the Ljung-Box test on residuals decimated to that time; a small value means that
    /// structure remains.
    pub ljung_box_p_value: f64,
}

/// The error compared with the scatter between repeated strokes. No model of the motion can be much
/// better than this scatter, since the motion was the same except for speeds up to 25 % apart,
/// whose effect a model may describe.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct AgainstStrokes {
    /// Strokes (from reversal to reversal) that have a repeat.
    pub strokes: usize,
    /// Scatter between them, N: standard deviation of a reading about the mean of infinitely many
    /// repeats, over the scored samples.
    pub stroke_scatter_n: f64,
    /// Scatter with a drift over the strokes removed, N; `None` for fewer than four repeats.
    pub without_drift_n: Option<f64>,
    /// Root mean square error, N, over the same samples.
    pub rms_n: f64,
    /// `rms_n` over `stroke_scatter_n`: 1 at best; the mean of n strokes, estimated without
    /// further error, gives √(1 + 1/n).
    pub rms_over_scatter: f64,
}

impl AgainstStrokes {
    fn of(recording: &Recording, error: &[f64], scored: &[usize]) -> Option<Self> {
        let scatter = StrokeScatter::of(recording).filter(|scatter| scatter.rules(recording))?;
        let mut is_scored = vec![false; recording.len()];
        scored.iter().for_each(|i| is_scored[*i] = true);
        let stroke_scatter_n = scatter.over(|i| is_scored[i]).filter(|scatter| *scatter > 0.0)?;
        let rms_n =
            Sums::of(scored.iter().filter(|i| scatter.covers(**i)).map(|i| (error[*i], 0.0))).rms();
        Some(Self {
            strokes: scatter.strokes,
            stroke_scatter_n,
            without_drift_n: scatter.without_drift_n,
            rms_n,
            rms_over_scatter: rms_n / stroke_scatter_n,
        })
    }

    /// Message.
    pub fn words(&self) -> String {
        format!(
            "{:.2} times the repeatability of the recording ({:.3} N between {} repeated strokes, speeds within 25 %)",
            self.rms_over_scatter, self.stroke_scatter_n, self.strokes
        )
    }
}

/// Validation on one recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordingValidation {
    /// Path of the recording.
    pub path: String,
    /// Root mean square error, N, where the state is known.
    pub rms_n: f64,
    /// 100·(1 − rms/sd of the readings), %.
    pub fit_percent: f64,
    /// Mean error, N: measured minus model.
    pub bias_n: f64,
    /// Largest absolute error, N.
    pub worst_n: f64,
    /// Root mean square error, N, including the start with unknown state.
    pub rms_with_start_n: f64,
    /// Samples scored.
    pub samples: usize,
    /// Samples omitted because the seal had not slid yet.
    pub samples_before_known: usize,
    /// Error by speed of the stroke.
    pub by_speed: Vec<SpeedPart>,
    /// Error by phase.
    pub by_phase: Phases,
    /// Whiteness of the residuals; `None` when too short.
    pub whiteness: Option<Whiteness>,
    /// Root mean square error of the torque, N·m, about its mean, which may be a tare; `None`
    /// without rotation in the model or a torque in the recording.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub torque_rms_n_m: Option<f64>,
    /// The error compared with the scatter between strokes; `None` where no strokes repeat.
    #[serde(default)]
    pub strokes: Option<AgainstStrokes>,
    /// Limitations of the figures.
    pub warnings: Vec<String>,
}

impl RecordingValidation {
    /// Samples with those whose state is not known.
    fn all_samples(&self) -> usize {
        self.samples + self.samples_before_known
    }

    /// Sum of the squared errors over all of them, N².
    fn squares_with_start(&self) -> f64 {
        self.rms_with_start_n.powi(2) * self.all_samples() as f64
    }

    /// How the recording contradicts a model whose own error is `own_rms`, N.
    fn contradiction(&self, own_rms: f64, quality: &Quality) -> Option<String> {
        let (rms, times) = (self.rms_n, self.rms_n / own_rms);
        let is_far = times > FAR;
        if rms <= FAR * quality.force_noise || !(is_far || self.fit_percent < LEAST_FIT) {
            return None;
        }
        let error = format!("validation error {} N rms", significant(rms));
        if quality.force_opposes_motion {
            return Some(format!(
                "{error}: the force has the opposite sign, lower on insertion than on withdrawal: {OPPOSED}"
            ));
        }
        if self.bias_n.abs() > MOSTLY_BIAS * rms {
            return Some(format!(
                "{error} is mostly an offset of {} N (the model's own error {} N rms): check the sensor offset and the sign of force and \
                 position, or record with the sensor tared alike",
                significant(self.bias_n),
                significant(own_rms)
            ));
        }
        Some(if is_far {
            let times = if times < 10.0 { significant(times) } else { format!("{times:.0}") };
            format!(
                "{error} is {times} times the model's own error {} N: the model does not describe this motion; record such motion to \
                 identify from, and check that seal, instrument and lubrication are the same",
                significant(own_rms)
            )
        } else {
            format!(
                "{error} leaves a fit of {:.0} %, below {LEAST_FIT:.0} %: the model explains little of this recording, and little more of those \
                 it was identified from (error {} N); check units and signs of the columns, and that they show the same seal",
                self.fit_percent,
                significant(own_rms)
            )
        })
    }
}

/// Formats with two significant digits.
fn significant(value: f64) -> String {
    let digits = (1.0 - value.abs().max(1e-6).log10().floor()).max(0.0) as usize;
    format!("{value:.digits$}")
}

/// Validation on all recordings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Validation {
    /// Root mean square error over all scored samples, N.
    pub rms_n: f64,
    /// 100·(1 − rms/sd of the readings), %, over all scored samples.
    pub fit_percent: f64,
    /// One entry per recording.
    pub recordings: Vec<RecordingValidation>,
}

/// Validation of one recording, with the sums on which it is based.
#[derive(Debug, Clone)]
pub struct Scored {
    result: RecordingValidation,
    sums: Sums,
    pieces: usize,
    /// Whether the seal's state was known in any part of it.
    known: bool,
    /// By how far its motion leaves the range of the position profile.
    departure: Option<Departure>,
}

impl Scored {
    /// Combines this and the next piece of the same recording. Every piece starts with a seal of
    /// unknown state. Whiteness and the scatter between strokes remain those of the first.
    #[must_use]
    pub fn plus(self, next: Self) -> Self {
        let (pieces, known) = (self.pieces + next.pieces, self.known || next.known);
        let departures = self.departure.into_iter().chain(next.departure);
        let departure = departures.max_by(|a, b| a.outside.total_cmp(&b.outside));
        if self.known != next.known {
            return Self { pieces, known, departure, ..self.beside_unknown(next) };
        }
        let (a, b) = (self.result, next.result);
        let sums = self.sums.plus(next.sums);
        let (n, m) = (a.samples as f64, b.samples as f64);
        let (p, q) = (a.all_samples() as f64, b.all_samples() as f64);
        let mut warnings = a.warnings;
        warnings.extend(
            b.warnings
                .into_iter()
                .filter(|warning| !warnings.contains(warning))
                .collect::<Vec<_>>(),
        );
        let result = RecordingValidation {
            rms_n: sums.rms(),
            fit_percent: sums.fit_percent(),
            bias_n: (n * a.bias_n + m * b.bias_n) / (n + m).max(1.0),
            worst_n: a.worst_n.max(b.worst_n),
            rms_with_start_n: ((p * a.rms_with_start_n.powi(2) + q * b.rms_with_start_n.powi(2))
                / (p + q))
                .sqrt(),
            samples: a.samples + b.samples,
            samples_before_known: a.samples_before_known + b.samples_before_known,
            torque_rms_n_m: match (a.torque_rms_n_m, b.torque_rms_n_m) {
                (Some(first), Some(next)) => Some(both_rms((first, a.samples), (next, b.samples))),
                (first, next) => first.or(next),
            },
            by_speed: both_speeds(a.by_speed, &b.by_speed),
            by_phase: a.by_phase.plus(&b.by_phase),
            warnings,
            path: a.path,
            whiteness: a.whiteness,
            strokes: a.strokes,
        };
        Self { result, sums, pieces, known, departure }
    }

    /// Combines one piece in which the state of the seal is known and one in which it never is:
    /// only the first is scored.
    fn beside_unknown(self, next: Self) -> Self {
        let path = self.result.path.clone();
        let (mut scored, other) = if self.known { (self, next) } else { (next, self) };
        let total = scored.result.squares_with_start() + other.result.squares_with_start();
        scored.result.samples_before_known += other.result.all_samples();
        scored.result.rms_with_start_n = (total / scored.result.all_samples() as f64).sqrt();
        scored.result.path = path;
        scored
    }

    /// The results, with the warning that concerns all pieces together.
    fn conclude(self) -> RecordingValidation {
        let mut result = self.result;
        result.warnings.extend(self.departure.map(|departure| departure.to_string()));
        result
    }

    /// Number of pieces combined.
    pub fn pieces(&self) -> usize {
        self.pieces
    }
}

fn both_speeds(mut all: Vec<SpeedPart>, more: &[SpeedPart]) -> Vec<SpeedPart> {
    for part in more {
        match all.iter_mut().find(|own| own.speed_m_s == part.speed_m_s) {
            Some(own) => {
                (own.rms_n, own.samples) = (
                    both_rms((own.rms_n, own.samples), (part.rms_n, part.samples)),
                    own.samples + part.samples,
                );
            }
            None => all.push(*part),
        }
    }
    all.sort_by(|a, b| a.speed_m_s.total_cmp(&b.speed_m_s));
    all
}

/// Root mean square over two groups of samples.
fn both_rms((a, n): (f64, usize), (b, m): (f64, usize)) -> f64 {
    ((a * a * n as f64 + b * b * m as f64) / ((n + m) as f64).max(1.0)).sqrt()
}

impl Validation {
    /// The validation of several recordings.
    pub fn of(recordings: Vec<Scored>) -> Self {
        let all = recordings.iter().fold(Sums::default(), |s, one| s.plus(one.sums));
        Self {
            rms_n: all.rms(),
            fit_percent: all.fit_percent(),
            recordings: recordings.into_iter().map(Scored::conclude).collect(),
        }
    }

    /// The error by phase over all recordings; a phase with less than 1 % of the samples is
    /// unknown.
    pub fn force_error(&self, source: ErrorSource) -> ForceError {
        let each: Vec<_> = self.recordings.iter().map(|r| (r.samples, r.by_phase)).collect();
        error_by_phase(&each, source)
    }

    /// The validation of a model whose error over the recordings used for identification is
    /// `identification_rms`, N. A recording gets a warning if its error is far above that or if the
    /// model explains it badly. `recordings` are those used for validation.
    #[must_use]
    pub(crate) fn beside_identification(
        mut self,
        identification_rms: f64,
        recordings: &[Recording],
    ) -> Self {
        for (result, recording) in self.recordings.iter_mut().zip(recordings) {
            result.warnings.extend(result.contradiction(identification_rms, &recording.quality));
        }
        self
    }

    /// The same beside the largest error that the file of the model states; without one nothing is
    /// compared.
    #[must_use]
    pub fn beside_model<'q>(
        mut self,
        file: &ModelFile,
        qualities: impl IntoIterator<Item = &'q Quality>,
    ) -> Self {
        let Some(own) = file.force_error.and_then(|own| own.largest()) else { return self };
        for (result, quality) in self.recordings.iter_mut().zip(qualities) {
            result.warnings.extend(result.contradiction(own, quality));
        }
        self
    }

    /// Whether a recording has a warning: its seal never forgot the unknown initial state, the
    /// motion left the range of the position profile, or it contradicts the model (exit code 3).
    pub fn is_doubtful(&self) -> bool {
        self.recordings.iter().any(|recording| !recording.warnings.is_empty())
    }
}

/// The error by phase over recordings, from the scored samples and the phases of each.
fn error_by_phase(each: &[(usize, Phases)], source: ErrorSource) -> ForceError {
    let all: usize = each.iter().map(|(samples, _)| samples).sum();
    let rms = |part: &dyn Fn(&Phases) -> (f64, usize)| {
        let parts = each.iter().map(|(_, phases)| part(phases));
        let (squares, samples) =
            parts.fold((0.0, 0), |(s, n), (squares, samples)| (s + squares, n + samples));
        (samples > 0 && samples as f64 >= SEEN * all as f64)
            .then(|| (squares.max(0.0) / samples as f64).sqrt())
    };
    let held = [
        rms(&|phases| phases.hold.less(phases.partial_hold)),
        rms(&|phases| phases.partial_hold.map_or((0.0, 0), PhaseError::sums)),
    ];
    // A model without deflection has one error for all motion.
    ForceError {
        source,
        deforming_n: rms(&|phases| match phases.moving {
            Some(moving) => moving.sums(),
            None => phases.deformation.less(phases.partial),
        }),
        partial_n: rms(&|phases| {
            phases.moving.or(phases.partial).map_or((0.0, 0), PhaseError::sums)
        }),
        sliding_n: rms(&|phases| phases.moving.unwrap_or(phases.sliding).sums()),
        held_n: held.into_iter().flatten().reduce(f64::max),
    }
}

/// Sums over samples, from which root mean squares and fits are computed.
#[derive(Debug, Default, Clone, Copy)]
pub struct Sums {
    n: f64,
    squares: f64,
    force: f64,
    force_squares: f64,
}

impl Sums {
    /// Of (error, force) in N.
    pub fn of(readings: impl Iterator<Item = (f64, f64)>) -> Self {
        readings.fold(Self::default(), |s, (error, force)| {
            s.plus(Self { n: 1.0, squares: error * error, force, force_squares: force * force })
        })
    }

    /// Both together.
    pub fn plus(self, other: Self) -> Self {
        Self {
            n: self.n + other.n,
            squares: self.squares + other.squares,
            force: self.force + other.force,
            force_squares: self.force_squares + other.force_squares,
        }
    }

    /// Of the errors, N.
    pub fn rms(&self) -> f64 {
        (self.squares / self.n.max(1.0)).sqrt()
    }

    /// 100·(1 - rms error over standard deviation of the force).
    pub fn fit_percent(&self) -> f64 {
        let n = self.n.max(1.0);
        let variance = self.force_squares / n - (self.force / n).powi(2);
        if variance > 0.0 { 100.0 * (1.0 - self.rms() / variance.sqrt()) } else { 0.0 }
    }
}

/// A model beside recordings.
#[derive(Debug, Clone)]
pub struct Validated {
    /// The recordings at the expected positions, without the moving mass, the unmodelled mass and the
    /// position delay.
    pub recordings: Vec<Recording>,
    /// The simulations of the model over them.
    pub runs: Vec<Replay>,
    /// The model's error over them.
    pub validation: Validation,
}

impl Validated {
    /// Of `trocar` beside `recordings`, whose readings include the sensor offset `offset`, N.
    pub fn of<K: AsRef<[f64]> + Sync>(
        trocar: &Trocar<K>,
        recordings: Vec<Recording>,
        offset: f64,
    ) -> Self {
        let recordings: Vec<_> = recordings.into_par_iter().map(Recording::into_smoothed).collect();
        let of = |recording: &Recording| {
            let along = Along::of(trocar, recording, offset);
            (along.scores(trocar, recording), along.run)
        };
        let (scored, runs): (Vec<Scored>, Vec<Replay>) = recordings.par_iter().map(of).unzip();
        Self { recordings, runs, validation: Validation::of(scored) }
    }

    /// Of an identified model beside `recordings` as they were passed to the identification, but in
    /// time.
    pub fn own(found: &Identification, recordings: &[Recording]) -> Self {
        let Candidate { loads, offset, .. } = &found.model;
        let of_seal = recordings.par_iter().map(|own| own.clone().without_loads(loads, *offset));
        Self::of(&found.trocar(), of_seal.collect(), *offset)
    }

    /// Of an identified model beside recordings that it has not seen.
    pub fn held_out(found: &Identification, recordings: Vec<Recording>) -> Self {
        let all = Self::of(&found.trocar(), recordings, found.model.offset);
        let validation = all.validation.beside_identification(found.residual_rms, &all.recordings);
        Self { validation, ..all }
    }
}

/// Replays `trocar` over `recordings`, whose readings include the sensor offset `offset`, N.
pub fn validate<K: AsRef<[f64]> + Sync>(
    trocar: &Trocar<K>,
    recordings: &[Recording],
    offset: f64,
) -> Validation {
    let each = recordings.par_iter().map(|recording| validate_one(trocar, recording, offset));
    Validation::of(each.collect())
}

/// The error by phase over smoothed `recordings`, as [`Validation::force_error`] of their validation gives it.
pub(crate) fn force_error<K: AsRef<[f64]> + Sync>(
    trocar: &Trocar<K>,
    recordings: &[Recording],
    offset: f64,
    source: ErrorSource,
) -> ForceError {
    let each = recordings.par_iter().map(|recording| {
        let along = Along::of(trocar, recording, offset);
        (along.scored.len(), along.by_phase(recording))
    });
    error_by_phase(&each.collect::<Vec<_>>(), source)
}

/// A model along a recording.
struct Along {
    run: Replay,
    /// Measured minus model, N, at every sample.
    error: Vec<f64>,
    /// The samples at which the state is known, or all where it never is.
    scored: Vec<usize>,
    is_known: bool,
}

impl Along {
    fn of<K: AsRef<[f64]>>(trocar: &Trocar<K>, recording: &Recording, offset: f64) -> Self {
        let run = replay(trocar, recording, offset);
        let error = recording.force.iter().zip(&run.force).map(|(y, f)| y - offset - f).collect();
        let known: Vec<usize> = run.known.iter().cloned().flatten().collect();
        let is_known = !known.is_empty();
        let scored = if is_known { known } else { (0..recording.len()).collect() };
        Self { run, error, scored, is_known }
    }

    fn by_phase(&self, recording: &Recording) -> Phases {
        let phases = phases_of(recording, &self.run, &self.scored);
        Phases::of(phases.into_iter().zip(self.scored.iter().map(|i| self.error[*i])))
    }

    fn scores<K: AsRef<[f64]>>(&self, trocar: &Trocar<K>, recording: &Recording) -> Scored {
        let Self { run, error, scored, is_known } = self;
        let (whiteness, strokes) = rayon::join(
            || whiteness(recording, error, scored),
            || AgainstStrokes::of(recording, error, scored),
        );
        let sums = Sums::of(scored.iter().map(|i| (error[*i], recording.force[*i])));
        let all = Sums::of((0..recording.len()).map(|i| (error[i], recording.force[i])));
        let result = RecordingValidation {
            path: recording.name.clone(),
            rms_n: sums.rms(),
            fit_percent: sums.fit_percent(),
            bias_n: scored.iter().map(|i| error[*i]).sum::<f64>() / sums.n.max(1.0),
            worst_n: scored.iter().map(|i| error[*i].abs()).fold(0.0, f64::max),
            rms_with_start_n: all.rms(),
            samples: scored.len(),
            samples_before_known: recording.len() - scored.len(),
            torque_rms_n_m: torque_error(trocar, recording, run, scored),
            by_speed: by_speed(recording, error, scored),
            by_phase: self.by_phase(recording),
            whiteness,
            strokes,
            warnings: self.unknown().map(str::to_owned).into_iter().collect(),
        };
        let (lowest, highest) = range(&recording.position);
        let departure =
            trocar.profile().and_then(|profile| Departure::of(profile, lowest, highest));
        Scored { result, sums, pieces: 1, known: *is_known, departure }
    }

    /// Why the state is known nowhere.
    fn unknown(&self) -> Option<&'static str> {
        let why = if self.run.sliding.is_empty() {
            "the force depends on the unknown initial state throughout: the figures contain its error"
        } else {
            "the motion never makes the seal slide all round: the figures contain the error of the unknown initial deflection"
        };
        (!self.is_known).then_some(why)
    }
}

/// Validates one recording, or one piece of it; [`Scored::plus`] combines pieces.
pub fn validate_one<K: AsRef<[f64]>>(
    trocar: &Trocar<K>,
    recording: &Recording,
    offset: f64,
) -> Scored {
    let recording = &*recording.smoothed();
    Along::of(trocar, recording, offset).scores(trocar, recording)
}

fn torque_error<K: AsRef<[f64]>>(
    trocar: &Trocar<K>,
    recording: &Recording,
    run: &Replay,
    scored: &[usize],
) -> Option<f64> {
    let readings = recording.torque.as_ref().filter(|_| trocar.rotation().is_some())?;
    let errors = scored.iter().map(|k| readings[*k] - run.torque[*k]);
    let count = scored.len().max(1) as f64;
    let mean = errors.clone().sum::<f64>() / count;
    let squares: f64 = errors.map(|error| (error - mean).powi(2)).sum();
    Some((squares / count).sqrt())
}

fn by_speed(recording: &Recording, error: &[f64], scored: &[usize]) -> Vec<SpeedPart> {
    let mut groups: std::collections::BTreeMap<u64, Sums> = std::collections::BTreeMap::new();
    let strokes = strokes(recording, reversal_threshold(recording));
    for stroke in &strokes {
        let speed = typical_speed(recording, stroke.start, stroke.end);
        let from = scored.partition_point(|i| *i < stroke.start);
        let to = scored.partition_point(|i| *i < stroke.end);
        let sums = Sums::of(scored[from..to].iter().map(|i| (error[*i], recording.force[*i])));
        let group = groups.entry((speed / SPEED_STEP).round() as u64).or_default();
        *group = group.plus(sums);
    }
    let groups = groups.into_iter().filter(|(_, s)| s.n > 0.0);
    let parts = groups.map(|(step, s)| SpeedPart {
        speed_m_s: step as f64 * SPEED_STEP,
        rms_n: s.rms(),
        samples: s.n as usize,
    });
    parts.collect()
}

/// Speed, m/s, over the middle half of the travel between two samples.
pub(crate) fn typical_speed(recording: &Recording, from: usize, to: usize) -> f64 {
    let (x, t) = (&recording.position, &recording.time);
    let s = if x[to] < x[from] { -1.0 } else { 1.0 };
    let travel = s * (x[to] - x[from]);
    let [a, b] = [0.25, 0.75]
        .map(|part| (from..=to).find(|i| s * (x[*i] - x[from]) >= part * travel).unwrap_or(to));
    if t[b] > t[a] { s * (x[b] - x[a]) / (t[b] - t[a]) } else { 0.0 }
}

/// Phase of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// The seal deforms after a full reversal.
    Deformation,
    /// The instrument slides.
    Sliding,
    /// Moves, and the phase is not determined.
    Moving,
    /// Stands still.
    Hold,
    /// After a partial reversal: a part of the deformation ...
    Partial,
    /// ... or of the holds.
    PartialHold,
}

/// Whether the instrument is held, at every sample.
pub(crate) fn is_held(recording: &Recording) -> Vec<bool> {
    let window = (20.0 * recording.quality.median_interval).max(0.05);
    local_velocity(recording, window).iter().map(|velocity| velocity.abs() < HOLD_SPEED).collect()
}

/// Phases of the `scored` samples, as far as the replay determines them.
pub(crate) fn phases_of(recording: &Recording, run: &Replay, scored: &[usize]) -> Vec<Phase> {
    let held = is_held(recording);
    // Rests after a partial reversal are separate: those at the ends of full strokes do not
    // represent them.
    let phases = scored.iter().map(|i| match (held[*i], run.sliding.get(*i)) {
        (true, _) if run.turned.get(*i) == Some(&true) => Phase::PartialHold,
        (true, _) => Phase::Hold,
        (false, Some(true)) => Phase::Sliding,
        (false, Some(false)) if run.turned[*i] => Phase::Partial,
        (false, Some(false)) => Phase::Deformation,
        (false, None) => Phase::Moving,
    });
    phases.collect()
}

impl PhaseError {
    /// Sum of the squared errors, N².
    fn squares(&self) -> f64 {
        self.rms_n * self.rms_n * self.samples as f64
    }

    /// The same with the number of samples.
    fn sums(self) -> (f64, usize) {
        (self.squares(), self.samples)
    }

    /// The sums without those of a `part` of the phase.
    fn less(self, part: Option<Self>) -> (f64, usize) {
        let (all, part) = (self.sums(), part.map_or((0.0, 0), Self::sums));
        (all.0 - part.0, all.1 - part.1)
    }

    /// `None` for a phase without samples.
    fn occurred(self) -> Option<Self> {
        Some(self).filter(|part| part.samples > 0)
    }
}

impl Phases {
    /// Combination of two parts of one recording.
    fn plus(&self, other: &Self) -> Self {
        let pairs = self.parts().into_iter().zip(other.parts());
        // The last two are subsets of others.
        let total: f64 = pairs.take(4).map(|(a, b)| a.squares() + b.squares()).sum();
        Self::from_parts(std::array::from_fn(|k| {
            let (a, b) = (self.parts()[k], other.parts()[k]);
            PhaseError {
                rms_n: both_rms((a.rms_n, a.samples), (b.rms_n, b.samples)),
                samples: a.samples + b.samples,
                share_of_squares: if total > 0.0 {
                    (a.squares() + b.squares()) / total
                } else {
                    0.0
                },
            }
        }))
    }

    fn parts(&self) -> [PhaseError; 6] {
        let Self { deformation, sliding, moving, hold, partial, partial_hold } = *self;
        let none = PhaseError { rms_n: 0.0, samples: 0, share_of_squares: 0.0 };
        let [moving, partial, partial_hold] =
            [moving, partial, partial_hold].map(|part| part.unwrap_or(none));
        [deformation, sliding, moving, hold, partial, partial_hold]
    }

    fn from_parts(parts: [PhaseError; 6]) -> Self {
        let [deformation, sliding, moving, hold, partial, partial_hold] = parts;
        Self {
            deformation,
            sliding,
            moving: moving.occurred(),
            hold,
            partial: partial.occurred(),
            partial_hold: partial_hold.occurred(),
        }
    }

    /// Errors, N, summed by phase.
    pub fn of(errors: impl Iterator<Item = (Phase, f64)>) -> Self {
        let mut sums = [Sums::default(); 6];
        for (phase, error) in errors {
            let own = &mut sums[phase as usize];
            *own = own.plus(Sums { n: 1.0, squares: error * error, ..Sums::default() });
        }
        let total: f64 = sums.iter().map(|s| s.squares).sum();
        let [full, sliding, moving, hold, partial, partial_hold] = sums;
        let (deformation, hold) = (full.plus(partial), hold.plus(partial_hold));
        let parts = [deformation, sliding, moving, hold, partial, partial_hold].map(|s| {
            let share = if total > 0.0 { s.squares / total } else { 0.0 };
            PhaseError { rms_n: s.rms(), samples: s.n as usize, share_of_squares: share }
        });
        Self::from_parts(parts)
    }
}

fn whiteness(recording: &Recording, error: &[f64], scored: &[usize]) -> Option<Whiteness> {
    let residuals: Vec<f64> = scored.iter().map(|i| error[*i]).collect();
    let n = residuals.len();
    let mean = residuals.iter().sum::<f64>() / n.max(1) as f64;
    let centred: Vec<f64> = residuals.iter().map(|e| e - mean).collect();
    let power = autocovariance(&centred, 0);
    let is_below = |k: usize| autocovariance(&centred, k) < power / std::f64::consts::E;
    // Lags are doubled until it is, and then halved: the first crossing, unless it swings within.
    let lags = successors(Some(1), |k| Some(2 * k)).take_while(|k| *k < n / 20);
    let mut high = lags.chain([n / 20]).find(|k| is_below(*k))?;
    let mut low = high / 2;
    while high - low > 1 {
        let middle = (low + high) / 2;
        if is_below(middle) { high = middle } else { low = middle }
    }
    let lag = high;
    let decimated: Vec<f64> = centred.iter().step_by(lag).copied().collect();
    let m = decimated.len();
    if m < 5 * LAGS || power <= 0.0 {
        return None;
    }
    let own = autocovariance(&decimated, 0);
    let statistic: f64 = (1..=LAGS)
        .map(|k| (autocovariance(&decimated, k) / own).powi(2) / (m - k) as f64)
        .sum::<f64>()
        * (m * (m + 2)) as f64;
    let law = ChiSquared::new(LAGS as f64).ok()?;
    Some(Whiteness {
        correlation_time_s: lag as f64 * recording.quality.median_interval,
        ljung_box_p_value: law.sf(statistic),
    })
}

fn autocovariance(centred: &[f64], lag: usize) -> f64 {
    centred.iter().zip(&centred[lag..]).map(|(a, b)| a * b).sum::<f64>() / centred.len() as f64
}
