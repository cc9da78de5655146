//! Identification of an EMS element from recordings.
//!
//! ```text
//! recordings -> passes, stretches -> F_0, F_c, β (23), Stribeck (11)            steady.rs, stribeck.rs
//!            -> traverses, c, branches (12), (24)-(26), σ (figure 7)            deformation.rs, shape.rs       the paper's two steps
//!            -> all motion against simulated force: one likelihood              likelihood.rs, training.rs
//!               friction scale of each stroke, optional terms                   element.rs, scale.rs, terms.rs
//!            -> the force along the position, where strokes repeat it           along.rs
//!            -> intervals                                                       numbers.rs, spread.rs
//!            -> what the data determine, and whether the model is adequate      adequacy.rs, stick_slip.rs
//!            -> the result                                                      conclude.rs
//! ```
//!
//! Each stage takes data and options and returns its own result; conclude.rs assembles them. A
//! parameter that the data do not determine is reported with an infinite interval, the reason, and
//! a warning.

use serde::Serialize;
use trocar_model::{Element, ParameterId, Quantity, Stages, Trocar};

use crate::profile::ProfileFit;
use crate::recording::{Recording, RecordingError, range};
use crate::segment::{Pass, SegmentOptions, Stretch, passes, reversal_threshold, stretches};

pub use adequacy::Phase;
pub use candidate::Candidate;
pub use deformation::{BINS, BranchFit, DampingTest, DeformationFit, Limits, Traverse, bin_centres, legendre};
pub use estimate::Estimate;
pub(crate) use estimate::t_quantile;
pub use free_motion::FreeMotion;
pub use numbers::reported;
pub use refit::EmsRefit;
pub(crate) use refit::refit;
pub use scale::{FrictionScale, Jump, StrokeFriction};
pub use shape::{BranchShape, Pins};
pub use stage::SecondStage;
pub use steady::{DirectionLine, LackOfFit, PassMean, SteadyFit, StribeckFit};
pub use stick_slip::StickSlip;
pub use terms::{Term, TermTrial};
pub use unexplained::PositionDelay;

mod adequacy;
mod along;
mod candidate;
pub mod classical;
mod conclude;
mod deformation;
mod delay;
mod divide;
mod element;
mod estimate;
mod free_motion;
mod likelihood;
mod nnls;
mod numbers;
mod random;
mod refit;
mod replicates;
mod scale;
mod shape;
mod spread;
mod stage;
mod steady;
mod stick_slip;
mod stribeck;
mod terms;
mod training;
mod two_steps;
mod unexplained;

/// Options of the identification.
#[derive(Debug, Clone)]
pub struct IdentifyOptions {
    /// Resamples of the bootstrap over cycles; with 0 all intervals come from the jackknife.
    pub bootstrap: usize,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Degrees of the two joined polynomials, 2 to 7 (EMS (25): 4 and 4).
    pub degrees: [usize; 2],
    /// Whether to try the terms that only rests and partial reversals reveal: creep, relaxation,
    /// minor loops, a second stage.
    pub free_motion: bool,
    /// Optional terms that are not tried.
    pub without: Vec<Term>,
    /// Whether to fit the position-dependent force where strokes repeat.
    pub along: bool,
    /// Whether to estimate a mass between sensor and seal that was not declared.
    pub estimate_unmodelled_mass: bool,
    /// Whether the inertia of the moving mass was removed from the readings. Transients then count
    /// as sliding too, where the deformation is less than a hundredth of the stroke.
    pub inertia_removed: bool,
    /// Sensor reading without load, N, where it is known (a tare); `None` estimates it.
    pub offset: Option<f64>,
    /// Whether to use only the procedure of the paper.
    pub paper: bool,
    /// Tolerances of the segmentation.
    pub segment: SegmentOptions,
}

impl Default for IdentifyOptions {
    fn default() -> Self {
        Self {
            bootstrap: 200,
            seed: 1,
            degrees: [4, 4],
            free_motion: true,
            without: Vec::new(),
            along: true,
            estimate_unmodelled_mass: true,
            inertia_removed: false,
            offset: None,
            paper: false,
            segment: SegmentOptions::default(),
        }
    }
}

/// Why the identification failed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum IdentifyError {
    /// No recording was given.
    #[error("no recording to identify from")]
    NoRecording,
    /// No steady sliding anywhere.
    #[error(
        "no steady sliding found: {passes} strokes, {stretches} constant-velocity segments, none of them \
         after the deformation and free of clipped readings; and too little free motion to fit a model to\n\nhint: record strokes \
         at constant velocity (within 2 %, longer than 50 ms) that are longer than the seal's deformation, in both directions and at \
         several speeds, or half a minute of motion with many reversals"
    )]
    NoSteadySliding {
        /// Passes found.
        passes: usize,
        /// Stretches found.
        stretches: usize,
    },
    /// The force opposes the motion.
    #[error(
        "the sliding force opposes the motion: F_c = {coulomb_force:.3} N, expected above 0 N\n\nhint: the force is what the device \
         exerts on the seal; if the sensor is mounted the other way round, use --flip-force"
    )]
    ForceSign {
        /// Coulomb force found, N.
        coulomb_force: f64,
    },
    /// The force is constant, or exceeds the range of any sensor.
    #[error(
        "{name}: the force {what}, from which no friction can be identified\n\nhint: is the sensor connected, and is force_n the right \
         column, in newtons?"
    )]
    NoForce {
        /// Name of the recording.
        name: String,
        /// Description of the force.
        what: String,
    },
    /// The same recording was given twice.
    #[error("{first} and {second} hold the same bytes: counted twice, they would make every interval too narrow")]
    SameRecording {
        /// Name of the first.
        first: String,
        /// Name of the second.
        second: String,
    },
    /// The identified parameters do not form a valid model.
    #[error("the identified numbers do not make a model: {0}")]
    NotAModel(#[from] trocar_model::ParamError),
    /// Polynomial degree outside 2 to 7.
    #[error("polynomial degree must be between 2 and 7, got {0}")]
    Degree(usize),
}

