//! Results of an identification: `model.json` and `summary.json`.
//!
//! Both contain names, hashes and seeds but no folders and times, so the same recordings give the
//! same bytes.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::motion::MotionRange;
use crate::validate::Validation;
use crate::workflow::{MovingMass, Workflow};
use trocar_identify::posterior::{CHAINS, Convergence, PosteriorParameter, PosteriorStructure};
use trocar_identify::{
    Covariance, DampingTest, DeformationFit, Estimate, FitSummary, FreeMotion, FrictionScale,
    Parameter, Phase, PositionDelay, Posterior, PriorUse, SteadyFit, StickSlip, Subject, Warning,
};
use trocar_recording::loads::Loads;
use trocar_recording::{Choice, Quality, Recording};
use trocar_runtime::model_file::{
    ErrorSource, ForceError, Interval, ModelFile, Origin, ReadWith, RecordingInfo, SensorInfo,
};
use trocar_simulate::profile::ProfileFit;
use trocar_tables::option::{Interface, spelt};

/// Value of the key `program`.
pub const PROGRAM: &str = concat!("trocar ", env!("CARGO_PKG_VERSION"));

impl MovingMass {
    /// The sensor of a model. `offset` is its offset without the declared mass, N; `beside` are the loads
    /// besides that mass.
    ///
    /// The offset of the sensor is the reading at rest without any force of the seal, including the
    /// weight of the declared mass.
    pub(crate) fn sensor(self, offset: f64, beside: &Loads) -> SensorInfo {
        let Loads([unmodelled, side_friction, tilted_weight_n, pressure_gain_per_pa]) = *beside;
        SensorInfo {
            offset_n: offset + self.mass * self.gravity,
            moving_mass_kg: self.mass + unmodelled.max(0.0),
            position_delay_s: 0.0,
            side_friction,
            tilted_weight_n,
            pressure_gain_per_pa,
        }
    }
}

/// A recording in the summary.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct RecordingSummary<'a> {
    /// File name without its folder.
    pub name: &'a str,
    /// SHA-256 of the file's bytes.
    pub sha256: &'a str,
    /// `identification` or `validation`.
    pub used_for: &'static str,
    /// Samples.
    pub samples: usize,
    /// Time from the first to the last sample, s.
    pub duration_s: f64,
    /// Properties of the data.
    pub quality: &'a Quality,
}

/// One branch of the deformation force in the summary.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct BranchSummary {
    /// Where the two polynomials of EMS (25) meet, m.
    pub join_m: f64,
    /// Root mean square residual, N, of the joined polynomials to the mean curve.
    pub joined_rms_n: f64,
    /// The same of a single polynomial of degree 7 (EMS figure 8).
    pub single_polynomial_rms_n: f64,
}

/// The dynamic step in the summary.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct DeformationSummary<'a> {
    /// c of the two-step result.
    pub half_width_m: &'a Estimate,
    /// Standard deviation of c over the full reversals, m: the error of the reconstructed
    /// deflection.
    pub half_width_spread_m: f64,
    /// p value of a dependence of c on speed; `None` with too few speeds.
    pub speed_dependence_p_value: Option<f64>,
    /// Full reversals: strokes over which the measured force goes from one sliding limit to the
    /// other.
    pub full_reversals: usize,
    /// Branch of the insertion.
    pub insertion_branch: BranchSummary,
    /// Branch of the withdrawal.
    pub withdrawal_branch: BranchSummary,
}

/// A parameter of the draws in the summary, in the unit of its name.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct DrawnParameter {
    /// Mean of the draws.
    pub mean: f64,
    /// Their standard deviation.
    pub standard_deviation: f64,
    /// Their 2.5 % and 97.5 % quantiles.
    pub ci95: [f64; 2],
    /// R-hat and effective sample sizes; `None` where it does not change.
    pub convergence: Option<Convergence>,
    /// Standard deviation relative to that of the prior; `None` without a prior.
    pub prior_ratio: Option<f64>,
}

/// The posterior draws in the summary.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct PosteriorSummary<'a> {
    /// Number of draws.
    pub draws: usize,
    /// Chains of each structure.
    pub chains: usize,
    /// Structures, the most probable first.
    pub structures: &'a [PosteriorStructure],
    /// Largest R-hat.
    pub r_hat: f64,
    /// Smallest effective sample size of bulk and tails.
    pub effective_sample_size: f64,
    /// Parameters by name with unit.
    pub parameters: BTreeMap<String, DrawnParameter>,
}

impl DrawnParameter {
    /// With its name.
    fn of(p: &PosteriorParameter) -> (String, Self) {
        let PosteriorParameter { mean, standard_deviation, ci95, convergence, prior_ratio, .. } =
            *p;
        (p.id.to_string(), Self { mean, standard_deviation, ci95, convergence, prior_ratio })
    }
}

impl<'a> PosteriorSummary<'a> {
    fn of(posterior: &'a Posterior) -> Self {
        Self {
            draws: posterior.draws.len(),
            chains: CHAINS,
            structures: &posterior.structures,
            r_hat: posterior.r_hat(),
            effective_sample_size: posterior.ess(),
            parameters: posterior.parameters.iter().map(DrawnParameter::of).collect(),
        }
    }
}