/// A warning about the result.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Warning {
    /// What it concerns (`viscous_damping_n_s_m`, `steady.csv`).
    pub subject: String,
    /// The problem and its remedy.
    pub message: String,
    /// Whether the result is doubtful or incomplete because of it (exit code 3).
    pub doubtful: bool,
}

impl Warning {
    /// Start of the message about an undetermined parameter.
    const UNDETERMINED: &str = "not determined: ";

    /// Warning that the data do not determine `parameter`.
    pub(crate) fn undetermined(parameter: &Parameter, doubtful: bool) -> Self {
        let why = parameter.estimate.note.as_deref().unwrap_or("not identifiable from these data");
        Self { subject: parameter.id.to_string(), message: format!("{}{why}", Self::UNDETERMINED), doubtful }
    }

    /// Whether it reports that the data do not determine a parameter.
    pub fn is_undetermined(&self) -> bool {
        self.message.starts_with(Self::UNDETERMINED)
    }
}

/// Outcome of the likelihood fit.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FitSummary {
    /// Trials of the optional terms.
    pub terms: Vec<TermTrial>,
    /// Root mean square error, N, of the paper's element fitted to all motion, with the friction
    /// scale of each stroke removed.
    pub paper_rms_n: f64,
    /// The same for the model.
    pub rms_n: f64,
    /// Iterations of the last fit.
    pub iterations: usize,
    /// Whether it converged.
    pub converged: bool,
}

/// An estimated parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Which; its name in `summary.json` is that of the id.
    pub id: ParameterId,
    /// Value and interval.
    pub estimate: Estimate,
}

impl Parameter {
    /// A parameter with its estimate.
    pub(super) fn new(id: impl Into<ParameterId>, estimate: Estimate) -> Self {
        Self { id: id.into(), estimate }
    }

    /// Whether it is a coefficient of a branch (EMS (25)): determined together with the others only.
    pub fn is_coefficient(&self) -> bool {
        matches!(self.id.quantity, Quantity::Coefficient { .. })
    }
}

/// Result of an identification.
#[derive(Debug, Clone)]
pub struct Identification {
    /// The model's parameters.
    pub model: Candidate,
    /// The model, ready to run.
    pub stages: Stages,
    /// The two-step result.
    pub two_step: Candidate,
    /// All parameters with intervals.
    pub parameters: Vec<Parameter>,
    /// The same parameters by the paper's two steps alone.
    pub two_step_parameters: Vec<Parameter>,
    /// Steady-state step.
    pub steady: SteadyFit,
    /// Dynamic step, or why there is none.
    pub deformation: Result<DeformationFit, String>,
    /// The likelihood fit, which then defines the model; `None` when it was not requested or not
    /// possible.
    pub fit: Option<FitSummary>,
    /// Change of friction from stroke to stroke.
    pub friction_scale: FrictionScale,
    /// Content of the recordings beyond full strokes.
    pub free_motion: FreeMotion,
    /// Error of the model by phase of the motion.
    pub phases: Vec<Phase>,
    /// Self-excited oscillation of the force; `None` without any.
    pub stick_slip: Option<StickSlip>,
    /// The position delay that was found and compensated; `None` if none is detectable.
    pub position_delay: Option<PositionDelay>,
    /// Position dependence of the force in addition to the element; `None` where it does not
    /// improve the prediction of held-out strokes.
    pub position_profile: Option<ProfileFit>,
    /// Why repeated strokes gave no position profile.
    pub no_position_profile: Option<String>,
    /// Number of model parameters estimated from the recordings, without the sensor offset and an
    /// unmodelled mass.
    pub free_parameters: usize,
    /// Root mean square error, N, of the model over the recordings it was identified from.
    pub residual_rms: f64,
    /// Warnings about the result.
    pub warnings: Vec<Warning>,
}

impl Identification {
    /// The element, or the first of several stages.
    pub fn element(&self) -> &Element {
        self.stages.first()
    }

    /// The estimate of a parameter.
    pub fn estimate(&self, id: impl Into<ParameterId>) -> Option<&Estimate> {
        let id = id.into();
        self.parameters.iter().find(|p| p.id == id).map(|p| &p.estimate)
    }