/// `summary.json`.
#[derive(Debug, Clone, Serialize)]
pub struct Summary<'a> {
    /// Program and version.
    pub program: &'static str,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Whether data were lost or parameters are not determined (exit code 3).
    pub doubtful: bool,
    /// Parameters of the model by name with unit.
    pub parameters: BTreeMap<String, &'a Estimate>,
    /// The same from the paper's two steps alone.
    pub two_step_parameters: BTreeMap<String, &'a Estimate>,
    /// Error of the model over the recordings used for identification, N.
    pub residual_rms_n: f64,
    /// The likelihood fit with its optional model terms; `None` if it was not made.
    pub fit: Option<&'a FitSummary>,
    /// Covariance of the parameters of the fit; `None` without a fit.
    pub covariance: Option<&'a Covariance>,
    /// What the recordings added to the model given as prior; left out without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub prior: Option<&'a PriorUse>,
    /// Structures, convergence and intervals of the posterior draws; left out without draws.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) posterior: Option<PosteriorSummary<'a>>,
    /// Number of model parameters estimated, without the sensor offset and an unmodelled mass.
    pub free_parameters: usize,
    /// Change of the friction from stroke to stroke.
    pub friction_scale: &'a FrictionScale,
    /// Error of the model by phase.
    pub phases: &'a [Phase],
    /// Self-excited oscillation of the force; `None` if there is none.
    pub stick_slip: Option<&'a StickSlip>,
    /// Speeds, strokes, forces and rests in the recordings used for identification: where the model holds.
    pub range: MotionRange,
    /// Rests and partial reversals in the recordings.
    pub free_motion: FreeMotion,
    /// The compensated position delay; `None` if none is significant.
    pub position_delay: Option<PositionDelay>,
    /// The position-dependent force; `None` if there is none or no strokes repeat.
    pub position_profile: Option<&'a ProfileFit>,
    /// Why repeated strokes gave no `position_profile`.
    pub no_position_profile: Option<&'a str>,
    /// Validation on the held-out recordings; `None` without any.
    pub validation: Option<&'a Validation>,
    /// Steady-state step with its data.
    pub steady: &'a SteadyFit,
    /// Dynamic step; `None` if the deformation was not resolved.
    pub(crate) deformation: Option<DeformationSummary<'a>>,
    /// Why there is no dynamic step.
    pub deformation_missing: Option<&'a str>,
    /// Test of the influence of the deformation velocity; `None` if it was not possible.
    pub damping_test: Option<&'a DampingTest>,
    /// Mass that was subtracted from the readings.
    pub moving_mass: MovingMass,
    /// All recordings.
    pub(crate) recordings: Vec<RecordingSummary<'a>>,
    /// Warnings about the result, including its validation.
    pub warnings: Vec<Warning>,
}

impl Workflow {
    /// The contents of `summary.json`.
    pub fn summary(&self) -> Summary<'_> {
        let found = &self.identification;
        let deformation = found.deformation.as_ref();
        Summary {
            program: PROGRAM,
            seed: self.options.seed,
            doubtful: self.is_doubtful(),
            parameters: by_name(&found.parameters),
            two_step_parameters: by_name(&found.two_step_parameters),
            residual_rms_n: found.residual_rms,
            fit: found.fit.as_ref(),
            covariance: found.covariance.as_ref(),
            prior: found.prior.as_ref(),
            posterior: found.posterior.as_ref().map(PosteriorSummary::of),
            free_parameters: found.free_parameters,
            friction_scale: &found.friction_scale,
            phases: &found.phases,
            stick_slip: found.stick_slip.as_ref(),
            range: self.range,
            free_motion: found.free_motion,
            position_delay: found.position_delay,
            position_profile: found.position_profile.as_ref(),
            no_position_profile: found.no_position_profile.as_deref(),
            validation: self.validation(),
            steady: &found.steady,
            deformation: deformation.ok().map(deformation_summary),
            deformation_missing: deformation.err().map(String::as_str),
            damping_test: deformation.ok().and_then(|d| d.damping.as_ref()),
            moving_mass: self.moving_mass,
            recordings: self.recording_summaries(),
            warnings: found.warnings.iter().cloned().chain(self.validation_warnings()).collect(),
        }
    }

    /// Limits of the validation, as warnings of the result.
    fn validation_warnings(&self) -> impl Iterator<Item = Warning> + '_ {
        let recordings = self.validation().into_iter().flat_map(|v| &v.recordings);
        recordings.flat_map(|r| {
            let subject = Subject::Recording(r.path.clone());
            r.warnings.iter().map(move |message| Warning::doubt(subject.clone(), message.clone()))
        })
    }

    /// Whether data were lost or parameters are not determined, in identification or validation.
    pub fn is_doubtful(&self) -> bool {
        let mut held_out = self.held_out.iter().flat_map(|held_out| &held_out.recordings);
        let lost = held_out.any(|recording| !recording.quality.warnings.is_empty());
        let unknown = self.validation().is_some_and(Validation::is_doubtful);
        self.identification.is_doubtful() || lost || unknown
    }

    /// The identified seal with its origin, sensor and intervals.
    pub fn model_file(&self) -> ModelFile {
        let found = &self.identification;
        let mut origin =
            Origin::identified(self.options.seed, self.recordings.iter().map(origin_of));
        origin.note = found.deformation_note();
        let mut model = ModelFile::new(found.stages, origin);
        model.trocar = found.trocar().stored_as(<[f64]>::to_vec);
        let sensor = self.moving_mass.sensor(found.model.offset, &found.model.loads);
        let position_delay_s = found.position_delay.map_or(0.0, |lag| lag.delay_s);
        model.sensor = Some(SensorInfo { position_delay_s, ..sensor });
        model.intervals = intervals(&found.parameters);
        model.force_error = Some(self.force_error());
        model
    }

    /// Error on the held-out recordings and on those used for identification: for each phase the
    /// larger of both.
    fn force_error(&self) -> ForceError {
        let own = self.own.validation.force_error(ErrorSource::Identification);
        let validated = self.validation().map(|v| v.force_error(ErrorSource::Validation));
        validated.map_or(own, |validated| own.worse(&validated, ErrorSource::Validation))
    }

    fn recording_summaries(&self) -> Vec<RecordingSummary<'_>> {
        fn of<'a>(
            used_for: &'static str,
            recordings: &'a [Recording],
        ) -> impl Iterator<Item = RecordingSummary<'a>> {
            recordings.iter().map(move |recording| RecordingSummary {
                name: &recording.name,
                sha256: &recording.sha256,
                used_for,
                samples: recording.len(),
                duration_s: recording.duration(),
                quality: &recording.quality,
            })
        }
        let held_out = self.held_out.as_ref().map_or(&[] as &[Recording], |h| &h.recordings);
        of("identification", &self.recordings).chain(of("validation", held_out)).collect()
    }
}

impl Summary<'_> {
    /// The text of `summary.json`: equal results give equal text. An infinite or undefined number
    /// is `null`.
    pub fn to_json(&self) -> String {
        json_text(self)
    }
}

/// The text of a summary, with options as JSON writes them.
pub(crate) fn json_text(summary: &impl Serialize) -> String {
    let text = serde_json::to_string_pretty(summary).expect("every key is a string") + "\n";
    spelt(&text, Interface::Json)
}

pub(crate) fn by_name(parameters: &[Parameter]) -> BTreeMap<String, &Estimate> {
    parameters.iter().map(|parameter| (parameter.id.to_string(), &parameter.estimate)).collect()
}

fn deformation_summary(found: &DeformationFit) -> DeformationSummary<'_> {
    let [insertion_branch, withdrawal_branch] = [&found.insertion_branch, &found.withdrawal_branch]
        .map(|fit| BranchSummary {
            join_m: fit.shape.join * found.half_width.value,
            joined_rms_n: fit.rms,
            single_polynomial_rms_n: fit.single_polynomial_rms,
        });
    DeformationSummary {
        half_width_m: &found.half_width,
        half_width_spread_m: found.deflection_error,
        speed_dependence_p_value: found.speed_dependence_p_value,
        full_reversals: found.full_reversals.len(),
        insertion_branch,
        withdrawal_branch,
    }
}

/// A recording for a model file.
pub(crate) fn origin_of(recording: &Recording) -> RecordingInfo {
    let force_reversed = recording.choice.reverses_force();
    let Choice { columns, topics, flip_force, skip_rows, rate_hz, .. } = recording.choice.clone();
    let read_with = ReadWith { columns, topics, flip_force, force_reversed, skip_rows, rate_hz };
    RecordingInfo {
        name: recording.name.clone(),
        sha256: recording.sha256.clone(),
        read_with: Some(read_with).filter(|own| *own != ReadWith::default()),
    }
}

/// How to read another recording for `model`: by the choice `own`, or, where that is of a period at
/// most, as the model's recordings were read. `None` where only `own` is left.
pub fn choice_for(model: &ModelFile, own: &Choice) -> Option<Choice> {
    let (from, to) = (own.from, own.to);
    if *own != (Choice { from, to, ..Choice::default() }) {
        return None;
    }
    let ReadWith { columns, topics, flip_force, skip_rows, rate_hz, .. } =
        model.read_with()?.clone();
    Some(Choice {
        from,
        to,
        columns,
        topics,
        flip_force,
        skip_rows,
        rate_hz,
        from_another_file: true,
    })
}

/// Estimates in the form used in a model file.
pub(crate) fn intervals(parameters: &[Parameter]) -> BTreeMap<String, Interval> {
    parameters
        .iter()
        .filter_map(|parameter| {
            let Estimate { value, ci95, .. } = parameter.estimate;
            value.is_finite().then(|| {
                (
                    parameter.id.to_string(),
                    Interval { value, ci95: ci95.map(|bound| bound.is_finite().then_some(bound)) },
                )
            })
        })
        .collect()
}