    /// The estimate of the parameter of this name, such as `half_width_m`.
    pub fn parameter(&self, name: &str) -> Option<&Estimate> {
        self.estimate(name.parse::<ParameterId>().ok()?)
    }

    /// The model, with its position profile.
    pub fn trocar(&self) -> Trocar<&[f64]> {
        let profile = self.position_profile.as_ref().map(|fit| fit.profile.stored_as(|knots| knots));
        Trocar::new(self.stages, profile)
    }

    /// The recordings for comparison with the model: with the position delay compensated.
    ///
    /// # Errors
    /// As for [`Recording::with_position_delay`].
    pub fn without_delay(&self, recordings: Vec<Recording>) -> Result<Vec<Recording>, RecordingError> {
        let Some(PositionDelay { delay_s, .. }) = self.position_delay else { return Ok(recordings) };
        recordings.iter().map(|recording| recording.with_position_delay(delay_s)).collect()
    }

    /// A remark for the model file if the deformation was not identified.
    pub(crate) fn deformation_note(&self) -> Option<String> {
        let fitted = self.fit.is_some();
        let assumed = self.deformation.as_ref().err().filter(|_| !fitted);
        assumed.map(|why| format!("deformation assumed, not identified: {why}"))
    }

    /// Whether data were lost or parameters are not determined (exit code 3).
    pub fn is_doubtful(&self) -> bool {
        self.warnings.iter().any(|w| w.doubtful)
    }
}

/// Callback for a progress display: name of the stage and fraction done, 0 to 1.
pub type Progress<'a> = &'a (dyn Fn(&str, f64) + Sync);

/// Passes and stretches of one recording.
struct Segments {
    passes: Vec<Pass>,
    stretches: Vec<Stretch>,
}

/// Identifies an EMS element from recordings of any motion.
///
/// Forces are expected without the inertia of a known moving mass
/// ([`Recording::without_moving_mass`](crate::recording::Recording)).
///
/// # Errors
/// [`IdentifyError`] when there is nothing to identify from. Parameters that are merely not
/// determined are part of the result.
pub fn identify(
    recordings: &[Recording],
    options: &IdentifyOptions,
    progress: Progress,
) -> Result<Identification, IdentifyError> {
    if recordings.is_empty() {
        return Err(IdentifyError::NoRecording);
    }
    if let Some(degree) = options.degrees.into_iter().find(|d| !(2..=trocar_model::MAX_DEGREE).contains(d)) {
        return Err(IdentifyError::Degree(degree));
    }
    for (i, second) in recordings.iter().enumerate() {
        if let Some(first) = recordings[..i].iter().find(|r| r.sha256 == second.sha256) {
            return Err(IdentifyError::SameRecording { first: first.name.clone(), second: second.name.clone() });
        }
    }
    recordings.iter().try_for_each(shows_force)?;
    progress("steady state", 0.1);
    let (in_time, fit) = delay::fitted(recordings, options, progress)?;
    let (input, lag) = (in_time.input(options), in_time.lag);
    if fit.is_none() && input.two.steady.means.is_empty() {
        return Err(IdentifyError::NoSteadySliding {
            passes: input.segments.iter().map(|s| s.passes.len()).sum(),
            stretches: input.segments.iter().map(|s| s.stretches.len()).sum(),
        });
    }
    progress("position profile", 0.8);
    let (fit, profile) = along::profiled(&input, fit);
    progress("intervals", 0.9);
    conclude::conclude(&input, fit, profile, lag)
}

/// Range of the force, in units of its noise, that noise alone rarely reaches.
const BEYOND_NOISE: f64 = 10.0;
/// Change of the force, N and as a fraction of the largest, that is rounding.
const LEAST_CHANGE: f64 = 1e-9;
const ROUNDING: f64 = 1e-9;
/// Force, N, beyond that of instruments and of robot axes.
const LARGEST_FORCE: f64 = 1e6;

/// Rejects a recording whose force contains no friction.
fn shows_force(recording: &Recording) -> Result<(), IdentifyError> {
    let no_force = |what: String| Err(IdentifyError::NoForce { name: recording.name.clone(), what });
    let (low, high) = range(&recording.force);
    let noise = recording.quality.force_noise;
    let largest = low.abs().max(high.abs());
    if largest > LARGEST_FORCE {
        return no_force(format!("reaches {largest:.1e} N, which no instrument exerts"));
    }
    // One stroke at constant speed has a constant force.
    if passes(recording, reversal_threshold(recording)).len() < 2 {
        return Ok(());
    }
    // Interpolation between equal readings rounds.
    if high - low <= LEAST_CHANGE.max(ROUNDING * largest) {
        return no_force(format!("is {} N throughout", 0.5 * (low + high)));
    }
    if high - low < BEYOND_NOISE * noise {
        return no_force(format!(
            "changes by {:.3} N, no more than its noise of {noise:.3} N rms makes it",
            high - low
        ));
    }
    Ok(())
}

fn segment(recording: &Recording, options: &SegmentOptions) -> Segments {
    let passes = passes(recording, reversal_threshold(recording));
    let stretches = stretches(recording, &passes, options);
    Segments { passes, stretches }
}
